//! Our node in the graph of ROS 2, so that `ros2 node list` shows who reads.
//!
//! Nothing is announced before the size of a gid is known: of the wrong size, the announcement
//! makes other processes throw.

use std::collections::BTreeSet;
use std::future::poll_fn;
use std::task::Poll;

use rustdds::bytes::Bytes;
use rustdds::dds::CreateResult;
use rustdds::no_key::DataWriter;
use rustdds::policy::{Durability, History, Reliability};
use rustdds::{DomainParticipant, QosPolicies, QosPolicyBuilder, RTPSEntity, Subscriber, Topic, TopicKind};
use tokio::sync::watch;

use super::messages::{self, GidSize, PARTICIPANT_ENTITIES_INFO};
use super::outbox::stopped;
use super::raw::{RawAdapter, RawBody};
use super::writers::Guid;

const NODE: &str = "telltale";

/// Announces the node until it is stopped. Returns the size of a gid, if it is known by then.
pub async fn run(
    participant: DomainParticipant,
    subscriber: Subscriber,
    mut size: Option<GidSize>,
    own_readers: watch::Receiver<BTreeSet<Guid>>,
    mut stop: watch::Receiver<bool>,
) -> Option<GidSize> {
    tokio::select! {
        () = stopped(&mut stop) => {}
        done = announce(&participant, &subscriber, &mut size, own_readers) => {
            if let Err(error) = done {
                tracing::warn!("the node cannot be announced to ROS 2: {error}");
            }
        }
    }
    size
}

async fn announce(
    participant: &DomainParticipant,
    subscriber: &Subscriber,
    size: &mut Option<GidSize>,
    mut own_readers: watch::Receiver<BTreeSet<Guid>>,
) -> CreateResult<()> {
    let topic = discovery_topic(participant)?;
    let size = match *size {
        Some(size) => size,
        None => *size.insert(listen(subscriber, &topic).await?),
    };
    let publisher = participant.create_publisher(&qos())?;
    let writer: DataWriter<Bytes, RawAdapter> = publisher.create_datawriter_no_key(&topic, Some(qos()))?;
    loop {
        let readers: Vec<Guid> = own_readers.borrow_and_update().iter().copied().collect();
        let body = messages::encode_node(participant.guid().to_bytes(), NODE, &readers, size);
        if let Err(error) = writer.async_write(body.into(), None).await {
            tracing::warn!("the node was not announced to ROS 2: {error}");
        }
        if own_readers.changed().await.is_err() {
            return Ok(());
        }
    }
}

/// Waits for another participant whose announcement tells the size.
async fn listen(subscriber: &Subscriber, topic: &Topic) -> CreateResult<GidSize> {
    let reader = subscriber.create_simple_datareader_no_key::<RawBody, RawAdapter>(topic, Some(qos()))?;
    let next = || reader.try_take_one().ok().flatten();
    let size = poll_fn(|context| {
        reader.drain_read_notifications();
        reader.set_waker(Some(context.waker().clone()));
        while let Some(change) = next() {
            let Ok((body, endian)) = change.into_value() else { continue };
            if let Some(size) = GidSize::of_message(&body, endian) {
                return Poll::Ready(size);
            }
        }
        Poll::Pending
    });
    Ok(size.await)
}

fn discovery_topic(participant: &DomainParticipant) -> CreateResult<Topic> {
    // The name has three parts, so it has one on the wire.
    let type_name = messages::dds_type_name(PARTICIPANT_ENTITIES_INFO).unwrap_or_default();
    participant.create_topic("ros_discovery_info".to_owned(), type_name, &qos(), TopicKind::NoKey)
}

/// As every rmw has it.
fn qos() -> QosPolicies {
    QosPolicyBuilder::new()
        .reliability(Reliability::Reliable { max_blocking_time: rustdds::Duration::from_millis(100) })
        .durability(Durability::TransientLocal)
        .history(History::KeepLast { depth: 1 })
        .build()
}
