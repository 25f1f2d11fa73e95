//! The common parts of simulated machines: their own time, streams of messages, and a drive from stop to stop.

pub(crate) mod drive;
pub(crate) mod feed;
pub(crate) mod obedience;
pub(crate) mod route;

pub use drive::Departure;
use telltale_engine::model::sample::Pose;
use telltale_engine::text::Text;
use telltale_engine::time::{Span, Timestamp};

pub(crate) const STEP_MS: u64 = 10;
/// The step of a machine's own time. Advancing it this often loses nothing.
pub const STEP: Span = Span::from_millis(STEP_MS);

/// A message of a node and its time, which is the stamp of its header, if it has one, unless the message says
/// otherwise.
#[derive(Debug, Clone, PartialEq)]
pub struct Sent<M> {
    pub at: Timestamp,
    pub message: M,
}

/// An order to a machine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Order {
    /// The operator says that it stands about there.
    Localize(Pose),
    /// Whether it may drive to its goal.
    Clear(bool),
    /// A request to slow down by so many m/s².
    Decelerate(f64),
    /// Whether a safe stop is requested.
    Stop(bool),
    /// Whether it must stand until it is released. A value of false is the release.
    Hold(bool),
}

/// A fault that can be switched on and off.
#[derive(Debug, Clone, PartialEq)]
pub struct FaultInfo {
    /// The word on the command line and in the demo's form.
    pub name: &'static str,
    pub title: Text,
    /// Its effect, in one line for people.
    pub about: Text,
}

impl FaultInfo {
    /// Its name, and title and effect in English and German.
    pub(crate) fn new(name: &'static str, title: (&str, &str), about: (&str, &str)) -> FaultInfo {
        let text = |(en, de): (&str, &str)| Text { en: en.into(), de: de.into() };
        FaultInfo { name, title: text(title), about: text(about) }
    }
}

/// The longest time that one call catches up: a process that was stopped does not flood the bus.
const CATCH_UP_STEPS: u64 = 500;

/// A machine's own time: it runs in steps, and catches up where nobody looked for a while.
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
