//! Reads rows of the history back into the states that were shown.

use std::sync::Arc;

use rusqlite::{Connection, OptionalExtension as _, Row, ToSql, params};

use super::write::{ACKNOWLEDGED, CLEARED, LEFT, LOST, MOVED, RAISED, SIGNAL, STAGE, STARTED};
use telltale_engine::event::Said;
use telltale_engine::model::Stage;
use telltale_engine::state::State;
use telltale_engine::time::Span;
use telltale_engine::view::record::Stretch;

/// Transitions of one node that are read; a picture holds no more.
const STRETCHES_MAX: usize = 4000;
const EVENTS_MAX: usize = 500;

/// A query: milliseconds since 1970, both ends included.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct HistoryQuery {
    pub nodes: Vec<String>,
    pub signals: Vec<String>,
    pub from_ms: i64,
    pub to_ms: i64,
}

#[derive(Debug, Clone, PartialEq, Default)]
pub struct Past {
    /// In the order of the query.
    pub nodes: Vec<NodePast>,
    pub stage: Vec<Period<Stage>>,
    /// In the order of the query.
    pub signals: Vec<(String, Vec<Period<Option<bool>>>)>,
    /// Events other than transitions of nodes, the oldest first.
    pub events: Vec<(i64, PastEvent)>,
    /// There are more rows than were read.
    pub cut: bool,
}

#[derive(Debug, Clone, PartialEq)]
pub struct NodePast {
    pub name: String,
    /// In order. Between two stretches there may be a gap in which nothing was recorded.
    pub stretches: Vec<Stretch>,
}

/// A stage or signal with the span of time for which it held.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Period<T> {
    pub from_ms: i64,
    pub to_ms: i64,
    pub value: T,
}

#[derive(Debug, Clone, PartialEq)]
pub enum PastEvent {
    Started {
        anew: bool,
    },
    Stage(Stage),
    Signal {
        name: String,
        value: Option<bool>,
    },
    AlarmRaised {
        id: i64,
        node: String,
    },
    AlarmMoved {
        id: i64,
        symptom: String,
        cause: String,
    },
    AlarmAcknowledged {
        id: i64,
        node: String,
    },
    AlarmCleared {
        id: i64,
        node: String,
    },
    /// The node was created at run time and was silent for too long.
    Left {
        node: String,
    },
    Lost(i64),
}

pub fn past(connection: &Connection, query: &HistoryQuery) -> rusqlite::Result<Past> {
    let mut past = Past { nodes: Vec::with_capacity(query.nodes.len()), ..Past::default() };
    let starts = starts(connection, query)?;
    for name in &query.nodes {
        let rows = shown(connection, name, query, STRETCHES_MAX as i64)?;
        past.cut |= rows.len() >= STRETCHES_MAX;
        past.nodes.push(NodePast { name: name.clone(), stretches: stretches(rows, &starts, query) });
    }
    let rows = levels(connection, STAGE, None, query, STRETCHES_MAX as i64)?;
    past.cut |= rows.len() >= STRETCHES_MAX;
    past.stage = held(rows, &starts, query, |value| value.and_then(stage));
    for name in &query.signals {
        let rows = levels(connection, SIGNAL, Some(name), query, STRETCHES_MAX as i64)?;
        past.cut |= rows.len() >= STRETCHES_MAX;
        let held = held(rows, &starts, query, |value| Some(value.map(|value| value == 1)));
        past.signals.push((name.clone(), held));
    }
    past.events = events(connection, query)?;
    past.cut |= past.events.len() >= EVENTS_MAX;
    Ok(past)
}

/// What nodes reported by themselves in the whole history, and what else held then.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Reported {
    /// Of each node: IGNORE while it was not relevant, and its own state while it was masked.
    pub nodes: Vec<Vec<Period<State>>>,
    pub signals: Vec<Vec<Period<bool>>>,
    pub stages: Vec<Period<Stage>>,
}

/// Bounded by the rows of the history. `None` if `go_on` ends it.
pub(super) fn reported(
    connection: &Connection,
    (nodes, signals): (&[String], &[String]),
    go_on: &dyn Fn() -> bool,
) -> rusqlite::Result<Option<Reported>> {
    const COLUMNS: &str = "SELECT id, at_ms, state, own, other IS NOT NULL FROM records";
    // An empty history has nothing.
    let to_ms = alive_ms(connection)?.unwrap_or(0);
    let query = HistoryQuery { nodes: Vec::new(), signals: Vec::new(), from_ms: 0, to_ms };
    let starts = starts(connection, &query)?;
    let own = |row: &Row<'_>| {
        let (state, own, has_cause) = (state(row.get(2)?), state(row.get(3)?), row.get(4)?);
        let is_relevant = state != State::Ignore || has_cause;
        let what = if is_relevant { own } else { State::Ignore };
        Ok(Dated { id: row.get(0)?, at_ms: row.get(1)?, what })
    };
    let mut all = Reported { stages: stages(connection, &query)?, ..Reported::default() };
    for name in nodes {
        if !go_on() {
            return Ok(None);
        }
        let rows =
            lasting(dated(connection, (COLUMNS, OF_NODE), &[name], (&query, -1), own)?, &starts, &query);
        let period = |(from_ms, to_ms, value)| Period { from_ms, to_ms, value };
        all.nodes.push(rows.into_iter().map(period).collect());
    }
    for name in signals {
        let rows = levels(connection, SIGNAL, Some(name), &query, -1)?;
        all.signals.push(held(rows, &starts, &query, |value| value.map(|value| value == 1)));
    }
    Ok(Some(all))
}

/// The stages in their order. Between two there may be a gap in which nothing was recorded.
pub(super) fn stages(connection: &Connection, query: &HistoryQuery) -> rusqlite::Result<Vec<Period<Stage>>> {
    let starts = starts(connection, query)?;
    let rows = levels(connection, STAGE, None, query, -1)?;
    Ok(held(rows, &starts, query, |value| value.and_then(stage)))
}

/// How long the program ran, and which version of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Run {
    pub from_ms: i64,
    pub to_ms: i64,
    /// Empty if it did not say.
    pub version: String,
}

/// The runs of the program in a span of time that ends no later than the last sign of life.
pub(super) fn runs(connection: &Connection, query: &HistoryQuery) -> rusqlite::Result<Vec<Run>> {
    let starts = starts(connection, query)?;
    let ends = starts.iter().skip(1).map(|next| next.ended_ms).chain([query.to_ms]);
    let run = |(start, ended_ms): (&Start, i64)| Run {
        from_ms: start.at_ms.max(query.from_ms),
        to_ms: ended_ms.min(query.to_ms),
        version: start.version.clone(),
    };
    Ok(starts.iter().zip(ends).map(run).filter(|run| run.from_ms < run.to_ms).collect())
}

/// When the program that wrote last was surely alive.
pub(super) fn alive_ms(connection: &Connection) -> rusqlite::Result<Option<i64>> {
    connection.query_row("SELECT max(at_ms) FROM alive", [], |row| row.get(0))
}

/// The program started or took another configuration: earlier states end here.
struct Start {
    id: i64,
    at_ms: i64,
    /// When the earlier states ended.
    ended_ms: i64,
    version: String,
}

/// A state from a moment on.
struct Dated<T> {
    id: i64,
    at_ms: i64,
    what: T,
}

struct Shown {
    state: State,
    own: State,
    cause: Option<Arc<str>>,
    said: Option<Said>,
}

/// The last start before the span, all starts in it, and the next one, which tells when the run before it
/// ended.
fn starts(connection: &Connection, query: &HistoryQuery) -> rusqlite::Result<Vec<Start>> {
    let start = |row: &Row<'_>| {
        let (id, at_ms): (i64, i64) = (row.get(0)?, row.get(1)?);
        let alive: Option<i64> = row.get(2)?;
        let version = row.get::<_, Option<String>>(3)?.unwrap_or_default();
        Ok(Start { id, at_ms, ended_ms: alive.unwrap_or(at_ms).min(at_ms), version })
    };
    let mut before = connection.prepare_cached(
        "SELECT id, at_ms, number, said FROM records WHERE kind = ? AND kind <> 1 AND at_ms <= ?
            ORDER BY at_ms DESC, id DESC LIMIT 1",
    )?;
    let mut starts: Vec<Start> =
        before.query_row([STARTED, query.from_ms], start).optional()?.into_iter().collect();
    let mut within = connection.prepare_cached(
        "SELECT id, at_ms, number, said FROM records WHERE kind = ? AND kind <> 1 AND at_ms > ? AND at_ms <= ? ORDER BY id",
    )?;
    for found in within.query_map([STARTED, query.from_ms, query.to_ms], start)? {
        starts.push(found?);
    }
    let mut after = connection.prepare_cached(
        "SELECT id, at_ms, number, said FROM records WHERE kind = ? AND kind <> 1 AND at_ms > ?
            ORDER BY at_ms, id LIMIT 1",
    )?;
    starts.extend(after.query_row([STARTED, query.to_ms], start).optional()?);
    Ok(starts)
}

/// The state of a node when the span began, and its transitions in it.
fn shown(
    connection: &Connection,
    name: &str,
    query: &HistoryQuery,
    limit: i64,
) -> rusqlite::Result<Vec<Dated<Shown>>> {
    const COLUMNS: &str = "SELECT records.id, at_ms, state, own, cause.name, said, silent_ms FROM records
        LEFT JOIN nodes AS cause ON cause.id = other";
    let shown = |row: &Row<'_>| {
        let (message, silent_ms): (Option<String>, Option<i64>) = (row.get(5)?, row.get(6)?);
        let what = Shown {
            state: state(row.get(2)?),
            own: state(row.get(3)?),
            cause: row.get::<_, Option<String>>(4)?.map(Arc::from),
            said: Said::of(&message.unwrap_or_default(), silent_ms.and_then(silence)),
        };
        Ok(Dated { id: row.get(0)?, at_ms: row.get(1)?, what })
    };
    dated(connection, (COLUMNS, OF_NODE), &[&name], (query, limit), shown)
}

/// The stage or a signal when the span began, and its changes in it.
fn levels(
    connection: &Connection,
    kind: i64,
    name: Option<&str>,
    query: &HistoryQuery,
    limit: i64,
) -> rusqlite::Result<Vec<Dated<Option<i64>>>> {
    // A stage has no name, so its row refers to no node.
    const OF_LEVEL: &str = "kind <> 1 AND kind = ? AND node IS (SELECT id FROM nodes WHERE name = ?)";
    let level = |row: &Row<'_>| {
        Ok(Dated { id: row.get(0)?, at_ms: row.get(1)?, what: row.get::<_, Option<i64>>(2)? })
    };
    dated(
        connection,
        ("SELECT id, at_ms, state FROM records", OF_LEVEL),
        &[&kind, &name],
        (query, limit),
        level,
    )
}

/// The rows of a node.
const OF_NODE: &str = "kind = 1 AND node = (SELECT id FROM nodes WHERE name = ?)";

/// The row that held when the span began, and the rows in it, by a condition on these values.
///
/// After the wall clock was set back the same times come again, and the last row that was written of a time counts.
fn dated<T>(
    connection: &Connection,
    (columns, condition): (&str, &str),
    values: &[&dyn ToSql],
    (query, limit): (&HistoryQuery, i64),
    read: impl Fn(&Row<'_>) -> rusqlite::Result<Dated<T>>,
) -> rusqlite::Result<Vec<Dated<T>>> {
    let before = format!(
        "{columns} WHERE records.id = (SELECT max(id) FROM records WHERE {condition} AND at_ms <= ?)"
    );
    let values_before = [values, &[&query.from_ms]].concat();
    let before = connection.prepare_cached(&before)?.query_row(&*values_before, &read).optional()?;
    let within = format!(
        "{columns} WHERE {condition} AND at_ms > ? AND at_ms <= ? ORDER BY at_ms, records.id LIMIT ?"
    );
    let values_within = [values, &[&query.from_ms, &query.to_ms, &limit]].concat();
    let mut within = connection.prepare_cached(&within)?;
    let within = within.query_map(&*values_within, &read)?;
    let rows: rusqlite::Result<Vec<Dated<T>>> = before.map(Ok).into_iter().chain(within).collect();
    let mut last_id = 0;
    let mut is_last = |row: &Dated<T>| {
        let is_last = row.id > last_id;
        last_id = last_id.max(row.id);
        is_last
    };
    Ok(rows?.into_iter().filter(|row| is_last(row)).collect())
}

/// The span in which each row holds: to the next row, to the end of its run, or to the end of the query.
fn lasting<T>(rows: Vec<Dated<T>>, starts: &[Start], query: &HistoryQuery) -> Vec<(i64, i64, T)> {
    let nexts: Vec<i64> = rows.iter().skip(1).map(|row| row.at_ms).chain([query.to_ms]).collect();
    let lasts = rows.into_iter().zip(nexts).map(|(row, next_ms)| {
        let cut_ms = starts.iter().find(|start| start.id > row.id).map_or(i64::MAX, |start| start.ended_ms);
        (row.at_ms.max(query.from_ms), next_ms.min(cut_ms).min(query.to_ms), row.what)
    });
    lasts.filter(|(from_ms, to_ms, _)| from_ms < to_ms).collect()
}

fn stretches(rows: Vec<Dated<Shown>>, starts: &[Start], query: &HistoryQuery) -> Vec<Stretch> {
    let stretch = |(from_ms, to_ms, shown)| {
        let Shown { state, own, cause, said } = shown;
        Stretch { from_ms, to_ms, state, own, cause, said }
    };
    lasting(rows, starts, query).into_iter().map(stretch).collect()
}

fn held<T>(
    rows: Vec<Dated<Option<i64>>>,
    starts: &[Start],
    query: &HistoryQuery,
    value: impl Fn(Option<i64>) -> Option<T>,
) -> Vec<Period<T>> {
    let held = |(from_ms, to_ms, level)| Some(Period { from_ms, to_ms, value: value(level)? });
    lasting(rows, starts, query).into_iter().filter_map(held).collect()
}

fn events(connection: &Connection, query: &HistoryQuery) -> rusqlite::Result<Vec<(i64, PastEvent)>> {
    let mut statement = connection.prepare_cached(
        "SELECT at_ms, kind, node.name, state, other.name, number FROM records
            LEFT JOIN nodes AS node ON node.id = node LEFT JOIN nodes AS other ON other.id = other
            WHERE kind <> 1 AND at_ms >= ? AND at_ms <= ? ORDER BY at_ms DESC, records.id DESC LIMIT ?",
    )?;
    let rows = statement.query_map(params![query.from_ms, query.to_ms, EVENTS_MAX as i64], |row| {
        let name = |column: usize| row.get::<_, Option<String>>(column).map(Option::unwrap_or_default);
        let flag: Option<i64> = row.get(3)?;
        let number = row.get::<_, Option<i64>>(5)?.unwrap_or_default();
        let what = match row.get::<_, i64>(1)? {
            STARTED => Some(PastEvent::Started { anew: flag == Some(1) }),
            STAGE => flag.and_then(stage).map(PastEvent::Stage),
            SIGNAL => Some(PastEvent::Signal { name: name(2)?, value: flag.map(|flag| flag == 1) }),
            RAISED => Some(PastEvent::AlarmRaised { id: number, node: name(2)? }),
            MOVED => Some(PastEvent::AlarmMoved { id: number, symptom: name(2)?, cause: name(4)? }),
            ACKNOWLEDGED => Some(PastEvent::AlarmAcknowledged { id: number, node: name(2)? }),
            CLEARED => Some(PastEvent::AlarmCleared { id: number, node: name(2)? }),
            LEFT => Some(PastEvent::Left { node: name(2)? }),
            LOST => Some(PastEvent::Lost(number)),
            // Written by a newer program.
            _ => None,
        };
        Ok(what.map(|what| (row.get_unwrap(0), what)))
    })?;
    let mut events = rows.filter_map(Result::transpose).collect::<rusqlite::Result<Vec<_>>>()?;
    events.reverse();
    Ok(events)
}

/// A value that Telltale never writes is unknown.
pub(super) fn state(number: i64) -> State {
    State::ALL.into_iter().find(|state| *state as i64 == number).unwrap_or(State::Unknown)
}

pub(super) fn silence(ms: i64) -> Option<Span> {
    u64::try_from(ms).ok().map(Span::from_millis)
}

pub(super) fn stage(number: i64) -> Option<Stage> {
    Stage::ALL.into_iter().find(|stage| *stage as i64 == number)
}
