//! Describes monitors.

use std::fmt::Write as _;

use super::span;
use telltale_engine::model::monitors::{
    AgreementRule, Bands, Class, Condition, FieldKind, FrozenLimits, ProbeTarget, ProcessMeasure, Resource,
    TF, TfLink, TopicId, ValueRule, ValueSource,
};
use telltale_engine::model::sample::FieldValue;
use telltale_engine::model::{Model, ModuleMonitor, MonitorSpec};

/// `status 'imu: status'`, `the rate of /points (sensor_msgs/msg/PointCloud2) over 2s: error below 5 Hz`
pub fn monitor(model: &Model, monitor: &ModuleMonitor) -> String {
    match monitor {
        ModuleMonitor::SelfState(status) => format!("status '{status}'"),
        ModuleMonitor::Other(spec) => other(model, spec),
    }
}

fn other(model: &Model, spec: &MonitorSpec) -> String {
    match spec {
        MonitorSpec::External { status, class } => {
            format!("external status '{status}', {}", self::class(*class))
        }
        MonitorSpec::Frequency { topic, window, bands } => {
            let of = self::topic(model, *topic);
            format!("the rate of {of} over {}: {}", span(*window), limits(bands, " Hz"))
        }
        MonitorSpec::Latency { topic, window, bands } => {
            let of = self::topic(model, *topic);
            format!("the latency of {of} over {}: {}", span(*window), limits(bands, " s"))
        }
        MonitorSpec::Value { source, rule, empty } => {
            let empty = empty.map(|it| format!(", {it} before the first message")).unwrap_or_default();
            format!("{}: {}{empty}", value(model, source), self::rule(rule))
        }
        MonitorSpec::Frozen { source, limits: FrozenLimits { time, repeats } } => {
            let parts =
                [("the same for a time", time, " s"), ("the same again and again", repeats, " repetitions")];
            format!("{}: {}", value(model, source), self::parts(parts))
        }
        MonitorSpec::Watchdog { watchdog, misses, bands } => {
            let spec = &model.watched.watchdogs[watchdog.0 as usize];
            let mut text =
                format!("{} every {}: error after {misses} misses", target(&spec.target), span(spec.every));
            if *bands != Bands::default() {
                let unit = if matches!(spec.target, ProbeTarget::Node { .. }) { " restarts" } else { " s" };
                let _ = write!(text, ", {}", limits(bands, unit));
            }
            text
        }
        MonitorSpec::System { watchdog, bands } => {
            let spec = &model.watched.watchdogs[watchdog.0 as usize];
            let ProbeTarget::System(resource) = &spec.target else { return target(&spec.target) };
            let judged = match resource {
                Resource::Process { measure: None, .. } => "error if there is none".to_owned(),
                Resource::Process { .. } => {
                    format!("error if there is none, {}", limits(bands, unit(resource)))
                }
                _ => limits(bands, unit(resource)),
            };
            format!("{} every {}: {judged}", target(&spec.target), span(spec.every))
        }
        MonitorSpec::RateRatio { input, output, window, bands } => {
            let (input, output) = (topic(model, *input), topic(model, *output));
            format!("the rate of {output} by that of {input} over {}: {}", span(*window), limits(bands, ""))
        }
        MonitorSpec::Sequence { earlier, later, max_gap, bands } => {
            let (earlier, later) = (value(model, earlier), value(model, later));
            format!("{later} minus {earlier} within {}: {}", span(*max_gap), limits(bands, ""))
        }
        MonitorSpec::Agreement { a, b, max_age, motion_over, rule } => {
            let of = motion_over.map_or(String::new(), |over| format!("the motion over {} of ", span(over)));
            let (a, b) = (value(model, a), value(model, b));
            format!("{of}{a} against {b}, not older than {}: {}", span(*max_age), agreement(rule))
        }
        MonitorSpec::Constant { state } => format!("always {state}"),
        MonitorSpec::Count { wanted, may_be_empty, grace } => {
            let or = if *may_be_empty { " or none" } else { "" };
            format!(
                "the number of statuses: error unless {wanted}{or}, from {} after the start",
                span(*grace)
            )
        }
        MonitorSpec::Tf { links, bands } => {
            let first = links.iter().map(|link| &*link.parent).take(1);
            let frames: Vec<&str> = first.chain(links.iter().map(|link| &*link.child)).collect();
            let topics = links.first().map(|link| tf_topics(model, link)).unwrap_or_default();
            format!("the transforms {}{topics}: {}", frames.join(" -> "), limits(bands, " s old"))
        }
        MonitorSpec::Expression { inputs, max_age, warning, error, class } => {
            let inputs: Vec<String> =
                inputs.iter().map(|(name, source)| format!("{name} = {}", value(model, source))).collect();
            let conditions = conditions(warning.as_ref(), error.as_ref());
            let (inputs, class) = (inputs.join(", "), self::class(*class));
            format!("{conditions} with {inputs}, not older than {}, {class}", span(*max_age))
        }
    }
}

/// The condition of a signal.
pub(super) fn condition(model: &Model, spec: &MonitorSpec) -> String {
    let MonitorSpec::Expression { inputs, error: Some(when), .. } = spec else { return String::new() };
    let inputs: Vec<String> =
        inputs.iter().map(|(name, source)| format!("{name} = {}", value(model, source))).collect();
    format!("true if `{}` with {}", when.text, inputs.join(", "))
}

fn topic(model: &Model, id: TopicId) -> String {
    let spec = &model.watched.topics[id.0 as usize];
    match &*spec.type_name {
        "" => format!("{} {}", spec.topic, super::type_name("")),
        type_name => format!("{} ({type_name})", spec.topic),
    }
}

/// A field of a watched topic.
pub(super) fn field(model: &Model, id: TopicId, field: u32) -> String {
    let field = &model.watched.topics[id.0 as usize].fields[field as usize];
    let what = match field.kind {
        FieldKind::Scalar | FieldKind::Named => "",
        FieldKind::Content if field.path.is_empty() => {
            return format!("the messages of {}", topic(model, id));
        }
        FieldKind::Content => "all in ",
        FieldKind::Pose => "the pose ",
        FieldKind::Positions => "the positions in ",
        FieldKind::Transforms => "",
        FieldKind::Elements => "each ",
    };
    format!("{what}{} of {}", field.path, topic(model, id))
}

fn value(model: &Model, source: &ValueSource) -> String {
    match source {
        ValueSource::Field { topic, field } => self::field(model, *topic, *field),
        ValueSource::Key { status, key, unit } => {
            let unit = unit.as_ref().map_or(String::new(), |unit| format!(" in {unit}"));
            format!("'{key}'{unit} of the status '{status}'")
        }
    }
}

/// ` of /robot1/tf and /robot1/tf_static`; nothing for those without a namespace.
fn tf_topics(model: &Model, link: &TfLink) -> String {
    let [ValueSource::Field { topic: moving, .. }, ValueSource::Field { topic: fixed, .. }] =
        [&link.moving, &link.fixed]
    else {
        return String::new();
    };
    let [moving, fixed] = [moving, fixed].map(|id| &*model.watched.topics[id.0 as usize].topic);
    if moving == TF { String::new() } else { format!(" of {moving} and {fixed}") }
}

fn target(target: &ProbeTarget) -> String {
    match target {
        ProbeTarget::Icmp { host } => format!("an echo from {host}"),
        ProbeTarget::Tcp { address } => format!("a connection to {address}"),
        ProbeTarget::Node { name } => {
            format!("the node {name} (one that crashed counts as running for some 35 s)")
        }
        ProbeTarget::Service { name } => format!("who serves {name}"),
        ProbeTarget::Lifecycle { name } => format!("whether the lifecycle node {name} is active"),
        ProbeTarget::System(resource) => match resource {
            Resource::Cpu => "what the processor of this computer is busy with".to_owned(),
            Resource::Memory => "the used memory of this computer".to_owned(),
            Resource::Disk { path } => format!("the used space of the disk at {path}"),
            Resource::Temperature { sensor } => format!("the temperature {sensor}"),
            Resource::Process { name, measure } => match measure {
                None => format!("the process {name}"),
                Some(ProcessMeasure::Cpu) => format!("what the process {name} takes of a core"),
                Some(ProcessMeasure::Memory) => format!("the memory of the process {name}"),
            },
        },
        ProbeTarget::Qos { topic } => format!("matching publishers and subscribers of {topic}"),
    }
}

fn unit(resource: &Resource) -> &'static str {
    match resource {
        Resource::Cpu | Resource::Memory | Resource::Disk { .. } => " %",
        Resource::Process { measure: Some(ProcessMeasure::Memory), .. } => " MB",
        Resource::Process { .. } => " % of a core",
        Resource::Temperature { .. } => " °C",
    }
}

fn limits(bands: &Bands, unit: &str) -> String {
    let Bands { warning_below, error_below, warning_above, error_above, unmeasurable } = bands;
    let limits = [
        ("warning below", warning_below),
        ("error below", error_below),
        ("warning above", warning_above),
        ("error above", error_above),
    ];
    let limits = limits.into_iter().filter_map(|(what, limit)| Some(format!("{what} {}{unit}", (*limit)?)));
    let unmeasurable =
        unmeasurable.iter().map(|state| format!("{} if it cannot be measured", state.as_str()));
    limits.chain(unmeasurable).collect::<Vec<_>>().join(", ")
}

fn rule(rule: &ValueRule) -> String {
    match rule {
        ValueRule::Bands(bands) => limits(bands, ""),
        ValueRule::Unless { error, warning } => {
            let unless = [("warning", warning), ("error", error)];
            let unless = unless.into_iter().filter_map(|(what, value)| {
                let value = value.as_ref()?;
                Some(format!("{what} unless {}", literal(value)))
            });
            unless.collect::<Vec<_>>().join(", ")
        }
    }
}

fn literal(value: &FieldValue) -> String {
    match value {
        FieldValue::Number(number) => number.to_string(),
        FieldValue::Bool(value) => value.to_string(),
        FieldValue::Text(text) => format!("'{text}'"),
        // No configuration can contain these.
        FieldValue::Pose(_)
        | FieldValue::Positions(_)
        | FieldValue::Transforms(_)
        | FieldValue::Elements(_)
        | FieldValue::Content(_)
        | FieldValue::Absent
        | FieldValue::Unreadable(_) => String::new(),
    }
}

fn agreement(rule: &AgreementRule) -> String {
    match rule {
        AgreementRule::Number(bands) => limits(bands, ""),
        AgreementRule::Pose { translation, rotation_deg } => {
            parts([("translation", translation, " m"), ("rotation", rotation_deg, "°")])
        }
        AgreementRule::Positions { count, nearest } => {
            parts([("difference in number", count, ""), ("distance to the nearest", nearest, " m")])
        }
    }
}

fn parts(parts: [(&str, &Bands, &str); 2]) -> String {
    let parts = parts.into_iter().filter(|(_, bands, _)| **bands != Bands::default());
    parts.map(|(what, bands, unit)| format!("{what} {}", limits(bands, unit))).collect::<Vec<_>>().join("; ")
}

fn conditions(warning: Option<&Condition>, error: Option<&Condition>) -> String {
    let conditions = [("warning", warning), ("error", error)];
    let conditions =
        conditions.into_iter().filter_map(|(what, it)| Some(format!("{what} if `{}`", it?.text)));
    conditions.collect::<Vec<_>>().join(", ")
}

/// `isolated, meta`, `contextual, content, parallel`
fn class(class: Class) -> String {
    let mut text = format!("{}, {}", class.location, class.information);
    if let Some(flow) = class.flow {
        let _ = write!(text, ", {flow}");
    }
    text
}
