//! The time on `/clock`, by which the nodes of a simulation or a replay stamp their messages.
//! Latencies of messages alone go by it: a simulation that pauses must not keep an old value fresh.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};

use super::cdr::{Endian, Fault, Reader};
use telltale_engine::model::sample::Sample;

pub const TOPIC: &str = "/clock";
pub const TYPE: &str = "rosgraph_msgs/msg/Clock";

/// A longer step is a pause or a jump, not the resolution of the clock.
const STEP_MAX_NS: i64 = 1_000_000_000;

/// The last time that was heard, in nanoseconds. It outlives participants.
#[derive(Debug, Clone)]
pub struct RosClock(Arc<Heard>);

#[derive(Debug)]
struct Heard {
    now: AtomicI64,
    /// The step from the message before to the last one.
    step: AtomicI64,
}

impl Default for RosClock {
    fn default() -> RosClock {
        let (now, step) = (AtomicI64::new(Sample::NO_CLOCK), AtomicI64::new(0));
        RosClock(Arc::new(Heard { now, step }))
    }
}

impl RosClock {
    /// A clock that goes on from here by itself.
    pub fn copy(&self) -> RosClock {
        let copy = |value: &AtomicI64| AtomicI64::new(value.load(Ordering::Relaxed));
        RosClock(Arc::new(Heard { now: copy(&self.0.now), step: copy(&self.0.step) }))
    }

    /// [`Sample::NO_CLOCK`] before the first message.
    pub fn now_ns(&self) -> i64 {
        self.0.now.load(Ordering::Relaxed)
    }

    /// The time at which a message with this stamp arrived. Nodes stamp by a finer clock than `/clock`,
    /// which may come ten times a second: until its next message, a stamp ahead of it by one step counts as
    /// now.
    pub fn at_stamp(&self, stamp_ns: Option<i64>) -> i64 {
        let (now, step) = (self.now_ns(), self.0.step.load(Ordering::Relaxed));
        let is_of_now =
            |stamp: &i64| now != Sample::NO_CLOCK && (now..=now.saturating_add(step)).contains(stamp);
        stamp_ns.filter(is_of_now).unwrap_or(now)
    }

    /// Takes the body of a `rosgraph_msgs/Clock`.
    pub fn take(&self, body: &[u8], endian: Endian) -> Result<(), Fault> {
        let mut reader = Reader::new(body, endian);
        // The seconds are signed, the nanoseconds are not.
        let (seconds, nanos) = (reader.u32()?.cast_signed(), reader.u32()?);
        let now = i64::from(seconds) * 1_000_000_000 + i64::from(nanos);
        let before = self.0.now.swap(now, Ordering::Relaxed);
        let step = if before == Sample::NO_CLOCK { 0 } else { now.saturating_sub(before) };
        self.0.step.store(if (0..=STEP_MAX_NS).contains(&step) { step } else { 0 }, Ordering::Relaxed);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stamp_between_two_messages_of_the_clock_is_of_now() {
        let clock = RosClock::default();
        assert_eq!(clock.at_stamp(Some(5)), Sample::NO_CLOCK);
        let message = |nanos: u32| [&2_u32.to_le_bytes()[..], &nanos.to_le_bytes()[..]].concat();
        for nanos in [0, 100_000_000] {
            clock.take(&message(nanos), Endian::Little).unwrap();
        }
        let now = 2_100_000_000;
        assert_eq!(clock.at_stamp(Some(now + 80_000_000)), now + 80_000_000);
        for other in [None, Some(now - 30_000_000), Some(now + 120_000_000)] {
            assert_eq!(clock.at_stamp(other), now, "{other:?}");
        }
        clock.take(&[0; 8], Endian::Little).unwrap();
        assert_eq!(clock.at_stamp(Some(80_000_000)), 0, "it began anew, and its step is not known");
    }

    #[test]
    fn the_last_time_counts() {
        let clock = RosClock::default();
        assert_eq!(clock.now_ns(), Sample::NO_CLOCK);
        clock.take(&[2, 0, 0, 0, 5, 0, 0, 0], Endian::Little).unwrap();
        assert_eq!(clock.now_ns(), 2_000_000_005);
        assert!(clock.take(&[1, 2], Endian::Little).is_err());
        clock.take(&[0; 8], Endian::Little).unwrap();
        assert_eq!(clock.now_ns(), 0, "a simulation may begin anew");
    }
}
