//! The DDS library in its process: the only place that touches it.

use std::collections::BTreeMap;
use std::future::poll_fn;
use std::net::Ipv4Addr;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use futures_util::StreamExt as _;
use rustdds::{
    DomainParticipant, DomainParticipantBuilder, GUID, QosPolicyBuilder, RTPSEntity as _, SampleIdentity,
    SequenceNumber, StatusEvented as _, Subscriber, Topic, WriteOptionsBuilder,
};
use tokio::task::JoinSet;

use super::busy_discovery::BusyDiscovery;
use super::discovered;
use super::echo_check::EchoCheck;
use super::losses::Losses;
use super::open_readers::{OpenReader, OpenReaders};
use super::qos::{self, RawWriter};
use super::relief::Relief;
use crate::every;
use crate::transport::parent::{Orders, ToParent, next};
use crate::transport::wire::{self, FromChild, Order};
use crate::transport::{BEAT, SampleId, WRITING_MAX};
use telltale_clock::Clock;
use telltale_engine::time::{Span, Timestamp};

/// How often it repeats a beat that has not come back.
const AGAIN: Duration = Duration::from_millis(25);
/// The shortest and the longest time between two looks at the discovered endpoints.
const LOOK_MIN: Span = Span::from_millis(5);
const LOOK_MAX: Span = Span::from_secs(1);
/// The same after endpoints were missing at a look.
const LOOK_AGAIN: Span = Span::from_millis(50);
/// The time that the library has to end its threads.
const ENDING: Duration = Duration::from_secs(1);

/// Makes a participant on these interfaces, or on all, and executes orders until the program ends it.
///
/// # Errors
/// The library can no longer be used.
pub async fn run(
    domain: u16,
    interfaces: Option<Vec<Ipv4Addr>>,
    first: Vec<Order>,
    orders: &mut Orders,
    out: &mut ToParent,
) -> Result<(), String> {
    let mut child = Child::open(domain, interfaces, out).await?;
    let ended = child.run(first, orders, out).await;
    child.close().await;
    ended
}

struct Child {
    participant: DomainParticipant,
    subscriber: Subscriber,
    topics: BTreeMap<(String, String), Topic>,
    open_readers: OpenReaders,
    losses: Losses,
    writers: BTreeMap<u32, Arc<RawWriter>>,
    writing: JoinSet<(u32, Option<String>)>,
    echo_check: EchoCheck,
    busy_discovery: BusyDiscovery,
    relief: Relief,
}

pub fn refused(error: impl std::fmt::Display) -> String {
    format!("the DDS library refused a reader or writer: {error}")
}

impl Child {
    async fn open(domain: u16, networks: Option<Vec<Ipv4Addr>>, out: &mut ToParent) -> Result<Child, String> {
        let mut builder = DomainParticipantBuilder::new(domain);
        if let Some(addresses) = networks {
            builder = builder.with_only_networks(addresses);
        }
        let participant = builder.build().map_err(|error| error.to_string())?;
        let subscriber = participant.create_subscriber(&QosPolicyBuilder::new().build()).map_err(refused)?;
        let echo_check = EchoCheck::open(&participant, &subscriber)?;
        let (guid, id) = (participant.guid().to_bytes(), participant.participant_id());
        out.frame.news(&FromChild::Ready { guid, participant: id });
        out.send().await?;
        Ok(Child {
            participant,
            subscriber,
            topics: BTreeMap::new(),
            open_readers: OpenReaders::default(),
            losses: Losses::default(),
            writers: BTreeMap::new(),
            writing: JoinSet::new(),
            echo_check,
            busy_discovery: BusyDiscovery::of_this_process(),
            relief: Relief::of_this_process(),
        })
    }

    async fn run(
        &mut self,
        first: Vec<Order>,
        orders: &mut Orders,
        out: &mut ToParent,
    ) -> Result<(), String> {
        self.obey_all(first, out)?;
        let listener = self.participant.clone();
        let listener = listener.status_listener();
        let mut events = listener.as_async_status_stream();
        let mut again = every(AGAIN);
        let mut beats = every(BEAT);
        let clock = Clock::start();
        let mut looked = clock.now();
        let mut look_at = looked;
        loop {
            tokio::select! {
                orders = next(orders) => match orders {
                    Some(orders) if !orders.contains(&Order::Close) => self.obey_all(orders, out)?,
                    _ => return Ok(()),
                },
                Some(done) = self.writing.join_next() => {
                    let (number, error) = done.map_err(|panic| panic.to_string())?;
                    match number {
                        0 => self.echo_check.writing = false,
                        _ => out.frame.news(&FromChild::Written { number, error }),
                    }
                }
                Some(event) = events.next() => {
                    self.busy_discovery.hear(&event);
                    if let Some((participant, change)) = self.losses.hear(&event) {
                        out.frame.news(&FromChild::Participant { participant, change });
                    }
                    look_at = look_at.min(looked + LOOK_MIN);
                }
                () = tokio::time::sleep_until(clock.instant(look_at).into()) => {
                    let started = clock.now();
                    self.tell_discovered(out)?;
                    // A large graph is looked at less often than it changes.
                    let now = clock.now();
                    looked = now + Span::from_nanos(4 * now.since(started).as_nanos());
                    look_at = looked + if self.losses.is_looking() { LOOK_AGAIN } else { LOOK_MAX };
                }
                // The return value says nothing: in a flood single beats are lost.
                _ = again.tick(), if self.echo_check.is_late() => self.speak(),
                _ = beats.tick() => {
                    self.ask(clock.now())?;
                    self.relieve(clock.now(), out)?;
                    self.beat(out);
                }
                taken = poll_fn(|context| self.open_readers.poll(context, &mut out.samples)) => {
                    if taken? {
                        self.tell_discovered(out)?;
                    }
                }
            }
            out.send().await?;
        }
    }

    fn obey_all(&mut self, orders: Vec<Order>, out: &mut ToParent) -> Result<(), String> {
        orders.into_iter().try_for_each(|order| self.obey(order, out))
    }

    fn obey(&mut self, order: Order, out: &mut ToParent) -> Result<(), String> {
        match order {
            Order::Reader { id, topic, type_name, via, depth } => {
                self.open_readers.told.ours.insert(topic.clone());
                let topic = self.topic(topic, type_name, depth as usize)?;
                let reader = qos::reader(&self.subscriber, &topic, via).map_err(refused)?;
                out.frame.news(&FromChild::Made { id, guid: reader.guid().to_bytes() });
                self.open_readers.readers.push(OpenReader::new(id, reader, topic, via));
            }
            Order::EndReader { id } => self.open_readers.readers.retain(|known| known.id != id),
            Order::Taken { id, bytes } => {
                if let Some(known) = self.open_readers.readers.iter_mut().find(|known| known.id == id) {
                    known.in_flight = known.in_flight.saturating_sub(bytes as usize);
                }
            }
            Order::Deepen { topic, type_name, depth } => {
                qos::create_topic(&self.participant, &topic, &type_name, depth as usize).map_err(refused)?;
            }
            Order::Writer { id, topic, type_name, quality } => {
                self.open_readers.told.ours.insert(topic.clone());
                let topic = qos::offered_topic(&self.participant, &topic, &type_name, quality);
                let writer = topic.and_then(|topic| qos::writer(&self.participant, &topic, quality));
                let writer = writer.map_err(refused)?;
                out.frame.news(&FromChild::Made { id, guid: writer.guid().to_bytes() });
                self.writers.insert(id, Arc::new(writer));
            }
            Order::Write { id, number, related, body } => {
                if let Some(writer) = self.writers.get(&id) {
                    self.writing.spawn(write(writer.clone(), number, body, related));
                }
            }
            Order::Forget { participant } => self.losses.forget(&participant),
            Order::FollowFirst { topic } => drop(self.open_readers.told.ours.insert(topic)),
            Order::Open(_) | Order::Close => {}
        }
        Ok(())
    }

    fn topic(&mut self, name: String, type_name: String, depth: usize) -> Result<Topic, String> {
        let key = (name, type_name);
        if let Some(known) = self.topics.get(&key) {
            return Ok(known.clone());
        }
        let topic = qos::create_topic(&self.participant, &key.0, &key.1, depth).map_err(refused)?;
        self.topics.insert(key, topic.clone());
        Ok(topic)
    }

    /// Reports endpoints that are gone, new or have changed.
    fn tell_discovered(&mut self, out: &mut ToParent) -> Result<(), String> {
        let mut now = discovered::all(&self.participant);
        let OpenReaders { told, unknown, .. } = &mut self.open_readers;
        self.losses.look(&told.endpoints, &mut now);
        if told.tell(now, 0, &mut out.frame)? {
            unknown.clear();
        }
        Ok(())
    }

    /// If the library's discovery thread has ended, it takes no orders. This order affects only writers
    /// that must assert their own liveliness, and there are none.
    fn ask(&mut self, now: Timestamp) -> Result<(), String> {
        if self.participant.assert_liveliness().is_err() {
            return Err("the threads of the DDS library have ended".to_owned());
        }
        if self.busy_discovery.is_too_much(now) {
            return Err("more participants were announced than it can look at".to_owned());
        }
        Ok(())
    }

    /// Gives back the memory of incomplete samples before the process is too large. On a line that loses packets they
    /// would fill it within seconds.
    fn relieve(&mut self, now: Timestamp, out: &mut ToParent) -> Result<(), String> {
        let mut replaced = self.open_readers.end_overlaps(now, &mut out.samples)?;
        if self.relief.is_due(now) {
            replaced.extend(self.open_readers.drop_fragments(&self.subscriber, now)?);
        }
        for (id, guid) in replaced {
            out.frame.news(&FromChild::Made { id, guid });
        }
        Ok(())
    }

    fn beat(&mut self, out: &mut ToParent) {
        self.echo_check.said += 1;
        self.speak();
        out.frame.news(&FromChild::Beat { heard: self.echo_check.heard });
    }

    fn speak(&mut self) {
        self.echo_check.listen();
        if !std::mem::replace(&mut self.echo_check.writing, true) {
            let beat = Bytes::copy_from_slice(&self.echo_check.said.to_le_bytes());
            self.writing.spawn(write(self.echo_check.writer.clone(), 0, beat, None));
        }
    }

    /// Readers and writers are dropped first, because they hold the participant.
    async fn close(self) {
        let Child { participant, subscriber, topics, open_readers, writers, mut writing, echo_check, .. } =
            self;
        writing.shutdown().await;
        drop((open_readers, writers, echo_check, topics, subscriber));
        let closed = tokio::task::spawn_blocking(move || drop(participant));
        let _ = tokio::time::timeout(ENDING, closed).await;
    }
}

/// Writes. The library would never report that its threads have ended.
async fn write(
    writer: Arc<RawWriter>,
    number: u32,
    body: Bytes,
    related: Option<SampleId>,
) -> (u32, Option<String>) {
    let related = related.map(|related| SampleIdentity {
        writer_guid: GUID::from_bytes(related.writer),
        sequence_number: SequenceNumber::from(related.sequence),
    });
    let options = WriteOptionsBuilder::new().related_sample_identity_opt(related).build();
    let written =
        match tokio::time::timeout(WRITING_MAX, writer.async_write_with_options(body, options)).await {
            Ok(written) => written.map(drop).map_err(|error| wire::cut(&error)),
            Err(_) => Err(format!("the DDS library does not answer within {WRITING_MAX:?}")),
        };
    (number, written.err())
}
