//! WARNINGs, and whether the operator accepted them. They are updated as they come and go, so no walk through
//! the vehicle is needed to find those that are not accepted.

use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

use crate::mask::net::{Change, Net};
use crate::model::{ModuleId, NodeId};
use crate::state::State;

/// Modules that show WARNING, by whether the operator accepted it.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Warnings {
    open: BTreeSet<ModuleId>,
    accepted: BTreeSet<ModuleId>,
    /// Accepted before a restart, without a report of the module since.
    awaited: BTreeSet<ModuleId>,
}

impl Warnings {
    /// Follows a module. An acceptance ends with the WARNING, however that ends.
    pub(crate) fn note(&mut self, net: &Net, change: &Change) -> bool {
        let NodeId::Module(id) = change.node else { return false };
        let module = &net.modules[id.0 as usize];
        let group = module.node.parent.map(|group| &net.groups[group.0 as usize]);
        if group.is_none_or(|group| group.aside) {
            return false;
        }
        let warns = change.after.shown == State::Warning;
        if module.own.received().is_some() && self.awaited.remove(&id) && warns {
            return self.accepted.insert(id);
        }
        if !warns {
            return self.open.remove(&id) | self.accepted.remove(&id);
        }
        !self.accepted.contains(&id) && self.open.insert(id)
    }

    /// All modules that are noted.
    pub(crate) fn nodes(&self) -> impl Iterator<Item = NodeId> {
        let all = self.open.iter().chain(&self.accepted).chain(&self.awaited);
        all.map(|&id| NodeId::Module(id))
    }

    /// The module was removed.
    pub(crate) fn forget(&mut self, id: ModuleId) {
        self.open.remove(&id);
        self.accepted.remove(&id);
        self.awaited.remove(&id);
    }

    pub(crate) fn open(&self) -> impl Iterator<Item = ModuleId> {
        self.open.iter().copied()
    }

    pub(crate) fn accept(&mut self, id: ModuleId) {
        if self.open.remove(&id) {
            self.accepted.insert(id);
        }
    }

    pub(crate) fn is_accepted(&self, id: ModuleId) -> bool {
        self.accepted.contains(&id)
    }

    /// Accepted WARNINGs, and those that were accepted before a restart and may return.
    pub(crate) fn accepted(&self) -> impl Iterator<Item = ModuleId> {
        self.accepted.union(&self.awaited).copied()
    }

    /// Takes over an acceptance from before a restart or a reload.
    pub(crate) fn expect(&mut self, id: ModuleId) {
        self.awaited.insert(id);
    }
}
