//! How often something came.

use telltale_engine::pace::RateLimits;
use telltale_engine::time::{Span, Timestamp};

/// Fewer messages have no rhythm.
const BEATS_MIN: u64 = 5;

#[derive(Debug, Clone, Default)]
pub struct Rhythm {
    pub count: u64,
    first: Option<Timestamp>,
    last: Option<Timestamp>,
    longest: Option<Span>,
}

impl Rhythm {
    pub fn beat(&mut self, at: Timestamp) {
        let pause = self.last.map(|last| at.since(last));
        self.longest = self.longest.max(pause);
        self.first = self.first.or(Some(at));
        self.last = Some(at);
        self.count += 1;
    }

    /// Messages a second from the first to the last; `None` of fewer than two.
    pub fn rate_hz(&self) -> Option<f64> {
        let span_s = self.last?.since(self.first?).as_nanos() as f64 / 1e9;
        (self.count > 1 && span_s > 0.0).then(|| (self.count - 1) as f64 / span_s)
    }

    /// The longest time without a message, up to the end of the observation.
    pub fn longest_s(&self, end: Timestamp) -> f64 {
        let open = self.last.map(|last| end.since(last));
        self.longest.max(open).unwrap_or_default().as_nanos() as f64 / 1e9
    }

    /// The longest time between two messages.
    pub fn longest_between_s(&self) -> Option<f64> {
        Some(self.longest?.as_nanos() as f64 / 1e9)
    }

    /// Whether it stopped: at the end it was silent for much longer than ever before.
    pub fn has_ended(&self, end: Timestamp) -> bool {
        let Some((last, longest_s)) = self.last.zip(self.longest_between_s()) else { return false };
        end.since(last).as_nanos() as f64 / 1e9 > 3.0 * longest_s.max(0.5)
    }

    /// Whether its first message came behind the last one of the other.
    pub fn follows(&self, other: &Rhythm) -> bool {
        matches!((self.first, other.last), (Some(first), Some(last)) if first > last)
    }

    /// The rate, if it comes so evenly that a limit below it means something.
    pub fn steady_hz(&self, end: Timestamp) -> Option<f64> {
        let rate = self.rate_hz().filter(|_| self.count >= BEATS_MIN)?;
        // A pause that takes less than 30 % of a window reaches no limit.
        let spared_s = 0.3 * RateLimits::of(rate).window_s as f64;
        (self.longest_s(end) <= spared_s.max(4.0 / rate)).then_some(rate)
    }
}

/// Durations as people write them.
const STEPS_MS: [u64; 15] =
    [100, 200, 300, 500, 1000, 2000, 3000, 5000, 10_000, 15_000, 20_000, 30_000, 60_000, 120_000, 300_000];

/// The next such duration from these seconds on.
pub fn at_least_ms(seconds: f64) -> u64 {
    let step = STEPS_MS.into_iter().find(|&step| step as f64 >= seconds * 1000.0 - 1e-6);
    step.unwrap_or(600_000)
}

/// As the configuration has it.
pub fn duration(ms: u64) -> String {
    if ms.is_multiple_of(1000) { format!("{}s", ms / 1000) } else { format!("{ms}ms") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_comes_evenly_has_a_rate() {
        let rhythm = |beats_ms: &[u64]| {
            let mut rhythm = Rhythm::default();
            beats_ms.iter().for_each(|&at| rhythm.beat(Timestamp::from_millis(at)));
            rhythm.steady_hz(Timestamp::from_millis(1000)).map(f64::round)
        };
        assert_eq!(rhythm(&[0, 200, 400, 600, 800, 1000]), Some(5.0));
        assert_eq!(rhythm(&[0, 200, 400, 600]), None, "too few");
        assert_eq!(rhythm(&[0, 50, 100, 150, 200, 250]), None, "it has ended");
        assert_eq!(rhythm(&[0, 1, 2, 3, 4, 1000]), None, "bursts");
        let stalled: Vec<u64> = (0..20).chain([40]).chain(58..101).map(|beat| 10 * beat).collect();
        assert!(rhythm(&stalled).is_some(), "a short stall of the computer");
    }

    #[test]
    fn what_is_silent_for_much_longer_than_before_has_ended() {
        let rhythm = |beats_ms: &[u64]| {
            let mut rhythm = Rhythm::default();
            beats_ms.iter().for_each(|&at| rhythm.beat(Timestamp::from_millis(at)));
            rhythm
        };
        let ended = |beats_ms: &[u64]| rhythm(beats_ms).has_ended(Timestamp::from_millis(10_000));
        assert!(ended(&[0, 1000, 2000]));
        assert!(!ended(&[0, 1000, 8000]), "it pauses that long");
        assert!(!ended(&[0, 8500, 9000]));
        assert!(!ended(&[0]), "it may come every minute");
        assert!(
            rhythm(&[3000]).follows(&rhythm(&[0, 2000])) && !rhythm(&[1000]).follows(&rhythm(&[0, 2000]))
        );
    }

    #[test]
    fn durations_are_round() {
        let cases = [(0.0, "100ms"), (0.11, "200ms"), (1.0, "1s"), (3.01, "5s"), (400.0, "600s")];
        for (seconds, text) in cases {
            assert_eq!(duration(at_least_ms(seconds)), text);
        }
    }
}
