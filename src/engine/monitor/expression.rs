//! Conditions over the latest fields of several topics.

use super::inputs::{Doubt, Inputs};
use super::spec::Condition;
use super::words::{Words, cut, number};
use crate::engine::sample::FieldValue;
use crate::engine::state::State;
use crate::engine::time::Timestamp;

#[derive(Debug, Clone)]
pub(in crate::engine) struct Expression {
    inputs: Inputs,
    names: Box<[Box<str>]>,
    warning: Option<Condition>,
    error: Option<Condition>,
    /// The answer for the values as they are; `None` where one of them changed since.
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

    pub(super) fn take(&mut self, slot: usize, value: &FieldValue, now: Timestamp) {
        if self.inputs.take(slot, value, now) {
            self.answer = None;
        }
    }

    pub(super) fn judge(&mut self, now: Timestamp) -> Option<State> {
        if !self.inputs.any() {
            return None;
        }
        if self.doubt(now).is_some() {
            return Some(State::Unknown);
        }
        if self.answer.is_none() {
            self.answer = Some(self.evaluate());
        }
        Some(match &self.answer {
            Some(Answer::State(state)) => *state,
            _ => State::Unknown,
        })
    }

    pub(super) fn due(&self, now: Timestamp) -> Option<Timestamp> {
        self.inputs.due(now)
    }

    pub(super) fn words(&self, now: Timestamp) -> Words {
        if !self.inputs.any() {
            return Words::default();
        }
        if let Some(doubt) = self.doubt(now) {
            return Words::plain(self.inputs.say(doubt));
        }
        let values = (0..self.inputs.len()).filter_map(|slot| {
            let text = match self.inputs.last(slot)? {
                FieldValue::Number(value) => number(*value),
                FieldValue::Bool(is) => is.to_string(),
                FieldValue::Text(text) => format!("\"{}\"", cut(text)),
                _ => return None,
            };
            Some(format!("{} = {text}", self.names[slot]))
        });
        let values = values.collect::<Vec<_>>().join(", ");
        let met = |condition: &Option<Condition>| {
            condition.as_ref().map_or(String::new(), |condition| cut(&condition.text).to_owned())
        };
        let message = match &self.answer {
            Some(Answer::State(State::Error)) => format!("{} holds: {values}", met(&self.error)),
            Some(Answer::State(State::Warning)) => format!("{} holds: {values}", met(&self.warning)),
            Some(Answer::Failed(why)) => format!("no answer for {values}: {}", cut(why)),
            _ => values,
        };
        Words::plain(message)
    }

    fn doubt(&self, now: Timestamp) -> Option<Doubt> {
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
