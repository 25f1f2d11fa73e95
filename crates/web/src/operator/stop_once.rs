//! Executes a STOP once, although it arrives in two ways. A page sends each tap on STOP over HTTP and over its
//! socket, so that it arrives even if no other connection is possible; both ways get the same answer.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, PoisonError};

use tokio::sync::OnceCell;

use super::not_done::NotDone;
use crate::texts::HttpError;
use telltale_store::Session;

/// Taps that are remembered; the oldest is forgotten for a new one.
const TAPS_MAX: usize = 64;

type Outcome = Result<(), NotDone>;

/// The last taps on STOP and what became of them.
#[derive(Debug, Default)]
pub struct Stops(Mutex<VecDeque<Tapped>>);

#[derive(Debug)]
struct Tapped {
    session: Session,
    name: Box<str>,
    outcome: Arc<OnceCell<Outcome>>,
}

impl Stops {
    /// Carries out an operator's tap on STOP once. The same tap on the other way waits for the answer to
    /// the first. It is carried out even where the page has gone meanwhile.
    pub async fn once(
        &self,
        session: &Session,
        name: Box<str>,
        stopping: impl Future<Output = Outcome> + Send + 'static,
    ) -> Outcome {
        let outcome = self.of(session, name.clone());
        let done = tokio::spawn(async move { outcome.get_or_init(|| stopping).await.clone() });
        // It ends early only if the whole program does.
        let outcome = done.await.unwrap_or(Err(NotDone::HttpError(HttpError::Unavailable)));
        if matches!(outcome, Err(NotDone::HttpError(HttpError::Unavailable))) {
            self.forget(session, &name);
            // The page sends it again.
            return Err(NotDone::HttpError(HttpError::TooSlow));
        }
        outcome
    }

    /// The engine did not answer: the same tap is tried anew.
    fn forget(&self, session: &Session, name: &str) {
        let mut taps = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        taps.retain(|it| !(it.session.is(session) && *it.name == *name));
    }

    fn of(&self, session: &Session, name: Box<str>) -> Arc<OnceCell<Outcome>> {
        let mut taps = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(tapped) = taps.iter().find(|it| it.session.is(session) && it.name == name) {
            return tapped.outcome.clone();
        }
        if taps.len() == TAPS_MAX {
            taps.pop_front();
        }
        let outcome = Arc::<OnceCell<Outcome>>::default();
        taps.push_back(Tapped { session: session.clone(), name, outcome: outcome.clone() });
        outcome
    }
}
