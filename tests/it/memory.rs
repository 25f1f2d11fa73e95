//! The texts of statuses are bounded in bytes; their states do not depend on it.

use std::sync::Arc;
use std::time::UNIX_EPOCH;

use telltale::engine::Engine;
use telltale::engine::input::{Input, OperatorAction, StatusArray, WriterId};
use telltale::engine::snapshot::Snapshot;
use telltale::engine::state::State;
use telltale::engine::time::Timestamp;
use telltale::runtime::Published;
use telltale::web::live::frame::Frames;

use crate::by_hand;

const TEXT: &str = "
vehicle: { stages: none }
defaults: { timeout: 1h }
limits: { discovered_modules: 4096 }
groups:
- id: a
  modules:
  - { id: honest, status: honest }
  - { id: heat, monitor: { value: { status: flood 7, key: key 15, error_above: 90 } } }
- { id: b, match: [{ contains: flood }] }
";

const BUDGET: u64 = 64 << 20;

fn say(engine: &mut Engine, writer: u8, level: u8, name: &str, values: usize, value: &str) {
    let mut array = StatusArray::default();
    array.push_status(level, name, &format!("message of {name}"), "hardware");
    for number in 0..values {
        array.push_value(&format!("key {number}"), value);
    }
    let input = Input::Diagnostics(array.said_by(WriterId([writer; 16])));
    engine.handle(&input, Timestamp::from_millis(10));
}

fn held(snapshot: &Snapshot) -> u64 {
    let text = |report: &telltale::engine::snapshot::Report| {
        let values = report.values.iter().map(|(key, value)| key.len() + value.len());
        (report.message.len() + report.hardware_id.len() + values.sum::<usize>()) as u64
    };
    snapshot.module_ids().map(|id| text(&snapshot.module(id).1.report)).sum()
}

fn view(snapshot: &Snapshot, name: &str) -> telltale::engine::snapshot::ModuleView {
    let id = snapshot.module_ids().find(|&id| *snapshot.module(id).0.id == *name).expect("it is there");
    snapshot.module(id).1.clone()
}

#[test]
fn a_flood_of_long_values_takes_no_more_than_its_share_and_hides_no_state() {
    let mut engine = Engine::new(by_hand::model(TEXT), Timestamp::ZERO);
    engine.handle(&Input::Operator(OperatorAction::Login { name: "dev".into() }), Timestamp::ZERO);
    say(&mut engine, 1, 1, "honest", 3, "12.5");
    // 4,096 names with 128 kB each, from two writers: half a GB.
    let value = format!("95.{}", "0".repeat(3997));
    for number in 0..4096_u32 {
        let writer = if number % 2 == 0 { 2 } else { 3 };
        let level = if number == 9 { 2 } else { 0 };
        say(&mut engine, writer, level, &format!("flood {number}"), 32, &value);
    }
    let snapshot = engine.snapshot();
    assert!(held(&snapshot) <= BUDGET, "{}", held(&snapshot));
    assert!(snapshot.counters.status_bytes <= BUDGET && snapshot.counters.status_bytes > BUDGET / 4);
    let honest = view(&snapshot, "a/honest");
    assert_eq!((honest.own, honest.report.values.len(), honest.report.cut), (State::Warning, 3, 0));
    for number in [0, 9, 2000, 4095] {
        let view = view(&snapshot, &format!("b/flood {number}"));
        assert_eq!(view.own, if number == 9 { State::Error } else { State::Ok });
        assert_eq!(&*view.report.message, format!("message of flood {number}"));
        assert!(view.report.cut > 100_000, "{number} is cut by {}", view.report.cut);
    }
    // A monitor reads the received values, not the kept ones.
    assert_eq!(view(&snapshot, "a/heat").own, State::Error);
    let memory = view(&snapshot, "telltale/memory");
    assert_eq!(memory.own, State::Warning);
    assert!(memory.report.message.contains("limits.status_bytes is 67108864"), "{}", memory.report.message);

    let published = Published::recorded(snapshot.clone(), UNIX_EPOCH);
    let json = Frames::default().json(&published);
    assert!(json.as_str().len() < 16 << 20, "{}", json.as_str().len());
    let answer: serde_json::Value = serde_json::from_str(json.as_str()).unwrap();
    assert_eq!(answer["left_out"], "values");

    // A repeated status changes nothing that is shown.
    let revision = engine.revision();
    say(&mut engine, 2, 0, "flood 2000", 32, &value);
    assert_eq!(engine.revision(), revision);

    // The flood ends: the next status is complete again.
    for number in 0..4096_u32 {
        say(&mut engine, 2 + (number % 2) as u8, 0, &format!("flood {number}"), 1, "1");
    }
    let snapshot: Arc<Snapshot> = engine.snapshot();
    assert_eq!((snapshot.counters.cut_statuses, view(&snapshot, "telltale/memory").own), (0, State::Ok));
    let published = Published::recorded(snapshot, UNIX_EPOCH);
    let answer: serde_json::Value =
        serde_json::from_str(Frames::default().json(&published).as_str()).unwrap();
    assert_eq!(answer.get("left_out"), None);
}

#[test]
fn one_writer_takes_no_more_than_its_share() {
    let text = TEXT.replace("limits: { ", "limits: { status_bytes: 1000000, source_bytes: 200000, ");
    let mut engine = Engine::new(by_hand::model(&text), Timestamp::ZERO);
    for number in 0..20 {
        say(&mut engine, 2, 0, &format!("flood {number}"), 10, &"9".repeat(4000));
    }
    let snapshot = engine.snapshot();
    assert!(held(&snapshot) <= 200_000, "{}", held(&snapshot));
    assert_eq!(view(&snapshot, "telltale/memory").own, State::Warning);
    // What was cut stays so over a reload, and so does its writer.
    engine.reload(by_hand::model(&text), Timestamp::from_millis(20));
    let after = engine.snapshot();
    assert_eq!(after.counters, snapshot.counters);
    assert_eq!(view(&after, "telltale/memory").own, State::Warning);
}
