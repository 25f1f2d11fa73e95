//! What the net is made of: groups and modules with what they need and what they are.

use super::model::{Model, Policy};
use super::time::Span;
use std::collections::BTreeSet;

use super::graph::targets;
use super::model::{Dependency, DependsOn, GroupId, ModuleId, NodeId};
use super::module::OwnState;
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
    /// It was not heard, or is silent, and is still given time to report.
    pub(super) grace: bool,
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
    pub(super) fn own_share(&self) -> State {
        if self.relevant { self.own } else { State::Ignore }
    }
}

/// One dependency of a node, with how many of its members block now.
#[derive(Debug)]
pub(super) struct Need {
    pub(super) members: Box<[NodeId]>,
    pub(super) any_of: bool,
    pub(super) masks_unknown: bool,
    pub(super) blocking: u32,
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
    pub(super) fn blocked_by(&self, facts: &Facts) -> bool {
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
    pub(super) dependents: Vec<(NodeId, u32)>,
    /// How many of its needs block.
    pub(super) blocking: u32,
    pub(super) not_relevant: Option<NotRelevant>,
    pub(super) facts: Facts,
    pub(super) dirty: bool,
}

#[derive(Debug)]
pub(super) struct GroupNode {
    pub(super) node: Node,
    /// The facts that its parent and dependents know; they are told when it is left.
    pub(super) told: Facts,
    pub(super) members: Vec<NodeId>,
    pub(super) shown: Tally,
    pub(super) own: Tally,
    /// Members that show IGNORE because a dependency fails.
    pub(super) masked: BTreeSet<NodeId>,
    /// Relevant members that are bad enough to mask.
    pub(super) failing: BTreeSet<NodeId>,
    pub(super) dirty_leave: bool,
    /// When it last became relevant.
    pub(super) relevant_since: Option<Timestamp>,
    /// Holds what nothing claims, and is not counted.
    pub(super) aside: bool,
    /// Says that statuses of new names were dropped: then the group is at least WARNING. It takes no
    /// part in the fold.
    pub(super) overflow: Option<ModuleId>,
}

/// Where a module comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ModuleKind {
    Declared,
    /// Made when a status matched a filter, or nothing.
    Discovered,
    /// The engine itself reports it.
    BuiltIn,
    /// The engine itself reports it, beside what its group folds.
    Overflow,
    /// It left. Its place may be taken again.
    Gone,
}

#[derive(Debug)]
pub(super) struct ModuleNode {
    pub(super) kind: ModuleKind,
    pub(super) node: Node,
    pub(super) own: OwnState,
    pub(super) rank: u32,
    /// Among those that were made at run time, the number in order of arrival.
    pub(super) arrival: u64,
    /// The entry of its group's `match` list that made it.
    pub(super) made_by: Option<u32>,
}

pub(super) const UNSEEN: Facts = Facts {
    relevant: false,
    blocked: false,
    masked: false,
    shown: State::Ignore,
    own: State::Unknown,
    grace: false,
};

pub(super) fn new_node(parent: Option<GroupId>, needs: &[Dependency]) -> Node {
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

/// The policies of the declared modules. What a monitor judges by the clock never falls silent.
pub(super) fn policies(model: &Model) -> Vec<Policy> {
    let policy = |spec: &super::model::ModuleSpec| {
        let timeout =
            if spec.monitor.by_the_clock() { Span::from_nanos(u64::MAX) } else { spec.policy.timeout };
        let forget_after = spec.policy.forget_after.filter(|_| !spec.monitor.by_the_clock());
        Policy { timeout, forget_after, ..spec.policy.clone() }
    };
    model.modules.iter().map(policy).collect()
}
