//! What happened, in order: for histories, figures and logs. The engine keeps it only if asked to.

use std::sync::Arc;

use super::Engine;
use super::model::{NodeId, Stage};
use super::net::Change;
use super::record::Said;
use super::state::State;
use super::time::Timestamp;

/// Events that wait to be taken. Past this the oldest are dropped, and counted.
const EVENTS_MAX: usize = 65_536;

#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    pub at: Timestamp,
    pub what: What,
}

#[derive(Debug, Clone, PartialEq)]
pub enum What {
    /// A node shows another state, reports another one behind what it shows, or waits for another
    /// `cause`.
    Shown {
        node: NodeId,
        from: State,
        to: State,
        own: State,
        cause: Option<NodeId>,
        /// The words of a module.
        said: Option<Said>,
    },
    Stage {
        from: Stage,
        to: Stage,
    },
    Signal {
        index: usize,
        value: Option<bool>,
    },
    /// A root cause appeared and nothing before explains it.
    AlarmRaised {
        id: u64,
        node: NodeId,
    },
    /// What `symptom` reported since the alarm was raised is owed to `cause`.
    AlarmMoved {
        id: u64,
        symptom: NodeId,
        cause: NodeId,
    },
    AlarmAcknowledged {
        id: u64,
        node: NodeId,
    },
    /// The root cause is gone, or another alarm stands for it.
    AlarmCleared {
        id: u64,
        node: NodeId,
    },
    /// A module that was made at run time was silent for too long: it is not there any more.
    Left {
        node: Arc<str>,
    },
    /// The configuration was replaced: ids before and after name different nodes.
    Reloaded,
}

#[derive(Debug, Default)]
pub(super) struct Events {
    list: Option<Vec<Event>>,
    pub(super) dropped: u64,
}

impl Events {
    pub(super) fn keep(&mut self) {
        self.list.get_or_insert_default();
    }

    pub(super) fn push(&mut self, at: Timestamp, what: What) {
        let Some(list) = &mut self.list else { return };
        if list.len() >= EVENTS_MAX {
            let half = list.len() / 2;
            list.drain(..half);
            self.dropped += half as u64;
        }
        list.push(Event { at, what });
    }

    /// What those that were not taken yet speak of.
    pub(super) fn nodes(&self) -> impl Iterator<Item = NodeId> {
        let of = |event: &Event| match event.what {
            What::Shown { node, cause, .. } => [Some(node), cause],
            What::AlarmMoved { symptom, cause, .. } => [Some(symptom), Some(cause)],
            What::AlarmRaised { node, .. }
            | What::AlarmAcknowledged { node, .. }
            | What::AlarmCleared { node, .. } => [Some(node), None],
            _ => [None, None],
        };
        self.list.iter().flatten().flat_map(of).flatten()
    }

    pub(super) fn wanted(&self) -> bool {
        self.list.is_some()
    }

    pub(super) fn take(&mut self) -> Vec<Event> {
        self.list.as_mut().map(std::mem::take).unwrap_or_default()
    }
}

/// A masked node that waits for another cause than before.
pub(super) struct BlamedAnew {
    pub(super) node: NodeId,
    pub(super) own: State,
    pub(super) cause: Option<NodeId>,
}

impl Engine {
    /// Tells what other nodes show now, and which wait for another cause. Asked for only where events
    /// are wanted.
    pub(super) fn keep_changes(&mut self, changes: &[Change], blamed: Vec<BlamedAnew>) {
        for Change { node, before, after } in changes {
            if (before.shown, before.own, before.masked) != (after.shown, after.own, after.masked) {
                let cause = self.views.masked_by(*node).first().copied();
                self.keep_shown(*node, (before.shown, after.shown), after.own, cause);
            }
        }
        for BlamedAnew { node, own, cause } in blamed {
            self.keep_shown(node, (State::Ignore, State::Ignore), own, cause);
        }
    }

    fn keep_shown(&mut self, node: NodeId, (from, to): (State, State), own: State, cause: Option<NodeId>) {
        let said = self.said(node);
        self.events.push(self.now, What::Shown { node, from, to, own, cause, said });
    }

    /// What a module says at this instant. The view of it may not know yet when it was heard.
    fn said(&self, node: NodeId) -> Option<Said> {
        let NodeId::Module(id) = node else { return None };
        let own = &self.net.modules[id.0 as usize].own;
        let silent = own.received().filter(|_| own.silent()).map(|at| self.now.since(at));
        let report = &self.views.modules.get(id.0 as usize)?.report;
        Said::of(report.last_words(own.silent()), silent)
    }
}
