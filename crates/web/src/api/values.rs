//! The numbers that a module reported: in the last minutes one by one, over days as minutes or hours.

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use telltale_clock::wall_at;
use telltale_engine::model::NodeId;
use telltale_runtime::Published;

use super::query::{Asked, Count, Moment};
use super::table::{Format, Table};
use crate::AppState;
use crate::incidents::{wall_ms, wall_time};
use crate::schema::words;
use crate::texts::HttpError;
use crate::view::trends::exactly;
use telltale_store::{Resolution, Trend, TrendQuery};

const DAY_MS: i64 = 24 * 3_600_000;
/// A span that is longer comes in hours, where nothing is asked for.
const MINUTES_UP_TO_MS: i64 = 2 * DAY_MS;
/// Names of nodes are not longer.
const NODE_BYTES_MAX: usize = 8192;

#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ValuesAsked {
    /// The module, as `sensors/lidar_front`.
    node: String,
    /// The first instant of minutes or hours; a day before the last one if it is not given.
    since: Option<Moment>,
    /// The last instant of minutes or hours; now if it is not given.
    until: Option<Moment>,
    /// With an instant `minute`, and `hour` of more than two days; without one `sample`.
    resolution: Option<Step>,
    /// Rows that are left out: `next` of the page before.
    #[serde(default)]
    offset: u32,
    /// At most so many rows.
    #[serde(default)]
    count: Count<20_000, 50_000>,
    format: Option<Format>,
}

/// The time of a row: an instant of the last five minutes, a minute or an hour.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
#[schemars(inline)]
pub enum Step {
    Sample,
    Minute,
    Hour,
}

/// The numbers of a module, the oldest first.
#[derive(Debug, Serialize, JsonSchema)]
pub struct ValuesAnswer<'a> {
    values: &'a [ValueRow<'a>],
    resolution: Step,
    /// From this hour on there are minutes of any module. Before it they are put together to hours.
    #[schemars(schema_with = "words::some_time")]
    minutes_since: Option<String>,
    /// From this hour or day on there are hours of any module. Before it nothing is kept.
    #[schemars(schema_with = "words::some_time")]
    hours_since: Option<String>,
    /// For `offset` of the next page; `null` on the last one.
    next: Option<u64>,
}

/// The value at an instant; there is no row where there was none.
#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "Value")]
pub struct ValueRow<'a> {
    /// The instant, or the beginning of the minute or hour.
    #[schemars(schema_with = "words::time")]
    at: String,
    key: &'a str,
    /// The number, or its mean by time.
    value: f64,
    /// The least of the minute or hour; `null` of an instant.
    min: Option<f64>,
    /// The greatest of the minute or hour; `null` of an instant.
    max: Option<f64>,
    /// For how long of the minute or hour there was a number; `null` of an instant.
    known_s: Option<f64>,
}

const COLUMNS: [&str; 6] = ["at", "key", "value", "min", "max", "known_s"];
/// Of instants.
const SAMPLE_COLUMNS: [&str; 3] = ["at", "key", "value"];

/// `GET /api/v1/values`
pub async fn get(
    State(app): State<AppState>,
    Asked(asked): Asked<ValuesAsked>,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let published = app.published();
    if published.is_locked() {
        return Err(HttpError::Locked);
    }
    if asked.node.len() > NODE_BYTES_MAX {
        return Err(HttpError::NotFound);
    }
    let to_ms = asked.until.map_or_else(|| wall_ms(published.at), |Moment(ms)| ms);
    let from_ms = asked.since.map_or(to_ms.saturating_sub(DAY_MS), |Moment(ms)| ms);
    let is_past = asked.since.is_some() || asked.until.is_some();
    let unasked = match is_past {
        false => Step::Sample,
        true if to_ms.saturating_sub(from_ms) > MINUTES_UP_TO_MS => Step::Hour,
        true => Step::Minute,
    };
    let step = asked.resolution.unwrap_or(unasked);
    let stored = match step {
        Step::Sample => None,
        Step::Minute => Some(Resolution::Minute),
        Step::Hour => Some(Resolution::Hour),
    };
    let (trend, numbers);
    let (all, columns) = match stored {
        None => {
            numbers = samples(&app, &published, &asked.node)?;
            trend = Trend::default();
            let row = |(at, key, value)| ValueRow { at, key, value, min: None, max: None, known_s: None };
            let rows: Vec<ValueRow<'_>> =
                numbers.iter().map(|(at, key, value)| row((at.clone(), &**key, *value))).collect();
            (rows, &SAMPLE_COLUMNS[..])
        }
        Some(resolution) => {
            let query = TrendQuery { node: asked.node.clone(), from_ms, to_ms, resolution };
            trend = app.past(&published, |history| history.trend(query)).await?;
            // A module that has left may have a past.
            if trend.values.is_empty()
                && !matches!(published.snapshot.node(&asked.node), Some(NodeId::Module(_)))
            {
                return Err(HttpError::NotFound);
            }
            (rows(&trend), &COLUMNS[..])
        }
    };
    let first = all.len().min(asked.offset as usize);
    let end = all.len().min(first + asked.count.0 as usize);
    let next = (end < all.len()).then_some(end as u64);
    let rows = &all[first..end];
    let table = Table { name: "values", columns, rows, next };
    let answer = ValuesAnswer {
        values: rows,
        resolution: step,
        minutes_since: trend.minutes_from_ms.map(wall_time),
        hours_since: trend.hours_from_ms.map(wall_time),
        next,
    };
    Ok(table.answer(Format::of(asked.format, &headers), &answer))
}

/// Instants with keys and numbers.
fn samples(
    app: &AppState,
    published: &Published,
    node: &str,
) -> Result<Vec<(String, String, f64)>, HttpError> {
    let snapshot = &published.snapshot;
    let Some(NodeId::Module(id)) = snapshot.node(node) else {
        return Err(HttpError::NotFound);
    };
    let (times, series) = app.trends.numbers(id.0 as usize, &snapshot.module(id).0.id);
    let mut rows = Vec::new();
    for (index, at) in times.iter().enumerate() {
        let at = wall_time(wall_ms(wall_at(published.at, snapshot.now, *at)));
        let then = series.iter().filter_map(|(key, numbers)| Some((key, numbers.get(index).copied()??)));
        rows.extend(then.map(|(key, value)| (at.clone(), key.clone(), value)));
    }
    Ok(rows)
}

/// By time, and then by key.
fn rows(trend: &Trend) -> Vec<ValueRow<'_>> {
    let points = trend.values.iter().flat_map(|value| value.points.iter().map(|point| (&*value.key, point)));
    let mut points: Vec<_> = points.collect();
    points.sort_by_key(|(_, point)| point.at_ms);
    let row = |(key, point): (_, &telltale_store::TrendPoint)| ValueRow {
        at: wall_time(point.at_ms),
        key,
        value: exactly(point.mean),
        min: Some(exactly(point.least)),
        max: Some(exactly(point.most)),
        known_s: Some(point.known_s),
    };
    points.into_iter().map(row).collect()
}
