//! `telltale incident verify`: compares recordings with their hashes in the store and in the audit log, says what is
//! damaged in them, and compares what the store says of incidents with the log.

use std::collections::BTreeSet;
use std::fs::File;
use std::io;
use std::path::Path;
use std::process::ExitCode;

use anyhow::Context as _;

use super::{EXIT_NO, hashed};
use crate::cli::check::print;
use crate::record::retention::size;
use crate::record::{file, folder, removed};
use crate::store::audit::verify_audit_in;
use crate::store::{Incident, IncidentRecords, Incidents};
use crate::yaml::plain::escaped;

/// Damages of a file that are told.
const DAMAGES_MAX: usize = 3;

/// What was found out about one incident.
enum Found {
    Whole(String),
    Unfinished,
    /// A file without an incident: nobody was told of one.
    Empty(String),
    Bad(String),
}

pub fn run(data: &Path, ids: &[u64]) -> anyhow::Result<ExitCode> {
    // The rows are read first: a hash is never in a row before it is in the log.
    let incidents = Incidents::open(data)?;
    let recordings = folder::folder_in(data);
    let is_all = ids.is_empty();
    let ids: BTreeSet<u64> = match ids {
        [] => {
            let files = folder::numbers(&recordings)
                .with_context(|| format!("the folder {} cannot be read", recordings.display()))?;
            incidents.held()?.iter().map(|it| it.id).chain(files).collect()
        }
        ids => ids.iter().copied().collect(),
    };
    let mut rows = Vec::new();
    for id in ids {
        rows.push((id, incidents.stored(id)?));
    }
    let records = incidents.records()?;
    // What was removed without a record of that has neither a row nor a file.
    let known: BTreeSet<u64> = rows.iter().map(|(id, _)| *id).collect();
    let unknown =
        records.hashes.keys().filter(|id| is_all && !known.contains(id) && !records.removed.contains(id));
    for &id in unknown {
        rows.push((id, incidents.stored(id)?));
    }
    let mut is_good = audit_is_whole(data)?;
    for (id, row) in rows {
        let mut found = check(&recordings, id, row.as_ref().map(|it| &it.incident), &records);
        if let (Found::Whole(_) | Found::Unfinished, Some(row)) = (&found, &row)
            && let Some(what) = records.contradiction(row)
        {
            found = Found::Bad(format!("in the database, {what} is not as the audit log says"));
        }
        match found {
            Found::Whole(what) => print(&format!("ok    incident {id}: {what}\n")),
            Found::Unfinished => {
                print(&format!("      incident {id} is not finished: there is no hash yet\n"))
            }
            Found::Empty(what) => print(&format!("      incident {id} never began: {what}\n")),
            Found::Bad(what) => {
                print(&format!("BAD   incident {id}: {what}\n"));
                is_good = false;
            }
        }
    }
    Ok(if is_good { ExitCode::SUCCESS } else { ExitCode::from(EXIT_NO) })
}

/// Whether the hashes in the audit log can be believed.
fn audit_is_whole(data: &Path) -> anyhow::Result<bool> {
    let verdict = verify_audit_in(data, &[], None).context("the audit log cannot be verified")?;
    match &verdict.breach {
        None => print(&format!("ok    the audit log, {} records\n", verdict.records)),
        Some(breach) => print(&format!(
            "BAD   the audit log: record {} {}; `telltale audit verify` says more\n",
            breach.number, breach.what
        )),
    }
    Ok(verdict.breach.is_none())
}

fn check(recordings: &Path, id: u64, incident: Option<&Incident>, records: &IncidentRecords) -> Found {
    let recorded = records.hashes.get(&id);
    let was_removed = records.removed.contains(&id);
    let file = match incident {
        Some(incident) => incident.summary.recording.file.clone(),
        None => folder::file_name(id),
    };
    let Some(path) = folder::path_of(recordings, &file) else {
        return Found::Bad("its row names no file".to_owned());
    };
    if path.symlink_metadata().is_ok_and(|it| !it.is_file()) {
        // To read a pipe may last for ever, and a link leads elsewhere.
        return Found::Bad(format!("{} is no file", path.display()));
    }
    let opened = File::open(&path);
    let is_missing = matches!(&opened, Err(error) if error.kind() == io::ErrorKind::NotFound);
    let (full, path) = (&path, path.display());
    match incident {
        None if is_missing && was_removed => return Found::Bad("it was removed".to_owned()),
        None if is_missing && recorded.is_some() => {
            return Found::Bad(format!("neither the store knows it, nor is {path} there"));
        }
        None if is_missing => return Found::Bad("there is no such incident".to_owned()),
        None if was_removed => {
            return Found::Bad(format!("it was removed, and {path} is there still: remove it by hand"));
        }
        None if recorded.is_none() && full.metadata().is_ok_and(|it| it.is_file() && it.len() == 0) => {
            return Found::Empty(format!("{path} is empty; the next start of the server removes it"));
        }
        Some(incident) if !incident.summary.recording.finished => {
            return match records.hash(id) {
                Some(hash) => Found::Bad(format!(
                    "the database says that it is not finished, the audit log that it was, with sha256 {hash}"
                )),
                _ => Found::Unfinished,
            };
        }
        _ => {}
    }
    let hash = opened.and_then(|mut file| hashed(&mut file, &mut io::sink()));
    let (bytes, hash) = match hash {
        Ok(hashed) => hashed,
        Err(_) if is_missing && removed::is_unrecorded(recordings, id) => {
            return Found::Bad(
                "it was removed to make room, and the audit log has no record of that yet".to_owned(),
            );
        }
        Err(_) if is_missing => return Found::Bad(format!("{path} is gone")),
        Err(error) => return Found::Bad(format!("{path} cannot be read: {error}")),
    };
    let damaged = match file::check(full) {
        Ok(damages) => told(&damages),
        Err(error) => return Found::Bad(error.to_string()),
    };
    let stored = incident.and_then(|it| it.summary.recording.sha256.as_ref());
    let wrong = |what: &str, expected: &str| {
        let damaged =
            damaged.as_ref().map(|damages| format!("; it is damaged {damages}")).unwrap_or_default();
        Found::Bad(format!(
            "{path} is not as it was recorded: {what} has sha256 {expected}, the file {hash}{damaged}"
        ))
    };
    match (stored, recorded) {
        (Some(stored), _) if *stored != hash => wrong("the store", stored),
        (_, Some(recorded)) if *recorded != hash => wrong("the audit log", recorded),
        (_, None) => Found::Bad(format!("{path} has no hash in the audit log, so nothing proves it")),
        (_, Some(_)) if let Some(damages) = damaged => {
            Found::Bad(format!("{path} is as it was recorded, but damaged {damages}"))
        }
        (None, Some(_)) if incident.is_none() => Found::Whole(format!(
            "{path}, {}, as the audit log has it; the store does not know it any more",
            size(bytes)
        )),
        _ if records.found.contains(&id) => Found::Whole(format!(
            "{path}, {}, sha256 {hash}, as it was when it was taken in; nothing proves it before that",
            size(bytes)
        )),
        _ => Found::Whole(format!("{path}, {}, sha256 {hash}", size(bytes))),
    }
}

/// What is damaged; `None` if nothing is.
fn told(damages: &[String]) -> Option<String> {
    let named = damages.iter().take(DAMAGES_MAX).map(|it| escaped(it).into_owned());
    let mut told = named.collect::<Vec<_>>().join("; ");
    let more = damages.len().saturating_sub(DAMAGES_MAX);
    if more > 0 {
        told += &format!("; and in {more} other places");
    }
    (!damages.is_empty()).then_some(told)
}
