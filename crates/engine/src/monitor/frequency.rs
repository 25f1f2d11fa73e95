//! The rate of messages, also judged by the clock: no message is 0 Hz.

use super::window::{Recovery, Window};
use super::words::{Words, measuring, not_measured};
use super::{MonitorKind, end_search};
use crate::files::KeyframeError;
use crate::model::monitors::Bands;
use crate::model::sample::Sample;
use crate::state::State;
use crate::time::{Span, Timestamp};
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Frequency {
    window: Window,
    #[serde(skip)]
    bands: Bands,
    /// The time since which the module is relevant; earlier messages are not counted. In the future while
    /// publishers are still being searched.
    since: Option<Timestamp>,
    recovery: Option<Recovery>,
}

impl Frequency {
    pub(super) fn new(window: Span, bands: Bands) -> Frequency {
        Frequency { window: Window::new(window), bands, since: None, recovery: None }
    }
}

impl MonitorKind for Frequency {
    fn resume(&mut self, kept: Frequency) -> Result<(), KeyframeError> {
        let Frequency { window, bands: _, since, recovery } = kept;
        (self.since, self.recovery) = (since, recovery);
        self.window.resume(window)
    }

    fn set_relevant(&mut self, relevant: bool, now: Timestamp) {
        self.window.clear();
        self.since = relevant.then_some(now);
        self.recovery = None;
    }

    fn recover(&mut self, now: Timestamp) {
        self.recovery = self.judge(now).map(|state| Recovery { at: now, state });
    }

    fn begin_anew(&mut self, now: Timestamp) -> bool {
        self.set_relevant(true, now);
        true
    }

    /// Starts the first window at `until`, unless a publisher is found earlier.
    fn search(&mut self, until: Timestamp) {
        self.since = self.since.map(|since| since.max(until));
    }

    /// A publisher was found. Returns whether that ends a search.
    fn found(&mut self, _slot: usize, now: Timestamp) -> bool {
        end_search(&mut self.since, now)
    }

    /// A late message came, which is not counted. Returns whether the first window starts again.
    fn late(&mut self, now: Timestamp) -> bool {
        let first = self.since.is_some_and(|since| since <= now && now < since + self.window.span());
        if first {
            self.since = Some(now);
        }
        first
    }

    fn take_message(&mut self, _slot: usize, _sample: &Sample, now: Timestamp) {
        if self.since.is_some() {
            self.window.push(0.0, now);
        }
    }

    /// Before the first full window only too high rates can be judged: they can no longer get better.
    fn judge(&mut self, now: Timestamp) -> Option<State> {
        self.window.advance(now);
        let judged = self.judged(now);
        let span = self.window.span();
        if let Some(recovery) = self.recovery.take_if(|it| it.ends_by(judged, span, now)) {
            self.window.forget_before(recovery.at);
            self.since = self.since.max(Some(recovery.at));
            return self.judged(now);
        }
        judged
    }

    fn due(&self, now: Timestamp) -> Option<Timestamp> {
        let full_at = self.full_at()?;
        if now < full_at {
            return Some(full_at);
        }
        let mut left = self.window.count();
        let state = self.at(left);
        let mut leaving = self.window.leaving();
        leaving
            .find(|(_, count)| {
                left -= count;
                self.at(left) != state
            })
            .map(|(at, _)| at)
    }

    /// The rate falls without any message.
    fn moves(&self, _now: Timestamp) -> bool {
        !self.window.is_empty()
    }

    fn words(&self, now: Timestamp) -> Words {
        let Some(full_at) = self.full_at() else { return not_measured() };
        let rate = self.window.rate(self.window.count());
        if now < full_at && self.too_many() == State::Ok {
            return measuring(self.window.span());
        }
        Words { message: self.bands.say(rate, "Hz".into()), values: self.bands.values("rate_hz", rate) }
    }
}

impl Frequency {
    fn judged(&self, now: Timestamp) -> Option<State> {
        if now >= self.full_at()? {
            Some(self.at(self.window.count()))
        } else {
            Some(self.too_many()).filter(|&state| state != State::Ok)
        }
    }

    fn at(&self, count: u64) -> State {
        self.bands.judge(self.window.rate(count))
    }

    fn too_many(&self) -> State {
        let above = Bands { warning_below: None, error_below: None, ..self.bands };
        above.judge(self.window.rate(self.window.count()))
    }

    fn full_at(&self) -> Option<Timestamp> {
        Some(self.since? + self.window.span())
    }
}
