//! The API: what all vehicles show, what all nodes of one show, and the incidents of the fleet.

use std::time::Duration;

use axum::extract::{Path, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Deserializer, Serialize};
use serde_json::{Value, json};
use telltale_engine::model::Stage;
use telltale_engine::state::State as Shows;
use telltale_fleet::message::{Alarm, Incident, VehicleId};
use telltale_web::common::{Asked, Format, Moment, Table, json_answer};
use telltale_web::describe::words;
use telltale_web::texts::{HttpError, Lang};
use tokio::time::timeout;

use super::Console;
use super::history::past;
use super::recordings::told;
use super::view::View;
use crate::state::contact::Contact;
use crate::state::incidents::{GroupBy, IncidentRow, grouped, row as incident_row};
use crate::state::picture::{Picture, Shown};
use crate::state::search::Search;
use crate::state::{Row, time};

/// The log of so long before a moment is read for its snapshot.
const AROUND_MS: i64 = 24 * 3_600_000;

/// For the answer of the store.
const READY_WITHIN: Duration = Duration::from_millis(1500);

#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VehiclesAsked {
    /// Words that all of them have.
    #[serde(default)]
    #[schemars(with = "String")]
    pub q: Search,
    pub format: Option<Format>,
}

/// `GET /api/v1/vehicles?q&format`: all vehicles, the worst first.
pub async fn vehicles(
    view: View,
    Asked(VehiclesAsked { q, format }): Asked<VehiclesAsked>,
    headers: HeaderMap,
) -> Response {
    let rows = view.found(&q);
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

#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SnapshotAsked {
    /// A moment of the past, by the vehicle's clock.
    at: Option<Moment>,
}

/// What all nodes of a vehicle show.
#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "VehicleSnapshot")]
pub struct SnapshotAnswer {
    vehicle: String,
    name: String,
    /// Of a moment: `live` if its states are surely known, `off` after a goodbye, else `lost`.
    contact: Contact,
    /// How old it is, in seconds; of a moment, how long before it this was told.
    age_s: Option<f64>,
    /// The number of the last message in it, and when that was made by the vehicle's clock.
    seq: Option<u64>,
    #[schemars(schema_with = "words::some_time")]
    at: Option<String>,
    /// The moment that was asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(schema_with = "words::time")]
    moment: Option<String>,
    /// Nothing is missing in it.
    whole: bool,
    #[schemars(schema_with = "words::some_stage")]
    stage: Option<Stage>,
    #[schemars(schema_with = "words::state")]
    overall: Shows,
    motion: Motion,
    groups: Vec<Group>,
    /// The nodes that others name as their cause.
    roots: Vec<Root>,
    alarms: Vec<OpenAlarm>,
}

#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "VehicleMotion")]
struct Motion {
    speed_mps: Option<f64>,
}

#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "VehicleNode")]
struct Node {
    id: String,
    #[schemars(schema_with = "words::state")]
    state: Shows,
    /// As if nothing were masked.
    #[schemars(schema_with = "words::state")]
    own: Shows,
    message: String,
    reason: Option<Reason>,
}

#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "VehicleReason")]
struct Reason {
    masked_by: Vec<String>,
}

#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "VehicleGroup")]
struct Group {
    #[serde(flatten)]
    node: Node,
    modules: Vec<Node>,
}

#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "VehicleRoot")]
struct Root {
    node: String,
    /// How many nodes name it.
    masks: u32,
}

#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "VehicleAlarm")]
struct OpenAlarm {
    id: u64,
    node: String,
    acknowledged: bool,
    active: bool,
    message: String,
}

/// `GET /api/v1/vehicles/ID/snapshot?at`: with the names of a vehicle's own snapshot, and how old it is.
pub async fn snapshot(
    view: View,
    Path(id): Path<String>,
    Asked(SnapshotAsked { at }): Asked<SnapshotAsked>,
) -> Result<Response, HttpError> {
    let id = VehicleId::new(&id).ok_or(HttpError::NotFound)?;
    let past = match at {
        Some(Moment(ms)) => Some(past(&view, &id, ms, AROUND_MS).await?.0),
        None => None,
    };
    let fleet = view.fleet();
    let vehicle = fleet.vehicle(&id)?;
    let now = fleet.row(vehicle, view.console.clock.now());
    let (row, picture) = match &past {
        Some(past) => (past.row(now), &past.picture),
        None => (now, &vehicle.picture),
    };
    let speed_mps = row.speed_kmh.map(|kmh| (f64::from(kmh) / 3.6 * 10.0).round() / 10.0);
    let answer = SnapshotAnswer {
        vehicle: row.id,
        name: row.name,
        contact: row.contact,
        age_s: row.age_s,
        seq: picture.end.map(|mark| mark.n),
        at: picture.at_ms.map(time),
        moment: past.as_ref().map(|past| time(past.at_ms)),
        whole: picture.is_whole,
        stage: row.stage,
        overall: row.state,
        motion: Motion { speed_mps },
        groups: groups(picture),
        roots: roots(picture),
        alarms: alarms(picture),
    };
    Ok(json_answer(StatusCode::OK, &json!(answer)))
}

fn shown(name: &str, shown: &Shown) -> Node {
    let reason = shown.cause.iter().map(|cause| Reason { masked_by: vec![cause.clone()] }).next();
    Node { id: name.to_owned(), state: shown.state, own: shown.own, message: shown.words.clone(), reason }
}

fn groups(picture: &Picture) -> Vec<Group> {
    let unknown = Shown { state: Shows::Unknown, own: Shows::Unknown, cause: None, words: String::new() };
    let groups = picture.groups().into_iter().map(|(name, (node, modules))| Group {
        node: shown(name, node.unwrap_or(&unknown)),
        modules: modules.into_iter().map(|(name, node)| shown(name, node)).collect(),
    });
    groups.collect()
}

fn roots(picture: &Picture) -> Vec<Root> {
    let root = |(node, waiting): (&str, Vec<_>)| Root { node: node.to_owned(), masks: waiting.len() as u32 };
    picture.waiting().into_iter().map(root).collect()
}

fn alarms(picture: &Picture) -> Vec<OpenAlarm> {
    let alarm = |it: &Alarm| OpenAlarm {
        id: it.number,
        node: it.node.clone(),
        acknowledged: it.acknowledged,
        active: it.active,
        message: it.words.clone(),
    };
    picture.alarms.values().map(alarm).collect()
}

#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct IncidentsAsked {
    /// What the groups have in common: `cause` without it.
    #[serde(default, deserialize_with = "group")]
    #[schemars(schema_with = "group_words")]
    pub group: GroupBy,
    format: Option<Format>,
}

pub fn group_words(_: &mut SchemaGenerator) -> Schema {
    words::of(GroupBy::ALL.map(GroupBy::as_str))
}

pub fn group<'de, D: Deserializer<'de>>(deserializer: D) -> Result<GroupBy, D::Error> {
    let word = String::deserialize(deserializer)?;
    let words = GroupBy::ALL.map(GroupBy::as_str).join(", ");
    let unknown = || serde::de::Error::custom(format_args!("group is one of {words}"));
    GroupBy::from_word(&word).ok_or_else(unknown)
}

/// `GET /api/v1/incidents?group&format`: the groups, the largest first; by their first causes if nothing is asked for.
pub async fn incidents(view: View, Asked(asked): Asked<IncidentsAsked>, headers: HeaderMap) -> Response {
    let rows = view.fleet().incidents();
    let groups = grouped(rows, asked.group);
    let columns = &["group", "count", "vehicles", "versions", "first", "last", "fetched"];
    let table = Table { name: "incidents", columns, rows: &groups, next: None };
    table.answer(Format::of(asked.format, &headers), &groups)
}

#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TableAsked {
    pub format: Option<Format>,
}

/// An incident of one vehicle.
#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "VehicleIncident")]
pub struct OwnIncident {
    #[serde(flatten)]
    incident: IncidentRow,
    /// Of its recording, if that is finished.
    bytes: u64,
    sha256: Option<String>,
    /// How its recording came so far: `none`, `asked`, `coming`, `here`, `refused`, `bad` or `gone`.
    recording: &'static str,
}

/// `GET /api/v1/vehicles/ID/incidents?format`: the incidents of one vehicle, the newest first.
pub async fn incidents_of(
    view: View,
    Path(id): Path<String>,
    Asked(asked): Asked<TableAsked>,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let id = VehicleId::new(&id).ok_or(HttpError::NotFound)?;
    let fleet = view.fleet();
    let vehicle = fleet.vehicle(&id)?;
    let own = |(number, it): (&u64, &Incident)| OwnIncident {
        incident: incident_row(&id, it, vehicle.recordings.get(number)),
        bytes: it.bytes,
        sha256: it.sha256.clone(),
        recording: told(vehicle.recordings.get(number).map(|it| &it.step), Lang::default()).0,
    };
    let rows: Vec<OwnIncident> = vehicle.incidents.iter().rev().map(own).collect();
    let columns = &[
        "vehicle",
        "number",
        "since",
        "until",
        "stage",
        "causes",
        "triggers",
        "version",
        "config",
        "bytes",
        "sha256",
        "recording",
    ];
    let table = Table { name: "incidents", columns, rows: &rows, next: None };
    Ok(table.answer(Format::of(asked.format, &headers), &rows))
}

/// `GET /readyz`: the console works, also while the hub is away.
pub async fn readyz(State(console): State<Console>) -> (StatusCode, &'static str) {
    match timeout(READY_WITHIN, console.store.is_ready()).await {
        Ok(true) => (StatusCode::OK, "ready\n"),
        _ => (StatusCode::SERVICE_UNAVAILABLE, "not ready\n"),
    }
}
