//! The sources of monitors: topics with their fields, KeyValues of statuses, and probes; and the recorded topics.

use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;
use std::sync::Arc;

use crate::time::Span;

/// The topic of diagnostics without a configuration.
pub const DIAGNOSTICS: &str = "/diagnostics";
/// The type of every topic of diagnostics.
pub const DIAGNOSTIC_ARRAY: &str = "diagnostic_msgs/msg/DiagnosticArray";

/// The topics of transforms: those that are sent again and again, and those that are sent once and hold.
pub const TF: &str = "/tf";
pub const TF_STATIC: &str = "/tf_static";
/// The type of both.
pub const TF_MESSAGE: &str = "tf2_msgs/msg/TFMessage";

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
    /// As they are written; [`Watched::diagnostics_topics`] has the one that counts if there are none.
    pub diagnostics: Vec<DiagnosticsTopic>,
    pub stamps: StampClock,
    /// Read for recordings alone.
    pub recorded: Vec<RecordedTopic>,
    /// Topics of our own publications, which are never read for recordings: a reader would count as a listener.
    pub published: Vec<Box<str>>,
}

impl Watched {
    /// The topics on which components report, each with what stands in front of the names of its statuses:
    /// [`DIAGNOSTICS`] if none is written.
    pub fn diagnostics_topics(&self) -> impl Iterator<Item = (&str, &str)> {
        let written = self.diagnostics.iter().map(|it| (&*it.topic, &*it.prefix));
        written.chain(self.diagnostics.is_empty().then_some((DIAGNOSTICS, "")))
    }

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
    /// The least time between two recorded messages of a topic; zero: all are recorded, [`RecordedTopic::NEVER`]: none.
    pub every: Span,
}

impl RecordedTopic {
    /// No message is recorded; of a topic that is read, its times and sizes are.
    pub const NEVER: Span = Span::from_nanos(u64::MAX);

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
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
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
    /// The names that a condition gives to numbers of the field: its type must have them.
    #[serde(default, skip_serializing_if = "BTreeSet::is_empty")]
    pub names: BTreeSet<Box<str>>,
}

impl FieldSpec {
    pub fn new(path: impl Into<Box<str>>, kind: FieldKind) -> FieldSpec {
        FieldSpec { path: path.into(), kind, names: BTreeSet::new() }
    }

    /// The transforms of a child frame in a `tf2_msgs/TFMessage`.
    pub fn transforms_of(child: &str) -> FieldSpec {
        FieldSpec::new(format!("transforms[child_frame_id={child}]"), FieldKind::Transforms)
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FieldKind {
    /// A number, a boolean or a string.
    Scalar,
    /// The same, but a whole number for which its message has a name is read as that name.
    Named,
    /// A `geometry_msgs` Pose or Transform, or a message with such a member `pose` or `transform`.
    Pose,
    /// An array of positions, or of messages that contain one; `[]` in its path stands for each element, and
    /// may be omitted at its end.
    Positions,
    /// The transforms of a child frame in a `tf2_msgs/TFMessage`: `transforms[child_frame_id=base_link]`.
    Transforms,
    /// One value of each element of an array: `status_list[].status`.
    Elements,
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
    /// The state of a lifecycle node, by its name with namespace: whether it is active. It is asked for it.
    Lifecycle { name: Box<str> },
    /// Whether all publishers and subscribers of a topic match.
    Qos { topic: Box<str> },
    /// The computer on which Telltale runs.
    System(Resource),
}

/// A resource of a computer, or a process on it.
#[derive(Debug, Clone, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Resource {
    /// The load of all its cores together, in percent.
    Cpu,
    /// The memory that is not available to a new program, in percent.
    Memory,
    /// The used part of the file system with this path, in percent.
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
    /// Its path or name, or `cpu` or `memory`.
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
            ProbeTarget::Node { name } | ProbeTarget::Service { name } | ProbeTarget::Lifecycle { name } => {
                name
            }
        }
    }

    /// Whether the answer comes from DDS.
    pub(crate) fn asks_dds(&self) -> bool {
        match self {
            ProbeTarget::Icmp { .. } | ProbeTarget::Tcp { .. } | ProbeTarget::System(_) => false,
            ProbeTarget::Node { .. }
            | ProbeTarget::Service { .. }
            | ProbeTarget::Lifecycle { .. }
            | ProbeTarget::Qos { .. } => true,
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
