//! What a snapshot says of shelved modules, and what outlives a keyframe, a reload and a restart.

use telltale::engine::Engine;
use telltale::engine::input::{Input, OperatorAction, Refusal, Response};
use telltale::engine::keyframe::Keyframe;
use telltale::engine::model::Stage;
use telltale::engine::model::sample::{FieldValue, Sample};
use telltale::engine::react::shelves::SHELVED_MAX;
use telltale::engine::snapshot::Snapshot;
use telltale::engine::state::State;
use telltale::engine::time::Span;

use crate::by_hand::{Vehicle, alarms};

const CONFIG: &str = "
vehicle: { stages: none }
motion: { speed: { topic: /speed, type: std_msgs/msg/Float64, timeout: 10s } }
groups:
  - { id: base, modules: [{ id: imu, status: imu }, { id: fan, status: fan }] }
  - { id: also, modules: [{ id: imu, status: imu }] }
";

/// A machine that stands, with a fault of its IMU.
fn standing() -> Vehicle {
    let mut vehicle = Vehicle::of(CONFIG, Stage::Active);
    vehicle.report(&[("imu", 2), ("fan", 0)]);
    speed(&mut vehicle, 0.0);
    vehicle.pass(Span::from_secs(1));
    vehicle
}

fn speed(vehicle: &mut Vehicle, mps: f64) {
    let source = vehicle.model.watched.topics[0].clone();
    let values = [FieldValue::Number(mps)].into();
    let sample = Sample::of(source, values);
    vehicle.input(&Input::Sample(sample));
}

fn shelve(vehicle: &mut Vehicle, module: &str) -> Response {
    let lasts = Span::from_secs(3600);
    vehicle.does(OperatorAction::Shelve { module: module.into(), lasts, by: "dev".into() })
}

fn shelved(snapshot: &Snapshot) -> Vec<(String, String)> {
    let named = |it: &telltale::engine::snapshot::Shelved| {
        (snapshot.module(it.module).0.id.to_string(), it.by.to_string())
    };
    snapshot.shelved.iter().map(named).collect()
}

fn by_dev(modules: &[&str]) -> Vec<(String, String)> {
    modules.iter().map(|it| ((*it).to_owned(), "dev".to_owned())).collect()
}

#[test]
fn one_status_is_shelved_in_all_its_groups_and_shows_what_it_says() {
    let mut vehicle = standing();
    assert_eq!(vehicle.look().alarms.len(), 2);
    assert_eq!(shelve(&mut vehicle, "base/imu"), Response::Done);
    let shown = vehicle.look();
    assert_eq!(shelved(&shown), by_dev(&["base/imu", "also/imu"]));
    assert_eq!(alarms(&shown), []);
    for name in ["base/imu", "also/imu", "base", "also"] {
        assert_eq!(shown.shown(shown.node(name).unwrap()), (State::Error, None), "{name}");
    }
    assert_eq!(shown.roots.len(), 2);
}

#[test]
fn a_fault_that_comes_later_calls_nobody_and_others_do() {
    let mut vehicle = standing();
    vehicle.report(&[("imu", 0), ("fan", 0)]);
    shelve(&mut vehicle, "base/imu");
    vehicle.report(&[("imu", 2), ("fan", 2)]);
    let shown = vehicle.look();
    let active: Vec<_> = alarms(&shown).into_iter().filter(|(_, _, active)| *active).collect();
    assert_eq!(active, [(3, "base/fan".to_owned(), true)]);
}

#[test]
fn a_keyframe_goes_on_with_it_and_ends_it_in_time() {
    let mut vehicle = standing();
    shelve(&mut vehicle, "base/imu");
    let text = serde_json::to_string(&vehicle.engine.keyframe()).unwrap();
    let keyframe: Keyframe = serde_json::from_str(&text).unwrap();
    vehicle.engine = Engine::from_keyframe(vehicle.model.clone(), &keyframe).unwrap();
    assert_eq!(shelved(&vehicle.look()), by_dev(&["base/imu", "also/imu"]));
    for _ in 0..3600 {
        vehicle.report(&[("imu", 2), ("fan", 0)]);
        speed(&mut vehicle, 0.0);
        vehicle.pass(Span::from_secs(1));
    }
    let shown = vehicle.look();
    assert_eq!(shelved(&shown), []);
    assert_eq!(shown.alarms.len(), 2);
}

#[test]
fn after_a_restart_and_after_a_reload_nothing_is_shelved() {
    let mut vehicle = standing();
    shelve(&mut vehicle, "base/imu");
    vehicle.reload(CONFIG);
    let shown = vehicle.look();
    assert_eq!(shelved(&shown), []);
    assert_eq!(shown.alarms.len(), 2);
    shelve(&mut vehicle, "base/imu");
    assert_eq!(shelved(&vehicle.look()).len(), 2);
    vehicle.restart(CONFIG);
    vehicle.report(&[("imu", 2), ("fan", 0)]);
    let shown = vehicle.look();
    assert_eq!(shelved(&shown), []);
    assert_eq!(shown.alarms.iter().filter(|it| it.active && !it.acknowledged).count(), 2);
}

#[test]
fn so_many_modules_are_shelved_and_no_more() {
    let modules: String = (0..=SHELVED_MAX).map(|it| format!("{{ id: m{it}, status: s{it} }}, ")).collect();
    let config = format!(
        "vehicle: {{ stages: none }}\nmotion: {{ speed: {{ topic: /speed, type: std_msgs/msg/Float64 }} }}\n\
         groups: [{{ id: g, modules: [{modules}] }}]\n"
    );
    let mut vehicle = Vehicle::of(&config, Stage::Active);
    speed(&mut vehicle, 0.0);
    vehicle.pass(Span::from_millis(600));
    for index in 0..SHELVED_MAX {
        assert_eq!(shelve(&mut vehicle, &format!("g/m{index}")), Response::Done);
    }
    // Another time for one of them takes no further place.
    assert_eq!(shelve(&mut vehicle, "g/m0"), Response::Done);
    let full = Refusal::ShelvesFull { limit: SHELVED_MAX as u32 };
    assert_eq!(shelve(&mut vehicle, &format!("g/m{SHELVED_MAX}")), Response::Refused(vec![full]));
}
