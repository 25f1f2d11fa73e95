//! The arrows of the graph; those on a path from a root cause are hot.

use std::collections::BTreeMap;

use telltale_engine::model::{DependsOn, GroupId, NodeId};
use telltale_engine::snapshot::Reason;
use telltale_engine::state::State;

use super::Graph;

/// The dependencies between two nodes that are drawn.
#[derive(Default)]
pub(super) struct Link {
    pub any: bool,
    pub hot: bool,
    /// Dependencies that this arrow stands for.
    pub count: usize,
}

impl Graph<'_> {
    /// By the node that is depended on and the node that depends, unless both are drawn as one.
    pub(super) fn links(&self) -> BTreeMap<(NodeId, NodeId), Link> {
        let layout = &self.view.snapshot.layout;
        let mut links: BTreeMap<(NodeId, NodeId), Link> = BTreeMap::new();
        for from in layout.nodes() {
            for dependency in layout.depends_on(from) {
                let any = matches!(dependency, DependsOn::AnyOf(_));
                for &on in dependency.nodes() {
                    if self.near.as_ref().is_some_and(|near| !near.joins(on, from)) {
                        continue;
                    }
                    let (Some(left), Some(right)) = (self.shown(on), self.shown(from)) else { continue };
                    if left == right {
                        continue;
                    }
                    let link = links.entry((left, right)).or_default();
                    link.any |= any;
                    link.hot |= self.is_hot(on, from);
                    link.count += 1;
                }
            }
        }
        links
    }

    /// Whether a root cause masks `from` by way of `on`.
    fn is_hot(&self, on: NodeId, from: NodeId) -> bool {
        let snapshot = self.view.snapshot;
        let Some(Reason::Masked { by }) = snapshot.shown(from).1 else { return false };
        match (on, snapshot.shown(on)) {
            (_, (_, Some(Reason::Masked { by: further }))) => by.iter().any(|root| further.contains(root)),
            (_, (_, Some(Reason::NotRelevant(_)))) => false,
            (NodeId::Group(id), (State::Error | State::Unknown, None)) => {
                by.contains(&on)
                    || by.iter().any(|&root| self.is_inside(root, id))
                    || snapshot
                        .group(id)
                        .1
                        .paths
                        .iter()
                        .any(|path| path.last().is_some_and(|root| by.contains(root)))
            }
            (NodeId::Module(_), _) => by.contains(&on),
            _ => false,
        }
    }

    fn is_inside(&self, node: NodeId, group: GroupId) -> bool {
        node == NodeId::Group(group) || self.view.snapshot.layout.around(node).any(|it| it == group)
    }
}
