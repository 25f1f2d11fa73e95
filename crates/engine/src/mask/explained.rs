//! Whether a cause explains a blocked module in ERROR: it began near the beginning of the cause.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use super::causes::{IdHash, Vertex, end, for_each_hop, for_each_way};
use super::net::Net;
use super::node::NodeFacts;
use super::rules;
use crate::model::lateness::{Beginning, Lateness, Notice};
use crate::model::{ModuleId, NodeId, Within};
use crate::state::State;
use crate::time::{Span, Timestamp};

/// When the causes behind each dependency began, while one evaluation lasts: a dependency of a group holds for all
/// its modules. All that is upstream of a visited module has been visited before it.
#[derive(Debug, Clone, Default)]
pub(crate) struct Beginnings {
    /// By holder and index of the dependency.
    known: HashMap<(NodeId, u32), Arc<rules::Beginnings>, IdHash>,
    /// Something changed on which explanations depend: all blocked modules in ERROR are visited again.
    moved: bool,
}

impl Beginnings {
    pub(crate) fn forget(&mut self) {
        self.known.clear();
        self.moved = false;
    }
}

impl Net {
    /// A node changed. Explanations further downstream may be others now.
    pub(super) fn note_beginning(&mut self, before: &NodeFacts, after: &NodeFacts) {
        if self.blocked_errors.is_empty()
            || self.beginnings.moved
            || before.for_causes(self.threshold) == after.for_causes(self.threshold)
        {
            return;
        }
        self.beginnings.moved = true;
        for id in self.blocked_errors.iter().copied().collect::<Vec<_>>() {
            self.mark_module(id);
        }
    }

    /// Whether a dependency that blocks this module in ERROR explains it.
    pub(crate) fn is_explained(&mut self, id: ModuleId, now: Timestamp) -> bool {
        let mut at = Some(NodeId::Module(id));
        while let Some(holder) = at {
            for index in 0..self.node(holder).needs.len() {
                let need = &self.node(holder).needs[index];
                if need.blocks() && self.explains(need.within, id, (holder, index as u32), now) {
                    return true;
                }
            }
            at = self.node(holder).parent.map(NodeId::Group);
        }
        false
    }

    /// A module in ERROR that is masked although no cause explains it: a fault of this program.
    pub(crate) fn masked_unexplained(&mut self, now: Timestamp) -> Option<ModuleId> {
        let masked: Vec<ModuleId> = self.blocked_errors.iter().copied().collect();
        let found = masked
            .into_iter()
            .find(|&id| self.modules[id.0 as usize].node.facts.masked && !self.is_explained(id, now));
        self.beginnings.forget();
        found
    }

    fn explains(&mut self, within: Within, id: ModuleId, need: (NodeId, u32), now: Timestamp) -> bool {
        let limit = match within {
            Within::Always => return true,
            Within::Limit(limit) => limit,
        };
        let own = &self.modules[id.0 as usize].own;
        if own.onset.was_shown_for(within, now) {
            return false;
        }
        let late = |notice| self.lateness(id, notice).known(limit);
        let effect = own.onset.as_effect(own.relevant_since(), limit, &late);
        let causes = match self.beginnings.known.get(&need) {
            Some(known) => known.clone(),
            None => {
                let found = Arc::new(self.causes_behind(need, limit));
                self.beginnings.known.insert(need, found.clone());
                found
            }
        };
        within.explains(effect.into_iter().flatten(), &causes)
    }

    /// How late the monitor of this module noticed a fault. The debounced state counts for what explains it.
    fn lateness(&self, id: ModuleId, notice: Notice) -> Lateness {
        let of_monitor = self.model.modules.get(id.0 as usize).map(|spec| &spec.monitor);
        self.model.lateness_of(of_monitor, self.policy(id), notice)
    }

    /// When the present fault of this module began, if it is estimated to have begun before its notice. The estimate is
    /// as good as the default limit of a dependency needs.
    pub(crate) fn began(&self, id: ModuleId) -> Option<Timestamp> {
        let Within::Limit(limit) = Within::default() else { return None };
        let own = &self.modules[id.0 as usize].own;
        let late = |notice| self.lateness(id, notice).debounced(self.policy(id)).known(limit);
        own.onset.began(own.relevant_since(), &late)
    }

    /// When the failing modules, and failing groups without members, on the paths upstream through a dependency
    /// began to fail.
    fn causes_behind(&self, (holder, index): (NodeId, u32), limit: Span) -> rules::Beginnings {
        let need = &self.node(holder).needs[index as usize];
        let mut found = Vec::new();
        let mut seen = HashSet::new();
        let mut open: Vec<(Vertex, bool)> = Vec::new();
        for &member in &need.members {
            for_each_way(self, member, need.masks_unknown, |vertex| open.push((vertex, need.masks_unknown)));
        }
        while let Some((vertex, masks_unknown)) = open.pop() {
            if !seen.insert((vertex, masks_unknown)) {
                continue;
            }
            found.extend(self.cause_began(vertex, masks_unknown, limit).into_iter().flatten());
            if end(self, vertex).is_none() {
                for_each_hop(self, vertex, |hop, through| open.push((hop, through.unwrap_or(masks_unknown))));
            }
        }
        found.into_iter().collect()
    }

    /// When a cause began. An UNKNOWN explains only the nodes that it masks directly.
    fn cause_began(&self, vertex: Vertex, masks_unknown: bool, limit: Span) -> [Option<Beginning>; 3] {
        match vertex {
            Vertex::Module(id) => {
                let module = &self.modules[id.0 as usize];
                let facts = module.node.facts;
                let fails = facts.relevant
                    && (facts.own == State::Error || facts.own == State::Unknown && !facts.blocked);
                let since = module.own.relevant_since();
                let late = |notice| self.lateness(id, notice).known(limit);
                if fails { module.own.onset.as_cause(since, masks_unknown, &late) } else { [None; 3] }
            }
            Vertex::Failing(id) => {
                let group = &self.groups[id.0 as usize];
                if end(self, vertex).is_none() {
                    return [None; 3];
                }
                let stood =
                    group.relevant_since.filter(|&since| group.well_until.is_none_or(|it| it <= since));
                let at_once = |noticed| Beginning { noticed, began: Some(noticed) };
                [None, group.well_until.map(at_once), stood.map(at_once)]
            }
            Vertex::Blocked(_) | Vertex::Beyond(_) | Vertex::Hidden(_) => [None; 3],
        }
    }

    /// How far back the causes of a blocked node may explain it: the largest limit of the dependencies that block.
    pub(crate) fn reach(&self, node: NodeId) -> Within {
        let around = std::iter::successors(Some(node), |&at| self.node(at).parent.map(NodeId::Group));
        let needs = around.flat_map(|at| &self.node(at).needs).filter(|need| need.blocks());
        let mut reach = Span::ZERO;
        for need in needs {
            match need.within {
                Within::Always => return Within::Always,
                Within::Limit(limit) => reach = reach.max(limit),
            }
        }
        Within::Limit(reach)
    }
}
