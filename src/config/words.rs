//! Parts of a model in words, for people who compare it with their file.

mod monitor;

use std::fmt::Write as _;
use std::time::Duration;

pub use self::monitor::monitor;
use crate::engine::countermeasure::{ConfirmedBy, Request, Rule};
use crate::engine::filter::Filter;
use crate::engine::model::{Dependency, DependsOn, Model, NodeId, POSED_SIGNAL, Policy, SignalSpec, When};
use crate::engine::state::State;
use crate::engine::time::Span;

/// `/mission/active std_msgs/msg/Bool.data, unknown when older than 2s`
pub fn signal(signal: &SignalSpec) -> String {
    let source = &signal.source;
    let dot = if source.field.is_empty() { "" } else { "." };
    let mut text = format!("{} {}{dot}{}", source.topic, source.type_name, source.field);
    if let Some(present) = signal.present_for {
        let _ = write!(text, ", true for {} after each message", span(present));
    }
    if let Some(timeout) = signal.timeout {
        let _ = write!(text, ", unknown when older than {}", span(timeout));
    }
    text
}

/// `unknown after 2s of silence, worse after 200ms`
pub fn policy(policy: &Policy) -> String {
    let silence = format!("{} after {} of silence", policy.stale, span(policy.timeout));
    std::iter::once(silence).chain(policy_when_heard(policy)).collect::<Vec<_>>().join(", ")
}

/// The same of what cannot fall silent.
pub fn policy_when_heard(policy: &Policy) -> impl Iterator<Item = String> {
    let after = |what: &str, after: Span| (!after.is_zero()).then(|| format!("{what} after {}", span(after)));
    let publisher = (policy.no_publisher == State::Error).then(|| "error without a publisher".to_owned());
    let latch = policy.latch.map(|latch| format!("an error of {} stays until reset", span(latch)));
    let delays = [after("worse", policy.raise_after), after("better", policy.clear_after)];
    delays.into_iter().chain([publisher, latch]).flatten()
}

/// `decelerate by 1 m/s² when planning or execution is error in active, confirmed by braking within 1s`
pub fn countermeasure(model: &Model, rule: &Rule) -> String {
    let request = match rule.request {
        Request::Decelerate { mps2 } => format!("decelerate by {mps2} m/s²"),
        other => other.as_str().to_owned(),
    };
    let nodes: Vec<&str> = rule.nodes.iter().map(|&node| node_name(model, node)).collect();
    let stages: Vec<&str> = rule.stages.iter().map(|stage| stage.as_str()).collect();
    let (nodes, stages, state) = (nodes.join(" or "), stages.join(" or "), rule.state);
    let mut text = format!("{request} when {nodes} is {state} in {stages}");
    if let Some(confirmation) = &rule.confirmation {
        let by = match &confirmation.by {
            ConfirmedBy::Signal(index) => format!("the signal {}", model.signals[*index].name),
            ConfirmedBy::Status(name) => format!("the status '{name}'"),
        };
        let _ = write!(text, ", confirmed by {by} within {}", span(confirmation.within));
    }
    text
}

/// `any of (can, sensors/imu) (also when unknown)`
pub fn dependency(model: &Model, dependency: &Dependency) -> String {
    let on = match &dependency.on {
        DependsOn::Node(node) => node_name(model, *node).to_owned(),
        DependsOn::AnyOf(members) => {
            let names: Vec<&str> = members.iter().map(|&node| node_name(model, node)).collect();
            format!("any of ({})", names.join(", "))
        }
    };
    if dependency.masks_unknown { format!("{on} (also when unknown)") } else { on }
}

/// `the stage is standby or active and doors is true`
pub fn when(model: &Model, when: &When) -> String {
    let stages: Vec<&str> = when.stages.iter().map(|stage| stage.as_str()).collect();
    let stages = (!stages.is_empty()).then(|| format!("the stage is {}", stages.join(" or ")));
    let signals =
        when.signals.iter().map(|&(index, value)| format!("{} is {value}", model.signals[index].name));
    let posed = when.posed.map(|value| format!("{POSED_SIGNAL} is {value}"));
    stages.into_iter().chain(signals).chain(posed).collect::<Vec<_>>().join(" and ")
}

/// `the namespace '/sensors'`
pub fn filter(filter: &Filter) -> String {
    match filter {
        Filter::Name(name) => format!("the name '{name}'"),
        Filter::Namespace(prefix) => format!("the namespace '{prefix}'"),
        Filter::Contains(part) => format!("'{part}' in the name"),
        Filter::Regex(regex) => {
            // The engine keeps the expression anchored; people wrote it without.
            let pattern = regex.as_str().strip_prefix(r"\A(?:").and_then(|rest| rest.strip_suffix(r")\z"));
            format!("a name that matches '{}'", pattern.unwrap_or(regex.as_str()))
        }
    }
}

pub fn node_name(model: &Model, node: NodeId) -> &str {
    match node {
        NodeId::Group(id) => &model.groups[id.0 as usize].path,
        NodeId::Module(id) => &model.modules[id.0 as usize].id,
    }
}

/// `1h 30m`
pub fn span(span: Span) -> String {
    humantime::format_duration(Duration::from_nanos(span.as_nanos())).to_string()
}
