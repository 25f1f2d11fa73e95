//! Recordings that an earlier run left behind: interrupted ones are completed, those that the store does not know
//! are taken in.

use std::io;
use std::path::Path;

use tokio::task;

use crate::record::beside::Beside;
use crate::record::file::{FileError, repair};
use crate::record::proof::NO_HASH;
use crate::record::retention::INCIDENTS_MAX;
use crate::record::summary::Summary;
use crate::record::writer::hash_file;
use crate::record::{beside, folder, found};
use crate::store::Store;
use crate::store::audit::{Action, Record, TELLTALE};

/// Completes the files of incidents that the end of an earlier run interrupted. One whose file is gone is marked so,
/// and is looked at again only if its file is back.
pub async fn make_whole(store: &Store, folder: &Path) {
    // Without the folder, nothing tells whether a file is gone.
    if let Err(error) = std::fs::read_dir(folder) {
        return tracing::error!(%error, "interrupted incidents are not looked for");
    }
    let unfinished = match store.unfinished_incidents().await {
        Ok(unfinished) => unfinished,
        Err(error) => return tracing::error!(%error, "interrupted incidents are not looked for"),
    };
    for summary in unfinished {
        let Some(path) = folder::path_of(folder, &summary.recording.file) else { continue };
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
                take_beside(store, folder, &summary).await;
            }
            Err(error) => return tracing::error!(%error, "recordings without an incident are not taken in"),
        }
    }
}

/// Takes over what people said of an incident, from the file beside its recording.
async fn take_beside(store: &Store, folder: &Path, summary: &Summary) {
    let (folder, id) = (folder.to_owned(), summary.id);
    let said = task::spawn_blocking(move || beside::read(&folder, id)).await;
    let Ok(Some(Beside { note, kept })) = said else { return };
    let taken = async {
        if let Some(note) = note {
            store.incident_note_found(id, note).await?;
        }
        match kept {
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
mod tests {
    use std::collections::BTreeMap;
    use std::path::PathBuf;

    use serde_json::json;

    use super::*;
    use crate::clock::Clock;
    use crate::record::file::{IncidentFile, TRANSITIONS, check};
    use crate::record::folder::{file_name, folder_in};
    use crate::record::retention::{Policy, surplus};
    use crate::record::summary::Recording;
    use crate::store::{DemoSecrets, Incident, IncidentFilter, Note, TestFolder};

    struct Place {
        data: TestFolder,
        folder: PathBuf,
    }

    impl Place {
        fn new(name: &str) -> Place {
            let data = TestFolder::new(name);
            let folder = folder_in(&data);
            std::fs::create_dir_all(&folder).unwrap();
            Place { data, folder }
        }

        fn store(&self) -> Store {
            Store::open(&self.data, Clock::start(), DemoSecrets::Refused).unwrap()
        }

        fn path(&self, id: u64) -> PathBuf {
            self.folder.join(file_name(id))
        }

        /// A recording with an alarm, completed or not.
        fn record(&self, id: u64, is_over: bool) {
            let about = BTreeMap::from([("vehicle".to_owned(), "shuttle-1".to_owned())]);
            let mut file = IncidentFile::create(&self.path(id), about).unwrap();
            let at_ms = 1_790_000_000_000 + id;
            let alarm = json!({ "at_ms": at_ms, "kind": "alarm_raised", "alarm": 4, "node": "a/b" });
            file.json(&TRANSITIONS, at_ms * 1_000_000, &alarm).unwrap();
            file.end_chunk().unwrap();
            if is_over {
                file.finish().unwrap();
            }
        }

        /// As at a start.
        async fn start(&self, store: &Store) {
            make_whole(store, &self.folder).await;
            take_in(store, &self.folder, folder::numbers(&self.folder).unwrap()).await;
        }
    }

    async fn known(store: &Store) -> Vec<(u64, Recording)> {
        let all = store.incidents(IncidentFilter::default()).await.unwrap();
        all.into_iter().map(|it| (it.summary.id, it.summary.recording)).collect()
    }

    async fn told(store: &Store) -> Vec<(String, String)> {
        let log = store.audit_entries(None, 100).await.unwrap();
        let ours = log.into_iter().rev().filter(|it| it.action.starts_with("incident"));
        ours.map(|it| (it.action, it.target)).collect()
    }

    #[tokio::test]
    async fn a_recording_that_the_store_lost_is_listed_counted_and_removed_again() {
        let place = Place::new("left-over-lost");
        place.record(3, true);
        let note = Note { text: "brake squeals".into(), by: "dora".into(), at_ms: 5 };
        let said = Beside { note: Some(note.clone()), kept: Some(true) };
        beside::write(&place.folder, 3, &said).unwrap();
        place.record(5, false);
        std::fs::write(place.path(6), "no recording").unwrap();
        std::fs::create_dir(place.path(7)).unwrap();
        std::fs::write(place.path(8), []).unwrap();
        let store = place.store();
        place.start(&store).await;
        let all = store.incidents(IncidentFilter::default()).await.unwrap();
        let ids: Vec<u64> = all.iter().map(|it| it.summary.id).collect();
        assert_eq!(ids, [5, 3]);
        let said = |it: &Incident| (it.note.clone(), it.kept);
        assert_eq!((said(&all[0]), said(&all[1])), ((None, false), (Some(note), true)));
        let Summary { since_ms, roots, vehicle, recording, .. } = &all[0].summary;
        assert_eq!((*since_ms, &**vehicle), (1_790_000_000_005, "shuttle-1"));
        assert_eq!(*roots, ["a/b"]);
        assert!(recording.finished && recording.interrupted && !all[1].summary.recording.interrupted);
        assert_eq!(check(&place.path(5)).unwrap(), [""; 0]);
        assert!(
            place.path(6).exists() && !place.path(8).exists(),
            "an empty one that nothing names never began"
        );
        let hash = |id: u64| hash_file(&place.path(id)).unwrap();
        let found = |id: u64| ("incident found".to_owned(), format!("{id} sha256:{}", hash(id)));
        let without_summary = |(action, target): (String, String)| {
            (action, target.split(" summary:").next().unwrap_or_default().to_owned())
        };
        let noted = ("incident note".to_owned(), "3: brake squeals".to_owned());
        let kept = ("incident kept".to_owned(), "3".to_owned());
        let said: Vec<_> = told(&store).await.into_iter().map(without_summary).collect();
        assert_eq!(said, [found(5), found(3), noted, kept]);
        place.start(&store).await;
        assert_eq!(told(&store).await.len(), 4, "nothing is new");
        let held = store.incidents_held().await.unwrap();
        assert_eq!(held.iter().map(|it| it.bytes).sum::<u64>(), {
            [3, 5].map(|id| std::fs::metadata(place.path(id)).unwrap().len()).iter().sum::<u64>()
        });
        assert_eq!(
            surplus(&held, &Policy { disk: 0, ..Policy::default() }, 0).remove,
            [5],
            "the other is kept"
        );
        store.keep_incident(3, false, Record::of(Action::IncidentKept, TELLTALE)).await.unwrap();
        // Forgotten, but its file was not removed before the crash.
        let record = Record::of(Action::IncidentRemoved, TELLTALE);
        store.forget_incidents(vec![3], record).await.unwrap();
        place.start(&store).await;
        assert_eq!(known(&store).await.len(), 2);
    }

    #[tokio::test]
    async fn a_file_that_is_not_as_the_audit_log_says_is_left_as_it_is() {
        let place = Place::new("left-over-forged");
        let store = place.store();
        for id in [1, 2] {
            place.record(id, true);
            let (bytes, hash) = complete(&place.path(id)).unwrap();
            let recording = Recording {
                file: file_name(id),
                bytes,
                finished: true,
                sha256: Some(hash),
                ..Recording::default()
            };
            store.incident_finished(&Summary { id, recording, ..Summary::default() }).await.unwrap();
        }
        let record = Record::of(Action::IncidentRemoved, TELLTALE);
        store.forget_incidents(vec![1, 2], record).await.unwrap();
        std::fs::remove_file(place.path(2)).unwrap();
        place.record(2, false);
        let before = std::fs::read(place.path(2)).unwrap();
        place.start(&store).await;
        let ids: Vec<u64> = known(&store).await.into_iter().map(|(id, _)| id).collect();
        assert_eq!(ids, [1]);
        assert_eq!(std::fs::read(place.path(2)).unwrap(), before, "nor is it completed");
    }

    #[tokio::test]
    async fn an_empty_file_that_a_record_names_stays() {
        let place = Place::new("left-over-emptied");
        let store = place.store();
        let recording = Recording { file: file_name(1), finished: true, ..Recording::default() };
        let summary = Summary { id: 1, recording, ..Summary::default() };
        // Its hash is not known.
        store.incident_finished(&summary).await.unwrap();
        store.forget_incidents(vec![1], Record::of(Action::IncidentRemoved, TELLTALE)).await.unwrap();
        let recording = Recording { file: file_name(2), ..Recording::default() };
        store.incident_opened(&Summary { id: 2, recording, ..Summary::default() }).await.unwrap();
        for id in [1, 2] {
            std::fs::write(place.path(id), []).unwrap();
        }
        place.start(&store).await;
        assert!(place.path(1).exists() && place.path(2).exists());
    }

    #[tokio::test]
    async fn a_file_that_cannot_be_completed_is_an_interrupted_incident() {
        let place = Place::new("left-over-damaged");
        let store = place.store();
        let recording = Recording { file: file_name(4), ..Recording::default() };
        store.incident_opened(&Summary { id: 4, recording, ..Summary::default() }).await.unwrap();
        std::fs::write(place.path(4), "no recording").unwrap();
        for _ in 0..2 {
            place.start(&store).await;
            let recording = &known(&store).await[0].1;
            assert!(recording.interrupted && !recording.finished && !recording.gone);
            assert_eq!(told(&store).await.len(), 1, "it is told once");
        }
    }

    #[tokio::test]
    async fn a_recording_that_is_gone_is_told_once_and_taken_when_it_is_back() {
        let place = Place::new("left-over-gone");
        let store = place.store();
        let recording = Recording { file: file_name(4), bytes: 100, ..Recording::default() };
        let summary = Summary { id: 4, since_ms: 7, stage: "active".into(), recording, ..Summary::default() };
        store.incident_opened(&summary).await.unwrap();
        make_whole(&store, &place.data.join("another folder")).await;
        assert!(known(&store).await[0].1.is_open(), "an unreadable folder says nothing");
        for _ in 0..2 {
            place.start(&store).await;
            let recording = &known(&store).await[0].1;
            assert!(recording.gone && recording.finished && recording.interrupted);
            assert_eq!((recording.bytes, told(&store).await.len()), (0, 1));
        }
        place.record(4, false);
        place.start(&store).await;
        let recording = &known(&store).await[0].1;
        assert!(!recording.gone && recording.finished && recording.sha256.is_some());
        let summary = store.incident(4).await.unwrap().unwrap().summary;
        assert_eq!(summary.stage, "active");
        assert!(summary.until_ms.is_some(), "it ended where its recording ends");
        assert_eq!(check(&place.path(4)).unwrap(), [""; 0]);
        let held = store.incidents_held().await.unwrap();
        assert!(held[0].bytes > 100 && held[0].finished);
    }
}
