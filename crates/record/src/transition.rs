//! The lines of a recording's channel `/telltale/transitions`: what changed, for readers who do not replay.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use telltale_engine::view::record::{Record, Recorded};

/// One change. Nodes have their names of the wire, states and stages the words of the API.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Transition<'a> {
    /// Milliseconds since 1970.
    pub at_ms: i64,
    #[serde(flatten)]
    pub change: Change<'a>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum Change<'a> {
    /// The engine started, or took another configuration.
    Started {
        reloaded: bool,
    },
    /// A node shows another state. `own` is its state as if nothing were masked, `masked_by` a root cause.
    Shown {
        node: Cow<'a, str>,
        shown: Cow<'a, str>,
        own: Cow<'a, str>,
        #[serde(skip_serializing_if = "Option::is_none")]
        masked_by: Option<Cow<'a, str>>,
        #[serde(skip_serializing_if = "Option::is_none")]
        message: Option<Cow<'a, str>>,
        /// When the fault began that is noticed now, if it is estimated to have begun earlier.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        began_ms: Option<i64>,
    },
    Stage {
        stage: Cow<'a, str>,
    },
    Signal {
        signal: Cow<'a, str>,
        value: Option<bool>,
    },
    AlarmRaised {
        alarm: u64,
        node: Cow<'a, str>,
    },
    AlarmMoved {
        alarm: u64,
        symptom: Cow<'a, str>,
        node: Cow<'a, str>,
    },
    AlarmAcknowledged {
        alarm: u64,
        node: Cow<'a, str>,
    },
    AlarmCleared {
        alarm: u64,
        node: Cow<'a, str>,
    },
    /// A discovered module was silent for too long and was removed.
    Left {
        node: Cow<'a, str>,
    },
    /// This number of changes is missing before this one.
    Lost {
        count: u64,
    },
    /// The wall clock of this machine was set. The times of a file do not follow it.
    ClockSet {
        by_ms: i64,
    },
    /// A reason of this incident: its kind and what it was, as the list of incidents has it.
    Trigger {
        of: Cow<'a, str>,
        what: Cow<'a, str>,
        #[serde(skip_serializing_if = "Option::is_none")]
        alarm: Option<u64>,
        #[serde(default, skip_serializing_if = "str::is_empty")]
        note: Cow<'a, str>,
    },
    /// A refused action of an operator, and the reason, in English and German.
    Refused {
        action: Cow<'a, str>,
        on: Cow<'a, str>,
        by: Cow<'a, str>,
        why: Cow<'a, str>,
        why_de: Cow<'a, str>,
    },
}

impl Transition<'_> {
    pub fn of(record: &Record, at_ms: i64) -> Transition<'_> {
        let change = match &record.what {
            Recorded::Started { anew } => Change::Started { reloaded: *anew },
            Recorded::Shown { node, state, own, cause, said, began } => Change::Shown {
                node: (**node).into(),
                shown: state.as_str().into(),
                own: own.as_str().into(),
                masked_by: cause.as_deref().map(Cow::Borrowed),
                message: said.as_ref().map(|said| said.words()),
                began_ms: began.map(|began| at_ms - record.at.since(began).as_millis() as i64),
            },
            Recorded::Stage(stage) => Change::Stage { stage: stage.as_str().into() },
            Recorded::Signal { name, value } => Change::Signal { signal: (**name).into(), value: *value },
            Recorded::AlarmRaised { id, node } => Change::AlarmRaised { alarm: *id, node: (**node).into() },
            Recorded::AlarmMoved { id, symptom, cause } => {
                Change::AlarmMoved { alarm: *id, symptom: (**symptom).into(), node: (**cause).into() }
            }
            Recorded::AlarmAcknowledged { id, node } => {
                Change::AlarmAcknowledged { alarm: *id, node: (**node).into() }
            }
            Recorded::AlarmCleared { id, node } => Change::AlarmCleared { alarm: *id, node: (**node).into() },
            Recorded::Left { node } => Change::Left { node: (**node).into() },
            Recorded::Lost(count) => Change::Lost { count: *count },
        };
        Transition { at_ms, change }
    }
}
