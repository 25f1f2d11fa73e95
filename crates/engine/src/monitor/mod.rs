//! Monitors: modules that diagnose from the outside (paper, Sec. III-D). Each kind is a small state machine: it
//! takes inputs with their times, judges them, and tells when time alone will change its judgement.

mod agreement;
mod constant;
mod count;
mod expression;
pub(super) mod feeds;
mod frequency;
mod frozen;
mod inputs;
mod latency;
mod motion;
mod rate_ratio;
mod sequence;
#[cfg(test)]
mod tests;
mod tf;
mod value;
mod watchdog;
mod window;
mod words;

use super::model::Policy;
use super::model::monitors::{MonitorSpec, Watched};
use super::model::sample::{FieldValue, ProbeOutcome, Sample};
use super::state::State;
use super::text::{Text, say};
use super::time::{Span, Timestamp};
use crate::files::KeyframeError;
use agreement::Agreement;
use constant::Constant;
use count::Count;
use expression::Expression;
use feeds::Keeping;
use frequency::Frequency;
use frozen::Frozen;
use inputs::Inputs;
pub(super) use inputs::NO_SUCH_KEY;
use latency::Latency;
use rate_ratio::RateRatio;
use sequence::Sequence;
use serde::{Deserialize, Serialize};
use tf::Tf;
use value::Value;
use watchdog::Watchdog;
pub(super) use words::{Words, cut};

/// The least time between two texts while the state stays.
pub(super) const WORDS_EVERY: Span = Span::from_millis(250);

/// A kind of monitor over time. It holds no ids, so it survives a change of the configuration. The defaults of the
/// methods are those of most kinds.
trait MonitorKind: Sized {
    /// Goes on with the state of a keyframe.
    fn resume(&mut self, kept: Self) -> Result<(), KeyframeError>;

    /// Whether the values of a slot are compared as texts, so that "12" is a text too.
    fn wants_words(&self, _slot: usize) -> bool {
        false
    }

    /// A monitor that judges by the clock starts when its module becomes relevant, and pauses while it is not.
    fn set_relevant(&mut self, relevant: bool, now: Timestamp) {
        if relevant {
            self.begin_anew(now);
        }
    }

    /// Its module is no longer blocked, and is well: it is judged on, but earlier inputs make nothing worse.
    fn recover(&mut self, _now: Timestamp) {}

    /// Starts its window again: earlier inputs do not count. Returns whether it has a window.
    fn begin_anew(&mut self, _now: Timestamp) -> bool {
        false
    }

    /// Whether something came since it began anew that shows that it is well. Without that a cause that comes and goes
    /// would hide it for ever.
    fn is_proven(&self) -> bool {
        true
    }

    /// After a start or a reload: a topic without a known publisher is not judged by the clock before `until`.
    fn search(&mut self, _until: Timestamp) {}

    /// Discovery reported, or a message came. Returns whether the next judgement moved forward.
    fn found(&mut self, _slot: usize, _now: Timestamp) -> bool {
        false
    }

    /// The topic of this slot has a publisher again after all had left, or it has a new reader and may have lost a message.
    fn returned(&mut self, _slot: usize, _now: Timestamp) {}

    /// Discovery reported the publishers of the topic of this slot; `None` if there are none.
    fn publishers(&mut self, _slot: usize, _keeping: Option<Keeping>, _now: Timestamp) {}

    /// A message came that was published before Telltale listened. Present ones may be delayed too, so the
    /// first window begins after it. Returns whether the next judgement moved back.
    fn late(&mut self, _now: Timestamp) -> bool {
        false
    }

    /// A message, whatever its content.
    fn take_message(&mut self, _slot: usize, _sample: &Sample, _now: Timestamp) {}

    fn take_value(&mut self, _slot: usize, _value: &FieldValue, _now: Timestamp) {}

    /// When the value of this slot was published, if an older one says nothing more.
    fn told(&self, _slot: usize) -> Option<Timestamp> {
        None
    }

    /// The value of a field of this message.
    fn take_field(&mut self, slot: usize, value: &FieldValue, _sample: &Sample, now: Timestamp) {
        self.take_value(slot, value, now);
    }

    /// Whether a judgement needs somebody who publishes the topic of this slot.
    fn needs_publisher(&self, _slot: usize) -> bool {
        true
    }

    fn take_probe(&mut self, _outcome: &ProbeOutcome, _now: Timestamp) {}

    /// The state at `now`; `None` while there is nothing to judge.
    fn judge(&mut self, now: Timestamp) -> Option<State>;

    /// After [`MonitorKind::judge`] at `now`: the time at which the state may change without an input. A time that has
    /// passed does not count.
    fn due(&self, _now: Timestamp) -> Option<Timestamp> {
        None
    }

    /// Whether the message changes with time alone.
    fn moves(&self, now: Timestamp) -> bool {
        self.due(now).is_some_and(|due| due > now)
    }

    /// Whether the message only tells that an input is too old.
    fn is_aged(&self, _now: Timestamp) -> bool {
        false
    }

    /// After [`MonitorKind::judge`] at `now`: the measured values as text.
    fn words(&self, now: Timestamp) -> Words;
}

/// A publisher was found: what begins after a search begins now. Returns whether that ends the search.
fn end_search(since: &mut Option<Timestamp>, now: Timestamp) -> bool {
    let searching = since.is_some_and(|since| since > now);
    if searching {
        *since = Some(now);
    }
    searching
}

macro_rules! kinds {
    ($($kind:ident),*) => {
        /// One monitor over time, of any kind.
        #[derive(Debug, Clone, Serialize, Deserialize)]
        #[serde(rename_all = "snake_case")]
        pub(super) enum Monitor {
            $($kind($kind)),*
        }

        impl Monitor {
            pub(super) fn resume(&mut self, kept: Monitor) -> Result<(), KeyframeError> {
                match (self, kept) {
                    $((Monitor::$kind(machine), Monitor::$kind(kept)) => machine.resume(kept),)*
                    _ => Err(KeyframeError::new("the configuration has a monitor of another kind")),
                }
            }
        }

        /// Asks the machine of a monitor.
        macro_rules! machine {
            ($monitor:expr, $machine:ident => $asked:expr) => {
                match $monitor {
                    $(Monitor::$kind($machine) => $asked),*
                }
            };
        }
    };
}

// A new kind is added here, and in `Monitor::new`.
kinds!(
    Frequency, Latency, Value, Frozen, Watchdog, RateRatio, Sequence, Agreement, Constant, Count, Tf,
    Expression
);

/// Each method calls the same of its [`MonitorKind`].
impl Monitor {
    /// `None` for a monitor that judges the level of a status.
    pub(super) fn new(spec: &MonitorSpec, watched: &Watched) -> Option<Monitor> {
        let one = |source| Inputs::new([("".into(), source)].into_iter(), watched, None);
        Some(match spec {
            MonitorSpec::External { .. } => return None,
            MonitorSpec::Constant { state } => Monitor::Constant(Constant(*state)),
            MonitorSpec::Count { wanted, may_be_empty, grace } => {
                Monitor::Count(Count::new(*wanted, *may_be_empty, *grace))
            }
            MonitorSpec::Frequency { window, bands, .. } => {
                Monitor::Frequency(Frequency::new(*window, *bands))
            }
            MonitorSpec::Latency { window, bands, .. } => Monitor::Latency(Latency::new(*window, *bands)),
            MonitorSpec::Value { source, rule, empty } => {
                Monitor::Value(Value::new(one(source), rule.clone(), *empty))
            }
            MonitorSpec::Frozen { source, limits } => Monitor::Frozen(Frozen::new(one(source), *limits)),
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
                Monitor::Agreement(Agreement::new(inputs, *max_age, *motion_over, rule.clone()))
            }
            MonitorSpec::Tf { links, bands } => Monitor::Tf(Tf::new(links, *bands)),
            MonitorSpec::Expression { inputs: sources, max_age, warning, error, .. } => {
                let roles = sources.iter().map(|(name, source)| (Text::plain(name), source));
                let inputs = Inputs::new(roles, watched, Some(*max_age));
                let names = sources.iter().map(|(name, _)| name.clone());
                Monitor::Expression(Expression::new(inputs, names, warning.clone(), error.clone()))
            }
        })
    }

    /// Takes what the policy of its module says of what never comes.
    pub(super) fn follow(&mut self, policy: &Policy) {
        if let Monitor::Tf(tf) = self {
            tf.follow(policy);
        }
    }

    pub(super) fn wants_words(&self, slot: usize) -> bool {
        machine!(self, machine => machine.wants_words(slot))
    }

    pub(super) fn set_relevant(&mut self, relevant: bool, now: Timestamp) {
        machine!(self, machine => machine.set_relevant(relevant, now))
    }

    pub(super) fn recover(&mut self, now: Timestamp) {
        machine!(self, machine => machine.recover(now))
    }

    pub(super) fn begin_anew(&mut self, now: Timestamp) -> bool {
        machine!(self, machine => machine.begin_anew(now))
    }

    pub(super) fn is_proven(&self) -> bool {
        machine!(self, machine => machine.is_proven())
    }

    pub(super) fn search(&mut self, until: Timestamp) {
        machine!(self, machine => machine.search(until))
    }

    pub(super) fn found(&mut self, slot: usize, now: Timestamp) -> bool {
        machine!(self, machine => machine.found(slot, now))
    }

    pub(super) fn publishers(&mut self, slot: usize, keeping: Option<Keeping>, now: Timestamp) {
        machine!(self, machine => machine.publishers(slot, keeping, now))
    }

    pub(super) fn returned(&mut self, slot: usize, now: Timestamp) {
        machine!(self, machine => machine.returned(slot, now))
    }

    pub(super) fn late(&mut self, now: Timestamp) -> bool {
        machine!(self, machine => machine.late(now))
    }

    pub(super) fn take_message(&mut self, slot: usize, sample: &Sample, now: Timestamp) {
        machine!(self, machine => machine.take_message(slot, sample, now))
    }

    pub(super) fn take_value(&mut self, slot: usize, value: &FieldValue, now: Timestamp) {
        machine!(self, machine => machine.take_value(slot, value, now))
    }

    pub(super) fn take_field(&mut self, slot: usize, value: &FieldValue, sample: &Sample, now: Timestamp) {
        machine!(self, machine => machine.take_field(slot, value, sample, now))
    }

    pub(super) fn told(&self, slot: usize) -> Option<Timestamp> {
        machine!(self, machine => machine.told(slot))
    }

    pub(super) fn needs_publisher(&self, slot: usize) -> bool {
        machine!(self, machine => machine.needs_publisher(slot))
    }

    pub(super) fn take_probe(&mut self, outcome: &ProbeOutcome, now: Timestamp) {
        machine!(self, machine => machine.take_probe(outcome, now))
    }

    pub(super) fn judge(&mut self, now: Timestamp) -> Option<State> {
        machine!(self, machine => machine.judge(now))
    }

    pub(super) fn due(&self, now: Timestamp) -> Option<Timestamp> {
        machine!(self, machine => machine.due(now)).filter(|&due| due > now)
    }

    pub(super) fn moves(&self, now: Timestamp) -> bool {
        machine!(self, machine => machine.moves(now))
    }

    pub(super) fn is_aged(&self, now: Timestamp) -> bool {
        machine!(self, machine => machine.is_aged(now))
    }

    pub(super) fn words(&self, now: Timestamp) -> Words {
        machine!(self, machine => machine.words(now))
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
