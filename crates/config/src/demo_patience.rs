//! The demo's patience: a busy computer lets messages wait, which is no fault of the simulated machine.

use std::sync::Arc;

use super::Loaded;
use telltale_engine::model::monitors::MonitorSpec;
use telltale_engine::model::{Model, ModuleMonitor, Parts};
use telltale_engine::time::Span;

/// A fault must last this much longer than on a vehicle before it counts. Causes and symptoms come later
/// alike, so their order stays.
pub const PATIENCE: Span = Span::from_millis(1500);

/// Rates are counted over at least this time. The first window of a monitor counts at once, also if messages waited for
/// nearly half of it.
const WINDOW: Span = Span::from_secs(2);

/// A message may take this much longer. It is a part of the patience: a late message is no silence, so its
/// lateness may last.
const LATER: Span = Span::from_millis(1000);

/// The same vehicle with more time for messages: dependencies, conditions and all other limits stay.
pub fn patient(mut loaded: Loaded) -> Loaded {
    let mut parts = Parts::clone(&loaded.model);
    for module in &mut parts.modules {
        let wait = match &mut module.monitor {
            ModuleMonitor::Other(spec) => relaxed(spec),
            ModuleMonitor::SelfState(_) => PATIENCE,
        };
        module.policy.raise_after = longer(module.policy.raise_after, wait);
    }
    for signal in &mut parts.signals {
        signal.timeout = signal.timeout.map(|timeout| longer(timeout, PATIENCE));
        signal.present_for = signal.present_for.map(|span| longer(span, PATIENCE));
    }
    if let Some(speed) = &mut parts.driving.speed {
        speed.timeout = longer(speed.timeout, PATIENCE);
    }
    if let Some(position) = &mut parts.driving.position {
        position.timeout = longer(position.timeout, PATIENCE);
    }
    for rule in &mut parts.driving.countermeasures {
        if let Some(confirmation) = &mut rule.confirmation {
            confirmation.within = longer(confirmation.within, PATIENCE);
        }
    }
    loaded.model = Arc::new(Model::new(parts).expect("the dependencies are those of a model"));
    loaded
}

/// Gives a monitor more time itself, where it can have it. Returns how long its fault must last then.
fn relaxed(spec: &mut MonitorSpec) -> Span {
    let taken = match spec {
        // Limits are about half of the rate, so a wider window notices a silence later by about 0.6 of what it
        // is wider.
        MonitorSpec::Frequency { window, .. } => {
            let wider = WINDOW.as_nanos().saturating_sub(window.as_nanos());
            *window = longer(*window, Span::from_nanos(wider));
            wider / 5 * 3
        }
        MonitorSpec::Latency { bands, .. } => {
            for limit in [&mut bands.warning_above, &mut bands.error_above].into_iter().flatten() {
                *limit += LATER.as_secs_f64();
            }
            LATER.as_nanos()
        }
        MonitorSpec::External { .. }
        | MonitorSpec::Value { .. }
        | MonitorSpec::Frozen { .. }
        | MonitorSpec::Tf { .. }
        | MonitorSpec::Watchdog { .. }
        | MonitorSpec::System { .. }
        | MonitorSpec::RateRatio { .. }
        | MonitorSpec::Sequence { .. }
        | MonitorSpec::Agreement { .. }
        | MonitorSpec::Constant { .. }
        | MonitorSpec::Count { .. }
        | MonitorSpec::Expression { .. } => 0,
    };
    Span::from_nanos(PATIENCE.as_nanos().saturating_sub(taken))
}

fn longer(span: Span, by: Span) -> Span {
    Span::from_nanos(span.as_nanos() + by.as_nanos())
}
