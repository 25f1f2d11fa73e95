//! Hands the messages of a DDS process to their receivers: readers, writers and discovery.

use std::collections::{BTreeMap, BTreeSet};
use std::io::ErrorKind;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll};

use futures_util::StreamExt as _;
use tokio::net::unix::OwnedReadHalf;
use tokio::sync::{mpsc, oneshot, watch};
use tokio_util::codec::FramedRead;

use super::BODY_BYTES_MAX;
use super::ids::Prefix;
use super::quality::Via;
use super::wire::{self, Change, FromChild, Order};
use super::{Announced, ENDPOINTS_MAX, Ended, Participant, RawSample, SAMPLE_BYTES, Seen, WINDOW_BYTES};
use telltale_engine::time::Timestamp;
use telltale_msg::sample_bytes::Guid;

/// The window, one message that began within it, and the frame that was under way.
const UNTAKEN_MAX: usize = WINDOW_BYTES + BODY_BYTES_MAX + 2 * SAMPLE_BYTES;

/// Participants that are remembered: those that are lost, and those that were discovered.
const PARTICIPANTS_MAX: usize = 1024;

/// When the library lost a participant, or discovered a lost one again.
#[derive(Debug, Clone, Copy)]
pub struct Loss {
    pub at: Timestamp,
    pub change: Change,
}

/// The messages of a reader.
pub enum ReaderEvent {
    Sample(RawSample),
    /// A sample was not handed over.
    Fault(String),
    /// Messages may be lost that are not sent again: another reader has taken its place, or the line was too slow.
    Missed,
}

impl ReaderEvent {
    fn weight(&self) -> usize {
        match self {
            ReaderEvent::Sample(sample) => sample.weight(),
            ReaderEvent::Fault(_) | ReaderEvent::Missed => SAMPLE_BYTES,
        }
    }
}

/// The queue for the samples of one reader, bounded by the window.
#[derive(Debug)]
struct ReaderQueue {
    samples: mpsc::UnboundedSender<ReaderEvent>,
    untaken: Arc<AtomicUsize>,
    /// It belongs to our node in the ROS 2 graph.
    of_node: bool,
}

/// State shared by the receiving task, the participant and the watch.
#[derive(Debug)]
pub struct Shared {
    seen: Mutex<Seen>,
    readers: Mutex<BTreeMap<u32, ReaderQueue>>,
    written: Mutex<BTreeMap<u32, oneshot::Sender<Option<String>>>>,
    made: Mutex<BTreeMap<u32, watch::Sender<Option<Guid>>>>,
    made_readers: Mutex<BTreeMap<u32, Guid>>,
    lost: Mutex<BTreeMap<Prefix, Loss>>,
    /// Participants that the library has discovered by what they said to it.
    discovered: Mutex<BTreeSet<Prefix>>,
    pub announced: Arc<Announced>,
    pub news: watch::Sender<u64>,
    pub own_readers: watch::Sender<BTreeSet<Guid>>,
    ended: watch::Sender<Option<Ended>>,
    /// The process is gone.
    over: watch::Sender<bool>,
    /// Endpoints of topics of ours that are not followed.
    pub cut_of_ours: AtomicU32,
    said_cut: AtomicBool,
    /// The process has made its participant.
    pub is_ready: AtomicBool,
    /// The number of the process's beats, and the newest beat that it heard itself.
    pub beats: AtomicU64,
    pub heard: AtomicU64,
}

impl Shared {
    pub fn new(announced: Arc<Announced>) -> Shared {
        Shared {
            announced,
            lost: Mutex::default(),
            discovered: Mutex::default(),
            seen: Mutex::default(),
            readers: Mutex::default(),
            written: Mutex::default(),
            made: Mutex::default(),
            made_readers: Mutex::default(),
            news: watch::channel(0).0,
            own_readers: watch::channel(BTreeSet::new()).0,
            ended: watch::channel(None).0,
            over: watch::channel(false).0,
            cut_of_ours: AtomicU32::new(0),
            said_cut: AtomicBool::new(false),
            is_ready: AtomicBool::new(false),
            beats: AtomicU64::new(0),
            heard: AtomicU64::new(0),
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    pub fn seen(&self) -> MutexGuard<'_, Seen> {
        lock(&self.seen)
    }

    /// The participant is unusable. The first reason counts.
    pub fn end(&self, reason: &str, ill: bool) {
        self.ended.send_if_modified(|ended| {
            let first = ended.is_none();
            if first {
                *ended = Some(Ended { reason: reason.into(), ill });
            }
            first
        });
    }

    pub fn has_ended(&self) -> bool {
        self.ended.borrow().is_some()
    }

    pub async fn ended(&self) -> Ended {
        let mut ended = self.ended.subscribe();
        let known = ended.wait_for(Option::is_some).await.ok().and_then(|ended| ended.clone());
        // The sender lives as long as `self`.
        known.unwrap_or_else(|| Ended { reason: "it is gone".into(), ill: true })
    }

    pub fn set_over(&self) {
        self.end("it was ended", false);
        self.over.send_replace(true);
    }

    pub async fn over(&self) {
        let _ = self.over.subscribe().wait_for(|over| *over).await;
    }

    /// For a reader or writer that is being made.
    pub fn make(&self, id: u32) -> watch::Receiver<Option<Guid>> {
        let (sender, receiver) = watch::channel(None);
        lock(&self.made).insert(id, sender);
        receiver
    }

    pub fn expect_written(&self, number: u32) -> oneshot::Receiver<Option<String>> {
        let (sender, receiver) = oneshot::channel();
        if !self.has_ended() {
            lock(&self.written).insert(number, sender);
        }
        receiver
    }

    pub fn forget_written(&self, number: u32) {
        lock(&self.written).remove(&number);
    }

    /// Takes one message.
    ///
    /// # Errors
    /// A sound process never sends this message.
    fn take(&self, news: FromChild) -> Result<(), &'static str> {
        match news {
            FromChild::Ready { .. } => return Err("it starts twice"),
            FromChild::Made { id, guid } => match lock(&self.made).remove(&id) {
                Some(made) => drop(made.send_replace(Some(guid))),
                None if lock(&self.readers).get(&id).is_some_and(|hearing| hearing.of_node) => {
                    let replaced = lock(&self.made_readers).insert(id, guid);
                    if replaced.is_some() {
                        self.hear(id, ReaderEvent::Missed)?;
                    }
                    self.own_readers.send_if_modified(|known| {
                        let is_gone = replaced.is_some_and(|old| known.remove(&old));
                        known.insert(guid) || is_gone
                    });
                }
                None => {}
            },
            FromChild::Found(found) => {
                if !self.seen().add(found) {
                    return Err("it tells of more endpoints than it may");
                }
                self.news.send_modify(|count| *count += 1);
            }
            FromChild::Gone { guid } => {
                self.seen().remove(&guid);
                self.news.send_modify(|count| *count += 1);
            }
            FromChild::Cut { of_ours, all } => {
                self.cut_of_ours.store(of_ours, Ordering::Relaxed);
                // Once for each process: the number may change at each look.
                if all > 0 && !self.said_cut.swap(true, Ordering::Relaxed) {
                    tracing::warn!(
                        "more than {ENDPOINTS_MAX} readers and writers of other programs are discovered: {all} or more \
                         are not looked at, those of the programs with the most, and at most {of_ours} of them on topics \
                         of Telltale. Look for the program that makes them"
                    );
                }
            }
            FromChild::Sample { reader, sample } => return self.hear(reader, ReaderEvent::Sample(sample)),
            FromChild::Fault { reader, reason } => return self.hear(reader, ReaderEvent::Fault(reason)),
            FromChild::Missed { reader } => return self.hear(reader, ReaderEvent::Missed),
            FromChild::Written { number, error } => {
                if let Some(waiting) = lock(&self.written).remove(&number) {
                    // Nobody waits for it any more.
                    let _ = waiting.send(error);
                }
            }
            FromChild::Beat { heard } => {
                self.beats.fetch_add(1, Ordering::Relaxed);
                self.heard.store(heard, Ordering::Relaxed);
            }
            FromChild::Broken { reason } => self.end(&reason, true),
            FromChild::Participant { participant, change } => {
                self.change(participant, change);
            }
        }
        Ok(())
    }

    /// Each lock is held alone: those who ask take them in another order.
    fn change(&self, participant: Prefix, change: Change) {
        match change {
            Change::Here => {
                let mut discovered = lock(&self.discovered);
                if discovered.len() < PARTICIPANTS_MAX {
                    discovered.insert(participant);
                }
                drop(discovered);
                self.announced.is_heard(&participant);
            }
            Change::Left => self.announced.has_left(&participant),
            Change::Lost | Change::Back | Change::Copied => {
                let loss = Loss { at: self.announced.now(), change };
                let mut lost = lock(&self.lost);
                if lost.len() < PARTICIPANTS_MAX {
                    lost.insert(participant, loss);
                }
            }
        }
    }

    /// The participants that the library has lost and that are not judged yet.
    pub fn lost(&self) -> BTreeMap<Prefix, Loss> {
        lock(&self.lost).clone()
    }

    pub fn has_discovered(&self, participant: &Prefix) -> bool {
        lock(&self.discovered).contains(participant)
    }

    pub fn is_judged(&self, participant: &Prefix) {
        lock(&self.lost).remove(participant);
    }

    fn hear(&self, reader: u32, heard: ReaderEvent) -> Result<(), &'static str> {
        let readers = lock(&self.readers);
        // A reader that was ended may still have received a sample.
        let Some(hearing) = readers.get(&reader) else { return Ok(()) };
        let weight = heard.weight();
        if hearing.untaken.fetch_add(weight, Ordering::Relaxed) + weight > UNTAKEN_MAX {
            return Err("it hands over more than it may");
        }
        // Its reader is gone.
        let _ = hearing.samples.send(heard);
        Ok(())
    }

    /// Nothing comes any more: nobody must wait for it.
    fn hang_up(&self) {
        lock(&self.written).clear();
        lock(&self.made).clear();
    }
}

/// Receives until the process is gone or sends nonsense.
pub async fn receive(socket: OwnedReadHalf, shared: Arc<Shared>, ready: oneshot::Sender<(Guid, u16)>) {
    let mut ready = Some(ready);
    let mut frames = FramedRead::with_capacity(socket, wire::frames(), wire::FRAME_BYTES);
    loop {
        let frame = tokio::select! {
            frame = frames.next() => frame,
            _ = shared.ended() => break,
        };
        let frame = match frame {
            Some(Ok(frame)) => frame.freeze(),
            Some(Err(error)) if error.kind() == ErrorKind::InvalidData => {
                shared.end("it says more at once than it may", true);
                break;
            }
            Some(Err(_)) | None => break,
        };
        let taken = wire::news(&frame).map_err(|_| "it says what makes no sense").and_then(|all| {
            all.into_iter().try_for_each(|news| match (news, &mut ready) {
                (FromChild::Ready { guid, participant }, ready @ Some(_)) => {
                    shared.is_ready.store(true, Ordering::Relaxed);
                    // The task that opened it may have given up.
                    let _ = ready.take().map(|ready| ready.send((guid, participant)));
                    Ok(())
                }
                (news, _) => shared.take(news),
            })
        });
        if let Err(reason) = taken {
            shared.end(reason, true);
        }
    }
    shared.hang_up();
    // If the process has ended by itself, the watch says why.
    drop((frames, ready));
}

/// A reader in a DDS process.
#[derive(Debug)]
pub struct Reader {
    id: u32,
    via: Via,
    samples: mpsc::UnboundedReceiver<ReaderEvent>,
    untaken: Arc<AtomicUsize>,
    /// Bytes that were taken and not reported to the process yet.
    taken: usize,
    participant: Participant,
}

impl Reader {
    pub(super) fn new(id: u32, via: Via, of_node: bool, participant: Participant) -> Reader {
        let (sender, samples) = mpsc::unbounded_channel();
        let untaken = Arc::new(AtomicUsize::new(0));
        let hearing = ReaderQueue { samples: sender, untaken: untaken.clone(), of_node };
        lock(&participant.0.shared.readers).insert(id, hearing);
        Reader { id, via, samples, untaken, taken: 0, participant }
    }

    pub fn via(&self) -> Via {
        self.via
    }

    /// Waits until it is made; for ever if the participant has ended. Only of readers that belong to a node.
    pub async fn guid(&self) -> Guid {
        let shared = &self.participant.0.shared;
        let mut made = shared.own_readers.subscribe();
        loop {
            let guid = lock(&shared.made_readers).get(&self.id).copied();
            if let Some(guid) = guid {
                return guid;
            }
            if made.changed().await.is_err() {
                return std::future::pending().await;
            }
        }
    }

    /// The next received sample. If there is none, the context is woken when one comes.
    pub fn poll(&mut self, context: &mut Context<'_>) -> Poll<ReaderEvent> {
        // Its sender lives until the reader is dropped.
        let Poll::Ready(Some(heard)) = self.samples.poll_recv(context) else { return Poll::Pending };
        let weight = heard.weight();
        self.untaken.fetch_sub(weight, Ordering::Relaxed);
        self.taken += weight;
        // Reported in large steps, because each report is a message.
        if self.taken >= WINDOW_BYTES / 4 {
            let bytes = u32::try_from(std::mem::take(&mut self.taken)).unwrap_or(u32::MAX);
            self.participant.order(Order::Taken { id: self.id, bytes });
        }
        Poll::Ready(heard)
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        let shared = &self.participant.0.shared;
        lock(&shared.readers).remove(&self.id);
        if let Some(guid) = lock(&shared.made_readers).remove(&self.id) {
            shared.own_readers.send_if_modified(|known| known.remove(&guid));
        }
        self.participant.order(Order::EndReader { id: self.id });
    }
}
