//! The only place that reads a clock.

pub mod latency;
pub mod rate;

use std::sync::atomic::{AtomicI64, AtomicU64, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use telltale_engine::time::{Span, Timestamp};

/// The first of May 2026; this version is newer. A constant, so that two builds of the same source are equal.
const EARLIEST_UNIX_S: u64 = 1_777_593_600;

/// A wall clock that shows less than this is wrong.
pub fn earliest() -> SystemTime {
    UNIX_EPOCH + Duration::from_secs(EARLIEST_UNIX_S)
}

/// The monotonic time at which the process starts, so that a message from before has a time and keeps its age.
const AT_START: Duration = Duration::from_secs(24 * 3600);

/// The monotonic clock of receipt, counted from a day before the start of the process, and the wall clock for
/// times that people read. Copies agree.
#[derive(Debug, Clone, Copy)]
pub struct Clock {
    start: Instant,
    /// The offset by which it was set ahead, in nanoseconds; only a test's clock has one.
    ahead: Option<&'static Ahead>,
    /// It moves only when it is set ahead.
    stands: bool,
}

/// The step that a test gave its clock, in nanoseconds.
#[derive(Debug, Default)]
struct Ahead {
    both: AtomicU64,
    wall: AtomicI64,
}

/// Sets a clock ahead, so that a test need not wait.
#[derive(Debug, Clone, Copy)]
pub struct ClockHand(&'static Ahead);

impl ClockHand {
    /// Time passes.
    pub fn advance(&self, span: Span) {
        self.0.both.fetch_add(span.as_nanos(), Ordering::Relaxed);
    }

    /// Somebody sets the wall clock by so many seconds.
    pub fn step_wall(&self, seconds: i64) {
        self.0.wall.fetch_add(seconds * 1_000_000_000, Ordering::Relaxed);
    }
}

impl Clock {
    pub fn start() -> Clock {
        Clock::since(AT_START)
    }

    #[expect(clippy::disallowed_methods, reason = "the one clock of the process")]
    fn since(before: Duration) -> Clock {
        Clock { start: Instant::now() - before, ahead: None, stands: false }
    }

    /// A clock that can be set ahead, for tests. Its offset lives as long as the process.
    pub fn with_hand() -> (Clock, ClockHand) {
        let ahead: &'static Ahead = Box::leak(Box::default());
        (Clock { ahead: Some(ahead), ..Clock::since(Duration::ZERO) }, ClockHand(ahead))
    }

    /// A clock that moves only when it is set ahead.
    pub fn standing() -> (Clock, ClockHand) {
        let (clock, hand) = Clock::with_hand();
        (Clock { stands: true, ..clock }, hand)
    }

    /// Monotonic: it is never stepped and never runs backwards.
    pub fn now(&self) -> Timestamp {
        let elapsed = if self.stands { Duration::ZERO } else { self.start.elapsed() };
        let elapsed = u64::try_from(elapsed.as_nanos()).unwrap_or(u64::MAX);
        Timestamp::from_nanos(elapsed.saturating_add(self.ahead()))
    }

    /// The present wall time. It may be stepped at any time: for display only.
    #[expect(clippy::disallowed_methods, reason = "the one clock of the process")]
    pub fn wall(&self) -> SystemTime {
        let wall = SystemTime::now() + Duration::from_nanos(self.ahead());
        let stepped = self.ahead.map_or(0, |ahead| ahead.wall.load(Ordering::Relaxed));
        let by = Duration::from_nanos(stepped.unsigned_abs());
        if stepped < 0 { wall - by } else { wall + by }
    }

    /// The monotonic instant as a tokio instant.
    pub fn instant(&self, at: Timestamp) -> Instant {
        self.start + Duration::from_nanos(at.as_nanos().saturating_sub(self.ahead()))
    }

    /// The result of a future, unless it comes after `until`.
    pub async fn by<T>(&self, until: Timestamp, future: impl Future<Output = T>) -> Option<T> {
        tokio::time::timeout_at(self.instant(until).into(), future).await.ok()
    }

    fn ahead(&self) -> u64 {
        self.ahead.map_or(0, |ahead| ahead.both.load(Ordering::Relaxed))
    }
}

/// Nanoseconds since 1970; zero before.
pub fn unix_ns(wall: SystemTime) -> u64 {
    u64::try_from(wall.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default().as_nanos())
        .unwrap_or(u64::MAX)
}

/// Milliseconds since 1970; zero before.
pub fn unix_ms(wall: SystemTime) -> i64 {
    let since = wall.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_millis()).unwrap_or(i64::MAX)
}

/// A wall time that has a text: a clock that is set out of the years 1970 to 9999 shows their first or last instant.
pub fn with_a_text(wall: SystemTime) -> SystemTime {
    const YEAR_9999_END: Duration = Duration::from_millis(253_402_300_799_999);
    UNIX_EPOCH + wall.duration_since(UNIX_EPOCH).unwrap_or_default().min(YEAR_9999_END)
}

/// The wall time of so many milliseconds since 1970, within [`with_a_text`].
pub fn of_unix_ms(ms: i64) -> SystemTime {
    let since = Duration::from_millis(u64::try_from(ms).unwrap_or(0));
    with_a_text(UNIX_EPOCH.checked_add(since).unwrap_or(UNIX_EPOCH))
}

/// The wall time at `then`, seen from now: a step of the clock shifts past, present and future alike.
pub fn wall_at(wall_now: SystemTime, now: Timestamp, then: Timestamp) -> SystemTime {
    let at = wall_now.checked_sub(now.since(then).into()).unwrap_or(SystemTime::UNIX_EPOCH);
    at.checked_add(then.since(now).into()).unwrap_or(at)
}
