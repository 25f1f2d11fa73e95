//! What simulated machines have in common: their own time, streams of messages, and a drive from stop to stop.

pub(in crate::sim) mod clockwork;
pub(in crate::sim) mod drive;
pub(in crate::sim) mod feed;
pub(in crate::sim) mod obedience;
pub(in crate::sim) mod route;

use crate::engine::model::sample::Pose;
use crate::engine::text::Text;
use crate::engine::time::{Span, Timestamp};
pub use drive::Departure;

/// The step of a machine's own time. Advancing it this often loses nothing.
pub const STEP: Span = Span::from_millis(clockwork::STEP_MS);

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
    pub(in crate::sim) fn new(name: &'static str, title: (&str, &str), about: (&str, &str)) -> FaultInfo {
        let text = |(en, de): (&str, &str)| Text { en: en.into(), de: de.into() };
        FaultInfo { name, title: text(title), about: text(about) }
    }
}
