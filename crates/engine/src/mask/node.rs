//! The nodes of the net: groups and modules with their dependencies and states.

use crate::model::{Model, Policy};
use crate::time::Span;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeSet, HashMap};

use super::dropped::{OnlyDropped, OnlyDroppedCount};
use super::rules::Standing;
use crate::model::{Dependency, GroupId, ModuleId, NodeId, Within};
use crate::module::OwnState;
use crate::snapshot::NotRelevant;
use crate::state::{State, Tally};
use crate::time::Timestamp;

/// The facts of a node that other nodes use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct NodeFacts {
    pub(crate) relevant: bool,
    pub(crate) blocked: bool,
    /// Shows IGNORE because a dependency fails.
    pub(crate) masked: bool,
    pub(crate) shown: State,
    pub(crate) own: State,
    /// It has no report, or is silent, and still has time to report.
    pub(crate) grace: bool,
    /// Its fault is over, and its ERROR stays until somebody resets it.
    pub(crate) waits_for_reset: bool,
    /// A blocked module that shows ERROR because no cause explains it; a group that contains one.
    pub(crate) second: bool,
    pub(crate) only_dropped: OnlyDropped,
}

impl NodeFacts {
    /// The facts that the rules of masking use.
    pub(crate) fn standing(&self) -> Standing {
        Standing { relevant: self.relevant, blocked: self.blocked, shown: self.shown, own: self.own }
    }

    pub(crate) fn worst(&self) -> State {
        self.standing().worst()
    }

    /// Whether the node fails: it is at least as bad as the least state that masks.
    pub(crate) fn failing(&self, threshold: State) -> bool {
        self.relevant && self.worst() >= threshold
    }

    /// The facts that root causes, and the beginnings of faults, depend on.
    pub(crate) fn for_causes(&self, threshold: State) -> impl PartialEq + use<> {
        let above = |state: State| Some(state).filter(|&state| self.relevant && state >= threshold);
        (
            self.failing(threshold),
            (self.blocked, self.masked, self.second),
            self.relevant && self.grace && self.own >= threshold,
            above(self.shown),
            above(self.own),
        )
    }
}

/// One dependency of a node, with the number of its members that block now.
#[derive(Debug, Clone)]
pub(crate) struct Need {
    pub(crate) members: Box<[NodeId]>,
    pub(crate) any_of: bool,
    pub(crate) masks_unknown: bool,
    pub(crate) within: Within,
    pub(crate) blocking: u32,
}

impl Need {
    fn new(dependency: &Dependency) -> Need {
        Need {
            members: dependency.targets().into(),
            any_of: dependency.is_any_of(),
            masks_unknown: dependency.masks_unknown,
            within: dependency.within,
            blocking: 0,
        }
    }

    pub(crate) fn blocks(&self) -> bool {
        self.blocking as usize == self.members.len()
    }

    /// Whether a member with these facts blocks the dependency.
    pub(crate) fn blocked_by(&self, facts: &NodeFacts) -> bool {
        facts.standing().blocks(self.any_of, self.masks_unknown)
    }
}

/// The common part of groups and modules.
#[derive(Debug, Clone)]
pub(crate) struct Node {
    pub(crate) parent: Option<GroupId>,
    pub(crate) needs: Box<[Need]>,
    /// The nodes that depend on this one, each with the index of the dependency.
    pub(crate) dependents: Vec<(NodeId, u32)>,
    /// The number of its dependencies that block.
    pub(crate) blocking: u32,
    pub(crate) not_relevant: Option<NotRelevant>,
    pub(crate) facts: NodeFacts,
    pub(crate) dirty: bool,
}

#[derive(Debug, Clone)]
pub(crate) struct GroupNode {
    pub(crate) node: Node,
    /// The facts that its parent and dependents know; they are updated when the node is left.
    pub(crate) told: NodeFacts,
    pub(crate) members: Vec<NodeId>,
    pub(crate) shown: Tally,
    pub(crate) own: Tally,
    /// Members that show IGNORE because a dependency fails.
    pub(crate) masked: BTreeSet<NodeId>,
    /// Relevant members that are bad enough to mask.
    pub(crate) failing: BTreeSet<NodeId>,
    /// The number of members that are second faults or contain one.
    pub(crate) second: u32,
    pub(crate) dirty_leave: bool,
    /// When it last became relevant.
    pub(crate) relevant_since: Option<Timestamp>,
    /// When its own state was last OK or WARNING, before the present one.
    pub(crate) well_until: Option<Timestamp>,
    /// Holds unclaimed statuses and is not counted.
    pub(crate) aside: bool,
    /// The module that reports dropped names: while there is one, the group is at least WARNING. It takes no
    /// part in the fold.
    pub(crate) overflow: Option<ModuleId>,
    pub(crate) only_dropped: OnlyDroppedCount,
}

/// The origin of a module.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum ModuleKind {
    Declared,
    /// Discovered: a status matched a filter, or none.
    Discovered,
    /// The engine itself reports it.
    BuiltIn,
    /// The engine itself reports it; it stands beside the fold of its group.
    Overflow,
    /// It left. Its index may be used again.
    Gone,
}

#[derive(Debug, Clone)]
pub(crate) struct ModuleNode {
    pub(crate) kind: ModuleKind,
    pub(crate) node: Node,
    pub(crate) own: OwnState,
    pub(crate) rank: u32,
    /// The number of a discovered module, in order of arrival.
    pub(crate) arrival: u64,
    /// The entry of the group's `match` list that claimed it.
    pub(crate) made_by: Option<u32>,
}

pub(crate) const UNSEEN: NodeFacts = NodeFacts {
    relevant: false,
    blocked: false,
    masked: false,
    shown: State::Ignore,
    own: State::Unknown,
    grace: false,
    waits_for_reset: false,
    second: false,
    only_dropped: OnlyDropped { shown: false, own: false },
};

pub(crate) fn new_node(parent: Option<GroupId>, needs: &[Dependency]) -> Node {
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

/// The policies of the declared modules, each once: nearly all modules share a few.
#[derive(Debug, Clone)]
pub(crate) struct Policies {
    distinct: Vec<Policy>,
    /// By [`ModuleId`].
    of_module: Vec<u32>,
}

impl Policies {
    /// A monitor that judges by the clock never falls silent.
    pub(crate) fn of(model: &Model) -> Policies {
        let mut known: HashMap<Policy, u32> = HashMap::new();
        let mut policies = Policies { distinct: Vec::new(), of_module: Vec::new() };
        for spec in &model.modules {
            let mut policy = spec.policy.clone();
            if spec.monitor.by_the_clock() {
                (policy.timeout, policy.forget_after) = (Span::from_nanos(u64::MAX), None);
            }
            let index = *known.entry(policy.clone()).or_insert_with(|| {
                policies.distinct.push(policy);
                policies.distinct.len() as u32 - 1
            });
            policies.of_module.push(index);
        }
        policies
    }

    pub(crate) fn get(&self, id: ModuleId) -> &Policy {
        &self.distinct[self.of_module[id.0 as usize] as usize]
    }
}
