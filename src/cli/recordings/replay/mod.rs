//! `telltale replay`: runs a recording through the engine and prints what changed.

mod serve;
mod text;
mod what_if;

use std::io::{self, IsTerminal as _};
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use anyhow::{Context as _, bail};
use humantime::format_rfc3339_millis;

use self::text::Text;
use crate::cli::EXIT_NO;
use crate::cli::fields::{self, DefinitionFlags};
use crate::cli::moment::{Moment, moment};
use crate::cli::print::{self, note, say};
use crate::cli::running::server;
use crate::clock::Clock;
use crate::config::{self, Loaded};
use crate::engine::model::{Stage, StageModel};
use crate::engine::time::{Span, Timestamp};
use crate::replay::expect::{Difference, Expected};
use crate::replay::line::{Line, lines, seconds};
use crate::replay::{Facts, Recording, ReplayError, Run};
use crate::yaml::input_file;

/// Differences that are printed.
const DIFFERENCES_MAX: usize = 20;

/// Run a recording through the engine and print each change of a node.
///
/// A recording of Telltale is judged as it was judged then; with `--config` by another configuration. A bag
/// of rosbag2 (an MCAP file, a `.db3` database, or the folder with its `metadata.yaml`) needs `--config`: the topics
/// that it reads are replayed.
///
/// `--json` prints an object for each change: `t_s` (seconds since the first instant that the recording shows),
/// `at` (UTC), `node`, `shown`, `own`, `reason` (null, or an object with `kind` `masked` or `not_relevant`) and
/// `roots`. With `--all`, other objects have `kind` instead of `node`: `stage`, `signal`, `alarm_raised` and the
/// like.
///
/// `--what-if NEW` runs each recording by its own configuration and by this one, and prints how much both show: the
/// alarms, the nodes that were ignored because of a root cause, the requests to the vehicle, the changes of what a
/// node shows, and the time from the first symptom to the root cause of the first alarm; below it the first instant
/// at which both differ. With `--json`, an object for each recording and one in total. Exit code 1 where anything
/// differs or a recording cannot be used, which does not stop the others: a configuration that is not to change what
/// was shown is tested so. Recordings are compared on all cores. `--junit` writes the results for the pages of
/// continuous integration.
///
/// Exit codes: 0; 1 where the changes differ from the expected ones; 2 where no recording, or the configuration,
/// can be used. What of a recording cannot be used is said on standard error: for each part of the time that is
/// missing, a line that begins with `telltale: missing`, with its first and its last instant in UTC.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  telltale replay incident-12.mcap\n  \
    telltale replay incident-12.mcap --json > expected.jsonl\n  \
    telltale replay incident-12.mcap --config new.yaml --expect expected.jsonl\n  \
    telltale replay rosbag2_2026_11_20/ --config robot.yaml --stage active\n  \
    telltale replay --what-if new.yaml incident-12.mcap incident-13.mcap\n  \
    telltale replay --what-if new.yaml --data /var/lib/telltale\n  \
    telltale replay --what-if new.yaml --junit results.xml recordings/")]
pub struct Args {
    /// The recording: an MCAP file, a database of rosbag2, or the folder of a bag. With `--what-if` any number, also
    /// folders of recordings, and with `--data` numbers of incidents
    #[arg(value_name = "FILE", required_unless_present = "data")]
    files: Vec<PathBuf>,
    /// Judge by this configuration instead of the recorded one
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Say what this configuration would have changed
    #[arg(long, value_name = "FILE", conflicts_with_all = ["all", "expect", "from", "to", "speed"])]
    what_if: Option<PathBuf>,
    /// The data folder of the vehicle, whose incidents are meant; those that are kept, if none is named
    #[arg(long, value_name = "DIR", requires = "what_if")]
    data: Option<PathBuf>,
    /// Write the result of each recording to this file as JUnit's XML
    #[arg(long, value_name = "OUT.xml", requires = "what_if")]
    junit: Option<PathBuf>,
    /// Print a JSON object for each change, in a line of its own
    #[arg(long)]
    json: bool,
    /// Print the changes of stages, signals and alarms too
    #[arg(long)]
    all: bool,
    /// Compare the changes with these lines, as `--json` prints them; a line may have fewer keys. With `--from` and
    /// `--to`, the lines in between
    #[arg(long, value_name = "FILE")]
    expect: Option<PathBuf>,
    /// Print from here on: a time as `12s` after the first instant that is shown, or `2026-11-20T12:00:00Z`
    #[arg(long, value_name = "TIME", value_parser = moment)]
    from: Option<Moment>,
    /// Print up to here
    #[arg(long, value_name = "TIME", value_parser = moment)]
    to: Option<Moment>,
    /// Replay at this speed, 1 is the speed of the recording [default: as fast as possible]
    #[arg(long, value_name = "N", value_parser = speed)]
    speed: Option<f64>,
    /// Show it in the display instead: the operator's screen and the developer's pages as they were
    #[arg(long, conflicts_with_all = ["what_if", "json", "all", "expect", "from", "to", "speed"])]
    serve: bool,
    /// Where browsers on this computer find it
    #[arg(long, value_name = "ADDR", requires = "serve", default_value = server::LISTEN, value_parser = server::address)]
    listen: SocketAddr,
    /// The stage in which the vehicle begins, where only its messages are recorded
    #[arg(long, value_name = "STAGE", value_parser = stage)]
    stage: Option<Stage>,
    #[command(flatten)]
    definitions: DefinitionFlags,
}

impl Moment {
    fn at(self, facts: &Facts) -> Timestamp {
        match self {
            Moment::After(span) => {
                facts.from + Span::from_nanos(u64::try_from(span.as_nanos()).unwrap_or(u64::MAX))
            }
            Moment::Wall(wall) => {
                let since = wall.duration_since(facts.zero).unwrap_or_default().as_nanos();
                Timestamp::from_nanos(u64::try_from(since).unwrap_or(u64::MAX))
            }
        }
    }

    fn wall(self, facts: &Facts) -> SystemTime {
        match self {
            Moment::After(_) => facts.wall(self.at(facts)),
            Moment::Wall(wall) => wall,
        }
    }
}

fn speed(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|speed: &f64| speed.is_finite() && *speed > 0.0).ok_or_else(|| {
        "write a number above 0: 1 is the speed of the recording, 2 is twice as fast".to_owned()
    })
}

fn stage(text: &str) -> Result<Stage, String> {
    let known = Stage::ALL.into_iter().find(|stage| stage.as_str() == text);
    known.ok_or_else(|| {
        let all = Stage::ALL.map(Stage::as_str).join(", ");
        format!("there is no such stage: write one of {all}")
    })
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    if let Some(new) = &args.what_if {
        return what_if::run(args, new);
    }
    let [file] = &args.files[..] else { bail!("one recording at a time can be replayed") };
    let expected = match &args.expect {
        Some(path) => {
            let text = input_file::open(path)
                .and_then(std::io::read_to_string)
                .with_context(|| format!("the expected lines {} cannot be read", path.display()))?;
            Some(Expected::parse(&text).map_err(|why| anyhow::anyhow!("{}: {why}", path.display()))?)
        }
        None => None,
    };
    let open = opener(args, file)?;
    if args.serve {
        let name = file.file_name().unwrap_or(file.as_os_str()).to_string_lossy().into_owned();
        return serve::run(args, name, open);
    }
    let mut run = open().with_context(|| file.display().to_string())?;
    let got = replay(args, &mut run, expected.is_none())?;
    report(&run);
    let Some(expected) = expected else { return Ok(ExitCode::SUCCESS) };
    let facts = run.facts();
    let [from, to] = [args.from, args.to].map(|moment| moment.map(|moment| moment.at(facts)));
    let differences = expected.within(facts, from, to).compare(&got);
    told(&differences);
    Ok(if differences.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(EXIT_NO) })
}

/// Opens the recording with an engine, as often as it is called.
type Open = dyn Fn() -> Result<Run, ReplayError> + Send + Sync;

/// What opens the recording.
fn opener(args: &Args, file: &Path) -> anyhow::Result<Arc<Open>> {
    let path_of_file = file.to_owned();
    let in_file = || file.display().to_string();
    let recording = match Recording::open(file) {
        // It names the file.
        Err(error @ ReplayError::File(_)) => return Err(error.into()),
        opened => opened.with_context(in_file)?,
    };
    let Some(path) = &args.config else {
        if args.stage.is_some() {
            bail!("--stage needs --config: this recording has its stages");
        }
        return Ok(Arc::new(move || Recording::open(&path_of_file).and_then(Run::recorded)));
    };
    let examined = config::examine(path);
    let definitions = args.definitions.definitions();
    // Fields that only the recording defines are checked with it.
    let known = |loaded: &Loaded| recording.define(definitions.with(&loaded.message_folders));
    let loaded = fields::whole(examined, known)?;
    check_stage(args, recording.facts(), &loaded, path)?;
    let loaded = recording.facts().as_counted(loaded);
    let definitions = recording.define(definitions.with(&loaded.message_folders));
    let (model, stage) = (loaded.model, args.stage);
    Ok(Arc::new(move || Run::judged_by(Recording::open(&path_of_file)?, model.clone(), &definitions, stage)))
}

/// Whether a stage can be given for a recording that is judged by this configuration.
fn check_stage(args: &Args, facts: &Facts, loaded: &Loaded, path: &Path) -> anyhow::Result<()> {
    match args.stage {
        Some(_) if facts.has_journal => {
            bail!("--stage is for recordings of others: this one has its stages")
        }
        Some(_) if loaded.model.stages == StageModel::None => {
            bail!("--stage needs a configuration with `stages: shuttle`: {} has none", path.display())
        }
        _ => Ok(()),
    }
}

/// Takes all steps. Prints the lines, or returns their JSON.
fn replay(args: &Args, run: &mut Run, prints: bool) -> anyhow::Result<Vec<String>> {
    let facts = run.facts().clone();
    let from = args.from.map_or(facts.from, |moment| moment.at(&facts));
    let to = args.to.map(|moment| moment.at(&facts));
    let end = facts.to.map(|end| end.max(facts.from));
    // The clock of the engine does not go back behind its beginning.
    if args.to.is_some_and(|to| to.wall(&facts) < facts.wall(facts.from)) {
        let from = format_rfc3339_millis(facts.wall(facts.from));
        bail!("--to is earlier than the beginning of the recording, {from}");
    }
    check_span(&facts, args.from.map(|_| from), to, end)?;
    let mut last = Timestamp::ZERO;
    let mut pace = Pace::new(args.speed, from);
    let mut progress = Progress::new(&facts, from, prints);
    let mut text = Text::new(&facts, from);
    let mut got = Vec::new();
    while let Some(taken) = run.step()? {
        if to.is_some_and(|to| taken.at > to) {
            break;
        }
        last = last.max(taken.at);
        pace.wait(taken.at);
        progress.show(taken.at);
        let lines: Vec<Line> =
            lines(&taken, &facts, args.all).into_iter().filter(|line| line.at >= from).collect();
        if prints && !args.json {
            if !text.print(taken.at, run.gaps(), &lines) {
                return Ok(got);
            }
            continue;
        }
        for Line { json, .. } in lines {
            if !prints {
                got.push(json);
            } else if !print::json(&json) {
                return Ok(got);
            }
        }
    }
    progress.end();
    // The file of an interrupted recording does not say where it ends.
    if end.is_none() {
        check_span(&facts, args.from.map(|_| from), None, Some(last))?;
    }
    Ok(got)
}

/// Whether there is anything of the recording between these instants. `end` is its last one, if that is known.
fn check_span(
    facts: &Facts,
    from: Option<Timestamp>,
    to: Option<Timestamp>,
    end: Option<Timestamp>,
) -> anyhow::Result<()> {
    let told = |at| format!("+{:.3} s ({})", seconds(facts.from, at), format_rfc3339_millis(facts.wall(at)));
    match (from, to, end) {
        (Some(from), Some(to), _) if from > to => {
            bail!("--from {} is later than --to {}: nothing lies between them", told(from), told(to))
        }
        (Some(from), _, Some(end)) if from > end => {
            bail!("--from {} is later than the end of the recording, {}", told(from), told(end))
        }
        _ => Ok(()),
    }
}

/// Says what of the recording could not be used.
fn report(run: &Run) {
    let notes = run.notes();
    let counted = [
        (
            notes.lost,
            "inputs are missing in the recording: from there to the next recorded state it may differ",
        ),
        (notes.unreadable, "lines of the journal cannot be read by this version"),
        (notes.malformed, "messages do not follow their type"),
        (notes.without_time, "messages have no time: each counts at the time of the message before"),
        (notes.out_of_order, "messages stand behind later ones: each counts at the time of the latest"),
        (notes.of_other_times, "messages are left out: their times do not fit those around them"),
    ];
    for (count, what) in counted.iter().filter(|(count, _)| *count > 0) {
        note!("telltale: {count} {what}");
    }
    run.gaps().sentences(run.facts()).iter().for_each(|sentence| note!("telltale: {sentence}"));
    let (omissions, more) = run.omissions();
    notes.said.iter().chain(&omissions).for_each(|sentence| note!("telltale: {sentence}"));
    if more > 0 {
        note!("telltale: {more} more parts of the file cannot be used");
    }
    run.unheard().iter().for_each(|sentence| note!("telltale: {sentence}"));
}

fn told(differences: &[Difference]) {
    for difference in differences.iter().take(DIFFERENCES_MAX) {
        match difference {
            Difference::Missing { line, text } => {
                say!("line {line} is expected and does not come:");
                say!("  - {text}");
            }
            Difference::Unexpected { before: Some(line), text } => {
                say!("before line {line} comes what is not expected:");
                say!("  + {text}");
            }
            Difference::Unexpected { before: None, text } => {
                say!("at the end comes what is not expected:");
                say!("  + {text}");
            }
        }
    }
    match differences.len().saturating_sub(DIFFERENCES_MAX) {
        0 => {}
        more => say!("and {more} more differences"),
    }
}

/// Waits so that a replay has the wanted speed.
struct Pace {
    clock: Clock,
    speed: Option<f64>,
    from: Timestamp,
    /// When the first instant was reached.
    began: Option<Timestamp>,
}

impl Pace {
    fn new(speed: Option<f64>, from: Timestamp) -> Pace {
        Pace { clock: Clock::start(), speed, from, began: None }
    }

    fn wait(&mut self, at: Timestamp) {
        let Some(speed) = self.speed.filter(|_| at >= self.from) else { return };
        let began = *self.began.get_or_insert(self.clock.now());
        let due = seconds(self.from, at) / speed;
        let wait = due - seconds(began, self.clock.now());
        if wait > 0.0 {
            std::thread::sleep(Duration::from_secs_f64(wait));
        }
    }
}

/// Says on the terminal how much of a recording is done, where no lines do.
struct Progress {
    from: Timestamp,
    span_s: f64,
    is_shown: bool,
    percent: Option<u8>,
}

impl Progress {
    fn new(facts: &Facts, from: Timestamp, prints: bool) -> Progress {
        let is_free = !prints || !io::stdout().is_terminal();
        let span_s = facts.to.map_or(0.0, |to| seconds(from, to));
        Progress {
            from,
            span_s,
            is_shown: is_free && io::stderr().is_terminal() && span_s > 0.0,
            percent: None,
        }
    }

    fn show(&mut self, at: Timestamp) {
        if !self.is_shown {
            return;
        }
        let percent = (seconds(self.from, at) / self.span_s * 100.0).clamp(0.0, 100.0) as u8;
        if self.percent.replace(percent) != Some(percent) {
            print::error_text(&format!("\rreplayed {percent:>3} %"));
        }
    }

    fn end(&self) {
        if self.percent.is_some() {
            print::error_text(&format!("\r{:20}\r", ""));
        }
    }
}
