//! The lines of a recording's channel `/telltale/transitions`: what changed, for readers who do not replay.

use serde::Serialize;

use crate::engine::view::record::{Record, Recorded};

/// One change. Nodes have their names of the wire, states and stages the words of the API.
#[derive(Debug, Serialize)]
pub struct Transition<'a> {
    /// Milliseconds since 1970.
    at_ms: i64,
    #[serde(flatten)]
    change: Change<'a>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "snake_case", tag = "kind")]
enum Change<'a> {
    /// The engine started, or took another configuration.
    Started {
        reloaded: bool,
    },
    /// A node shows another state. `own` is its state as if nothing were masked, `masked_by` a root cause.
    Shown {
        node: &'a str,
        shown: &'static str,
        own: &'static str,
        #[serde(skip_serializing_if = "Option::is_none")]
        masked_by: Option<&'a str>,
        #[serde(skip_serializing_if = "Option::is_none")]
        message: Option<String>,
    },
    Stage {
        stage: &'static str,
    },
    Signal {
        signal: &'a str,
        value: Option<bool>,
    },
    AlarmRaised {
        alarm: u64,
        node: &'a str,
    },
    AlarmMoved {
        alarm: u64,
        symptom: &'a str,
        node: &'a str,
    },
    AlarmAcknowledged {
        alarm: u64,
        node: &'a str,
    },
    AlarmCleared {
        alarm: u64,
        node: &'a str,
    },
    /// A discovered module was silent for too long and was removed.
    Left {
        node: &'a str,
    },
    /// This number of changes is missing before this one.
    Lost {
        count: u64,
    },
}

impl Transition<'_> {
    pub fn of(record: &Record, at_ms: i64) -> Transition<'_> {
        let change = match &record.what {
            Recorded::Started { anew } => Change::Started { reloaded: *anew },
            Recorded::Shown { node, state, own, cause, said } => Change::Shown {
                node,
                shown: state.as_str(),
                own: own.as_str(),
                masked_by: cause.as_deref(),
                message: said.as_ref().map(|said| said.words().into_owned()),
            },
            Recorded::Stage(stage) => Change::Stage { stage: stage.as_str() },
            Recorded::Signal { name, value } => Change::Signal { signal: name, value: *value },
            Recorded::AlarmRaised { id, node } => Change::AlarmRaised { alarm: *id, node },
            Recorded::AlarmMoved { id, symptom, cause } => {
                Change::AlarmMoved { alarm: *id, symptom, node: cause }
            }
            Recorded::AlarmAcknowledged { id, node } => Change::AlarmAcknowledged { alarm: *id, node },
            Recorded::AlarmCleared { id, node } => Change::AlarmCleared { alarm: *id, node },
            Recorded::Left { node } => Change::Left { node },
            Recorded::Lost(count) => Change::Lost { count: *count },
        };
        Transition { at_ms, change }
    }
}
