//! Deadlines of modules, monitors and signals. An entry may be early: its owner is asked again when it comes
//! up, so a report of a module costs no work here.

use super::files::KeyframeError;
use serde::{Deserialize, Serialize};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::time::Timestamp;

/// The owner of a deadline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(super) enum TimerKey {
    Signal(u32),
    Reception,
    Disputes,
    Localization,
    Countermeasures,
    Active,
    Searched,
    Motion,
    Shelves,
    Monitor(u32),
    Module(u32),
    Group(u32),
}

/// Superseded entries may be twice as many as live ones, plus this number.
const SUPERSEDED_MAX: usize = 64;

/// At most one live entry for each key; superseded ones are dropped when they come up, or when there are too
/// many.
#[derive(Debug, Clone, Default)]
pub(super) struct Timers {
    heap: BinaryHeap<Reverse<(Timestamp, TimerKey)>>,
    queued: [Vec<Option<Timestamp>>; 12],
    live: usize,
}

impl Timers {
    /// Makes sure that `key` comes up no later than `due`.
    pub(super) fn arm(&mut self, key: TimerKey, due: Timestamp) {
        let slot = self.slot(key);
        let is_new = slot.is_none();
        if due < Timestamp::MAX && slot.is_none_or(|queued| due < queued) {
            *slot = Some(due);
            self.live += usize::from(is_new);
            self.heap.push(Reverse((due, key)));
            if self.heap.len() > 3 * self.live + SUPERSEDED_MAX {
                self.clear_out();
            }
        }
    }

    /// Drops superseded entries.
    fn clear_out(&mut self) {
        let mut entries = std::mem::take(&mut self.heap).into_vec();
        entries.sort_unstable();
        entries.dedup();
        entries.retain(|&Reverse((due, key))| *self.slot(key) == Some(due));
        self.heap = entries.into();
    }

    /// The next instant at which an entry may be due.
    pub(super) fn next(&self) -> Option<Timestamp> {
        self.heap.peek().map(|Reverse((due, _))| *due)
    }

    /// Takes one key that is due by `now`, with its time.
    pub(super) fn pop(&mut self, now: Timestamp) -> Option<(Timestamp, TimerKey)> {
        while let Some(&Reverse((due, key))) = self.heap.peek() {
            if due > now {
                return None;
            }
            self.heap.pop();
            let slot = self.slot(key);
            if *slot == Some(due) {
                *slot = None;
                self.live -= 1;
                return Some((due, key));
            }
        }
        None
    }

    fn slot(&mut self, key: TimerKey) -> &mut Option<Timestamp> {
        let (kind, index) = place(key);
        let slots = &mut self.queued[kind];
        if slots.len() <= index {
            slots.resize(index + 1, None);
        }
        &mut slots[index]
    }

    /// The entries for a keyframe, by time.
    pub(super) fn kept(&self) -> Vec<KeptTimer> {
        let Timers { heap, queued, live: _ } = self;
        let mut entries: Vec<(Timestamp, TimerKey)> = heap.iter().map(|Reverse(entry)| *entry).collect();
        entries.sort_unstable();
        let queued = |key| {
            let (kind, index) = place(key);
            queued[kind].get(index).copied().flatten()
        };
        let mut before = None;
        let kept = |(due, owner)| {
            let is_first = before.replace((due, owner)) != Some((due, owner));
            KeptTimer { due, owner, live: is_first && queued(owner) == Some(due) }
        };
        entries.into_iter().map(kept).collect()
    }

    /// Goes on with the entries of a keyframe.
    pub(super) fn resume(
        kept: Vec<KeptTimer>,
        is_known: impl Fn(TimerKey) -> bool,
    ) -> Result<Timers, KeyframeError> {
        let mut timers = Timers::default();
        for KeptTimer { due, owner, live } in kept {
            if !is_known(owner) || live && timers.slot(owner).replace(due).is_some() {
                return Err(KeyframeError::new(format!("the deadline of {owner:?} has no owner")));
            }
            timers.live += usize::from(live);
            timers.heap.push(Reverse((due, owner)));
        }
        Ok(timers)
    }
}

/// A deadline in a keyframe.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct KeptTimer {
    due: Timestamp,
    owner: TimerKey,
    /// It is not superseded.
    live: bool,
}

/// The kind of a key, and its index among those of the kind.
fn place(key: TimerKey) -> (usize, usize) {
    match key {
        TimerKey::Signal(index) => (0, index as usize),
        TimerKey::Reception => (1, 0),
        TimerKey::Module(index) => (2, index as usize),
        TimerKey::Localization => (3, 0),
        TimerKey::Countermeasures => (4, 0),
        TimerKey::Monitor(index) => (5, index as usize),
        TimerKey::Active => (6, 0),
        TimerKey::Searched => (7, 0),
        TimerKey::Group(index) => (8, index as usize),
        TimerKey::Disputes => (9, 0),
        TimerKey::Motion => (10, 0),
        TimerKey::Shelves => (11, 0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn superseded_deadlines_have_a_bound_and_no_live_one_is_lost() {
        let mut timers = Timers::default();
        let keys = [
            TimerKey::Signal(2),
            TimerKey::Reception,
            TimerKey::Module(5),
            TimerKey::Localization,
            TimerKey::Countermeasures,
            TimerKey::Monitor(1),
            TimerKey::Active,
            TimerKey::Searched,
            TimerKey::Motion,
            TimerKey::Shelves,
        ];
        for round in 0..10_000 {
            for &key in &keys {
                // A far deadline, and a near one that supersedes it.
                timers.arm(key, Timestamp::from_millis(1_000_000));
                timers.arm(key, Timestamp::from_millis(round));
                timers.arm(key, Timestamp::MAX);
            }
            let mut up: Vec<_> =
                keys.iter().filter_map(|_| timers.pop(Timestamp::from_millis(round))).collect();
            up.sort_unstable();
            let mut expected = keys.map(|key| (Timestamp::from_millis(round), key)).to_vec();
            expected.sort_unstable();
            assert_eq!(up, expected);
        }
        assert!(timers.heap.len() <= 4 * keys.len() + SUPERSEDED_MAX, "{}", timers.heap.len());
        timers.arm(TimerKey::Module(7), Timestamp::MAX);
        assert_eq!(timers.live, 0);
    }

    #[test]
    fn a_key_comes_up_once_at_its_earliest_time() {
        let at = Timestamp::from_millis;
        let mut timers = Timers::default();
        timers.arm(TimerKey::Module(3), at(10));
        timers.arm(TimerKey::Module(3), at(5));
        timers.arm(TimerKey::Module(3), at(20));
        timers.arm(TimerKey::Signal(0), at(7));
        assert_eq!(timers.next(), Some(at(5)));
        assert_eq!(timers.pop(at(4)), None);
        assert_eq!(timers.pop(at(100)), Some((at(5), TimerKey::Module(3))));
        assert_eq!(timers.pop(at(100)), Some((at(7), TimerKey::Signal(0))));
        assert_eq!(timers.pop(at(100)), None);
        assert_eq!(timers.next(), None);
    }
}
