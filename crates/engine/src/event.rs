//! Events in order, for histories, figures and logs. The engine keeps them only on request.

use super::files::count;
use super::time::Span;
use super::time::how_long;
use serde::{Deserialize, Serialize};
use std::borrow::Cow;
use std::sync::Arc;

use super::model::{NodeId, Stage};
use super::state::State;
use super::time::Timestamp;

/// The number of waiting events. Beyond it the oldest are dropped and counted.
const EVENTS_MAX: usize = 65_536;

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Event {
    pub at: Timestamp,
    pub what: EventKind,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum EventKind {
    /// A node's shown state, its own state behind that, or the `cause` that masks it has changed.
    Shown {
        node: NodeId,
        from: State,
        to: State,
        own: State,
        cause: Option<NodeId>,
        /// The message of a module.
        said: Option<Said>,
        /// When the fault of a module began that is noticed now, if it is estimated to have begun earlier.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        began: Option<Timestamp>,
    },
    Stage {
        from: Stage,
        to: Stage,
    },
    Signal {
        index: usize,
        value: Option<bool>,
    },
    /// A root cause appeared that no earlier alarm explains.
    AlarmRaised {
        id: u64,
        node: NodeId,
    },
    /// The alarm of `symptom` now belongs to `cause`, which explains it.
    AlarmMoved {
        id: u64,
        symptom: NodeId,
        cause: NodeId,
    },
    AlarmAcknowledged {
        id: u64,
        node: NodeId,
    },
    /// The root cause ended, or another alarm covers it.
    AlarmCleared {
        id: u64,
        node: NodeId,
    },
    /// A discovered module was silent for too long and was removed.
    Left {
        node: Arc<str>,
    },
    /// The configuration was replaced. Ids before and after it name different nodes.
    Reloaded,
}

#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Events {
    list: Option<Vec<Event>>,
    #[serde(deserialize_with = "count")]
    pub(super) dropped: u64,
}

impl Events {
    pub(super) fn keep(&mut self) {
        self.list.get_or_insert_default();
    }

    pub(super) fn push(&mut self, at: Timestamp, what: EventKind) {
        let Some(list) = &mut self.list else { return };
        if list.len() >= EVENTS_MAX {
            let half = list.len() / 2;
            list.drain(..half);
            self.dropped += half as u64;
        }
        list.push(Event { at, what });
    }

    /// The nodes of the waiting events, as they are numbered now: those before a reload named others.
    pub(super) fn nodes(&self) -> impl Iterator<Item = NodeId> {
        let of = |event: &Event| match event.what {
            EventKind::Shown { node, cause, .. } => [Some(node), cause],
            EventKind::AlarmMoved { symptom, cause, .. } => [Some(symptom), Some(cause)],
            EventKind::AlarmRaised { node, .. }
            | EventKind::AlarmAcknowledged { node, .. }
            | EventKind::AlarmCleared { node, .. } => [Some(node), None],
            EventKind::Stage { .. }
            | EventKind::Signal { .. }
            | EventKind::Left { .. }
            | EventKind::Reloaded => [None, None],
        };
        let list = self.list.as_deref().unwrap_or_default();
        let reload = list.iter().rposition(|event| event.what == EventKind::Reloaded);
        list[reload.map_or(0, |it| it + 1)..].iter().flat_map(of).flatten()
    }

    pub(super) fn wanted(&self) -> bool {
        self.list.is_some()
    }

    pub(super) fn take(&mut self) -> Vec<Event> {
        self.list.as_mut().map(std::mem::take).unwrap_or_default()
    }
}

/// Bytes of a message that are kept: a history holds a million of them.
const SAID_BYTES_MAX: usize = 200;

/// The message of a module when its state changed. Only this text distinguishes a reported ERROR from a silence
/// that counts as an ERROR.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Said {
    /// The last message, or its beginning.
    pub message: Box<str>,
    /// The length of the silence, if it was longer than the module's timeout.
    pub silent: Option<Span>,
}

impl Said {
    pub fn of(message: &str, silent: Option<Span>) -> Option<Said> {
        let message = &message[..message.floor_char_boundary(SAID_BYTES_MAX)];
        (silent.is_some() || !message.is_empty()).then(|| Said { message: message.into(), silent })
    }

    /// The message and the silence as one text, for programs.
    pub fn words(&self) -> Cow<'_, str> {
        with_silence(&self.message, self.silent)
    }
}

/// The last message together with the silence since then, if there is one.
pub(super) fn with_silence(last: &str, silent: Option<Span>) -> Cow<'_, str> {
    match silent.map(how_long) {
        None => last.into(),
        Some(long) if last.is_empty() => format!("silent for {long}").into(),
        Some(long) => format!("silent for {long}; last: {last}").into(),
    }
}
