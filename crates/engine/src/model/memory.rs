//! How far back a vehicle's diagnosis looks: a recording for another configuration needs as much of the past.

use super::monitors::{ModuleMonitor, MonitorSpec};
use super::{Model, Policy};
use crate::time::Span;

impl Model {
    /// The longest window, timeout or delay by which a state depends on earlier messages.
    pub fn longest_memory(&self) -> Span {
        let policies = self.modules.iter().map(|module| &module.policy);
        let policies = policies.chain([&self.discovered]).map(Policy::memory);
        let monitors = self.modules.iter().map(|module| match &module.monitor {
            ModuleMonitor::SelfState(_) => Span::ZERO,
            ModuleMonitor::Other(spec) => self.memory_of(spec),
        });
        let signals = self.signals.iter().filter_map(|signal| signal.present_for);
        policies.chain(monitors).chain(signals).max().unwrap_or_default()
    }

    fn memory_of(&self, spec: &MonitorSpec) -> Span {
        match spec {
            MonitorSpec::External { .. }
            | MonitorSpec::Value { .. }
            | MonitorSpec::Constant { .. }
            | MonitorSpec::Count { .. } => Span::ZERO,
            MonitorSpec::Frequency { window, .. }
            | MonitorSpec::Latency { window, .. }
            | MonitorSpec::RateRatio { window, .. } => *window,
            MonitorSpec::Watchdog { watchdog, misses, .. } => {
                let every = self.watched.watchdogs[watchdog.0 as usize].every;
                Span::from_nanos(every.as_nanos().saturating_mul(u64::from(*misses)))
            }
            MonitorSpec::System { watchdog, .. } => self.watched.watchdogs[watchdog.0 as usize].every,
            MonitorSpec::Frozen { limits, .. } => limits.longest(),
            MonitorSpec::Sequence { max_gap, .. } => *max_gap,
            MonitorSpec::Agreement { max_age, motion_over, .. } => {
                motion_over.unwrap_or_default().max(*max_age)
            }
            MonitorSpec::Expression { max_age, .. } => *max_age,
        }
    }
}

impl Policy {
    /// Latches and forgetting are states, not windows.
    fn memory(&self) -> Span {
        self.timeout.max(self.raise_after).max(self.clear_after)
    }
}
