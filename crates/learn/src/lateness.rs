//! How late a monitor notices, as its configuration bounds it, and what monitors read.

use telltale_engine::model::monitors::{MonitorSpec, TopicId, ValueSource};
use telltale_engine::model::{Model, ModuleMonitor, ModuleSpec};
use telltale_engine::state::State;
use telltale_engine::time::Span;

fn ms(span: Span) -> i64 {
    i64::try_from(span.as_millis()).unwrap_or(i64::MAX / 4)
}

/// The least and the most time from a fault to its notice, if the notice begins with this state.
pub(crate) fn lateness(model: &Model, module: &ModuleSpec, first: State) -> (i64, i64) {
    let policy = &module.policy;
    let (least, most) = match (&module.monitor, first) {
        (ModuleMonitor::Other(spec), _) => of_monitor(model, spec, first, policy.timeout),
        // A component reports its fault at once.
        (ModuleMonitor::SelfState(_), State::Unknown) => of_silence(policy.timeout),
        (ModuleMonitor::SelfState(_), _) => (0, 0),
    };
    let is_stale = first == policy.stale && first != State::Unknown;
    let most = if is_stale { most.max(ms(policy.timeout)) } else { most };
    (least + ms(policy.raise_after), most + ms(policy.raise_after))
}

/// Silence is noticed when it has lasted this long, and begins with the last message. The fault may come up to a period
/// later, which the configuration does not say: at most half of the time that is waited, else it would be noticed for nothing.
fn of_silence(waits: Span) -> (i64, i64) {
    (ms(waits) / 2, ms(waits))
}

/// The most time from a fault to its notice.
pub(crate) fn latest(model: &Model, module: &ModuleSpec) -> i64 {
    let states = [State::Warning, State::Unknown, State::Error];
    states.into_iter().map(|first| lateness(model, module, first).1).max().unwrap_or(0)
}

fn of_monitor(model: &Model, spec: &MonitorSpec, first: State, timeout: Span) -> (i64, i64) {
    let silent = first == State::Unknown;
    match spec {
        MonitorSpec::Watchdog { watchdog, misses, .. } => {
            let every = model.watched.watchdogs.get(watchdog.0 as usize).map_or(0, |it| ms(it.every));
            (every * i64::from(*misses), every * i64::from(misses + 1))
        }
        MonitorSpec::Agreement { max_age, .. }
        | MonitorSpec::Expression { max_age, .. }
        | MonitorSpec::Sequence { max_gap: max_age, .. }
            if silent =>
        {
            of_silence(*max_age)
        }
        _ if silent => of_silence(timeout),
        MonitorSpec::Frequency { window, .. }
        | MonitorSpec::Latency { window, .. }
        | MonitorSpec::RateRatio { window, .. } => (0, ms(*window)),
        MonitorSpec::Agreement { motion_over, .. } => (0, motion_over.map_or(0, ms)),
        MonitorSpec::Frozen { limits, .. } => (0, ms(limits.longest())),
        _ => (0, 0),
    }
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
