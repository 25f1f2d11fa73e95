//! Counters since the start, for developers.

use super::files::count;
use super::input::TroubleKind;
use super::time::Timestamp;
use serde::{Deserialize, Serialize};

/// The number of faults of one kind on one topic.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Reception {
    pub topic: Box<str>,
    pub kind: TroubleKind,
    #[serde(deserialize_with = "count")]
    pub count: u64,
    pub last: Timestamp,
    pub last_text: Box<str>,
}

/// Counters since the start; for developers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Counters {
    #[serde(deserialize_with = "count")]
    pub arrays: u64,
    #[serde(deserialize_with = "count")]
    pub statuses: u64,
    /// Statuses of new names past the limit of discovered modules.
    #[serde(deserialize_with = "count")]
    pub dropped_names: u64,
    /// Ended, unacknowledged alarms that a later alarm of the same node counts.
    #[serde(deserialize_with = "count")]
    pub merged_alarms: u64,
    /// Ended, unacknowledged alarms that were dropped because too many were kept.
    #[serde(deserialize_with = "count")]
    pub dropped_alarms: u64,
    /// Signals that the model does not name.
    #[serde(deserialize_with = "count")]
    pub unknown_signals: u64,
    /// Messages of topics that monitors watch.
    #[serde(deserialize_with = "count")]
    pub samples: u64,
    /// Messages, publisher changes and probe results that another configuration requested.
    #[serde(deserialize_with = "count")]
    pub dropped_samples: u64,
    /// Modules with cut texts at present, and the bytes of all modules' texts.
    #[serde(deserialize_with = "count")]
    pub cut_statuses: u64,
    #[serde(deserialize_with = "count")]
    pub status_bytes: u64,
}
