//! A clearance after the first of its two steps: requested and not confirmed yet.

use std::sync::{Mutex, PoisonError};

use crate::engine::time::{Span, Timestamp};
use crate::store::Session;

/// Later than this a confirmation comes too late.
pub const CONFIRM_WITHIN: Span = Span::from_secs(10);

/// The one clearance of this vehicle that waits. Who asks again, or somebody else, replaces it.
#[derive(Debug, Default)]
pub struct PendingClearance(Mutex<Option<Asked>>);

#[derive(Debug)]
struct Asked {
    token: String,
    session: Session,
    /// The state of the vehicle that was shown when it was asked for.
    version: u64,
    until: Timestamp,
}

/// Why a confirmation is worth nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NotPending {
    /// It was used, replaced, or belongs to somebody else.
    Unknown,
    TooLate,
}

impl PendingClearance {
    /// A new token, good once, for this login alone.
    ///
    /// # Errors
    /// If the system gives no random numbers.
    pub fn ask(&self, session: &Session, version: u64, now: Timestamp) -> Result<String, getrandom::Error> {
        let mut bytes = [0; 16];
        getrandom::fill(&mut bytes)?;
        let token: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
        let asked =
            Asked { token: token.clone(), session: session.clone(), version, until: now + CONFIRM_WITHIN };
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(asked);
        Ok(token)
    }

    /// Takes the clearance away, whatever becomes of it, and returns the version it was asked for with,
    /// and until when it may be given.
    ///
    /// # Errors
    /// If this token opens nothing. A foreign token takes nothing away.
    pub fn redeem(
        &self,
        token: &str,
        session: &Session,
        now: Timestamp,
    ) -> Result<(u64, Timestamp), NotPending> {
        let mut pending = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let asked = pending.take_if(|asked| asked.token == token && asked.session.is(session));
        match asked {
            None => Err(NotPending::Unknown),
            Some(asked) if now >= asked.until => Err(NotPending::TooLate),
            Some(asked) => Ok((asked.version, asked.until)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::Clock;
    use crate::store::{DemoSecrets, Store};

    #[tokio::test]
    async fn a_confirmation_counts_once_and_for_ten_seconds() {
        let store = Store::in_memory(Clock::start(), DemoSecrets::Accepted).unwrap();
        store.add_demo_users().await.unwrap();
        let user = store.authenticate("operator", "246810").await.unwrap().unwrap();
        let (_, session) = store.open_session(&user).await.unwrap();
        let (_, other) = store.open_session(&user).await.unwrap();
        let pending = PendingClearance::default();
        let granted = Ok((7, Timestamp::from_millis(15_000)));
        let cases = [(0, granted), (9_999, granted), (10_000, Err(NotPending::TooLate))];
        for (waited_ms, expect) in cases {
            let asked = Timestamp::from_millis(5_000);
            let now = asked + Span::from_millis(waited_ms);
            let token = pending.ask(&session, 7, asked).unwrap();
            assert_eq!(token.len(), 32);
            assert_eq!(pending.redeem(&token, &other, now), Err(NotPending::Unknown));
            assert_eq!(pending.redeem("", &session, now), Err(NotPending::Unknown));
            assert_eq!(pending.redeem(&token, &session, now), expect, "{waited_ms} ms");
            assert_eq!(pending.redeem(&token, &session, now), Err(NotPending::Unknown), "used");
        }
    }
}
