//! The Zenoh session, on a thread of its own: it declares and undeclares, writes and calls. The library may block it, and
//! calls back on threads of its own.

use std::any::Any;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::sync::mpsc::Receiver;
use std::time::Duration;

use bytes::Bytes;
use tokio::sync::oneshot;
use zenoh::Wait as _;
use zenoh::liveliness::LivelinessToken;
use zenoh::query::{ConsolidationMode, QueryTarget, Reply};
use zenoh::sample::Sample;
use zenoh_ext::{
    AdvancedPublisher, AdvancedPublisherBuilderExt as _, AdvancedSubscriberBuilderExt as _, CacheConfig,
    HistoryConfig, MissDetectionConfig, RecoveryConfig,
};

use super::attachment::Attachment;
use super::graph::{self, Graph};
use super::heard::Heard;
use super::names::{self, Channel, ENTITIES_MAX, Kind, Part, Qos, Token};
use super::{config, hashes};
use crate::transport::quality::{Quality, Via};
use crate::transport::wire::{self, FromChild, Order};
use crate::transport::{NODES_TOPIC, SampleId, WRITING_MAX};
use telltale_clock::Clock;
use telltale_engine::discovery::Liveliness;
use telltale_msg::cdr::{Endian, Fault, Reader};
use telltale_msg::sample_bytes::Guid;

/// No token begins so.
const NOBODY: &str = "telltale_alive";
/// A question without an answer is given up long after the session was given up for it.
const UNANSWERED: Duration = Duration::from_secs(60);
/// CDR in little endian.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// A task for the thread of the session.
pub enum Work {
    Order(Order),
    /// Ask the router whether it is there.
    Beat(u64),
    /// The graph has changed: late subscribers may want the last values.
    Graph,
}

/// Opens the session and works until there is no more work.
pub fn run(
    domain: u16,
    router: Option<&str>,
    heard: &Arc<Heard>,
    work: &Receiver<Work>,
    opened: oneshot::Sender<Result<Guid, String>>,
) {
    let mut session = match Session::open(domain, router, heard) {
        Ok(session) => session,
        Err(error) => return drop(opened.send(Err(error))),
    };
    if opened.send(Ok(graph::guid(&session.id, 0))).is_err() {
        return;
    }
    while let Ok(work) = work.recv() {
        let done = match work {
            Work::Order(order) => session.obey(order),
            Work::Beat(number) => session.beat(number),
            Work::Graph => session.write_to_late(),
        };
        if let Err(error) = done {
            return heard.with(|state| state.broken = Some(error));
        }
    }
    let Session { session, readers, writers, .. } = session;
    drop((readers, writers));
    // It says goodbye if it can.
    let _ = session.close().timeout(WRITING_MAX).wait();
}

pub fn refused(error: impl std::fmt::Display) -> String {
    format!("the Zenoh library refused: {error}")
}

struct Session {
    domain: u16,
    heard: Arc<Heard>,
    session: zenoh::Session,
    id: String,
    clock: Clock,
    entities: u32,
    /// Nodes that are declared, with their numbers.
    nodes: BTreeMap<String, (u32, LivelinessToken)>,
    /// The nodes of our readers and writers.
    node_of: BTreeMap<Guid, String>,
    readers: BTreeMap<u32, OpenReader>,
    writers: BTreeMap<u32, OpenWriter>,
}

/// Opens a session at this router, or at the one that the environment names.
pub fn open(router: Option<&str>) -> Result<zenoh::Session, String> {
    let config = config::session(router, |name| std::env::var(name).ok())?;
    let router = config.get_json("connect/endpoints").unwrap_or_default();
    zenoh::open(config).wait().map_err(|error| {
        let error = error.to_string();
        // Behind it the library names the line of its source.
        let (error, _) = error.split_once(" at /").unwrap_or((&error, ""));
        format!("no Zenoh router at {router}: start one (ros2 run rmw_zenoh_cpp rmw_zenohd), or name it in ZENOH_CONFIG_OVERRIDE: {error}")
    })
}

/// Asks the router for tokens that nobody has. It says when it has told all of them, while it works.
pub fn ask(session: &zenoh::Session, answered: impl Fn() + Send + Sync + 'static) -> Result<(), String> {
    if session.info().routers_zid().wait().next().is_none() {
        return Err("the Zenoh router is gone".to_owned());
    }
    let answered = Answered(answered);
    let nobody = format!("{NOBODY}/{}", session.zid());
    let get = session.liveliness().get(nobody).timeout(UNANSWERED);
    get.callback(move |_: Reply| {
        let _ = &answered;
    })
    .wait()
    .map_err(refused)
}

/// A question to the router. It is dropped when its answer is complete.
struct Answered<F: Fn()>(F);

impl<F: Fn()> Drop for Answered<F> {
    fn drop(&mut self) {
        self.0();
    }
}

/// A reader or writer, and the token that tells of it.
struct Entity {
    number: u32,
    declared: Option<(Kind, Channel, Qos)>,
    token: Option<(String, LivelinessToken)>,
}

struct OpenReader {
    entity: Entity,
    /// A subscriber or a queryable, until it is dropped.
    _reads: Option<Box<dyn Any + Send>>,
}

struct OpenWriter {
    entity: Entity,
    channel: (Channel, Part),
    quality: Quality,
    /// By the hash of the type.
    publishers: BTreeMap<String, AdvancedPublisher<'static>>,
    sequence: i64,
    /// Messages for late subscribers, with their attachments.
    kept: VecDeque<(Bytes, Vec<u8>)>,
}

impl Session {
    fn open(domain: u16, router: Option<&str>, heard: &Arc<Heard>) -> Result<Session, String> {
        let session = open(router)?;
        let id = session.zid().to_string();
        heard.state().graph = Graph::new(domain, id.clone());
        Ok(Session {
            domain,
            heard: heard.clone(),
            session,
            id,
            clock: Clock::start(),
            entities: 0,
            nodes: BTreeMap::new(),
            node_of: BTreeMap::new(),
            readers: BTreeMap::new(),
            writers: BTreeMap::new(),
        })
    }

    fn beat(&mut self, number: u64) -> Result<(), String> {
        let heard = self.heard.clone();
        ask(&self.session, move || heard.with(|state| state.echo = state.echo.max(number)))
    }

    fn obey(&mut self, order: Order) -> Result<(), String> {
        match order {
            Order::Reader { id, topic, type_name, via, depth } => {
                let channel = Channel::of_dds(&topic, &type_name);
                // Each session's nodes are told once.
                let kept = if topic == NODES_TOPIC { usize::MAX } else { depth as usize };
                self.heard.state().open(id, kept, channel.clone());
                let reads = match &channel {
                    _ if topic == NODES_TOPIC => {
                        self.heard.with(|state| state.graph.tell_all_again());
                        None
                    }
                    Some((channel, Part::Message)) => {
                        Some(self.subscribe(id, channel, via, depth as usize)?)
                    }
                    Some((channel, Part::Request)) => Some(self.serve(id, channel)?),
                    Some((_, Part::Reply)) | None => None,
                };
                let of_part = |part| match part {
                    Part::Message => Some((Kind::Subscriber, via == Via::LastValue)),
                    Part::Request => Some((Kind::Server, false)),
                    Part::Reply => None,
                };
                let declared = channel.filter(|_| topic != NODES_TOPIC).and_then(|(channel, part)| {
                    let (kind, transient_local) = of_part(part)?;
                    Some((kind, channel, qos(via != Via::BestEffort, transient_local, depth as usize)))
                });
                let entity = self.entity(id, declared);
                self.readers.insert(id, OpenReader { entity, _reads: reads });
            }
            Order::EndReader { id } => {
                drop(self.readers.remove(&id));
                drop(self.heard.state().queues.remove(&id));
            }
            Order::Deepen { topic, type_name, depth } => {
                if let Some(channel) = Channel::of_dds(&topic, &type_name) {
                    self.heard.state().deepen(&channel, depth as usize);
                }
            }
            Order::Writer { id, topic, type_name, quality } => {
                let Some(channel) = Channel::of_dds(&topic, &type_name) else {
                    return Err(refused(format!("{topic} of {type_name} is no topic of ROS")));
                };
                let transient_local = matches!(quality, Quality::LastValue | Quality::Log);
                let qos = qos(quality != Quality::BestEffort, transient_local, depth(quality));
                let declared = match channel.1 {
                    _ if topic == NODES_TOPIC => None,
                    Part::Message => Some((Kind::Publisher, channel.0.clone(), qos)),
                    Part::Request => Some((Kind::Client, channel.0.clone(), qos)),
                    Part::Reply => None,
                };
                let entity = self.entity(id, declared);
                let (publishers, kept) = (BTreeMap::new(), VecDeque::new());
                self.writers
                    .insert(id, OpenWriter { entity, channel, quality, publishers, sequence: 0, kept });
            }
            Order::Write { id, number, related, body } => {
                let error = self.write(id, related, &body).err().map(|error| wire::cut(&error));
                self.heard.with(|state| state.news.push(FromChild::Written { number, error }));
            }
            Order::Open(_)
            | Order::Close
            | Order::Taken { .. }
            | Order::Forget { .. }
            | Order::FollowFirst { .. } => {}
        }
        Ok(())
    }

    /// A new reader or writer.
    fn entity(&mut self, id: u32, declared: Option<(Kind, Channel, Qos)>) -> Entity {
        self.entities = (self.entities + 1) % ENTITIES_MAX;
        let guid = graph::guid(&self.id, self.entities);
        self.heard.with(|state| state.news.push(FromChild::Made { id, guid }));
        Entity { number: self.entities, declared, token: None }
    }

    fn subscribe(
        &self,
        id: u32,
        channel: &Channel,
        via: Via,
        depth: usize,
    ) -> Result<Box<dyn Any + Send>, String> {
        let heard = self.heard.clone();
        let on_sample = move |sample: Sample| heard.hear(id, sample.payload(), sample.attachment(), None);
        let builder =
            self.session.declare_subscriber(channel.key(self.domain, "*")).callback(on_sample).advanced();
        let subscriber = match via {
            Via::Reliable | Via::BestEffort => builder.wait(),
            Via::LastValue => {
                let history = HistoryConfig::default().detect_late_publishers().max_samples(depth.max(1));
                builder.history(history).recovery(RecoveryConfig::default().heartbeat()).wait()
            }
        };
        Ok(Box::new(subscriber.map_err(refused)?))
    }

    fn serve(&self, id: u32, channel: &Channel) -> Result<Box<dyn Any + Send>, String> {
        let heard = self.heard.clone();
        let service = self.session.declare_queryable(channel.key(self.domain, "*")).complete(true);
        let service = service.callback(move |query| heard.hear_call(id, query)).wait();
        Ok(Box::new(service.map_err(refused)?))
    }

    fn write(&mut self, id: u32, related: Option<SampleId>, body: &[u8]) -> Result<(), String> {
        let Some(writer) = self.writers.get_mut(&id) else { return Ok(()) };
        if writer.channel.0.name.strip_prefix('/') == Some(NODES_TOPIC) {
            return self.announce(body);
        }
        writer.sequence += 1;
        let stamp_ns =
            self.clock.wall().duration_since(std::time::UNIX_EPOCH).map_or(0, |since| since.as_nanos());
        let gid = writer.entity.token.as_ref().map_or([0; 16], |(key, _)| names::gid(key));
        let attached = Attachment {
            sequence: writer.sequence,
            stamp_ns: i64::try_from(stamp_ns).unwrap_or(i64::MAX),
            gid,
        };
        let payload = Bytes::from([&ENCAPSULATION[..], body].concat());
        match writer.channel.1 {
            Part::Message => {
                let message = (payload, attached.bytes());
                writer.publishers(self.domain, &self.session, &self.heard)?;
                for publisher in writer.publishers.values() {
                    put(publisher, &message)?;
                }
                if matches!(writer.quality, Quality::LastValue | Quality::Log) {
                    writer.kept.push_back(message);
                    while writer.kept.len() > depth(writer.quality) {
                        writer.kept.pop_front();
                    }
                }
                Ok(())
            }
            Part::Request => {
                let (channel, own) = (writer.channel.0.clone(), graph::guid(&self.id, writer.entity.number));
                self.call(&channel, payload, attached, own)
            }
            Part::Reply => {
                let query = related.and_then(|id| self.heard.state().call(&id));
                let Some(query) = query else { return Err("its client has not waited".to_owned()) };
                let asked = query.attachment().and_then(|bytes| Attachment::read(&bytes.to_bytes()));
                let attached = asked.map(|asked| Attachment { stamp_ns: attached.stamp_ns, ..asked });
                let key = query.key_expr().clone();
                let reply = query.reply(key, payload.as_ref());
                reply.attachment(attached.map(|it| it.bytes())).wait().map_err(refused)
            }
        }
    }

    /// Calls a service.
    fn call(&self, channel: &Channel, payload: Bytes, attached: Attachment, own: Guid) -> Result<(), String> {
        let (hashes, readers) = {
            let state = self.heard.state();
            let hashes = state.graph.hashes(channel, Kind::Server).map(str::to_owned).collect::<Vec<_>>();
            (hashes, state.readers(&(channel.clone(), Part::Reply)))
        };
        if hashes.is_empty() {
            return Err("its service is being discovered still".to_owned());
        }
        let heard = self.heard.clone();
        let request = SampleId { writer: own, sequence: attached.sequence };
        let on_reply = move |reply: Reply| {
            let server =
                reply.replier_id().map_or([0; 16], |id| graph::guid(&id.zid().to_string(), ENTITIES_MAX));
            if let Ok(sample) = reply.result() {
                for reader in &readers {
                    heard.hear(*reader, sample.payload(), sample.attachment(), Some((server, request)));
                }
            }
        };
        // Those that nobody serves were announced all the same.
        hashes.iter().try_for_each(|hash| {
            let get = self.session.get(channel.key(self.domain, hash)).payload(payload.as_ref());
            let get = get.attachment(attached.bytes()).target(QueryTarget::AllComplete);
            get.consolidation(ConsolidationMode::None).callback(on_reply.clone()).wait().map_err(refused)
        })
    }

    /// Declares our nodes, and the readers and writers that they announce, by tokens.
    fn announce(&mut self, body: &[u8]) -> Result<(), String> {
        let nodes = read_nodes(body).map_err(|fault| fault.to_string())?;
        for (name, endpoints) in nodes {
            if !self.nodes.contains_key(&name) {
                self.entities = (self.entities + 1) % ENTITIES_MAX;
                let (session, entity) = (self.id.clone(), self.entities);
                let token = Token { session, entity, kind: Kind::Node, node: name.clone(), channel: None };
                let key = token.key(self.domain, entity);
                let token = self.session.liveliness().declare_token(key).wait().map_err(refused)?;
                self.nodes.insert(name.clone(), (entity, token));
            }
            self.node_of.extend(endpoints.into_iter().map(|guid| (guid, name.clone())));
        }
        let readers = self.readers.values_mut().map(|reader| &mut reader.entity);
        for entity in readers.chain(self.writers.values_mut().map(|writer| &mut writer.entity)) {
            let node = self.node_of.get(&graph::guid(&self.id, entity.number));
            // Telltale announces no writers of its own node: those of a participant with one node are its.
            let node = node.or_else(|| self.nodes.keys().next().filter(|_| self.nodes.len() == 1));
            let (Some(node), Some((kind, channel, qos)), None) = (node, &entity.declared, &entity.token)
            else {
                continue;
            };
            let known = self.heard.state().graph.hashes(channel, kind.other()).next().map(str::to_owned);
            let hash = known.unwrap_or_else(|| hashes::of(&channel.type_name).to_owned());
            let token = Token {
                session: self.id.clone(),
                entity: entity.number,
                kind: *kind,
                node: node.clone(),
                channel: Some((channel.clone(), hash, qos.clone())),
            };
            let of_node = self.nodes.get(node).map_or(0, |(number, _)| *number);
            let key = token.key(self.domain, of_node);
            let token = self.session.liveliness().declare_token(&key).wait().map_err(refused)?;
            entity.token = Some((key, token));
        }
        Ok(())
    }

    /// Publishes the kept messages for late subscribers of other hashes.
    fn write_to_late(&mut self) -> Result<(), String> {
        let message = |writer: &&mut OpenWriter| writer.channel.1 == Part::Message && !writer.kept.is_empty();
        for writer in self.writers.values_mut().filter(message) {
            let known: BTreeSet<String> = writer.publishers.keys().cloned().collect();
            writer.publishers(self.domain, &self.session, &self.heard)?;
            for (_, publisher) in writer.publishers.iter().filter(|(hash, _)| !known.contains(*hash)) {
                writer.kept.iter().try_for_each(|kept| put(publisher, kept))?;
            }
        }
        Ok(())
    }
}

impl OpenWriter {
    /// Makes a publisher for each hash that the subscribers have.
    fn publishers(&mut self, domain: u16, session: &zenoh::Session, heard: &Heard) -> Result<(), String> {
        let (channel, _) = &self.channel;
        let own = hashes::of(&channel.type_name).to_owned();
        let mut wanted = BTreeSet::from([own]);
        wanted.extend(heard.state().graph.hashes(channel, Kind::Subscriber).map(str::to_owned));
        self.publishers.retain(|hash, _| wanted.contains(hash));
        for hash in wanted {
            if self.publishers.contains_key(&hash) {
                continue;
            }
            let mut publisher = session.declare_publisher(channel.key(domain, &hash)).advanced();
            if matches!(self.quality, Quality::LastValue | Quality::Log) {
                let missed = MissDetectionConfig::default().sporadic_heartbeat(Duration::from_millis(500));
                publisher = publisher.cache(CacheConfig::default().max_samples(depth(self.quality)));
                publisher = publisher.publisher_detection().sample_miss_detection(missed);
            }
            self.publishers.insert(hash, publisher.wait().map_err(refused)?);
        }
        Ok(())
    }
}

fn put(publisher: &AdvancedPublisher<'static>, (payload, attached): &(Bytes, Vec<u8>)) -> Result<(), String> {
    publisher.put(payload.as_ref()).attachment(attached.as_slice()).wait().map_err(refused)
}

fn qos(reliable: bool, transient_local: bool, depth: usize) -> Qos {
    Qos { reliable, transient_local, depth, deadline_ns: None, liveliness: Liveliness::default() }
}

/// How many messages late subscribers get; others have this depth.
fn depth(quality: Quality) -> usize {
    match quality {
        Quality::LastValue => 1,
        Quality::Log => 100,
        Quality::Reply => 128,
        Quality::Reliable | Quality::BestEffort | Quality::Command => 10,
    }
}

/// The nodes that a participant of ours announces, each with its readers and writers.
fn read_nodes(body: &[u8]) -> Result<Vec<(String, Vec<Guid>)>, Fault> {
    let mut reader = Reader::new(body, Endian::Little);
    reader.octets(16)?;
    let mut nodes = Vec::new();
    for _ in 0..reader.u32()? {
        let namespace = String::from_utf8_lossy(reader.string()?).trim_end_matches('/').to_owned();
        let name = format!("{namespace}/{}", String::from_utf8_lossy(reader.string()?));
        let mut endpoints = Vec::new();
        for _readers_then_writers in 0..2 {
            for _ in 0..reader.u32()? {
                endpoints.extend(reader.octets(16)?.first_chunk::<16>());
            }
        }
        nodes.push((name, endpoints));
    }
    Ok(nodes)
}
