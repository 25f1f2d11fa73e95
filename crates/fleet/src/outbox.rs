//! What waits for the hub: the messages of a vehicle in SQLite, in their order, until the hub had them for a while.
//!
//! The hub writes what it acknowledges to its disk later. So messages stay here for [`ACKED_KEPT`] after that, and a hub
//! that was rolled back gets them again. From the oldest message that is here on, each place in the log has a message or
//! lies in a gap; only what the hub acknowledged leaves from the front. Time is the running time of the program: a
//! wall clock that is set ahead would make everything old.

use std::io;
use std::path::{Path, PathBuf};

use rusqlite::{Connection, OptionalExtension as _, Transaction, TransactionBehavior, params};
use telltale_engine::time::{Span, Timestamp};
use telltale_yaml::private_file::make_private_file;

use crate::message::{
    BATCH_MESSAGES_MAX, Batch, Content, Epoch, Gap, GapReason, MESSAGE_BYTES_MAX, Mark, Message, VehicleId,
    packed_len,
};

/// The file in the data folder.
pub const FILE_NAME: &str = "fleet.db";

/// Bytes of all messages that are kept. Beyond it changes of states become gaps first; alarms, heads of the audit log
/// and incidents last.
pub const BYTES_MAX: u64 = 256_000_000;

/// How long a message waits for the hub.
pub const KEPT: Span = Span::from_secs(14 * 24 * 3600);

/// How long a message stays here after the hub acknowledged it.
pub const ACKED_KEPT: Span = Span::from_secs(600);

/// Earlier runs of the program that are remembered, to know one's own messages.
pub const STARTS_MAX: usize = 1024;

/// Bytes of messages, not packed, that are looked at for one batch.
const LOOKED_AT: usize = 1 << 20;

const SCHEMA: &str = "
    CREATE TABLE IF NOT EXISTS starts (epoch TEXT PRIMARY KEY, last INTEGER NOT NULL) STRICT, WITHOUT ROWID;
    CREATE TABLE IF NOT EXISTS messages (
        epoch TEXT NOT NULL,
        n INTEGER NOT NULL,
        last INTEGER NOT NULL,
        rank INTEGER NOT NULL,
        made_s INTEGER NOT NULL,
        acked_s INTEGER,
        json TEXT NOT NULL,
        PRIMARY KEY (epoch, n)
    ) STRICT, WITHOUT ROWID;
    CREATE INDEX IF NOT EXISTS messages_unsent ON messages (epoch, n) WHERE acked_s IS NULL;
    CREATE INDEX IF NOT EXISTS messages_by_rank ON messages (rank, epoch, n) WHERE acked_s IS NULL;
    CREATE INDEX IF NOT EXISTS messages_acked ON messages (acked_s) WHERE acked_s IS NOT NULL;
    CREATE TABLE IF NOT EXISTS recordings (
        incident INTEGER PRIMARY KEY,
        path TEXT NOT NULL,
        sha256 TEXT NOT NULL,
        bytes INTEGER NOT NULL,
        sent INTEGER NOT NULL DEFAULT 0,
        is_told INTEGER NOT NULL DEFAULT 0
    ) STRICT;
    CREATE TABLE IF NOT EXISTS sent_by_itself (incident INTEGER PRIMARY KEY) STRICT;
    CREATE TABLE IF NOT EXISTS life (one INTEGER PRIMARY KEY CHECK (one = 1), ran_s INTEGER NOT NULL) STRICT;
";

/// The rank of a gap, which is never given up.
const GAP: i64 = 9;

/// Bytes that a row takes beside its text.
const ROW_BYTES: u64 = 64;

/// Why the outbox cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum OutboxError {
    #[error("{}: {reason}", .path.display())]
    Open { path: PathBuf, reason: rusqlite::Error },
    #[error("{}: {reason}", .path.display())]
    Make { path: PathBuf, reason: io::Error },
    #[error("the outbox of the fleet: {0}")]
    Disk(#[from] rusqlite::Error),
}

/// How much is kept.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    pub bytes: u64,
    pub kept: Span,
}

impl Default for Limits {
    fn default() -> Limits {
        Limits { bytes: BYTES_MAX, kept: KEPT }
    }
}

/// What makes the epoch of a run.
#[derive(Debug, Clone, Copy)]
pub struct Seed {
    /// The number of the first run of a new outbox, larger than those of one that was lost: seconds since 1970.
    pub first: u32,
    /// Random: a copied outbox has other epochs from its next start on.
    pub nonce: u32,
}

#[derive(Debug)]
pub struct Outbox {
    connection: Connection,
    limits: Limits,
    epoch: Epoch,
    last: u64,
    /// The seconds that earlier runs took.
    ran_before_s: u64,
    started: Timestamp,
    bytes: u64,
    /// The disk refused a message.
    has_missed: bool,
}

/// Messages that are to be sent.
#[derive(Debug)]
pub struct Pending {
    pub end: Mark,
    pub packed: Vec<u8>,
}

/// A row that may be given up.
struct Row {
    epoch: String,
    n: i64,
    last: i64,
    bytes: u64,
}

impl Outbox {
    /// Opens or makes the outbox in a data folder, and begins an epoch.
    ///
    /// # Errors
    /// Of the disk.
    pub fn open(folder: &Path, limits: Limits, seed: Seed, now: Timestamp) -> Result<Outbox, OutboxError> {
        let path = folder.join(FILE_NAME);
        make_private_file(&path).map_err(|reason| OutboxError::Make { path: path.clone(), reason })?;
        let opened = Connection::open(&path).and_then(|connection| {
            connection.pragma_update(None, "journal_mode", "WAL")?;
            // An epoch, or a message that the hub has, must not be forgotten by a loss of power.
            connection.pragma_update(None, "synchronous", "FULL")?;
            connection.pragma_update(None, "journal_size_limit", 4 << 20)?;
            Ok(connection)
        });
        let connection = opened.map_err(|reason| OutboxError::Open { path, reason })?;
        Outbox::over(connection, limits, seed, now)
    }

    /// # Errors
    /// Of the database.
    pub(crate) fn over(
        mut connection: Connection,
        limits: Limits,
        seed: Seed,
        now: Timestamp,
    ) -> Result<Outbox, OutboxError> {
        connection.set_prepared_statement_cache_capacity(32);
        connection.execute_batch(SCHEMA)?;
        let started = transaction(&mut connection)?;
        let ran_before_s = started
            .query_row("SELECT ran_s FROM life", [], |row| row.get::<_, i64>(0))
            .optional()?
            .unwrap_or(0)
            .unsigned_abs();
        let newest =
            started.query_row("SELECT max(epoch) FROM starts", [], |row| row.get::<_, Option<String>>(0))?;
        let newest = newest.and_then(|it| Epoch::try_from(it).ok());
        let start = newest.map_or(seed.first, |epoch| epoch.start.saturating_add(1));
        let epoch = Epoch { start, nonce: seed.nonce };
        started.execute("INSERT INTO starts (epoch, last) VALUES (?1, 0)", [epoch.to_string()])?;
        started.execute(
            "DELETE FROM starts WHERE epoch NOT IN (SELECT epoch FROM starts ORDER BY epoch DESC LIMIT ?1)
             AND epoch NOT IN (SELECT epoch FROM messages)",
            [signed(STARTS_MAX as u64)],
        )?;
        let sum = "SELECT coalesce(sum(length(json) + ?1), 0) FROM messages";
        let bytes: i64 = started.query_row(sum, [ROW_BYTES as i64], |row| row.get(0))?;
        started.commit()?;
        Ok(Outbox {
            connection,
            limits,
            epoch,
            last: 0,
            ran_before_s,
            started: now,
            bytes: bytes.unsigned_abs(),
            has_missed: false,
        })
    }

    /// The epoch of this run.
    pub fn epoch(&self) -> Epoch {
        self.epoch
    }

    /// The number of the last message of this run; 0 if there is none.
    pub fn last(&self) -> u64 {
        self.last
    }

    /// The bytes of all messages that are here.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Takes messages, all or none, and gives the place of the first. One that no batch can hold becomes a gap.
    ///
    /// # Errors
    /// Of the disk: the messages are lost, and the next one that the disk takes has a gap before it.
    pub fn push(&mut self, at_ms: i64, contents: &[Content], now: Timestamp) -> Result<Mark, OutboxError> {
        let pushed = self.insert(at_ms, contents, now);
        self.has_missed = pushed.is_err();
        let first = pushed?;
        self.make_room(at_ms)?;
        Ok(first)
    }

    fn insert(&mut self, at_ms: i64, contents: &[Content], now: Timestamp) -> Result<Mark, OutboxError> {
        let (epoch, ran_s) = (self.epoch.to_string(), self.ran_s(now));
        let (mut last, mut bytes) = (self.last, 0);
        let writing = transaction(&mut self.connection)?;
        let mut write = |rank: i64, json: String, n: u64| {
            bytes += json.len() as u64 + ROW_BYTES;
            writing
                .prepare_cached(
                    "INSERT INTO messages (epoch, n, last, rank, made_s, json) VALUES (?1, ?2, ?2, ?3, ?4, ?5)",
                )?
                .execute(params![epoch, signed(n), rank, signed(ran_s), json])
        };
        if self.has_missed {
            last += 1;
            write(GAP, gap(self.epoch, last, last, at_ms, GapReason::Disk), last)?;
        }
        let first = last + 1;
        for content in contents {
            last += 1;
            let json = json(&Message { epoch: self.epoch, n: last, at: at_ms, content: content.clone() });
            match fits(&json) {
                true => write(rank(content), json, last)?,
                false => write(GAP, gap(self.epoch, last, last, at_ms, GapReason::TooLarge), last)?,
            };
        }
        writing
            .prepare_cached("UPDATE starts SET last = ?2 WHERE epoch = ?1")?
            .execute(params![epoch, signed(last)])?;
        live(&writing, ran_s)?;
        writing.commit()?;
        self.bytes += bytes;
        self.last = last;
        Ok(Mark { epoch: self.epoch, n: first })
    }

    /// The oldest messages that the hub has not acknowledged, packed in at most so many bytes, but at least one.
    ///
    /// # Errors
    /// Of the disk.
    pub fn batch(
        &self,
        id: &VehicleId,
        key: &str,
        sent_ms: i64,
        bytes_max: usize,
    ) -> Result<Option<Pending>, OutboxError> {
        let messages = self.unsent()?;
        let mut count = messages.len();
        while count > 0 {
            let json: Vec<&str> = messages[..count].iter().map(|(_, json)| json.as_str()).collect();
            let packed = Batch::pack(id, key, sent_ms, &json);
            if let Some(packed) = packed.filter(|packed| packed.len() <= bytes_max || count == 1) {
                let end = messages[count - 1].0;
                return Ok(Some(Pending { end, packed }));
            }
            count /= 2;
        }
        Ok(None)
    }

    fn unsent(&self) -> Result<Vec<(Mark, String)>, OutboxError> {
        let mut query = self.connection.prepare_cached(
            "SELECT epoch, last, json FROM messages WHERE acked_s IS NULL ORDER BY epoch, n LIMIT ?1",
        )?;
        let mut rows = query.query([signed(BATCH_MESSAGES_MAX as u64)])?;
        let mut messages = Vec::new();
        let mut bytes = 0;
        while let Some(row) = rows.next()? {
            let json: String = row.get(2)?;
            bytes += json.len();
            if bytes > LOOKED_AT && !messages.is_empty() {
                break;
            }
            messages.push((mark(row.get(0)?, row.get(1)?), json));
        }
        Ok(messages)
    }

    /// Whether something waits for the hub.
    ///
    /// # Errors
    /// Of the disk.
    pub fn has_unsent(&self) -> Result<bool, OutboxError> {
        let sql = "SELECT EXISTS (SELECT 1 FROM messages WHERE acked_s IS NULL)";
        Ok(self.connection.prepare_cached(sql)?.query_row([], |row| row.get(0))?)
    }

    /// Whether this outbox made the message at this place.
    ///
    /// # Errors
    /// Of the disk.
    pub fn knows(&self, mark: Mark) -> Result<bool, OutboxError> {
        let sql = "SELECT EXISTS (SELECT 1 FROM starts WHERE epoch = ?1 AND last >= ?2)";
        let row = params![mark.epoch.to_string(), signed(mark.n)];
        Ok(self.connection.prepare_cached(sql)?.query_row(row, |row| row.get(0))?)
    }

    /// The hub has everything up to this place, and nothing after it. What it lost and is here is sent again; what is
    /// not here any more becomes a gap.
    ///
    /// # Errors
    /// Of the disk.
    pub fn hub_has(&mut self, last: Option<Mark>, at_ms: i64, now: Timestamp) -> Result<(), OutboxError> {
        let ran_s = self.ran_s(now);
        let (epoch, n) = last.map_or((String::new(), 0), |it| (it.epoch.to_string(), signed(it.n)));
        let writing = transaction(&mut self.connection)?;
        writing
            .prepare_cached(
                "UPDATE messages SET acked_s = ?3
                 WHERE acked_s IS NULL AND (epoch, n) <= (?1, ?2) AND (epoch, last) <= (?1, ?2)",
            )?
            .execute(params![epoch, n, signed(ran_s)])?;
        writing
            .prepare_cached(
                "UPDATE messages SET acked_s = NULL WHERE acked_s IS NOT NULL AND (epoch, last) > (?1, ?2)",
            )?
            .execute(params![epoch, n])?;
        let mut bytes = 0;
        for Missing { start, from, to } in missing(&writing, &epoch, n)? {
            let epoch = Epoch::try_from(start.clone()).unwrap_or(self.epoch);
            let json = gap(epoch, from.unsigned_abs(), to.unsigned_abs(), at_ms, GapReason::Lost);
            bytes += json.len() as u64 + ROW_BYTES;
            writing
                .prepare_cached(
                    "INSERT INTO messages (epoch, n, last, rank, made_s, json) VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
                )?
                .execute(params![start, from, to, GAP, signed(ran_s), json])?;
        }
        live(&writing, ran_s)?;
        writing.commit()?;
        self.bytes += bytes;
        Ok(())
    }

    /// Removes what the hub has had for long enough, and makes gaps of what waited for too long.
    ///
    /// # Errors
    /// Of the disk.
    pub fn tidy(&mut self, at_ms: i64, now: Timestamp) -> Result<(), OutboxError> {
        let ran_s = self.ran_s(now);
        let acked_before = signed(ran_s) - signed(ACKED_KEPT.as_millis() / 1000);
        let writing = transaction(&mut self.connection)?;
        let mut removed = 0;
        {
            let mut delete =
                writing.prepare_cached("DELETE FROM messages WHERE acked_s <= ?1 RETURNING length(json)")?;
            for bytes in delete.query_map([acked_before], |row| row.get::<_, i64>(0))? {
                removed += bytes?.unsigned_abs() + ROW_BYTES;
            }
        }
        live(&writing, ran_s)?;
        writing.commit()?;
        self.bytes = self.bytes.saturating_sub(removed);
        let made_before = signed(ran_s) - signed(self.limits.kept.as_millis() / 1000);
        while let Some(row) = self.oldest_before(made_before)? {
            self.give_up(&row, at_ms, GapReason::TooOld)?;
        }
        Ok(())
    }

    /// The oldest message that waits and is no gap, if it was made before this.
    fn oldest_before(&self, made_s: i64) -> Result<Option<Row>, OutboxError> {
        let sql = "SELECT epoch, n, last, length(json), made_s FROM messages
            WHERE acked_s IS NULL AND rank <> ?1 ORDER BY epoch, n LIMIT 1";
        let found = self
            .connection
            .prepare_cached(sql)?
            .query_row([GAP], |found| Ok((row(found)?, found.get::<_, i64>(4)?)));
        Ok(found.optional()?.filter(|(_, made)| *made < made_s).map(|(row, _)| row))
    }

    /// Gives up what is worth least until everything fits.
    fn make_room(&mut self, at_ms: i64) -> Result<(), OutboxError> {
        while self.bytes > self.limits.bytes {
            let sql = "DELETE FROM messages WHERE (epoch, n) IN
                (SELECT epoch, n FROM messages WHERE acked_s IS NOT NULL ORDER BY epoch, n LIMIT 1)
                RETURNING length(json)";
            let acked: Option<i64> =
                self.connection.prepare_cached(sql)?.query_row([], |row| row.get(0)).optional()?;
            if let Some(bytes) = acked {
                self.bytes = self.bytes.saturating_sub(bytes.unsigned_abs() + ROW_BYTES);
                continue;
            }
            let sql = "SELECT epoch, n, last, length(json) FROM messages
                WHERE acked_s IS NULL AND rank < ?1 ORDER BY rank, epoch, n LIMIT 1";
            let next = self.connection.prepare_cached(sql)?.query_row([GAP], row).optional()?;
            let Some(next) = next else { break };
            self.give_up(&next, at_ms, GapReason::Overflow)?;
        }
        Ok(())
    }

    /// Puts a gap in the place of a message, one with the gaps beside it. A gap that the hub has in part waits as a
    /// whole.
    fn give_up(&mut self, given: &Row, at_ms: i64, why: GapReason) -> Result<(), OutboxError> {
        let writing = transaction(&mut self.connection)?;
        let beside = "DELETE FROM messages WHERE epoch = ?1 AND rank = ?2 AND acked_s IS NULL
            AND (last = ?3 - 1 OR n = ?4 + 1) RETURNING epoch, n, last, length(json)";
        let gone: Vec<Row> = writing
            .prepare_cached(beside)?
            .query_map(params![given.epoch, GAP, given.n, given.last], row)?
            .collect::<Result<_, _>>()?;
        let first = gone.iter().map(|it| it.n).chain([given.n]).min().unwrap_or(given.n);
        let last = gone.iter().map(|it| it.last).chain([given.last]).max().unwrap_or(given.last);
        let epoch = Epoch::try_from(given.epoch.clone()).unwrap_or(self.epoch);
        let json = gap(epoch, first.unsigned_abs(), last.unsigned_abs(), at_ms, why);
        let made = "DELETE FROM messages WHERE epoch = ?1 AND n = ?2 RETURNING made_s";
        let made_s: i64 =
            writing.prepare_cached(made)?.query_row(params![given.epoch, given.n], |row| row.get(0))?;
        writing
            .prepare_cached(
                "INSERT INTO messages (epoch, n, last, rank, made_s, json) VALUES (?1, ?2, ?3, ?4, ?5, ?6)",
            )?
            .execute(params![given.epoch, first, last, GAP, made_s, json])?;
        writing.commit()?;
        let freed: u64 = gone.iter().chain([given]).map(|it| it.bytes + ROW_BYTES).sum();
        self.bytes = self.bytes.saturating_sub(freed) + json.len() as u64 + ROW_BYTES;
        Ok(())
    }

    pub(crate) fn connection(&self) -> &Connection {
        &self.connection
    }

    fn ran_s(&self, now: Timestamp) -> u64 {
        self.ran_before_s + now.since(self.started).as_millis() / 1000
    }

    #[cfg(test)]
    pub(crate) fn into_connection(self) -> Connection {
        self.connection
    }
}

/// Places of one epoch that neither the hub nor the outbox has.
struct Missing {
    start: String,
    from: i64,
    to: i64,
}

/// All of them after this place.
fn missing(reading: &Transaction<'_>, epoch: &str, n: i64) -> Result<Vec<Missing>, rusqlite::Error> {
    let mut starts =
        reading.prepare_cached("SELECT epoch, last FROM starts WHERE epoch >= ?1 ORDER BY epoch")?;
    let starts: Vec<(String, i64)> =
        starts.query_map([epoch], |row| Ok((row.get(0)?, row.get(1)?)))?.collect::<Result<_, _>>()?;
    let mut found = Vec::new();
    for (start, last) in starts {
        let next = if start == epoch { n + 1 } else { 1 };
        let sql = "SELECT min(n) FROM messages WHERE epoch = ?1 AND last >= ?2";
        let here: Option<i64> =
            reading.prepare_cached(sql)?.query_row(params![start, next], |row| row.get(0))?;
        let until = here.map_or(last, |here| here - 1);
        if until >= next {
            found.push(Missing { start, from: next, to: until });
        }
        if here.is_some() {
            // From the oldest message on nothing is missing.
            break;
        }
    }
    Ok(found)
}

fn transaction(connection: &mut Connection) -> Result<Transaction<'_>, rusqlite::Error> {
    connection.transaction_with_behavior(TransactionBehavior::Immediate)
}

fn live(writing: &Transaction<'_>, ran_s: u64) -> Result<(), rusqlite::Error> {
    writing
        .prepare_cached("INSERT INTO life (one, ran_s) VALUES (1, ?1) ON CONFLICT DO UPDATE SET ran_s = ?1")?
        .execute([signed(ran_s)])?;
    Ok(())
}

fn row(row: &rusqlite::Row<'_>) -> Result<Row, rusqlite::Error> {
    let bytes = row.get::<_, i64>(3)?.unsigned_abs();
    Ok(Row { epoch: row.get(0)?, n: row.get(1)?, last: row.get(2)?, bytes })
}

/// The order of messages to be given up.
fn rank(content: &Content) -> i64 {
    match content {
        Content::Head(_) | Content::Delta(_) | Content::Unknown => 0,
        Content::Keyframe(_) => 1,
        Content::Goodbye => 2,
        Content::Incident(_) | Content::Recording(_) | Content::AuditHead(_) | Content::Alarm(_) => 3,
        Content::Gap(_) => GAP,
    }
}

fn json(message: &Message) -> String {
    serde_json::to_string(message).expect("texts and numbers are JSON")
}

/// Whether a batch can hold it.
fn fits(json: &str) -> bool {
    let is_small = json.len() <= MESSAGE_BYTES_MAX / 2;
    is_small || json.len() <= LOOKED_AT && packed_len(json).is_some_and(|it| it <= MESSAGE_BYTES_MAX)
}

fn gap(epoch: Epoch, n: u64, to: u64, at: i64, why: GapReason) -> String {
    json(&Message { epoch, n, at, content: Content::Gap(Gap { to, why }) })
}

fn mark(epoch: String, n: i64) -> Mark {
    // Only this program writes the file. Text that is no epoch sorts first and is sent first.
    let epoch = Epoch::try_from(epoch).unwrap_or(Epoch { start: 0, nonce: 0 });
    Mark { epoch, n: n.unsigned_abs() }
}

pub(crate) fn signed(n: u64) -> i64 {
    i64::try_from(n).unwrap_or(i64::MAX)
}
