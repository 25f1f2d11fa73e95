//! The graph of ROS 2: our node in it, so that `ros2 node list` shows who reads, and those of others.
//!
//! Nothing is announced before the size of a gid is known: of the wrong size, the announcement
//! makes other processes throw.

use std::collections::BTreeSet;
use std::future::poll_fn;
use std::task::Poll;
use std::time::Duration;

use rustdds::bytes::Bytes;
use rustdds::dds::CreateResult;
use rustdds::no_key::DataWriter;
use rustdds::policy::{Durability, History, Reliability};
use rustdds::{DomainParticipant, QosPolicies, QosPolicyBuilder, RTPSEntity, Subscriber, Topic};
use tokio::sync::watch;
use tokio::time::MissedTickBehavior;

use super::cdr::Endian;
use super::messages::{self, GidSize, NodeEntities, PARTICIPANT_ENTITIES_INFO};
use super::nodes::{self, Nodes};
use super::outbox::stopped;
use super::raw::{RawAdapter, RawBody};
use super::readers::{create_topic, reader_qos};
use super::writers::{Guid, Via};
use crate::clock::Clock;

pub const TOPIC: &str = "ros_discovery_info";

/// Samples of the topic that the library keeps: one for each participant that comes at once.
const DEPTH: usize = 512;
/// How often nodes are forgotten whose participants are gone.
const LOOK: Duration = Duration::from_secs(1);

pub struct Surroundings {
    pub own_readers: watch::Receiver<BTreeSet<Guid>>,
    pub nodes: watch::Sender<Nodes>,
    /// How long a gid is here, as soon as it is known.
    pub gid_size: watch::Sender<Option<GidSize>>,
    pub clock: Clock,
    /// Our own name in the graph.
    pub node: String,
}

/// Announces the node and follows those of others until it is stopped.
pub async fn run(
    participant: DomainParticipant,
    subscriber: Subscriber,
    around: Surroundings,
    mut stop: watch::Receiver<bool>,
) {
    around.nodes.send_replace(Nodes::new(around.clock.now()));
    let (nodes, own_readers) = (&around.nodes, around.own_readers);
    let both = async {
        let topic = discovery_topic(&participant)?;
        tokio::try_join!(
            announce(&participant, &topic, &around.node, around.gid_size.subscribe(), own_readers, nodes),
            listen(&participant, &subscriber, &topic, &around.gid_size, nodes),
        )
    };
    tokio::select! {
        () = stopped(&mut stop) => {}
        done = both => {
            if let Err(error) = done {
                tracing::warn!("nodes cannot be exchanged with ROS 2: {error}");
            }
        }
    }
    around.nodes.send_replace(Nodes::default());
}

/// A writer of announcements, which keeps the last one for who comes later.
///
/// # Errors
/// The library's own.
pub fn announcer(participant: &DomainParticipant) -> CreateResult<DataWriter<Bytes, RawAdapter>> {
    writer(participant, &discovery_topic(participant)?)
}

fn writer(participant: &DomainParticipant, topic: &Topic) -> CreateResult<DataWriter<Bytes, RawAdapter>> {
    participant.create_publisher(&qos())?.create_datawriter_no_key(topic, Some(qos()))
}

async fn announce(
    participant: &DomainParticipant,
    topic: &Topic,
    node: &str,
    mut size: watch::Receiver<Option<GidSize>>,
    mut own_readers: watch::Receiver<BTreeSet<Guid>>,
    nodes: &watch::Sender<Nodes>,
) -> CreateResult<()> {
    // While the threads of the library surely run: without them it would be waited for without end.
    let writer = writer(participant, topic)?;
    let known = size.wait_for(Option::is_some).await.ok().and_then(|size| *size);
    let Some(size) = known else { return Ok(()) };
    loop {
        let readers: Vec<Guid> = own_readers.borrow_and_update().iter().copied().collect();
        let node = NodeEntities { name: node, readers: &readers, writers: &[] };
        let body = messages::encode_nodes(participant.guid().to_bytes(), &[node], size);
        // Whether a participant hears itself is up to the network.
        let own = writer.guid().to_bytes();
        nodes.send_modify(|nodes| nodes.announce(own, &body, Endian::Little, Some(size)));
        if let Err(error) = writer.async_write(body.into(), None).await {
            tracing::warn!("the node was not announced to ROS 2: {error}");
        }
        if own_readers.changed().await.is_err() {
            // Nothing changes any more; the writer keeps the last announcement for who comes later.
            return std::future::pending().await;
        }
    }
}

/// Takes the announcements of other participants; the first tells the size, if it is not known.
async fn listen(
    participant: &DomainParticipant,
    subscriber: &Subscriber,
    topic: &Topic,
    learn: &watch::Sender<Option<GidSize>>,
    nodes: &watch::Sender<Nodes>,
) -> CreateResult<()> {
    let reader = subscriber
        .create_simple_datareader_no_key::<RawBody, RawAdapter>(topic, Some(reader_qos(Via::LastValue)))?;
    let mut looks = tokio::time::interval(LOOK);
    looks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        let next = poll_fn(|context| {
            reader.drain_read_notifications();
            reader.set_waker(Some(context.waker().clone()));
            let next = reader.try_take_one().ok().flatten();
            next.map_or(Poll::Pending, Poll::Ready)
        });
        tokio::select! {
            _ = looks.tick() => {
                let (guids, services) = seen(participant);
                let own = participant.guid().to_bytes();
                nodes.send_modify(|nodes| nodes.update(&own, guids, services));
            }
            change = next => {
                let writer = change.writer_guid.to_bytes();
                let Ok((body, endian)) = change.into_value() else { continue };
                learn.send_if_modified(|size| {
                    let known = size.is_some();
                    *size = size.or_else(|| GidSize::of_message(&body, endian));
                    size.is_some() && !known
                });
                let size = *learn.borrow();
                nodes.send_modify(|nodes| nodes.announce(writer, &body, endian, size));
            }
        }
    }
}

/// The writers of announcements that discovery knows, and the services that somebody serves.
fn seen(participant: &DomainParticipant) -> (BTreeSet<Guid>, BTreeSet<Box<str>>) {
    let (writers, readers) = (participant.discovered_writers(), participant.discovered_readers());
    let writers = writers.iter().map(|found| {
        let data = &found.publication_topic_data;
        (&*data.topic_name, data.key.to_bytes())
    });
    let readers = readers.iter().map(|found| {
        let data = &found.subscription_topic_data;
        (&**data.topic_name(), data.key().to_bytes())
    });
    let announcing = writers.clone().filter(|(topic, _)| *topic == TOPIC).map(|(_, guid)| guid).collect();
    (announcing, nodes::services(readers, writers))
}

fn discovery_topic(participant: &DomainParticipant) -> CreateResult<Topic> {
    // The name has three parts, so it has one on the wire.
    let type_name = messages::dds_type_name(PARTICIPANT_ENTITIES_INFO).unwrap_or_default();
    create_topic(participant, TOPIC, &type_name, DEPTH)
}

/// As every rmw has it.
fn qos() -> QosPolicies {
    QosPolicyBuilder::new()
        .reliability(Reliability::Reliable { max_blocking_time: rustdds::Duration::from_millis(100) })
        .durability(Durability::TransientLocal)
        .history(History::KeepLast { depth: 1 })
        .build()
}
