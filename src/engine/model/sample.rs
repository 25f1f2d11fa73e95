//! The received values of topics and probes that monitors watch.

use std::sync::Arc;

use super::monitors::{TopicSpec, WatchdogSpec};
use crate::engine::time::Span;

/// One message of a watched topic.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample {
    /// What the reader read by. A sample of another configuration is not taken.
    pub source: Arc<TopicSpec>,
    /// The stamp of its header in nanoseconds since 1970, on the publisher's clock; `None` if it has
    /// none, it was not asked for, or it cannot be read.
    pub stamp_ns: Option<i64>,
    /// When it was received by this machine's wall clock, in nanoseconds since 1970. For comparison
    /// with stamps alone; ages are judged by the monotonic clock. With `clock: ros` the time on `/clock`,
    /// and [`NO_CLOCK`](Sample::NO_CLOCK) while nothing was heard there.
    pub received_wall_ns: i64,
    /// It was published when nobody listened yet, and came when it could: what it says holds, but it
    /// is neither counted nor timed.
    pub late: bool,
    /// By position in [`TopicSpec::fields`].
    pub values: Box<[FieldValue]>,
}

impl Sample {
    /// In the place of a time that is not known.
    pub const NO_CLOCK: i64 = i64::MIN;
}

/// The value of a field.
#[derive(Debug, Clone, PartialEq)]
pub enum FieldValue {
    Number(f64),
    Bool(bool),
    Text(Box<str>),
    Pose(Pose),
    Positions(Arc<Positions>),
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

/// Positions of one list that are taken; of those behind nothing is known but how many they are.
pub const POSITIONS_MAX: usize = 256;

/// Where the objects of a list are.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Positions {
    /// At most [`POSITIONS_MAX`], the first ones.
    pub taken: Box<[Position]>,
    /// How many the list has.
    pub count: u32,
}

/// On the ground, in metres.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Position {
    pub x_m: f64,
    pub y_m: f64,
}

impl Positions {
    /// Whether there are more than were taken.
    pub fn is_cut(&self) -> bool {
        self.count as usize > self.taken.len()
    }
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
        /// From the question to the answer.
        after: Span,
    },
    /// Discovery knows it; nobody asked it, so nothing is known of how soon it answers.
    Announced,
    /// It is not there, with the reason: refused, no answer in time, no such node or service.
    Missed(Box<str>),
    /// This machine cannot ask, so nothing is known: no permission, a name that does not resolve.
    Impossible(Box<str>),
}
