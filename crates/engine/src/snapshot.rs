//! The immutable result: the state that every part of the vehicle shows at one instant, and why.
//!
//! A snapshot is cheap to make and to keep: it shares unchanged parts with the one before.

use super::files::count;
use super::model::monitors::{Class, Reads};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::sync::Arc;

pub use super::counters::{Counters, Reception};
use super::files::float;
use super::input::Refusal;
use super::model::countermeasure::{Request, RequestKind};
use super::model::output::Output;
use super::model::quantity::Quantity;
use super::model::wording::{Advice, Urgency, Wording};
use super::model::{DependsOn, GroupId, ModuleId, NodeId, NodeNames, Other, Stage, Stop};
use super::persistent::PersistentVec;
use super::state::State;
use super::text::{Text, words};
use super::time::{Since, Span, Timestamp};

/// An engine that works publishes four times as often. After this time without a new snapshot the last one is old, and is
/// not told as the vehicle's state.
pub const SILENT_MAX: Span = Span::from_secs(1);

/// The state of the whole vehicle at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    /// Grows by one with every input or deadline that changed a state, a reason, a root cause, an alarm or the
    /// stage: everything that an operator decides by.
    pub seq: u64,
    /// Grows by one with every change, texts and values included.
    pub revision: u64,
    pub now: Timestamp,
    pub stage: Stage,
    /// The logged-in operator.
    pub operator: Option<Arc<str>>,
    /// The fold of the top-level groups; IGNORE if all are ignored.
    pub overall: State,
    pub layout: Arc<Layout>,
    /// By [`GroupId`].
    pub groups: PersistentVec<GroupView>,
    /// By [`ModuleId`].
    pub modules: PersistentVec<ModuleView>,
    /// Ranked, worst first.
    pub roots: Arc<[RootCause]>,
    /// The urgency of each fault for the operator of a driving vehicle by its own state, masked or not; by node.
    pub asking: Arc<[(NodeId, Urgency)]>,
    /// The urgency of the instruction, if faults have any.
    pub asked: Option<Asked>,
    /// Active or not acknowledged, by number.
    pub alarms: Arc<[Alarm]>,
    /// The number of the last alarm that was raised.
    pub last_alarm: u64,
    /// Modules with a WARNING that the operator accepted, and when; `None` before a restart.
    pub accepted: Arc<BTreeMap<NodeId, Option<Timestamp>>>,
    /// Modules whose faults call nobody for now, by their ids. Their states are what they are without that.
    pub shelved: Arc<[Shelved]>,
    /// The requests to the vehicle, strongest first; at most one of each kind.
    pub countermeasures: Arc<[Countermeasure]>,
    pub localization: Localization,
    pub motion: Motion,
    /// The way since the start of the program, in metres, as far as the speed was known. It changes nothing else of a
    /// snapshot.
    pub driven_m: f64,
    /// The vehicle may start; a level for its topic.
    pub clearance: bool,
    /// Whether the vehicle must not go on before it is released; a level for its topic. `None`: after a restart
    /// nobody knows, until the vehicle stands at a stop or is released.
    pub hold: Option<bool>,
    /// The number of the operator's last STOP; 0 if there was none in this run of the program.
    pub last_stop: u64,
    /// A vehicle with stages may set off though nothing says that it drives: there is no word on `active` and no source of its
    /// speed, or it is somewhere between stops.
    pub may_set_off: bool,
    /// The reasons against a clearance now, without those that only the display and the store know.
    pub clearance_refusals: Arc<[Refusal]>,
    /// Every check of a release that fails now, but for display and store. Empty: a release is offered.
    pub release_refusals: Arc<[Refusal]>,
    /// Outputs without a receiver, and why.
    pub unreached: Arc<[(Output, Unreached)]>,
    /// Outputs with a reader on the vehicle. In the first seconds this is not known.
    pub listened: Arc<[Output]>,
    /// By position in the model's signals; `None` is unknown.
    pub signals: Arc<[(Box<str>, Option<bool>)]>,
    /// Faults of the reception by topic, in order of first appearance.
    pub reception: Arc<[Reception]>,
    pub counters: Counters,
}

impl Snapshot {
    /// Whether the machine has stages (`vehicle.stages` is not `none`).
    pub fn has_stages(&self) -> bool {
        !self.clearance_refusals.contains(&Refusal::NoStages)
    }

    /// Whether it is a vehicle that drives. A machine without stages is always active and never drives.
    pub fn drives(&self) -> bool {
        self.stage == Stage::Active && self.has_stages()
    }

    /// The stop that the vehicle drives to, or is to drive to.
    pub fn destination(&self) -> Option<&Stop> {
        self.layout.stops.get(self.motion.destination?)
    }

    pub fn group(&self, id: GroupId) -> (&GroupInfo, &GroupView) {
        (&self.layout.groups[id.0 as usize], &self.groups[id.0 as usize])
    }

    pub fn module(&self, id: ModuleId) -> (&ModuleInfo, &ModuleView) {
        (&self.layout.modules[id.0 as usize], &self.modules[id.0 as usize])
    }

    /// The tiles: the configuration's groups without a parent, in its order; then `other`, if that is counted.
    pub fn tiles(&self) -> impl Iterator<Item = GroupId> {
        (0..self.layout.groups.len() as u32).map(GroupId).filter(|&id| {
            let group = &self.layout.groups[id.0 as usize];
            group.is_tile()
        })
    }

    /// The name of a node in paths and on the wire: `a/b` or `a/b/module`.
    pub fn node_name(&self, node: NodeId) -> &Arc<str> {
        self.layout.node_name(node)
    }

    /// All nodes without the modules that have left.
    pub fn nodes(&self) -> impl Iterator<Item = NodeId> {
        let is_here = |&node: &NodeId| !matches!(node, NodeId::Module(id) if self.module(id).0.gone);
        self.layout.nodes().filter(is_here)
    }

    /// Finds a node by the name of [`Snapshot::node_name`]. Searches all names: for pages and tests.
    pub fn node(&self, name: &str) -> Option<NodeId> {
        let group = self.layout.groups.iter().position(|group| &*group.path == name);
        let module = || self.module_ids().find(|id| *self.module(*id).0.id == *name);
        group.map(|index| NodeId::Group(GroupId(index as u32))).or_else(|| module().map(NodeId::Module))
    }

    /// The modules that have not left.
    pub fn module_ids(&self) -> impl Iterator<Item = ModuleId> {
        let modules = self.layout.modules.iter().zip(0..).filter(|(module, _)| !module.gone);
        modules.map(|(_, index)| ModuleId(index))
    }

    /// The own state of a node, as if nothing were masked.
    pub fn own(&self, node: NodeId) -> State {
        match node {
            NodeId::Group(id) => self.groups[id.0 as usize].own,
            NodeId::Module(id) => self.modules[id.0 as usize].own,
        }
    }

    /// The urgency of a node's own state for the operator of a driving vehicle.
    pub fn asks(&self, node: NodeId) -> Option<Urgency> {
        let index = self.asking.binary_search_by_key(&node, |(asking, _)| *asking).ok()?;
        Some(self.asking[index].1)
    }

    /// The shown state of a node, with the reason if it is IGNORE.
    pub fn shown(&self, node: NodeId) -> (State, Option<&Reason>) {
        match node {
            NodeId::Group(id) => {
                let view = &self.groups[id.0 as usize];
                (view.state, view.reason.as_ref())
            }
            NodeId::Module(id) => {
                let view = &self.modules[id.0 as usize];
                (view.state, view.reason.as_ref())
            }
        }
    }

    /// Whether the vehicle is under way, or may be: cleared, or driving by itself, or not known to stand, or between stops.
    /// Where nothing tells its motion, only the stage counts.
    pub fn is_under_way(&self) -> bool {
        let by_stage = matches!(self.stage, Stage::Cleared | Stage::Active);
        let may_set_off = self.motion.has_source && self.may_set_off;
        self.has_stages() && (by_stage || self.motion.may_move() || may_set_off)
    }

    /// Whether the vehicle drives by itself, or moves in another stage: its operator does not leave it.
    pub fn moves(&self) -> bool {
        self.has_stages() && moves(self.stage, self.motion)
    }

    /// Whether the vehicle moves, or may: it is cleared or drives by itself, or is not known to stand.
    pub fn may_move(&self) -> bool {
        may_move(self.stage, self.motion, self.may_set_off)
    }

    /// The strongest countermeasure: the operator has to know it first.
    pub fn countermeasure(&self) -> Option<&Countermeasure> {
        self.countermeasures.first()
    }

    /// The requested deceleration in m/s²; a level for its topic.
    pub fn deceleration(&self) -> Option<f64> {
        self.countermeasures.iter().find_map(|it| it.request.mps2())
    }

    /// Whether the maneuver component's own stop is requested; a level for its topic. A stronger request does
    /// not end it.
    pub fn maneuver_stop(&self) -> bool {
        self.countermeasures.iter().any(|it| it.request.kind() == RequestKind::ManeuverStop)
    }

    /// Whether the operator requested a stop that is not over.
    pub fn stop_requested(&self) -> bool {
        self.stop_requested_since().is_some()
    }

    /// Since when the operator requests a stop.
    pub fn stop_requested_since(&self) -> Option<Since> {
        self.countermeasures.iter().find_map(|it| it.by_operator)
    }

    /// The reason why an output has no receiver.
    pub fn unreached(&self, output: Output) -> Option<Unreached> {
        self.unreached.iter().find(|(of, _)| *of == output).map(|(_, why)| *why)
    }

    /// Whether an output is known to have a reader.
    pub fn is_listened_to(&self, output: Output) -> bool {
        self.listened.contains(&output)
    }
}

/// Names and structure; the same for all snapshots until a module is discovered.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    pub vehicle_id: Arc<str>,
    pub vehicle_name: Text,
    /// The density of the vehicle's display, in dots per inch.
    pub display_dpi: u32,
    /// The treatment of unclaimed statuses.
    pub other: Other,
    /// The places at which an operator may localize the vehicle.
    pub stops: Arc<[Stop]>,
    /// Signals that have a title, by their names.
    pub signal_titles: Arc<[(Box<str>, Text)]>,
    /// By [`GroupId`]; parents stand before their children, `other` and `telltale` are last.
    pub groups: Vec<GroupInfo>,
    /// By [`ModuleId`].
    pub modules: Vec<Arc<ModuleInfo>>,
}

#[derive(Debug, Clone, PartialEq, Default)]
pub struct GroupInfo {
    pub path: Arc<str>,
    pub name: Text,
    pub parent: Option<GroupId>,
    pub groups: Vec<GroupId>,
    pub modules: Vec<ModuleId>,
    pub depends_on: Vec<DependsOn>,
    pub tile: Option<(u8, u8)>,
    /// The group of unclaimed statuses.
    pub is_other: bool,
    pub is_any: bool,
    pub may_be_empty: bool,
    /// The number of modules that it must have, where the configuration gives one.
    pub wanted: Option<u32>,
    /// It counts towards the state of the vehicle.
    pub counted: bool,
    /// The group of Telltale's own modules.
    pub is_system: bool,
    /// While nothing matches its filters: a received name that a filter was probably meant to match.
    pub hint: Option<Text>,
}

impl GroupInfo {
    /// Whether it is a tile on the operator's page.
    pub fn is_tile(&self) -> bool {
        self.parent.is_none() && self.counted && !self.is_system
    }
}

#[derive(Debug, Clone, PartialEq)]
pub struct ModuleInfo {
    pub id: Arc<str>,
    pub name: Option<Arc<Wording>>,
    pub help: Option<Arc<Wording<Advice>>>,
    pub group: GroupId,
    /// The status of the module, if it has one. Filters may overlap, so other modules may have the same.
    pub status: Option<Arc<str>>,
    /// The name that people read, where the configuration leaves out the beginning of a status name.
    pub shown: Option<Arc<str>>,
    /// Full names of the nodes whose reports count; `None`: all.
    pub writers: Option<NodeNames>,
    pub depends_on: Vec<DependsOn>,
    pub discovered: bool,
    /// It was silent for too long and left; alarms and countermeasures still find its name here.
    pub gone: bool,
    /// The number of a discovered module, in order of arrival.
    pub number: u64,
    /// The kind of its monitor, as in the configuration.
    pub kind: &'static str,
    pub class: Class,
    /// It judges a component, and not a data stream.
    pub of_component: bool,
    /// How people read what its monitor measures.
    pub quantity: Option<Quantity>,
    /// The topics that its monitor reads; `None`: none.
    pub reads: Option<Box<Reads>>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GroupView {
    /// The shown state.
    pub state: State,
    /// The fold of its members, as if nothing were masked.
    pub own: State,
    /// Since when it shows this state for this kind of reason.
    pub since: Timestamp,
    /// Direct members that show OK, and those that are not ignored.
    pub ok: u32,
    pub counted: u32,
    pub reason: Option<Reason>,
    /// For a group in ERROR or masked: the shortest path from the group to each root, both ends included.
    pub paths: Arc<[Path]>,
}

/// Nodes from a symptom to a root cause.
pub type Path = Arc<[NodeId]>;

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ModuleView {
    pub state: State,
    pub own: State,
    pub since: Timestamp,
    /// When its present fault began, if it is estimated to have begun before its notice.
    pub began: Option<Timestamp>,
    /// The time of its last status; `None` if there was none.
    pub received: Option<Timestamp>,
    /// No report came within its timeout.
    pub silent: bool,
    pub steps: Steps,
    pub reason: Option<Reason>,
    pub report: Arc<Report>,
}

/// The texts of a status, kept while they do not change.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Report {
    pub message: Box<str>,
    /// The German message, if the engine itself made it: for a monitor or one of Telltale's own modules.
    pub german: Option<Box<str>>,
    pub hardware_id: Box<str>,
    /// The message only tells that an input is too old: a silent module shows its silence instead.
    pub aged: bool,
    pub values: Vec<(Box<str>, Box<str>)>,
    /// Bytes that were cut because of [`Limits::status_bytes`](super::model::Limits).
    #[serde(deserialize_with = "count")]
    pub cut: usize,
}

/// The reason why a node shows IGNORE.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Reason {
    /// A dependency fails; these are the root causes, ranked.
    Masked { by: Arc<[NodeId]> },
    /// The state of the vehicle makes its diagnosis pointless.
    NotRelevant(NotRelevant),
}

/// The condition that does not hold.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NotRelevant {
    /// The present stage.
    Stage(Stage),
    /// The signal, and its value, which is not the required one.
    Signal { name: Box<str>, value: bool },
}

/// A visible failure that no other failure explains.
#[derive(Debug, Clone, PartialEq)]
pub struct RootCause {
    /// A module; a group only if it has no members.
    pub node: NodeId,
    /// The number of modules and groups that it masks.
    pub masks: u32,
    pub since: Timestamp,
    /// It waits for a failing dependency too, which does not explain it: it is a fault of its own.
    pub second: bool,
    /// It is UNKNOWN only because it still has time to report, and hides no ERROR: it raises no alarm.
    pub grace: bool,
}

/// The most that any fault asks of the operator of a driving vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Asked {
    pub urgency: Urgency,
    /// The node that asks for it, a visible one if there is one. If none does any more, the root cause whose fault
    /// did before.
    pub node: NodeId,
}

/// An alarm about a root cause. Its number lasts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Alarm {
    #[serde(deserialize_with = "count")]
    pub id: u64,
    pub node: NodeId,
    pub raised: Timestamp,
    /// The time at which it ended.
    pub ended: Option<Timestamp>,
    pub acknowledged: bool,
    /// The time of the acknowledgement; not known for one from before a restart.
    pub acknowledged_at: Option<Timestamp>,
    pub active: bool,
    /// Earlier alarms of the node that are only counted here.
    pub repeats: u32,
    /// The highest urgency of its fault, and of all that waits for it, since the vehicle set off.
    pub asked: Option<Urgency>,
}

/// A module that a developer has shelved for maintenance.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shelved {
    pub module: ModuleId,
    pub until: Timestamp,
    /// The user.
    pub by: Arc<str>,
}

/// A request to the vehicle because of a failure.
#[derive(Debug, Clone, PartialEq)]
pub struct Countermeasure {
    pub request: Request,
    /// Since when the operator requests it too.
    pub by_operator: Option<Since>,
    /// The root causes, at most 64; ended ones stay until they are acknowledged.
    pub causes: Arc<[CountermeasureCause]>,
    /// The nodes that ask for it by a rule. A node that waits for a cause can still fail when the cause is over.
    pub about: Arc<[NodeId]>,
    pub since: Since,
    pub state: CountermeasureState,
    /// No cause is present any more: it only waits for the operator's acknowledgement.
    pub latched: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CountermeasureCause {
    pub node: NodeId,
    /// It is still present.
    pub present: bool,
    pub acknowledged: bool,
}

words! {
    /// The progress of a request. Its words are those on the wire.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum CountermeasureState {
        /// Made; the vehicle has not confirmed it, or has no confirmation configured.
        Requested = "requested",
        /// The vehicle confirmed that it carries it out.
        Engaged = "engaged",
        /// The vehicle did not confirm it in time, or it could not be sent: an ERROR of its own.
        Unconfirmed = "unconfirmed",
    }
}

/// The reason why a request has no receiver.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unreached {
    /// The configuration has switched it off.
    Unpublished,
    /// No reader of the vehicle is matched.
    Unheard,
}

/// The progress of localization.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Localization {
    /// Grows with every pose that the operator gave: when it grows, `pose` is published.
    #[serde(deserialize_with = "count")]
    pub number: u64,
    /// The last one.
    pub pose: Option<MapPose>,
    /// The time of the pose, while it waits to be confirmed or is confirmed in this localizing.
    pub given: Option<Timestamp>,
    /// The time since which the group `localization` has been OK after that.
    pub ok_since: Option<Timestamp>,
    /// It was OK for long enough.
    pub done: bool,
    /// The vehicle drove before it was localized: without a localization there is no clearance.
    pub skipped: bool,
    /// Where the vehicle was last known to be.
    pub last_known: Option<KnownPlace>,
    /// The group `localization` was not OK for so long after the pose that this may be a wrong one.
    pub late: bool,
}

impl Localization {
    /// The operator has to localize, or the pose is not confirmed yet: there is no clearance.
    pub fn is_open(&self) -> bool {
        (self.given.is_some() || self.skipped) && !self.done
    }
}

/// Where a vehicle was last known to be.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct KnownPlace {
    pub pose: MapPose,
    /// A drive led to this stop. Otherwise an operator chose it, and the localization confirmed it.
    pub driven: bool,
}

/// Metres and degrees in the map's frame.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MapPose {
    #[serde(with = "float")]
    pub x_m: f64,
    #[serde(with = "float")]
    pub y_m: f64,
    #[serde(with = "float")]
    pub yaw_deg: f64,
}

impl From<&Stop> for MapPose {
    fn from(stop: &Stop) -> MapPose {
        MapPose { x_m: stop.x_m, y_m: stop.y_m, yaw_deg: stop.yaw_deg }
    }
}

/// The steps to a module's own state. Each step changes the state of the one before.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Steps {
    pub reported: Option<State>,
    /// After silence.
    pub judged: Option<State>,
    /// After debounce.
    pub debounced: Option<State>,
    pub latched: bool,
    pub grace: bool,
    /// After debounce and grace it is in ERROR, latched or not: a reset is refused.
    pub in_error: bool,
}

/// Whether the vehicle moves, how fast, and where to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Motion {
    pub moving: Moving,
    /// Whole km/h without a sign; `None` while unknown. A moving vehicle has at least 1, a standing one 0.
    pub speed_kmh: Option<u32>,
    /// The configuration names the source of the speed.
    pub has_source: bool,
    /// By position in [`Layout::stops`].
    pub destination: Option<usize>,
    /// How far the goal is in a straight line, in rounded metres. `None` while the place of the vehicle or of the goal is
    /// not known.
    pub goal_m: Option<u32>,
    /// In how many minutes a drive is there if it comes nearer as it did in the last minute.
    pub goal_min: Option<u32>,
}

/// Whether a vehicle moves, or may: it is cleared or drives by itself, or is not known to stand. The page offers STOP by
/// this, and the engine takes it.
pub(crate) fn may_move(stage: Stage, motion: Motion, may_set_off: bool) -> bool {
    matches!(stage, Stage::Cleared | Stage::Active) || motion.may_move() || may_set_off
}

pub(crate) fn moves(stage: Stage, motion: Motion) -> bool {
    stage == Stage::Active || motion.moving == Moving::Yes
}

impl Motion {
    /// Whether the vehicle moves, or may: nothing says that it stands although something should.
    pub fn may_move(self) -> bool {
        match self.moving {
            Moving::Yes => true,
            Moving::No => false,
            Moving::Unknown => self.has_source,
        }
    }
}

words! {
    /// Whether the vehicle moves. A signal that was not heard proves nothing. The words are those on the wire.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Moving {
        Yes = "yes",
        No = "no",
        #[default]
        Unknown = "unknown",
    }
}
