//! The way to ROS 2: the library of DDS or of Zenoh, in a process of its own for each participant.
//!
//! One forged packet can make such a library take all memory or hang for ever. So it runs in a child process of
//! the same program (`child`) with a memory limit. `watch` checks it from outside and ends it when it is ill;
//! then a new participant replaces it. Samples and discovered endpoints come over a socket (`wire`) and are
//! decoded in the main process.

mod child;
mod dds;
pub mod ids;
mod inbox;
mod memory;
mod parent;
pub mod places;
pub mod quality;
mod seen;
mod told;
mod watch;
mod wire;
#[cfg_attr(not(feature = "zenoh"), path = "without_zenoh.rs")]
mod zenoh;

use std::collections::BTreeSet;
use std::os::unix::net::UnixStream as StdStream;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use tokio::net::UnixStream;
use tokio::sync::{mpsc, oneshot};
use tokio::task::JoinHandle;

pub use child::process;
pub use dds::spdp;
pub use inbox::{Reader, ReaderEvent};
#[cfg(test)]
pub use seen::tests::found;
pub use seen::{Found, Seen};
use tokio::io::AsyncWriteExt as _;
pub use watch::Ended;
use wire::{Frame, Network, Order};
pub use zenoh::router::ZenohRouter;

use super::options::{self, BridgeOptions, Transport};
use super::{BridgeError, DdsProcess};
use dds::announced::Announced;
use dds::keep;
use ids::prefix;
use inbox::Shared;
pub use quality::Quality;
use quality::Via;
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::sample_bytes::{Guid, RawBody};

/// The interval of the DDS process's beats.
const BEAT: Duration = Duration::from_millis(250);
/// The topic on which participants announce their nodes.
pub const NODES_TOPIC: &str = "ros_discovery_info";
/// A larger message is refused: 100,000 statuses of 600 bytes are smaller.
pub const BODY_BYTES_MAX: usize = 64 << 20;
/// Bytes of samples of one reader that are under way or wait to be taken here. The library keeps the rest,
/// and drops the oldest if that is too much.
const WINDOW_BYTES: usize = 4 << 20;
/// The cost of a sample in addition to its body.
const SAMPLE_BYTES: usize = 128;
/// Endpoints of others that are remembered.
const ENDPOINTS_MAX: usize = 16_384;
/// Topics of ours that a process is told of beside those that it reads and writes itself.
const TOPICS_OF_OURS_MAX: usize = 4096;
/// Orders that wait for the DDS process. If there are more, the process no longer takes them.
const ORDERS_MAX: usize = 1024;
/// The longest time to make a participant.
const OPENING: Duration = Duration::from_secs(10);
/// The longest time to find those that live.
const SEARCHING_MAX: Span = Span::from_secs(20);
/// The longest time to write. Waiting for slow readers takes a tenth of it.
const WRITING_MAX: Duration = Duration::from_secs(1);

/// The identity of a sample: who wrote it, and its number there (DDS-RPC 1.0, 7.5.1.1.1).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SampleId {
    pub writer: Guid,
    pub sequence: i64,
}

/// A sample as the DDS process received it.
#[derive(Debug, Clone, PartialEq)]
pub struct RawSample {
    pub writer: Guid,
    pub sequence: i64,
    /// The publisher's clock, if the sample has it: seconds since 1970 in 32.32 bits.
    pub source: Option<u64>,
    /// The sample to which it belongs, as requests and replies of Fast DDS say it.
    pub related: Option<SampleId>,
    pub body: RawBody,
}

impl RawSample {
    fn weight(&self) -> usize {
        SAMPLE_BYTES + self.body.as_ref().map_or(0, |(body, _)| body.len())
    }
}

/// A participant in a DDS process. The process ends when all clones and all readers and writers are gone.
#[derive(Debug, Clone)]
pub struct Participant(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    transport: Transport,
    guid: Guid,
    id: u16,
    shared: Arc<Shared>,
    orders: mpsc::Sender<Order>,
    next: AtomicU32,
    topics_of_ours: Mutex<BTreeSet<String>>,
    watch: watch::Watch,
    opened: Timestamp,
    /// It says goodbye at the end.
    keeper: Mutex<Option<JoinHandle<()>>>,
}

impl Participant {
    /// Starts a DDS process with a participant.
    ///
    /// # Errors
    /// The interface does not exist, the process cannot be started, or no socket or port is available.
    pub async fn open(options: &BridgeOptions) -> Result<Participant, BridgeError> {
        let (network, announced) = match options.transport {
            Transport::Dds => {
                let interfaces = options::networks(options.interface)?;
                let announced = Announced::on(options.domain, interfaces.as_deref());
                (Network::Dds { domain: options.domain, interfaces }, announced)
            }
            Transport::Zenoh => (
                Network::Zenoh {
                    domain: options.domain,
                    router: options.router.as_deref().map(str::to_owned),
                },
                Announced::nobody(),
            ),
        };
        let failed = match options.transport {
            Transport::Dds => BridgeError::Participant,
            Transport::Zenoh => BridgeError::Router,
        };
        let lacks = |error: std::io::Error| failed(error.to_string());
        let (ours, theirs) = StdStream::pair().map_err(lacks)?;
        ours.set_nonblocking(true).map_err(lacks)?;
        let (reading, mut writing) = UnixStream::from_std(ours).map_err(lacks)?.into_split();
        let shared = Arc::new(Shared::new(announced));
        let watch = watch::start(options.dds_process, theirs, shared.clone()).map_err(lacks)?;
        let (orders, mut given) = mpsc::channel(ORDERS_MAX);
        let (ready, opened) = oneshot::channel();
        tokio::spawn(inbox::receive(reading, shared.clone(), ready));
        tokio::spawn(async move {
            let mut frame = Frame::new();
            while let Some(order) = given.recv().await {
                frame.order(&order);
                while let Some(order) = (!frame.is_full()).then(|| given.try_recv().ok()).flatten() {
                    frame.order(&order);
                }
                if writing.write_all(&frame.take()).await.is_err() {
                    return;
                }
            }
        });
        // The channel is new and empty.
        let _ = orders.try_send(Order::Open(network.clone()));
        let opened = tokio::time::timeout(OPENING, opened).await;
        match opened {
            Ok(Ok((guid, id))) => {
                let next = AtomicU32::new(1);
                let keeper = match network {
                    Network::Dds { domain, interfaces } => {
                        let port = spdp::discovery_port(domain, id);
                        Some(keep::run(guid, port, interfaces, shared.clone(), orders.downgrade()))
                    }
                    Network::Zenoh { .. } => None,
                };
                let keeper = Mutex::new(keeper.map(tokio::spawn));
                let opened = shared.announced.now();
                let topics_of_ours = Mutex::default();
                Ok(Participant(Arc::new(Inner {
                    transport: options.transport,
                    guid,
                    id,
                    shared,
                    orders,
                    next,
                    topics_of_ours,
                    watch,
                    opened,
                    keeper,
                })))
            }
            Ok(Err(_)) => Err(failed(shared.ended().await.reason.into_string())),
            Err(_) => Err(failed(format!("it does not start within {OPENING:?}"))),
        }
    }

    pub fn guid(&self) -> Guid {
        self.0.guid
    }

    /// Its number on this machine, which determines its ports.
    pub fn id(&self) -> u16 {
        self.0.id
    }

    /// The endpoints of others that discovery knows.
    pub fn seen(&self) -> MutexGuard<'_, Seen> {
        self.0.shared.seen()
    }

    /// Changes whenever discovery has news.
    pub fn news(&self) -> tokio::sync::watch::Receiver<u64> {
        self.0.shared.news.subscribe()
    }

    /// The readers that are made so far.
    pub fn own_readers(&self) -> tokio::sync::watch::Receiver<BTreeSet<Guid>> {
        self.0.shared.own_readers.subscribe()
    }

    /// The packets of participants, heard beside the library for as long as this is held.
    pub fn announced(&self) -> Arc<Announced> {
        self.0.shared.announced.clone()
    }

    /// Waits until the participant is unusable, and returns the reason.
    pub async fn ended(&self) -> Ended {
        self.0.shared.ended().await
    }

    pub fn has_ended(&self) -> bool {
        self.0.shared.has_ended()
    }

    /// Whether some that live and that we have met before are not found yet. Only in its first time: later they may
    /// have ended what they had.
    pub fn is_searching(&self) -> bool {
        let announced = &self.0.shared.announced;
        if announced.now().since(self.0.opened) >= SEARCHING_MAX {
            return false;
        }
        let (met, seen) = (announced.met(), self.seen());
        let own = prefix(&self.0.guid);
        met.iter().any(|participant| *participant != own && !seen.has_any_of(participant))
    }

    /// Whether there are more endpoints on topics of ours than are followed: one that is not seen may be there.
    pub fn sees_not_all(&self) -> bool {
        self.0.shared.cut_of_ours.load(Ordering::Relaxed) > 0
    }

    /// Follows the endpoints of these topics before those of others, as it does with what it reads and writes itself.
    pub fn follow_first<'a>(&self, topics: impl IntoIterator<Item = &'a str>) {
        let mut known = self.0.topics_of_ours.lock().unwrap_or_else(PoisonError::into_inner);
        for topic in topics {
            if known.len() < TOPICS_OF_OURS_MAX && !known.contains(topic) {
                known.insert(topic.to_owned());
                self.order(Order::FollowFirst { topic: topic.to_owned() });
            }
        }
    }

    /// Waits until it hears itself, if any participant on this network ever did.
    pub async fn hears_itself(&self) {
        while watch::is_self_heard() && self.0.shared.heard.load(Ordering::Relaxed) == 0 {
            tokio::time::sleep(BEAT).await;
        }
    }

    /// Lets the library keep so many samples of a topic from now on. The number can only grow.
    pub fn deepen(&self, topic: &str, type_name: &str, depth: usize) {
        let (topic, type_name) = (topic.to_owned(), type_name.to_owned());
        self.order(Order::Deepen { topic, type_name, depth: depth as u32 });
    }

    /// A reader of a topic; the library keeps `depth` of its samples. If it cannot be made, the participant
    /// ends.
    pub fn reader(&self, topic: &str, type_name: &str, via: Via, depth: usize) -> Reader {
        let id = self.next();
        // The topic on which a participant hears itself belongs to none of its nodes.
        let reader = Reader::new(id, via, topic != NODES_TOPIC, self.clone());
        let (topic, type_name) = (topic.to_owned(), type_name.to_owned());
        self.order(Order::Reader { id, topic, type_name, via, depth: depth as u32 });
        reader
    }

    /// A writer of a topic. If it cannot be made, the participant ends.
    pub fn writer(&self, topic: &str, type_name: &str, quality: Quality) -> Writer {
        let id = self.next();
        let (topic, type_name) = (topic.to_owned(), type_name.to_owned());
        let made = self.0.shared.make(id);
        self.order(Order::Writer { id, topic, type_name, quality });
        Writer { id, made, participant: self.clone() }
    }

    /// Ends the process, and waits for that and for its goodbye.
    pub async fn close(self) {
        self.order(Order::Close);
        self.0.watch.close();
        self.0.shared.over().await;
        let keeper = self.0.keeper.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(keeper) = keeper {
            // A panic there is no reason to fail here.
            let _ = keeper.await;
        }
    }

    fn next(&self) -> u32 {
        self.0.next.fetch_add(1, Ordering::Relaxed)
    }

    fn order(&self, order: Order) {
        if self.0.orders.try_send(order).is_err() {
            self.0.shared.end("it takes no orders any more", true);
        }
    }
}

/// A writer in a DDS process.
#[derive(Debug)]
pub struct Writer {
    id: u32,
    made: tokio::sync::watch::Receiver<Option<Guid>>,
    participant: Participant,
}

impl Writer {
    /// Waits until it is made; for ever if the participant has ended.
    pub async fn guid(&self) -> Guid {
        match self.made.clone().wait_for(Option::is_some).await.map(|guid| *guid) {
            Ok(Some(guid)) => guid,
            _ => std::future::pending().await,
        }
    }

    /// Publishes the CDR of a body in little endian, without its encapsulation.
    ///
    /// # Errors
    /// A reader holds it back for too long, or the process does not answer.
    pub async fn write(&self, body: Vec<u8>) -> Result<(), String> {
        self.write_related(body, None).await
    }

    /// The same, as the reply to another sample.
    pub async fn write_related(&self, body: Vec<u8>, related: Option<SampleId>) -> Result<(), String> {
        let number = self.participant.next();
        let written = self.participant.0.shared.expect_written(number);
        self.participant.order(Order::Write { id: self.id, number, related, body: body.into() });
        let answer = tokio::time::timeout(WRITING_MAX, written).await;
        self.participant.0.shared.forget_written(number);
        match answer {
            Ok(Ok(None)) => Ok(()),
            Ok(Ok(Some(error))) => Err(error),
            Ok(Err(_)) => Err(format!("the {} process has ended", self.participant.0.transport)),
            Err(_) => {
                let transport = self.participant.0.transport;
                Err(format!("the {transport} process does not answer within {WRITING_MAX:?}"))
            }
        }
    }
}

impl DdsProcess {
    /// No realistic use of DDS was seen to need more.
    pub const MEGABYTES: u32 = 1024;
}
