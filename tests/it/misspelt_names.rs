//! Hints for configured names that are never heard while similar names are.

use telltale::engine::Engine;
use telltale::engine::input::{Input, StatusArray};
use telltale::engine::snapshot::Snapshot;
use telltale::engine::time::Timestamp;

use crate::by_hand;

fn hear(engine: &mut Engine, at_ms: u64, name: &str) {
    let mut array = StatusArray::with_capacity(1, 0);
    array.push_status(0, name, "fine", "");
    engine.handle(&Input::Diagnostics(array), Timestamp::from_millis(at_ms));
}

fn message(snapshot: &Snapshot, id: &str) -> (String, Option<String>) {
    let index = snapshot.layout.modules.iter().position(|module| *module.id == *id).unwrap();
    let report = &snapshot.modules.get(index).unwrap().report;
    (report.message.to_string(), report.german.as_ref().map(ToString::to_string))
}

fn hint(snapshot: &Snapshot, path: &str) -> Option<String> {
    let group = snapshot.layout.groups.iter().find(|group| *group.path == *path).unwrap();
    group.hint.as_ref().map(|hint| hint.en.to_string())
}

const TEXT: &str = "
vehicle: { stages: none }
groups:
- { id: a, modules: [{ id: imu, status: 'imu: status' }, { id: heat, monitor: { value: { status: 'computer: heat', key: celsius, error_above: 90 } } }] }
- { id: amcl, match: [{ namespace: amcl }] }
- { id: planner, match: [{ contains: planer }] }
";

#[test]
fn a_status_that_never_comes_names_the_one_that_does() {
    let model = by_hand::model(TEXT);
    let mut engine = Engine::new(model.clone(), Timestamp::ZERO);
    hear(&mut engine, 100, "imu: Status");
    hear(&mut engine, 100, "imu: status 2");
    hear(&mut engine, 100, "Computer: heat");
    hear(&mut engine, 100, "/amcl: x");
    let snapshot = engine.snapshot();
    let said = (
        "never heard; `imu: Status` is heard".to_owned(),
        Some("nie empfangen; `imu: Status` wird empfangen".to_owned()),
    );
    assert_eq!(message(&snapshot, "a/imu"), said);
    assert_eq!(message(&snapshot, "a/heat").0, "never heard; `Computer: heat` is heard");
    assert_eq!(hint(&snapshot, "amcl").as_deref(), Some("nothing matches; `/amcl: x` in other looks alike"));
    assert_eq!((hint(&snapshot, "planner"), hint(&snapshot, "other")), (None, None));
    // A reload of the same configuration gives the same hint.
    engine.reload(model, Timestamp::from_millis(200));
    assert_eq!(
        (message(&engine.snapshot(), "a/imu"), hint(&engine.snapshot(), "amcl").is_some()),
        (said, true)
    );
    // Once the status comes, its own message is shown.
    hear(&mut engine, 300, "imu: status");
    hear(&mut engine, 300, "amcl: y");
    let snapshot = engine.snapshot();
    assert_eq!((message(&snapshot, "a/imu").0.as_str(), hint(&snapshot, "amcl")), ("fine", None));
    hear(&mut engine, 400, "IMU: status");
    assert_eq!(message(&engine.snapshot(), "a/imu").0, "fine");
}
