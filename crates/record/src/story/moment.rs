//! The things that happen in an incident, as its page tells them one after the other.

use schemars::JsonSchema;
use serde::Serialize;

/// One thing that happened, and when it was noticed.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
pub struct Moment {
    pub at_ms: i64,
    #[serde(flatten)]
    pub what: Happened,
}

impl Moment {
    /// The time by which a story is in order: a fault stands where it began.
    pub fn began_ms(&self) -> i64 {
        match self.what {
            Happened::Fails { began_ms: Some(began_ms), .. } => began_ms,
            _ => self.at_ms,
        }
    }
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", tag = "kind")]
pub enum Happened {
    /// A module shows a fault that nothing explains, or no longer explains.
    Fails {
        node: String,
        state: String,
        message: String,
        /// When the fault began, if it is estimated to have begun before its notice.
        #[serde(skip_serializing_if = "Option::is_none")]
        began_ms: Option<i64>,
    },
    /// A module is in ERROR itself, which a fault that is shown hides.
    FailsBehind {
        node: String,
    },
    /// The nodes are explained by a root cause and hidden behind it.
    Masks {
        by: String,
        nodes: Vec<String>,
        more: usize,
    },
    /// Modules that had failed are OK.
    Recovers {
        nodes: Vec<String>,
        more: usize,
    },
    /// The alarm of a symptom now belongs to its cause.
    AlarmMoves {
        symptom: String,
        node: String,
    },
    Stage {
        stage: String,
    },
    /// A signal has another value; `None`: it is not known.
    Signal {
        signal: String,
        value: Option<bool>,
    },
    /// Autonomous driving ended although the vehicle was not known to stand.
    LostActive {
        stage: String,
    },
    /// A request to the vehicle became stronger.
    Request {
        request: String,
    },
    Mark {
        by: String,
        note: String,
    },
    /// An action of the operator, by its word, and its target.
    Operator {
        action: &'static str,
        on: String,
    },
    /// A refused action of the operator, by its word, and the reason, in English and German.
    Refused {
        action: String,
        on: String,
        by: String,
        why: String,
        why_de: String,
    },
    /// The wall clock was set by so much.
    ClockSet {
        by_ms: i64,
    },
    Reload,
    Lost {
        count: u64,
    },
    /// The program ended: what came later is not in the recording.
    Interrupted,
}
