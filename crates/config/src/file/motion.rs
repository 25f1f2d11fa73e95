//! The vehicle's motion as it is written: where its speed comes from, and when it stands.

use super::forms::{FIELD, default_span};
use super::monitors::sources::{POSE, Topic};
use crate::decode::{FromNode, Spanned};
use crate::fields::Fields;
use telltale_engine::model::motion::{POSITION_TIMEOUT, SPEED_TIMEOUT, STANDING_BELOW_MPS};
use telltale_engine::time;
use telltale_yaml::schema::{default, most};
use telltale_yaml::{Log, Node, key, map};

/// The largest timeout of a speed or a position: an older one says nothing about the present motion.
pub(crate) const TIMEOUT_MAX: time::Span = time::Span::from_secs(10);
/// The largest speed at which a vehicle may count as standing.
pub(crate) const STANDING_MPS_MAX: f64 = 1.0;

/// `motion: { speed: { topic: /t, type: T, field: PATH, timeout: 1s }, standing_below: 0.1 }`
#[derive(Debug)]
pub(crate) struct RawMotion {
    pub speed: Option<RawSpeed>,
    pub position: Option<RawPosition>,
    pub standing_below: Option<Spanned<f64>>,
}

#[derive(Debug)]
pub(crate) struct RawSpeed {
    pub topic: Topic,
    pub field: Option<Spanned<String>>,
    pub timeout: Option<Spanned<time::Span>>,
}

/// `position: { topic: /t, type: T, pose: PATH, timeout: 1s }`
#[derive(Debug)]
pub(crate) struct RawPosition {
    pub topic: Topic,
    pub pose: Spanned<String>,
    pub timeout: Option<Spanned<time::Span>>,
}

impl FromNode for RawMotion {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let about =
            "Whether the vehicle moves, and how fast. Without it the page says that it does not know.";
        let mut fields = Fields::of(node, map("motion", "the motion").about(about), log)?;
        Some(RawMotion {
            speed: fields.required(key("speed").about("In m/s; its sign does not count.")),
            position: fields.optional(
                key("position").about("Where the vehicle is, in the frame of the goal: the page then says how far the next stop is."),
            ),
            standing_below: fields.optional(
                key("standing_below")
                    .about("In m/s. Slower than this for half a second, the vehicle stands; at this speed it moves at once.")
                    .rules(|| vec![("exclusiveMinimum", 0.into()), most(STANDING_MPS_MAX), default(STANDING_BELOW_MPS)]),
            ),
        })
    }
}

impl FromNode for RawSpeed {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let about = "A number in a topic.";
        let mut fields = Fields::of(node, map("speed", "a speed").about(about), log)?;
        let topic = Topic::of(&mut fields);
        let field = fields.optional(FIELD.about("Path of the number; `data` for std_msgs."));
        let timeout = fields.optional(
            key("timeout")
                .about("Older than this, the speed is unknown. At most 10s.")
                .rules(|| vec![default_span(SPEED_TIMEOUT)]),
        );
        Some(RawSpeed { topic: topic?, field, timeout })
    }
}

impl FromNode for RawPosition {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let about = "A pose in a topic.";
        let mut fields = Fields::of(node, map("position", "a position").about(about), log)?;
        let topic = Topic::of(&mut fields);
        let pose = fields.required(POSE);
        let timeout = fields.optional(
            key("timeout")
                .about("Older than this, the position is unknown. At most 10s.")
                .rules(|| vec![default_span(POSITION_TIMEOUT)]),
        );
        Some(RawPosition { topic: topic?, pose: pose?, timeout })
    }
}
