//! `telltale check`: validates a configuration and prints its graph.

use std::fmt::Write as _;
use std::io::{IsTerminal, Write as _};
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use super::EXIT_USAGE;
use crate::config::{self, Loaded};
use crate::engine::filter::Filter;
use crate::engine::model::{
    Combine, Dependency, DependsOn, GroupId, Model, ModuleId, MonitorSpec, NodeId, Policy, SignalSpec, Stage,
    When,
};
use crate::engine::time::Span;
use crate::yaml::Problems;

/// Check a configuration and print its graph of groups, modules and dependencies.
///
/// Errors go to standard error, each with file, line, column and what to do; the exit code is then 2.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  telltale check config/shuttle.yaml\n  \
    telltale check --dot config/shuttle.yaml | dot -Tsvg > graph.svg\n  \
    telltale check --schema > telltale.schema.json")]
pub struct Args {
    /// Print the graph for Graphviz instead
    #[arg(long)]
    dot: bool,
    /// Print the JSON Schema of configurations, for editors
    #[arg(long, conflicts_with_all = ["dot", "file"])]
    schema: bool,
    /// The configuration
    #[arg(value_name = "FILE", required_unless_present = "schema")]
    file: Option<PathBuf>,
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let Some(file) = &args.file else {
        print(config::SCHEMA);
        return Ok(ExitCode::SUCCESS);
    };
    match config::load(file) {
        Ok(loaded) => {
            print(&if args.dot { dot(&loaded.model) } else { text(&loaded) });
            Ok(ExitCode::SUCCESS)
        }
        Err(problems) => {
            report(&problems);
            Ok(ExitCode::from(EXIT_USAGE))
        }
    }
}

/// Prints what is wrong with a file to standard error.
pub(super) fn report(problems: &Problems) {
    let colour = std::io::stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    eprint!("{}", problems.render(colour));
}

/// Prints to standard output. A reader that went away (`| head`) is no error of ours.
pub(super) fn print(text: &str) {
    let _ = std::io::stdout().write_all(text.as_bytes());
}

fn text(loaded: &Loaded) -> String {
    let model = &loaded.model;
    let mut out = format!(
        "{} \"{}\": {} groups, {} modules, {} stops. No errors.\n",
        model.vehicle_id,
        model.vehicle_name.en,
        model.groups.len(),
        model.modules.len(),
        loaded.stops.len()
    );
    for signal in &model.signals {
        let _ = writeln!(out, "signal {}: {}", signal.name, signal_text(signal));
    }
    for index in (0..model.groups.len()).filter(|&index| model.groups[index].parent.is_none()) {
        out.push('\n');
        group_text(&mut out, model, GroupId(index as u32), 0);
    }
    out
}

fn signal_text(signal: &SignalSpec) -> String {
    let source = &signal.source;
    let dot = if source.field.is_empty() { "" } else { "." };
    let mut text = format!("{} {}{dot}{}", source.topic, source.type_name, source.field);
    if let Some(present) = signal.present_for {
        let _ = write!(text, ", true for {} after each message", span(present));
    }
    if let Some(timeout) = signal.timeout {
        let _ = write!(text, ", unknown when older than {}", span(timeout));
    }
    text
}

fn group_text(out: &mut String, model: &Model, id: GroupId, depth: usize) {
    let group = &model.groups[id.0 as usize];
    let pad = "  ".repeat(depth);
    let any = if group.combine == Combine::Any { ", the best member counts" } else { "" };
    let _ = writeln!(out, "{pad}{} \"{}\"{any}", group.path, group.name.en);
    conditions(out, model, &pad, &group.depends_on, group.when.as_ref());
    if !group.filters.is_empty() {
        let filters: Vec<String> = group.filters.iter().map(filter_text).collect();
        let _ = writeln!(out, "{pad}  takes statuses with {}", filters.join(", "));
    }
    for module in model.modules.iter().filter(|module| module.group == id) {
        let MonitorSpec::SelfState { status } = &module.monitor;
        let name = module.name.as_ref().map_or(String::new(), |name| format!(" \"{}\"", name.en));
        let policy = policy_text(&module.policy);
        let _ = writeln!(out, "{pad}  - {}{name}: status '{status}', {policy}", module.id);
        conditions(out, model, &format!("{pad}    "), &module.depends_on, module.when.as_ref());
    }
    let inside = model.groups.iter().enumerate().filter(|(_, inner)| inner.parent == Some(id));
    for (index, _) in inside {
        group_text(out, model, GroupId(index as u32), depth + 1);
    }
}

fn policy_text(policy: &Policy) -> String {
    let mut text = format!("{} after {} of silence", policy.stale, span(policy.timeout));
    for (what, after) in [("worse", policy.raise_after), ("better", policy.clear_after)] {
        if !after.is_zero() {
            let _ = write!(text, ", {what} after {}", span(after));
        }
    }
    if let Some(latch) = policy.latch {
        let _ = write!(text, ", an error of {} stays until reset", span(latch));
    }
    text
}

fn conditions(out: &mut String, model: &Model, pad: &str, depends_on: &[Dependency], when: Option<&When>) {
    if !depends_on.is_empty() {
        let names: Vec<String> =
            depends_on.iter().map(|dependency| dependency_text(model, dependency)).collect();
        let _ = writeln!(out, "{pad}  depends on {}", names.join(", "));
    }
    if let Some(when) = when {
        let _ = writeln!(out, "{pad}  only when {}", when_text(model, when));
    }
}

fn dependency_text(model: &Model, dependency: &Dependency) -> String {
    let on = match &dependency.on {
        DependsOn::Node(node) => node_name(model, *node).to_owned(),
        DependsOn::AnyOf(members) => {
            let names: Vec<&str> = members.iter().map(|&node| node_name(model, node)).collect();
            format!("any of ({})", names.join(", "))
        }
    };
    if dependency.masks_unknown { format!("{on} (also when unknown)") } else { on }
}

fn when_text(model: &Model, when: &When) -> String {
    let stages: Vec<&str> = when.stages.iter().map(|stage: &Stage| stage.as_str()).collect();
    let stages = (!stages.is_empty()).then(|| format!("the stage is {}", stages.join(" or ")));
    let signals =
        when.signals.iter().map(|&(index, value)| format!("{} is {value}", model.signals[index].name));
    stages.into_iter().chain(signals).collect::<Vec<_>>().join(" and ")
}

fn filter_text(filter: &Filter) -> String {
    match filter {
        Filter::Name(name) => format!("the name '{name}'"),
        Filter::Namespace(prefix) => format!("the namespace '{prefix}'"),
        Filter::Contains(part) => format!("'{part}' in the name"),
        Filter::Regex(regex) => {
            // The engine keeps the expression anchored; people wrote it without.
            let pattern = regex.as_str().strip_prefix(r"\A(?:").and_then(|rest| rest.strip_suffix(r")\z"));
            format!("a name that matches '{}'", pattern.unwrap_or(regex.as_str()))
        }
    }
}

/// The graph for Graphviz: an arrow from each node to what it depends on.
fn dot(model: &Model) -> String {
    let mut out =
        format!("digraph \"{}\" {{\n  compound=true; rankdir=RL; node [shape=box];\n", model.vehicle_id);
    for index in (0..model.groups.len()).filter(|&index| model.groups[index].parent.is_none()) {
        dot_group(&mut out, model, GroupId(index as u32), 1);
    }
    for (index, group) in model.groups.iter().enumerate() {
        dot_edges(&mut out, model, NodeId::Group(GroupId(index as u32)), &group.depends_on);
    }
    for (index, module) in model.modules.iter().enumerate() {
        let id = NodeId::Module(ModuleId(index as u32));
        dot_edges(&mut out, model, id, &module.depends_on);
    }
    out.push_str("}\n");
    out
}

fn dot_group(out: &mut String, model: &Model, id: GroupId, depth: usize) {
    let group = &model.groups[id.0 as usize];
    let pad = "  ".repeat(depth);
    let _ = writeln!(out, "{pad}subgraph \"cluster {}\" {{", group.path);
    let _ = writeln!(out, "{pad}  label={}; \"{}\" [shape=point];", quoted(&group.name.en), group.path);
    for module in model.modules.iter().filter(|module| module.group == id) {
        let name = module.id.rsplit('/').next().unwrap_or(&module.id);
        let _ = writeln!(out, "{pad}  \"{}\" [label={}];", module.id, quoted(name));
    }
    for (index, inner) in model.groups.iter().enumerate() {
        if inner.parent == Some(id) {
            dot_group(out, model, GroupId(index as u32), depth + 1);
        }
    }
    let _ = writeln!(out, "{pad}}}");
}

fn dot_edges(out: &mut String, model: &Model, from: NodeId, depends_on: &[Dependency]) {
    let cluster = |node: NodeId, end: &str| match node {
        NodeId::Group(_) => format!(" {end}=\"cluster {}\"", node_name(model, node)),
        NodeId::Module(_) => String::new(),
    };
    for dependency in depends_on {
        let (targets, style) = match &dependency.on {
            DependsOn::Node(node) => (std::slice::from_ref(node), "solid"),
            DependsOn::AnyOf(members) => (members.as_slice(), "dashed"),
        };
        for &to in targets {
            let (tail, head) = (cluster(from, "ltail"), cluster(to, "lhead"));
            let (from, to) = (node_name(model, from), node_name(model, to));
            let _ = writeln!(out, "  \"{from}\" -> \"{to}\" [style={style}{tail}{head}];");
        }
    }
}

fn node_name(model: &Model, node: NodeId) -> &str {
    match node {
        NodeId::Group(id) => &model.groups[id.0 as usize].path,
        NodeId::Module(id) => &model.modules[id.0 as usize].id,
    }
}

fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

fn span(span: Span) -> String {
    humantime::format_duration(Duration::from_nanos(span.as_nanos())).to_string()
}
