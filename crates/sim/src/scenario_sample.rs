//! Samples of topics and results of probes in scenario files: as written, then bound to a model.

use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;

use telltale_config::decode::{Entries, FromNode, Spanned};
use telltale_config::fields::Fields;
use telltale_engine::input::{Input, ListenerReport};
use telltale_engine::model::Model;
use telltale_engine::model::countermeasure::RequestKind;
use telltale_engine::model::monitors::{FieldKind, FieldSpec, ProbeTarget, TopicSpec};
use telltale_engine::model::output::Output;
use telltale_engine::model::sample::{
    ELEMENTS_MAX, Elements, FieldValue, Fingerprint, PARENTS_MAX, POSITIONS_MAX, Pose, Position, Positions,
    Probe, ProbeOutcome, PublisherReport, Sample, Transform,
};
use telltale_engine::time;
use telltale_yaml::decode::{did_you_mean, word};
use telltale_yaml::{Kind, Log, Node, Problem, Span, suggest};

/// The state in which a lifecycle node does its work.
const ACTIVE: &str = "active";

/// The stamp in the header of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stamp {
    /// An instant: nanoseconds since the start.
    At(i64),
    /// The age of the message on arrival, in nanoseconds.
    Behind(i64),
}

/// `{ topic: /t, stamp: 5.99, fields: { twist.linear.x: 1.5 } }`
#[derive(Debug)]
pub(super) struct RawSample {
    topic: Spanned<String>,
    pub stamp: Option<Spanned<Stamp>>,
    fields: Entries<Spanned<Value>>,
    /// The text for the whole message: equal texts are equal messages.
    content: Option<Spanned<String>>,
    transforms: Vec<RawTransform>,
}

/// `{ parent: odom, child: base_link }`: a transform with the stamp of its sample, or of now.
#[derive(Debug)]
struct RawTransform {
    parent: String,
    child: Spanned<String>,
}

impl FromNode for RawTransform {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a transform", log)?;
        let (parent, child) = (fields.required("parent"), fields.required("child"));
        Some(RawTransform { parent: parent?, child: child? })
    }
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
        let content = fields.optional("content");
        let transforms = fields.or_default("transforms");
        Some(RawSample { topic: topic?, stamp: stamp.or(delay), fields: values, content, transforms })
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
            Kind::Sequence(items) if items.iter().any(|item| matches!(item.kind, Kind::Scalar { .. })) => {
                let values: Option<Vec<Value>> =
                    items.iter().map(|item| Value::from_node(item, log)).collect();
                let taken: Box<[FieldValue]> =
                    values?.into_iter().map(|it| it.0).take(ELEMENTS_MAX).collect();
                let count = u32::try_from(items.len()).unwrap_or(u32::MAX);
                Some(Value(FieldValue::Elements(Arc::new(Elements { taken, count }))))
            }
            Kind::Sequence(items) => {
                let positions: Option<Vec<Position>> = items.iter().map(|item| position(item, log)).collect();
                let positions = positions?;
                let count = u32::try_from(positions.len()).unwrap_or(u32::MAX);
                let taken = positions.into_iter().take(POSITIONS_MAX).collect();
                Some(Value(FieldValue::Positions(Arc::new(Positions { taken, count }))))
            }
        }
    }
}

/// `[1.5, 2]`: metres, x and y.
fn position(node: &Node, log: &mut Log) -> Option<Position> {
    if let Kind::Sequence(parts) = &node.kind
        && let [x, y] = &parts[..]
    {
        let (x, y) = (f64::from_node(x, log), f64::from_node(y, log));
        return Some(Position { x_m: x?, y_m: y? });
    }
    let problem = Problem::at(node.span, "a list of a sample holds positions");
    log.push(
        problem.help("write two numbers for each: `[[1.5, 2], [3, 4]]`; or name an element in the path"),
    );
    None
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
    let half = yaw.unwrap_or_default().to_radians() / 2.0;
    let [qx, qy, qz, qw] = match quaternion {
        [None, None, None, None] => [0.0, 0.0, half.sin(), half.cos()],
        some => some.map(Option::unwrap_or_default),
    };
    Some(Pose { x_m: x, y_m: y, z_m: z, qx, qy, qz, qw })
}

/// `{ topic: /t, count: 0, type: std_msgs/msg/String, transient_local: true, best_effort: true }`: the publishers of a topic.
#[derive(Debug)]
pub(super) struct RawPublishers {
    topic: Spanned<String>,
    count: u32,
    other_type: Option<String>,
    transient_local: bool,
    best_effort: bool,
}

impl FromNode for RawPublishers {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "the publishers of a topic", log)?;
        let (topic, count) = (fields.required("topic"), fields.or_default::<u64>("count"));
        let (other_type, transient_local) = (fields.optional("type"), fields.or_default("transient_local"));
        let best_effort = fields.or_default("best_effort");
        let count = u32::try_from(count).unwrap_or(u32::MAX);
        Some(RawPublishers { topic: topic?, count, other_type, transient_local, best_effort })
    }
}

/// `{ request: maneuver_stop, count: 0 }`: the number of programs of the vehicle that subscribe to a
/// request.
#[derive(Debug)]
pub(super) struct RawListeners {
    request: Spanned<RequestKind>,
    count: u64,
}

impl FromNode for RawListeners {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a step of listeners", log)?;
        let kinds = [RequestKind::ManeuverStop, RequestKind::Decelerate].map(|kind| (kind.as_str(), kind));
        let request = fields.node("request").and_then(|node| {
            let value = word(node, fields.log, "request", &kinds)?;
            Some(Spanned { value, span: node.span })
        });
        fields.needs("request", "`request: maneuver_stop`");
        let count: Option<u64> = fields.required("count");
        Some(RawListeners { request: request?, count: count? })
    }
}

/// `{ node: /planner, answered: false }`, `{ icmp: lidar, answered: true, after: 0.02 }`: the result of a
/// probe.
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
        let (service, qos, lifecycle) = (text("service"), text("qos"), text("lifecycle"));
        let boxed = |it: &Spanned<String>| it.value.as_str().into();
        let targets = [
            icmp.map(|it| (ProbeTarget::Icmp { host: boxed(&it) }, it.span)),
            tcp.map(|it| (ProbeTarget::Tcp { address: boxed(&it) }, it.span)),
            ros.map(|it| (ProbeTarget::Node { name: boxed(&it) }, it.span)),
            service.map(|it| (ProbeTarget::Service { name: boxed(&it) }, it.span)),
            lifecycle.map(|it| (ProbeTarget::Lifecycle { name: boxed(&it) }, it.span)),
            qos.map(|it| (ProbeTarget::Qos { topic: boxed(&it) }, it.span)),
            system(&mut fields),
        ];
        let mut targets = targets.into_iter().flatten();
        let (target, more) = (targets.next(), targets.next());
        if target.is_none() || more.is_some() {
            let problem = Problem::at(
                node.span,
                "a probe asks one of `icmp`, `tcp`, `node`, `service`, `lifecycle`, `qos`, `system`",
            );
            fields.log.push(problem.help("for example `probe: { node: /planner, answered: false }`"));
        }
        let answered: Option<bool> = fields.optional("answered");
        let after: Option<Spanned<f64>> = fields.optional("after");
        let discovered = matches!(target, Some((ProbeTarget::Node { .. } | ProbeTarget::Service { .. }, _)));
        if let Some(after) = after.filter(|_| discovered || answered != Some(true)) {
            let problem =
                Problem::at(after.span, "only an answer of `icmp`, `tcp` or `lifecycle` takes a time");
            fields.log.push(problem.help("remove `after`, or write `answered: true` beside one of these"));
        }
        let times: Option<Spanned<u64>> = fields.optional("times");
        let is_node = matches!(target, Some((ProbeTarget::Node { .. }, _)));
        if let Some(times) = times.as_ref().filter(|it| !is_node || answered != Some(true) || it.value < 1) {
            let problem =
                Problem::at(times.span, "only a `node` that is there is announced one or more times");
            fields.log.push(problem.help("write `probe: { node: /planner, answered: true, times: 3 }`"));
        }
        let state: Option<Spanned<String>> = fields.optional("state");
        let is_lifecycle = matches!(target, Some((ProbeTarget::Lifecycle { .. }, _)));
        if let Some(state) = state.as_ref().filter(|_| !is_lifecycle || answered != Some(true)) {
            let problem = Problem::at(state.span, "only a `lifecycle` node that answers says its state");
            fields.log.push(
                problem.help("write `probe: { lifecycle: /planner, answered: true, state: inactive }`"),
            );
        }
        let impossible: Option<String> = fields.optional("impossible");
        let measured: Option<f64> = fields.optional("measured");
        let is_system = matches!(target, Some((ProbeTarget::System(_), _)));
        let outcome = match (answered, impossible) {
            (None, None) if is_system && measured.is_some() => measured.map(ProbeOutcome::Measured),
            (None, Some(why)) => Some(ProbeOutcome::Impossible(why.into())),
            (Some(true), None) if is_system => Some(ProbeOutcome::Announced),
            (Some(true), None) if discovered => Some(match times {
                Some(times) if times.value > 1 => {
                    ProbeOutcome::Repeated { times: u32::try_from(times.value).unwrap_or(u32::MAX) }
                }
                _ => ProbeOutcome::Announced,
            }),
            (Some(true), None) if state.as_ref().is_some_and(|it| it.value != ACTIVE) => {
                state.map(|it| ProbeOutcome::Inactive { state: it.value.into() })
            }
            (Some(true), None) => {
                let seconds = after.map_or(0.001, |after| after.value);
                Some(ProbeOutcome::Answered { after: time::Span::from_nanos((seconds * 1e9).round() as u64) })
            }
            (Some(false), None) => Some(ProbeOutcome::Missed("no answer".into())),
            _ => {
                let problem = Problem::at(node.span, "a probe needs either `answered` or `impossible`");
                fields.log.push(problem.help(
                    "write `answered: true`, `answered: false` or `impossible: WHY`; `measured: 70` beside `system`",
                ));
                None
            }
        };
        let (target, span) = target?;
        Some(RawProbe { target: Spanned { value: target, span }, outcome: outcome? })
    }
}

/// `system: { cpu: used }`: what is measured of the computer.
fn system(fields: &mut Fields) -> Option<(ProbeTarget, Span)> {
    let node = fields.node("system")?;
    let mut inner = Fields::of(node, "what is measured", fields.log)?;
    let found = telltale_config::resource(&mut inner);
    found.map(|it| (ProbeTarget::System(it.value), it.span))
}

/// A sample without its times, which come from the step.
pub(super) fn sample(raw: &RawSample, model: &Model, log: &mut Log) -> Option<Input> {
    let source = topic(&raw.topic, model, log)?;
    let absent = |field: &FieldSpec| match field.kind {
        FieldKind::Transforms => transforms(&raw.transforms, field),
        _ => FieldValue::Unreadable("the scenario says nothing of it".into()),
    };
    let mut values: Box<[FieldValue]> = source.fields.iter().map(absent).collect();
    for RawTransform { child, .. } in &raw.transforms {
        if !source.fields.contains(&FieldSpec::transforms_of(&child.value)) {
            let text = format!("no monitor reads the transforms of `{}` on {}", child.value, source.topic);
            log.push(Problem::at(child.span, text).help("remove it, or name the frame in a `tf` monitor"));
        }
    }
    for (key, Spanned { value: Value(value), span }) in &raw.fields.0 {
        let mut found = false;
        for (field, place) in
            source.fields.iter().zip(&mut values).filter(|(field, _)| *field.path == *key.text)
        {
            let fits = match value {
                FieldValue::Unreadable(_) => true,
                FieldValue::Pose(_) => field.kind == FieldKind::Pose,
                FieldValue::Positions(list) if list.count == 0 && field.kind == FieldKind::Elements => true,
                FieldValue::Positions(_) => field.kind == FieldKind::Positions,
                FieldValue::Elements(_) => field.kind == FieldKind::Elements,
                _ => matches!(field.kind, FieldKind::Scalar | FieldKind::Named),
            } || field.kind == FieldKind::Content;
            let value = match field.kind {
                FieldKind::Content if !matches!(value, FieldValue::Unreadable(_)) => &fingerprint(value),
                FieldKind::Elements if matches!(value, FieldValue::Positions(_)) => &no_elements(),
                _ => value,
            };
            if !fits {
                let (what, example) = match field.kind {
                    FieldKind::Scalar | FieldKind::Named | FieldKind::Content => ("one value", "1.5"),
                    FieldKind::Pose => ("a pose", "{ x: 1, y: 2, yaw_deg: 90 }"),
                    FieldKind::Positions => ("a list of positions", "[[1.5, 2], [3, 4]]"),
                    FieldKind::Elements => ("a list of values", "[2, 6]"),
                    FieldKind::Transforms => {
                        ("transforms", "transforms: [{ parent: odom, child: base_link }]")
                    }
                };
                let problem = Problem::at(*span, format!("`{}` is read as {what}", key.text));
                log.push(problem.help(format!("for example `{example}`")));
            }
            found = true;
            *place = value.clone();
        }
        if !found {
            let known = source.fields.iter().map(|field| &*field.path);
            let text = format!("nothing reads `{}` of {}", key.text, source.topic);
            let help = suggest(&key.text, known.clone()).map_or_else(|| are_read(source), did_you_mean);
            log.push(Problem::at(key.span, text).help(help));
        }
    }
    if let Some(content) = &raw.content {
        let fields = source.fields.iter().zip(&mut values);
        let whole = |field: &FieldSpec| field.kind == FieldKind::Content && field.path.is_empty();
        match fields.into_iter().find(|(field, _)| whole(field)) {
            Some((_, place)) => *place = fingerprint(&FieldValue::Text(content.value.as_str().into())),
            None => {
                let text = format!("nothing compares whole messages of {}", source.topic);
                let problem = Problem::at(content.span, text);
                log.push(problem.help("remove it, or add a `frozen` monitor without `field`"));
            }
        }
    }
    if let Some(stamp) = raw.stamp.as_ref().filter(|_| !source.stamp && raw.transforms.is_empty()) {
        let problem = Problem::at(stamp.span, format!("no monitor reads the stamp of {}", source.topic));
        log.push(problem.help("remove it, or add a latency monitor"));
    }
    let source = source.clone();
    Some(Input::Sample(Sample::of(source, values)))
}

/// Those of one frame. Their stamps come with the step.
fn transforms(all: &[RawTransform], field: &FieldSpec) -> FieldValue {
    let mut found: Vec<Transform> = Vec::new();
    for RawTransform { parent, child } in all {
        let is_new = found.len() < PARENTS_MAX && found.iter().all(|known| *known.parent != **parent);
        if is_new && FieldSpec::transforms_of(&child.value) == *field {
            found.push(Transform { parent: parent.as_str().into(), stamp_ns: None });
        }
    }
    if found.is_empty() { FieldValue::Absent } else { FieldValue::Transforms(found.into()) }
}

/// `[]` may be a list of anything.
fn no_elements() -> FieldValue {
    FieldValue::Elements(Arc::default())
}

/// Stands for content that is written like this.
fn fingerprint(value: &FieldValue) -> FieldValue {
    let mut hash = DefaultHasher::new();
    format!("{value:?}").hash(&mut hash);
    FieldValue::Content(Fingerprint(hash.finish()))
}

fn are_read(source: &TopicSpec) -> String {
    let known: Vec<&str> = source.fields.iter().map(|field| &*field.path).collect();
    match known[..] {
        [] => "its messages are only counted or timed: remove it from `fields`".to_owned(),
        _ => format!("these are read: {}", known.join(", ")),
    }
}

pub(super) fn publishers(raw: &RawPublishers, model: &Model, log: &mut Log) -> Option<Input> {
    let source = topic(&raw.topic, model, log)?.clone();
    let other_type = raw.other_type.as_deref().map(Into::into);
    let (publishers, transient_local, best_effort) = (raw.count, raw.transient_local, raw.best_effort);
    Some(Input::Topic(PublisherReport {
        source,
        publishers,
        other_type,
        transient_local,
        best_effort,
        anew: false,
    }))
}

/// One for each watchdog with this target.
pub(super) fn probes(raw: &RawProbe, model: &Model, log: &mut Log) -> Vec<Input> {
    let watchdogs = model.watched.watchdogs.iter().filter(|watchdog| watchdog.target == raw.target.value);
    let inputs: Vec<Input> = watchdogs
        .map(|source| Input::Probe(Probe { source: source.clone(), outcome: raw.outcome.clone() }))
        .collect();
    if inputs.is_empty() {
        let known = model.watched.watchdogs.iter().map(|watchdog| watchdog.target.name());
        let (text, name) = ("the configuration has no such watchdog", raw.target.value.name());
        let help = suggest(name, known).map_or("add a monitor of the kind `watchdog`".into(), did_you_mean);
        log.push(Problem::at(raw.target.span, text).help(help));
    }
    inputs
}

fn topic<'m>(name: &Spanned<String>, model: &'m Model, log: &mut Log) -> Option<&'m Arc<TopicSpec>> {
    let found = model.watched.topics.iter().find(|topic| *topic.topic == *name.value);
    if found.is_none() {
        let known = model.watched.topics.iter().map(|topic| &*topic.topic);
        let problem = Problem::at(name.span, format!("nothing watches the topic `{}`", name.value));
        let help = suggest(&name.value, known)
            .map_or("add a monitor that does, a signal with `when`, or `motion`".into(), did_you_mean);
        log.push(problem.help(help));
    }
    found
}

/// A topic that is not published has no listeners.
pub(super) fn listeners(raw: &RawListeners, model: &Model, log: &mut Log) -> Option<Input> {
    let Spanned { value: kind, span } = raw.request;
    let output = kind.output()?;
    if model.driving.unpublished.contains(&output) {
        let problem = Problem::at(span, format!("the configuration does not publish `{}`", kind.as_str()));
        log.push(problem.help("remove the step, or the line of `publish` that switches it off"));
        return None;
    }
    let topic = match output {
        Output::ManeuverStop => "/telltale/maneuver_stop_request",
        _ => "/telltale/deceleration_request",
    };
    Some(Input::Listened(ListenerReport { output, topic: topic.into(), heard: raw.count > 0 }))
}
