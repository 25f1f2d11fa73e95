//! Freeze frames of incidents: which modules they have, and with which values.

use telltale::engine::Engine;
use telltale::engine::input::{Input, StatusArray};
use telltale::engine::time::Timestamp;
use telltale::record::freeze::{first, later};
use telltale::record::incident::{Change, Margins, Open, Tracker, Trigger};
use telltale::record::summary::FrozenNode;

use crate::by_hand;

const CONFIG: &str = "
vehicle: { stages: none }
groups:
  - { id: power, modules: [{ id: psu, status: psu }, { id: fan, status: fan }] }
  - { id: sensors, depends_on: [power], modules: [{ id: lidar, status: lidar }, { id: radar, status: radar }] }
  - { id: base, modules: [{ id: motor, status: motor }, { id: encoder, status: encoder }] }
  - { id: cabin, modules: [{ id: lamp, status: lamp }, { id: door, status: door }] }
";
const ALL: [&str; 8] = ["psu", "fan", "lidar", "radar", "motor", "encoder", "lamp", "door"];

fn say(engine: &mut Engine, at_ms: u64, statuses: &[(&str, u8)]) {
    let mut array = StatusArray::default();
    for (name, level) in statuses {
        array.push_status(*level, name, "as it is", "");
        array.push_value("at_ms", &at_ms.to_string());
    }
    engine.handle(&Input::Diagnostics(array), Timestamp::from_millis(at_ms));
}

fn opened(changes: Vec<Change>) -> Open {
    match changes.into_iter().next_back() {
        Some(Change::Opened(open) | Change::Extended(open)) => open,
        other => panic!("{other:?}"),
    }
}

fn names(frozen: &[FrozenNode]) -> Vec<&str> {
    frozen.iter().map(|it| &*it.node).collect()
}

#[test]
fn a_freeze_frame_has_every_root_its_symptoms_and_their_groups_at_their_instants() {
    let model = by_hand::model(CONFIG);
    let mut engine = Engine::begin(model, Timestamp::ZERO);
    say(&mut engine, 100, &ALL.map(|name| (name, 0)));
    let mut tracker = Tracker::new(Margins::default(), &engine.snapshot());

    // A mark while nothing fails.
    let mark = Trigger::Mark { by: "anna".into(), note: "".into() };
    let open =
        Tracker::new(Margins::default(), &engine.snapshot()).trigger(Timestamp::from_millis(150), mark);
    assert_eq!(names(&first(&engine.snapshot(), &opened(open))).len(), ALL.len());

    say(&mut engine, 200, &[("psu", 2), ("lidar", 2), ("motor", 2), ("door", 1)]);
    let snapshot = engine.snapshot();
    let open = opened(tracker.follow(&snapshot, &[]));
    let mut frozen = first(&snapshot, &open);
    let mut roots = names(&frozen[..2]);
    roots.sort_unstable();
    assert_eq!(roots, ["base/motor", "power/psu"]);
    let rest = ["cabin/door", "sensors/lidar", "base/encoder", "cabin/lamp", "power/fan", "sensors/radar"];
    let mut found = names(&frozen[2..]);
    assert_eq!(found[..2], rest[..2], "a WARNING, then the symptom");
    found[2..].sort_unstable();
    assert_eq!(found, rest);
    let value =
        |frozen: &[FrozenNode], node: &str| frozen.iter().rfind(|it| it.node == node).unwrap().values.clone();
    assert_eq!(value(&frozen, "power/psu"), [("at_ms".to_owned(), "200".to_owned())]);
    assert_eq!(value(&frozen, "power/fan"), [("at_ms".to_owned(), "100".to_owned())]);

    // What fails later is there as it is then, and nothing twice as it was.
    say(&mut engine, 900, &[("encoder", 2)]);
    let snapshot = engine.snapshot();
    assert_eq!(opened(tracker.follow(&snapshot, &[])).triggers.len(), 3);
    let new = later(&snapshot, "base/encoder", &frozen);
    assert_eq!(names(&new), ["base/encoder"]);
    assert_eq!(value(&new, "base/encoder"), [("at_ms".to_owned(), "900".to_owned())]);
    frozen.extend(new);
    assert_eq!(later(&snapshot, "base/encoder", &frozen), []);
    assert_eq!(later(&snapshot, "base/unknown", &frozen), []);
}

#[test]
fn a_freeze_frame_is_bounded() {
    let modules: Vec<String> =
        (0..500).map(|number| format!("{{ id: m{number}, status: m{number} }}")).collect();
    let text =
        format!("vehicle: {{ stages: none }}\ngroups: [{{ id: g, modules: [{}] }}]\n", modules.join(", "));
    let model = by_hand::model(&text);
    let mut engine = Engine::begin(model, Timestamp::ZERO);
    let mut tracker = Tracker::new(Margins::default(), &engine.snapshot());
    let names: Vec<String> = (0..500).map(|number| format!("m{number}")).collect();
    let mut frozen = Vec::new();
    for at_ms in [100, 200, 300, 400] {
        let level = if at_ms % 200 == 0 { 0 } else { 2 };
        say(&mut engine, at_ms, &names.iter().map(|name| (&**name, level)).collect::<Vec<_>>());
        let snapshot = engine.snapshot();
        let changes = tracker.follow(&snapshot, &[]);
        if frozen.is_empty() {
            frozen = first(&snapshot, &opened(changes));
            assert_eq!(frozen.len(), 64);
        }
        for name in &names {
            frozen.extend(later(&snapshot, &format!("g/{name}"), &frozen));
        }
    }
    assert_eq!(frozen.len(), 128);
}
