//! Counters since the start, for developers.

use super::input::TroubleKind;
use super::time::Timestamp;

/// The number of faults of one kind on one topic.
#[derive(Debug, Clone, PartialEq)]
pub struct Reception {
    pub topic: Box<str>,
    pub kind: TroubleKind,
    pub count: u64,
    pub last: Timestamp,
    pub last_text: Box<str>,
}

/// Counters since the start; for developers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    pub arrays: u64,
    pub statuses: u64,
    /// Statuses of new names past the limit of discovered modules.
    pub dropped_names: u64,
    /// Ended, unacknowledged alarms that a later alarm of the same node counts.
    pub merged_alarms: u64,
    /// Ended, unacknowledged alarms that were dropped because too many were kept.
    pub dropped_alarms: u64,
    /// Signals that the model does not name.
    pub unknown_signals: u64,
    /// Messages of topics that monitors watch.
    pub samples: u64,
    /// Messages, publisher changes and probe results that another configuration requested.
    pub dropped_samples: u64,
    /// Modules with cut texts at present, and the bytes of all modules' texts.
    pub cut_statuses: u64,
    pub status_bytes: u64,
}
