//! When the DDS process gives back the memory of incomplete samples.

use rustix::process::{Resource, getrlimit};

use crate::transport::memory::resident_megabytes;
use telltale_engine::time::{Span, Timestamp};

/// The shortest time from one relief to the next.
const RELIEF_EVERY: Span = Span::from_secs(1);

#[derive(Debug)]
pub struct Relief {
    /// The memory to which the process is confined, in megabytes.
    limit: Option<u64>,
    relieved: Timestamp,
    /// The least memory since the last relief. What a relief does not give back is no reason for the next one.
    least: u64,
}

impl Relief {
    pub fn of_this_process() -> Relief {
        let limit = getrlimit(Resource::Data).current.map(|bytes| bytes >> 20);
        Relief { limit, relieved: Timestamp::ZERO, least: 0 }
    }

    /// Whether it takes more than three eighths of its memory, and one more than after the last relief.
    pub fn is_due(&mut self, now: Timestamp) -> bool {
        let Some(limit) = self.limit else { return false };
        now.since(self.relieved) >= RELIEF_EVERY && self.is_due_with(now, limit, resident_megabytes("self"))
    }

    fn is_due_with(&mut self, now: Timestamp, limit: u64, resident: u64) -> bool {
        self.least = self.least.min(resident);
        let is_due = resident > limit / 8 * 3 && resident - self.least > limit / 8;
        if is_due {
            (self.relieved, self.least) = (now, u64::MAX);
        }
        is_due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_relief_does_not_give_back_is_no_reason_for_the_next() {
        let mut relief = Relief { limit: Some(800), relieved: Timestamp::ZERO, least: 0 };
        let mut is_due = |resident| relief.is_due_with(Timestamp::ZERO, 800, resident);
        assert!(!is_due(300));
        assert!(is_due(301));
        assert!(!is_due(400), "it gave back nothing");
        assert!(!is_due(500));
        assert!(is_due(501));
        assert!(!is_due(150));
        assert!(!is_due(251), "an eighth more, but less than three");
        assert!(is_due(301));
    }
}
