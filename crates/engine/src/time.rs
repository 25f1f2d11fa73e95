//! Time in the core: instants on one monotonic clock, and durations.
//!
//! The core never reads a clock; its caller gives the time.

use std::fmt;
use std::num::NonZeroU64;
use std::ops::{Add, Sub};
use std::time::Duration;

use serde::{Deserialize, Serialize};

/// Nanoseconds on the monotonic clock of receipt, since a start that only the caller knows.
///
/// The stored number is larger by one, so that an optional instant needs no extra room: a module stores nine of
/// them.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(from = "u64", into = "u64")]
pub struct Timestamp(NonZeroU64);

/// In files: nanoseconds.
impl From<Timestamp> for u64 {
    fn from(at: Timestamp) -> u64 {
        at.as_nanos()
    }
}

impl From<u64> for Timestamp {
    fn from(nanos: u64) -> Timestamp {
        Timestamp::from_nanos(nanos)
    }
}

impl Timestamp {
    pub const ZERO: Timestamp = Timestamp(NonZeroU64::MIN);

    /// The last possible instant. Deadlines that never come have it.
    pub const MAX: Timestamp = Timestamp(NonZeroU64::MAX);

    /// A larger number becomes [`Timestamp::MAX`].
    pub const fn from_nanos(nanos: u64) -> Timestamp {
        Timestamp(NonZeroU64::MIN.saturating_add(nanos))
    }

    pub const fn from_millis(millis: u64) -> Timestamp {
        Timestamp::from_nanos(millis.saturating_mul(1_000_000))
    }

    pub const fn as_nanos(self) -> u64 {
        self.0.get() - 1
    }

    /// The time from `earlier` to `self`; zero if `earlier` is later.
    pub fn since(self, earlier: Timestamp) -> Span {
        Span(self.0.get().saturating_sub(earlier.0.get()))
    }
}

impl Default for Timestamp {
    fn default() -> Timestamp {
        Timestamp::ZERO
    }
}

impl fmt::Debug for Timestamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Timestamp").field(&self.as_nanos()).finish()
    }
}

impl Add<Span> for Timestamp {
    type Output = Timestamp;

    fn add(self, span: Span) -> Timestamp {
        Timestamp(self.0.saturating_add(span.0))
    }
}

/// A length of time in nanoseconds, as in files. Never negative; arithmetic saturates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
pub struct Span(u64);

impl Span {
    pub const ZERO: Span = Span(0);

    pub const fn from_nanos(nanos: u64) -> Span {
        Span(nanos)
    }

    pub const fn from_millis(millis: u64) -> Span {
        Span(millis.saturating_mul(1_000_000))
    }

    pub const fn from_secs(secs: u64) -> Span {
        Span(secs.saturating_mul(1_000_000_000))
    }

    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    pub const fn as_millis(self) -> u64 {
        self.0 / 1_000_000
    }

    pub const fn as_secs_f64(self) -> f64 {
        self.0 as f64 / 1e9
    }

    pub const fn is_zero(&self) -> bool {
        self.0 == 0
    }
}

impl From<Span> for Duration {
    fn from(span: Span) -> Duration {
        Duration::from_nanos(span.0)
    }
}

/// The start, at the earliest.
impl Sub<Span> for Timestamp {
    type Output = Timestamp;

    fn sub(self, span: Span) -> Timestamp {
        Timestamp::from_nanos(self.as_nanos().saturating_sub(span.0))
    }
}

impl Sub for Span {
    type Output = Span;

    fn sub(self, other: Span) -> Span {
        Span(self.0.saturating_sub(other.0))
    }
}

/// Since when something lasts: an instant of this run of the program, and how long it had lasted before that where
/// it comes from an earlier run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Since {
    pub at: Timestamp,
    pub before: Span,
}

impl Since {
    /// Something that has lasted for `age` at `now`.
    pub fn of_age(age: Span, now: Timestamp) -> Since {
        let at = now - age;
        Since { at, before: age - now.since(at) }
    }

    pub fn age(self, now: Timestamp) -> Span {
        Span(now.since(self.at).0.saturating_add(self.before.0))
    }
}

/// `3 s`, `2 min`, `1 h 5 min`: only as fine as people need.
pub fn how_long(span: Span) -> String {
    let s = span.as_millis().saturating_add(500) / 1000;
    match s {
        0..60 => format!("{s} s"),
        60..3600 => format!("{} min", s / 60),
        _ => format!("{} h {} min", s / 3600, s % 3600 / 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn instants_end_at_the_last_one_and_a_missing_one_takes_no_room() {
        let last = Timestamp::from_nanos(u64::MAX);
        assert_eq!((last, last + Span::from_secs(1)), (Timestamp::MAX, Timestamp::MAX));
        assert_eq!(Timestamp::from_nanos(7).since(Timestamp::ZERO), Span::from_nanos(7));
        assert_eq!(format!("{:?}", Timestamp::from_nanos(7)), "Timestamp(7)");
        assert_eq!(size_of::<Option<Timestamp>>(), size_of::<u64>());
    }

    #[test]
    fn a_duration_is_said_as_roughly_as_it_is_read() {
        let all = [(0, "0 s"), (1_500, "2 s"), (59_400, "59 s"), (59_500, "1 min"), (3_599_000, "59 min")];
        for (ms, said) in all.into_iter().chain([(3_900_000, "1 h 5 min"), (90_000_000, "25 h 0 min")]) {
            assert_eq!(how_long(Span::from_millis(ms)), said);
        }
    }
}
