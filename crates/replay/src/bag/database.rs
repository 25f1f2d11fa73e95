//! A database of rosbag2 (`.db3`), read only and row by row.

use std::collections::{HashMap, VecDeque};
use std::fs::Metadata;
use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use bytes::Bytes;
use rusqlite::config::DbConfig;
use rusqlite::types::ValueRef;
use rusqlite::{Connection, OpenFlags, OptionalExtension as _, params};

use telltale_record::file::{
    Budget, CHUNK_BYTES_MAX, Channel, Entry, FileError, MessageStamps, Omissions, SPENT, raw_body,
};

pub(super) const MAGIC: &[u8] = b"SQLite format 3\0";

/// More topics are left out.
const TOPICS_MAX: usize = 10_000;
/// A longer name is left out, and a longer definition is not used.
const NAME_BYTES_MAX: usize = 1024;
const DEFINITION_BYTES_MAX: usize = 1 << 20;
/// The rows that are looked up at once, without their data.
const ROWS: usize = 4096;

pub(super) struct Database {
    connection: Connection,
    /// By their number.
    topics: HashMap<i64, Topic>,
    order: &'static str,
    /// The next rows.
    rows: VecDeque<Row>,
    /// The time and the number of the last row that was looked up.
    after: (i64, i64),
    /// The same of the last row that was taken.
    taken: (i64, i64),
    is_at_end: bool,
    omissions: Omissions,
    /// The log of a recorder that did not end, as it was when it was opened.
    log: Option<(PathBuf, Metadata)>,
    /// By the time and the number of a row.
    budget: Budget<(i64, i64)>,
}

enum Topic {
    Known(Arc<Channel>),
    /// Why it is left out.
    Other(String),
}

#[derive(Clone, Copy)]
struct Row {
    number: i64,
    topic: i64,
    time: i64,
    bytes: u64,
}

/// Rows by their time. A number that every row has makes the order definite.
const BY_TIME: &str = "SELECT rowid, topic_id, timestamp, length(data) FROM messages
    WHERE (timestamp, rowid) > (?1, ?2) AND typeof(timestamp) = 'integer' ORDER BY timestamp, rowid LIMIT ?3";
/// Without an index of times, each look at the next rows would sort them all.
const BY_NUMBER: &str = "SELECT rowid, topic_id, timestamp, length(data) FROM messages
    WHERE (?1 = ?1) AND rowid > ?2 AND typeof(timestamp) = 'integer' ORDER BY rowid LIMIT ?3";

impl Database {
    /// # Errors
    /// It is no database of rosbag2, or is damaged in its first parts.
    pub fn open(path: &Path) -> Result<Database, FileError> {
        let failed = |error: rusqlite::Error| {
            FileError::format(path, format!("it cannot be read as a database of rosbag2: {error}"))
        };
        // The files that SQLite keeps beside a database are beside the file itself, wherever a link stands.
        let real = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let journal = beside(&real, "-journal");
        if starts(&journal) {
            let why = format!(
                "its recorder was interrupted while it wrote, and {} has what is to be taken back: copy both into a folder \
                 where you may write, and open the copy once with `sqlite3 COPY .tables`",
                journal.display()
            );
            return Err(FileError::format(path, why));
        }
        let log = beside(&real, "-wal");
        let log = log.metadata().ok().filter(|about| about.len() > 0).map(|about| (log, about));
        let connection = connect(&real, log.is_some()).map_err(failed)?;
        for table in ["topics", "messages"] {
            let query = "SELECT sql FROM sqlite_schema WHERE type = 'table' AND name = ?1";
            let sql: Option<String> =
                connection.query_row(query, [table], |row| row.get(0)).optional().map_err(failed)?;
            if !sql.is_some_and(|sql| sql.to_uppercase().starts_with("CREATE TABLE")) {
                let mut why = format!("it is no database of rosbag2: it has no table {table:?}");
                if log.is_none() && writes_a_log(&real) {
                    why += &format!(
                        ". Its recorder wrote into {} first, which is not beside it: copy that file too",
                        beside(&real, "-wal").display()
                    );
                }
                return Err(FileError::format(path, why));
            }
        }
        let odd = "SELECT name FROM pragma_table_xinfo('messages') WHERE hidden > 0 OR lower(name) = 'rowid'";
        let odd: Option<String> =
            connection.query_row(odd, [], |row| row.get(0)).optional().map_err(failed)?;
        if let Some(column) = odd {
            let why = format!(
                "it is no database of rosbag2: no recorder makes such a column {column:?} of messages"
            );
            return Err(FileError::format(path, why));
        }
        let mut omissions = Omissions::default();
        let topics = topics(&connection, &mut omissions).map_err(failed)?;
        let index = "SELECT 1 FROM pragma_index_list('messages') AS it, pragma_index_info(it.name) AS part
            WHERE part.seqno = 0 AND part.name = 'timestamp' AND it.partial = 0";
        let is_indexed = connection.query_row(index, [], |_| Ok(())).optional().map_err(failed)?.is_some();
        let order = if is_indexed { BY_TIME } else { BY_NUMBER };
        let after = (i64::MIN, i64::MIN);
        let of_log = log.as_ref().map_or(0, |(_, about)| about.len());
        let bytes = path.metadata().map_or(0, |it| it.len()) + of_log;
        Ok(Database {
            budget: Budget::of_file(bytes),
            connection,
            topics,
            order,
            rows: VecDeque::new(),
            after,
            taken: after,
            is_at_end: false,
            omissions,
            log,
        })
    }

    pub fn omissions(&self) -> &Omissions {
        &self.omissions
    }

    pub fn channels(&self) -> Vec<Arc<Channel>> {
        let known = self.topics.iter().filter_map(|(number, topic)| match topic {
            Topic::Known(channel) => Some((number, channel.clone())),
            Topic::Other(_) => None,
        });
        let mut channels: Vec<_> = known.collect();
        channels.sort_unstable_by_key(|(number, _)| **number);
        channels.into_iter().map(|(_, channel)| channel).collect()
    }

    /// The last time of a message.
    pub fn last_ns(&self) -> Option<u64> {
        let last = "SELECT max(timestamp) FROM messages WHERE typeof(timestamp) = 'integer'";
        let last: Option<i64> = self.connection.query_row(last, [], |row| row.get(0)).ok()?;
        last.and_then(|last| u64::try_from(last).ok())
    }

    /// The time and the number of the last row before the next entry.
    pub fn place(&self) -> (i64, i64) {
        self.taken
    }

    pub fn go_to(&mut self, place: (i64, i64)) {
        self.rows.clear();
        (self.after, self.taken, self.is_at_end) = (place, place, false);
    }

    /// The next message. What cannot be used is in `omissions`.
    pub fn next_entry(&mut self) -> Option<Entry> {
        loop {
            let Some(row) = self.rows.pop_front() else {
                self.look_up()?;
                continue;
            };
            self.taken = (row.time, row.number);
            if let Some(entry) = self.entry(row) {
                return Some(entry);
            }
        }
    }

    /// Looks up the next rows; `None` at the end.
    fn look_up(&mut self) -> Option<()> {
        if self.is_at_end {
            return None;
        }
        if let Err(error) = self.find_rows() {
            self.omissions.add(0, 0, format!("the database cannot be read further: {error}"));
            self.is_at_end = true;
        }
        if self.rows.is_empty() {
            self.is_at_end = true;
            let odd = "SELECT count(*) FROM messages WHERE typeof(timestamp) <> 'integer'";
            if let Ok(count @ 1..) = self.connection.query_row(odd, [], |row| row.get::<_, i64>(0)) {
                self.omissions.add(0, 0, format!("{count} messages have no time"));
            }
            self.look_at_log();
            return None;
        }
        Some(())
    }

    /// Says if the recorder goes on: nothing keeps it from changing the database under its reader.
    fn look_at_log(&mut self) {
        let Some((log, before)) = &self.log else { return };
        let now = log.metadata().ok();
        let is_same =
            |now: &Metadata| now.len() == before.len() && now.modified().ok() == before.modified().ok();
        if !now.as_ref().is_some_and(is_same) {
            let why = "it is being recorded meanwhile, and messages may be missing or wrong: end the recording first";
            self.omissions.add(0, 0, why.to_owned());
        }
    }

    fn find_rows(&mut self) -> rusqlite::Result<()> {
        let mut statement = self.connection.prepare_cached(self.order)?;
        let mut rows = statement.query(params![self.after.0, self.after.1, ROWS as i64])?;
        while let Some(row) = rows.next()? {
            let (number, time) = (row.get(0)?, row.get(2)?);
            // A damaged index gives rows in any order: without this they would come again and again.
            let is_next = match self.order == BY_TIME {
                true => (time, number) > self.after,
                false => number > self.after.1,
            };
            if !is_next {
                self.omissions.add(0, 0, "the database is damaged: its rows are out of order".to_owned());
                self.is_at_end = true;
                return Ok(());
            }
            self.after = (time, number);
            let bytes = row.get::<_, Option<i64>>(3)?.and_then(|bytes| u64::try_from(bytes).ok());
            let topic = match row.get_ref(1)? {
                ValueRef::Integer(topic) => topic,
                _ => -1,
            };
            self.rows.push_back(Row { number, topic, time, bytes: bytes.unwrap_or_default() });
        }
        Ok(())
    }

    fn entry(&mut self, row: Row) -> Option<Entry> {
        let Row { number, topic, time, bytes } = row;
        let channel = match self.topics.get(&topic) {
            Some(Topic::Known(channel)) => channel.clone(),
            Some(Topic::Other(why)) => {
                self.omissions.add(0, 0, why.clone());
                return None;
            }
            None => {
                self.omissions.add(0, 0, format!("messages of a topic that is not in the database: {topic}"));
                return None;
            }
        };
        // A column may make its bytes of nothing.
        let why = if !self.budget.has_room(self.taken) {
            self.rows.clear();
            self.is_at_end = true;
            SPENT.to_owned()
        } else if bytes > CHUNK_BYTES_MAX {
            format!("a message of {} with {bytes} bytes is too large", channel.topic)
        } else {
            match self.data(number) {
                Ok(Some(data)) => match raw_body(&Bytes::from(data)) {
                    Some(body) => {
                        let bytes = body.as_ref().map_or(0, |(bytes, _)| bytes.len());
                        self.budget.spend(self.taken, bytes as u64);
                        let ns = u64::try_from(time).unwrap_or_default();
                        let stamps = MessageStamps { log_time_ns: ns, publish_time_ns: ns, sequence: 0 };
                        return Some(Entry::Message { channel, stamps, body });
                    }
                    None => format!("messages of {} without a body", channel.topic),
                },
                Ok(None) => format!("messages of {} that are no bytes", channel.topic),
                Err(error) => format!("messages of {} cannot be read: {error}", channel.topic),
            }
        };
        self.omissions.add(0, 0, why);
        None
    }

    fn data(&self, number: i64) -> rusqlite::Result<Option<Vec<u8>>> {
        let mut statement = self.connection.prepare_cached("SELECT data FROM messages WHERE rowid = ?1")?;
        statement.query_row([number], |row| match row.get_ref(0)? {
            ValueRef::Blob(data) => Ok(Some(data.to_vec())),
            _ => Ok(None),
        })
    }
}

/// Opens a database that nobody else writes. Nothing is written into it or beside it, also where it has a log of changes
/// (`-wal`) that are not in it yet: its index is then kept in memory.
fn connect(path: &Path, has_log: bool) -> rusqlite::Result<Connection> {
    let how = if has_log { "vfs=unix-none" } else { "immutable=1" };
    let uri = format!("file:{}?mode=ro&{how}", escaped(path));
    let flags =
        OpenFlags::SQLITE_OPEN_READ_ONLY | OpenFlags::SQLITE_OPEN_URI | OpenFlags::SQLITE_OPEN_NO_MUTEX;
    let connection = Connection::open_with_flags(uri, flags)?;
    connection.set_db_config(DbConfig::SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, true)?;
    connection.execute_batch(
        "PRAGMA locking_mode = EXCLUSIVE; PRAGMA trusted_schema = OFF; PRAGMA cell_size_check = ON;",
    )?;
    Ok(connection)
}

/// The file that SQLite keeps beside a database.
fn beside(path: &Path, end: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(end);
    name.into()
}

/// Whether a journal has something to be taken back: an ended one is gone, empty, or begins with zeros.
fn starts(journal: &Path) -> bool {
    let mut first = [0];
    let read = std::fs::File::open(journal).and_then(|mut file| file.read(&mut first));
    read.is_ok_and(|bytes| bytes == 1) && first[0] != 0
}

/// Whether changes go into a log first, by the header of the file (SQLite's file format, 1.3).
fn writes_a_log(path: &Path) -> bool {
    let mut header = [0; 20];
    let read = std::fs::File::open(path).and_then(|mut file| file.read_exact(&mut header));
    read.is_ok() && header[18..] == [2, 2]
}

fn topics(connection: &Connection, omissions: &mut Omissions) -> rusqlite::Result<HashMap<i64, Topic>> {
    let mut statement = connection.prepare(
        "SELECT id, name, type, serialization_format FROM topics
         WHERE typeof(id) = 'integer' AND max(length(name), length(type), length(serialization_format)) <= ?1",
    )?;
    let mut found = HashMap::new();
    let mut rows = statement.query([NAME_BYTES_MAX as i64])?;
    while let Some(row) = rows.next()? {
        if found.len() == TOPICS_MAX {
            omissions.add(0, 0, format!("the database has more than {TOPICS_MAX} topics"));
            break;
        }
        let number = row.get(0)?;
        let topic = match [1, 2, 3].map(|column| row.get::<_, String>(column)) {
            [Ok(name), Ok(type_name), Ok(format)] if format == "cdr" => {
                let definition = definition(connection, &type_name);
                Topic::Known(Arc::new(Channel::cdr(&name, &type_name, definition.as_deref())))
            }
            [Ok(name), Ok(_), Ok(format)] => {
                Topic::Other(format!("messages of {name}: their encoding is {format:?}"))
            }
            _ => Topic::Other(format!("messages of topic {number}: its name, type or encoding is no text")),
        };
        found.insert(number, topic);
    }
    Ok(found)
}

/// The definition of a type. Databases from before 2023 have none.
fn definition(connection: &Connection, type_name: &str) -> Option<String> {
    let query = "SELECT encoded_message_definition FROM message_definitions WHERE topic_type = ?1
        AND encoding = 'ros2msg' AND length(encoded_message_definition) BETWEEN 1 AND ?2 LIMIT 1";
    let mut statement = connection.prepare_cached(query).ok()?;
    statement.query_row(params![type_name, DEFINITION_BYTES_MAX as i64], |row| row.get(0)).ok()
}

/// The path in a URI.
fn escaped(path: &Path) -> String {
    use std::fmt::Write as _;
    use std::os::unix::ffi::OsStrExt as _;
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    absolute.as_os_str().as_bytes().iter().fold(String::new(), |mut uri, byte| {
        match byte {
            b'/' | b'.' | b'-' | b'_' | b'0'..=b'9' | b'a'..=b'z' | b'A'..=b'Z' => {
                uri.push(char::from(*byte))
            }
            _ => {
                let _ = write!(uri, "%{byte:02x}");
            }
        }
        uri
    })
}
