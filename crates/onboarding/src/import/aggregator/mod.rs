//! diagnostic_aggregator's analyzers.yaml. The rules are those of its sources in ros/diagnostics, for ROS 2.

mod analyzer;
mod parameters;
mod sections;

use super::Findings;
use super::write::{self, Ids, OutGroup, duration, quoted};
use analyzer::Import;
use parameters::Parameters;
pub(super) use sections::are_in;
use telltale_yaml::{Node, Problem};

/// The time after which the aggregator calls a status stale, where nothing else is said.
const TIMEOUT_S: f64 = 5.0;

/// The rates at which Telltale publishes, in hertz.
const RATES: std::ops::RangeInclusive<f64> = 0.1..=100.0;

/// The names of parameters at the top that are no analyzers.
const TOP: [&str; 12] = [
    "path",
    "base_path",
    "pub_rate",
    "history_depth",
    "critical",
    "other_as_errors",
    "publish_values",
    "use_sim_time",
    "log_level",
    "analyzers",
    // The parameters of every node of ROS 2, as in a file by `ros2 param dump`.
    "qos_overrides",
    "start_type_description_service",
];

/// The configuration as text; `file` names where the parameters come from, and `node` is that of the aggregator.
///
/// # Errors
///
/// There is no analyzer in it.
pub(super) fn import(
    file: &str,
    roots: &[Node],
    node: Option<&str>,
    findings: &mut Findings,
) -> Result<String, Problem> {
    let all = sections::aggregator(roots, node, findings)?;
    let path = base_path(&all, findings);
    let mut import = Import { findings, dropped: Vec::new() };
    let root = if path.is_empty() { String::new() } else { format!("/{path}") };
    let groups = import.children(&all, &TOP, &root, &mut Ids::at_the_top());
    let dropped = std::mem::take(&mut import.dropped);
    if groups.is_empty() {
        let problem = Problem::at(all.span, "there are no analyzers in this file");
        return Err(problem.help(
            "an analyzer is a map with `type: diagnostic_aggregator/GenericAnalyzer` and `path: NAME`",
        ));
    }
    same_names(&groups, &all, findings);
    if all.flag("use_sim_time", findings) == Some(true) {
        let text = "with `use_sim_time` the node's clock is /clock";
        let help = "for a simulated vehicle write `clock: ros` at the top of the result";
        findings.differs(
            Problem::at(all.leaf("use_sim_time").map_or(all.span, |node| node.span), text).help(help),
        );
    }
    let name = path.trim_matches('/');
    let name = if name.is_empty() { "Vehicle" } else { name };
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

/// The part behind the first `/` of each path.
fn base_path(all: &Parameters, findings: &mut Findings) -> String {
    if let Some((path, span)) = all.text("path") {
        if path.starts_with('/') {
            let text = format!("the paths begin with `/{path}`, as with diagnostic_aggregator");
            let help = "for one `/`, remove that of `path` below `publish`";
            findings.differs(Problem::at(span, text).help(help));
        }
        return path;
    }
    let Some((path, span)) = all.text("base_path") else { return String::new() };
    let problem = Problem::at(span, "diagnostic_aggregator for ROS 2 reads `path`, not `base_path`");
    findings.differs(
        problem.help("the paths here begin with it; if that is not wanted, empty `path` below `publish`"),
    );
    path.strip_prefix('/').unwrap_or(&path).to_owned()
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
    let rate = rate.filter(|&rate| rate != 1.0).map(|rate| format!("rate: {rate} Hz"));
    let mut keys = vec![format!("path: {}", quoted_path(path))];
    keys.extend(rate.clone());
    if all.flag("publish_values", findings) == Some(false) {
        keys.push("values: false".into());
    }
    if all.flag("critical", findings) == Some(true) {
        keys.push("at_once: true".into());
    }
    let mut text = format!("publish:\n  diagnostics_agg: {{ {} }}", keys.join(", "));
    if let Some(rate) = rate {
        text.push_str(&format!("\n  toplevel_state: {{ {rate} }}"));
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
