//! The output rate of a component against its input rate.

use super::spec::Bands;
use super::window::Window;
use super::words::{Words, number, span};
use crate::engine::state::State;
use crate::engine::time::{Span, Timestamp};

#[derive(Debug, Clone)]
pub(in crate::engine) struct RateRatio {
    input: Window,
    output: Window,
    bands: Bands,
    /// Since when the module is relevant: nothing before is counted. Ahead of us while it is not
    /// known yet who publishes.
    since: Option<Timestamp>,
    /// By slot: it is known who publishes it.
    known: [bool; 2],
}

impl RateRatio {
    pub(super) const INPUT: usize = 0;
    pub(super) const OUTPUT: usize = 1;

    pub(super) fn new(window: Span, bands: Bands) -> RateRatio {
        let (input, output) = (Window::new(window), Window::new(window));
        RateRatio { input, output, bands, since: None, known: [false; 2] }
    }

    pub(super) fn set_relevant(&mut self, relevant: bool, now: Timestamp) {
        self.begin(relevant.then_some(now));
    }

    /// Lets the first window begin only at `until`, unless both publishers are found before.
    pub(super) fn search(&mut self, until: Timestamp) {
        self.since = self.since.map(|since| since.max(until));
    }

    /// Who publishes this one is known now. Returns whether that ends a search: what came of one of
    /// them before the other was found has nothing to be compared with.
    pub(super) fn found(&mut self, slot: usize, now: Timestamp) -> bool {
        self.known[slot] = true;
        let found = self.known == [true; 2] && self.since.is_some_and(|since| since > now);
        if found {
            self.begin(Some(now));
        }
        found
    }

    /// What is not counted came. Returns whether the first window begins anew.
    pub(super) fn late(&mut self, now: Timestamp) -> bool {
        let first = self.since.is_some_and(|since| since <= now && now < since + self.input.span());
        if first {
            self.begin(Some(now));
        }
        first
    }

    fn begin(&mut self, since: Option<Timestamp>) {
        self.input.clear();
        self.output.clear();
        self.since = since;
    }

    pub(super) fn take(&mut self, slot: usize, now: Timestamp) {
        if self.since.is_some() {
            let window = if slot == RateRatio::INPUT { &mut self.input } else { &mut self.output };
            window.push(0.0, now);
        }
    }

    pub(super) fn judge(&mut self, now: Timestamp) -> Option<State> {
        self.input.advance(now);
        self.output.advance(now);
        (now >= self.full_at()?).then(|| self.at(self.input.count(), self.output.count()))
    }

    /// When the state changes if nothing comes any more: messages leave both windows, in turn or at once.
    pub(super) fn due(&self, now: Timestamp) -> Option<Timestamp> {
        let full_at = self.full_at()?;
        if now < full_at {
            return Some(full_at);
        }
        let (mut input, mut output) = (self.input.count(), self.output.count());
        let state = self.at(input, output);
        let (mut inputs, mut outputs) = (self.input.leaving().peekable(), self.output.leaving().peekable());
        loop {
            let next = [inputs.peek(), outputs.peek()].into_iter().flatten().map(|&(at, _)| at).min()?;
            input -= inputs.next_if(|&(at, _)| at == next).map_or(0, |(_, count)| count);
            output -= outputs.next_if(|&(at, _)| at == next).map_or(0, |(_, count)| count);
            if self.at(input, output) != state {
                return Some(next);
            }
        }
    }

    pub(super) fn moves(&self) -> bool {
        !self.input.is_empty() || !self.output.is_empty()
    }

    pub(super) fn words(&self, now: Timestamp) -> Words {
        let Some(full_at) = self.full_at() else {
            return Words::plain("not measured while it does not matter".into());
        };
        if now < full_at {
            return Words::plain(format!("measuring for {}", span(self.input.span())));
        }
        let rates = [
            ("input_hz", number(self.input.rate(self.input.count()))),
            ("output_hz", number(self.output.rate(self.output.count()))),
        ];
        if self.input.is_empty() {
            let message = format!("no input for {}", span(self.input.span()));
            return Words { message, values: rates.into() };
        }
        let ratio = self.output.count() as f64 / self.input.count() as f64;
        let mut values = self.bands.values("ratio", ratio);
        values.extend(rates);
        Words { message: self.bands.say(ratio, "outputs per input"), values }
    }

    fn at(&self, input: u64, output: u64) -> State {
        if input == 0 { State::Unknown } else { self.bands.judge(output as f64 / input as f64) }
    }

    fn full_at(&self) -> Option<Timestamp> {
        Some(self.since? + self.input.span())
    }
}
