//! How a `frozen` monitor is written: its source, and for how long and how often the value may stay the same.

use super::Monitor;
use super::bands;
use super::sources::Source;
use crate::fields::Fields;
use telltale_engine::model::monitors::{Bands, FrozenLimits};
use telltale_yaml::schema::{least, most, needs_any};
use telltale_yaml::{Log, Members, Node, Problem, map};

const REPEATS_MAX: u64 = 1_000_000;
const LIMITS: [&str; 4] = ["warning_above", "error_above", "repeats_warning_above", "repeats_error_above"];

fn bounds() -> Members {
    vec![least(0), most(REPEATS_MAX)]
}

pub(crate) fn frozen(node: &Node, log: &mut Log) -> Option<Monitor> {
    let doc = map("frozen", "a frozen monitor")
        .about("How long what a topic sends may stay the same, to the last bit, though messages come.");
    let mut fields = Fields::of(node, doc, log)?;
    fields.rule(|| needs_any(&LIMITS.each_ref().map(std::slice::from_ref)));
    let source = Source::part(&mut fields);
    let about = "From the first of the equal messages to the last.";
    let time = bands::durations_above(&mut fields, about);
    let about = "How often in a row a message may repeat the one before it.";
    let names = ["repeats_warning_above", "repeats_error_above"];
    let repeats = bands::counts_above(&mut fields, names, about, (REPEATS_MAX, bounds));
    if LIMITS.iter().all(|key| fields.key_span(key).is_none()) {
        let problem = Problem::at(node.span, "without a limit this would never be anything but OK");
        fields.log.push(problem.help(format!("add at least one of {}", LIMITS.join(", "))));
    }
    let repeats = repeats.map_or(Bands::default(), |(_, bands)| bands);
    Some(Monitor::Frozen { source: source?, limits: FrozenLimits { time, repeats } })
}
