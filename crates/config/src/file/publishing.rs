//! Decodes the key `publish`: the differences from the topics that are published by default.

use super::forms::{self, TOPIC};
use super::monitors::bands::hertz;
use crate::decode::{FromNode, Spanned};
use crate::fields::Fields;
use telltale_engine::model::output::{Like, LogLevel};
use telltale_yaml::decode::{scalar, word};
use telltale_yaml::schema::{default, of_type, words};
use telltale_yaml::{KeyDoc, Log, Members, Node, Problem, Schema, Span, key, map};

/// The permitted rates of a topic.
const RATE_HZ: std::ops::RangeInclusive<f64> = 0.1..=100.0;

const RATE: KeyDoc = key("rate").about("How often, from 0.1 Hz to 100 Hz.");

/// The differences from the default.
#[derive(Debug)]
pub(crate) struct RawPublishing {
    pub span: Span,
    pub diagnostics_agg: Option<Switch<RawAggregated>>,
    pub toplevel_state: Option<Switch<RawAggregated>>,
    pub rosout: Option<Switch<RawRosout>>,
    pub initialpose: Option<Switch<RawOnce>>,
    pub stage: Option<Switch<RawOnce>>,
    pub clearance: Option<Switch<RawOnce>>,
    pub deceleration_request: Option<Switch<RawPeriodic>>,
    pub maneuver_stop_request: Option<Switch<RawOnce>>,
    pub hold: Option<Switch<RawOnce>>,
}

impl FromNode for RawPublishing {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let about = "Names and rates of the topics that are published; `false` switches one off.";
        let mut fields = Fields::of(node, map("publishing", "what is published").about(about), log)?;
        Some(RawPublishing {
            span: node.span,
            diagnostics_agg: fields.optional_by(
                key("diagnostics_agg").about("/diagnostics_agg with 1 Hz."),
                |schema| forms::or_off(schema.decoder(RawAggregated::tree)),
                |node, log| Switch::read(node, log, RawAggregated::tree),
            ),
            toplevel_state: fields
                .optional(key("toplevel_state").about("/diagnostics_toplevel_state with 1 Hz.")),
            rosout: fields.optional(
                key("rosout")
                    .about("/rosout: warnings and errors of Telltale, and root causes as they come and go."),
            ),
            initialpose: fields.optional(key("initialpose").about("/initialpose.")),
            stage: fields.optional(key("stage").about("/telltale/stage.")),
            clearance: fields.optional(key("clearance").about("/telltale/clearance.")),
            deceleration_request: fields
                .optional(key("deceleration_request").about("/telltale/deceleration_request with 20 Hz.")),
            maneuver_stop_request: fields
                .optional(key("maneuver_stop_request").about("/telltale/maneuver_stop_request.")),
            hold: fields.optional(
                key("hold").about("/telltale/hold: whether the vehicle must stand until it is released."),
            ),
        })
    }
}

impl RawPublishing {
    /// The place where requests to stop are switched off.
    pub fn stop_off(&self) -> Option<Span> {
        off(&self.maneuver_stop_request)
    }
}

/// `false`, or the differences from the default.
#[derive(Debug)]
pub(crate) enum Switch<T> {
    Off(Span),
    On(T),
}

impl<T: FromNode> FromNode for Switch<T> {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        Switch::read(node, log, T::from_node)
    }

    fn form(schema: &mut Schema) -> Members {
        forms::or_off(T::form(schema))
    }
}

impl<T> Switch<T> {
    fn read(node: &Node, log: &mut Log, on: fn(&Node, &mut Log) -> Option<T>) -> Option<Switch<T>> {
        match scalar(node) {
            Some("false") => Some(Switch::Off(node.span)),
            _ => on(node, log).map(Switch::On),
        }
    }
}

#[derive(Debug)]
pub(crate) struct RawOnce {
    pub topic: Option<Spanned<String>>,
}

impl FromNode for RawOnce {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, map("published", "a published topic"), log)?;
        Some(RawOnce { topic: fields.optional(TOPIC) })
    }
}

/// The lines of the log.
#[derive(Debug)]
pub(crate) struct RawRosout {
    pub topic: Option<Spanned<String>>,
    pub level: Option<LogLevel>,
}

impl FromNode for RawRosout {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, map("rosout", "the published log"), log)?;
        let level = key("level")
            .about("The least severity: with `error`, neither warnings nor the ends of root causes are published.")
            .rules(|| vec![default(LogLevel::default().as_str())]);
        Some(RawRosout { topic: fields.optional(TOPIC), level: fields.optional(level) })
    }
}

impl FromNode for LogLevel {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        word(node, log, "severity", &LogLevel::ALL.map(|level| (level.as_str(), level)))
    }

    fn form(_: &mut Schema) -> Members {
        words(LogLevel::ALL.map(LogLevel::as_str))
    }
}

#[derive(Debug)]
pub(crate) struct RawPeriodic {
    pub topic: Option<Spanned<String>>,
    pub rate: Option<Rate>,
}

impl FromNode for RawPeriodic {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let doc = map("periodic", "a topic that is published again and again");
        let mut fields = Fields::of(node, doc, log)?;
        Some(RawPeriodic { topic: fields.optional(TOPIC), rate: fields.optional(RATE) })
    }
}

/// The same, and whether it is published beside other publishers.
#[derive(Debug)]
pub(crate) struct RawAggregated {
    pub periodic: RawPeriodic,
    pub beside_others: Option<bool>,
    pub tree: RawTree,
}

/// Only of the tree.
#[derive(Debug, Default)]
pub(crate) struct RawTree {
    pub path: Option<TreePath>,
    pub like: Option<Like>,
    pub values: Option<bool>,
    pub at_once: Option<bool>,
}

impl FromNode for RawAggregated {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, map("aggregated", "a topic of the aggregated diagnosis"), log)?;
        Some(RawAggregated::of(&mut fields))
    }
}

impl RawAggregated {
    fn of(fields: &mut Fields) -> RawAggregated {
        let periodic = RawPeriodic { topic: fields.optional(TOPIC), rate: fields.optional(RATE) };
        let beside_others = key("beside_others").about(
            "Whether Telltale publishes it also where another program publishes the same; otherwise Telltale is silent there.",
        );
        RawAggregated { periodic, beside_others: fields.optional(beside_others), tree: RawTree::default() }
    }

    /// The topic of the tree.
    fn tree(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, map("aggregated_tree", "the topic of the aggregated tree"), log)?;
        let aggregated = RawAggregated::of(&mut fields);
        let path = key("path").about(
            "The path of the whole, as diagnostic_aggregator has it; `''` for none. With it, all paths and levels are exactly those of diagnostic_aggregator, which puts a `/` before it. Without it, the path is the vehicle's name.",
        );
        let like = key("like")
            .about("The release of diagnostic_aggregator whose levels are followed, by its number for Kilted; those for other distributions of the same day are the same. To 4.3.6 what is STALE in part is ERROR; from 4.3.7 on (26 May 2026) it is STALE unless something in it is in WARN or ERROR, and the message of /diagnostics_toplevel_state names the worst status.")
            .rules(|| vec![default(Like::default().as_str())]);
        let values =
            key("values").about("Whether the statuses in the tree have values; without them it is smaller.");
        let at_once = key("at_once").about(
            "Whether the tree is published also at once when the level of the whole gets worse, and not only at its rate. /diagnostics_toplevel_state always is.",
        );
        let tree = RawTree {
            path: fields.optional(path),
            like: fields.optional(like),
            values: fields.optional(values),
            at_once: fields.optional(at_once),
        };
        Some(RawAggregated { tree, ..aggregated })
    }
}

impl FromNode for Like {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        word(node, log, "release", &Like::ALL.map(|like| (like.as_str(), like)))
    }

    fn form(_: &mut Schema) -> Members {
        words(Like::ALL.map(Like::as_str))
    }
}

/// The path of the whole tree; it may be empty.
#[derive(Debug)]
pub(crate) struct TreePath(pub String);

impl FromNode for TreePath {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        match scalar(node) {
            Some(text) => Some(TreePath(text.to_owned())),
            None => String::from_node(node, log).map(TreePath),
        }
    }

    fn form(_: &mut Schema) -> Members {
        of_type("string")
    }
}

/// `20 Hz` or `20`.
#[derive(Debug)]
pub(crate) struct Rate(pub f64);

impl FromNode for Rate {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let found = scalar(node).and_then(hertz).filter(|rate| RATE_HZ.contains(rate));
        if found.is_none() {
            let (least, most) = (RATE_HZ.start(), RATE_HZ.end());
            let problem = Problem::at(node.span, format!("expected a rate, found {}", node.describe()));
            log.push(problem.help(format!("write {least} Hz to {most} Hz, for example `20 Hz`")));
        }
        found.map(Rate)
    }

    fn form(schema: &mut Schema) -> Members {
        forms::rate(schema)
    }
}

pub(crate) fn off<T>(raw: &Option<Switch<T>>) -> Option<Span> {
    match raw {
        Some(Switch::Off(span)) => Some(*span),
        _ => None,
    }
}
