//! Events with names instead of ids, which stay valid under another configuration.

use crate::Engine;
use crate::event::Said;
use std::collections::HashSet;
use std::sync::Arc;

use super::views::Views;
use crate::event::{Event, EventKind};
use crate::mask::net::Change;
use crate::model::{NodeId, Stage};
use crate::module::report::said;
use crate::snapshot::{Reason, Snapshot};
use crate::state::State;
use crate::time::Timestamp;

/// One line of a history.
#[derive(Debug, Clone, PartialEq)]
pub struct Record {
    pub at: Timestamp,
    pub what: Recorded,
}

#[derive(Debug, Clone, PartialEq)]
pub enum Recorded {
    /// The engine started, or took another configuration: all earlier states end here, and a record of every
    /// node follows.
    Started {
        anew: bool,
    },
    /// A node shows this from now on. A `cause` is the root cause that masks it.
    Shown {
        node: Arc<str>,
        state: State,
        own: State,
        cause: Option<Arc<str>>,
        said: Option<Said>,
        /// When the fault began that is noticed now, if it is estimated to have begun earlier.
        began: Option<Timestamp>,
    },
    Stage(Stage),
    Signal {
        name: Box<str>,
        value: Option<bool>,
    },
    AlarmRaised {
        id: u64,
        node: Arc<str>,
    },
    AlarmMoved {
        id: u64,
        symptom: Arc<str>,
        cause: Arc<str>,
    },
    AlarmAcknowledged {
        id: u64,
        node: Arc<str>,
    },
    AlarmCleared {
        id: u64,
        node: Arc<str>,
    },
    /// A discovered module was silent for too long and was removed.
    Left {
        node: Arc<str>,
    },
    /// This number of records before this one was dropped.
    Lost(u64),
}

/// A node showed one state from one instant to another.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    /// Milliseconds since 1970.
    pub from_ms: i64,
    pub to_ms: i64,
    pub state: State,
    pub own: State,
    /// The root cause that masked it.
    pub cause: Option<Arc<str>>,
    /// Its message when it began to show this.
    pub said: Option<Said>,
}

impl Views {
    /// Nodes that stay masked, but by another cause than before.
    pub(crate) fn changed_causes(
        &self,
        masked: &[(NodeId, Arc<[NodeId]>)],
        changes: &[Change],
    ) -> Vec<ChangedCause> {
        let changed: HashSet<NodeId> = changes.iter().map(|change| change.node).collect();
        let anew = |(node, by): &(NodeId, Arc<[NodeId]>)| {
            let known = match self.reason(*node) {
                Some(Reason::Masked { by }) if !changed.contains(node) => by.first(),
                _ => return None,
            };
            let own = match *node {
                NodeId::Group(id) => self.groups.get(id.0 as usize)?.own,
                NodeId::Module(id) => self.modules.get(id.0 as usize)?.own,
            };
            let cause = by.first().copied();
            (known != by.first()).then_some(ChangedCause { node: *node, own, cause })
        };
        masked.iter().filter_map(anew).collect()
    }
}

impl Record {
    /// The record of an event, with the names of the snapshot that was taken after it.
    pub fn of(event: Event, snapshot: &Snapshot) -> Option<Record> {
        let name = |node: NodeId| snapshot.node_name(node).clone();
        let Event { at, what } = event;
        let what = match what {
            EventKind::Shown { node, to, own, cause, said, began, .. } => {
                Recorded::Shown { node: name(node), state: to, own, cause: cause.map(name), said, began }
            }
            EventKind::Stage { to, .. } => Recorded::Stage(to),
            EventKind::Signal { index, value } => {
                Recorded::Signal { name: snapshot.signals.get(index)?.0.clone(), value }
            }
            EventKind::AlarmRaised { id, node } => Recorded::AlarmRaised { id, node: name(node) },
            EventKind::AlarmMoved { id, symptom, cause } => {
                Recorded::AlarmMoved { id, symptom: name(symptom), cause: name(cause) }
            }
            EventKind::AlarmAcknowledged { id, node } => Recorded::AlarmAcknowledged { id, node: name(node) },
            EventKind::AlarmCleared { id, node } => Recorded::AlarmCleared { id, node: name(node) },
            EventKind::Left { node } => Recorded::Left { node },
            // `Record::present` writes it.
            EventKind::Reloaded => return None,
        };
        Some(Record { at, what })
    }

    /// The present state as the first records of a history: the stage, the signals, and the state of every
    /// node.
    pub fn present(snapshot: &Snapshot, anew: bool) -> Vec<Record> {
        let stage = snapshot.has_stages().then_some(Recorded::Stage(snapshot.stage));
        let first = [Recorded::Started { anew }].into_iter().chain(stage);
        let signal =
            |(name, value): &(Box<str>, Option<bool>)| Recorded::Signal { name: name.clone(), value: *value };
        let shown = |node: NodeId| {
            let (state, reason) = snapshot.shown(node);
            let cause = match reason {
                Some(Reason::Masked { by }) => by.first(),
                Some(Reason::NotRelevant(_)) | None => None,
            };
            let cause = cause.map(|&cause| snapshot.node_name(cause).clone());
            let said = match node {
                NodeId::Module(id) => snapshot.module(id).1.said(snapshot.now),
                NodeId::Group(_) => None,
            };
            let (name, own) = (snapshot.node_name(node).clone(), snapshot.own(node));
            Recorded::Shown { node: name, state, own, cause, said, began: None }
        };
        let all = first.chain(snapshot.signals.iter().map(signal));
        let all = all.chain(snapshot.nodes().map(shown));
        all.map(|what| Record { at: snapshot.now, what }).collect()
    }
}

impl Engine {
    /// Records changed nodes, and masked ones with another cause. Called only if events are kept.
    pub(crate) fn keep_changes(&mut self, changes: &[Change], blamed: Vec<ChangedCause>) {
        for Change { node, before, after } in changes {
            if (before.shown, before.own, before.masked) != (after.shown, after.own, after.masked) {
                let cause = self.views.masked_by(*node).first().copied();
                let began = match *node {
                    NodeId::Module(id) if before.own != after.own => self.net.began(id),
                    NodeId::Module(_) | NodeId::Group(_) => None,
                };
                self.keep_shown(*node, (before.shown, after.shown), after.own, cause, began);
            }
        }
        for ChangedCause { node, own, cause } in blamed {
            self.keep_shown(node, (State::Ignore, State::Ignore), own, cause, None);
        }
    }

    fn keep_shown(
        &mut self,
        node: NodeId,
        (from, to): (State, State),
        own: State,
        cause: Option<NodeId>,
        began: Option<Timestamp>,
    ) {
        let said = self.said(node);
        self.events.push(self.now, EventKind::Shown { node, from, to, own, cause, said, began });
    }

    /// The present message of a module. Its view may not have the latest time of receipt yet.
    fn said(&self, node: NodeId) -> Option<Said> {
        let NodeId::Module(id) = node else { return None };
        let module = &self.net.modules[id.0 as usize];
        let own = &module.own;
        let silent = own.received().filter(|_| own.silent()).map(|at| self.now.since(at));
        let report = &self.views.modules.get(id.0 as usize)?.report;
        let why = own.steps(self.net.policy(id)).why_unknown(module.node.facts.own, own.silent());
        said(report, own.silent(), why, silent)
    }
}

/// A masked node with another cause than before.
pub(crate) struct ChangedCause {
    pub(crate) node: NodeId,
    pub(crate) own: State,
    pub(crate) cause: Option<NodeId>,
}
