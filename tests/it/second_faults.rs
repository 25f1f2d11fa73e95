//! Second faults over restarts and reloads: what was shown before stays shown, and what was explained stays so.

use telltale::engine::Engine;
use telltale::engine::model::NodeId;
use telltale::engine::snapshot::Snapshot;
use telltale::engine::state::State;
use telltale::engine::time::Timestamp;

use crate::by_hand::{model, said};

const CONFIG: &str = "
vehicle: { stages: none }
defaults: { timeout: 1000s }
groups:
  - { id: a, modules: [{ id: m, status: a }] }
  - { id: b, depends_on: [a], modules: [{ id: old, status: b_old }, { id: new, status: b_new }] }
";

const SEEN: [&str; 3] = ["a/m", "b/old", "b/new"];

fn at(seconds: u64) -> Timestamp {
    Timestamp::from_millis(1000 * seconds)
}

/// Levels of the three statuses.
fn report(engine: &mut Engine, levels: [u8; 3], seconds: u64) {
    let [a, old, new] = levels;
    engine.handle(&said(&[("a", a), ("b_old", old), ("b_new", new)]), at(seconds));
}

/// What the three modules show, and the nodes of the active alarms with their numbers.
fn shown(snapshot: &Snapshot) -> ([State; 3], Vec<(u64, String)>) {
    let state = |name| snapshot.shown(snapshot.node(name).unwrap()).0;
    let active = snapshot.alarms.iter().filter(|alarm| alarm.active);
    (SEEN.map(state), active.map(|it| (it.id, snapshot.node_name(it.node).to_string())).collect())
}

/// `b/old` failed a minute before `a`, and `b/new` with it.
fn with_two_faults() -> Engine {
    let mut engine = Engine::new(model(CONFIG), at(0));
    report(&mut engine, [0, 0, 0], 0);
    report(&mut engine, [0, 2, 0], 10);
    report(&mut engine, [2, 2, 0], 70);
    report(&mut engine, [2, 2, 2], 71);
    engine
}

fn both() -> ([State; 3], Vec<(u64, String)>) {
    let alarms = vec![(1, "b/old".to_owned()), (2, "a/m".to_owned())];
    ([State::Error, State::Error, State::Ignore], alarms)
}

#[test]
fn what_was_shown_before_a_restart_is_no_consequence_of_what_is_heard_with_it() {
    let mut engine = with_two_faults();
    assert_eq!(shown(&engine.snapshot()), both());
    let stored = engine.snapshot().to_restore();
    let mut resumed = Engine::resume(model(CONFIG), &stored, at(75));
    report(&mut resumed, [2, 2, 2], 76);
    assert_eq!(shown(&resumed.snapshot()), both());
    // The ERROR from before ended: one that comes now follows from what it waits for.
    report(&mut resumed, [2, 0, 2], 77);
    report(&mut resumed, [2, 2, 2], 78);
    let (states, alarms) = shown(&resumed.snapshot());
    assert_eq!(states, [State::Error, State::Ignore, State::Ignore]);
    assert_eq!(alarms, [(2, "a/m".to_owned())]);
}

#[test]
fn a_reload_keeps_when_everything_began() {
    let mut engine = with_two_faults();
    engine.reload(model(CONFIG), at(75));
    report(&mut engine, [2, 2, 2], 76);
    assert_eq!(shown(&engine.snapshot()), both());
    // With another limit the same times count: they are a minute apart.
    engine.reload(model(&CONFIG.replace("depends_on: [a]", "depends_on: [{ on: a, within: 2m }]")), at(77));
    let ([_, old, new], _) = shown(&engine.snapshot());
    assert_eq!((old, new), (State::Ignore, State::Ignore));
}

#[test]
fn a_root_says_whether_it_is_a_second_fault() {
    let snapshot = with_two_faults().snapshot();
    let second = |name: &str| {
        let node: NodeId = snapshot.node(name).unwrap();
        snapshot.roots.iter().find(|root| root.node == node).map(|root| root.second)
    };
    assert_eq!(SEEN.map(second), [Some(false), Some(true), None]);
}
