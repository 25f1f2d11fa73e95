//! What scenario files say of watched topics and probes: written, then bound to a model.

use std::sync::Arc;

use crate::engine::input::Input;
use crate::engine::model::Model;
use crate::engine::monitor::spec::{FieldKind, ProbeTarget, TopicSpec};
use crate::engine::sample::{FieldValue, Pose, Probe, ProbeOutcome, Sample, TopicNews};
use crate::engine::time;
use crate::yaml::decode::{Entries, did_you_mean};
use crate::yaml::{Fields, FromNode, Kind, Log, Node, Problem, Spanned, suggest};

/// What the header of a message says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stamp {
    /// An instant: nanoseconds since the start.
    At(i64),
    /// It was made this many nanoseconds before it is received.
    Behind(i64),
}

/// `{ topic: /t, stamp: 5.99, fields: { twist.linear.x: 1.5 } }`
#[derive(Debug)]
pub(super) struct RawSample {
    topic: Spanned<String>,
    pub stamp: Option<Spanned<Stamp>>,
    fields: Entries<Spanned<Value>>,
}

impl FromNode for RawSample {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a sample", log)?;
        let topic = fields.required("topic");
        let nanos = |seconds: Spanned<f64>| (seconds.value * 1e9).round() as i64;
        let stamp: Option<Spanned<f64>> = fields.optional("stamp");
        let delay: Option<Spanned<f64>> = fields.optional("delay");
        if let (Some(stamp), Some(delay)) = (stamp, delay) {
            let problem = Problem::at(delay.span, "a sample has either `stamp` or `delay`");
            fields.log.push(problem.also(stamp.span, "and here").help("remove one of the two"));
        }
        let stamp = stamp.map(|it| Spanned { value: Stamp::At(nanos(it)), span: it.span });
        let delay = delay.map(|it| Spanned { value: Stamp::Behind(nanos(it)), span: it.span });
        let values = fields.or_default("fields");
        fields.finish();
        Some(RawSample { topic: topic?, stamp: stamp.or(delay), fields: values })
    }
}

/// The value of a field as it is written.
#[derive(Debug)]
struct Value(FieldValue);

impl FromNode for Value {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        match &node.kind {
            Kind::Mapping(entries) if entries.iter().any(|(key, _)| key.text == "unreadable") => {
                let mut fields = Fields::of(node, "a value that cannot be read", log)?;
                let why: Option<String> = fields.required("unreadable");
                fields.finish();
                why.map(|why| Value(FieldValue::Unreadable(why.into())))
            }
            Kind::Mapping(_) => pose(node, log).map(|pose| Value(FieldValue::Pose(pose))),
            Kind::Scalar { plain, .. } => {
                let text = String::from_node(node, log)?;
                Some(Value(match text.as_str() {
                    "true" if *plain => FieldValue::Bool(true),
                    "false" if *plain => FieldValue::Bool(false),
                    ".nan" if *plain => FieldValue::Number(f64::NAN),
                    ".inf" if *plain => FieldValue::Number(f64::INFINITY),
                    _ => match text.parse::<f64>() {
                        Ok(number) if *plain && number.is_finite() => FieldValue::Number(number),
                        _ => FieldValue::Text(text.into()),
                    },
                }))
            }
            Kind::Sequence(_) => {
                log.push(
                    Problem::at(node.span, "a field has one value").help("name the element in the path"),
                );
                None
            }
        }
    }
}

/// Metres, with an angle about the vertical axis or a whole quaternion.
fn pose(node: &Node, log: &mut Log) -> Option<Pose> {
    let mut fields = Fields::of(node, "a pose of a sample", log)?;
    let mut number = |key| fields.optional::<f64>(key);
    let [x, y, z] = ["x", "y", "z"].map(|key| number(key).unwrap_or_default());
    let yaw = number("yaw_deg");
    let quaternion = ["qx", "qy", "qz", "qw"].map(number);
    if yaw.is_some() && quaternion.iter().any(Option::is_some) {
        let problem = Problem::at(node.span, "a rotation is either `yaw_deg` or a quaternion");
        fields.log.push(problem.help("remove one of the two"));
    }
    fields.finish();
    let half = yaw.unwrap_or_default().to_radians() / 2.0;
    let [qx, qy, qz, qw] = match quaternion {
        [None, None, None, None] => [0.0, 0.0, half.sin(), half.cos()],
        some => some.map(Option::unwrap_or_default),
    };
    Some(Pose { x_m: x, y_m: y, z_m: z, qx, qy, qz, qw })
}

/// `{ topic: /t, count: 0, type: std_msgs/msg/String }`: who publishes a topic.
#[derive(Debug)]
pub(super) struct RawPublishers {
    topic: Spanned<String>,
    count: u32,
    other_type: Option<String>,
}

impl FromNode for RawPublishers {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "the publishers of a topic", log)?;
        let (topic, count) = (fields.required("topic"), fields.or_default::<u64>("count"));
        let other_type = fields.optional("type");
        fields.finish();
        Some(RawPublishers { topic: topic?, count: u32::try_from(count).unwrap_or(u32::MAX), other_type })
    }
}

/// `{ node: /planner, answered: false }`: how a probe ended.
#[derive(Debug)]
pub(super) struct RawProbe {
    target: Spanned<ProbeTarget>,
    outcome: ProbeOutcome,
}

impl FromNode for RawProbe {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a probe", log)?;
        let mut text = |key| fields.optional::<Spanned<String>>(key);
        let (icmp, tcp, ros) = (text("icmp"), text("tcp"), text("node"));
        let boxed = |it: &Spanned<String>| it.value.as_str().into();
        let targets = [
            icmp.map(|it| (ProbeTarget::Icmp { host: boxed(&it) }, it.span)),
            tcp.map(|it| (ProbeTarget::Tcp { address: boxed(&it) }, it.span)),
            ros.map(|it| (ProbeTarget::Node { name: boxed(&it) }, it.span)),
        ];
        let mut targets = targets.into_iter().flatten();
        let (target, more) = (targets.next(), targets.next());
        if target.is_none() || more.is_some() {
            let problem = Problem::at(node.span, "a probe asks one of `icmp`, `tcp`, `node`");
            fields.log.push(problem.help("for example `probe: { node: /planner, answered: false }`"));
        }
        let answered: Option<bool> = fields.optional("answered");
        let impossible: Option<String> = fields.optional("impossible");
        let outcome = match (answered, impossible) {
            (None, Some(why)) => Some(ProbeOutcome::Impossible(why.into())),
            (Some(true), None) => Some(ProbeOutcome::Answered { after: time::Span::from_millis(1) }),
            (Some(false), None) => Some(ProbeOutcome::Missed("no answer".into())),
            _ => {
                let problem = Problem::at(node.span, "a probe needs either `answered` or `impossible`");
                fields
                    .log
                    .push(problem.help("write `answered: true`, `answered: false` or `impossible: WHY`"));
                None
            }
        };
        fields.finish();
        let (target, span) = target?;
        Some(RawProbe { target: Spanned { value: target, span }, outcome: outcome? })
    }
}

/// A sample without its times, which are those of the step.
pub(super) fn sample(raw: &RawSample, model: &Model, log: &mut Log) -> Option<Input> {
    let source = topic(&raw.topic, model, log)?;
    let absent = || FieldValue::Unreadable("the scenario says nothing of it".into());
    let mut values: Box<[FieldValue]> = source.fields.iter().map(|_| absent()).collect();
    for (key, Spanned { value: Value(value), span }) in &raw.fields.0 {
        let mut found = false;
        for (field, place) in
            source.fields.iter().zip(&mut values).filter(|(field, _)| *field.path == *key.text)
        {
            let fits = match value {
                FieldValue::Unreadable(_) => true,
                value => (field.kind == FieldKind::Pose) == matches!(value, FieldValue::Pose(_)),
            };
            if !fits {
                let pose = field.kind == FieldKind::Pose;
                let what = if pose { "a pose, not one value" } else { "one value, not a pose" };
                let problem = Problem::at(*span, format!("`{}` is read as {what}", key.text));
                log.push(problem.help("for example `{ x: 1, y: 2, yaw_deg: 90 }` or `1.5`"));
            }
            found = true;
            *place = value.clone();
        }
        if !found {
            let known = source.fields.iter().map(|field| &*field.path);
            let text = format!("no monitor reads `{}` of {}", key.text, source.topic);
            let help = suggest(&key.text, known.clone()).map_or_else(
                || format!("these are read: {}", known.collect::<Vec<_>>().join(", ")),
                did_you_mean,
            );
            log.push(Problem::at(key.span, text).help(help));
        }
    }
    if let Some(stamp) = raw.stamp.as_ref().filter(|_| !source.stamp) {
        let problem = Problem::at(stamp.span, format!("no monitor reads the stamp of {}", source.topic));
        log.push(problem.help("remove it, or add a latency monitor"));
    }
    let source = source.clone();
    Some(Input::Sample(Sample { source, stamp_ns: None, received_wall_ns: 0, late: false, values }))
}

pub(super) fn publishers(raw: &RawPublishers, model: &Model, log: &mut Log) -> Option<Input> {
    let source = topic(&raw.topic, model, log)?.clone();
    let other_type = raw.other_type.as_deref().map(Into::into);
    Some(Input::Topic(TopicNews { source, publishers: raw.count, other_type }))
}

/// One for each watchdog that asks so.
pub(super) fn probes(raw: &RawProbe, model: &Model, log: &mut Log) -> Vec<Input> {
    let watchdogs = model.watched.watchdogs.iter().filter(|watchdog| watchdog.target == raw.target.value);
    let inputs: Vec<Input> = watchdogs
        .map(|source| Input::Probe(Probe { source: source.clone(), outcome: raw.outcome.clone() }))
        .collect();
    if inputs.is_empty() {
        let known = model.watched.watchdogs.iter().map(|watchdog| asked(&watchdog.target));
        let (text, name) = ("the configuration has no such watchdog", asked(&raw.target.value));
        let help = suggest(name, known).map_or("add a monitor of the kind `watchdog`".into(), did_you_mean);
        log.push(Problem::at(raw.target.span, text).help(help));
    }
    inputs
}

fn asked(target: &ProbeTarget) -> &str {
    match target {
        ProbeTarget::Icmp { host } => host,
        ProbeTarget::Tcp { address } => address,
        ProbeTarget::Node { name } => name,
    }
}

fn topic<'m>(name: &Spanned<String>, model: &'m Model, log: &mut Log) -> Option<&'m Arc<TopicSpec>> {
    let found = model.watched.topics.iter().find(|topic| *topic.topic == *name.value);
    if found.is_none() {
        let known = model.watched.topics.iter().map(|topic| &*topic.topic);
        let problem = Problem::at(name.span, format!("no monitor watches the topic `{}`", name.value));
        let help = suggest(&name.value, known).map_or("add a monitor that does".into(), did_you_mean);
        log.push(problem.help(help));
    }
    found
}
