//! The API of one vehicle's history, and its states at a moment of the past.

use axum::extract::Path;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use telltale_clock::unix_ms;
use telltale_fleet::message::VehicleId;
use telltale_web::common::{Asked, Format, Moment, Table, json_answer};
use telltale_web::describe::words;
use telltale_web::texts::HttpError;

use super::view::View;
use crate::history::{self, Known, Part};
use crate::past::Past;
use crate::state::time;

/// Without a time to begin with: so far back.
const UNASKED_MS: i64 = 3_600_000;

#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HistoryAsked {
    /// Only messages of this time or later.
    from: Option<Moment>,
    /// Only messages of this time or earlier.
    to: Option<Moment>,
    pub format: Option<Format>,
}

impl HistoryAsked {
    /// From when to when.
    pub fn span(&self, wall_ms: i64) -> (i64, i64) {
        let to = self.to.map_or(i64::MAX, |Moment(ms)| ms);
        (self.from.map_or(wall_ms.min(to).saturating_sub(UNASKED_MS), |Moment(ms)| ms), to)
    }
}

/// The columns of a CSV. A row without a kind stands for missing messages, and the last row is a `cut` if there are more.
const COLUMNS: [&str; 15] = [
    "epoch",
    "n",
    "at",
    "kind",
    "stage",
    "number",
    "node",
    "words",
    "active",
    "acknowledged",
    "incident",
    "causes",
    "to",
    "why",
    "nodes",
];

/// What a vehicle told.
#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "VehicleHistory")]
pub struct HistoryAnswer {
    vehicle: String,
    #[schemars(schema_with = "words::time")]
    from: String,
    /// Each has `epoch`, `n`, `at`, `kind`, and what its kind has; kinds that you do not know are to be passed over.
    messages: Vec<Map<String, Value>>,
    /// The gaps in between: `epoch`, the first missing number `n`, the last one `to`, and `why`, if the vehicle says it.
    unknown: Vec<Map<String, Value>>,
    /// Messages that were told again with other content.
    contradictions: usize,
    /// Batches that cannot be read.
    refused: usize,
    /// Nothing is left out. If not, ask again from the time of the last message.
    whole: bool,
}

/// `GET /api/v1/vehicles/ID/history?from&to&format`: messages in their order, by the vehicle's clock.
pub async fn get(
    view: View,
    Path(id): Path<String>,
    Asked(asked): Asked<HistoryAsked>,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let id = VehicleId::new(&id).ok_or(HttpError::NotFound)?;
    let (from, to) = asked.span(unix_ms(view.console.clock.wall()));
    let known = view.history(&id, from, to).await?;
    let told = known.told(from, to);
    let format = Format::of(asked.format, &headers);
    if format == Format::Csv {
        let row = |part: &Part<'_>| match part {
            Part::Message(message) => history::message(message),
            Part::Missing(it) => history::missing(it),
        };
        let mut rows: Vec<Value> = told.parts.iter().map(row).collect();
        if !told.is_whole {
            rows.push(json!({ "kind": "cut" }));
        }
        let table = Table { name: "history", columns: &COLUMNS, rows: &rows, next: None };
        return Ok(table.answer(format, &rows));
    }
    let (mut messages, mut missing) = (Vec::new(), Vec::new());
    for part in &told.parts {
        match part {
            Part::Message(message) => messages.extend(history::message(message).as_object().cloned()),
            Part::Missing(it) => missing.extend(history::missing(it).as_object().cloned()),
        }
    }
    let answer = HistoryAnswer {
        vehicle: id.to_string(),
        from: time(from),
        messages,
        unknown: missing,
        contradictions: known.contradictions,
        refused: known.refused,
        whole: told.is_whole,
    };
    Ok(json_answer(StatusCode::OK, &json!(answer)))
}

/// A keyframe is at most so old, as a rule.
const NEAR_MS: i64 = 20 * 60_000;

/// A vehicle's clock may be ahead of the console's by so much without a word.
const AHEAD_MS: i64 = 5000;

/// What a vehicle showed at a moment by its own clock, and its log of so many milliseconds before and after.
///
/// # Errors
/// There is no such vehicle, the moment is still to come, or the hub does not answer.
pub async fn past(
    view: &View,
    id: &VehicleId,
    at_ms: i64,
    around_ms: i64,
) -> Result<(Past, Known), HttpError> {
    let last_told = {
        let (wall_ms, now) = (unix_ms(view.console.clock.wall()), view.console.clock.now());
        let fleet = view.fleet();
        let vehicle = fleet.vehicle(id)?;
        let ahead_ms = vehicle.skew_ms().unwrap_or(0).max(AHEAD_MS);
        if at_ms > wall_ms.saturating_add(ahead_ms) {
            return Err(HttpError::Future);
        }
        vehicle.last_told(wall_ms, now)
    };
    let [from, to] = [at_ms.saturating_sub(around_ms), at_ms.saturating_add(around_ms)];
    let around = view.history(id, from, to).await?;
    let past = if around.is_whole {
        Past::of(&around, at_ms, last_told)
    } else {
        // It may have ended before the moment.
        let near = view.history(id, at_ms.saturating_sub(NEAR_MS), at_ms).await?;
        Past::of(&near, at_ms, last_told.filter(|_| near.is_whole))
    };
    Ok((past, around))
}
