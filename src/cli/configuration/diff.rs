//! `telltale diff`: what two configurations mean differently.

use std::io::stdin;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::bail;

use crate::cli::print::{self, say};
use crate::cli::{EXIT_NO, EXIT_USAGE, fields};
use crate::config::{self, Change, Difference, Loaded};
use crate::yaml::Problems;

/// Say what two configurations mean differently.
///
/// One line for each difference, as the page of the configuration shows it before a reload. Comments, the order of
/// keys and the division into files mean nothing. What a recording shows of it: `telltale replay --what-if`.
///
/// `--json` prints one object: `differs`, and `differences`, each with `change` (`added`, `removed` or `changed`),
/// `subject` and `detail` (empty where the subject itself was added or removed).
///
/// Exit codes: 0 where both mean the same; 1 where they differ; 2 where one has mistakes, which go to standard
/// error with their lines as those of `telltale check`.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  telltale diff /etc/telltale/shuttle.yaml new.yaml\n  \
    git show HEAD:shuttle.yaml | telltale diff - shuttle.yaml")]
pub struct Args {
    /// The old configuration; `-` reads it from standard input
    #[arg(value_name = "OLD")]
    old: PathBuf,
    /// The new configuration; `-` reads it from standard input
    #[arg(value_name = "NEW")]
    new: PathBuf,
    /// Print the differences for programs
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    definitions: fields::DefinitionFlags,
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    if is_input(&args.old) && is_input(&args.new) {
        bail!("only one of the two can be standard input");
    }
    let read = [&args.old, &args.new].map(|path| load(path, args));
    let wrong: Vec<&Problems> = read.iter().filter_map(|read| read.as_ref().err()).collect();
    wrong.iter().for_each(|problems| print::problems(problems));
    let [Ok(old), Ok(new)] = read else { return Ok(ExitCode::from(EXIT_USAGE)) };
    let differences = config::difference(&old, &new);
    match args.json {
        true => drop(print::json(&json(&differences))),
        false => differences.iter().for_each(|difference| say!("{difference}")),
    }
    Ok(if differences.is_empty() { ExitCode::SUCCESS } else { ExitCode::from(EXIT_NO) })
}

fn is_input(path: &Path) -> bool {
    path.as_os_str() == "-"
}

fn load(path: &Path, args: &Args) -> Result<Loaded, Problems> {
    let examined = match is_input(path) {
        true => config::examine_from("standard input", stdin().lock()),
        false => config::examine(path),
    };
    let definitions = args.definitions.definitions();
    fields::whole(examined, |loaded| definitions.with(&loaded.message_folders))
}

fn json(differences: &[Difference]) -> serde_json::Value {
    let one = |Difference { change, subject, detail }: &Difference| {
        let change = match change {
            Change::Added => "added",
            Change::Removed => "removed",
            Change::Changed => "changed",
        };
        serde_json::json!({ "change": change, "subject": subject, "detail": detail })
    };
    let all: Vec<_> = differences.iter().map(one).collect();
    serde_json::json!({ "differs": !all.is_empty(), "differences": all })
}
