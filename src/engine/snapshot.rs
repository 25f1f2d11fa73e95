//! The immutable result: what every part of the vehicle shows at one instant, and why.
//!
//! A snapshot is cheap to make and to keep: parts that did not change are shared with the one before.

use super::model::monitors::Class;
use std::sync::Arc;

pub use super::counters::{Counters, Reception};
use super::input::Refusal;
use super::model::countermeasure::{Request, RequestKind};
use super::model::output::Output;
use super::model::wording::Wording;
use super::model::{DependsOn, GroupId, ModuleId, NodeId, NodeNames, Other, Stage, Stop};
use super::persistent::PersistentVec;
use super::state::State;
use super::text::Text;
use super::time::Timestamp;

/// The state of the whole vehicle at one instant.
#[derive(Debug, Clone, PartialEq)]
pub struct Snapshot {
    /// Grows by one with every input or deadline that changed a state, a reason, a root cause, an
    /// alarm or the stage: what an operator decides by.
    pub seq: u64,
    /// Grows by one with every change at all, words and values included.
    pub revision: u64,
    pub now: Timestamp,
    pub stage: Stage,
    /// The operator in the seat, if one is logged in.
    pub operator: Option<Arc<str>>,
    /// The fold of the top-level groups; IGNORE if all are ignored.
    pub overall: State,
    pub layout: Arc<Layout>,
    /// By [`GroupId`].
    pub groups: PersistentVec<GroupView>,
    /// By [`ModuleId`].
    pub modules: PersistentVec<ModuleView>,
    /// Ranked, worst first (`ENGINE.md` 6).
    pub roots: Arc<[RootCause]>,
    /// Active or not acknowledged, by number.
    pub alarms: Arc<[Alarm]>,
    /// The number of the last alarm that was raised.
    pub last_alarm: u64,
    /// Modules whose WARNING the operator accepted.
    pub accepted: Arc<[NodeId]>,
    /// What the vehicle is asked to do, strongest first; at most one of each kind.
    pub countermeasures: Arc<[Countermeasure]>,
    pub localization: Localization,
    /// The vehicle may start; a level for its topic.
    pub clearance: bool,
    /// Why the vehicle cannot be cleared now; what only the display and the store know is not in it.
    pub clearance_refusals: Arc<[Refusal]>,
    /// Requests that would reach nobody, and why.
    pub unreached: Arc<[(Output, Unreached)]>,
    /// Outputs to which somebody of the vehicle listens. In the first seconds it is not known.
    pub listened: Arc<[Output]>,
    /// By position in the model's signals; `None` is unknown.
    pub signals: Arc<[(Box<str>, Option<bool>)]>,
    /// Faults of the reception by topic, in order of first appearance.
    pub reception: Arc<[Reception]>,
    pub counters: Counters,
}

impl Snapshot {
    /// The strongest countermeasure: what the operator has to know first.
    pub fn countermeasure(&self) -> Option<&Countermeasure> {
        self.countermeasures.first()
    }

    /// The deceleration to ask for in m/s²; a level for its topic.
    pub fn deceleration(&self) -> Option<f64> {
        self.countermeasures.iter().find_map(|it| it.request.mps2())
    }

    /// Whether to ask for the maneuver component's own stop; a level for its topic. A stronger
    /// request beside it does not take it back.
    pub fn maneuver_stop(&self) -> bool {
        self.countermeasures.iter().any(|it| it.request.kind() == RequestKind::ManeuverStop)
    }

    /// Whether the operator asked for a stop that is not over.
    pub fn stop_requested(&self) -> bool {
        self.countermeasures.iter().any(|it| it.by_operator)
    }

    /// Why what is said on an output reaches nobody.
    pub fn unreached(&self, output: Output) -> Option<Unreached> {
        self.unreached.iter().find(|(of, _)| *of == output).map(|(_, why)| *why)
    }

    /// Whether it is known that somebody listens to this output.
    pub fn is_listened_to(&self, output: Output) -> bool {
        self.listened.contains(&output)
    }

    pub fn group(&self, id: GroupId) -> (&GroupInfo, &GroupView) {
        (&self.layout.groups[id.0 as usize], &self.groups[id.0 as usize])
    }

    pub fn module(&self, id: ModuleId) -> (&ModuleInfo, &ModuleView) {
        (&self.layout.modules[id.0 as usize], &self.modules[id.0 as usize])
    }

    /// The tiles: the configuration's groups without a parent, in its order; then what nothing claims,
    /// where that is counted.
    pub fn tiles(&self) -> impl Iterator<Item = GroupId> {
        (0..self.layout.groups.len() as u32).map(GroupId).filter(|&id| {
            let group = &self.layout.groups[id.0 as usize];
            group.is_tile()
        })
    }

    /// The name of a node in paths and on the wire: `a/b` or `a/b/module`.
    pub fn node_name(&self, node: NodeId) -> &Arc<str> {
        match node {
            NodeId::Group(id) => &self.layout.groups[id.0 as usize].path,
            NodeId::Module(id) => &self.layout.modules[id.0 as usize].id,
        }
    }

    /// Finds a node by the name of [`Snapshot::node_name`]. Walks all names: for pages and tests.
    pub fn node(&self, name: &str) -> Option<NodeId> {
        let group = self.layout.groups.iter().position(|group| &*group.path == name);
        let module = || self.module_ids().find(|id| *self.module(*id).0.id == *name);
        group.map(|index| NodeId::Group(GroupId(index as u32))).or_else(|| module().map(NodeId::Module))
    }

    /// The modules that are there.
    pub fn module_ids(&self) -> impl Iterator<Item = ModuleId> {
        let modules = self.layout.modules.iter().zip(0..).filter(|(module, _)| !module.gone);
        modules.map(|(_, index)| ModuleId(index))
    }

    /// What a node reports, as if nothing were masked.
    pub fn own(&self, node: NodeId) -> State {
        match node {
            NodeId::Group(id) => self.groups[id.0 as usize].own,
            NodeId::Module(id) => self.modules[id.0 as usize].own,
        }
    }

    /// What a node shows, and why where that is IGNORE.
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
}

/// Names and structure; the same for all snapshots until a module is discovered.
#[derive(Debug, Clone, PartialEq)]
pub struct Layout {
    pub vehicle_id: Arc<str>,
    pub vehicle_name: Text,
    /// What becomes of statuses that nothing claims.
    pub other: Other,
    /// Where an operator may say that the vehicle stands.
    pub stops: Arc<[Stop]>,
    /// By [`GroupId`]; parents stand before their children, `other` and `telltale` are last.
    pub groups: Vec<GroupInfo>,
    /// By [`ModuleId`].
    pub modules: Vec<Arc<ModuleInfo>>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct GroupInfo {
    pub path: Arc<str>,
    pub name: Text,
    pub parent: Option<GroupId>,
    pub groups: Vec<GroupId>,
    pub modules: Vec<ModuleId>,
    pub depends_on: Vec<DependsOn>,
    pub tile: Option<(u8, u8)>,
    /// The group of statuses that nothing claims.
    pub is_other: bool,
    /// It has a part in what the vehicle is.
    pub counted: bool,
    /// The group of what the diagnosis says of itself.
    pub is_system: bool,
    /// While nothing matches its filters: a name that looks as if it should.
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
    pub help: Option<Arc<Wording>>,
    pub group: GroupId,
    /// The status that it takes, if it takes one: filters may overlap, so others may take the same.
    pub status: Option<Arc<str>>,
    /// Whole names of the nodes that may say it; `None`: all.
    pub writers: Option<NodeNames>,
    pub depends_on: Vec<DependsOn>,
    pub discovered: bool,
    /// It was silent for too long and is not there any more: what speaks of it finds its name here.
    pub gone: bool,
    /// Of what was made at run time, the number in order of arrival.
    pub number: u64,
    /// The kind of its monitor, as the configuration names it.
    pub kind: &'static str,
    pub class: Class,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GroupView {
    /// What is shown.
    pub state: State,
    /// What its members report, as if nothing were masked.
    pub own: State,
    /// Since when it shows this state for this kind of reason.
    pub since: Timestamp,
    /// Direct members shown OK, of those not ignored.
    pub ok: u32,
    pub counted: u32,
    pub reason: Option<Reason>,
    /// For a group in ERROR or masked: from the group to each root, shortest, both ends included.
    pub paths: Arc<[Path]>,
}

/// Nodes from a symptom to a root cause.
pub type Path = Arc<[NodeId]>;

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ModuleView {
    pub state: State,
    pub own: State,
    pub since: Timestamp,
    /// When its last status came; `None` if never.
    pub received: Option<Timestamp>,
    /// Nothing came for its timeout.
    pub silent: bool,
    pub steps: Steps,
    pub reason: Option<Reason>,
    pub report: Arc<Report>,
}

/// The words of a status, kept while they do not change.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Report {
    pub message: Box<str>,
    /// The message in German, where the engine says it: a monitor, or the diagnosis of itself.
    pub german: Option<Box<str>>,
    pub hardware_id: Box<str>,
    /// The message is only that an input is too old: of a silent module it says nothing more.
    pub aged: bool,
    pub values: Vec<(Box<str>, Box<str>)>,
    /// Bytes that are left out for want of room ([`Limits::status_bytes`](super::model::Limits)).
    pub cut: usize,
}

/// Why a node shows IGNORE.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Reason {
    /// A dependency fails; these are the root causes, ranked.
    Masked { by: Arc<[NodeId]> },
    /// The vehicle's state makes it pointless.
    NotRelevant(NotRelevant),
}

/// The condition that does not hold.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NotRelevant {
    /// The stage is this one.
    Stage(Stage),
    /// The signal has the value that was not asked for.
    Signal { name: Box<str>, value: bool },
}

/// A visible failure that explains itself.
#[derive(Debug, Clone, PartialEq)]
pub struct RootCause {
    /// A module; a group only if it has no members.
    pub node: NodeId,
    /// How many modules and groups show IGNORE because of it.
    pub masks: u32,
    pub since: Timestamp,
    /// It is UNKNOWN only because it is still given time to report, and hides no ERROR: it raises no alarm.
    pub grace: bool,
}

/// A root cause that was raised (`ENGINE.md` 6). Its number lasts.
#[derive(Debug, Clone, PartialEq)]
pub struct Alarm {
    pub id: u64,
    pub node: NodeId,
    pub raised: Timestamp,
    /// When it was over.
    pub ended: Option<Timestamp>,
    pub acknowledged: bool,
    pub active: bool,
    /// Earlier ones of the node that are counted here and not kept.
    pub repeats: u32,
}

/// Something that is asked of the vehicle because something failed (`ENGINE.md` 10).
#[derive(Debug, Clone, PartialEq)]
pub struct Countermeasure {
    pub request: Request,
    /// The operator asked for it too.
    pub by_operator: bool,
    /// The root causes, at most 64; those that are over stay until they are acknowledged.
    pub causes: Arc<[CountermeasureCause]>,
    pub since: Timestamp,
    pub state: CountermeasureState,
    /// No cause is there any more: it waits for the operator's acknowledgement alone.
    pub latched: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CountermeasureCause {
    pub node: NodeId,
    /// It is there still.
    pub present: bool,
    pub acknowledged: bool,
}

/// How far a request is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CountermeasureState {
    /// It is made; the vehicle has not confirmed it, or never does by its configuration.
    Requested,
    /// The vehicle confirmed that it does what was asked.
    Engaged,
    /// The vehicle did not confirm it in time, or it could not be sent: an ERROR of its own.
    Unconfirmed,
}

impl CountermeasureState {
    /// The word on the wire.
    pub const fn as_str(self) -> &'static str {
        match self {
            CountermeasureState::Requested => "requested",
            CountermeasureState::Engaged => "engaged",
            CountermeasureState::Unconfirmed => "unconfirmed",
        }
    }
}

/// Why a request reaches nobody.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unreached {
    /// The configuration has switched it off.
    Unpublished,
    /// No reader of the vehicle is matched.
    Unheard,
}

/// How far the vehicle knows where it is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Localization {
    /// Grows with every pose that the operator gave: when it grows, `pose` is to be published.
    pub number: u64,
    /// The last one.
    pub pose: Option<MapPose>,
    /// When it was given, while it waits to be confirmed or is confirmed in this localizing.
    pub given: Option<Timestamp>,
    /// Since when the group `localization` is OK after that.
    pub ok_since: Option<Timestamp>,
    /// It was OK for long enough.
    pub done: bool,
    /// The vehicle was said to drive before that: without it there is no clearance.
    pub owed: bool,
}

impl Localization {
    /// The operator has to localize, or did and it is not confirmed: there is no clearance.
    pub fn is_open(&self) -> bool {
        (self.given.is_some() || self.owed) && !self.done
    }
}

/// Metres and degrees in the map's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MapPose {
    pub x_m: f64,
    pub y_m: f64,
    pub yaw_deg: f64,
}

/// How a module's own state came about. A state is what the step made of the one before.
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
