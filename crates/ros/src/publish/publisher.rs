//! A participant that publishes diagnostics and any other topic, as the nodes of a vehicle do.

use crate::transport::NODES_TOPIC;
use crate::transport::ids::participant_name;
use crate::transport::{Participant, Quality, Writer};
use std::future::poll_fn;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::SystemTime;

use bytes::Bytes;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;

use crate::discovery::peers::{self, Announcer};
use crate::discovery::presence;
use crate::options::BridgeOptions;
use crate::transport::quality::Via;
use crate::{BridgeError, DIAGNOSTICS};
use telltale_clock::Clock;
use telltale_engine::input::{Input, StatusArray};
use telltale_msg::cdr::Endian;
use telltale_msg::messages::{self, BOOL, DIAGNOSTIC_ARRAY, GidSize, NodeEntities};
use telltale_msg::received::{Message, Stamped};
use telltale_msg::sample_bytes::Guid;

/// Larger arrays are sent as several messages: readers of other vendors were seen to lose large ones.
const MESSAGE_BYTES_MAX: usize = 128 << 10;

#[derive(Debug, thiserror::Error)]
pub enum PublishError {
    #[error("{topic} was not published: {reason}")]
    NotWritten { topic: String, reason: String },
    #[error("{0} is not a topic of this publisher")]
    NoSuchTopic(String),
}

/// The writers of one participant.
pub struct Publisher {
    options: BridgeOptions,
    participant: Participant,
    writers: Vec<Offered>,
    subscribed: Vec<Subscribed>,
    /// They take what comes for the readers, and drop it.
    draining: JoinSet<()>,
    /// Takes a copy of each published message, for recordings.
    copies: Option<(mpsc::Sender<Stamped>, Clock)>,
    /// For the nodes of this participant, once it had any.
    announcer: Option<Writer>,
    /// Announces the participant to hosts that multicast does not reach.
    peers: Option<Announcer>,
}

/// A topic to which a node of this participant is subscribed.
struct Subscribed {
    node: Box<str>,
    guid: watch::Receiver<Option<Guid>>,
}

/// A topic that is offered.
struct Offered {
    /// Its ROS name.
    topic: Arc<str>,
    type_name: Arc<str>,
    writer: Writer,
    /// How many messages were published.
    written: AtomicI64,
    /// Late readers get the last one.
    kept: bool,
}

impl Subscribed {
    /// `None` if the participant has ended before the reader was made.
    async fn guid(&self) -> Option<Guid> {
        let mut guid = self.guid.clone();
        guid.wait_for(Option::is_some).await.ok().and_then(|guid| *guid)
    }
}

impl Publisher {
    /// Offers `/diagnostics` (reliable) and each of `boolean_topics` as `std_msgs/Bool` (with the last
    /// value).
    ///
    /// # Errors
    /// The interface does not exist, or DDS gets no sockets.
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
    /// The interface does not exist, or DDS gets no sockets.
    pub async fn empty(options: &BridgeOptions) -> Result<Publisher, BridgeError> {
        let participant = Participant::open(options).await?;
        let peers = peers::announce(&participant, options);
        let (options, writers) = (options.clone(), Vec::new());
        let (subscribed, draining) = (Vec::new(), JoinSet::new());
        Ok(Publisher {
            options,
            participant,
            writers,
            subscribed,
            draining,
            copies: None,
            announcer: None,
            peers,
        })
    }

    /// Sends a copy of each published message to the engine too, as a tick, so that it is recorded. A full queue
    /// loses the copy.
    pub fn record(&mut self, inputs: mpsc::Sender<Stamped>, clock: Clock) {
        self.copies = Some((inputs, clock));
    }

    /// Offers one more topic of any type, `package/msg/Name`. A topic that is already offered does not
    /// change.
    ///
    /// # Errors
    /// No type has such a name.
    pub fn offer(&mut self, topic: &str, type_name: &str, quality: Quality) -> Result<(), BridgeError> {
        if self.offered(topic).is_err() {
            let topic = self.options.whole_name(topic);
            let dds_type = messages::dds_type_name(type_name).ok_or_else(|| {
                BridgeError::Participant(format!("{topic}: {type_name:?} is no package/msg/Name"))
            })?;
            let writer = self.participant.writer(&format!("rt{topic}"), &dds_type, quality);
            let (topic, type_name) = (topic.into(), type_name.into());
            self.writers.push(Offered {
                topic,
                type_name,
                writer,
                written: AtomicI64::new(0),
                kept: quality == Quality::LastValue,
            });
        }
        Ok(())
    }

    /// Publishes one message on an offered topic: the CDR of its body in little endian, without the
    /// encapsulation, as [`messages::encode`] makes it.
    ///
    /// # Errors
    /// The topic is not offered, or a reader holds the writer back for too long.
    pub async fn publish(&self, topic: &str, mut body: Vec<u8>) -> Result<(), PublishError> {
        let offered = self.offered(topic)?;
        // Cyclone DDS drops fragmented messages that are not padded.
        body.resize(body.len().next_multiple_of(4), 0);
        let copy = self.copies.as_ref().map(|copies| (copies, copies.1.wall(), Bytes::from(body.clone())));
        let written = offered.writer.write(body).await;
        // The library numbers what it takes, whether or not a reader holds it back.
        let sequence = offered.written.fetch_add(1, Ordering::Relaxed) + 1;
        if let (Some(((inputs, clock), stamp, body)), Ok(())) = (copy, &written) {
            let message = Message {
                topic: offered.topic.clone(),
                type_name: offered.type_name.clone(),
                writer: offered.writer.guid().await,
                sequence,
                source: Some(stamp),
                received: clock.wall(),
                body: Ok((body, Endian::Little)),
                left_out: 0,
                kept: offered.kept,
            };
            let message = Some(Arc::new(message));
            // A recording can do without one of them, a vehicle cannot wait.
            let _ = inputs.try_send(Stamped { input: Input::Tick, received: clock.now(), message });
        }
        written.map_err(|reason| PublishError::NotWritten { topic: topic.to_owned(), reason })
    }

    /// Publishes the statuses on `/diagnostics`, in as many messages as needed.
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

    /// Subscribes a node of this participant to a topic, so that the graph of ROS 2 shows it. What comes is dropped.
    ///
    /// # Errors
    /// No type has such a name.
    pub fn subscribe(&mut self, node: &str, topic: &str, type_name: &str) -> Result<(), BridgeError> {
        let topic = self.options.whole_name(topic);
        let dds_type = messages::dds_type_name(type_name).ok_or_else(|| {
            BridgeError::Participant(format!("{topic}: {type_name:?} is no package/msg/Name"))
        })?;
        let mut reader = self.participant.reader(&format!("rt{topic}"), &dds_type, Via::BestEffort, 1);
        let (made, guid) = watch::channel(None);
        self.subscribed.push(Subscribed { node: node.into(), guid });
        self.draining.spawn(async move {
            made.send_replace(Some(reader.guid().await));
            loop {
                drop(poll_fn(|context| reader.poll(context)).await);
            }
        });
        Ok(())
    }

    /// Makes announcements possible.
    pub fn offer_announcements(&mut self) {
        self.announcer = Some(presence::announcer(&self.participant));
    }

    /// Announces the ROS 2 nodes of this participant, as an rmw does, each with the topics that it
    /// publishes, and with those to which it is subscribed; the last announcement counts. A wrong `size` makes processes of other distributions
    /// throw.
    ///
    /// # Errors
    /// It was not offered, or a reader holds the writer back for too long.
    pub async fn announce(&self, nodes: &[(&str, Vec<&str>)], size: GidSize) -> Result<(), PublishError> {
        let topic = || NODES_TOPIC.to_owned();
        let writer = self.announcer.as_ref().ok_or_else(|| PublishError::NoSuchTopic(topic()))?;
        let mut whole: Vec<(String, Vec<Guid>, Vec<Guid>)> = Vec::with_capacity(nodes.len());
        for (name, topics) in nodes {
            let mut gids = Vec::with_capacity(topics.len());
            for topic in topics {
                if let Ok(offered) = self.offered(topic) {
                    gids.push(offered.writer.guid().await);
                }
            }
            let mut readers = Vec::new();
            for subscribed in self.subscribed.iter().filter(|subscribed| *subscribed.node == **name) {
                readers.extend(subscribed.guid().await);
            }
            whole.push((self.options.whole_name(name), readers, gids));
        }
        let entities = whole.iter().map(|(name, readers, writers)| NodeEntities { name, readers, writers });
        let entities: Vec<NodeEntities<'_>> = entities.collect();
        let body = messages::encode_nodes(self.participant.guid(), &entities, size);
        writer.write(body).await.map_err(|reason| PublishError::NotWritten { topic: topic(), reason })
    }

    /// This participant, in hexadecimal digits.
    pub fn participant(&self) -> String {
        participant_name(&self.participant.guid())
    }

    /// The topics that are offered.
    pub fn topics(&self) -> Vec<&str> {
        self.writers.iter().map(|offered| &*offered.topic).collect()
    }

    /// # Errors
    /// The topic is not offered, or a reader holds the writer back for too long.
    pub async fn boolean(&self, topic: &str, value: bool) -> Result<(), PublishError> {
        self.publish(topic, messages::encode::boolean(value)).await
    }

    fn offered(&self, topic: &str) -> Result<&Offered, PublishError> {
        let whole = self.options.whole_name(topic);
        let found = self.writers.iter().find(|offered| *offered.topic == *whole);
        found.ok_or_else(|| PublishError::NoSuchTopic(topic.to_owned()))
    }

    /// Whether a reader is discovered that accepts this offer on a topic.
    pub fn has_reader(&self, topic: &str, type_name: &str, quality: Quality) -> bool {
        let topic = format!("rt{}", self.options.whole_name(topic));
        let Some(type_name) = messages::dds_type_name(type_name) else { return false };
        let seen = self.participant.seen();
        seen.readers_of(&topic).any(|reader| reader.type_name == type_name && reader.takes(quality))
    }

    /// Whether the participant is unusable: its process was ill or has died. Then a new publisher is due.
    pub fn has_stopped(&self) -> bool {
        self.participant.has_ended()
    }

    /// Waits until the participant is unusable, and returns the reason.
    pub async fn stopped(&self) -> Box<str> {
        self.participant.ended().await.reason
    }

    /// Ends the writers, then the participant, and waits for its threads.
    pub async fn shutdown(self) {
        let Publisher { participant, writers, announcer, peers, mut draining, .. } = self;
        drop((peers, writers, announcer));
        draining.shutdown().await;
        participant.close().await;
    }
}
