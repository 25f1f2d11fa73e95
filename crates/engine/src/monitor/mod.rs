//! Monitors: modules that diagnose from the outside (paper, Sec. III-D). Each kind is a small state machine: it
//! takes inputs with their times, judges them, and tells when time alone will change its judgement.

mod agreement;
mod count;
mod expression;
pub(super) mod feeds;
mod frequency;
mod frozen;
mod inputs;
mod latency;
mod meaning;
mod motion;
mod nearest;
mod rate_ratio;
mod sequence;
#[cfg(test)]
mod tests;
mod value;
mod watchdog;
mod window;
mod words;

use super::model::monitors::{MonitorSpec, TopicId, ValueSource, Watched};
use crate::files::KeyframeError;
use crate::text::say;
use agreement::Agreement;
use count::Count;
use expression::Expression;
use frequency::Frequency;
use frozen::Frozen;
use inputs::Inputs;
pub(super) use inputs::NO_SUCH_KEY;
use latency::Latency;
use rate_ratio::RateRatio;
use sequence::Sequence;
use serde::{Deserialize, Serialize};
use value::Value;
use watchdog::Watchdog;
pub(super) use words::{Words, cut};

use super::model::sample::{FieldValue, ProbeOutcome, Sample};
use super::state::State;
use super::text::Text;
use super::time::{Span, Timestamp};

/// An input of a monitor.
#[derive(Debug, Clone, Copy)]
pub(super) enum Taken<'a> {
    /// A message, whatever its content.
    Message(&'a Sample),
    Value(&'a FieldValue),
    Probe(&'a ProbeOutcome),
}

/// A source of a monitor. Its index in [`feeds`] is the slot of its inputs.
#[derive(Debug, Clone, Copy)]
pub(super) enum Feed<'a> {
    Messages(TopicId),
    Values(&'a ValueSource),
}

/// The sources of a monitor, by slot. A watchdog has none.
pub(super) fn feeds(spec: &MonitorSpec) -> Vec<Feed<'_>> {
    match spec {
        MonitorSpec::External { .. }
        | MonitorSpec::Watchdog { .. }
        | MonitorSpec::System { .. }
        | MonitorSpec::Constant { .. }
        | MonitorSpec::Count { .. } => Vec::new(),
        MonitorSpec::Frequency { topic, .. } | MonitorSpec::Latency { topic, .. } => {
            vec![Feed::Messages(*topic)]
        }
        MonitorSpec::RateRatio { input, output, .. } => {
            let mut feeds = vec![Feed::Messages(*input); 2];
            feeds[RateRatio::OUTPUT] = Feed::Messages(*output);
            feeds
        }
        MonitorSpec::Value { source, .. } | MonitorSpec::Frozen { source, .. } => {
            vec![Feed::Values(source)]
        }
        MonitorSpec::Sequence { earlier, later, .. } => vec![Feed::Values(earlier), Feed::Values(later)],
        MonitorSpec::Agreement { a, b, .. } => vec![Feed::Values(a), Feed::Values(b)],
        MonitorSpec::Expression { inputs, .. } => {
            inputs.iter().map(|(_, source)| Feed::Values(source)).collect()
        }
    }
}

/// One monitor over time. It holds no ids, so it survives a change of the configuration.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum Monitor {
    Frequency(Frequency),
    Latency(Latency),
    Value(Value),
    Frozen(Frozen),
    Watchdog(Watchdog),
    RateRatio(RateRatio),
    Sequence(Sequence),
    Agreement(Box<Agreement>),
    Constant(State),
    Count(Count),
    Expression(Box<Expression>),
}

impl Monitor {
    /// `None` for a monitor that judges the level of a status.
    pub(super) fn new(spec: &MonitorSpec, watched: &Watched) -> Option<Monitor> {
        let one = |source, max_age| Inputs::new([("".into(), source)].into_iter(), watched, max_age);
        Some(match spec {
            MonitorSpec::External { .. } => return None,
            MonitorSpec::Constant { state } => Monitor::Constant(*state),
            MonitorSpec::Count { wanted, may_be_empty, grace } => {
                Monitor::Count(Count::new(*wanted, *may_be_empty, *grace))
            }
            MonitorSpec::Frequency { window, bands, .. } => {
                Monitor::Frequency(Frequency::new(*window, *bands))
            }
            MonitorSpec::Latency { window, bands, .. } => Monitor::Latency(Latency::new(*window, *bands)),
            MonitorSpec::Value { source, rule } => {
                Monitor::Value(Value::new(one(source, None), rule.clone()))
            }
            MonitorSpec::Frozen { source, limits } => {
                Monitor::Frozen(Frozen::new(one(source, None), *limits))
            }
            MonitorSpec::Watchdog { watchdog, misses, bands } => {
                let spec = &watched.watchdogs[watchdog.0 as usize];
                Monitor::Watchdog(Watchdog::new(spec, *misses, *bands))
            }
            MonitorSpec::System { watchdog, bands } => {
                let spec = &watched.watchdogs[watchdog.0 as usize];
                Monitor::Watchdog(Watchdog::new(spec, 1, *bands))
            }
            MonitorSpec::RateRatio { window, bands, .. } => {
                Monitor::RateRatio(RateRatio::new(*window, *bands))
            }
            MonitorSpec::Sequence { earlier, later, max_gap, bands } => {
                let roles = [(say!("earlier", "früher"), earlier), (say!("later", "später"), later)];
                let inputs = Inputs::new(roles.into_iter(), watched, None);
                Monitor::Sequence(Sequence::new(inputs, *max_gap, *bands))
            }
            MonitorSpec::Agreement { a, b, max_age, motion_over, rule } => {
                let inputs =
                    Inputs::new([("a".into(), a), ("b".into(), b)].into_iter(), watched, Some(*max_age));
                Monitor::Agreement(Box::new(Agreement::new(inputs, *max_age, *motion_over, rule.clone())))
            }
            MonitorSpec::Expression { inputs: sources, max_age, warning, error, .. } => {
                let roles = sources.iter().map(|(name, source)| (Text::plain(name), source));
                let inputs = Inputs::new(roles, watched, Some(*max_age));
                let names = sources.iter().map(|(name, _)| name.clone());
                let expression = Expression::new(inputs, names, warning.clone(), error.clone());
                Monitor::Expression(Box::new(expression))
            }
        })
    }

    /// Goes on with the state of a keyframe.
    pub(super) fn resume(&mut self, kept: Monitor) -> Result<(), KeyframeError> {
        match (self, kept) {
            (Monitor::Frequency(monitor), Monitor::Frequency(kept)) => monitor.resume(kept),
            (Monitor::Latency(monitor), Monitor::Latency(kept)) => monitor.resume(kept),
            (Monitor::Value(monitor), Monitor::Value(kept)) => monitor.resume(kept),
            (Monitor::Frozen(monitor), Monitor::Frozen(kept)) => monitor.resume(kept),
            (Monitor::Watchdog(monitor), Monitor::Watchdog(kept)) => {
                monitor.resume(kept);
                Ok(())
            }
            (Monitor::RateRatio(monitor), Monitor::RateRatio(kept)) => monitor.resume(kept),
            (Monitor::Sequence(monitor), Monitor::Sequence(kept)) => monitor.resume(kept),
            (Monitor::Agreement(monitor), Monitor::Agreement(kept)) => monitor.resume(*kept),
            (Monitor::Expression(monitor), Monitor::Expression(kept)) => monitor.resume(*kept),
            (Monitor::Constant(_), Monitor::Constant(_)) => Ok(()),
            (Monitor::Count(monitor), Monitor::Count(kept)) => {
                monitor.resume(kept);
                Ok(())
            }
            _ => Err(KeyframeError::new("the configuration has a monitor of another kind")),
        }
    }

    /// Whether the values of a slot are compared as texts, so that "12" is a text too.
    pub(super) fn wants_words(&self, slot: usize) -> bool {
        match self {
            Monitor::Value(value) => value.wants_words(),
            Monitor::Expression(expression) => expression.wants_words(slot),
            // Whatever it is, its text is compared.
            Monitor::Frozen(_) => true,
            Monitor::Frequency(_)
            | Monitor::Latency(_)
            | Monitor::Watchdog(_)
            | Monitor::RateRatio(_)
            | Monitor::Sequence(_)
            | Monitor::Constant(_)
            | Monitor::Count(_)
            | Monitor::Agreement(_) => false,
        }
    }

    /// A monitor that judges by the clock starts when its module becomes relevant, and pauses while it is not.
    pub(super) fn set_relevant(&mut self, relevant: bool, now: Timestamp) {
        match self {
            Monitor::Frequency(monitor) => monitor.set_relevant(relevant, now),
            Monitor::RateRatio(monitor) => monitor.set_relevant(relevant, now),
            Monitor::Watchdog(monitor) => monitor.set_relevant(relevant, now),
            Monitor::Latency(_) | Monitor::Agreement(_) | Monitor::Frozen(_) if relevant => {
                self.begin_anew(now);
            }
            Monitor::Latency(_)
            | Monitor::Value(_)
            | Monitor::Frozen(_)
            | Monitor::Sequence(_)
            | Monitor::Agreement(_)
            | Monitor::Constant(_)
            | Monitor::Count(_)
            | Monitor::Expression(_) => {}
        }
    }

    /// Its module is no longer blocked, and is well: it is judged on, but what came before makes nothing worse.
    pub(super) fn recover(&mut self, now: Timestamp) {
        match self {
            Monitor::Frequency(monitor) => monitor.recover(now),
            Monitor::RateRatio(monitor) => monitor.recover(now),
            Monitor::Latency(_)
            | Monitor::Value(_)
            | Monitor::Frozen(_)
            | Monitor::Watchdog(_)
            | Monitor::Sequence(_)
            | Monitor::Agreement(_)
            | Monitor::Constant(_)
            | Monitor::Count(_)
            | Monitor::Expression(_) => {}
        }
    }

    /// Starts its window again: what came before does not count. Returns whether it has a window.
    pub(super) fn begin_anew(&mut self, now: Timestamp) -> bool {
        match self {
            Monitor::Frequency(monitor) => monitor.set_relevant(true, now),
            Monitor::RateRatio(monitor) => monitor.set_relevant(true, now),
            Monitor::Latency(monitor) => monitor.begin_anew(),
            Monitor::Frozen(monitor) => monitor.begin_anew(now),
            Monitor::Agreement(monitor) => return monitor.begin_anew(),
            Monitor::Watchdog(_)
            | Monitor::Value(_)
            | Monitor::Sequence(_)
            | Monitor::Constant(_)
            | Monitor::Count(_)
            | Monitor::Expression(_) => return false,
        }
        true
    }

    /// After a start or a reload: a topic without a known publisher is not judged by the clock before `until`.
    pub(super) fn search(&mut self, until: Timestamp) {
        match self {
            Monitor::Frequency(monitor) => monitor.search(until),
            Monitor::RateRatio(monitor) => monitor.search(until),
            Monitor::Latency(_)
            | Monitor::Value(_)
            | Monitor::Frozen(_)
            | Monitor::Watchdog(_)
            | Monitor::Sequence(_)
            | Monitor::Agreement(_)
            | Monitor::Constant(_)
            | Monitor::Count(_)
            | Monitor::Expression(_) => {}
        }
    }

    /// Discovery reported, or a message came. Returns whether the next judgement moved forward.
    pub(super) fn found(&mut self, slot: usize, now: Timestamp) -> bool {
        match self {
            Monitor::Frequency(monitor) => monitor.found(now),
            Monitor::RateRatio(monitor) => monitor.found(slot, now),
            Monitor::Latency(_)
            | Monitor::Value(_)
            | Monitor::Frozen(_)
            | Monitor::Watchdog(_)
            | Monitor::Sequence(_)
            | Monitor::Agreement(_)
            | Monitor::Constant(_)
            | Monitor::Count(_)
            | Monitor::Expression(_) => false,
        }
    }

    /// A message came that was published before Telltale listened. Present ones may be delayed too, so the
    /// first window begins after it. Returns whether the next judgement moved back.
    pub(super) fn late(&mut self, now: Timestamp) -> bool {
        match self {
            Monitor::Frequency(monitor) => monitor.late(now),
            Monitor::RateRatio(monitor) => monitor.late(now),
            Monitor::Latency(_)
            | Monitor::Value(_)
            | Monitor::Frozen(_)
            | Monitor::Watchdog(_)
            | Monitor::Sequence(_)
            | Monitor::Agreement(_)
            | Monitor::Constant(_)
            | Monitor::Count(_)
            | Monitor::Expression(_) => false,
        }
    }

    pub(super) fn take(&mut self, slot: usize, taken: Taken<'_>, now: Timestamp) {
        match (self, taken) {
            (Monitor::Frequency(monitor), Taken::Message(_)) => monitor.take(now),
            (Monitor::RateRatio(monitor), Taken::Message(_)) => monitor.take(slot, now),
            (Monitor::Latency(monitor), Taken::Message(sample)) => monitor.take(sample, now),
            (Monitor::Watchdog(monitor), Taken::Probe(outcome)) => monitor.take(outcome, now),
            (Monitor::Value(monitor), Taken::Value(value)) => {
                monitor.inputs.take(slot, value, now);
            }
            (Monitor::Frozen(monitor), Taken::Value(value)) => monitor.take(slot, value, now),
            (Monitor::Sequence(monitor), Taken::Value(value)) => monitor.take(slot, value, now),
            (Monitor::Agreement(monitor), Taken::Value(value)) => monitor.take(slot, value, now),
            (Monitor::Expression(monitor), Taken::Value(value)) => monitor.take(slot, value, now),
            // These take no other inputs: see [`feeds`].
            (
                Monitor::Frequency(_) | Monitor::RateRatio(_) | Monitor::Latency(_),
                Taken::Value(_) | Taken::Probe(_),
            )
            | (Monitor::Watchdog(_), Taken::Message(_) | Taken::Value(_))
            | (Monitor::Constant(_) | Monitor::Count(_), _)
            | (
                Monitor::Value(_)
                | Monitor::Frozen(_)
                | Monitor::Sequence(_)
                | Monitor::Agreement(_)
                | Monitor::Expression(_),
                Taken::Message(_) | Taken::Probe(_),
            ) => {}
        }
    }

    /// The state at `now`; `None` while there is nothing to judge.
    pub(super) fn judge(&mut self, now: Timestamp) -> Option<State> {
        match self {
            Monitor::Frequency(monitor) => monitor.judge(now),
            Monitor::Latency(monitor) => monitor.judge(now),
            Monitor::Value(monitor) => monitor.judge(now),
            Monitor::Frozen(monitor) => monitor.judge(now),
            Monitor::Watchdog(monitor) => monitor.judge(now),
            Monitor::RateRatio(monitor) => monitor.judge(now),
            Monitor::Sequence(monitor) => monitor.judge(),
            Monitor::Agreement(monitor) => monitor.judge(now),
            Monitor::Constant(state) => Some(*state),
            Monitor::Count(monitor) => monitor.judge(now),
            Monitor::Expression(monitor) => monitor.judge(now),
        }
    }

    /// After [`Monitor::judge`] at `now`: the time at which the state may change without an input.
    pub(super) fn due(&self, now: Timestamp) -> Option<Timestamp> {
        let due = match self {
            Monitor::Frequency(monitor) => monitor.due(now),
            Monitor::Latency(monitor) => monitor.due(),
            Monitor::Watchdog(monitor) => monitor.due(),
            Monitor::RateRatio(monitor) => monitor.due(now),
            Monitor::Agreement(monitor) => monitor.due(now),
            Monitor::Expression(monitor) => monitor.due(now),
            Monitor::Count(monitor) => monitor.due(),
            Monitor::Value(_) | Monitor::Frozen(_) | Monitor::Sequence(_) | Monitor::Constant(_) => None,
        };
        due.filter(|&due| due > now)
    }

    /// Whether the message changes with time alone.
    pub(super) fn moves(&self, now: Timestamp) -> bool {
        match self {
            Monitor::Frequency(monitor) => monitor.moves(),
            Monitor::Latency(monitor) => monitor.moves(),
            Monitor::RateRatio(monitor) => monitor.moves(),
            Monitor::Value(_)
            | Monitor::Frozen(_)
            | Monitor::Sequence(_)
            | Monitor::Constant(_)
            | Monitor::Count(_) => false,
            Monitor::Watchdog(_) | Monitor::Agreement(_) | Monitor::Expression(_) => self.due(now).is_some(),
        }
    }

    /// Whether the message only tells that an input is too old.
    pub(super) fn is_aged(&self, now: Timestamp) -> bool {
        match self {
            Monitor::Agreement(monitor) => monitor.is_aged(now),
            Monitor::Expression(monitor) => monitor.is_aged(now),
            Monitor::Frequency(_)
            | Monitor::Latency(_)
            | Monitor::Value(_)
            | Monitor::Frozen(_)
            | Monitor::Watchdog(_)
            | Monitor::RateRatio(_)
            | Monitor::Sequence(_)
            | Monitor::Constant(_)
            | Monitor::Count(_) => false,
        }
    }

    /// After [`Monitor::judge`] at `now`: the measured values as text.
    pub(super) fn words(&self, now: Timestamp) -> Words {
        match self {
            Monitor::Frequency(monitor) => monitor.words(now),
            Monitor::Latency(monitor) => monitor.words(),
            Monitor::Value(monitor) => monitor.words(now),
            Monitor::Frozen(monitor) => monitor.words(now),
            Monitor::Watchdog(monitor) => monitor.words(now),
            Monitor::RateRatio(monitor) => monitor.words(now),
            Monitor::Sequence(monitor) => monitor.words(),
            Monitor::Agreement(monitor) => monitor.words(now),
            Monitor::Constant(_) => {
                Words::plain(say!("set by the configuration", "von der Konfiguration festgelegt"))
            }
            Monitor::Count(monitor) => monitor.words(),
            Monitor::Expression(monitor) => monitor.words(now),
        }
    }
}

/// The value of a KeyValue: `12.5` is a number, `true` and `false` are booleans, also as `diagnostic_updater`
/// and Python write them, the rest is text.
pub(super) fn parse(text: &str) -> FieldValue {
    let trimmed = text.trim();
    match trimmed {
        "true" | "True" | "TRUE" => FieldValue::Bool(true),
        "false" | "False" | "FALSE" => FieldValue::Bool(false),
        _ => trimmed.parse().map_or_else(|_| FieldValue::Text(text.into()), FieldValue::Number),
    }
}

/// The least time between two texts while the state stays.
pub(super) const WORDS_EVERY: Span = Span::from_millis(250);
