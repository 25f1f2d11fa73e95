//! `telltale incident verify`: compares recordings with their hashes in the store and in the audit log, says what is
//! damaged in them, and compares what the store says of incidents with the log.

use std::collections::BTreeSet;
use std::fs::File;
use std::io;
use std::path::Path;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::Context as _;

use super::EXIT_NO;
use crate::cli::print::say;
use crate::cli::process::data_folder;
use crate::record::retention::size;
use crate::record::writer::copy_hashed;
use crate::record::{file, folder, removed};
use crate::store::audit::verify_audit_in;
use crate::store::{Incident, IncidentRecords, Incidents, StoreError, StoredIncident};

/// Damages of a file that are told.
const DAMAGES_MAX: usize = 3;

/// Beside a server, what is wrong is looked at so often again, each time after a while.
const LOOKS: usize = 20;
const LOOK_AGAIN_AFTER: Duration = Duration::from_millis(250);

/// What was found out about one incident.
#[cfg_attr(test, derive(Debug, PartialEq))]
enum Found {
    Whole(String),
    Unfinished,
    /// A file without an incident: nobody was told of one.
    Empty(String),
    /// Its removal is in the audit log.
    Removed,
    Bad(String),
}

pub fn run(data: &Path, ids: &[u64]) -> anyhow::Result<ExitCode> {
    let incidents = Incidents::open(data)?;
    let is_served = data_folder::is_locked(data).unwrap_or(false);
    let look = |ids: &[u64]| look(&incidents, data, ids, is_served);
    let first = look(ids)?;
    let found = match is_served {
        true => settled(first, LOOKS, |suspects| {
            std::thread::sleep(LOOK_AGAIN_AFTER);
            look(suspects)
        })?,
        false => first,
    };
    let mut is_good = audit_is_whole(data)?;
    for (id, found) in found {
        match found {
            Found::Whole(what) => say!("ok    incident {id}: {what}"),
            Found::Unfinished => say!("      incident {id} is not finished: there is no hash yet"),
            Found::Empty(what) => say!("      incident {id} never began: {what}"),
            // One that was named is looked for in vain.
            Found::Removed if ids.is_empty() => {}
            Found::Removed => {
                say!("BAD   incident {id}: it was removed");
                is_good = false;
            }
            Found::Bad(what) => {
                say!("BAD   incident {id}: {what}");
                is_good = false;
            }
        }
    }
    Ok(if is_good { ExitCode::SUCCESS } else { ExitCode::from(EXIT_NO) })
}

/// What was found in the end: a server writes files, rows and records one after the other, so what is wrong beside one
/// counts only if it stays wrong.
fn settled(
    mut found: Vec<(u64, Found)>,
    looks: usize,
    mut look: impl FnMut(&[u64]) -> anyhow::Result<Vec<(u64, Found)>>,
) -> anyhow::Result<Vec<(u64, Found)>> {
    for _ in 0..looks {
        let is_bad = |(_, found): &&(u64, Found)| matches!(found, Found::Bad(_));
        let suspects: Vec<u64> = found.iter().filter(is_bad).map(|(id, _)| *id).collect();
        if suspects.is_empty() {
            break;
        }
        let again = look(&suspects)?;
        found.retain(|it| !is_bad(&it));
        found.extend(again);
        found.sort_by_key(|(id, _)| *id);
    }
    Ok(found)
}

/// Looks at these incidents, or at all. `is_served`: a server writes meanwhile.
fn look(
    incidents: &Incidents,
    data: &Path,
    ids: &[u64],
    is_served: bool,
) -> anyhow::Result<Vec<(u64, Found)>> {
    let recordings = folder::folder_in(data);
    let is_all = ids.is_empty();
    let mut ids: BTreeSet<u64> = ids.iter().copied().collect();
    if is_all {
        let files = folder::numbers(&recordings)
            .with_context(|| format!("the folder {} cannot be read", recordings.display()))?;
        ids.extend(files);
    }
    let (rows, records) = incidents.at_once(|| {
        let records = incidents.records()?;
        if is_all {
            ids.extend(incidents.held()?.iter().map(|it| it.id));
            // What was removed without a record of that has neither a row nor a file.
            ids.extend(records.held());
        }
        let rows = ids.iter().map(|&id| Ok((id, incidents.stored(id)?)));
        Ok((rows.collect::<Result<Vec<_>, StoreError>>()?, records))
    })?;
    let one = |(id, row): (u64, Option<StoredIncident>)| {
        let found = check(&recordings, id, row.as_ref().map(|it| &it.incident), &records, is_served);
        let contradiction = row.as_ref().and_then(|row| records.contradiction(row));
        match (found, contradiction) {
            (Found::Whole(_) | Found::Unfinished, Some(what)) => {
                (id, Found::Bad(format!("in the database, {what} is not as the audit log says")))
            }
            (found, _) => (id, found),
        }
    };
    Ok(rows.into_iter().map(one).collect())
}

/// Whether the hashes in the audit log can be believed.
fn audit_is_whole(data: &Path) -> anyhow::Result<bool> {
    let verdict = verify_audit_in(data, &[], None).context("the audit log cannot be verified")?;
    match &verdict.breach {
        None => say!("ok    the audit log, {} records", verdict.records),
        Some(breach) => say!(
            "BAD   the audit log: record {} {}; `telltale audit verify` says more",
            breach.number,
            breach.what
        ),
    }
    Ok(verdict.breach.is_none())
}

fn check(
    recordings: &Path,
    id: u64,
    incident: Option<&Incident>,
    records: &IncidentRecords,
    is_served: bool,
) -> Found {
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
        None if is_missing && was_removed => return Found::Removed,
        None if is_missing && records.held().any(|held| held == id) => {
            return Found::Bad(format!(
                "the audit log names it, but neither the store knows it, nor is {path} there"
            ));
        }
        None if is_missing => return Found::Bad("there is no such incident".to_owned()),
        None if was_removed => {
            return Found::Bad(format!("it was removed, and {path} is there still: remove it by hand"));
        }
        None if recorded.is_none() && full.metadata().is_ok_and(|it| it.is_file() && it.len() == 0) => {
            return Found::Empty(format!("{path} is empty; the next start of the server removes it"));
        }
        // Its row comes when its first piece is on the disk.
        None if is_served
            && recorded.is_none()
            && file::Reader::open(full).is_ok_and(|reader| !reader.is_complete()) =>
        {
            return Found::Unfinished;
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
    let hash = opened.and_then(|mut file| copy_hashed(&mut file, &mut io::sink()));
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
        _ if incident.is_some_and(|it| it.summary.recording.interrupted) => Found::Whole(format!(
            "{path}, {}, sha256 {hash}, as it was when the server started again after the interruption; nothing proves \
             it before that",
            size(bytes)
        )),
        _ => Found::Whole(format!("{path}, {}, sha256 {hash}", size(bytes))),
    }
}

/// What is damaged; `None` if nothing is.
fn told(damages: &[String]) -> Option<String> {
    let named = damages.iter().take(DAMAGES_MAX).cloned();
    let mut told = named.collect::<Vec<_>>().join("; ");
    let more = damages.len().saturating_sub(DAMAGES_MAX);
    if more > 0 {
        told += &format!("; and in {more} other places");
    }
    (!damages.is_empty()).then_some(told)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::clock::Clock;
    use crate::store::{DemoSecrets, Store};

    fn bad() -> Found {
        Found::Bad("it has no hash".to_owned())
    }

    #[tokio::test]
    async fn beside_a_server_a_recording_that_has_just_begun_is_not_accused() {
        let temporary = tempfile::tempdir().unwrap();
        let data = temporary.path();
        Store::open(data, Clock::start(), DemoSecrets::Refused).unwrap().close().await;
        let recordings = folder::folder_in(data);
        std::fs::create_dir(&recordings).unwrap();
        let incidents = Incidents::open(data).unwrap();
        let look = |is_served| look(&incidents, data, &[], is_served).unwrap().pop();
        let mut begun =
            file::IncidentFile::create(&recordings.join(folder::file_name(1)), BTreeMap::new()).unwrap();
        begun.sync().unwrap();
        assert_eq!(look(true), Some((1, Found::Unfinished)), "its row comes next");
        assert!(matches!(look(false), Some((1, Found::Bad(_)))), "nobody goes on with it");
        begun.finish().unwrap();
        assert!(matches!(look(true), Some((1, Found::Bad(_)))), "it is whole, and nobody recorded it");
    }

    #[test]
    fn what_a_server_writes_meanwhile_is_not_accused_and_what_stays_wrong_is() {
        let first = || vec![(1, Found::Whole(String::new())), (2, bad()), (3, bad()), (4, bad())];
        let mut asked = Vec::new();
        let found = settled(first(), 3, |suspects| {
            asked.push(suspects.to_vec());
            let now = |&id: &u64| match id {
                2 if asked.len() == 2 => (2, Found::Whole("now".to_owned())),
                4 => (4, Found::Removed),
                id => (id, bad()),
            };
            Ok(suspects.iter().map(now).collect())
        });
        let whole = |what: &str| Found::Whole(what.to_owned());
        assert_eq!(found.unwrap(), [(1, whole("")), (2, whole("now")), (3, bad()), (4, Found::Removed)]);
        assert_eq!(asked, [vec![2, 3, 4], vec![2, 3], vec![3]]);
    }
}
