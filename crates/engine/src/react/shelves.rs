//! Modules that a developer has shelved for maintenance: until a time their faults call nobody.
//!
//! Shelving changes no state. What a shelved module shows, hides and refuses is what it would be without it; only its
//! alarms are left out, and only while the vehicle surely stands.

use std::collections::BTreeSet;

use serde::{Deserialize, Serialize};

use crate::Engine;
use crate::input::Refusal;
use crate::mask::node::ModuleKind;
use crate::model::countermeasure::{Confirmation, ConfirmedBy};
use crate::model::{ModuleId, NodeId, Stage, StageModel};
use crate::snapshot::{Moving, Shelved, Snapshot};
use crate::time::{Span, Timestamp};
use crate::timers::TimerKey;

/// Modules that are shelved at once.
pub const SHELVED_MAX: usize = 16;
/// Nobody does maintenance for longer without a look.
pub const SHELVED_FOR_MAX: Span = Span::from_secs(8 * 3600);

/// The shelved modules, by their ids.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Shelves(Vec<Shelved>);

impl Shelves {
    pub(crate) fn list(&self) -> &[Shelved] {
        &self.0
    }

    /// Whether the node is a shelved module.
    pub(crate) fn has(&self, node: NodeId) -> bool {
        self.0.iter().any(|it| NodeId::Module(it.module) == node)
    }

    pub(crate) fn nodes(&self) -> impl Iterator<Item = NodeId> {
        self.0.iter().map(|it| NodeId::Module(it.module))
    }

    /// The module was removed.
    pub(crate) fn forget(&mut self, id: ModuleId) {
        self.0.retain(|it| it.module != id);
    }

    fn put(&mut self, shelved: Shelved) {
        self.forget(shelved.module);
        self.0.push(shelved);
        self.0.sort_unstable_by_key(|it| it.module);
    }

    fn due(&self) -> Option<Timestamp> {
        self.0.iter().map(|it| it.until).min()
    }
}

impl Snapshot {
    /// Until when the module is shelved, and by whom.
    pub fn shelved(&self, id: ModuleId) -> Option<&Shelved> {
        self.shelved.iter().find(|it| it.module == id)
    }
}

impl Engine {
    /// Every reason why this module may not be shelved now. One status in several groups is one module here.
    pub(crate) fn shelving_refusals(&self, name: &str, lasts: Span) -> Vec<Refusal> {
        let Some(id) = self.views.module(name) else { return vec![Refusal::NoSuchModule(name.into())] };
        let mut reasons = Vec::new();
        if !self.surely_stands() {
            reasons.push(Refusal::NotKnownToStand);
        }
        if lasts.is_zero() || lasts > SHELVED_FOR_MAX {
            reasons
                .push(Refusal::ShelvedTooLong { limit_h: (SHELVED_FOR_MAX.as_millis() / 3_600_000) as u32 });
        }
        let places = self.places_of(NodeId::Module(id));
        let new = places.iter().filter(|&&place| !self.shelves.has(place)).count();
        if self.shelves.list().len() + new > SHELVED_MAX {
            reasons.push(Refusal::ShelvesFull { limit: SHELVED_MAX as u32 });
        }
        if !matches!(self.net.modules[id.0 as usize].kind, ModuleKind::Declared | ModuleKind::Discovered) {
            reasons.push(Refusal::NeverShelved(name.into()));
        }
        let needed = self.needed_by_countermeasures();
        let needed = places.into_iter().filter(|place| needed.contains(place));
        reasons.extend(
            needed.map(|place| Refusal::CountermeasureRests { module: self.views.name(place).into() }),
        );
        reasons
    }

    pub(crate) fn unshelving_refusal(&self, name: &str) -> Option<Refusal> {
        let Some(id) = self.views.module(name) else { return Some(Refusal::NoSuchModule(name.into())) };
        (!self.shelves.has(NodeId::Module(id))).then(|| Refusal::NotShelved(name.into()))
    }

    /// The alarms of the module end: what they were about is known.
    pub(crate) fn shelve(&mut self, name: &str, lasts: Span, by: &str) {
        let (places, until) = (self.modules_with(name), self.now + lasts);
        for module in places {
            self.shelves.put(Shelved { module, until, by: by.into() });
            let is_its = |node| node == NodeId::Module(module);
            self.alarms.acknowledge(|it| it.active && is_its(it.node), self.now, &mut self.events);
        }
    }

    /// A fault that goes on calls anew.
    pub(crate) fn unshelve(&mut self, name: &str) {
        for id in self.modules_with(name) {
            self.shelves.forget(id);
        }
    }

    /// A module of this name, and those with the same status.
    pub(crate) fn modules_with(&self, name: &str) -> Vec<ModuleId> {
        let places = self.views.module(name).map(|id| self.places_of(NodeId::Module(id)));
        let of_module = |node| if let NodeId::Module(id) = node { Some(id) } else { None };
        places.into_iter().flatten().filter_map(of_module).collect()
    }

    /// Ends the shelvings that are over: by their time, or because the vehicle is not known to stand any more. Returns whether anything
    /// ended.
    pub(crate) fn end_shelving(&mut self) -> bool {
        if self.shelves.0.is_empty() {
            return false;
        }
        let (stands, before) = (self.surely_stands(), self.shelves.0.len());
        self.shelves.0.retain(|it| stands && self.now < it.until);
        if let Some(due) = self.shelves.due() {
            self.timers.arm(TimerKey::Shelves, due);
        }
        let ended = self.shelves.0.len() != before;
        self.vehicle_changed |= ended;
        ended
    }

    /// Whether the vehicle stands by its speed, and nothing may set it in motion: it is not cleared, and does not say
    /// that it drives. In the stage `locked` nobody would see the shelved modules.
    fn surely_stands(&self) -> bool {
        let is_at_a_stop = self.vehicle.model == StageModel::None
            || matches!(self.vehicle.stage, Stage::Localizing | Stage::Standby)
                && self.says_it_drives() != Some(true);
        is_at_a_stop && self.motion.shown().moving == Moving::No
    }

    /// The nodes that a request to slow down or to stop needs: the nodes of its rule with their members, all their
    /// dependencies, and the status that confirms it.
    fn needed_by_countermeasures(&self) -> BTreeSet<NodeId> {
        let rules = self.model.driving.countermeasures.iter().filter(|rule| rule.request.kind().moves());
        let mut open: Vec<NodeId> = Vec::new();
        for rule in rules {
            open.extend(&rule.nodes);
            if let Some(Confirmation { by: ConfirmedBy::Status(name), .. }) = &rule.confirmation {
                let route = self.names.find(name).map(|route| &self.names.routes[route as usize]);
                open.extend(route.into_iter().flat_map(|route| route.modules()).map(NodeId::Module));
            }
        }
        let mut needed = BTreeSet::new();
        while let Some(node) = open.pop() {
            if !needed.insert(node) {
                continue;
            }
            if let NodeId::Group(id) = node {
                open.extend(&self.net.groups[id.0 as usize].members);
            }
            for around in self.around(node) {
                open.extend(self.net.node(around).needs.iter().flat_map(|need| need.members.iter().copied()));
            }
        }
        needed
    }
}
