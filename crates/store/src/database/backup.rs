//! Daily copies of the database, in the folder `backups` beside it. A copy counts once it was checked and
//! found whole. SQLite's backup makes it: a copy of the file is torn while somebody writes, and `VACUUM INTO` leaves
//! out the damage that the check should find.

use std::cmp::Reverse;
use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};
use std::time::SystemTime;

use rusqlite::Connection;
use rusqlite::backup::{Backup, StepResult};

use super::schema::{self, LOCK_WAIT, connect_reading};
use crate::{Database, FILE_NAME, StoreError};
use telltale_engine::time::{Span, Timestamp};
use telltale_yaml::private_file::{make_folder, make_private_file};

/// The folder of the copies, in the data folder.
pub const BACKUPS: &str = "backups";

/// Copies that are kept; the oldest goes.
const KEPT: usize = 7;
const EVERY: Span = Span::from_secs(24 * 3600);
/// The delay after a start and after a change of users: other programs that start at the same time have the
/// disk first.
const SOON: Span = Span::from_secs(5);
const AGAIN_AFTER: Span = Span::from_secs(3600);
/// Free room that must remain beside a copy.
const FREE_BYTES_MIN: u64 = 16 << 20;

/// Why no copy could be made.
#[derive(Debug, thiserror::Error)]
pub(crate) enum BackupError {
    #[error("there is no room for it: it needs {needed} bytes, and {free} are free")]
    Room { needed: u64, free: u64 },
    #[error("the copy is damaged: {0}")]
    Copy(String),
    #[error("the database is damaged: {0}")]
    Database(String),
    #[error(transparent)]
    Store(#[from] StoreError),
    #[error(transparent)]
    Sqlite(#[from] rusqlite::Error),
    #[error(transparent)]
    Io(#[from] io::Error),
}

/// When the next copy is due, and the copy that is being made.
#[derive(Debug, Default)]
pub(crate) struct Schedule {
    /// `None` before the first look.
    due: Option<Timestamp>,
    running: Option<Receiver<Result<PathBuf, BackupError>>>,
}

impl Schedule {
    /// The database has something new that must be in a copy soon.
    pub(crate) fn hasten(&mut self, now: Timestamp) {
        self.due = Some(self.due.map_or(now + SOON, |due| due.min(now + SOON)));
    }
}

impl Database {
    /// Starts a copy in a thread of its own when it is due, and takes the result of the last one.
    pub(crate) fn back_up_if_due(&mut self) {
        let Some(folder) = self.health.folder().filter(|_| self.serves).map(Path::to_owned) else { return };
        let now = self.clock.now();
        if let Some(running) = &self.backups.running {
            match running.try_recv() {
                Err(TryRecvError::Empty) => return,
                Ok(Ok(file)) => tracing::info!("the database is backed up: {}", file.display()),
                Ok(Err(error)) => {
                    tracing::error!("the database cannot be backed up: {error}");
                    if let BackupError::Database(_) = error {
                        self.health.is_broken(&error.to_string());
                    }
                    self.backups.due = Some(now + AGAIN_AFTER);
                }
                Err(TryRecvError::Disconnected) => {}
            }
            self.backups.running = None;
        }
        let due = *self.backups.due.get_or_insert(now + SOON);
        if now < due || !self.health.is_well() {
            return;
        }
        // A copy of a database whose log was removed lacks what lies in the log.
        if self.check_files().is_err() {
            return self.health.doubt();
        }
        self.backups.due = Some(now + EVERY);
        let (report, running) = sync_channel(1);
        let wall = self.clock.wall();
        let spawned = std::thread::Builder::new().name("backup".to_owned()).spawn(move || {
            // On Linux this sets the priority of the calling thread only.
            let _ = rustix::process::nice(19);
            let _ = report.send(make(&folder, wall));
        });
        match spawned {
            Ok(_) => self.backups.running = Some(running),
            Err(error) => tracing::error!(%error, "the database cannot be backed up"),
        }
    }
}

/// Makes today's copy, in place of an earlier one of today. It reads with a connection of its own, so
/// writers do not wait.
pub(crate) fn make(folder: &Path, wall: SystemTime) -> Result<PathBuf, BackupError> {
    let (from, _, _) = schema::read_only(folder, LOCK_WAIT)?;
    let backups = folder.join(BACKUPS);
    make_folder(&backups)?;
    let day = humantime::format_rfc3339_seconds(wall).to_string();
    let file = backups.join(format!("telltale-{}.db", day.split('T').next().unwrap_or_default()));
    check_room(&from, &backups)?;
    let new = file.with_extension("db.new");
    let made = copy(&from, &new).and_then(|()| Ok(fs::rename(&new, &file)?));
    if made.is_err() {
        let _ = fs::remove_file(&new);
    }
    made?;
    File::open(&backups)?.sync_all()?;
    for old in list(folder).into_iter().filter(|it| *it != file).skip(KEPT - 1) {
        fs::remove_file(old)?;
    }
    Ok(file)
}

fn check_room(from: &Connection, backups: &Path) -> Result<(), BackupError> {
    let number = |name| from.pragma_query_value(None, name, |row| row.get::<_, i64>(0));
    let bytes = number("page_count")?.unsigned_abs().saturating_mul(number("page_size")?.unsigned_abs());
    let system = rustix::fs::statvfs(backups).map_err(io::Error::from)?;
    let free = system.f_bavail.saturating_mul(system.f_frsize);
    let needed = bytes.saturating_add(FREE_BYTES_MIN.min(bytes.saturating_mul(4)));
    if free < needed { Err(BackupError::Room { needed, free }) } else { Ok(()) }
}

fn copy(from: &Connection, new: &Path) -> Result<(), BackupError> {
    // Left behind by an earlier run.
    if new.exists() {
        fs::remove_file(new)?;
    }
    make_private_file(new)?;
    let mut to = Connection::open(new)?;
    // One transaction for the whole copy: otherwise each write of others would restart it.
    from.execute_batch("BEGIN; SELECT 1 FROM users LIMIT 1")?;
    let stepped = Backup::new(from, &mut to).and_then(|backup| backup.step(-1));
    from.execute_batch("COMMIT")?;
    let stepped = stepped?;
    if stepped != StepResult::Done {
        return Err(BackupError::Copy(format!("it ended with {stepped:?}")));
    }
    // The copy is one file.
    to.pragma_update_and_check(None, "journal_mode", "DELETE", |_| Ok(()))?;
    if let Some(damage) = schema::damage_of(&to) {
        return Err(match schema::damage_of(from) {
            Some(damage) => BackupError::Database(damage),
            None => BackupError::Copy(damage),
        });
    }
    drop(to);
    Ok(File::open(new)?.sync_all()?)
}

/// The copies of a data folder, the newest first: the newest one has the last records of the audit log, since a wrong clock
/// gives a copy a wrong day. Copies that cannot be read come last.
pub(crate) fn list(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder.join(BACKUPS)).into_iter().flatten().flatten();
    let mut files: Vec<PathBuf> =
        entries.map(|it| it.path()).filter(|path| path.extension().is_some_and(|it| it == "db")).collect();
    files.sort_by_cached_key(|file| Reverse((last_record(file), file.clone())));
    files
}

fn last_record(file: &Path) -> Option<i64> {
    let copy = connect_reading(file, "immutable=1", LOCK_WAIT).ok()?;
    copy.query_row("SELECT max(number) FROM audit", [], |row| row.get(0)).ok()?
}

/// Opens a copy if it is whole and holds users.
pub(crate) fn open(file: &Path) -> Result<Connection, StoreError> {
    let damaged = |what: String| StoreError::Backup { path: file.to_owned(), what };
    let connection =
        connect_reading(file, "immutable=1", LOCK_WAIT).map_err(|error| damaged(error.to_string()))?;
    schema::damage_of(&connection).map_or(Ok(connection), |damage| Err(damaged(damage)))
}

/// The newest copy that is whole.
pub(crate) fn newest(folder: &Path) -> Option<(PathBuf, Connection)> {
    list(folder).into_iter().find_map(|file| {
        let opened = open(&file).inspect_err(|error| tracing::warn!("{error}"));
        Some((file, opened.ok()?))
    })
}

/// The file that shows that a data folder once held a database, if there is one.
pub(crate) fn trace_of_database(folder: &Path) -> Option<String> {
    let head = folder.join(super::files::HEAD_FILE_NAME);
    if head.exists() {
        return Some(head.display().to_string());
    }
    list(folder).first().map(|file| file.display().to_string())
}

/// Whether there is a file that is not empty.
pub(crate) fn holds_something(folder: &Path) -> bool {
    fs::metadata(folder.join(FILE_NAME)).is_ok_and(|file| file.len() > 0)
}
