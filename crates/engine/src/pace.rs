//! How often and how evenly the messages of a topic come, measured over its last seconds, and the limits that are
//! proposed for a measured rate.

use super::time::{Span, Timestamp};
use std::collections::VecDeque;

/// Looks that are kept; there is one a second.
const LOOKS_MAX: usize = 60;
/// Looks that remain when older ones are dropped.
const LOOKS_ENOUGH: usize = 5;
/// Messages in the looks that remain.
const MESSAGES_ENOUGH: u32 = 10;
/// A shorter silence is no end.
const SILENCE_MIN: Span = Span::from_millis(1500);

/// The pace of the messages of a topic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pace {
    pub rate_hz: f32,
    /// The standard deviation of the time from one message to the next; `None` of fewer than three messages.
    pub jitter_ms: Option<f32>,
}

/// The messages between two looks.
#[derive(Debug, Clone, Copy, Default)]
struct Look {
    seconds: f64,
    messages: u32,
    /// Times from one message to the next: their number, their sum, the sum of their squares and the longest, in seconds.
    gaps: u32,
    sum: f64,
    squares: f64,
    longest: f64,
}

/// The messages of one topic over its last looks: at least five, and as many more, up to sixty, as hold ten messages.
#[derive(Debug, Clone)]
pub struct Arrivals {
    past: VecDeque<Look>,
    present: Look,
    looked: Timestamp,
    last: Option<Timestamp>,
}

impl Arrivals {
    pub fn since(now: Timestamp) -> Arrivals {
        Arrivals { past: VecDeque::new(), present: Look::default(), looked: now, last: None }
    }

    /// A message came.
    pub fn take(&mut self, now: Timestamp) {
        self.present.messages = self.present.messages.saturating_add(1);
        let gap = self.last.replace(now).map(|last| now.since(last).as_secs_f64());
        // A longer one began before all looks that are kept.
        let Some(gap) = gap.filter(|gap| *gap <= LOOKS_MAX as f64) else { return };
        self.present.gaps += 1;
        self.present.sum += gap;
        self.present.squares += gap * gap;
        self.present.longest = self.present.longest.max(gap);
    }

    /// The pace up to now. Is asked for once a second.
    pub fn look(&mut self, now: Timestamp) -> Pace {
        self.present.seconds = now.since(self.looked).as_secs_f64();
        self.looked = now;
        self.past.push_back(std::mem::take(&mut self.present));
        let messages =
            |past: &VecDeque<Look>| past.iter().fold(0, |sum, look| look.messages.saturating_add(sum));
        while let Some(oldest) = self.past.front()
            && (self.past.len() > LOOKS_MAX
                || self.past.len() > LOOKS_ENOUGH
                    && messages(&self.past) - oldest.messages >= MESSAGES_ENOUGH)
        {
            self.past.pop_front();
        }
        let sum = |of: fn(&Look) -> f64| self.past.iter().map(of).sum::<f64>();
        let (time, gaps) = (sum(|look| look.seconds), sum(|look| f64::from(look.gaps)));
        let longest = self.past.iter().fold(0.0, |longest, look| look.longest.max(longest));
        // It ended: it is silent for much longer than ever before.
        let silent = self.last.map_or(Span::ZERO, |last| now.since(last));
        let is_over = silent > SILENCE_MIN && gaps > 0.0 && silent.as_secs_f64() > 3.0 * longest;
        let rate = if time > 0.0 && !is_over { f64::from(messages(&self.past)) / time } else { 0.0 };
        let jitter = (gaps >= 2.0).then(|| {
            let mean = sum(|look| look.sum) / gaps;
            (sum(|look| look.squares) / gaps - mean * mean).max(0.0).sqrt()
        });
        Pace { rate_hz: rate as f32, jitter_ms: jitter.map(|it| (it * 1e3) as f32) }
    }
}

/// Limits of a rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RateLimits {
    pub window_s: u64,
    pub warning_below: f64,
    pub error_below: f64,
}

impl RateLimits {
    /// A window holds at least ten messages; a WARNING is for 70 % of them, an ERROR for 40 %.
    pub fn of(rate_hz: f64) -> RateLimits {
        let window_s = (10.0 / rate_hz).ceil().clamp(2.0, 60.0) as u64;
        let (warning_below, error_below) = (floor(rate_hz * 0.7), floor(rate_hz * 0.4));
        RateLimits { window_s, warning_below, error_below }
    }
}

/// Rounded down to two digits.
fn floor(value: f64) -> f64 {
    let scale = 10f64.powf(value.log10().floor() - 1.0);
    let digits = (value / scale + 1e-9).floor();
    if scale >= 1.0 { digits * scale } else { digits / (1.0 / scale).round() }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Messages at these milliseconds, looked at every second until the end.
    fn pace(end_s: u64, beats_ms: impl IntoIterator<Item = u64>) -> (f32, Option<f32>) {
        let mut arrivals = Arrivals::since(Timestamp::ZERO);
        let mut beats = beats_ms.into_iter().peekable();
        let mut pace = None;
        for second in 1..=end_s {
            while let Some(at) = beats.next_if(|at| *at < second * 1000) {
                arrivals.take(Timestamp::from_millis(at));
            }
            pace = Some(arrivals.look(Timestamp::from_millis(second * 1000)));
            assert!(arrivals.past.len() <= LOOKS_MAX);
        }
        let Pace { rate_hz, jitter_ms } = pace.expect("it was looked at");
        ((rate_hz * 100.0).round() / 100.0, jitter_ms.map(|it| (it * 10.0).round() / 10.0))
    }

    #[test]
    fn a_steady_topic_has_its_rate_and_no_jitter_however_slow_it_is() {
        assert_eq!(pace(9, (0..90).map(|beat| beat * 100)), (10.0, Some(0.0)));
        assert_eq!(pace(9, 0..9000), (1000.0, Some(0.0)));
        // Ten seconds apart: a look alone would say 0 or 1 Hz.
        assert_eq!(pace(130, (0..13).map(|beat| beat * 10_000)), (0.1, Some(0.0)));
        assert_eq!(pace(135, (0..14).map(|beat| beat * 10_000)), (0.1, Some(0.0)));
    }

    #[test]
    fn jitter_is_the_standard_deviation_of_the_times_between_messages() {
        // 80 and 120 ms in turn.
        let uneven = (0..90).map(|beat| beat * 100 + 20 * (beat % 2));
        assert_eq!(pace(9, uneven), (10.0, Some(20.0)));
        // One pause of 600 ms among 44 times of 100 ms.
        let paused = (0..90).map(|beat| beat * 100).filter(|at| !(6100..6600).contains(at));
        assert_eq!(pace(9, paused).1, Some(73.7));
        assert_eq!(pace(9, [100, 200]), (0.0, None), "two messages have one time between them");
    }

    #[test]
    fn what_ended_has_no_rate_and_what_begins_again_has_its_own_soon() {
        let beats = (0..100).map(|beat| beat * 100);
        assert_eq!(pace(11, beats.clone()).0, 8.0, "a second is no end");
        assert_eq!(pace(12, beats.clone()).0, 0.0);
        assert_eq!(pace(300, beats.clone()), (0.0, None));
        let again = beats.chain((0..100).map(|beat| 200_000 + beat * 100));
        assert_eq!(pace(206, again), (10.0, Some(0.0)), "the pause counts no longer");
        assert_eq!(pace(3, []), (0.0, None));
    }

    #[test]
    fn limits_lie_below_what_was_measured_and_have_two_digits() {
        for (rate, window_s, warning_below, error_below) in [
            (10.0, 2, 7.0, 4.0),
            (19.97, 2, 13.0, 7.9),
            (0.5, 20, 0.35, 0.2),
            (1234.0, 2, 860.0, 490.0),
            (1.01, 10, 0.7, 0.4),
        ] {
            assert_eq!(RateLimits::of(rate), RateLimits { window_s, warning_below, error_below }, "{rate}");
        }
    }
}
