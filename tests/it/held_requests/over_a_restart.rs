//! A restart of Telltale keeps the nodes that asked for a request, also masked ones, and latches.

use super::*;

/// `b` waits for `a` with an ERROR of its own, which asks for a deceleration.
fn with_a_masked_cause() -> Engine {
    let mut engine = Engine::new(model(MASKED), Timestamp::ZERO);
    engine.start_in(Stage::Active);
    say_of_two(&mut engine, Some((0, 0)), 0);
    say_of_two(&mut engine, Some((2, 0)), 1000);
    say_of_two(&mut engine, Some((2, 2)), 1500);
    assert!(engine.snapshot().countermeasures[0].causes.iter().any(|it| it.present));
    engine
}

const MASKED: &str = "
vehicle: { stages: none }
groups:
  - { id: a, modules: [{ id: m, status: a, timeout: 60s }] }
  - { id: b, depends_on: [a], modules: [{ id: m, status: b }] }
countermeasures:
  - { request: decelerate, mps2: 1.5, when: { groups: [a, b], state: error } }
";

/// Levels of the two, or a level of `a` alone.
fn say_of_two(engine: &mut Engine, both: Option<(u8, u8)>, millis: u64) {
    let said = match both {
        Some((a, b)) => said(&[("a", a), ("b", b)]),
        None => said(&[("a", 0)]),
    };
    engine.handle(&said, Timestamp::from_millis(millis));
}

/// The nodes that forbid a release once `a` is well again and nothing is heard of `b`.
fn forbidding(mut engine: Engine) -> (Option<bool>, bool) {
    say_of_two(&mut engine, None, 6000);
    let snapshot = engine.snapshot();
    (snapshot.hold, snapshot.countermeasures[0].latched)
}

#[test]
fn what_a_cause_masked_holds_the_vehicle_over_a_restart_and_another_rule() {
    let held = (Some(true), false);
    assert_eq!(forbidding(with_a_masked_cause()), held);
    let restored = with_a_masked_cause().snapshot().to_restore();
    let resumed = |text| Engine::resume(model(text), &restored, Timestamp::from_millis(2000));
    assert_eq!(forbidding(resumed(MASKED)), held, "after a restart");
    let stronger = MASKED.replace("1.5", "1.2");
    assert_eq!(forbidding(resumed(&stronger)), held, "after a restart with a weaker rule");
    let elsewhere = MASKED.replace("groups: [a, b], state", "groups: [a], state");
    assert_eq!(forbidding(resumed(&elsewhere)), held, "after a restart without the rule");
    for text in [&stronger, &elsewhere] {
        let mut engine = with_a_masked_cause();
        engine.reload(model(text), Timestamp::from_millis(2000));
        assert_eq!(forbidding(engine), held, "after a reload");
    }
    // Once it is heard to be well, only the release is missing.
    let mut well = resumed(MASKED);
    say_of_two(&mut well, Some((0, 0)), 6000);
    let snapshot = well.snapshot();
    assert_eq!((snapshot.hold, snapshot.countermeasures[0].latched), (Some(true), true));
}

#[test]
fn a_latched_error_stays_over_a_restart_until_it_is_reset() {
    let text = "
groups:
  - { id: brake, modules: [{ id: m, status: m, latch: 1s }, { id: n, status: n }] }
";
    let mut engine = Engine::new(model(text), Timestamp::ZERO);
    engine.start_in(Stage::Standby);
    let report = |engine: &mut Engine, m: u8, millis: u64| {
        engine.handle(&said(&[("m", m), ("n", 0)]), Timestamp::from_millis(millis));
    };
    report(&mut engine, 2, 0);
    report(&mut engine, 2, 1500);
    report(&mut engine, 0, 1600);
    let state = |engine: &mut Engine| {
        let snapshot = engine.snapshot();
        snapshot.shown(snapshot.node("brake/m").unwrap()).0
    };
    assert_eq!(state(&mut engine), State::Error, "it is latched");
    let restored = engine.snapshot().to_restore();
    let mut resumed = Engine::resume(model(text), &restored, Timestamp::from_millis(2000));
    assert_eq!(state(&mut resumed), State::Error, "before anything is heard");
    report(&mut resumed, 0, 2100);
    assert_eq!(state(&mut resumed), State::Error);
    let reset = Input::Operator(OperatorAction::Reset { module: "brake/m".into() });
    resumed.handle(&reset, Timestamp::from_millis(2200));
    assert_eq!(state(&mut resumed), State::Ok);
    // Without a latch in the configuration there is none to reset.
    let without = text.replace(", latch: 1s", "");
    let mut resumed = Engine::resume(model(&without), &restored, Timestamp::from_millis(2000));
    report(&mut resumed, 0, 2100);
    assert_eq!(state(&mut resumed), State::Ok);
}
