//! The numbers that a module reported in the last minutes, as they are drawn on the page of a node.

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
use crate::incidents::{wall_ms, wall_time};
use crate::schema::words;
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
    #[schemars(schema_with = "words::time")]
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
) -> Result<Response, HttpError> {
    let published = app.published();
    let snapshot = &published.snapshot;
    if published.is_locked() {
        return Err(HttpError::Locked);
    }
    let Some(NodeId::Module(id)) = snapshot.node(&asked.node) else {
        return Err(HttpError::NotFound);
    };
    let (times, series) = app.trends.numbers(id.0 as usize, &snapshot.module(id).0.id);
    let mut rows = Vec::new();
    for (index, at) in times.iter().enumerate() {
        let at = wall_time(wall_ms(wall_at(published.at, snapshot.now, *at)));
        let then = series.iter().filter_map(|(key, numbers)| Some((key, numbers.get(index).copied()??)));
        rows.extend(then.map(|(key, value)| ValueRow { at: at.clone(), key, value }));
    }
    let table = Table { name: "values", columns: &COLUMNS, rows: &rows, next: None };
    Ok(table.answer(Format::of(asked.format, &headers), &ValuesAnswer { values: &rows }))
}
