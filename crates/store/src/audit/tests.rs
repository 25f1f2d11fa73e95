//! Tests of the audit log: a change in it is found.

use super::*;
use crate::{Breach, DemoSecrets, FILE_NAME, Head, Incidents};
use telltale_clock::Clock;
use telltale_engine::time::Span;
use telltale_record::summary::{Recording, Summary};

/// A data folder with some records; the store that wrote them is closed.
struct Folder(tempfile::TempDir);

impl Folder {
    async fn with_records(count: u64) -> Folder {
        let folder = Folder(tempfile::tempdir().unwrap());
        let store = folder.store();
        for number in 1..=count {
            let record = Record::of(Action::Login, "127.0.0.1").by("anna", Role::Operator);
            store.record_in_time(record.on(number.to_string())).await;
        }
        store.close().await;
        folder
    }

    fn store(&self) -> Store {
        Store::open(self.0.path(), Clock::start(), DemoSecrets::Refused).unwrap()
    }

    fn database<T>(&self, use_it: impl FnOnce(&Connection) -> T) -> T {
        let connection = Connection::open(self.0.path().join(FILE_NAME)).unwrap();
        connection.busy_timeout(std::time::Duration::from_secs(5)).unwrap();
        use_it(&connection)
    }

    fn run(&self, sql: &str) {
        self.database(|connection| connection.execute_batch(sql).unwrap());
    }

    fn verdict(&self) -> Verdict {
        verify_audit_in(self.0.path(), &[], None).unwrap()
    }

    fn key(&self) -> Key {
        Key::read(&self.0.path().join(KEY_FILE_NAME)).unwrap().unwrap()
    }

    /// Rebuilds the chain with other people in it, without the key.
    fn forge(&self, records: u64) {
        let (mut last, mut sql) = (Hash::NONE, String::new());
        for number in 1..=records {
            last = chain::hash(None, last, number, 1, ["eve", "", "", "login", "", "done"]);
            sql += &format!(
                "UPDATE audit SET at_ms = 1, who = 'eve', role = '', source = '', target = '', hash = x'{last}'
                 WHERE number = {number};"
            );
        }
        self.run(&sql);
    }

    /// Writes the present end of the chain into the file beside the database.
    fn note(&self) {
        let head = self.database(|connection| Head::of(connection).unwrap());
        std::fs::write(self.0.path().join(HEAD_FILE_NAME), head.to_string()).unwrap();
    }

    fn breach(&self) -> Option<Breach> {
        self.verdict().breach
    }
}

#[tokio::test]
async fn the_verifier_names_the_first_record_that_was_tampered_with() {
    let cases = [
        ("", None),
        ("UPDATE audit SET who = 'eve' WHERE number = 7", Some(7)),
        ("UPDATE audit SET outcome = 'done ' WHERE number = 1", Some(1)),
        ("UPDATE audit SET at_ms = at_ms + 1 WHERE number = 20", Some(20)),
        ("UPDATE audit SET who = '', role = 'anna' WHERE number = 3", Some(3)),
        ("UPDATE audit SET hash = zeroblob(32) WHERE number = 9", Some(9)),
        ("DELETE FROM audit WHERE number = 1", Some(1)),
        ("DELETE FROM audit WHERE number = 12", Some(12)),
        (
            "DELETE FROM audit WHERE number = 12; UPDATE audit SET number = number - 1 WHERE number > 12",
            Some(12),
        ),
        ("DELETE FROM audit WHERE number > 15", Some(16)),
        ("DELETE FROM audit WHERE number = 20", Some(20)),
        ("DELETE FROM audit", Some(1)),
        ("UPDATE audit SET number = 21 WHERE number = 20", Some(20)),
        (
            "INSERT INTO audit SELECT 0, at_ms, who, role, source, action, target, outcome, hash
             FROM audit WHERE number = 4",
            Some(1),
        ),
    ];
    for (sql, expected) in cases {
        let folder = Folder::with_records(20).await;
        folder.run(sql);
        let breach = folder.breach();
        assert_eq!(breach.as_ref().map(|breach| breach.number), expected, "{sql}: {breach:?}");
        let says = |what: &str| breach.as_ref().is_some_and(|breach| breach.what.contains(what));
        assert!(!sql.starts_with("DELETE") || sql.contains(';') || says("is missing"), "{sql}: {breach:?}");
        // One that stands before the first makes none of the others look changed.
        assert!(!sql.starts_with("INSERT") || folder.verdict().records == 20, "{sql}: {breach:?}");
    }
}

#[tokio::test]
async fn without_the_file_of_the_head_a_head_from_elsewhere_alone_says_that_nothing_was_cut() {
    let folder = Folder::with_records(20).await;
    let head = folder.verdict().head;
    std::fs::remove_file(folder.0.path().join(HEAD_FILE_NAME)).unwrap();
    let breach = folder.breach().expect("nobody can tell whether the end is there");
    assert!(breach.number == 21 && breach.what.contains("there is no audit.head"), "{breach:?}");
    assert_eq!(verify_audit_in(folder.0.path(), &[head], None).unwrap().breach, None);
    folder.run("DELETE FROM audit WHERE number > 15");
    for heads in [&[][..], &[head]] {
        let breach = verify_audit_in(folder.0.path(), heads, None).unwrap().breach;
        assert_eq!(breach.map(|breach| breach.number), Some(16), "{heads:?}");
    }
}

#[tokio::test]
async fn a_log_that_was_cut_stays_found_out_when_it_goes_on() {
    let folder = Folder::with_records(20).await;
    folder.run("DELETE FROM audit WHERE number > 10");
    let store = folder.store();
    for _ in 0..30 {
        store.record_in_time(Record::of(Action::Logout, TELLTALE)).await;
    }
    store.close().await;
    let breach = folder.breach().unwrap();
    assert!(breach.number == 11 && breach.what.contains("20:"), "{breach:?}");
}

#[tokio::test]
async fn a_head_that_was_noted_elsewhere_finds_a_chain_that_was_written_anew() {
    let folder = Folder::with_records(5).await;
    let head = folder.verdict().head;
    let verdict = verify_audit_in(folder.0.path(), &[Head::parse(&head.to_string()).unwrap()], None).unwrap();
    assert_eq!((verdict.records, verdict.breach), (5, None));
    let other = Folder::with_records(5).await;
    let breach = verify_audit_in(other.0.path(), &[head], None).unwrap().breach.unwrap();
    assert_eq!(breach.number, 5);
    for text in ["", "5", "5:", "x:00", &format!("5:{}", "0".repeat(63)), &format!("-1:{}", "0".repeat(64))] {
        assert_eq!(Head::parse(text), None, "{text}");
    }
}

#[tokio::test]
async fn the_store_itself_shows_and_verifies_its_log() {
    let store = Store::in_memory(Clock::start(), DemoSecrets::Refused).unwrap();
    let long = "x".repeat(10_000);
    for number in 1..=2500 {
        let record = Record::of(Action::Request, "10.0.0.1").on(number.to_string()).refused(&*long);
        store.record_in_time(record).await;
    }
    let verdict = store.verify_audit().await.unwrap();
    assert_eq!((verdict.records, verdict.head.number, verdict.breach), (2500, 2500, None));
    let page = store.audit_entries(Some(100), 10).await.unwrap();
    assert_eq!((page[0].number, page.len(), page[9].target.as_str()), (99, 10, "90"));
    assert!(page[0].was_refused() && page[0].outcome.chars().count() == FIELD_CHARS_MAX);
}

#[tokio::test]
async fn the_oldest_records_are_taken_away_and_the_chain_still_holds() {
    const KEPT: u64 = 500;
    let folder = Folder::with_records(1).await;
    let key = folder.key();
    let mut connection = Connection::open(folder.0.path().join(FILE_NAME)).unwrap();
    let transaction = connection.transaction().unwrap();
    for _ in 0..3 * PRUNE_AT_ONCE {
        let (stop, wall) = (Record::of(Action::Stop, TELLTALE), SystemTime::UNIX_EPOCH);
        let last = append(&transaction, &key, &stop, wall).unwrap();
        prune(&transaction, &key, last, KEPT, wall).unwrap();
    }
    transaction.commit().unwrap();
    let verdict = folder.verdict();
    assert_eq!(verdict.breach, None);
    assert!(verdict.records < KEPT + PRUNE_AT_ONCE + 2 && verdict.head.number > 3000, "{verdict:?}");
    let first = verdict.head.number - verdict.records + 1;
    folder.run(&format!("DELETE FROM audit WHERE number = {first}"));
    assert_eq!(folder.breach().map(|breach| breach.number), Some(first), "it was kept");
    // An attacker removes more and records it in the program's words, but without the key.
    let base = folder.database(|connection| hash_of(connection, first + 99).unwrap().unwrap());
    let last = folder.verdict().head;
    let target = format!("{PRUNED_UP_TO}{}", Head { number: first + 99, hash: base });
    let fields = ["", "", TELLTALE, "pruned", &target, "done"];
    let hash = chain::hash(None, last.hash, last.number + 1, 1, fields);
    folder.run(&format!(
        "DELETE FROM audit WHERE number < {first} + 100;
         INSERT INTO audit VALUES ({} + 1, 1, '', '', 'telltale', 'pruned', '{target}', 'done', x'{hash}')",
        last.number
    ));
    folder.note();
    assert_eq!(folder.breach().map(|breach| breach.number), Some(last.number + 1));
}

#[tokio::test]
async fn what_pruned_records_said_of_incidents_and_of_a_breach_is_still_known() {
    let folder = Folder::with_records(3).await;
    let store = folder.store();
    let summary = |id| Summary {
        id,
        recording: Recording { finished: true, sha256: Some("ab".repeat(32)), ..Recording::default() },
        ..Summary::default()
    };
    let by_anna = || Record::of(Action::Mark, "127.0.0.1").by("anna", Role::Operator);
    for id in 1..=3 {
        store.incident_finished(&summary(id)).await.unwrap();
    }
    store.record_in_time(by_anna().on("2: here")).await;
    store.set_incident_note(2, "it squeals", by_anna()).await.unwrap();
    store.keep_incident(2, true, by_anna()).await.unwrap();
    store.forget_incidents(vec![3], by_anna()).await.unwrap();
    store.close().await;
    // Somebody changes a record, and removes an incident.
    folder.run("UPDATE audit SET target = 'x' WHERE number = 2; DELETE FROM incidents WHERE id = 1");
    let incidents = || Incidents::open(folder.0.path()).unwrap();
    let (known, evidence) = (incidents().records().unwrap(), folder.breach().unwrap());
    assert!(evidence.number == 2 && known.held().any(|id| id == 1));
    let (key, wall) = (folder.key(), SystemTime::UNIX_EPOCH);
    let mut connection = Connection::open(folder.0.path().join(FILE_NAME)).unwrap();
    let transaction = connection.transaction().unwrap();
    for _ in 0..3 * PRUNE_AT_ONCE {
        let last = append(&transaction, &key, &Record::of(Action::Stop, TELLTALE), wall).unwrap();
        prune(&transaction, &key, last, 500, wall).unwrap();
    }
    transaction.commit().unwrap();
    let (incidents, breach) = (incidents(), folder.breach().unwrap());
    let again = incidents.records().unwrap();
    assert_eq!(
        (&again.hashes, again.removed.len()),
        (&known.hashes.into_iter().filter(|it| it.0 < 3).collect(), 0)
    );
    assert!(again.held().any(|id| id == 1), "it is missed");
    let stored = incidents.stored(2).unwrap().unwrap();
    assert_eq!((again.contradiction(&stored), again.kept(2, None)), (None, Some(true)));
    assert!(again.may_be_note(2, &stored.incident.note.unwrap()));
    assert!(breach.what.contains("the pruned record 2"), "{breach:?}");
}

#[tokio::test]
async fn a_head_that_cannot_be_read_is_not_called_missing() {
    let folder = Folder::with_records(3).await;
    let head = folder.0.path().join(HEAD_FILE_NAME);
    let noted = std::fs::read(&head).unwrap();
    // Like a file of somebody else; tests may run as root.
    std::fs::remove_file(&head).unwrap();
    std::fs::create_dir(&head).unwrap();
    let names = |error: String| {
        assert!(error.contains(head.to_str().unwrap()) && error.contains("which cannot be read"), "{error}");
        assert!(error.contains("it belongs to the user") && error.contains("Give it to"), "{error}");
    };
    names(Store::open(folder.0.path(), Clock::start(), DemoSecrets::Refused).unwrap_err().to_string());
    names(verify_audit_in(folder.0.path(), &[], None).unwrap_err().to_string());
    // The display starts, says so, and writes nothing until it can.
    let (clock, hand) = Clock::with_hand();
    let store = Store::open_or_read(folder.0.path(), clock, DemoSecrets::Refused).unwrap();
    names(store.fault().borrow().as_deref().unwrap().to_owned());
    // In between it looked once more.
    for _ in 0..2 {
        assert!(!store.record(Record::of(Action::Start, TELLTALE), None).await);
    }
    names(store.fault().borrow().as_deref().unwrap().to_owned());
    std::fs::remove_dir(&head).unwrap();
    std::fs::write(&head, &noted).unwrap();
    hand.advance(Span::from_secs(5));
    store.fault().wait_for(Option::is_none).await.unwrap();
    store.record_in_time(Record::of(Action::Start, TELLTALE)).await;
    store.close().await;
    let verdict = folder.verdict();
    assert_eq!((verdict.records, verdict.breach), (6, None), "nothing was lost, so nothing says so");
}

#[tokio::test]
async fn a_pipe_in_place_of_the_head_or_the_key_is_refused_at_once() {
    for name in [HEAD_FILE_NAME, KEY_FILE_NAME] {
        let folder = Folder::with_records(3).await;
        let file = folder.0.path().join(name);
        std::fs::remove_file(&file).unwrap();
        rustix::fs::mknodat(rustix::fs::CWD, &file, rustix::fs::FileType::Fifo, rustix::fs::Mode::RUSR, 0)
            .unwrap();
        let refused =
            Store::open(folder.0.path(), Clock::start(), DemoSecrets::Refused).unwrap_err().to_string();
        assert!(refused.contains(name), "{refused}");
        let refused = verify_audit_in(folder.0.path(), &[], None).unwrap_err().to_string();
        assert!(refused.contains(name), "{refused}");
        // The display goes on, with a login.
        Store::open_or_read(folder.0.path(), Clock::start(), DemoSecrets::Refused).unwrap();
    }
}

#[test]
fn the_head_is_written_through_no_link() {
    let temporary = tempfile::tempdir().unwrap();
    let [victim, file] = ["victim", HEAD_FILE_NAME].map(|name| temporary.path().join(name));
    std::fs::write(&victim, "text").unwrap();
    std::os::unix::fs::symlink(&victim, head::temporary(&file)).unwrap();
    let head = Head::parse(&format!("1:{}", "0".repeat(64))).unwrap();
    head::write_head(&file, head).unwrap_err();
    assert_eq!((std::fs::read(&victim).unwrap(), file.exists()), (b"text".to_vec(), false));
}

#[tokio::test]
async fn a_file_that_holds_no_head_is_as_good_as_none() {
    for text in [b"".as_slice(), b"\xff\xfe", b"4:00\n"] {
        let folder = Folder::with_records(3).await;
        std::fs::write(folder.0.path().join(HEAD_FILE_NAME), text).unwrap();
        folder.store().close().await;
        let verdict = folder.verdict();
        let breach = verdict.breach.map(|breach| breach.number);
        assert_eq!((verdict.records, breach), (4, Some(4)), "its loss is a record, and a breach");
    }
}

#[tokio::test]
async fn what_is_done_to_the_log_while_it_is_written_is_found_with_the_next_record() {
    type Attack = fn(&Folder);
    let attacks: [(&str, Attack, u64); 6] = [
        ("cut", |folder| folder.run("DELETE FROM audit WHERE number > 8"), 9),
        ("emptied", |folder| folder.run("DELETE FROM audit"), 1),
        ("rebuilt", |folder| folder.forge(10), 1),
        ("rebuilt and noted", |folder| (folder.forge(10), folder.note()).1, 1),
        ("head removed", |folder| std::fs::remove_file(folder.0.path().join(HEAD_FILE_NAME)).unwrap(), 11),
        (
            "went on without the key",
            |folder| {
                let last = folder.database(|connection| Head::of(connection).unwrap());
                let hash = chain::hash(None, last.hash, 11, 1, ["eve", "", "", "login", "", "done"]);
                folder.run(&format!(
                    "INSERT INTO audit VALUES (11, 1, 'eve', '', '', 'login', '', 'done', x'{hash}')"
                ));
            },
            11,
        ),
    ];
    for (how, attack, expected) in attacks {
        let folder = Folder::with_records(10).await;
        let store = folder.store();
        let record = || Record::of(Action::Stop, "127.0.0.1");
        // An ordinary record, and the head after it.
        let note = |database: &mut Database| {
            database.log.note_head();
            Ok(())
        };
        store.call(note).await.unwrap();
        attack(&folder);
        for _ in 0..3 {
            store.record_in_time(record()).await;
        }
        let said: Vec<_> =
            store.audit_entries(None, 5).await.unwrap().into_iter().map(|it| it.action).collect();
        let found = if how == "head removed" { "head missing" } else { "chain broken" };
        assert_eq!(said[..4], ["stop", "stop", "stop", found], "{how}: once, before what comes next");
        assert_eq!(store.verify_audit().await.unwrap().breach.map(|it| it.number), Some(expected), "{how}");
        store.close().await;
        assert_eq!(folder.breach().map(|it| it.number), Some(expected), "{how}");
    }
}

#[tokio::test]
async fn what_another_program_of_ours_writes_is_no_breach() {
    let folder = Folder::with_records(3).await;
    let [server, command] = [folder.store(), folder.store()];
    for _ in 0..3 {
        server.record_in_time(Record::of(Action::Stop, "127.0.0.1")).await;
        command.record_in_time(Record::of(Action::UserAdded, COMMAND_LINE)).await;
        command.record_in_time(Record::of(Action::UserAdded, COMMAND_LINE)).await;
    }
    command.close().await;
    server.close().await;
    let verdict = folder.verdict();
    assert_eq!((verdict.records, verdict.breach), (12, None));
}

#[tokio::test]
async fn a_chain_that_was_written_anew_while_nobody_served_needs_the_key() {
    let folder = Folder::with_records(10).await;
    let copy = folder.0.path().join("copy of the key");
    std::fs::copy(folder.0.path().join(KEY_FILE_NAME), &copy).unwrap();
    folder.forge(10);
    folder.note();
    assert_eq!(folder.breach().map(|it| (it.number, it.to)), Some((1, 10)));
    folder.store().close().await;
    let verdict = folder.verdict();
    assert_eq!((verdict.breach.map(|it| it.number), verdict.breaches, verdict.records), (Some(1), 2, 1));
    // Without the key nothing of it can be proven, and every later start says so.
    for gone in [true, false] {
        let folder = Folder::with_records(10).await;
        let key = folder.0.path().join(KEY_FILE_NAME);
        match gone {
            true => std::fs::remove_file(&key).unwrap(),
            false => std::fs::write(&key, format!("{}\n", "ab".repeat(32))).unwrap(),
        }
        assert_eq!(folder.breach().map(|it| it.number), Some(1));
        folder.store().close().await;
        let verdict = folder.verdict();
        assert!(verdict.breach.is_some() && verdict.records == 1, "{verdict:?}");
        let newest = folder.store().audit_entries(None, 1).await.unwrap();
        assert!(newest[0].action == "chain broken" && newest[0].target.contains("audit.key"), "{newest:?}");
    }
}

#[tokio::test]
async fn a_breach_is_one_until_an_authority_acknowledges_it_and_another_is_another() {
    let folder = Folder::with_records(10).await;
    let store = folder.store();
    store.add_user("carl", Role::Authority, "a long password").await.unwrap();
    store.add_user("dora", Role::Developer, "a long password").await.unwrap();
    let carl = store.authenticate("carl", "a long password").await.unwrap().unwrap();
    let dora = store.authenticate("dora", "a long password").await.unwrap().unwrap();
    assert_eq!(store.acknowledge_breaches(&carl, "nothing").await.unwrap(), 0);
    folder.run("UPDATE audit SET who = 'eve' WHERE number = 3; DELETE FROM audit WHERE number = 6");
    std::fs::remove_file(folder.0.path().join(HEAD_FILE_NAME)).unwrap();
    store.record_in_time(Record::of(Action::Stop, "127.0.0.1")).await;
    let refused = store.acknowledge_breaches(&dora, "mine").await.unwrap_err().to_string();
    assert!(refused.contains("dora is no authority"), "{refused}");
    assert_eq!(store.acknowledge_breaches(&carl, "the disk was changed").await.unwrap(), 3);
    store.close().await;
    let verdict = folder.verdict();
    assert_eq!((verdict.breach, verdict.breaches), (None, 0));
    let known = verdict.acknowledged.unwrap();
    assert_eq!((&*known.by, known.count), ("carl", 3));
    // Acknowledged records are not changed again unnoticed.
    folder.run("UPDATE audit SET who = 'mallory' WHERE number = 3");
    let verdict = folder.verdict();
    assert_eq!((verdict.breach.map(|it| it.number), verdict.breaches), (Some(3), 3));
    folder.run("UPDATE audit SET who = 'eve' WHERE number = 3");
    assert_eq!(folder.breach(), None);
    folder.run("UPDATE audit SET who = 'eve' WHERE number = 9");
    assert!(folder.breach().is_some());
}

#[tokio::test]
async fn what_a_process_left_behind_that_was_killed_is_removed() {
    let folder = Folder::with_records(3).await;
    // No process has this number.
    let (left, mine) = (folder.0.path().join("audit.head.4194305"), folder.0.path().join("audit.head.old"));
    for file in [&left, &mine] {
        std::fs::write(file, "3:").unwrap();
    }
    folder.store().close().await;
    assert!(!left.exists() && mine.exists());
}

#[test]
fn what_is_not_there_is_not_made() {
    let folder = tempfile::tempdir().unwrap().path().join("none");
    let error = verify_audit_in(&folder, &[], None).unwrap_err().to_string();
    assert!(error.contains("there is no database") && error.contains("--data"), "{error}");
    assert!(!folder.exists());
}

#[tokio::test]
async fn an_older_database_with_its_head_is_found_with_a_head_from_elsewhere_alone() {
    let folder = Folder::with_records(5).await;
    let files = [FILE_NAME, HEAD_FILE_NAME].map(|name| folder.0.path().join(name));
    let old = files.each_ref().map(|file| std::fs::read(file).unwrap());
    let store = folder.store();
    store.record_in_time(Record::of(Action::UserRemoved, COMMAND_LINE).on("olga")).await;
    store.close().await;
    let head = folder.verdict().head;
    for (file, bytes) in files.iter().zip(&old) {
        std::fs::write(file, bytes).unwrap();
    }
    assert_eq!(folder.breach(), None, "nothing in the folder shows it");
    folder.store().close().await;
    assert_eq!(folder.breach(), None);
    let breach = verify_audit_in(folder.0.path(), &[head], None).unwrap().breach.unwrap();
    assert_eq!(breach.number, 6, "{breach:?}");
}
