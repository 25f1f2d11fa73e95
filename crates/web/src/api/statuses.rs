//! The modules as a table: those of the page of statuses, each as in a snapshot.

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::query::{Asked, Count};
use super::table::{Format, Table};
use crate::AppState;
use crate::developer::statuses::StatusFilter;
use crate::live::frame::{ModuleSchema, modules};
use crate::texts::{HttpError, Lang};
use crate::view::View;

#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StatusesAsked {
    /// Part of a name, a message, a value or a hardware id.
    #[serde(default)]
    q: String,
    /// `ok`, `warning`, `error`, `ignore`, `unknown`; `abnormal` for error, warning and unknown.
    level: Option<Level>,
    /// The path of a group; with the groups in it.
    #[serde(default)]
    group: String,
    /// How many modules to skip: `next` of the page before.
    #[serde(default)]
    offset: u32,
    /// The largest number of modules to return.
    #[serde(default)]
    count: Count<1000, 5000>,
    format: Option<Format>,
}

#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[schemars(inline)]
enum Level {
    Ok,
    Warning,
    Error,
    Ignore,
    Unknown,
    Abnormal,
}

impl Level {
    const fn as_str(self) -> &'static str {
        match self {
            Level::Ok => "ok",
            Level::Warning => "warning",
            Level::Error => "error",
            Level::Ignore => "ignore",
            Level::Unknown => "unknown",
            Level::Abnormal => "abnormal",
        }
    }
}

/// Modules in the order of their groups.
#[derive(Debug, Serialize, JsonSchema)]
pub struct StatusesAnswer<'a> {
    seq: u64,
    #[schemars(with = "Vec<ModuleSchema<'_>>")]
    modules: &'a [Value],
    /// The parts that are left out because there would be too much: `values`, `words` or `modules`.
    left_out: Option<&'static str>,
    /// For `offset` of the next page; `null` on the last one.
    next: Option<u64>,
}

const COLUMNS: [&str; 13] = [
    "id",
    "state",
    "own",
    "since",
    "age_ms",
    "silent_s",
    "message",
    "hardware_id",
    "reason",
    "class",
    "values",
    "cut",
    "began",
];

/// `GET /api/v1/statuses`
pub async fn get(
    State(app): State<AppState>,
    Asked(asked): Asked<StatusesAsked>,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let published = app.unlocked()?;
    let view = View::new(&published, Lang::En, false);
    let level = asked.level.map_or("", Level::as_str);
    let filter = StatusFilter::new(&view, &asked.q, level, &asked.group);
    let found: Vec<_> = filter.modules().into_iter().filter(|&id| filter.has_level(id)).collect();
    let (offset, count) = ((asked.offset as usize).min(found.len()), asked.count.0 as usize);
    let shown = &found[offset..found.len().min(offset + count)];
    let (rows, left_out) = modules(&published, shown);
    let end = offset + shown.len();
    let next = (end < found.len()).then_some(end as u64);
    let table = Table { name: "statuses", columns: &COLUMNS, rows: &rows, next };
    let answer = StatusesAnswer { seq: published.snapshot.seq, modules: &rows, left_out, next };
    Ok(table.answer(Format::of(asked.format, &headers), &answer))
}
