//! Why an operator's action was not done.

use crate::engine::input::Refusal;
use crate::web::http::errors::HttpError;
use crate::web::record::write::NotWritten;
use crate::web::view::Lang;

/// Why an operator's action changed nothing.
#[derive(Debug)]
pub enum NotActed {
    Refused(Vec<Refusal>),
    /// The tap counts no more.
    Invalid(InvalidTap),
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
    pub const fn trouble(&self) -> HttpError {
        match self {
            NotActed::Storage => HttpError::Storage,
            NotActed::Busy => HttpError::Busy,
            NotActed::Refused(_) | NotActed::Invalid(_) | NotActed::Unavailable => HttpError::Unavailable,
        }
    }
}

/// Why a tap counts for nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InvalidTap {
    /// The user who made it has no session any more.
    SessionEnded,
    /// Another operator is in charge.
    NotInCharge,
    /// What it was made for is not as it was shown.
    Stale,
    /// It waited too long, on its way or here.
    Late,
    /// It confirms what was asked for too long ago.
    ConfirmedLate,
}

impl InvalidTap {
    pub fn words(self, lang: Lang) -> String {
        let words = lang.words();
        match self {
            InvalidTap::SessionEnded => HttpError::NoSession.say(lang).1.to_owned(),
            InvalidTap::NotInCharge => words.not_in_charge.to_owned(),
            InvalidTap::Stale => words.refused_stale.to_owned(),
            InvalidTap::Late => words.refused_late.to_owned(),
            InvalidTap::ConfirmedLate => lang.not_pending(true),
        }
    }
}

/// Why a tap is not acknowledged. It changed nothing; a stop that cannot be kept is requested.
#[derive(Debug, Clone)]
pub enum NotDone {
    /// In words.
    Refused(Vec<String>),
    Invalid(InvalidTap),
    HttpError(HttpError),
}
