//! The records of the history one by one, in pages.

use rusqlite::{Connection, Row, params};

use super::read::{silence, stage, state};
use super::write::{ACKNOWLEDGED, CLEARED, LEFT, LOST, MOVED, RAISED, SHOWN, SIGNAL, STAGE, STARTED};
use telltale_engine::event::Said;
use telltale_engine::state::State;

/// A query: milliseconds since 1970, both ends included.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LineQuery {
    /// Only what is about this node or signal, or a node in it.
    pub node: Option<String>,
    pub kind: Option<LineKind>,
    pub from_ms: i64,
    pub to_ms: i64,
    /// Only records with a greater id.
    pub after: i64,
    pub count: u32,
}

telltale_engine::words! {
    /// The content of a record.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum LineKind {
        /// A node shows another state, or for another reason.
        State = "state",
        /// The program started or took another configuration: earlier states end here.
        Started = "started",
        Stage = "stage",
        Signal = "signal",
        AlarmRaised = "alarm_raised",
        /// The alarm of a symptom belongs to its cause now.
        AlarmMoved = "alarm_moved",
        AlarmAcknowledged = "alarm_acknowledged",
        AlarmCleared = "alarm_cleared",
        /// A node was silent for too long and is forgotten.
        Left = "left",
        /// Records are missing here.
        Lost = "lost",
    }
}

/// A record of the history; what a kind does not have is `None`.
#[derive(Debug, Clone, PartialEq)]
pub struct HistoryLine {
    pub id: i64,
    pub at_ms: i64,
    pub kind: LineKind,
    /// The node, or the name of a signal.
    pub node: Option<String>,
    pub state: Option<State>,
    pub own: Option<State>,
    /// The root cause that masks the node, or to which an alarm moved.
    pub cause: Option<String>,
    pub said: Option<Said>,
    pub alarm: Option<i64>,
    /// The stage, `true` or `false` of a signal, how the program started, how many records are missing.
    pub value: Option<String>,
}

impl LineKind {
    const fn number(self) -> i64 {
        match self {
            LineKind::State => SHOWN,
            LineKind::Started => STARTED,
            LineKind::Stage => STAGE,
            LineKind::Signal => SIGNAL,
            LineKind::AlarmRaised => RAISED,
            LineKind::AlarmMoved => MOVED,
            LineKind::AlarmAcknowledged => ACKNOWLEDGED,
            LineKind::AlarmCleared => CLEARED,
            LineKind::Left => LEFT,
            LineKind::Lost => LOST,
        }
    }
}

/// In the order in which they were recorded. Records of a newer program are left out.
pub fn lines(connection: &Connection, query: &LineQuery) -> rusqlite::Result<Vec<HistoryLine>> {
    let mut statement = connection.prepare_cached(&format!(
        "SELECT records.id, at_ms, kind, node.name, state, own, other.name, number, said, silent_ms FROM records
            LEFT JOIN nodes AS node ON node.id = node LEFT JOIN nodes AS other ON other.id = other
            WHERE records.id > ?1 AND at_ms >= ?2 AND at_ms <= ?3 AND kind <= {LEFT}
            AND (?4 IS NULL OR records.node IN
                (SELECT id FROM nodes WHERE name = ?4 OR substr(name, 1, length(?4) + 1) = ?4 || '/'))
            AND (?5 IS NULL OR kind = ?5)
            ORDER BY records.id LIMIT ?6"
    ))?;
    let LineQuery { node, kind, from_ms, to_ms, after, count } = query;
    let kind = kind.map(LineKind::number);
    let rows = statement.query_map(params![after, from_ms, to_ms, node, kind, count], line)?;
    rows.filter_map(Result::transpose).collect()
}

fn line(row: &Row<'_>) -> rusqlite::Result<Option<HistoryLine>> {
    let number: i64 = row.get(2)?;
    let Some(kind) = LineKind::ALL.into_iter().find(|kind| kind.number() == number) else { return Ok(None) };
    let (shown, number): (Option<i64>, Option<i64>) = (row.get(4)?, row.get(7)?);
    let is_state = kind == LineKind::State;
    let message: Option<String> = row.get(8)?;
    let silent_ms: Option<i64> = row.get(9)?;
    Ok(Some(HistoryLine {
        id: row.get(0)?,
        at_ms: row.get(1)?,
        kind,
        node: row.get(3)?,
        state: shown.filter(|_| is_state).map(state),
        own: row.get::<_, Option<i64>>(5)?.filter(|_| is_state).map(state),
        cause: row.get(6)?,
        said: Said::of(&message.unwrap_or_default(), silent_ms.and_then(silence)),
        alarm: number.filter(|_| matches!(kind.as_str().split_once('_'), Some(("alarm", _)))),
        value: match kind {
            LineKind::Stage => shown.and_then(stage).map(|it| it.as_str().to_owned()),
            LineKind::Signal => shown.map(|it| (it == 1).to_string()),
            LineKind::Started => Some(if shown == Some(1) { "reloaded" } else { "started" }.to_owned()),
            LineKind::Lost => number.map(|it| it.to_string()),
            _ => None,
        },
    }))
}
