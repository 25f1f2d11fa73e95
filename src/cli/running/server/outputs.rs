//! Publishes outputs from the engine's snapshots, on the topics of the configuration.

use std::sync::Arc;

use tokio::sync::watch;

use crate::clock::Clock;
use crate::config::publishing::Publishing;
use crate::engine::model::output::Publication;
use crate::engine::snapshot::Snapshot;
use crate::ros::publish::outputs;
use crate::ros::publish::outputs::{OutputTopic, Outputs, Snapshots};
use crate::ros::{Bridge, BridgeError, BridgeOptions};
use crate::runtime::{Link, Published};

/// # Errors
/// The interface is not there, or DDS gets no sockets.
pub async fn start(
    options: &BridgeOptions,
    publishing: &Publishing,
    link: &Link,
    bridge: &Bridge,
    clock: Clock,
) -> Result<Outputs, BridgeError> {
    let snapshots = Snapshots { vehicle: link.vehicle.clone(), tools: latest(link.afterwards.clone()) };
    let (topics, inputs) = (topics(publishing), link.inputs.clone());
    outputs::start(options.clone(), topics, snapshots, inputs, bridge.graph(), clock).await
}

/// The topics of a configuration, as the types of `ros`.
pub fn topics(publishing: &Publishing) -> Vec<OutputTopic> {
    let topic = |publication| {
        let (topic, period) = publishing.topic(publication)?;
        let beside_others = publishing.beside_others(publication);
        let tree = publishing.tree.clone();
        let level = publishing.log_level();
        Some(OutputTopic { publication, topic: topic.into(), period, beside_others, tree, level })
    };
    Publication::ALL.into_iter().filter_map(topic).collect()
}

/// Forwards the snapshots alone, each at once.
pub(super) fn latest(mut published: watch::Receiver<Published>) -> watch::Receiver<Arc<Snapshot>> {
    let (sender, receiver) = watch::channel(published.borrow_and_update().snapshot.clone());
    tokio::spawn(async move {
        while published.changed().await.is_ok() {
            if sender.send(published.borrow_and_update().snapshot.clone()).is_err() {
                return;
            }
        }
    });
    receiver
}
