//! The living graph: what every group and module is now, and how a change of one reaches the
//! others (`ENGINE.md` 3 to 5).
//!
//! Nothing is computed twice: groups fold tallies, dependencies count what blocks them, and a
//! change walks upward in the order of [`Order`](super::graph), each node at most once.

use std::cmp::Reverse;
use std::collections::{BTreeSet, BinaryHeap};
use std::sync::Arc;

use super::graph::targets;
use super::model::{Combine, Dependency, DependsOn, GroupId, Model, ModuleId, NodeId, Stage, When};
use super::module::OwnState;
use super::signals::Signals;
use super::snapshot::NotRelevant;
use super::state::{State, Tally};
use super::time::Timestamp;

/// What others need to know of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Facts {
    pub(super) relevant: bool,
    pub(super) blocked: bool,
    /// Shows IGNORE because a dependency fails.
    pub(super) masked: bool,
    pub(super) shown: State,
    pub(super) own: State,
}

impl Facts {
    /// The worse of what it shows and what it would show if nothing were masked.
    pub(super) fn worst(&self) -> State {
        self.shown.max(self.own)
    }

    fn fails(&self, masks_unknown: bool) -> bool {
        self.worst() == State::Error || (masks_unknown && self.worst() == State::Unknown)
    }

    /// What it adds to the own state of the group around it.
    fn own_share(&self) -> State {
        if self.relevant { self.own } else { State::Ignore }
    }
}

/// One dependency of a node, with how many of its members block now.
#[derive(Debug)]
pub(super) struct Need {
    pub(super) members: Box<[NodeId]>,
    any_of: bool,
    masks_unknown: bool,
    blocking: u32,
}

impl Need {
    fn new(dependency: &Dependency) -> Need {
        Need {
            members: targets(dependency).into(),
            any_of: matches!(dependency.on, DependsOn::AnyOf(_)),
            masks_unknown: dependency.masks_unknown,
            blocking: 0,
        }
    }

    pub(super) fn blocks(&self) -> bool {
        self.blocking as usize == self.members.len()
    }

    /// Whether a member with these facts blocks. One that is not relevant passes on what blocks
    /// it, but keeps a redundancy set open.
    fn blocked_by(&self, facts: &Facts) -> bool {
        let fails = facts.relevant && facts.fails(self.masks_unknown);
        if self.any_of { facts.relevant && (facts.blocked || fails) } else { facts.blocked || fails }
    }
}

/// What groups and modules have in common.
#[derive(Debug)]
pub(super) struct Node {
    pub(super) parent: Option<GroupId>,
    pub(super) needs: Box<[Need]>,
    /// Who needs this node, and as which of its needs.
    dependents: Vec<(NodeId, u32)>,
    /// How many of its needs block.
    pub(super) blocking: u32,
    pub(super) not_relevant: Option<NotRelevant>,
    pub(super) facts: Facts,
    dirty: bool,
}

#[derive(Debug)]
pub(super) struct GroupNode {
    pub(super) node: Node,
    /// The facts that its parent and dependents know; they are told when it is left.
    told: Facts,
    pub(super) members: Vec<NodeId>,
    pub(super) shown: Tally,
    own: Tally,
    /// Members that show IGNORE because a dependency fails.
    pub(super) masked: BTreeSet<NodeId>,
    /// Relevant members that are bad enough to mask.
    pub(super) failing: BTreeSet<NodeId>,
    dirty_leave: bool,
    /// Holds what nothing claims; never counted.
    pub(super) is_other: bool,
}

#[derive(Debug)]
pub(super) struct ModuleNode {
    pub(super) node: Node,
    pub(super) own: OwnState,
    pub(super) rank: u32,
}

/// A node whose facts changed in an evaluation: what it was and what it is.
#[derive(Debug, Clone, Copy)]
pub(super) struct Change {
    pub(super) node: NodeId,
    pub(super) before: Facts,
    pub(super) after: Facts,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Visit {
    Enter(u32),
    Module(u32),
    Leave(u32),
}

#[derive(Debug)]
pub(super) struct Net {
    model: Arc<Model>,
    pub(super) groups: Vec<GroupNode>,
    pub(super) modules: Vec<ModuleNode>,
    /// Tiles, folded.
    pub(super) root: Tally,
    /// States from this one on may mask: UNKNOWN only if some dependency says so.
    pub(super) threshold: State,
    locked: bool,
    queue: BinaryHeap<Reverse<(u32, Visit)>>,
    /// What changed since it was last taken, in order.
    pub(super) changes: Vec<Change>,
    /// Modules whose deadlines may have moved.
    pub(super) rearm: Vec<ModuleId>,
}

const UNSEEN: Facts =
    Facts { relevant: false, blocked: false, masked: false, shown: State::Ignore, own: State::Unknown };

impl Net {
    pub(super) fn new(model: Arc<Model>) -> Net {
        let masks_unknown = |needs: &[Dependency]| needs.iter().any(|need| need.masks_unknown);
        let any_unknown = model.groups.iter().any(|group| masks_unknown(&group.depends_on))
            || model.modules.iter().any(|module| masks_unknown(&module.depends_on));
        let mut net = Net {
            groups: Vec::new(),
            modules: Vec::new(),
            root: Tally::default(),
            threshold: if any_unknown { State::Unknown } else { State::Error },
            locked: true,
            queue: BinaryHeap::new(),
            changes: Vec::new(),
            rearm: Vec::new(),
            model: model.clone(),
        };
        for group in &model.groups {
            net.add_group(group.parent, &group.depends_on, false);
        }
        net.add_group(None, &[], true);
        for (index, module) in model.modules.iter().enumerate() {
            net.add_module(module.group, &module.depends_on, model.order.module[index]);
        }
        net.link();
        net
    }

    fn add_group(&mut self, parent: Option<GroupId>, needs: &[Dependency], is_other: bool) {
        let id = GroupId(self.groups.len() as u32);
        self.groups.push(GroupNode {
            node: new_node(parent, needs),
            told: UNSEEN,
            members: Vec::new(),
            shown: Tally::default(),
            own: Tally::default(),
            masked: BTreeSet::new(),
            failing: BTreeSet::new(),
            dirty_leave: false,
            is_other,
        });
        match parent {
            Some(parent) => self.add_member(parent, NodeId::Group(id)),
            None if !is_other => self.root.add(UNSEEN.shown),
            None => {}
        }
        self.mark_enter(id);
    }

    fn add_member(&mut self, group: GroupId, member: NodeId) {
        let group = &mut self.groups[group.0 as usize];
        group.members.push(member);
        group.shown.add(UNSEEN.shown);
        group.own.add(UNSEEN.own_share());
    }

    fn add_module(&mut self, group: GroupId, needs: &[Dependency], rank: u32) -> ModuleId {
        let id = ModuleId(self.modules.len() as u32);
        let node = new_node(Some(group), needs);
        self.modules.push(ModuleNode { node, own: OwnState::new(), rank });
        self.add_member(group, NodeId::Module(id));
        self.mark_module(id);
        id
    }

    /// A module made at run time: it has no dependencies of its own, so it stands just before
    /// its group in the order.
    pub(super) fn discover(&mut self, group: GroupId) -> ModuleId {
        let rank = self.leave_rank(group) - 1;
        let id = self.add_module(group, &[], rank);
        self.mark_leave(group);
        id
    }

    fn link(&mut self) {
        let groups = (0..self.groups.len() as u32).map(|id| NodeId::Group(GroupId(id)));
        let modules = (0..self.modules.len() as u32).map(|id| NodeId::Module(ModuleId(id)));
        for dependent in groups.chain(modules).collect::<Vec<_>>() {
            for index in 0..self.node(dependent).needs.len() {
                for member in self.node(dependent).needs[index].members.clone() {
                    self.node_mut(member).dependents.push((dependent, index as u32));
                }
            }
        }
    }

    pub(super) fn node(&self, id: NodeId) -> &Node {
        match id {
            NodeId::Group(id) => &self.groups[id.0 as usize].node,
            NodeId::Module(id) => &self.modules[id.0 as usize].node,
        }
    }

    fn node_mut(&mut self, id: NodeId) -> &mut Node {
        match id {
            NodeId::Group(id) => &mut self.groups[id.0 as usize].node,
            NodeId::Module(id) => &mut self.modules[id.0 as usize].node,
        }
    }

    pub(super) fn enter_rank(&self, id: GroupId) -> u32 {
        self.model.order.enter.get(id.0 as usize).copied().unwrap_or(u32::MAX - 3)
    }

    pub(super) fn leave_rank(&self, id: GroupId) -> u32 {
        self.model.order.leave.get(id.0 as usize).copied().unwrap_or(u32::MAX - 1)
    }

    pub(super) fn mark_module(&mut self, id: ModuleId) {
        let module = &mut self.modules[id.0 as usize];
        if !std::mem::replace(&mut module.node.dirty, true) {
            self.queue.push(Reverse((module.rank, Visit::Module(id.0))));
        }
    }

    fn mark_enter(&mut self, id: GroupId) {
        let rank = self.enter_rank(id);
        if !std::mem::replace(&mut self.groups[id.0 as usize].node.dirty, true) {
            self.queue.push(Reverse((rank, Visit::Enter(id.0))));
        }
    }

    fn mark_leave(&mut self, id: GroupId) {
        let rank = self.leave_rank(id);
        if !std::mem::replace(&mut self.groups[id.0 as usize].dirty_leave, true) {
            self.queue.push(Reverse((rank, Visit::Leave(id.0))));
        }
    }

    fn mark(&mut self, id: NodeId) {
        match id {
            NodeId::Group(id) => self.mark_enter(id),
            NodeId::Module(id) => self.mark_module(id),
        }
    }

    /// The stage or a signal changed: everything with a condition is looked at again. To be in a
    /// stage other than locked is everybody's condition.
    pub(super) fn mark_conditions(&mut self, stage: Stage) {
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

    /// Brings every marked node, and whatever rests on it, to what it is at `now`.
    pub(super) fn evaluate(&mut self, stage: Stage, signals: &Signals, now: Timestamp) {
        while let Some(Reverse((_, visit))) = self.queue.pop() {
            match visit {
                Visit::Enter(id) => self.enter(GroupId(id), stage, signals),
                Visit::Module(id) => self.visit_module(ModuleId(id), stage, signals, now),
                Visit::Leave(id) => self.leave(GroupId(id)),
            }
        }
    }

    /// Why the node is not relevant: first what is around it, then its own condition.
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

    /// The condition that keeps a node out: its own, or that of the first member that has one.
    pub(super) fn kept_out_by(&self, node: NodeId) -> Option<NotRelevant> {
        let own = self.node(node).not_relevant.clone();
        own.or_else(|| match node {
            NodeId::Module(_) => None,
            NodeId::Group(id) => {
                self.groups[id.0 as usize].members.iter().find_map(|&member| self.kept_out_by(member))
            }
        })
    }

    fn enter(&mut self, id: GroupId, stage: Stage, signals: &Signals) {
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
        node.not_relevant = not_relevant;
        for position in 0..self.groups[index].members.len() {
            let member = self.groups[index].members[position];
            self.mark(member);
        }
        self.mark_leave(id);
    }

    fn visit_module(&mut self, id: ModuleId, stage: Stage, signals: &Signals, now: Timestamp) {
        let index = id.0 as usize;
        let parent = self.modules[index].node.parent;
        let spec = self.model.modules.get(index);
        let policy = spec.map_or(&self.model.discovered, |spec| &spec.policy);
        let not_relevant =
            self.not_relevant(parent, spec.and_then(|spec| spec.when.as_ref()), stage, signals);
        let around_blocked = parent.is_some_and(|id| self.groups[id.0 as usize].node.facts.blocked);
        let module = &mut self.modules[index];
        module.node.dirty = false;
        let relevant = not_relevant.is_none();
        module.own.set_relevant(relevant, now);
        module.own.advance(policy, now);
        let own = module.own.state(policy, now);
        let blocked = module.node.blocking > 0 || around_blocked;
        let masked = relevant && blocked;
        let shown = if relevant && !masked { own } else { State::Ignore };
        module.node.not_relevant = not_relevant;
        let before =
            std::mem::replace(&mut module.node.facts, Facts { relevant, blocked, masked, shown, own });
        self.rearm.push(id);
        self.tell(NodeId::Module(id), before);
    }

    fn leave(&mut self, id: GroupId) {
        let group = &mut self.groups[id.0 as usize];
        group.dirty_leave = false;
        let combine = self.model.groups.get(id.0 as usize).map_or(Combine::Worst, |group| group.combine);
        let fold = |tally: &Tally| match combine {
            Combine::Worst => tally.worst(),
            Combine::Any => tally.best(),
        };
        let nobody = if group.members.is_empty() { State::Unknown } else { State::Ignore };
        let facts = group.node.facts;
        let shown = if facts.relevant && !facts.blocked {
            fold(&group.shown).unwrap_or(nobody)
        } else {
            State::Ignore
        };
        let masked = shown == State::Ignore && facts.relevant && (facts.blocked || !group.masked.is_empty());
        let own = fold(&group.own).unwrap_or(nobody);
        group.node.facts = Facts { masked, shown, own, ..facts };
        let before = std::mem::replace(&mut group.told, group.node.facts);
        self.tell(NodeId::Group(id), before);
    }

    /// Tells the group around a node and its dependents what became of it.
    fn tell(&mut self, id: NodeId, before: Facts) {
        let after = self.node(id).facts;
        self.changes.push(Change { node: id, before, after });
        if before == after {
            return;
        }
        match self.node(id).parent {
            Some(parent) => self.tell_group(parent, id, before, after),
            None => {
                let NodeId::Group(GroupId(index)) = id else { return };
                if !self.groups[index as usize].is_other {
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

    fn tell_group(&mut self, parent: GroupId, id: NodeId, before: Facts, after: Facts) {
        let threshold = self.threshold;
        let group = &mut self.groups[parent.0 as usize];
        group.shown.remove(before.shown);
        group.shown.add(after.shown);
        group.own.remove(before.own_share());
        group.own.add(after.own_share());
        if after.masked {
            group.masked.insert(id);
        } else {
            group.masked.remove(&id);
        }
        if after.relevant && after.worst() >= threshold {
            group.failing.insert(id);
        } else {
            group.failing.remove(&id);
        }
        self.mark_leave(parent);
    }

    fn tell_dependent(&mut self, dependent: NodeId, need: u32, before: &Facts, after: &Facts) {
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

fn new_node(parent: Option<GroupId>, needs: &[Dependency]) -> Node {
    Node {
        parent,
        needs: needs.iter().map(Need::new).collect(),
        dependents: Vec::new(),
        blocking: 0,
        not_relevant: None,
        facts: UNSEEN,
        dirty: false,
    }
}

/// The first condition that does not hold. A signal that is unknown meets every condition: what
/// is not known to be irrelevant is diagnosed.
fn unmet(when: Option<&When>, stage: Stage, signals: &Signals) -> Option<NotRelevant> {
    let in_stage = match when {
        Some(when) if !when.stages.is_empty() => when.stages.contains(&stage),
        _ => stage != Stage::Locked,
    };
    if !in_stage {
        return Some(NotRelevant::Stage(stage));
    }
    let wanted = when.map_or(&[][..], |when| &when.signals);
    wanted.iter().find_map(|&(index, wanted)| {
        let value = signals.value(index).filter(|&value| value != wanted)?;
        Some(NotRelevant::Signal { name: signals.name(index).into(), value })
    })
}
