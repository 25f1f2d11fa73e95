//! Incidents as JSON: the same objects for the HTTP API and for `telltale incident list --json`.

use std::time::{Duration, UNIX_EPOCH};

use serde_json::{Map, Value, json};

use crate::record::summary::{FrozenNode, Summary, TriggerLine};
use crate::store::Incident;

/// Milliseconds since 1970 as text, in UTC.
pub fn time(ms: i64) -> String {
    // The end of the year 9999 is the last time that has a text.
    let since = Duration::from_millis(u64::try_from(ms).unwrap_or(0).min(253_402_300_799_999));
    humantime::format_rfc3339_millis(UNIX_EPOCH + since).to_string()
}

/// An incident in a list.
pub fn listed(incident: &Incident) -> Value {
    let Incident { summary, kept, note } = incident;
    let Summary { recording, triggers, .. } = summary;
    let mut kinds: Vec<&str> = triggers.iter().map(|trigger| &*trigger.kind).collect();
    kinds.sort_unstable();
    kinds.dedup();
    let note = note.as_ref().map(|it| json!({ "text": it.text, "by": it.by, "at": time(it.at_ms) }));
    json!({
        "id": summary.id,
        "since": time(summary.since_ms),
        "until": summary.until_ms.map(time),
        "roots": summary.causes(),
        "kinds": kinds,
        "trigger_count": triggers.len() as u64 + summary.more_triggers,
        "stage": Some(&summary.stage).filter(|stage| !stage.is_empty()),
        "marked": summary.is_marked(),
        "kept": kept,
        "storm": summary.storm,
        "note": note,
        "recording": {
            "bytes": recording.bytes,
            "pre_roll_s": recording.pre_roll_s,
            "finished": recording.finished,
            "interrupted": recording.interrupted,
            "gone": recording.gone,
        },
    })
}

/// Everything that is known of an incident.
pub fn whole(incident: &Incident) -> Value {
    let Summary { vehicle, triggers, freeze, configuration, version, recording, .. } = &incident.summary;
    let mut value = listed(incident);
    value["vehicle"] = json!(Some(vehicle).filter(|vehicle| !vehicle.is_empty()));
    value["triggers"] = triggers.iter().map(trigger).collect();
    value["freeze"] = freeze.iter().map(frozen).collect();
    value["configuration"] = json!(configuration);
    value["version"] = json!(version);
    value["recording"]["sha256"] = json!(recording.sha256);
    value["recording"]["messages"] = json!(recording.messages);
    value["recording"]["missing"] = json!(recording.missing);
    value
}

fn trigger(trigger: &TriggerLine) -> Value {
    let TriggerLine { at_ms, kind, what, alarm, note } = trigger;
    json!({ "at": time(*at_ms), "kind": kind, "what": what, "alarm": alarm, "note": note })
}

fn frozen(frozen: &FrozenNode) -> Value {
    let FrozenNode { node, state, message, values } = frozen;
    let values: Map<String, Value> =
        values.iter().map(|(key, value)| (key.clone(), Value::from(value.as_str()))).collect();
    json!({ "node": node, "state": state, "message": message, "values": values })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::summary::{Recording, kind};

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
