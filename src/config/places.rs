//! Where the nodes of a model are written.

use crate::engine::model::NodeId;
use crate::yaml::{Sources, Span};

#[derive(Debug, Clone)]
pub(super) struct Places {
    pub sources: Sources,
    /// By the ids of the model.
    pub groups: Vec<NodePlace>,
    pub modules: Vec<NodePlace>,
}

#[derive(Debug, Clone)]
pub(super) struct NodePlace {
    pub id: Span,
    pub when: Option<Span>,
    /// By position in the node's `depends_on`.
    pub depends_on: Vec<Span>,
}

impl Places {
    pub fn of(&self, node: NodeId) -> &NodePlace {
        match node {
            NodeId::Group(id) => &self.groups[id.0 as usize],
            NodeId::Module(id) => &self.modules[id.0 as usize],
        }
    }
}
