//! The configuration of monitors: their sources and their limits.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::sync::Arc;

use super::sample::FieldValue;
use crate::state::State;
use crate::time::Span;

/// Index of a topic in [`Watched::topics`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TopicId(pub u32);

/// Index of a probe in [`Watched::watchdogs`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct WatchdogId(pub u32);

/// All inputs of the monitors of a model, each once.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Watched {
    /// No two have the same name.
    pub topics: Vec<Arc<TopicSpec>>,
    pub watchdogs: Vec<Arc<WatchdogSpec>>,
    /// Topics of `diagnostic_msgs/DiagnosticArray`; if empty, `/diagnostics`.
    pub diagnostics: Vec<DiagnosticsTopic>,
    pub stamps: StampClock,
    /// Read for recordings alone.
    pub recorded: Vec<RecordedTopic>,
    /// Topics of our own publications, which are never read for recordings: a reader would count as a listener.
    pub published: Vec<Box<str>>,
}

impl Watched {
    /// How the messages of a topic are recorded, if the configuration says so: the first entry that names it decides.
    pub fn recorded(&self, topic: &str) -> Option<&RecordedTopic> {
        if self.published.iter().any(|own| **own == *topic) {
            return None;
        }
        self.recorded.iter().find(|recorded| recorded.names(topic))
    }
}

/// Topics whose messages are recorded and mean nothing to the engine.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordedTopic {
    /// A name, in which each `*` stands for any characters: `/camera/*`.
    pub pattern: Box<str>,
    /// The least time between two recorded messages of a topic; zero: all are recorded.
    pub every: Span,
}

impl RecordedTopic {
    pub fn names(&self, topic: &str) -> bool {
        let mut parts = self.pattern.split('*');
        let Some(mut rest) = parts.next().and_then(|first| topic.strip_prefix(first)) else { return false };
        let Some(last) = parts.next_back() else { return rest.is_empty() };
        for part in parts {
            let Some(found) = rest.find(part) else { return false };
            rest = &rest[found + part.len()..];
        }
        rest.ends_with(last)
    }
}

/// A topic on which components report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DiagnosticsTopic {
    /// As ROS names it: `/robot1/diagnostics`.
    pub topic: Box<str>,
    /// Stands in front of the name of each status; may be empty.
    pub prefix: Box<str>,
}

/// The clock of the stamps in messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StampClock {
    /// The wall clock of this machine.
    #[default]
    System,
    /// The time on `/clock`, which nodes with `use_sim_time` use.
    Ros,
}

/// A topic and the fields that are read from its messages. Each sample carries it, so a sample that was read
/// for another configuration is recognized.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct TopicSpec {
    /// As ROS names it: `/odometry`.
    pub topic: Box<str>,
    /// `package/msg/Name`; empty: the type that the publisher announces.
    pub type_name: Box<str>,
    /// Whether the stamp of the message's header is needed.
    pub stamp: bool,
    /// [`Sample::values`](super::sample::Sample::values) has the same length and order.
    pub fields: Vec<FieldSpec>,
}

/// A field of a message.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct FieldSpec {
    /// `twist.twist.linear.x`, `poses[0].position.x`, `transforms[child_frame_id=base_link].transform`.
    pub path: Box<str>,
    pub kind: FieldKind,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FieldKind {
    /// A number, a boolean or a string.
    Scalar,
    /// A `geometry_msgs` Pose or Transform, or a message with such a member `pose` or `transform`.
    Pose,
    /// An array of positions, or of messages that contain one; `[]` in its path stands for each element, and
    /// may be omitted at its end.
    Positions,
    /// Any part of the message, as a fingerprint of its values; without a path the whole message. Times with the
    /// name `stamp` in it do not count.
    Content,
}

/// The type of a [`FieldKind::Scalar`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ScalarKind {
    Number,
    Bool,
    Text,
}

/// A target that is probed periodically.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct WatchdogSpec {
    pub target: ProbeTarget,
    pub every: Span,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProbeTarget {
    /// An ICMP echo to this host.
    Icmp { host: Box<str> },
    /// A TCP connection to `HOST:PORT`.
    Tcp { address: Box<str> },
    /// A ROS node with its namespace, `/ns/name`.
    Node { name: Box<str> },
    /// A ROS service with its namespace, `/ns/name`: whether a node offers it, not its response time.
    Service { name: Box<str> },
    /// Whether all publishers and subscribers of a topic match.
    Qos { topic: Box<str> },
    /// The computer on which Telltale runs.
    System(Resource),
}

/// A resource of a computer, or a process on it.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Resource {
    /// What its cores are busy with together, in percent.
    Cpu,
    /// What is not available to a new program, in percent.
    Memory,
    /// What is used of the file system with this path, in percent.
    Disk { path: Box<str> },
    /// In degrees Celsius, by the name that the kernel gives the sensor.
    Temperature { sensor: Box<str> },
    /// All processes of a program; without a measure, whether there is any.
    Process { name: Box<str>, measure: Option<ProcessMeasure> },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProcessMeasure {
    /// In percent of one core.
    Cpu,
    /// Resident, in megabytes.
    Memory,
}

impl Resource {
    /// Its path or name, or what it is.
    pub fn name(&self) -> &str {
        match self {
            Resource::Cpu => "cpu",
            Resource::Memory => "memory",
            Resource::Disk { path } => path,
            Resource::Temperature { sensor } => sensor,
            Resource::Process { name, .. } => name,
        }
    }
}

impl ProbeTarget {
    /// The probed host, address or name.
    pub fn name(&self) -> &str {
        match self {
            ProbeTarget::Icmp { host } => host,
            ProbeTarget::Tcp { address } => address,
            ProbeTarget::Qos { topic } => topic,
            ProbeTarget::System(resource) => resource.name(),
            ProbeTarget::Node { name } | ProbeTarget::Service { name } => name,
        }
    }
}

/// The source of a value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ValueSource {
    Field {
        topic: TopicId,
        /// Index in [`TopicSpec::fields`].
        field: u32,
    },
    /// A KeyValue of the status with exactly this name.
    Key {
        status: Arc<str>,
        key: Arc<str>,
        /// The unit that may follow the number: `V` of `25.60 V`.
        unit: Option<Arc<str>>,
    },
}

/// Limits. A value below or above a limit counts, an equal value does not; ERROR is judged before WARNING.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Bands {
    pub warning_below: Option<f64>,
    pub error_below: Option<f64>,
    pub warning_above: Option<f64>,
    pub error_above: Option<f64>,
    /// The state of a value that is no number, and of a stamp that lies in the future; `None`: UNKNOWN.
    pub unmeasurable: Option<State>,
}

/// The rule for a single value.
#[derive(Debug, Clone, PartialEq)]
pub enum ValueRule {
    Bands(Bands),
    /// Every other value is bad; numbers, booleans and texts are compared as such.
    Unless {
        error: Option<FieldValue>,
        warning: Option<FieldValue>,
    },
}

impl Default for ValueRule {
    fn default() -> ValueRule {
        ValueRule::Bands(Bands::default())
    }
}

/// Limits of what repeats itself; only those above are set.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FrozenLimits {
    /// From the first of the equal messages to the last, in seconds.
    pub time: Bands,
    /// The equal messages in a row without the first.
    pub repeats: Bands,
}

impl FrozenLimits {
    /// The longest time that is allowed.
    pub fn longest(&self) -> Span {
        let limits = [self.time.warning_above, self.time.error_above].into_iter().flatten();
        Span::from_nanos((limits.fold(0.0, f64::max) * 1e9) as u64)
    }
}

/// The rule for two sources.
#[derive(Debug, Clone, PartialEq)]
pub enum AgreementRule {
    /// By the absolute difference.
    Number(Bands),
    /// By the distance in metres and the angle in degrees.
    Pose { translation: Bands, rotation_deg: Bands },
    /// Lists of positions: by the difference of their lengths, and by the largest distance of any
    /// position of one list to the nearest of the other, in metres.
    Positions { count: Bands, nearest: Bands },
}

impl Default for AgreementRule {
    fn default() -> AgreementRule {
        AgreementRule::Number(Bands::default())
    }
}

/// What judges a module. Most modules judge themselves, so all other monitors are stored apart.
#[derive(Debug, Clone, PartialEq)]
pub enum ModuleMonitor {
    /// The level in the status of exactly this name.
    SelfState(Arc<str>),
    Other(Box<MonitorSpec>),
}

/// A monitor that is not the module itself.
#[derive(Debug, Clone, PartialEq)]
pub enum MonitorSpec {
    /// The level in the status of a domain-specific module elsewhere, which has a class of its own.
    External {
        status: Arc<str>,
        class: Class,
    },
    /// Messages per second; bands in Hz.
    Frequency {
        topic: TopicId,
        window: Span,
        bands: Bands,
    },
    /// Receipt minus header stamp, the worst in the window; bands in seconds.
    Latency {
        topic: TopicId,
        window: Span,
        bands: Bands,
    },
    Value {
        source: ValueSource,
        rule: ValueRule,
    },
    /// How long, and how many messages in a row, a value may stay the same.
    Frozen {
        source: ValueSource,
        limits: FrozenLimits,
    },
    /// This many misses in a row make an ERROR; bands on the response time, in seconds.
    Watchdog {
        watchdog: WatchdogId,
        misses: u32,
        bands: Bands,
    },
    /// Bands on what is measured of a [`Resource`].
    System {
        watchdog: WatchdogId,
        bands: Bands,
    },
    /// Bands on the output rate divided by the input rate.
    RateRatio {
        input: TopicId,
        output: TopicId,
        window: Span,
        bands: Bands,
    },
    /// Bands on `later` minus `earlier`.
    Sequence {
        earlier: ValueSource,
        later: ValueSource,
        max_gap: Span,
        bands: Bands,
    },
    Agreement {
        a: ValueSource,
        b: ValueSource,
        /// An older value is no longer compared.
        max_age: Span,
        /// Compares the motion over this time instead of the positions.
        motion_over: Option<Span>,
        rule: AgreementRule,
    },
    /// Always this state.
    Constant {
        state: State,
    },
    /// The number of modules in its group, other than itself and without those of nested groups.
    Count {
        wanted: u32,
        /// None at all is OK too.
        may_be_empty: bool,
        /// After the start, the time in which modules may still come.
        grace: Span,
    },
    Expression {
        /// By the names that the conditions use.
        inputs: Vec<(Box<str>, ValueSource)>,
        max_age: Span,
        warning: Option<Condition>,
        error: Option<Condition>,
        class: Class,
    },
}

impl From<MonitorSpec> for ModuleMonitor {
    fn from(spec: MonitorSpec) -> ModuleMonitor {
        ModuleMonitor::Other(Box::new(spec))
    }
}

impl ModuleMonitor {
    /// The monitor, unless the module judges itself.
    pub fn other(&self) -> Option<&MonitorSpec> {
        match self {
            ModuleMonitor::SelfState(_) => None,
            ModuleMonitor::Other(spec) => Some(spec),
        }
    }

    /// The status whose level is the module's report. No other module declares it.
    pub fn status(&self) -> Option<&Arc<str>> {
        match self {
            ModuleMonitor::SelfState(status) => Some(status),
            ModuleMonitor::Other(spec) => spec.status(),
        }
    }
}

impl MonitorSpec {
    /// The status whose level is the module's report.
    pub fn status(&self) -> Option<&Arc<str>> {
        match self {
            MonitorSpec::External { status, .. } => Some(status),
            MonitorSpec::Frequency { .. }
            | MonitorSpec::Latency { .. }
            | MonitorSpec::Value { .. }
            | MonitorSpec::Frozen { .. }
            | MonitorSpec::Watchdog { .. }
            | MonitorSpec::System { .. }
            | MonitorSpec::RateRatio { .. }
            | MonitorSpec::Sequence { .. }
            | MonitorSpec::Agreement { .. }
            | MonitorSpec::Constant { .. }
            | MonitorSpec::Count { .. }
            | MonitorSpec::Expression { .. } => None,
        }
    }
}

/// A condition over values in the order of the inputs. The configuration knows its language; conditions with
/// equal texts are equal.
#[derive(Clone)]
pub struct Condition {
    pub text: Arc<str>,
    evaluate: Arc<Evaluate>,
    /// The type that the condition assumes for each input, if it does.
    kinds: Arc<[Option<ScalarKind>]>,
}

type Evaluate = dyn Fn(&[FieldValue]) -> Result<bool, Box<str>> + Send + Sync;

impl Condition {
    pub fn new(
        text: &str,
        evaluate: impl Fn(&[FieldValue]) -> Result<bool, Box<str>> + Send + Sync + 'static,
    ) -> Condition {
        Condition { text: text.into(), evaluate: Arc::new(evaluate), kinds: Arc::from([]) }
    }

    /// The same condition with the assumed types of its inputs, in order.
    pub fn taking(self, kinds: impl Into<Arc<[Option<ScalarKind>]>>) -> Condition {
        Condition { kinds: kinds.into(), ..self }
    }

    /// The type that the condition assumes for an input.
    pub fn takes(&self, input: usize) -> Option<ScalarKind> {
        self.kinds.get(input).copied().flatten()
    }

    /// # Errors
    ///
    /// The reason why the condition has no answer for these values.
    pub fn holds(&self, values: &[FieldValue]) -> Result<bool, Box<str>> {
        (self.evaluate)(values)
    }
}

impl fmt::Debug for Condition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Condition").field(&self.text).finish()
    }
}

impl PartialEq for Condition {
    fn eq(&self, other: &Condition) -> bool {
        self.text == other.text
    }
}

/// The class of a diagnosis in the paper's classification (Sec. III-B).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Class {
    /// `isolated` or `contextual`.
    pub location: &'static str,
    /// `content` or `meta`.
    pub information: &'static str,
    /// `sequential` or `parallel`, for a diagnosis of data flow.
    pub flow: Option<&'static str>,
}

impl Class {
    /// The column of the paper's taxonomy (Fig. 3), from 0: isolated meta, isolated content, contextual meta,
    /// contextual content sequential and parallel. `None` for a class that the taxonomy does not have.
    pub fn column(self) -> Option<usize> {
        match (self.location, self.information, self.flow) {
            ("isolated", "meta", None) => Some(0),
            ("isolated", "content", None) => Some(1),
            // A contextual meta diagnosis has one column, with and without data flow.
            ("contextual", "meta", _) => Some(2),
            ("contextual", "content", Some("sequential")) => Some(3),
            ("contextual", "content", Some("parallel")) => Some(4),
            _ => None,
        }
    }
}

impl ProbeTarget {
    /// Whether the answer comes from DDS.
    pub(crate) fn asks_dds(&self) -> bool {
        match self {
            ProbeTarget::Icmp { .. } | ProbeTarget::Tcp { .. } | ProbeTarget::System(_) => false,
            ProbeTarget::Node { .. } | ProbeTarget::Service { .. } | ProbeTarget::Qos { .. } => true,
        }
    }
}
