//! Finds windows of rates that are too short for their limits: the count of so few messages changes with each of them, so
//! a topic on the right side of its limit raises alarms.

use super::{Finding, FindingKind};
use crate::file::monitors::WINDOW_MAX;
use telltale_engine::model::monitors::{Bands, MonitorSpec};
use telltale_engine::model::{Model, ModuleId, NodeId};
use telltale_engine::time::Span;

/// Messages that a window holds at its limit.
const MESSAGES_MIN: f64 = 2.0;

pub(super) fn look(model: &Model) -> Vec<Finding> {
    let found = model.modules.iter().zip((0..).map(ModuleId)).filter_map(|(module, id)| {
        let Some(MonitorSpec::Frequency { window, bands, .. }) = module.monitor.other() else { return None };
        let limit = hardest(bands).filter(|limit| is_unsafe(*limit, *window))?;
        let least = rounded_up(MESSAGES_MIN / limit);
        let what = FindingKind::ShortWindow { window: *window, limit, least };
        Some(Finding { node: NodeId::Module(id), what, example: None }).filter(|_| least <= WINDOW_MAX)
    });
    found.collect()
}

/// The limit that is nearest to the rates that are right.
fn hardest(bands: &Bands) -> Option<f64> {
    let below = [bands.warning_below, bands.error_below].into_iter().flatten().reduce(f64::max);
    let above = [bands.warning_above, bands.error_above].into_iter().flatten().reduce(f64::min);
    below.or(above)
}

/// A limit of exactly one message in the window asks for any message at all, and one of zero for none.
fn is_unsafe(limit: f64, window: Span) -> bool {
    let messages = limit * window.as_secs_f64();
    let is_any = (messages - 1.0).abs() < 1e-6;
    messages > 0.0 && messages < MESSAGES_MIN - 1e-6 && !is_any
}

/// A round time, as people write it.
fn rounded_up(seconds: f64) -> Span {
    let millis = seconds * 1000.0 - 1e-6;
    let step = [(100.0, 10.0), (10_000.0, 100.0)].into_iter().find(|(below, _)| millis < *below);
    let step = step.map_or(1000.0, |(_, step)| step);
    Span::from_millis(((millis / step).ceil() * step) as u64)
}
