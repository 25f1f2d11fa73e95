//! Incidents as JSON: the same objects for the HTTP API and for `telltale incident list --json`.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::Serialize;
use serde_json::Value;

use crate::schema::words;
use telltale_clock::of_unix_ms;
use telltale_record::proof::Proof;
use telltale_record::story::Story;
use telltale_record::summary::{FrozenNode, Recording, Summary, TriggerLine};
use telltale_store::Incident;

/// Milliseconds since 1970 as text, in UTC.
pub fn time(ms: i64) -> String {
    humantime::format_rfc3339_millis(of_unix_ms(ms)).to_string()
}

/// An incident in a list.
#[derive(Serialize, JsonSchema)]
#[schemars(rename = "ListedIncident")]
pub struct Listed<'a> {
    #[serde(flatten)]
    told: Told<'a>,
    recording: ToldRecording,
}

/// Everything that is known of an incident.
#[derive(Serialize, JsonSchema)]
#[schemars(rename = "Incident")]
pub struct Whole<'a> {
    #[serde(flatten)]
    told: Told<'a>,
    recording: WholeRecording<'a>,
    /// The id of the vehicle.
    vehicle: Option<&'a str>,
    /// Oldest first; at most 256.
    triggers: Vec<Trigger<'a>>,
    /// The modules that failed at the first trigger with those that belong to them, as they were then; then those
    /// that failed later.
    freeze: Vec<Frozen<'a>>,
    /// SHA-256 of the configuration's files.
    configuration: &'a str,
    /// The version of Telltale.
    version: &'a str,
    /// The story of the recording, where one incident is asked for; `null` if its file cannot be read now.
    #[serde(skip_serializing_if = "Option::is_none")]
    story: Option<Option<&'a Story>>,
}

#[derive(Serialize, JsonSchema)]
struct Told<'a> {
    id: u64,
    /// The first trigger.
    #[schemars(schema_with = "words::time")]
    since: String,
    /// The end; `null` while it lasts.
    #[schemars(schema_with = "words::some_time")]
    until: Option<String>,
    roots: Vec<&'a str>,
    /// Of its triggers: `root`, `own_error`, `lost_active`, `countermeasure`, `mark`.
    kinds: Vec<&'a str>,
    trigger_count: u64,
    /// At the first trigger.
    stage: Option<&'a str>,
    marked: bool,
    /// Oldest first.
    marks: Vec<Mark<'a>>,
    /// It stays whatever its age and size.
    kept: bool,
    /// It followed at once on an incident that reached its greatest length.
    storm: bool,
    note: Option<Note<'a>>,
}

#[derive(Serialize, JsonSchema)]
struct Note<'a> {
    text: &'a str,
    by: &'a str,
    #[schemars(schema_with = "words::time")]
    at: String,
}

#[derive(Serialize, JsonSchema)]
struct ToldRecording {
    bytes: u64,
    /// Seconds before the first trigger.
    pre_roll_s: f64,
    /// The file will not change.
    finished: bool,
    /// The program ended while it was recorded.
    interrupted: bool,
    /// The file is lost.
    gone: bool,
}

#[derive(Serialize, JsonSchema)]
struct WholeRecording<'a> {
    #[serde(flatten)]
    told: ToldRecording,
    /// Of the finished file.
    sha256: Option<&'a str>,
    messages: u64,
    /// Messages and inputs that are not in the file.
    missing: u64,
    /// Messages that had no room, and their bytes. The file has their times and sizes.
    left_out: u64,
    left_out_bytes: u64,
    /// Whether the file has the hash that the list of incidents and the audit log have, where one incident is asked
    /// for; `null` if it has none, cannot be read, or is too large to be compared at once.
    #[serde(skip_serializing_if = "Option::is_none")]
    as_recorded: Option<Option<bool>>,
}

/// A reason of an incident.
#[derive(Serialize, JsonSchema)]
struct Trigger<'a> {
    #[schemars(schema_with = "words::time")]
    at: String,
    kind: &'a str,
    what: &'a str,
    /// The number of the alarm of a root.
    alarm: Option<u64>,
    note: &'a str,
}

/// The user who marked a moment of an incident, and the note.
#[derive(Serialize, JsonSchema)]
struct Mark<'a> {
    by: &'a str,
    note: &'a str,
}

/// A node at the first trigger, or at a later one.
#[derive(Serialize, JsonSchema)]
struct Frozen<'a> {
    node: &'a str,
    state: &'a str,
    message: &'a str,
    values: BTreeMap<&'a str, &'a str>,
    /// The time of a later trigger; `null` at the first one.
    #[schemars(schema_with = "words::some_time")]
    at: Option<String>,
}

/// `{"incident": 12}`: the number of the incident that a mark is in.
#[derive(Serialize, JsonSchema)]
pub struct Marked {
    pub incident: u64,
}

/// An incident as an object of a list.
pub fn listed(incident: &Incident) -> Value {
    as_value(&Listed::of(incident))
}

/// Everything that is known of an incident without its recording.
pub fn whole(incident: &Incident) -> Value {
    as_value(&Whole::of(incident, None))
}

fn as_value(it: &impl Serialize) -> Value {
    serde_json::to_value(it).expect("structs of strings and numbers are JSON")
}

impl<'a> Listed<'a> {
    pub fn of(incident: &'a Incident) -> Listed<'a> {
        Listed { told: Told::of(incident), recording: ToldRecording::of(&incident.summary.recording) }
    }
}

impl<'a> Whole<'a> {
    pub fn of(incident: &'a Incident, read: Option<(Option<&'a Story>, &Proof)>) -> Whole<'a> {
        let Summary { vehicle, triggers, freeze, configuration, version, recording, .. } = &incident.summary;
        Whole {
            told: Told::of(incident),
            recording: WholeRecording {
                told: ToldRecording::of(recording),
                sha256: recording.sha256.as_deref(),
                messages: recording.messages,
                missing: recording.missing,
                left_out: recording.left_out,
                left_out_bytes: recording.left_out_bytes,
                as_recorded: read.map(|(_, proof)| proof.is_as_recorded()),
            },
            vehicle: Some(&**vehicle).filter(|vehicle| !vehicle.is_empty()),
            triggers: triggers.iter().map(trigger).collect(),
            freeze: freeze.iter().map(frozen).collect(),
            configuration,
            version,
            story: read.map(|(story, _)| story),
        }
    }
}

impl<'a> Told<'a> {
    fn of(incident: &'a Incident) -> Told<'a> {
        let Incident { summary, kept, note } = incident;
        let mut kinds: Vec<&str> = summary.triggers.iter().map(|trigger| &*trigger.kind).collect();
        kinds.sort_unstable();
        kinds.dedup();
        Told {
            id: summary.id,
            since: time(summary.since_ms),
            until: summary.until_ms.map(time),
            roots: summary.causes(),
            kinds,
            trigger_count: summary.trigger_count(),
            stage: Some(&*summary.stage).filter(|stage| !stage.is_empty()),
            marked: summary.is_marked(),
            marks: summary.marks().map(|mark| Mark { by: &mark.what, note: &mark.note }).collect(),
            kept: *kept,
            storm: summary.storm,
            note: note.as_ref().map(|it| Note { text: &it.text, by: &it.by, at: time(it.at_ms) }),
        }
    }
}

impl ToldRecording {
    fn of(recording: &Recording) -> ToldRecording {
        ToldRecording {
            bytes: recording.bytes,
            pre_roll_s: recording.pre_roll_s,
            finished: recording.finished,
            interrupted: recording.interrupted,
            gone: recording.gone,
        }
    }
}

fn trigger(trigger: &TriggerLine) -> Trigger<'_> {
    let TriggerLine { at_ms, kind, what, alarm, note } = trigger;
    Trigger { at: time(*at_ms), kind, what, alarm: *alarm, note }
}

fn frozen(frozen: &FrozenNode) -> Frozen<'_> {
    let FrozenNode { node, state, message, values, at_ms } = frozen;
    let values = values.iter().map(|(key, value)| (&**key, &**value)).collect();
    Frozen { node, state, message, values, at: at_ms.map(time) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use telltale_record::summary::kind;

    #[test]
    fn an_incident_that_lasts_is_as_the_contract_says() {
        let trigger = TriggerLine {
            at_ms: 1_000,
            kind: kind::ROOT.into(),
            what: "sensors/velodyne_packet_alive".into(),
            alarm: Some(3),
            note: String::new(),
        };
        let recording = Recording { bytes: 1, pre_roll_s: 30.0, finished: true, ..Recording::default() };
        let summary =
            Summary { id: 1, since_ms: 1_500, triggers: vec![trigger], recording, ..Summary::default() };
        let listed = listed(&Incident { summary, kept: false, note: None });
        let expected = json!({
            "id": 1, "since": "1970-01-01T00:00:01.500Z", "until": null,
            "roots": ["sensors/velodyne_packet_alive"],
        });
        for (key, value) in expected.as_object().unwrap() {
            assert_eq!(listed[key], *value, "{key}");
        }
        for (key, value) in [("bytes", json!(1)), ("pre_roll_s", json!(30.0)), ("finished", json!(true))] {
            assert_eq!(listed["recording"][key], value, "{key}");
        }
    }
}
