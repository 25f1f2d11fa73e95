//! Samples every received number, for the small curves of the pages.

use crate::AppState;

/// Runs for as long as the server does, at the pace of the snapshots.
pub async fn watch(app: AppState) {
    let mut snapshots = app.afterwards().clone();
    while snapshots.changed().await.is_ok() {
        let published = snapshots.borrow_and_update().clone();
        app.trends.sample(&published);
    }
}
