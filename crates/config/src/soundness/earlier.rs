//! Finds contextual modules that compare a later stage with an earlier one, but do not depend on the module of the
//! earlier stage. A fault of the earlier stage then shows as a fault of theirs.

use std::collections::BTreeSet;

use super::judge::Judge;
use super::{Finding, FindingKind};
use telltale_engine::model::monitors::{TopicId, ValueSource};
use telltale_engine::model::{Dependency, ModuleId, ModuleSpec, MonitorSpec, NodeId};

pub(super) fn look(judge: &Judge<'_>) -> Vec<Finding> {
    let mut found = Vec::new();
    for (id, module) in (0..).map(ModuleId).zip(&judge.model.modules) {
        let Some(spec) = module.monitor.other() else { continue };
        let node = NodeId::Module(id);
        for source in earlier(spec) {
            let sources: Vec<NodeId> = judges(judge, &source).filter(|&it| it != node).collect();
            let waits = |&it: &NodeId| needs(judge, node, it) || needs(judge, it, node);
            if let Some(&source) = sources.first().filter(|_| !sources.iter().any(waits)) {
                found.push(Finding { node, what: FindingKind::NoEarlier { source }, example: None });
            }
        }
    }
    found
}

/// The parts of a monitor that come from earlier stages.
enum Source<'m> {
    Topic(TopicId),
    Status(&'m str),
}

fn earlier(spec: &MonitorSpec) -> Vec<Source<'_>> {
    fn of(source: &ValueSource) -> Source<'_> {
        match source {
            ValueSource::Field { topic, .. } => Source::Topic(*topic),
            ValueSource::Key { status, .. } => Source::Status(status),
        }
    }
    match spec {
        MonitorSpec::RateRatio { input, .. } => vec![Source::Topic(*input)],
        MonitorSpec::Sequence { earlier, .. } => vec![of(earlier)],
        MonitorSpec::Expression { inputs, class, .. } if class.flow == Some("sequential") => {
            inputs.iter().map(|(_, source)| of(source)).collect()
        }
        MonitorSpec::External { .. }
        | MonitorSpec::Frequency { .. }
        | MonitorSpec::Latency { .. }
        | MonitorSpec::Value { .. }
        | MonitorSpec::Frozen { .. }
        | MonitorSpec::Watchdog { .. }
        | MonitorSpec::System { .. }
        | MonitorSpec::Agreement { .. }
        | MonitorSpec::Constant { .. }
        | MonitorSpec::Count { .. }
        | MonitorSpec::Tf { .. }
        | MonitorSpec::Expression { .. } => Vec::new(),
    }
}

/// The modules that judge a source by itself.
fn judges<'a>(judge: &'a Judge<'_>, source: &'a Source<'_>) -> impl Iterator<Item = NodeId> + 'a {
    let of_source = move |module: &&ModuleSpec| match (source, module.monitor.other()) {
        (Source::Status(name), _) if module.monitor.status().is_some_and(|it| **it == **name) => true,
        (
            Source::Topic(id),
            Some(MonitorSpec::Frequency { topic, .. } | MonitorSpec::Latency { topic, .. }),
        ) => topic == id,
        (
            Source::Topic(id),
            Some(
                MonitorSpec::Value { source: ValueSource::Field { topic, .. }, .. }
                | MonitorSpec::Frozen { source: ValueSource::Field { topic, .. }, .. },
            ),
        ) => topic == id,
        (Source::Status(name), Some(MonitorSpec::Value { source: ValueSource::Key { status, .. }, .. })) => {
            **status == **name
        }
        _ => false,
    };
    let modules = (0..).map(ModuleId).zip(&judge.model.modules);
    modules.filter(move |(_, module)| of_source(module)).map(|(id, _)| NodeId::Module(id))
}

/// Whether a fault of `source` can mask `node`, directly or through other nodes.
fn needs(judge: &Judge<'_>, node: NodeId, source: NodeId) -> bool {
    let (mut seen, mut open) = (BTreeSet::new(), vec![node]);
    while let Some(at) = open.pop() {
        let around = judge.model.around(at).map(NodeId::Group);
        let holders = std::iter::once(at).chain(around);
        for target in holders.flat_map(|it| judge.model.depends_on(it)).flat_map(Dependency::targets) {
            let inside =
                *target == source || judge.model.around(source).any(|group| NodeId::Group(group) == *target);
            if inside {
                return true;
            }
            if seen.insert(*target) {
                open.push(*target);
                open.extend(members(judge, *target));
            }
        }
    }
    false
}

/// Everything inside a group.
fn members(judge: &Judge<'_>, node: NodeId) -> Vec<NodeId> {
    let mut all = vec![node];
    let mut next = 0;
    while let Some(&at) = all.get(next) {
        if let NodeId::Group(id) = at {
            all.extend(&judge.members[id.0 as usize]);
        }
        next += 1;
    }
    all
}
