//! What is received of the topics and probes that monitors watch.

use std::sync::Arc;

use super::monitor::spec::{TopicSpec, WatchdogSpec};
use super::time::Span;

/// One message of a watched topic.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// What the reader read by. A sample of another configuration is not taken.
    pub source: Arc<TopicSpec>,
    /// The stamp of its header in nanoseconds since 1970, on the publisher's clock; `None` if it has
    /// none, it was not asked for, or it cannot be read.
    pub stamp_ns: Option<i64>,
    /// When it was received by this machine's wall clock, in nanoseconds since 1970. For comparison
    /// with stamps alone; ages are judged by the monotonic clock.
    pub received_wall_ns: i64,
    /// It was published when nobody listened yet, and came when it could: what it says holds, but it
    /// is neither counted nor timed.
    pub late: bool,
    /// By position in [`TopicSpec::fields`].
    pub values: Box<[FieldValue]>,
}

/// The value of a field.
#[derive(Debug, Clone, PartialEq)]
pub enum FieldValue {
    Number(f64),
    Bool(bool),
    Text(Box<str>),
    Pose(Pose),
    /// It is not in this message: no element is the one that is asked for. Such a message says
    /// nothing of the field; only its age goes on.
    Absent,
    /// Why there is none, for a developer: the message ends early, there is no such element.
    Unreadable(Box<str>),
}

/// Metres, and a rotation as a quaternion that need not be normalized.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pose {
    pub x_m: f64,
    pub y_m: f64,
    pub z_m: f64,
    pub qx: f64,
    pub qy: f64,
    pub qz: f64,
    pub qw: f64,
}

/// What discovery knows of a watched topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TopicNews {
    pub source: Arc<TopicSpec>,
    /// Publishers of the configured type.
    pub publishers: u32,
    /// Another type under which somebody publishes it: `package/msg/Name`.
    pub other_type: Option<Box<str>>,
}

/// The answer of a probe.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Probe {
    pub source: Arc<WatchdogSpec>,
    pub outcome: ProbeOutcome,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ProbeOutcome {
    Answered {
        after: Span,
    },
    /// It is not there, with the reason: refused, no answer in time, no such node.
    Missed(Box<str>),
    /// This machine cannot ask, so nothing is known: no permission, a name that does not resolve.
    Impossible(Box<str>),
}
