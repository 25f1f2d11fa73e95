//! Finds dependencies by which a mere silence hides an ERROR: UNKNOWN masks, and silence is UNKNOWN.

use super::judge::Judge;
use super::{Finding, FindingKind};
use telltale_engine::model::monitors::{Bands, ValueRule};
use telltale_engine::model::{ModuleId, ModuleMonitor, MonitorSpec, NodeId};
use telltale_engine::state::State;

pub(super) fn look(judge: &Judge<'_>) -> Vec<Finding> {
    let mut found = Vec::new();
    for node in judge.model.nodes() {
        for (index, dependency) in judge.model.depends_on(node).iter().enumerate() {
            if !dependency.masks_unknown {
                continue;
            }
            let silent: Option<Vec<NodeId>> = dependency
                .targets()
                .iter()
                .map(|&target| first(judge, target, &is_unknown_by_silence))
                .collect();
            let hidden = first(judge, node, &may_be_in_error);
            if let Some((silent, hidden)) = silent.and_then(|it| it.first().copied()).zip(hidden) {
                let what = FindingKind::SilenceHides { dependency: index, silent, hidden };
                found.push(Finding { node, what, example: None });
            }
        }
    }
    found
}

/// The first module in a node, or the group that statuses join, for which this holds.
fn first(judge: &Judge<'_>, node: NodeId, holds: &impl Fn(&Judge<'_>, NodeId) -> bool) -> Option<NodeId> {
    if holds(judge, node) {
        return Some(node);
    }
    let NodeId::Group(id) = node else { return None };
    judge.members[id.0 as usize].iter().find_map(|&member| first(judge, member, holds))
}

/// A module that the clock judges is never silent.
fn is_unknown_by_silence(judge: &Judge<'_>, node: NodeId) -> bool {
    match node {
        NodeId::Module(ModuleId(index)) => {
            let module = &judge.model.modules[index as usize];
            module.policy.stale == State::Unknown && !module.monitor.by_the_clock()
        }
        NodeId::Group(id) => {
            let filters = &judge.model.groups[id.0 as usize].filters;
            let of_filter = filters.iter().map(|it| it.policy.as_ref().unwrap_or(&judge.model.discovered));
            judge.discovers(id) && of_filter.into_iter().any(|policy| policy.stale == State::Unknown)
        }
    }
}

fn may_be_in_error(judge: &Judge<'_>, node: NodeId) -> bool {
    let can = |bands: &Bands| bands.error_below.is_some() || bands.error_above.is_some();
    let module = match node {
        NodeId::Module(ModuleId(index)) => &judge.model.modules[index as usize],
        NodeId::Group(id) => return judge.discovers(id),
    };
    let by_silence = module.policy.stale == State::Error && !module.monitor.by_the_clock();
    by_silence
        || match &module.monitor {
            ModuleMonitor::SelfState(_) => true,
            ModuleMonitor::Other(spec) => match &**spec {
                MonitorSpec::Frequency { bands, .. }
                | MonitorSpec::Latency { bands, .. }
                | MonitorSpec::RateRatio { bands, .. }
                | MonitorSpec::Sequence { bands, .. }
                | MonitorSpec::Value { rule: ValueRule::Bands(bands), .. } => can(bands),
                // A frame with two parents is always an ERROR.
                MonitorSpec::Tf { .. } => true,
                MonitorSpec::Frozen { limits, .. } => can(&limits.time) || can(&limits.repeats),
                MonitorSpec::Expression { error, .. } => error.is_some(),
                MonitorSpec::Constant { state } => *state == State::Error,
                MonitorSpec::External { .. }
                | MonitorSpec::Value { .. }
                | MonitorSpec::Watchdog { .. }
                | MonitorSpec::System { .. }
                | MonitorSpec::Agreement { .. }
                | MonitorSpec::Count { .. } => true,
            },
        }
}
