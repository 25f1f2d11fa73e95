//! The database file: its settings, and its schema with all migrations.

use std::path::{Path, PathBuf};
use std::time::Duration;
use telltale_yaml::private_file::{make_folder, make_private_file};

use rusqlite::{Connection, OpenFlags, TransactionBehavior, ffi};

use super::files::{odd_beside, put_odd_aside};
use super::{backup, foreign};
use crate::StoreError;

/// The database in the data folder.
pub const FILE_NAME: &str = "telltale.db";

/// The largest number of a record of the audit log: only damage gives a larger one.
pub(crate) const RECORD_NUMBER_MAX: u64 = 1 << 62;

/// How long to wait for another process that writes.
pub(crate) const LOCK_WAIT: Duration = Duration::from_secs(2);

/// The same for a server that opens it: the pages wait for that, and it can do without writing at first.
pub(crate) const OPEN_WAIT: Duration = Duration::from_millis(500);

/// Step N takes schema N to N + 1. Steps are never edited after a release, only added.
pub(super) const MIGRATIONS: &[&str] = &[
    "
    CREATE TABLE users (
        id INTEGER PRIMARY KEY,
        name TEXT NOT NULL UNIQUE,
        role TEXT NOT NULL CHECK (role IN ('operator', 'developer', 'control_room', 'engineer', 'authority')),
        secret_hash TEXT NOT NULL,
        created_ms INTEGER NOT NULL
    ) STRICT;
    CREATE TABLE sessions (
        token_hash BLOB PRIMARY KEY CHECK (length(token_hash) = 32),
        user INTEGER NOT NULL REFERENCES users(id) ON DELETE CASCADE,
        created_ms INTEGER NOT NULL,
        expires_ms INTEGER NOT NULL,
        used_ms INTEGER NOT NULL DEFAULT 0
    ) STRICT, WITHOUT ROWID;
    CREATE INDEX sessions_by_user ON sessions(user);
    CREATE TABLE tokens (
        number INTEGER PRIMARY KEY AUTOINCREMENT,
        token_hash BLOB NOT NULL UNIQUE CHECK (length(token_hash) = 32),
        user INTEGER NOT NULL REFERENCES users(id) ON DELETE CASCADE,
        label TEXT NOT NULL,
        created_ms INTEGER NOT NULL,
        expires_ms INTEGER NOT NULL
    ) STRICT;
    CREATE INDEX tokens_by_user ON tokens(user);
    -- Browsers from which a user logged in before.
    CREATE TABLE devices (
        token_hash BLOB PRIMARY KEY CHECK (length(token_hash) = 32),
        user INTEGER NOT NULL REFERENCES users(id) ON DELETE CASCADE,
        created_ms INTEGER NOT NULL
    ) STRICT, WITHOUT ROWID;
    CREATE INDEX devices_by_user ON devices(user);
    CREATE TABLE user_changes (
        one INTEGER PRIMARY KEY CHECK (one = 1),
        made INTEGER NOT NULL,
        taken_in INTEGER NOT NULL
    ) STRICT;
    INSERT INTO user_changes VALUES (1, 0, 0);
    -- The operator in charge.
    CREATE TABLE seat (
        one INTEGER PRIMARY KEY CHECK (one = 1),
        user INTEGER NOT NULL REFERENCES users(id) ON DELETE CASCADE
    ) STRICT;

    CREATE TABLE audit (
        number INTEGER PRIMARY KEY,
        at_ms INTEGER NOT NULL,
        who TEXT NOT NULL,
        role TEXT NOT NULL,
        source TEXT NOT NULL,
        action TEXT NOT NULL,
        target TEXT NOT NULL,
        outcome TEXT NOT NULL,
        hash BLOB NOT NULL CHECK (length(hash) = 32)
    ) STRICT;
    CREATE INDEX audit_by_action ON audit(action);
    -- Identifies the key with which the audit log is written.
    CREATE TABLE audit_key (
        one INTEGER PRIMARY KEY CHECK (one = 1),
        id BLOB NOT NULL CHECK (length(id) = 32)
    ) STRICT;

    CREATE TABLE vehicle (
        one INTEGER PRIMARY KEY CHECK (one = 1),
        stage TEXT NOT NULL,
        posed INTEGER NOT NULL,
        pose_number INTEGER,
        pose_x_m REAL,
        pose_y_m REAL,
        pose_yaw_deg REAL,
        last_alarm INTEGER NOT NULL
    ) STRICT;
    -- Where the vehicle was last known to be.
    CREATE TABLE last_known_place (
        one INTEGER PRIMARY KEY CHECK (one = 1),
        x_m REAL NOT NULL,
        y_m REAL NOT NULL,
        yaw_deg REAL NOT NULL,
        driven INTEGER NOT NULL
    ) STRICT;
    -- urgency: the highest of the fault of the alarm.
    CREATE TABLE alarms (
        id INTEGER PRIMARY KEY,
        node TEXT NOT NULL,
        raised_ms INTEGER NOT NULL,
        acknowledged INTEGER NOT NULL,
        active INTEGER NOT NULL,
        urgency TEXT
    ) STRICT;
    CREATE TABLE accepted (node TEXT PRIMARY KEY) STRICT, WITHOUT ROWID;
    -- stopped_ms: since when the operator asks for it too.
    CREATE TABLE countermeasures (
        number INTEGER PRIMARY KEY,
        request TEXT NOT NULL,
        mps2 REAL,
        since_ms INTEGER NOT NULL,
        stopped_ms INTEGER
    ) STRICT;
    CREATE TABLE causes (
        countermeasure INTEGER NOT NULL REFERENCES countermeasures(number) ON DELETE CASCADE,
        position INTEGER NOT NULL,
        node TEXT NOT NULL,
        acknowledged INTEGER NOT NULL,
        PRIMARY KEY (countermeasure, position)
    ) STRICT, WITHOUT ROWID;
    CREATE TABLE beat (one INTEGER PRIMARY KEY CHECK (one = 1), count INTEGER NOT NULL) STRICT;
    INSERT INTO beat VALUES (1, 0);

    -- Incidents apart from their recordings. causes has each node between two line feeds.
    CREATE TABLE incidents (
        id INTEGER PRIMARY KEY,
        since_ms INTEGER NOT NULL,
        until_ms INTEGER,
        marked INTEGER NOT NULL,
        kept INTEGER NOT NULL,
        bytes INTEGER NOT NULL,
        finished INTEGER NOT NULL,
        sha256 TEXT,
        stage TEXT NOT NULL,
        causes TEXT NOT NULL,
        summary TEXT NOT NULL,
        note TEXT NOT NULL DEFAULT '',
        note_by TEXT NOT NULL DEFAULT '',
        note_ms INTEGER NOT NULL DEFAULT 0
    ) STRICT;
    CREATE TABLE incident_number (one INTEGER PRIMARY KEY CHECK (one = 1), last INTEGER NOT NULL) STRICT;
",
    "
    -- The nodes whose rules ask for a countermeasure.
    CREATE TABLE asking (
        countermeasure INTEGER NOT NULL REFERENCES countermeasures(number) ON DELETE CASCADE,
        node TEXT NOT NULL,
        PRIMARY KEY (countermeasure, node)
    ) STRICT, WITHOUT ROWID;
    -- The modules whose ERROR stays until somebody resets it.
    CREATE TABLE latched (node TEXT PRIMARY KEY) STRICT, WITHOUT ROWID;
",
];

/// Waits so long for another process; [`go_on`] makes the connection wait as all others do.
pub(crate) fn open(folder: &Path, wait: Duration) -> Result<Connection, StoreError> {
    let folder_error = |reason| StoreError::Folder { path: folder.to_owned(), reason };
    make_folder(folder).map_err(folder_error)?;
    let path = folder.join(FILE_NAME);
    // SQLite would make an empty database of it, and nobody could log in any more.
    let trace = backup::trace_of_database(folder);
    if !backup::holds_something(folder)
        && let Some(trace) = &trace
    {
        return Err(gone(path, trace));
    }
    make_private_file(&path).map_err(folder_error)?;
    put_odd_aside(&path).map_err(folder_error)?;
    let open_error = |reason| StoreError::Open { path: path.clone(), reason };
    let mut connection = Connection::open(&path).map_err(open_error)?;
    // SQLite opens a file that it may not write for reading only, and reports that at the first write.
    if connection.is_readonly(rusqlite::MAIN_DB).map_err(open_error)? {
        return Err(open_error(rusqlite::Error::SqliteFailure(ffi::Error::new(ffi::SQLITE_READONLY), None)));
    }
    configure(&connection, wait).map_err(open_error)?;
    migrate(&mut connection, &path, trace.as_deref())?;
    // Damage that is found now does not keep the display from starting; damage that is found later would.
    match damage_of_state(&connection) {
        Some(what) => Err(StoreError::Damaged { path, what }),
        None => Ok(connection),
    }
}

fn gone(path: PathBuf, trace: &str) -> StoreError {
    StoreError::Damaged { path, what: format!("it is gone or empty, and {trace} shows that there was one") }
}

/// The database is opened: from now on it waits for others as long as anybody does.
pub(crate) fn go_on(connection: &Connection) -> rusqlite::Result<()> {
    connection.busy_timeout(LOCK_WAIT)
}

/// Damage in all tables but the audit log, which may be large, and in the schema; `None` if there is none.
fn damage_of_state(connection: &Connection) -> Option<String> {
    if let Some(strange) = foreign::strange_in(connection).or_else(|| odd_numbers(connection)) {
        return Some(strange);
    }
    let sql =
        "SELECT name FROM sqlite_schema WHERE type = 'table' AND name NOT IN ('audit', 'sqlite_sequence')";
    let names = |query: &mut rusqlite::Statement<'_>| {
        query.query_map([], |row| row.get(0))?.collect::<rusqlite::Result<Vec<String>>>()
    };
    let tables = match connection.prepare(sql).and_then(|mut query| names(&mut query)) {
        Ok(tables) => tables,
        Err(error) => return Some(error.to_string()),
    };
    tables.iter().find_map(|table| found_by(connection, &format!("PRAGMA integrity_check('{table}')")))
}

/// Damage in a database; `None` if there is none.
pub(crate) fn damage_of(connection: &Connection) -> Option<String> {
    let has_users = connection.query_row("SELECT count(*) FROM users", [], |_| Ok(()));
    has_users
        .err()
        .map(|error| error.to_string())
        .or_else(|| found_by(connection, "PRAGMA integrity_check(10)"))
        .or_else(|| foreign::strange_in(connection))
        .or_else(|| odd_numbers(connection))
        .or_else(|| refused(connection))
}

/// A row that a table of today's schema refuses. A connection for reading only does not check that by itself.
fn refused(connection: &Connection) -> Option<String> {
    if !connection.is_readonly("main").is_ok_and(|it| it) {
        return None;
    }
    let today = open_in_memory().ok()?;
    let mut query = today
        .prepare("SELECT name, sql FROM sqlite_schema WHERE type = 'table' AND sql LIKE '%CHECK%'")
        .ok()?;
    let tables = query.query_map([], |row| Ok((row.get(0)?, row.get(1)?))).ok()?;
    for (table, sql) in tables.filter_map(Result::<(String, String), _>::ok) {
        for check in checks(&sql) {
            let sql = format!("SELECT count(*) FROM {table} WHERE NOT ({check})");
            // A backup of an older schema may lack the table.
            let Ok(count) = connection.query_row(&sql, [], |row| row.get::<_, i64>(0)) else { continue };
            if count > 0 {
                return Some(format!("CHECK constraint failed in {table}"));
            }
        }
    }
    None
}

/// The conditions behind each CHECK of a table.
fn checks(sql: &str) -> impl Iterator<Item = &str> {
    sql.split("CHECK (").skip(1).filter_map(|rest| {
        let mut open = 1;
        let end = rest.find(|letter| {
            open += i32::from(letter == '(') - i32::from(letter == ')');
            open == 0
        });
        rest.get(..end?)
    })
}

/// A number in the audit log after which no record can be written.
fn odd_numbers(connection: &Connection) -> Option<String> {
    let sql = "SELECT (SELECT min(number) FROM audit), (SELECT max(number) FROM audit)";
    let ends = connection.query_row(sql, [], |row| Ok([row.get::<_, Option<i64>>(0)?, row.get(1)?]));
    let is_odd = |number: &i64| *number < 1 || number.unsigned_abs() > RECORD_NUMBER_MAX;
    match ends {
        Ok(ends) => {
            let odd = ends.into_iter().flatten().find(is_odd)?;
            Some(format!("a record of the audit log has the number {odd}"))
        }
        Err(error) => Some(error.to_string()),
    }
}

fn found_by(connection: &Connection, check: &str) -> Option<String> {
    match connection.query_row(check, [], |row| row.get::<_, String>(0)) {
        Ok(found) if found == "ok" => None,
        Ok(found) => Some(found),
        Err(error) => Some(error.to_string()),
    }
}

/// The database of a folder, which must exist.
pub(crate) fn existing(folder: &Path) -> Result<PathBuf, StoreError> {
    let path = folder.join(FILE_NAME);
    match path.try_exists() {
        Ok(true) => Ok(path),
        Ok(false) => Err(StoreError::NoDatabase { path }),
        Err(reason) => Err(StoreError::Folder { path: folder.to_owned(), reason }),
    }
}

/// Opens a database of today's schema for reading only: on a disk that is full or read-only.
pub(crate) fn open_reading(folder: &Path) -> Result<Connection, StoreError> {
    let (connection, path, found) = read_only(folder, OPEN_WAIT)?;
    let known = MIGRATIONS.len() as u32;
    if found != known {
        return Err(StoreError::Newer { path, found, known });
    }
    Ok(connection)
}

/// Opens a database of any schema for reading. Also returns its path and its schema.
pub(crate) fn read_only(folder: &Path, wait: Duration) -> Result<(Connection, PathBuf, u32), StoreError> {
    let path = existing(folder)?;
    let open = |parameter: &str| {
        let connection = connect_reading(&path, parameter, wait)?;
        let found: u32 = connection.pragma_query_value(None, "user_version", |row| row.get(0))?;
        connection.query_row("SELECT count(*) FROM users", [], |_| Ok(()))?;
        Ok((connection, found))
    };
    let log = std::fs::metadata(folder.join(format!("{FILE_NAME}-wal")));
    let is_whole = log.map_or(true, |log| log.len() == 0);
    // Without a log beside it the database is one file, and needs none of the files that a log needs.
    let opened = open("mode=ro").or_else(|error| if is_whole { open("immutable=1") } else { Err(error) });
    match opened {
        Ok((connection, found)) => Ok((connection, path, found)),
        Err(reason) => Err(StoreError::Open { path, reason }),
    }
}

/// A connection for reading only, with a parameter of SQLite: `mode=ro`, or `immutable=1` for a file that
/// nobody writes.
pub(crate) fn connect_reading(path: &Path, parameter: &str, wait: Duration) -> rusqlite::Result<Connection> {
    if let Some(odd) = odd_beside(path) {
        return Err(rusqlite::Error::InvalidPath(odd));
    }
    let flags =
        OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_URI | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(uri(path, parameter), flags)?;
    connection.busy_timeout(wait)?;
    Ok(connection)
}

/// A path as a URI of SQLite, with a parameter.
fn uri(path: &Path, parameter: &str) -> String {
    let escaped: String = path.to_string_lossy().chars().fold(String::new(), |mut uri, letter| {
        match letter {
            '%' => uri.push_str("%25"),
            '?' => uri.push_str("%3f"),
            '#' => uri.push_str("%23"),
            _ => uri.push(letter),
        }
        uri
    });
    format!("file:{escaped}?{parameter}")
}

pub(crate) fn open_in_memory() -> Result<Connection, StoreError> {
    let mut connection = Connection::open_in_memory()?;
    configure(&connection, LOCK_WAIT)?;
    migrate(&mut connection, Path::new(":memory:"), None)?;
    Ok(connection)
}

fn configure(connection: &Connection, wait: Duration) -> rusqlite::Result<()> {
    connection.busy_timeout(wait)?;
    connection.pragma_update_and_check(None, "journal_mode", "WAL", |_| Ok(()))?;
    connection.pragma_update(None, "synchronous", "FULL")?;
    connection.pragma_update(None, "foreign_keys", true)?;
    connection.pragma_update(None, "trusted_schema", false)
}

/// An empty database of today's schema in one new file, without a write-ahead log beside it.
pub(crate) fn make_new(path: &Path) -> Result<Connection, StoreError> {
    let open_error = |reason| StoreError::Open { path: path.to_owned(), reason };
    make_private_file(path).map_err(|reason| StoreError::Folder { path: path.to_owned(), reason })?;
    let mut connection = Connection::open(path).map_err(open_error)?;
    migrate(&mut connection, path, None)?;
    Ok(connection)
}

/// If a `trace` shows that there was a database here, no empty one is made.
fn migrate(connection: &mut Connection, path: &Path, trace: Option<&str>) -> Result<(), StoreError> {
    let open_error = |reason| StoreError::Open { path: path.to_owned(), reason };
    let known = MIGRATIONS.len() as u32;
    // The lock is taken before the version is read, because two processes may start at once.
    let transaction =
        connection.transaction_with_behavior(TransactionBehavior::Immediate).map_err(open_error)?;
    let found: u32 =
        transaction.pragma_query_value(None, "user_version", |row| row.get(0)).map_err(open_error)?;
    if found > known {
        return Err(StoreError::Newer { path: path.to_owned(), found, known });
    }
    if found == known {
        // Nothing is written: a full disk must not keep the display from starting.
        return Ok(());
    }
    if let (0, Some(trace)) = (found, trace) {
        return Err(gone(path.to_owned(), trace));
    }
    for step in &MIGRATIONS[found as usize..] {
        transaction.execute_batch(step).map_err(open_error)?;
    }
    transaction.pragma_update(None, "user_version", known).map_err(open_error)?;
    transaction.commit().map_err(open_error)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DemoSecrets, Role, Store};
    use telltale_clock::Clock;
    use telltale_engine::time::Span;

    #[tokio::test]
    async fn users_sessions_and_the_operator_in_charge_outlive_a_restart() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let store = Store::open(folder, Clock::start(), DemoSecrets::Refused).unwrap();
        store.add_user("anna", Role::Operator, "135791").await.unwrap();
        let user = store.authenticate("anna", "135791").await.unwrap().unwrap();
        let (token, before) = store.open_session(&user).await.unwrap();
        store.put_in_charge("anna").await.unwrap();
        drop(store);

        let store = Store::open(folder, Clock::start(), DemoSecrets::Refused).unwrap();
        let session = store.session(&token).unwrap();
        assert_eq!((&*session.user, session.role), ("anna", Role::Operator));
        assert!(session.expires <= before.expires, "a restart makes no session longer");
        assert_eq!(store.operator_in_charge().await.unwrap().as_deref(), Some("anna"));
        store.close().await;
        let file = std::fs::read(folder.join(FILE_NAME)).unwrap();
        let wal = std::fs::read(folder.join(format!("{FILE_NAME}-wal"))).unwrap_or_default();
        for secret in [b"135791".as_slice(), token.as_str().as_bytes()] {
            let holds = |bytes: &[u8]| bytes.windows(secret.len()).any(|window| window == secret);
            assert!(!holds(&file) && !holds(&wal), "a secret lies on the disk");
        }
    }

    #[tokio::test]
    async fn a_database_that_cannot_be_written_is_read_until_it_can() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let store = Store::open(folder, Clock::start(), DemoSecrets::Refused).unwrap();
        store.add_user("anna", Role::Operator, "135791").await.unwrap();
        let user = store.authenticate("anna", "135791").await.unwrap().unwrap();
        let (token, _) = store.open_session(&user).await.unwrap();
        store.put_in_charge("anna").await.unwrap();
        let reading = Store::read(folder, "no room", Clock::start(), DemoSecrets::Refused).unwrap();
        assert_eq!(reading.fault().borrow().as_deref(), Some("no room"));
        assert!(reading.session(&token).is_some());
        assert_eq!(reading.operator_in_charge().await.unwrap().as_deref(), Some("anna"));
        let mut fault = reading.fault();
        fault.wait_for(Option::is_none).await.unwrap();
        reading.open_session(&user).await.expect("it is written again");
        assert!(reading.session(&token).is_some());
    }

    #[tokio::test]
    async fn beside_a_database_that_another_program_locks_a_server_starts_within_three_seconds() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let store = Store::open(folder, Clock::start(), DemoSecrets::Refused).unwrap();
        store.add_user("anna", Role::Operator, "135791").await.unwrap();
        store.close().await;
        let other = Connection::open(folder.join(FILE_NAME)).unwrap();
        other.execute_batch("BEGIN EXCLUSIVE").unwrap();
        let clock = Clock::start();
        let began = clock.now();
        let store = Store::open_or_read(folder, clock, DemoSecrets::Refused).unwrap();
        // Its first jobs wait for none of its attempts to write.
        assert!(store.has_users().await.unwrap());
        store.recall().await.unwrap();
        assert!(clock.now().since(began) < Span::from_secs(3), "{:?}", clock.now().since(began));
        assert!(store.fault().borrow().as_deref().is_some_and(|fault| fault.contains("locked")));
        other.execute_batch("COMMIT").unwrap();
        let mut fault = store.fault();
        let mended = fault.wait_for(Option::is_none);
        tokio::time::timeout(std::time::Duration::from_secs(60), mended)
            .await
            .expect("it is mended")
            .unwrap();
    }

    #[tokio::test]
    async fn a_record_after_which_none_can_be_written_is_damage_that_a_repair_leaves_out() {
        for number in [i64::MAX, -1000] {
            let temporary = tempfile::tempdir().unwrap();
            let folder = temporary.path();
            let store = Store::open_or_read(folder, Clock::start(), DemoSecrets::Refused).unwrap();
            store.add_user("anna", Role::Operator, "135791").await.unwrap();
            let other = Connection::open(folder.join(FILE_NAME)).unwrap();
            let sql = "INSERT INTO audit SELECT ?1, at_ms, who, role, source, action, target, outcome, hash FROM audit LIMIT 1";
            other.execute(sql, [number]).unwrap();
            drop(other);
            // A server that runs goes on, in memory if it must.
            let user = store.authenticate("anna", "135791").await.unwrap().unwrap();
            store.open_session(&user).await.unwrap();
            store.close().await;
            let store = Store::open_or_read(folder, Clock::start(), DemoSecrets::Refused).unwrap();
            assert!(store.fault().borrow().as_deref().is_some_and(|it| it.contains(&number.to_string())));
            assert!(store.authenticate("anna", "135791").await.unwrap().is_some());
            store.close().await;
            let path = folder.to_owned();
            let repair = move || crate::repair(&path, Clock::start()).unwrap();
            tokio::task::spawn_blocking(repair).await.unwrap();
            let store = Store::open_or_read(folder, Clock::start(), DemoSecrets::Refused).unwrap();
            assert_eq!(store.fault().borrow().as_deref(), None);
            store.add_user("berta", Role::Operator, "246802").await.unwrap();
        }
    }

    #[test]
    fn a_folder_or_file_that_cannot_be_used_says_which_and_what_to_do() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let open = || Store::open(folder, Clock::start(), DemoSecrets::Refused).unwrap_err().to_string();
        drop(super::open(folder, LOCK_WAIT).unwrap());
        let path = folder.join(FILE_NAME);
        let newer = Connection::open(&path).unwrap();
        newer.pragma_update(None, "user_version", MIGRATIONS.len() as u32 + 1).unwrap();
        drop(newer);
        let error = open();
        assert!(error.contains(path.to_str().unwrap()) && error.contains("newer telltale"), "{error}");
        let display = Store::open_or_read(folder, Clock::start(), DemoSecrets::Refused).unwrap();
        assert!(display.fault().borrow().as_deref().is_some_and(|fault| fault.contains("newer telltale")));
        drop(display);
        std::fs::write(&path, [b'x'; 4096]).unwrap();
        let error = open();
        assert!(error.contains(path.to_str().unwrap()) && error.contains("--data"), "{error}");
        let inside_a_file = Store::open(&path, Clock::start(), DemoSecrets::Refused).unwrap_err().to_string();
        assert!(inside_a_file.contains("cannot be used") && inside_a_file.contains("--data"));
    }
}
