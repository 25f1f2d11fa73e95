//! The checked configuration: the parts of the vehicle, their dependencies and their relevance. `config` makes
//! it from files, tests make it by hand. It cannot be wrong: see [`Model::new`].

pub mod countermeasure;
pub mod filter;
pub mod lateness;
pub mod monitors;
pub mod motion;
mod nodes;
pub mod order;
pub mod output;
mod policy;
pub mod quantity;
pub mod sample;
pub mod service;
mod watched;
pub mod wording;

use super::text::{Text, words};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

use super::time::Span;
use countermeasure::Rule;
pub use filter::{Match, Prefixes, Unclaimed};
use monitors::{FieldKind, TopicSpec, Watched};
pub use monitors::{ModuleMonitor, MonitorSpec};
pub use motion::Stop;
use motion::{PositionSource, SpeedSource, WatchedField};
use order::{Cycle, Order, Visit};
use output::Output;
pub use policy::{CountsAs, Policy};
use watched::ProbeTarget;
use wording::{Advice, Wording};

/// Index of a group in [`Parts::groups`]. Parents stand before their children.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct GroupId(pub u32);

/// Index of a module: declared modules in configuration order, then discovered ones in order of arrival.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct ModuleId(pub u32);

/// A group or a module.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NodeId {
    Group(GroupId),
    Module(ModuleId),
}

impl NodeId {
    /// So many groups, then so many modules.
    pub fn all(groups: usize, modules: usize) -> impl Iterator<Item = NodeId> {
        let groups = (0..groups as u32).map(|id| NodeId::Group(GroupId(id)));
        groups.chain((0..modules as u32).map(|id| NodeId::Module(ModuleId(id))))
    }
}

/// The stages that the vehicle has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StageModel {
    /// The shuttle's: locked until an operator logs in.
    Shuttle,
    /// A machine that is no shuttle: always active.
    None,
}

words! {
    /// Stage of the vehicle (paper, Sec. IV-B).
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Stage {
        Locked = "locked",
        Localizing = "localizing",
        Standby = "standby",
        Cleared = "cleared",
        Active = "active",
    }
}

/// A named boolean of the vehicle.
#[derive(Debug, Clone, PartialEq)]
pub struct SignalSpec {
    pub name: Box<str>,
    /// The words for the machine while it is true: `on its way`.
    pub title: Option<Text>,
    pub source: SignalSource,
    /// Older than this, it is unknown.
    pub timeout: Option<Span>,
    /// True for this long after each receipt, false before and after: for topics whose
    /// message is an event (a goal), not a level.
    pub present_for: Option<Span>,
}

impl SignalSpec {
    /// A signal without a title that never becomes too old.
    pub fn new(name: &str, source: SignalSource) -> SignalSpec {
        SignalSpec { name: name.into(), title: None, source, timeout: None, present_for: None }
    }
}

/// The source of a signal.
#[derive(Debug, Clone, PartialEq)]
pub enum SignalSource {
    /// A field that is true or false, or the arrival of a message.
    Field(FieldSource),
    /// An [`MonitorSpec::Expression`] whose `error` is the condition: true while it holds, unknown while an
    /// input is.
    Condition(Box<MonitorSpec>),
}

impl SignalSource {
    pub fn field(&self) -> Option<&FieldSource> {
        match self {
            SignalSource::Field(source) => Some(source),
            SignalSource::Condition(_) => None,
        }
    }

    pub fn condition(&self) -> Option<&MonitorSpec> {
        match self {
            SignalSource::Field(_) => None,
            SignalSource::Condition(spec) => Some(spec),
        }
    }

    /// Whether it reads the same sources, whatever indices two configurations give them.
    pub(super) fn means_the_same(&self, watched: &Watched, other: &SignalSource, others: &Watched) -> bool {
        match (self, other) {
            (SignalSource::Condition(spec), SignalSource::Condition(other)) => {
                spec.means_the_same(watched, other, others)
            }
            (SignalSource::Field(_), SignalSource::Field(_)) => self == other,
            (SignalSource::Field(_) | SignalSource::Condition(_), _) => false,
        }
    }
}

/// A field of a ROS 2 topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldSource {
    /// As ROS names it: `/mission/active`.
    pub topic: Box<str>,
    /// `package/msg/Name`; empty: the type that the publisher announces.
    pub type_name: Box<str>,
    /// Path of the field, `data`.
    pub field: Box<str>,
}

/// When a node is relevant. Every condition must hold.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct When {
    /// Stages in which the node is relevant. Empty: every stage but `locked`.
    pub stages: Vec<Stage>,
    /// Index into [`Parts::signals`] and the required value.
    pub signals: Vec<(usize, bool)>,
    /// The required value of the built-in signal [`POSED_SIGNAL`].
    pub posed: Option<bool>,
}

/// How a group folds its members.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Combine {
    /// The worst member counts.
    Worst,
    /// Redundant members: the best one counts.
    Any,
}

/// A requirement of a node: unless it works, the node cannot be judged.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Dependency {
    pub on: DependsOn,
    /// UNKNOWN masks as well as ERROR.
    pub masks_unknown: bool,
    /// How far apart the beginnings of a cause and of its effect may be.
    pub within: Within,
}

/// How far apart the beginnings of a cause and of an ERROR that it explains may be. An ERROR that no cause
/// explains is a second fault: it is not masked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Within {
    /// A cause explains everything that waits for it, however late it began.
    Always,
    Limit(Span),
}

impl Default for Within {
    fn default() -> Within {
        Within::Limit(Span::from_secs(5))
    }
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum DependsOn {
    Node(NodeId),
    /// A redundancy set: it blocks when every member does. Never empty.
    AnyOf(Vec<NodeId>),
}

impl DependsOn {
    /// The nodes that it names.
    pub fn nodes(&self) -> &[NodeId] {
        match self {
            DependsOn::Node(node) => std::slice::from_ref(node),
            DependsOn::AnyOf(nodes) => nodes,
        }
    }
}

#[derive(Debug, Clone, PartialEq)]
pub struct GroupSpec {
    /// Path of ids, `a/b`.
    pub path: Arc<str>,
    pub name: Text,
    pub parent: Option<GroupId>,
    pub combine: Combine,
    pub when: Option<When>,
    pub depends_on: Vec<Dependency>,
    /// Statuses that match any of these become modules of this group.
    pub filters: Vec<Match>,
    /// Without members it is OK, not UNKNOWN.
    pub may_be_empty: bool,
    /// Column and row of the tile on the operator's page, counted from 1; without it the page places the tile.
    pub tile: Option<(u8, u8)>,
}

impl GroupSpec {
    /// A group that is always relevant, depends on nothing and finds no modules by itself.
    pub fn new(path: &str, name: Text) -> GroupSpec {
        GroupSpec {
            path: path.into(),
            name,
            parent: None,
            combine: Combine::Worst,
            when: None,
            depends_on: Vec::new(),
            filters: Vec::new(),
            may_be_empty: false,
            tile: None,
        }
    }
}

words! {
    /// The treatment of statuses that no group claims: the group `other`. Its words are those of the configuration.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
    pub enum Other {
        /// Shown to developers only.
        Hidden = "hidden",
        /// One quiet line for the operator, if something in it is not OK.
        #[default]
        Shown = "shown",
        /// A tile like any other, with alarms.
        Counted = "counted",
    }
}

/// Full names of ROS 2 nodes, `/ns/name`.
pub type NodeNames = Arc<[Arc<str>]>;

#[derive(Debug, Clone, PartialEq)]
pub struct ModuleSpec {
    /// `group/module`, with the whole path of the group.
    pub id: Arc<str>,
    /// The name of its fault.
    pub name: Option<Arc<Wording>>,
    /// Advice to the operator.
    pub help: Option<Arc<Wording<Advice>>>,
    pub group: GroupId,
    pub policy: Policy,
    pub when: Option<Box<When>>,
    pub depends_on: Vec<Dependency>,
    pub monitor: ModuleMonitor,
    /// For a status that is expected in a group's `match`: filters of other groups take it too.
    pub expected: Option<Expected>,
}

impl ModuleSpec {
    /// A module that is always relevant and depends on nothing, with the default policy.
    pub fn new(id: &str, group: GroupId, monitor: ModuleMonitor) -> ModuleSpec {
        ModuleSpec {
            id: id.into(),
            name: None,
            help: None,
            group,
            policy: Policy::default(),
            when: None,
            depends_on: Vec::new(),
            monitor,
            expected: None,
        }
    }
}

/// A module that is there before its status, because the configuration expects it.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Expected {
    /// Left out at the beginning of the name that people read.
    pub prefixes: Prefixes,
}

/// Bounds on all inputs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Limits {
    /// Discovered modules and remembered unmatched names, together.
    pub discovered_modules: usize,
    pub values_per_status: usize,
    pub string_bytes: usize,
    /// The bytes of messages, hardware ids, keys and values of all statuses, and of those of one writer: beyond
    /// them the longest are cut.
    pub status_bytes: usize,
    pub source_bytes: usize,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits {
            discovered_modules: 4096,
            values_per_status: 256,
            string_bytes: 4096,
            status_bytes: 64 << 20,
            source_bytes: 32 << 20,
        }
    }
}

/// The density of the reference display, in dots per inch: the sizes of the operator's pages are made for it.
pub const DISPLAY_DPI: u32 = 149;

/// The parts of a vehicle and their relations, as configured; [`Model::new`] checks them.
#[derive(Debug, Clone, PartialEq)]
pub struct Parts {
    pub vehicle_id: Arc<str>,
    pub vehicle_name: Text,
    pub stages: StageModel,
    pub signals: Vec<SignalSpec>,
    pub groups: Vec<GroupSpec>,
    pub modules: Vec<ModuleSpec>,
    /// The inputs of the modules' monitors.
    pub watched: Watched,
    pub driving: Driving,
    /// The policy of discovered modules.
    pub discovered: Policy,
    pub other: Other,
    pub unclaimed: Unclaimed,
    pub limits: Limits,
    /// The density of the vehicle's display, in dots per inch.
    pub display_dpi: u32,
}

impl Parts {
    /// A vehicle without groups and monitors, with the defaults for all else.
    pub fn empty(vehicle_id: &str, stages: StageModel) -> Parts {
        Parts {
            vehicle_id: vehicle_id.into(),
            vehicle_name: Text::plain(vehicle_id),
            stages,
            signals: Vec::new(),
            groups: Vec::new(),
            modules: Vec::new(),
            watched: Watched::default(),
            driving: Driving::default(),
            discovered: Policy::default(),
            other: Other::default(),
            unclaimed: Unclaimed::default(),
            limits: Limits::default(),
            display_dpi: DISPLAY_DPI,
        }
    }
}

impl Model {
    /// The same vehicle with changed dependencies: fewer, or with other limits.
    ///
    /// # Panics
    /// If the change closes a circle.
    pub fn with_dependencies(&self, mut change: impl FnMut(&mut Vec<Dependency>)) -> Model {
        let mut parts = self.parts.clone();
        parts.groups.iter_mut().for_each(|group| change(&mut group.depends_on));
        parts.modules.iter_mut().for_each(|module| change(&mut module.depends_on));
        Model::new(parts).expect("fewer dependencies close no circle")
    }

    /// The topics whose messages are only counted: a recording needs no content of large ones, unless it
    /// names them.
    pub fn counted_topics(&self) -> impl Iterator<Item = &str> {
        let is_signal = |topic: &str| {
            self.signals
                .iter()
                .filter_map(|it| it.source.field())
                .any(|field| same_topic(&field.topic, topic))
        };
        let is_counted = |spec: &&Arc<TopicSpec>| spec.fields.iter().all(|it| it.kind == FieldKind::Content);
        let counted = self.watched.topics.iter().filter(is_counted);
        counted.map(|spec| &*spec.topic).filter(move |topic| {
            let is_diagnostics = self.watched.diagnostics_topics().any(|(it, _)| same_topic(it, topic));
            !is_diagnostics && !is_signal(topic) && self.watched.recorded(topic).is_none()
        })
    }
}

/// Whether two names mean one topic; a configuration may leave out the first `/`.
pub fn same_topic(one: &str, other: &str) -> bool {
    one.trim_start_matches('/') == other.trim_start_matches('/')
}

/// The configuration of stages and countermeasures.
#[derive(Debug, Clone, PartialEq)]
pub struct Driving {
    pub stops: Vec<Stop>,
    /// Localization counts as done when its group was OK for this long.
    pub localized_after: Span,
    pub countermeasures: Vec<Rule>,
    /// Outputs that the configuration switches off.
    pub unpublished: Vec<Output>,
    pub speed: Option<SpeedSource>,
    pub position: Option<PositionSource>,
    /// The pose in the goal's messages: the nearest stop is the destination.
    pub goal: Option<WatchedField>,
}

impl Default for Driving {
    fn default() -> Driving {
        Driving {
            stops: Vec::new(),
            localized_after: Span::from_secs(2),
            countermeasures: Vec::new(),
            unpublished: Vec::new(),
            speed: None,
            position: None,
            goal: None,
        }
    }
}

/// Parts whose references exist and whose dependencies have an order.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    parts: Parts,
    pub(super) order: Order,
}

impl Model {
    /// # Errors
    ///
    /// The first cycle of dependencies, in configuration order.
    ///
    /// # Panics
    ///
    /// If an id in `parts` is out of range: the caller that made the parts made the ids.
    pub fn new(parts: Parts) -> Result<Model, Cycle> {
        let order = Order::of(&parts)?;
        Ok(Model { parts, order })
    }

    /// The longest window, timeout or delay by which a state depends on earlier messages. A recording for another
    /// configuration needs as much of the past.
    pub fn longest_memory(&self) -> Span {
        let policies = self.modules.iter().map(|module| module.policy.memory());
        let monitors = self.modules.iter().map(|module| module.monitor.memory(&self.watched));
        let signals = self.signals.iter().filter_map(|signal| signal.present_for);
        let all = policies.chain([self.discovered.memory()]).chain(monitors).chain(signals);
        all.max().unwrap_or_default()
    }

    /// The policies of modules that are configured, and of those that are discovered.
    fn policies(&self) -> impl Iterator<Item = &Policy> {
        let filters = self.groups.iter().flat_map(|group| &group.filters);
        let of_filters = filters.filter_map(|filter| filter.policy.as_ref());
        let of_modules = self.modules.iter().map(|module| &module.policy);
        of_modules.chain(of_filters).chain(&self.unclaimed.policy)
    }

    /// The nodes that some module accepts its status from, and no others.
    fn writers(&self) -> impl Iterator<Item = &NodeNames> {
        self.policies().chain([&self.discovered]).filter_map(|policy| policy.writers.as_ref())
    }

    /// Whether some module accepts its status only from certain writers.
    pub(super) fn restricts_writers(&self) -> bool {
        self.writers().next().is_some()
    }

    /// The nodes that it names, as those that a watchdog asks for or that may write a status.
    pub fn named_nodes(&self) -> impl Iterator<Item = &str> {
        let asked = self.watched.watchdogs.iter().filter_map(|watchdog| match &watchdog.target {
            ProbeTarget::Node { name } => Some(&**name),
            _ => None,
        });
        asked.chain(self.writers().flat_map(|names| names.iter().map(|name| &**name)))
    }

    /// Whether a report of some module counts as another state than the reported one.
    pub(super) fn recounts(&self) -> bool {
        self.policies().any(|policy| policy.counts_as != CountsAs::Reported)
    }

    /// All visits in an order in which each comes after everything that it depends on.
    pub fn visits(&self) -> Vec<Visit> {
        self.order.visits()
    }
}

impl std::ops::Deref for Model {
    type Target = Parts;

    fn deref(&self) -> &Parts {
        &self.parts
    }
}

/// The signal that tells whether the vehicle drives, if the model has it.
pub const ACTIVE_SIGNAL: &str = "active";

/// The signal that tells whether a goal is set, if the model has it. Without it no goal is required.
pub const GOAL_SIGNAL: &str = "goal";

/// The built-in signal that is true as soon as the operator gave a pose: see [`When::posed`].
pub const POSED_SIGNAL: &str = "posed";

/// The top-level group that tells whether the vehicle is localized. Without it the pose alone counts, after
/// [`Driving::localized_after`].
pub const LOCALIZATION_GROUP: &str = "localization";
