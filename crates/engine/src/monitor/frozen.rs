//! Whether what a topic sends still changes: a source that repeats itself is fresh and wrong.
//! The time runs from the first equal message to the last, so a silence is no repetition.

use super::MonitorKind;
use super::inputs::{InputFault, Inputs, UnusableInput};
use super::words::Words;
use crate::files::{KeyframeError, count};
use crate::model::monitors::{Bands, FrozenLimits};
use crate::model::sample::FieldValue;
use crate::state::State;
use crate::text::{Text, say};
use crate::time::Timestamp;
use serde::{Deserialize, Serialize};

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Frozen {
    inputs: Inputs,
    #[serde(skip)]
    limits: FrozenLimits,
    run: Option<Run>,
    /// Its cause was over, and nothing has changed since: that shows neither that the source lives nor that it hangs.
    unproven: bool,
}

/// Equal messages in a row.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Run {
    value: FieldValue,
    /// When the first of them came.
    since: Timestamp,
    /// When the last of them came.
    last: Timestamp,
    /// All but the first.
    #[serde(deserialize_with = "count")]
    repeats: u32,
}

impl Run {
    fn seconds(&self) -> f64 {
        self.last.since(self.since).as_secs_f64()
    }
}

impl Frozen {
    pub(super) fn new(inputs: Inputs, limits: FrozenLimits) -> Frozen {
        Frozen { inputs, limits, run: None, unproven: false }
    }
}

impl MonitorKind for Frozen {
    fn resume(&mut self, kept: Frozen) -> Result<(), KeyframeError> {
        let Frozen { inputs, limits: _, run, unproven } = kept;
        (self.run, self.unproven) = (run, unproven);
        self.inputs.resume(inputs)
    }

    /// Repetitions so far do not count.
    fn begin_anew(&mut self, now: Timestamp) -> bool {
        if let Some(run) = &mut self.run {
            (run.since, run.last, run.repeats) = (now, now, 0);
            self.unproven = true;
        }
        true
    }

    fn set_relevant(&mut self, relevant: bool, now: Timestamp) {
        if relevant {
            self.begin_anew(now);
            self.unproven = false;
        }
    }

    fn is_proven(&self) -> bool {
        !self.unproven
    }

    /// Values of every type are compared as texts.
    fn wants_words(&self, _slot: usize) -> bool {
        true
    }

    /// A message that cannot be read neither repeats the one before it nor differs from it.
    fn take_value(&mut self, slot: usize, value: &FieldValue, now: Timestamp) {
        self.inputs.take(slot, value, now);
        if self.inputs.value(slot, now).is_err() {
            return;
        }
        match &mut self.run {
            Some(run) if run.value == *value => {
                (run.last, run.repeats) = (now, run.repeats.saturating_add(1));
            }
            run => {
                *run = Some(Run { value: value.clone(), since: now, last: now, repeats: 0 });
                self.unproven = false;
            }
        }
    }

    fn judge(&mut self, now: Timestamp) -> Option<State> {
        let unreadable = self.unusable(now).map(|_| State::Unknown);
        self.run.as_ref().map(|run| self.by_time(run).max(self.by_number(run))).max(unreadable)
    }

    fn words(&self, now: Timestamp) -> Words {
        if let Some(unusable) = self.unusable(now) {
            return Words::plain(self.inputs.say(unusable));
        }
        let Some(run) = &self.run else { return Words::default() };
        let FrozenLimits { time, repeats } = &self.limits;
        let (seconds, number) = (run.seconds(), f64::from(run.repeats));
        let of_number = *time == Bands::default() || self.by_number(run) > self.by_time(run);
        let message = if of_number {
            repeats.say_of(number, Text::default(), say!("repetitions in a row", "Wiederholungen in Folge"))
        } else {
            time.say_of(seconds, "s".into(), say!("unchanged", "unverändert"))
        };
        let limits = if of_number { repeats } else { time };
        let measured = if of_number { ("repeats", number) } else { ("unchanged_s", seconds) };
        Words { message, values: limits.values(measured.0, measured.1) }
    }
}

impl Frozen {
    /// Why the last message says nothing.
    fn unusable(&self, now: Timestamp) -> Option<UnusableInput> {
        self.inputs.value(0, now).err().filter(|unusable| unusable.fault != InputFault::Missing)
    }

    fn by_time(&self, run: &Run) -> State {
        self.limits.time.judge(run.seconds())
    }

    fn by_number(&self, run: &Run) -> State {
        self.limits.repeats.judge(f64::from(run.repeats))
    }
}
