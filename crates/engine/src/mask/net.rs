//! The net of groups and modules: the present state of each, and the spread of a change from one to the others.
//!
//! Nothing is computed twice: groups fold tallies, dependencies count their blocking members, and a change
//! walks upward in the order of [`Order`](crate::model::order), each node at most once.

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};
use std::sync::Arc;

use super::dropped::{self, OnlyDropped};
use super::explained::Beginnings;
use super::node::{GroupNode, ModuleKind, ModuleNode, Node, NodeFacts, Policies, UNSEEN};
use super::relevance::unmet;
use super::rules;
use crate::model::{
    Combine, Dependency, GroupId, Match, Model, ModuleId, NodeId, Other, Policy, Stage, When,
};
use crate::module::names::NewModule;
use crate::module::onset::is_well;
use crate::module::system;
use crate::module::system::SystemCheck;
use crate::signals::Signals;
use crate::snapshot::NotRelevant;
use crate::state::{State, Tally};
use crate::time::{Span, Timestamp};

/// A node whose facts changed in an evaluation, with the facts before and after.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Change {
    pub(crate) node: NodeId,
    pub(crate) before: NodeFacts,
    pub(crate) after: NodeFacts,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Visit {
    Enter(u32),
    Module(u32),
    Leave(u32),
}

#[derive(Debug, Clone)]
pub(crate) struct Net {
    pub(crate) model: Arc<Model>,
    pub(crate) groups: Vec<GroupNode>,
    pub(crate) modules: Vec<ModuleNode>,
    /// The fold of the tiles.
    pub(crate) root: Tally,
    /// The least state that may mask: UNKNOWN only if a dependency asks for that.
    pub(crate) threshold: State,
    pub(super) locked: bool,
    /// Relevant modules in ERROR by themselves, masked or not; without those in `other`.
    pub(crate) own_errors: usize,
    /// The policies of the declared modules.
    pub(super) policies: Policies,
    pub(super) built_in_policy: Policy,
    /// Some report counts as another state than the reported one.
    pub(super) recounts: bool,
    pub(super) queue: BinaryHeap<Reverse<(u32, Visit)>>,
    /// The number of modules that were discovered so far.
    pub(crate) arrivals: u64,
    /// Modules that left since the list was last taken.
    pub(crate) left: Vec<ModuleId>,
    /// Modules whose reports expired since the list was last taken.
    pub(crate) forgotten: Vec<ModuleId>,
    /// Changes since the list was last taken, in order.
    pub(crate) changes: Vec<Change>,
    /// Empty groups with a grace period and its end, since the list was last taken.
    pub(crate) graces: Vec<(GroupId, Timestamp)>,
    /// Modules whose deadlines may have moved.
    pub(crate) rearm: Vec<ModuleId>,
    /// Blocked modules in ERROR: each is masked only while a cause explains it.
    pub(crate) blocked_errors: BTreeSet<ModuleId>,
    /// Beginnings of causes that are known in this evaluation.
    pub(super) beginnings: Beginnings,
    /// How much later than usual the input came that is taken now: its reports count from when it should have come.
    pub(crate) late: Span,
}

impl Net {
    pub(crate) fn new(model: Arc<Model>, now: Timestamp) -> Net {
        let masks_unknown = |needs: &[Dependency]| needs.iter().any(|need| need.masks_unknown);
        let any_unknown = model.groups.iter().any(|group| masks_unknown(&group.depends_on))
            || model.modules.iter().any(|module| masks_unknown(&module.depends_on));
        let mut net = Net {
            groups: Vec::with_capacity(model.groups.len() + 2),
            modules: Vec::with_capacity(model.modules.len() + SystemCheck::ALL.len()),
            root: Tally::default(),
            threshold: if any_unknown { State::Unknown } else { State::Error },
            locked: true,
            own_errors: 0,
            built_in_policy: system::policy(),
            recounts: model.recounts(),
            policies: Policies::of(&model),
            queue: BinaryHeap::new(),
            arrivals: 0,
            left: Vec::new(),
            forgotten: Vec::new(),
            changes: Vec::new(),
            graces: Vec::new(),
            rearm: Vec::new(),
            blocked_errors: BTreeSet::new(),
            beginnings: Beginnings::default(),
            late: Span::ZERO,
            model: model.clone(),
        };
        for group in &model.groups {
            net.add_group(group.parent, &group.depends_on, false);
        }
        net.add_group(None, &[], model.other != Other::Counted);
        net.add_group(None, &[], false);
        for (index, module) in model.modules.iter().enumerate() {
            let rank = model.order.module[index];
            net.add_module(module.group, &module.depends_on, rank, now);
        }
        for _ in SystemCheck::ALL {
            net.discover(&NewModule::of(net.system_group()), ModuleKind::BuiltIn, None, now);
        }
        net.link();
        net
    }

    /// Takes a report of a module. Returns whether its own state may have changed.
    pub(crate) fn report(&mut self, id: ModuleId, state: State, now: Timestamp) -> bool {
        let state = self.counted(id, state);
        if self.modules[id.0 as usize].own.repeats(state, self.late, now) {
            return false;
        }
        let policy = self.policy(id).clone();
        self.modules[id.0 as usize].own.report(state, &policy, self.late, now);
        true
    }

    /// The state as which a report of the module counts.
    pub(crate) fn counted(&self, id: ModuleId, reported: State) -> State {
        if self.recounts { self.policy(id).counts_as.of(reported) } else { reported }
    }

    pub(crate) fn node(&self, id: NodeId) -> &Node {
        match id {
            NodeId::Group(id) => &self.groups[id.0 as usize].node,
            NodeId::Module(id) => &self.modules[id.0 as usize].node,
        }
    }

    pub(crate) fn node_mut(&mut self, id: NodeId) -> &mut Node {
        match id {
            NodeId::Group(id) => &mut self.groups[id.0 as usize].node,
            NodeId::Module(id) => &mut self.modules[id.0 as usize].node,
        }
    }

    /// The group of statuses that no group claims.
    pub(crate) fn other_group(&self) -> GroupId {
        GroupId(self.model.groups.len() as u32)
    }

    /// The group of Telltale's own modules.
    pub(crate) fn system_group(&self) -> GroupId {
        GroupId(self.model.groups.len() as u32 + 1)
    }

    pub(crate) fn is_discovered(&self, id: ModuleId) -> bool {
        self.modules[id.0 as usize].kind == ModuleKind::Discovered
    }

    pub(crate) fn system_module(&self, check: SystemCheck) -> ModuleId {
        ModuleId(self.model.modules.len() as u32 + check as u32)
    }

    pub(crate) fn policy(&self, id: ModuleId) -> &Policy {
        match self.modules[id.0 as usize].kind {
            ModuleKind::Declared => self.policies.get(id),
            ModuleKind::Discovered => self.discovered_policy(id),
            ModuleKind::BuiltIn | ModuleKind::Overflow | ModuleKind::Gone => &self.built_in_policy,
        }
    }

    pub(crate) fn enter_rank(&self, id: GroupId) -> u32 {
        self.rank(&self.model.order.enter, id, 3)
    }

    pub(crate) fn leave_rank(&self, id: GroupId) -> u32 {
        self.rank(&self.model.order.leave, id, 1)
    }

    /// The two built-in groups stand after all others.
    fn rank(&self, ranks: &[u32], id: GroupId, below_max: u32) -> u32 {
        let after_all = if id == self.other_group() { 0 } else { 4 };
        ranks.get(id.0 as usize).copied().unwrap_or(u32::MAX - below_max - after_all)
    }

    pub(crate) fn mark_module(&mut self, id: ModuleId) {
        let module = &mut self.modules[id.0 as usize];
        if !std::mem::replace(&mut module.node.dirty, true) {
            self.queue.push(Reverse((module.rank, Visit::Module(id.0))));
        }
    }

    pub(crate) fn mark_enter(&mut self, id: GroupId) {
        let rank = self.enter_rank(id);
        if !std::mem::replace(&mut self.groups[id.0 as usize].node.dirty, true) {
            self.queue.push(Reverse((rank, Visit::Enter(id.0))));
        }
    }

    pub(crate) fn mark_leave(&mut self, id: GroupId) {
        let rank = self.leave_rank(id);
        if !std::mem::replace(&mut self.groups[id.0 as usize].dirty_leave, true) {
            self.queue.push(Reverse((rank, Visit::Leave(id.0))));
        }
    }

    /// A member has a new reason not to be relevant. Enclosing groups may be irrelevant because of that member
    /// (see [`Net::kept_out_by`]), although nothing else about them changed.
    fn mark_around(&mut self, mut parent: Option<GroupId>) {
        while let Some(id) = parent {
            self.mark_leave(id);
            parent = self.groups[id.0 as usize].node.parent;
        }
    }

    fn mark(&mut self, id: NodeId) {
        match id {
            NodeId::Group(id) => self.mark_enter(id),
            NodeId::Module(id) => self.mark_module(id),
        }
    }

    /// The stage or a signal changed: marks every node with a condition. Every node without one depends on the
    /// stage being other than locked.
    pub(crate) fn mark_conditions(&mut self, stage: Stage) {
        let locked = stage == Stage::Locked;
        let everybody = std::mem::replace(&mut self.locked, locked) != locked;
        let model = self.model.clone();
        for index in 0..self.groups.len() {
            if everybody || model.groups.get(index).is_some_and(|group| group.when.is_some()) {
                self.mark_enter(GroupId(index as u32));
            }
        }
        for index in 0..self.modules.len() {
            if everybody || model.modules.get(index).is_some_and(|module| module.when.is_some()) {
                self.mark_module(ModuleId(index as u32));
            }
        }
    }

    /// Evaluates every marked node, and the nodes that depend on it, at `now`.
    pub(crate) fn evaluate(&mut self, stage: Stage, signals: &Signals, now: Timestamp) {
        while let Some(Reverse((_, visit))) = self.queue.pop() {
            match visit {
                Visit::Enter(id) => self.enter(GroupId(id), stage, signals, now),
                Visit::Module(id) => self.visit_module(ModuleId(id), stage, signals, now),
                Visit::Leave(id) => self.leave(GroupId(id), now),
            }
        }
        self.beginnings.forget();
    }

    pub(crate) fn is_settled(&self) -> bool {
        self.queue.is_empty()
    }

    /// The reason why a node is not relevant: first that of an enclosing group, then its own condition.
    fn not_relevant(
        &self,
        parent: Option<GroupId>,
        when: Option<&When>,
        stage: Stage,
        signals: &Signals,
    ) -> Option<NotRelevant> {
        let around = parent.and_then(|id| self.groups[id.0 as usize].node.not_relevant.clone());
        around.or_else(|| unmet(when, stage, signals))
    }

    fn enter(&mut self, id: GroupId, stage: Stage, signals: &Signals, now: Timestamp) {
        let index = id.0 as usize;
        let parent = self.groups[index].node.parent;
        let when = self.model.groups.get(index).and_then(|group| group.when.as_ref());
        let not_relevant = self.not_relevant(parent, when, stage, signals);
        let around_blocked = parent.is_some_and(|id| self.groups[id.0 as usize].node.facts.blocked);
        let node = &mut self.groups[index].node;
        node.dirty = false;
        let blocked = node.blocking > 0 || around_blocked;
        if node.facts.blocked == blocked
            && node.not_relevant == not_relevant
            && node.facts.relevant == not_relevant.is_none()
        {
            return;
        }
        node.facts.blocked = blocked;
        node.facts.relevant = not_relevant.is_none();
        let since = self.groups[index].relevant_since;
        self.groups[index].relevant_since = not_relevant.is_none().then(|| since.unwrap_or(now));
        let node = &mut self.groups[index].node;
        let other_reason = node.not_relevant.is_some() && not_relevant.is_some();
        node.not_relevant = not_relevant;
        if other_reason {
            self.mark_around(parent);
        }
        for position in 0..self.groups[index].members.len() {
            let member = self.groups[index].members[position];
            self.mark(member);
        }
        if let Some(overflow) = self.groups[index].overflow {
            self.mark_module(overflow);
        }
        self.mark_leave(id);
    }

    fn visit_module(&mut self, id: ModuleId, stage: Stage, signals: &Signals, now: Timestamp) {
        let index = id.0 as usize;
        if self.leaves(id, now) {
            return;
        }
        let parent = self.modules[index].node.parent;
        let spec = self.model.modules.get(index);
        let not_relevant =
            self.not_relevant(parent, spec.and_then(|spec| spec.when.as_deref()), stage, signals);
        let around_blocked = parent.is_some_and(|id| self.groups[id.0 as usize].node.facts.blocked);
        let policy = self.policy(id).clone();
        let policy = &policy;
        let module = &mut self.modules[index];
        module.node.dirty = false;
        let relevant = not_relevant.is_none();
        let heard = module.own.received().is_some();
        module.own.advance(policy, now);
        module.own.set_relevant(relevant, policy, now);
        let own = module.own.state(policy);
        let notice = module.own.notice(policy);
        module.own.onset.follow(notice, now);
        let grace = module.own.in_grace();
        let waits_for_reset = module.own.latched() && !module.own.is_in_error(policy);
        let known = module.own.known();
        let blocked = module.node.blocking > 0 || around_blocked;
        if relevant && blocked && own == State::Error {
            self.blocked_errors.insert(id);
        } else {
            self.blocked_errors.remove(&id);
        }
        let masked = rules::is_masked(relevant, blocked, own, || self.is_explained(id, now));
        let shown = rules::shown(relevant, masked, own);
        let second = relevant && blocked && !masked;
        let module = &mut self.modules[index];
        module.own.onset.note_shown(own, shown, known, now);
        let other_reason = not_relevant.is_some()
            && module.node.not_relevant.is_some()
            && module.node.not_relevant != not_relevant;
        module.node.not_relevant = not_relevant;
        let before = std::mem::replace(
            &mut module.node.facts,
            NodeFacts { relevant, blocked, masked, shown, own, grace, waits_for_reset, second, ..UNSEEN },
        );
        if heard && module.own.received().is_none() {
            self.forgotten.push(id);
        }
        self.rearm.push(id);
        if other_reason {
            self.mark_around(parent);
        }
        self.tell(NodeId::Module(id), before);
    }

    fn leave(&mut self, id: GroupId, now: Timestamp) {
        let grace_until = self.grace_until(id).filter(|&until| now < until);
        self.graces.extend(grace_until.map(|until| (id, until)));
        let group = &mut self.groups[id.0 as usize];
        group.dirty_leave = false;
        let spec = self.model.groups.get(id.0 as usize);
        let combine = spec.map_or(Combine::Worst, |group| group.combine);
        // If `other` is a tile, an empty `other` is OK: every status is configured.
        let is_other_tile = id.0 as usize == self.model.groups.len() && !group.aside;
        let may_be_empty = is_other_tile || spec.is_some_and(|group| group.may_be_empty);
        let alone = if may_be_empty { State::Ok } else { State::Unknown };
        // Of Telltale's own group nothing is known then.
        let is_known = id.0 as usize <= self.model.groups.len();
        let alone = (group.members.is_empty() && is_known).then_some(alone);
        let facts = group.node.facts;
        let says = group.overflow.is_some() && facts.relevant;
        let only = group.only_dropped;
        let alone_shown = alone.filter(|_| !facts.blocked);
        let (folded, only_shown) =
            dropped::fold(combine, &group.shown, only.shown, alone_shown, says && !facts.blocked);
        let (own, only_own) = dropped::fold(combine, &group.own, only.own, alone, says);
        let shown = rules::shown(facts.relevant, false, folded);
        let only_dropped = OnlyDropped { shown: only_shown && shown == folded, own: only_own };
        let masked = shown == State::Ignore && facts.relevant && (facts.blocked || !group.masked.is_empty());
        let grace = grace_until.is_some();
        if is_well(facts.own) && !is_well(own) {
            group.well_until = Some(now);
        }
        let second = group.second > 0;
        group.node.facts = NodeFacts { masked, shown, own, grace, second, only_dropped, ..facts };
        let before = std::mem::replace(&mut group.told, group.node.facts);
        self.tell(NodeId::Group(id), before);
    }

    /// The end of the grace period of a group that only discovered modules join.
    fn grace_until(&self, id: GroupId) -> Option<Timestamp> {
        let group = &self.groups[id.0 as usize];
        let filters = &self.model.groups.get(id.0 as usize)?.filters;
        let timeout = |filter: &Match| filter.policy.as_ref().unwrap_or(&self.model.discovered).timeout;
        let longest = filters.iter().map(timeout).max().filter(|_| group.members.is_empty());
        Some(group.relevant_since? + longest?)
    }

    /// Passes the change of a node on to its group and its dependents.
    pub(crate) fn tell(&mut self, id: NodeId, before: NodeFacts) {
        let after = self.node(id).facts;
        self.changes.push(Change { node: id, before, after });
        if before == after {
            return;
        }
        self.note_beginning(&before, &after);
        match self.node(id).parent {
            Some(parent) => self.tell_group(parent, id, before, after),
            None => {
                let NodeId::Group(GroupId(index)) = id else { return };
                if !self.groups[index as usize].aside {
                    self.root.remove(before.shown);
                    self.root.add(after.shown);
                }
            }
        }
        for position in 0..self.node(id).dependents.len() {
            let (dependent, need) = self.node(id).dependents[position];
            self.tell_dependent(dependent, need, &before, &after);
        }
    }

    fn tell_group(&mut self, parent: GroupId, id: NodeId, before: NodeFacts, after: NodeFacts) {
        let threshold = self.threshold;
        let group = &mut self.groups[parent.0 as usize];
        if matches!(id, NodeId::Module(id) if group.overflow == Some(id)) {
            return;
        }
        group.shown.remove(before.shown);
        group.shown.add(after.shown);
        group.own.remove(before.standing().own_share());
        group.own.add(after.standing().own_share());
        group.only_dropped.replace(before.only_dropped, after.only_dropped);
        if !group.aside && matches!(id, NodeId::Module(_)) {
            self.own_errors += usize::from(after.standing().own_share() == State::Error);
            self.own_errors -= usize::from(before.standing().own_share() == State::Error);
        }
        if after.masked {
            group.masked.insert(id);
        } else {
            group.masked.remove(&id);
        }
        if after.failing(threshold) {
            group.failing.insert(id);
        } else {
            group.failing.remove(&id);
        }
        group.second += u32::from(after.second);
        group.second -= u32::from(before.second);
        self.mark_leave(parent);
    }

    fn tell_dependent(&mut self, dependent: NodeId, need: u32, before: &NodeFacts, after: &NodeFacts) {
        let node = self.node_mut(dependent);
        let need = &mut node.needs[need as usize];
        let (was, is) = (need.blocked_by(before), need.blocked_by(after));
        if was == is {
            return;
        }
        let blocked_before = need.blocks();
        if is {
            need.blocking += 1;
        } else {
            need.blocking -= 1;
        }
        match (blocked_before, need.blocks()) {
            (false, true) => node.blocking += 1,
            (true, false) => node.blocking -= 1,
            _ => return,
        }
        self.mark(dependent);
    }
}
