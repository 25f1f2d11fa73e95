//! How late a module notices a fault, as far as its configuration tells: by that, when the fault began.

use super::monitors::{MonitorSpec, ProbeTarget};
use super::{Model, ModuleMonitor, ModuleSpec, Policy};
use crate::state::State;
use crate::time::{Span, Timestamp};
use serde::{Deserialize, Serialize};

/// A ROS 2 node that was killed counts as running for so long: three leases of its participant (10 s each with Cyclone
/// DDS, 20 s with Fast DDS), and up to 4 s until discovery lets go of it.
pub const KILLED_NODE: Span = Span::from_secs(34);

/// How a fault was noticed: the first state, and whether silence was the reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Notice {
    pub state: State,
    pub silent: bool,
}

/// A beginning of a fault: its notice, and the instant that is estimated for the fault itself, if the lateness of the
/// module is known well enough.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Beginning {
    pub noticed: Timestamp,
    pub began: Option<Timestamp>,
}

/// The least and the most time from a fault to its notice.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lateness {
    pub least: Span,
    pub most: Span,
    /// How much longer it may take if a node was killed.
    pub lease: Span,
}

impl Lateness {
    const NONE: Lateness = Lateness { least: Span::ZERO, most: Span::ZERO, lease: Span::ZERO };

    fn up_to(most: Span) -> Lateness {
        Lateness { most, ..Lateness::NONE }
    }

    /// Silence is noticed when it has lasted this long, and begins with the last message. The fault may come up to a period
    /// later, which the configuration does not say: at most half of the time that is waited, else it would be noticed for
    /// nothing.
    fn of_silence(waits: Span) -> Lateness {
        Lateness { least: Span::from_nanos(waits.as_nanos() / 2), most: waits, ..Lateness::NONE }
    }

    /// With the time for which a fault has to last until it counts.
    pub(crate) fn debounced(self, policy: &Policy) -> Lateness {
        let [least, most] = [self.least, self.most].map(|it| sum(it, policy.raise_after));
        Lateness { least, most, ..self }
    }

    /// The latest notice, also of a node that was killed.
    pub fn latest(self) -> Span {
        sum(self.most, self.lease)
    }

    /// The middle: the fault began about so long before it was noticed.
    pub fn about(self) -> Span {
        Span::from_nanos(self.least.as_nanos().midpoint(self.most.as_nanos()))
    }

    /// The middle, if it is known well enough to be compared with this limit: to a quarter of it.
    pub fn known(self, limit: Span) -> Option<Span> {
        let open = self.latest().as_nanos() - self.least.as_nanos();
        (open <= limit.as_nanos() / 2).then(|| self.about())
    }
}

fn sum(one: Span, other: Span) -> Span {
    Span::from_nanos(one.as_nanos().saturating_add(other.as_nanos()))
}

impl Model {
    /// How late a declared module notices a fault with this state first, whether silence is the reason or not.
    pub fn lateness(&self, module: &ModuleSpec, state: State) -> Lateness {
        let of = |silent| {
            let of_monitor =
                self.lateness_of(Some(&module.monitor), &module.policy, Notice { state, silent });
            of_monitor.debounced(&module.policy)
        };
        match state {
            // A component that reports UNKNOWN is rare.
            State::Unknown => of(module.monitor.other().is_none()),
            _ if state == module.policy.stale => {
                let (heard, silent) = (of(false), of(true));
                Lateness { most: heard.most.max(silent.most), ..heard }
            }
            _ => of(false),
        }
    }

    /// How late the monitor of any module notices a fault, without [`Policy::raise_after`]; `None`: a status reports its
    /// state.
    pub fn lateness_of(
        &self,
        monitor: Option<&ModuleMonitor>,
        policy: &Policy,
        Notice { state, silent }: Notice,
    ) -> Lateness {
        let by_the_clock = monitor.is_some_and(ModuleMonitor::by_the_clock);
        match monitor.and_then(ModuleMonitor::other) {
            _ if silent && !by_the_clock && state >= policy.stale => Lateness::of_silence(policy.timeout),
            Some(spec) => self.of_monitor(spec, state, policy.timeout),
            // A component reports its fault at once.
            None => Lateness::NONE,
        }
    }

    fn of_monitor(&self, spec: &MonitorSpec, state: State, timeout: Span) -> Lateness {
        let is_silent = state == State::Unknown;
        match spec {
            MonitorSpec::Watchdog { watchdog, misses, .. } => {
                let spec = &self.watched.watchdogs[watchdog.0 as usize];
                let rounds =
                    |count: u32| Span::from_nanos(spec.every.as_nanos().saturating_mul(u64::from(count)));
                match spec.target {
                    ProbeTarget::Node { .. } | ProbeTarget::Service { .. } => {
                        let (least, most) = (rounds(misses.saturating_sub(1)), rounds(*misses));
                        Lateness { least, most, lease: KILLED_NODE }
                    }
                    // A probe waits one round for its answer.
                    _ => Lateness {
                        least: rounds(*misses),
                        most: rounds(misses.saturating_add(1)),
                        ..Lateness::NONE
                    },
                }
            }
            MonitorSpec::System { watchdog, .. } => {
                Lateness::up_to(self.watched.watchdogs[watchdog.0 as usize].every)
            }
            MonitorSpec::Agreement { max_age, .. }
            | MonitorSpec::Expression { max_age, .. }
            | MonitorSpec::Sequence { max_gap: max_age, .. }
                if is_silent =>
            {
                Lateness::of_silence(*max_age)
            }
            _ if is_silent => Lateness::of_silence(timeout),
            MonitorSpec::Frequency { window, .. } | MonitorSpec::RateRatio { window, .. } => {
                Lateness::up_to(*window)
            }
            MonitorSpec::Agreement { motion_over, .. } => Lateness::up_to(motion_over.unwrap_or_default()),
            MonitorSpec::Frozen { limits, .. } => Lateness::up_to(limits.longest()),
            MonitorSpec::Tf { bands, .. } => {
                let limit = bands.error_above.or(bands.warning_above).unwrap_or_default();
                Lateness::up_to(Span::from_nanos((limit * 1e9) as u64))
            }
            _ => Lateness::NONE,
        }
    }
}
