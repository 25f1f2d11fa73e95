//! Executes a STOP once, although it arrives in two ways. A page sends each tap on STOP over HTTP and over its
//! socket, so that it arrives even if no other connection is possible; both ways get the same answer.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use tokio::sync::OnceCell;

use super::not_done::NotDone;
use super::tap::Tap;
use crate::texts::HttpError;
use telltale_engine::time::{Span, Timestamp};
use telltale_store::Session;

/// Taps that are remembered; the oldest is forgotten for a new one.
const TAPS_MAX: usize = 64;

/// After this no attempt of the same tap is under way: a request under its name is another tap.
const REPEATED_WITHIN: Span = Span::from_secs(10);

type Outcome = Result<(), NotDone>;

/// The last taps on STOP and what became of them.
#[derive(Debug, Default)]
pub struct Stops(Mutex<VecDeque<Tapped>>);

#[derive(Debug)]
struct Tapped {
    session: Session,
    name: Box<str>,
    /// The name counts until then.
    until: Timestamp,
    outcome: Arc<OnceCell<Outcome>>,
}

impl Stops {
    /// Carries out an operator's tap on STOP once. The same tap on the other way waits for the answer to
    /// the first. It is carried out even where the page has gone meanwhile. A tap that failed, or whose request is
    /// held no more, is carried out again.
    pub async fn once(
        &self,
        tap: &Tap,
        name: Box<str>,
        stopping: impl Future<Output = Outcome> + Send + 'static,
    ) -> Outcome {
        let is_held = tap.app.published().snapshot.stop_requested();
        let outcome = self.of(&tap.session, name, tap.app.clock.now(), is_held);
        let done = tokio::spawn(async move { outcome.get_or_init(|| stopping).await.clone() });
        // It ends early only if the whole program does.
        let outcome = done.await.unwrap_or(Err(NotDone::HttpError(HttpError::Unavailable)));
        if matches!(outcome, Err(NotDone::HttpError(HttpError::Unavailable))) {
            // The page sends it again.
            return Err(NotDone::HttpError(HttpError::TooSlow));
        }
        outcome
    }

    /// Forgets all names: a STOP after this is a new one. What begins to set the vehicle in motion says so.
    pub fn forget(&self) {
        self.taps().clear();
    }

    fn of(&self, session: &Session, name: Box<str>, now: Timestamp, is_held: bool) -> Arc<OnceCell<Outcome>> {
        let mut taps = self.taps();
        let known = taps.iter().position(|it| it.session.is(session) && it.name == name);
        if let Some(index) = known {
            let tapped = &taps[index];
            let counts = match tapped.outcome.get() {
                // The other way of this tap is at it.
                None => true,
                Some(done) => done.is_ok() && is_held && now < tapped.until,
            };
            if counts {
                return tapped.outcome.clone();
            }
            taps.remove(index);
        }
        if taps.len() == TAPS_MAX {
            taps.pop_front();
        }
        let (session, until, outcome) = (session.clone(), now + REPEATED_WITHIN, Arc::default());
        taps.push_back(Tapped { session, name, until, outcome: Arc::clone(&outcome) });
        outcome
    }

    fn taps(&self) -> MutexGuard<'_, VecDeque<Tapped>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
