//! A handle that ends the engine's task; its clones end the same one.

use std::sync::Arc;

use tokio::sync::Notify;

/// Ends the engine's task, also while links to it are held. Clones end the same one.
#[derive(Debug, Clone, Default)]
pub struct Ending(Arc<Notify>);

impl Ending {
    /// The followers are still told of all that happened. An engine that has ended stays so.
    pub fn end(&self) {
        self.0.notify_one();
    }

    pub(super) async fn asked(&self) {
        self.0.notified().await;
    }
}
