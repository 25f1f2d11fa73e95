//! How late a module notices, in milliseconds, and what monitors read.

use telltale_engine::model::monitors::{MonitorSpec, TopicId, ValueSource};
use telltale_engine::model::{Model, ModuleSpec};
use telltale_engine::state::State;
use telltale_engine::time::Span;

fn ms(span: Span) -> i64 {
    i64::try_from(span.as_millis()).unwrap_or(i64::MAX / 4)
}

/// The least and the most time from a fault to its notice, if the notice begins with this state.
pub(crate) fn lateness(model: &Model, module: &ModuleSpec, first: State) -> (i64, i64) {
    let lateness = model.lateness(module, first);
    (ms(lateness.least), ms(lateness.most))
}

/// The most time from a fault to its notice.
pub(crate) fn latest(model: &Model, module: &ModuleSpec) -> i64 {
    let states = [State::Warning, State::Unknown, State::Error];
    states.into_iter().map(|first| lateness(model, module, first).1).max().unwrap_or(0)
}

/// The topics that a module reads.
fn topics(module: &ModuleSpec) -> Vec<TopicId> {
    let Some(spec) = module.monitor.other() else { return Vec::new() };
    let (sources, mut topics): (Vec<&ValueSource>, Vec<TopicId>) = match spec {
        MonitorSpec::Frequency { topic, .. } | MonitorSpec::Latency { topic, .. } => (vec![], vec![*topic]),
        MonitorSpec::RateRatio { input, output, .. } => (vec![], vec![*input, *output]),
        MonitorSpec::Value { source, .. } | MonitorSpec::Frozen { source, .. } => (vec![source], vec![]),
        MonitorSpec::Sequence { earlier, later, .. } => (vec![earlier, later], vec![]),
        MonitorSpec::Agreement { a, b, .. } => (vec![a, b], vec![]),
        MonitorSpec::Expression { inputs, .. } => (inputs.iter().map(|(_, source)| source).collect(), vec![]),
        _ => (vec![], vec![]),
    };
    topics.extend(sources.into_iter().filter_map(|source| match source {
        ValueSource::Field { topic, .. } => Some(*topic),
        ValueSource::Key { .. } => None,
    }));
    topics
}

/// Whether `one` only counts the messages of a topic, and `other` reads their content.
pub(crate) fn feeds(one: &ModuleSpec, other: &ModuleSpec) -> bool {
    let rate = |module: &ModuleSpec| match module.monitor.other() {
        Some(MonitorSpec::Frequency { topic, .. }) => Some(*topic),
        _ => None,
    };
    rate(one).is_some_and(|topic| rate(other).is_none() && topics(other).contains(&topic))
}
