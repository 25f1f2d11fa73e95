//! The received values of topics and probes that monitors watch.

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};
use std::sync::Arc;

use super::monitors::{TopicSpec, WatchdogSpec};
use crate::files::float;
use crate::time::Span;

/// One message of a watched topic.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// The topic for which it was read. A sample of another configuration is not taken.
    pub source: Arc<TopicSpec>,
    /// The stamp of its header in nanoseconds since 1970, on the publisher's clock; `None` if there is none, it
    /// was not requested, or it cannot be read.
    pub stamp_ns: Option<i64>,
    /// The time of receipt by this machine's wall clock, in nanoseconds since 1970. Only for comparison with
    /// stamps; ages follow the monotonic clock. With `clock: ros` it is the time on `/clock`, and
    /// [`NO_CLOCK`](Sample::NO_CLOCK) before the first one.
    pub received_wall_ns: i64,
    /// It was published before Telltale listened, and arrived later: its value holds, but it is neither counted
    /// nor timed.
    pub late: bool,
    /// How much later than usual it was received: it was lost at first, or waited. It counts from when it should have come.
    #[serde(rename = "late_ns", default, skip_serializing_if = "Span::is_zero")]
    pub delay: Span,
    /// By position in [`TopicSpec::fields`].
    pub values: Box<[FieldValue]>,
}

impl Sample {
    /// One that came in time, without a stamp.
    pub fn of(source: Arc<TopicSpec>, values: Box<[FieldValue]>) -> Sample {
        Sample { source, stamp_ns: None, received_wall_ns: 0, late: false, delay: Span::ZERO, values }
    }

    /// Replaces an unknown time.
    pub const NO_CLOCK: i64 = i64::MIN;

    /// About the bytes of its values.
    pub fn value_bytes(&self) -> usize {
        let held = |value: &FieldValue| match value {
            FieldValue::Text(text) | FieldValue::Unreadable(text) => text.len(),
            FieldValue::Positions(list) => size_of_val(&*list.taken) + size_of::<Positions>(),
            FieldValue::Elements(list) => {
                let text = |it: &FieldValue| if let FieldValue::Text(text) = it { text.len() } else { 0 };
                size_of_val(&*list.taken) + list.taken.iter().map(text).sum::<usize>()
            }
            FieldValue::Transforms(list) => {
                size_of_val(&**list) + list.iter().map(|it| it.parent.len()).sum::<usize>()
            }
            FieldValue::Number(_)
            | FieldValue::Bool(_)
            | FieldValue::Pose(_)
            | FieldValue::Content(_)
            | FieldValue::Absent => 0,
        };
        size_of_val(&*self.values) + self.values.iter().map(held).sum::<usize>()
    }
}

/// The value of a field.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FieldValue {
    Number(#[serde(with = "float")] f64),
    Bool(bool),
    Text(Box<str>),
    Pose(Pose),
    Positions(Arc<Positions>),
    /// Those of one child frame, of different parents, at most [`PARENTS_MAX`]; never empty.
    Transforms(#[serde(deserialize_with = "few_parents")] Box<[Transform]>),
    /// Of the elements of an array.
    Elements(Arc<Elements>),
    /// Equal for equal content.
    Content(Fingerprint),
    /// The message does not contain it: no element has the requested property. The last value stays and ages.
    Absent,
    /// The reason why it cannot be read, for a developer: the message ends early, or the element is missing.
    Unreadable(Box<str>),
}

/// A hash of a part of a message; in files 16 hexadecimal digits, because many readers of JSON take numbers for doubles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Fingerprint(pub u64);

impl From<Fingerprint> for String {
    fn from(fingerprint: Fingerprint) -> String {
        format!("{:016x}", fingerprint.0)
    }
}

impl TryFrom<String> for Fingerprint {
    type Error = &'static str;

    fn try_from(text: String) -> Result<Fingerprint, &'static str> {
        let digits = Some(&text).filter(|it| it.len() == 16 && it.bytes().all(|it| it.is_ascii_hexdigit()));
        let number = digits.and_then(|digits| u64::from_str_radix(digits, 16).ok());
        number.map(Fingerprint).ok_or("a fingerprint has 16 hexadecimal digits")
    }
}

/// Elements of one array that are kept; further ones are only counted.
pub const ELEMENTS_MAX: usize = 256;

/// One value of each element of an array: numbers, truth values or texts.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Elements {
    /// At most [`ELEMENTS_MAX`], the first ones.
    #[serde(deserialize_with = "few_scalars")]
    pub taken: Box<[FieldValue]>,
    /// The length of the array.
    pub count: u32,
}

impl Elements {
    /// Whether the array has more elements than were kept.
    pub fn is_cut(&self) -> bool {
        self.count as usize > self.taken.len()
    }
}

fn few_scalars<'de, D: Deserializer<'de>>(from: D) -> Result<Box<[FieldValue]>, D::Error> {
    let taken = Box::<[FieldValue]>::deserialize(from)?;
    let is_scalar =
        |it: &FieldValue| matches!(it, FieldValue::Number(_) | FieldValue::Bool(_) | FieldValue::Text(_));
    if taken.len() > ELEMENTS_MAX || !taken.iter().all(is_scalar) {
        return Err(D::Error::custom("at most 256 elements, each a number, a truth value or a text"));
    }
    Ok(taken)
}

/// Parents of one frame that are kept of a message: two are a fault already.
pub const PARENTS_MAX: usize = 2;

/// That a frame has this parent, by a transform in a `tf2_msgs/TFMessage`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Transform {
    pub parent: Box<str>,
    /// In nanoseconds since 1970, on the publisher's clock; `None` if it is no time.
    pub stamp_ns: Option<i64>,
}

fn few_parents<'de, D: Deserializer<'de>>(from: D) -> Result<Box<[Transform]>, D::Error> {
    let taken = Box::<[Transform]>::deserialize(from)?;
    if !(1..=PARENTS_MAX).contains(&taken.len()) {
        return Err(D::Error::invalid_length(taken.len(), &"one or two parents"));
    }
    Ok(taken)
}

/// Metres, and a rotation as a quaternion that need not be normalized.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pose {
    #[serde(with = "float")]
    pub x_m: f64,
    #[serde(with = "float")]
    pub y_m: f64,
    #[serde(with = "float")]
    pub z_m: f64,
    #[serde(with = "float")]
    pub qx: f64,
    #[serde(with = "float")]
    pub qy: f64,
    #[serde(with = "float")]
    pub qz: f64,
    #[serde(with = "float")]
    pub qw: f64,
}

/// Positions of one list that are kept; further ones are only counted.
pub const POSITIONS_MAX: usize = 256;

/// The positions of the objects in a list.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct Positions {
    /// At most [`POSITIONS_MAX`], the first ones.
    #[serde(deserialize_with = "few")]
    pub taken: Box<[Position]>,
    /// The length of the list.
    pub count: u32,
}

/// On the ground, in metres.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Position {
    #[serde(with = "float")]
    pub x_m: f64,
    #[serde(with = "float")]
    pub y_m: f64,
}

/// Reads a list of positions, which costs the square of its length to compare.
fn few<'de, D: Deserializer<'de>>(from: D) -> Result<Box<[Position]>, D::Error> {
    let taken = Box::<[Position]>::deserialize(from)?;
    let count = taken.len();
    if count > POSITIONS_MAX {
        return Err(D::Error::invalid_length(count, &"at most 256 positions"));
    }
    Ok(taken)
}

impl Positions {
    /// Whether the list has more positions than were kept.
    pub fn is_cut(&self) -> bool {
        self.count as usize > self.taken.len()
    }
}

/// The publishers of a watched topic, from discovery.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct PublisherReport {
    pub source: Arc<TopicSpec>,
    /// Publishers of the configured type.
    pub publishers: u32,
    /// Another type under which the topic is published: `package/msg/Name`.
    pub other_type: Option<Box<str>>,
    /// Whether all of them keep their last messages for late readers, and are asked for them.
    #[serde(default)]
    pub transient_local: bool,
    /// Whether one of them is best effort: it sends a lost message no second time.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub best_effort: bool,
    /// A message may have been missed that nobody tells again: a publisher that keeps nothing, or the reader, is new, or
    /// the publisher of the last message is gone.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub anew: bool,
}

/// The result of a probe.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Probe {
    pub source: Arc<WatchdogSpec>,
    pub outcome: ProbeOutcome,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ProbeOutcome {
    Answered {
        /// The response time.
        after: Span,
    },
    /// Discovery knows it. It was not asked, so its response time is unknown.
    Announced,
    /// A node that several participants announce at once: one that crashed counts until its leases end, so each but the
    /// last is a restart, or the node runs more than once.
    Repeated { times: u32 },
    /// The measured value, in the unit of the target.
    Measured(#[serde(with = "float")] f64),
    /// A lifecycle node that answered with another state than active.
    Inactive { state: Box<str> },
    /// It is not there, with the reason: refused, no answer in time, no such node or service.
    Missed(Box<str>),
    /// This machine cannot probe it, so nothing is known: no permission, or a name that does not resolve.
    Impossible(Box<str>),
}
