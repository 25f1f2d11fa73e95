//! The life of one participant: its topics are read until a new participant is needed.

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{mpsc, watch};
use tokio::task::JoinSet;

use super::discovery::graph::{self, OwnParticipants, Paces};
use super::discovery::nodes::Nodes;
use super::discovery::{peers, presence, status_writers};
use super::engine_queue::{End, stopped};
use super::options::BridgeOptions;
use super::options::interfaces::{self, AddressWatch};
use super::probe::lifecycle::{self, LifecycleContext};
use super::reading::clock_step::StepWatch;
use super::reading::topic::TopicContext;
use super::reading::topics::{Carryover, Topics};
use super::transport::{Ended, Participant};
use crate::every;
use telltale_clock::Clock;
use telltale_engine::discovery::Discovery;
use telltale_engine::time::Timestamp;
use telltale_msg::messages::GidSize;
use telltale_msg::received::Stamped;
use telltale_msg::ros_clock::RosClock;
use telltale_msg::subscription::Plan;

/// How often the clocks are compared; the addresses are compared at every fourth look.
const LOOK: Duration = Duration::from_millis(250);

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
    pub paces: Paces,
    pub siblings: OwnParticipants,
    pub ros_clock: RosClock,
    /// When the bridge last did its work.
    pub works: watch::Sender<Timestamp>,
    /// Whether more topics are to be recorded than are read.
    pub unrecorded: watch::Sender<bool>,
    /// Changes when somebody asks for a new participant.
    pub rebuild: watch::Receiver<u64>,
}

/// Reads until the end. When it returns, the readers and everything else that holds the participant are
/// gone.
pub async fn run(participant: &Participant, context: &BridgeContext, carried: &mut Carryover) -> End {
    let _announcer = peers::announce(participant, &context.options);
    let (stop, stopping) = watch::channel(false);
    let around = TopicContext {
        participant: participant.clone(),
        inputs: context.inputs.clone(),
        clock: context.clock,
        paces: context.paces.clone(),
        ros_clock: context.ros_clock.clone(),
        stop: stopping.clone(),
    };
    let mut plan = context.plan.clone();
    let first = plan.borrow_and_update().clone();
    carried.keep_what_is_read(&first);
    let mut topics = Topics::start(around, &first, carried);
    let mut others = JoinSet::new();
    others.spawn(presence::run(
        participant.clone(),
        presence::PresenceContext {
            nodes: context.nodes.clone(),
            gid_size: context.gid_size.clone(),
            clock: context.clock,
            node: context.options.whole_name(context.options.node),
            plan: context.plan.clone(),
        },
        stopping.clone(),
    ));
    let (seen, paces) = (context.discovery.clone(), context.paces.clone());
    others.spawn(graph::run(
        participant.clone(),
        paces,
        seen,
        (context.nodes.subscribe(), context.siblings.clone(), context.plan.clone()),
        context.clock,
        stopping.clone(),
    ));
    let (nodes, inputs) = (context.nodes.subscribe(), context.inputs.clone());
    others.spawn(status_writers::run(
        participant.clone(),
        nodes.clone(),
        inputs.clone(),
        context.clock,
        stopping.clone(),
    ));
    let asking = LifecycleContext { participant: participant.clone(), inputs, nodes, clock: context.clock };
    others.spawn(lifecycle::run(asking, context.plan.clone(), stopping));
    let end = watch_over(participant, context, plan, (&mut topics, &mut others), carried).await;
    // The receivers live in the tasks; without tasks there is nothing to stop.
    let _ = stop.send(true);
    topics.close(carried).await;
    while others.join_next().await.is_some() {}
    end
}

async fn watch_over(
    participant: &Participant,
    context: &BridgeContext,
    mut plan: watch::Receiver<Arc<Plan>>,
    (topics, others): (&mut Topics, &mut JoinSet<()>),
    carried: &mut Carryover,
) -> End {
    let mut news = participant.news();
    // Endpoints that are discovered already are news, too: on Zenoh no other may follow.
    news.mark_changed();
    let clock = context.clock;
    let mut steps = StepWatch::new(clock.wall(), clock.now());
    let now = interfaces::addresses().unwrap_or_default();
    let mut addresses = AddressWatch::new(context.options.interface, &now);
    let (mut stop, mut rebuild) = (context.stop.clone(), context.rebuild.clone());
    rebuild.mark_unchanged();
    let mut looks = every(LOOK);
    let mut look = 0_u64;
    loop {
        tokio::select! {
            () = stopped(&mut stop) => return End::Stopped,
            Ok(()) = rebuild.changed() => return End::Rebuild("asked for".to_owned()),
            Ok(()) = plan.changed() => {
                let next = plan.borrow_and_update().clone();
                if let Err(end) = topics.follow(&next, carried).await {
                    return end;
                }
                topics.learn(carried);
                context.unrecorded.send_replace(topics.record(&next, &context.siblings, carried));
            }
            ended = participant.ended() => return lost(ended),
            Some(ended) = topics.tasks.join_next() => if let Some(end) = topics.ended(ended, carried) {
                return end;
            },
            Some(ended) = others.join_next() => return match ended {
                Ok(()) if context.inputs.is_closed() => End::NobodyListens,
                Ok(()) => End::Lost("discovery is no longer followed, and nobody asked for that".to_owned()),
                Err(panic) => End::Lost(format!("the task of discovery failed: {panic}")),
            },
            Ok(()) = news.changed() => topics.tell_all(),
            _ = looks.tick() => {
                look += 1;
                context.works.send_replace(clock.now());
                topics.learn(carried);
                if look.is_multiple_of(4) {
                    let plan = plan.borrow().clone();
                    context.unrecorded.send_replace(topics.record(&plan, &context.siblings, carried));
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

/// Why a participant is unusable.
fn lost(ended: Ended) -> End {
    let reason = ended.reason.into_string();
    if ended.ill { End::Lost(reason) } else { End::Rebuild(reason) }
}
