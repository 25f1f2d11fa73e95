//! Conditions over the latest fields of several topics.

use super::MonitorKind;
use super::inputs::{Inputs, UnusableInput};
use super::words::{Words, cut, numeral_in};
use crate::files::KeyframeError;
use crate::model::monitors::{Condition, ScalarKind};
use crate::model::quantity::number;
use crate::model::sample::{Elements, FieldValue};
use crate::state::State;
use crate::text::Text;
use crate::text::say;
use crate::time::Timestamp;
use serde::{Deserialize, Serialize};

/// Elements of a list that a message names.
const SAID_MAX: usize = 8;

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Expression {
    inputs: Inputs,
    #[serde(skip)]
    names: Box<[Box<str>]>,
    #[serde(skip)]
    warning: Option<Condition>,
    #[serde(skip)]
    error: Option<Condition>,
    /// The answer for the present values; `None` after one of them changed.
    #[serde(skip)]
    answer: Option<Answer>,
}

#[derive(Debug, Clone)]
enum Answer {
    State(State),
    /// The condition has no answer for these values.
    Failed(Box<str>),
}

impl Expression {
    pub(super) fn new(
        inputs: Inputs,
        names: impl Iterator<Item = Box<str>>,
        warning: Option<Condition>,
        error: Option<Condition>,
    ) -> Expression {
        Expression { inputs, names: names.collect(), warning, error, answer: None }
    }

    /// The time of the oldest present value; `None` while one is missing.
    pub(crate) fn oldest(&self) -> Option<Timestamp> {
        let received: Option<Vec<Timestamp>> =
            (0..self.inputs.len()).map(|slot| self.inputs.received(slot)).collect();
        received?.into_iter().min()
    }
}

impl MonitorKind for Expression {
    /// Goes on with the state of a keyframe. The answer follows from the inputs.
    fn resume(&mut self, kept: Expression) -> Result<(), KeyframeError> {
        let Expression { inputs, names: _, warning: _, error: _, answer: _ } = kept;
        self.answer = None;
        self.inputs.resume(inputs)
    }

    /// Whether it assumes a text as this input.
    fn wants_words(&self, slot: usize) -> bool {
        let mut conditions = [&self.error, &self.warning].into_iter().flatten();
        conditions.any(|condition| condition.takes(slot) == Some(ScalarKind::Text))
    }

    fn take_value(&mut self, slot: usize, value: &FieldValue, now: Timestamp) {
        if self.inputs.take(slot, value, now) {
            self.answer = None;
        }
    }
    fn told(&self, slot: usize) -> Option<Timestamp> {
        self.inputs.told(slot)
    }

    fn judge(&mut self, now: Timestamp) -> Option<State> {
        if !self.inputs.any() {
            return None;
        }
        if self.unusable(now).is_some() {
            return Some(State::Unknown);
        }
        if self.answer.is_none() {
            self.answer = Some(self.evaluate());
        }
        Some(match &self.answer {
            Some(Answer::State(state)) => *state,
            Some(Answer::Failed(_)) | None => State::Unknown,
        })
    }

    fn due(&self, now: Timestamp) -> Option<Timestamp> {
        self.inputs.due(now)
    }

    fn is_aged(&self, now: Timestamp) -> bool {
        self.inputs.any() && self.unusable(now).is_some_and(UnusableInput::is_age)
    }

    fn words(&self, now: Timestamp) -> Words {
        if !self.inputs.any() {
            return Words::default();
        }
        if let Some(unusable) = self.unusable(now) {
            return Words::plain(self.inputs.say(unusable));
        }
        let values = (0..self.inputs.len()).filter_map(|slot| {
            let text = match self.inputs.last(slot)? {
                FieldValue::Number(value) => numeral_in(*value, self.inputs.quantity(slot)),
                FieldValue::Bool(true) => say!("true", "wahr"),
                FieldValue::Bool(false) => say!("false", "falsch"),
                FieldValue::Text(text) => format!("\"{}\"", cut(text)).into(),
                FieldValue::Elements(list) => elements(list),
                FieldValue::Pose(_)
                | FieldValue::Positions(_)
                | FieldValue::Transforms(_)
                | FieldValue::Content(_)
                | FieldValue::Absent
                | FieldValue::Unreadable(_) => return None,
            };
            Some(say!("{name} = {text}", "{name} = {text}", name = &*self.names[slot], text))
        });
        let joined = |all: Text, next: Text| say!("{all}, {next}", "{all}; {next}", all, next);
        let values = values.reduce(joined).unwrap_or_else(|| "".into());
        let holds = |condition: &Option<Condition>, values: Text| {
            let condition = condition.as_ref().map_or("", |condition| cut(&condition.text));
            say!("{condition} holds: {values}", "{condition} trifft zu: {values}", condition, values)
        };
        let message = match &self.answer {
            Some(Answer::State(State::Error)) => holds(&self.error, values),
            Some(Answer::State(State::Warning)) => holds(&self.warning, values),
            Some(Answer::Failed(why)) => say!(
                "no answer for {values}: {why}",
                "keine Antwort für {values}: {why}",
                values,
                why = cut(why)
            ),
            Some(Answer::State(State::Ok | State::Unknown | State::Ignore)) | None => values,
        };
        Words::plain(message)
    }
}

/// The first values of a list.
fn elements(list: &Elements) -> Text {
    let word = |value: &FieldValue| match value {
        FieldValue::Number(value) => number(*value),
        FieldValue::Bool(is) => is.to_string(),
        FieldValue::Text(text) => format!("\"{}\"", cut(text)),
        _ => String::new(),
    };
    let words: Vec<String> = list.taken.iter().take(SAID_MAX).map(word).collect();
    let more = if list.count as usize > SAID_MAX { ", …" } else { "" };
    format!("[{}{more}]", words.join(", ")).into()
}

impl Expression {
    fn unusable(&self, now: Timestamp) -> Option<UnusableInput> {
        (0..self.inputs.len()).find_map(|slot| self.inputs.value(slot, now).err())
    }

    fn evaluate(&self) -> Answer {
        let values: Vec<FieldValue> =
            (0..self.inputs.len()).filter_map(|slot| self.inputs.last(slot).cloned()).collect();
        let holds = |condition: &Option<Condition>| {
            condition.as_ref().map_or(Ok(false), |condition| condition.holds(&values))
        };
        let error = holds(&self.error);
        if matches!(error, Ok(true)) {
            return Answer::State(State::Error);
        }
        match error.and_then(|_| holds(&self.warning)) {
            Ok(true) => Answer::State(State::Warning),
            Ok(false) => Answer::State(State::Ok),
            Err(why) => Answer::Failed(why),
        }
    }
}
