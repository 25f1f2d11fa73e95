//! The number of modules in a group: all of them must be there, and no others. It is a module, because a
//! group in ERROR whose members are all well would be a cause without an alarm and without a message.

use serde::{Deserialize, Serialize};

use super::MonitorKind;
use super::Words;
use crate::files::KeyframeError;
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
}

impl MonitorKind for Count {
    fn resume(&mut self, kept: Count) -> Result<(), KeyframeError> {
        (self.found, self.since) = (kept.found, kept.since);
        Ok(())
    }

    /// A wrong number is not judged while modules may still come.
    fn judge(&mut self, now: Timestamp) -> Option<State> {
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

    fn due(&self, _now: Timestamp) -> Option<Timestamp> {
        Some(self.since? + self.grace)
    }

    fn moves(&self, _now: Timestamp) -> bool {
        false
    }

    fn words(&self, _now: Timestamp) -> Words {
        let message = say!(
            "{found} of {wanted} statuses",
            "{found} von {wanted} Status",
            found = self.found,
            wanted = self.wanted
        );
        Words { message, values: vec![("statuses", self.found.to_string())] }
    }
}
