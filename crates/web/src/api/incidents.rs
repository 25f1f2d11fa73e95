//! Incidents for programs: the list, and everything that is known of one.

use axum::Json;
use axum::extract::{Path, State};
use axum::http::HeaderMap;
use axum::response::{IntoResponse, Response};
use schemars::JsonSchema;
use serde::Deserialize;

use super::query::{Asked, Count, Moment};
use super::table::{Format, Table};
use crate::AppState;
use crate::incidents::{Listed, Read, Whole, failed, find, story};
use crate::texts::HttpError;
use telltale_store::{INCIDENTS_PAGE_MAX, IncidentFilter};

/// Incidents in one answer, unless `count` asks for another number.
const COUNT: u32 = 50;

#[derive(Debug, Deserialize, JsonSchema)]
pub struct ListQuery {
    /// Part of the name of a cause.
    #[serde(default)]
    cause: String,
    /// The path of a group that a cause is in.
    #[serde(default)]
    group: String,
    /// At the first trigger.
    #[serde(default)]
    stage: String,
    marked: Option<bool>,
    kept: Option<bool>,
    /// Only those that began at this time or later.
    since: Option<Moment>,
    /// Only those that began at this time or earlier.
    until: Option<Moment>,
    /// Only those with a smaller number.
    before: Option<u64>,
    /// The largest number of incidents to return.
    #[serde(default)]
    count: Count<COUNT, INCIDENTS_PAGE_MAX>,
    format: Option<Format>,
}

/// The columns of the list as CSV.
const COLUMNS: [&str; 13] = [
    "id",
    "since",
    "until",
    "roots",
    "kinds",
    "trigger_count",
    "stage",
    "marked",
    "marks",
    "kept",
    "storm",
    "note",
    "recording",
];

impl ListQuery {
    fn filter(self) -> IncidentFilter {
        IncidentFilter {
            cause: self.cause,
            group: self.group,
            stage: self.stage,
            marked: self.marked,
            kept: self.kept,
            since_ms: self.since.map(|Moment(ms)| ms),
            until_ms: self.until.map(|Moment(ms)| ms),
            before: self.before,
            count: self.count.0,
            ..IncidentFilter::default()
        }
    }
}

/// `GET /api/v1/incidents`: the newest first, filtered, in pages.
pub async fn list(
    State(app): State<AppState>,
    headers: HeaderMap,
    Asked(query): Asked<ListQuery>,
) -> Result<Response, HttpError> {
    let format = Format::of(query.format, &headers);
    let filter = query.filter();
    let count = filter.count as usize;
    let found = app.store.incidents(filter).await.map_err(failed)?;
    let rows: Vec<Listed<'_>> = found.iter().map(Listed::of).collect();
    let next = found.last().filter(|_| found.len() == count).map(|last| last.summary.id);
    Ok(Table { name: "incidents", columns: &COLUMNS, rows: &rows, next }.answer(format, &rows))
}

/// `GET /api/v1/incidents/{id}`: everything that is known of it.
pub async fn one(State(app): State<AppState>, Path(id): Path<String>) -> Result<Response, HttpError> {
    let incident = find(&app, &id).await?;
    let (read, proof) = story(&app, &incident.summary).await;
    let story = match read {
        Read::Told(story) => Some(story),
        Read::Missing | Read::Bad(_) | Read::Busy => None,
    };
    Ok(Json(Whole::of(&incident, Some((story.as_deref(), &proof)))).into_response())
}
