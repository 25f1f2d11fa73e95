//! The number of modules in a group: all of them must be there, and no others. It is a module, because a
//! group in ERROR whose members are all well would be a cause without an alarm and without a message.

use serde::{Deserialize, Serialize};

use super::Words;
use crate::state::State;
use crate::text::say;
use crate::time::{Span, Timestamp};

#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct Count {
    #[serde(skip)]
    wanted: u32,
    #[serde(skip)]
    may_be_empty: bool,
    #[serde(skip)]
    grace: Span,
    found: u32,
    /// Since when it counts.
    since: Option<Timestamp>,
}

impl Count {
    pub(super) fn new(wanted: u32, may_be_empty: bool, grace: Span) -> Count {
        Count { wanted, may_be_empty, grace, found: 0, since: None }
    }

    /// Returns whether this is the first number, or another one.
    pub(super) fn set(&mut self, found: u32, now: Timestamp) -> bool {
        let is_first = self.since.is_none();
        self.since.get_or_insert(now);
        std::mem::replace(&mut self.found, found) != found || is_first
    }

    /// Goes on with the state of a keyframe.
    pub(super) fn resume(&mut self, kept: Count) {
        (self.found, self.since) = (kept.found, kept.since);
    }

    /// A wrong number is not judged while modules may still come.
    pub(super) fn judge(&self, now: Timestamp) -> Option<State> {
        let since = self.since?;
        if self.found == self.wanted {
            Some(State::Ok)
        } else if now < since + self.grace {
            None
        } else if self.found == 0 && self.may_be_empty {
            Some(State::Ok)
        } else {
            Some(State::Error)
        }
    }

    pub(super) fn due(&self) -> Option<Timestamp> {
        Some(self.since? + self.grace)
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
