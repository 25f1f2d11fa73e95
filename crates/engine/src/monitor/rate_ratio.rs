//! The output rate of a component against its input rate.

use super::MonitorKind;
use super::window::{Recovery, Window};
use super::words::{Words, measuring, not_measured, span};
use crate::files::KeyframeError;
use crate::model::monitors::Bands;
use crate::model::quantity::number;
use crate::model::sample::Sample;
use crate::state::State;
use crate::text::{Text, say};
use crate::time::{Span, Timestamp};
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct RateRatio {
    input: Window,
    output: Window,
    #[serde(skip)]
    bands: Bands,
    /// The time since which the module is relevant; earlier messages are not counted. In the future while
    /// publishers are still being searched.
    since: Option<Timestamp>,
    /// By slot: whether a publisher is known.
    known: [bool; 2],
    recovery: Option<Recovery>,
}

impl RateRatio {
    pub(super) fn new(window: Span, bands: Bands) -> RateRatio {
        let (input, output) = (Window::new(window), Window::new(window));
        RateRatio { input, output, bands, since: None, known: [false; 2], recovery: None }
    }
}

impl MonitorKind for RateRatio {
    fn resume(&mut self, kept: RateRatio) -> Result<(), KeyframeError> {
        let RateRatio { input, output, bands: _, since, known, recovery } = kept;
        (self.since, self.known, self.recovery) = (since, known, recovery);
        self.input.resume(input)?;
        self.output.resume(output)
    }

    fn set_relevant(&mut self, relevant: bool, now: Timestamp) {
        self.begin(relevant.then_some(now));
    }

    fn begin_anew(&mut self, now: Timestamp) -> bool {
        self.set_relevant(true, now);
        true
    }

    /// Starts the first window at `until`, unless both publishers are found earlier.
    fn search(&mut self, until: Timestamp) {
        self.since = self.since.map(|since| since.max(until));
    }

    /// The publisher of this slot was found. Returns whether that ends a search: earlier messages of the other
    /// slot have no counterpart.
    fn found(&mut self, slot: usize, now: Timestamp) -> bool {
        self.known[slot] = true;
        let found = self.known == [true; 2] && self.since.is_some_and(|since| since > now);
        if found {
            self.begin(Some(now));
        }
        found
    }

    /// A late message came, which is not counted. Returns whether the first window starts again.
    fn late(&mut self, now: Timestamp) -> bool {
        let first = self.since.is_some_and(|since| since <= now && now < since + self.input.span());
        if first {
            self.begin(Some(now));
        }
        first
    }

    fn recover(&mut self, now: Timestamp) {
        self.recovery = self.judge(now).map(|state| Recovery { at: now, state });
    }

    fn take_message(&mut self, slot: usize, _sample: &Sample, now: Timestamp) {
        self.count(slot, now);
    }

    fn judge(&mut self, now: Timestamp) -> Option<State> {
        self.input.advance(now);
        self.output.advance(now);
        let judged = self.judged(now);
        let span = self.input.span();
        if let Some(recovery) = self.recovery.take_if(|it| it.ends_by(judged, span, now)) {
            self.input.forget_before(recovery.at);
            self.output.forget_before(recovery.at);
            self.since = self.since.max(Some(recovery.at));
            return self.judged(now);
        }
        judged
    }

    /// Before this time the state does not change without an input: until enough messages have left either
    /// window for the ratio to reach a limit, or no input is left.
    fn due(&self, now: Timestamp) -> Option<Timestamp> {
        let full_at = self.full_at()?;
        if now < full_at {
            return Some(full_at);
        }
        let (input, output) = (self.input.count(), self.output.count());
        if input == 0 {
            return None;
        }
        let Bands { warning_below, error_below, warning_above, error_above, unmeasurable: _ } = self.bands;
        let (mut inputs, mut outputs) = (input, u64::MAX);
        for limit in [warning_below, error_below, warning_above, error_above].into_iter().flatten() {
            // Leaving outputs lower the ratio towards the limit, leaving inputs raise it.
            outputs = outputs.min(leaving(output as f64 - limit * input as f64));
            inputs = inputs.min(leaving(input as f64 - output as f64 / limit));
        }
        [self.input.left_by(inputs), self.output.left_by(outputs)].into_iter().flatten().min()
    }

    fn moves(&self, _now: Timestamp) -> bool {
        !self.input.is_empty() || !self.output.is_empty()
    }

    fn words(&self, now: Timestamp) -> Words {
        let Some(full_at) = self.full_at() else { return not_measured() };
        if now < full_at {
            return measuring(self.input.span());
        }
        let rates = [
            ("input_hz", number(self.input.rate(self.input.count()))),
            ("output_hz", number(self.output.rate(self.output.count()))),
        ];
        if self.input.is_empty() {
            let message =
                say!("no input for {time}", "keine Eingabe seit {time}", time = span(self.input.span()));
            return Words { message, values: rates.into() };
        }
        let ratio = self.output.count() as f64 / self.input.count() as f64;
        let mut values = self.bands.values("ratio", ratio);
        values.extend(rates);
        let is_one = (ratio - 1.0).abs() < 0.0005;
        let one = say!("output per input", "Ausgabe je Eingabe");
        let words = if is_one { one } else { say!("outputs per input", "Ausgaben je Eingabe") };
        Words { message: self.bands.say_of(ratio, Text::default(), words), values }
    }
}

impl RateRatio {
    fn begin(&mut self, since: Option<Timestamp>) {
        self.input.clear();
        self.output.clear();
        self.since = since;
        self.recovery = None;
    }

    /// A message of the input, which has slot 0, or of the output.
    fn count(&mut self, slot: usize, now: Timestamp) {
        if self.since.is_some() {
            let window = if slot == 0 { &mut self.input } else { &mut self.output };
            window.push(0.0, now);
        }
    }

    fn judged(&self, now: Timestamp) -> Option<State> {
        (now >= self.full_at()?).then(|| self.at(self.input.count(), self.output.count()))
    }

    fn at(&self, input: u64, output: u64) -> State {
        if input == 0 { State::Unknown } else { self.bands.judge(output as f64 / input as f64) }
    }

    fn full_at(&self) -> Option<Timestamp> {
        Some(self.since? + self.input.span())
    }
}

/// A lower bound of the messages that leave before the ratio reaches a limit; `MAX` if the limit is on the
/// other side.
fn leaving(between: f64) -> u64 {
    // Less than one message beyond the limit may be a rounding error.
    if between > -1.0 { (between as u64).max(1) } else { u64::MAX }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn no_change_comes_before_it_is_due(
            limits in prop::array::uniform4(prop::option::of(0_u8..12)),
            messages in prop::collection::vec((0_u64..40, prop::bool::ANY), 0..120),
        ) {
            let [warning_below, error_below, warning_above, error_above] = limits.map(|it| it.map(|it| f64::from(it) / 4.0));
            let bands = Bands { warning_below, error_below, warning_above, error_above, unmeasurable: None };
            let mut ratio = RateRatio::new(Span::from_millis(1000), bands);
            ratio.set_relevant(true, Timestamp::ZERO);
            let mut millis = 0;
            for (gap, is_input) in messages {
                millis += gap;
                ratio.count(usize::from(!is_input), Timestamp::from_millis(millis));
            }
            let mut now = Timestamp::from_millis(millis.max(1000));
            let mut state = ratio.judge(now);
            let mut due = ratio.due(now);
            for _ in 0..2100 {
                now = now + Span::from_millis(1);
                let next = ratio.judge(now);
                let is_due = due.is_some_and(|due| due <= now);
                prop_assert!(next == state || is_due, "{state:?} became {next:?} at {now:?}, due {due:?}");
                if is_due {
                    due = ratio.due(now);
                }
                state = next;
            }
        }
    }
}
