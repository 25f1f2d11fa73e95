//! What is recorded, and for how long recordings are kept.

use telltale_engine::model::monitors::RecordedTopic;
use telltale_engine::time::Span;

/// The settings of the recording. A switched off recording is none of these.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recording {
    /// Time before the first trigger of an incident that belongs to it.
    pub before: Span,
    /// Time after its last trigger.
    pub after: Span,
    /// Bytes in memory for the time before a trigger.
    pub memory: u64,
    /// Bytes of all recordings on the disk; beyond it the oldest are removed.
    pub disk: u64,
    /// The age at which a recording is removed.
    pub keep: Span,
    /// Topics that are recorded in addition to the topics that Telltale reads anyway.
    pub topics: Vec<RecordedTopic>,
}

impl Default for Recording {
    fn default() -> Recording {
        Recording {
            before: Span::from_secs(30),
            after: Span::from_secs(10),
            memory: 256_000_000,
            disk: 10_000_000_000,
            keep: Span::from_secs(30 * 24 * 3600),
            topics: Vec::new(),
        }
    }
}
