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
    /// What the node showed when the alarm came to it.
    pub state: State,
    pub raised_ms: i64,
    pub acknowledged_ms: Option<i64>,
    pub cleared_ms: Option<i64>,
}

/// The last `count` alarms, the newest first.
pub fn last_alarms(connection: &Connection, count: u32) -> rusqlite::Result<Vec<PastAlarm>> {
    let mut raised = connection.prepare_cached(
        "SELECT number, at_ms, nodes.name FROM records JOIN nodes ON nodes.id = node
            WHERE kind <> 1 AND kind = ? AND number IS NOT NULL ORDER BY at_ms DESC, records.id DESC LIMIT ?",
    )?;
    let raised = raised.query_map(params![RAISED, count], |row| {
        let (id, raised_ms, node) = (row.get(0)?, row.get(1)?, row.get(2)?);
        let state = State::Unknown;
        Ok(PastAlarm { id, node, state, raised_ms, acknowledged_ms: None, cleared_ms: None })
    })?;
    let mut alarms = raised.collect::<rusqlite::Result<Vec<_>>>()?;
    let mut later = connection.prepare_cached(
        "SELECT kind, at_ms, other.name FROM records LEFT JOIN nodes AS other ON other.id = other
            WHERE kind <> 1 AND kind IN (?, ?, ?) AND at_ms >= ? AND number = ? ORDER BY at_ms, records.id",
    )?;
    let mut shown = connection.prepare_cached(
        "SELECT state FROM records WHERE kind = 1 AND node = (SELECT id FROM nodes WHERE name = ?) AND at_ms <= ?
            ORDER BY at_ms DESC, id DESC LIMIT 1",
    )?;
    for alarm in &mut alarms {
        let mut came_ms = alarm.raised_ms;
        let mut rows = later.query(params![MOVED, ACKNOWLEDGED, CLEARED, alarm.raised_ms, alarm.id])?;
        while let Some(row) = rows.next()? {
            let at_ms = row.get(1)?;
            match row.get::<_, i64>(0)? {
                ACKNOWLEDGED => alarm.acknowledged_ms = Some(at_ms),
                CLEARED => alarm.cleared_ms = Some(at_ms),
                _ => {
                    came_ms = at_ms;
                    alarm.node = row.get::<_, Option<String>>(2)?.unwrap_or_else(|| alarm.node.clone());
                }
            }
        }
        let state = shown.query_row(params![alarm.node, came_ms], |row| row.get(0)).optional()?;
        alarm.state = state.map_or(State::Unknown, read::state);
    }
    Ok(alarms)
}
