//! The history: every transition with its cause, stages, signals and alarms, in a file of its own.
//!
//! A thread writes the batches that the engine's task hands over. The state of the vehicle does not depend
//! on it: a failure is logged and counted, and everything else goes on. The file is bounded: beyond
//! [`ROWS_MAX`] records the oldest go, but the last of each node stays, so that the state of every node is
//! known for every kept moment. Of alarms and stages the statistics of their days stay. Beside them it has the numbers of the modules over days (`trends`).

mod alarms;
mod damage;
mod lines;
mod read;
mod reader;
mod statistics;
mod trends;
mod write;

use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime};

use rusqlite::{Connection, OpenFlags};
use tokio::sync::oneshot;

pub use alarms::PastAlarm;
pub use damage::{SavedHistory, history_damage, repair_history};
pub use lines::{HistoryLine, LineKind, LineQuery};
pub use read::{HistoryQuery, NodePast, Past, PastEvent, Period, Reported};
use reader::Reader;
pub use statistics::{
    NodeFigures, NodeStatistics, Statistics, VersionStatistics, between_failures_ms, how_long_ms, per_100_km,
    way,
};
pub use telltale_engine::view::record::Stretch;
pub use trends::{Minute, MinuteSums, Resolution, Trend, TrendPoint, TrendQuery, ValueTrend};

use super::StoreError;
use super::database::files::{odd_beside, put_aside, put_odd_aside};
use super::database::foreign;
use telltale_clock::Clock;
use telltale_engine::time::Timestamp;
use telltale_engine::view::record::Record;
use telltale_yaml::private_file::make_private_file;
use trends::TrendWriter;

/// The file of the history. It may grow large, and may be removed.
pub const HISTORY_FILE: &str = "history.db";
/// Records that are kept. Each takes about 80 bytes on the disk, and the module's message, which is cut at
/// 200.
pub const ROWS_MAX: usize = 1_000_000;
/// Batches that wait for the disk. A full queue refuses the next one: see `runtime`.
const QUEUE: usize = 64;
/// The file notes at least this often that the program runs.
const ALIVE_EVERY: Duration = Duration::from_secs(5);

const SCHEMA: &str = "
    CREATE TABLE IF NOT EXISTS nodes (id INTEGER PRIMARY KEY, name TEXT NOT NULL UNIQUE) STRICT;
    CREATE TABLE IF NOT EXISTS records (
        id INTEGER PRIMARY KEY,
        at_ms INTEGER NOT NULL,
        kind INTEGER NOT NULL,
        node INTEGER,
        state INTEGER,
        own INTEGER,
        other INTEGER,
        number INTEGER,
        said TEXT,
        silent_ms INTEGER
    ) STRICT;
    CREATE INDEX IF NOT EXISTS records_by_node ON records (node, at_ms) WHERE kind = 1;
    CREATE INDEX IF NOT EXISTS records_by_time ON records (at_ms) WHERE kind <> 1;
    CREATE TABLE IF NOT EXISTS alive (one INTEGER PRIMARY KEY CHECK (one = 1), at_ms INTEGER NOT NULL, rows INTEGER) STRICT;
";

/// A page that waits longer no longer needs the answer.
const READ_WITHIN: Duration = Duration::from_secs(5);

/// The handle of the history. Clones use the same one.
#[derive(Debug, Clone)]
pub struct History {
    connection: Arc<Mutex<Connection>>,
    reader: Arc<Reader>,
    /// Locked after the connection.
    trends: Arc<Mutex<TrendWriter>>,
    /// `None` for one in memory.
    folder: Option<PathBuf>,
    /// Its other end goes with the thread that writes.
    written: Arc<Mutex<Option<oneshot::Receiver<()>>>>,
    clock: Clock,
}

/// A history that another process writes: for a command beside a running `serve`.
///
/// # Errors
/// If there is none in `folder`, or it cannot be read.
pub fn past_in(folder: &Path, query: &HistoryQuery) -> Result<Past, StoreError> {
    Ok(read::past(&opened_in(folder)?, query)?)
}

/// Statistics of a history that another process may write.
///
/// # Errors
/// If there is none in `folder`, or it cannot be read.
pub fn statistics_in(folder: &Path, from_ms: i64, to_ms: i64) -> Result<Statistics, StoreError> {
    Ok(statistics::statistics(&opened_in(folder)?, from_ms, to_ms)?)
}

/// What these nodes reported, and these signals, in a history that another process may write.
///
/// # Errors
/// If there is none in `folder`, or it cannot be read.
pub fn reported_in(folder: &Path, nodes: &[String], signals: &[String]) -> Result<Reported, StoreError> {
    let reported = read::reported(&opened_in(folder)?, (nodes, signals), &|| true)?;
    Ok(reported.expect("it goes on to its end"))
}

fn opened_in(folder: &Path) -> Result<Connection, StoreError> {
    let path = folder.join(HISTORY_FILE);
    let opened = match odd_beside(&path) {
        Some(odd) => Err(rusqlite::Error::InvalidPath(odd)),
        None => Connection::open_with_flags(&path, OpenFlags::SQLITE_OPEN_READ_ONLY),
    };
    let connection = opened.map_err(|reason| StoreError::Open { path, reason })?;
    connection.busy_timeout(Duration::from_secs(2))?;
    Ok(connection)
}

impl History {
    /// Opens or makes the file in `folder`, and starts to write what comes through the queue.
    ///
    /// # Errors
    /// If the file cannot be written or is not a history.
    pub fn open(folder: &Path, clock: Clock) -> Result<(History, SyncSender<Vec<Record>>), StoreError> {
        let start = || {
            let opened = Opened::of(folder)?;
            let reading = Arc::new(Mutex::new(opened.reading));
            Ok(History::start(opened.writing, Some(folder), |_| Ok(reading), opened.writer, clock)?)
        };
        let failed = |error| match error {
            StoreError::Database(reason) => StoreError::Open { path: folder.join(HISTORY_FILE), reason },
            error => error,
        };
        match start() {
            Err(StoreError::Database(error)) if damage::is_damage(&error) => {
                begin_anew(folder, clock, &error)?;
                start().map_err(failed)
            }
            started => started.map_err(failed),
        }
    }

    /// A history in memory. It has one connection for reading and writing.
    pub fn in_memory(clock: Clock) -> Result<(History, SyncSender<Vec<Record>>), StoreError> {
        let shared = |writing: &Arc<Mutex<Connection>>| Ok(writing.clone());
        let connection = Connection::open_in_memory()?;
        prepare(&connection)?;
        let writer = write::Writer::new(&connection, ROWS_MAX)?;
        Ok(History::start(connection, None, shared, writer, clock)?)
    }

    /// A history in memory of what is past: `until` is an instant of its clock, with the wall time then.
    pub fn recorded(
        records: &[Record],
        until: (SystemTime, Timestamp),
        clock: Clock,
    ) -> Result<History, StoreError> {
        let mut connection = Connection::open_in_memory()?;
        prepare(&connection)?;
        write::Writer::new(&connection, ROWS_MAX)?.write(&mut connection, records, until)?;
        let connection = Arc::new(Mutex::new(connection));
        let reader = Arc::new(Reader::new(connection.clone()));
        let trends = Arc::default();
        Ok(History { reader, connection, trends, folder: None, written: Arc::default(), clock })
    }

    /// `reading` is the connection for readers.
    fn start(
        connection: Connection,
        folder: Option<&Path>,
        reading: impl FnOnce(&Arc<Mutex<Connection>>) -> rusqlite::Result<Arc<Mutex<Connection>>>,
        writer: write::Writer,
        clock: Clock,
    ) -> rusqlite::Result<(History, SyncSender<Vec<Record>>)> {
        let connection = Arc::new(Mutex::new(connection));
        let reader = Arc::new(Reader::new(reading(&connection)?));
        let folder = folder.map(Path::to_owned);
        let (writing, written) = oneshot::channel::<()>();
        let written = Arc::new(Mutex::new(Some(written)));
        let history = History { connection, reader, trends: Arc::default(), folder, written, clock };
        let (queue, records) = sync_channel(QUEUE);
        let shared = history.clone();
        // Without a thread the queue fills and records are counted as lost; the program goes on.
        let spawned = std::thread::Builder::new().name("history".to_owned()).spawn(move || {
            shared.write(writer, &records);
            drop(writing);
        });
        if let Err(error) = spawned {
            tracing::error!(%error, "the history has no thread; nothing will be recorded");
        }
        Ok((history, queue))
    }

    /// The records of some nodes, and everything else, in a span of time.
    pub async fn past(&self, query: HistoryQuery) -> Result<Past, StoreError> {
        self.reader.read(READ_WITHIN, move |connection| read::past(connection, &query)).await
    }

    /// The same as [`reported_in`], while `go_on` permits it; `None` if it did not. Blocks. The file is read and written by
    /// others meanwhile; a history in memory is locked.
    ///
    /// # Errors
    /// If it cannot be read.
    pub fn reported(
        &self,
        nodes: &[String],
        signals: &[String],
        go_on: &dyn Fn() -> bool,
    ) -> Result<Option<Reported>, StoreError> {
        Ok(match &self.folder {
            Some(folder) => read::reported(&opened_in(folder)?, (nodes, signals), go_on)?,
            None => read::reported(&self.lock(), (nodes, signals), go_on)?,
        })
    }

    /// Records one by one, in the order in which they were written.
    pub async fn lines(&self, query: LineQuery) -> Result<Vec<HistoryLine>, StoreError> {
        self.reader.read(READ_WITHIN, move |connection| lines::lines(connection, &query)).await
    }

    /// How many alarms there were, and in which stages, between two instants in milliseconds since 1970.
    pub async fn statistics(&self, from_ms: i64, to_ms: i64) -> Result<Statistics, StoreError> {
        self.reader
            .read(READ_WITHIN, move |connection| statistics::statistics(connection, from_ms, to_ms))
            .await
    }

    /// The last alarms, the newest first.
    pub async fn last_alarms(&self, count: u32) -> Result<Vec<PastAlarm>, StoreError> {
        self.reader.read(READ_WITHIN, move |connection| alarms::last_alarms(connection, count)).await
    }

    /// Keeps a minute of the numbers of all modules. Returns when that is written, or cannot be.
    pub async fn keep_minute(&self, minute: Minute) {
        let history = self.clone();
        let kept = tokio::task::spawn_blocking(move || {
            let mut connection = history.lock();
            history.trends.lock().unwrap_or_else(PoisonError::into_inner).keep(&mut connection, &minute);
        });
        if let Err(error) = kept.await {
            tracing::error!(%error, "a minute of the numbers is not kept");
        }
    }

    /// The numbers of a module in a span of time.
    pub async fn trend(&self, query: TrendQuery) -> Result<Trend, StoreError> {
        self.reader.read(READ_WITHIN, move |connection| trends::trend(connection, &query)).await
    }

    /// Waits until all is written that came through the queue, whose sender must be gone.
    pub async fn written(&self) {
        let written = self.written.lock().unwrap_or_else(PoisonError::into_inner).take();
        if let Some(written) = written {
            // The thread sends nothing and drops its end.
            let _ = written.await;
        }
    }

    fn lock(&self) -> MutexGuard<'_, Connection> {
        self.connection.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Goes on with another file beside the damaged one.
    fn replace(&self, why: &rusqlite::Error) -> Result<write::Writer, StoreError> {
        let Some(folder) = &self.folder else { return Err(StoreError::Ended) };
        begin_anew(folder, self.clock, why)?;
        let opened = Opened::of(folder)?;
        *self.lock() = opened.writing;
        *self.trends.lock().unwrap_or_else(PoisonError::into_inner) = TrendWriter::default();
        self.reader.replace(opened.reading);
        Ok(opened.writer)
    }

    /// Runs until the engine's task has ended.
    fn write(&self, mut writer: write::Writer, records: &Receiver<Vec<Record>>) {
        let mut failing = false;
        loop {
            let mut batch = match records.recv_timeout(ALIVE_EVERY) {
                Ok(batch) => batch,
                Err(RecvTimeoutError::Timeout) => Vec::new(),
                Err(RecvTimeoutError::Disconnected) => return,
            };
            batch.extend(records.try_iter().take(QUEUE).flatten());
            let now = (self.clock.wall(), self.clock.now());
            let written = writer.write(&mut self.lock(), &batch, now);
            match &written {
                Err(error) if damage::is_damage(error) && self.folder.is_some() => {
                    match self.replace(error) {
                        Ok(next) => writer = next.without(writer.lost()),
                        Err(error) => tracing::error!(%error, "no other history can be begun"),
                    }
                }
                Err(error) if !failing => {
                    tracing::error!(%error, "the history cannot be written: check the free space of the data folder");
                }
                Ok(()) if failing => tracing::info!("the history can be written again"),
                _ => {}
            }
            failing = written.is_err();
        }
    }
}

/// The connections to a file.
struct Opened {
    writing: Connection,
    reading: Connection,
    writer: write::Writer,
}

impl Opened {
    fn of(folder: &Path) -> Result<Opened, StoreError> {
        let path = folder.join(HISTORY_FILE);
        // It tells where and when the vehicle failed, so only the owner may read it.
        make_private_file(&path).map_err(|reason| StoreError::Folder { path: folder.to_owned(), reason })?;
        put_odd_aside(&path).map_err(|reason| StoreError::Folder { path: folder.to_owned(), reason })?;
        let writing = Connection::open(&path)?;
        writing.busy_timeout(Duration::from_secs(2))?;
        writing.pragma_update_and_check(None, "journal_mode", "WAL", |_| Ok(()))?;
        // The last moments before a loss of power may be missing; the file stays whole.
        writing.pragma_update(None, "synchronous", "NORMAL")?;
        writing.pragma_update(None, "trusted_schema", false)?;
        prepare(&writing)?;
        if let Some(strange) = damage::strange(&writing)? {
            return Err(foreign::damage(&strange).into());
        }
        let writer = write::Writer::new(&writing, ROWS_MAX)?;
        let reading = Connection::open_with_flags(&path, OpenFlags::SQLITE_OPEN_READ_ONLY)?;
        reading.busy_timeout(Duration::from_secs(2))?;
        Ok(Opened { writing, reading, writer })
    }
}

/// Puts a damaged history aside.
fn begin_anew(folder: &Path, clock: Clock, why: &rusqlite::Error) -> Result<(), StoreError> {
    let kept = put_aside(folder, HISTORY_FILE, clock.wall())
        .map_err(|reason| StoreError::Folder { path: folder.to_owned(), reason })?;
    tracing::error!("the history is damaged ({why}): it lies in {}, and another one begins", kept.display());
    Ok(())
}

/// Makes the tables.
fn prepare(connection: &Connection) -> rusqlite::Result<()> {
    connection.execute_batch(SCHEMA)?;
    connection.execute_batch(trends::SCHEMA)?;
    connection.execute_batch(statistics::SCHEMA)
}

#[cfg(test)]
mod tests;
