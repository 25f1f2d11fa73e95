//! Copies the readable part of a damaged database, row by row, into a whole one.
//!
//! A server that finds its database damaged works on such a copy in memory. `telltale data repair` makes
//! one on the disk.

use std::fs::Permissions;
use std::io;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::time::Duration;

use rusqlite::types::Value;
use rusqlite::{Connection, Row, params, params_from_iter};
use tempfile::TempDir;

use crate::audit::known::Known;
use crate::audit::{KEY_FILE_NAME, Key, Log};
use crate::database::{backup, schema};
use crate::users::secret::NOBODY;
use crate::{Database, FILE_NAME, SessionKind, StoreError, note_largest_incident};
use telltale_clock::unix_ms;

/// A folder whose files lie in memory.
const MEMORY: &str = "/dev/shm";
/// A larger database, or its log, is not copied there.
const COPY_BYTES_MAX: u64 = 256 << 20;

/// The number of rows of one table that fit into memory, whatever a damaged file claims to hold.
const ROWS_IN_MEMORY_MAX: usize = 100_000;

/// The result of copying a damaged database.
#[derive(Debug, Default)]
pub(crate) struct Salvaged {
    /// The data that are lost or older than they should be, for people; empty if everything could be read.
    pub losses: Vec<String>,
    pub users: u64,
}

/// Which of two rows with the same key stays.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Keep {
    Copied,
    Present,
}

/// Copies everything but the audit log into a database in memory, and logs what is missing.
pub(crate) fn into_memory(folder: &Path) -> Result<Connection, StoreError> {
    let mut connection = schema::open_in_memory()?;
    let is_needed = |table: &str| table != "audit";
    let salvaged = salvage(folder, &mut connection, is_needed, ROWS_IN_MEMORY_MAX)?;
    tracing::warn!("{} users can log in until the database is repaired", salvaged.users);
    for loss in &salvaged.losses {
        tracing::warn!("{loss}");
    }
    Ok(connection)
}

/// Removes users and tokens from the copy that the records in the damaged database do not know. If these know nobody, the
/// records of the newest backup count. Where not all records can be read, nobody can tell: all stay.
fn leave_out_foreign(folder: &Path, from: &Connection, copy: &Connection) -> Result<Vec<String>, StoreError> {
    let Some(key) = Key::read(&folder.join(KEY_FILE_NAME)).ok().flatten() else { return Ok(Vec::new()) };
    match Known::read(from, &key) {
        Ok(known) if known.is_empty() => match backup::newest(folder) {
            Some((_, backup)) => Known::read(&backup, &key)?.keep_known(copy),
            None => Ok(Vec::new()),
        },
        Ok(known) => known.keep_known(copy),
        Err(error) => {
            tracing::warn!(%error, "users cannot be compared with the audit log");
            Ok(Vec::new())
        }
    }
}

/// The report of a server that goes on with a copy in memory.
pub(crate) fn fault(folder: &Path, damage: &str) -> String {
    let path = folder.join(FILE_NAME);
    format!(
        "the database {} is damaged ({damage}): stop telltale, run `telltale data repair` and start it again",
        path.display()
    )
}

impl Database {
    /// Leaves a database that was found damaged as it is, and goes on with a copy in memory. Returns the
    /// fault.
    pub(crate) fn go_on_in_memory(&mut self, damage: &str) -> String {
        let Some(folder) = self.health.folder().map(Path::to_owned) else {
            return format!("the database is damaged: {damage}");
        };
        match self.replacement(&folder) {
            Ok((connection, log, data_version)) => {
                // It is not closed: SQLite would write into it, and others might remove its log.
                std::mem::forget(std::mem::replace(&mut self.connection, connection));
                self.log = log;
                // Nobody else changes the copy, and its sessions are those that are open.
                self.data_version = data_version;
                self.health.is_salvaged(&fault(&folder, damage));
            }
            Err(error) => tracing::error!(%error, "what can be read of the database cannot be copied"),
        }
        fault(&folder, damage)
    }

    fn replacement(&self, folder: &Path) -> Result<(Connection, Log, i64), StoreError> {
        let mut connection = into_memory(folder)?;
        // Open sessions stay, whether or not they and their users could be read. Nobody knows the secret of such a user.
        let (wall, now) = (self.clock.wall(), self.clock.now());
        let sessions = self.sessions.all();
        for session in sessions.iter().filter(|session| session.kind == SessionKind::Person) {
            let left = Duration::from_nanos(session.expires.since(now).as_nanos());
            connection.execute(
                "INSERT OR IGNORE INTO users (name, role, secret_hash, created_ms) VALUES (?1, ?2, ?3, ?4)",
                params![&*session.user, session.role.as_str(), NOBODY, unix_ms(wall)],
            )?;
            connection.execute(
                "INSERT OR IGNORE INTO sessions (token_hash, user, created_ms, expires_ms, used_ms)
                 SELECT ?1, id, ?3, ?4, ?3 FROM users WHERE name = ?2",
                params![session.key(), &*session.user, unix_ms(wall), unix_ms(wall + left)],
            )?;
        }
        let log = Log::open(&mut connection, None, wall)?;
        let data_version = connection.pragma_query_value(None, "data_version", |row| row.get(0))?;
        Ok((connection, log, data_version))
    }
}

/// Copies everything into an empty database of today's schema.
pub(crate) fn into_new(folder: &Path, new: &mut Connection) -> Result<Salvaged, StoreError> {
    salvage(folder, new, |_| true, usize::MAX)
}

fn salvage(
    folder: &Path,
    to: &mut Connection,
    is_needed: impl Fn(&str) -> bool,
    rows_max: usize,
) -> Result<Salvaged, StoreError> {
    let mut losses = Vec::new();
    let broken = open_broken(folder, &mut losses);
    let mut unread = Vec::new();
    to.pragma_update(None, "foreign_keys", false)?;
    let transaction = to.transaction()?;
    for table in tables(&transaction)?.iter().filter(|table| is_needed(table)) {
        let is_whole = match &broken {
            Some(from) => copy(from, &transaction, table, Keep::Copied, rows_max)?,
            None => false,
        };
        if !is_whole {
            unread.push(table.clone());
        }
    }
    if !unread.is_empty() {
        losses.push(match &broken {
            Some(_) => format!("not all could be read of: {}", unread.join(", ")),
            None => "nothing could be read of the database".to_owned(),
        });
    }
    // Users are needed to log in, the audit log has to be as complete as possible, and recordings of yesterday
    // have not changed. Yesterday's sessions, tokens and vehicle would only mislead.
    for table in ["users", "audit", "audit_key", "incidents"]
        .into_iter()
        .filter(|it| unread.iter().any(|table| table == it))
    {
        match backup::newest(folder) {
            Some((file, from)) => {
                copy(&from, &transaction, table, Keep::Present, rows_max)?;
                losses.push(format!("what is missing of {table} is as it was in {}", file.display()));
            }
            None => losses.push(format!("there is no backup from which {table} could be completed")),
        }
    }
    if unread.iter().any(|table| table == "countermeasures") {
        losses.push(
            "a request that holds the vehicle may be missing: the page does not show it, and the vehicle stays held until \
             the next clearance or release"
                .to_owned(),
        );
    }
    note_largest_incident(&transaction)?;
    if let Some(from) = &broken {
        let foreign = leave_out_foreign(folder, from, &transaction)?;
        if !foreign.is_empty() {
            losses
                .push(format!("no record of the audit log knows, so it is left out: {}", foreign.join(", ")));
        }
    }
    drop_orphans(&transaction)?;
    // The next record has the number after the largest one.
    transaction
        .execute("DELETE FROM audit WHERE number < 1 OR number > ?1", [schema::RECORD_NUMBER_MAX as i64])?;
    let users = transaction.query_row("SELECT count(*) FROM users", [], |row| row.get::<_, i64>(0))?;
    transaction.commit()?;
    to.pragma_update(None, "foreign_keys", true)?;
    Ok(Salvaged { losses, users: users.unsigned_abs() })
}

/// Copies all rows of a table that can be read into one of the same name.
pub(crate) fn copy_all(from: &Connection, to: &Connection, table: &str) -> Result<bool, StoreError> {
    copy(from, to, table, Keep::Copied, usize::MAX)
}

/// Opens a database that may be damaged, to read as much of it as possible.
fn open_broken(folder: &Path, losses: &mut Vec<String>) -> Option<Connection> {
    let path = folder.join(FILE_NAME);
    // SQLite takes the log of an empty file for a leftover and removes it.
    if !std::fs::metadata(&path).is_ok_and(|file| file.len() > 0) {
        return None;
    }
    let open = |path: &Path, parameter| {
        let connection = schema::connect_reading(path, parameter, schema::LOCK_WAIT).ok()?;
        // With this setting one damaged entry of the schema does not hide all others.
        connection.pragma_update(None, "writable_schema", true).ok()?;
        let readable = connection.query_row("SELECT count(*) FROM sqlite_schema", [], |_| Ok(()));
        readable.is_ok().then_some(connection)
    };
    if let Some(connection) = open(&path, "mode=ro") {
        return Some(connection);
    }
    let log = folder.join(format!("{FILE_NAME}-wal"));
    if std::fs::metadata(&log).is_ok_and(|log| log.len() > 0) {
        // The files are open, so they stay until the connection is closed.
        let copied = copy_elsewhere(&path, &log);
        if let Some(connection) =
            copied.as_ref().ok().and_then(|copy| open(&copy.path().join(FILE_NAME), "mode=ro"))
        {
            return Some(connection);
        }
        let why = copied.err().map_or(String::new(), |why| format!(" ({why})"));
        losses.push(format!("{} could not be read{why}: the last changes are missing", log.display()));
    }
    open(&path, "immutable=1")
}

/// Copies a database with its log into memory: SQLite makes an index file beside a log, for which a full or read-only
/// disk has no room.
fn copy_elsewhere(database: &Path, log: &Path) -> io::Result<TempDir> {
    let private = Permissions::from_mode(0o700);
    let copy = tempfile::Builder::new().prefix("telltale-").permissions(private).tempdir_in(MEMORY)?;
    for file in [database, log] {
        let bytes = std::fs::metadata(file)?.len();
        if bytes > COPY_BYTES_MAX {
            return Err(io::Error::other(format!("{} has {bytes} bytes", file.display())));
        }
        std::fs::copy(file, copy.path().join(file.file_name().unwrap_or_default()))?;
    }
    Ok(copy)
}

fn tables(connection: &Connection) -> Result<Vec<String>, StoreError> {
    let sql = "SELECT name FROM sqlite_schema WHERE type = 'table' AND name NOT LIKE 'sqlite_%'";
    let mut query = connection.prepare(sql)?;
    Ok(query.query_map([], |row| row.get(0))?.collect::<Result<_, _>>()?)
}

/// Copies the rows of a table from both ends: rows between two damaged pages are lost. Returns whether all
/// could be read.
fn copy(
    from: &Connection,
    to: &Connection,
    table: &str,
    keep: Keep,
    rows_max: usize,
) -> Result<bool, StoreError> {
    let mut columns: Vec<(String, i64)> = Vec::new();
    let mut query = to.prepare(&format!("PRAGMA table_info({table})"))?;
    for column in query.query_map([], |row| Ok((row.get(1)?, row.get(5)?)))? {
        columns.push(column?);
    }
    let names: Vec<&str> = columns.iter().map(|(name, _)| name.as_str()).collect();
    let mut keys: Vec<&(String, i64)> = columns.iter().filter(|(_, place)| *place > 0).collect();
    keys.sort_by_key(|(_, place)| *place);
    let marks = vec!["?"; names.len()].join(", ");
    let or = if keep == Keep::Copied { "REPLACE" } else { "IGNORE" };
    let names = names.join(", ");
    let mut is_whole = true;
    let mut insert = to.prepare(&format!("INSERT OR {or} INTO {table} ({names}) VALUES ({marks})"))?;
    for order in ["ASC", "DESC"] {
        let keys: Vec<String> = keys.iter().map(|(name, _)| format!("{name} {order}")).collect();
        let sql = format!("SELECT {names} FROM {table} NOT INDEXED ORDER BY {}", keys.join(", "));
        let mut put = |row: &Row<'_>| -> Result<(), StoreError> {
            let values: Result<Vec<Value>, _> = (0..columns.len()).map(|column| row.get(column)).collect();
            // A row that today's schema refuses was damaged, too.
            let is_refused = |error: &rusqlite::Error| {
                error.sqlite_error_code() == Some(rusqlite::ErrorCode::ConstraintViolation)
            };
            match values.map(|values| insert.execute(params_from_iter(values))) {
                Ok(Err(error)) if !is_refused(&error) => return Err(error.into()),
                Ok(Ok(_)) => {}
                Ok(Err(_)) | Err(_) => is_whole = false,
            }
            Ok(())
        };
        if read_all(from, &sql, rows_max, &mut put)? {
            return Ok(is_whole);
        }
    }
    Ok(false)
}

/// Reads as far as possible. Returns whether that was to the end.
fn read_all(
    from: &Connection,
    sql: &str,
    rows_max: usize,
    put: &mut dyn FnMut(&Row<'_>) -> Result<(), StoreError>,
) -> Result<bool, StoreError> {
    let Ok(mut query) = from.prepare(sql) else { return Ok(false) };
    let Ok(mut rows) = query.query([]) else { return Ok(false) };
    for _ in 0..rows_max {
        match rows.next() {
            Ok(Some(row)) => put(row)?,
            Ok(None) => return Ok(true),
            Err(_) => return Ok(false),
        }
    }
    Ok(false)
}

/// Removes rows that belong to something that could not be read.
fn drop_orphans(connection: &Connection) -> Result<(), StoreError> {
    for table in tables(connection)? {
        let mut query = connection.prepare(&format!("PRAGMA foreign_key_list({table})"))?;
        let links = query.query_map([], |row| Ok((row.get(2)?, row.get(3)?, row.get(4)?)))?;
        let links: Vec<(String, String, String)> = links.collect::<Result<_, _>>()?;
        for (parent, from, to) in links {
            connection.execute(
                &format!("DELETE FROM {table} WHERE {from} NOT IN (SELECT {to} FROM {parent})"),
                [],
            )?;
        }
    }
    Ok(())
}
