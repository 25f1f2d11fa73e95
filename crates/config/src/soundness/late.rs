//! Finds modules whose ERROR may come later than a dependency's `within`: their symptoms would count as second faults.

use super::{Finding, FindingKind};
use telltale_engine::model::{Model, ModuleId, NodeId, Within};
use telltale_engine::state::State;

/// One finding for a module: the dependency with the shortest limit.
pub(super) fn look(model: &Model) -> Vec<Finding> {
    let mut found = Vec::new();
    for (id, module) in (0..).map(ModuleId).zip(&model.modules) {
        let after = model.lateness(module, State::Error).latest();
        let near = dependencies(model)
            .filter(|(holder, index)| concerns(model, id, (*holder, *index)))
            .filter_map(|(holder, index)| match model.depends_on(holder)[index].within {
                Within::Limit(limit) if limit < after => Some((limit, holder, index)),
                Within::Limit(_) | Within::Always => None,
            });
        if let Some((limit, holder, dependency)) = near.min_by_key(|(limit, ..)| *limit) {
            let late = NodeId::Module(id);
            let what = FindingKind::LateCause { late, after, limit, dependency };
            found.push(Finding { node: holder, what, example: None });
        }
    }
    found
}

/// Each dependency by its holder and its index.
pub(super) fn dependencies(model: &Model) -> impl Iterator<Item = (NodeId, usize)> + '_ {
    model.nodes().flat_map(|node| (0..model.depends_on(node).len()).map(move |index| (node, index)))
}

/// Whether a dependency is one of the module itself, or one on it.
fn concerns(model: &Model, id: ModuleId, (holder, index): (NodeId, usize)) -> bool {
    holder == NodeId::Module(id)
        || model.depends_on(holder)[index].targets().iter().any(|&target| is_inside(model, id, target))
}

pub(super) fn is_inside(model: &Model, id: ModuleId, node: NodeId) -> bool {
    match node {
        NodeId::Module(other) => other == id,
        NodeId::Group(group) => model.around(NodeId::Module(id)).any(|it| it == group),
    }
}
