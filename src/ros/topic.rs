//! One topic in a task of its own: what its readers receive becomes inputs.

use std::collections::{BTreeMap, BTreeSet};
use std::future::poll_fn;
use std::sync::Arc;

use rustdds::dds::CreateError;
use rustdds::{DomainParticipant, Subscriber};
use tokio::sync::{mpsc, watch};

use super::graph::Tallies;
use super::messages;
use super::outbox::{End, Outbox, stopped};
use super::readers::{Advice, ReadFault, Readers, Retention, Sample};
use super::subscription::Subscription;
use super::trouble::Troubles;
use super::writers::{Guid, Offer, Verdict, Via, Writers};
use crate::clock::Clock;
use crate::engine::input::{Input, Stamped, TroubleKind};
use crate::engine::model::Model;
use crate::engine::time::Timestamp;

/// Writers that discovery does not know are asked for again only after it has news.
const UNKNOWN_MAX: usize = 1024;

/// Gids of the readers in use, for the announcement of our node.
pub type OwnReaders = Arc<watch::Sender<BTreeSet<Guid>>>;

/// What every topic of a participant's life shares.
#[derive(Clone)]
pub struct Surroundings {
    pub participant: DomainParticipant,
    pub subscriber: Subscriber,
    pub model: Arc<Model>,
    pub inputs: mpsc::Sender<Stamped>,
    pub clock: Clock,
    pub own_readers: OwnReaders,
    /// Counts what is received.
    pub tallies: Tallies,
    pub stop: watch::Receiver<bool>,
}

/// What outlives a participant: gaps are counted across a rebuild, and what was seen before it is
/// not taken again.
#[derive(Debug)]
pub struct Memory {
    writers: Writers,
    troubles: Troubles,
    retention: Retention,
}

impl Memory {
    pub fn new() -> Memory {
        Memory { writers: Writers::default(), troubles: Troubles::default(), retention: Retention::new() }
    }
}

pub struct Topic {
    subscription: Arc<Subscription>,
    around: Surroundings,
    readers: Readers,
    memory: Memory,
    outbox: Outbox,
    unknown: BTreeSet<Guid>,
}

impl Topic {
    /// # Errors
    /// The library's own.
    pub fn new(
        subscription: Arc<Subscription>,
        around: Surroundings,
        memory: Memory,
    ) -> Result<Topic, CreateError> {
        let depth = memory.retention.depth();
        let readers =
            Readers::new(around.participant.clone(), around.subscriber.clone(), &subscription, depth)?;
        let outbox = Outbox::new(around.inputs.clone(), around.stop.clone());
        let topic = Topic { subscription, around, readers, memory, outbox, unknown: BTreeSet::new() };
        topic.tell_readers();
        // Nothing yet is a rate too.
        topic.around.tallies.add(&topic.subscription.dds_topic, 0);
        Ok(topic)
    }

    /// Reads until the end. `discovered` changes when discovery has news of this topic.
    pub async fn run(mut self, mut discovered: watch::Receiver<u64>) -> (Memory, End) {
        let end = match self.read(&mut discovered).await {
            Ok(never) => match never {},
            Err(end) => end,
        };
        (self.memory, end)
    }

    async fn read(&mut self, discovered: &mut watch::Receiver<u64>) -> Result<std::convert::Infallible, End> {
        let (mut batch, mut faults) = (Vec::new(), Vec::new());
        let mut stop = self.around.stop.clone();
        self.follow_discovery()?;
        loop {
            let due = self.memory.troubles.due().map(|due| self.around.clock.instant(due));
            tokio::select! {
                biased;
                () = stopped(&mut stop) => return Err(End::Stopped),
                news = discovered.changed() => {
                    news.map_err(|_| End::Stopped)?;
                    self.follow_discovery()?;
                }
                () = until(due) => {}
                () = poll_fn(|context| self.readers.poll(context, &mut batch, &mut faults)) => {
                    let received = self.around.clock.now();
                    self.take_faults(&mut faults)?;
                    self.take_batch(&mut batch, received).await?;
                }
            }
            self.tell_troubles().await?;
        }
    }

    async fn take_batch(&mut self, batch: &mut Vec<Sample>, received: Timestamp) -> Result<(), End> {
        let sizes = batch.iter().map(|sample| sample.body.as_ref().map_or(0, |(body, _)| body.len()));
        match self.memory.retention.observe(sizes) {
            Advice::Fits => {}
            Advice::Deepen(depth) => self.readers.deepen(depth).map_err(|error| broken(&error))?,
            Advice::Rebuild(depth) => {
                self.memory.retention = Retention::with_depth(depth);
                return Err(End::Rebuild(format!(
                    "messages on {} are so large that only {depth} can be kept",
                    self.subscription.topic
                )));
            }
        }
        self.around.tallies.add(&self.subscription.dds_topic, batch.len());
        for sample in batch.drain(..) {
            self.take_sample(sample, received).await?;
        }
        Ok(())
    }

    async fn take_sample(&mut self, sample: Sample, received: Timestamp) -> Result<(), End> {
        if !self.memory.writers.knows(&sample.writer) && !self.unknown.contains(&sample.writer) {
            self.follow_discovery()?;
            if !self.memory.writers.knows(&sample.writer) && self.unknown.len() < UNKNOWN_MAX {
                self.unknown.insert(sample.writer);
            }
        }
        if !self.subscription.wants_last_value()
            && self.memory.writers.is_history(&sample.writer, sample.source, received)
        {
            return Ok(());
        }
        let dds_type = &self.subscription.dds_type;
        let troubles = &mut self.memory.troubles;
        match self.memory.writers.judge(&sample.writer, sample.sequence, sample.via, dds_type) {
            Verdict::Skip => return Ok(()),
            Verdict::WrongType => {
                let theirs = self.memory.writers.type_name(&sample.writer).unwrap_or_default();
                troubles.add(TroubleKind::WrongType, 1, || wrong_type(theirs, &self.subscription));
                return Ok(());
            }
            Verdict::Take { lost: 0 } => {}
            Verdict::Take { lost } => troubles.add(TroubleKind::Lost, lost, || {
                format!("{lost} missing before number {} of a publisher", sample.sequence)
            }),
        }
        let (body, endian) = match sample.body {
            Ok(body) => body,
            Err(fault) => {
                troubles.add(TroubleKind::Malformed, 1, || fault.to_string());
                return Ok(());
            }
        };
        let (inputs, fault) = self.subscription.decode(&body, endian, &self.around.model.limits);
        if let Some(fault) = fault {
            troubles.add(TroubleKind::Malformed, 1, || format!("{fault}, of {} in all", body.len()));
        }
        for input in inputs {
            self.outbox.send(input, received, body.len()).await?;
        }
        Ok(())
    }

    fn take_faults(&mut self, faults: &mut Vec<ReadFault>) -> Result<(), End> {
        for fault in faults.drain(..) {
            match fault {
                ReadFault::Sample(reason) => self.memory.troubles.add(TroubleKind::Malformed, 1, || reason),
                ReadFault::Broken(reason) => return Err(End::Rebuild(reason)),
            }
        }
        Ok(())
    }

    async fn tell_troubles(&mut self) -> Result<(), End> {
        let now = self.around.clock.now();
        for trouble in self.memory.troubles.take(&self.subscription.topic, now) {
            self.outbox.send(Input::Reception(trouble), now, 0).await?;
        }
        Ok(())
    }

    /// Takes over which writers there are, and creates the readers that they need.
    fn follow_discovery(&mut self) -> Result<(), End> {
        let offers = offers(&self.around.participant, &self.subscription.dds_topic);
        let dds_type = &self.subscription.dds_type;
        self.unknown.clear();
        let now = (self.around.clock.now(), self.around.clock.wall());
        for theirs in self.memory.writers.update(offers, dds_type, now) {
            let text = || wrong_type(&theirs, &self.subscription);
            self.memory.troubles.add(TroubleKind::WrongType, 1, text);
        }
        let mut wanted = vec![Via::BestEffort];
        if self.subscription.wants_last_value() {
            wanted.push(Via::LastValue);
        }
        wanted.retain(|&via| self.memory.writers.need(via, dds_type) && !self.readers.has(via));
        for &via in &wanted {
            self.readers.ensure(via).map_err(|error| broken(&error))?;
        }
        if !wanted.is_empty() {
            self.tell_readers();
        }
        Ok(())
    }

    fn tell_readers(&self) {
        self.around.own_readers.send_modify(|known| known.extend(self.readers.guids()));
    }
}

async fn until(due: Option<std::time::Instant>) {
    match due {
        Some(due) => tokio::time::sleep_until(due.into()).await,
        None => std::future::pending().await,
    }
}

/// What discovery knows of the writers of a topic.
fn offers(participant: &DomainParticipant, dds_topic: &str) -> BTreeMap<Guid, Offer> {
    use rustdds::policy::{Durability, Reliability};
    let writers = participant.discovered_writers().into_iter().map(|found| found.publication_topic_data);
    let ours = writers.filter(|writer| writer.topic_name == dds_topic).map(|writer| {
        let offer = Offer {
            // A writer that does not say is reliable and volatile (DDS 1.4, 2.2.3).
            reliable: writer.reliability != Some(Reliability::BestEffort),
            transient_local: writer.durability.is_some_and(|kind| kind >= Durability::TransientLocal),
            type_name: writer.type_name,
        };
        (writer.key.to_bytes(), offer)
    });
    ours.collect()
}

fn wrong_type(theirs: &str, subscription: &Subscription) -> String {
    let theirs = messages::ros_type_name(theirs);
    format!("topic has type {theirs}, configuration says {}", subscription.type_name)
}

fn broken(error: &CreateError) -> End {
    End::Rebuild(format!("the DDS library refused a reader: {error}"))
}
