//! Tests of damaged databases: how a server starts on one, and what a repair saves.

use std::os::unix::fs::{FileExt as _, PermissionsExt as _};
use std::time::UNIX_EPOCH;

use super::*;
use crate::{Database, Entering, Role, VehicleMemory};
use telltale_engine::restart::resume::Restored;
use telltale_engine::time::Timestamp;
use telltale_record::summary::{Recording, Summary};

/// No wait is longer, even for a slow disk.
const WITHIN: std::time::Duration = std::time::Duration::from_secs(60);
const USERS: u64 = 300;
const LATE: Timestamp = Timestamp::from_millis(u32::MAX as u64);

/// A data folder with users, a vehicle and some pages of audit log; no process has it open.
struct Folder(tempfile::TempDir);

impl Folder {
    async fn new() -> Folder {
        let folder = Folder(tempfile::tempdir().unwrap());
        let store = folder.open();
        store.add_user("anna", Role::Operator, "135791").await.unwrap();
        let memory = VehicleMemory { seq: 1, at: UNIX_EPOCH, vehicle: Restored::default() };
        (0..100).for_each(|_| store.note(Record::of(Action::Localize, "here").on("x".repeat(200))));
        store.remember(memory).await.unwrap();
        store.close().await;
        // More users than fit into one page; hashing so many secrets would take a minute.
        let more = format!(
            "INSERT INTO users (name, role, secret_hash, created_ms)
             WITH RECURSIVE n(i) AS (SELECT 2 UNION ALL SELECT i + 1 FROM n WHERE i < {USERS})
             SELECT 'user' || i, 'developer', (SELECT secret_hash FROM users), 0 FROM n"
        );
        Connection::open(folder.file("")).unwrap().execute_batch(&more).unwrap();
        let store = folder.open();
        let known =
            |database: &mut Database| database.change(&as_they_are(&database.connection)?, |_| Ok(()));
        store.call(known).await.unwrap();
        store.close().await;
        folder
    }

    fn open(&self) -> Store {
        Store::open(self.0.path(), Clock::start(), DemoSecrets::Refused).unwrap()
    }

    fn serve(&self) -> Store {
        Store::open_or_read(self.0.path(), Clock::start(), DemoSecrets::Refused)
            .unwrap_or_else(|error| panic!("no display: {error}"))
    }

    fn file(&self, suffix: &str) -> PathBuf {
        self.0.path().join(format!("{FILE_NAME}{suffix}"))
    }

    fn back_up(&self) -> PathBuf {
        backup::make(self.0.path(), UNIX_EPOCH).unwrap()
    }

    /// Overwrites a page with zeroes.
    fn zero(&self, page: u64) {
        let file = File::options().write(true).open(self.file("")).unwrap();
        file.write_all_at(&[0; 4096], page * 4096).unwrap();
    }

    fn pages(&self) -> u64 {
        fs::metadata(self.file("")).unwrap().len() / 4096
    }
}

async fn can_log_in(store: &Store) -> bool {
    let Ok(Some(user)) = store.authenticate("anna", "135791").await else { return false };
    let vehicle = Some(VehicleMemory { seq: 2, at: UNIX_EPOCH, vehicle: Restored::default() });
    let entering = Entering { user: &user, before: None, vehicle, from: None, stay: Vec::new() };
    let record = Record::of(Action::Login, "here");
    let Ok((token, written)) = store.enter(entering, vec![record], LATE).await else { return false };
    store.entered(written).unwrap();
    store.session(&token).is_some()
}

/// Runs the probe of the storage now instead of in a few seconds.
async fn look_after(store: &Store) {
    let look = |database: &mut Database| {
        database.health.doubt();
        database.probe_if_due();
        Ok(())
    };
    store.call(look).await.unwrap();
}

#[tokio::test]
async fn whatever_page_is_zeroed_there_is_a_display_with_a_login() {
    let folder = Folder::new().await;
    folder.back_up();
    let whole = fs::read(folder.file("")).unwrap();
    let (mut degraded, pages) = (0, folder.pages());
    assert!(pages > 15, "{pages}");
    for page in 0..pages {
        fs::write(folder.file(""), &whole).unwrap();
        folder.zero(page);
        let store = folder.serve();
        // The first record alone needs some pages.
        if !can_log_in(&store).await {
            look_after(&store).await;
            assert!(can_log_in(&store).await, "page {page}");
        }
        let fault = store.fault().borrow().clone();
        if let Some(fault) = fault {
            degraded += 1;
            assert!(fault.contains("damaged") && fault.contains("telltale data repair"), "{fault}");
            let cleared = Record::of(Action::Clearance, "here");
            let refused = store.write_ahead(&cleared, None, LATE, ()).await.unwrap_err();
            assert!(refused.is_of_storage(), "no record, no clearance: {refused}");
            assert!(store.verify_audit().await.is_err(), "the log in memory is not the one on the disk");
        }
        store.close().await;
    }
    assert!(degraded > 5, "{degraded} of {pages}");
}

#[tokio::test]
async fn a_file_that_is_cut_overwritten_empty_or_gone_is_no_new_database() {
    let folder = Folder::new().await;
    folder.back_up();
    let whole = fs::read(folder.file("")).unwrap();
    let broken: [(&str, Option<Vec<u8>>); 6] = [
        ("gone", None),
        ("empty", Some(Vec::new())),
        ("garbage", Some(vec![b'x'; 20_000])),
        ("cut", Some(whole[..whole.len() / 2].to_vec())),
        ("cut to one page", Some(whole[..4096].to_vec())),
        ("cut within a page", Some(whole[..5000].to_vec())),
    ];
    for (how, bytes) in broken {
        let _ = fs::remove_file(folder.file(""));
        if let Some(bytes) = &bytes {
            fs::write(folder.file(""), bytes).unwrap();
        }
        let error =
            Store::open(folder.0.path(), Clock::start(), DemoSecrets::Refused).unwrap_err().to_string();
        assert!(error.contains("data repair") || error.contains("data check"), "{how}: {error}");
        let store = folder.serve();
        let fault = store.fault().borrow().clone();
        assert!(fault.is_some_and(|fault| fault.contains("damaged")), "{how}");
        assert!(can_log_in(&store).await, "{how}");
        store.close().await;
        assert_eq!(fs::read(folder.file("")).ok(), bytes, "{how}: what is left was changed");
        assert!(check_data(folder.0.path()).unwrap().damage.is_some(), "{how}");
    }
}

#[tokio::test]
async fn a_log_that_is_garbage_or_gone_leaves_a_display() {
    for how in ["garbage", "gone"] {
        let folder = Folder::new().await;
        folder.back_up();
        let store = folder.open();
        store.add_user("bert", Role::Operator, "135791").await.unwrap();
        let [database, log] = ["", "-wal"].map(|suffix| fs::read(folder.file(suffix)).unwrap());
        store.close().await;
        fs::write(folder.file(""), database).unwrap();
        if how == "garbage" {
            fs::write(folder.file("-wal"), vec![7; log.len()]).unwrap();
        }
        let store = folder.serve();
        assert!(can_log_in(&store).await, "{how}");
        store.close().await;
    }
}

#[tokio::test]
async fn without_a_backup_what_can_be_read_is_used() {
    let folder = Folder::new().await;
    let connection = Connection::open(folder.file("")).unwrap();
    let sql = "SELECT rootpage FROM sqlite_schema WHERE name = ?1";
    let root = |name: &str| connection.query_row(sql, [name], |row| row.get::<_, u32>(0)).unwrap();
    let (index, table) = (root("sqlite_autoindex_users_1"), root("users"));
    let whole = fs::read(folder.file("")).unwrap();
    drop(connection);
    folder.zero(u64::from(index) - 1);
    let store = folder.serve();
    assert!(store.fault().borrow().is_some() && can_log_in(&store).await, "the table is whole");
    assert_eq!(store.users().await.unwrap().len() as u64, USERS);
    store.close().await;

    fs::write(folder.file(""), whole).unwrap();
    folder.zero(u64::from(table) - 1);
    let store = folder.serve();
    assert!(!can_log_in(&store).await, "the root of the table is gone");
    let asked = store.has_users().await.unwrap_err();
    assert!(asked.is_of_storage(), "nobody is told to add a user: {asked}");
    store.close().await;
    assert!(matches!(repair(folder.0.path(), Clock::start()), Err(StoreError::NothingToSave { .. })));
    assert!(!folder.file(".new").exists() && folder.file("").exists());
}

#[test]
fn a_row_that_the_schema_refuses_is_damage_and_its_loss_is_said() {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let folder = runtime.block_on(Folder::new());
    let store = folder.open();
    let recording = Recording { finished: true, ..Recording::default() };
    let removed = Record::of(Action::IncidentRemoved, COMMAND_LINE);
    runtime.block_on(async {
        store.incident_finished(&Summary { id: 7, recording, ..Summary::default() }).await.unwrap();
        store.forget_incidents(vec![7], removed).await.unwrap();
        store.close().await;
    });
    let backup = folder.back_up();
    let spoil = |file: &Path, sql: &str| {
        let connection = Connection::open(file).unwrap();
        connection.execute_batch(&format!("PRAGMA ignore_check_constraints = ON; {sql}")).unwrap();
    };
    let role = "UPDATE users SET role = 'operatos' WHERE name = 'anna'";
    spoil(&folder.file(""), &format!("{role}; DELETE FROM incident_number"));
    let state = check_data(folder.0.path()).unwrap();
    assert_eq!(state.damage.as_deref(), Some("CHECK constraint failed in users"));
    assert_eq!(state.backups[0].damage, None);
    let repaired = repair(folder.0.path(), Clock::start()).unwrap();
    assert!(repaired.losses[0].contains("users") && repaired.losses[1].contains("backups"), "{repaired:?}");
    assert_eq!(repaired.users, USERS);
    let store = folder.serve();
    runtime.block_on(async {
        assert!(can_log_in(&store).await, "the user is as in the backup");
        assert_eq!(store.next_incident_number(0).await.unwrap(), 8, "a number is never used twice");
        store.close().await;
    });
    // A backup of another vehicle.
    fs::remove_file(folder.0.path().join(KEY_FILE_NAME)).unwrap();
    fs::remove_file(folder.0.path().join(HEAD_FILE_NAME)).unwrap();
    runtime.block_on(folder.serve().close());
    let (_, restored) = restore(folder.0.path(), Some(&backup), Clock::start()).unwrap();
    assert!(restored.losses[1].contains("another audit.key"), "{restored:?}");
    // A database without what its log had.
    let _ = fs::remove_file(folder.file("-wal"));
    fs::copy(&backup, folder.file("")).unwrap();
    let damage = check_data(folder.0.path()).unwrap().damage.unwrap();
    assert!(damage.contains("audit.head says"), "{damage}");
    spoil(&backup, role);
    assert!(check_data(folder.0.path()).unwrap().backups[0].damage.is_some());
}

#[test]
fn a_repair_saves_what_can_be_read_and_takes_the_rest_from_the_backup() {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let folder = runtime.block_on(Folder::new());
    assert_eq!(check_data(folder.0.path()).unwrap().damage, None);
    folder.back_up();
    let whole = fs::read(folder.file("")).unwrap();
    for page in 0..folder.pages() {
        fs::write(folder.file(""), &whole).unwrap();
        folder.zero(page);
        if check_data(folder.0.path()).unwrap().damage.is_none() {
            continue;
        }
        let repaired = repair(folder.0.path(), Clock::start()).unwrap();
        assert_eq!(repaired.users, USERS, "page {page}: {repaired:?}");
        assert!(repaired.kept.join(FILE_NAME).exists());
        assert_eq!(check_data(folder.0.path()).unwrap().damage, None, "page {page}");
        let store = folder.serve();
        assert_eq!(*store.fault().borrow(), None, "page {page}");
        // All users are recorded as they are.
        let records = runtime.block_on(store.audit_entries(None, 1000)).unwrap();
        assert_eq!(records.iter().filter(|it| it.action == Action::Localize.as_str()).count(), 100);
        assert!(records.iter().any(|it| it.action == Action::DataRepaired.as_str()), "page {page}");
        assert!(runtime.block_on(can_log_in(&store)), "page {page}");
        runtime.block_on(store.close());
        let _ = fs::remove_file(folder.0.path().join("audit.head"));
        fs::remove_dir_all(&repaired.kept).unwrap();
    }
}

#[test]
fn a_backup_is_whole_private_and_no_session_comes_back_with_it() {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let folder = runtime.block_on(Folder::new());
    let store = folder.open();
    assert!(runtime.block_on(can_log_in(&store)));
    let file = folder.back_up();
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
    assert_eq!((mode(&file), mode(file.parent().unwrap())), (0o600, 0o700));
    runtime.block_on(store.remove_user("user7")).unwrap();
    runtime.block_on(store.close());

    let (taken, repaired) = restore(folder.0.path(), None, Clock::start()).unwrap();
    assert_eq!((&taken, repaired.users), (&file, USERS));
    let store = folder.serve();
    assert!(store.sessions().is_empty());
    assert_eq!(runtime.block_on(store.operator_in_charge()).unwrap(), None);
    let newest = runtime.block_on(store.audit_entries(None, 2)).unwrap();
    // The users that this test wrote into the database are told behind it.
    let restored = newest.iter().find(|it| it.action == "data restored").unwrap();
    assert_eq!(&*restored.target, file.to_str().unwrap());
    runtime.block_on(store.close());

    // A copy that is not whole does not count.
    fs::write(&file, vec![0; 9000]).unwrap();
    assert!(check_data(folder.0.path()).unwrap().backups[0].damage.is_some());
    assert!(matches!(restore(folder.0.path(), None, Clock::start()), Err(StoreError::NoBackup { .. })));
    assert!(matches!(restore(folder.0.path(), Some(&file), Clock::start()), Err(StoreError::Backup { .. })));
}

#[tokio::test]
async fn a_database_that_breaks_while_it_is_served_lets_people_log_in_and_stay() {
    let folder = Folder::new().await;
    let store = folder.serve();
    let user = store.authenticate("anna", "135791").await.unwrap().unwrap();
    let (token, session) = store.open_session(&user).await.unwrap();
    // Otherwise the log or the cache would be read instead of the page.
    let spoil = |database: &mut Database| {
        database.connection.query_row("PRAGMA wal_checkpoint(TRUNCATE)", [], |_| Ok(()))?;
        Ok(database.connection.execute_batch("PRAGMA cache_size = 0; PRAGMA shrink_memory")?)
    };
    store.call(spoil).await.unwrap();
    let sql = "SELECT rootpage FROM sqlite_schema WHERE name = 'audit'";
    let page =
        |database: &mut Database| Ok(database.connection.query_row(sql, [], |row| row.get::<_, u32>(0))?);
    let page = store.call(page).await.unwrap();
    std::process::Command::new("dd")
        .args(["if=/dev/zero", "bs=4096", "count=1", "conv=notrunc", "status=none"])
        .args([format!("of={}", folder.file("").display()), format!("seek={}", page - 1)])
        .status()
        .unwrap();
    assert!(!can_log_in(&store).await, "the root of the audit log is gone");
    look_after(&store).await;
    let fault = store.fault().borrow().clone();
    assert!(fault.is_some_and(|fault| fault.contains("data repair")));
    assert!(session.is_open() && store.session(&token).is_some(), "who was logged in is");
    assert!(can_log_in(&store).await);
    store
        .end_session(
            &session,
            Record::of(Action::Logout, "here"),
            Timestamp::from_millis(u64::from(u32::MAX)),
        )
        .await
        .unwrap();
    assert!(!session.is_open());
    store.close().await;
}

#[tokio::test]
async fn seven_backups_are_kept_and_none_is_made_of_what_is_damaged() {
    let folder = Folder::new().await;
    let day = |day: u64| UNIX_EPOCH + std::time::Duration::from_secs(day * 24 * 3600);
    for number in 0..9 {
        let file = backup::make(folder.0.path(), day(number)).unwrap();
        assert_eq!(backup::make(folder.0.path(), day(number)).unwrap(), file, "one a day");
    }
    let kept = backup::list(folder.0.path());
    assert_eq!(kept.len(), 7);
    assert!(kept[0].ends_with("telltale-1970-01-09.db") && kept[6].ends_with("telltale-1970-01-03.db"));
    let last = folder.pages() - 1;
    folder.zero(last);
    let refused = backup::make(folder.0.path(), day(20)).unwrap_err();
    assert!(matches!(refused, backup::BackupError::Database(_)), "{refused}");
    assert_eq!(backup::list(folder.0.path()), kept, "those that are whole stay");
}

#[tokio::test]
async fn the_newest_backup_has_the_last_records_also_with_an_early_day() {
    let folder = Folder::new().await;
    let day = |day: u64| UNIX_EPOCH + std::time::Duration::from_secs(day * 24 * 3600);
    // The clock was ahead, and is behind now.
    for number in 400..407 {
        backup::make(folder.0.path(), day(number)).unwrap();
    }
    let store = folder.open();
    store.remove_user("user7").await.unwrap();
    store.close().await;
    let newest = backup::make(folder.0.path(), day(1)).unwrap();
    let kept = backup::list(folder.0.path());
    assert_eq!((kept.len(), &kept[0]), (7, &newest));
    assert_eq!(backup::newest(folder.0.path()).unwrap().0, newest);
}

#[tokio::test]
async fn a_server_backs_up_soon_after_its_start_after_a_change_of_users_and_each_day() {
    use telltale_engine::time::Span;
    let folder = Folder::new().await;
    let (clock, hand) = Clock::with_hand();
    let store = Store::open_or_read(folder.0.path(), clock, DemoSecrets::Refused).unwrap();
    let backup = || backup::list(folder.0.path()).pop();
    // A job is one turn of the store's thread.
    let until_made = async || {
        let made = async {
            loop {
                store.is_ready().await;
                if let Some(file) = backup() {
                    return fs::remove_file(file).unwrap();
                }
                tokio::task::yield_now().await;
            }
        };
        tokio::time::timeout(WITHIN, made).await.expect("a backup is made");
    };
    store.is_ready().await;
    assert_eq!(backup(), None, "others have the disk first");
    hand.advance(Span::from_secs(6));
    until_made().await;
    let other = folder.open();
    other.remove_user("user7").await.unwrap();
    let change = other.last_user_change().await.unwrap();
    let taken_in = async {
        while !other.is_taken_in(change).await.unwrap() {
            store.is_ready().await;
        }
    };
    tokio::time::timeout(WITHIN, taken_in).await.expect("the server takes the change in");
    hand.advance(Span::from_secs(6));
    until_made().await;
    hand.advance(Span::from_secs(25 * 3600));
    until_made().await;
    other.close().await;
    store.close().await;
}

#[tokio::test]
async fn a_repair_makes_no_user_known_whom_no_record_knows() {
    let folder = Folder::new().await;
    let connection = Connection::open(folder.file("")).unwrap();
    connection
        .execute_batch(
            "INSERT INTO users (name, role, secret_hash, created_ms)
             SELECT 'eve', 'authority', secret_hash, 0 FROM users WHERE name = 'anna'",
        )
        .unwrap();
    let root = "SELECT rootpage FROM sqlite_schema WHERE name = 'incidents'";
    let page = connection.query_row(root, [], |row| row.get::<_, u32>(0)).unwrap();
    drop(connection);
    folder.zero(u64::from(page) - 1);
    let data = folder.0.path().to_path_buf();
    let repaired = std::thread::spawn(move || repair(&data, Clock::start()).unwrap()).join().unwrap();
    let store = folder.open();
    assert!(
        store.authenticate("eve", "135791").await.unwrap().is_none() && can_log_in(&store).await,
        "{repaired:?}"
    );
    assert_eq!(store.users().await.unwrap().len() as u64, USERS);
    store.close().await;
}
