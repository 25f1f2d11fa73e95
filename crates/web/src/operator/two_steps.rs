//! Actions in two steps, because they set the vehicle in motion: requested first, then confirmed.

use std::sync::{Mutex, PoisonError};

use crate::texts::InvalidTap;
use crate::view::versions::Aspect;
use telltale_engine::input::OperatorAction;
use telltale_engine::text::hex;
use telltale_engine::time::{Span, Timestamp};
use telltale_store::Session;
use telltale_store::audit::Action;

/// Later than this a confirmation comes too late.
pub const CONFIRM_WITHIN: Span = Span::from_secs(10);

/// An action that sets the vehicle in motion.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TwoSteps {
    Clearance,
    Release,
}

impl TwoSteps {
    /// The first step, with its record.
    pub const fn request(self, display_live: bool, storage_ok: bool) -> (OperatorAction, Action) {
        match self {
            TwoSteps::Clearance => {
                (OperatorAction::AskClearance { display_live, storage_ok }, Action::ClearanceAsked)
            }
            TwoSteps::Release => {
                (OperatorAction::AskRelease { display_live, storage_ok }, Action::ReleaseAsked)
            }
        }
    }

    /// The second step, with its record.
    pub const fn confirm(self, display_live: bool, storage_ok: bool) -> (OperatorAction, Action) {
        match self {
            TwoSteps::Clearance => (OperatorAction::Clear { display_live, storage_ok }, Action::Clearance),
            TwoSteps::Release => (OperatorAction::Release { display_live, storage_ok }, Action::Release),
        }
    }

    /// The part of the state that both steps are judged by.
    pub const fn aspect(self) -> Aspect {
        match self {
            TwoSteps::Clearance => Aspect::Clearance,
            TwoSteps::Release => Aspect::Release,
        }
    }
}

/// The one request of this vehicle that waits for its confirmation. Another request replaces it.
#[derive(Debug, Default)]
pub struct PendingConfirmation(Mutex<Option<Requested>>);

#[derive(Debug)]
struct Requested {
    steps: TwoSteps,
    token: String,
    session: Session,
    first: FirstStep,
}

/// The first step. The second one names it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FirstStep {
    /// The state of the vehicle that was shown with the request.
    pub version: u64,
    /// The number of the operator's last STOP before it.
    pub last_stop: u64,
    /// Until then it may be confirmed.
    pub until: Timestamp,
}

impl PendingConfirmation {
    /// A new token for the confirmation, good once, for this login alone.
    ///
    /// # Errors
    /// If the operating system gives no random numbers.
    pub fn request(
        &self,
        steps: TwoSteps,
        session: &Session,
        first: FirstStep,
    ) -> Result<String, getrandom::Error> {
        let mut bytes = [0; 16];
        getrandom::fill(&mut bytes)?;
        let token = hex(&bytes);
        let request = Requested { steps, token: token.clone(), session: session.clone(), first };
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(request);
        Ok(token)
    }

    /// Removes the request, also one that is confirmed too late, and returns the first step.
    ///
    /// # Errors
    /// If the token is not that of the request. A foreign token removes nothing.
    pub fn redeem(
        &self,
        steps: TwoSteps,
        token: &str,
        session: &Session,
        now: Timestamp,
    ) -> Result<FirstStep, InvalidTap> {
        let mut pending = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match pending.take_if(|it| it.steps == steps && it.token == token && it.session.is(session)) {
            None => Err(InvalidTap::NotPending),
            Some(request) if now >= request.first.until => Err(InvalidTap::ConfirmedLate),
            Some(request) => Ok(request.first),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use telltale_clock::Clock;
    use telltale_store::{DemoSecrets, Store};

    #[tokio::test]
    async fn a_confirmation_counts_once_and_for_ten_seconds() {
        let store = Store::in_memory(Clock::start(), DemoSecrets::Accepted).unwrap();
        store.add_demo_users().await.unwrap();
        let user = store.authenticate("operator", "246810").await.unwrap().unwrap();
        let (_, session) = store.open_session(&user).await.unwrap();
        let (_, other) = store.open_session(&user).await.unwrap();
        let pending = PendingConfirmation::default();
        let (asks, other_action) = (TwoSteps::Release, TwoSteps::Clearance);
        let asked = Timestamp::from_millis(5_000);
        let first = FirstStep { version: 7, last_stop: 3, until: asked + CONFIRM_WITHIN };
        let cases = [(0, Ok(first)), (9_999, Ok(first)), (10_000, Err(InvalidTap::ConfirmedLate))];
        for (waited_ms, expect) in cases {
            let now = asked + Span::from_millis(waited_ms);
            let token = pending.request(asks, &session, first).unwrap();
            assert_eq!(token.len(), 32);
            assert_eq!(pending.redeem(asks, &token, &other, now), Err(InvalidTap::NotPending));
            assert_eq!(pending.redeem(other_action, &token, &session, now), Err(InvalidTap::NotPending));
            assert_eq!(pending.redeem(asks, "", &session, now), Err(InvalidTap::NotPending));
            assert_eq!(pending.redeem(asks, &token, &session, now), expect, "{waited_ms} ms");
            assert_eq!(pending.redeem(asks, &token, &session, now), Err(InvalidTap::NotPending), "used");
        }
    }
}
