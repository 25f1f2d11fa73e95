//! Statistics of the alarms, as ISA-18.2 has them, and the time in each stage.

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::query::{Asked, Moment};
use super::table::{Format, Table};
use crate::AppState;
use crate::incidents::{wall_ms, wall_time};
use crate::schema::words;
use crate::texts::HttpError;
use telltale_store::{NodeStatistics, Statistics};

/// What is summed up without `since`.
const WEEK_MS: i64 = 7 * 24 * 3_600_000;

#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct StatisticsAsked {
    /// The first instant; a week before the last one if it is not given.
    since: Option<Moment>,
    /// The last instant; now if it is not given.
    until: Option<Moment>,
    format: Option<Format>,
}

#[derive(Debug, Serialize, JsonSchema)]
pub struct StatisticsAnswer<'a> {
    #[schemars(schema_with = "words::time")]
    since: String,
    #[schemars(schema_with = "words::time")]
    until: String,
    /// How long Telltale ran in that time.
    recorded_s: f64,
    alarms: u64,
    /// Of the recorded time.
    alarms_an_hour: Option<f64>,
    /// More than ten are a flood.
    most_in_10_min: u64,
    acknowledged: u64,
    /// Half of the acknowledged alarms were acknowledged sooner.
    to_acknowledge_s: Option<f64>,
    stages: Vec<StageStatistics>,
    /// Those with an alarm, the most frequent first. A CSV has these rows.
    nodes: &'a [NodeRow<'a>],
    /// Records that are missing.
    lost: u64,
}

#[derive(Debug, Serialize, JsonSchema)]
pub struct StageStatistics {
    stage: &'static str,
    time_s: f64,
}

/// The alarms of a node, with those that moved to it from its symptoms.
#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "NodeStatistics")]
pub struct NodeRow<'a> {
    node: &'a str,
    alarms: u64,
    /// The mean recorded time between two.
    between_alarms_s: Option<f64>,
    /// How long they lasted in all.
    alarmed_s: f64,
    longest_s: f64,
    /// It came three times within a minute.
    chatters: bool,
}

const COLUMNS: [&str; 6] = ["node", "alarms", "between_alarms_s", "alarmed_s", "longest_s", "chatters"];

/// `GET /api/v1/statistics`
pub async fn get(
    State(app): State<AppState>,
    Asked(asked): Asked<StatisticsAsked>,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let published = app.published();
    let to_ms = asked.until.map_or_else(|| wall_ms(published.at), |Moment(ms)| ms);
    let from_ms = asked.since.map_or(to_ms - WEEK_MS, |Moment(ms)| ms);
    let found = app.past(&published, |history| history.statistics(from_ms, to_ms)).await?;
    let rows: Vec<NodeRow<'_>> = found.nodes.iter().map(|node| row(&found, node)).collect();
    let table = Table { name: "statistics", columns: &COLUMNS, rows: &rows, next: None };
    Ok(table.answer(Format::of(asked.format, &headers), &answer(&found, &rows)))
}

fn answer<'a>(found: &Statistics, nodes: &'a [NodeRow<'a>]) -> StatisticsAnswer<'a> {
    let stage = |&(stage, ms): &(telltale_engine::model::Stage, i64)| StageStatistics {
        stage: stage.as_str(),
        time_s: seconds(ms),
    };
    StatisticsAnswer {
        since: wall_time(found.from_ms),
        until: wall_time(found.to_ms),
        recorded_s: seconds(found.recorded_ms),
        alarms: found.alarms,
        alarms_an_hour: found.per_hour(found.alarms),
        most_in_10_min: found.most_in_10_min,
        acknowledged: found.acknowledged,
        to_acknowledge_s: found.to_acknowledge_ms.map(seconds),
        stages: found.stages.iter().map(stage).collect(),
        nodes,
        lost: found.lost,
    }
}

fn row<'a>(found: &Statistics, node: &'a NodeStatistics) -> NodeRow<'a> {
    NodeRow {
        node: &node.node,
        alarms: node.alarms,
        between_alarms_s: found.between_alarms_ms(node).map(seconds),
        alarmed_s: seconds(node.alarmed_ms),
        longest_s: seconds(node.longest_ms),
        chatters: node.chatters,
    }
}

fn seconds(ms: i64) -> f64 {
    ms as f64 / 1000.0
}
