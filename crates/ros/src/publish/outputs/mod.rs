//! Telltale's outputs: the aggregated diagnosis for the tools of ROS 2, and for the vehicle the stage, the
//! clearance, the operator's pose and the countermeasures.
//!
//! All outputs follow from the latest snapshot. A task of its own sends those for the vehicle as soon as
//! the snapshot is there; the aggregated diagnosis is sent at its own pace.

mod aggregate;
mod diagnosis;
mod levels;
mod listeners;
mod other_aggregators;
mod rosout;
mod send_failures;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use futures_util::future::join_all;
use tokio::sync::{mpsc, watch};
use tokio::task::{JoinHandle, JoinSet};
use tokio::time::Instant;

use crate::engine_queue::stopped;
use crate::every;
use crate::options::interfaces::{self, AddressWatch};
use crate::{BridgeError, BridgeOptions, Graph, PublishError, Publisher, Quality};
pub use levels::{Levels, VehicleMessage};
use send_failures::{tell, tell_all};
use telltale_clock::Clock;
use telltale_engine::model::output::{LogLevel, Output, Publication, TreeForm};
use telltale_engine::model::sample::Pose;
use telltale_engine::snapshot::{MapPose, Snapshot};
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::messages::encode::{self, Header, Motion};
use telltale_msg::messages::{BOOL, DIAGNOSTIC_ARRAY, GidSize};
use telltale_msg::received::Stamped;

const STATUS: &str = "diagnostic_msgs/msg/DiagnosticStatus";

/// How often the participant is checked; the addresses are compared at every fourth look.
const LOOK: Duration = Duration::from_millis(250);
const RETRY: Duration = Duration::from_secs(1);
/// After so many looks with a new snapshot that the sending task did not take, it hangs. A turn of it takes one
/// second at most.
const HANGS_AFTER: u32 = 8;
/// The default interval at which a request to decelerate is repeated.
const REPEAT: Span = Span::from_millis(50);

/// The type of a publication, and its quality of service.
const fn offer(publication: Publication) -> (&'static str, Quality) {
    match publication {
        Publication::DiagnosticsAgg => (DIAGNOSTIC_ARRAY, Quality::Reliable),
        Publication::TopLevelState => (STATUS, Quality::Reliable),
        Publication::Rosout => (encode::LOG, Quality::Log),
        Publication::Vehicle(Output::Pose) => (encode::POSE_WITH_COVARIANCE_STAMPED, Quality::Command),
        Publication::Vehicle(Output::Deceleration) => (encode::ACCEL_STAMPED, Quality::Command),
        Publication::Vehicle(Output::Stage) => (encode::STRING, Quality::LastValue),
        Publication::Vehicle(Output::Clearance | Output::ManeuverStop | Output::Hold) => {
            (BOOL, Quality::LastValue)
        }
    }
}

/// One published topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OutputTopic {
    pub publication: Publication,
    pub topic: Box<str>,
    /// The interval, for a publication that is repeated.
    pub period: Option<Span>,
    /// Whether it is published even if another program publishes the same. Outputs for the vehicle always
    /// are.
    pub beside_others: bool,
    /// For both topics of the aggregated diagnosis.
    pub tree: TreeForm,
    /// For `/rosout`: the least severity.
    pub level: LogLevel,
}

/// The running publications. They end when this is dropped.
#[derive(Debug)]
pub struct Outputs {
    stop: watch::Sender<bool>,
    topics: watch::Sender<Arc<[OutputTopic]>>,
    working: watch::Receiver<Timestamp>,
    task: JoinHandle<()>,
}

/// The latest snapshot, for each kind of output.
#[derive(Debug, Clone)]
pub struct Snapshots {
    /// For the vehicle, which goes first.
    pub vehicle: watch::Receiver<Arc<Snapshot>>,
    /// For the tools of ROS 2.
    pub tools: watch::Receiver<Arc<Snapshot>>,
}

/// State that outlives a participant.
struct LastingState {
    snapshots: Snapshots,
    inputs: mpsc::Sender<Stamped>,
    graph: Graph,
    clock: Clock,
    works: Arc<watch::Sender<Timestamp>>,
}

/// State shared by all tasks.
#[derive(Clone)]
struct OutputContext {
    topics: Arc<[OutputTopic]>,
    snapshots: Snapshots,
    inputs: mpsc::Sender<Stamped>,
    clock: Clock,
    /// When the task that sends to the vehicle last took a snapshot.
    works: Arc<watch::Sender<Timestamp>>,
    /// The engine was told that this task hangs.
    hangs: Arc<AtomicBool>,
    /// The end of this participant's life.
    end: watch::Receiver<bool>,
}

/// Starts to publish the outputs that follow from the snapshots, in a participant of its own, which is
/// never replaced because of a reader. Failures to send to the vehicle go to the engine through `inputs`.
///
/// # Errors
/// The interface does not exist, or DDS gets no sockets.
pub async fn start(
    options: BridgeOptions,
    topics: Vec<OutputTopic>,
    snapshots: Snapshots,
    inputs: mpsc::Sender<Stamped>,
    graph: Graph,
    clock: Clock,
) -> Result<Outputs, BridgeError> {
    let (topics, wanted) = watch::channel(Arc::from(topics));
    let publisher = match open(&options, &topics.borrow(), (&inputs, clock)).await {
        Ok(publisher) => Some(publisher),
        Err(BridgeError::Router(_)) => None,
        Err(error) => return Err(error),
    };
    let (stop, stopping) = watch::channel(false);
    let (works, working) = watch::channel(clock.now());
    let around = LastingState { snapshots, inputs, graph, clock, works: Arc::new(works) };
    let task = tokio::spawn(run(options, wanted, around, stopping, publisher));
    Ok(Outputs { stop, topics, working, task })
}

impl Outputs {
    /// When the task that sends to the vehicle last did its work, be DDS well or ill.
    pub fn working(&self) -> watch::Receiver<Timestamp> {
        self.working.clone()
    }

    /// Publishes on other topics from now on.
    pub fn follow(&self, topics: Vec<OutputTopic>) {
        self.topics.send_if_modified(|known| {
            let differs = **known != *topics;
            *known = topics.into();
            differs
        });
    }

    /// Takes back a clearance, ends the writers and waits for the library's threads.
    pub async fn shutdown(self) {
        // An error means that the task has ended by itself.
        let _ = self.stop.send(true);
        if let Err(panic) = self.task.await {
            tracing::error!("publishing failed: {panic}");
        }
    }
}

async fn open(
    options: &BridgeOptions,
    topics: &Arc<[OutputTopic]>,
    (inputs, clock): (&mpsc::Sender<Stamped>, Clock),
) -> Result<Publisher, BridgeError> {
    let mut publisher = Publisher::empty(options).await?;
    publisher.record(inputs.clone(), clock);
    for OutputTopic { publication, topic, .. } in topics.iter() {
        let (type_name, quality) = offer(*publication);
        publisher.offer(topic, type_name, quality)?;
    }
    publisher.offer_announcements();
    Ok(publisher)
}

/// Makes one participant after the other.
async fn run(
    options: BridgeOptions,
    mut wanted: watch::Receiver<Arc<[OutputTopic]>>,
    around: LastingState,
    mut stop: watch::Receiver<bool>,
    mut next: Option<Publisher>,
) {
    let LastingState { snapshots, inputs, graph, clock, works } = around;
    let node = format!("{}_outputs", options.node);
    let mut levels = Levels::new(REPEAT, &snapshots.vehicle.borrow());
    let mut refused = false;
    loop {
        let topics = wanted.borrow_and_update().clone();
        let opened = match next.take() {
            Some(publisher) => Ok(publisher),
            None => open(&options, &topics, (&inputs, clock)).await,
        };
        let (ends, ending) = watch::channel(false);
        let opened_at = clock.now();
        let context = OutputContext {
            topics,
            snapshots: snapshots.clone(),
            inputs: inputs.clone(),
            clock,
            works: works.clone(),
            hangs: Arc::default(),
            end: ending,
        };
        works.send_replace(opened_at);
        match opened {
            Ok(publisher) => {
                if std::mem::take(&mut refused) {
                    tell_all(&context, None);
                }
                let publisher = Arc::new(publisher);
                let mut tasks = JoinSet::new();
                let control = tokio::spawn(control(publisher.clone(), context.clone(), levels));
                tasks.spawn(listeners::watch(publisher.clone(), context.clone()));
                let end = context.end.clone();
                tasks.spawn(announce(publisher.clone(), node.clone(), graph.gid_size.clone(), end));
                let others = other_aggregators::OtherAggregators::new(
                    &publisher,
                    &context.topics,
                    graph.discovery.clone(),
                );
                graph.siblings.add(publisher.participant());
                tasks.spawn(other_aggregators::tell(
                    others.clone(),
                    context.inputs.clone(),
                    clock,
                    context.end.clone(),
                ));
                let rosout = context.topics.iter().find(|it| it.publication == Publication::Rosout);
                if let Some(topic) = rosout.cloned() {
                    tasks.spawn(rosout::run(publisher.clone(), topic, context.clone()));
                }
                tasks.spawn(diagnosis::run(publisher.clone(), others, context.clone()));
                look_after(&publisher, &options, &mut wanted, &mut stop, context).await;
                // The receivers live in the tasks; without tasks there is nothing to end.
                let _ = ends.send(true);
                levels = control.await.unwrap_or_else(|_| Levels::new(REPEAT, &snapshots.vehicle.borrow()));
                tasks.join_all().await;
                if let Some(publisher) = Arc::into_inner(publisher) {
                    publisher.shutdown().await;
                }
                levels.forget();
                // If one participant after the other is ill, not faster than the bridge replaces its own.
                let lived = Duration::from_nanos(clock.now().since(opened_at).as_nanos());
                tokio::select! {
                    () = stopped(&mut stop) => {}
                    () = tokio::time::sleep(RETRY.saturating_sub(lived)) => {}
                }
            }
            Err(error) => {
                if !std::mem::replace(&mut refused, true) {
                    tracing::error!("nothing can be published for now, trying again: {error}");
                }
                tell_all(&context, Some(&error.to_string()));
                tokio::select! {
                    () = stopped(&mut stop) => {}
                    () = tokio::time::sleep(RETRY) => {}
                }
            }
        }
        if *stop.borrow() || stop.has_changed().is_err() {
            return;
        }
    }
}

/// Runs until the participant must be replaced, or everything is to end.
async fn look_after(
    publisher: &Publisher,
    options: &BridgeOptions,
    wanted: &mut watch::Receiver<Arc<[OutputTopic]>>,
    stop: &mut watch::Receiver<bool>,
    mut context: OutputContext,
) {
    let (mut worked, mut untaken) = (*context.works.borrow(), 0);
    let now = interfaces::addresses().unwrap_or_default();
    let mut addresses = AddressWatch::new(options.interface, &now);
    let mut looks = every(LOOK);
    let mut look = 0_u64;
    loop {
        tokio::select! {
            () = stopped(stop) => return,
            Ok(()) = wanted.changed() => return,
            reason = publisher.stopped() => {
                tracing::error!("the process that publishes is ill and is replaced: {reason}");
                return;
            }
            _ = looks.tick() => {
                look += 1;
                let works = *context.works.borrow();
                let is_new = context.snapshots.vehicle.has_changed().is_ok_and(|is_new| is_new);
                context.snapshots.vehicle.mark_unchanged();
                untaken = if works == worked { untaken + u32::from(is_new) } else { 0 };
                worked = works;
                if untaken >= HANGS_AFTER && !context.hangs.swap(true, Ordering::Relaxed) {
                    tracing::error!("nothing is sent to the vehicle: the task that sends hangs");
                    tell_all(&context, Some("the task that sends to the vehicle hangs"));
                }
                // An error while listing the interfaces says nothing about them.
                if look.is_multiple_of(4) && interfaces::addresses().is_ok_and(|now| addresses.look(&now)) {
                    tracing::warn!("the participant that publishes is replaced: the addresses have changed");
                    return;
                }
            }
        }
    }
}

/// Publishes the outputs for the vehicle at once.
async fn control(publisher: Arc<Publisher>, mut context: OutputContext, mut levels: Levels) -> Levels {
    let mut speech = VehicleSender::new(publisher, &context);
    if let Some(period) = speech.period {
        levels.every = period;
    }
    loop {
        context.works.send_replace(context.clock.now());
        if context.hangs.swap(false, Ordering::Relaxed) {
            tracing::info!("the task that sends to the vehicle goes on");
            tell_all(&context, None);
            speech.failed.clear();
        }
        let snapshot = context.snapshots.vehicle.borrow_and_update().clone();
        // Side by side, in this order: a topic that is held back delays no other one.
        let due = levels.due(&snapshot, context.clock.now());
        let sent = join_all(due.iter().map(|say| speech.send(*say, &context))).await;
        let told_engine = !due.is_empty();
        for (say, sent) in due.into_iter().zip(sent) {
            if speech.is_sent(say, sent, &context) {
                levels.said(say, context.clock.now());
            }
        }
        // The engine gets a copy of each message, and may wait on this thread: no other one would run it while this task hangs.
        if told_engine {
            tokio::task::yield_now().await;
        }
        let repeat = levels.repeat_at(&snapshot).map(|at| Instant::from_std(context.clock.instant(at)));
        let repeated = async {
            match repeat {
                Some(at) => tokio::time::sleep_until(at).await,
                None => std::future::pending().await,
            }
        };
        tokio::select! {
            biased;
            () = stopped(&mut context.end) => break,
            changed = context.snapshots.vehicle.changed() => if changed.is_err() { break },
            () = repeated => {}
        }
    }
    if levels.cleared() {
        let say = VehicleMessage::Clearance(false);
        let sent = speech.send(say, &context).await;
        speech.is_sent(say, sent, &context);
    }
    levels
}

/// Publishes a level on its topic, and reports failures to the engine.
struct VehicleSender {
    publisher: Arc<Publisher>,
    topics: BTreeMap<Output, Box<str>>,
    /// The interval for requests to decelerate.
    period: Option<Span>,
    /// The state that the engine was told last; at first it assumes that everything is sent.
    failed: BTreeMap<Output, bool>,
}

impl VehicleSender {
    fn new(publisher: Arc<Publisher>, context: &OutputContext) -> VehicleSender {
        let of = |topic: &OutputTopic| match topic.publication {
            Publication::Vehicle(output) => Some((output, topic.topic.clone())),
            _ => None,
        };
        let deceleration = Publication::Vehicle(Output::Deceleration);
        let period =
            context.topics.iter().find(|topic| topic.publication == deceleration).and_then(|it| it.period);
        VehicleSender {
            publisher,
            topics: context.topics.iter().filter_map(of).collect(),
            period,
            failed: BTreeMap::new(),
        }
    }

    async fn send(&self, say: VehicleMessage, context: &OutputContext) -> Result<(), PublishError> {
        match self.topics.get(&say.output()) {
            Some(topic) => self.publisher.publish(topic, body(say, context.clock.wall())).await,
            None => Ok(()),
        }
    }

    /// Whether it was sent, or has no topic.
    fn is_sent(
        &mut self,
        say: VehicleMessage,
        sent: Result<(), PublishError>,
        context: &OutputContext,
    ) -> bool {
        let Some(topic) = self.topics.get(&say.output()) else { return true };
        let failed = sent.is_err();
        if self.failed.get(&say.output()) != Some(&failed) && tell(context, say.output(), topic, sent.err()) {
            self.failed.insert(say.output(), failed);
        }
        !failed
    }
}

fn body(say: VehicleMessage, stamp: std::time::SystemTime) -> Vec<u8> {
    let header = |frame_id| Header { stamp, frame_id };
    match say {
        // A deceleration is an acceleration backwards.
        VehicleMessage::Deceleration(mps2) => {
            let backwards = Motion { linear: [-mps2, 0.0, 0.0], ..Motion::default() };
            encode::accel_stamped(header("base_link"), backwards)
        }
        VehicleMessage::ManeuverStop(on) | VehicleMessage::Hold(on) | VehicleMessage::Clearance(on) => {
            encode::boolean(on)
        }
        VehicleMessage::Stage(stage) => encode::string(stage.as_str()),
        VehicleMessage::Pose(_, pose) => {
            encode::pose_with_covariance_stamped(header("map"), pose_of(pose), &covariance())
        }
    }
}

fn pose_of(MapPose { x_m, y_m, yaw_deg }: MapPose) -> Pose {
    let (qz, qw) = (yaw_deg.to_radians() / 2.0).sin_cos();
    Pose { x_m, y_m, qz, qw, ..Pose::default() }
}

/// As RViz publishes it: half a metre and fifteen degrees.
fn covariance() -> [f64; 36] {
    let mut covariance = [0.0; 36];
    (covariance[0], covariance[7], covariance[35]) = (0.25, 0.25, 0.068_5);
    covariance
}

/// Tools are not the vehicle: a failure to send to them is not reported as a fault.
fn log(published: Result<(), PublishError>) {
    if let Err(error) = published {
        tracing::debug!("{error}");
    }
}

/// Announces the node of the outputs, which has a name of its own: tools look an endpoint up among the nodes of its own
/// participant, and warn of two participants with one name. It is announced as soon as the size of a gid is known; the writer keeps the announcement for late
/// joiners.
async fn announce(
    publisher: Arc<Publisher>,
    node: String,
    mut gid_size: watch::Receiver<Option<GidSize>>,
    mut end: watch::Receiver<bool>,
) {
    let known = tokio::select! {
        () = stopped(&mut end) => return,
        known = gid_size.wait_for(Option::is_some) => known.ok().and_then(|size| *size),
    };
    let Some(size) = known else { return };
    if let Err(error) = publisher.announce(&[(&node, publisher.topics())], size).await {
        tracing::warn!("the node {node} was not announced to ROS 2: {error}");
    }
}
