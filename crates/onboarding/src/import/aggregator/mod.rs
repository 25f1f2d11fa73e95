//! diagnostic_aggregator's analyzers.yaml. The rules are those of its sources in ros/diagnostics, for ROS 2.

mod analyzer;
mod parameters;

use super::findings::Findings;
use super::write::{self, Ids, OutGroup, duration, quoted};
use analyzer::Import;
use parameters::Parameters;
pub(super) use parameters::parameters;
use telltale_yaml::{Node, Problem};

/// The time after which the aggregator calls a status stale, where nothing else is said.
const TIMEOUT_S: f64 = 5.0;

/// The rates at which Telltale publishes, in hertz.
const RATES: std::ops::RangeInclusive<f64> = 0.1..=100.0;

/// The names of parameters at the top that are no analyzers.
const TOP: [&str; 9] = [
    "path",
    "base_path",
    "pub_rate",
    "history_depth",
    "critical",
    "other_as_errors",
    "use_sim_time",
    "log_level",
    "analyzers",
];

/// The configuration as text.
///
/// # Errors
///
/// There is no analyzer in it.
pub(super) fn import(file: &str, root: &Node, findings: &mut Findings) -> Result<String, Problem> {
    let nothing = || {
        let problem = Problem::at(root.span, "there are no analyzers in this file");
        problem
            .help("an analyzer is a map with `type: diagnostic_aggregator/GenericAnalyzer` and `path: NAME`")
    };
    let all = parameters(root).ok_or_else(nothing)?;
    let mut import = Import { findings, dropped: Vec::new() };
    let groups = import.children(&all, &TOP, &mut Ids::at_the_top());
    let dropped = std::mem::take(&mut import.dropped);
    if groups.is_empty() {
        return Err(nothing());
    }
    same_names(&groups, &all, findings);
    let path = base_path(&all, findings);
    let name = if path.is_empty() { "Vehicle" } else { &path };
    let id = Ids::default().of(&name.to_lowercase());
    let comments = [
        format!("Made by `telltale import` from {file}, the parameters of diagnostic_aggregator."),
        "/diagnostics_agg has the same paths and levels as with diagnostic_aggregator. Beside it, Telltale has".into(),
        "statuses of its own under `Telltale`, and the levels of the whole do not count them.".into(),
    ];
    let keys = [
        "# A machine without stages is always diagnosed. Remove `stages` for a shuttle, which an operator clears.".into(),
        format!("vehicle: {{ id: {}, name: {}, stages: none }}", quoted(&id), quoted(name)),
        format!("defaults: {{ timeout: {} }}", duration(TIMEOUT_S)),
        other(&all, &dropped, findings),
        publish(&all, &path, findings),
        String::new(),
    ];
    Ok(write::file(&comments, &keys, &groups))
}

fn base_path(all: &Parameters, findings: &mut Findings) -> String {
    if let Some((path, _)) = all.text("path") {
        return path.trim_matches('/').to_owned();
    }
    let Some((path, span)) = all.text("base_path") else { return String::new() };
    let problem = Problem::at(span, "diagnostic_aggregator for ROS 2 reads `path`, not `base_path`");
    findings.differs(
        problem.help("the paths here begin with it; if that is not wanted, empty `path` below `publish`"),
    );
    path.trim_matches('/').to_owned()
}

/// The analyzer `Other` that the aggregator makes itself.
fn other(all: &Parameters, dropped: &[String], findings: &mut Findings) -> String {
    let silence = format!("timeout: {0}, forget_after: {0}", duration(TIMEOUT_S));
    let (show, state) = match all.flag("other_as_errors", findings) {
        Some(true) => ("counted", ", state: error"),
        Some(false) | None => ("shown", ""),
    };
    let mut text = format!("other:\n  show: {show}\n");
    let inside = format!("{silence}{state}");
    inside.split(", ").for_each(|key| text.push_str(&format!("  {key}\n")));
    if !dropped.is_empty() {
        text.push_str("  except:\n");
        dropped.iter().for_each(|filter| text.push_str(&format!("    - {{ {filter} }}\n")));
    }
    text.trim_end().to_owned()
}

fn publish(all: &Parameters, path: &str, findings: &mut Findings) -> String {
    let rate = all.number("pub_rate", findings).map(|(hertz, span)| {
        let kept = hertz.clamp(*RATES.start(), *RATES.end());
        if kept != hertz {
            let text = format!("Telltale publishes with {kept} Hz, not with {hertz} Hz");
            findings.differs(Problem::at(span, text).help("it can publish with 0.1 Hz to 100 Hz"));
        }
        kept
    });
    if let Some((_, span)) = all.text("critical").filter(|(critical, _)| critical == "true") {
        let text = "`critical` needs nothing here: /diagnostics_toplevel_state is published at every change of the level";
        findings.differs(Problem::at(span, text));
    }
    let rate = rate.filter(|&rate| rate != 1.0);
    let of = |rate: f64| format!("rate: {rate} Hz");
    let beside = rate.map_or(String::new(), |rate| format!(", {}", of(rate)));
    let mut text = format!("publish:\n  diagnostics_agg: {{ path: {}{beside} }}", quoted_path(path));
    if let Some(rate) = rate {
        text.push_str(&format!("\n  toplevel_state: {{ {} }}", of(rate)));
    }
    text
}

fn quoted_path(path: &str) -> String {
    if path.is_empty() { "''".into() } else { quoted(path) }
}

/// Paths are unique here: of two analyzers with one path the second gets a number.
fn same_names(groups: &[OutGroup], all: &Parameters, findings: &mut Findings) {
    for (index, group) in groups.iter().enumerate() {
        if groups[..index].iter().any(|before| before.name == group.name) {
            let text = format!(
                "two analyzers have the path `{}`: the second is `{} (2)` here",
                group.name, group.name
            );
            findings.differs(Problem::at(all.span, text).help("give each a path of its own"));
        }
        same_names(&group.groups, all, findings);
    }
}
