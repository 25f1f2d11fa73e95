//! Rows back into what was shown when.

use std::sync::Arc;

use rusqlite::{Connection, OptionalExtension as _, Row, params};

use super::write::{ACKNOWLEDGED, CLEARED, LOST, MOVED, RAISED, SIGNAL, STAGE, STARTED};
use crate::engine::model::Stage;
use crate::engine::state::State;

/// Transitions of one node that are read; a picture holds no more.
const STRETCHES_MAX: usize = 4000;
const HAPPENED_MAX: usize = 500;

/// What is asked for: milliseconds since 1970, both ends included.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HistoryQuery {
    pub nodes: Vec<String>,
    pub from_ms: i64,
    pub to_ms: i64,
}

#[derive(Debug, Clone, PartialEq, Default)]
pub struct Past {
    /// As asked for, in that order.
    pub nodes: Vec<NodePast>,
    /// All that is no transition of a node, oldest first.
    pub happened: Vec<(i64, Happened)>,
    /// There is more than was read.
    pub cut: bool,
}

#[derive(Debug, Clone, PartialEq)]
pub struct NodePast {
    pub name: String,
    /// In order; between two may be a gap in which nothing was recorded.
    pub stretches: Vec<Stretch>,
}

/// A node showed this for this long.
#[derive(Debug, Clone, PartialEq)]
pub struct Stretch {
    pub from_ms: i64,
    pub to_ms: i64,
    pub state: State,
    pub own: State,
    /// The root cause that masked it.
    pub cause: Option<Arc<str>>,
}

#[derive(Debug, Clone, PartialEq)]
pub enum Happened {
    Started { anew: bool },
    Stage(Stage),
    Signal { name: String, value: Option<bool> },
    AlarmRaised { id: i64, node: String },
    AlarmMoved { id: i64, symptom: String, cause: String },
    AlarmAcknowledged { id: i64, node: String },
    AlarmCleared { id: i64, node: String },
    Lost(i64),
}

pub fn past(connection: &Connection, query: &HistoryQuery) -> rusqlite::Result<Past> {
    let mut past = Past { nodes: Vec::with_capacity(query.nodes.len()), ..Past::default() };
    let starts = starts(connection, query)?;
    for name in &query.nodes {
        let rows = shown(connection, name, query)?;
        past.cut |= rows.len() >= STRETCHES_MAX;
        past.nodes.push(NodePast { name: name.clone(), stretches: stretches(&rows, &starts, query) });
    }
    past.happened = happened(connection, query)?;
    past.cut |= past.happened.len() >= HAPPENED_MAX;
    Ok(past)
}

/// The program started or took another configuration: nothing shown before lasts beyond.
struct Start {
    id: i64,
    /// When that ended which was shown before.
    ended_ms: i64,
}

struct Shown {
    id: i64,
    at_ms: i64,
    state: State,
    own: State,
    cause: Option<Arc<str>>,
}

/// The last start before the span, all in it, and the next: it tells when the run before it ended.
fn starts(connection: &Connection, query: &HistoryQuery) -> rusqlite::Result<Vec<Start>> {
    let start = |row: &Row<'_>| {
        let (id, at_ms): (i64, i64) = (row.get(0)?, row.get(1)?);
        let alive: Option<i64> = row.get(2)?;
        Ok(Start { id, ended_ms: alive.unwrap_or(at_ms).min(at_ms) })
    };
    let mut before = connection.prepare_cached(
        "SELECT id, at_ms, number FROM records WHERE kind = ? AND kind <> 1 AND at_ms <= ?
            ORDER BY at_ms DESC, id DESC LIMIT 1",
    )?;
    let mut starts: Vec<Start> =
        before.query_row([STARTED, query.from_ms], start).optional()?.into_iter().collect();
    let mut within = connection.prepare_cached(
        "SELECT id, at_ms, number FROM records WHERE kind = ? AND kind <> 1 AND at_ms > ? AND at_ms <= ? ORDER BY id",
    )?;
    for found in within.query_map([STARTED, query.from_ms, query.to_ms], start)? {
        starts.push(found?);
    }
    let mut after = connection.prepare_cached(
        "SELECT id, at_ms, number FROM records WHERE kind = ? AND kind <> 1 AND at_ms > ?
            ORDER BY at_ms, id LIMIT 1",
    )?;
    starts.extend(after.query_row([STARTED, query.to_ms], start).optional()?);
    Ok(starts)
}

/// What a node showed when the span began, and its transitions in it.
fn shown(connection: &Connection, name: &str, query: &HistoryQuery) -> rusqlite::Result<Vec<Shown>> {
    const COLUMNS: &str = "SELECT records.id, at_ms, state, own, cause.name FROM records
        LEFT JOIN nodes AS cause ON cause.id = other
        WHERE kind = 1 AND node = (SELECT id FROM nodes WHERE name = ?)";
    let shown = |row: &Row<'_>| {
        Ok(Shown {
            id: row.get(0)?,
            at_ms: row.get(1)?,
            state: state(row.get(2)?),
            own: state(row.get(3)?),
            cause: row.get::<_, Option<String>>(4)?.map(Arc::from),
        })
    };
    let before = format!("{COLUMNS} AND at_ms <= ? ORDER BY at_ms DESC, records.id DESC LIMIT 1");
    let before =
        connection.prepare_cached(&before)?.query_row(params![name, query.from_ms], shown).optional()?;
    let mut rows: Vec<Shown> = before.into_iter().collect();
    let within = format!("{COLUMNS} AND at_ms > ? AND at_ms <= ? ORDER BY at_ms, records.id LIMIT ?");
    let mut within = connection.prepare_cached(&within)?;
    let limit = STRETCHES_MAX as i64;
    for found in within.query_map(params![name, query.from_ms, query.to_ms, limit], shown)? {
        rows.push(found?);
    }
    Ok(rows)
}

fn stretches(rows: &[Shown], starts: &[Start], query: &HistoryQuery) -> Vec<Stretch> {
    let mut stretches = Vec::with_capacity(rows.len());
    for (index, row) in rows.iter().enumerate() {
        let next_ms = rows.get(index + 1).map_or(query.to_ms, |next| next.at_ms);
        let cut_ms = starts.iter().find(|start| start.id > row.id).map_or(i64::MAX, |start| start.ended_ms);
        let (from_ms, to_ms) = (row.at_ms.max(query.from_ms), next_ms.min(cut_ms).min(query.to_ms));
        if from_ms < to_ms {
            let Shown { state, own, ref cause, .. } = *row;
            stretches.push(Stretch { from_ms, to_ms, state, own, cause: cause.clone() });
        }
    }
    stretches
}

fn happened(connection: &Connection, query: &HistoryQuery) -> rusqlite::Result<Vec<(i64, Happened)>> {
    let mut statement = connection.prepare_cached(
        "SELECT at_ms, kind, node.name, state, other.name, number FROM records
            LEFT JOIN nodes AS node ON node.id = node LEFT JOIN nodes AS other ON other.id = other
            WHERE kind <> 1 AND at_ms >= ? AND at_ms <= ? ORDER BY at_ms DESC, records.id DESC LIMIT ?",
    )?;
    let rows = statement.query_map(params![query.from_ms, query.to_ms, HAPPENED_MAX as i64], |row| {
        let name = |column: usize| row.get::<_, Option<String>>(column).map(Option::unwrap_or_default);
        let flag: Option<i64> = row.get(3)?;
        let number = row.get::<_, Option<i64>>(5)?.unwrap_or_default();
        let what = match row.get::<_, i64>(1)? {
            STARTED => Some(Happened::Started { anew: flag == Some(1) }),
            STAGE => flag.and_then(stage).map(Happened::Stage),
            SIGNAL => Some(Happened::Signal { name: name(2)?, value: flag.map(|flag| flag == 1) }),
            RAISED => Some(Happened::AlarmRaised { id: number, node: name(2)? }),
            MOVED => Some(Happened::AlarmMoved { id: number, symptom: name(2)?, cause: name(4)? }),
            ACKNOWLEDGED => Some(Happened::AlarmAcknowledged { id: number, node: name(2)? }),
            CLEARED => Some(Happened::AlarmCleared { id: number, node: name(2)? }),
            LOST => Some(Happened::Lost(number)),
            // Of a newer program.
            _ => None,
        };
        Ok(what.map(|what| (row.get_unwrap(0), what)))
    })?;
    let mut happened = rows.filter_map(Result::transpose).collect::<rusqlite::Result<Vec<_>>>()?;
    happened.reverse();
    Ok(happened)
}

/// What no program of ours has written is unknown.
fn state(number: i64) -> State {
    State::ALL.into_iter().find(|state| *state as i64 == number).unwrap_or(State::Unknown)
}

fn stage(number: i64) -> Option<Stage> {
    Stage::ALL.into_iter().find(|stage| *stage as i64 == number)
}
