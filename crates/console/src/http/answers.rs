//! The API: what all vehicles show, what all nodes of one show, and the incidents of the fleet.

use std::collections::BTreeMap;
use std::time::Duration;

use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::response::Response;
use serde::{Deserialize, Deserializer};
use serde_json::{Value, json};
use telltale_engine::state::State as Shows;
use telltale_fleet::message::VehicleId;
use telltale_web::common::{Asked, SignedIn, json_answer};
use telltale_web::texts::HttpError;
use tokio::time::timeout;

use super::Console;
use crate::state::incidents::{GroupBy, grouped};
use crate::state::picture::{Picture, Shown};
use crate::state::time;

/// For the answer of the store.
const READY_WITHIN: Duration = Duration::from_millis(1500);

/// `GET /api/v1/vehicles`: all vehicles, the worst first.
pub async fn vehicles(State(console): State<Console>, _: SignedIn) -> Response {
    let rows = console.shared.fleet().rows(console.clock.now());
    json_answer(StatusCode::OK, &json!(rows))
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
}

fn group<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<GroupBy>, D::Error> {
    let word = String::deserialize(deserializer)?;
    let words = GroupBy::ALL.map(GroupBy::as_str).join(", ");
    let unknown = || serde::de::Error::custom(format_args!("group is one of {words}"));
    GroupBy::from_word(&word).map(Some).ok_or_else(unknown)
}

/// `GET /api/v1/incidents?group=`: the groups, the largest first; by their first causes if nothing is asked for.
pub async fn incidents(
    State(console): State<Console>,
    _: SignedIn,
    Asked(asked): Asked<IncidentsAsked>,
) -> Response {
    let rows = console.shared.fleet().incidents();
    json_answer(StatusCode::OK, &json!(grouped(rows, asked.group.unwrap_or(GroupBy::Cause))))
}

/// `GET /readyz`: the console works, also while the hub is away.
pub async fn readyz(State(console): State<Console>) -> (StatusCode, &'static str) {
    match timeout(READY_WITHIN, console.store.is_ready()).await {
        Ok(true) => (StatusCode::OK, "ready\n"),
        _ => (StatusCode::SERVICE_UNAVAILABLE, "not ready\n"),
    }
}
