//! `telltale scenario`: runs scenario files in virtual time.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use serde_json::json;

use crate::cli::junit::{self, Case, Verdict};
use crate::cli::print::{self, Lines};
use crate::cli::{EXIT_NO, EXIT_USAGE};
use crate::clock::Clock;
use crate::config;
use crate::engine::time::Timestamp;
use crate::picture::figure::{self, Panel};
use crate::sim::scenario::{self, Failure, Outcome, seconds};
use crate::sim::scenario_file::{self, Config, File};
use crate::sim::strips;
use crate::yaml::{Problem, Problems};

/// Run scenario files in virtual time and check what they expect.
///
/// The exit code is 1 where an expectation fails, and 2 where a file cannot be used.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  telltale scenario config/scenarios/*.yaml\n  \
    telltale scenario --json config/scenarios/2-sensor-outage.yaml\n  \
    telltale scenario --figure outage.svg config/scenarios/2-sensor-outage.yaml")]
pub struct Args {
    /// Print a JSON object for each file in a line of its own: failures, and every change of a state
    #[arg(long)]
    json: bool,
    /// Draw the states over time, one panel for each file
    #[arg(long, value_name = "OUT.svg")]
    figure: Option<PathBuf>,
    /// Write the result of each file to this file as JUnit's XML
    #[arg(long, value_name = "OUT.xml")]
    junit: Option<PathBuf>,
    /// The scenario files
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let mut code = 0;
    let (mut panels, mut cases) = (Vec::new(), Vec::new());
    let clock = Clock::start();
    for path in &args.files {
        let began = clock.now();
        let result = match scenario_file::load(path).and_then(|file| run_file(&file).map(|run| (file, run))) {
            Ok((file, Run { outcome, panel })) => {
                match args.json {
                    true => drop(print::json(&json(path, &file, &outcome))),
                    false => drop(print::text(&summary(path, &file, &outcome))),
                }
                panels.push(panel);
                match &outcome.failures[..] {
                    [] => Verdict::Passed,
                    [first, ..] => {
                        code = code.max(EXIT_NO);
                        Verdict::Failed(problem(first).message, summary(path, &file, &outcome))
                    }
                }
            }
            Err(problems) => {
                print::problems(&problems);
                code = EXIT_USAGE;
                Verdict::Broken(problems.to_string())
            }
        };
        let took = Duration::from_nanos(clock.now().since(began).as_nanos());
        cases.push(Case { name: path.display().to_string(), took, result });
    }
    if let Some(path) = &args.junit {
        junit::write(path, "telltale scenario", &cases)?;
    }
    if let Some(path) = args.figure.as_ref().filter(|_| code != EXIT_USAGE) {
        std::fs::write(path, figure::draw(&panels))
            .with_context(|| format!("the figure cannot be written to {}", path.display()))?;
    }
    Ok(ExitCode::from(code))
}

struct Run {
    outcome: Outcome,
    panel: Panel,
}

/// Runs a scenario with the configuration that it names.
///
/// # Errors
/// What is wrong with the configuration, or with the scenario in view of it.
fn run_file(file: &File) -> Result<Run, Problems> {
    let loaded = match &file.config {
        Config::Path(path) => config::load(path),
        Config::Inline(node) => config::of_node(file.sources.clone(), node),
    };
    let loaded = loaded.map_err(|problems| file.wrong().unwrap_or(problems))?;
    let model = match file.dependencies {
        true => loaded.model,
        // As in scenario 1 of the paper.
        false => Arc::new(loaded.model.with_dependencies(Vec::clear)),
    };
    let scenario = file.bind(&model)?;
    let outcome = scenario::run(model, &scenario);
    let panel = strips::panel(&file.name, &scenario.figure, &outcome);
    Ok(Run { outcome, panel })
}

fn summary(path: &Path, file: &File, outcome: &Outcome) -> String {
    let is_ok = outcome.failures.is_empty();
    let mut lines = Lines::default();
    lines.add(format_args!("{} {} ({})", if is_ok { "ok   " } else { "FAIL " }, file.name, path.display()));
    let mut text = lines.text().to_owned();
    if !is_ok {
        let failures = outcome.failures.iter().map(problem).collect();
        text += &Problems::new(file.sources.clone(), failures).render(false);
    }
    text
}

fn json(path: &Path, file: &File, outcome: &Outcome) -> serde_json::Value {
    let at_s = |at: Timestamp| at.as_nanos() as f64 / 1e9;
    let failures = outcome.failures.iter().map(|failure| {
        json!({
            "at_s": at_s(failure.at), "place": file.sources.place(failure.span), "subject": failure.subject,
            "expected": failure.expected, "got": failure.got, "why": failure.why,
        })
    });
    let transitions = outcome.transitions.iter().map(|change| {
        json!({
            "at_s": at_s(change.at), "node": &*change.node, "state": change.state.as_str(),
            "reason": scenario::why_word(change.why), "own": change.own.as_str(),
            "causes": change.causes.iter().map(|cause| &**cause).collect::<Vec<_>>(),
        })
    });
    json!({
        "file": path.display().to_string(), "name": file.name, "ok": outcome.failures.is_empty(),
        "failures": failures.collect::<Vec<_>>(), "transitions": transitions.collect::<Vec<_>>(),
    })
}

fn problem(failure: &Failure) -> Problem {
    let Failure { span, at, subject, expected, got, why } = failure;
    let message = format!("at {}, {subject}: expected {expected}, got {got}", seconds(*at));
    let problem = Problem::at(*span, message).label(format!("got {got}"));
    match why {
        Some(why) => problem.help(why.as_str()),
        None => problem,
    }
}

#[cfg(test)]
mod tests;
