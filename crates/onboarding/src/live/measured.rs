//! Measurements that differ from what a configuration allows: a robot that changed since the file was written.

use super::Heard;
use telltale_config::describe::words;
use telltale_config::{Loaded, ModelPlace};
use telltale_engine::model::ModuleId;
use telltale_engine::model::monitors::{Bands, MonitorSpec, TopicId};
use telltale_yaml::Problem;

/// Rates and ages for which a module of the file would not be OK.
pub fn beyond(loaded: &Loaded, heard: &Heard) -> Vec<Problem> {
    let model = &loaded.model;
    let messages = |topic: TopicId| {
        let name = &*model.watched.topics[topic.0 as usize].topic;
        Some((name, heard.seen.topics.get(&*format!("/{}", name.trim_start_matches('/')))?))
    };
    let said = |spec: &MonitorSpec| match spec {
        MonitorSpec::Frequency { topic, bands, .. } => {
            let (name, messages) = messages(*topic)?;
            let rate = messages.rhythm.steady(heard.end)?.rate_hz;
            let (state, limit) = state(bands, rate)?;
            Some(format!("{name} came at {rate:.1} Hz, for which this is {state}: the limit is {limit} Hz"))
        }
        MonitorSpec::Latency { topic, bands, .. } => {
            let (name, messages) = messages(*topic)?;
            let age_s = messages.age_ns?.1 as f64 / 1e9;
            let (state, limit) = state(bands, age_s)?;
            Some(format!(
                "{name} came up to {age_s:.2} s old, for which this is {state}: the limit is {limit} s"
            ))
        }
        _ => None,
    };
    let modules = (0..).map(ModuleId).zip(&model.modules);
    let found = modules.filter_map(|(id, module)| {
        let text = said(module.monitor.other()?)?;
        let when = match &module.when {
            Some(when) => format!("it matters only when {}; if it was so, ", words::when(model, when)),
            None => String::new(),
        };
        let help = format!("{when}look whether the robot changed or the limit is right");
        let place = loaded.place(ModelPlace::Module(id))?;
        Some(Problem::at(place, text).label("this module").help(help).as_warning())
    });
    found.collect()
}

/// The state for a value and the limit that it passes, unless it is OK.
fn state(bands: &Bands, value: f64) -> Option<(&'static str, f64)> {
    let below = |limit: Option<f64>| limit.filter(|limit| value < *limit);
    let above = |limit: Option<f64>| limit.filter(|limit| value > *limit);
    let error = below(bands.error_below).or(above(bands.error_above));
    let warning = below(bands.warning_below).or(above(bands.warning_above));
    error.map(|limit| ("ERROR", limit)).or(warning.map(|limit| ("WARNING", limit)))
}
