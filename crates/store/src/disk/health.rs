//! Watches whether the storage can keep what is acknowledged: the disk, the files, and a small write every
//! few seconds.

use std::path::Path;
use std::sync::Arc;

use rusqlite::{Connection, ErrorCode};
use tokio::sync::watch;

use crate::audit::Log;
use crate::database::files::OpenFiles;
use crate::database::schema;
use crate::{Database, Store, StoreError};
use telltale_engine::time::{Span, Timestamp};

const PROBE_EVERY: Span = Span::from_secs(5);

/// The fault of the storage, for a developer; `None` while it works.
pub type Fault = Option<Arc<str>>;

impl Store {
    /// The fault of the storage, now and whenever it changes.
    pub fn fault(&self) -> watch::Receiver<Fault> {
        self.fault.clone()
    }
}

/// The watched state of the storage.
#[derive(Debug)]
pub(crate) struct Health {
    /// The data folder with the files that were opened; `None` for a store in memory.
    files: Option<OpenFiles>,
    fault: watch::Sender<Fault>,
    probed: Option<Timestamp>,
    /// The database is open for reading only.
    is_reading: bool,
    /// A job found the database damaged, and it has not been checked since.
    is_suspect: bool,
    /// A fault that stays when the disk works again: the database is damaged.
    broken: Option<Arc<str>>,
    /// The database is a copy in memory of the readable part of a damaged one.
    is_salvaged: bool,
}

impl Health {
    pub(crate) fn new(folder: Option<&Path>) -> Health {
        let (files, fault) = (folder.map(OpenFiles::new), watch::channel(None).0);
        Health {
            files,
            fault,
            probed: None,
            is_reading: false,
            is_suspect: false,
            broken: None,
            is_salvaged: false,
        }
    }

    /// The database is damaged, and somebody has to repair it.
    pub(crate) fn is_broken(&mut self, why: &str) {
        self.broken = Some(Arc::from(why));
        self.report(Some(why));
    }

    /// The database is a copy in memory of the readable part of a damaged one: nothing is kept.
    pub(crate) fn is_salvaged(&mut self, why: &str) {
        self.is_salvaged = true;
        self.files = None;
        self.is_broken(why);
    }

    /// Whether a restart will find what is written now.
    pub(crate) fn check_keeps(&self) -> Result<(), StoreError> {
        match &self.broken {
            Some(broken) if self.is_salvaged => Err(StoreError::Files(broken.to_string())),
            _ => Ok(()),
        }
    }

    /// The folder of the files; `None` for a database in memory.
    pub(crate) fn folder(&self) -> Option<&Path> {
        self.files.as_ref().map(OpenFiles::folder)
    }

    /// Whether no fault is known.
    pub(crate) fn is_well(&self) -> bool {
        self.fault.borrow().is_none() && !self.is_reading && !self.is_suspect
    }

    /// The database could be opened for reading only.
    pub(crate) fn cannot_write(&mut self, why: &str) {
        self.is_reading = true;
        self.report(Some(why));
    }

    pub(crate) fn is_reading(&self) -> bool {
        self.is_reading
    }

    /// Whether the files are those that were opened: a restart would not find what is written into others.
    pub(crate) fn check_files(&self) -> Result<(), StoreError> {
        let checked = self.files.as_ref().map_or(Ok(()), |files| files.check_files(self.is_reading));
        checked.map_err(StoreError::Files)
    }

    pub(crate) fn watch(&self) -> watch::Receiver<Fault> {
        self.fault.subscribe()
    }

    /// Judges the result of a job: an error of the disk is reported at once, not at the next probe. For a
    /// database that is open for reading only the reason is known.
    pub(crate) fn judge(&mut self, error: &StoreError) {
        if let StoreError::Files(fault) = error {
            self.report(Some(fault));
        }
        if let StoreError::Database(rusqlite::Error::SqliteFailure(failure, _)) = error
            && !self.is_reading
            && matches!(
                failure.code,
                ErrorCode::DiskFull
                    | ErrorCode::ReadOnly
                    | ErrorCode::SystemIoFailure
                    | ErrorCode::DatabaseCorrupt
                    | ErrorCode::NotADatabase
                    | ErrorCode::CannotOpen
            )
        {
            let is_damage = matches!(failure.code, ErrorCode::DatabaseCorrupt | ErrorCode::NotADatabase);
            if is_damage {
                self.is_suspect = true;
                self.doubt();
            }
            self.report(Some(&error.to_string()));
        }
    }

    /// Other parts of the store report their faults with this: see [`report`].
    pub(crate) fn fault_sender(&self) -> watch::Sender<Fault> {
        self.fault.clone()
    }

    /// Something took suspiciously long: the next probe is due.
    pub(crate) fn doubt(&mut self) {
        self.probed = None;
    }

    fn report(&self, fault: Option<&str>) {
        report(&self.fault, fault);
    }
}

/// Reports a fault of the storage, or its end.
pub(crate) fn report(sender: &watch::Sender<Fault>, fault: Option<&str>) {
    sender.send_if_modified(|reported| {
        if reported.as_deref() == fault {
            return false;
        }
        match fault {
            Some(fault) => tracing::error!("nothing can be kept any more: {fault}"),
            None => tracing::info!("what happens is kept again"),
        }
        *reported = fault.map(Arc::from);
        true
    });
}

impl Database {
    /// Probes the storage when that is due.
    pub(crate) fn probe_if_due(&mut self) {
        let now = self.clock.now();
        if self.health.probed.is_some_and(|probed| now.since(probed) < PROBE_EVERY) {
            return;
        }
        let fault = self.check().err();
        self.health.probed = Some(self.clock.now());
        self.health.report(fault.as_deref());
    }

    /// Opens a database for writing that could only be read so far.
    fn open_again(&mut self) -> Result<(), String> {
        let files = self.health.files.as_ref().filter(|_| self.health.is_reading);
        let Some(folder) = files.map(|files| files.folder().to_owned()) else { return Ok(()) };
        // Connections of one process share the index of the log, and with it that it may not be written.
        let nothing = Connection::open_in_memory().map_err(|error| error.to_string())?;
        drop(std::mem::replace(&mut self.connection, nothing));
        let reopened = schema::open(&folder, schema::OPEN_WAIT).and_then(|mut connection| {
            let log = Log::open(&mut connection, Some(&folder), self.clock.wall())?;
            schema::go_on(&connection)?;
            Ok((connection, log))
        });
        match reopened {
            Ok((connection, log)) => (self.connection, self.log) = (connection, log),
            Err(error) => {
                self.connection = schema::open_reading(&folder).map_err(|error| error.to_string())?;
                return Err(error.to_string());
            }
        }
        self.health.files = Some(OpenFiles::new(&folder));
        self.health.is_reading = false;
        // This also stores what changed meanwhile.
        self.data_version = 0;
        self.notice_foreign_changes().map_err(|error| error.to_string())
    }

    fn check(&mut self) -> Result<(), String> {
        if let Err(broken) = self.health.check_keeps() {
            return Err(broken.to_string());
        }
        self.check_files().map_err(|fault| fault.to_string())?;
        if let Some(files) = &self.health.files {
            files.check_room()?;
        }
        self.open_again()?;
        if let Err(error) = self.beat() {
            return Err(match error.damage() {
                Some(strange) => self.go_on_in_memory(&strange),
                None => format!("the database failed: {error}"),
            });
        }
        if let Some(fault) = self.log.fault() {
            return Err(fault.to_owned());
        }
        // A log that was emptied under it shows now, by its first bytes.
        self.check_files().map_err(|fault| fault.to_string())?;
        self.check_size()?;
        self.look_through()?;
        self.health.broken.as_ref().map_or(Ok(()), |broken| Err(broken.to_string()))
    }

    /// Writes, to see whether that works.
    fn beat(&mut self) -> Result<(), StoreError> {
        let transaction = Database::begin(&mut self.connection, &mut self.schema)?;
        transaction.execute("UPDATE beat SET count = count + 1", [])?;
        Ok(transaction.commit()?)
    }

    /// Checks that the files are those that were opened. If not, it saves what was acknowledged as far as
    /// possible.
    pub(crate) fn check_files(&mut self) -> Result<(), StoreError> {
        let Err(fault) = self.health.check_files() else { return Ok(()) };
        // The acknowledged records lie in a log that has no name any more. The database still has one:
        // it takes all of that in, unless another program works with it through another log.
        if !self.health.is_reading && self.health.files.as_ref().is_some_and(OpenFiles::can_be_saved) {
            // FULL waits for readers of an older state, such as the daily copy: PASSIVE would leave out what
            // was written after it began.
            let is_busy = self.connection.query_row("PRAGMA wal_checkpoint(FULL)", [], |row| row.get(0));
            match is_busy {
                Ok(false) => {}
                Ok(true) => tracing::error!("the log of the database is in use: it is saved later"),
                Err(error) => tracing::error!(%error, "what was in the log of the database cannot be saved"),
            }
        }
        Err(fault)
    }

    fn check_size(&mut self) -> Result<(), String> {
        let Some(files) = &mut self.health.files else { return Ok(()) };
        let number = |name| self.connection.pragma_query_value(None, name, |row| row.get::<_, i64>(0));
        let (pages, size) = number("page_count")
            .and_then(|pages| Ok((pages, number("page_size")?)))
            .map_err(|error| format!("the database failed: {error}"))?;
        files.check_size(pages.unsigned_abs().saturating_mul(size.unsigned_abs()))
    }

    /// Checks a database that was found damaged: one successful write does not prove that it is whole.
    fn look_through(&mut self) -> Result<(), String> {
        if !self.health.is_suspect {
            return Ok(());
        }
        let found = self.connection.query_row("PRAGMA quick_check(1)", [], |row| row.get::<_, String>(0));
        match found.map_err(|error| error.to_string()) {
            Ok(found) if found == "ok" => {
                self.health.is_suspect = false;
                Ok(())
            }
            // Otherwise each login would find it damaged again.
            Ok(found) | Err(found) => Err(self.go_on_in_memory(&found)),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use rusqlite::OpenFlags;

    use super::*;
    use crate::{DemoSecrets, FILE_NAME, Role};
    use telltale_clock::Clock;

    async fn probe(store: &Store) -> Option<String> {
        let probe = |database: &mut Database| {
            database.health.doubt();
            database.probe_if_due();
            Ok(())
        };
        store.call(probe).await.unwrap();
        store.fault.borrow().as_deref().map(str::to_owned)
    }

    /// The locks of this process on a file.
    fn locks(path: &Path) -> usize {
        use std::os::unix::fs::MetadataExt as _;
        let owner = format!(" {} ", std::process::id());
        let inode = format!(":{} ", std::fs::metadata(path).unwrap().ino());
        let table = std::fs::read_to_string("/proc/locks").unwrap();
        table.lines().filter(|line| line.contains(&owner) && line.contains(&inode)).count()
    }

    #[tokio::test]
    async fn no_probe_and_no_second_start_gives_up_the_lock_of_the_database() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let store = Store::open(folder, Clock::start(), DemoSecrets::Refused).unwrap();
        let path = folder.join(FILE_NAME);
        for _ in 0..3 {
            assert_eq!(probe(&store).await, None);
            assert!(locks(&path) > 0, "another program may delete the log now");
        }
        telltale_yaml::private_file::make_private_file(&path).unwrap();
        let other = Store::open(folder, Clock::start(), DemoSecrets::Refused).unwrap();
        assert_eq!(probe(&other).await, None);
        other.close().await;
        assert!(locks(&path) > 0, "the first is still open");
        store.close().await;
        assert_eq!(locks(&path), 0);
        assert!(!folder.join(format!("{FILE_NAME}-wal")).exists(), "closed, it is one file");
    }

    #[tokio::test]
    async fn a_log_without_a_name_is_saved_whole_although_the_database_is_being_read() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let store = Store::open(folder, Clock::start(), DemoSecrets::Refused).unwrap();
        let reader = Connection::open(folder.join(FILE_NAME)).unwrap();
        reader.execute_batch("BEGIN; SELECT 1 FROM users LIMIT 1").unwrap();
        store.add_user("anna", Role::Operator, "135791").await.unwrap();
        let log = folder.join(format!("{FILE_NAME}-wal"));
        std::fs::remove_file(&log).unwrap();
        // A program that opens the database only to read it leaves an empty log there.
        drop(schema::read_only(folder, schema::LOCK_WAIT));
        assert_eq!(std::fs::metadata(&log).unwrap().len(), 0);
        let (refused, ()) = tokio::join!(store.add_user("bert", Role::Operator, "135791"), async {
            tokio::time::sleep(Duration::from_millis(200)).await;
            reader.execute_batch("COMMIT").unwrap();
        });
        assert!(matches!(refused, Err(StoreError::Files(_))), "{refused:?}");
        let database = folder.join(FILE_NAME);
        let immutable = format!("file:{}?immutable=1", database.display());
        let flags = OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_URI;
        let without_log = Connection::open_with_flags(immutable, flags).unwrap();
        let names = "SELECT count(*) FROM users WHERE name = 'anna'";
        assert_eq!(without_log.query_row(names, [], |row| row.get::<_, i64>(0)).unwrap(), 1);
    }

    #[tokio::test]
    async fn what_is_written_into_files_without_a_name_is_not_acknowledged() {
        for suffix in ["-wal", "-shm"] {
            let temporary = tempfile::tempdir().unwrap();
            let folder = temporary.path();
            let store = Store::open(folder, Clock::start(), DemoSecrets::Refused).unwrap();
            store.add_user("anna", Role::Operator, "135791").await.unwrap();
            std::fs::remove_file(folder.join(format!("{FILE_NAME}{suffix}"))).unwrap();
            let refused = store.add_user("bert", Role::Operator, "135791").await;
            assert!(matches!(refused, Err(StoreError::Files(_))), "{refused:?}");
            let said = store.fault.borrow().clone().expect("at once, not at the next probe");
            assert!(said.contains("removed or replaced") && said.contains("restart"), "{said}");
            // Opens the database file without its log, as a restart after a loss of power does.
            let temporary = tempfile::tempdir().unwrap();
            let copy = temporary.path();
            let taken = std::process::Command::new("cp")
                .args([folder.join(FILE_NAME), copy.join(FILE_NAME)])
                .status();
            assert!(taken.unwrap().success());
            let copied = Store::open(copy, Clock::start(), DemoSecrets::Refused).unwrap();
            let names: Vec<_> = copied.users().await.unwrap().into_iter().map(|user| user.name).collect();
            assert_eq!(names, ["anna"], "what was acknowledged is in the database itself, before it is said");
            assert_eq!(probe(&store).await.as_deref(), Some(&*said));
        }
    }

    #[tokio::test]
    async fn a_damaged_database_is_a_fault_until_it_is_whole() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let store = Store::open(folder, Clock::start(), DemoSecrets::Refused).unwrap();
        let damage = || {
            let code = rusqlite::ffi::Error::new(rusqlite::ffi::SQLITE_CORRUPT);
            Err::<(), _>(StoreError::Database(rusqlite::Error::SqliteFailure(code, None)))
        };
        // The next probe by itself is not due for a while.
        assert_eq!(probe(&store).await, None);
        let mut said = store.fault();
        said.mark_unchanged();
        store.call(move |_| damage()).await.unwrap_err();
        assert!(said.has_changed().unwrap(), "at once; the store's thread may have looked through it since");
        assert_eq!(probe(&store).await, None, "it was looked through and is whole");
        store
            .call(|database| {
                // An index without its entries: every write works, and reads are wrong.
                let spoil = "PRAGMA writable_schema = ON;
                    UPDATE sqlite_schema SET rootpage = (SELECT rootpage FROM sqlite_schema WHERE name = 'beat')
                        WHERE name = 'tokens_by_user';
                    PRAGMA writable_schema = RESET;";
                Ok(database.connection.execute_batch(spoil)?)
            })
            .await
            .unwrap();
        store.call(move |_| damage()).await.unwrap_err();
        for _ in 0..3 {
            let said = probe(&store).await.expect("one write that works does not mend it");
            assert!(said.contains("damaged"), "{said}");
        }
    }
}
