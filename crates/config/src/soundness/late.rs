//! Finds modules whose ERROR may come later than a dependency's `within`: their symptoms would count as second faults.

use super::{Finding, FindingKind};
use telltale_engine::model::monitors::ProbeTarget;
use telltale_engine::model::{Model, ModuleId, ModuleSpec, MonitorSpec, NodeId, Within};
use telltale_engine::state::State;
use telltale_engine::time::Span;

/// A ROS 2 node that was killed counts as running for so long: three leases of its participant (10 s each with Cyclone
/// DDS, 20 s with Fast DDS), and up to 4 s until discovery lets go of it.
pub const KILLED_NODE: Span = Span::from_secs(34);

/// One finding for a module: the dependency with the shortest limit.
pub(super) fn look(model: &Model) -> Vec<Finding> {
    let mut found = Vec::new();
    for (id, module) in (0..).map(ModuleId).zip(&model.modules) {
        let after = noticed_after(model, module);
        let near = dependencies(model)
            .filter(|(holder, index)| concerns(model, id, (*holder, *index)))
            .filter_map(|(holder, index)| match model.depends_on(holder)[index].within {
                Within::Limit(limit) if limit < after => Some((limit, holder, index)),
                Within::Limit(_) | Within::Always => None,
            });
        if let Some((limit, holder, dependency)) = near.min_by_key(|(limit, ..)| *limit) {
            let late = NodeId::Module(id);
            let what = FindingKind::LateCause { late, after, limit, dependency };
            found.push(Finding { node: holder, what, example: None });
        }
    }
    found
}

/// The longest time from a fault to the ERROR of this module, as far as the configuration tells.
fn noticed_after(model: &Model, module: &ModuleSpec) -> Span {
    let judged = match module.monitor.other() {
        Some(MonitorSpec::Frequency { window, .. } | MonitorSpec::RateRatio { window, .. }) => *window,
        Some(MonitorSpec::Watchdog { watchdog, misses, .. }) => {
            let spec = &model.watched.watchdogs[watchdog.0 as usize];
            let rounds = Span::from_nanos(spec.every.as_nanos().saturating_mul(u64::from(*misses)));
            match spec.target {
                ProbeTarget::Node { .. } | ProbeTarget::Service { .. } => sum(KILLED_NODE, rounds),
                ProbeTarget::Icmp { .. }
                | ProbeTarget::Lifecycle { .. }
                | ProbeTarget::Tcp { .. }
                | ProbeTarget::Qos { .. }
                | ProbeTarget::System(_) => rounds,
            }
        }
        Some(MonitorSpec::System { watchdog, .. }) => model.watched.watchdogs[watchdog.0 as usize].every,
        Some(MonitorSpec::Frozen { limits, .. }) => limits.longest(),
        Some(MonitorSpec::Tf { bands, .. }) => {
            Span::from_nanos((bands.error_above.or(bands.warning_above).unwrap_or_default() * 1e9) as u64)
        }
        Some(
            MonitorSpec::External { .. }
            | MonitorSpec::Latency { .. }
            | MonitorSpec::Value { .. }
            | MonitorSpec::Sequence { .. }
            | MonitorSpec::Agreement { .. }
            | MonitorSpec::Constant { .. }
            | MonitorSpec::Count { .. }
            | MonitorSpec::Expression { .. },
        )
        | None => Span::ZERO,
    };
    let by_the_clock = module.monitor.by_the_clock();
    let silent = module.policy.stale == State::Error && !by_the_clock;
    let silence = if silent { module.policy.timeout } else { Span::ZERO };
    sum(judged.max(silence), module.policy.raise_after)
}

fn sum(one: Span, other: Span) -> Span {
    Span::from_nanos(one.as_nanos().saturating_add(other.as_nanos()))
}

/// Each dependency by its holder and its index.
pub(super) fn dependencies(model: &Model) -> impl Iterator<Item = (NodeId, usize)> + '_ {
    model.nodes().flat_map(|node| (0..model.depends_on(node).len()).map(move |index| (node, index)))
}

/// Whether a dependency is one of the module itself, or one on it.
fn concerns(model: &Model, id: ModuleId, (holder, index): (NodeId, usize)) -> bool {
    holder == NodeId::Module(id)
        || model.depends_on(holder)[index].targets().iter().any(|&target| is_inside(model, id, target))
}

pub(super) fn is_inside(model: &Model, id: ModuleId, node: NodeId) -> bool {
    match node {
        NodeId::Module(other) => other == id,
        NodeId::Group(group) => model.around(NodeId::Module(id)).any(|it| it == group),
    }
}
