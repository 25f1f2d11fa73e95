//! The file, its settings and its schema.

use std::path::Path;
use std::time::Duration;

use rusqlite::{Connection, TransactionBehavior};

use super::StoreError;

/// The database in the data folder.
pub const FILE_NAME: &str = "telltale.db";

/// How long to wait for another process that writes.
const LOCK_WAIT: Duration = Duration::from_secs(2);

/// Step N takes schema N to N + 1. Steps are never edited, only added.
const MIGRATIONS: &[&str] = &["
    CREATE TABLE users (
        id INTEGER PRIMARY KEY,
        name TEXT NOT NULL UNIQUE,
        role TEXT NOT NULL CHECK (role IN ('operator', 'developer', 'authority')),
        secret_hash TEXT NOT NULL,
        created_ms INTEGER NOT NULL
    ) STRICT;
    CREATE TABLE sessions (
        token_hash BLOB PRIMARY KEY CHECK (length(token_hash) = 32),
        user INTEGER NOT NULL REFERENCES users(id) ON DELETE CASCADE,
        created_ms INTEGER NOT NULL,
        expires_ms INTEGER NOT NULL
    ) STRICT, WITHOUT ROWID;
    CREATE INDEX sessions_by_user ON sessions(user);
    CREATE TABLE seat (
        one INTEGER PRIMARY KEY CHECK (one = 1),
        user INTEGER NOT NULL REFERENCES users(id) ON DELETE CASCADE
    ) STRICT;
"];

pub(super) fn open(folder: &Path) -> Result<Connection, StoreError> {
    let folder_error = |reason| StoreError::Folder { path: folder.to_owned(), reason };
    make_folder(folder).map_err(folder_error)?;
    let path = folder.join(FILE_NAME);
    make_private_file(&path).map_err(folder_error)?;
    let open_error = |reason| StoreError::Open { path: path.clone(), reason };
    let mut connection = Connection::open(&path).map_err(open_error)?;
    configure(&connection).map_err(open_error)?;
    migrate(&mut connection, &path)?;
    Ok(connection)
}

pub(super) fn open_in_memory() -> Result<Connection, StoreError> {
    let mut connection = Connection::open_in_memory()?;
    configure(&connection)?;
    migrate(&mut connection, Path::new(":memory:"))?;
    Ok(connection)
}

fn configure(connection: &Connection) -> rusqlite::Result<()> {
    connection.busy_timeout(LOCK_WAIT)?;
    connection.pragma_update_and_check(None, "journal_mode", "WAL", |_| Ok(()))?;
    connection.pragma_update(None, "synchronous", "FULL")?;
    connection.pragma_update(None, "foreign_keys", true)?;
    connection.pragma_update(None, "trusted_schema", false)
}

fn migrate(connection: &mut Connection, path: &Path) -> Result<(), StoreError> {
    let open_error = |reason| StoreError::Open { path: path.to_owned(), reason };
    let known = MIGRATIONS.len() as u32;
    // The lock is taken before the version is read: two processes may start at once.
    let transaction =
        connection.transaction_with_behavior(TransactionBehavior::Immediate).map_err(open_error)?;
    let found: u32 =
        transaction.pragma_query_value(None, "user_version", |row| row.get(0)).map_err(open_error)?;
    if found > known {
        return Err(StoreError::Newer { path: path.to_owned(), found, known });
    }
    for step in &MIGRATIONS[found as usize..] {
        transaction.execute_batch(step).map_err(open_error)?;
    }
    transaction.pragma_update(None, "user_version", known).map_err(open_error)?;
    transaction.commit().map_err(open_error)
}

#[cfg(unix)]
fn make_folder(folder: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::DirBuilderExt;
    std::fs::DirBuilder::new().recursive(true).mode(0o700).create(folder)
}

#[cfg(not(unix))]
fn make_folder(folder: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)
}

/// The file holds hashes of secrets: nobody else may read it, whatever the umask.
fn make_private_file(path: &Path) -> std::io::Result<()> {
    let mut options = std::fs::OpenOptions::new();
    options.append(true).create(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    options.open(path).map(drop)
}
