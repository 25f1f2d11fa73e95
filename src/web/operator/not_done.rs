//! Why an operator's action was not done.

use crate::engine::input::Refusal;
use crate::web::http::errors::Trouble;
use crate::web::record::write::NotWritten;
use crate::web::view::Lang;

/// Why an operator's action changed nothing.
#[derive(Debug)]
pub enum NotActed {
    Refused(Vec<Refusal>),
    /// What it was asked for with counts no more.
    Void(Void),
    /// It cannot be written down.
    Storage,
    /// Too many wait already.
    Busy,
    /// The engine or the store does not answer.
    Unavailable,
}

impl From<NotWritten> for NotActed {
    fn from(not_written: NotWritten) -> NotActed {
        match not_written {
            NotWritten::Storage => NotActed::Storage,
            NotWritten::Unavailable => NotActed::Unavailable,
        }
    }
}

impl NotActed {
    /// What is answered where there are no reasons to name.
    pub const fn trouble(&self) -> Trouble {
        match self {
            NotActed::Storage => Trouble::Storage,
            NotActed::Busy => Trouble::Busy,
            NotActed::Refused(_) | NotActed::Void(_) | NotActed::Unavailable => Trouble::Unavailable,
        }
    }
}

/// Why a tap counts for nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Void {
    /// The user who made it has no session any more.
    SessionEnded,
    /// Somebody else leads the vehicle.
    NotSeated,
    /// What it was made for is not as it was shown.
    Stale,
    /// It waited too long, on its way or here.
    Late,
    /// It confirms what was asked for too long ago.
    ConfirmedLate,
}

impl Void {
    pub fn words(self, lang: Lang) -> String {
        let words = lang.words();
        match self {
            Void::SessionEnded => Trouble::NoSession.say(lang).1.to_owned(),
            Void::NotSeated => words.not_in_seat.to_owned(),
            Void::Stale => words.refused_stale.to_owned(),
            Void::Late => words.refused_late.to_owned(),
            Void::ConfirmedLate => lang.not_pending(true),
        }
    }
}

/// Why a tap is not acknowledged. It changed nothing; a stop that cannot be kept is requested.
#[derive(Debug, Clone)]
pub enum NotDone {
    /// In words.
    Refused(Vec<String>),
    Void(Void),
    Trouble(Trouble),
}
