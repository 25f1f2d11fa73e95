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
use telltale_store::{NodeStatistics, Statistics, VersionStatistics, between_failures_ms, per_100_km};

/// The span without `since`.
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
    /// The way in that time; `null` if no speed was known.
    driven_km: Option<f64>,
    alarms: u64,
    /// Of the recorded time.
    alarms_an_hour: Option<f64>,
    /// `null` if the way is not known or shorter than a kilometre.
    alarms_on_100_km: Option<f64>,
    /// More than ten are a flood.
    most_in_10_min: u64,
    acknowledged: u64,
    /// Half of the acknowledged alarms were acknowledged sooner.
    to_acknowledge_s: Option<f64>,
    stages: Vec<StageStatistics>,
    /// Those with an alarm, the most frequent first. A CSV has these rows.
    nodes: &'a [NodeRow<'a>],
    /// By version of Telltale, in the order in which they ran. A reload begins no other one.
    versions: Vec<VersionAnswer<'a>>,
    /// Records that are missing.
    lost: u64,
}

/// The figures of one version.
#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "VersionStatistics")]
pub struct VersionAnswer<'a> {
    /// Empty of records that were made by one which did not say.
    version: &'a str,
    recorded_s: f64,
    driven_km: Option<f64>,
    alarms: u64,
    alarms_on_100_km: Option<f64>,
    /// The mean recorded time for each alarm.
    between_alarms_s: Option<f64>,
    nodes: Vec<NodeRow<'a>>,
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
    an_hour: Option<f64>,
    /// `null` if the way is not known or shorter than a kilometre.
    on_100_km: Option<f64>,
    /// The mean time between failures: the recorded time without the alarms of the node, for each of them.
    mtbf_s: Option<f64>,
}

const COLUMNS: [&str; 9] = [
    "node",
    "alarms",
    "between_alarms_s",
    "alarmed_s",
    "longest_s",
    "chatters",
    "an_hour",
    "on_100_km",
    "mtbf_s",
];

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

fn answer<'a>(found: &'a Statistics, nodes: &'a [NodeRow<'a>]) -> StatisticsAnswer<'a> {
    let stage = |&(stage, ms): &(telltale_engine::model::Stage, i64)| StageStatistics {
        stage: stage.as_str(),
        time_s: seconds(ms),
    };
    StatisticsAnswer {
        since: wall_time(found.from_ms),
        until: wall_time(found.to_ms),
        recorded_s: seconds(found.recorded_ms),
        driven_km: found.driven_m.map(kilometres),
        alarms: found.alarms,
        alarms_an_hour: found.per_hour(found.alarms),
        alarms_on_100_km: per_100_km(found.alarms, found.driven_m),
        most_in_10_min: found.most_in_10_min,
        acknowledged: found.acknowledged,
        to_acknowledge_s: found.to_acknowledge_ms.map(seconds),
        stages: found.stages.iter().map(stage).collect(),
        nodes,
        versions: found.versions.iter().map(version).collect(),
        lost: found.lost,
    }
}

fn version(found: &VersionStatistics) -> VersionAnswer<'_> {
    // The figures of its nodes are of its own time and way.
    let alone =
        Statistics { recorded_ms: found.recorded_ms, driven_m: found.driven_m, ..Statistics::default() };
    VersionAnswer {
        version: &found.version,
        recorded_s: seconds(found.recorded_ms),
        driven_km: found.driven_m.map(kilometres),
        alarms: found.alarms,
        alarms_on_100_km: per_100_km(found.alarms, found.driven_m),
        between_alarms_s: found.between_alarms_ms().map(seconds),
        nodes: found.nodes.iter().map(|node| row(&alone, node)).collect(),
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
        an_hour: found.per_hour(node.alarms),
        on_100_km: per_100_km(node.alarms, found.driven_m),
        mtbf_s: between_failures_ms(found.recorded_ms, node).map(seconds),
    }
}

fn kilometres(metres: f64) -> f64 {
    metres / 1000.0
}

fn seconds(ms: i64) -> f64 {
    ms as f64 / 1000.0
}
