//! `telltale incident` as shells and programs use it, beside a server and on damaged folders.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use serde_json::{Value, json};
use telltale::clock::Clock;
use telltale::record::file::{IncidentFile, TRANSITIONS};
use telltale::record::folder::{file_name, folder_in};
use telltale::record::found;
use telltale::record::summary::{Recording, Summary, TriggerLine, kind};
use telltale::record::writer::hash_file;
use telltale::store::audit::{Action, Record};
use telltale::store::{DemoSecrets, Store};

use crate::folder::TestFolder;
use crate::program::{said, telltale};

const DAY_MS: i64 = 24 * 3600 * 1000;

/// A data folder with four incidents: 1 is old, 2 is marked, 3 is new, 4 lasts.
struct Folder {
    data: TestFolder,
    /// As a server has it.
    store: Option<Store>,
}

impl Folder {
    async fn new(name: &str) -> Folder {
        let data = TestFolder::new(&format!("incident-{name}"));
        std::fs::create_dir_all(folder_in(&data)).unwrap();
        let clock = Clock::start();
        let store = Store::open(&data, clock, DemoSecrets::Refused).unwrap();
        let now = clock.wall().duration_since(std::time::UNIX_EPOCH).unwrap().as_millis() as i64;
        for (id, kind, age) in [
            (1, kind::ROOT, 40 * DAY_MS),
            (2, kind::MARK, 39 * DAY_MS),
            (3, kind::ROOT, DAY_MS),
            (4, kind::ROOT, 0),
        ] {
            let path = folder_in(&data).join(file_name(id));
            let bytes = recording(&path, id);
            let is_over = id < 4;
            let hash = hash_file(&path).unwrap();
            let trigger = TriggerLine {
                at_ms: now - age,
                kind: kind.into(),
                what: "sensors/lidar\u{1b}[2J".into(),
                alarm: None,
                note: String::new(),
            };
            let recording = Recording {
                file: file_name(id),
                bytes,
                finished: is_over,
                sha256: is_over.then_some(hash),
                ..Recording::default()
            };
            let until_ms = is_over.then_some(now - age + 12_000);
            let triggers = vec![trigger];
            let summary =
                Summary { id, since_ms: now - age, until_ms, triggers, recording, ..Summary::default() };
            match is_over {
                true => store.incident_finished(&summary).await.unwrap(),
                false => store.incident_opened(&summary).await.unwrap(),
            }
        }
        // The head of a new log is noted beside it when nothing waits to be written, at the latest at the end.
        store.close().await;
        let store = Store::open(&data, clock, DemoSecrets::Refused).unwrap();
        Folder { data, store: Some(store) }
    }

    fn file(&self, id: u64) -> PathBuf {
        folder_in(&self.data).join(file_name(id))
    }

    async fn end_server(&mut self) {
        if let Some(store) = self.store.take() {
            store.close().await;
        }
    }

    fn run(&self, words: &[&str]) -> (String, String, Option<i32>) {
        incident(&self.data, words)
    }
}

/// A small recording. Returns its bytes.
fn recording(path: &Path, id: u64) -> u64 {
    let mut file =
        IncidentFile::create(path, BTreeMap::from([("incident".to_owned(), id.to_string())])).unwrap();
    for at in 1..=100 {
        file.json(&TRANSITIONS, at, &json!({ "at_ms": 0, "kind": "stage", "stage": format!("{id} {at}") }))
            .unwrap();
    }
    file.finish().unwrap().bytes
}

fn incident(data: &Path, words: &[&str]) -> (String, String, Option<i32>) {
    let mut command = telltale([&["incident"], words, &["--data", data.to_str().unwrap()]].concat());
    said(&command.current_dir(std::env::temp_dir()).output().expect("the program can be run"))
}

#[tokio::test]
async fn a_list_is_a_table_or_json() {
    let folder = Folder::new("list").await;
    let (out, _, code) = folder.run(&["list"]);
    let lines: Vec<&str> = out.lines().collect();
    assert_eq!((lines.len(), code), (4, Some(0)), "{out}");
    assert!(lines[0].contains("lasts") && lines[0].contains(r"sensors/lidar\u{1b}[2J"), "{out}");
    assert!(lines[2].contains("mark [marked] [kept]") && lines[3].contains("12 s"), "{out}");
    let (out, _, _) = folder.run(&["list", "--json", "--count", "2", "--before", "4"]);
    let list: Value = serde_json::from_str(&out).unwrap();
    let ids: Vec<u64> = list.as_array().unwrap().iter().map(|it| it["id"].as_u64().unwrap()).collect();
    assert_eq!(ids, [3, 2]);
    assert_eq!(list[1]["marked"], true);
    let (out, err, code) = folder.run(&["list", "--cause", "planner"]);
    assert_eq!((&*out, code), ("", Some(0)));
    assert!(err.contains("no such incident"), "{err}");
    assert_eq!(folder.run(&["list", "--since", "yesterday"]).2, Some(2));
    assert_eq!(folder.run(&["list", "--since", "2020-01-01", "--until", "2020-01-02"]).0, "");
}

#[tokio::test]
async fn a_recording_is_copied_and_nothing_is_overwritten() {
    let folder = Folder::new("export").await;
    let output = folder.data.join("copy.mcap");
    let to = output.to_str().unwrap();
    let (out, err, code) = folder.run(&["export", "3", "--output", to]);
    assert_eq!((err.as_str(), code), ("", Some(0)));
    assert!(out.contains("sha256 ") && out.contains(to), "{out}");
    assert_eq!(std::fs::read(&output).unwrap(), std::fs::read(folder.file(3)).unwrap());
    let (_, err, code) = folder.run(&["export", "3", "--output", to]);
    assert!(code == Some(2) && err.contains("--output"), "{err}");
    let other = folder.data.join("other.mcap");
    let other = other.to_str().unwrap();
    let (_, err, code) = folder.run(&["export", "9", "--output", other]);
    assert!(code == Some(2) && err.contains("there is no incident 9"), "{err}");
    let (_, err, code) = folder.run(&["export", "4", "--output", other]);
    assert!(code == Some(0) && err.contains("not finished"), "{err}");
    std::fs::remove_file(folder.file(2)).unwrap();
    let (_, err, code) = folder.run(&["export", "2", "--output", folder.data.join("two").to_str().unwrap()]);
    assert!(code == Some(1) && err.contains(&file_name(2)), "{err}");
    std::fs::write(folder.file(1), "another").unwrap();
    let (_, err, code) = folder.run(&["export", "1", "--output", folder.data.join("one").to_str().unwrap()]);
    assert!(code == Some(1) && err.contains("not as it was recorded"), "{err}");
}

#[tokio::test]
async fn a_report_is_written_beside_a_server_also_where_the_recording_is_damaged_or_gone() {
    let folder = Folder::new("report").await;
    let to = |name: &str| folder.data.join(name).to_str().unwrap().to_owned();
    // A recording of its own.
    let path = folder.file(5);
    let mut file = IncidentFile::create(&path, BTreeMap::new()).unwrap();
    let state = |at_ms: u64, shown: &str| {
        json!({ "at_ms": at_ms, "kind": "shown", "node": "sensors/lidar", "shown": shown, "own": shown,
            "message": "no <packets>" })
    };
    file.json(&TRANSITIONS, 70_000_000_000, &state(70_000, "ok")).unwrap();
    file.json(&TRANSITIONS, 100_000_000_000, &state(100_000, "error")).unwrap();
    let bytes = file.finish().unwrap().bytes;
    let recording = Recording {
        file: file_name(5),
        bytes,
        pre_roll_s: 30.0,
        finished: true,
        sha256: Some(hash_file(&path).unwrap()),
        ..Recording::default()
    };
    let summary = Summary {
        id: 5,
        since_ms: 100_000,
        until_ms: Some(110_000),
        vehicle: "shuttle-1".into(),
        recording,
        ..Summary::default()
    };
    folder.store.as_ref().unwrap().incident_finished(&summary).await.unwrap();
    let (out, err, code) = folder.run(&["export", "5", "--report", &to("whole.html")]);
    assert_eq!((err.as_str(), code), ("", Some(0)), "{out}");
    assert!(out.starts_with(&to("whole.html")) && !out.contains("sha256"), "only the report: {out}");
    let read = |name: &str| std::fs::read_to_string(to(name)).unwrap();
    for part in
        ["shuttle-1", "sensors/lidar: Error, \u{201c}no &#60;packets&#62;", "still had it", "id=\"states\""]
    {
        assert!(read("whole.html").contains(part), "{part}: {}", read("whole.html"));
    }
    let (_, err, code) = folder.run(&["export", "5", "--report", &to("whole.html")]);
    assert!(code == Some(2) && err.contains("--report"), "{err}");
    let (out, _, code) = folder.run(&["export", "5", "--report", &to("b.html"), "--output", &to("b.mcap")]);
    assert!(code == Some(0) && out.contains("b.html") && out.contains("b.mcap"), "{out}");
    assert_eq!(std::fs::read(to("b.mcap")).unwrap(), std::fs::read(&path).unwrap());
    // What the database knows; two are no recordings.
    let store = folder.store.as_ref().unwrap();
    for id in [3, 4] {
        std::fs::write(folder.file(id), "no recording").unwrap();
    }
    let mut summary = store.incident(3).await.unwrap().unwrap().summary;
    summary.recording.sha256 = Some(hash_file(&folder.file(3)).unwrap());
    store.incident_finished(&summary).await.unwrap();
    for (id, says, in_report) in [
        ("3", "cannot be read", "The recording cannot be read"),
        ("2", "is gone", "The recording is not there any more"),
        ("1", "not as it was recorded", "The recording is not as it was recorded"),
        ("4", "not finished", "has no hash"),
    ] {
        match id {
            "2" => std::fs::remove_file(folder.file(2)).unwrap(),
            "1" => drop(std::fs::copy(&path, folder.file(1)).unwrap()),
            _ => {}
        }
        let name = format!("{id}.html");
        let (_, err, code) = folder.run(&["export", id, "--report", &to(&name)]);
        assert!(code == Some(1) && err.contains(says), "{id}: {code:?} {err}");
        for part in [in_report, &format!("Incident report {id}")] {
            assert!(read(&name).contains(part), "{part}: {}", read(&name));
        }
    }
    let (_, err, code) = folder.run(&["export", "9", "--report", &to("9.html")]);
    assert!(
        code == Some(2) && err.contains("there is no incident 9") && !folder.data.join("9.html").exists()
    );
}

#[tokio::test]
async fn recordings_are_proven_by_the_store_and_by_the_audit_log() {
    let mut folder = Folder::new("verify").await;
    let (out, err, code) = folder.run(&["verify"]);
    assert_eq!((err.as_str(), code), ("", Some(0)), "{out}");
    for line in ["ok    the audit log", "ok    incident 1", "ok    incident 3", "incident 4 is not finished"]
    {
        assert!(out.contains(line), "{out}");
    }
    std::fs::write(folder.file(1), "another").unwrap();
    std::fs::rename(folder.file(2), folder.file(17)).unwrap();
    let (out, _, code) = folder.run(&["verify"]);
    assert_eq!(code, Some(1));
    for line in
        ["incident 1: ", "is not as it was recorded", "incident 2: ", " is gone", "incident 17: ", "no hash"]
    {
        assert!(out.contains(line), "{line}: {out}");
    }
    assert_eq!(folder.run(&["verify", "3"]).2, Some(0));
    let (out, _, code) = folder.run(&["verify", "8"]);
    assert!(code == Some(1) && out.contains("there is no such incident"), "{out}");
    std::fs::write(folder.file(18), []).unwrap();
    let (out, _, code) = folder.run(&["verify", "18"]);
    assert!(
        code == Some(0) && out.contains("incident 18 never began: ") && out.contains("is empty"),
        "{out}"
    );
    // A moment is marked in incident 4, which lasts.
    let mark = Record::of(Action::Mark, "dora").on("4: crash: at the gate");
    folder.store.as_ref().unwrap().record(mark, None).await;
    folder.end_server().await;
    // Somebody changes the file and its hash in the store.
    let run = |sql: &str| {
        let connection = rusqlite::Connection::open(folder.data.join("telltale.db")).unwrap();
        connection.execute_batch(sql).unwrap();
    };
    std::fs::remove_file(folder.file(3)).unwrap();
    recording(&folder.file(3), 33);
    let hash = hash_file(&folder.file(3)).unwrap();
    let old: String = {
        let connection = rusqlite::Connection::open(folder.data.join("telltale.db")).unwrap();
        connection.query_row("SELECT sha256 FROM incidents WHERE id = 3", [], |row| row.get(0)).unwrap()
    };
    run(&format!("UPDATE incidents SET summary = replace(summary, '{old}', '{hash}'), sha256 = '{hash}'"));
    let (out, _, code) = folder.run(&["verify", "3"]);
    assert!(code == Some(1) && out.contains("the audit log has sha256"), "{out}");
    // A recording that is gone with its row is named, too, also one that was not finished; and a pipe is not waited for.
    run("DELETE FROM incidents WHERE id IN (2, 4)");
    std::fs::remove_file(folder.file(4)).unwrap();
    assert!(Command::new("mkfifo").arg(folder.file(19)).status().unwrap().success());
    let (out, _, code) = folder.run(&["verify"]);
    for id in [2, 4] {
        let gone = format!("incident {id}: the audit log names it, but neither the store knows it");
        assert!(code == Some(1) && out.contains(&gone), "{out}");
    }
    assert!(out.contains("BAD   incident 19: ") && out.contains("is no file"), "{out}");
    // In the audit log too, but not its chain.
    run(&format!("UPDATE audit SET target = replace(target, '{old}', '{hash}')"));
    let (out, _, code) = folder.run(&["verify", "3"]);
    assert!(code == Some(1) && out.contains("BAD   the audit log"), "{out}");
    assert!(
        out.contains("in the database, what it says of the incident is not as the audit log says"),
        "{out}"
    );
}

#[tokio::test]
async fn a_recording_that_was_taken_in_is_proven_from_then_on() {
    let folder = Folder::new("found").await;
    recording(&folder.file(9), 9);
    let (out, _, code) = folder.run(&["verify", "9"]);
    assert!(code == Some(1) && out.contains("no hash"), "{out}");
    let mut summary = found::summary(&folder.file(9), 9).unwrap().unwrap();
    (summary.recording.finished, summary.recording.sha256) =
        (true, Some(hash_file(&folder.file(9)).unwrap()));
    folder.store.as_ref().unwrap().incident_found(&summary).await.unwrap();
    let (out, _, code) = folder.run(&["verify", "9"]);
    assert!(code == Some(0) && out.contains("nothing proves it before that"), "{out}");
    std::fs::write(folder.file(9), "another").unwrap();
    assert_eq!(folder.run(&["verify", "9"]).2, Some(1));
}

#[tokio::test]
async fn a_damaged_recording_is_told_also_where_its_hash_is_right() {
    let folder = Folder::new("damaged").await;
    let store = folder.store.as_ref().unwrap();
    // Completed after a crash, and damaged before its hash was made.
    let mut bytes = std::fs::read(folder.file(3)).unwrap();
    let middle = bytes.len() / 3;
    bytes[middle] ^= 0xff;
    std::fs::write(folder.file(3), &bytes).unwrap();
    let recorded = store.incident(3).await.unwrap().unwrap().summary;
    let record = async |id, bytes: &[u8]| {
        std::fs::write(folder.file(id), bytes).unwrap();
        let mut summary = Summary { id, ..recorded.clone() };
        summary.recording.file = file_name(id);
        summary.recording.bytes = bytes.len() as u64;
        summary.recording.sha256 = Some(hash_file(&folder.file(id)).unwrap());
        store.incident_finished(&summary).await.unwrap();
    };
    let (out, _, code) = folder.run(&["verify", "3"]);
    assert!(
        code == Some(1) && out.contains("not as it was recorded") && out.contains("; it is damaged at byte"),
        "{out}"
    );
    record(5, &bytes).await;
    let (out, _, code) = folder.run(&["verify", "5"]);
    assert!(code == Some(1) && out.contains("is as it was recorded, but damaged at byte"), "{out}");
    record(6, &bytes[..bytes.len() / 2]).await;
    let (out, _, code) = folder.run(&["verify", "6"]);
    assert!(code == Some(1) && out.contains("the file ends in the middle of a record"), "{out}");
    assert_eq!(folder.run(&["verify", "1"]).2, Some(0));
}

#[tokio::test]
async fn pruning_beside_a_server_removes_what_is_old_and_not_what_is_kept() {
    let folder = Folder::new("prune").await;
    let (out, _, code) = folder.run(&["prune", "--dry-run"]);
    assert!(
        code == Some(0) && out.contains("would remove incident 1,") && out.contains("3 incidents left"),
        "{out}"
    );
    assert!(folder.file(1).exists());
    let (out, _, code) = folder.run(&["prune"]);
    assert!(code == Some(0) && out.contains("removed incident 1,"), "{out}");
    assert!(!folder.file(1).exists() && folder.file(2).exists());
    let (out, _, _) = folder.run(&["prune", "--disk", "0", "--keep", "1s"]);
    assert!(out.contains("removed incident 3,") && out.contains("that is too much"), "{out}");
    assert!(folder.file(2).exists() && folder.file(4).exists(), "one is marked, the other lasts");
    let (out, _, code) = folder.run(&["keep", "2", "--off"]);
    assert_eq!((out.trim(), code), ("incident 2 is kept no longer", Some(0)));
    assert!(folder.run(&["prune"]).0.contains("removed incident 2,"));
    let (out, _, code) = folder.run(&["verify", "1"]);
    assert!(code == Some(1) && out.contains("it was removed"), "{out}");
    let (_, err, code) = folder.run(&["keep", "2"]);
    assert!(code == Some(2) && err.contains("there is no incident 2"), "{err}");
    let log = folder.store.as_ref().unwrap().audit_entries(None, 10).await.unwrap();
    let removed = log.iter().filter(|it| it.action == "incident removed").count();
    assert_eq!(removed, 3);
}

#[tokio::test]
async fn pruning_keeps_what_was_changed_until_it_is_told_to_remove_it() {
    let folder = Folder::new("prune-changed").await;
    std::fs::write(folder.file(1), "another").unwrap();
    for words in [&["prune", "--dry-run"][..], &["prune"]] {
        let (out, err, code) = folder.run(words);
        assert!(code == Some(1) && !out.contains("incident 1,") && folder.file(1).exists(), "{out}{err}");
        for part in ["incident 1 stays", "incident-1.mcap is not as it was recorded", "add --changed"] {
            assert!(err.contains(part), "{part}: {err}");
        }
    }
    let (out, err, code) = folder.run(&["prune", "--changed"]);
    assert!(code == Some(0) && out.contains("removed incident 1,"), "{out}{err}");
    assert!(!folder.file(1).exists());
}

#[test]
fn a_folder_without_a_database_is_told() {
    let data = TestFolder::new("incident-none");
    for words in
        [&["list"][..], &["export", "1"], &["verify"], &["keep", "1"], &["prune"], &["prune", "--dry-run"]]
    {
        let (_, err, code) = incident(&data, words);
        assert!(code == Some(2) && err.contains("--data"), "{words:?}: {err}");
    }
    assert!(!data.exists(), "a misspelt folder does not become one");
}
