//! The work of `telltale data`: checks a data folder, repairs its database, restores a backup. No server
//! may run on the folder meanwhile, except during a check.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;
use telltale_yaml::private_file::make_private_file;

use rusqlite::Connection;

use super::salvage;
use crate::audit::head::read_head;
use crate::audit::known::as_they_are;
use crate::audit::{Action, COMMAND_LINE, HEAD_FILE_NAME, KEY_FILE_NAME, Key, Record};
use crate::database::files::put_aside;
use crate::database::{backup, schema};
use crate::{Database, DemoSecrets, FILE_NAME, Head, Store, StoreError, history_damage};
use telltale_clock::Clock;

/// The result of checking a data folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DataState {
    pub database: PathBuf,
    /// `None` if it is whole.
    pub damage: Option<String>,
    /// The number of users, if it can be read.
    pub users: Option<u64>,
    /// The damage of the history, which is a file of its own.
    pub history_damage: Option<String>,
    /// The newest first.
    pub backups: Vec<BackupState>,
}

/// A backup, and whether it can be restored.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BackupState {
    pub file: PathBuf,
    /// `None` if it is whole.
    pub damage: Option<String>,
    pub users: Option<u64>,
}

/// The result of repairing or replacing a database.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Repaired {
    pub users: u64,
    /// The data that are lost or older than before.
    pub losses: Vec<String>,
    /// The folder with the old files.
    pub kept: PathBuf,
}

/// Checks the database of a folder and its backups, and changes nothing. A server may run.
///
/// # Errors
/// If the folder cannot be read, or never held a database.
pub fn check_data(folder: &Path) -> Result<DataState, StoreError> {
    let database = folder.join(FILE_NAME);
    let trace = backup::trace_of_database(folder);
    // Before the database: a server that runs writes there first.
    let noted = read_head(&folder.join(HEAD_FILE_NAME)).ok().flatten();
    let (damage, users) = match backup::holds_something(folder) {
        true => match schema::read_only(folder, schema::LOCK_WAIT) {
            Ok((connection, _, _)) => {
                let damage = schema::damage_of(&connection).or_else(|| ends_early(&connection, noted));
                (damage, count(&connection))
            }
            Err(StoreError::Open { reason, .. }) => (Some(reason.to_string()), None),
            Err(error) => return Err(error),
        },
        false if trace.is_some() => (Some("it is gone or empty".to_owned()), None),
        false => return Err(StoreError::NoDatabase { path: database }),
    };
    let look = |file: PathBuf| match backup::open(&file) {
        Ok(connection) => BackupState { file, damage: None, users: count(&connection) },
        Err(StoreError::Backup { what, .. }) => BackupState { file, damage: Some(what), users: None },
        Err(error) => BackupState { file, damage: Some(error.to_string()), users: None },
    };
    let backups = backup::list(folder).into_iter().map(look).collect();
    Ok(DataState { database, damage, users, history_damage: history_damage(folder), backups })
}

/// Why `audit.head` belongs to another database.
fn ends_early(connection: &Connection, noted: Option<Head>) -> Option<String> {
    let last = connection.query_row("SELECT max(number) FROM audit", [], |row| row.get::<_, Option<i64>>(0));
    let (noted, last) = (noted?.number, last.ok()?.unwrap_or(0).unsigned_abs());
    (last < noted).then(|| {
        format!(
            "its audit log ends at record {last}, and {HEAD_FILE_NAME} says {noted}: its log `-wal` is gone, or an older \
             copy was put in its place"
        )
    })
}

/// Whether a backup was written with another key of the audit log than the one of this folder.
fn is_of_another(backup: &Connection, folder: &Path) -> bool {
    let key = Key::read(&folder.join(KEY_FILE_NAME)).ok().flatten();
    let id = backup.query_row("SELECT id FROM audit_key", [], |row| row.get::<_, [u8; 32]>(0));
    key.zip(id.ok()).is_some_and(|(key, id)| key.id() != id)
}

fn count(connection: &Connection) -> Option<u64> {
    let count = connection.query_row("SELECT count(*) FROM users", [], |row| row.get::<_, i64>(0));
    count.ok().map(i64::unsigned_abs)
}

/// Makes a new database of everything that can be read of a damaged one, with users and records of the
/// audit log from the newest backup if they cannot be read. The old files are moved aside.
///
/// # Errors
/// If it cannot be written, or no user can be found: nothing is changed then.
pub fn repair(folder: &Path, clock: Clock) -> Result<Repaired, StoreError> {
    let new = new_file(folder)?;
    let mut connection = schema::make_new(&new)?;
    let salvaged = salvage::into_new(folder, &mut connection)?;
    if salvaged.users == 0 {
        drop(connection);
        let _ = fs::remove_file(&new);
        return Err(StoreError::NothingToSave { folder: folder.to_owned() });
    }
    let kept = put_in_place(folder, &new, connection, clock.wall())?;
    note(folder, clock, Record::of(Action::DataRepaired, COMMAND_LINE).on(salvaged.losses.join("; ")), true)?;
    Ok(Repaired { users: salvaged.users, losses: salvaged.losses, kept })
}

/// Replaces the database with a backup: this one, or the newest that is whole. Nobody is logged in then.
/// The old files are moved aside.
///
/// # Errors
/// If there is no backup that is whole, or it cannot be written: nothing is changed then.
pub fn restore(folder: &Path, file: Option<&Path>, clock: Clock) -> Result<(PathBuf, Repaired), StoreError> {
    let (file, from) = match file {
        Some(file) => (file.to_owned(), backup::open(file)?),
        None => backup::newest(folder).ok_or_else(|| StoreError::NoBackup { folder: folder.to_owned() })?,
    };
    let new = new_file(folder)?;
    make_private_file(&new).map_err(|reason| folder_error(folder, reason))?;
    let mut connection = Connection::open(&new)?;
    rusqlite::backup::Backup::new(&from, &mut connection)?.step(-1)?;
    connection.pragma_update_and_check(None, "journal_mode", "DELETE", |_| Ok(()))?;
    // A session that has ended since the backup would be open again.
    connection.execute_batch("DELETE FROM seat; DELETE FROM sessions")?;
    let users = count(&connection).unwrap_or(0);
    let kept = put_in_place(folder, &new, connection, clock.wall())?;
    let record = Record::of(Action::DataRestored, COMMAND_LINE).on(file.display().to_string());
    note(folder, clock, record, false)?;
    let mut losses = vec![format!("what happened after {} is not in it", file.display())];
    if is_of_another(&from, folder) {
        losses.push(format!(
            "it was written with another {KEY_FILE_NAME}, so nobody in it can log in: `telltale user passwd` takes each \
             user in, or copy the key that belongs to it here"
        ));
    }
    Ok((file, Repaired { users, losses, kept }))
}

/// An unused name for the new database.
fn new_file(folder: &Path) -> Result<PathBuf, StoreError> {
    let new = folder.join(format!("{FILE_NAME}.new"));
    match fs::remove_file(&new) {
        Err(reason) if reason.kind() != io::ErrorKind::NotFound => Err(folder_error(folder, reason)),
        _ => Ok(new),
    }
}

/// Puts the new database in place once it was found whole, and moves the files of the old one aside.
fn put_in_place(
    folder: &Path,
    new: &Path,
    connection: Connection,
    wall: SystemTime,
) -> Result<PathBuf, StoreError> {
    if let Some(what) = schema::damage_of(&connection) {
        return Err(StoreError::Damaged { path: new.to_owned(), what });
    }
    drop(connection);
    let moved = || {
        File::open(new)?.sync_all()?;
        let kept = put_aside(folder, FILE_NAME, wall)?;
        give_to_owner(folder, new)?;
        fs::rename(new, folder.join(FILE_NAME))?;
        File::open(folder)?.sync_all()?;
        Ok(kept)
    };
    moved().map_err(|reason| folder_error(folder, reason))
}

/// If root repairs the database, the files get the owner of the folder, who must be able to read and write
/// them.
fn give_to_owner(folder: &Path, file: &Path) -> io::Result<()> {
    use std::os::unix::fs::{MetadataExt as _, chown};
    let (owner, ours) = (fs::metadata(folder)?, fs::metadata(file)?);
    if owner.uid() == ours.uid() { Ok(()) } else { chown(file, Some(owner.uid()), Some(owner.gid())) }
}

fn folder_error(folder: &Path, reason: io::Error) -> StoreError {
    StoreError::Folder { path: folder.to_owned(), reason }
}

/// Records the repair in the audit log. Where the log may lack records of users, they are taken as they are.
fn note(folder: &Path, clock: Clock, record: Record, takes_users: bool) -> Result<(), StoreError> {
    let store = Store::open(folder, clock, DemoSecrets::Refused)?;
    let runtime = tokio::runtime::Builder::new_current_thread().build();
    let runtime = runtime.map_err(|reason| folder_error(folder, reason))?;
    runtime.block_on(async {
        let note = move |database: &mut Database| {
            let mut records = vec![record];
            if takes_users {
                records.extend(as_they_are(&database.connection)?);
            }
            database.change(&records, |_| Ok(()))
        };
        let noted = store.call(note).await;
        store.close().await;
        noted
    })
}

#[cfg(test)]
mod tests;
