//! The DDS process: the only place that touches the DDS library. It executes orders, and passes received
//! samples and discovered endpoints up as bytes.
//!
//! A packet from the network can make the library take all memory or hang. So it runs in a process of its own,
//! and `watch` checks it from outside.

use std::collections::{BTreeMap, BTreeSet};
use std::future::poll_fn;
use std::io::Write as _;
use std::net::Ipv4Addr;
use std::os::fd::AsFd as _;
use std::os::unix::net::UnixStream;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use bytes::Bytes;
use futures_util::StreamExt as _;
use rustdds::{
    DomainParticipant, DomainParticipantBuilder, GUID, QosPolicyBuilder, RTPSEntity as _, SampleIdentity,
    SequenceNumber, StatusEvented as _, Subscriber, Topic, WriteOptionsBuilder,
};
use tokio::io::AsyncWriteExt as _;
use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};
use tokio::signal::unix::{SignalKind, signal};
use tokio::task::JoinSet;
use tokio_util::codec::{FramedRead, LengthDelimitedCodec};

use super::busy_discovery::BusyDiscovery;
use super::echo_check::EchoCheck;
use super::losses::Losses;
use super::open_readers::{OpenReader, OpenReaders};
use super::places;
use super::qos::{self, RawWriter};
use super::relief::Relief;
use super::wire::{self, Frame, FromChild, Order};
use super::{BEAT, SampleId, WRITING_MAX, discovered};
use crate::every;
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

/// `telltale dds-process PARENT MEGABYTES`, with the socket to its parent as standard input.
pub fn process(parent: u32, megabytes: u64) -> ExitCode {
    if let Err(error) = confine(parent, megabytes) {
        tell(&error);
        return ExitCode::FAILURE;
    }
    // Nobody notices when a thread of the library panics: the process would go on deaf.
    std::panic::set_hook(Box::new(|panic| {
        tell(&panic);
        std::process::abort();
    }));
    match std::io::stdin().as_fd().try_clone_to_owned() {
        Ok(socket) => serve(UnixStream::from(socket), true),
        Err(error) => tell(&error),
    }
    // Threads of the library that do not end are left behind.
    std::process::exit(0)
}

/// Says why it ends. Where nobody reads standard error it ends all the same.
fn tell(why: &dyn std::fmt::Display) {
    let _ = writeln!(std::io::stderr(), "telltale dds-process: {}", why.to_string().replace('\n', " "));
}

/// Limits the process: no more memory than `megabytes`, no longer life than its parent's, and the first to
/// be killed when the machine runs out of memory.
fn confine(parent: u32, megabytes: u64) -> std::io::Result<()> {
    use rustix::process::{Resource, Rlimit, Signal};
    rustix::process::set_parent_process_death_signal(Some(Signal::KILL))?;
    if std::os::unix::process::parent_id() != parent {
        return Err(std::io::Error::other("it is started by `telltale serve`, `demo` and `sim` alone"));
    }
    let limit = |bytes| Rlimit { current: Some(bytes), maximum: Some(bytes) };
    rustix::process::setrlimit(Resource::Data, limit(megabytes << 20))?;
    rustix::process::setrlimit(Resource::Core, limit(0))?;
    // If that cannot be written, the limit above still holds.
    let _ = std::fs::write("/proc/self/oom_score_adj", "500");
    Ok(())
}

/// Executes the orders that come over the socket, until the socket closes.
pub fn serve(socket: UnixStream, alone: bool) {
    let served = tokio::runtime::Builder::new_current_thread().enable_all().build().and_then(|runtime| {
        let lived = runtime.block_on(live(socket, alone));
        runtime.shutdown_background();
        lived
    });
    if let Err(error) = served {
        tracing::error!("the DDS process cannot be started: {error}");
    }
}

/// Orders, in frames.
type Orders = FramedRead<OwnedReadHalf, LengthDelimitedCodec>;

/// The next orders. `None` if the program is gone or sends nonsense.
async fn next(orders: &mut Orders) -> Option<Vec<Order>> {
    wire::orders(&orders.next().await?.ok()?.freeze()).ok()
}

async fn live(socket: UnixStream, alone: bool) -> std::io::Result<()> {
    if alone {
        // The parent decides when to end: a signal to all processes of a service must not end this one
        // before the last messages to the vehicle are published. After this call, these signals are ignored
        // for good.
        let _ = [SignalKind::interrupt(), SignalKind::terminate(), SignalKind::hangup()].map(signal);
    }
    socket.set_nonblocking(true)?;
    let (reading, writing) = tokio::net::UnixStream::from_std(socket)?.into_split();
    let mut orders = FramedRead::new(reading, wire::frames());
    let mut first = next(&mut orders).await.unwrap_or_default().into_iter();
    let Some(Order::Open { domain, networks }) = first.next() else { return Ok(()) };
    let mut out = ToParent { socket: writing, frame: Frame::new(), samples: Frame::new() };
    let ended = match Child::open(domain, networks, &mut out).await {
        Ok(mut child) => {
            let ended = child.run(first.collect(), &mut orders, &mut out).await;
            child.close().await;
            ended
        }
        Err(reason) => Err(reason),
    };
    if let Err(reason) = ended {
        out.frame.news(&FromChild::Broken { reason: wire::cut(&reason) });
        let _ = out.send().await;
    }
    Ok(())
}

/// The messages to the parent. Writing waits if the parent does not read.
struct ToParent {
    socket: OwnedWriteHalf,
    frame: Frame,
    /// Samples, which follow the description of their writers.
    samples: Frame,
}

impl ToParent {
    async fn send(&mut self) -> Result<(), String> {
        for frame in [&mut self.frame, &mut self.samples] {
            if !frame.is_empty() {
                self.socket.write_all(&frame.take()).await.map_err(|error| error.to_string())?;
            }
        }
        Ok(())
    }
}

struct Child {
    participant: DomainParticipant,
    subscriber: Subscriber,
    topics: BTreeMap<(String, String), Topic>,
    open_readers: OpenReaders,
    losses: Losses,
    /// The topics whose endpoints are followed before others.
    ours: BTreeSet<String>,
    /// Endpoints that are not followed, as the parent knows: those of such topics, and all.
    told_cut: (u32, u32),
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
            ours: BTreeSet::new(),
            told_cut: (0, 0),
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
                self.ours.insert(topic.clone());
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
                self.ours.insert(topic.clone());
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
            Order::FollowFirst { topic } => drop(self.ours.insert(topic)),
            Order::Open { .. } | Order::Close => {}
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
        let told = std::mem::take(&mut self.open_readers.told);
        self.losses.look(&told, &mut now);
        let places::Places { followed: now, cut_of_ours, cut } = places::choose(now, &told, &self.ours)?;
        let before = std::mem::replace(&mut self.told_cut, (cut_of_ours, cut));
        let tell_cut = |frame: &mut Frame| frame.news(&FromChild::Cut { of_ours: cut_of_ours, all: cut });
        // Told first: an endpoint that was cut is not gone.
        let is_more = cut_of_ours > before.0;
        if is_more {
            tell_cut(&mut out.frame);
        }
        // Before the new ones, which need their places.
        for guid in told.keys().filter(|guid| !now.contains_key(*guid)) {
            out.frame.news(&FromChild::Gone { guid: *guid });
        }
        for (guid, found) in &now {
            if told.get(guid) != Some(found) {
                out.frame.news(&FromChild::Found(found.clone()));
                self.open_readers.unknown.clear();
            }
        }
        if !is_more && before != self.told_cut {
            tell_cut(&mut out.frame);
        }
        self.open_readers.told = now;
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
