//! The store: users, sessions, the vehicle's state, incidents and the audit log, kept over restarts in SQLite,
//! behind a thread of its own.
//!
//! One thread owns the connection and takes jobs from a bounded queue. Sessions are read from
//! memory, so that a request never waits for the disk; every change is on the disk
//! (`synchronous=FULL`) before its caller is answered.

pub mod audit;
mod caller;
mod database;
mod disk;
mod history;
mod incidents;
mod queue;
mod sessions;
mod temporary_folder;
mod unwritten;
mod users;
mod vehicle;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError};
use std::time::{Duration, SystemTime};

use rusqlite::Connection;
use tokio::sync::{oneshot, watch};

pub use audit::chain::{Acknowledged, Breach, Hash, Head, Verdict};
pub use caller::{Caller, Role};
pub use database::schema::FILE_NAME;
pub use disk::exposed::{Exposed, exposed};
pub use disk::health::Fault;
pub use disk::repair::{BackupState, DataState, Repaired, check_data, repair, restore};
pub use history::{
    HISTORY_FILE, History, HistoryLine, HistoryQuery, LineKind, LineQuery, Minute, MinuteSums, NodeFigures,
    NodePast, NodeStatistics, Past, PastAlarm, PastEvent, Period, Reported, Resolution, SavedHistory,
    Statistics, Stretch, Trend, TrendPoint, TrendQuery, ValueTrend, VersionStatistics, between_failures_ms,
    history_damage, how_long_ms, past_in, per_100_km, repair_history, reported_in, statistics_in, way,
};
pub use incidents::{
    Forgotten, INCIDENTS_PAGE_MAX, Incident, IncidentFilter, IncidentRecords, Incidents, Logged, Note,
    OnDisk, StoredIncident, clean_note,
};
pub use sessions::guests::{Grant, Grants, Pattern};
pub use sessions::operator_change::{Entering, Written};
pub use sessions::{SESSION_LIFE, Session, SessionKind, Token};
pub use temporary_folder::TemporaryFolder;
pub use users::secret::{DEMO_CONSOLE_USERS, DEMO_USERS, DemoSecrets, SecretError, is_pin};
pub use users::tokens::{ProgramToken, TOKEN_LIFE_DAYS};
pub use users::{NameError, User, Verified};
pub use vehicle::VehicleMemory;

use audit::Log;
use audit::known::Knowledge;
use database::foreign::Schema;
use database::schema;
use disk::health::Health;
use disk::stall::JobWatch;
use incidents::{note_largest as note_largest_incident, said_again as incidents_said_again};
use queue::{Job, Queue};
use sessions::table::Sessions;
use telltale_clock::Clock;
use telltale_engine::time::Timestamp;
use unwritten::Unwritten;
use users::secret::Hashing;

/// How long a change by another process (`telltale user remove`) may stay unnoticed.
const FOREIGN_CHANGE_POLL: Duration = Duration::from_millis(500);

/// The errors between a caller and the database.
#[derive(Debug, thiserror::Error)]
pub enum StoreError {
    #[error("the data folder {} cannot be used: {reason}. Make it writable or name another one with --data", path.display())]
    Folder { path: PathBuf, reason: std::io::Error },
    #[error("the database {} cannot be opened: {reason}. Check its permissions and the free space; `telltale data check` looks for damage; another folder is named with --data", path.display())]
    Open { path: PathBuf, reason: rusqlite::Error },
    #[error(
        "the database {} is damaged: {what}. Stop `telltale serve`; then `telltale data repair` saves what can be \
         read, or `telltale data restore` takes the last backup. To begin with an empty one, name another \
         folder with --data",
        path.display()
    )]
    Damaged { path: PathBuf, what: String },
    #[error("there is no backup in {} that is whole", folder.join(database::backup::BACKUPS).display())]
    NoBackup { folder: PathBuf },
    #[error(
        "no user can be read of the database in {}, nor of a backup: nothing was changed. Put a copy of \
         telltale.db in its place, or begin with an empty folder and `telltale user add`",
        folder.display()
    )]
    NothingToSave { folder: PathBuf },
    #[error("the backup {} is damaged: {what}", path.display())]
    Backup { path: PathBuf, what: String },
    #[error(
        "the database {} has schema {found}, this telltale knows {known}: use the newer telltale that made it, or name another folder with --data",
        path.display()
    )]
    Newer { path: PathBuf, found: u32, known: u32 },
    #[error(
        "the end of the audit log is noted in {}, which cannot be read: {reason}{whose}. Give it to the user \
         whose database lies beside it, who has to read and write it",
        path.display()
    )]
    Head { path: PathBuf, whose: String, reason: std::io::Error },
    #[error(
        "the audit log is written with the key in {}, which cannot be read: {reason}{whose}. Give it to the user \
         whose database lies beside it",
        path.display()
    )]
    Key { path: PathBuf, whose: String, reason: std::io::Error },
    #[error("{0} is no authority: what is wrong with the audit log is acknowledged by one")]
    NoAuthority(String),
    #[error("there is no database {}: name the data folder of the vehicle with --data", path.display())]
    NoDatabase { path: PathBuf },
    #[error("the database failed: {0}")]
    Database(#[from] rusqlite::Error),
    #[error("{0}")]
    Files(String),
    #[error("the store is busy; try again")]
    Busy,
    #[error("the disk did not answer in time")]
    TooLate,
    #[error("the history was not read in {} s: ask for a shorter span of time", .within.as_secs())]
    TooLong { within: std::time::Duration },
    #[error("the store has ended")]
    Ended,
    #[error("the operating system gives no random numbers: {0}")]
    Random(getrandom::Error),
    #[error("the secret cannot be hashed: {0}")]
    Hash(argon2::password_hash::Error),
    #[error(transparent)]
    Name(#[from] NameError),
    #[error(transparent)]
    Secret(#[from] SecretError),
    #[error("there is a user named {0} already; change the secret with `telltale user passwd {0}`")]
    Exists(String),
    #[error("there is no user named {0}; `telltale user list` shows all")]
    NoSuchUser(String),
    #[error(
        "{0} is an operator: an operator acts at a display, by hand; make a token for a developer or an authority"
    )]
    OperatorToken(String),
    #[error(
        "{0} has too many tokens; `telltale user tokens` shows them, `telltale user revoke NUMBER` takes one back"
    )]
    ManyTokens(String),
    #[error("the session was ended while it was opened; log in again")]
    SessionEnded,
    #[error("there is no incident {0}, or it was removed; `telltale incident list` shows all")]
    NoSuchIncident(u64),
    #[error(
        "there are too many incidents to list another: `telltale incident keep ID --off` releases one that is kept, \
         `telltale incident prune` removes the oldest"
    )]
    ManyIncidents,
    #[error("there is no token {0}; `telltale user tokens` shows all")]
    NoSuchToken(i64),
}

impl StoreError {
    /// Whether the disk or the database failed, and not the request.
    pub const fn is_of_storage(&self) -> bool {
        matches!(self, StoreError::Database(_) | StoreError::Files(_) | StoreError::TooLate)
    }

    /// Whether another program has locked the database for longer than is waited for.
    pub fn is_locked(&self) -> bool {
        matches!(self, StoreError::Database(reason)
            if reason.sqlite_error_code() == Some(rusqlite::ErrorCode::DatabaseBusy))
    }

    /// Whether the disk takes nothing, or a file beside the database cannot be read.
    fn is_of_disk(&self) -> bool {
        use rusqlite::ErrorCode::{CannotOpen, DatabaseBusy, DiskFull, ReadOnly, SystemIoFailure};
        match self {
            StoreError::Open { reason, .. } | StoreError::Database(reason) => matches!(
                reason.sqlite_error_code(),
                Some(CannotOpen | DatabaseBusy | DiskFull | ReadOnly | SystemIoFailure)
            ),
            StoreError::Folder { .. } | StoreError::Head { .. } | StoreError::Key { .. } => true,
            _ => false,
        }
    }

    /// The damage of a database that can be reached; `None` for other errors.
    fn damage(&self) -> Option<String> {
        use rusqlite::ErrorCode::{CannotOpen, DatabaseBusy, DiskFull, ReadOnly};
        match self {
            StoreError::Damaged { what, .. } => Some(what.clone()),
            StoreError::Open { reason, .. } | StoreError::Database(reason) => {
                let code = reason.sqlite_error_code();
                let is_other = matches!(code, Some(CannotOpen | DatabaseBusy | DiskFull | ReadOnly));
                (!is_other).then(|| reason.to_string())
            }
            _ => None,
        }
    }
}

/// The handle of the database. Clones use the same one; it closes when the last is dropped.
#[derive(Debug, Clone)]
pub struct Store {
    queue: Queue,
    sessions: Arc<Sessions>,
    unwritten: Arc<Unwritten>,
    hashing: Hashing,
    fault: watch::Receiver<Fault>,
    folder: Option<Arc<Path>>,
    clock: Clock,
    floor: SystemTime,
}

/// The state of the store's thread.
#[derive(Debug)]
struct Database {
    connection: Connection,
    sessions: Arc<Sessions>,
    unwritten: Arc<Unwritten>,
    clock: Clock,
    /// Nothing is judged by a time before this one.
    floor: SystemTime,
    /// When the floor was read.
    opened: Timestamp,
    log: Log,
    health: Health,
    /// The users whom the audit log knows.
    knowledge: Knowledge,
    job_watch: Arc<JobWatch>,
    backups: database::backup::Schedule,
    /// The vehicle's state that this process wrote last.
    stored_vehicle: Option<VehicleMemory>,
    /// SQLite's count of changes by other processes, at the last look.
    data_version: i64,
    schema: Schema,
    /// This store is the server's, which notes the changes of users that it has taken in.
    serves: bool,
    /// Somebody wants it closed, and waits for that.
    closing: Option<oneshot::Sender<()>>,
}

impl Store {
    /// Opens or makes `telltale.db` in `folder`, and the folder if it is missing.
    ///
    /// # Errors
    /// If the folder or the file cannot be written, or a newer telltale made it.
    pub fn open(folder: &Path, clock: Clock, demo: DemoSecrets) -> Result<Store, StoreError> {
        let connection = schema::open(folder, schema::LOCK_WAIT)?;
        Store::start(connection, Some(folder), clock, demo, false)
    }

    /// Opens it for the server, which notes the changes of users that it has taken in. A database that can
    /// be read and not written is opened too, and written as soon as that is possible; until then
    /// [`Store::fault`] says why not.
    ///
    /// The readable part of a damaged database, or of one that a newer telltale made, is copied into memory: with that people log in and look at
    /// the diagnosis. Nothing is kept then, and [`Store::fault`] says so until a restart.
    ///
    /// # Errors
    /// If there is no database and none can be made, or it may not be read.
    pub fn open_or_read(folder: &Path, clock: Clock, demo: DemoSecrets) -> Result<Store, StoreError> {
        let open = || {
            let connection = schema::open(folder, schema::OPEN_WAIT)?;
            Store::start(connection, Some(folder), clock, demo, true)
        };
        let mut error = match open() {
            Ok(store) => return Ok(store),
            Err(error) => error,
        };
        if error.is_of_disk() {
            match Store::read(folder, &error.to_string(), clock, demo) {
                Ok(store) => return Ok(store),
                Err(damaged) if damaged.damage().is_some() => error = damaged,
                // A log beside it needs an index, which cannot be made here; or the schema is another one.
                Err(StoreError::Open { .. } | StoreError::Newer { .. }) => {
                    return Store::salvage(folder, &error.to_string(), clock, demo);
                }
                Err(_) => return Err(error),
            }
        }
        match (error.damage(), &error) {
            (Some(damage), _) => Store::salvage(folder, &disk::salvage::fault(folder, &damage), clock, demo),
            // The display starts all the same.
            (None, StoreError::Newer { .. }) => Store::salvage(folder, &error.to_string(), clock, demo),
            (None, _) => Err(error),
        }
    }

    fn salvage(folder: &Path, fault: &str, clock: Clock, demo: DemoSecrets) -> Result<Store, StoreError> {
        let mut connection = disk::salvage::into_memory(folder)?;
        let log = Log::open(&mut connection, None, clock.wall())?;
        let mut health = Health::new(None);
        health.is_salvaged(fault);
        Store::run(connection, log, health, Some(folder), clock, demo, true)
    }

    fn read(folder: &Path, why: &str, clock: Clock, demo: DemoSecrets) -> Result<Store, StoreError> {
        let connection = schema::open_reading(folder)?;
        let log = Log::read(&connection, folder)?;
        let mut health = Health::new(Some(folder));
        health.cannot_write(why);
        Store::run(connection, log, health, Some(folder), clock, demo, true)
    }

    /// Opens `telltale.db` in `folder`, if there is one.
    ///
    /// # Errors
    /// As [`Store::open`], and if there is none.
    pub fn open_existing(folder: &Path, clock: Clock, demo: DemoSecrets) -> Result<Store, StoreError> {
        schema::existing(folder)?;
        Store::open(folder, clock, demo)
    }

    /// A store in memory, for tests and demonstrations.
    pub fn in_memory(clock: Clock, demo: DemoSecrets) -> Result<Store, StoreError> {
        Store::start(schema::open_in_memory()?, None, clock, demo, false)
    }

    fn start(
        mut connection: Connection,
        folder: Option<&Path>,
        clock: Clock,
        demo: DemoSecrets,
        serves: bool,
    ) -> Result<Store, StoreError> {
        let log = Log::open(&mut connection, folder, clock.wall())?;
        Store::run(connection, log, Health::new(folder), folder, clock, demo, serves)
    }

    fn run(
        connection: Connection,
        log: Log,
        health: Health,
        folder: Option<&Path>,
        clock: Clock,
        demo: DemoSecrets,
        serves: bool,
    ) -> Result<Store, StoreError> {
        let (sessions, unwritten) = (Arc::new(Sessions::default()), Arc::new(Unwritten::default()));
        let fault = health.watch();
        let no_thread = |reason| StoreError::Folder { path: PathBuf::from("(a new thread)"), reason };
        let job_watch = JobWatch::start(health.fault_sender(), folder, clock).map_err(no_thread)?;
        let floor = disk::clock_floor::of(&connection)?;
        let mut database = Database {
            connection,
            sessions: sessions.clone(),
            unwritten: unwritten.clone(),
            clock,
            floor,
            opened: clock.now(),
            log,
            health,
            knowledge: Knowledge::default(),
            job_watch,
            backups: database::backup::Schedule::default(),
            stored_vehicle: None,
            data_version: 0,
            schema: Schema::new(serves),
            serves,
            closing: None,
        };
        database.reload_sessions()?;
        // The number of the changes that were taken in is written now, or when the disk takes it.
        if let Err(error) = database.notice_foreign_changes() {
            database.health.judge(&error);
        }
        schema::go_on(&database.connection)?;
        let (queue, jobs) = Queue::new();
        std::thread::Builder::new()
            .name("store".to_owned())
            .spawn(move || database.run(&jobs))
            .map_err(no_thread)?;
        Ok(Store {
            queue,
            sessions,
            unwritten,
            hashing: Hashing::new(demo)?,
            fault,
            folder: folder.map(Arc::from),
            clock,
            floor,
        })
    }

    /// The path of the database; `None` for one in memory.
    pub fn folder(&self) -> Option<&Path> {
        self.folder.as_deref()
    }

    /// Whether the database answers. Anybody may ask.
    pub async fn is_ready(&self) -> bool {
        let asked =
            |database: &mut Database| Ok(database.connection.query_row("SELECT 1", [], |_| Ok(()))?);
        self.call_from(Caller::Elsewhere, asked).await.is_ok()
    }

    /// Waits until everything is written, the head of the audit log too, and the database is closed. It is
    /// then one file, unless another process uses it.
    pub async fn close(self) {
        let (closing, closed) = oneshot::channel();
        let ask = |database: &mut Database| {
            database.closing = Some(closing);
            Ok(())
        };
        // A store that has ended has written everything it could.
        if self.call(ask).await.is_ok() {
            let _ = closed.await;
        }
    }
}

impl Database {
    fn run(mut self, jobs: &Receiver<Job>) {
        loop {
            let job = match jobs.try_recv() {
                Ok(job) => Ok(job),
                Err(TryRecvError::Disconnected) => Err(RecvTimeoutError::Disconnected),
                Err(TryRecvError::Empty) => {
                    self.write_waiting_if_due();
                    self.log.note_head();
                    self.idle();
                    jobs.recv_timeout(FOREIGN_CHANGE_POLL)
                }
            };
            self.begin_job();
            match job {
                Ok(job) => job(&mut self),
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => return self.end(),
            }
            if let Some(closing) = self.closing.take() {
                self.end();
                // Nobody may wait for it any more.
                let _ = closing.send(());
                return;
            }
            self.begin_job();
            self.probe_if_due();
            self.back_up_if_due();
            if let Err(error) = self.notice_foreign_changes() {
                tracing::warn!(%error, "the database cannot be read; sessions stay as they are");
                self.health.judge(&error);
            }
        }
    }

    fn end(mut self) {
        // The last failure is logged.
        let _ = self.write_waiting();
        self.log.note_head();
        self.log.log_head();
        // SQLite deletes the log by its name. If that is now the log of another database, it is left as it
        // is.
        if self.check_files().is_err() {
            std::mem::forget(self.connection);
        }
    }

    fn begin_job(&mut self) {
        if self.job_watch.begin(self.clock.now()) {
            self.health.doubt();
        }
    }

    fn idle(&mut self) {
        if self.job_watch.idle() {
            self.health.doubt();
        }
    }
}
