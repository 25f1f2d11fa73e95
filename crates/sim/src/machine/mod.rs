//! What simulated machines have in common: their own time, streams of messages, and a drive from stop to stop.

pub(crate) mod clockwork;
pub(crate) mod drive;
pub(crate) mod feed;
pub(crate) mod obedience;
pub(crate) mod route;

pub use drive::Departure;
use telltale_engine::model::sample::Pose;
use telltale_engine::text::Text;
use telltale_engine::time::{Span, Timestamp};

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
    pub(crate) fn new(name: &'static str, title: (&str, &str), about: (&str, &str)) -> FaultInfo {
        let text = |(en, de): (&str, &str)| Text { en: en.into(), de: de.into() };
        FaultInfo { name, title: text(title), about: text(about) }
    }
}
