//! `telltale check`: validates a configuration and prints its graph.

pub mod live;

use std::collections::BTreeSet;
use std::io::stdin;
use std::path::PathBuf;
use std::process::ExitCode;

use super::graph;
use crate::cli::print::{self, Lines, note};
use crate::cli::{EXIT_NO, EXIT_USAGE, fields};
use crate::config::describe::words;
use crate::config::soundness::{self, FindingKind, Soundness};
use crate::config::{self, Loaded};
use crate::engine::model::monitors::RecordedTopic;
use crate::engine::model::{Combine, Dependency, GroupId, Model, Stage, StageModel, When};
use crate::engine::stage::machine::{Guard, TRANSITIONS, Transition};
use crate::engine::state::State;
use crate::msg::subscription::LARGE_BYTES_PER_S;
use crate::yaml::Problems;
use crate::yaml::plain::escaped;

/// Topics that one sentence names.
const SIZES_ONLY_NAMED: usize = 8;

/// Check a configuration and print its graph of groups, modules and dependencies.
///
/// Errors go to standard error, each with file, line, column and what to do; the exit code is then 2.
/// Warnings go there too: conditions, dependencies and groups that cannot do what they are there for,
/// each with a situation in which it can be seen. A vehicle runs with them; the exit code is 0.
///
/// `--json` prints one object instead: `ok`, `problems`, `more` (how many more there are than are listed) and
/// `assumed` (sentences on topics whose type is left out).
/// A problem has `severity` (`error` or `warning`), `file`, `line` and `column` (from 1; these two null where
/// a file as a whole is meant), `message`, `help`, and in `also` other places with a `message` each.
/// With `-q` the object is printed only where there is a problem.
///
/// `--live` listens to the running ROS 2 system as `telltale init` does. A name in the configuration
/// that nobody offers in that time is an error at its place (topics, types that differ, statuses, nodes, services), and
/// the exit code is 1. Warnings name measurements beyond their limits, and lines below them name the parts of the robot
/// that nothing watches. A status may be silent for as long as its module allows, so it is judged only when it was
/// listened for longer. The object of `--json` then has `live`: `listened_s`, `nobody`, `absent`, `not_judged` and
/// `unwatched`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  telltale check config/shuttle.yaml\n  \
    telltale check --svg config/shuttle.yaml > graph.svg\n  \
    telltale check --dot config/shuttle.yaml | dot -Tsvg > graph.svg\n  \
    telltale check --json config/shuttle.yaml\n  \
    generate-configuration | telltale check -q --json -\n  \
    telltale check -q --live --for 30s robot.yaml\n  \
    telltale check --schema > telltale.schema.json")]
pub struct Args {
    /// Print the graph for Graphviz instead
    #[arg(long)]
    dot: bool,
    /// Print a drawing of the graph instead
    #[arg(long, conflicts_with = "dot")]
    svg: bool,
    /// Print what is wrong for programs, and nothing else
    #[arg(long, conflicts_with_all = ["dot", "svg", "schema"])]
    json: bool,
    /// Print no graph, and with `--json` no object: nothing at all where nothing is wrong
    #[arg(short, long, conflicts_with_all = ["dot", "svg", "schema"])]
    quiet: bool,
    /// Exit with 1 where there is a warning
    #[arg(long, conflicts_with = "schema")]
    strict: bool,
    /// Print the JSON Schema of configurations, for editors
    #[arg(long, conflicts_with_all = ["dot", "file"])]
    schema: bool,
    /// The configuration; `-` reads it from standard input
    #[arg(value_name = "FILE", required_unless_present = "schema")]
    file: Option<PathBuf>,
    #[command(flatten)]
    beside: live::LiveArgs,
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let Some(file) = &args.file else {
        print::text(&config::schema());
        return Ok(ExitCode::SUCCESS);
    };
    let examined = match file.as_os_str() == "-" {
        true => config::examine_from("standard input", stdin().lock()),
        false => config::examine(file),
    };
    let definitions = args.beside.dds.definitions.definitions();
    let loaded = match fields::whole(examined, |loaded| definitions.with(&loaded.message_folders)) {
        Ok(loaded) => loaded,
        Err(problems) => {
            tell(args, false, Some(&problems), &[], None);
            return Ok(ExitCode::from(EXIT_USAGE));
        }
    };
    let (found, mut problems) = loaded.soundness();
    let mut beside = match args.beside.live {
        true => Some(live::look(&args.beside, &loaded)?),
        false => None,
    };
    let more = beside.as_mut().and_then(|beside| beside.problems.take());
    problems = problems.into_iter().chain(more).reduce(Problems::and);
    match args {
        Args { dot: true, .. } => drop(print::text(&escaped(&graph::dot(&loaded.model)))),
        Args { svg: true, .. } => drop(print::text(&escaped(&graph::svg(&loaded.model)))),
        Args { json: true, .. } | Args { quiet: true, .. } => {}
        _ => drop(print::text(text(&loaded, &found).text())),
    }
    let code = match judged(args, &found) {
        0 if beside.as_ref().is_some_and(|beside| !beside.is_whole()) => EXIT_NO,
        code => code,
    };
    tell(args, code == 0, problems.as_ref(), &fields::assumed(&loaded.model), beside.as_ref());
    Ok(ExitCode::from(code))
}

fn tell(
    args: &Args,
    ok: bool,
    problems: Option<&Problems>,
    assumed: &[String],
    beside: Option<&live::Beside>,
) {
    match problems {
        None if args.quiet && beside.is_none() => {}
        _ if args.json => {
            let mut object = json(ok, problems, assumed);
            if let Some(beside) = beside {
                object["live"] = beside.json();
            }
            print::json(&object);
        }
        Some(problems) => print::problems(problems),
        None => {}
    }
    if let Some(beside) = beside.filter(|_| !args.json) {
        beside.lines().iter().for_each(|line| note!("{line}"));
    }
}

fn json(ok: bool, problems: Option<&Problems>, assumed: &[String]) -> serde_json::Value {
    let list = problems.map(Problems::json).unwrap_or_default();
    let more = problems.map_or(0, Problems::more);
    serde_json::json!({ "ok": ok, "problems": list, "more": more, "assumed": assumed })
}

/// The exit code. Only a fault of the engine's own rules is an error; a vehicle runs with all other
/// findings.
fn judged(args: &Args, found: &Soundness) -> u8 {
    let fault = found.findings.iter().any(|finding| finding.what == FindingKind::Unexplained);
    match (fault, args.strict && !found.findings.is_empty()) {
        (true, _) => EXIT_USAGE,
        (false, true) => EXIT_NO,
        (false, false) => 0,
    }
}

fn soundness_text(found: &Soundness) -> String {
    let pictures = match found.pictures {
        1 => "1 state of the modules".to_owned(),
        count => format!("{count} states of the modules"),
    };
    let looked = format!("{} with {pictures}", words::counted(found.situations, "situation"));
    let claim = match found.findings.iter().any(|finding| finding.what == FindingKind::Unexplained) {
        true => "a node can be masked without a cause in sight",
        false => "whatever is masked has a cause in sight",
    };
    let warnings = match found.findings.len() {
        0 => "No warnings.".into(),
        count => format!("{}.", words::counted(count, "warning")),
    };
    let rest = if found.complete { "" } else { " There are more than were looked at." };
    format!("Looked at {looked}: {claim}.{rest} {warnings}")
}

fn text(loaded: &Loaded, found: &Soundness) -> Lines {
    let model = &loaded.model;
    let mut out = Lines::default();
    out.add(format_args!(
        "{} \"{}\": {}, {}, {}. No errors.",
        model.vehicle_id,
        model.vehicle_name.en,
        words::counted(model.groups.len(), "group"),
        words::counted(model.modules.len(), "module"),
        words::counted(model.driving.stops.len(), "stop")
    ));
    out.add(soundness_text(found));
    for behind in soundness::urgency::behind(model) {
        out.add(format_args!("Urgency: {}.", soundness::behind(model, &behind)));
    }
    out.add(format_args!("statuses that no group takes: {}", words::other(model.other)));
    for assumption in fields::assumed(model) {
        out.add(format_args!("Assumed: {assumption}."));
    }
    if let Some(sizes) = sizes_only(loaded) {
        out.add(sizes);
    }
    if let Some(never) = never_recorded(loaded) {
        out.add(never);
    }
    for signal in &model.signals {
        out.add(format_args!("signal {}: {}", signal.name, words::signal(model, signal)));
    }
    out.add(format_args!("motion: {}", words::motion(model)));
    if model.stages == StageModel::Shuttle {
        out.add("");
        stages_text().lines().for_each(|line| out.add(line));
    }
    for index in (0..model.groups.len()).filter(|&index| model.groups[index].parent.is_none()) {
        out.add("");
        group_text(&mut out, model, GroupId(index as u32), 0);
    }
    out
}

/// Names the topics whose recordings may have only the times and sizes of messages.
fn sizes_only(loaded: &Loaded) -> Option<String> {
    loaded.recording.as_ref()?;
    let topics = listed(loaded.model.counted_topics().collect())?;
    let limit = words::bytes(LARGE_BYTES_PER_S);
    Some(format!(
        "recording: above {limit} a second, only the times and sizes of {topics} are recorded, because nothing reads \
         their content; `recording.topics` names topics to record whole"
    ))
}

/// Names the topics that are read and by `every: never` not recorded.
fn never_recorded(loaded: &Loaded) -> Option<String> {
    loaded.recording.as_ref()?;
    let watched = &loaded.model.watched;
    let of_signals = loaded.model.signals.iter().filter_map(|it| it.source.field()).map(|it| &*it.topic);
    let read: BTreeSet<&str> = watched.topics.iter().map(|it| &*it.topic).chain(of_signals).collect();
    let is_never = |topic: &&str| watched.recorded(topic).is_some_and(|it| it.every == RecordedTopic::NEVER);
    let topics = listed(read.into_iter().filter(is_never).collect())?;
    Some(format!(
        "recording: only the times and sizes of {topics} are recorded, as `every: never` says; another configuration \
         cannot judge them in a replay"
    ))
}

fn listed(topics: Vec<&str>) -> Option<String> {
    let named: Vec<&str> = topics.iter().copied().take(SIZES_ONLY_NAMED).collect();
    let more = match topics.len() - named.len() {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    (!topics.is_empty()).then(|| format!("{}{more}", named.join(", ")))
}

/// The table of transitions between stages.
fn stages_text() -> String {
    let mut out = "stages\n".to_owned();
    for Transition { from, event, guard, to } in TRANSITIONS {
        let from: Vec<&str> = from.iter().map(|stage| stage.as_str()).collect();
        let guard = match guard {
            Guard::None => String::new(),
            guard => format!(", if: {}", guard.as_str()),
        };
        out += &format!("  {} --{}--> {}{guard}\n", from.join(", "), event.as_str(), to.as_str());
    }
    out
}

fn group_text(out: &mut Lines, model: &Model, id: GroupId, depth: usize) {
    let group = &model.groups[id.0 as usize];
    let pad = "  ".repeat(depth);
    let any = if group.combine == Combine::Any { ", the best member counts" } else { "" };
    out.add(format_args!("{pad}{} \"{}\"{any}", group.path, group.name.en));
    conditions(out, model, &pad, &group.depends_on, group.when.as_ref());
    if !group.filters.is_empty() {
        let filters: Vec<String> = group.filters.iter().map(words::matching).collect();
        out.add(format_args!("{pad}  takes statuses with {}", filters.join(", ")));
    }
    for module in model.modules.iter().filter(|module| module.group == id) {
        let monitor = words::monitor(model, &module.monitor);
        let name = |state| module.name.as_ref()?.of(state, Stage::Active);
        let name = [State::Error, State::Unknown, State::Warning].into_iter().find_map(name);
        let name = name.map_or(String::new(), |name| format!(" \"{}\"", name.en));
        // What is judged by the clock never falls silent.
        let policy = if module.monitor.by_the_clock() {
            words::policy_when_heard(&module.policy).collect()
        } else {
            vec![words::policy(&module.policy)]
        };
        let facts = std::iter::once(monitor).chain(policy).collect::<Vec<_>>().join(", ");
        out.add(format_args!("{pad}  - {}{name}: {facts}", module.id));
        conditions(out, model, &format!("{pad}    "), &module.depends_on, module.when.as_deref());
    }
    let inside = model.groups.iter().enumerate().filter(|(_, inner)| inner.parent == Some(id));
    for (index, _) in inside {
        group_text(out, model, GroupId(index as u32), depth + 1);
    }
}

fn conditions(out: &mut Lines, model: &Model, pad: &str, depends_on: &[Dependency], when: Option<&When>) {
    if !depends_on.is_empty() {
        let names: Vec<String> =
            depends_on.iter().map(|dependency| words::dependency(model, dependency)).collect();
        out.add(format_args!("{pad}  depends on {}", names.join(", ")));
    }
    if let Some(when) = when {
        out.add(format_args!("{pad}  only when {}", words::when(model, when)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::engine::model::monitors::DIAGNOSTIC_ARRAY;

    #[test]
    fn one_of_a_kind_is_no_plural() {
        let loaded = config::parse("c", "groups: [{ id: a, modules: [{ id: m, status: s }] }]\n").unwrap();
        let lines = text(&loaded, &loaded.soundness().0);
        let text = lines.text();
        assert!(text.starts_with("vehicle \"vehicle\": 1 group, 1 module, 0 stops. No errors.\n"), "{text}");
        let none =
            config::parse("c", "vehicle: { stages: none }\ngroups: [{ id: a, match: [{ name: s }] }]\n")
                .unwrap();
        assert!(soundness_text(&none.soundness().0).starts_with("Looked at 1 situation with "), "{text}");
    }

    #[test]
    fn topics_of_which_only_times_and_sizes_are_recorded_are_named() {
        let monitored = "groups: [{ id: a, modules: [{ id: m, monitor: { frequency: { topic: /points, \
                         type: sensor_msgs/msg/PointCloud2, window: 2s, error_below: 5 } } }] }]\n";
        let said =
            |recording: &str| sizes_only(&config::parse("c", &format!("{recording}{monitored}")).unwrap());
        assert!(
            said("").is_some_and(|said| said.contains("times and sizes of /points are")),
            "{:?}",
            said("")
        );
        assert_eq!(said("recording: { topics: [{ topic: '/po*' }] }\n"), None);
        assert_eq!(said("recording: false\n"), None);
        let never = "recording: { topics: [{ topic: /points, every: never }] }\n";
        assert_eq!(said(never), None);
        let never = never_recorded(&config::parse("c", &format!("{never}{monitored}")).unwrap());
        assert!(
            never.is_some_and(
                |said| said.contains("times and sizes of /points are recorded, as `every: never`")
            )
        );
        let of_statuses = monitored
            .replace("/points", "/diagnostics")
            .replace("sensor_msgs/msg/PointCloud2", DIAGNOSTIC_ARRAY);
        assert_eq!(sizes_only(&config::parse("c", &of_statuses).unwrap()), None, "the statuses are read");
    }

    #[test]
    fn the_documentation_shows_the_stages_as_they_are() {
        let page = include_str!("../../../../docs/stages.md");
        assert!(page.contains(stages_text().trim()), "docs/stages.md lacks:{}", stages_text());
    }
}
