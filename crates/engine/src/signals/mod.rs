//! The vehicle's signals: named truth values that conditions use.

pub(super) mod driving_word;

use super::Engine;
use super::event::EventKind;
use super::files::KeyframeError;
use super::model::{ACTIVE_SIGNAL, SignalSpec, Stage, StageModel};
use super::time::Timestamp;
use super::timers::TimerKey;
use driving_word::Drive;
use serde::{Deserialize, Serialize};

/// The present values. A signal that was never received, or is older than its timeout, is unknown.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Signals {
    /// The built-in signal: the operator gave a pose.
    pub(super) posed: bool,
    /// Whether the signal that the vehicle drives is believed.
    pub(super) drive: Drive,
    /// The signal that the stages follow, if there is one.
    #[serde(skip)]
    active: Option<usize>,
    #[serde(skip)]
    specs: Vec<SignalSpec>,
    values: Vec<PresentSignal>,
}

/// The last value of a signal, and its time.
#[derive(Debug, Clone, Copy)]
pub(super) struct SignalSample {
    pub(super) is: bool,
    /// For a condition over several inputs, the time of the oldest.
    pub(super) at: Timestamp,
}

#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
struct PresentSignal {
    last: Option<(bool, Timestamp)>,
    /// The value that conditions see now.
    seen: Option<bool>,
}

impl Signals {
    pub(super) fn new(specs: &[SignalSpec]) -> Signals {
        let value = |spec: &SignalSpec| PresentSignal {
            last: None,
            // An event that has not come counts as false.
            seen: spec.present_for.map(|_| false),
        };
        Signals {
            posed: false,
            drive: Drive::default(),
            active: specs.iter().position(|spec| &*spec.name == ACTIVE_SIGNAL),
            specs: specs.to_vec(),
            values: specs.iter().map(value).collect(),
        }
    }

    /// Goes on with the state of a keyframe.
    pub(super) fn resume(&mut self, kept: Signals) -> Result<(), KeyframeError> {
        let Signals { posed, drive, active: _, specs: _, values } = kept;
        KeyframeError::unless_same("signals", values.len(), self.values.len())?;
        (self.posed, self.drive, self.values) = (posed, drive, values);
        Ok(())
    }

    pub(super) fn index(&self, name: &str) -> Option<usize> {
        self.specs.iter().position(|spec| &*spec.name == name)
    }

    pub(super) fn name(&self, index: usize) -> &str {
        &self.specs[index].name
    }

    pub(super) fn value(&self, index: usize) -> Option<bool> {
        self.values[index].seen
    }

    pub(super) fn list(&self) -> impl Iterator<Item = (&str, Option<bool>)> {
        self.specs.iter().zip(&self.values).map(|(spec, value)| (&*spec.name, value.seen))
    }

    /// Takes over the last sample of a signal of another set.
    pub(super) fn copy(&mut self, index: usize, other: &Signals, from: usize, now: Timestamp) {
        self.values[index].last = other.values[from].last;
        if self.active == Some(index) {
            self.drive = other.drive;
        }
        self.refresh(index, now);
    }

    /// Sets the value that conditions see until the next sample, however long that takes.
    pub(super) fn assume(&mut self, index: usize, value: bool) {
        self.values[index] = PresentSignal { last: None, seen: Some(value) };
        if self.active == Some(index) {
            self.drive.assume(value);
        }
    }

    /// Uses an event up: it counts as not received. Returns whether the value for conditions changed.
    pub(super) fn forget(&mut self, index: usize) -> bool {
        if self.specs[index].present_for.is_none() {
            return false;
        }
        self.values[index].last = None;
        self.values[index].seen.replace(false) != Some(false)
    }

    /// Takes a sample of the signal that the vehicle drives; samples may contradict each other. `stage`: of the vehicle
    /// until now. Returns whether the value for conditions changed.
    pub(super) fn take_active(&mut self, value: SignalSample, stage: Stage, now: Timestamp) -> bool {
        let Some(index) = self.active else { return false };
        self.drive.take(value.is, stage == Stage::Active, stage == Stage::Cleared, now);
        self.take(index, value, now)
    }

    /// Takes a sample. Returns whether the value for conditions changed.
    pub(super) fn take(&mut self, index: usize, value: SignalSample, now: Timestamp) -> bool {
        self.values[index].last = Some((value.is, value.at));
        self.refresh(index, now)
    }

    /// A level becomes unknown; an event stays as it is. Returns whether the value for conditions changed.
    fn lose(&mut self, index: usize) -> bool {
        if self.specs[index].present_for.is_some() {
            return false;
        }
        if self.active == Some(index) {
            self.drive.lapse();
        }
        std::mem::take(&mut self.values[index]).seen.is_some()
    }

    /// Advances one signal to `now`. Returns whether the value for conditions changed.
    pub(super) fn refresh(&mut self, index: usize, now: Timestamp) -> bool {
        let Some((value, at)) = self.values[index].last else { return false };
        let spec = &self.specs[index];
        let is_active = self.active == Some(index);
        let seen = match (spec.present_for, spec.timeout) {
            (Some(span), _) => Some(value && now < at + span),
            (None, Some(timeout)) if now >= at + timeout => {
                if is_active {
                    self.drive.lapse();
                }
                None
            }
            (None, _) => Some(value || (is_active && self.drive.holds(now))),
        };
        std::mem::replace(&mut self.values[index].seen, seen) != seen
    }

    /// The next time at which time alone changes a signal, or whether it is believed.
    pub(super) fn due(&self, index: usize, now: Timestamp) -> Option<Timestamp> {
        let spec = &self.specs[index];
        let over = self.values[index].last.and_then(|(_, at)| Some(at + spec.present_for.or(spec.timeout)?));
        let believed = if self.active == Some(index) { self.drive.due(now) } else { None };
        [over, believed].into_iter().flatten().filter(|&due| due > now).min()
    }
}

impl Engine {
    pub(super) fn take_signal(&mut self, name: &str, value: bool) {
        let Some(index) = self.signals.index(name) else {
            self.counters.unknown_signals += 1;
            return;
        };
        self.take_heard(index, SignalSample { is: value, at: self.now });
    }

    /// Evaluates the condition of a signal after an input. Returns whether anything follows from it.
    pub(super) fn judge_condition(&mut self, watch: u32, index: usize) -> bool {
        let timeout = self.model.signals[index].timeout;
        let is_known = |heard: &SignalSample| timeout.is_none_or(|timeout| self.now < heard.at + timeout);
        let Some(holds) = self.watching.condition(watch, self.now).filter(is_known) else {
            let changed = self.signals.lose(index);
            self.signal_changed(index, changed);
            return true;
        };
        // An event happens with its message, whatever the age of the other inputs.
        let is_event = self.model.signals[index].present_for.is_some();
        let at = if is_event { self.now } else { holds.at };
        self.take_heard(index, SignalSample { at, ..holds }) || Some(index) == self.active_signal
    }

    fn take_heard(&mut self, index: usize, heard: SignalSample) -> bool {
        let changed = match self.vehicle.model {
            StageModel::Shuttle if Some(index) == self.active_signal => {
                self.signals.take_active(heard, self.vehicle.stage, self.now)
            }
            _ => self.signals.take(index, heard, self.now),
        };
        self.signal_changed(index, changed);
        changed
    }

    pub(super) fn signal_changed(&mut self, index: usize, changed: bool) {
        if let Some(due) = self.signals.due(index, self.now) {
            self.timers.arm(TimerKey::Signal(index as u32), due);
        }
        self.vehicle_changed |= Some(index) == self.active_signal;
        if !changed {
            return;
        }
        let value = self.signals.value(index);
        self.events.push(self.now, EventKind::Signal { index, value });
        if Some(index) == self.active_signal {
            self.take_active(value);
        }
        self.vehicle_changed = true;
        self.net.mark_conditions(self.vehicle.stage);
        self.views.set_signals(&self.signals);
    }
}
