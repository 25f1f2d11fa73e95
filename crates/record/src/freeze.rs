//! The freeze frame of an incident: the modules with their values at the instants of its faults.

use std::collections::HashSet;

use super::incident::{Open, Trigger};
use super::summary::FrozenNode;
use telltale_engine::model::{GroupId, ModuleId, NodeId};
use telltale_engine::snapshot::{Reason, Snapshot};
use telltale_engine::state::State;

/// Modules at the first trigger.
const FIRST_MAX: usize = 64;
/// Modules of an incident in all. One may be there several times.
const MODULES_MAX: usize = 128;
const VALUES_MAX: usize = 32;
const TEXT_BYTES_MAX: usize = 256;

/// At the first trigger: the root causes and what the trigger names, everything else that fails, the symptoms that they
/// explain included, and the other modules of their groups. While nothing fails, as at a mark: all modules.
pub fn first(snapshot: &Snapshot, open: &Open) -> Vec<FrozenNode> {
    let named = open.triggers.iter().filter_map(|(_, trigger)| match trigger {
        Trigger::Root { node, .. } | Trigger::OwnError { node } => snapshot.node(node),
        _ => None,
    });
    let causes = snapshot.roots.iter().map(|root| root.node).chain(named).collect();
    let mut modules = concerned(snapshot, causes);
    if modules.is_empty() {
        let counts = |id: &ModuleId| {
            let (group, _) = snapshot.group(snapshot.module(*id).0.group);
            group.counted && !group.is_system
        };
        modules = all(snapshot).filter(counts).collect();
    }
    modules.into_iter().take(FIRST_MAX).map(|id| frozen(snapshot, id)).collect()
}

/// The modules that a later trigger about a node adds: the module as it is now, and those that were not there.
pub fn later(snapshot: &Snapshot, node: &str, known: &[FrozenNode]) -> Vec<FrozenNode> {
    let Some(node) = snapshot.node(node) else { return Vec::new() };
    let names: HashSet<&str> = known.iter().map(|it| &*it.node).collect();
    let is_new = |it: &FrozenNode, id: ModuleId| match NodeId::Module(id) == node {
        true => !known.contains(it),
        false => !names.contains(&*it.node),
    };
    let modules = concerned(snapshot, vec![node]).into_iter().map(|id| (frozen(snapshot, id), id));
    let new = modules.filter(|(it, id)| is_new(it, *id)).map(|(it, _)| it);
    new.take(MODULES_MAX.saturating_sub(known.len())).collect()
}

/// The causes, everything that fails, and the other modules of their groups: those of the causes first.
fn concerned(snapshot: &Snapshot, causes: Vec<NodeId>) -> Vec<ModuleId> {
    let of_group = |id: GroupId| snapshot.group(id).0.modules.iter().copied();
    let mut modules: Vec<ModuleId> = Vec::new();
    let mut groups: Vec<GroupId> = Vec::new();
    for cause in causes {
        match cause {
            NodeId::Module(id) => {
                modules.push(id);
                groups.push(snapshot.module(id).0.group);
            }
            NodeId::Group(id) => groups.push(id),
        }
    }
    let failing: Vec<ModuleId> = all(snapshot).filter(|id| fails(snapshot, *id)).collect();
    let (hidden, shown): (Vec<ModuleId>, Vec<ModuleId>) =
        failing.iter().copied().partition(|id| snapshot.module(*id).1.reason.is_some());
    modules.extend(shown);
    modules.extend(hidden);
    modules.extend(groups.into_iter().flat_map(of_group));
    modules.extend(failing.iter().flat_map(|id| of_group(snapshot.module(*id).0.group)));
    let mut seen = HashSet::new();
    modules.retain(|id| seen.insert(*id));
    modules
}

fn all(snapshot: &Snapshot) -> impl Iterator<Item = ModuleId> {
    let groups = (0..).map(GroupId).take(snapshot.groups.len());
    groups.flat_map(|id| snapshot.group(id).0.modules.iter().copied())
}

/// Whether it is in a state that counts, shown or hidden behind its cause.
fn fails(snapshot: &Snapshot, id: ModuleId) -> bool {
    let (info, view) = snapshot.module(id);
    let matters = !matches!(view.reason, Some(Reason::NotRelevant(_)));
    let counts = snapshot.group(info.group).0.counted;
    matters && counts && matches!(view.own, State::Warning | State::Error | State::Unknown)
}

fn frozen(snapshot: &Snapshot, id: ModuleId) -> FrozenNode {
    let (info, view) = snapshot.module(id);
    let values = view.report.values.iter().take(VALUES_MAX);
    FrozenNode {
        node: info.id.to_string(),
        state: view.state.as_str().to_owned(),
        message: cut(&view.report.message),
        values: values.map(|(key, value)| (cut(key), cut(value))).collect(),
        at_ms: None,
    }
}

fn cut(text: &str) -> String {
    text[..text.floor_char_boundary(TEXT_BYTES_MAX)].to_owned()
}
