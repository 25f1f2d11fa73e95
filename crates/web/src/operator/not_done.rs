//! Why an operator's action was not done.

use crate::engine_link::NoAnswer;
use crate::http::errors::HttpError;
use crate::view::Lang;
use telltale_engine::input::Refusal;
use telltale_store::StoreError;

/// Why a tap is not acknowledged. It changed nothing; a stop that cannot be recorded is requested.
#[derive(Debug, Clone)]
pub enum NotDone {
    /// The engine refuses it.
    Refused(Vec<Refusal>),
    /// The tap does not count.
    Invalid(InvalidTap),
    HttpError(HttpError),
}

impl From<InvalidTap> for NotDone {
    fn from(invalid: InvalidTap) -> NotDone {
        NotDone::Invalid(invalid)
    }
}

impl From<StoreError> for NotDone {
    fn from(error: StoreError) -> NotDone {
        NotDone::HttpError(error.into())
    }
}

impl From<NoAnswer> for NotDone {
    fn from(error: NoAnswer) -> NotDone {
        tracing::error!(%error, "an action cannot be handed on");
        NotDone::HttpError(HttpError::Unavailable)
    }
}

/// Why a tap does not count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InvalidTap {
    /// The user who made it has no session any more.
    SessionEnded,
    /// Another operator is in charge.
    NotInCharge,
    /// The part of the state that it was made for is not as it was shown.
    Stale,
    /// While the vehicle is cleared or drives, it is for the operator alone.
    ForOperator,
    /// It confirms a request, and the operator tapped STOP since.
    StoppedSince,
    /// It waited too long, on its way or here.
    Late,
    /// It confirms a request that was used, replaced, or made by somebody else.
    NotPending,
    /// It confirms a request that was made too long ago.
    ConfirmedLate,
}

impl InvalidTap {
    pub fn words(self, lang: Lang) -> String {
        let words = lang.words();
        match self {
            InvalidTap::SessionEnded => HttpError::NoSession.say(lang).1.to_owned(),
            InvalidTap::NotInCharge => words.not_in_charge.to_owned(),
            InvalidTap::Stale => words.refused_stale.to_owned(),
            InvalidTap::ForOperator => words.refused_driving.to_owned(),
            InvalidTap::StoppedSince => words.refused_stopped.to_owned(),
            InvalidTap::Late => words.refused_late.to_owned(),
            InvalidTap::NotPending => lang.not_pending(false),
            InvalidTap::ConfirmedLate => lang.not_pending(true),
        }
    }
}
