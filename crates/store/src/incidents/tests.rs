//! Tests of incidents in the store: numbers, filters, notes, hashes in the audit log, damage and disks.

use std::path::Path;

use rusqlite::Connection;

use super::*;
use crate::audit::{Action, COMMAND_LINE, Record, verify_audit_in};
use crate::{DemoSecrets, FILE_NAME, Role, Store, StoreError, check_data, repair, restore};
use telltale_clock::Clock;
use telltale_record::folder::file_name;
use telltale_record::summary::{FrozenNode, Recording, TriggerLine, kind};

fn line(kind: &str, what: &str, alarm: Option<u64>) -> TriggerLine {
    TriggerLine { at_ms: 1000, kind: kind.to_owned(), what: what.to_owned(), alarm, note: String::new() }
}

fn summary(id: u64, triggers: Vec<TriggerLine>) -> Summary {
    let recording =
        Recording { file: file_name(id), bytes: 100 * id, pre_roll_s: 30.0, ..Recording::default() };
    let since_ms = 1000 * id as i64;
    Summary { id, since_ms, triggers, stage: "active".into(), recording, ..Summary::default() }
}

fn finished(mut summary: Summary) -> Summary {
    summary.until_ms = Some(summary.since_ms + 500);
    summary.recording.finished = true;
    summary.recording.sha256 = Some(format!("{:064x}", summary.id));
    summary
}

fn by_hand(action: Action) -> Record {
    Record::of(action, COMMAND_LINE).by("dora", Role::Developer)
}

fn memory() -> Store {
    Store::in_memory(Clock::start(), DemoSecrets::Refused).unwrap()
}

fn open(folder: &Path) -> Store {
    Store::open(folder, Clock::start(), DemoSecrets::Refused).unwrap()
}

async fn ids(store: &Store, filter: IncidentFilter) -> Vec<u64> {
    store.incidents(filter).await.unwrap().iter().map(|it| it.summary.id).collect()
}

#[tokio::test]
async fn a_number_is_never_used_twice() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let store = open(folder);
    assert_eq!(store.next_incident_number(0).await.unwrap(), 1);
    assert_eq!(store.next_incident_number(0).await.unwrap(), 2, "also if nothing was recorded with it");
    let three = finished(summary(3, Vec::new()));
    store.incident_finished(&three).await.unwrap();
    assert_eq!(store.next_incident_number(2).await.unwrap(), 4);
    assert_eq!(store.forget_incidents(vec![3], by_hand(Action::IncidentRemoved)).await.unwrap()[0].id, 3);
    store.close().await;
    let store = open(folder);
    assert_eq!(store.next_incident_number(0).await.unwrap(), 5, "after a restart and pruning");
    let later = finished(summary(9, Vec::new()));
    store.incident_finished(&later).await.unwrap();
    store.forget_incidents(vec![9], by_hand(Action::IncidentRemoved)).await.unwrap();
    assert_eq!(store.next_incident_number(0).await.unwrap(), 10, "a number that the recorder counted itself");
    let lost = memory();
    assert_eq!(lost.next_incident_number(17).await.unwrap(), 18, "after a lost database");
    assert_eq!(lost.next_incident_number(3).await.unwrap(), 19);
    assert!(lost.next_incident_number(u64::MAX).await.unwrap() < 1 << 60);
    // A disk that takes nothing.
    lost.call(|database| Ok(database.connection.pragma_update(None, "query_only", true)?)).await.unwrap();
    assert!(lost.next_incident_number(1 << 50).await.unwrap() > 1 << 50);
}

#[tokio::test]
async fn incidents_are_listed_newest_first_in_pages_and_by_each_filter() {
    let store = memory();
    let root = |node: &str, alarm| line(kind::ROOT, node, alarm);
    let mut two = finished(summary(2, vec![root("localization/tf_map", Some(4))]));
    // It was another node, as became known later.
    two.roots = vec!["sensors/velodyne_packet_alive".into()];
    let message = "No packets for 2 s".to_owned();
    two.freeze = vec![FrozenNode {
        node: two.roots[0].clone(),
        state: "error".into(),
        message,
        values: Vec::new(),
        at_ms: None,
    }];
    let mut four = summary(4, vec![root("a/b/c", Some(9)), line(kind::LOST_ACTIVE, "standby", None)]);
    four.stage = "standby".into();
    for summary in [
        finished(summary(1, vec![line(kind::MARK, "anna", None)])),
        two.clone(),
        finished(summary(3, vec![root("Sensors_old/x", None)])),
        four,
    ] {
        store.incident_opened(&summary).await.unwrap();
    }
    store.keep_incident(3, true, by_hand(Action::IncidentKept)).await.unwrap();
    let all = IncidentFilter::default;
    let cases = [
        (all(), vec![4, 3, 2, 1]),
        (IncidentFilter { count: 2, ..all() }, vec![4, 3]),
        (IncidentFilter { before: Some(3), count: 1, ..all() }, vec![2]),
        (IncidentFilter { cause: "VELODYNE".into(), ..all() }, vec![2]),
        (IncidentFilter { cause: "tf_map".into(), ..all() }, vec![]),
        (IncidentFilter { cause: "%".into(), ..all() }, vec![]),
        (IncidentFilter { text: "VELODYNE".into(), ..all() }, vec![2]),
        (IncidentFilter { text: "%".into(), ..all() }, vec![]),
        (IncidentFilter { text: "Mark".into(), ..all() }, vec![1]),
        (IncidentFilter { text: "since_ms".into(), ..all() }, vec![]),
        (IncidentFilter { text: "no PACKETS".into(), ..all() }, vec![2]),
        (
            IncidentFilter { text: "nothing".into(), or_causes: vec!["a/b/c".into(), "b".into()], ..all() },
            vec![4],
        ),
        (IncidentFilter { group: "sensors".into(), ..all() }, vec![2]),
        (IncidentFilter { group: "a".into(), ..all() }, vec![4]),
        (IncidentFilter { group: "a/b".into(), ..all() }, vec![4]),
        (IncidentFilter { group: "b".into(), ..all() }, vec![]),
        (IncidentFilter { group: "a/b/c".into(), ..all() }, vec![4]),
        (IncidentFilter { stage: "standby".into(), ..all() }, vec![4]),
        (IncidentFilter { marked: Some(true), ..all() }, vec![1]),
        (IncidentFilter { marked: Some(false), kept: Some(false), ..all() }, vec![4, 2]),
        (IncidentFilter { kept: Some(true), ..all() }, vec![3, 1]),
        (IncidentFilter { since_ms: Some(3000), ..all() }, vec![4, 3]),
        (IncidentFilter { since_ms: Some(2500), until_ms: Some(3000), ..all() }, vec![3, 2]),
        (IncidentFilter { since_ms: Some(99_000), ..all() }, vec![4]),
    ];
    for (filter, expected) in cases {
        assert_eq!(ids(&store, filter.clone()).await, expected, "{filter:?}");
    }
    assert_eq!(store.incident(2).await.unwrap().unwrap().summary, two);
    assert_eq!(store.incident(5).await.unwrap(), None);
    assert_eq!(store.incident(u64::MAX).await.unwrap(), None);
    let unfinished: Vec<u64> = store.unfinished_incidents().await.unwrap().iter().map(|it| it.id).collect();
    assert_eq!(unfinished, [4]);
    let held = store.incidents_held().await.unwrap();
    let flags: Vec<_> = held.iter().map(|it| (it.id, it.bytes, it.marked, it.kept, it.finished)).collect();
    assert_eq!(
        flags,
        [
            (1, 100, true, true, true),
            (2, 200, false, false, true),
            (3, 300, false, true, true),
            (4, 400, false, false, false)
        ]
    );
}

#[tokio::test]
async fn notes_and_what_is_kept_outlive_updates_and_stand_in_the_audit_log() {
    let store = memory();
    let mut marked = summary(1, Vec::new());
    store.incident_opened(&marked).await.unwrap();
    store.set_incident_note(1, " brake squeals ", by_hand(Action::Mark)).await.unwrap();
    assert!(!store.incident(1).await.unwrap().unwrap().kept);
    marked.triggers.push(line(kind::MARK, "anna", None));
    store.incident_updated(&marked).await.unwrap();
    let found = store.incident(1).await.unwrap().unwrap();
    let note = found.note.unwrap();
    assert_eq!((&*note.text, &*note.by, found.kept), ("brake squeals", "dora", true), "a mark keeps it");
    store.keep_incident(1, false, by_hand(Action::IncidentKept)).await.unwrap();
    store.incident_finished(&finished(marked.clone())).await.unwrap();
    let found = store.incident(1).await.unwrap().unwrap();
    assert!(!found.kept && found.note.is_some() && found.summary.recording.finished);
    store.set_incident_note(1, "", by_hand(Action::IncidentNote)).await.unwrap();
    assert_eq!(store.incident(1).await.unwrap().unwrap().note, None);
    let missing = store.set_incident_note(7, "x", by_hand(Action::IncidentNote)).await;
    assert!(matches!(missing, Err(StoreError::NoSuchIncident(7))));
    let missing = store.keep_incident(7, true, by_hand(Action::IncidentKept)).await;
    assert!(matches!(missing, Err(StoreError::NoSuchIncident(7))));
    let log = store.audit_entries(None, 10).await.unwrap();
    let said: Vec<(&str, &str)> = log.iter().rev().map(|it| (&*it.action, &*it.target)).collect();
    let (recorded, _) = said[2].1.split_once(" summary:").unwrap();
    assert_eq!(recorded, format!("1 sha256:{:064x}", 1));
    assert_eq!(
        said,
        [
            ("incident note", "1: brake squeals"),
            ("incident kept", "1: no longer"),
            ("incident recorded", said[2].1),
            ("incident note", "1: "),
        ]
    );
}

#[tokio::test]
async fn an_incident_is_forgotten_with_its_hash_unless_it_is_kept_or_unfinished() {
    let store = memory();
    for summary in [1, 2, 3].map(|id| finished(summary(id, Vec::new()))) {
        store.incident_finished(&summary).await.unwrap();
    }
    store.incident_opened(&summary(4, Vec::new())).await.unwrap();
    store.keep_incident(2, true, by_hand(Action::IncidentKept)).await.unwrap();
    let gone = store.forget_incidents(vec![1, 2, 3, 4, 5], by_hand(Action::IncidentRemoved)).await.unwrap();
    assert_eq!(gone.iter().map(|it| (it.id, it.bytes)).collect::<Vec<_>>(), [(1, 100), (3, 300)]);
    assert_eq!(ids(&store, IncidentFilter::default()).await, [4, 2]);
    let log = store.audit_entries(None, 2).await.unwrap();
    let said = |at: usize| (log[at].action.clone(), log[at].target.clone(), log[at].who.clone());
    let removed = |id| ("incident removed".to_owned(), format!("{id} sha256:{id:064x}"), "dora".to_owned());
    assert_eq!((said(1), said(0)), (removed(1), removed(3)));
    assert!(store.forget_incidents(vec![9], by_hand(Action::IncidentRemoved)).await.unwrap().is_empty());
}

#[tokio::test]
async fn too_many_incidents_are_told_and_those_that_are_known_go_on() {
    let store = memory();
    let fill = "INSERT INTO incidents (id, since_ms, marked, kept, bytes, finished, stage, causes, summary)
                WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 20000)
                SELECT i, i, 0, 1, 1, 1, '', '', 'damaged' FROM n";
    store.call(move |database| Ok(database.connection.execute_batch(fill)?)).await.unwrap();
    let refused = store.incident_opened(&summary(20_001, Vec::new())).await;
    assert!(matches!(refused, Err(StoreError::ManyIncidents)));
    store.incident_updated(&summary(20_000, Vec::new())).await.unwrap();
    let newest = store.incidents(IncidentFilter::default()).await.unwrap();
    assert_eq!(newest.len(), INCIDENTS_PAGE_MAX as usize);
    assert_eq!(
        (newest[0].summary.recording.bytes, newest[1].summary.recording.bytes),
        (2_000_000, 1),
        "damaged, and listed"
    );
}

#[tokio::test]
async fn a_data_folder_is_read_beside_a_server_and_the_audit_log_proves_each_hash() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let store = open(folder);
    for id in [1, 2] {
        store.incident_finished(&finished(summary(id, Vec::new()))).await.unwrap();
    }
    store.forget_incidents(vec![1], by_hand(Action::IncidentRemoved)).await.unwrap();
    let incidents = Incidents::open(folder).unwrap();
    assert_eq!(incidents.list(&IncidentFilter::default()).unwrap().len(), 1);
    assert_eq!(incidents.one(2).unwrap().unwrap().summary.id, 2);
    assert_eq!(incidents.held().unwrap().len(), 1);
    let records = incidents.records().unwrap();
    assert_eq!((records.hashes[&2].clone(), records.removed), (format!("{:064x}", 2), vec![1]));
    drop(incidents);
    store.close().await;
    assert_eq!(verify_audit_in(folder, &[], None).unwrap().breach, None);
}

/// A change in the database alone, and what the audit log does not prove after it.
type Forgery = (&'static str, Option<&'static str>);

#[tokio::test]
async fn the_audit_log_proves_what_the_database_says_of_an_incident() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let store = open(folder);
    let marked =
        || finished(summary(1, vec![line(kind::ROOT, "a/b", Some(4)), line(kind::MARK, "anna", None)]));
    store.incident_finished(&marked()).await.unwrap();
    let long = "brake squeals ".repeat(100);
    store.set_incident_note(1, &long, by_hand(Action::IncidentNote)).await.unwrap();
    store.close().await;
    let incidents = Incidents(Connection::open(folder.join(FILE_NAME)).unwrap());
    let records = incidents.records().unwrap();
    let said = "what it says of the incident";
    let forgeries: [Forgery; 11] = [
        ("id = id", None),
        ("summary = replace(summary, 'a/b', 'a/c')", Some(said)),
        ("since_ms = since_ms + 1", Some(said)),
        ("stage = 'ready'", Some(said)),
        ("causes = char(10) || 'x' || char(10)", Some(said)),
        ("marked = 0", Some(said)),
        ("summary = 'damaged'", Some(said)),
        ("note = substr(note, 1, 1000) || 'hums'", Some("its note")),
        ("note_by = 'anna'", Some("its note")),
        ("note = ''", Some("its note")),
        ("kept = 0", Some("whether it is kept")),
    ];
    for (change, expected) in forgeries {
        let execute = |sql: &str| incidents.0.execute_batch(sql).unwrap();
        execute(&format!("BEGIN; UPDATE incidents SET {change}"));
        let row = incidents.stored(1).unwrap().unwrap();
        assert_eq!(records.contradiction(&row), expected, "{change}");
        let logged = incidents.logged(1).unwrap().unwrap();
        assert_eq!(logged.contradiction, expected, "{change}");
        execute("ROLLBACK");
    }
}

#[tokio::test]
async fn incidents_outlive_a_repair_and_a_backup_and_are_listed_while_the_database_is_damaged() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let store = open(folder);
    store.add_user("anna", Role::Operator, "135791").await.unwrap();
    store.incident_finished(&finished(summary(1, Vec::new()))).await.unwrap();
    assert_eq!(store.next_incident_number(1).await.unwrap(), 2);
    store.close().await;
    let backup = crate::database::backup::make(folder, std::time::UNIX_EPOCH).unwrap();
    damage(folder);
    assert!(check_data(folder).unwrap().damage.is_some());
    let serving = Store::open_or_read(folder, Clock::start(), DemoSecrets::Refused).unwrap();
    assert!(serving.fault().borrow().is_some());
    assert_eq!(ids(&serving, IncidentFilter::default()).await, [1]);
    let next = serving.next_incident_number(1).await.unwrap();
    assert_eq!(next, 3, "recording goes on");
    serving.incident_opened(&summary(next, Vec::new())).await.unwrap();
    serving.incident_finished(&finished(summary(next, Vec::new()))).await.unwrap();
    assert_eq!(ids(&serving, IncidentFilter::default()).await, [3, 1]);
    let refused = serving.forget_incidents(vec![1], by_hand(Action::IncidentRemoved)).await;
    assert!(refused.is_err(), "nothing is removed without its record");
    drop(serving);
    aside(|| repair(folder, Clock::start()).unwrap());
    let repaired = open(folder);
    assert_eq!(ids(&repaired, IncidentFilter::default()).await, [1]);
    assert_eq!(repaired.next_incident_number(3).await.unwrap(), 4);
    repaired.close().await;
    aside(|| restore(folder, Some(&backup), Clock::start()).unwrap());
    let restored = open(folder);
    assert_eq!(ids(&restored, IncidentFilter::default()).await, [1]);
}

/// Does what has an async runtime of its own.
fn aside<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    std::thread::scope(|scope| scope.spawn(work).join().unwrap())
}

/// Takes away the page of the vehicle's state, and leaves all others as they are.
fn damage(folder: &Path) {
    use std::os::unix::fs::FileExt as _;
    let path = folder.join(FILE_NAME);
    let connection = Connection::open(&path).unwrap();
    let sql = "SELECT rootpage FROM sqlite_schema WHERE name = 'vehicle'";
    let page: u64 = connection.query_row(sql, [], |row| row.get::<_, i64>(0)).unwrap().unsigned_abs();
    drop(connection);
    let file = std::fs::File::options().write(true).open(path).unwrap();
    file.write_all_at(&[0xff; 4096], (page - 1) * 4096).unwrap();
}
