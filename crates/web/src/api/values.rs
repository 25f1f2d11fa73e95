//! The numbers that a module reported in the last minutes, as they are drawn on the page of a node.

use std::time::SystemTime;

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use telltale_clock::wall_at;
use telltale_engine::model::NodeId;

use super::query::Asked;
use super::table::{Format, Table};
use crate::AppState;
use crate::http::respond::{Reader, refusal};
use crate::texts::HttpError;

#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ValuesAsked {
    /// The module, as `sensors/lidar_front`.
    node: String,
    format: Option<Format>,
}

/// The numbers of a module, the oldest first.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ValuesAnswer<'a> {
    values: &'a [ValueRow<'a>],
}

/// The value at an instant; there is no row where there was none.
#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "Value")]
pub struct ValueRow<'a> {
    at: String,
    key: &'a str,
    value: f64,
}

const COLUMNS: [&str; 3] = ["at", "key", "value"];

/// `GET /api/v1/values`
pub async fn get(
    State(app): State<AppState>,
    Asked(asked): Asked<ValuesAsked>,
    headers: HeaderMap,
    reader: Reader,
) -> Response {
    let published = app.published();
    let snapshot = &published.snapshot;
    if published.is_locked() {
        return refusal(&reader, HttpError::Locked);
    }
    let Some(NodeId::Module(id)) = snapshot.node(&asked.node) else {
        return refusal(&reader, HttpError::NotFound);
    };
    let (times, series) = app.trends.numbers(id.0 as usize, &snapshot.module(id).0.id);
    let wall = |at| -> SystemTime { wall_at(published.at, snapshot.now, at) };
    let mut rows = Vec::new();
    for (index, at) in times.iter().enumerate() {
        let at = humantime::format_rfc3339_millis(wall(*at)).to_string();
        let then = series.iter().filter_map(|(key, numbers)| Some((key, numbers.get(index).copied()??)));
        rows.extend(then.map(|(key, value)| ValueRow { at: at.clone(), key, value }));
    }
    let table = Table { name: "values", columns: &COLUMNS, rows: &rows, next: None };
    table.answer(Format::of(asked.format, &headers), &ValuesAnswer { values: &rows })
}
