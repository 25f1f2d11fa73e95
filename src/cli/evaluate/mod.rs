//! `telltale evaluate`: measures the diagnosis in a campaign of faults with known truth.

mod live;
mod machine;

use std::num::NonZero;
use std::ops::Range;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use anyhow::{Context as _, ensure};
use clap::ValueEnum;

use crate::cli::print::{self, Lines};
use crate::cli::running::vehicle::machine::Kind;
use crate::evaluate::campaign::{self, CURVE_MS, Results};
use crate::evaluate::figures::{self, Figure, Figures};
use crate::evaluate::learning;
use crate::evaluate::live::Live;
use crate::evaluate::report;
use crate::sim::machine::Departure;
use machine::Simulated;

/// The most trials of one call: some days of one core.
const SEEDS_MAX: u64 = 1_000_000;

/// Measure the diagnosis in a campaign of simulated faults whose truth is known
///
/// Each seed is a trial: a fault alone, two at a time, or one that spreads, comes and goes. The shipped configuration and
/// others with drawn delays and mistakes judge it, and so do other rules of diagnosis.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  telltale evaluate --seeds 1..200\n  \
    telltale evaluate --machine robot --seeds 1..1000 --json\n  \
    telltale evaluate --seeds 1..100 --live 100")]
pub struct Args {
    /// The machine
    #[arg(long, value_enum, default_value_t = Word::Shuttle)]
    machine: Word,
    /// The first and the last seed
    #[arg(long, value_name = "A..B", value_parser = seeds, default_value = "1..300")]
    seeds: Range<u64>,
    /// Trials that run at a time [default: as many as there are cores; three times as many in real time]
    #[arg(long, value_name = "COUNT")]
    threads: Option<NonZero<usize>>,
    /// Run the first trials with so many faults in real time too: over DDS, judged by the running diagnosis
    ///
    /// It needs DDS on the loopback interface, and a computer with time to spare: a run that the computer held up for more
    /// than 0.2 s is made again, and is counted.
    #[arg(long, value_name = "FAULTS")]
    live: Option<NonZero<u64>>,
    /// The first of the DDS domains of trials in real time [default: free ones, from 60 on]
    #[arg(long, value_name = "N", requires = "live")]
    domain: Option<u16>,
    /// Print the figures as one JSON object
    #[arg(long)]
    json: bool,
    /// Write the tables as Markdown and the curve as SVG into this folder, and how well the dependencies are learned
    #[arg(long, value_name = "DIR")]
    report: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Word {
    Shuttle,
    Robot,
}

impl Word {
    fn machine(self) -> anyhow::Result<Simulated> {
        Simulated::new(match self {
            Word::Shuttle => Kind::Shuttle(Departure::Cleared),
            Word::Robot => Kind::Robot,
        })
    }
}

/// Trials in real time for each core: they wait most of the time.
const LIVE_OF_A_CORE: usize = 3;

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let machine = Arc::new(args.machine.machine()?);
    let threads = args.threads.or(std::thread::available_parallelism().ok()).map_or(1, NonZero::get);
    let all = args.seeds.end - args.seeds.start;
    let progress = |done: u64| {
        if done.is_multiple_of(100) {
            tracing::info!("{done} of {all} trials");
        }
    };
    let mut results = campaign::run(&*machine, args.seeds.clone(), threads, &progress);
    ensure!(results.faults() > 0, "no module noticed any fault of these seeds: take more of them");
    if let Some(faults) = args.live {
        ensure!(
            results.faults() >= faults.get(),
            "these seeds have {} faults that a module notices: take more seeds, or fewer faults",
            results.faults()
        );
        let at_a_time = args.threads.map_or(threads * LIVE_OF_A_CORE, NonZero::get);
        let trials = live::run(&machine, results.first(faults.get()), at_a_time, args.domain)?;
        results.live = Some(Live::judge(&*machine, &results, trials, threads));
    }
    if let Some(folder) = &args.report {
        let name = results.machine;
        let learned = learning::measure(&*machine, args.seeds.clone(), threads);
        std::fs::create_dir_all(folder).with_context(|| format!("{} cannot be made", folder.display()))?;
        for (file, text) in [
            (format!("{name}.md"), report::markdown(&results)),
            (format!("{name}-curve.svg"), report::curve(&results)),
            (format!("{name}-learning.md"), report::learning(&learned)),
        ] {
            let path = folder.join(file);
            std::fs::write(&path, text).with_context(|| format!("{} cannot be written", path.display()))?;
        }
    }
    match args.json {
        true => drop(print::json(&results.to_json())),
        false => drop(print::text(&summary(&results))),
    }
    Ok(ExitCode::SUCCESS)
}

/// `A..B`, both included.
fn seeds(text: &str) -> Result<Range<u64>, String> {
    let wrong = || format!("{text} is no range of seeds: 1..300 are the first 300");
    let (first, last) = text.split_once("..").ok_or_else(wrong)?;
    let last = last.strip_prefix('=').unwrap_or(last);
    let (first, last): (u64, u64) = (first.parse().map_err(|_| wrong())?, last.parse().map_err(|_| wrong())?);
    match last.checked_sub(first) {
        Some(more) if more < SEEDS_MAX && last < u64::MAX => Ok(first..last + 1),
        Some(_) => Err(format!("at most {SEEDS_MAX} seeds at a time")),
        None => Err(wrong()),
    }
}

fn summary(results: &Results) -> String {
    let mut lines = Lines::default();
    let Results { machine, seeds, .. } = results;
    lines.add(format_args!(
        "{machine}: {} trials (seeds {} to {}), {} faults",
        results.ours.len(),
        seeds.start,
        seeds.end - 1,
        results.faults()
    ));
    lines.add("");
    lines.add(format_args!(
        "{:<11}{:>12}{:>11}{:>9}{:>7}{:>9}{:>9}{:>9}{:>8}{:>10}",
        "rule",
        "first right",
        "precision",
        "recall",
        "rank",
        "alarms",
        "p50 s",
        "p95 s",
        "hidden",
        "hidden s"
    ));
    let live = results.live.iter();
    let live = live.flat_map(|live| [("live", &live.ours), ("as virtual", &live.in_virtual_time)]);
    for (name, trials) in results.rules().chain(live) {
        let [first, precision, recall, rank, alarms, _] = figures::ratios(trials).map(value);
        let [p50, p95] =
            figures::times(trials).map(|it| value(Figure { value: it.value.map(|ms| ms / 1000.0), ..it }));
        let sum = Figures::sum(trials);
        lines.add(format_args!(
            "{name:<11}{first:>12}{precision:>11}{recall:>9}{rank:>7}{alarms:>9}{p50:>9}{p95:>9}{:>8}{:>10.1}",
            sum.hidden,
            sum.hidden_ms as f64 / 1000.0
        ));
    }
    lines.add("");
    add_wrong(&mut lines, "ours", seeds.clone(), &results.ours);
    if let Some(Live { ours, seeds, repeated, left_out, .. }) = &results.live {
        add_wrong(&mut lines, "live", seeds.iter().copied(), ours);
        let faults = Figures::sum(ours).faults;
        lines.add(format_args!(
            "live: {} trials, {faults} faults, {repeated} runs made again, {} trials without a run that counts",
            ours.len(),
            left_out.len()
        ));
    }
    lines.add("");
    lines.add(format_args!("{:<16}{:>8}{:>10}{:>9}", "a cause explains", "hidden", "hidden s", "alarms"));
    for (ms, trials) in CURVE_MS.iter().zip(&results.curve) {
        let [.., alarms, _] = figures::ratios(trials).map(value);
        let sum = Figures::sum(trials);
        lines.add(format_args!(
            "{:<16}{:>8}{:>10.1}{alarms:>9}",
            format!("{} s", *ms as f64 / 1000.0),
            sum.hidden,
            sum.hidden_ms as f64 / 1000.0
        ));
    }
    lines.text().to_owned()
}

/// The counts that must be 0, with the seeds of the trials where they are not.
fn add_wrong(lines: &mut Lines, name: &str, seeds: impl Iterator<Item = u64>, trials: &[Figures]) {
    let sum = Figures::sum(trials);
    lines.add(format_args!(
        "{name}: {} wrong greens, {} wrong reactions, {} wrong instructions, {} hidden longer than a cause may explain",
        sum.wrong_greens, sum.wrong_reactions, sum.wrong_instructions, sum.hidden_beyond_within
    ));
    let wrong = seeds.zip(trials).filter(|(_, trial)| trial.is_wrong());
    let wrong: Vec<String> = wrong.map(|(seed, _)| seed.to_string()).collect();
    if !wrong.is_empty() {
        lines.add(format_args!("in the trials of the seeds {}", wrong.join(", ")));
    }
}

fn value(figure: Figure) -> String {
    figure.value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::learning::{Effects, Past};
    use crate::evaluate::machine::Machine as _;
    use crate::learn::learn;

    /// What two hundred trials teach, and what the same trials teach when their times are shuffled.
    fn learned(word: Word) {
        let machine = word.machine().expect("its configuration is right");
        let past = Past::of(&machine, 0, 1..201, None, 1);
        let effects = Effects::of(&machine);
        let score = effects.score(&learn(&past.part(0..200), machine.model()).learned);
        assert!(score.right == score.learned && score.reversed == 0, "{score:?}");
        assert!(score.direct * 10 >= score.learned * 9, "{score:?}");
        assert!(score.found * 5 >= score.known * 4 && score.known > 0, "{score:?}");
        let shuffled = learn(&past.shuffled(1), machine.model());
        assert_eq!((shuffled.learned, shuffled.undecided), (vec![], vec![]));
        let without = Past::of(&machine, 0, 1..201, Some(&effects.without()), 1);
        let nothing = learn(&without.part(0..200), machine.model());
        assert_eq!((nothing.learned, nothing.undecided), (vec![], vec![]));
    }

    #[test]
    fn the_shuttle_s_dependencies_are_learned_from_two_hundred_trials() {
        learned(Word::Shuttle);
    }

    #[test]
    fn the_robot_s_dependencies_are_learned_from_two_hundred_trials() {
        learned(Word::Robot);
    }
}
