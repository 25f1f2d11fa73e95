//! The only place that reads a clock.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant, SystemTime};

use crate::engine::time::{Span, Timestamp};

/// The monotonic clock of receipt, counted from the start of the process, with the wall clock
/// beside it for what people read. Copies agree.
#[derive(Debug, Clone, Copy)]
pub struct Clock {
    start: Instant,
    /// How far it was set ahead, in nanoseconds; a clock of a test alone has this.
    ahead: Option<&'static AtomicU64>,
}

/// Sets a clock ahead, so that a test need not wait for what takes long.
#[derive(Debug, Clone, Copy)]
pub struct ClockHand(&'static AtomicU64);

impl ClockHand {
    pub fn advance(&self, span: Span) {
        self.0.fetch_add(span.as_nanos(), Ordering::Relaxed);
    }
}

impl Clock {
    #[expect(clippy::disallowed_methods, reason = "the one clock of the process")]
    pub fn start() -> Clock {
        Clock { start: Instant::now(), ahead: None }
    }

    /// A clock that can be set ahead. Its hand lives as long as the process: it is for tests.
    pub fn with_hand() -> (Clock, ClockHand) {
        let ahead: &'static AtomicU64 = Box::leak(Box::default());
        (Clock { ahead: Some(ahead), ..Clock::start() }, ClockHand(ahead))
    }

    /// Monotonic: never stepped, never back.
    pub fn now(&self) -> Timestamp {
        let elapsed = u64::try_from(self.start.elapsed().as_nanos()).unwrap_or(u64::MAX);
        Timestamp::from_nanos(elapsed.saturating_add(self.ahead()))
    }

    /// What the wall clock says now. It may be stepped at any time: for display only.
    #[expect(clippy::disallowed_methods, reason = "the one clock of the process")]
    pub fn wall(&self) -> SystemTime {
        SystemTime::now()
    }

    /// The monotonic instant as tokio's timers take it.
    pub fn instant(&self, at: Timestamp) -> Instant {
        self.start + Duration::from_nanos(at.as_nanos().saturating_sub(self.ahead()))
    }

    fn ahead(&self) -> u64 {
        self.ahead.map_or(0, |ahead| ahead.load(Ordering::Relaxed))
    }
}

/// What the wall clock showed at `then`, as it reads now: a stepped clock shifts past and present alike.
pub fn wall_at(wall_now: SystemTime, now: Timestamp, then: Timestamp) -> SystemTime {
    let ago: Span = now.since(then);
    wall_now.checked_sub(Duration::from_nanos(ago.as_nanos())).unwrap_or(SystemTime::UNIX_EPOCH)
}
