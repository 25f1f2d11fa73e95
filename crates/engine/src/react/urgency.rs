//! The urgency of the faults for the operator of a driving vehicle. Masking never lowers it, and it does not fall until a
//! fault gets better.

use std::cmp::Reverse;
use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

use super::held::{RequestOrigin, fails};
use crate::Engine;
use crate::mask::net::{Change, Net};
use crate::mask::node::{ModuleKind, NodeFacts};
use crate::model::countermeasure::RequestKind;
use crate::model::wording::Urgency;
use crate::model::{ModuleId, NodeId, Stage, StageModel};
use crate::snapshot::{Alarm, Asked, Moving};
use crate::state::State;

/// The present urgency of the faults. All of it follows from the own states, the stage and the alarms.
#[derive(Debug, Clone, Default)]
pub(crate) struct Asks {
    /// Modules, and groups without members, whose own state is a fault. Those with time to report are left out.
    faulty: BTreeSet<NodeId>,
    /// Those that changed since the last look.
    changed: Vec<NodeId>,
    dirty: bool,
    stands: bool,
    /// By node.
    pub(crate) asking: Arc<[(NodeId, Urgency)]>,
    pub(crate) asked: Option<Asked>,
}

impl Asks {
    /// Follows a node. A walk through the vehicle is not needed to find the faults.
    pub(crate) fn note(&mut self, net: &Net, change: &Change, has_advice: impl Fn(ModuleId) -> bool) {
        let node = change.node;
        // A WARNING asks for something only where the configuration says so.
        let is_advised = || matches!(node, NodeId::Module(id) if has_advice(id));
        let counts = || match node {
            NodeId::Group(id) => {
                let group = &net.groups[id.0 as usize];
                group.members.is_empty() && !group.aside && id != net.system_group()
            }
            NodeId::Module(_) => net.node(node).parent.is_none_or(|id| !net.groups[id.0 as usize].aside),
        };
        let asks =
            is_fault(&change.after) && (change.after.own != State::Warning || is_advised()) && counts();
        if change.before != change.after {
            self.dirty = true;
            self.changed.extend(asks.then_some(node));
        }
        self.dirty |= if asks { self.faulty.insert(node) } else { self.faulty.remove(&node) };
    }
}

/// A fault of a relevant node that has no time left to report.
fn is_fault(facts: &NodeFacts) -> bool {
    let fault = match facts.own {
        State::Warning | State::Error => true,
        State::Unknown => !facts.grace,
        State::Ok | State::Ignore => false,
    };
    facts.relevant && fault
}

impl Engine {
    /// Updates what the faults ask for, and what alarms remember of it.
    pub(crate) fn follow_urgency(&mut self) {
        let stands = self.motion.shown().moving == Moving::No;
        let moved = std::mem::replace(&mut self.asks.stands, stands) != stands;
        let dirty = std::mem::take(&mut self.asks.dirty);
        if !dirty && !moved && !self.vehicle_changed && !self.views.is_changed() {
            return;
        }
        let may_drive = self.may_drive();
        let asks_nothing = !may_drive || self.asks.faulty.is_empty();
        let asked_nothing = self.asks.asked.is_none() && self.asks.asking.is_empty();
        if asks_nothing && asked_nothing && self.alarms.list().iter().all(|alarm| alarm.asked.is_none()) {
            return;
        }
        let faulty = self.asks.faulty.iter().filter(|_| may_drive);
        let asking: Vec<(NodeId, Urgency)> =
            faulty.filter_map(|&node| Some((node, self.asks_for(node)?))).collect();
        let mut of_root: HashMap<NodeId, Urgency> = HashMap::new();
        for &(node, urgency) in &asking {
            let causes = if self.is_masked(node) { self.views.masked_by(node) } else { vec![node] };
            for cause in causes {
                let most = of_root.entry(cause).or_insert(urgency);
                *most = urgency.max(*most);
            }
        }
        if self.alarms.ask(|root| of_root.get(&root).copied(), may_drive && !stands) {
            self.views.set_alarms(self.alarms.list());
        }
        let asked = self.asked(&asking);
        if asked != self.asks.asked || *asking != *self.asks.asking {
            (self.asks.asking, self.asks.asked) = (asking.into(), asked);
            self.vehicle_changed = true;
        }
    }

    /// A node whose new fault asks for more than the instruction says: a fault of this program. Only what changed is
    /// looked at, so that the look costs nothing while nothing changes.
    pub(crate) fn under_asked(&mut self) -> Option<NodeId> {
        let mut changed = std::mem::take(&mut self.asks.changed);
        let said = self.asks.asked.map(|asked| asked.urgency);
        let found = match self.may_drive() {
            true => changed
                .iter()
                .copied()
                .find(|&node| is_fault(&self.net.node(node).facts) && self.asks_for(node) > said),
            false => None,
        };
        changed.clear();
        self.asks.changed = changed;
        found
    }

    fn may_drive(&self) -> bool {
        self.vehicle.model == StageModel::Shuttle
            && matches!(self.vehicle.stage, Stage::Cleared | Stage::Active)
    }

    /// The most urgent of all: first what is in sight, then what waits for a cause, then what was asked before.
    fn asked(&self, asking: &[(NodeId, Urgency)]) -> Option<Asked> {
        let present =
            asking.iter().map(|&(node, urgency)| (urgency, 1 + u8::from(!self.is_masked(node)), node));
        let open = self.alarms.list().iter().filter(|alarm| alarm.active && !alarm.acknowledged);
        let before = open.filter_map(|alarm| Some((alarm.asked?, 0, alarm.node)));
        // A reload numbers discovered modules anew: of those that are alike the first by name.
        let discovered = |node| match node {
            NodeId::Module(id)
                if !matches!(
                    self.net.modules[id.0 as usize].kind,
                    ModuleKind::Declared | ModuleKind::BuiltIn
                ) =>
            {
                Some(self.views.name(node))
            }
            NodeId::Module(_) | NodeId::Group(_) => None,
        };
        // `max_by_key` gives the last of those that are alike.
        let all: Vec<_> = present.chain(before).collect();
        let key = |&(urgency, rank, node): &(Urgency, u8, NodeId)| (urgency, rank, Reverse(discovered(node)));
        let (urgency, _, node) = all.into_iter().rev().max_by_key(key)?;
        Some(Asked { urgency, node })
    }

    fn is_masked(&self, node: NodeId) -> bool {
        self.net.node(node).facts.masked
    }

    /// The urgency of a node's own state: the configured one; else an ERROR or UNKNOWN asks to be ready, and a fault after
    /// which the vehicle can only slow down asks to take over.
    fn asks_for(&self, node: NodeId) -> Option<Urgency> {
        let facts = &self.net.node(node).facts;
        let own = facts.own;
        let advised = match node {
            NodeId::Module(id) if !facts.waits_for_reset => {
                self.views.help(id).and_then(|help| help.of(own, self.vehicle.stage)?.urgency)
            }
            NodeId::Module(_) | NodeId::Group(_) => None,
        };
        match own {
            State::Ok | State::Ignore => None,
            _ if advised.is_some() => advised,
            State::Warning => None,
            State::Error if self.slows(node) => Some(Urgency::TakeOver),
            State::Unknown | State::Error => Some(Urgency::BeReady),
        }
    }

    /// Whether the vehicle is asked to slow down because of this node: it is named as a cause, or would be if nothing
    /// masked it.
    fn slows(&self, node: NodeId) -> bool {
        let held = self.countermeasures.held().iter();
        let mut slowing = held.filter(|held| held.present && held.request.kind() == RequestKind::Decelerate);
        slowing.any(|held| {
            let is_named = held.causes.iter().any(|cause| cause.present && cause.node == node);
            is_named
                || match held.by {
                    RequestOrigin::Rule(index, about) => {
                        let state = self.model.driving.countermeasures[index].state;
                        fails(&self.net.node(about).facts, state) && self.fails_for(node, about)
                    }
                    RequestOrigin::Past | RequestOrigin::Operator => false,
                }
        })
    }

    /// Whether a node around this one, or this one itself, fails because of it.
    fn fails_for(&self, node: NodeId, about: NodeId) -> bool {
        let mut at = node;
        while at != about {
            let Some(parent) = self.net.node(at).parent.map(NodeId::Group) else { return false };
            let standing = |node| self.net.node(node).facts.standing();
            if !standing(at).is_responsible_for(standing(parent)) {
                return false;
            }
            at = parent;
        }
        true
    }
}

impl Alarm {
    /// Covers an alarm of a symptom, which closes. What nobody has acknowledged there is not acknowledged here.
    pub(super) fn take_over_urgency(&mut self, asked: Option<Urgency>, acknowledged: bool) {
        if asked > self.asked {
            self.asked = asked;
            if !acknowledged {
                (self.acknowledged, self.acknowledged_at) = (false, None);
            }
        }
    }
}
