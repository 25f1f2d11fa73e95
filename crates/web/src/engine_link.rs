//! Questions to the engine: whether it would do an operator's action, and to do it.

use std::time::Duration;

use tokio::sync::{mpsc, oneshot};
use tokio::time::timeout;

use super::source::Live;
use telltale_engine::input::{OperatorAction, Refusal, Response};
use telltale_engine::restart::preview::Preview;
use telltale_runtime::{Command, Rehearsal};

/// The engine answers in well under a millisecond; one that takes this long hangs.
const COMMAND_TIMEOUT: Duration = Duration::from_secs(2);

/// The engine does not answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("the engine does not answer")]
pub struct NoAnswer;

impl Live {
    /// Asks the engine whether it would do an operator's action, without doing it.
    ///
    /// # Errors
    /// If the engine does not answer.
    pub async fn rehearse(&self, action: OperatorAction) -> Result<Result<Preview, Vec<Refusal>>, NoAnswer> {
        ask(&self.link.rehearsals, |reply| Rehearsal { action, reply }).await
    }

    /// Hands an operator's action to the engine. A second step names the last STOP before its first.
    ///
    /// # Errors
    /// If it does not answer. Nothing has happened then and nothing will; a stop may.
    pub async fn command(
        &self,
        action: OperatorAction,
        last_stop: Option<u64>,
    ) -> Result<Response, NoAnswer> {
        ask(&self.link.commands, |reply| Command { action, last_stop, reply }).await
    }
}

/// Asks the engine, and waits a while for its answer.
async fn ask<Q, A>(
    queue: &mpsc::Sender<Q>,
    question: impl FnOnce(oneshot::Sender<A>) -> Q,
) -> Result<A, NoAnswer> {
    let (reply, answer) = oneshot::channel();
    let exchange = async {
        queue.send(question(reply)).await.map_err(|_| NoAnswer)?;
        answer.await.map_err(|_| NoAnswer)
    };
    timeout(COMMAND_TIMEOUT, exchange).await.map_err(|_| NoAnswer)?
}
