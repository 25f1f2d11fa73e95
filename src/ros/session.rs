//! The life of one participant: its topics are read until something asks for another one.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use futures_util::StreamExt;
use rustdds::dds::CreateResult;
use rustdds::{
    DomainParticipant, DomainParticipantBuilder, DomainParticipantStatusEvent as Event, QosPolicyBuilder,
    StatusEvented, Subscriber,
};
use tokio::sync::{mpsc, watch};
use tokio::task::{JoinError, JoinHandle, JoinSet};

use super::BridgeError;
use super::graph::{self, Tallies};
use super::interfaces::{self, AddressWatch};
use super::messages::GidSize;
use super::options::{self, BridgeOptions};
use super::outbox::{End, stopped};
use super::presence;
use super::step::StepWatch;
use super::subscription::Subscription;
use super::topic::{Memory, Surroundings, Topic};
use crate::clock::Clock;
use crate::engine::discovery::Discovery;
use crate::engine::input::Stamped;
use crate::engine::model::Model;

/// How often the clocks are compared; the addresses are at every fourth look.
const LOOK: Duration = Duration::from_millis(250);
/// How often every topic asks discovery anew, should an event have been missed: they are dropped
/// in a flood.
const DISCOVERY_LOOKS: u64 = 20;

/// What lasts as long as the bridge.
pub struct Ground {
    pub options: BridgeOptions,
    pub model: Arc<Model>,
    pub subscriptions: Vec<Arc<Subscription>>,
    pub inputs: mpsc::Sender<Stamped>,
    pub clock: Clock,
    pub stop: watch::Receiver<bool>,
    /// What discovery sees, and how much of it was received.
    pub discovery: Arc<watch::Sender<Arc<Discovery>>>,
    pub tallies: Tallies,
    /// Changes when somebody asks for a new participant.
    pub rebuild: watch::Receiver<u64>,
}

/// What a participant leaves to the next one.
#[derive(Default)]
pub struct Legacy {
    memories: BTreeMap<usize, Memory>,
    gid_size: Option<GidSize>,
}

/// Makes a participant. It blocks for some milliseconds, so it runs aside.
///
/// # Errors
/// The interface is not there, or no socket or port is to be had.
pub async fn open(options: &BridgeOptions) -> Result<DomainParticipant, BridgeError> {
    let networks = options::networks(options.interface)?;
    let domain = options.domain;
    let build = move || {
        let mut builder = DomainParticipantBuilder::new(domain);
        if let Some(addresses) = networks {
            builder = builder.with_only_networks(addresses);
        }
        builder.build()
    };
    match tokio::task::spawn_blocking(build).await {
        Ok(built) => built.map_err(|error| BridgeError::Participant(error.to_string())),
        Err(panic) => Err(BridgeError::Participant(panic.to_string())),
    }
}

/// Drops a participant aside: it waits for its threads.
pub fn close(participant: DomainParticipant) -> JoinHandle<()> {
    tokio::task::spawn_blocking(move || drop(participant))
}

/// Reads until the end. The readers are gone when it returns, and after them all else that holds
/// the participant.
pub async fn run(participant: &DomainParticipant, ground: &Ground, legacy: &mut Legacy) -> End {
    let subscriber = match participant.create_subscriber(&QosPolicyBuilder::new().build()) {
        Ok(subscriber) => subscriber,
        Err(error) => return End::Rebuild(error.to_string()),
    };
    let (stop, stopping) = watch::channel(false);
    let mut topics = match Topics::start(participant, &subscriber, ground, legacy, stopping.clone()) {
        Ok(topics) => topics,
        Err(error) => return End::Rebuild(error.to_string()),
    };
    let presence = tokio::spawn(presence::run(
        participant.clone(),
        subscriber,
        ground.options.gid_size.or(legacy.gid_size),
        topics.own_readers.subscribe(),
        stopping.clone(),
    ));
    let (seen, tallies) = (ground.discovery.clone(), ground.tallies.clone());
    let looking = tokio::spawn(graph::run(participant.clone(), tallies, seen, ground.clock, stopping));
    let end = watch_over(participant, ground, &mut topics, legacy).await;
    // The receivers live in the tasks; with none left there is nothing to stop.
    let _ = stop.send(true);
    while let Some(ended) = topics.tasks.join_next().await {
        keep(legacy, ended);
    }
    // A panic was in the library; the participant is dropped all the same.
    let _ = looking.await;
    legacy.gid_size = presence.await.ok().flatten();
    end
}

/// The tasks that read, and the way to tell them of discovery.
struct Topics {
    tasks: JoinSet<(usize, Memory, End)>,
    /// By the name on the wire.
    news: BTreeMap<String, watch::Sender<u64>>,
    own_readers: Arc<watch::Sender<BTreeSet<super::writers::Guid>>>,
}

impl Topics {
    fn start(
        participant: &DomainParticipant,
        subscriber: &Subscriber,
        ground: &Ground,
        legacy: &mut Legacy,
        stop: watch::Receiver<bool>,
    ) -> CreateResult<Topics> {
        let around = Surroundings {
            participant: participant.clone(),
            subscriber: subscriber.clone(),
            model: ground.model.clone(),
            inputs: ground.inputs.clone(),
            clock: ground.clock,
            tallies: ground.tallies.clone(),
            own_readers: Arc::new(watch::channel(BTreeSet::new()).0),
            stop,
        };
        let mut topics =
            Topics { tasks: JoinSet::new(), news: BTreeMap::new(), own_readers: around.own_readers.clone() };
        for (index, subscription) in ground.subscriptions.iter().enumerate() {
            let memory = legacy.memories.remove(&index).unwrap_or_else(Memory::new);
            let topic = Topic::new(subscription.clone(), around.clone(), memory)?;
            let (news, discovered) = watch::channel(0);
            topics.news.insert(subscription.dds_topic.clone(), news);
            topics.tasks.spawn(async move {
                let (memory, end) = topic.run(discovered).await;
                (index, memory, end)
            });
        }
        Ok(topics)
    }

    /// Has the topic that an event concerns ask discovery, or all if it does not say which.
    fn tell(&self, event: &Event) {
        match event {
            Event::WriterDetected { writer } => {
                if let Some(news) = self.news.get(&writer.topic_name) {
                    news.send_modify(|count| *count += 1);
                }
            }
            Event::WriterLost { .. } | Event::ParticipantLost { .. } => self.tell_all(),
            _ => {}
        }
    }

    fn tell_all(&self) {
        for news in self.news.values() {
            news.send_modify(|count| *count += 1);
        }
    }
}

async fn watch_over(
    participant: &DomainParticipant,
    ground: &Ground,
    topics: &mut Topics,
    legacy: &mut Legacy,
) -> End {
    let listener = participant.status_listener();
    let mut events = listener.as_async_status_stream();
    let clock = ground.clock;
    let mut pulse = Pulse::default();
    let mut steps = StepWatch::new(clock.wall(), clock.now());
    let now = interfaces::addresses().unwrap_or_default();
    let mut addresses = AddressWatch::new(ground.options.interface, &now);
    let (mut stop, mut rebuild) = (ground.stop.clone(), ground.rebuild.clone());
    rebuild.mark_unchanged();
    let mut looks = tokio::time::interval(LOOK);
    looks.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
    let mut look = 0_u64;
    loop {
        tokio::select! {
            () = stopped(&mut stop) => return End::Stopped,
            Ok(()) = rebuild.changed() => return End::Rebuild("asked for".to_owned()),
            Some(ended) = topics.tasks.join_next() => return keep(legacy, ended),
            Some(event) = events.next() => topics.tell(&event),
            _ = looks.tick() => {
                look += 1;
                if pulse.has_stopped(participant) {
                    return End::Rebuild("the threads of the DDS library have ended".to_owned());
                }
                if let Some(back) = steps.look(clock.wall(), clock.now()) {
                    return End::Rebuild(format!("the wall clock was set back by {back:?}"));
                }
                // An error to list the interfaces says nothing about them.
                if look.is_multiple_of(4) && interfaces::addresses().is_ok_and(|now| addresses.look(&now)) {
                    return End::Rebuild("the addresses of the network interfaces have changed".to_owned());
                }
                if look.is_multiple_of(DISCOVERY_LOOKS) {
                    topics.tell_all();
                }
            }
        }
    }
}

/// Notices that the threads of a participant have ended: they do, and say so only in the log, when
/// a stopped process goes on (`SIGSTOP`, Ctrl-Z, a debugger) and their system call is interrupted.
#[derive(Debug, Default)]
pub struct Pulse {
    misses: u32,
}

impl Pulse {
    /// To be asked every now and then. One miss alone may be a full queue.
    pub fn has_stopped(&mut self, participant: &DomainParticipant) -> bool {
        // It has no effect but on writers that must assert their own liveliness; there are none.
        let missed = participant.assert_liveliness().is_err();
        self.misses = if missed { self.misses + 1 } else { 0 };
        self.misses >= 2
    }
}

/// Keeps what an ended topic remembers. One that panicked, in the library, remembers nothing.
fn keep(legacy: &mut Legacy, ended: Result<(usize, Memory, End), JoinError>) -> End {
    match ended {
        Ok((index, memory, end)) => {
            legacy.memories.insert(index, memory);
            end
        }
        Err(panic) => End::Rebuild(format!("the task of a topic failed: {panic}")),
    }
}
