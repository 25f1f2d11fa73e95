//! The five diagnostic states (paper, Sec. III-C) and how they fold.

use crate::text::words;
use serde::{Deserialize, Serialize};
use std::fmt;

words! {
    /// A diagnostic state. The order is the badness by which groups fold: UNKNOWN is above WARNING because it may
    /// hide an ERROR; IGNORE never takes part in a fold. Its words are those on the wire and in files.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum State {
        Ignore = "ignore",
        Ok = "ok",
        Warning = "warning",
        Unknown = "unknown",
        Error = "error",
    }
}

impl State {
    /// The state of a `diagnostic_msgs/DiagnosticStatus` level byte. STALE (3) is UNKNOWN; every byte that the message
    /// definition does not name is an ERROR, as for ROS 2's aggregator. Nowhere else is a level judged.
    pub const fn from_level(level: u8) -> State {
        match level {
            0 => State::Ok,
            1 => State::Warning,
            3 => State::Unknown,
            _ => State::Error,
        }
    }

    pub(crate) const fn index(self) -> usize {
        self as usize
    }
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// The number of members in each state. A group folds this instead of its members, so the cost of one changed
/// member does not depend on their number.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tally([u32; 5]);

impl Tally {
    pub fn add(&mut self, state: State) {
        self.0[state.index()] += 1;
    }

    pub fn remove(&mut self, state: State) {
        self.0[state.index()] -= 1;
    }

    pub fn of(&self, state: State) -> u32 {
        self.0[state.index()]
    }

    /// Members that are not ignored.
    pub fn counted(&self) -> u32 {
        self.0.iter().sum::<u32>() - self.of(State::Ignore)
    }

    /// The worst state of the members that are not ignored.
    pub fn worst(&self) -> Option<State> {
        State::ALL.into_iter().rev().find(|&state| state != State::Ignore && self.of(state) > 0)
    }

    /// The best state of the members that are not ignored.
    pub fn best(&self) -> Option<State> {
        State::ALL.into_iter().find(|&state| state != State::Ignore && self.of(state) > 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_level_byte_has_a_state_and_only_zero_is_ok() {
        for level in 0..=u8::MAX {
            let state = State::from_level(level);
            assert_eq!(state == State::Ok, level == 0);
            assert_eq!(state == State::Unknown, level == 3);
            assert_eq!(state == State::Error, level == 2 || level > 3);
        }
    }

    #[test]
    fn a_tally_folds_to_worst_and_best_without_ignore() {
        let mut tally = Tally::default();
        assert_eq!((tally.worst(), tally.best(), tally.counted()), (None, None, 0));
        tally.add(State::Ignore);
        assert_eq!((tally.worst(), tally.counted()), (None, 0));
        tally.add(State::Warning);
        tally.add(State::Unknown);
        assert_eq!((tally.worst(), tally.best()), (Some(State::Unknown), Some(State::Warning)));
        tally.add(State::Error);
        tally.remove(State::Warning);
        assert_eq!(
            (tally.worst(), tally.best(), tally.counted()),
            (Some(State::Error), Some(State::Unknown), 2)
        );
    }
}
