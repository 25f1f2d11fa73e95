//! Deadlines of modules, monitors and signals. An entry may be early: whoever owns it is asked again when
//! it comes up, so hearing from a module costs no work here.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use super::time::Timestamp;

/// What a deadline belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum TimerKey {
    Signal(u32),
    Reception,
    Localization,
    Measures,
    Active,
    Searched,
    Monitor(u32),
    Module(u32),
}

/// At most one live entry for each key; superseded ones are dropped when they come up.
#[derive(Debug, Default)]
pub(super) struct Timers {
    heap: BinaryHeap<Reverse<(Timestamp, TimerKey)>>,
    queued: [Vec<Option<Timestamp>>; 8],
}

impl Timers {
    /// Makes sure that `key` comes up no later than `due`.
    pub(super) fn arm(&mut self, key: TimerKey, due: Timestamp) {
        let slot = self.slot(key);
        if slot.is_none_or(|queued| due < queued) {
            *slot = Some(due);
            self.heap.push(Reverse((due, key)));
        }
    }

    /// The next instant at which something may be due.
    pub(super) fn next(&self) -> Option<Timestamp> {
        self.heap.peek().map(|Reverse((due, _))| *due)
    }

    /// Takes one key whose time has come by `now`, with that time.
    pub(super) fn pop(&mut self, now: Timestamp) -> Option<(Timestamp, TimerKey)> {
        while let Some(&Reverse((due, key))) = self.heap.peek() {
            if due > now {
                return None;
            }
            self.heap.pop();
            let slot = self.slot(key);
            if *slot == Some(due) {
                *slot = None;
                return Some((due, key));
            }
        }
        None
    }

    fn slot(&mut self, key: TimerKey) -> &mut Option<Timestamp> {
        let (kind, index) = match key {
            TimerKey::Signal(index) => (0, index as usize),
            TimerKey::Reception => (1, 0),
            TimerKey::Module(index) => (2, index as usize),
            TimerKey::Localization => (3, 0),
            TimerKey::Measures => (4, 0),
            TimerKey::Monitor(index) => (5, index as usize),
            TimerKey::Active => (6, 0),
            TimerKey::Searched => (7, 0),
        };
        let slots = &mut self.queued[kind];
        if slots.len() <= index {
            slots.resize(index + 1, None);
        }
        &mut slots[index]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
