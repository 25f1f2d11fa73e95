//! Reads the numbers of a module in a span of time.

use std::collections::BTreeMap;

use rusqlite::{Connection, params};

use super::minute::VEHICLE;
use super::pack::{Point, Values, unpack, unpack_all};
use super::write::{beginning, hour_of};
use super::{HOUR_MS, Level, MINUTE_MS};
use crate::history::damage::has_trends;

/// The span of a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resolution {
    Minute,
    Hour,
}

/// A query: milliseconds since 1970, both ends included.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TrendQuery {
    /// The whole name of a module.
    pub node: String,
    pub from_ms: i64,
    pub to_ms: i64,
    pub resolution: Resolution,
}

/// The numbers of a module.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Trend {
    pub values: Vec<ValueTrend>,
    /// The first hour with minutes of any module, and the first hour or day with hours.
    pub minutes_from_ms: Option<i64>,
    pub hours_from_ms: Option<i64>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct ValueTrend {
    pub key: String,
    /// In order. Where the module had no number, there is no point.
    pub points: Vec<TrendPoint>,
}

/// A minute or an hour of a value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrendPoint {
    /// Its beginning.
    pub at_ms: i64,
    /// For how long the number was known in it.
    pub known_s: f64,
    pub least: f32,
    /// By time.
    pub mean: f32,
    pub most: f32,
}

impl Resolution {
    pub const fn span_ms(self) -> i64 {
        match self {
            Resolution::Minute => MINUTE_MS,
            Resolution::Hour => HOUR_MS,
        }
    }
}

/// The way that the vehicle drove, as far as its speed is known: in metres, each with the beginning of its minute, or of
/// its hour where there are no minutes any more.
pub fn drives(connection: &Connection, from_ms: i64, to_ms: i64) -> rusqlite::Result<Vec<(i64, f64)>> {
    let query = TrendQuery { node: VEHICLE.to_owned(), from_ms, to_ms, resolution: Resolution::Minute };
    let mut drives = Vec::new();
    let metres = |point: &Point| f64::from(point.mean) * f64::from(point.tenths) / 10.0;
    if has_trends(connection)? {
        for (day_ms, values) in rows(connection, Level::Day, &query)? {
            let points = values.iter().flat_map(|(_, points)| points);
            drives.extend(points.map(|point| (day_ms + i64::from(point.place) * HOUR_MS, metres(point))));
        }
    }
    let minutes = trend(connection, &query)?;
    for point in minutes.values.iter().flat_map(|value| &value.points) {
        drives.push((point.at_ms, f64::from(point.mean) * point.known_s));
    }
    drives.retain(|&(at_ms, _)| at_ms >= from_ms && at_ms <= to_ms);
    Ok(drives)
}

/// The points of each key by their time.
type Found = BTreeMap<String, BTreeMap<i64, Point>>;

pub fn trend(connection: &Connection, query: &TrendQuery) -> rusqlite::Result<Trend> {
    if !has_trends(connection)? {
        return Ok(Trend::default());
    }
    let mut found = Found::new();
    let first = |level| first_ms(connection, level);
    let minutes_from_ms = first(Level::Hour)?.into_iter().chain(first(Level::Minute)?).min();
    let hours_from_ms = first(Level::Day)?.into_iter().chain(minutes_from_ms).min();
    if query.resolution == Resolution::Hour {
        for (day_ms, values) in rows(connection, Level::Day, query)? {
            put(&mut found, query, values, |point| day_ms + i64::from(point.place) * HOUR_MS);
        }
    }
    for (hour_ms, values) in rows(connection, Level::Hour, query)? {
        match query.resolution {
            Resolution::Minute => {
                put(&mut found, query, values, |point| hour_ms + i64::from(point.place) * MINUTE_MS);
            }
            Resolution::Hour => {
                let hour = |(key, points): (_, Vec<Point>)| Some((key, vec![hour_of(&points, 0)?]));
                put(&mut found, query, values.into_iter().filter_map(hour).collect(), |_| hour_ms);
            }
        }
    }
    let mut minutes = connection.prepare_cached(
        "SELECT from_ms, data FROM trends WHERE level = ? AND from_ms >= ? AND from_ms <= ?",
    )?;
    let from_ms = beginning(query.from_ms, query.resolution.span_ms());
    let mut minutes = minutes.query(params![Level::Minute as i64, from_ms, query.to_ms])?;
    while let Some(row) = minutes.next()? {
        let at_ms = beginning(row.get(0)?, query.resolution.span_ms());
        let all = unpack_all(row.get_ref(1)?.as_blob()?, |node| *node == *query.node).unwrap_or_default();
        for (_, values) in all {
            put(&mut found, query, values, |_| at_ms);
        }
    }
    let values = found.into_iter().map(|(key, points)| ValueTrend {
        key,
        points: points.into_iter().map(|(at_ms, point)| point_at(at_ms, point)).collect(),
    });
    Ok(Trend { values: values.collect(), minutes_from_ms, hours_from_ms })
}

fn point_at(at_ms: i64, point: Point) -> TrendPoint {
    let Point { tenths, least, mean, most, .. } = point;
    TrendPoint { at_ms, known_s: f64::from(tenths) / 10.0, least, mean, most }
}

/// Points whose span of time is in the query; those of one time are joined.
fn put(found: &mut Found, query: &TrendQuery, values: Values, at_ms: impl Fn(&Point) -> i64) {
    for (key, points) in values {
        let known = found.entry(key.into()).or_default();
        for point in points {
            let at_ms = at_ms(&point);
            if at_ms + query.resolution.span_ms() > query.from_ms && at_ms <= query.to_ms {
                known.entry(at_ms).and_modify(|it| *it = it.joined(point)).or_insert(point);
            }
        }
    }
}

/// The rows of the module that may hold something of the span, in the order in which they were written.
fn rows(connection: &Connection, level: Level, query: &TrendQuery) -> rusqlite::Result<Vec<(i64, Values)>> {
    let Some(first_ms) = first_ms(connection, level)? else { return Ok(Vec::new()) };
    let step_ms = level.row_ms();
    // One look for each hour or day: the index has all modules of one time beside one another.
    let mut rows = connection.prepare_cached(
        "WITH RECURSIVE times(at) AS (SELECT ?1 UNION ALL SELECT at + ?2 FROM times WHERE at + ?2 <= ?3)
            SELECT from_ms, data FROM times CROSS JOIN trends ON level = ?4 AND from_ms = at AND node = ?5
            ORDER BY from_ms, id",
    )?;
    let last: Option<i64> = connection
        .prepare_cached("SELECT max(from_ms) FROM trends WHERE level = ?")?
        .query_row([level as i64], |row| row.get(0))?;
    let from_ms = beginning(query.from_ms, step_ms).max(first_ms);
    let to_ms = query.to_ms.min(last.unwrap_or(first_ms));
    if from_ms > to_ms {
        return Ok(Vec::new());
    }
    let row =
        |row: &rusqlite::Row<'_>| Ok((row.get(0)?, unpack(row.get_ref(1)?.as_blob()?).unwrap_or_default()));
    rows.query_map(params![from_ms, step_ms, to_ms, level as i64, query.node], row)?.collect()
}

fn first_ms(connection: &Connection, level: Level) -> rusqlite::Result<Option<i64>> {
    let mut first = connection.prepare_cached("SELECT min(from_ms) FROM trends WHERE level = ?")?;
    first.query_row([level as i64], |row| row.get(0))
}
