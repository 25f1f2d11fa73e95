//! The history: every transition between two instants.

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Deserializer, Serialize};

use super::query::{Asked, Count, Moment};
use super::table::{Format, Table};
use crate::AppState;
use crate::incidents::wall_time;
use crate::schema::words;
use crate::texts::HttpError;
use telltale_engine::time::Span;
use telltale_store::{HistoryLine, LineKind, LineQuery};

/// Names of nodes are not longer.
const NODE_BYTES_MAX: usize = 8192;

#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HistoryAsked {
    /// A node or a signal; a group with all that is in it.
    node: Option<String>,
    #[serde(default, deserialize_with = "kind")]
    #[schemars(schema_with = "kinds")]
    kind: Option<LineKind>,
    /// The first instant.
    since: Option<Moment>,
    /// The last instant.
    until: Option<Moment>,
    /// Only records with a greater id: `next` of the page before.
    #[serde(default)]
    after: u64,
    /// The largest number of records to return.
    #[serde(default)]
    count: Count<1000, 10_000>,
    format: Option<Format>,
}

fn kind<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<LineKind>, D::Error> {
    let word = String::deserialize(deserializer)?;
    let words = || LineKind::ALL.map(LineKind::as_str).join(", ");
    let unknown = || serde::de::Error::custom(format_args!("kind is one of {}", words()));
    LineKind::from_word(&word).map(Some).ok_or_else(unknown)
}

fn kinds(_: &mut SchemaGenerator) -> Schema {
    words::of(LineKind::ALL.map(LineKind::as_str))
}

/// Records in the order in which they were made. What a kind does not have is `null`.
#[derive(Debug, Serialize, JsonSchema)]
pub struct HistoryAnswer<'a> {
    records: &'a [HistoryRow<'a>],
    /// For `after` of the next page; `null` on the last one.
    next: Option<u64>,
}

/// A record. `state`: a node shows another state, or for another reason. `started`: the program started or took
/// another configuration; earlier states end here, and a record of each node follows. `left`: a node was silent for
/// too long and is forgotten. `lost`: records are missing here.
#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "HistoryRecord")]
pub struct HistoryRow<'a> {
    id: i64,
    #[schemars(schema_with = "words::time")]
    at: String,
    #[schemars(schema_with = "kinds")]
    kind: &'static str,
    /// The node, or the name of a signal.
    node: Option<&'a str>,
    #[schemars(schema_with = "words::some_state")]
    state: Option<&'static str>,
    #[schemars(schema_with = "words::some_state")]
    own: Option<&'static str>,
    /// The root cause that masks the node, or to which an alarm moved.
    cause: Option<&'a str>,
    /// The first 200 bytes, in English; of `started` the version of Telltale.
    message: Option<&'a str>,
    silent_s: Option<f64>,
    /// The number of an alarm.
    alarm: Option<i64>,
    /// The stage; `true`, `false` or `null` of a signal; `started` or `reloaded`; how many records are missing.
    value: Option<&'a str>,
}

const COLUMNS: [&str; 11] =
    ["id", "at", "kind", "node", "state", "own", "cause", "message", "silent_s", "alarm", "value"];

/// `GET /api/v1/history`
pub async fn get(
    State(app): State<AppState>,
    Asked(asked): Asked<HistoryAsked>,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    if asked.node.as_ref().is_some_and(|node| node.len() > NODE_BYTES_MAX) {
        return Err(HttpError::NotFound);
    }
    let query = LineQuery {
        node: asked.node.filter(|node| !node.is_empty()),
        kind: asked.kind,
        from_ms: asked.since.map_or(i64::MIN, |Moment(ms)| ms),
        to_ms: asked.until.map_or(i64::MAX, |Moment(ms)| ms),
        after: i64::try_from(asked.after).unwrap_or(i64::MAX),
        count: asked.count.0,
    };
    let lines = app.past(&app.published(), |history| history.lines(query)).await?;
    let rows: Vec<HistoryRow<'_>> = lines.iter().map(row).collect();
    let is_full = rows.len() == asked.count.0 as usize;
    let next = rows.last().filter(|_| is_full).and_then(|last| u64::try_from(last.id).ok());
    let table = Table { name: "history", columns: &COLUMNS, rows: &rows, next };
    Ok(table.answer(Format::of(asked.format, &headers), &HistoryAnswer { records: &rows, next }))
}

fn row(line: &HistoryLine) -> HistoryRow<'_> {
    let said = line.said.as_ref();
    HistoryRow {
        id: line.id,
        at: wall_time(line.at_ms),
        kind: line.kind.as_str(),
        node: line.node.as_deref(),
        state: line.state.map(|it| it.as_str()),
        own: line.own.map(|it| it.as_str()),
        cause: line.cause.as_deref(),
        message: said.map(|said| &*said.message),
        silent_s: said.and_then(|said| said.silent).map(|silent: Span| silent.as_millis() as f64 / 1000.0),
        alarm: line.alarm,
        value: line.value.as_deref(),
    }
}
