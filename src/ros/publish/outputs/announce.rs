//! The node of what is published. It has a name of its own: tools look an endpoint up among the nodes
//! that its own participant announces, and warn of two participants with one name.

use std::sync::Arc;

use tokio::sync::watch;

use crate::msg::messages::GidSize;
use crate::ros::Publisher;
use crate::ros::outbox::stopped;

/// Announces it as soon as it is known how long a gid is; the writer keeps that for who comes later.
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
