//! The incidents that vehicles told of, and their groups over the fleet.

use std::collections::{BTreeMap, BTreeSet};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use telltale_fleet::message::{Incident, VehicleId, possible_ms};
use telltale_web::describe::words;
use telltale_web::texts::{ID, VALUE, clean};

use super::recordings::{Step, Transfer};
use super::time;

/// Incidents of one vehicle that are kept; beyond it the oldest go.
pub const INCIDENTS_MAX: usize = 100;
/// Incidents of a group that are named.
const NAMED_MAX: usize = 100;
const CAUSES_MAX: usize = 16;

telltale_engine::words! {
    /// What incidents are grouped by.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
    #[serde(rename_all = "snake_case")]
    pub enum GroupBy {
        #[default]
        Cause = "cause",
        Version = "version",
        Config = "config",
    }
}

/// An incident of a vehicle, for programs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, JsonSchema)]
#[schemars(rename = "Incident")]
pub struct IncidentRow {
    pub vehicle: String,
    pub number: u64,
    #[schemars(schema_with = "words::time")]
    pub since: String,
    /// Nothing while it lasts.
    #[schemars(schema_with = "words::some_time")]
    pub until: Option<String>,
    pub stage: String,
    pub causes: Vec<String>,
    pub triggers: u64,
    pub version: String,
    pub config: String,
    #[serde(skip)]
    since_ms: i64,
    /// Its recording is here.
    #[serde(skip)]
    pub is_fetched: bool,
}

impl GroupBy {
    /// The group of an incident.
    pub fn key(self, row: &IncidentRow) -> &str {
        match self {
            GroupBy::Cause => row.causes.first().map_or("", String::as_str),
            GroupBy::Version => &row.version,
            GroupBy::Config => &row.config,
        }
    }
}

/// Incidents with something in common.
#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "IncidentGroup")]
pub struct Group {
    /// The common cause, version or hash of the configuration.
    pub group: String,
    pub count: usize,
    /// Those with a recording at this console.
    pub fetched: usize,
    pub vehicles: BTreeSet<String>,
    pub versions: BTreeSet<String>,
    /// When the first and the last of them began.
    #[schemars(schema_with = "words::time")]
    pub first: String,
    #[schemars(schema_with = "words::time")]
    pub last: String,
    /// The newest of them.
    pub incidents: Vec<IncidentRow>,
}

/// With bounds, and without letters that act.
pub fn cleaned(incident: &Incident) -> Incident {
    let causes = incident.causes.iter().take(CAUSES_MAX).map(|cause| clean(cause, ID));
    Incident {
        since: possible_ms(incident.since),
        until: incident.until.map(possible_ms),
        stage: clean(&incident.stage, VALUE),
        causes: causes.collect(),
        version: clean(&incident.version, VALUE),
        config: clean(&incident.config, 2 * VALUE),
        sha256: incident.sha256.as_deref().map(|hash| clean(hash, 2 * VALUE)),
        ..*incident
    }
}

pub fn row(id: &VehicleId, incident: &Incident, transfer: Option<&Transfer>) -> IncidentRow {
    IncidentRow {
        vehicle: id.to_string(),
        number: incident.number,
        since: time(incident.since),
        until: incident.until.map(time),
        stage: incident.stage.clone(),
        causes: incident.causes.clone(),
        triggers: incident.triggers,
        version: incident.version.clone(),
        config: incident.config.clone(),
        since_ms: incident.since,
        is_fetched: transfer.is_some_and(|it| matches!(it.step, Step::Here(_))),
    }
}

/// The groups, the largest first.
pub fn grouped(rows: Vec<IncidentRow>, by: GroupBy) -> Vec<Group> {
    let mut groups: BTreeMap<String, Vec<IncidentRow>> = BTreeMap::new();
    for row in rows {
        groups.entry(by.key(&row).to_owned()).or_default().push(row);
    }
    let mut groups: Vec<Group> = groups.into_iter().map(|(key, rows)| group(key, rows)).collect();
    groups.sort_by(|a, b| (b.count, &a.group).cmp(&(a.count, &b.group)));
    groups
}

/// Sorts them, the newest first.
pub fn sort(rows: &mut [IncidentRow]) {
    rows.sort_by(|a, b| (b.since_ms, &a.vehicle, a.number).cmp(&(a.since_ms, &b.vehicle, b.number)));
}

fn group(group: String, mut rows: Vec<IncidentRow>) -> Group {
    sort(&mut rows);
    let since = |row: Option<&IncidentRow>| row.map(|it| it.since.clone()).unwrap_or_default();
    Group {
        group,
        count: rows.len(),
        fetched: rows.iter().filter(|it| it.is_fetched).count(),
        vehicles: rows.iter().map(|it| it.vehicle.clone()).collect(),
        versions: rows.iter().map(|it| it.version.clone()).collect(),
        first: since(rows.last()),
        last: since(rows.first()),
        incidents: rows.into_iter().take(NAMED_MAX).collect(),
    }
}
