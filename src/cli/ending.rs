//! When to end: the first SIGINT or SIGTERM asks for it, a second one takes no more patience.

use anyhow::Context as _;
use tokio::signal::unix::{Signal, SignalKind, signal};

/// Listens for the signals that ask a program to end.
pub struct Ending {
    interrupt: Signal,
    terminate: Signal,
}

impl Ending {
    /// # Errors
    /// If the operating system refuses the handlers.
    pub fn listen() -> anyhow::Result<Ending> {
        let refused = "signals cannot be handled";
        Ok(Ending {
            interrupt: signal(SignalKind::interrupt()).context(refused)?,
            terminate: signal(SignalKind::terminate()).context(refused)?,
        })
    }

    /// Waits for the next of them.
    pub async fn asked(&mut self) {
        tokio::select! {
            _ = self.interrupt.recv() => {}
            _ = self.terminate.recv() => {}
        }
    }
}
