//! The configuration of monitors: what they watch, and their limits (`ENGINE.md` 7, `DESIGN.md` 5).

use std::fmt;
use std::sync::Arc;

use super::sample::FieldValue;
use crate::engine::time::Span;

/// Index of a topic in [`Watched::topics`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct TopicId(pub u32);

/// Index of a probe in [`Watched::watchdogs`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct WatchdogId(pub u32);

/// Everything that the monitors of a model need from outside, each thing once.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Watched {
    /// No two with one name.
    pub topics: Vec<Arc<TopicSpec>>,
    pub watchdogs: Vec<Arc<WatchdogSpec>>,
    /// Topics of `diagnostic_msgs/DiagnosticArray`; with none it is `/diagnostics`.
    pub diagnostics: Vec<DiagnosticsTopic>,
    pub stamps: StampClock,
}

/// A topic on which components report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DiagnosticsTopic {
    /// As ROS names it: `/robot1/diagnostics`.
    pub topic: Box<str>,
    /// Stands in front of the name of each status; may be empty.
    pub prefix: Box<str>,
}

/// By which clock the stamps of messages are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StampClock {
    /// The wall clock of this machine.
    #[default]
    System,
    /// The time on `/clock`, as nodes with `use_sim_time` have it.
    Ros,
}

/// A topic and what is read out of each of its messages. Samples carry it, so that one which was
/// received under another configuration is known by that.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TopicSpec {
    /// As ROS names it: `/odometry`.
    pub topic: Box<str>,
    /// `package/msg/Name`; empty: the type that the publisher offers.
    pub type_name: Box<str>,
    /// Whether the stamp of the message's header is wanted.
    pub stamp: bool,
    /// [`Sample::values`](super::sample::Sample::values) has the same length and order.
    pub fields: Vec<FieldSpec>,
}

/// A field of a message.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub struct FieldSpec {
    /// `twist.twist.linear.x`, `poses[0].position.x`, `transforms[child_frame_id=base_link].transform`.
    pub path: Box<str>,
    pub kind: FieldKind,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum FieldKind {
    /// A number, a boolean or a string.
    Scalar,
    /// A `geometry_msgs` Pose or Transform, or what holds one as its member `pose` or `transform`.
    Pose,
    /// An array of positions, or of what holds one; `[]` in its path stands for each element, and at
    /// its end may be left out.
    Positions,
}

/// What a [`FieldKind::Scalar`] is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ScalarKind {
    Number,
    Bool,
    Text,
}

/// Something that is asked again and again whether it is there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WatchdogSpec {
    pub target: ProbeTarget,
    pub every: Span,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub enum ProbeTarget {
    /// An ICMP echo to this host.
    Icmp { host: Box<str> },
    /// A TCP connection to `HOST:PORT`.
    Tcp { address: Box<str> },
    /// A ROS node with its namespace, `/ns/name`.
    Node { name: Box<str> },
    /// A ROS service with its namespace, `/ns/name`: that somebody serves it, not how soon it answers.
    Service { name: Box<str> },
    /// Whether all publishers and subscribers of a topic can come together.
    Qos { topic: Box<str> },
}

impl ProbeTarget {
    /// The host, address or name that is asked.
    pub fn name(&self) -> &str {
        match self {
            ProbeTarget::Icmp { host } => host,
            ProbeTarget::Tcp { address } => address,
            ProbeTarget::Qos { topic } => topic,
            ProbeTarget::Node { name } | ProbeTarget::Service { name } => name,
        }
    }
}

/// Where a value comes from.
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
        /// What may stand behind its number: `V` of `25.60 V`.
        unit: Option<Arc<str>>,
    },
}

/// Limits. Below or above a limit counts, equal does not; ERROR is judged before WARNING.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Bands {
    pub warning_below: Option<f64>,
    pub error_below: Option<f64>,
    pub warning_above: Option<f64>,
    pub error_above: Option<f64>,
}

/// How a single value is judged.
#[derive(Debug, Clone, PartialEq)]
pub enum ValueRule {
    Bands(Bands),
    /// Anything but these values is bad; numbers, booleans and words are compared as such.
    Unless {
        error: Option<FieldValue>,
        warning: Option<FieldValue>,
    },
}

/// How two sources are compared.
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

/// What a module watches.
#[derive(Debug, Clone, PartialEq)]
pub enum MonitorSpec {
    /// The level in the status of exactly this name.
    SelfState {
        status: Arc<str>,
    },
    /// The same, from a domain-specific module elsewhere, which states its class.
    External {
        status: Arc<str>,
        class: Class,
    },
    /// Messages in a second; bands in Hz.
    Frequency {
        topic: TopicId,
        window: Span,
        bands: Bands,
    },
    /// Receipt minus header stamp, the worst of the window; bands in seconds.
    Latency {
        topic: TopicId,
        window: Span,
        bands: Bands,
    },
    Value {
        source: ValueSource,
        rule: ValueRule,
    },
    /// As many misses in a row as this make an ERROR; bands on the time until an answer, in seconds.
    Watchdog {
        watchdog: WatchdogId,
        misses: u32,
        bands: Bands,
    },
    /// Bands on output rate by input rate.
    RateRatio {
        input: TopicId,
        output: TopicId,
        window: Span,
        bands: Bands,
    },
    /// Bands on later minus earlier.
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
    Expression {
        /// By the name that the conditions use.
        inputs: Vec<(Box<str>, ValueSource)>,
        max_age: Span,
        warning: Option<Condition>,
        error: Option<Condition>,
        class: Class,
    },
}

impl MonitorSpec {
    /// The status whose level is the module's report. It belongs to the module alone.
    pub fn status(&self) -> Option<&Arc<str>> {
        match self {
            MonitorSpec::SelfState { status } | MonitorSpec::External { status, .. } => Some(status),
            MonitorSpec::Frequency { .. }
            | MonitorSpec::Latency { .. }
            | MonitorSpec::Value { .. }
            | MonitorSpec::Watchdog { .. }
            | MonitorSpec::RateRatio { .. }
            | MonitorSpec::Sequence { .. }
            | MonitorSpec::Agreement { .. }
            | MonitorSpec::Expression { .. } => None,
        }
    }
}

/// A condition over values in the order of the inputs. The language it is written in is the
/// configuration's affair; two conditions are the same if their texts are.
#[derive(Clone)]
pub struct Condition {
    pub text: Arc<str>,
    evaluate: Arc<Evaluate>,
    /// What it takes each input for, where it says so.
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

    /// The same with what it takes each input for, in their order.
    pub fn taking(self, kinds: impl Into<Arc<[Option<ScalarKind>]>>) -> Condition {
        Condition { kinds: kinds.into(), ..self }
    }

    /// What it takes an input for, where it says so.
    pub fn takes(&self, input: usize) -> Option<ScalarKind> {
        self.kinds.get(input).copied().flatten()
    }

    /// # Errors
    /// Why there is no answer for these values.
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

/// Where a diagnosis stands in the paper's classification (Sec. III-B).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Class {
    /// `isolated` or `contextual`.
    pub location: &'static str,
    /// `content` or `meta`.
    pub information: &'static str,
    /// `sequential` or `parallel`, where data flows.
    pub flow: Option<&'static str>,
}

impl Class {
    /// The column of the paper's taxonomy (Fig. 3), from 0: isolated meta, isolated content,
    /// contextual meta, contextual content sequential and parallel. A class that the taxonomy does
    /// not have stands in none.
    pub fn column(self) -> Option<usize> {
        match (self.location, self.information, self.flow) {
            ("isolated", "meta", None) => Some(0),
            ("isolated", "content", None) => Some(1),
            // That its data flows, too, is no column of its own.
            ("contextual", "meta", _) => Some(2),
            ("contextual", "content", Some("sequential")) => Some(3),
            ("contextual", "content", Some("parallel")) => Some(4),
            _ => None,
        }
    }
}

impl ProbeTarget {
    /// Whether the answer comes from DDS.
    pub(in crate::engine) fn asks_dds(&self) -> bool {
        match self {
            ProbeTarget::Icmp { .. } | ProbeTarget::Tcp { .. } => false,
            ProbeTarget::Node { .. } | ProbeTarget::Service { .. } | ProbeTarget::Qos { .. } => true,
        }
    }
}
