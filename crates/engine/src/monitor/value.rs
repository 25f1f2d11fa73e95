//! One field of a topic, or one KeyValue of a status.

use super::feeds::{Keeping, TOGETHER};
use super::inputs::{InputFault, Inputs, UnusableInput, nothing_yet};
use super::words::{Words, numeral_in, quoted};
use super::{MonitorKind, end_search};
use crate::files::KeyframeError;
use crate::model::monitors::ValueRule;
use crate::model::quantity::{Quantity, number};
use crate::model::sample::{FieldValue, Sample};
use crate::state::State;
use crate::text::Text;
use crate::text::say;
use crate::time::{Span, Timestamp};
use serde::{Deserialize, Serialize};

/// A reader is there for all messages a second after the discovery of a writer; lost ones are sent again.
const TOLD: Span = Span::from_secs(10);

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Value {
    inputs: Inputs,
    #[serde(skip)]
    rule: ValueRule,
    /// Its messages are events, and before the first one this is its state.
    #[serde(skip)]
    empty: Option<State>,
    /// Of events: the time since which its module is relevant. In the future while publishers are still being searched.
    #[serde(default)]
    since: Option<Timestamp>,
    /// Of events: their publishers.
    #[serde(default)]
    publishers: Publishers,
    /// When the topic told a fault before a restart, if it told nothing later: a fault ends by another message alone.
    #[serde(default)]
    failed: Option<Timestamp>,
}

#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Publishers {
    /// Or not known yet.
    #[default]
    Nobody,
    /// One of them sends a lost message no second time: an event may be missed.
    BestEffort,
    /// One of them keeps no message for late readers: an event may have passed.
    Volatile,
    /// Since this instant they would tell the last event, if there was any.
    TransientLocal(Timestamp),
}

impl Value {
    pub(super) fn new(inputs: Inputs, rule: ValueRule, empty: Option<State>) -> Value {
        Value { inputs, rule, empty, since: None, publishers: Publishers::Nobody, failed: None }
    }

    /// Its module was in a fault before a restart, since this instant. An action's server tells of its last goal if it has
    /// one.
    pub(super) fn note_failed(&mut self, since: Timestamp) {
        if self.empty != Some(State::Ok) {
            self.failed = self.failed.max(Some(since));
        }
    }
}

impl MonitorKind for Value {
    fn resume(&mut self, kept: Value) -> Result<(), KeyframeError> {
        let Value { inputs, rule: _, empty: _, since, publishers, failed } = kept;
        (self.since, self.publishers, self.failed) = (since, publishers, failed);
        self.inputs.resume(inputs)
    }

    /// The last event still counts.
    fn set_relevant(&mut self, relevant: bool, now: Timestamp) {
        self.since = (relevant && self.empty.is_some()).then_some(now);
    }

    fn search(&mut self, until: Timestamp) {
        self.since = self.since.map(|since| since.max(until));
        if let Publishers::TransientLocal(since) = &mut self.publishers {
            *since = until.max(*since);
        }
    }

    /// Of events it judges itself.
    fn told(&self, slot: usize) -> Option<Timestamp> {
        self.inputs.told(slot).filter(|_| self.empty.is_none())
    }

    fn found(&mut self, _slot: usize, now: Timestamp) -> bool {
        end_search(&mut self.since, now)
    }

    /// A publisher that was started again may not have said that a switch was let go: a fault ends by its word alone. An
    /// action's server that was started again has no goal.
    fn returned(&mut self, slot: usize, now: Timestamp) {
        let fails = || matches!(self.last(now), Some(State::Warning | State::Error));
        if self.empty == Some(State::Ok) || self.empty.is_some() && !fails() {
            self.inputs.forget(slot);
            self.publishers = Publishers::Nobody;
        }
    }

    fn publishers(&mut self, _slot: usize, keeping: Option<Keeping>, now: Timestamp) {
        self.publishers = match (keeping, self.publishers) {
            (None, _) => Publishers::Nobody,
            (Some(Keeping::BestEffort), _) => Publishers::BestEffort,
            (Some(Keeping::Volatile), _) => Publishers::Volatile,
            (Some(Keeping::TransientLocal), known @ Publishers::TransientLocal(_)) => known,
            (Some(Keeping::TransientLocal), _) => Publishers::TransientLocal(now),
        };
    }

    /// Whether texts are compared, so that "12" is a text too.
    fn wants_words(&self, _slot: usize) -> bool {
        let ValueRule::Unless { error, warning } = &self.rule else { return false };
        [error, warning].into_iter().any(|wanted| matches!(wanted, Some(FieldValue::Text(_))))
    }

    fn take_value(&mut self, slot: usize, value: &FieldValue, now: Timestamp) {
        self.failed = None;
        self.inputs.take(slot, value, now);
    }

    /// An event that was told before the one that counts ends no fault: one publisher's word may come first, and an older
    /// one of another publisher, which was lost or kept for late readers, after it.
    fn take_field(&mut self, slot: usize, value: &FieldValue, _sample: &Sample, at: Timestamp) {
        let last = self.failed.max(self.inputs.received(slot));
        let is_older = self.empty.is_some() && last.is_some_and(|last| at + TOGETHER < last);
        let before = is_older.then(|| self.clone());
        self.take_value(slot, value, at);
        if let Some(before) = before
            && self.last(at) < Some(before.last(at).unwrap_or(State::Unknown))
        {
            *self = before;
        }
    }

    fn judge(&mut self, now: Timestamp) -> Option<State> {
        if !self.inputs.any() {
            return self.empty_from().filter(|&from| from <= now).map(|_| State::Ok);
        }
        self.last(now).map(|state| if self.may_miss() { state.max(State::Unknown) } else { state })
    }

    fn due(&self, now: Timestamp) -> Option<Timestamp> {
        self.empty_from().filter(|&from| from > now && !self.inputs.any())
    }

    fn words(&self, now: Timestamp) -> Words {
        if self.may_miss() && self.last(now) != Some(State::Error) {
            return Words::plain(say!(
                "a publisher of {topic} is best effort: a change may be lost",
                "ein Sender von {topic} sendet „best effort“: eine Änderung kann verloren gehen",
                topic = self.inputs.label(0)
            ));
        }
        if !self.inputs.any() {
            return match self.publishers {
                _ if self.empty.is_none() => Words::default(),
                Publishers::Volatile => Words::plain(say!(
                    "nothing came yet of {topic}, and its publisher keeps nothing for late readers (volatile)",
                    "noch nichts empfangen von {topic}, und der Sender bewahrt für später Kommende nichts auf (volatile)",
                    topic = self.inputs.label(0)
                )),
                _ => Words::plain(nothing_yet(self.inputs.label(0))),
            };
        }
        self.measured(now).unwrap_or_else(|unusable| Words::plain(self.inputs.say(unusable)))
    }
}

impl Value {
    /// The state by the last value, if there is one.
    fn last(&self, now: Timestamp) -> Option<State> {
        if !self.inputs.any() {
            return None;
        }
        Some(match (self.look(now), &self.rule) {
            (Ok((_, state)), _) => state,
            (Err(unusable), ValueRule::Bands(bands)) if unusable.fault == InputFault::NotANumber => {
                bands.unmeasurable()
            }
            (Err(_), _) => State::Unknown,
        })
    }

    /// Whether an event may be lost.
    fn may_miss(&self) -> bool {
        self.empty.is_some() && matches!(self.publishers, Publishers::BestEffort)
    }

    /// From when it is known that there was no event. That there is no publisher is judged beside it.
    fn empty_from(&self) -> Option<Timestamp> {
        match self.publishers {
            _ if self.failed.is_some() => None,
            Publishers::Nobody => self.since,
            Publishers::TransientLocal(since) if self.empty == Some(State::Ok) => {
                Some(self.since?.max(since + TOLD))
            }
            Publishers::TransientLocal(_) | Publishers::Volatile | Publishers::BestEffort => None,
        }
    }

    fn measured(&self, now: Timestamp) -> Result<Words, UnusableInput> {
        Ok(match &self.rule {
            ValueRule::Bands(bands) => {
                let value = self.inputs.number(0, now)?;
                Words {
                    message: bands.say_in(value, self.inputs.quantity(0)),
                    values: bands.values("value", value),
                }
            }
            ValueRule::Unless { error, warning } => {
                let (value, state) = self.look(now)?;
                let quantity = self.inputs.quantity(0);
                let missed = if state == State::Error { error } else { warning };
                let message = match missed.as_ref().filter(|_| state != State::Ok) {
                    Some(wanted) => say!(
                        "{value}, {wanted} wanted",
                        "{value}, erwartet {wanted}",
                        value = words_of(value, quantity),
                        wanted = words_of(wanted, quantity)
                    ),
                    None => words_of(value, quantity),
                };
                Words { message, values: vec![("value", bare(value))] }
            }
        })
    }

    fn look(&self, now: Timestamp) -> Result<(&FieldValue, State), UnusableInput> {
        let value = self.inputs.value(0, now)?;
        let state = match &self.rule {
            ValueRule::Bands(bands) => bands.judge(self.inputs.number(0, now)?),
            ValueRule::Unless { error: Some(wanted), .. } if value != wanted => State::Error,
            ValueRule::Unless { warning: Some(wanted), .. } if value != wanted => State::Warning,
            ValueRule::Unless { .. } => State::Ok,
        };
        Ok((value, state))
    }
}

fn words_of(value: &FieldValue, quantity: Option<&Quantity>) -> Text {
    match value {
        FieldValue::Text(text) => quoted(text).into(),
        FieldValue::Number(value) => numeral_in(*value, quantity),
        FieldValue::Bool(true) => say!("true", "wahr"),
        FieldValue::Bool(false) => say!("false", "falsch"),
        FieldValue::Pose(_) => say!("a pose", "eine Pose"),
        FieldValue::Positions(_) => say!("a list", "eine Liste"),
        FieldValue::Transforms(_)
        | FieldValue::Elements(_)
        | FieldValue::Content(_)
        | FieldValue::Absent
        | FieldValue::Unreadable(_) => {
            say!("unreadable", "nicht lesbar")
        }
    }
}

fn bare(value: &FieldValue) -> String {
    match value {
        FieldValue::Number(value) => number(*value),
        FieldValue::Bool(is) => is.to_string(),
        FieldValue::Text(text) => super::words::cut(text).to_owned(),
        FieldValue::Pose(_) => "a pose".into(),
        FieldValue::Positions(_) => "a list".into(),
        FieldValue::Transforms(_)
        | FieldValue::Elements(_)
        | FieldValue::Content(_)
        | FieldValue::Absent
        | FieldValue::Unreadable(_) => "unreadable".into(),
    }
}
