//! A module's message is recorded when its state changes.

use telltale::engine::Engine;
use telltale::engine::event::EventKind;
use telltale::engine::input::{Input, StatusArray};
use telltale::engine::model::NodeId;
use telltale::engine::state::State;
use telltale::engine::time::Timestamp;
use telltale::engine::view::record::{Record, Recorded};

use crate::by_hand;

const CONFIG: &str = "
vehicle: { stages: none }
groups:
  - id: sensors
    modules: [{ id: camera, status: camera, timeout: 1s, stale: error }]
  - id: perception
    depends_on: [sensors]
    modules: [{ id: objects, status: objects, timeout: 10s }]
";

/// Reports a level, or lets time pass; then tells what was recorded of a module, in words.
fn told(engine: &mut Engine, node: &str, level: Option<(&str, u8, &str)>, millis: u64) -> Vec<String> {
    let input = level.map_or(Input::Tick, |(name, level, message)| {
        let mut array = StatusArray::default();
        array.push_status(level, name, message, "");
        Input::Diagnostics(array)
    });
    engine.handle(&input, Timestamp::from_millis(millis));
    let events = engine.take_events();
    let snapshot = engine.snapshot();
    let records = events.into_iter().filter_map(|event| Record::of(event, &snapshot));
    words(records.collect(), node)
}

/// `error: what was said` for each record of a node.
fn words(records: Vec<Record>, node: &str) -> Vec<String> {
    let of_node = |record: Record| match record.what {
        Recorded::Shown { node: of, state, said, .. } if *of == *node => {
            Some(format!("{state}: {}", said.as_ref().map(|said| said.words()).unwrap_or_default()))
        }
        _ => None,
    };
    records.into_iter().filter_map(of_node).collect()
}

#[test]
fn a_silence_and_a_reported_error_are_recorded_in_their_words() {
    let model = by_hand::model(CONFIG);
    let mut engine = Engine::new(model, Timestamp::ZERO);
    engine.keep_events();
    let camera = "sensors/camera";
    let ok = Some(("camera", 0, "Images arrive"));
    assert_eq!(told(&mut engine, camera, ok, 0), ["ok: Images arrive"]);
    // It was silent and is heard again before anybody takes a snapshot: its silence counts from there.
    engine.handle(
        &{
            let mut array = StatusArray::default();
            array.push_status(0, "camera", "Images arrive", "");
            Input::Diagnostics(array)
        },
        Timestamp::from_millis(5000),
    );
    let silent = "error: silent for 1 s; last: Images arrive";
    assert_eq!(told(&mut engine, camera, None, 7000), [silent, "ok: Images arrive", silent]);
    assert_eq!(told(&mut engine, camera, ok, 9000), ["ok: Images arrive"]);
    assert_eq!(told(&mut engine, camera, Some(("camera", 2, "no picture")), 9500), ["error: no picture"]);

    // Behind an IGNORE it is recorded too.
    let objects = "perception/objects";
    assert_eq!(
        told(&mut engine, objects, Some(("objects", 2, "nothing seen")), 9600),
        ["ignore: nothing seen"]
    );

    // The first records of a history contain the message of the present state.
    let present = Record::present(&engine.snapshot(), true);
    assert_eq!(words(present.clone(), camera), ["error: no picture"]);
    assert_eq!(words(present, "sensors"), ["error: "]);
}

#[test]
fn an_input_that_is_too_old_is_said_once() {
    const MONITORS: [&str; 2] = [
        "expression: { inputs: { x: { status: s, key: v } }, max_age: 1s, error: 'x > 3' }",
        "agreement: { a: { status: s, key: v }, b: { status: s, key: w }, max_age: 1s, error_above: 3 }",
    ];
    for monitor in MONITORS {
        let text = format!(
            "vehicle: {{ stages: none }}\ngroups:\n  - {{ id: a, modules: [{{ id: m, timeout: 3s, stale: error, monitor: {{ {monitor} }} }}] }}\n"
        );
        let model = by_hand::model(&text);
        let mut engine = Engine::new(model, Timestamp::ZERO);
        engine.keep_events();
        let mut says = |input: Input, millis: u64| {
            let now = Timestamp::from_millis(millis);
            engine.handle(&input, now);
            let snapshot = engine.snapshot();
            let Some(NodeId::Module(id)) = snapshot.node("a/m") else { panic!("it is there") };
            (snapshot.module(id).1.says(now).into_owned(), engine.take_events())
        };
        let mut array = StatusArray::default();
        array.push_status(0, "s", "", "");
        array.push_value("v", "1");
        array.push_value("w", "1");
        says(Input::Diagnostics(array), 0);
        let (old, _) = says(Input::Tick, 2000);
        assert!(old.contains("s: v") && old.ends_with("older than 1 s"), "{old}");
        // Its silence is more than that, and it is said of the whole module.
        let (silent, events) = says(Input::Tick, 3000);
        assert_eq!(silent, "silent for 3 s");
        let said = events.iter().find_map(|event| match &event.what {
            EventKind::Shown { to: State::Error, said: Some(said), .. } => Some(said.words().into_owned()),
            _ => None,
        });
        assert_eq!(said.as_deref(), Some("silent for 3 s"), "{events:?}");
    }
}
