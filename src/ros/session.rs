//! The life of one participant: its topics are read until a new participant is needed.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{mpsc, watch};
use tokio::task::{JoinError, JoinSet};

use super::discovery::graph;
use super::discovery::graph::{MessageCounts, OwnParticipants};
use super::discovery::nodes::Nodes;
use super::discovery::peers;
use super::discovery::presence;
use super::discovery::status_writers;
use super::library::discovered::PREFIX;
use super::library::{Ended, Found, Participant};
use super::options::BridgeOptions;
use super::options::interfaces;
use super::options::interfaces::AddressWatch;
use super::outbox::{End, stopped};
use super::reading::clock_step::StepWatch;
use super::reading::learning::Learning;
use super::reading::topic::{Memory, Orders, Topic, TopicContext};
use crate::clock::Clock;
use crate::engine::discovery::Discovery;
use crate::msg::messages;
use crate::msg::messages::GidSize;
use crate::msg::received::Stamped;
use crate::msg::ros_clock::RosClock;
use crate::msg::subscription::{Plan, Subscription};

/// How often the clocks are compared; the addresses are compared at every fourth look.
const LOOK: Duration = Duration::from_millis(250);

/// Topics that are read for recordings alone, at most.
const RECORDED_MAX: usize = 256;

/// State that lives as long as the bridge.
pub struct BridgeContext {
    pub options: BridgeOptions,
    /// Changes at every new configuration.
    pub plan: watch::Receiver<Arc<Plan>>,
    pub inputs: mpsc::Sender<Stamped>,
    /// For the watchdogs that ask whether a node is there.
    pub nodes: watch::Sender<Nodes>,
    /// The size of a gid, as soon as it is known.
    pub gid_size: watch::Sender<Option<GidSize>>,
    pub clock: Clock,
    pub stop: watch::Receiver<bool>,
    /// The graph from discovery, and the number of received messages.
    pub discovery: Arc<watch::Sender<Arc<Discovery>>>,
    pub tallies: MessageCounts,
    pub siblings: OwnParticipants,
    pub ros_clock: RosClock,
    /// Changes when somebody asks for a new participant.
    pub rebuild: watch::Receiver<u64>,
}

/// A topic and its type, by their names on the wire.
type Key = (String, String);

/// State that a participant leaves to the next one.
#[derive(Default)]
pub struct Carryover {
    memories: BTreeMap<Key, Memory>,
}

/// Reads until the end. When it returns, the readers and everything else that holds the participant are
/// gone.
pub async fn run(participant: &Participant, ground: &BridgeContext, legacy: &mut Carryover) -> End {
    let _announcer = peers::announce(participant, &ground.options);
    let (stop, stopping) = watch::channel(false);
    let around = TopicContext {
        participant: participant.clone(),
        inputs: ground.inputs.clone(),
        clock: ground.clock,
        tallies: ground.tallies.clone(),
        ros_clock: ground.ros_clock.clone(),
        stop: stopping.clone(),
    };
    let mut plan = ground.plan.clone();
    let first = plan.borrow_and_update().clone();
    let is_wanted = |known: &Key| {
        let same = |it: &Subscription| key(it) == *known || it.is_untyped() && it.dds_topic == known.0;
        first.subscriptions.iter().any(|wanted| same(wanted))
    };
    let mut room = RECORDED_MAX;
    let mut is_recorded = |(topic, type_name): &Key| {
        let is_recorded = room > 0 && record(&first, topic, type_name).is_some();
        room -= usize::from(is_recorded);
        is_recorded
    };
    legacy.memories.retain(|known, _| is_wanted(known) || is_recorded(known));
    let mut topics = Topics::start(around, &first, legacy);
    let presence = tokio::spawn(presence::run(
        participant.clone(),
        presence::PresenceContext {
            nodes: ground.nodes.clone(),
            gid_size: ground.gid_size.clone(),
            clock: ground.clock,
            node: ground.options.whole_name(ground.options.node),
        },
        stopping.clone(),
    ));
    let (seen, tallies) = (ground.discovery.clone(), ground.tallies.clone());
    let looking = tokio::spawn(graph::run(
        participant.clone(),
        tallies,
        seen,
        (ground.nodes.subscribe(), ground.siblings.clone()),
        ground.clock,
        stopping.clone(),
    ));
    let (nodes, inputs) = (ground.nodes.subscribe(), ground.inputs.clone());
    let speaking =
        tokio::spawn(status_writers::run(participant.clone(), nodes, inputs, ground.clock, stopping));
    let end = watch_over(participant, ground, plan, &mut topics, legacy).await;
    // The receivers live in the tasks; without tasks there is nothing to stop.
    let _ = stop.send(true);
    while let Some(ended) = topics.tasks.join_next().await {
        keep(legacy, ended);
    }
    // A panic came from the library; the participant is dropped anyway.
    let _ = looking.await;
    let _ = speaking.await;
    let _ = presence.await;
    end
}

/// The tasks that read, and the channels for their orders.
struct Topics {
    tasks: JoinSet<(Key, Memory, End)>,
    running: BTreeMap<Key, Running>,
    /// Topics whose type is not known yet.
    learning: Learning,
    around: TopicContext,
    /// It was said that more topics are to be recorded than are read.
    is_full: bool,
}

struct Running {
    news: watch::Sender<u64>,
    subscription: watch::Sender<Arc<Subscription>>,
}

impl Topics {
    fn start(around: TopicContext, plan: &Plan, legacy: &mut Carryover) -> Topics {
        let learning = Learning::new(around.inputs.clone(), around.clock);
        let mut topics =
            Topics { tasks: JoinSet::new(), running: BTreeMap::new(), learning, around, is_full: false };
        for subscription in &topics.typed(plan) {
            topics.add(subscription, legacy);
        }
        topics
    }

    /// The topics of a plan that can be read at once. The types of the others must be learned; types that
    /// were learned before stay.
    fn typed(&mut self, plan: &Plan) -> Vec<Arc<Subscription>> {
        let known = |subscription: &Arc<Subscription>| {
            let running = self.running.keys().find(|(topic, _)| *topic == subscription.dds_topic);
            let type_name = messages::ros_type_name(&running.filter(|_| subscription.is_untyped())?.1);
            // A missing definition is reported where the type is learned, so that is done again.
            let learned = subscription.learn(&type_name).ok().filter(|learned| learned.missing.is_empty())?;
            Some(Arc::new(learned.subscription))
        };
        let all = plan.subscriptions.iter().map(|it| known(it).unwrap_or_else(|| it.clone()));
        let (untyped, typed) = all.partition(|subscription| subscription.is_untyped());
        self.learning.follow(untyped);
        typed
    }

    /// Reads the topics whose type a publisher has announced now.
    fn learn(&mut self, legacy: &mut Carryover) {
        for subscription in &self.learning.look(&self.around.participant) {
            self.add(subscription, legacy);
        }
    }

    /// Reads the topics that are published now and that the plan only records. Telltale's own participants are
    /// left out: a reader of its outputs would count as a listener.
    fn record(&mut self, plan: &Plan, siblings: &OwnParticipants, legacy: &mut Carryover) {
        if !plan.records_more() {
            return;
        }
        let own = self.around.participant.guid();
        let seen = self.around.participant.seen();
        let is_new = |found: &&Found| {
            let is_running = || self.running.contains_key(&(found.topic.clone(), found.type_name.clone()));
            found.guid[..PREFIX] != own[..PREFIX] && !siblings.has(&found.guid) && !is_running()
        };
        let found = seen.writers().filter(is_new);
        let found: BTreeMap<Key, Subscription> = found
            .filter_map(|found| record(plan, &found.topic, &found.type_name))
            .map(|subscription| (key(&subscription), subscription))
            .collect();
        drop(seen);
        let recorded = self.running.values().filter(|it| it.subscription.borrow().recorded_every().is_some());
        let room = RECORDED_MAX.saturating_sub(recorded.count());
        if found.len() > room && !std::mem::replace(&mut self.is_full, true) {
            tracing::warn!(
                "`recording.topics` names more than {RECORDED_MAX} topics: the further ones are not recorded"
            );
        }
        for subscription in found.into_values().take(room) {
            self.add(&Arc::new(subscription), legacy);
        }
    }

    fn add(&mut self, subscription: &Arc<Subscription>, legacy: &mut Carryover) {
        let key = key(subscription);
        let memory = legacy.memories.remove(&key).unwrap_or_else(|| Memory::new(subscription));
        let topic = Topic::new(subscription.clone(), self.around.clone(), memory);
        let (news, discovered) = watch::channel(0);
        let (change, changed) = watch::channel(subscription.clone());
        self.running.insert(key.clone(), Running { news, subscription: change });
        self.tasks.spawn(async move {
            let (memory, end) = topic.run(Orders { discovered, subscription: changed }).await;
            (key, memory, end)
        });
    }

    /// Reads the topics of another configuration: topics that stay are read on without a gap.
    ///
    /// # Errors
    /// That needs a new participant.
    async fn follow(&mut self, plan: &Plan, legacy: &mut Carryover) -> Result<(), End> {
        let subscriptions = self.typed(plan);
        let mut subscriptions = subscriptions;
        let recorded = self.running.keys().filter_map(|(topic, type_name)| record(plan, topic, type_name));
        subscriptions.extend(recorded.map(Arc::new));
        let wanted: BTreeSet<Key> = subscriptions.iter().map(|subscription| key(subscription)).collect();
        let gone = self.running.keys().filter(|key| !wanted.contains(*key)).cloned().collect::<Vec<_>>();
        for key in &gone {
            // Its task ends when it gets no more orders.
            self.running.remove(key);
        }
        for _ in &gone {
            if let Some(ended) = self.tasks.join_next().await {
                match keep(legacy, ended) {
                    End::Stopped => {}
                    other => return Err(other),
                }
            }
        }
        for subscription in &subscriptions {
            if let Some(running) = self.running.get(&key(subscription)) {
                running.subscription.send_replace(subscription.clone());
            } else if gone.iter().any(|(topic, _)| *topic == subscription.dds_topic) {
                return Err(End::Rebuild(format!("{} has another type now", subscription.topic)));
            } else {
                self.add(subscription, legacy);
            }
        }
        Ok(())
    }

    fn tell_all(&self) {
        for running in self.running.values() {
            running.news.send_modify(|count| *count += 1);
        }
    }
}

async fn watch_over(
    participant: &Participant,
    ground: &BridgeContext,
    mut plan: watch::Receiver<Arc<Plan>>,
    topics: &mut Topics,
    legacy: &mut Carryover,
) -> End {
    let mut news = participant.news();
    let clock = ground.clock;
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
            Ok(()) = plan.changed() => {
                let next = plan.borrow_and_update().clone();
                if let Err(end) = topics.follow(&next, legacy).await {
                    return end;
                }
                topics.learn(legacy);
                topics.record(&next, &ground.siblings, legacy);
            }
            ended = participant.ended() => return lost(ended),
            Some(ended) = topics.tasks.join_next() => return keep(legacy, ended),
            Ok(()) = news.changed() => topics.tell_all(),
            _ = looks.tick() => {
                look += 1;
                topics.learn(legacy);
                if look.is_multiple_of(4) {
                    let plan = plan.borrow().clone();
                    topics.record(&plan, &ground.siblings, legacy);
                }
                if let Some(back) = steps.look(clock.wall(), clock.now()) {
                    return End::Rebuild(format!("the wall clock was set back by {back:?}"));
                }
                // An error while listing the interfaces says nothing about them.
                if look.is_multiple_of(4) && interfaces::addresses().is_ok_and(|now| addresses.look(&now)) {
                    return End::Rebuild("the addresses of the network interfaces have changed".to_owned());
                }
            }
        }
    }
}

/// The subscription that only records this topic and type, by their names on the wire.
fn record(plan: &Plan, dds_topic: &str, dds_type: &str) -> Option<Subscription> {
    let topic = dds_topic.strip_prefix("rt")?;
    plan.recorded(topic, &messages::ros_type_name(dds_type)).filter(|it| it.dds_type == *dds_type)
}

/// Why a participant is unusable.
fn lost(ended: Ended) -> End {
    let reason = ended.reason.into_string();
    if ended.ill { End::Lost(reason) } else { End::Rebuild(reason) }
}

/// Keeps the memory of an ended topic. A task that panicked, in the library, leaves none.
fn keep(legacy: &mut Carryover, ended: Result<(Key, Memory, End), JoinError>) -> End {
    match ended {
        Ok((key, memory, end)) => {
            legacy.memories.insert(key, memory);
            end
        }
        Err(panic) => End::Rebuild(format!("the task of a topic failed: {panic}")),
    }
}

fn key(subscription: &Subscription) -> Key {
    (subscription.dds_topic.clone(), subscription.dds_type.clone())
}
