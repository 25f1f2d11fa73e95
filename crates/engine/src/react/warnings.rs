//! WARNINGs, and whether the operator accepted them. They are updated as they come and go, so no walk through
//! the vehicle is needed to find those that are not accepted.

use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};

use crate::mask::net::{Change, Net};
use crate::model::{ModuleId, NodeId};
use crate::state::State;
use crate::time::Timestamp;

/// Modules that show WARNING, by whether the operator accepted it.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Warnings {
    open: BTreeSet<ModuleId>,
    /// Each with the time of that; `None` before a restart.
    accepted: BTreeMap<ModuleId, Option<Timestamp>>,
    /// Accepted before a restart, without a report of the module since.
    awaited: BTreeMap<ModuleId, Option<Timestamp>>,
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
        if module.own.received().is_some()
            && let Some(at) = self.awaited.remove(&id)
            && warns
        {
            return self.accepted.insert(id, at).is_none();
        }
        if !warns {
            return self.open.remove(&id) | self.accepted.remove(&id).is_some();
        }
        !self.is_accepted(id) && self.open.insert(id)
    }

    /// All modules that are noted.
    pub(crate) fn nodes(&self) -> impl Iterator<Item = NodeId> {
        let all = self.open.iter().chain(self.accepted.keys()).chain(self.awaited.keys());
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

    pub(crate) fn accept(&mut self, id: ModuleId, now: Timestamp) {
        if self.open.remove(&id) {
            self.accepted.insert(id, Some(now));
        }
    }

    pub(crate) fn is_accepted(&self, id: ModuleId) -> bool {
        self.accepted.contains_key(&id)
    }

    /// Accepted WARNINGs, and those that were accepted before a restart and may return.
    pub(crate) fn accepted(&self) -> impl Iterator<Item = (ModuleId, Option<Timestamp>)> {
        self.awaited.iter().chain(&self.accepted).map(|(&id, &at)| (id, at))
    }

    /// Takes over an acceptance from before a restart or a reload.
    pub(crate) fn expect(&mut self, id: ModuleId, at: Option<Timestamp>) {
        self.awaited.insert(id, at);
    }
}
