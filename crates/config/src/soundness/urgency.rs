//! Finds dependencies where a less urgent cause hides a more urgent fault: the page names the cause and gives the advice
//! for the fault.

use super::late::{dependencies, is_inside};
use super::{Finding, FindingKind};
use telltale_engine::model::wording::Urgency;
use telltale_engine::model::{Model, ModuleId, NodeId, Stage, Within};
use telltale_engine::state::State;

/// The less urgent faults of a dependency before a more urgent one of its holder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Behind {
    pub holder: NodeId,
    pub dependency: usize,
    /// The number of modules whose ERROR is less urgent.
    pub less_urgent: usize,
    /// One of them, if it is the only one.
    pub only: Option<ModuleId>,
    /// The most urgent module of the holder.
    pub hidden: ModuleId,
}

/// In the order of the configuration.
pub fn behind(model: &Model) -> Vec<Behind> {
    let ids = || (0..model.modules.len() as u32).map(ModuleId);
    let mut found = Vec::new();
    for (holder, dependency) in dependencies(model) {
        let urgent =
            ids().filter(|&id| is_inside(model, id, holder)).rev().max_by_key(|&id| urgency(model, id));
        let Some(hidden) = urgent.filter(|&id| urgency(model, id).is_some()) else { continue };
        let targets = model.depends_on(holder)[dependency].targets();
        let less = |&id: &ModuleId| {
            targets.iter().any(|&target| is_inside(model, id, target))
                && urgency(model, id) < urgency(model, hidden)
        };
        let mut causes = ids().filter(less);
        if let Some(first) = causes.next() {
            let less_urgent = 1 + causes.count();
            let only = (less_urgent == 1).then_some(first);
            found.push(Behind { holder, dependency, less_urgent, only, hidden });
        }
    }
    found
}

/// The urgency of a module's ERROR for the operator of a driving vehicle.
fn urgency(model: &Model, id: ModuleId) -> Option<Urgency> {
    let help = model.modules[id.0 as usize].help.as_ref()?;
    help.of(State::Error, Stage::Active)?.urgency
}

/// Those that stay hidden, however late they come.
pub(super) fn look(model: &Model) -> Vec<Finding> {
    let always = |it: &Behind| model.depends_on(it.holder)[it.dependency].within == Within::Always;
    let found = behind(model).into_iter().filter(always);
    found.map(|it| Finding { node: it.holder, what: FindingKind::HidesUrgent(it), example: None }).collect()
}
