//! A history that is damaged: how that is found, what is saved of it, and how another one begins beside it.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use rusqlite::{Connection, ErrorCode, OpenFlags, OptionalExtension as _};

use super::{HISTORY_FILE, prepare};
use crate::StoreError;
use crate::database::files::{odd_beside, put_aside};
use crate::database::foreign::difference;
use crate::disk::salvage;
use telltale_yaml::private_file::make_private_file;

/// The rest of a damaged history that was saved.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SavedHistory {
    pub damage: String,
    pub records: u64,
    /// The folder with the old files.
    pub kept: PathBuf,
}

/// The damage of the history of a data folder; `None` if it is whole, or there is none. A server may run.
pub fn history_damage(folder: &Path) -> Option<String> {
    let path = folder.join(HISTORY_FILE);
    if !fs::metadata(&path).is_ok_and(|file| file.is_file()) {
        return None;
    }
    if let Some(odd) = odd_beside(&path) {
        return Some(format!("{} is no file", odd.display()));
    }
    let looked =
        Connection::open_with_flags(&path, OpenFlags::SQLITE_OPEN_READ_ONLY).and_then(|connection| {
            connection.busy_timeout(Duration::from_secs(2))?;
            let found: String = connection.query_row("PRAGMA quick_check(1)", [], |row| row.get(0))?;
            if found != "ok" {
                return Ok(Some(found));
            }
            if let Some(strange) = strange(&connection)? {
                return Ok(Some(strange));
            }
            let missing = missing(&connection)?;
            Ok((missing > 0).then(|| format!("{missing} of its records were removed")))
        });
    looked.unwrap_or_else(|error| Some(error.to_string()))
}

/// Foreign parts of its schema: a trigger would change records.
pub(super) fn strange(connection: &Connection) -> rusqlite::Result<Option<String>> {
    let known = Connection::open_in_memory()?;
    prepare(&known)?;
    difference(connection, &known)
}

/// Makes the history of a data folder anew of all that can be read of it; `None`: it is whole. No server may run.
///
/// # Errors
/// If it cannot be written: nothing is changed then.
pub fn repair_history(folder: &Path, wall: SystemTime) -> Result<Option<SavedHistory>, StoreError> {
    let Some(damage) = history_damage(folder) else { return Ok(None) };
    let failed = |reason| StoreError::Folder { path: folder.to_owned(), reason };
    let (path, new) = (folder.join(HISTORY_FILE), folder.join(format!("{HISTORY_FILE}.new")));
    let _ = fs::remove_file(&new);
    make_private_file(&new).map_err(failed)?;
    let to = Connection::open(&new)?;
    prepare(&to)?;
    if let Ok(from) = Connection::open_with_flags(&path, OpenFlags::SQLITE_OPEN_READ_ONLY) {
        for table in ["nodes", "records", "alive", "trends", "days"] {
            salvage::copy_all(&from, &to, table)?;
        }
    }
    let records = count(&to)?;
    to.execute("UPDATE alive SET rows = ?1", [records])?;
    drop(to);
    let kept = put_aside(folder, HISTORY_FILE, wall).map_err(failed)?;
    fs::rename(&new, &path).map_err(failed)?;
    Ok(Some(SavedHistory { damage, records: records.unsigned_abs(), kept }))
}

/// Whether an error means that the file is no whole database, and not that the disk is full or busy.
pub(super) fn is_damage(error: &rusqlite::Error) -> bool {
    let code = error.sqlite_error_code();
    matches!(code, Some(ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase))
}

/// Records that another program removed.
pub(super) fn missing(connection: &Connection) -> rusqlite::Result<u64> {
    let transaction = connection.unchecked_transaction()?;
    let noted =
        transaction.query_row("SELECT rows FROM alive", [], |row| row.get::<_, Option<i64>>(0)).optional()?;
    let missing =
        noted.flatten().map_or(0, |noted| noted.saturating_sub(count(&transaction).unwrap_or(noted)));
    Ok(u64::try_from(missing).unwrap_or(0))
}

fn count(connection: &Connection) -> rusqlite::Result<i64> {
    connection.query_row("SELECT count(*) FROM records", [], |row| row.get(0))
}
