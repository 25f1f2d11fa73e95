//! `telltale init --update`: adds to a configuration the statuses, topics and nodes that were heard and that nothing in
//! it watches.

use std::fs::{self, OpenOptions};
use std::io::Write as _;
use std::path::Path;
use std::process::ExitCode;

use anyhow::{Context as _, bail};

use super::{Args, listen, refusal, write};
use crate::cli::print::{self, note};
use crate::cli::{EXIT_NO, fields};
use crate::clock::Clock;
use crate::config;
use crate::config::describe::words::counted;
use crate::msg::fields::Definitions;
use crate::onboarding::live;
use crate::onboarding::update::{self, Updated};
use crate::yaml::Problems;

/// The mark at the beginning of a file that some editors write.
const MARK: &str = "\u{feff}";

pub fn run(args: &Args, file: &Path) -> anyhow::Result<ExitCode> {
    let in_place = args.output.as_deref().is_some_and(|output| is_same(output, file));
    if let Some(output) = args.output.as_deref().filter(|output| !in_place && output.exists()) {
        return Err(refusal(output));
    }
    let mut options = args.dds.resolve()?;
    // As `check` and `serve` read the file, which know nothing of the flags here.
    let definitions = |loaded: &config::Loaded| Definitions::default().with(&loaded.message_folders);
    let loaded = match fields::whole(config::examine(file), definitions) {
        Ok(loaded) => loaded,
        Err(problems) => {
            print::problems(&problems);
            bail!("{} is not a configuration that can be updated", file.display());
        }
    };
    options.definitions = options.definitions.with(&loaded.message_folders);
    let heard = listen(options, args.length, Some(loaded.model.watched.diagnostics.clone()))?;
    let comparison = live::compare(&loaded, &heard);
    if !comparison.problems.is_empty() {
        print::problems(&Problems::new(loaded.sources().clone(), comparison.problems));
        if comparison.absent > 0 {
            note!("Names that were not found stay in the file.");
        }
    }
    if comparison.nobody {
        bail!("nobody was heard, so nothing is written");
    }
    let known = definitions(&loaded);
    let is_known = |type_name: &str| known.knows(type_name, false);
    let at = humantime::format_rfc3339_seconds(Clock::start().wall());
    let when = format!("heard in the {} s before {at}", heard.length_s());
    let updated = update::update(&loaded, heard.draft, &comparison.unwatched, is_known, &when)?;
    tell(&updated);
    if let Some(unsteady) = comparison.unwatched.sentence_of_unsteady() {
        note!("Not watched: {unsteady}");
    }
    let bytes = fs::read(file).with_context(|| format!("{} cannot be read", file.display()))?;
    let mark = if bytes.starts_with(MARK.as_bytes()) { MARK } else { "" };
    if bytes[mark.len()..] != *loaded.sources().text(0).as_bytes() {
        bail!("{} was changed meanwhile, so nothing is written", file.display());
    }
    let text = format!("{mark}{}", updated.text);
    match &args.output {
        None => drop(print::text(&text)),
        Some(_) if in_place && updated.modules.is_empty() => {}
        Some(_) if in_place => replace(file, &text)?,
        Some(output) => write(output, &text)?,
    }
    Ok(ExitCode::from(if comparison.absent > 0 { EXIT_NO } else { 0 }))
}

fn is_same(one: &Path, other: &Path) -> bool {
    matches!((one.canonicalize(), other.canonicalize()), (Ok(one), Ok(other)) if one == other)
}

/// Replaces a file at once, with its permissions: a reader sees the old text or the new one.
fn replace(file: &Path, text: &str) -> anyhow::Result<()> {
    let failed = || format!("{} cannot be replaced", file.display());
    let file = file.canonicalize().with_context(failed)?;
    let permissions = fs::metadata(&file).with_context(failed)?.permissions();
    let mut name = file.file_name().unwrap_or_default().to_owned();
    name.push(".new");
    let new = file.with_file_name(name);
    let mut opened = OpenOptions::new().write(true).create_new(true).open(&new).with_context(|| {
        format!("{} cannot be written beside it; is there one from before?", new.display())
    })?;
    let written = opened
        .write_all(text.as_bytes())
        .and_then(|()| opened.set_permissions(permissions))
        .and_then(|()| opened.sync_all())
        .and_then(|()| fs::rename(&new, &file));
    if written.is_err() {
        let _ = fs::remove_file(&new);
    }
    written.with_context(failed)
}

fn tell(updated: &Updated) {
    let Updated { modules, groups, left, .. } = updated;
    match (modules.len(), groups.len()) {
        (0, 0) => note!("Nothing new was heard."),
        (added, 0) => note!("Added {}.", counted(added, "module")),
        (added, made) => note!("Added {}, in {}.", counted(added, "module"), counted(made, "new group")),
    }
    for left in left {
        note!("Not added: {left}.");
    }
}
