//! Finds steps of the wall clock by comparing it with the monotonic clock.

use std::time::{Duration, SystemTime};

use telltale_engine::time::{Span, Timestamp};

/// A smaller difference comes from slewing or the scheduler; readers that such a step stops recover by
/// themselves.
const STEP_BACK_MIN: Duration = Duration::from_millis(100);

/// Notices a wall clock that was stepped back. The DDS library orders the samples of best-effort readers by
/// wall time, and would wait until the clock reaches the time before the step again.
#[derive(Debug)]
pub struct StepWatch {
    wall: SystemTime,
    now: Timestamp,
}

impl StepWatch {
    pub fn new(wall: SystemTime, now: Timestamp) -> StepWatch {
        StepWatch { wall, now }
    }

    /// How far the wall clock was stepped back since the last look; `None` if it was not.
    pub fn look(&mut self, wall: SystemTime, now: Timestamp) -> Option<Duration> {
        let elapsed: Span = now.since(self.now);
        let expected = self.wall + Duration::from(elapsed);
        (self.wall, self.now) = (wall, now);
        expected.duration_since(wall).ok().filter(|&back| back > STEP_BACK_MIN)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_step_back_counts() {
        let start = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000);
        let wall = |millis: i64| {
            let millis = u64::try_from(1_000_000 + millis).unwrap();
            start - Duration::from_secs(1000) + Duration::from_millis(millis)
        };
        let mut watch = StepWatch::new(wall(0), Timestamp::ZERO);
        // Monotonic and wall milliseconds, and the step that is seen.
        let looks = [
            (250, 250, None),
            (500, 450, None),
            (750, 800_000, None),
            (1000, 799_000, Some(1250)),
            (1250, 799_250, None),
        ];
        for (now, at, expected) in looks {
            let seen = watch.look(wall(at), Timestamp::from_millis(now));
            assert_eq!(seen, expected.map(Duration::from_millis), "at {now} ms");
        }
    }
}
