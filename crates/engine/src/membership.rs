//! The modules of the net: declared ones, and discovered ones that come and go.
//!
//! A module's id is its index. The index of a module that left is used again as soon as nothing refers to it.
//! So the list is never longer than the largest number of simultaneous modules and of those that alarms and
//! countermeasures name.

use super::module::names::{Names, NewModule};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::sync::Arc;

use super::Engine;
use super::event::EventKind;
use super::mask::dropped::OnlyDroppedCount;
use super::mask::net::Net;
use super::mask::node::{GroupNode, ModuleKind, ModuleNode, UNSEEN, new_node};
use super::model::{Dependency, GroupId, Match, ModuleId, NodeId, Policy};
use super::module::OwnState;
use super::module::overflow;
use super::module::system::SystemCheck;
use super::module::writers::{Heard, WriterReport};
use super::state::{State, Tally};
use super::time::Timestamp;
use super::view::views::Views;
use super::view::views::members::Told;

/// The indices of modules that left.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Departed {
    /// By name: alarms or countermeasures may still refer to these.
    named: BTreeMap<Arc<str>, ModuleId>,
    /// Nothing refers to these any more.
    free: Vec<ModuleId>,
}

impl Departed {
    /// Whether each index is one of a module that left, and stands here once.
    pub(super) fn is_sound(&self, net: &Net) -> bool {
        let mut seen = HashSet::new();
        let has_left = |id: &ModuleId| {
            net.modules.get(id.0 as usize).is_some_and(|it| it.kind == ModuleKind::Gone) && seen.insert(*id)
        };
        self.named.values().chain(&self.free).all(has_left)
    }
}

impl Engine {
    /// Makes the modules of a name that was just received, new or known, where its node may say it.
    pub(super) fn discover_heard(&mut self, name: &str, report: WriterReport) -> Option<u32> {
        self.discover_by(name, &[], Some(report))
    }

    /// Makes the modules of a new name, or the missing ones of a known name; none if the limit is reached.
    pub(super) fn discover(&mut self, name: &str) -> Option<u32> {
        self.discover_by(name, &[], None)
    }

    /// The same, but leaves these groups without a module until the name is received again.
    pub(super) fn discover_but(&mut self, name: &str, left_out: &[GroupId]) -> Option<u32> {
        self.discover_by(name, left_out, None)
    }

    fn discover_by(&mut self, name: &str, left_out: &[GroupId], report: Option<WriterReport>) -> Option<u32> {
        let known = self.names.find(name);
        let present = known.map(|route| self.names.modules(route));
        let mut present: Vec<GroupId> = present
            .into_iter()
            .flatten()
            .filter_map(|id| self.net.modules[id.0 as usize].node.parent)
            .collect();
        present.extend(left_out);
        let other = self.net.other_group();
        // A status with a module in a group is not unclaimed: the configuration expects it there.
        present.extend(known.map(|_| other));
        let mut heard = report.map(|report| Heard::new(report, &self.writers));
        let claim = self.names.claim(&self.model, name, other, |place| {
            let heard = heard.as_mut();
            !present.contains(&place.group) && heard.is_none_or(|it| it.admits(place.policy(&self.model)))
        });
        let heard = heard.unwrap_or_default();
        if heard.is_held_back() {
            self.note_held_back(name, &heard);
        }
        let counted = |names: &mut Names, route| names.drop_from(route, &claim, !heard.is_held_back());
        // A name that has modules elsewhere is counted once, not with each of its statuses.
        let dropped_by =
            known.map_or_else(|| claim.dropped_by.clone(), |route| counted(&mut self.names, route));
        for group in dropped_by {
            let module = self
                .overflow
                .module(group)
                .unwrap_or_else(|| self.make(&NewModule::of(group), ModuleKind::Overflow, overflow::MODULE));
            let message =
                self.overflow.count(group, module, self.model.limits.discovered_modules, claim.too_long);
            self.net.report(module, State::Warning, self.now);
            self.views.set_message(module, message);
        }
        if known.is_none() && claim.places.is_empty() {
            if !claim.dropped_by.is_empty() {
                self.counters.dropped_names += 1;
            } else if !heard.is_held_back() && left_out.is_empty() {
                self.names.drop_name(name);
            }
            return None;
        }
        let mut route = known;
        for place in &claim.places {
            let module = self.make(place, ModuleKind::Discovered, name);
            route = Some(self.names.discovered(name, module));
        }
        if let Some(route) = route {
            let lacking = !claim.dropped_by.is_empty() || !left_out.is_empty() || heard.is_held_back();
            self.names.set_lacking(route, lacking);
            if left_out.is_empty() {
                counted(&mut self.names, route);
            }
            if heard.is_unproven() {
                self.names.doubt(route);
            }
        }
        if known.is_none() && route.is_some() {
            let unclaimed = claim.places == [NewModule::of(self.net.other_group())];
            self.compare_new_name(name, unclaimed);
        }
        route
    }

    pub(super) fn make(&mut self, place: &NewModule, kind: ModuleKind, name: &str) -> ModuleId {
        let status = (kind == ModuleKind::Discovered).then(|| Arc::from(name));
        let name = self.views.free_name(place.group, name);
        let slot = self.departed.named.remove(&name).or_else(|| self.free_slot());
        let id = self.net.discover(place, kind, slot, self.now);
        let number = self.net.modules[id.0 as usize].arrival;
        let told = Told::of(&self.net, id, status);
        self.views.discover(id, place.group, (name, number), told, self.now);
        id
    }

    /// The index of a module that left and that nothing refers to.
    fn free_slot(&mut self) -> Option<ModuleId> {
        if self.departed.free.is_empty() && !self.departed.named.is_empty() {
            let spoken_of: HashSet<NodeId> = self
                .alarms
                .list()
                .iter()
                .map(|alarm| alarm.node)
                .chain(
                    self.countermeasures
                        .held()
                        .iter()
                        .flat_map(|held| held.causes.iter().map(|cause| cause.node)),
                )
                .chain(self.events.nodes())
                .collect();
            let (views, free) = (&mut self.views, &mut self.departed.free);
            self.departed.named.retain(|_, &mut id| {
                let kept = spoken_of.contains(&NodeId::Module(id));
                if !kept {
                    views.clear_name(id);
                    free.push(id);
                }
                kept
            });
        }
        self.departed.free.pop()
    }

    /// Removes modules that left, and resets those whose reports expired.
    pub(super) fn remove_departed(&mut self) {
        for id in std::mem::take(&mut self.net.left) {
            let name = self.views.leave(id);
            self.names.forget(id);
            self.warnings.forget(id);
            self.shelves.forget(id);
            self.events.push(self.now, EventKind::Left { node: name.clone() });
            self.departed.named.insert(name, id);
        }
        for id in std::mem::take(&mut self.net.forgotten) {
            self.views.forget(id);
        }
    }

    /// The names of modules that left, each with its group.
    pub(super) fn departed_names(&self, new: &Views) -> Vec<(Arc<str>, GroupId)> {
        let group = |id: ModuleId| {
            let group = self.net.modules[id.0 as usize].node.parent?;
            let path = self.views.name(NodeId::Group(group));
            new.paths().find(|(_, known)| *known == path).map(|(group, _)| group)
        };
        let named = self.departed.named.iter();
        named.filter_map(|(name, &id)| Some((name.clone(), group(id)?))).collect()
    }

    /// Keeps the name of a module that left before a restart or a reload, for alarms and countermeasures that
    /// refer to it.
    pub(super) fn keep_departed(&mut self, name: &str, group: GroupId) {
        let name: Arc<str> = name.into();
        if self.views.has(&name) || self.departed.named.contains_key(&name) {
            return;
        }
        // References to it are restored later: until then no index is free.
        let id = self.net.discover(&NewModule::of(group), ModuleKind::Discovered, None, self.now);
        self.views.discover(id, group, (name.clone(), 0), Told::default(), self.now);
        self.net.remove(id);
        self.net.left.retain(|&left| left != id);
        self.views.leave(id);
        self.departed.named.insert(name, id);
    }

    /// Leaves out all modules of the group `telltale`, until the engine itself finds a fault of one: of a vehicle without Telltale
    /// nobody knows that its checks were OK.
    pub fn leave_self_out(&mut self) {
        for check in SystemCheck::ALL {
            let id = self.net.system_module(check);
            self.net.remove(id);
            self.views.leave(id);
        }
        // Their indices stay theirs.
        self.net.left.clear();
        self.settle();
    }

    pub(super) fn is_left_out(&self, id: ModuleId) -> bool {
        self.net.modules[id.0 as usize].kind == ModuleKind::Gone
    }

    /// Takes a module back that was left out, if this is a fault. Returns whether it is there now.
    pub(super) fn take_back(&mut self, id: ModuleId, state: State) -> bool {
        if state == State::Ok {
            return false;
        }
        let group = self.net.system_group();
        self.net.discover(&NewModule::of(group), ModuleKind::BuiltIn, Some(id), self.now);
        self.views.come_back(id, self.now);
        true
    }
}

impl Net {
    pub(super) fn add_group(&mut self, parent: Option<GroupId>, needs: &[Dependency], aside: bool) {
        let id = GroupId(self.groups.len() as u32);
        self.groups.push(GroupNode {
            node: new_node(parent, needs),
            told: UNSEEN,
            members: Vec::new(),
            shown: Tally::default(),
            own: Tally::default(),
            masked: BTreeSet::new(),
            failing: BTreeSet::new(),
            second: 0,
            dirty_leave: false,
            relevant_since: None,
            well_until: None,
            aside,
            overflow: None,
            only_dropped: OnlyDroppedCount::default(),
        });
        match parent {
            Some(parent) => self.add_member(parent, NodeId::Group(id)),
            None if !aside => self.root.add(UNSEEN.shown),
            None => {}
        }
        self.mark_enter(id);
    }

    /// Enters each node among the dependents of its dependencies.
    pub(super) fn link(&mut self) {
        for dependent in NodeId::all(self.groups.len(), self.modules.len()) {
            for index in 0..self.node(dependent).needs.len() {
                for member in self.node(dependent).needs[index].members.clone() {
                    self.node_mut(member).dependents.push((dependent, index as u32));
                }
            }
        }
    }

    pub(super) fn add_member(&mut self, group: GroupId, member: NodeId) {
        let group = &mut self.groups[group.0 as usize];
        group.members.push(member);
        group.shown.add(UNSEEN.shown);
        group.own.add(UNSEEN.standing().own_share());
    }

    pub(super) fn add_module(&mut self, group: GroupId, needs: &[Dependency], rank: u32, now: Timestamp) {
        let id = ModuleId(self.modules.len() as u32);
        let (kind, node) = (ModuleKind::Declared, new_node(Some(group), needs));
        let own = OwnState::new(false, now);
        self.modules.push(ModuleNode { kind, node, own, rank, arrival: 0, made_by: None });
        self.add_member(group, NodeId::Module(id));
        self.mark_module(id);
    }

    /// Adds a discovered module, at the index of one that left if there is one. It has no dependencies of its
    /// own, so it stands just before its group in the order.
    pub(super) fn discover(
        &mut self,
        place: &NewModule,
        kind: ModuleKind,
        slot: Option<ModuleId>,
        now: Timestamp,
    ) -> ModuleId {
        let &NewModule { group, filter } = place;
        self.arrivals += 1;
        let module = ModuleNode {
            kind,
            node: new_node(Some(group), &[]),
            own: OwnState::new(kind == ModuleKind::Discovered, now),
            rank: self.leave_rank(group) - 1,
            arrival: self.arrivals,
            made_by: filter,
        };
        let id = match slot {
            Some(id) => {
                self.modules[id.0 as usize] = module;
                id
            }
            None => {
                self.modules.push(module);
                ModuleId(self.modules.len() as u32 - 1)
            }
        };
        if kind == ModuleKind::Overflow {
            self.groups[group.0 as usize].overflow = Some(id);
        } else {
            self.add_member(group, NodeId::Module(id));
        }
        self.mark_module(id);
        self.mark_leave(group);
        id
    }

    /// The policy of a discovered module: that of the entry that claimed it.
    pub(super) fn discovered_policy(&self, id: ModuleId) -> &Policy {
        self.place(id).map_or(&self.model.discovered, |place| place.policy(&self.model))
    }

    /// The entry that claimed a discovered module.
    pub(super) fn claimed_by(&self, id: ModuleId) -> Option<&Match> {
        self.place(id)?.entry(&self.model)
    }

    fn place(&self, id: ModuleId) -> Option<NewModule> {
        let module = &self.modules[id.0 as usize];
        Some(NewModule { group: module.node.parent?, filter: module.made_by })
    }

    /// Removes a module that was silent for too long, if it is not removed already. Returns whether it is gone.
    pub(super) fn leaves(&mut self, id: ModuleId, now: Timestamp) -> bool {
        let module = &self.modules[id.0 as usize];
        if module.kind == ModuleKind::Discovered && module.own.lapsed(self.policy(id), now) {
            self.remove(id);
        }
        let module = &mut self.modules[id.0 as usize];
        let gone = module.kind == ModuleKind::Gone;
        module.node.dirty &= !gone;
        gone
    }

    /// Takes a module out of its group; it has no further effect.
    pub(super) fn remove(&mut self, id: ModuleId) {
        let module = &mut self.modules[id.0 as usize];
        let before = std::mem::replace(&mut module.node.facts, UNSEEN);
        module.kind = ModuleKind::Gone;
        module.own = OwnState::new(false, Timestamp::ZERO);
        module.node.not_relevant = None;
        self.blocked_errors.remove(&id);
        let module = &self.modules[id.0 as usize];
        let group = module.node.parent;
        self.tell(NodeId::Module(id), before);
        if let Some(group) = group {
            let group = &mut self.groups[group.0 as usize];
            group.members.retain(|&member| member != NodeId::Module(id));
            group.shown.remove(UNSEEN.shown);
            group.own.remove(UNSEEN.standing().own_share());
        }
        group.into_iter().for_each(|group| self.mark_leave(group));
        self.left.push(id);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use crate::Engine;
    use crate::input::{Input, ReceptionTrouble, StatusArray, TroubleKind};
    use crate::model::{Model, NodeId, Other, Parts, StageModel};
    use crate::snapshot::Snapshot;
    use crate::state::State;
    use crate::time::Timestamp;

    fn own(snapshot: &Snapshot) -> Vec<(&str, State)> {
        let modules =
            snapshot.module_ids().map(|id| (&*snapshot.module(id).0.id, snapshot.module(id).1.state));
        modules.filter(|(name, _)| name.starts_with("telltale/")).collect()
    }

    #[test]
    fn what_was_left_out_is_there_from_its_first_fault_on() {
        let parts = Parts { other: Other::Counted, ..Parts::empty("v", StageModel::None) };
        let mut engine = Engine::begin(Arc::new(Model::new(parts).unwrap()), Timestamp::ZERO);
        assert_eq!(own(&engine.snapshot()).len(), 16);
        engine.keep_events();
        engine.leave_self_out();
        let group = |snapshot: &Snapshot| snapshot.shown(snapshot.node("telltale").unwrap()).0;
        let first = engine.snapshot();
        assert_eq!((own(&first), group(&first)), (Vec::new(), State::Ignore));

        // Names that come take no place of theirs.
        let mut array = StatusArray::default();
        array.push_status(0, "gps", "fine", "");
        engine.handle(&Input::Diagnostics(array), Timestamp::from_millis(1000));
        assert_eq!(own(&engine.snapshot()), []);
        let trouble = ReceptionTrouble {
            topic: "/diagnostics".into(),
            kind: TroubleKind::Malformed,
            count: 1,
            text: "it is too short".into(),
        };
        engine.handle(&Input::Reception(trouble), Timestamp::from_millis(2000));
        let faulty = engine.snapshot();
        assert_eq!(own(&faulty), [("telltale/reception", State::Warning)]);
        assert_eq!(group(&faulty), State::Warning);
        assert!(matches!(faulty.node("telltale/reception"), Some(NodeId::Module(_))));
        // Now it is known to be over.
        engine.handle(&Input::Tick, Timestamp::from_millis(30_000));
        let over = engine.snapshot();
        assert_eq!((own(&over), group(&over)), (vec![("telltale/reception", State::Ok)], State::Ok));
    }
}
