//! The part of the graph around one node: what it depends on, and what depends on it.

use std::collections::BTreeSet;

use super::open::OpenGroups;
use super::{Graph, STYLE};
use crate::view::View;
use telltale_engine::model::{GroupId, NodeId};
use telltale_picture::graph::{self, Drawing};

/// Neighbours that are drawn in each direction, in the order of the configuration.
const NEIGHBOURS: usize = 20;
/// Modules of one group.
const MODULES: usize = 12;

pub(super) struct Near {
    pub node: NodeId,
    /// The node, what is in it and around it.
    own: BTreeSet<NodeId>,
    /// All that is drawn, with the groups around it.
    drawn: BTreeSet<NodeId>,
}

impl Near {
    pub fn has(&self, node: NodeId) -> bool {
        self.drawn.contains(&node)
    }

    /// Whether a dependency is one of the node's.
    pub fn joins(&self, on: NodeId, from: NodeId) -> bool {
        self.own.contains(&on) != self.own.contains(&from) || on == self.node || from == self.node
    }
}

/// The neighbours of a node, and how many further ones are not drawn. `None` if it has none.
pub(in crate::developer) fn neighbourhood(view: &View<'_>, node: NodeId) -> Option<(Drawing, usize)> {
    let layout = &view.snapshot.layout;
    let own: BTreeSet<NodeId> =
        layout.around(node).map(NodeId::Group).chain(inside(view, node)).chain([node]).collect();
    let (mut needs, mut needed_by) = (BTreeSet::new(), BTreeSet::new());
    for from in layout.nodes() {
        for &on in layout.depends_on(from).iter().flat_map(|it| it.nodes()) {
            match (own.contains(&from), own.contains(&on)) {
                (true, false) => needs.insert(on),
                (false, true) => needed_by.insert(from),
                // Between two members, or between a member and the node.
                (true, true) if from == node => needs.insert(on),
                (true, true) if on == node => needed_by.insert(from),
                _ => false,
            };
        }
    }
    if needs.is_empty() && needed_by.is_empty() {
        return None;
    }
    let more = needs.len().saturating_sub(NEIGHBOURS) + needed_by.len().saturating_sub(NEIGHBOURS);
    let neighbours = needs.iter().take(NEIGHBOURS).chain(needed_by.iter().take(NEIGHBOURS)).copied();
    let mut drawn: BTreeSet<NodeId> = neighbours.chain([node]).collect();
    for inner in drawn.clone() {
        drawn.extend(layout.around(inner).map(NodeId::Group));
    }
    let mut graph = Graph {
        view,
        open: OpenGroups::AllBut(Vec::new()),
        near: Some(Near { node, own, drawn: drawn.clone() }),
        each: MODULES,
        groups: vec![None; layout.groups.len()],
        modules: vec![None; layout.modules.len()],
        tops: Vec::new(),
        proposed: Vec::new(),
        kept: "",
    };
    let is_top = |id: &GroupId| layout.groups[id.0 as usize].parent.is_none();
    let groups = drawn.iter().filter_map(|node| if let NodeId::Group(id) = node { Some(*id) } else { None });
    graph.tops = groups.filter(is_top).collect();
    for top in graph.tops.clone() {
        graph.stand_for(top, None);
    }
    let boxes: Vec<_> = graph.tops.iter().map(|&top| graph.group(top)).collect();
    Some((graph::draw(&STYLE, &boxes, &graph.arrows()), more))
}

/// The groups and modules in a node.
fn inside(view: &View<'_>, node: NodeId) -> Vec<NodeId> {
    let NodeId::Group(id) = node else { return Vec::new() };
    let group = &view.snapshot.layout.groups[id.0 as usize];
    let modules = group.modules.iter().map(|&id| NodeId::Module(id));
    let inner = group.groups.iter().flat_map(|&id| {
        let id = NodeId::Group(id);
        std::iter::once(id).chain(inside(view, id))
    });
    modules.chain(inner).collect()
}
