//! Recordings that an earlier run left behind: interrupted ones are completed, those that the store does not know
//! are taken in.

use std::io;
use std::path::Path;

use tokio::task;

use crate::record::file::{FileError, repair};
use crate::record::note_file::Beside;
use crate::record::proof::NO_HASH;
use crate::record::retention::{INCIDENTS_MAX, Policy};
use crate::record::room::Disk;
use crate::record::summary::Summary;
use crate::record::writer::hash_file;
use crate::record::{folder, found, note_file};
use crate::store::audit::{Action, Record, TELLTALE};
use crate::store::{IncidentRecords, Store};

/// Completes the files of incidents that the end of an earlier run, or a fault of the disk, interrupted. One whose file
/// is gone is marked so, and is looked at again only if its file is back. `is_left`: those that are still written. What
/// the audit log contradicts is evidence, and is left as it is. One whose copy has no room waits for it.
pub async fn make_whole(store: &Store, folder: &Path, policy: &Policy, is_left: impl Fn(&Summary) -> bool) {
    // Without the folder, nothing tells whether a file is gone.
    if let Err(error) = std::fs::read_dir(folder) {
        return tracing::error!(%error, "interrupted incidents are not looked for");
    }
    let unfinished = match store.unfinished_incidents().await {
        Ok(unfinished) => unfinished,
        Err(error) => return tracing::error!(%error, "interrupted incidents are not looked for"),
    };
    if unfinished.is_empty() {
        return;
    }
    let records = match store.incident_records().await {
        Ok(records) => records,
        Err(error) => return tracing::error!(%error, "interrupted incidents are not looked for"),
    };
    for summary in unfinished {
        let id = summary.id;
        if is_left(&summary) {
            continue;
        }
        let Ok(Some(row)) = store.stored_incident(id).await else { continue };
        if records.hash(id).is_some() || records.contradiction(&row).is_some() {
            tracing::error!(
                "what the database says of incident {id} is not as the audit log says: it is left as it is. \
                 `telltale incident verify {id}` says more"
            );
            continue;
        }
        let Some(path) = folder::path_of(folder, &summary.recording.file) else { continue };
        // Until it is whole there are two of it.
        let bytes = path.metadata().map_or(0, |meta| meta.len());
        if Disk::of(folder).is_ok_and(|disk| !disk.has_room_for(bytes, policy)) {
            tracing::warn!("there is no room yet to complete the recording of incident {id}");
            continue;
        }
        let whole = task::spawn_blocking(move || whole(summary, &path)).await;
        let Ok(Some(summary)) = whole else { continue };
        if let Err(error) = store.incident_finished(&summary).await {
            tracing::error!(%error, "an interrupted incident stays open in the database");
        }
    }
}

/// The summary of an incident whose file is made whole, or will not be. `None`: nothing is new.
fn whole(mut summary: Summary, path: &Path) -> Option<Summary> {
    let id = summary.id;
    let recording = &mut summary.recording;
    let was_interrupted = std::mem::replace(&mut recording.interrupted, true);
    match complete(path) {
        Ok((bytes, sha256)) => {
            (recording.finished, recording.gone) = (true, false);
            (recording.bytes, recording.sha256) = (bytes, Some(sha256));
            // What the row lacks, the file tells: it ended where its last message is.
            if let Ok(Some(found)) = found::summary(path, id) {
                recording.messages = found.recording.messages;
                recording.missing = recording.missing.max(found.recording.missing);
                summary.until_ms = summary.until_ms.or(found.until_ms);
            }
        }
        Err(error) if is_missing(&error) && recording.gone => return None,
        Err(error) if is_missing(&error) => {
            tracing::error!("the recording of incident {id} is gone: {} is missing", path.display());
            (recording.finished, recording.gone) = (true, true);
            (recording.bytes, recording.sha256) = (0, None);
        }
        Err(error) => {
            tracing::error!(%error, "the file of an interrupted incident cannot be completed");
            if was_interrupted {
                return None;
            }
        }
    }
    Some(summary)
}

fn is_missing(error: &FileError) -> bool {
    error.kind() == Some(io::ErrorKind::NotFound)
}

/// Completes a file. Returns its bytes and its hash.
fn complete(path: &Path) -> Result<(u64, String), FileError> {
    let failed = |why| FileError::Io { path: path.to_owned(), doing: "completed", why };
    // Another kind of file may have no end.
    let meta = std::fs::symlink_metadata(path).map_err(failed)?;
    if !meta.is_file() {
        return Err(FileError::Format { path: path.to_owned(), why: "it is no file".to_owned() });
    }
    repair(path)?;
    let bytes = std::fs::metadata(path).map_err(failed)?.len();
    Ok((bytes, hash_file(path).map_err(failed)?))
}

/// Takes in the recordings of these numbers that the store does not know: its database was lost, or is an older
/// copy. From then on they are listed, counted and removed as all others. A file that contradicts the audit log, or
/// is no recording, is left as it is. An empty one that no record names is removed: its incident never began.
pub async fn take_in(store: &Store, folder: &Path, files: Vec<u64>) {
    let unknown = match store.unknown_incidents(files).await {
        Ok(unknown) => unknown,
        Err(error) => return tracing::error!(%error, "recordings without an incident are not looked for"),
    };
    if unknown.is_empty() {
        return;
    }
    let records = match store.incident_records().await {
        Ok(records) => records,
        Err(error) => return tracing::error!(%error, "recordings without an incident are not taken in"),
    };
    // The newest first: the oldest may be too many.
    for id in unknown.into_iter().rev().take(INCIDENTS_MAX) {
        let recorded = records.hashes.get(&id).cloned();
        let path = folder.join(folder::file_name(id));
        let summary = task::spawn_blocking(move || unknown_summary(id, &path, recorded)).await;
        let Ok(Some(summary)) = summary else { continue };
        match store.incident_found(&summary).await {
            Ok(()) => {
                tracing::warn!("the recording of incident {id} was not in the database, and is again");
                take_beside(store, folder, &summary, &records).await;
            }
            Err(error) => return tracing::error!(%error, "recordings without an incident are not taken in"),
        }
    }
}

/// Takes over what people said of an incident, from the file beside its recording.
async fn take_beside(store: &Store, folder: &Path, summary: &Summary, records: &IncidentRecords) {
    let (folder, id) = (folder.to_owned(), summary.id);
    let said = task::spawn_blocking(move || note_file::read(&folder, id)).await;
    let Ok(Some(Beside { note, kept })) = said else { return };
    let taken = async {
        match note {
            Some(note) if records.may_be_note(id, &note) => store.incident_note_found(id, note).await?,
            Some(_) => {
                tracing::warn!(
                    "the note beside incident {id} is not the one of the audit log, and is left out"
                );
            }
            None => {}
        }
        match records.kept(id, kept) {
            // A mark keeps it already.
            Some(kept) if kept != summary.is_marked() => {
                store.keep_incident(id, kept, Record::of(Action::IncidentKept, TELLTALE)).await
            }
            _ => Ok(()),
        }
    };
    if let Err(error) = taken.await {
        tracing::error!(%error, "what people said of incident {id} is not taken in");
    }
}

/// The summary of an incident that left only its file. `recorded`: what the audit log has in place of its hash.
fn unknown_summary(id: u64, path: &Path, recorded: Option<String>) -> Option<Summary> {
    let left = |why: &dyn std::fmt::Display| {
        tracing::warn!("{} belongs to no incident and is left as it is: {why}", path.display());
    };
    let Some(meta) = std::fs::symlink_metadata(path).ok().filter(std::fs::Metadata::is_file) else {
        left(&"it is no file");
        return None;
    };
    if meta.len() == 0 && recorded.is_none() {
        match std::fs::remove_file(path) {
            Ok(()) => tracing::warn!(
                "{} was empty and is removed: the program ended before its recording began",
                path.display()
            ),
            Err(error) => left(&format_args!("it is empty and cannot be removed: {error}")),
        }
        return None;
    }
    // Evidence: what the log contradicts is not even completed.
    if let Some(recorded) = recorded.filter(|hash| hash != NO_HASH)
        && hash_file(path).ok().as_ref() != Some(&recorded)
    {
        left(&"it is not as the audit log says");
        return None;
    }
    let found = found::summary(path, id).and_then(|found| match found {
        Some(summary) => Ok(Some((summary, complete(path)?))),
        None => Ok(None),
    });
    match found {
        Ok(Some((mut summary, (bytes, sha256)))) => {
            let recording = &mut summary.recording;
            (recording.finished, recording.bytes, recording.sha256) = (true, bytes, Some(sha256));
            Some(summary)
        }
        Ok(None) => {
            left(&"it is no recording of Telltale");
            None
        }
        Err(error) => {
            left(&error);
            None
        }
    }
}

#[cfg(test)]
mod tests;
