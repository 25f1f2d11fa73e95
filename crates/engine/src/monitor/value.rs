//! One field of a topic, or one KeyValue of a status.

use super::inputs::{InputFault, Inputs, UnusableInput, nothing_yet};
use super::words::{Words, numeral_in, quoted};
use super::{MonitorKind, end_search};
use crate::files::KeyframeError;
use crate::model::monitors::ValueRule;
use crate::model::quantity::{Quantity, number};
use crate::model::sample::FieldValue;
use crate::state::State;
use crate::text::Text;
use crate::text::say;
use crate::time::Timestamp;
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Value {
    inputs: Inputs,
    #[serde(skip)]
    rule: ValueRule,
    /// Its messages are events, and none at all is OK.
    #[serde(skip)]
    may_be_empty: bool,
    /// If it may be empty: the time since which its module is relevant. In the future while publishers are still being searched.
    #[serde(default)]
    since: Option<Timestamp>,
}

impl Value {
    pub(super) fn new(inputs: Inputs, rule: ValueRule, may_be_empty: bool) -> Value {
        Value { inputs, rule, may_be_empty, since: None }
    }
}

impl MonitorKind for Value {
    fn resume(&mut self, kept: Value) -> Result<(), KeyframeError> {
        let Value { inputs, rule: _, may_be_empty: _, since } = kept;
        self.since = since;
        self.inputs.resume(inputs)
    }

    /// The last event still counts.
    fn set_relevant(&mut self, relevant: bool, now: Timestamp) {
        self.since = (relevant && self.may_be_empty).then_some(now);
    }

    fn search(&mut self, until: Timestamp) {
        self.since = self.since.map(|since| since.max(until));
    }

    fn found(&mut self, _slot: usize, now: Timestamp) -> bool {
        end_search(&mut self.since, now)
    }

    /// What an action was asked for before its server was started again is over.
    fn returned(&mut self, slot: usize) {
        if self.may_be_empty {
            self.inputs.forget(slot);
        }
    }

    /// Whether texts are compared, so that "12" is a text too.
    fn wants_words(&self, _slot: usize) -> bool {
        let ValueRule::Unless { error, warning } = &self.rule else { return false };
        [error, warning].into_iter().any(|wanted| matches!(wanted, Some(FieldValue::Text(_))))
    }

    fn take_value(&mut self, slot: usize, value: &FieldValue, now: Timestamp) {
        self.inputs.take(slot, value, now);
    }

    fn judge(&mut self, now: Timestamp) -> Option<State> {
        if !self.inputs.any() {
            return self.since.filter(|&since| since <= now).map(|_| State::Ok);
        }
        Some(match (self.look(now), &self.rule) {
            (Ok((_, state)), _) => state,
            (Err(unusable), ValueRule::Bands(bands)) if unusable.fault == InputFault::NotANumber => {
                bands.unmeasurable()
            }
            (Err(_), _) => State::Unknown,
        })
    }

    fn due(&self, now: Timestamp) -> Option<Timestamp> {
        self.since.filter(|&since| since > now)
    }

    fn words(&self, now: Timestamp) -> Words {
        if !self.inputs.any() {
            let is_empty = self.may_be_empty.then(|| Words::plain(nothing_yet(self.inputs.label(0))));
            return is_empty.unwrap_or_default();
        }
        self.measured(now).unwrap_or_else(|unusable| Words::plain(self.inputs.say(unusable)))
    }
}

impl Value {
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
