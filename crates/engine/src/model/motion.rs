//! The vehicle's stops, and the sources of its motion: its speed, and the pose of its goal.

use std::sync::Arc;

use super::monitors::{TopicId, Watched};
use crate::text::Text;
use crate::time::Span;

/// A place at which an operator may localize the vehicle: metres and degrees in the map's frame.
#[derive(Debug, Clone, PartialEq)]
pub struct Stop {
    pub id: Arc<str>,
    pub name: Text,
    pub x_m: f64,
    pub y_m: f64,
    pub yaw_deg: f64,
}

/// A field of a watched topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WatchedField {
    pub topic: TopicId,
    /// Index in [`TopicSpec::fields`](super::monitors::TopicSpec::fields).
    pub field: u32,
}

/// The vehicle's speed. Its sign does not count: a vehicle that reverses moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedSource {
    /// A number in m/s.
    pub value: WatchedField,
    /// Older than this, the speed is unknown.
    pub timeout: Span,
    pub standing_below_mps: f64,
}

/// The vehicle's place, in the frame of its goals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionSource {
    /// A pose in metres.
    pub value: WatchedField,
    /// Older than this, the place is unknown.
    pub timeout: Span,
}

/// The place without a configured timeout.
pub const POSITION_TIMEOUT: Span = Span::from_secs(1);

/// The speed without a configured timeout or limit.
pub const SPEED_TIMEOUT: Span = Span::from_secs(1);
pub const STANDING_BELOW_MPS: f64 = 0.1;

impl WatchedField {
    /// Whether both read the same field, whatever indices two configurations give it.
    pub(crate) fn means_the_same(self, watched: &Watched, other: WatchedField, others: &Watched) -> bool {
        let (topic, other_topic) =
            (&watched.topics[self.topic.0 as usize], &others.topics[other.topic.0 as usize]);
        (&topic.topic, &topic.type_name) == (&other_topic.topic, &other_topic.type_name)
            && topic.fields[self.field as usize] == other_topic.fields[other.field as usize]
    }
}
