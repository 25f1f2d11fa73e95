//! The messages of a sliding window, in memory that does not grow with the rate.

use crate::files::KeyframeError;
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

use crate::state::State;
use crate::time::{Span, Timestamp};

/// Up to this number of messages in a window, each has its own time of receipt; of more, those within this
/// fraction of the window leave together with the first of them.
const BUCKETS: u64 = 256;

/// Messages of a window that is read from a keyframe: no topic has more.
const WINDOW_MAX: u64 = 1 << 53;

/// The shortest window; a shorter one would divide by zero.
const SHORTEST: Span = Span::from_millis(1);

/// A sliding window: a message received at `t` is in it from `t` until just before `t + span`. A bucket opens
/// with a message and takes all messages within 1/256 of the span. So a slow topic is counted exactly, and a
/// flood too low by at most 0.4 %.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Window {
    #[serde(skip)]
    span: Span,
    buckets: VecDeque<Bucket>,
    #[serde(skip)]
    count: u64,
    /// Candidates for the smallest and the largest value, by the start of their buckets: no later value is
    /// below, or above; the first one is the extreme of the window.
    low: VecDeque<(Timestamp, f64)>,
    high: VecDeque<(Timestamp, f64)>,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Bucket {
    start: Timestamp,
    count: u64,
}

impl Window {
    pub(super) fn new(span: Span) -> Window {
        let (low, high) = (VecDeque::new(), VecDeque::new());
        Window { span: span.max(SHORTEST), buckets: VecDeque::new(), count: 0, low, high }
    }

    pub(super) fn span(&self) -> Span {
        self.span
    }

    /// Goes on with the state of a keyframe.
    pub(super) fn resume(&mut self, kept: Window) -> Result<(), KeyframeError> {
        let Window { span: _, buckets, count: _, low, high } = kept;
        let total = buckets.iter().try_fold(0, |sum: u64, bucket| sum.checked_add(bucket.count));
        let total = total.filter(|&total| total <= WINDOW_MAX);
        self.count = total.ok_or_else(|| KeyframeError::new("a window has too many messages"))?;
        (self.buckets, self.low, self.high) = (buckets, low, high);
        Ok(())
    }

    /// Forgets what came before this instant.
    pub(super) fn forget_before(&mut self, at: Timestamp) {
        self.buckets.retain(|bucket| bucket.start >= at);
        self.count = self.buckets.iter().map(|bucket| bucket.count).sum();
        self.low.retain(|(start, _)| *start >= at);
        self.high.retain(|(start, _)| *start >= at);
    }

    pub(super) fn clear(&mut self) {
        self.buckets.clear();
        self.count = 0;
        self.low.clear();
        self.high.clear();
    }

    /// Takes a message with a value; a monitor that only counts gives 0. One that came late counts after those before it.
    pub(super) fn push(&mut self, value: f64, at: Timestamp) {
        let now = self.buckets.back().map_or(at, |last| at.max(last.start));
        self.advance(now);
        let width = Span::from_nanos(self.span.as_nanos() / BUCKETS);
        let start = match self.buckets.back_mut() {
            Some(last) if now < last.start + width => {
                last.count += 1;
                last.start
            }
            Some(_) | None => {
                self.buckets.push_back(Bucket { start: now, count: 1 });
                now
            }
        };
        self.count += 1;
        while self.low.pop_back_if(|(_, low)| *low >= value).is_some() {}
        // Values of one bucket leave together, so one is enough.
        if self.low.back().is_none_or(|(last, _)| *last != start) {
            self.low.push_back((start, value));
        }
        while self.high.pop_back_if(|(_, high)| *high <= value).is_some() {}
        if self.high.back().is_none_or(|(last, _)| *last != start) {
            self.high.push_back((start, value));
        }
    }

    /// Removes messages that are too old at `now`.
    pub(super) fn advance(&mut self, now: Timestamp) {
        let span = self.span;
        let old = |start: Timestamp| start + span <= now;
        while let Some(first) = self.buckets.pop_front_if(|first| old(first.start)) {
            self.count -= first.count;
        }
        while self.low.pop_front_if(|(start, _)| old(*start)).is_some() {}
        while self.high.pop_front_if(|(start, _)| old(*start)).is_some() {}
    }

    pub(super) fn count(&self) -> u64 {
        self.count
    }

    pub(super) fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// The smallest and the largest value in the window.
    pub(super) fn extremes(&self) -> Option<(f64, f64)> {
        Some((self.low.front()?.1, self.high.front()?.1))
    }

    /// Messages per second, if the window holds `count`. A rate that equals a limit on paper is equal here: the
    /// division is rounded once.
    pub(super) fn rate(&self, count: u64) -> f64 {
        count as f64 * 1e9 / self.span.as_nanos() as f64
    }

    /// The time at which the last of the `count` oldest messages leaves; `None` if there are fewer.
    pub(super) fn left_by(&self, count: u64) -> Option<Timestamp> {
        let nth = if self.count == self.buckets.len() as u64 {
            self.buckets.get(count.checked_sub(1)? as usize)
        } else {
            let mut left = 0;
            self.buckets.iter().find(|bucket| {
                left += bucket.count;
                left >= count
            })
        };
        nth.map(|bucket| bucket.start + self.span)
    }

    /// The times at which messages leave, and their numbers, in order.
    pub(super) fn leaving(&self) -> impl Iterator<Item = (Timestamp, u64)> {
        self.buckets.iter().map(|bucket| (bucket.start + self.span, bucket.count))
    }
}

/// A module was blocked and is well: what came before that instant counts as long as it makes nothing worse, for
/// one window.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub(super) struct Recovery {
    pub(super) at: Timestamp,
    pub(super) state: State,
}

impl Recovery {
    /// Whether a window that is judged as `state` begins anew at the recovery.
    pub(super) fn ends_by(self, judged: Option<State>, span: Span, now: Timestamp) -> bool {
        judged > Some(self.state) && now < self.at + span
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A window of two seconds after messages at `hertz` for ten.
    fn after(hertz: u64) -> Window {
        let mut window = Window::new(Span::from_secs(2));
        for number in 0..10 * hertz {
            window.push(number as f64, Timestamp::from_nanos(number * 1_000_000_000 / hertz));
        }
        window
    }

    #[test]
    fn slow_topics_are_counted_exactly_and_floods_nearly_in_bounded_memory() {
        for hertz in [1, 2, 10, 100] {
            let window = after(hertz);
            assert_eq!(window.count(), 2 * hertz, "{hertz} Hz");
        }
        for hertz in [1_000, 20_000, 1_000_000] {
            let window = after(hertz);
            let wrong = 1.0 - window.rate(window.count()) / hertz as f64;
            assert!((0.0..=1.0 / 256.0).contains(&wrong), "{hertz} Hz: {wrong}");
            assert!(window.buckets.len() <= 257 && window.low.len() <= 257, "{}", window.buckets.len());
        }
    }

    #[test]
    fn a_message_leaves_at_its_instant() {
        let at = Timestamp::from_millis;
        let mut window = Window::new(Span::from_millis(100));
        for (millis, value) in [(0, 5.0), (10, -1.0), (20, 2.0)] {
            window.push(value, at(millis));
        }
        for (now, count, extremes) in [
            (99, 3, Some((-1.0, 5.0))),
            (100, 2, Some((-1.0, 2.0))),
            (110, 1, Some((2.0, 2.0))),
            (120, 0, None),
        ] {
            window.advance(at(now));
            assert_eq!((window.count(), window.extremes()), (count, extremes), "at {now} ms");
        }
    }
}
