//! Announces the node of the outputs. It has a name of its own: tools look an endpoint up among the nodes
//! of its own participant, and warn of two participants with one name.

use std::sync::Arc;

use tokio::sync::watch;

use crate::Publisher;
use crate::outbox::stopped;
use telltale_msg::messages::GidSize;

/// Announces the node as soon as the size of a gid is known; the writer keeps the announcement for late
/// joiners.
pub async fn run(
    publisher: Arc<Publisher>,
    node: String,
    mut gid_size: watch::Receiver<Option<GidSize>>,
    mut end: watch::Receiver<bool>,
) {
    let known = tokio::select! {
        () = stopped(&mut end) => return,
        known = gid_size.wait_for(Option::is_some) => known.ok().and_then(|size| *size),
    };
    let Some(size) = known else { return };
    if let Err(error) = publisher.announce(&[(&node, publisher.topics())], size).await {
        tracing::warn!("the node {node} was not announced to ROS 2: {error}");
    }
}
