//! One topic in a task of its own: turns the samples of its readers into inputs.

use std::collections::BTreeMap;
use std::future::poll_fn;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

use bytes::Bytes;
use tokio::sync::{mpsc, watch};

use super::delays::Delays;
use super::keeping::Kept;
use super::last_values::{LastValue, LastValues};
use super::publishers::{Came, Offer, Published, Verdict, Writers};
use super::readers::{Advice, Readers, Retention, Sample};
use super::trouble::Troubles;
use crate::discovery::graph::Paces;
use crate::engine_queue::{End, EngineQueue, stopped, waiting_bytes};
use crate::transport::{Found, Participant};
use telltale_clock::Clock;
use telltale_engine::input::{Input, TroubleKind};
use telltale_engine::model::sample::PublisherReport;
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::fields::NoValue;
use telltale_msg::messages;
use telltale_msg::received::{Message, Stamped};
use telltale_msg::ros_clock::RosClock;
use telltale_msg::sample_bytes::Guid;
use telltale_msg::subscription::{PublicationTime, Received, Subscription};

/// A topic is reported to have no publisher only after discovery had this time.
const DISCOVERY: Span = Span::from_secs(5);

/// While some that live are not found yet, it is looked again after this time.
const SEARCHED_AGAIN: Span = Span::from_secs(1);

/// State shared by all topics of a participant.
#[derive(Clone)]
pub struct TopicContext {
    pub participant: Participant,
    pub inputs: mpsc::Sender<Stamped>,
    pub clock: Clock,
    pub paces: Paces,
    pub ros_clock: RosClock,
    pub stop: watch::Receiver<bool>,
}

/// State that outlives a participant: gaps are counted across a replacement, and samples are not taken
/// twice.
#[derive(Debug)]
pub struct TopicState {
    writers: Writers,
    delays: Delays,
    troubles: Troubles,
    retention: Retention,
    last_values: LastValues,
    /// When its last message came.
    heard: Option<Timestamp>,
    /// When the newest one was published, by the clock of its writer.
    newest: Option<(SystemTime, Guid)>,
}

impl TopicState {
    pub fn new(subscription: &Subscription) -> TopicState {
        let retention = match (subscription.may_be_large(), subscription.recorded_every()) {
            (true, _) => Retention::of_large_messages(),
            (false, Some(_)) => Retention::of_recorded_messages(),
            (false, None) => Retention::new(),
        };
        let (writers, delays, troubles, last_values) = Default::default();
        TopicState { writers, delays, troubles, retention, last_values, heard: None, newest: None }
    }

    /// When the last message of its type came.
    pub fn heard(&self) -> Option<Timestamp> {
        self.heard
    }
}

/// What the owner of the task that reads a topic knows of its messages.
#[derive(Debug, Default)]
pub struct Trial {
    /// When the last message came, in nanoseconds; 0 before the first.
    last: AtomicU64,
    /// One of several types that are announced: nothing is said of it before its first message.
    is_quiet: AtomicBool,
}

impl Trial {
    pub fn new(is_quiet: bool) -> Trial {
        Trial { is_quiet: is_quiet.into(), ..Trial::default() }
    }

    /// When the last message of its type came.
    pub fn last(&self) -> Option<Timestamp> {
        Some(self.last.load(Ordering::Relaxed)).filter(|at| *at > 0).map(Timestamp::from_nanos)
    }

    fn is_quiet(&self) -> bool {
        self.is_quiet.load(Ordering::Relaxed)
    }

    fn note_data(&self, now: Timestamp) {
        self.last.store(now.as_nanos().max(1), Ordering::Relaxed);
        self.is_quiet.store(false, Ordering::Relaxed);
    }
}

/// Orders to the task of a topic.
pub struct Orders {
    /// Changes when discovery has news of this topic.
    pub discovered: watch::Receiver<u64>,
    /// The fields to read; marked as changed at every new configuration, even if they are the same.
    pub subscription: watch::Receiver<Arc<Subscription>>,
}

pub struct Topic {
    subscription: Arc<Subscription>,
    /// Until then discovery may not have found everybody.
    searching_until: Timestamp,
    /// The publishers and the other type that were reported last.
    said: Option<PublisherReport>,
    /// Messages may have been lost since the reader before this one, and nothing was said of that.
    anew: bool,
    /// It was reported that last values are not asked for.
    told_of_mix: bool,
    /// When the present writers were taken last.
    followed: Timestamp,
    trial: Arc<Trial>,
    around: TopicContext,
    readers: Readers,
    state: TopicState,
    queue: EngineQueue,
    /// The last values that the participant or the reader before this one heard. Their publishers repeat them; the engine
    /// forgot them when those ended.
    forgotten: LastValues,
    /// Of a topic that is only recorded: when the next message may be.
    recorded_from: Timestamp,
    /// Of another one: what is recorded whole.
    kept: Kept,
}

impl Topic {
    pub fn new(
        subscription: Arc<Subscription>,
        around: TopicContext,
        mut state: TopicState,
        trial: Arc<Trial>,
    ) -> Topic {
        state.writers.listen(around.clock.wall());
        if let Some(heard) = state.heard {
            trial.note_data(heard);
        }
        let depth = state.retention.depth();
        let readers = Readers::new(around.participant.clone(), &subscription, depth, around.clock.now());
        let queue = EngineQueue::new(around.inputs.clone(), around.stop.clone());
        let forgotten = state.last_values.clone();
        let topic = Topic {
            subscription,
            searching_until: around.clock.now() + DISCOVERY,
            said: None,
            anew: state.heard.is_some(),
            told_of_mix: false,
            followed: Timestamp::ZERO,
            trial,
            around,
            readers,
            state,
            queue,
            forgotten,
            recorded_from: Timestamp::ZERO,
            kept: Kept::default(),
        };
        topic.around.paces.begin(&topic.subscription.dds_topic, topic.around.clock.now());
        topic
    }

    /// Reads until the end, or until nobody gives orders any more.
    pub async fn run(mut self, mut orders: Orders) -> (TopicState, End) {
        let end = match self.read(&mut orders).await {
            Ok(never) => match never {},
            Err(end) => end,
        };
        (self.state, end)
    }

    async fn read(&mut self, orders: &mut Orders) -> Result<std::convert::Infallible, End> {
        let (mut batch, mut faults) = (Vec::new(), Vec::new());
        let mut stop = self.around.stop.clone();
        self.follow_discovery();
        loop {
            let follow = self.follow_due();
            let due = [self.state.troubles.due(), self.news_due(), follow].into_iter().flatten().min();
            let due = due.map(|due| self.around.clock.instant(due));
            tokio::select! {
                biased;
                () = stopped(&mut stop) => return Err(End::Stopped),
                changed = orders.subscription.changed() => {
                    changed.map_err(|_| End::Stopped)?;
                    let next = orders.subscription.borrow_and_update().clone();
                    self.follow_configuration(next).await?;
                }
                news = orders.discovered.changed() => {
                    news.map_err(|_| End::Stopped)?;
                    self.follow_discovery();
                }
                () = until(due) => {}
                () = poll_fn(|context| self.readers.poll(context, &mut batch, &mut faults)) => {
                    let received = self.around.clock.now();
                    match (self.readers.may_have_missed(), self.readers.asks_for_last_value()) {
                        (true, true) => self.state.writers.may_miss(&self.subscription.dds_type),
                        (true, false) => self.state.writers.may_miss_any(),
                        (false, _) => {}
                    }
                    self.take_faults(&mut faults);
                    self.take_batch(&mut batch, received).await?;
                }
            }
            if follow.is_some_and(|due| due <= self.around.clock.now()) {
                self.follow_discovery();
            }
            self.tell_troubles().await?;
            self.tell_news().await?;
        }
    }

    /// Reads by another configuration from now on. It gets the last values as a late joiner does, and the
    /// publishers are reported again.
    async fn follow_configuration(&mut self, next: Arc<Subscription>) -> Result<(), End> {
        self.subscription = next;
        self.said = None;
        self.follow_discovery();
        self.tell_news().await?;
        if self.subscription.wants_last_value() { self.tell_last_values().await } else { Ok(()) }
    }

    async fn take_batch(&mut self, batch: &mut Vec<Sample>, received: Timestamp) -> Result<(), End> {
        let sizes = batch.iter().map(|sample| sample.body.as_ref().map_or(0, |(body, _)| body.len()));
        match self.state.retention.observe(sizes) {
            Advice::Fits => {}
            Advice::Deepen(depth) => self.readers.deepen(depth),
            Advice::Rebuild(depth) => {
                self.state.retention = Retention::with_depth(depth);
                return Err(End::Rebuild(format!(
                    "messages on {} are so large that only {depth} can be kept",
                    self.subscription.topic
                )));
            }
        }
        for sample in batch.drain(..) {
            self.take_sample(sample, received).await?;
            // A slow engine takes a large batch for seconds: a loss is told at once, not after it.
            self.tell_troubles().await?;
        }
        Ok(())
    }

    async fn take_sample(&mut self, sample: Sample, received: Timestamp) -> Result<(), End> {
        if self.state.writers.is_first_of_undiscovered(&sample.writer, received) {
            self.follow_discovery();
            self.tell_news().await?;
        }
        let dds_type = &self.subscription.dds_type;
        let published = self.state.writers.published(&sample.writer, sample.source, received);
        let troubles = &mut self.state.troubles;
        let came = Came { source: sample.source, received, is_now: published == Published::Now };
        let verdict = self.state.writers.judge(&sample.writer, sample.sequence, sample.via, dds_type, came);
        // A message that two readers received came once.
        if verdict != Verdict::Skip {
            self.around.paces.take(&self.subscription.dds_topic, received);
        }
        match verdict {
            Verdict::Skip => {
                return match self.forgotten.remove(&sample.writer, sample.sequence) {
                    Some(LastValue { message, at }) => {
                        self.state.writers.may_miss(dds_type);
                        self.hand_over(&message, (PublicationTime::Kept, received.since(at)), received).await
                    }
                    None => Ok(()),
                };
            }
            Verdict::WrongType => {
                let theirs = self.state.writers.type_name(&sample.writer).unwrap_or_default();
                troubles.add(TroubleKind::WrongType, 1, || wrong_type(theirs, &self.subscription));
                return Ok(());
            }
            Verdict::Take { lost: 0 } => {}
            Verdict::Take { lost } => troubles.add(TroubleKind::Lost, lost, || {
                format!("{lost} missing before number {} of a publisher", sample.sequence)
            }),
        }
        let wall = self.around.clock.wall();
        let late = self.state.delays.take(&sample.writer, sample.source, (received, wall));
        self.forgotten.forget(&sample.writer);
        self.trial.note_data(received);
        self.state.heard = Some(received);
        if let Some(every) = self.subscription.recorded_every() {
            if received < self.recorded_from {
                return Ok(());
            }
            self.recorded_from = received + every;
        }
        let keeps = self.state.writers.keeps_last_value(&sample.writer, dds_type);
        let message = Arc::new(Message {
            topic: self.subscription.topic.clone(),
            type_name: self.subscription.type_name.clone(),
            writer: sample.writer,
            sequence: sample.sequence,
            source: sample.source,
            received: wall,
            body: sample.body,
            left_out: 0,
            kept: keeps,
        });
        if keeps {
            self.state.last_values.take(&message, received - late);
        }
        let when = match published {
            Published::Now => PublicationTime::Now,
            Published::Unfound => PublicationTime::Late,
            Published::Before if keeps => {
                self.state.writers.may_miss(dds_type);
                PublicationTime::Kept
            }
            Published::Before => PublicationTime::Past,
        };
        self.hand_over(&message, (when, late), received).await
    }

    /// Sends the inputs that a message means.
    async fn hand_over(
        &mut self,
        message: &Arc<Message>,
        (when, late): (PublicationTime, Span),
        received: Timestamp,
    ) -> Result<(), End> {
        let Message { body, writer, .. } = &**message;
        self.state.writers.speaks(writer);
        let since_epoch = self.around.clock.wall().duration_since(UNIX_EPOCH).unwrap_or_default();
        let wall_ns = i64::try_from(since_epoch.as_nanos()).unwrap_or(i64::MAX);
        let received_message = Received { body, writer: *writer, wall_ns, when };
        let (mut inputs, wrong) = self.subscription.decode_by(received_message, &self.around.ros_clock);
        // Late messages of several writers come in any order: the signal is what the newest one says.
        let published = message.source.map(|source| (source, *writer));
        let newest = self.state.newest;
        let is_older = published.zip(newest).is_some_and(|(it, last)| it.1 != last.1 && it.0 < last.0);
        if is_older && (when != PublicationTime::Now || !late.is_zero()) {
            inputs.retain(|input| !matches!(input, Input::Signal { .. }));
        } else {
            self.state.newest = published.or(newest);
        }
        if !late.is_zero() {
            inputs.retain(|input| !self.subscription.is_over(input, late));
            for input in &mut inputs {
                match input {
                    Input::Diagnostics(array) => *array = std::mem::take(array).received_late(late),
                    Input::Sample(sample) => sample.delay = late,
                    _ => {}
                }
            }
        }
        let bytes = message.len();
        if let Some(wrong) = wrong {
            let text = || match (&wrong, body) {
                (NoValue::Fault(fault), Ok(_)) => format!("{fault}, of {bytes} in all"),
                _ => wrong.to_string(),
            };
            self.state.troubles.add(TroubleKind::Malformed, 1, text);
        }
        if inputs.is_empty() {
            inputs.push(Input::Tick);
        }
        let message = self.recorded(message, received);
        // The first of them accounts for the size of the message.
        let mut body_bytes = message.len();
        for input in inputs {
            let waiting = waiting_bytes(&input, bytes) + std::mem::take(&mut body_bytes);
            let stamped = Stamped { input, received, message: Some(message.clone()) };
            self.queue.send(stamped, waiting).await?;
        }
        Ok(())
    }

    /// The message as a recording has it: whole, or its times and its size.
    fn recorded(&mut self, message: &Arc<Message>, received: Timestamp) -> Arc<Message> {
        let bytes = message.len();
        match &message.body {
            Ok((_, endian)) if !self.kept.is_whole(self.subscription.keeping(), bytes, received) => {
                let body = Ok((Bytes::new(), *endian));
                Arc::new(Message { body, left_out: bytes, ..Message::clone(message) })
            }
            _ => message.clone(),
        }
    }

    fn take_faults(&mut self, faults: &mut Vec<String>) {
        for reason in faults.drain(..) {
            self.state.troubles.add(TroubleKind::Malformed, 1, || reason);
        }
    }

    async fn tell_troubles(&mut self) -> Result<(), End> {
        if self.state.troubles.due().is_none() {
            return Ok(());
        }
        let now = self.around.clock.now();
        for trouble in self.state.troubles.take(&self.subscription.topic, now) {
            // The numbers of the messages in a recording show what is missing; the operator has no use for it.
            if self.subscription.recorded_every().is_some() || self.trial.is_quiet() {
                continue;
            }
            self.queue.send(Stamped::new(Input::Reception(trouble), now), 0).await?;
        }
        Ok(())
    }

    /// When it is due to be reported that there is no publisher.
    fn news_due(&self) -> Option<Timestamp> {
        let silent = self.said.is_none() && self.subscription.watched().is_some() && !self.trial.is_quiet();
        silent.then_some(self.searching_until)
    }

    /// When another reader may fit, without any news of discovery.
    fn follow_due(&self) -> Option<Timestamp> {
        let fitting = self.state.writers.fitting_due(self.followed);
        [fitting, self.readers.overlap_ends()].into_iter().flatten().min()
    }

    /// Reports the publishers, if monitors watch the topic and they have changed.
    async fn tell_news(&mut self) -> Result<(), End> {
        let Some(source) = self.subscription.watched().filter(|_| !self.trial.is_quiet()) else {
            return Ok(());
        };
        let (publishers, other, transient_local, best_effort) =
            self.state.writers.publishers(&self.subscription.dds_type);
        let other_type: Option<Box<str>> = other.map(|theirs| messages::ros_type_name(theirs).into());
        let now = self.around.clock.now();
        let found = publishers > 0 || other_type.is_some();
        let source = source.clone();
        let is_settled = self.state.writers.settles_at(now).is_none();
        // Lost messages are sent again to a reliable reader alone, and kept ones to a reader that asks for them.
        let best_effort = best_effort || publishers > 0 && is_settled && !self.readers.any_reliable();
        let is_asked = !self.subscription.wants_last_value() || self.readers.asks_for_last_value();
        let transient_local = transient_local && (!is_settled || is_asked);
        let anew = self.anew && !transient_local || self.state.writers.may_have_missed();
        let news = PublisherReport { source, publishers, other_type, transient_local, best_effort, anew };
        if !anew && self.said.as_ref() == Some(&news)
            || self.said.is_none() && !found && now < self.searching_until
        {
            return Ok(());
        }
        if self.said.is_none() && !found && self.around.participant.is_searching() {
            self.searching_until = now + SEARCHED_AGAIN;
            return Ok(());
        }
        self.anew &= !is_settled && transient_local;
        self.state.writers.reported();
        self.said = Some(PublisherReport { anew: false, ..news.clone() });
        self.queue.send(Stamped::new(Input::Topic(news), now), 0).await?;
        // Messages that the publishers still keep are not missed.
        if anew && transient_local { self.tell_last_values().await } else { Ok(()) }
    }

    /// Hands over what the publishers keep for readers that come later.
    async fn tell_last_values(&mut self) -> Result<(), End> {
        let (writers, dds_type) = (&self.state.writers, &self.subscription.dds_type);
        for last in self.state.last_values.of(|writer| writers.keeps_last_value(writer, dds_type)) {
            let now = self.around.clock.now();
            self.hand_over(&last.message, (PublicationTime::Kept, now.since(last.at)), now).await?;
        }
        Ok(())
    }

    /// Takes the present writers, and chooses the readers that fit them.
    fn follow_discovery(&mut self) {
        let offers = offers(&self.around.participant, &self.subscription.dds_topic);
        let dds_type = &self.subscription.dds_type;
        let now = (self.around.clock.now(), self.around.clock.wall());
        self.followed = now.0;
        for theirs in self.state.writers.update(offers, dds_type, now) {
            let text = || wrong_type(&theirs, &self.subscription);
            self.state.troubles.add(TroubleKind::WrongType, 1, text);
        }
        let wants_last_value = self.subscription.wants_last_value();
        // While there is no publisher, the readers do not change.
        let fitting = self.state.writers.fitting(wants_last_value, dds_type, now.0);
        let Some(fitting) = fitting.or_else(|| self.readers.fitting()) else { return };
        let is_catching_up = self.state.writers.is_catching_up(dds_type);
        let was_reliable = self.readers.any_reliable();
        if self.readers.follow(fitting, is_catching_up, now.0) {
            match self.readers.any_reliable() {
                false => self.state.writers.heard_by_best_effort_alone(),
                true if !was_reliable && self.said.as_ref().is_some_and(|said| said.best_effort) => {
                    self.state.writers.may_miss_any();
                }
                true => {}
            }
            if self.subscription.watched().is_some() {
                self.forgotten = self.state.last_values.clone();
            }
        }
        if wants_last_value && self.state.writers.leaves_last_value(fitting, dds_type, now.0) {
            self.tell_of_mix();
        }
    }

    /// Reported once: it can be the reason for a signal that stays unknown.
    fn tell_of_mix(&mut self) {
        if !std::mem::replace(&mut self.told_of_mix, true) {
            tracing::info!(
                "{}: not all of its publishers keep their last value, so none is asked for it; what was \
                 published before Telltale listened counts with the next message",
                self.subscription.topic
            );
        }
    }
}

async fn until(due: Option<std::time::Instant>) {
    match due {
        Some(due) => tokio::time::sleep_until(due.into()).await,
        None => std::future::pending().await,
    }
}

/// The writers of a topic as discovery knows them.
fn offers(participant: &Participant, dds_topic: &str) -> BTreeMap<Guid, Offer> {
    let seen = participant.seen();
    let offers = seen.writers_of(dds_topic).map(|writer| {
        let Found { type_name, reliable, transient_local, .. } = writer;
        let (type_name, reliable, transient_local) = (type_name.clone(), *reliable, *transient_local);
        (writer.guid, Offer { type_name, reliable, transient_local })
    });
    offers.collect()
}

fn wrong_type(theirs: &str, subscription: &Subscription) -> String {
    let theirs = messages::ros_type_name(theirs);
    format!("topic has type {theirs}, configuration says {}", subscription.type_name)
}
