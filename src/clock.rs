//! The only place that reads a clock.

use std::time::{Duration, Instant, SystemTime};

use crate::engine::time::{Span, Timestamp};

/// The monotonic clock of receipt, counted from the start of the process, with the wall clock
/// beside it for what people read. Copies agree.
#[derive(Debug, Clone, Copy)]
pub struct Clock {
    start: Instant,
}

impl Clock {
    #[expect(clippy::disallowed_methods, reason = "the one clock of the process")]
    pub fn start() -> Clock {
        Clock { start: Instant::now() }
    }

    /// Monotonic: never stepped, never back.
    pub fn now(&self) -> Timestamp {
        Timestamp::from_nanos(u64::try_from(self.start.elapsed().as_nanos()).unwrap_or(u64::MAX))
    }

    /// What the wall clock says now. It may be stepped at any time: for display only.
    #[expect(clippy::disallowed_methods, reason = "the one clock of the process")]
    pub fn wall(&self) -> SystemTime {
        SystemTime::now()
    }

    /// The monotonic instant as tokio's timers take it.
    pub fn instant(&self, at: Timestamp) -> Instant {
        self.start + Duration::from_nanos(at.as_nanos())
    }
}

/// What the wall clock showed at `then`, as it reads now: a stepped clock shifts past and present alike.
pub fn wall_at(wall_now: SystemTime, now: Timestamp, then: Timestamp) -> SystemTime {
    let ago: Span = now.since(then);
    wall_now.checked_sub(Duration::from_nanos(ago.as_nanos())).unwrap_or(SystemTime::UNIX_EPOCH)
}
