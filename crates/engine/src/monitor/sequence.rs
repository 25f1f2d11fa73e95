//! A value at a later stage of processing against the same value at an earlier stage.
//!
//! A later value is compared when it comes. A new earlier one has no answer yet: comparing it with the old later value
//! would report every step of a set point.

use super::MonitorKind;
use super::inputs::{InputFault, Inputs, UnusableInput, nothing_yet};
use super::words::{Words, span};
use crate::files::KeyframeError;
use crate::model::monitors::Bands;
use crate::model::quantity::number;
use crate::model::sample::FieldValue;
use crate::state::State;
use crate::text::Text;
use crate::text::say;
use crate::time::{Span, Timestamp};
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Sequence {
    inputs: Inputs,
    #[serde(skip)]
    max_gap: Span,
    #[serde(skip)]
    bands: Bands,
    /// The last `later` with the `earlier` that it was compared with; `earlier` alone answers nothing.
    pair: Option<Pair>,
}

#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
struct Pair {
    earlier: Result<f64, UnusableInput>,
    later: Result<f64, UnusableInput>,
    gap: Span,
}

impl Sequence {
    pub(super) const EARLIER: usize = 0;
    pub(super) const LATER: usize = 1;

    pub(super) fn new(inputs: Inputs, max_gap: Span, bands: Bands) -> Sequence {
        Sequence { inputs, max_gap, bands, pair: None }
    }
}

impl MonitorKind for Sequence {
    fn resume(&mut self, kept: Sequence) -> Result<(), KeyframeError> {
        let Sequence { inputs, max_gap: _, bands: _, pair } = kept;
        let faults = pair.iter().flat_map(|pair| [pair.earlier.err(), pair.later.err()]).flatten();
        if !faults.into_iter().all(|fault| fault.is_of(&self.inputs)) {
            return Err(KeyframeError::new("a pair of values names an input that does not exist"));
        }
        self.pair = pair;
        self.inputs.resume(inputs)
    }

    fn take_value(&mut self, slot: usize, value: &FieldValue, now: Timestamp) {
        self.inputs.take(slot, value, now);
        if slot == Sequence::LATER {
            let gap = self.inputs.received(Sequence::EARLIER).map_or(Span::ZERO, |at| now.since(at));
            let earlier = self.inputs.number(Sequence::EARLIER, now);
            self.pair = Some(Pair { earlier, later: self.inputs.number(Sequence::LATER, now), gap });
        }
    }
    fn told(&self, slot: usize) -> Option<Timestamp> {
        self.inputs.told(slot)
    }

    fn judge(&mut self, _now: Timestamp) -> Option<State> {
        self.inputs.any().then(|| match self.difference() {
            Ok((_, state)) => state,
            Err(NotComparable::Input(unusable)) if unusable.fault == InputFault::NotANumber => {
                self.bands.unmeasurable()
            }
            Err(_) => State::Unknown,
        })
    }

    fn words(&self, _now: Timestamp) -> Words {
        if !self.inputs.any() {
            return Words::default();
        }
        match self.difference() {
            Err(why) => Words::plain(why.say(&self.inputs, self.max_gap)),
            Ok((difference, _)) => {
                let mut values = self.bands.values("difference", difference);
                for (name, slot) in [("earlier", Sequence::EARLIER), ("later", Sequence::LATER)] {
                    if let Some(FieldValue::Number(value)) = self.inputs.last(slot) {
                        values.push((name, number(*value)));
                    }
                }
                let message = say!(
                    "later minus earlier: {what}",
                    "später minus früher: {what}",
                    what = self.bands.say_in(difference, self.inputs.common_quantity())
                );
                Words { message, values }
            }
        }
    }
}

impl Sequence {
    fn difference(&self) -> Result<(f64, State), NotComparable> {
        let Some(pair) = self.pair else { return Err(NotComparable::Missing(Sequence::LATER)) };
        let ahead = self.inputs.received(Sequence::EARLIER).zip(self.inputs.received(Sequence::LATER));
        if ahead.is_some_and(|(earlier, later)| earlier.since(later) > self.max_gap) {
            return Err(NotComparable::Gap(Sequence::LATER));
        }
        let (earlier, later) =
            (pair.earlier.map_err(NotComparable::Input)?, pair.later.map_err(NotComparable::Input)?);
        if pair.gap > self.max_gap {
            return Err(NotComparable::Gap(Sequence::EARLIER));
        }
        let difference = later - earlier;
        Ok((difference, self.bands.judge_within(difference, slack(earlier, later))))
    }
}

/// The largest rounding error of the difference of two numbers.
pub(super) fn slack(a: f64, b: f64) -> f64 {
    2.0 * f64::EPSILON * a.abs().max(b.abs())
}

enum NotComparable {
    Input(UnusableInput),
    Missing(usize),
    /// This input is too far behind the other.
    Gap(usize),
}

impl NotComparable {
    fn say(self, inputs: &Inputs, max_gap: Span) -> Text {
        match self {
            NotComparable::Input(unusable) => inputs.say(unusable),
            NotComparable::Missing(slot) => nothing_yet(inputs.label(slot)),
            NotComparable::Gap(slot) => say!(
                "{label} is more than {time} behind the other",
                "{label} kommt mehr als {time} nach dem anderen",
                label = inputs.label(slot),
                time = span(max_gap)
            ),
        }
    }
}
