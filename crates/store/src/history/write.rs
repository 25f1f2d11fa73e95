//! Writes records as rows, and removes the oldest rows.

use std::collections::{BTreeSet, HashMap};
use std::time::SystemTime;

use rusqlite::{Connection, Transaction, TransactionBehavior, params};

use super::read::{self, HistoryQuery};
use super::statistics;
use crate::database::foreign::damage;
use telltale_clock::unix_ms;
use telltale_clock::wall_at;
use telltale_engine::event::Said;
use telltale_engine::time::Timestamp;
use telltale_engine::view::record::{Record, Recorded};

/// Kinds of rows. They are numbers on the disk and are never reused.
pub const SHOWN: i64 = 1;
pub const STARTED: i64 = 2;
pub const STAGE: i64 = 3;
pub const SIGNAL: i64 = 4;
pub const RAISED: i64 = 5;
pub const MOVED: i64 = 6;
pub const CLEARED: i64 = 7;
pub const LOST: i64 = 8;
pub const ACKNOWLEDGED: i64 = 9;
pub const LEFT: i64 = 10;

const DAY_MS: i64 = 24 * 3_600_000;

/// Names whose row is known without a query; the others are looked up again.
const NAMES_MAX: usize = 65_536;

#[derive(Debug)]
pub struct Writer {
    names: HashMap<Box<str>, i64>,
    rows: usize,
    rows_max: usize,
    /// When the previous program that wrote this file was last alive.
    alive_before_ms: Option<i64>,
    /// The version of this program, for the records of its starts.
    version: Option<Said>,
    lost: u64,
    /// The version of the schema that was found to be Telltale's.
    schema: Option<i64>,
    /// When this program wrote last.
    written_ms: i64,
}

/// One row without its time.
#[derive(Default)]
struct Row<'a> {
    kind: i64,
    node: Option<i64>,
    state: Option<i64>,
    own: Option<i64>,
    other: Option<i64>,
    number: Option<i64>,
    said: Option<&'a Said>,
}

impl Writer {
    pub fn new(connection: &Connection, rows_max: usize) -> rusqlite::Result<Writer> {
        let rows: i64 = connection.query_row("SELECT count(*) FROM records", [], |row| row.get(0))?;
        let alive = connection.query_row("SELECT max(at_ms) FROM alive", [], |row| row.get(0))?;
        let rows = usize::try_from(rows).unwrap_or(0);
        let missing = super::damage::missing(connection)?;
        if missing > 0 {
            tracing::error!("{missing} records of the history were removed: the timeline has a gap");
        }
        Ok(Writer {
            names: HashMap::new(),
            rows,
            rows_max,
            alive_before_ms: alive,
            version: Said::of(telltale_record::VERSION, None),
            lost: missing,
            schema: None,
            written_ms: 0,
        })
    }

    #[cfg(test)]
    pub fn of_version(self, version: &str) -> Writer {
        Writer { version: Said::of(version, None), ..self }
    }

    /// Records that are not written.
    pub fn lost(&self) -> u64 {
        self.lost
    }

    /// These are lost too.
    pub fn without(self, lost: u64) -> Writer {
        Writer { lost: self.lost + lost, ..self }
    }

    /// Writes all of a batch or, if the database fails, nothing; the batch is then counted as lost.
    pub fn write(
        &mut self,
        connection: &mut Connection,
        batch: &[Record],
        now: (SystemTime, Timestamp),
    ) -> rusqlite::Result<()> {
        let written = self.try_write(connection, batch, now);
        match written {
            Ok(rows) => {
                // Names that only removed rows used are removed with them.
                if rows < self.rows + batch.len() {
                    self.names.clear();
                }
                self.rows = rows;
                self.lost = 0;
                self.written_ms = unix_ms(now.0);
            }
            Err(_) => {
                // Ids from a transaction that was rolled back are invalid.
                self.names.clear();
                self.lost += batch.len() as u64;
            }
        }
        written.map(drop)
    }

    fn try_write(
        &mut self,
        connection: &mut Connection,
        batch: &[Record],
        now: (SystemTime, Timestamp),
    ) -> rusqlite::Result<usize> {
        let transaction = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
        // A trigger of somebody else would act with the first write.
        let schema: i64 = transaction.pragma_query_value(None, "schema_version", |row| row.get(0))?;
        if self.schema != Some(schema) {
            if let Some(strange) = super::damage::strange(&transaction)? {
                return Err(damage(&strange));
            }
            self.schema = Some(schema);
        }
        let now_ms = unix_ms(now.0);
        let mut rows = self.rows;
        if self.lost > 0 {
            insert(
                &transaction,
                now_ms,
                Row { kind: LOST, number: Some(self.lost as i64), ..Row::default() },
            )?;
            rows += 1;
        }
        if now_ms < self.written_ms {
            rows += hold_from(&transaction, now_ms)?;
        }
        for record in batch {
            let row = self.row(&transaction, &record.what)?;
            insert(&transaction, unix_ms(wall_at(now.0, now.1, record.at)), row)?;
        }
        rows += batch.len();
        if rows > self.rows_max {
            rows = trim(&transaction, rows, self.rows_max)?;
        }
        // How many there are tells `telltale data check` whether somebody removed some.
        transaction
            .prepare_cached("INSERT OR REPLACE INTO alive (one, at_ms, rows) VALUES (1, ?, ?)")?
            .execute(params![now_ms, rows as i64])?;
        transaction.commit()?;
        Ok(rows)
    }

    fn row<'a>(&'a mut self, transaction: &Transaction<'_>, what: &'a Recorded) -> rusqlite::Result<Row<'a>> {
        let mut id = |name: &str| self.name(transaction, name);
        Ok(match what {
            Recorded::Shown { node, state, own, cause, said, began: _ } => Row {
                kind: SHOWN,
                node: Some(id(node)?),
                state: Some(*state as i64),
                own: Some(*own as i64),
                other: cause.as_ref().map(|cause| id(cause)).transpose()?,
                number: None,
                said: said.as_ref(),
            },
            Recorded::Started { anew } => Row {
                kind: STARTED,
                state: Some(i64::from(*anew)),
                number: if *anew { None } else { self.alive_before_ms },
                said: self.version.as_ref(),
                ..Row::default()
            },
            Recorded::Stage(stage) => Row { kind: STAGE, state: Some(*stage as i64), ..Row::default() },
            Recorded::Signal { name, value } => {
                Row { kind: SIGNAL, node: Some(id(name)?), state: value.map(i64::from), ..Row::default() }
            }
            Recorded::AlarmRaised { id: number, node } => {
                Row { kind: RAISED, node: Some(id(node)?), number: Some(*number as i64), ..Row::default() }
            }
            Recorded::AlarmMoved { id: number, symptom, cause } => Row {
                kind: MOVED,
                node: Some(id(symptom)?),
                other: Some(id(cause)?),
                number: Some(*number as i64),
                ..Row::default()
            },
            Recorded::AlarmAcknowledged { id: number, node } => Row {
                kind: ACKNOWLEDGED,
                node: Some(id(node)?),
                number: Some(*number as i64),
                ..Row::default()
            },
            Recorded::AlarmCleared { id: number, node } => {
                Row { kind: CLEARED, node: Some(id(node)?), number: Some(*number as i64), ..Row::default() }
            }
            Recorded::Left { node } => Row { kind: LEFT, node: Some(id(node)?), ..Row::default() },
            Recorded::Lost(lost) => Row { kind: LOST, number: Some(*lost as i64), ..Row::default() },
        })
    }

    fn name(&mut self, transaction: &Transaction<'_>, name: &str) -> rusqlite::Result<i64> {
        if let Some(&id) = self.names.get(name) {
            return Ok(id);
        }
        transaction.prepare_cached("INSERT OR IGNORE INTO nodes (name) VALUES (?)")?.execute([name])?;
        let id = transaction
            .prepare_cached("SELECT id FROM nodes WHERE name = ?")?
            .query_row([name], |row| row.get(0))?;
        if self.names.len() >= NAMES_MAX {
            self.names.clear();
        }
        self.names.insert(name.into(), id);
        Ok(id)
    }
}

fn insert(transaction: &Transaction<'_>, at_ms: i64, row: Row<'_>) -> rusqlite::Result<()> {
    let Row { kind, node, state, own, other, number, said } = row;
    let silent_ms = said.and_then(|said| said.silent).map(|silent| silent.as_millis() as i64);
    let said = said.map(|said| &*said.message);
    transaction
        .prepare_cached(
            "INSERT INTO records (at_ms, kind, node, state, own, other, number, said, silent_ms)
                VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
        )?
        .execute(params![at_ms, kind, node, state, own, other, number, said, silent_ms])?;
    Ok(())
}

/// The wall clock was set back to this time: the states that were recorded of later times hold from here on.
fn hold_from(transaction: &Transaction<'_>, at_ms: i64) -> rusqlite::Result<usize> {
    transaction.execute(
        "INSERT INTO records (at_ms, kind, node, state, own, other, number, said, silent_ms)
            SELECT ?1, kind, node, state, own, other, number, said, silent_ms FROM records
            WHERE at_ms > ?1 AND (id IN (SELECT max(id) FROM records WHERE kind = 1 GROUP BY node)
                OR id IN (SELECT max(id) FROM records WHERE kind <> 1 AND kind IN (?2, ?3) GROUP BY kind, node))
            ORDER BY id",
        params![at_ms, STAGE, SIGNAL],
    )
}

/// Removes the oldest rows, a twentieth of all or more. Returns the remaining number of rows.
///
/// Transitions of nodes go first, as they are the most. Alarms, stages and starts may take half of the rows, because the
/// statistics count them; beyond that their oldest days go, and the sums of these days stay.
fn trim(transaction: &Transaction<'_>, rows: usize, rows_max: usize) -> rusqlite::Result<usize> {
    let target = rows_max - rows_max / 20;
    let others = "SELECT count(*) FROM records WHERE kind <> 1";
    let others: i64 = transaction.query_row(others, [], |row| row.get(0))?;
    let surplus = others - (target / 2) as i64;
    let summed = if others > (rows_max / 2) as i64 { sum_up_oldest(transaction, surplus)? } else { 0 };
    let rows = rows - summed;
    let gone = if rows > target { forget_oldest(transaction, rows - target)? } else { 0 };
    transaction.execute(
        "DELETE FROM nodes WHERE id NOT IN (SELECT node FROM records WHERE node IS NOT NULL
            UNION SELECT other FROM records WHERE other IS NOT NULL)",
        [],
    )?;
    Ok(rows - gone)
}

/// Removes about this many of the oldest transitions, but the last one of each node among them stays.
fn forget_oldest(transaction: &Transaction<'_>, surplus: usize) -> rusqlite::Result<usize> {
    transaction.execute(
        "DELETE FROM records WHERE kind = 1
            AND id < ifnull((SELECT id FROM records WHERE kind = 1 ORDER BY id LIMIT 1 OFFSET ?1), 1 << 62)
            AND id NOT IN (SELECT max(id) FROM records WHERE kind = 1
                AND id < ifnull((SELECT id FROM records WHERE kind = 1 ORDER BY id LIMIT 1 OFFSET ?1), 1 << 62)
                GROUP BY node)",
        [surplus as i64],
    )
}

/// Removes about this many of the oldest records of another kind, whole days if there are several, and keeps the
/// statistics of each day. What held at the end of them holds from there on.
fn sum_up_oldest(transaction: &Transaction<'_>, surplus: i64) -> rusqlite::Result<usize> {
    let at = |sql: &str, offset: i64| transaction.query_row(sql, [offset], |row| row.get::<_, i64>(0));
    let ordered = "SELECT at_ms FROM records WHERE kind <> 1 ORDER BY at_ms LIMIT 1 OFFSET ?";
    let (first_ms, border_ms) = (at(ordered, 0)?, at(ordered, surplus)?);
    let day_ms = border_ms - border_ms.rem_euclid(DAY_MS) + DAY_MS;
    let last_ms: i64 =
        transaction.query_row("SELECT max(at_ms) FROM records WHERE kind <> 1", [], |row| row.get(0))?;
    // Nothing is at the end of the day any more, or the day goes on.
    let end_ms = if day_ms <= last_ms { day_ms } else { border_ms + 1 };
    let query = HistoryQuery { nodes: Vec::new(), signals: Vec::new(), from_ms: first_ms, to_ms: end_ms };
    let mut days: BTreeSet<i64> = BTreeSet::new();
    for run in read::runs(transaction, &query)? {
        let newest = run.to_ms.div_euclid(DAY_MS);
        let oldest = run.from_ms.div_euclid(DAY_MS).max(newest - statistics::DAYS_MAX);
        days.extend(oldest..=newest);
    }
    let mut with_records =
        transaction.prepare("SELECT DISTINCT at_ms / ?1 FROM records WHERE kind <> 1 AND at_ms < ?2")?;
    for day in with_records.query_map([DAY_MS, end_ms], |row| row.get(0))? {
        days.insert(day?);
    }
    for day_ms in days.into_iter().map(|day| day * DAY_MS) {
        statistics::keep_day(transaction, day_ms.max(first_ms), (day_ms + DAY_MS).min(end_ms))?;
    }
    let gone = transaction.execute(
        "DELETE FROM records WHERE kind <> 1 AND at_ms < ?1 AND id NOT IN
            (SELECT max(id) FROM records WHERE kind <> 1 AND kind IN (?2, ?3, ?4) AND at_ms < ?1 GROUP BY kind, node)",
        params![end_ms, STARTED, STAGE, SIGNAL],
    )?;
    transaction.execute("UPDATE records SET at_ms = ?1 WHERE kind <> 1 AND at_ms < ?1", [end_ms])?;
    Ok(gone)
}
