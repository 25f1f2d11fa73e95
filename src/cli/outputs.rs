//! What is published follows from the engine's snapshots, on the topics of the configuration.

use std::sync::Arc;

use tokio::sync::watch;

use crate::clock::Clock;
use crate::config::publishing::Publishing;
use crate::engine::snapshot::Snapshot;
use crate::engine::time::Span;
use crate::ros::publish::outputs;
use crate::ros::publish::outputs::{OutputTopic, Outputs, What};
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
    let snapshots = latest(link.snapshots.clone());
    let (topics, inputs) = (topics(publishing), link.inputs.clone());
    outputs::start(options.clone(), topics, snapshots, inputs, bridge.graph(), clock).await
}

/// The topics of a configuration, as the room that publishes knows them.
pub fn topics(publishing: &Publishing) -> Vec<OutputTopic> {
    let topic = |(key, topic, period): (&str, Option<&str>, Option<Span>)| {
        let beside_others = publishing.beside_others(key);
        Some(OutputTopic { what: What::from_key(key)?, topic: topic?.into(), period, beside_others })
    };
    publishing.all().into_iter().filter_map(topic).collect()
}

/// The snapshots alone, each in the moment it is there.
fn latest(mut published: watch::Receiver<Published>) -> watch::Receiver<Arc<Snapshot>> {
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
