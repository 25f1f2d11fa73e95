//! How often something came.

use telltale_engine::pace::RateLimits;
use telltale_engine::time::{Span, Timestamp};

/// Fewer messages have no rhythm.
const BEATS_MIN: u64 = 5;
/// A pause that takes less of a window reaches no limit.
const SPARED: f64 = 0.3;
/// No window is made longer than this for a pause: the end of the topic would be noticed late.
const WINDOW_S_MAX: u64 = 10;

#[derive(Debug, Clone, Default)]
pub struct Rhythm {
    pub count: u64,
    first: Option<Timestamp>,
    last: Option<Timestamp>,
    longest: Option<Span>,
    second: Option<Span>,
}

/// A rate, and the longest time without a message beside it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Steady {
    pub rate_hz: f64,
    pub longest_s: f64,
}

impl Rhythm {
    pub fn beat(&mut self, at: Timestamp) {
        let pause = self.last.map(|last| at.since(last));
        self.second = self.second.max(pause.min(self.longest));
        self.longest = self.longest.max(pause);
        self.first = self.first.or(Some(at));
        self.last = Some(at);
        self.count += 1;
    }

    /// Messages a second from the first to the last; `None` of fewer than two.
    pub fn rate_hz(&self) -> Option<f64> {
        let span_s = self.last?.since(self.first?).as_secs_f64();
        (self.count > 1 && span_s > 0.0).then(|| (self.count - 1) as f64 / span_s)
    }

    /// The longest time without a message, up to the end of the observation.
    pub fn longest_s(&self, end: Timestamp) -> f64 {
        let open = self.last.map(|last| end.since(last));
        self.longest.max(open).unwrap_or_default().as_secs_f64()
    }

    /// The longest time between two messages.
    pub fn longest_between_s(&self) -> Option<f64> {
        self.longest.map(Span::as_secs_f64)
    }

    /// Whether it stopped: at the end it was silent for much longer than ever before.
    pub fn has_ended(&self, end: Timestamp) -> bool {
        let Some((last, longest_s)) = self.last.zip(self.longest_between_s()) else { return false };
        end.since(last).as_secs_f64() > 3.0 * longest_s.max(0.5)
    }

    /// Whether its first message came behind the last one of the other.
    pub fn follows(&self, other: &Rhythm) -> bool {
        matches!((self.first, other.last), (Some(first), Some(last)) if first > last)
    }

    /// The rate, if it comes so evenly that a limit below it means something. One pause may be longer, as when its
    /// publisher was restarted: the rate is then that of the time before and behind it. That time is at least twice as
    /// long as the pause, because two bursts are no rhythm.
    pub fn steady(&self, end: Timestamp) -> Option<Steady> {
        let span_s = self.last?.since(self.first?).as_secs_f64();
        let (longest_s, open_s) = (self.longest?.as_secs_f64(), end.since(self.last?).as_secs_f64());
        let at = |rate_hz: f64, pause_s: f64| {
            let is_even = pause_s.max(open_s) <= spared_s(rate_hz).max(4.0 / rate_hz);
            is_even.then_some(Steady { rate_hz, longest_s: longest_s.max(open_s) })
        };
        let whole = || at(self.rate_hz().filter(|_| self.count >= BEATS_MIN)?, longest_s);
        let apart = || {
            let flows_s = span_s - longest_s;
            let is_most = self.count > BEATS_MIN && flows_s >= 2.0 * longest_s;
            at(is_most.then(|| (self.count - 2) as f64 / flows_s)?, self.second?.as_secs_f64())
        };
        whole().or_else(apart)
    }
}

impl Steady {
    /// The limits of a monitor. A window of up to ten seconds becomes so long that the longest pause reaches no limit.
    pub fn limits(&self) -> RateLimits {
        let limits = RateLimits::of(self.rate_hz);
        let window_s = (self.longest_s / SPARED).ceil() as u64;
        let window_s = if window_s <= WINDOW_S_MAX { window_s.max(limits.window_s) } else { limits.window_s };
        RateLimits { window_s, ..limits }
    }

    /// Whether the longest pause would reach a limit of these.
    pub fn reaches(&self, limits: RateLimits) -> bool {
        self.longest_s > SPARED * limits.window_s as f64
    }
}

/// The longest pause that reaches no limit of a rate.
fn spared_s(rate_hz: f64) -> f64 {
    SPARED * RateLimits::of(rate_hz).window_s as f64
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
            rhythm.steady(Timestamp::from_millis(1000)).map(|it| it.rate_hz.round())
        };
        assert_eq!(rhythm(&[0, 200, 400, 600, 800, 1000]), Some(5.0));
        assert_eq!(rhythm(&[0, 200, 400, 600]), None, "too few");
        assert_eq!(rhythm(&[0, 50, 100, 150, 200, 250]), None, "it has ended");
        assert_eq!(rhythm(&[0, 1, 2, 3, 4, 1000]), None, "bursts");
        let stalled: Vec<u64> = (0..20).chain([40]).chain(58..101).map(|beat| 10 * beat).collect();
        assert!(rhythm(&stalled).is_some(), "a short stall of the computer");
    }

    #[test]
    fn one_pause_leaves_the_rate_and_lengthens_the_window() {
        // Beats each 100 ms for ten seconds, but for these pauses.
        let limits = |pauses: &[(u64, u64)]| {
            let mut rhythm = Rhythm::default();
            let beats = (0..=100).map(|beat| 100 * beat);
            let heard = beats.filter(|at| !pauses.iter().any(|(from, to)| (from..to).contains(&at)));
            heard.for_each(|at| rhythm.beat(Timestamp::from_millis(at)));
            let steady = rhythm.steady(Timestamp::from_millis(10_000))?;
            let limits = steady.limits();
            let RateLimits { window_s, warning_below, error_below } = limits;
            assert_eq!((warning_below, error_below), (7.0, 4.0), "of 10 Hz");
            Some((window_s, steady.reaches(limits)))
        };
        assert_eq!(limits(&[]), Some((2, false)));
        assert_eq!(limits(&[(4050, 5950)]), Some((7, false)), "2 s");
        assert_eq!(limits(&[(4050, 7250)]), Some((2, true)), "3.3 s would need more than ten seconds");
        assert_eq!(limits(&[(3050, 7250)]), None, "too little beside it");
        assert_eq!(limits(&[(2050, 3950), (6050, 7950)]), None, "two pauses");
        assert_eq!(limits(&[(9050, 10_050)]), None, "it may have ended");
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
