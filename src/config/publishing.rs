//! What this program publishes, under which names and how often (`DESIGN.md` 7).

use super::raw_bands::hertz;
use super::topics::{Topics, check_topic};
use crate::engine::model::StageModel;
use crate::engine::model::countermeasure::{Request, Rule};
use crate::engine::model::output::{Output, Publication};
use crate::engine::time;
use crate::yaml::decode::scalar;
use crate::yaml::{Fields, FromNode, Log, Node, Problem, Span, Spanned};

/// How often a topic may be published.
const RATE_HZ: std::ops::RangeInclusive<f64> = 0.1..=100.0;

/// Everything that is published. `None`: it is switched off.
#[derive(Debug, Clone, PartialEq)]
pub struct Publishing {
    pub diagnostics_agg: Option<Periodic>,
    pub toplevel_state: Option<Periodic>,
    pub initialpose: Option<Box<str>>,
    pub stage: Option<Box<str>>,
    pub clearance: Option<Box<str>>,
    /// While one is engaged.
    pub deceleration_request: Option<Periodic>,
    pub maneuver_stop_request: Option<Box<str>>,
}

/// A topic that is published again and again.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Periodic {
    pub topic: Box<str>,
    pub period: time::Span,
    /// Also where another program publishes the same.
    pub beside_others: bool,
}

impl Default for Publishing {
    fn default() -> Publishing {
        let periodic = |topic: &str, millis| {
            let period = time::Span::from_millis(millis);
            Periodic { topic: topic.into(), period, beside_others: false }
        };
        Publishing {
            diagnostics_agg: Some(periodic("/diagnostics_agg", 1000)),
            toplevel_state: Some(periodic("/diagnostics_toplevel_state", 1000)),
            initialpose: Some("/initialpose".into()),
            stage: Some("/telltale/stage".into()),
            clearance: Some("/telltale/clearance".into()),
            deceleration_request: Some(periodic("/telltale/deceleration_request", 50)),
            maneuver_stop_request: Some("/telltale/maneuver_stop_request".into()),
        }
    }
}

impl Publishing {
    /// Requests that the vehicle can never be told.
    pub fn switched_off(&self) -> Vec<Output> {
        let requests = [
            (Output::Deceleration, self.deceleration_request.is_none()),
            (Output::ManeuverStop, self.maneuver_stop_request.is_none()),
        ];
        requests.into_iter().filter(|(_, off)| *off).map(|(output, _)| output).collect()
    }

    /// Whether it is published also where another program publishes the same. What is for the vehicle
    /// always is.
    pub fn beside_others(&self, publication: Publication) -> bool {
        let periodic = match publication {
            Publication::DiagnosticsAgg => &self.diagnostics_agg,
            Publication::TopLevelState => &self.toplevel_state,
            Publication::Vehicle(_) => return true,
        };
        periodic.as_ref().is_some_and(|it| it.beside_others)
    }

    /// The topic and its period, where there is one. `None`: it is switched off.
    pub fn topic(&self, publication: Publication) -> Option<(&str, Option<time::Span>)> {
        fn periodic(it: &Option<Periodic>) -> Option<(&str, Option<time::Span>)> {
            it.as_ref().map(|it| (&*it.topic, Some(it.period)))
        }
        fn once(topic: &Option<Box<str>>) -> Option<(&str, Option<time::Span>)> {
            topic.as_deref().map(|topic| (topic, None))
        }
        match publication {
            Publication::DiagnosticsAgg => periodic(&self.diagnostics_agg),
            Publication::TopLevelState => periodic(&self.toplevel_state),
            Publication::Vehicle(Output::Pose) => once(&self.initialpose),
            Publication::Vehicle(Output::Stage) => once(&self.stage),
            Publication::Vehicle(Output::Clearance) => once(&self.clearance),
            Publication::Vehicle(Output::Deceleration) => periodic(&self.deceleration_request),
            Publication::Vehicle(Output::ManeuverStop) => once(&self.maneuver_stop_request),
        }
    }
}

/// As it is written: what differs from the default.
#[derive(Debug)]
pub(super) struct RawPublishing {
    span: Span,
    diagnostics_agg: Option<Switch<RawAggregated>>,
    toplevel_state: Option<Switch<RawAggregated>>,
    initialpose: Option<Switch<RawOnce>>,
    stage: Option<Switch<RawOnce>>,
    clearance: Option<Switch<RawOnce>>,
    deceleration_request: Option<Switch<RawPeriodic>>,
    maneuver_stop_request: Option<Switch<RawOnce>>,
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
enum Switch<T> {
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
struct RawOnce {
    topic: Option<Spanned<String>>,
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
struct RawPeriodic {
    topic: Option<Spanned<String>>,
    rate: Option<Rate>,
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
struct RawAggregated {
    periodic: RawPeriodic,
    beside_others: Option<bool>,
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
struct Rate(f64);

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

/// What is published. What a vehicle cannot do without must not be switched off, and what is
/// published here must not be what is read.
pub(super) fn publishing(
    raw: Option<&RawPublishing>,
    stages: StageModel,
    rules: &[Rule],
    topics: &Topics,
    log: &mut Log,
) -> Publishing {
    let default = Publishing::default();
    let Some(raw) = raw else {
        check_loops(&default, None, topics, log);
        return default;
    };
    let asks = |wanted: fn(Request) -> bool| rules.iter().any(|rule| wanted(rule.request));
    let needed = [
        (off(&raw.initialpose), stages == StageModel::Shuttle, "operators could not localize the vehicle"),
        (
            off(&raw.deceleration_request),
            asks(|request| matches!(request, Request::Decelerate { .. })),
            "a countermeasure asks for a deceleration",
        ),
        (
            off(&raw.maneuver_stop_request),
            asks(|request| request == Request::ManeuverStop),
            "a countermeasure asks for a stop",
        ),
    ];
    for (off, needed, why) in needed {
        if let Some(span) = off.filter(|_| needed) {
            let problem = Problem::at(span, format!("this cannot be switched off: {why}"));
            log.push(problem.help("remove the line"));
        }
    }
    let found = Publishing {
        diagnostics_agg: aggregated(&raw.diagnostics_agg, default.diagnostics_agg, log),
        toplevel_state: aggregated(&raw.toplevel_state, default.toplevel_state, log),
        initialpose: once(&raw.initialpose, default.initialpose, log),
        stage: once(&raw.stage, default.stage, log),
        clearance: once(&raw.clearance, default.clearance, log),
        deceleration_request: periodic(&raw.deceleration_request, default.deceleration_request, log),
        maneuver_stop_request: once(&raw.maneuver_stop_request, default.maneuver_stop_request, log),
    };
    check_loops(&found, Some(raw), topics, log);
    found
}

fn off<T>(raw: &Option<Switch<T>>) -> Option<Span> {
    match raw {
        Some(Switch::Off(span)) => Some(*span),
        _ => None,
    }
}

fn once(raw: &Option<Switch<RawOnce>>, default: Option<Box<str>>, log: &mut Log) -> Option<Box<str>> {
    match raw {
        None => default,
        Some(Switch::Off(_)) => None,
        Some(Switch::On(raw)) => topic(raw.topic.as_ref(), log).or(default),
    }
}

fn periodic(raw: &Option<Switch<RawPeriodic>>, default: Option<Periodic>, log: &mut Log) -> Option<Periodic> {
    match raw {
        None => default,
        Some(Switch::Off(_)) => None,
        Some(Switch::On(raw)) => default.map(|default| raw.over(default, log)),
    }
}

fn aggregated(
    raw: &Option<Switch<RawAggregated>>,
    default: Option<Periodic>,
    log: &mut Log,
) -> Option<Periodic> {
    match raw {
        None => default,
        Some(Switch::Off(_)) => None,
        Some(Switch::On(RawAggregated { periodic, beside_others })) => default.map(|default| {
            let beside_others = beside_others.unwrap_or(default.beside_others);
            Periodic { beside_others, ..periodic.over(default, log) }
        }),
    }
}

impl RawPeriodic {
    fn over(&self, default: Periodic, log: &mut Log) -> Periodic {
        let every = |Rate(hertz): &Rate| time::Span::from_nanos((1e9 / hertz).round() as u64);
        Periodic {
            topic: topic(self.topic.as_ref(), log).unwrap_or(default.topic),
            period: self.rate.as_ref().map_or(default.period, every),
            beside_others: default.beside_others,
        }
    }
}

fn topic(raw: Option<&Spanned<String>>, log: &mut Log) -> Option<Box<str>> {
    let raw = raw?;
    check_topic(raw, log);
    Some(raw.value.as_str().into())
}

/// Where the topic is written, or else all of it.
fn place(raw: Option<&RawPublishing>, publication: Publication) -> Option<Span> {
    fn once(raw: &Option<Switch<RawOnce>>) -> Option<Span> {
        let Some(Switch::On(raw)) = raw else { return None };
        raw.topic.as_ref().map(|topic| topic.span)
    }
    fn periodic(raw: &Option<Switch<RawPeriodic>>) -> Option<Span> {
        let Some(Switch::On(raw)) = raw else { return None };
        raw.topic.as_ref().map(|topic| topic.span)
    }
    fn aggregated(raw: &Option<Switch<RawAggregated>>) -> Option<Span> {
        let Some(Switch::On(raw)) = raw else { return None };
        raw.periodic.topic.as_ref().map(|topic| topic.span)
    }
    let raw = raw?;
    let topic = match publication {
        Publication::DiagnosticsAgg => aggregated(&raw.diagnostics_agg),
        Publication::TopLevelState => aggregated(&raw.toplevel_state),
        Publication::Vehicle(Output::Pose) => once(&raw.initialpose),
        Publication::Vehicle(Output::Stage) => once(&raw.stage),
        Publication::Vehicle(Output::Clearance) => once(&raw.clearance),
        Publication::Vehicle(Output::Deceleration) => periodic(&raw.deceleration_request),
        Publication::Vehicle(Output::ManeuverStop) => once(&raw.maneuver_stop_request),
    };
    Some(topic.unwrap_or(raw.span))
}

/// No two publish one topic, and none publishes what is read.
fn check_loops(publishing: &Publishing, raw: Option<&RawPublishing>, topics: &Topics, log: &mut Log) {
    let mut taken: Vec<(&str, &str)> = Vec::new();
    for publication in Publication::ALL {
        let Some((topic, _)) = publishing.topic(publication) else { continue };
        let (key, own) = (publication.as_str(), place(raw, publication));
        if let Some((other, _)) = taken.iter().find(|(_, other)| *other == topic) {
            let span = own.unwrap_or(Span { file: 0, start: 0, end: 0 });
            let problem =
                Problem::at(span, format!("`{key}` and `{other}` would publish one topic, {topic}"));
            log.push(problem.help("give each a topic of its own"));
        }
        taken.push((key, topic));
        if topics.reads(topic) {
            let span = topics.place(topic).or(own).unwrap_or(Span { file: 0, start: 0, end: 0 });
            let problem =
                Problem::at(span, format!("{topic} is read here, and published by this program as `{key}`"));
            log.push(
                problem.help(format!(
                    "read another topic, or write `publish: {{ {key}: {{ topic: /OTHER }} }}`"
                )),
            );
        }
    }
}
