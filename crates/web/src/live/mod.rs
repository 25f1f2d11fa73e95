//! The WebSockets: frames for pages and programs, the budget of incoming bytes, and what each page has
//! shown.

pub(super) mod byte_budget;
pub(super) mod client;
pub(super) mod displays;
pub(super) mod first_changes;
pub mod frame;
pub(super) mod pacing;
pub(super) mod socket;
pub(super) mod stream_query;

use super::AppState;

/// Samples every received number for the small curves of the pages, for as long as the server runs, at the pace of the
/// snapshots.
pub(super) async fn sample_trends(app: AppState) {
    let mut snapshots = app.afterwards().clone();
    while snapshots.changed().await.is_ok() {
        let published = snapshots.borrow_and_update().clone();
        app.trends.sample(&published);
    }
}
