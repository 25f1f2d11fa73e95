//! Describes parts of a model, for people who compare it with their file.

mod monitor;

use std::fmt::Write as _;
use std::time::Duration;

pub use self::monitor::monitor;
use crate::fleet::Fleet;
use crate::recording::Recording;
use crate::services::{Offer, Services};
use telltale_engine::model::countermeasure::{ConfirmedBy, Request, Rule};
use telltale_engine::model::filter::Filter;
use telltale_engine::model::monitors::{RecordedTopic, Watched};
use telltale_engine::model::motion::{PositionSource, SpeedSource};
use telltale_engine::model::service::Service;
use telltale_engine::model::{
    CountsAs, Dependency, DependsOn, Match, Model, Other, POSED_SIGNAL, Policy, SignalSource, SignalSpec,
    When, Within,
};
use telltale_engine::state::State;
use telltale_engine::time::Span;

/// `/mission/active std_msgs/msg/Bool.data, unknown when older than 2s`, ``true if `value == 1` with
/// value = power_supply_status of /battery (sensor_msgs/msg/BatteryState)``
pub fn signal(model: &Model, signal: &SignalSpec) -> String {
    let (mut text, event) = match &signal.source {
        SignalSource::Field(source) => {
            let dot = if source.field.is_empty() { "" } else { "." };
            let type_name = type_name(&source.type_name);
            (format!("{} {type_name}{dot}{}", source.topic, source.field), "each message")
        }
        SignalSource::Condition(spec) => {
            (monitor::condition(model, spec), "each message with which the condition holds")
        }
    };
    if let Some(present) = signal.present_for {
        let _ = write!(text, ", true for {} after {event}", span(present));
    }
    if let Some(timeout) = signal.timeout {
        let _ = write!(text, ", unknown when older than {}", span(timeout));
    }
    text
}

/// ``twist.linear.x of /can/speed (geometry_msgs/msg/TwistStamped), unknown when older than 1s, standing below
/// 0.1 m/s``, and where the vehicle is if that is configured.
pub fn motion(model: &Model) -> String {
    let Some(SpeedSource { value, timeout, standing_below_mps }) = &model.driving.speed else {
        return "no speed is configured".into();
    };
    let (of, old) = (monitor::field(model, value.topic, value.field), span(*timeout));
    let mut text = format!("{of}, unknown when older than {old}, standing below {standing_below_mps} m/s");
    if let Some(PositionSource { value, timeout }) = &model.driving.position {
        let (of, old) = (monitor::field(model, value.topic, value.field), span(*timeout));
        let _ = write!(text, "; position from {of}, unknown when older than {old}");
    }
    text
}

/// The type, or a note that the publisher announces it.
fn type_name(known: &str) -> &str {
    if known.is_empty() { "(type as published)" } else { known }
}

/// `1 group`, `3 groups`
pub fn counted(count: usize, one: &str) -> String {
    if count == 1 { format!("1 {one}") } else { format!("{count} {one}s") }
}

/// `unknown after 2s of silence, worse after 200ms`
pub fn policy(policy: &Policy) -> String {
    let silence = format!("{} after {} of silence", policy.stale, span(policy.timeout));
    let forgotten = policy.forget_after.map(|after| format!("forgotten after {}", span(after)));
    std::iter::once(silence).chain(forgotten).chain(policy_when_heard(policy)).collect::<Vec<_>>().join(", ")
}

/// The same for a module that cannot fall silent.
pub fn policy_when_heard(policy: &Policy) -> impl Iterator<Item = String> {
    let after = |what: &str, after: Span| (!after.is_zero()).then(|| format!("{what} after {}", span(after)));
    let publisher = (policy.no_publisher == State::Error).then(|| "error without a publisher".to_owned());
    let latch = policy.latch.map(|latch| format!("an error of {} stays until reset", span(latch)));
    let writers = policy.writers.as_ref().map(|writers| format!("said by {} alone", writers.join(" or ")));
    let delays = [after("worse", policy.raise_after), after("better", policy.clear_after)];
    let counts_as = match policy.counts_as {
        CountsAs::Reported => None,
        CountsAs::WarningOk => Some("a warning is ok".to_owned()),
        CountsAs::WarningError => Some("a warning is an error".to_owned()),
        CountsAs::Error => Some("whatever is reported is an error".to_owned()),
    };
    delays.into_iter().chain([publisher, latch, writers, counts_as]).flatten()
}

/// `decelerate by 1 m/s² when planning or execution is error in active, confirmed by braking within 1s`
pub fn countermeasure(model: &Model, rule: &Rule) -> String {
    let request = match rule.request {
        Request::Decelerate { mps2 } => format!("decelerate by {mps2} m/s²"),
        other => other.as_str().to_owned(),
    };
    let nodes: Vec<&str> = rule.nodes.iter().map(|&node| model.node_name(node)).collect();
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
        DependsOn::Node(node) => model.node_name(*node).to_owned(),
        DependsOn::AnyOf(members) => {
            let names: Vec<&str> = members.iter().map(|&node| model.node_name(node)).collect();
            format!("any of ({})", names.join(", "))
        }
    };
    let unknown = if dependency.masks_unknown { " (also when unknown)" } else { "" };
    let within = match dependency.within {
        within if within == Within::default() => String::new(),
        Within::Always => " (explains everything)".to_owned(),
        Within::Limit(limit) => format!(" (explains within {})", span(limit)),
    };
    format!("{on}{unknown}{within}")
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

/// The treatment of unclaimed statuses.
pub fn other(other: Other) -> &'static str {
    match other {
        Other::Hidden => "shown to developers alone",
        Other::Shown => "one line for the operator when one of them is not OK, no alarm",
        Other::Counted => "a tile like any other, with alarms",
    }
}

/// An entry of a `match` list.
pub fn matching(Match { filter, except, prefixes, policy }: &Match) -> String {
    let except = (!except.is_empty()).then(|| format!("except {}", filters(except)));
    let prefix = (!prefixes.is_empty()).then(|| format!("without {}", self::prefixes(prefixes)));
    let beside = except.into_iter().chain(prefix).chain(policy.as_ref().map(self::policy));
    let beside = beside.collect::<Vec<_>>().join(", ");
    if beside.is_empty() { self::filter(filter) } else { format!("{} ({beside})", self::filter(filter)) }
}

/// `'/sensors' and 'imu' at the beginning of the name`
pub fn prefixes(prefixes: &[Box<str>]) -> String {
    let all: Vec<String> = prefixes.iter().map(|prefix| format!("'{prefix}'")).collect();
    format!("{} at the beginning of the name", all.join(" and "))
}

/// Several filters; each takes its own statuses.
pub fn filters(all: &[Filter]) -> String {
    all.iter().map(filter).collect::<Vec<_>>().join(" and ")
}

fn filter(filter: &Filter) -> String {
    match filter {
        Filter::Name(name) => format!("the name '{name}'"),
        Filter::Namespace(prefix) => format!("the namespace '{prefix}'"),
        Filter::Contains(part) => format!("'{part}' in the name"),
        Filter::Regex(regex) => {
            // The engine's expression has anchors; the file has none.
            let pattern = regex.as_str().strip_prefix(r"\A(?:").and_then(|rest| rest.strip_suffix(r")\z"));
            format!("a name that matches '{}'", pattern.unwrap_or(regex.as_str()))
        }
    }
}

/// `1h 30m`
pub fn span(span: Span) -> String {
    const DAY: u64 = 24 * 3600 * 1_000_000_000;
    if !span.is_zero() && span.as_nanos().is_multiple_of(DAY) {
        return format!("{}d", span.as_nanos() / DAY);
    }
    humantime::format_duration(Duration::from(span)).to_string()
}

/// A size as the configuration has it: `256MB`.
pub fn bytes(bytes: u64) -> String {
    let units = [("TB", 1_000_000_000_000), ("GB", 1_000_000_000), ("MB", 1_000_000), ("kB", 1000)];
    let whole = units.into_iter().find(|(_, scale)| bytes >= *scale && bytes.is_multiple_of(*scale));
    match whole {
        Some((unit, scale)) => format!("{}{unit}", bytes / scale),
        None => format!("{}kB", bytes as f64 / 1000.0),
    }
}

/// The services that are offered.
pub fn services(services: &Services) -> String {
    let word = |(service, offer): (&Service, &Offer)| {
        let also = offer.while_driving && *service != Service::Mark;
        format!("{}{}", service.as_str(), if also { " (also while driving)" } else { "" })
    };
    let words: Vec<String> = services.0.iter().map(word).collect();
    if words.is_empty() { "none".to_owned() } else { words.join(", ") }
}

/// The settings of the recording.
pub fn recording(recording: Option<&Recording>) -> String {
    let Some(Recording { before, after, memory, disk, keep, topics }) = recording else {
        return "switched off".to_owned();
    };
    let [before, after, keep] = [before, after, keep].map(|it| span(*it));
    let [memory, disk] = [memory, disk].map(|it| bytes(*it));
    let mut words =
        format!("{before} before and {after} after, {memory} of memory, {disk} of disk, kept for {keep}");
    for (index, RecordedTopic { pattern, every }) in topics.iter().enumerate() {
        words.push_str(if index == 0 { "; also " } else { ", " });
        words.push_str(pattern);
        if *every == RecordedTopic::NEVER {
            words.push_str(" never");
        } else if *every > Span::ZERO {
            words.push_str(&format!(" every {}", span(*every)));
        }
    }
    words
}

/// The settings of the fleet.
pub fn fleet(fleet: Option<&Fleet>) -> String {
    let Some(Fleet { hub, credentials, ca, max_kbit_s, recordings }) = fleet else {
        return "none".to_owned();
    };
    let (credentials, ca) = (credentials.display(), ca.display());
    let recordings = recordings.as_str();
    format!(
        "{hub} with the key {credentials} and the authority {ca}, at most {max_kbit_s} kbit/s, recordings {recordings}"
    )
}

/// The topics on which components report.
pub fn diagnostics(watched: &Watched) -> String {
    let one = |(topic, prefix): (&str, &str)| match prefix {
        "" => topic.to_owned(),
        prefix => format!("{topic} as `{prefix}...`"),
    };
    watched.diagnostics_topics().map(one).collect::<Vec<_>>().join(", ")
}
