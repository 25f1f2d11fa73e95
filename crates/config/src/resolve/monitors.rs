//! Converts monitors from the file into monitors of the model.

use std::collections::{BTreeMap, BTreeSet};

use super::topics::Topics;
use crate::decode::Spanned;
use crate::expression;
use crate::file::monitors::{Expression, Monitor, Source, Topic};
use telltale_engine::model::monitors::{
    FieldKind, FieldSpec, ModuleMonitor, MonitorSpec, ProbeTarget, TF, TF_MESSAGE, TF_STATIC, TfLink,
    ValueSource, WatchdogSpec,
};
use telltale_yaml::{Log, Problem, Span};

/// The monitor of the model; `None` if the log has the reason.
pub(crate) fn resolve(monitor: &Monitor, topics: &mut Topics, log: &mut Log) -> Option<ModuleMonitor> {
    let spec = match monitor {
        Monitor::SelfState { status } => {
            return Some(ModuleMonitor::SelfState(status.as_ref()?.value.as_str().into()));
        }
        Monitor::External { status, class } => {
            MonitorSpec::External { status: status.as_ref()?.value.as_str().into(), class: *class }
        }
        Monitor::Frequency { topic, window, bands } => {
            let topic = topics.watch(topic, false, log);
            MonitorSpec::Frequency { topic, window: *window, bands: *bands }
        }
        Monitor::Latency { topic, window, bands } => {
            let topic = topics.watch(topic, true, log);
            MonitorSpec::Latency { topic, window: *window, bands: *bands }
        }
        Monitor::Value { source: from, rule, empty } => {
            MonitorSpec::Value { source: source(from, topics, log), rule: rule.clone(), empty: *empty }
        }
        Monitor::Frozen { source: from, limits } => {
            MonitorSpec::Frozen { source: source(from, topics, log), limits: *limits }
        }
        Monitor::Watchdog { target, every, misses, bands, place: _ } => {
            let spec = WatchdogSpec { target: target.clone(), every: *every };
            MonitorSpec::Watchdog { watchdog: topics.watchdog(spec), misses: *misses, bands: *bands }
        }
        Monitor::System { resource, every, bands } => {
            let spec = WatchdogSpec { target: ProbeTarget::System(resource.clone()), every: *every };
            MonitorSpec::System { watchdog: topics.watchdog(spec), bands: *bands }
        }
        Monitor::RateRatio { input, output, window, bands } => {
            let (input, output) = (topics.watch(input, false, log), topics.watch(output, false, log));
            MonitorSpec::RateRatio { input, output, window: *window, bands: *bands }
        }
        Monitor::Sequence { earlier, later, max_gap, bands } => {
            let (earlier, later) = (source(earlier, topics, log), source(later, topics, log));
            MonitorSpec::Sequence { earlier, later, max_gap: *max_gap, bands: *bands }
        }
        Monitor::Agreement { a, b, max_age, motion_over, rule } => {
            let span = span_of(b);
            let (a, b) = (source(a, topics, log), source(b, topics, log));
            if a == b {
                let problem = Problem::at(span, "this is the same value as the other");
                log.push(problem.help("name a second, independent source"));
            }
            let (max_age, motion_over, rule) = (*max_age, *motion_over, rule.clone());
            MonitorSpec::Agreement { a, b, max_age, motion_over, rule }
        }
        Monitor::Tf { frames, namespace, bands } => {
            let links =
                frames.windows(2).map(|pair| link(&pair[0], &pair[1], namespace.as_ref(), topics, log));
            MonitorSpec::Tf { links: links.collect(), bands: *bands }
        }
        Monitor::Constant(state) => MonitorSpec::Constant { state: *state },
        Monitor::Expression(expression) => resolve_expression(expression, topics, log)?,
    };
    Some(spec.into())
}

/// A wanted transform, from both topics.
fn link(
    parent: &Spanned<String>,
    child: &Spanned<String>,
    namespace: Option<&Spanned<String>>,
    topics: &mut Topics,
    log: &mut Log,
) -> TfLink {
    let span = child.span;
    let mut of = |topic: &str| {
        let value = format!("{}{topic}", namespace.map_or("", |namespace| &namespace.value));
        let name = Spanned { value, span: namespace.map_or(span, |namespace| namespace.span) };
        let type_name = Some(Spanned { value: TF_MESSAGE.to_owned(), span });
        let field = FieldSpec::transforms_of(&child.value);
        let path = Spanned { value: field.path.into_string(), span };
        let (topic, field) = topics.field(&Topic { name, type_name }, &path, field.kind, log);
        ValueSource::Field { topic, field }
    };
    let (moving, fixed) = (of(TF), of(TF_STATIC));
    TfLink { parent: parent.value.as_str().into(), child: child.value.as_str().into(), moving, fixed }
}

fn span_of(source: &Source) -> Span {
    match source {
        Source::Field { path, .. } => path.span,
        Source::Key { key, .. } => key.span,
    }
}

pub(crate) fn source(source: &Source, topics: &mut Topics, log: &mut Log) -> ValueSource {
    match source {
        Source::Field { topic, path, kind } => {
            let (topic, field) = topics.field(topic, path, *kind, log);
            ValueSource::Field { topic, field }
        }
        Source::Key { status, key, unit } => ValueSource::Key {
            status: status.value.as_str().into(),
            key: key.value.as_str().into(),
            unit: unit.as_ref().map(|unit| unit.value.as_str().into()),
        },
    }
}

/// The inputs of conditions. A list is one input for each member of its elements that the conditions use.
pub(crate) fn inputs(
    raw: &[(Spanned<String>, Source)],
    texts: &[&Spanned<String>],
    topics: &mut Topics,
    log: &mut Log,
) -> Vec<(Box<str>, ValueSource)> {
    let members = expression::members(texts);
    let mut compared: BTreeMap<String, BTreeSet<Box<str>>> = BTreeMap::new();
    for text in texts.iter().filter(|text| text.value.len() <= expression::TEXT_BYTES_MAX) {
        for (input, label) in expression::texts(&text.value) {
            compared.entry(input).or_default().insert(label.into());
        }
    }
    let mut inputs: Vec<(Box<str>, ValueSource)> = Vec::new();
    for (name, from) in raw {
        let of_list = || members.iter().filter(|(list, _)| *list == name.value).map(|(_, member)| &**member);
        match from {
            Source::Field { topic, path, .. } if of_list().next().is_some() => {
                for member in of_list() {
                    let dot = if member.is_empty() { "" } else { "." };
                    let path = Spanned { value: format!("{}[]{dot}{member}", path.value), span: path.span };
                    let (topic, field) = topics.field(topic, &path, FieldKind::Elements, log);
                    let name = expression::column(&name.value, member).into();
                    inputs.push((name, ValueSource::Field { topic, field }));
                }
            }
            Source::Field { topic, path, kind: FieldKind::Scalar } if compared.contains_key(&name.value) => {
                let names = compared[&name.value].clone();
                let (topic, field) = topics.field_with_names(topic, path, FieldKind::Named, names, log);
                inputs.push((name.value.as_str().into(), ValueSource::Field { topic, field }));
            }
            _ => inputs.push((name.value.as_str().into(), source(from, topics, log))),
        }
    }
    inputs
}

fn resolve_expression(raw: &Expression, topics: &mut Topics, log: &mut Log) -> Option<MonitorSpec> {
    for (name, _) in &raw.inputs {
        expression::check_name(name, log);
    }
    let texts: Vec<_> = [&raw.error, &raw.warning].into_iter().flatten().collect();
    let inputs = inputs(&raw.inputs, &texts, topics, log);
    let names: Vec<&str> = inputs.iter().map(|(name, _)| &**name).collect();
    let mut condition = |text: &Option<_>| match text {
        Some(text) => expression::condition(text, &names, log).map(Some),
        None => Some(None),
    };
    let (warning, error) = (condition(&raw.warning), condition(&raw.error));
    if let (Some(Some(a)), Some(Some(b)), Some(text)) = (&warning, &error, &raw.error)
        && let Some(said) = expression::conflict(&names, a, b)
    {
        log.push(Problem::at(text.span, said).help("give each its own input"));
    } else if let (Some(Some(a)), Some(Some(b)), Some(text)) = (&warning, &error, &raw.warning)
        && expression::is_covered(a, b)
    {
        let problem =
            Problem::at(text.span, "wherever this WARNING holds, `error` holds too: it never shows");
        let problem = match &raw.error {
            Some(error) => problem.also(error.span, "the ERROR"),
            None => problem,
        };
        log.push(problem.help("let the WARNING begin before the ERROR does, or remove it"));
    }
    let (max_age, class) = (raw.max_age, raw.class);
    Some(MonitorSpec::Expression { inputs, max_age, warning: warning?, error: error?, class })
}
