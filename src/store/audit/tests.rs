use std::path::PathBuf;

use super::*;
use crate::clock::Clock;
use crate::engine::time::Span;
use crate::store::{Breach, DemoSecrets, FILE_NAME};

/// A data folder with some records, and without the store that wrote them.
struct Folder(PathBuf);

impl Folder {
    async fn with_records(name: &str, count: u64) -> Folder {
        let folder =
            Folder(std::env::temp_dir().join(format!("telltale-audit-{name}-{}", std::process::id())));
        let _ = std::fs::remove_dir_all(&folder.0);
        let store = folder.store();
        for number in 1..=count {
            let record = Record::of(Action::Login, "127.0.0.1").by("anna", Role::Operator);
            store.audit(record.on(number.to_string())).await.unwrap();
        }
        folder.closed(store);
        folder
    }

    fn store(&self) -> Store {
        Store::open(&self.0, Clock::start(), DemoSecrets::Refused).unwrap()
    }

    /// Waits until the store's thread has noted the head and closed the database.
    fn closed(&self, store: Store) {
        drop(store);
        let expected = self.database(|connection| Head::of(connection).unwrap());
        while read_head(&self.0.join(HEAD_FILE_NAME)).unwrap() != Some(expected) {
            std::thread::yield_now();
        }
    }

    fn database<T>(&self, use_it: impl FnOnce(&Connection) -> T) -> T {
        let connection = Connection::open(self.0.join(FILE_NAME)).unwrap();
        connection.busy_timeout(std::time::Duration::from_secs(5)).unwrap();
        use_it(&connection)
    }

    fn run(&self, sql: &str) {
        self.database(|connection| connection.execute_batch(sql).unwrap());
    }

    fn breach(&self) -> Option<Breach> {
        verify_audit_in(&self.0, &[]).unwrap().0.breach
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // What a failed test leaves behind lies in the folder for that.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[tokio::test]
async fn the_verifier_names_the_first_record_that_was_tampered_with() {
    // Whoever writes a whole chain anew is found by the head alone.
    let forged = {
        let mut sql = String::new();
        let mut last = Hash::NONE;
        for number in 1..=20 {
            let hash = chain::hash(last, number, 1, ["eve", "", "", "login", "", "done"]);
            sql += &format!(
                "UPDATE audit SET at_ms = 1, who = 'eve', role = '', source = '', target = '', hash = x'{hash}'
                 WHERE number = {number};"
            );
            last = hash;
        }
        sql
    };
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
        (&forged, Some(20)),
    ];
    for (sql, expected) in cases {
        let folder = Folder::with_records("tampered", 20).await;
        folder.run(sql);
        let breach = folder.breach();
        assert_eq!(breach.as_ref().map(|breach| breach.number), expected, "{sql}: {breach:?}");
    }
}

#[tokio::test]
async fn a_log_that_was_cut_stays_found_out_when_it_goes_on() {
    let folder = Folder::with_records("cut", 20).await;
    folder.run("DELETE FROM audit WHERE number > 10");
    let store = folder.store();
    for _ in 0..30 {
        store.audit(Record::of(Action::Logout, TELLTALE)).await.unwrap();
    }
    folder.closed(store);
    let breach = folder.breach().unwrap();
    assert!(breach.number == 11 && breach.what.contains("20:"), "{breach:?}");
}

#[tokio::test]
async fn a_head_that_was_noted_elsewhere_finds_a_chain_that_was_written_anew() {
    let folder = Folder::with_records("elsewhere", 5).await;
    let head = verify_audit_in(&folder.0, &[]).unwrap().0.head;
    let (verdict, _) = verify_audit_in(&folder.0, &[Head::parse(&head.to_string()).unwrap()]).unwrap();
    assert_eq!((verdict.records, verdict.breach), (5, None));
    let other = Folder::with_records("anew", 5).await;
    let breach = verify_audit_in(&other.0, &[head]).unwrap().0.breach.unwrap();
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
        store.audit(record).await.unwrap();
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
    let folder = Folder::with_records("pruned", 1).await;
    let mut connection = Connection::open(folder.0.join(FILE_NAME)).unwrap();
    let transaction = connection.transaction().unwrap();
    for _ in 0..3 * PRUNE_AT_ONCE {
        let last = append(&transaction, &Record::of(Action::Stop, TELLTALE), SystemTime::UNIX_EPOCH).unwrap();
        prune(&transaction, last, KEPT, SystemTime::UNIX_EPOCH).unwrap();
    }
    transaction.commit().unwrap();
    let (verdict, _) = verify_audit_in(&folder.0, &[]).unwrap();
    assert_eq!(verdict.breach, None);
    assert!(verdict.records < KEPT + PRUNE_AT_ONCE + 2 && verdict.head.number > 3000, "{verdict:?}");
    let first = verdict.head.number - verdict.records + 1;
    folder.run(&format!("DELETE FROM audit WHERE number = {first}"));
    assert_eq!(folder.breach().map(|breach| breach.number), Some(first), "it was kept");
}

#[tokio::test]
async fn a_head_that_cannot_be_read_is_not_called_missing() {
    let folder = Folder::with_records("unreadable", 3).await;
    let head = folder.0.join(HEAD_FILE_NAME);
    let noted = std::fs::read(&head).unwrap();
    // As for a file of somebody else, whoever runs the tests.
    std::fs::remove_file(&head).unwrap();
    std::fs::create_dir(&head).unwrap();
    let names = |error: String| {
        assert!(error.contains(head.to_str().unwrap()) && error.contains("which cannot be read"), "{error}");
        assert!(error.contains("it belongs to the user") && error.contains("Give it to"), "{error}");
    };
    names(Store::open(&folder.0, Clock::start(), DemoSecrets::Refused).unwrap_err().to_string());
    names(verify_audit_in(&folder.0, &[]).unwrap_err().to_string());
    // The display starts, says so, and writes nothing until it can.
    let (clock, hand) = Clock::with_hand();
    let store = Store::open_or_read(&folder.0, clock, DemoSecrets::Refused).unwrap();
    names(store.fault().borrow().as_deref().unwrap().to_owned());
    // Between the two it looked once more.
    for _ in 0..2 {
        assert!(store.audit(Record::of(Action::Start, TELLTALE)).await.is_err());
    }
    std::fs::remove_dir(&head).unwrap();
    std::fs::write(&head, &noted).unwrap();
    hand.advance(Span::from_secs(5));
    store.fault().wait_for(Option::is_none).await.unwrap();
    store.audit(Record::of(Action::Start, TELLTALE)).await.unwrap();
    folder.closed(store);
    let (verdict, _) = verify_audit_in(&folder.0, &[]).unwrap();
    assert_eq!((verdict.records, verdict.breach), (4, None), "nothing was lost, so nothing says so");
}

#[tokio::test]
async fn a_file_that_holds_no_head_is_as_good_as_none() {
    for text in [b"".as_slice(), b"\xff\xfe", b"4:00\n"] {
        let folder = Folder::with_records("none", 3).await;
        std::fs::write(folder.0.join(HEAD_FILE_NAME), text).unwrap();
        folder.closed(folder.store());
        let (verdict, _) = verify_audit_in(&folder.0, &[]).unwrap();
        assert_eq!((verdict.records, verdict.breach), (4, None), "its loss is a record");
    }
}

#[test]
fn what_is_not_there_is_not_made() {
    let folder = std::env::temp_dir().join(format!("telltale-audit-none-{}", std::process::id()));
    let error = verify_audit_in(&folder, &[]).unwrap_err().to_string();
    assert!(error.contains("there is no database") && error.contains("--data"), "{error}");
    assert!(!folder.exists());
}
