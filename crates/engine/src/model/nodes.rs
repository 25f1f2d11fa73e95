//! Questions about a node of the model, be it a group or a module.

use super::{Dependency, GroupId, NodeId, Parts, When};

impl Parts {
    /// All groups, then all modules.
    pub fn nodes(&self) -> impl Iterator<Item = NodeId> + use<> {
        NodeId::all(self.groups.len(), self.modules.len())
    }

    /// The name of a node in paths and on the wire: `a/b` or `a/b/module`.
    pub fn node_name(&self, node: NodeId) -> &str {
        match node {
            NodeId::Group(id) => &self.groups[id.0 as usize].path,
            NodeId::Module(id) => &self.modules[id.0 as usize].id,
        }
    }

    /// The group that contains a node.
    pub fn parent(&self, node: NodeId) -> Option<GroupId> {
        match node {
            NodeId::Group(id) => self.groups[id.0 as usize].parent,
            NodeId::Module(id) => Some(self.modules[id.0 as usize].group),
        }
    }

    /// The enclosing groups of a node, from the inside out.
    pub fn around(&self, node: NodeId) -> impl Iterator<Item = GroupId> {
        std::iter::successors(self.parent(node), |group| self.groups[group.0 as usize].parent)
    }

    pub fn when(&self, node: NodeId) -> Option<&When> {
        match node {
            NodeId::Group(id) => self.groups[id.0 as usize].when.as_ref(),
            NodeId::Module(id) => self.modules[id.0 as usize].when.as_deref(),
        }
    }

    pub fn depends_on(&self, node: NodeId) -> &[Dependency] {
        match node {
            NodeId::Group(id) => &self.groups[id.0 as usize].depends_on,
            NodeId::Module(id) => &self.modules[id.0 as usize].depends_on,
        }
    }

    /// The members of each group: its groups, then its modules.
    pub fn members(&self) -> Vec<Vec<NodeId>> {
        let mut members = vec![Vec::new(); self.groups.len()];
        for node in self.nodes() {
            if let Some(parent) = self.parent(node) {
                members[parent.0 as usize].push(node);
            }
        }
        members
    }
}
