//! What is published, as it is written: what differs from the default.

use super::bands::hertz;
use crate::yaml::decode::scalar;
use crate::yaml::{Fields, FromNode, Log, Node, Problem, Span, Spanned};

/// How often a topic may be published.
const RATE_HZ: std::ops::RangeInclusive<f64> = 0.1..=100.0;

/// As it is written: what differs from the default.
#[derive(Debug)]
pub(in crate::config) struct RawPublishing {
    pub span: Span,
    pub diagnostics_agg: Option<Switch<RawAggregated>>,
    pub toplevel_state: Option<Switch<RawAggregated>>,
    pub initialpose: Option<Switch<RawOnce>>,
    pub stage: Option<Switch<RawOnce>>,
    pub clearance: Option<Switch<RawOnce>>,
    pub deceleration_request: Option<Switch<RawPeriodic>>,
    pub maneuver_stop_request: Option<Switch<RawOnce>>,
}

impl FromNode for RawPublishing {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "what is published", log)?;
        let raw = RawPublishing {
            span: node.span,
            diagnostics_agg: fields.optional("diagnostics_agg"),
            toplevel_state: fields.optional("toplevel_state"),
            initialpose: fields.optional("initialpose"),
            stage: fields.optional("stage"),
            clearance: fields.optional("clearance"),
            deceleration_request: fields.optional("deceleration_request"),
            maneuver_stop_request: fields.optional("maneuver_stop_request"),
        };
        fields.finish();
        Some(raw)
    }
}

impl RawPublishing {
    /// Where requests to stop are switched off.
    pub fn stop_off(&self) -> Option<Span> {
        off(&self.maneuver_stop_request)
    }
}

/// `false`, or what is different.
#[derive(Debug)]
pub(in crate::config) enum Switch<T> {
    Off(Span),
    On(T),
}

impl<T: FromNode> FromNode for Switch<T> {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        match scalar(node) {
            Some("false") => Some(Switch::Off(node.span)),
            _ => T::from_node(node, log).map(Switch::On),
        }
    }
}

#[derive(Debug)]
pub(in crate::config) struct RawOnce {
    pub topic: Option<Spanned<String>>,
}

impl FromNode for RawOnce {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a published topic", log)?;
        let topic = fields.optional("topic");
        fields.finish();
        Some(RawOnce { topic })
    }
}

#[derive(Debug)]
pub(in crate::config) struct RawPeriodic {
    pub topic: Option<Spanned<String>>,
    pub rate: Option<Rate>,
}

impl FromNode for RawPeriodic {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a topic that is published again and again", log)?;
        let periodic = RawPeriodic { topic: fields.optional("topic"), rate: fields.optional("rate") };
        fields.finish();
        Some(periodic)
    }
}

/// As above, and whether it is published beside others.
#[derive(Debug)]
pub(in crate::config) struct RawAggregated {
    pub periodic: RawPeriodic,
    pub beside_others: Option<bool>,
}

impl FromNode for RawAggregated {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a topic of the aggregated diagnosis", log)?;
        let periodic = RawPeriodic { topic: fields.optional("topic"), rate: fields.optional("rate") };
        let aggregated = RawAggregated { periodic, beside_others: fields.optional("beside_others") };
        fields.finish();
        Some(aggregated)
    }
}

/// `20 Hz` or `20`.
#[derive(Debug)]
pub(in crate::config) struct Rate(pub f64);

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
}

pub(in crate::config) fn off<T>(raw: &Option<Switch<T>>) -> Option<Span> {
    match raw {
        Some(Switch::Off(span)) => Some(*span),
        _ => None,
    }
}
