//! Statuses that were lost at first, or waited in a queue, count from when they should have come.

use telltale::engine::Engine;
use telltale::engine::input::Input;
use telltale::engine::model::sample::{FieldValue, Sample};
use telltale::engine::state::State;
use telltale::engine::time::{Span, Timestamp};

use crate::by_hand::{model, said};

const CONFIG: &str = "
vehicle: { stages: none }
groups:
  - { id: g, modules: [{ id: m, status: m, timeout: 2s }] }
";

/// Takes a report that came so many milliseconds late, and what the module shows then.
fn late(engine: &mut Engine, level: u8, late_ms: u64, now_ms: u64) -> State {
    let Input::Diagnostics(array) = said(&[("m", level)]) else { unreachable!("it is an array") };
    let input = Input::Diagnostics(array.received_late(Span::from_millis(late_ms)));
    engine.handle(&input, Timestamp::from_millis(now_ms));
    shown(engine)
}

fn at(engine: &mut Engine, now_ms: u64) -> State {
    engine.handle(&Input::Tick, Timestamp::from_millis(now_ms));
    shown(engine)
}

fn shown(engine: &mut Engine) -> State {
    let snapshot = engine.snapshot();
    snapshot.shown(snapshot.node("g/m").unwrap()).0
}

#[test]
fn a_report_that_is_older_than_the_timeout_ends_no_silence_but_its_error_counts() {
    let mut engine = Engine::new(model(CONFIG), Timestamp::ZERO);
    assert_eq!(late(&mut engine, 0, 0, 0), State::Ok);
    assert_eq!(at(&mut engine, 3000), State::Unknown);
    for now_ms in [8000, 8001, 8400] {
        assert_eq!(late(&mut engine, 0, 5000, now_ms), State::Unknown, "at {now_ms}");
    }
    assert_eq!(late(&mut engine, 2, 5000, 9000), State::Error);
    assert_eq!(at(&mut engine, 9500), State::Error, "what is worse than a silence stays");
    // One that is younger ends it, for the rest of the timeout.
    assert_eq!(late(&mut engine, 0, 1500, 10_000), State::Ok);
    assert_eq!([10_499, 10_501].map(|ms| at(&mut engine, ms)), [State::Ok, State::Unknown]);
}

#[test]
fn a_report_from_before_the_start_of_the_program_ends_no_silence() {
    let mut engine = Engine::new(model(CONFIG), Timestamp::ZERO);
    for now_ms in [1000, 1100] {
        assert_eq!(late(&mut engine, 0, 9000, now_ms), State::Unknown, "at {now_ms}");
    }
    assert_eq!(late(&mut engine, 1, 9000, 1200), State::Unknown);
    assert_eq!(late(&mut engine, 0, 0, 1300), State::Ok);
    // And takes nothing from a report that came in time.
    assert_eq!(late(&mut engine, 1, 9000, 1400), State::Warning);
}

#[test]
fn a_late_report_takes_nothing_from_one_that_came_in_time() {
    let mut engine = Engine::new(model(CONFIG), Timestamp::ZERO);
    assert_eq!(late(&mut engine, 0, 0, 1000), State::Ok);
    assert_eq!(late(&mut engine, 0, 5000, 1100), State::Ok);
    assert_eq!([2999, 3001].map(|ms| at(&mut engine, ms)), [State::Ok, State::Unknown]);
}

const MONITORS: &str = "
vehicle: { stages: none }
groups:
  - id: g
    modules:
      - { id: level, timeout: 2s, monitor: { value: { topic: /fuel, type: std_msgs/msg/Float64, field: data, error_below: 10 } } }
      - { id: rate, monitor: { frequency: { topic: /fuel, type: std_msgs/msg/Float64, window: 1s, error_below: 3 } } }
      - { id: key, timeout: 2s, monitor: { value: { status: m, key: volt, error_below: 10 } } }
";

#[test]
fn values_rates_and_keys_of_late_messages_are_as_old_as_they_are() {
    let model = model(MONITORS);
    let mut engine = Engine::new(model.clone(), Timestamp::ZERO);
    let source = model.watched.topics[0].clone();
    let mut hear = |late_ms: u64, now_ms: u64| {
        let (delay, values) = (Span::from_millis(late_ms), [FieldValue::Number(50.0)].into());
        let source = source.clone();
        let sample = Sample { source, stamp_ns: None, received_wall_ns: 0, late: false, delay, values };
        let Input::Diagnostics(mut array) = said(&[("m", 0)]) else { unreachable!("it is an array") };
        array.push_value("volt", "12");
        for input in [Input::Sample(sample), Input::Diagnostics(array.received_late(delay))] {
            engine.handle(&input, Timestamp::from_millis(now_ms));
        }
        let snapshot = engine.snapshot();
        ["level", "rate", "key"].map(|id| snapshot.shown(snapshot.node(&format!("g/{id}")).unwrap()).0)
    };
    let in_time: Vec<_> = (0..20).map(|at| hear(0, at * 200)).collect();
    assert_eq!(in_time.last(), Some(&[State::Ok; 3]));
    // The last ones of a node that has hung since 4 s; all come again at 10 s.
    for at in 0..5 {
        let states = hear(6000 - at * 200, 10_000 + at);
        assert!(states.iter().all(|state| *state != State::Ok), "{states:?}");
    }
}

#[test]
fn a_late_report_gives_a_silence_no_time_to_rise_again() {
    let config = CONFIG.replace("timeout: 2s", "timeout: 2s, stale: error, raise_after: 3s");
    let mut engine = Engine::new(model(&config), Timestamp::ZERO);
    late(&mut engine, 0, 0, 0);
    assert_eq!(at(&mut engine, 6000), State::Error);
    assert_eq!(late(&mut engine, 0, 5000, 8000), State::Error);
    assert_eq!([8100, 12_000].map(|ms| at(&mut engine, ms)), [State::Error; 2]);
    // The first one that is heard at all.
    let mut engine = Engine::new(model(CONFIG), Timestamp::ZERO);
    assert_eq!(late(&mut engine, 0, 5000, 10_000), State::Unknown);
}
