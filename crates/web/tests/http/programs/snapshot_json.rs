//! The snapshot in the form that programs read.

use std::sync::Arc;
use std::time::{Duration, UNIX_EPOCH};

use serde_json::{Value, json};
use telltale_engine::Engine;
use telltale_engine::input::{Input, OperatorAction, StatusArray};
use telltale_engine::time::Timestamp;
use telltale_runtime::Published;
use telltale_web::live::frame::Frames;

use crate::fixture::model;

const AT_MS: u64 = 1_795_176_005_123;

fn read(engine: &mut Engine) -> Value {
    let published = Published::recorded(engine.snapshot(), UNIX_EPOCH + Duration::from_millis(AT_MS));
    serde_json::from_str(Frames::default().json(&published).as_str()).unwrap()
}

fn class() -> Value {
    json!({ "location": "isolated", "information": "content", "flow": null })
}

#[test]
fn a_snapshot_reads_as_documented() {
    let mut engine = Engine::new(Arc::new(model()), Timestamp::ZERO);
    let login = Input::Operator(OperatorAction::Login { name: "anna".into() });
    engine.handle(&login, Timestamp::from_millis(1000));
    let mut array = StatusArray::default();
    array.push_status(2, "lidar", "no \u{202e}packets\n", "velodyne");
    array.push_value("rate_hz", "0");
    array.push_value("rate_hz", "9");
    array.push_value("since", "2 s");
    for name in ["imu", "tf"] {
        array.push_status(0, name, "fine", "");
    }
    engine.handle(&Input::Diagnostics(array), Timestamp::from_millis(4000));
    engine.handle(&Input::Tick, Timestamp::from_millis(4250));
    let snapshot = read(&mut engine);

    let at = "2026-11-20T12:00:05.123Z";
    let then = "2026-11-20T12:00:04.873Z";
    assert_eq!(snapshot["seq"].as_u64(), Some(engine.seq()));
    for (field, expected) in [
        ("at", json!(at)),
        ("stage", json!("localizing")),
        ("operator", json!("anna")),
        ("overall", json!("error")),
        ("motion", json!({ "moving": "unknown", "speed_mps": null, "destination": null })),
        ("recording", json!(false)),
        ("roots", json!([{ "node": "sensors/lidar", "masks": 2, "since": then, "second": false }])),
        (
            "alarms",
            json!([{ "id": 1, "node": "sensors/lidar", "raised": then, "acknowledged": false, "active": true,
                     "repeats": 0 }]),
        ),
        ("shelved", json!([])),
        ("countermeasures", json!([])),
        ("signals", json!({ "active": null })),
    ] {
        assert_eq!(snapshot[field], expected, "{field}");
    }
    let groups = snapshot["groups"].as_array().unwrap();
    assert_eq!(
        groups[0],
        json!({
            "id": "sensors", "name": "Sensors", "state": "error", "own": "error", "since": then,
            "ok": 1, "counted": 2, "reason": null, "paths": [["sensors", "sensors/lidar"]],
            "modules": [{
                "id": "sensors/lidar", "state": "error", "own": "error", "since": then,
                "message": "no \u{202e}packets\n", "age_ms": 250, "reason": null, "class": class(),
                "hardware_id": "velodyne", "values": { "rate_hz": "0", "since": "2 s" },
            }],
            "groups": [{
                "id": "sensors/inside", "name": "Inside", "state": "ok", "own": "ok", "since": then,
                "ok": 1, "counted": 1, "reason": null, "paths": [], "groups": [],
                "modules": [{
                    "id": "sensors/inside/imu", "state": "ok", "own": "ok", "since": then,
                    "message": "fine", "age_ms": 250, "reason": null, "class": class(),
                    "hardware_id": "", "values": {},
                }],
            }],
        })
    );
    assert_eq!(groups[1]["reason"], json!({ "kind": "masked", "by": ["sensors/lidar"] }));
    assert_eq!(groups[1]["paths"], json!([["localization", "sensors", "sensors/lidar"]]));
    assert_eq!(groups[2]["reason"], json!({ "kind": "not_relevant", "because": "stage localizing" }));
    assert_eq!(groups[2]["modules"][0]["age_ms"], Value::Null);
    assert_eq!(groups.len(), 3);
}

#[test]
fn statuses_that_nothing_claims_come_last_once_there_are_some() {
    let mut engine = Engine::new(Arc::new(model()), Timestamp::ZERO);
    engine.handle(&Input::Operator(OperatorAction::Login { name: "anna".into() }), Timestamp::ZERO);
    let mut array = StatusArray::default();
    array.push_status(2, "coffee machine", "empty", "");
    engine.handle(&Input::Diagnostics(array), Timestamp::from_millis(10));
    let snapshot = read(&mut engine);
    let groups = snapshot["groups"].as_array().unwrap();
    assert_eq!(groups.len(), 4);
    assert_eq!(groups[3]["modules"][0]["id"], json!("other/coffee machine"));
    assert_eq!(snapshot["roots"], json!([]));
}

#[test]
fn a_locked_vehicle_tells_its_stage_alone() {
    let mut engine = Engine::new(Arc::new(model()), Timestamp::ZERO);
    let mut array = StatusArray::default();
    array.push_status(2, "lidar", "broken", "");
    engine.handle(&Input::Diagnostics(array), Timestamp::from_millis(10));
    let snapshot = read(&mut engine);
    assert_eq!((snapshot["stage"].as_str(), snapshot["overall"].as_str()), (Some("locked"), Some("ignore")));
    for list in ["groups", "roots", "alarms", "shelved", "countermeasures"] {
        assert_eq!(snapshot[list], json!([]), "{list}");
    }
}

#[test]
fn a_wall_clock_far_out_of_range_breaks_nothing() {
    let mut engine = Engine::new(Arc::new(model()), Timestamp::ZERO);
    for (at, expected) in [
        (UNIX_EPOCH - Duration::from_secs(1), "1970-01-01T00:00:00.000Z"),
        (UNIX_EPOCH + Duration::from_secs(400_000_000_000), "9999-12-31T23:59:59.999Z"),
    ] {
        let published = Published::recorded(engine.snapshot(), at);
        let json: Value = serde_json::from_str(Frames::default().json(&published).as_str()).unwrap();
        assert_eq!(json["at"], json!(expected));
    }
}
