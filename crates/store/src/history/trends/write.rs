//! Writes a minute, makes hours of the minutes that are over and days of the hours that are old, and removes the oldest
//! days.

use std::collections::BTreeMap;

use rusqlite::{Connection, OptionalExtension as _, Transaction, TransactionBehavior, params};

use super::minute::Minute;
use super::pack::{Point, Values, join, pack, pack_all, unpack, unpack_all};
use super::{DAY_MS, HOUR_MS, Level, MINUTE_MS};
use crate::database::foreign::damage;
use crate::history::damage::strange;

/// The bytes of all minutes; beyond them the oldest become hours. How old they are does not count: a wall clock may be
/// years ahead for a moment.
pub const MINUTES_BYTES_MAX: u64 = 128 << 20;
/// The bytes of all hours; beyond them the oldest day is removed.
pub const HOURS_BYTES_MAX: u64 = 64 << 20;
/// The bytes of a row beside its data and its name, in the table and in the index.
const ROW_BYTES: usize = 64;
/// Hours that become part of a day with one minute, so that no write takes long.
const AT_ONCE: usize = 2;

/// How much may be kept.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    pub minutes_bytes: u64,
    pub hours_bytes: u64,
}

impl Default for Bounds {
    fn default() -> Bounds {
        Bounds { minutes_bytes: MINUTES_BYTES_MAX, hours_bytes: HOURS_BYTES_MAX }
    }
}

#[derive(Debug, Default)]
pub struct TrendWriter {
    bounds: Bounds,
    /// The version of the schema that was found to be Telltale's.
    schema: Option<i64>,
    /// By level; `None` until they are counted.
    bytes: Option<[u64; 3]>,
    /// The last minute was not kept, which the log says once.
    failing: bool,
}

/// The rows of a transaction, with their bytes.
struct Rows<'a> {
    transaction: &'a Transaction<'a>,
    bytes: [u64; 3],
}

impl TrendWriter {
    #[cfg(test)]
    pub fn bounded(bounds: Bounds) -> TrendWriter {
        TrendWriter { bounds, ..TrendWriter::default() }
    }

    /// Writes all of it or, if the database fails, nothing. Then the minute is missing, and the log says so.
    pub fn keep(&mut self, connection: &mut Connection, minute: &Minute) {
        match self.try_keep(connection, minute) {
            Ok(bytes) => {
                self.bytes = Some(bytes);
                if std::mem::take(&mut self.failing) {
                    tracing::info!("the numbers of the modules are kept again");
                }
            }
            Err(error) => {
                if !self.failing {
                    tracing::error!(%error, "the numbers of the modules are not kept");
                }
                *self = TrendWriter { bounds: self.bounds, failing: true, ..TrendWriter::default() };
            }
        }
    }

    pub(super) fn try_keep(
        &mut self,
        connection: &mut Connection,
        minute: &Minute,
    ) -> rusqlite::Result<[u64; 3]> {
        let transaction = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
        // A trigger of somebody else would act with the first write.
        let schema: i64 = transaction.pragma_query_value(None, "schema_version", |row| row.get(0))?;
        if self.schema != Some(schema) {
            if let Some(strange) = strange(&transaction)? {
                return Err(damage(&strange));
            }
            self.schema = Some(schema);
        }
        let bytes = match self.bytes {
            Some(bytes) => bytes,
            None => counted(&transaction)?,
        };
        let mut rows = Rows { transaction: &transaction, bytes };
        rows.insert(Level::Minute, minute.from_ms, "", &pack_all(&minute.nodes).map_err(unpacked)?)?;
        rows.end_hours(minute.from_ms)?;
        rows.end_days(minute.from_ms, self.bounds.minutes_bytes)?;
        rows.forget(minute.from_ms, self.bounds.hours_bytes)?;
        let bytes = rows.bytes;
        transaction.commit()?;
        Ok(bytes)
    }
}

/// The bytes of each level.
fn counted(connection: &Connection) -> rusqlite::Result<[u64; 3]> {
    let mut bytes = [0; 3];
    // The index alone is read.
    let mut sums = connection.prepare_cached("SELECT level, sum(bytes) FROM trends GROUP BY level")?;
    let mut sums = sums.query([])?;
    while let Some(row) = sums.next()? {
        let level = usize::try_from(row.get::<_, i64>(0)?).unwrap_or(usize::MAX);
        if let Some(known) = bytes.get_mut(level) {
            *known = row.get::<_, i64>(1)?.unsigned_abs();
        }
    }
    Ok(bytes)
}

impl Rows<'_> {
    fn insert(&mut self, level: Level, from_ms: i64, node: &str, data: &[u8]) -> rusqlite::Result<()> {
        let bytes = data.len() + 2 * node.len() + ROW_BYTES;
        self.transaction
            .prepare_cached("INSERT INTO trends (level, from_ms, node, bytes, data) VALUES (?, ?, ?, ?, ?)")?
            .execute(params![level as i64, from_ms, node, bytes as i64, data])?;
        self.bytes[level as usize] += bytes as u64;
        Ok(())
    }

    /// Removes the rows of a level with times from `from_ms` to before `to_ms`, and returns them in their order.
    fn remove(&mut self, level: Level, from_ms: i64, to_ms: i64) -> rusqlite::Result<Vec<Removed>> {
        let mut removed = self.transaction.prepare_cached(
            "DELETE FROM trends WHERE level = ?1 AND from_ms >= ?2 AND from_ms < ?3
                RETURNING id, from_ms, node, bytes, data",
        )?;
        let row = |row: &rusqlite::Row<'_>| {
            Ok(Removed {
                id: row.get(0)?,
                from_ms: row.get(1)?,
                node: row.get(2)?,
                bytes: row.get::<_, i64>(3)?.unsigned_abs(),
                data: row.get(4)?,
            })
        };
        let rows = removed.query_map(params![level as i64, from_ms, to_ms], row)?;
        let mut rows = rows.collect::<rusqlite::Result<Vec<Removed>>>()?;
        rows.sort_by_key(|row| row.id);
        let freed: u64 = rows.iter().map(|row| row.bytes).sum();
        let bytes = &mut self.bytes[level as usize];
        *bytes = bytes.saturating_sub(freed);
        Ok(rows)
    }

    /// The first or the last time of a level.
    fn end(&self, level: Level, end: &str) -> rusqlite::Result<Option<i64>> {
        let sql = format!("SELECT {end}(from_ms) FROM trends WHERE level = ?");
        self.transaction
            .prepare_cached(&sql)?
            .query_row([level as i64], |row| row.get(0))
            .optional()
            .map(Option::flatten)
    }

    /// The oldest time of a level, or one that a wall clock which was ahead has left.
    fn oldest(&self, level: Level, now_ms: i64) -> rusqlite::Result<Option<i64>> {
        let last = self.end(level, "max")?.filter(|&last_ms| last_ms > now_ms + DAY_MS);
        last.map_or_else(|| self.end(level, "min"), |last| Ok(Some(last)))
    }

    /// Minutes of other hours than the present one become a row for each module. A wall clock that went back may leave
    /// some that are later.
    fn end_hours(&mut self, now_ms: i64) -> rusqlite::Result<()> {
        let present = beginning(now_ms, HOUR_MS);
        for end in ["min", "max"] {
            while let Some(at_ms) = self.end(Level::Minute, end)?.map(|at_ms| beginning(at_ms, HOUR_MS))
                && at_ms != present
            {
                self.end_hour(at_ms)?;
            }
        }
        Ok(())
    }

    fn end_hour(&mut self, hour_ms: i64) -> rusqlite::Result<()> {
        let mut nodes: BTreeMap<Box<str>, Values> = BTreeMap::new();
        for row in self.remove(Level::Minute, hour_ms, hour_ms + HOUR_MS)? {
            let place = ((row.from_ms - hour_ms) / MINUTE_MS) as u16;
            // A damaged row is no reason to keep nothing.
            for (node, values) in unpack_all(&row.data, |_| true).unwrap_or_default() {
                let known = nodes.entry(node).or_default();
                for (key, points) in values {
                    join(known, &key, points.into_iter().map(|point| Point { place, ..point }));
                }
            }
        }
        for (node, values) in nodes {
            self.insert(Level::Hour, hour_ms, &node, &pack(&values).map_err(unpacked)?)?;
        }
        Ok(())
    }

    /// The oldest minutes become hours while they are too many.
    fn end_days(&mut self, now_ms: i64, bytes_max: u64) -> rusqlite::Result<()> {
        for _ in 0..AT_ONCE {
            if self.bytes[Level::Hour as usize] > bytes_max
                && let Some(hour_ms) = self.oldest(Level::Hour, now_ms)?
            {
                self.end_day(hour_ms)?;
            }
        }
        Ok(())
    }

    /// Puts the minutes of an hour into the rows of its day, as one point.
    fn end_day(&mut self, hour_ms: i64) -> rusqlite::Result<()> {
        let day_ms = beginning(hour_ms, DAY_MS);
        let mut nodes: BTreeMap<String, Values> = BTreeMap::new();
        for row in self.remove(Level::Hour, hour_ms, hour_ms + 1)? {
            let known = nodes.entry(row.node).or_default();
            for (key, points) in unpack(&row.data).unwrap_or_default() {
                if let Some(point) = hour_of(&points, ((hour_ms - day_ms) / HOUR_MS) as u16) {
                    join(known, &key, [point].into_iter());
                }
            }
        }
        for row in self.remove(Level::Day, day_ms, day_ms + 1)? {
            let known = nodes.entry(row.node).or_default();
            for (key, points) in unpack(&row.data).unwrap_or_default() {
                join(known, &key, points.into_iter());
            }
        }
        for (node, values) in nodes {
            self.insert(Level::Day, day_ms, &node, &pack(&values).map_err(unpacked)?)?;
        }
        Ok(())
    }

    /// Removes the oldest days while the hours are too many.
    fn forget(&mut self, now_ms: i64, bytes_max: u64) -> rusqlite::Result<()> {
        while self.bytes[Level::Day as usize] > bytes_max {
            let Some(day_ms) = self.oldest(Level::Day, now_ms)? else { return Ok(()) };
            let removed = self.remove(Level::Day, day_ms, day_ms + 1)?;
            let day = std::time::UNIX_EPOCH + std::time::Duration::from_millis(day_ms.unsigned_abs());
            let day = humantime::format_rfc3339_seconds(day);
            tracing::info!(
                "the numbers of {} modules of the day {day} are removed: no more fit in",
                removed.len()
            );
        }
        Ok(())
    }
}

struct Removed {
    id: i64,
    from_ms: i64,
    node: String,
    bytes: u64,
    data: Vec<u8>,
}

/// The points of an hour as one.
pub(super) fn hour_of(points: &[Point], place: u16) -> Option<Point> {
    let joined = points.iter().copied().reduce(Point::joined)?;
    Some(Point { place, ..joined })
}

/// The beginning of the hour or day that holds an instant.
pub(super) fn beginning(at_ms: i64, span_ms: i64) -> i64 {
    at_ms - at_ms.rem_euclid(span_ms)
}

/// Nothing but a lack of memory makes packing fail.
fn unpacked(error: std::io::Error) -> rusqlite::Error {
    rusqlite::Error::ToSqlConversionFailure(Box::new(error))
}
