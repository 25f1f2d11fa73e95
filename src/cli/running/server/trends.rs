//! Keeps the numbers of the modules minute by minute.

use tokio::task::JoinHandle;

use crate::runtime::Link;
use crate::store::{History, MinuteSums};

/// Ends with the engine's task, when the minute that is not over is kept too. A disk that takes its time leaves a gap in
/// the numbers, and holds nobody else up.
pub fn keep(link: &Link, history: History) -> JoinHandle<()> {
    let mut snapshots = link.afterwards.clone();
    tokio::spawn(async move {
        let mut sums = MinuteSums::default();
        while snapshots.changed().await.is_ok() {
            let published = snapshots.borrow_and_update().clone();
            if let Some(minute) = sums.take(&published.snapshot, published.at) {
                history.keep_minute(minute).await;
            }
        }
        if let Some(minute) = sums.end() {
            history.keep_minute(minute).await;
        }
    })
}
