//! What happened, in order: for histories, figures and logs. The engine keeps it only if asked to.

use super::model::{NodeId, Stage};
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

    pub(super) fn wanted(&self) -> bool {
        self.list.is_some()
    }

    pub(super) fn take(&mut self) -> Vec<Event> {
        self.list.as_mut().map(std::mem::take).unwrap_or_default()
    }
}
