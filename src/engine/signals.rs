//! The vehicle's signals: named booleans that conditions ask for (`ENGINE.md` 3).

use super::model::SignalSpec;
use super::time::Timestamp;

/// The present values. A signal that was never received, or is older than its timeout, is unknown.
#[derive(Debug)]
pub(super) struct Signals {
    /// The built-in signal: the operator gave a pose.
    pub(super) posed: bool,
    specs: Vec<SignalSpec>,
    values: Vec<Value>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Value {
    last: Option<(bool, Timestamp)>,
    /// What conditions see now.
    seen: Option<bool>,
}

impl Signals {
    pub(super) fn new(specs: &[SignalSpec]) -> Signals {
        let value = |spec: &SignalSpec| Value {
            last: None,
            // An event that has not come is known to be absent.
            seen: spec.present_for.map(|_| false),
        };
        Signals { posed: false, specs: specs.to_vec(), values: specs.iter().map(value).collect() }
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

    /// Takes over the last sample of another set's signal.
    pub(super) fn copy(&mut self, index: usize, other: &Signals, from: usize, now: Timestamp) {
        self.values[index].last = other.values[from].last;
        self.refresh(index, now);
    }

    /// Sets what conditions see until the next sample, however long that takes.
    pub(super) fn assume(&mut self, index: usize, value: bool) {
        self.values[index] = Value { last: None, seen: Some(value) };
    }

    /// An event is used up: it counts as not received. Returns whether what conditions see changed.
    pub(super) fn forget(&mut self, index: usize) -> bool {
        if self.specs[index].present_for.is_none() {
            return false;
        }
        self.values[index].last = None;
        self.values[index].seen.replace(false) != Some(false)
    }

    /// Takes a sample. Returns whether what conditions see changed.
    pub(super) fn take(&mut self, index: usize, value: bool, now: Timestamp) -> bool {
        self.values[index].last = Some((value, now));
        self.refresh(index, now)
    }

    /// Lets the time up to `now` act on one signal. Returns whether what conditions see changed.
    pub(super) fn refresh(&mut self, index: usize, now: Timestamp) -> bool {
        let Some((value, at)) = self.values[index].last else { return false };
        let spec = &self.specs[index];
        let seen = match (spec.present_for, spec.timeout) {
            (Some(span), _) => Some(value && now < at + span),
            (None, Some(timeout)) if now >= at + timeout => None,
            (None, _) => Some(value),
        };
        std::mem::replace(&mut self.values[index].seen, seen) != seen
    }

    /// When time alone changes a signal next.
    pub(super) fn due(&self, index: usize) -> Option<Timestamp> {
        let (_, at) = self.values[index].last?;
        let spec = &self.specs[index];
        spec.present_for.or(spec.timeout).map(|span| at + span)
    }
}
