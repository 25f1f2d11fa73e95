//! What a history proposes for a configuration: for `telltale learn` and for the developer's page.

use anyhow::ensure;

use crate::config::Loaded;
use crate::engine::model::NodeId;
use crate::engine::state::State;
use crate::learn::{History, Proposals, Stretch};
use crate::onboarding::update::dependencies::{Edit, Edited, edit};
use crate::store::Period;

/// Every module is compared with every other one.
const MODULES_MAX: usize = 1_000;

/// The names of the modules, for their reports in a history.
///
/// # Errors
/// They are too many.
pub fn names(loaded: &Loaded) -> anyhow::Result<Vec<String>> {
    let modules = &loaded.model.modules;
    ensure!(
        modules.len() <= MODULES_MAX,
        "at most {MODULES_MAX} modules can be compared, and the configuration has {}",
        modules.len()
    );
    Ok(modules.iter().map(|module| module.id.to_string()).collect())
}

/// What these modules reported; `None` if that is nothing.
pub fn history(reported: Vec<Vec<Period<State>>>) -> Option<History> {
    let stretch = |it: Period<State>| Stretch { from_ms: it.from_ms, to_ms: it.to_ms, own: it.value };
    let of_module = |periods: Vec<Period<State>>| periods.into_iter().map(stretch).collect();
    let modules: Vec<Vec<Stretch>> = reported.into_iter().map(of_module).collect();
    modules.iter().any(|it| !it.is_empty()).then_some(History { modules })
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
