//! A participant that publishes diagnostics and signals, as the nodes of a vehicle do.

use std::time::SystemTime;

use rustdds::bytes::Bytes;
use rustdds::dds::{CreateError, CreateResult};
use rustdds::no_key::DataWriter;
use rustdds::policy::{Durability, History, Reliability};
use rustdds::{DomainParticipant, QosPolicies, QosPolicyBuilder, TopicKind};

use super::messages::{self, BOOL, DIAGNOSTIC_ARRAY};
use super::options::BridgeOptions;
use super::raw::RawAdapter;
use super::session::Pulse;
use super::{BridgeError, DIAGNOSTICS, session};
use crate::engine::input::StatusArray;

/// Larger arrays travel as several messages: readers of other vendors were seen to lose large ones.
const MESSAGE_BYTES_MAX: usize = 128 << 10;

type Writer = DataWriter<Bytes, RawAdapter>;

#[derive(Debug, thiserror::Error)]
pub enum PublishError {
    #[error("{topic} was not published: {reason}")]
    NotWritten { topic: String, reason: String },
    #[error("{0} is not a topic of this publisher")]
    NoSuchTopic(String),
}

/// The writers of one participant of its own.
pub struct Publisher {
    participant: DomainParticipant,
    diagnostics: Writer,
    /// With the name as ROS has it.
    booleans: Vec<(Box<str>, Writer)>,
    pulse: Pulse,
}

impl Publisher {
    /// Offers `/diagnostics` (reliable, volatile) and each of `boolean_topics` as `std_msgs/Bool`
    /// (reliable, transient local: who comes later learns the last value).
    ///
    /// # Errors
    /// The interface is not there, or DDS gets no sockets.
    pub async fn open(options: &BridgeOptions, boolean_topics: &[&str]) -> Result<Publisher, BridgeError> {
        let participant = session::open(options).await?;
        let refused = |error: CreateError| BridgeError::Participant(error.to_string());
        let diagnostics =
            writer(&participant, DIAGNOSTICS, DIAGNOSTIC_ARRAY, Durability::Volatile).map_err(refused)?;
        let booleans = boolean_topics.iter().map(|&topic| {
            let topic = format!("/{}", topic.trim_start_matches('/'));
            let writer = writer(&participant, &topic, BOOL, Durability::TransientLocal)?;
            Ok((topic.into(), writer))
        });
        let booleans = booleans.collect::<CreateResult<_>>().map_err(refused)?;
        Ok(Publisher { participant, diagnostics, booleans, pulse: Pulse::default() })
    }

    /// Publishes the statuses, in as many messages as it takes.
    ///
    /// # Errors
    /// A reader holds the writer back for too long; the rest of the array is dropped.
    pub async fn diagnostics(&self, array: &StatusArray, stamp: SystemTime) -> Result<(), PublishError> {
        for body in messages::encode_diagnostic_arrays(array, stamp, MESSAGE_BYTES_MAX) {
            write(&self.diagnostics, DIAGNOSTICS, body).await?;
        }
        Ok(())
    }

    /// # Errors
    /// The topic was not named at the start, or a reader holds the writer back for too long.
    pub async fn boolean(&self, topic: &str, value: bool) -> Result<(), PublishError> {
        let bare = topic.trim_start_matches('/');
        let found = self.booleans.iter().find(|(known, _)| known.trim_start_matches('/') == bare);
        let (topic, writer) = found.ok_or_else(|| PublishError::NoSuchTopic(topic.to_owned()))?;
        write(writer, topic, messages::encode_boolean(value)).await
    }

    /// Whether the threads of the DDS library have ended, as they do when a stopped process goes
    /// on; a new publisher is due then. To be asked every now and then.
    pub fn has_stopped(&mut self) -> bool {
        self.pulse.has_stopped(&self.participant)
    }

    /// Ends the writers, then the participant, and waits for its threads.
    pub async fn shutdown(self) {
        let Publisher { participant, diagnostics, booleans, .. } = self;
        drop((diagnostics, booleans));
        // A panic there was in the library, and the participant is gone either way.
        let _ = session::close(participant).await;
    }
}

fn writer(
    participant: &DomainParticipant,
    topic: &str,
    type_name: &str,
    durability: Durability,
) -> CreateResult<Writer> {
    let qos = qos(durability);
    let type_name = messages::dds_type_name(type_name)
        .ok_or_else(|| CreateError::BadParameter { reason: type_name.to_owned() })?;
    let topic = participant.create_topic(format!("rt{topic}"), type_name, &qos, TopicKind::NoKey)?;
    participant.create_publisher(&qos)?.create_datawriter_no_key(&topic, Some(qos))
}

fn qos(durability: Durability) -> QosPolicies {
    let depth = if durability == Durability::Volatile { 10 } else { 1 };
    QosPolicyBuilder::new()
        .reliability(Reliability::Reliable { max_blocking_time: rustdds::Duration::from_millis(100) })
        .durability(durability)
        .history(History::KeepLast { depth })
        .build()
}

async fn write(writer: &Writer, topic: &str, body: Vec<u8>) -> Result<(), PublishError> {
    let written = writer.async_write(body.into(), None).await;
    written.map_err(|error| PublishError::NotWritten { topic: topic.to_owned(), reason: error.to_string() })
}
