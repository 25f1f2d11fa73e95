//! A machine's own time: it runs in steps, and catches up where nobody looked for a while.

use super::{STEP, Sent};
use telltale_engine::time::{Span, Timestamp};

pub(crate) const STEP_MS: u64 = 10;

/// The longest time that one call catches up: a process that was stopped does not flood the bus.
const CATCH_UP_STEPS: u64 = 500;

#[derive(Debug, Clone)]
pub(crate) struct Clockwork {
    /// When the next step is due.
    due: Timestamp,
}

impl Clockwork {
    pub fn new(start: Timestamp) -> Clockwork {
        Clockwork { due: start + STEP }
    }

    /// Runs the steps until `now` and returns the messages published meanwhile, in order. Of more than five
    /// seconds, only the last five happen.
    pub fn advance<M>(&mut self, now: Timestamp, mut step: impl FnMut(&mut dyn FnMut(M))) -> Vec<Sent<M>> {
        let backlog = now.since(self.due).as_nanos() / STEP.as_nanos();
        if backlog > CATCH_UP_STEPS {
            let skipped = Span::from_millis((backlog - CATCH_UP_STEPS) * STEP_MS);
            self.due = self.due + skipped;
        }
        let mut sent = Vec::new();
        while self.due <= now {
            let at = self.due;
            step(&mut |message| sent.push(Sent { at, message }));
            self.due = self.due + STEP;
        }
        sent
    }
}
