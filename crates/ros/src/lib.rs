//! The DDS bridge: turns what the vehicle's ROS 2 nodes publish into
//! [`Input`](telltale_engine::input::Input)s.
//!
//! The participant that reads has a task for each topic, raw readers and a lenient decoder; publishing and services
//! have participants of their own. Where the DDS library cannot recover by itself, the participant is replaced and
//! the bridge goes on.

#![deny(clippy::print_stdout, clippy::print_stderr)]

mod discovery;
mod engine_queue;
mod name_lookup;
mod options;
mod probe;
pub mod publish;
mod reading;
pub mod services;
mod session;
mod transport;

use std::sync::Arc;
use std::time::Duration;

use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;
use tokio::time::{Interval, MissedTickBehavior};

pub use discovery::nodes::Nodes;
pub use options::interfaces::{Address, addresses};
pub use options::{BridgeOptions, DOMAIN_MAX, DdsProcess, Interface, OptionsError, Transport};
pub use publish::publisher::{PublishError, Publisher};
pub use telltale_engine::model::monitors::DIAGNOSTICS;
pub use telltale_msg::subscription::SubscriptionError;
pub use transport::ZenohRouter;
pub use transport::process as dds_process;
pub use transport::quality::Quality;

use discovery::graph::{OwnParticipants, Paces};
use engine_queue::{End, stopped};
use futures_util::FutureExt as _;
use probe::ProbeContext;
use reading::topics::Carryover;
use session::BridgeContext;
use telltale_clock::Clock;
use telltale_engine::discovery::Discovery;
use telltale_engine::input::Input;
use telltale_engine::model::Model;
use telltale_engine::time::Timestamp;
use telltale_msg::fields::Definitions;
use telltale_msg::messages::GidSize;
use telltale_msg::received::Stamped;
use telltale_msg::ros_clock::RosClock;
use telltale_msg::subscription::Plan;
use transport::Participant;

/// For the log's filter: each library writes a line for each forged packet, so anybody could fill the disk
/// with them. The bridge logs the important errors itself.
pub const LOG_FILTER: &str = "rustdds=off,zenoh=off";

/// The pause between two attempts to make a participant, and the shortest life of one.
const RETRY: Duration = Duration::from_secs(1);
/// The longest wait for the end of a participant before the next one.
const CLOSING_MAX: Duration = Duration::from_secs(1);

/// After an ill participant, the next one counts as sound once it has lived this long and hears itself.
const SETTLED: Duration = Duration::from_secs(2);

#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    #[error(transparent)]
    Options(#[from] OptionsError),
    #[error(transparent)]
    Subscription(#[from] SubscriptionError),
    #[error("DDS cannot be started: {0}")]
    Participant(String),
    /// It may be there later.
    #[error("Zenoh cannot be started: {0}")]
    Router(String),
}

/// The ROS 2 graph as the bridge knows it.
#[derive(Debug, Clone)]
pub struct Graph {
    pub gid_size: watch::Receiver<Option<GidSize>>,
    pub discovery: watch::Receiver<Arc<Discovery>>,
    /// Our other participants, whose endpoints are our own.
    siblings: OwnParticipants,
}

/// A running bridge. It ends when it is dropped; [`Bridge::shutdown`] also waits for that.
#[derive(Debug)]
pub struct Bridge {
    stop: watch::Sender<bool>,
    rebuild: watch::Sender<u64>,
    discovery: watch::Receiver<Arc<Discovery>>,
    plan: watch::Sender<Arc<Plan>>,
    definitions: Definitions,
    gid_size: watch::Receiver<Option<GidSize>>,
    siblings: OwnParticipants,
    working: watch::Receiver<Timestamp>,
    unrecorded: watch::Receiver<bool>,
    task: JoinHandle<()>,
}

/// Starts to read `/diagnostics`, the signals of the model and what its monitors watch. Every message is stamped with the
/// instant at which it was taken from the library.
///
/// When `inputs` is full, readers wait and the library keeps the newest messages of each topic. Lost
/// messages are counted in a [`ReceptionTrouble`](telltale_engine::input::ReceptionTrouble), from the first
/// message of each publisher on.
///
/// # Errors
/// The interface does not exist, a signal cannot be read, or DDS gets no sockets.
pub async fn start(
    options: BridgeOptions,
    model: &Model,
    inputs: mpsc::Sender<Stamped>,
    clock: Clock,
) -> Result<Bridge, BridgeError> {
    let (plan, planned) = watch::channel(Arc::new(Plan::of(model, &options.definitions)?));
    let participant = match Participant::open(&options).await {
        Ok(participant) => Some(participant),
        // Its router may be started later.
        Err(BridgeError::Router(_)) => None,
        Err(error) => return Err(error),
    };
    let (stop, stopping) = watch::channel(false);
    let (rebuild, rebuilding) = watch::channel(0);
    let definitions = options.definitions.clone();
    let (nodes, known_nodes) = watch::channel(Nodes::default());
    let (seen, discovery) = watch::channel(Arc::default());
    let probes =
        ProbeContext { inputs: inputs.clone(), nodes: known_nodes, discovery: discovery.clone(), clock };
    let (learn, gid_size) = watch::channel(options.gid_size);
    let siblings = OwnParticipants::default();
    let (works, working) = watch::channel(clock.now());
    let (tell_of_unrecorded, unrecorded) = watch::channel(false);
    let context = BridgeContext {
        options,
        plan: planned,
        inputs,
        nodes,
        gid_size: learn,
        clock,
        stop: stopping,
        discovery: Arc::new(seen),
        paces: Paces::default(),
        siblings: siblings.clone(),
        ros_clock: RosClock::default(),
        works,
        unrecorded: tell_of_unrecorded,
        rebuild: rebuilding,
    };
    let probing = probe::run(probes, context.plan.clone(), context.stop.clone());
    let probing = tokio::spawn(probing);
    let reading = read(participant, Arc::new(context));
    let task = tokio::spawn(async { tokio::join!(reading, probing) }.map(drop));
    Ok(Bridge { stop, rebuild, discovery, plan, definitions, gid_size, siblings, working, unrecorded, task })
}

/// Ticks at once and then in each period; where it was held up, the next tick comes a whole period later.
fn every(period: Duration) -> Interval {
    let mut interval = tokio::time::interval(period);
    interval.set_missed_tick_behavior(MissedTickBehavior::Delay);
    interval
}

impl Bridge {
    /// Reads the topics of another model. Topics that stay are read on without a gap, and everything that
    /// an engine forgets with its old model is sent again: so the engine must already run with the new
    /// model.
    ///
    /// # Errors
    /// A signal or a field cannot be read. Then nothing changes.
    pub fn follow(&self, model: &Model) -> Result<(), BridgeError> {
        self.plan.send_replace(Arc::new(Plan::of(model, &self.definitions)?));
        Ok(())
    }

    /// Replaces the participant, as the bridge does by itself when the wall clock is set back or
    /// the addresses of the interfaces change.
    pub fn rebuild(&self) {
        self.rebuild.send_modify(|count| *count += 1);
    }

    /// The graph of discovery, about once a second.
    pub fn discovery(&self) -> watch::Receiver<Arc<Discovery>> {
        self.discovery.clone()
    }

    /// The state of the graph for participants that only publish.
    pub fn graph(&self) -> Graph {
        let (gid_size, discovery) = (self.gid_size(), self.discovery());
        Graph { gid_size, discovery, siblings: self.siblings.clone() }
    }

    /// When the bridge last did its work, on its clock. An old time means that it hangs or has ended.
    pub fn working(&self) -> watch::Receiver<Timestamp> {
        self.working.clone()
    }

    /// Whether `recording.topics` names more topics than are recorded.
    pub fn unrecorded(&self) -> watch::Receiver<bool> {
        self.unrecorded.clone()
    }

    /// The size of a gid in the announcements of nodes, as soon as it is known.
    pub fn gid_size(&self) -> watch::Receiver<Option<GidSize>> {
        self.gid_size.clone()
    }

    /// Ends the readers, then the participant, and waits for its threads.
    pub async fn shutdown(self) {
        // An error means that the bridge has ended by itself: nobody took its inputs.
        let _ = self.stop.send(true);
        if let Err(panic) = self.task.await {
            tracing::error!("the bridge to ROS 2 failed: {panic}");
        }
    }
}

/// Reads until the bridge is to end. A fault of its own is reported, and it begins again.
async fn read(participant: Option<Participant>, context: Arc<BridgeContext>) {
    let mut down = false;
    let first = match participant {
        Some(participant) => Some(participant),
        None => reopen(&context, Duration::ZERO, &mut down).await,
    };
    let Some(mut participant) = first else { return };
    loop {
        let running = {
            let context = context.clone();
            async move { run(participant, &context, down).await }
        };
        let Err(panic) = tokio::spawn(running).await else { return };
        tracing::error!("the bridge to ROS 2 failed and begins again: {panic}");
        down = tell_of_dds(&context, Some("the bridge to ROS 2 failed and begins again")).await;
        match reopen(&context, RETRY, &mut down).await {
            Some(next) => participant = next,
            None => return,
        }
    }
}

async fn run(mut participant: Participant, context: &BridgeContext, mut down: bool) {
    let mut carried = Carryover::default();
    // Kept while a participant follows another.
    let _announced = participant.announced();
    loop {
        let started = context.clock.now();
        let end = {
            let mut session = std::pin::pin!(session::run(&participant, context, &mut carried));
            let over = tokio::select! {
                end = &mut session => Some(end),
                () = settled(&participant), if down => None,
            };
            match over {
                Some(end) => end,
                None => {
                    down = !tell_of_dds(context, None).await;
                    session.await
                }
            }
        };
        let closed = tokio::spawn(participant.close());
        match end {
            End::Rebuild(reason) => {
                tracing::warn!("the {} participant is replaced: {reason}", context.options.transport);
            }
            End::Lost(reason) => {
                let reason = format!("the {} process is replaced: {reason}", context.options.transport);
                tracing::error!("{reason}");
                down |= tell_of_dds(context, Some(&reason)).await;
            }
            End::Stopped | End::NobodyListens => return drop(closed.await),
        }
        // Others know the next one only after they have forgotten this one. It may be slow to end.
        let _ = tokio::time::timeout(CLOSING_MAX, closed).await;
        let lived = Duration::from_nanos(context.clock.now().since(started).as_nanos());
        match reopen(context, RETRY.saturating_sub(lived), &mut down).await {
            Some(next) => participant = next,
            None => return,
        }
    }
}

/// Waits until a participant that follows an ill one counts as sound. While the interface is gone none
/// does.
async fn settled(participant: &Participant) {
    tokio::time::sleep(SETTLED).await;
    participant.hears_itself().await;
}

/// Reports whether the vehicle can be heard. Returns whether the report was received.
async fn tell_of_dds(context: &BridgeContext, fault: Option<&str>) -> bool {
    let input = Input::Dds { fault: fault.map(Box::from) };
    let said = context.inputs.send(Stamped::new(input, context.clock.now()));
    let mut stop = context.stop.clone();
    tokio::select! {
        said = said => said.is_ok(),
        () = stopped(&mut stop) => false,
    }
}

/// Tries again after `pause` until there is a participant, or the bridge is to end.
async fn reopen(context: &BridgeContext, mut pause: Duration, down: &mut bool) -> Option<Participant> {
    let mut stop = context.stop.clone();
    let mut told = false;
    loop {
        tokio::select! {
            biased;
            () = stopped(&mut stop) => return None,
            () = tokio::time::sleep(pause) => {}
        }
        context.works.send_replace(context.clock.now());
        match Participant::open(&context.options).await {
            Ok(participant) => return Some(participant),
            Err(error) if !told => {
                tracing::error!("ROS 2 is not heard for now, trying again: {error}");
                *down |= tell_of_dds(context, Some(&error.to_string())).await;
                told = true;
            }
            Err(_) => {}
        }
        pause = RETRY;
    }
}
