//! Counters since the start, for developers.

use super::input::TroubleKind;
use super::time::Timestamp;

/// Faults of one kind on one topic, counted.
#[derive(Debug, Clone, PartialEq)]
pub struct Reception {
    pub topic: Box<str>,
    pub kind: TroubleKind,
    pub count: u64,
    pub last: Timestamp,
    pub last_text: Box<str>,
}

/// What was counted since the start; for developers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counters {
    pub arrays: u64,
    pub statuses: u64,
    /// Statuses of new names past the limit of discovered modules.
    pub dropped_names: u64,
    /// Alarms that are over and not acknowledged, counted by a later alarm of the same node.
    pub merged_alarms: u64,
    /// Those that are gone without one, past what is kept.
    pub dropped_alarms: u64,
    /// Signals that the model does not name.
    pub unknown_signals: u64,
    /// Messages of topics that monitors watch.
    pub samples: u64,
    /// Messages, news of topics and probes that were asked for by another configuration.
    pub dropped_samples: u64,
    /// Modules whose words are cut now, and the bytes that those of all take.
    pub cut_statuses: u64,
    pub status_bytes: u64,
}
