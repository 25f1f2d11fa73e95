//! Converts the written publications into topics. No topic is read or published twice.

use super::topics::Topics;
use crate::decode::Spanned;
use crate::file::publishing::{
    Rate, RawAggregated, RawOnce, RawPeriodic, RawPublishing, RawRosout, RawTree, Switch, off,
};
use crate::file::ros_names::check_topic;
use crate::publishing::{Periodic, Publishing, Rosout};
use telltale_engine::model::StageModel;
use telltale_engine::model::countermeasure::{Request, Rule};
use telltale_engine::model::output::{Output, Publication, TreeForm};
use telltale_engine::time;
use telltale_yaml::{Log, Problem, Span};

/// The publications. Outputs that the vehicle needs must not be switched off, and no published topic may be one
/// that is read.
pub(crate) fn publishing(
    raw: Option<&RawPublishing>,
    stages: StageModel,
    rules: &[Rule],
    topics: &Topics,
    log: &mut Log,
) -> Publishing {
    let asks = |wanted: fn(Request) -> bool| rules.iter().any(|rule| wanted(rule.request));
    let decelerates = asks(|request| matches!(request, Request::Decelerate { .. }));
    let stops = asks(|request| request == Request::ManeuverStop);
    let full = Publishing::default();
    // A machine without stages is commanded only by the countermeasures of its configuration.
    let default = match stages {
        StageModel::Shuttle => full.clone(),
        StageModel::None => Publishing {
            initialpose: None,
            stage: None,
            clearance: None,
            deceleration_request: full.deceleration_request.clone().filter(|_| decelerates),
            maneuver_stop_request: full.maneuver_stop_request.clone().filter(|_| stops),
            hold: full.hold.clone().filter(|_| decelerates || stops),
            ..full.clone()
        },
    };
    let Some(raw) = raw else {
        check_loops(&default, None, topics, log);
        return default;
    };
    // The operator may request a stop on every vehicle with stages.
    let operator_stops = stages == StageModel::Shuttle && off(&raw.maneuver_stop_request).is_none();
    let needed = [
        (off(&raw.initialpose), stages == StageModel::Shuttle, "operators could not localize the vehicle"),
        (off(&raw.deceleration_request), decelerates, "a countermeasure asks for a deceleration"),
        (off(&raw.maneuver_stop_request), stops, "a countermeasure asks for a stop"),
        (
            off(&raw.hold),
            decelerates || stops || operator_stops,
            "nothing else releases a vehicle that was asked to stop",
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
        tree: match &raw.diagnostics_agg {
            Some(Switch::On(RawAggregated { tree, .. })) => tree.form(),
            _ => default.tree,
        },
        toplevel_state: aggregated(&raw.toplevel_state, default.toplevel_state, log),
        rosout: rosout(&raw.rosout, default.rosout, log),
        initialpose: once(&raw.initialpose, default.initialpose, full.initialpose, log),
        stage: once(&raw.stage, default.stage, full.stage, log),
        clearance: once(&raw.clearance, default.clearance, full.clearance, log),
        deceleration_request: periodic(
            &raw.deceleration_request,
            default.deceleration_request,
            full.deceleration_request,
            log,
        ),
        maneuver_stop_request: once(
            &raw.maneuver_stop_request,
            default.maneuver_stop_request,
            full.maneuver_stop_request,
            log,
        ),
        hold: once(&raw.hold, default.hold, full.hold, log),
    };
    check_loops(&found, Some(raw), topics, log);
    found
}

/// `default` is published without a written key, `on` with one that does not name the topic.
fn once(
    raw: &Option<Switch<RawOnce>>,
    default: Option<Box<str>>,
    on: Option<Box<str>>,
    log: &mut Log,
) -> Option<Box<str>> {
    match raw {
        None => default,
        Some(Switch::Off(_)) => None,
        Some(Switch::On(raw)) => topic(raw.topic.as_ref(), log).or(on),
    }
}

fn periodic(
    raw: &Option<Switch<RawPeriodic>>,
    default: Option<Periodic>,
    on: Option<Periodic>,
    log: &mut Log,
) -> Option<Periodic> {
    match raw {
        None => default,
        Some(Switch::Off(_)) => None,
        Some(Switch::On(raw)) => on.map(|on| raw.over(on, log)),
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
        Some(Switch::On(RawAggregated { periodic, beside_others, tree: _ })) => default.map(|default| {
            let beside_others = beside_others.unwrap_or(default.beside_others);
            Periodic { beside_others, ..periodic.over(default, log) }
        }),
    }
}

impl RawTree {
    fn form(&self) -> TreeForm {
        let default = TreeForm::default();
        TreeForm {
            path: self.path.as_ref().map(|path| path.0.as_str().into()),
            like: self.like.unwrap_or(default.like),
            values: self.values.unwrap_or(default.values),
            at_once: self.at_once.unwrap_or(default.at_once),
        }
    }
}

fn rosout(raw: &Option<Switch<RawRosout>>, default: Option<Rosout>, log: &mut Log) -> Option<Rosout> {
    match raw {
        None => default,
        Some(Switch::Off(_)) => None,
        Some(Switch::On(raw)) => default.map(|default| Rosout {
            topic: topic(raw.topic.as_ref(), log).unwrap_or(default.topic),
            level: raw.level.unwrap_or(default.level),
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

/// The place of the topic, or else of all publications.
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
    let rosout = || match &raw.rosout {
        Some(Switch::On(raw)) => raw.topic.as_ref().map(|topic| topic.span),
        _ => None,
    };
    let topic = match publication {
        Publication::Rosout => rosout(),
        Publication::DiagnosticsAgg => aggregated(&raw.diagnostics_agg),
        Publication::TopLevelState => aggregated(&raw.toplevel_state),
        Publication::Vehicle(Output::Pose) => once(&raw.initialpose),
        Publication::Vehicle(Output::Stage) => once(&raw.stage),
        Publication::Vehicle(Output::Clearance) => once(&raw.clearance),
        Publication::Vehicle(Output::Deceleration) => periodic(&raw.deceleration_request),
        Publication::Vehicle(Output::ManeuverStop) => once(&raw.maneuver_stop_request),
        Publication::Vehicle(Output::Hold) => once(&raw.hold),
    };
    Some(topic.unwrap_or(raw.span))
}

/// Checks that no topic is published twice, or published and read.
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
            log.push(problem.help(format!(
                "read another topic, or write `publish: {{ {key}: {{ topic: /OTHER }} }}`, or `{key}: false`"
            )));
        }
    }
}
