//! The vehicle's side while it runs: a thread that tells the hub what the engine's snapshots show. It takes snapshots and
//! summaries, and gives nothing back but its [`Status`] and the numbers of incidents with wanted recordings: no part
//! of it holds a way into the engine.

mod opening;
mod recordings;

use std::path::{Path, PathBuf};
use std::pin::Pin;
use std::sync::Arc;
use std::time::Instant;

use rusqlite::Connection;
use telltale_clock::{Clock, unix_ms, wall_at};
use telltale_engine::snapshot::{SILENT_MAX, Snapshot};
use telltale_engine::time::{Span, Timestamp};
use tokio::sync::{mpsc, oneshot, watch};

use crate::delivery::{Answer, Delivery, Last, Learned, Order, Said};
use crate::identity::{Identity, IdentityError};
use crate::line::{Hub, Line, NoLine, OwnLast, Requests, Want};
use crate::message::{Batch, Content, Head, Message, VehicleId, possible_ms};
use crate::outbox::{Limits, Outbox, OutboxError, Seed};
use crate::recordings::{Finished, Sending, Wishes};
use crate::status::{Contact, Status};
use crate::tell::{Teller, is_news};
use opening::opened;

/// A head is told this often, and at once after a change, but no more often than once in [`CHANGES_EVERY`].
const HEAD_EVERY: Span = Span::from_secs(15);
const CHANGES_EVERY: Span = Span::from_secs(1);
/// All nodes are told this often.
pub const KEYFRAME_EVERY: Span = Span::from_secs(600);

/// Changes wait this long for others, so that a batch is worth its envelope. Alarms and all else do not wait.
const DELTAS_WAIT: Span = Span::from_secs(10);

const TIDY_EVERY: Span = Span::from_secs(60);

/// The waits between attempts to reach the hub. Each vehicle waits up to twice as long, by its own share.
const RECONNECT_MIN: Span = Span::from_secs(1);
const RECONNECT_MAX: Span = Span::from_secs(60);

/// Messages that may wait for the thread. A sender that finds no room waits.
pub const NEWS_MAX: usize = 64;

/// How the vehicle is told of.
#[derive(Debug)]
pub struct Settings {
    pub id: VehicleId,
    pub hub: Hub,
    /// The file of the private key.
    pub credentials: PathBuf,
    pub kbit_s_max: u32,
    /// Recordings may be sent.
    pub sends_recordings: bool,
    /// Of Telltale.
    pub version: String,
}

/// What the thread tells of.
#[derive(Debug)]
pub struct Sources {
    pub snapshots: watch::Receiver<Arc<Snapshot>>,
    /// SHA-256 of the configuration's files, in hexadecimal digits.
    pub config: watch::Receiver<String>,
    /// Incidents and heads of the audit log.
    pub news: mpsc::Receiver<Content>,
    /// Recordings that are to be sent.
    pub finished: mpsc::Receiver<Finished>,
    /// The numbers of incidents with wanted recordings. Nothing else that the hub says leaves the thread.
    pub wanted: mpsc::Sender<u64>,
}

/// Why the thread does not start.
#[derive(Debug, thiserror::Error)]
pub enum StartError {
    #[error(transparent)]
    Identity(#[from] IdentityError),
    #[error("the thread of the fleet cannot be started: {0}")]
    Thread(#[from] std::io::Error),
}

/// A running line to the fleet.
#[derive(Debug)]
pub struct Fleet {
    status: watch::Receiver<Status>,
    end: watch::Sender<Option<Instant>>,
    /// Its sender goes with the thread. Nothing joins the thread: it may hang in a locked database.
    over: oneshot::Receiver<()>,
}

/// Starts to tell. Without a folder the outbox ends with the program. One that cannot be opened now is tried again.
///
/// # Errors
/// The key is of no use, or there is no thread.
pub fn start(
    settings: Settings,
    folder: Option<&Path>,
    sources: Sources,
    clock: Clock,
) -> Result<Fleet, StartError> {
    let identity = Identity::read(&settings.credentials)?;
    let nonce = getrandom::u32().map_err(|error| std::io::Error::other(error.to_string()))?;
    let first = u32::try_from(unix_ms(clock.wall()) / 1000).unwrap_or(0);
    let (limits, seed) = (Limits::default(), Seed { first, nonce });
    let folder = folder.map(Path::to_owned);
    let open = move || match &folder {
        Some(folder) => Outbox::open(folder, limits, seed, clock.now()),
        None => Outbox::over(Connection::open_in_memory()?, limits, seed, clock.now()),
    };
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    let (tell_status, status) = watch::channel(Status::new(clock.now()));
    let (end, mut ended) = watch::channel(None);
    let vehicle = move |outbox, status| Vehicle {
        delivery: Delivery::new(identity.public(), settings.kbit_s_max),
        teller: Teller::default(),
        status,
        outbox,
        identity,
        settings,
        clock,
        head: None,
        changes_at: Timestamp::ZERO,
        keyframe_at: Timestamp::ZERO,
        tidy_at: Timestamp::ZERO,
        hurry: true,
        waiting_since: None,
        live_until: Timestamp::ZERO,
        connect_at: Timestamp::ZERO,
        reconnect_wait: RECONNECT_MIN,
        sending: None,
        wishes: Wishes::default(),
    };
    let (thread, over) = oneshot::channel();
    std::thread::Builder::new().name("fleet".into()).spawn(move || {
        runtime.block_on(async {
            if let Some(outbox) = opened(open, &tell_status, &mut ended).await {
                vehicle(outbox, tell_status).run(sources, ended).await;
            }
        });
        // A name server that does not answer holds up no end.
        runtime.shutdown_background();
        drop(thread);
    })?;
    Ok(Fleet { status, end, over })
}

impl Fleet {
    pub fn status(&self) -> watch::Receiver<Status> {
        self.status.clone()
    }

    /// Says goodbye, and waits until the hub has heard it, but no longer than `until`.
    pub async fn end(self, until: Instant) {
        self.end.send_replace(Some(until));
        if tokio::time::timeout_at(until.into(), self.over).await.is_err() {
            tracing::warn!("the hub of the fleet has not heard the goodbye; it waits in the outbox");
        }
    }
}

/// A request to the hub, or an attempt to reach it, that is not answered yet.
type Waiting = Pin<Box<dyn Future<Output = Heard>>>;

enum Heard {
    Line(Box<Result<Line, NoLine>>),
    Answer(Answer),
    /// To a piece of a recording.
    Piece(Answer),
    OwnLast(OwnLast),
}

struct Vehicle {
    settings: Settings,
    identity: Identity,
    outbox: Outbox,
    delivery: Delivery,
    teller: Teller,
    status: watch::Sender<Status>,
    clock: Clock,
    /// The head that was told last, and when.
    head: Option<(Head, Timestamp)>,
    /// No changes are told before this.
    changes_at: Timestamp,
    keyframe_at: Timestamp,
    tidy_at: Timestamp,
    /// A message waits that is no change of a state.
    hurry: bool,
    /// Since when the oldest change waits.
    waiting_since: Option<Timestamp>,
    live_until: Timestamp,
    connect_at: Timestamp,
    reconnect_wait: Span,
    /// The oldest recording that is to be sent.
    sending: Option<Sending>,
    wishes: Wishes,
}

impl Vehicle {
    async fn run(mut self, mut sources: Sources, mut ended: watch::Receiver<Option<Instant>>) {
        self.look_for_recordings();
        let mut line: Option<Line> = None;
        let mut waiting: Option<Waiting> = None;
        let mut until = None;
        let mut heard_at = self.clock.now();
        loop {
            let now = self.clock.now();
            let snapshot = sources.snapshots.borrow().clone();
            // The last snapshot of an engine that hangs is not told: the console sees by its age that it is old.
            let told = (until.is_some() || now.since(heard_at) < SILENT_MAX).then_some(&*snapshot);
            self.tell(told, &mut sources, until.is_some(), line.as_ref()).await;
            if waiting.is_none() {
                if line.is_some() && until.is_none() {
                    self.announce_recording();
                }
                waiting = self.next(line.as_ref(), now, until.is_some());
            }
            if until.is_some() && (line.is_none() || waiting.is_none() && !self.is_worth_sending(now)) {
                if let Some(line) = &line {
                    line.requests().flush().await;
                }
                return;
            }
            let told = told.filter(|_| until.is_none());
            let due = self.clock.instant(self.due(told, line.is_some(), waiting.is_some()));
            tokio::select! {
                _ = tokio::time::sleep_until(due.into()) => {}
                Ok(()) = sources.snapshots.changed(), if until.is_none() => heard_at = self.clock.now(),
                Some(content) = sources.news.recv() => {
                    self.hurry = true;
                    self.push(vec![content]);
                }
                Some(finished) = sources.finished.recv() => {
                    // The messages before it stand before it in the log.
                    let before: Vec<Content> = std::iter::from_fn(|| sources.news.try_recv().ok()).collect();
                    self.hurry |= !before.is_empty();
                    self.push(before);
                    self.take_finished(&finished);
                }
                heard = heard(&mut waiting) => self.hear(heard, &mut line),
                want = next_want(&mut line) => match want {
                    Ok(Some(Want { live, incidents })) => {
                        if let Some(span) = live {
                            self.live_until = self.clock.now() + span;
                        }
                        incidents.into_iter().for_each(|number| self.want(number, &sources.wanted));
                    }
                    Ok(None) => self.drop_wish(),
                    Err(why) => self.hang_up((&mut line, &mut waiting), &why),
                },
                // Its sender lives as long as the program; without it there is nothing to tell either.
                _ = ended.changed(), if until.is_none() => {
                    until = Some(ended.borrow_and_update().unwrap_or_else(|| self.clock.instant(now)));
                    self.hurry = true;
                    self.push(vec![Content::Goodbye]);
                }
                () = by(until) => return,
            }
        }
    }

    /// Puts what changed into the outbox, and tells the head if it is time.
    async fn tell(
        &mut self,
        snapshot: Option<&Snapshot>,
        sources: &mut Sources,
        ending: bool,
        line: Option<&Line>,
    ) {
        let now = self.clock.now();
        let mut news = Vec::new();
        if let Some(snapshot) = snapshot.filter(|_| !ending) {
            if now >= self.keyframe_at {
                news = self.teller.changes(snapshot);
                news.retain(|it| !matches!(it, Content::Delta(_)));
                news.extend(self.teller.keyframe(snapshot));
                self.keyframe_at = now + KEYFRAME_EVERY;
            } else if now >= self.changes_at {
                news = self.teller.changes(snapshot);
            }
        }
        if !news.is_empty() {
            self.changes_at = now + CHANGES_EVERY;
        }
        self.hurry |= news.iter().any(|it| !matches!(it, Content::Delta(_) | Content::Keyframe(_)));
        let lines = self.push(news);
        if now >= self.tidy_at {
            self.tidy_at = now + TIDY_EVERY;
            let tidied = self.outbox.tidy(self.at_ms(), now);
            self.note_disk(tidied.err());
            self.look_for_recordings();
        }
        let Some(requests) = line.map(Line::requests).filter(|_| !self.delivery.is_stopped()) else { return };
        if now < self.live_until && !lines.is_empty() {
            self.publish_live(&requests, &lines).await;
        }
        let Some(snapshot) = snapshot else { return };
        let (clock, wall) = (self.clock, self.clock.wall());
        let unix = |at| possible_ms(unix_ms(wall_at(wall, clock.now(), at)));
        let head = Head {
            version: self.settings.version.clone(),
            config: sources.config.borrow().clone(),
            last: self.outbox.last(),
            ending,
            ..self.teller.head(snapshot, unix)
        };
        let is_due = match &self.head {
            None => true,
            Some((before, at)) => {
                let age = now.since(*at);
                age >= HEAD_EVERY || is_news(&head, before) && (age >= CHANGES_EVERY || ending)
            }
        };
        if is_due {
            let message = Message {
                epoch: self.outbox.epoch(),
                n: self.outbox.last().max(1),
                at: self.at_ms(),
                content: Content::Head(head.clone()),
            };
            if let Some(packed) = self.packed(&[message]) {
                self.delivery.used(packed.len(), now);
                requests.head(packed).await;
            }
            self.head = Some((head, now));
        }
    }

    async fn publish_live(&mut self, requests: &Requests, lines: &[Message]) {
        if let Some(packed) = self.packed(lines) {
            self.delivery.used(packed.len(), self.clock.now());
            requests.live(packed).await;
        }
    }

    fn packed(&self, messages: &[Message]) -> Option<Vec<u8>> {
        let json: Option<Vec<String>> = messages.iter().map(|it| serde_json::to_string(it).ok()).collect();
        let json = json?;
        let json: Vec<&str> = json.iter().map(String::as_str).collect();
        Batch::pack(&self.settings.id, self.identity.public(), self.at_ms(), &json)
    }

    /// Takes messages into the outbox. A disk that refuses them makes a gap and a WARNING.
    fn push(&mut self, contents: Vec<Content>) -> Vec<Message> {
        if contents.is_empty() {
            return Vec::new();
        }
        let (at, now) = (self.at_ms(), self.clock.now());
        match self.outbox.push(at, &contents, now) {
            Ok(first) => {
                self.note_disk(None);
                self.waiting_since = self.waiting_since.or(Some(now));
                let numbered = (first.n..).zip(contents);
                numbered.map(|(n, content)| Message { epoch: first.epoch, n, at, content }).collect()
            }
            Err(error) => {
                self.note_disk(Some(error));
                Vec::new()
            }
        }
    }

    /// The next request to the hub, or attempt to reach it.
    fn next(&mut self, line: Option<&Line>, now: Timestamp, ending: bool) -> Option<Waiting> {
        let Some(line) = line else {
            if now < self.connect_at || self.delivery.is_stopped() {
                return None;
            }
            let (hub, id) = (self.settings.hub.clone(), self.settings.id.clone());
            let identity = self.identity.clone();
            return Some(Box::pin(
                async move { Heard::Line(Box::new(Line::open(&hub, &id, &identity).await)) },
            ));
        };
        let requests = line.requests();
        match self.delivery.order(self.is_worth_sending(now), now) {
            Order::Rest | Order::Until(_) if ending => None,
            Order::Rest | Order::Until(_) => self.next_piece(requests, now),
            Order::Ask => {
                self.delivery.asks();
                Some(Box::pin(async move { Heard::OwnLast(requests.own_last().await) }))
            }
            Order::Send { after } => {
                let (at_ms, bytes) = (self.at_ms(), self.delivery.batch_bytes());
                let batch = self.outbox.batch(&self.settings.id, self.identity.public(), at_ms, bytes);
                let pending = match batch {
                    Ok(pending) => pending?,
                    Err(error) => {
                        self.note_disk(Some(error));
                        return None;
                    }
                };
                self.delivery.sends(pending.end, pending.packed.len(), now);
                Some(Box::pin(async move { Heard::Answer(requests.log(after, pending.packed).await) }))
            }
        }
    }

    /// Whether something waits that does not wait for more.
    fn is_worth_sending(&self, now: Timestamp) -> bool {
        let is_due = self.hurry
            || now < self.live_until
            || self.waiting_since.is_some_and(|since| now.since(since) >= DELTAS_WAIT);
        is_due && self.outbox.has_unsent().unwrap_or(false)
    }

    fn hear_of_line(&mut self, opened: Result<Line, NoLine>, line: &mut Option<Line>) {
        let now = self.clock.now();
        match opened {
            Ok(opened) => {
                *line = Some(opened);
                self.head = None;
                self.delivery.connected();
                self.reconnect_wait = RECONNECT_MIN;
                self.status.send_modify(|status| status.contact = Contact::Reached { since: now });
                tracing::info!("the hub of the fleet is reached");
            }
            Err(NoLine::Refused) => {
                self.wait_to_connect(RECONNECT_MAX);
                self.change_contact(Contact::Refused { since: now }, "the hub does not admit this vehicle");
            }
            Err(NoLine::Unreachable(why)) => self.lost(&why),
        }
    }

    fn hear(&mut self, heard: Heard, line: &mut Option<Line>) {
        let answer = match heard {
            Heard::Line(opened) => return self.hear_of_line(*opened, line),
            Heard::Answer(answer) => answer,
            Heard::Piece(answer) => return self.piece_answered(&answer),
            Heard::OwnLast(OwnLast::Nothing) => Answer::Nothing,
            Heard::OwnLast(OwnLast::Unknown(answer)) => answer,
            Heard::OwnLast(OwnLast::Stored(stored)) => {
                let said = Batch::unpack(&stored.packed, &self.settings.id).ok().and_then(|batch| {
                    let end = batch.end()?;
                    let known = self.outbox.knows(end).ok()?;
                    Some(Said { key: batch.key, end, known })
                });
                Answer::Last(Last { sequence: stored.sequence, said })
            }
        };
        let now = self.clock.now();
        let refuses = matches!(answer, Answer::Refused | Answer::Silence);
        self.status.send_if_modified(|status| {
            let is_news = status.refuses_since.is_some() != refuses;
            status.refuses_since = if refuses { status.refuses_since.or(Some(now)) } else { None };
            is_news
        });
        match self.delivery.answered(&answer, now) {
            Learned::Nothing => {}
            Learned::HubHas(last) => {
                let noted = self.outbox.hub_has(last, self.at_ms(), now);
                let is_empty = !self.outbox.has_unsent().unwrap_or(true);
                // What the hub lost waited long enough.
                self.hurry = !is_empty && (self.hurry || !matches!(answer, Answer::Stored(_)));
                self.waiting_since = self.waiting_since.filter(|_| !is_empty);
                self.note_disk(noted.err());
            }
            Learned::TwoVehicles => {
                tracing::error!(
                    "another vehicle tells the fleet as {}, or this one lost its outbox: nothing more is told. \
                     Enrol it anew with `telltale fleet enrol`",
                    self.settings.id
                );
                *line = None;
                self.status.send_modify(|status| status.contact = Contact::TwoVehicles);
            }
        }
    }

    /// When something is to be done although nothing happens.
    fn due(&self, told: Option<&Snapshot>, is_connected: bool, is_waiting: bool) -> Timestamp {
        let now = self.clock.now();
        let mut due = self.tidy_at;
        if let Some(snapshot) = told {
            due = due.min(self.keyframe_at);
            if self.teller.has_news(snapshot) {
                due = due.min(self.changes_at);
            }
            if is_connected {
                let head = self.head.as_ref();
                due = due.min(head.map_or(now + CHANGES_EVERY, |(_, at)| *at + HEAD_EVERY));
            }
        }
        if is_connected {
            if !is_waiting {
                let sent = self.waiting_since.map_or(due, |since| since + DELTAS_WAIT);
                let soon = now + Span::from_millis(100);
                due = due.min(sent.max(soon));
                match self.delivery.order(self.is_worth_sending(now), now) {
                    Order::Until(then) => due = due.min(then.max(now + Span::from_millis(1))),
                    // Its time came after it was asked for.
                    Order::Ask | Order::Send { .. } => due = due.min(soon),
                    Order::Rest => {}
                }
                let has_piece = self.sending.is_some() && !self.is_worth_sending(now);
                if let Some(then) = self.delivery.piece_at().filter(|_| has_piece) {
                    due = due.min(then.max(now + Span::from_millis(1)));
                }
            }
        } else if !is_waiting && !self.delivery.is_stopped() {
            due = due.min(self.connect_at);
        }
        due
    }

    fn hang_up(&mut self, (line, waiting): (&mut Option<Line>, &mut Option<Waiting>), why: &str) {
        *line = None;
        *waiting = None;
        self.delivery.disconnected();
        self.lost(why);
    }

    fn lost(&mut self, why: &str) {
        self.wait_to_connect(self.reconnect_wait);
        self.reconnect_wait = Span::from_nanos(self.reconnect_wait.as_nanos() * 2).min(RECONNECT_MAX);
        let now = self.clock.now();
        self.change_contact(Contact::Away { since: now, why: why.into() }, why);
    }

    /// Two vehicles that lost the hub together do not come back together.
    fn wait_to_connect(&mut self, wait: Span) {
        let share = u64::from(self.outbox.epoch().nonce % 1000);
        let wait = Span::from_nanos(wait.as_nanos() + wait.as_nanos() / 1000 * share);
        self.connect_at = self.clock.now() + wait;
    }

    /// The time of the first attempt stays while the contact is of the same kind.
    fn change_contact(&mut self, contact: Contact, why: &str) {
        self.status.send_if_modified(|status| {
            if status.contact.is_like(&contact) {
                return false;
            }
            tracing::warn!("the fleet is not told: {why}");
            status.contact = contact;
            true
        });
    }

    fn note_disk(&self, fault: Option<OutboxError>) {
        note_disk(&self.status, fault);
    }

    fn at_ms(&self) -> i64 {
        possible_ms(unix_ms(self.clock.wall()))
    }
}

fn note_disk(status: &watch::Sender<Status>, fault: Option<OutboxError>) {
    status.send_if_modified(|status| {
        let fault = fault.map(|error| error.to_string());
        if status.disk == fault {
            return false;
        }
        if let Some(fault) = &fault {
            tracing::error!("{fault}");
        }
        status.disk = fault;
        true
    });
}

async fn heard(waiting: &mut Option<Waiting>) -> Heard {
    match waiting {
        Some(future) => {
            let heard = future.await;
            *waiting = None;
            heard
        }
        None => std::future::pending().await,
    }
}

async fn next_want(line: &mut Option<Line>) -> Result<Option<Want>, String> {
    match line {
        Some(line) => line.next().await,
        None => std::future::pending().await,
    }
}

async fn by(until: Option<Instant>) {
    match until {
        Some(until) => tokio::time::sleep_until(until.into()).await,
        None => std::future::pending().await,
    }
}
