//! The last alarms, each with what became of it.

use rusqlite::{Connection, OptionalExtension as _, params};

use super::read;
use super::write::{ACKNOWLEDGED, CLEARED, MOVED, RAISED};
use telltale_engine::state::State;

/// An alarm. Times are milliseconds since 1970.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PastAlarm {
    pub id: i64,
    /// The node to which it belonged at last.
    pub node: String,
    /// The state of the node when the alarm came to it.
    pub state: State,
    pub raised_ms: i64,
    pub acknowledged_ms: Option<i64>,
    pub cleared_ms: Option<i64>,
}

/// The last `count` alarms, the newest first, in the order in which they were written: a wall clock may step back.
pub fn last_alarms(connection: &Connection, count: u32) -> rusqlite::Result<Vec<PastAlarm>> {
    let mut raised =
        connection.prepare_cached("SELECT id FROM records WHERE kind = ? ORDER BY id DESC LIMIT ?")?;
    let ids = raised.query_map(params![RAISED, count], |row| row.get(0))?;
    let Some(oldest) = ids.collect::<rusqlite::Result<Vec<i64>>>()?.pop() else { return Ok(Vec::new()) };
    let mut rows = connection.prepare_cached(
        "SELECT kind, at_ms, number, node.name, other.name, records.id FROM records
            LEFT JOIN nodes AS node ON node.id = node LEFT JOIN nodes AS other ON other.id = other
            WHERE records.id >= ? AND kind IN (?, ?, ?, ?) AND number IS NOT NULL ORDER BY records.id",
    )?;
    let mut rows = rows.query(params![oldest, RAISED, MOVED, ACKNOWLEDGED, CLEARED])?;
    // Each with the record with which it came to its node.
    let mut alarms: Vec<(PastAlarm, i64)> = Vec::new();
    while let Some(row) = rows.next()? {
        let (kind, at_ms, number): (i64, i64, i64) = (row.get(0)?, row.get(1)?, row.get(2)?);
        let name = |column| row.get::<_, Option<String>>(column).map(Option::unwrap_or_default);
        if kind == RAISED {
            let (node, state) = (name(3)?, State::Unknown);
            let alarm = PastAlarm {
                id: number,
                node,
                state,
                raised_ms: at_ms,
                acknowledged_ms: None,
                cleared_ms: None,
            };
            alarms.push((alarm, row.get(5)?));
            continue;
        }
        let Some((alarm, came)) = alarms.iter_mut().rev().find(|(alarm, _)| alarm.id == number) else {
            continue;
        };
        match kind {
            ACKNOWLEDGED => alarm.acknowledged_ms = Some(at_ms),
            CLEARED => alarm.cleared_ms = Some(at_ms),
            _ => (alarm.node, *came) = (name(4)?, row.get(5)?),
        }
    }
    let mut shown = connection.prepare_cached(
        "SELECT state FROM records WHERE kind = 1 AND node = (SELECT id FROM nodes WHERE name = ?) AND id <= ?
            ORDER BY id DESC LIMIT 1",
    )?;
    for (alarm, came) in &mut alarms {
        let state = shown.query_row(params![alarm.node, *came], |row| row.get(0)).optional()?;
        alarm.state = state.map_or(State::Unknown, read::state);
    }
    Ok(alarms.into_iter().rev().map(|(alarm, _)| alarm).collect())
}
