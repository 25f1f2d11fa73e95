//! `telltale learn`: proposes changes of the dependencies from what failed with what in the history.

mod told;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context as _, bail};

use crate::cli::EXIT_NO;
use crate::cli::fields;
use crate::cli::learned;
use crate::cli::print::{self, note};
use crate::cli::process::data_folder::DataFolder;
use crate::config::{self, Loaded};
use crate::learn::{Proposals, learn};
use crate::msg::fields::Definitions;
use crate::record::folder;
use crate::replay::Recording;
use crate::store::{Incident, IncidentFilter, Incidents, reported_in};

/// Propose dependencies from what failed with what in the history
///
/// It looks for modules that fail whenever another one fails, for dependencies with a cause that fails without an effect, and for
/// modules that are silent in some stages or while a signal has a value. Each proposal has its counterexamples beside it. It reads the data folder and changes nothing, also while `serve` writes.
/// A proposal is never in force by itself: `-o` writes the configuration with all changes of dependencies, to read it, `check` it, and try
/// it on kept incidents with `replay --what-if`.
///
/// Exit codes: 0; 1 where nothing is recorded.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:\n  telltale learn --data /var/lib/telltale\n  \
    telltale learn --data /var/lib/telltale --config shuttle.yaml -o proposed.yaml\n  \
    telltale replay --data /var/lib/telltale --what-if proposed.yaml")]
pub struct Args {
    #[command(flatten)]
    data: DataFolder,
    /// The configuration that the proposals are for [default: the one in the newest recording of an incident]
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Write the configuration with the proposals into this file
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

pub fn run(args: &Args) -> anyhow::Result<ExitCode> {
    if let Some(output) = args.output.as_deref().filter(|output| output.exists()) {
        bail!("{} exists already: name another file", output.display());
    }
    let folder = args.data.path()?;
    let incidents = Incidents::open(&folder)?.all(IncidentFilter::default())?;
    let loaded = match &args.config {
        Some(path) => {
            let definitions = |loaded: &Loaded| Definitions::default().with(&loaded.message_folders);
            fields::whole(config::examine(path), definitions)?
        }
        None => recorded(&folder, &incidents)?,
    };
    let (modules, signals) = learned::names(&loaded)?;
    let reported = reported_in(&folder, &modules, &signals).context("the history cannot be read")?;
    let Some(history) = learned::history(reported) else {
        note!("telltale: the history has nothing of the modules of this configuration");
        return Ok(ExitCode::from(EXIT_NO));
    };
    let proposals = learn(&history, &loaded.model);
    print::text(told::told(&loaded.model, &history, &proposals, &incidents).text());
    if let Some(output) = &args.output {
        write(output, &loaded, &proposals)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The configuration in the newest recording that has one.
fn recorded(folder: &Path, incidents: &[Incident]) -> anyhow::Result<Loaded> {
    let recordings = folder::folder_in(folder);
    let paths = incidents.iter().filter_map(|it| folder::path_of(&recordings, &it.summary.recording.file));
    let mut opened = paths.filter_map(|path| Recording::open(&path).ok());
    let loaded = opened.find_map(|recording| recording.facts().recorded().ok());
    loaded.context("no incident is recorded that has a configuration: name one with --config")
}

/// Writes the configuration with the proposals, if it means these and nothing else.
fn write(output: &Path, loaded: &Loaded, proposals: &Proposals) -> anyhow::Result<()> {
    let Some(edited) = learned::edited(loaded, proposals) else {
        note!("No dependency is to be changed, so nothing is written.");
        return Ok(());
    };
    for node in &edited.left {
        note!("Not written, to be changed by hand: the dependencies of {node}.");
    }
    std::fs::write(output, &edited.text)
        .with_context(|| format!("{} cannot be written", output.display()))?;
    note!("Written to {}. `telltale check` accepts it.", output.display());
    Ok(())
}
