//! What a history proposes for a configuration: for `telltale learn` and for the developer's page.

use anyhow::ensure;

use crate::config::Loaded;
use crate::engine::model::NodeId;
use crate::engine::state::State;
use crate::learn::{About, Fact, History, Proposals, Stretch};
use crate::onboarding::update::dependencies::{Edit, Edited, edit};
use crate::store::{Period, Reported};

/// Every module is compared with every other one.
const MODULES_MAX: usize = 1_000;

/// The names of the modules and of the signals, for what a history has of them.
///
/// # Errors
/// The modules are too many.
pub fn names(loaded: &Loaded) -> anyhow::Result<(Vec<String>, Vec<String>)> {
    let modules = &loaded.model.modules;
    ensure!(
        modules.len() <= MODULES_MAX,
        "at most {MODULES_MAX} modules can be compared, and the configuration has {}",
        modules.len()
    );
    let signals = loaded.model.signals.iter().map(|signal| signal.name.to_string());
    Ok((modules.iter().map(|module| module.id.to_string()).collect(), signals.collect()))
}

/// What these modules reported, and what held then; `None` if they reported nothing.
pub fn history(reported: Reported) -> Option<History> {
    fn fact<T>(about: About, periods: Vec<Period<T>>, value: impl Fn(T) -> usize) -> Fact {
        let period = |it: Period<T>| (it.from_ms, it.to_ms, value(it.value));
        Fact { about, periods: periods.into_iter().map(period).collect() }
    }
    let stretch = |it: Period<State>| Stretch { from_ms: it.from_ms, to_ms: it.to_ms, own: it.value };
    let of_module = |periods: Vec<Period<State>>| periods.into_iter().map(stretch).collect();
    let modules: Vec<Vec<Stretch>> = reported.nodes.into_iter().map(of_module).collect();
    let signals = reported.signals.into_iter().enumerate();
    let signals = signals.map(|(index, periods)| fact(About::Signal(index), periods, usize::from));
    let stages = fact(About::Stages, reported.stages, |stage| stage as usize);
    let facts = signals.chain([stages]).collect();
    modules.iter().any(|it| !it.is_empty()).then_some(History { modules, facts })
}

/// The configuration with the proposals, which means these and nothing else; `None` if there are none.
pub fn edited(loaded: &Loaded, proposals: &Proposals) -> Option<Edited> {
    let model = &loaded.model;
    let name = |node| model.node_name(node).to_owned();
    let add = proposals.add.iter().map(|index| &proposals.learned[*index]).map(|edge| Edit::Add {
        node: name(NodeId::Module(edge.dependent)),
        on: name(NodeId::Module(edge.cause)),
    });
    let replace = proposals.doubted.iter().map(|doubt| Edit::Replace {
        node: name(doubt.node),
        index: doubt.index,
        on: doubt.remains.iter().map(|it| name(NodeId::Module(*it))).collect(),
    });
    let edits: Vec<Edit> = add.chain(replace).collect();
    (!edits.is_empty()).then(|| edit(loaded, &edits))
}
