//! The number of modules in a group: all of them must be there, and no others.

use serde::{Deserialize, Serialize};

use super::Words;
use crate::engine::state::State;
use crate::engine::text::say;

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(in crate::engine) struct Count {
    wanted: u32,
    none: State,
    found: u32,
}

impl Count {
    pub(super) fn new(wanted: u32, none: State) -> Count {
        Count { wanted, none, found: 0 }
    }

    /// Returns whether the number changed.
    pub(super) fn set(&mut self, found: u32) -> bool {
        std::mem::replace(&mut self.found, found) != found
    }

    pub(super) fn resume(&mut self, kept: Count) {
        self.found = kept.found;
    }

    pub(super) fn judge(&self) -> State {
        match self.found {
            found if found == self.wanted => State::Ok,
            0 => self.none,
            _ => State::Error,
        }
    }

    pub(super) fn words(&self) -> Words {
        let message = say!(
            "{found} of {wanted} statuses",
            "{found} von {wanted} Status",
            found = self.found.to_string(),
            wanted = self.wanted.to_string()
        );
        Words { message, values: vec![("statuses", self.found.to_string())] }
    }
}
