//! A participant that publishes diagnostics and any other topic, as the nodes of a vehicle do.

use std::sync::{Mutex, PoisonError};
use std::time::SystemTime;

use rustdds::bytes::Bytes;
use rustdds::dds::{CreateError, CreateResult};
use rustdds::no_key::DataWriter;
use rustdds::policy::{Durability, History, Reliability};
use rustdds::{DomainParticipant, QosPolicies, QosPolicyBuilder, RTPSEntity, TopicKind};

use super::graph::participant_name;
use super::messages::{self, BOOL, DIAGNOSTIC_ARRAY, GidSize, NodeEntities};
use super::options::BridgeOptions;
use super::peers::{self, Announcer};
use super::raw::RawAdapter;
use super::session::Pulse;
use super::writers::Guid;
use super::{BridgeError, DIAGNOSTICS, presence, session};
use crate::engine::input::StatusArray;

/// Larger arrays travel as several messages: readers of other vendors were seen to lose large ones.
const MESSAGE_BYTES_MAX: usize = 128 << 10;

/// Writing waits for slow readers a tenth of that.
const WRITING_MAX: std::time::Duration = std::time::Duration::from_secs(1);

type Writer = DataWriter<Bytes, RawAdapter>;

#[derive(Debug, thiserror::Error)]
pub enum PublishError {
    #[error("{topic} was not published: {reason}")]
    NotWritten { topic: String, reason: String },
    #[error("{0} is not a topic of this publisher")]
    NoSuchTopic(String),
}

/// How a topic is offered to its readers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quality {
    /// Reliable, volatile.
    Reliable,
    /// Best effort, volatile: as sensors publish.
    BestEffort,
    /// Reliable, transient local: who comes later learns the last value.
    LastValue,
}

/// The writers of one participant of its own.
pub struct Publisher {
    options: BridgeOptions,
    participant: DomainParticipant,
    /// With the name as ROS has it.
    writers: Vec<(Box<str>, Writer)>,
    /// Of the nodes that this participant has, once there were any.
    announcer: Option<Writer>,
    pulse: Mutex<Pulse>,
    /// To the hosts that multicast does not reach.
    peers: Option<Announcer>,
}

impl Publisher {
    /// Offers `/diagnostics` (reliable) and each of `boolean_topics` as `std_msgs/Bool` (its last value).
    ///
    /// # Errors
    /// The interface is not there, or DDS gets no sockets.
    pub async fn open(options: &BridgeOptions, boolean_topics: &[&str]) -> Result<Publisher, BridgeError> {
        let mut publisher = Publisher::empty(options).await?;
        publisher.offer(DIAGNOSTICS, DIAGNOSTIC_ARRAY, Quality::Reliable)?;
        for topic in boolean_topics {
            publisher.offer(topic, BOOL, Quality::LastValue)?;
        }
        Ok(publisher)
    }

    /// Offers nothing yet.
    ///
    /// # Errors
    /// The interface is not there, or DDS gets no sockets.
    pub async fn empty(options: &BridgeOptions) -> Result<Publisher, BridgeError> {
        let participant = session::open(options).await?;
        let peers = peers::announce(&participant, options);
        let (options, writers, pulse) = (options.clone(), Vec::new(), Mutex::default());
        Ok(Publisher { options, participant, writers, announcer: None, pulse, peers })
    }

    /// Offers one more topic of any type, `package/msg/Name`. One that is offered already stays as it is.
    ///
    /// # Errors
    /// The type has no such name, or DDS gets no sockets.
    pub fn offer(&mut self, topic: &str, type_name: &str, quality: Quality) -> Result<(), BridgeError> {
        if self.writer(topic).is_err() {
            let topic = self.options.whole_name(topic);
            let writer = writer(&self.participant, &topic, type_name, quality)
                .map_err(|error| BridgeError::Participant(format!("{topic}: {error}")))?;
            self.writers.push((topic.into(), writer));
        }
        Ok(())
    }

    /// Publishes one message on a topic that is offered: the CDR of its body in little endian, without
    /// the encapsulation, as [`messages::encode`] makes it.
    ///
    /// # Errors
    /// The topic is not offered, or a reader holds the writer back for too long.
    pub async fn publish(&self, topic: &str, mut body: Vec<u8>) -> Result<(), PublishError> {
        let (topic, writer) = self.writer(topic)?;
        // Cyclone DDS drops fragmented messages that are not padded.
        body.resize(body.len().next_multiple_of(4), 0);
        write(writer, body)
            .await
            .map_err(|reason| PublishError::NotWritten { topic: topic.to_owned(), reason })
    }

    /// Publishes the statuses on `/diagnostics`, in as many messages as it takes.
    ///
    /// # Errors
    /// A reader holds the writer back for too long; the rest of the array is dropped.
    pub async fn diagnostics(&self, array: &StatusArray, stamp: SystemTime) -> Result<(), PublishError> {
        self.statuses(DIAGNOSTICS, array, stamp).await
    }

    /// The same on another topic of arrays.
    ///
    /// # Errors
    /// As above, or the topic is not offered.
    pub async fn statuses(
        &self,
        topic: &str,
        array: &StatusArray,
        stamp: SystemTime,
    ) -> Result<(), PublishError> {
        for body in messages::encode_diagnostic_arrays(array, stamp, MESSAGE_BYTES_MAX) {
            self.publish(topic, body).await?;
        }
        Ok(())
    }

    /// Makes announcements possible. Where the threads of the library have ended, a new writer would be
    /// waited for without end: it is made with the participant.
    ///
    /// # Errors
    /// DDS gets no sockets.
    pub fn offer_announcements(&mut self) -> Result<(), BridgeError> {
        let failed = |error| BridgeError::Participant(format!("{}: {error}", presence::TOPIC));
        self.announcer = Some(presence::announcer(&self.participant).map_err(failed)?);
        Ok(())
    }

    /// Announces which nodes of ROS 2 run in this participant, as an rmw does, each with the topics that
    /// it publishes; the last announcement counts. A wrong `size` makes processes of other distributions
    /// throw.
    ///
    /// # Errors
    /// It was not offered, or a reader holds the writer back for too long.
    pub async fn announce(&self, nodes: &[(&str, Vec<&str>)], size: GidSize) -> Result<(), PublishError> {
        let topic = || presence::TOPIC.to_owned();
        let writer = self.announcer.as_ref().ok_or_else(|| PublishError::NoSuchTopic(topic()))?;
        let gid = |topic: &&str| self.writer(topic).ok().map(|(_, writer)| writer.guid().to_bytes());
        let nodes = nodes.iter().map(|(name, topics)| {
            (self.options.whole_name(name), topics.iter().filter_map(gid).collect::<Vec<_>>())
        });
        let nodes: Vec<(String, Vec<Guid>)> = nodes.collect();
        let entities = nodes.iter().map(|(name, writers)| NodeEntities { name, readers: &[], writers });
        let entities: Vec<NodeEntities<'_>> = entities.collect();
        let body = messages::encode_nodes(self.participant.guid().to_bytes(), &entities, size);
        write(writer, body).await.map_err(|reason| PublishError::NotWritten { topic: topic(), reason })
    }

    /// This participant, in hexadecimal digits.
    pub fn participant(&self) -> String {
        participant_name(&self.participant.guid().to_bytes())
    }

    /// The topics that are offered.
    pub fn topics(&self) -> Vec<&str> {
        self.writers.iter().map(|(topic, _)| &**topic).collect()
    }

    /// # Errors
    /// The topic is not offered, or a reader holds the writer back for too long.
    pub async fn boolean(&self, topic: &str, value: bool) -> Result<(), PublishError> {
        self.publish(topic, messages::encode::boolean(value)).await
    }

    fn writer(&self, topic: &str) -> Result<(&str, &Writer), PublishError> {
        let whole = self.options.whole_name(topic);
        let found = self.writers.iter().find(|(known, _)| **known == *whole);
        let (topic, writer) = found.ok_or_else(|| PublishError::NoSuchTopic(topic.to_owned()))?;
        Ok((topic, writer))
    }

    /// Whether a reader is discovered that takes what is offered so on a topic. The library's news of
    /// matches are dropped when four wait, so what it knows is asked for instead.
    pub fn has_reader(&self, topic: &str, type_name: &str, quality: Quality) -> bool {
        let (topic, offered) = (format!("rt{}", self.options.whole_name(topic)), qos(quality));
        let Some(type_name) = messages::dds_type_name(type_name) else { return false };
        self.participant.discovered_readers().iter().any(|found| {
            let reader = &found.subscription_topic_data;
            *reader.topic_name() == topic
                && *reader.type_name() == type_name
                && offered.compliance_failure_wrt(&reader.qos()).is_none()
        })
    }

    /// Whether the threads of the DDS library have ended, as they do when a stopped process goes
    /// on; a new publisher is due then. To be asked every now and then.
    pub fn has_stopped(&self) -> bool {
        self.pulse.lock().unwrap_or_else(PoisonError::into_inner).has_stopped(&self.participant)
    }

    /// Ends the writers, then the participant, and waits for its threads.
    pub async fn shutdown(self) {
        let Publisher { participant, writers, announcer, peers, .. } = self;
        drop((peers, writers, announcer));
        // A panic there was in the library, and the participant is gone either way.
        let _ = session::close(participant).await;
    }
}

/// Writes, unless the library has ended its threads and would never say so.
async fn write(writer: &Writer, body: Vec<u8>) -> Result<(), String> {
    match tokio::time::timeout(WRITING_MAX, writer.async_write(body.into(), None)).await {
        Ok(written) => written.map_err(|error| error.to_string()),
        Err(_) => Err(format!("the DDS library does not answer within {WRITING_MAX:?}")),
    }
}

fn writer(
    participant: &DomainParticipant,
    topic: &str,
    type_name: &str,
    quality: Quality,
) -> CreateResult<Writer> {
    let qos = qos(quality);
    let type_name = messages::dds_type_name(type_name).ok_or_else(|| CreateError::BadParameter {
        reason: format!("{type_name:?} is no package/msg/Name"),
    })?;
    let topic = participant.create_topic(format!("rt{topic}"), type_name, &qos, TopicKind::NoKey)?;
    participant.create_publisher(&qos)?.create_datawriter_no_key(&topic, Some(qos))
}

fn qos(quality: Quality) -> QosPolicies {
    let reliable = Reliability::Reliable { max_blocking_time: rustdds::Duration::from_millis(100) };
    let (reliability, durability, depth) = match quality {
        Quality::Reliable => (reliable, Durability::Volatile, 10),
        Quality::BestEffort => (Reliability::BestEffort, Durability::Volatile, 10),
        Quality::LastValue => (reliable, Durability::TransientLocal, 1),
    };
    QosPolicyBuilder::new()
        .reliability(reliability)
        .durability(durability)
        .history(History::KeepLast { depth })
        .build()
}
