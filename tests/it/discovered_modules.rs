//! Discovered modules: they appear, leave when they are silent for too long, and appear again.

use std::sync::Arc;

use telltale::engine::Engine;
use telltale::engine::event::EventKind;
use telltale::engine::input::{AlarmRef, Input, OperatorAction};
use telltale::engine::model::NodeId;
use telltale::engine::snapshot::Snapshot;
use telltale::engine::state::State;
use telltale::engine::time::Timestamp;
use telltale::engine::view::record::{Record, Recorded};

use crate::by_hand::{alarms, model, said};

const CONFIG: &str = "
vehicle: { stages: none }
limits: { discovered_modules: 50 }
groups:
  - id: sensors
    match: [{ namespace: /sensors, timeout: 1s, stale: error, forget_after: 2s }, { namespace: /fixed }]
    modules: [{ id: own, status: own }]
  - { id: all, match: [{ contains: both, forget_after: 10s }] }
";

fn at(millis: u64) -> Timestamp {
    Timestamp::from_millis(millis)
}

fn report(engine: &mut Engine, statuses: &[(&str, u8)], millis: u64) -> Arc<Snapshot> {
    engine.handle(&said(statuses), at(millis));
    engine.snapshot()
}

fn tick(engine: &mut Engine, millis: u64) -> Arc<Snapshot> {
    engine.handle(&Input::Tick, at(millis));
    engine.snapshot()
}

fn names(snapshot: &Snapshot) -> Vec<String> {
    let discovered = snapshot.module_ids().filter(|&id| snapshot.module(id).0.discovered);
    let mut names: Vec<String> = discovered.map(|id| snapshot.module(id).0.id.to_string()).collect();
    names.retain(|name| !name.ends_with("(names past the limit)"));
    names.sort_unstable();
    names
}

#[test]
fn a_silent_module_leaves_with_a_record_and_its_name_may_come_again() {
    let mut engine = Engine::new(model(CONFIG), Timestamp::ZERO);
    engine.keep_events();
    report(&mut engine, &[("own", 0), ("/sensors/trailer", 2), ("/fixed/x", 0)], 0);
    let before = tick(&mut engine, 1999);
    assert_eq!(names(&before), ["sensors//fixed/x", "sensors//sensors/trailer"]);
    engine.take_events();
    let after = tick(&mut engine, 2000);
    assert_eq!(names(&after), ["sensors//fixed/x"]);
    assert_eq!(after.node("sensors//sensors/trailer"), None);
    let events = engine.take_events();
    assert!(events.iter().any(|it| matches!(it.what, EventKind::AlarmCleared { id: 1, .. })));
    let records: Vec<Recorded> =
        events.into_iter().filter_map(|event| Record::of(event, &after)).map(|it| it.what).collect();
    let left = Recorded::Left { node: "sensors//sensors/trailer".into() };
    assert_eq!(records.iter().filter(|it| **it == left).count(), 1);
    // The alarm is over, and it is listed by its name until somebody acknowledges it.
    assert_eq!(alarms(&after), [(1, "sensors//sensors/trailer".into(), false)]);
    // It comes again, healthy, under its old name, and the past one is still of it.
    let again = report(&mut engine, &[("/sensors/trailer", 0), ("own", 0)], 2500);
    assert_eq!(names(&again), ["sensors//fixed/x", "sensors//sensors/trailer"]);
    assert_eq!(alarms(&again).len(), 1);
    let Some(NodeId::Module(id)) = again.node("sensors//sensors/trailer") else { panic!("it is there") };
    assert_eq!((again.module(id).1.own, &*again.module(id).1.report.message), (State::Ok, "said"));
    let acknowledge = OperatorAction::Acknowledge { alarm: AlarmRef::Number(1) };
    engine.handle(&Input::Operator(acknowledge), at(2600));
    assert_eq!(alarms(&engine.snapshot()), []);
}

#[test]
fn names_without_end_take_no_memory_and_no_room() {
    let mut engine = Engine::new(model(CONFIG), Timestamp::ZERO);
    let mut most = 0;
    for round in 0..3000_u64 {
        // Each is in ERROR once: an alarm, which nobody acknowledges, when it leaves.
        let name = format!("/sensors/{round}");
        let snapshot = report(&mut engine, &[(&name, 2), ("own", 0)], round * 100);
        assert!(snapshot.node(&format!("sensors/{name}")).is_some(), "{round}: there is room");
        assert!(names(&snapshot).len() <= 21);
        most = most.max(snapshot.modules.len());
    }
    let snapshot = engine.snapshot();
    assert_eq!(snapshot.counters.dropped_names, 0);
    // The present modules, and those that an alarm refers to.
    assert!(most <= 8 + 21 + 256 + 8, "{most}");
    let alarms = alarms(&snapshot);
    assert!(alarms.iter().all(|(id, name, _)| *name == format!("sensors//sensors/{}", id - 1)), "{alarms:?}");
}

#[test]
fn a_name_leaves_each_group_in_its_own_time_and_comes_back_to_each() {
    let mut engine = Engine::new(model(CONFIG), Timestamp::ZERO);
    let name = "/sensors/both";
    report(&mut engine, &[(name, 0)], 0);
    let (one, other) = ("all//sensors/both", "sensors//sensors/both");
    assert_eq!(names(&tick(&mut engine, 5000)), [one]);
    // Another configuration, or the same one, brings nothing back that left.
    engine.reload(model(CONFIG), at(5000));
    assert_eq!(names(&engine.snapshot()), [one]);
    assert_eq!(names(&report(&mut engine, &[(name, 0)], 6000)), [one, other]);
    assert_eq!(names(&tick(&mut engine, 20_000)), [""; 0]);
}

#[test]
fn room_that_becomes_free_is_given_to_whom_it_was_refused() {
    let text = CONFIG.replace("discovered_modules: 50", "discovered_modules: 1");
    let mut engine = Engine::new(model(&text), Timestamp::ZERO);
    let both = [("/sensors/a", 0), ("/sensors/b", 0)];
    assert_eq!(names(&report(&mut engine, &both, 0)), ["sensors//sensors/a"]);
    report(&mut engine, &both[1..], 1000);
    assert_eq!(names(&report(&mut engine, &both[1..], 2000)), ["sensors//sensors/b"]);
}

#[test]
fn a_restart_and_a_reload_keep_the_alarms_of_what_left_and_make_nothing_of_it() {
    let mut engine = Engine::new(model(CONFIG), Timestamp::ZERO);
    report(&mut engine, &[("/sensors/gone", 2), ("/sensors/lost", 2), ("own", 0)], 0);
    let before = report(&mut engine, &[("/sensors/there", 2), ("own", 0)], 2500);
    let expected = [
        (1, "sensors//sensors/gone".to_owned(), false),
        (2, "sensors//sensors/lost".to_owned(), false),
        (3, "sensors//sensors/there".to_owned(), true),
    ];
    assert_eq!(alarms(&before), expected);
    let mut resumed = Engine::resume(model(CONFIG), &before.to_restore(), at(2600));
    engine.reload(model(CONFIG), at(2600));
    for engine in [&mut engine, &mut resumed] {
        let after = engine.snapshot();
        assert_eq!(alarms(&after), expected);
        assert_eq!(names(&after), ["sensors//sensors/there"]);
        // A module that is not heard after a restart either is not kept for ever.
        let later = tick(engine, 9000);
        assert_eq!(names(&later), [""; 0]);
        assert!(alarms(&later).iter().all(|(_, _, active)| !active));
    }
}

#[test]
fn a_stray_that_no_group_takes_leaves_as_the_defaults_say() {
    let text = format!("defaults: {{ forget_after: 3s }}\nother: counted{CONFIG}");
    let mut engine = Engine::new(model(&text), Timestamp::ZERO);
    let there = report(&mut engine, &[("stray", 2), ("own", 0)], 0);
    assert_eq!((names(&there), alarms(&there).len()), (vec!["other/stray".to_owned()], 1));
    assert_eq!(names(&tick(&mut engine, 2999)), ["other/stray"]);
    let gone = tick(&mut engine, 3000);
    assert_eq!(names(&gone), [""; 0]);
    assert!(alarms(&gone).iter().all(|(_, _, active)| !active));
    // A declared module is expected: it stays and is stale.
    let Some(NodeId::Module(own)) = gone.node("sensors/own") else { panic!("it is there") };
    assert!(gone.module(own).1.silent);
}

#[test]
fn a_reload_gives_no_place_away_and_keeps_what_was_refused() {
    let text = CONFIG.replace("discovered_modules: 50", "discovered_modules: 2");
    let mut engine = Engine::new(model(&text), Timestamp::ZERO);
    // It leaves one of its two groups, and another name takes the room.
    let both = "/sensors/both";
    report(&mut engine, &[(both, 0)], 0);
    assert_eq!(names(&tick(&mut engine, 3000)), ["all//sensors/both"]);
    let there = ["all//sensors/both", "sensors//fixed/x"];
    assert_eq!(names(&report(&mut engine, &[("/fixed/x", 2)], 3100)), there);
    report(&mut engine, &[("/fixed/y", 0)], 3200);
    let before = engine.snapshot();
    engine.reload(model(&text), at(3300));
    let after = engine.snapshot();
    assert_eq!(names(&after), there);
    let words = |snapshot: &Snapshot| {
        let Some(NodeId::Module(id)) = snapshot.node("sensors/(names past the limit)") else { return None };
        let view = snapshot.module(id).1;
        Some((view.state, view.report.message.clone()))
    };
    assert!(matches!(words(&before), Some((State::Warning, _))));
    assert_eq!(words(&after), words(&before), "one status was refused, and is still");
    // It counts on from there, and a larger limit is a new beginning.
    let more = report(&mut engine, &[("/fixed/y", 0)], 3400);
    assert!(words(&more).is_some_and(|(_, said)| said.starts_with("2 statuses")), "{:?}", words(&more));
    engine.reload(model(CONFIG), at(3500));
    assert_eq!(words(&engine.snapshot()), None);
}

#[test]
fn a_name_that_stands_elsewhere_in_its_array_than_before_is_found_all_the_same() {
    let mut engine = Engine::new(model(CONFIG), Timestamp::ZERO);
    let states = |engine: &mut Engine, statuses: &[(&str, u8)], millis| {
        let snapshot = report(engine, statuses, millis);
        let state = |id| (snapshot.module(id).0.id.to_string(), snapshot.module(id).1.state);
        let discovered = snapshot.module_ids().filter(|&id| snapshot.module(id).0.discovered);
        discovered.map(state).map(|(name, state)| format!("{name} {state}")).collect::<Vec<_>>()
    };
    let (a, b, c) = ("sensors//sensors/a", "/fixed/b", "/fixed/c");
    let first = states(&mut engine, &[("/sensors/a", 0), (b, 0), (c, 0)], 0);
    assert_eq!(first, [format!("{a} ok"), format!("sensors/{b} ok"), format!("sensors/{c} ok")]);
    let turned = states(&mut engine, &[(c, 2), ("/sensors/a", 0), (b, 1)], 10);
    assert_eq!(turned, [format!("{a} ok"), format!("sensors/{b} warning"), format!("sensors/{c} error")]);
    // Where it stood, one stands that left meanwhile, and one without a name.
    tick(&mut engine, 2010);
    let left = states(&mut engine, &[(c, 0), ("", 2), (b, 0)], 2020);
    assert_eq!(left, [format!("sensors/{b} ok"), format!("sensors/{c} ok"), "other/ error".to_owned()]);
}
