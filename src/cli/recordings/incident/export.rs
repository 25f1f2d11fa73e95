//! `telltale incident export`: copies a recording, or writes a report of an incident.

use std::fs::File;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;

use super::{EXIT_NO, now_ms};
use crate::cli::print::{note, say};
use crate::cli::process::new_file::create;
use crate::record::folder;
use crate::record::proof::{Expected, Proof, compare};
use crate::record::retention::size;
use crate::record::writer::copy_hashed;
use crate::store::{Incident, Incidents, Logged, StoreError};
use crate::web::developer::incidents::report::report;
use crate::web::incidents::{Read, read};
use crate::web::texts::Lang;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[arg(value_name = "ID")]
    id: u64,
    /// Where to copy the recording; no file there is overwritten [default: incident-ID.mcap in this folder]
    #[arg(long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Write the report here, and copy the recording only with --output; no file there is overwritten
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

pub fn run(data: &Path, args: &Args) -> anyhow::Result<ExitCode> {
    let incidents = Incidents::open(data)?;
    let incident = incidents.one(args.id)?.ok_or(StoreError::NoSuchIncident(args.id))?;
    let expected = Logged::expected(incidents.logged(args.id)?, &incident.summary);
    let mut is_good = true;
    if let Some(output) = &args.report {
        is_good &= write_report(data, &incident, &expected, output)?;
    }
    if args.report.is_none() || args.output.is_some() {
        let output = args.output.clone().unwrap_or_else(|| PathBuf::from(folder::file_name(args.id)));
        is_good &= copy(data, &incident, &expected, &output)?;
    }
    Ok(if is_good { ExitCode::SUCCESS } else { ExitCode::from(EXIT_NO) })
}

/// Writes the report. Returns whether all of it could be read, and was as it was recorded.
fn write_report(
    data: &Path,
    incident: &Incident,
    expected: &Expected,
    output: &Path,
) -> anyhow::Result<bool> {
    let recordings = folder::folder_in(data);
    let told = read(&recordings, &incident.summary);
    let path = folder::file_in(&recordings, &incident.summary.recording.file);
    let proof = path.map_or(Proof::None, |path| compare(&path, expected, u64::MAX));
    let document = report(Lang::En, incident, (&told, &proof), now_ms());
    let mut to = create(output, "the report cannot be written to", "--report")?;
    to.write_all(document.as_bytes())
        .and_then(|()| to.sync_all())
        .with_context(|| format!("the report cannot be written to {}", output.display()))?;
    say!("{}, {}", output.display(), size(document.len() as u64));
    let id = incident.summary.id;
    let lacks = match &told {
        Read::Told(_) => None,
        Read::Bad(why) => Some(format!("cannot be read: {why}")),
        Read::Missing | Read::Busy => Some("is gone".to_owned()),
    };
    if let Some(lacks) = &lacks {
        note!("telltale: the recording of incident {id} {lacks}. The report has what the database knows");
    }
    if let Proof::Other(hash) = &proof {
        note!("telltale: the recording is not as it was recorded, which the report says: its hash is {hash}");
    }
    if proof == Proof::OtherRow {
        note!(
            "telltale: what the database says of incident {id} is not as it was recorded, which the report says"
        );
    }
    tell_open(incident);
    Ok(lacks.is_none() && proof.is_as_recorded() != Some(false))
}

/// Copies the recording. Returns whether it is as it was recorded.
fn copy(data: &Path, incident: &Incident, expected: &Expected, output: &Path) -> anyhow::Result<bool> {
    let Some((path, mut from)) = open_recording(data, incident) else { return Ok(false) };
    let mut to = create(output, "the recording cannot be copied to", "--output")?;
    let (bytes, hash) = copy_hashed(&mut from, &mut to)
        .and_then(|copied| to.sync_all().map(|()| copied))
        .with_context(|| format!("{} cannot be copied to {}", path.display(), output.display()))?;
    say!("{}, {}", output.display(), size(bytes));
    say!("sha256 {hash}");
    tell_open(incident);
    let known = [&expected.stored, &expected.logged].into_iter().flatten();
    if let Some(recorded) = known.into_iter().find(|it| **it != hash) {
        note!("telltale: the file is not as it was recorded: its hash was {recorded}");
        return Ok(false);
    }
    Ok(true)
}

fn tell_open(incident: &Incident) {
    if incident.summary.recording.sha256.is_none() {
        let id = incident.summary.id;
        note!("telltale: incident {id} is not finished: this is what is written of it by now");
    }
}

/// Opens the recording of an incident, and says so if there is none.
fn open_recording(data: &Path, incident: &Incident) -> Option<(PathBuf, File)> {
    let (id, file) = (incident.summary.id, &incident.summary.recording.file);
    let Some(path) = folder::path_of(&folder::folder_in(data), file) else {
        note!("telltale: incident {id} has no recording");
        return None;
    };
    if path.symlink_metadata().is_ok_and(|it| !it.is_file()) {
        note!("telltale: the recording {} of incident {id} is no file", path.display());
        return None;
    }
    match File::open(&path) {
        Ok(open) => Some((path, open)),
        Err(error) => {
            note!("telltale: the recording {} of incident {id} cannot be read: {error}", path.display());
            None
        }
    }
}
