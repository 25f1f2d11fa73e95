//! `telltale replay --what-if`: what another configuration would have shown of recordings.

use std::collections::BTreeMap;
use std::fs;
use std::io::ErrorKind;
use std::num::NonZero;
use std::panic::resume_unwind;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, SystemTime};

use anyhow::bail;
use serde_json::{Value, json};

use super::{Args, check_stage};
use crate::cli::junit::{self, Case, Verdict};
use crate::cli::print::{self, Lines, note};
use crate::cli::{EXIT_NO, EXIT_USAGE, fields};
use crate::clock::Clock;
use crate::config::{self, Loaded};
use crate::record::folder;
use crate::replay::compare::{Comparison, Parting, PartingOf, compare, judged};
use crate::replay::line::seconds;
use crate::replay::{Facts, Recording, ReplayError, Run, Shown, Totals};
use crate::store::{Incident, IncidentFilter, Incidents, StoreError};
use crate::yaml::Problems;

/// Names in one line.
const NAMED_MAX: usize = 5;
/// Recordings for each core that are compared before the first of them is printed.
const AT_ONCE_PER_CORE: usize = 8;

/// One recording, under the name that is printed.
struct Named {
    name: String,
    /// Or why there is none.
    path: Result<PathBuf, String>,
}

impl Named {
    fn without(name: String, why: impl ToString) -> Named {
        Named { name, path: Err(why.to_string()) }
    }
}

/// Why a recording is not compared.
enum Trouble {
    /// The configuration is wrong, for every recording.
    Configuration(Problems),
    Recording(String),
}

pub fn run(args: &Args, new: &Path) -> anyhow::Result<ExitCode> {
    let recordings = recordings(args)?;
    let (mut compared, mut failed) = (Vec::new(), 0);
    let (mut covered, mut cases) = (Covered::default(), Vec::new());
    let cores = std::thread::available_parallelism().map_or(1, NonZero::get);
    let batches = recordings.chunks(AT_ONCE_PER_CORE * cores);
    let results =
        batches.flat_map(|batch| batch.iter().zip(on_all_cores(cores, batch, |named| one(args, named, new))));
    for (named, (result, took)) in results {
        let outcome;
        let is_read = match result {
            Ok(comparison) => {
                if compared.is_empty() && !args.json {
                    print::line(&heading());
                }
                let [recorded, new] = comparison.alone(covered.until(&comparison.facts));
                covered.add(&comparison);
                compared.push((comparison.differs(), recorded, new));
                let said = text(&named.name, &comparison);
                outcome = match &comparison.first {
                    None => Verdict::Passed,
                    Some(first) => Verdict::Failed(parting(&comparison, first), said.text().to_owned()),
                };
                match args.json {
                    true => print::json(&with_name(comparison.json(), &named.name)),
                    false => print::text(said.text()),
                }
            }
            Err(Trouble::Configuration(problems)) => return Err(problems.into()),
            Err(Trouble::Recording(why)) => {
                failed += 1;
                note!("telltale: {}: {why}", named.name);
                let is_read = !args.json || print::json(&with_name(json!({ "error": why }), &named.name));
                outcome = Verdict::Broken(why);
                is_read
            }
        };
        if args.junit.is_some() {
            cases.push(Case { name: named.name.clone(), took, result: outcome });
        } else if !is_read {
            break;
        }
    }
    if let Some(path) = &args.junit {
        junit::write(path, "telltale replay --what-if", &cases)?;
    }
    let differ = compared.iter().filter(|(differs, ..)| *differs).count();
    let (recorded, new) = (sum(compared.iter().map(|it| it.1)), sum(compared.iter().map(|it| it.2)));
    if args.json {
        let count = compared.len();
        let total =
            json!({ "total": count, "differ": differ, "failed": failed, "recorded": recorded, "new": new });
        print::json(&total);
    } else if !compared.is_empty() {
        print::line(&row("all", &recorded, &new));
        print::line(&verdict(compared.len(), differ, failed));
    }
    Ok(match (failed, differ) {
        (0, 0) => ExitCode::SUCCESS,
        (_, _) if compared.is_empty() => ExitCode::from(EXIT_USAGE),
        _ => ExitCode::from(EXIT_NO),
    })
}

/// Calls `of` with each of `all` on all cores. Returns the results in order, and how long each took.
fn on_all_cores<T: Sync, R: Send>(
    cores: usize,
    all: &[T],
    of: impl Fn(&T) -> R + Sync,
) -> Vec<(R, Duration)> {
    let next = AtomicUsize::new(0);
    let work = || {
        let (clock, mut done) = (Clock::start(), Vec::new());
        while let index = next.fetch_add(1, Ordering::Relaxed)
            && let Some(it) = all.get(index)
        {
            let began = clock.now();
            let result = of(it);
            done.push((index, (result, Duration::from_nanos(clock.now().since(began).as_nanos()))));
        }
        done
    };
    let mut done: Vec<(usize, (R, Duration))> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..cores.min(all.len())).map(|_| scope.spawn(work)).collect();
        let joined = threads.into_iter().map(std::thread::ScopedJoinHandle::join);
        joined.flat_map(|it| it.unwrap_or_else(|panic| resume_unwind(panic))).collect()
    });
    done.sort_by_key(|(index, _)| *index);
    done.into_iter().map(|(_, it)| it).collect()
}

/// The recordings that are meant.
fn recordings(args: &Args) -> anyhow::Result<Vec<Named>> {
    let data = args.data.as_deref();
    let incidents = data.map(Incidents::open).transpose()?;
    if let (Some(incidents), Some(data), []) = (&incidents, data, &args.files[..]) {
        let kept = kept(incidents)?;
        if kept.is_empty() {
            bail!(
                "no incident in {} is kept: `telltale incident keep ID` keeps one, or name some here",
                data.display()
            );
        }
        return Ok(kept.iter().map(|incident| of_incident(data, incident)).collect());
    }
    let mut found = Vec::new();
    for path in &args.files {
        let number = path.to_str().and_then(|text| text.parse::<u64>().ok());
        match (number, &incidents, data) {
            (Some(id), Some(incidents), Some(data)) => found.push(match incidents.one(id)? {
                Some(incident) => of_incident(data, &incident),
                None => Named::without(format!("incident {id}"), StoreError::NoSuchIncident(id)),
            }),
            (Some(id), ..) if !path.exists() => {
                bail!("{id} is no file: to mean an incident, name the data folder with --data")
            }
            _ => match of_path(path) {
                Ok(named) => found.extend(named),
                Err(why) => found.push(Named::without(path.display().to_string(), why)),
            },
        }
    }
    Ok(found)
}

/// All incidents that are kept, the oldest first.
fn kept(incidents: &Incidents) -> Result<Vec<Incident>, StoreError> {
    let mut all = incidents.all(IncidentFilter { kept: Some(true), ..IncidentFilter::default() })?;
    all.reverse();
    Ok(all)
}

fn of_incident(data: &Path, incident: &Incident) -> Named {
    let (id, file) = (incident.summary.id, &incident.summary.recording.file);
    let path = folder::path_of(&folder::folder_in(data), file);
    Named { name: format!("incident {id}"), path: path.ok_or_else(|| "it has no recording".to_owned()) }
}

/// A file, a bag, or each recording in a folder.
fn of_path(path: &Path) -> Result<Vec<Named>, String> {
    let named = |path: PathBuf| Named { name: path.display().to_string(), path: Ok(path) };
    let is_folder = match fs::metadata(path) {
        Ok(about) => about.is_dir() && !path.join("metadata.yaml").exists(),
        Err(error) if error.kind() == ErrorKind::NotFound => return Err("there is no such file".to_owned()),
        Err(error) => return Err(error.to_string()),
    };
    if !is_folder {
        return Ok(vec![named(path.to_owned())]);
    }
    let entries = fs::read_dir(path).map_err(|error| error.to_string())?;
    let mut found = Vec::new();
    for entry in entries {
        let path = entry.map_err(|error| error.to_string())?.path();
        let is_bag = path.join("metadata.yaml").exists();
        if is_bag || path.extension().is_some_and(|it| it == "mcap" || it == "db3") {
            found.push(path);
        }
    }
    if found.is_empty() {
        return Err("there are no recordings in it".to_owned());
    }
    // 2 before 10.
    found.sort_by_key(|path| (path.as_os_str().len(), path.clone()));
    Ok(found.into_iter().map(named).collect())
}

/// What the recordings of each vehicle cover so far: incidents that follow each other closely share some seconds, and
/// what happened in them counts once in the sums.
#[derive(Default)]
struct Covered(BTreeMap<String, (SystemTime, SystemTime)>);

impl Covered {
    /// Until when the recordings before have everything that this one has.
    fn until(&self, facts: &Facts) -> Option<SystemTime> {
        let from = facts.wall(facts.from);
        let (begin, end) = self.0.get(&facts.vehicle).filter(|_| facts.has_journal)?;
        (*begin <= from && from < *end).then_some(*end)
    }

    fn add(&mut self, comparison: &Comparison) {
        let (from, to) = comparison.period();
        let (begin, end) = self.0.entry(comparison.facts.vehicle.clone()).or_insert((from, to));
        if *begin <= from && from < *end { *end = to.max(*end) } else { (*begin, *end) = (from, to) }
    }
}

fn one(args: &Args, named: &Named, new: &Path) -> Result<Comparison, Trouble> {
    let file = named.path.as_deref().map_err(|why| Trouble::Recording(why.clone()))?;
    let trouble = |error: ReplayError| {
        let said = error.to_string();
        // It names the file, as its line does.
        let said = said.strip_prefix(&format!("{}: ", file.display())).unwrap_or(&said).to_owned();
        Trouble::Recording(said)
    };
    let recording = Recording::open(file).map_err(trouble)?;
    let loaded = load(args, new, &recording)?;
    let definitions = args.definitions.definitions();
    let mut recorded = match &args.config {
        Some(old) => {
            let old = load(args, old, &recording)?;
            judged(file, &old, &definitions.with(&old.message_folders), args.stage).map_err(trouble)?
        }
        None => {
            let omissions = recording.omissions();
            Run::recorded(recording).map_err(|error| match (error, &omissions[..]) {
                (
                    error @ (ReplayError::NoConfiguration | ReplayError::DamagedConfiguration(_)),
                    [omission, ..],
                ) => Trouble::Recording(format!("{error}; {omission}")),
                (error, _) => trouble(error),
            })?
        }
    };
    let definitions = definitions.with(&loaded.message_folders);
    let mut new = judged(file, &loaded, &definitions, args.stage).map_err(trouble)?;
    compare(&mut recorded, &mut new, &|| true).map_err(trouble)
}

/// A configuration whose fields the messages of a recording have.
fn load(args: &Args, path: &Path, recording: &Recording) -> Result<Loaded, Trouble> {
    let definitions = args.definitions.definitions();
    let whole = fields::whole(config::examine(path), |loaded| {
        recording.define(definitions.with(&loaded.message_folders))
    });
    let loaded = whole.map_err(Trouble::Configuration)?;
    check_stage(args, recording.facts(), &loaded, path)
        .map_err(|error| Trouble::Recording(error.to_string()))?;
    Ok(loaded)
}

fn with_name(mut object: Value, name: &str) -> Value {
    object["recording"] = name.into();
    object
}

/// Both sides of all recordings together; the longest of the times.
fn sum(all: impl Iterator<Item = Totals>) -> Totals {
    all.fold(Totals::default(), |sum, it| Totals {
        alarms: sum.alarms + it.alarms,
        masked: sum.masked + it.masked,
        countermeasures: sum.countermeasures + it.countermeasures,
        transitions: sum.transitions + it.transitions,
        to_root_s: [sum.to_root_s, it.to_root_s].into_iter().flatten().reduce(f64::max),
    })
}

fn heading() -> String {
    columns("recording", &["alarms", "masked", "requests", "transitions", "to root"].map(str::to_owned))
}

fn row(name: &str, recorded: &Totals, new: &Totals) -> String {
    let count = |of: fn(&Totals) -> u64| both(&of(recorded).to_string(), &of(new).to_string());
    let time = |side: &Totals| side.to_root_s.map_or("-".to_owned(), |s| format!("{s:.2} s"));
    let cells = [
        count(|it| it.alarms),
        count(|it| it.masked),
        count(|it| it.countermeasures),
        count(|it| it.transitions),
        both(&time(recorded), &time(new)),
    ];
    columns(name, &cells)
}

/// Both values, or the one that they are.
fn both(recorded: &str, new: &str) -> String {
    if recorded == new { recorded.to_owned() } else { format!("{recorded} -> {new}") }
}

fn columns(name: &str, cells: &[String; 5]) -> String {
    let [alarms, masked, requests, transitions, to_root] = cells;
    format!("{name:<28} {alarms:>12} {masked:>12} {requests:>12} {transitions:>14} {to_root:>18}")
        .trim_end()
        .to_owned()
}

fn text(name: &str, comparison: &Comparison) -> Lines {
    let mut out = Lines::default();
    out.add(row(name, &comparison.recorded, &comparison.new));
    let parting = match &comparison.first {
        None => "nothing differs".to_owned(),
        Some(first) => parting(comparison, first),
    };
    out.add(format_args!("  {parting}"));
    let Comparison { alarms_gone, alarms_new, only_recorded, only_new, .. } = comparison;
    for (names, what) in [
        (alarms_gone, "alarms that are gone"),
        (alarms_new, "new alarms"),
        (only_recorded, "only in the recorded configuration"),
        (only_new, "only in the new configuration"),
    ] {
        if !names.is_empty() {
            let more = names.len().saturating_sub(NAMED_MAX);
            let named: Vec<&str> = names.iter().take(NAMED_MAX).map(|name| &**name).collect();
            let more = if more > 0 { format!(" and {more} more") } else { String::new() };
            out.add(format_args!("  {what}: {}{more}", named.join(", ")));
        }
    }
    for note in &comparison.notes {
        out.add(format_args!("  note: {note}"));
    }
    out
}

/// Where they part, in a sentence.
fn parting(comparison: &Comparison, Parting { at, of }: &Parting) -> String {
    let listed = |all: &[String]| if all.is_empty() { "nothing".to_owned() } else { all.join(", ") };
    let names = |all: &[std::sync::Arc<str>]| {
        let all: Vec<String> = all.iter().map(ToString::to_string).collect();
        listed(&all)
    };
    let what = match of {
        PartingOf::Node { node, recorded, new } => {
            format!("{node}: {} -> {}", shown(recorded.as_ref()), shown(new.as_ref()))
        }
        PartingOf::Stage { recorded, new } => format!("stage: {recorded} -> {new}"),
        PartingOf::Requests { recorded, new } => format!("requests: {} -> {}", listed(recorded), listed(new)),
        PartingOf::Instruction { recorded, new } => {
            let word = |it: &Option<&'static str>| it.unwrap_or("nothing");
            format!("instruction: {} -> {}", word(recorded), word(new))
        }
        PartingOf::Alarms { recorded, new } => format!("alarms: {} -> {}", names(recorded), names(new)),
    };
    let others = (comparison.nodes.len() + comparison.more_nodes).saturating_sub(1);
    let others = match others {
        0 => String::new(),
        1 => " (1 more node differs)".to_owned(),
        more => format!(" ({more} more nodes differ)"),
    };
    let facts = &comparison.facts;
    let wall = humantime::format_rfc3339_millis(facts.wall(*at));
    format!("differs from {:.3} s on ({wall}): {what}{others}", seconds(facts.from, *at))
}

fn shown(shown: Option<&Shown>) -> String {
    match shown {
        None => "not there".to_owned(),
        Some(Shown { state, cause: Some(cause), .. }) => format!("{state} because of {cause}"),
        Some(Shown { state, own, .. }) if own != state => format!("{state} (own {own})"),
        Some(Shown { state, .. }) => state.to_string(),
    }
}

fn verdict(compared: usize, differ: usize, failed: usize) -> String {
    let failed = match failed {
        0 => String::new(),
        1 => "; 1 cannot be used".to_owned(),
        more => format!("; {more} cannot be used"),
    };
    format!("{differ} of {compared} differ{failed}")
}
