//! Look-ups of a node in the layout of a snapshot, discovered modules included: its name, what it depends on, its groups.

use crate::model::{DependsOn, GroupId, NodeId};
use crate::snapshot::Layout;
use std::collections::HashMap;
use std::sync::Arc;

impl Layout {
    /// All groups, then all modules, with those that have left.
    pub fn nodes(&self) -> impl Iterator<Item = NodeId> + use<> {
        NodeId::all(self.groups.len(), self.modules.len())
    }

    /// The name of a node in paths and on the wire: `a/b` or `a/b/module`.
    pub fn node_name(&self, node: NodeId) -> &Arc<str> {
        match node {
            NodeId::Group(id) => &self.groups[id.0 as usize].path,
            NodeId::Module(id) => &self.modules[id.0 as usize].id,
        }
    }

    pub fn depends_on(&self, node: NodeId) -> &[DependsOn] {
        match node {
            NodeId::Group(id) => &self.groups[id.0 as usize].depends_on,
            NodeId::Module(id) => &self.modules[id.0 as usize].depends_on,
        }
    }

    /// The group itself, or that of the module.
    pub fn group_of(&self, node: NodeId) -> GroupId {
        match node {
            NodeId::Group(id) => id,
            NodeId::Module(id) => self.modules[id.0 as usize].group,
        }
    }

    /// The enclosing groups of a node, from the inside out.
    pub fn around(&self, node: NodeId) -> impl Iterator<Item = GroupId> {
        let of_group = |id: &GroupId| self.groups[id.0 as usize].parent;
        let first = match node {
            NodeId::Group(id) => of_group(&id),
            NodeId::Module(id) => Some(self.modules[id.0 as usize].group),
        };
        std::iter::successors(first, of_group)
    }

    /// What was kept of each module of the layout before this one, by `ModuleId` of this one. A module is known by its
    /// name.
    pub fn rearranged<T: Default>(&self, before: Option<&Layout>, kept: Vec<T>) -> Vec<T> {
        let names = before.into_iter().flat_map(|before| &before.modules).map(|info| &info.id);
        let mut kept: HashMap<&Arc<str>, T> = names.zip(kept).collect();
        self.modules.iter().map(|info| kept.remove(&info.id).unwrap_or_default()).collect()
    }

    /// The group without a parent in which a node is, or which it is.
    pub fn outermost(&self, node: NodeId) -> GroupId {
        self.around(node).last().unwrap_or_else(|| self.group_of(node))
    }
}
