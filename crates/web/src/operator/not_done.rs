//! Why an operator's action was not done.

use crate::engine_link::NoAnswer;
use crate::texts::{HttpError, InvalidTap};
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
