//! The API: what all vehicles show, what all nodes of one show, and the incidents of the fleet.

use std::collections::BTreeMap;
use std::time::Duration;

use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use serde::{Deserialize, Deserializer};
use serde_json::{Value, json};
use telltale_engine::state::State as Shows;
use telltale_fleet::message::VehicleId;
use telltale_web::common::{Asked, Format, SignedIn, Table, json_answer};
use telltale_web::texts::HttpError;
use tokio::time::timeout;

use super::Console;
use crate::state::incidents::{GroupBy, grouped};
use crate::state::picture::{Picture, Shown};
use crate::state::search::Search;
use crate::state::{Row, time};

/// For the answer of the store.
const READY_WITHIN: Duration = Duration::from_millis(1500);

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VehiclesAsked {
    /// Words that all of them have.
    #[serde(default)]
    q: Search,
    format: Option<Format>,
}

/// `GET /api/v1/vehicles?q&format`: all vehicles, the worst first.
pub async fn vehicles(
    State(console): State<Console>,
    _: SignedIn,
    Asked(VehiclesAsked { q, format }): Asked<VehiclesAsked>,
    headers: HeaderMap,
) -> Response {
    let mut rows = console.shared.fleet().rows(console.clock.now());
    rows.retain(|row| q.finds(row));
    let flat: Vec<Value> = rows.iter().map(flat).collect();
    let table = Table { name: "vehicles", columns: &COLUMNS, rows: &flat, next: None };
    table.answer(Format::of(format, &headers), &rows)
}

/// The columns of a CSV.
const COLUMNS: [&str; 14] = [
    "id",
    "name",
    "state",
    "contact",
    "node",
    "words",
    "since",
    "stage",
    "speed_kmh",
    "unacknowledged",
    "age_s",
    "version",
    "config",
    "two_vehicles",
];

/// With the parts of the cause in columns of their own.
fn flat(row: &Row) -> Value {
    let mut flat = json!(row);
    if let Some(cause) = &row.cause {
        flat["node"] = Value::from(cause.node.as_str());
        flat["words"] = Value::from(cause.words.as_str());
    }
    flat
}

/// `GET /api/v1/vehicles/ID/snapshot`: with the names of a vehicle's own snapshot, and how old it is.
pub async fn snapshot(
    State(console): State<Console>,
    _: SignedIn,
    Path(id): Path<String>,
) -> Result<Response, HttpError> {
    let id = VehicleId::new(&id).ok_or(HttpError::NotFound)?;
    let fleet = console.shared.fleet();
    let vehicle = fleet.vehicle(&id).ok_or(HttpError::NotFound)?;
    let row = fleet.row(vehicle, console.clock.now());
    let picture = &vehicle.picture;
    let speed_mps = row.speed_kmh.map(|kmh| (f64::from(kmh) / 3.6 * 10.0).round() / 10.0);
    let answer = json!({
        "vehicle": row.id, "name": row.name, "contact": row.contact, "age_s": row.age_s,
        "seq": picture.end.map(|mark| mark.n),
        "at": picture.at_ms.map(time),
        "whole": picture.is_whole,
        "stage": row.stage, "overall": row.state,
        "motion": { "speed_mps": speed_mps },
        "groups": groups(picture), "roots": roots(picture), "alarms": alarms(picture),
    });
    Ok(json_answer(StatusCode::OK, &answer))
}

fn shown(name: &str, shown: &Shown) -> Value {
    let reason = shown.cause.as_ref().map(|cause| json!({ "masked_by": [cause] }));
    json!({ "id": name, "state": shown.state, "own": shown.own, "message": shown.words, "reason": reason })
}

/// The groups with their modules: the name of a module begins with that of its group.
fn groups(picture: &Picture) -> Vec<Value> {
    let mut groups: BTreeMap<&str, (Option<&Shown>, Vec<Value>)> = BTreeMap::new();
    for (name, node) in &picture.nodes {
        match name.split_once('/') {
            None => groups.entry(name).or_default().0 = Some(node),
            Some((group, _)) => groups.entry(group).or_default().1.push(shown(name, node)),
        }
    }
    let group = |(name, (node, modules)): (&str, (Option<&Shown>, Vec<Value>))| {
        let unknown = Shown { state: Shows::Unknown, own: Shows::Unknown, cause: None, words: String::new() };
        let mut group = shown(name, node.unwrap_or(&unknown));
        group["modules"] = Value::from(modules);
        group
    };
    groups.into_iter().map(group).collect()
}

/// The nodes that others name as their cause.
fn roots(picture: &Picture) -> Vec<Value> {
    let mut masks: BTreeMap<&str, u32> = BTreeMap::new();
    for cause in picture.nodes.values().filter_map(|node| node.cause.as_deref()) {
        *masks.entry(cause).or_default() += 1;
    }
    masks.into_iter().map(|(node, masks)| json!({ "node": node, "masks": masks })).collect()
}

fn alarms(picture: &Picture) -> Vec<Value> {
    let alarm = |it: &telltale_fleet::message::Alarm| json!({ "id": it.number, "node": it.node, "acknowledged": it.acknowledged, "active": it.active, "message": it.words });
    picture.alarms.values().map(alarm).collect()
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct IncidentsAsked {
    #[serde(default, deserialize_with = "group")]
    group: Option<GroupBy>,
    format: Option<Format>,
}

fn group<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<GroupBy>, D::Error> {
    let word = String::deserialize(deserializer)?;
    let words = GroupBy::ALL.map(GroupBy::as_str).join(", ");
    let unknown = || serde::de::Error::custom(format_args!("group is one of {words}"));
    GroupBy::from_word(&word).map(Some).ok_or_else(unknown)
}

/// `GET /api/v1/incidents?group&format`: the groups, the largest first; by their first causes if nothing is asked for.
pub async fn incidents(
    State(console): State<Console>,
    _: SignedIn,
    Asked(asked): Asked<IncidentsAsked>,
    headers: HeaderMap,
) -> Response {
    let rows = console.shared.fleet().incidents();
    let groups = grouped(rows, asked.group.unwrap_or(GroupBy::Cause));
    let columns = &["group", "count", "vehicles", "versions", "first", "last"];
    let table = Table { name: "incidents", columns, rows: &groups, next: None };
    table.answer(Format::of(asked.format, &headers), &groups)
}

/// `GET /readyz`: the console works, also while the hub is away.
pub async fn readyz(State(console): State<Console>) -> (StatusCode, &'static str) {
    match timeout(READY_WITHIN, console.store.is_ready()).await {
        Ok(true) => (StatusCode::OK, "ready\n"),
        _ => (StatusCode::SERVICE_UNAVAILABLE, "not ready\n"),
    }
}
