//! Tests of recordings that an earlier run left behind.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde_json::json;

use super::*;
use crate::clock::Clock;
use crate::record::file::{IncidentFile, TRANSITIONS, check};
use crate::record::folder::{file_name, folder_in};
use crate::record::retention::{Policy, surplus};
use crate::record::summary::Recording;
use crate::store::{DemoSecrets, Incident, IncidentFilter, Note};

struct Place {
    data: tempfile::TempDir,
    folder: PathBuf,
}

impl Place {
    fn new() -> Place {
        let data = tempfile::tempdir().unwrap();
        let folder = folder_in(data.path());
        std::fs::create_dir_all(&folder).unwrap();
        Place { data, folder }
    }

    fn store(&self) -> Store {
        Store::open(self.data.path(), Clock::start(), DemoSecrets::Refused).unwrap()
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
        make_whole(store, &self.folder, &Policy::default(), |_| false).await;
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
    let place = Place::new();
    place.record(3, true);
    let note = Note { text: "brake squeals".into(), by: "dora".into(), at_ms: 5 };
    let said = Beside { note: Some(note.clone()), kept: Some(true) };
    note_file::write(&place.folder, 3, &said).unwrap();
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
    assert!(place.path(6).exists() && !place.path(8).exists(), "an empty one that nothing names never began");
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
        surplus(&held, &Policy { disk: 0, reserved: 0, ..Policy::default() }, 0).remove,
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
    let place = Place::new();
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
async fn a_changed_row_is_not_recorded_anew_and_neither_is_its_file() {
    let place = Place::new();
    let store = place.store();
    place.record(1, true);
    let (bytes, hash) = complete(&place.path(1)).unwrap();
    let recording =
        Recording { file: file_name(1), bytes, finished: true, sha256: Some(hash), ..Recording::default() };
    let summary = Summary { id: 1, recording, ..Summary::default() };
    store.incident_finished(&summary).await.unwrap();
    // As if it had been interrupted, and of another vehicle.
    let recording = Recording { file: file_name(1), ..Recording::default() };
    let forged = Summary { id: 1, vehicle: "another".into(), recording, ..Summary::default() };
    store.incident_updated(&forged).await.unwrap();
    std::fs::remove_file(place.path(1)).unwrap();
    place.record(1, false);
    let before = std::fs::read(place.path(1)).unwrap();
    place.start(&store).await;
    assert_eq!(std::fs::read(place.path(1)).unwrap(), before);
    assert_eq!(told(&store).await.len(), 1);
    // Nor is one whose hash was never known.
    let recording = Recording { file: file_name(2), interrupted: true, ..Recording::default() };
    let summary = Summary { id: 2, recording, ..Summary::default() };
    store.incident_finished(&summary).await.unwrap();
    store.incident_updated(&Summary { vehicle: "another".into(), ..summary }).await.unwrap();
    place.record(2, false);
    place.start(&store).await;
    assert_eq!(told(&store).await.len(), 2);
}

#[tokio::test]
async fn what_lies_beside_a_known_recording_is_taken_as_the_log_has_it() {
    let place = Place::new();
    let store = place.store();
    place.record(1, true);
    place.start(&store).await;
    store.keep_incident(1, true, Record::of(Action::IncidentKept, TELLTALE)).await.unwrap();
    let forged = Note { text: "it was fine".into(), by: "dora".into(), at_ms: 5 };
    note_file::write(&place.folder, 1, &Beside { note: Some(forged), kept: Some(false) }).unwrap();
    store.close().await;
    let database = rusqlite::Connection::open(place.data.path().join(crate::store::FILE_NAME)).unwrap();
    database.execute("DELETE FROM incidents", []).unwrap();
    drop(database);
    let store = place.store();
    place.start(&store).await;
    let found = store.incident(1).await.unwrap().unwrap();
    assert_eq!((found.note, found.kept), (None, true));
}

#[tokio::test]
async fn an_empty_file_that_a_record_names_stays() {
    let place = Place::new();
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
    let place = Place::new();
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
    let place = Place::new();
    let store = place.store();
    let recording = Recording { file: file_name(4), bytes: 100, ..Recording::default() };
    let summary = Summary { id: 4, since_ms: 7, stage: "active".into(), recording, ..Summary::default() };
    store.incident_opened(&summary).await.unwrap();
    make_whole(&store, &place.data.path().join("another folder"), &Policy::default(), |_| false).await;
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
