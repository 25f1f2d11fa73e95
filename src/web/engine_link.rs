//! The link to the engine: its latest snapshot, and its answers to an operator's actions.

use std::time::Duration;

use tokio::sync::oneshot;
use tokio::time::timeout;

use super::AppState;
use crate::engine::input::{OperatorAction, Refusal, Response};
use crate::engine::restart::preview::Preview;
use crate::engine::time::Span;
use crate::runtime::{self, Command, Published, Rehearsal};

/// The engine answers in well under a millisecond; one that takes this long hangs.
const COMMAND_TIMEOUT: Duration = Duration::from_secs(2);

/// Four pulses of the engine.
const ENGINE_SILENT_MAX: Span = Span::from_millis(4 * runtime::PULSE_EVERY.as_millis());

/// The engine does not answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the engine does not answer")]
pub struct NoAnswer;

impl AppState {
    pub fn published(&self) -> Published {
        self.link.snapshots.borrow().clone()
    }

    /// Whether the engine said something lately: it does even when nothing happens. What it said
    /// last is of no worth to a display once it hangs.
    pub fn is_engine_alive(&self) -> bool {
        let snapshots = &self.link.snapshots;
        let silent_since = snapshots.borrow().snapshot.now;
        snapshots.has_changed().is_ok() && self.clock.now().since(silent_since) < ENGINE_SILENT_MAX
    }

    /// Has an operator's action judged, and not done.
    ///
    /// # Errors
    /// If the engine does not answer.
    pub async fn rehearse(&self, action: OperatorAction) -> Result<Result<Preview, Vec<Refusal>>, NoAnswer> {
        let (reply, answer) = oneshot::channel();
        let exchange = async {
            self.link.rehearsals.send(Rehearsal { action, reply }).await.map_err(|_| NoAnswer)?;
            answer.await.map_err(|_| NoAnswer)
        };
        timeout(COMMAND_TIMEOUT, exchange).await.map_err(|_| NoAnswer)?
    }

    /// Hands an operator's action to the engine.
    ///
    /// # Errors
    /// If it does not answer. Nothing has happened then and nothing will; a stop may.
    pub async fn command(&self, action: OperatorAction) -> Result<Response, NoAnswer> {
        let (reply, answer) = oneshot::channel();
        let exchange = async {
            self.link.commands.send(Command { action, reply }).await.map_err(|_| NoAnswer)?;
            answer.await.map_err(|_| NoAnswer)
        };
        timeout(COMMAND_TIMEOUT, exchange).await.map_err(|_| NoAnswer)?
    }
}
