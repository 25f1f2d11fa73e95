//! Questions of the rest of the engine about the shown state.

use super::Views;
use crate::model::wording::{Advice, Wording};
use crate::model::{GroupId, ModuleId, NodeId};
use crate::react::shelves::Shelves;
use crate::snapshot::Reason;

impl Views {
    pub(crate) fn module(&self, name: &str) -> Option<ModuleId> {
        self.module_ids().find(|(id, _)| *id == name).map(|(_, id)| id)
    }

    /// The status of a module.
    pub(crate) fn status_of(&self, node: NodeId) -> Option<&str> {
        match node {
            NodeId::Module(id) => self.layout.modules[id.0 as usize].status.as_deref(),
            NodeId::Group(_) => None,
        }
    }

    /// The advice for a fault of a module, one of Telltale's own included.
    pub(crate) fn help(&self, id: ModuleId) -> Option<&Wording<Advice>> {
        self.layout.modules[id.0 as usize].help.as_deref()
    }

    pub(crate) fn has(&self, name: &str) -> bool {
        self.names.contains(name)
    }

    /// The ranked causes of a masked node; none if it is not masked.
    pub(crate) fn masked_by(&self, node: NodeId) -> Vec<NodeId> {
        match self.reason(node) {
            Some(Reason::Masked { by }) => by.to_vec(),
            Some(Reason::NotRelevant(_)) | None => Vec::new(),
        }
    }

    pub(crate) fn module_ids(&self) -> impl Iterator<Item = (&str, ModuleId)> {
        let modules = self.layout.modules.iter().enumerate().filter(|(_, module)| !module.gone);
        modules.map(|(index, module)| (&*module.id, ModuleId(index as u32)))
    }

    pub(crate) fn paths(&self) -> impl Iterator<Item = (GroupId, &str)> {
        self.layout.groups.iter().zip(0..).map(|(group, index)| (GroupId(index), &*group.path))
    }

    pub(crate) fn nodes(&self) -> impl Iterator<Item = (NodeId, &str)> {
        self.layout.nodes().map(|node| (node, self.name(node)))
    }

    /// Root causes, ranked, each with whether it raises an alarm.
    pub(crate) fn roots(&self, shelves: &Shelves) -> Vec<(NodeId, bool)> {
        let roots = self.roots.iter().filter(|root| !shelves.has(root.node));
        roots.map(|root| (root.node, !root.grace)).collect()
    }

    /// The number of root causes that raise an alarm.
    pub(crate) fn alarm_count(&self, shelves: &Shelves) -> usize {
        self.roots.iter().filter(|root| !root.grace && !shelves.has(root.node)).count()
    }

    pub(crate) fn root_count(&self) -> usize {
        self.roots.len()
    }

    /// A root cause that is masked itself. Every change of masking has made a search.
    pub(crate) fn masked_root(&self) -> Option<&str> {
        self.masked_root.map(|node| self.name(node))
    }

    /// A masked node without a cause. The last search updated every node that lost its last cause.
    pub(crate) fn masked_by_nothing(&self) -> Option<&str> {
        self.unexplained.map(|node| self.name(node))
    }

    pub(crate) fn reason(&self, node: NodeId) -> Option<&Reason> {
        match node {
            NodeId::Group(id) => self.groups[id.0 as usize].reason.as_ref(),
            NodeId::Module(id) => self.modules[id.0 as usize].reason.as_ref(),
        }
    }

    pub(crate) fn name(&self, node: NodeId) -> &str {
        self.layout.node_name(node)
    }
}
