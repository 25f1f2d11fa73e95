//! Countermeasures, acceptances and stages in cases that scenarios cannot express: topics that cannot be
//! sent, restarts, reloads and many modules.

use telltale::engine::Engine;
use telltale::engine::input::{AlarmRef, Input, OperatorAction, OutputReport, Place, Response};
use telltale::engine::model::Stage;
use telltale::engine::model::output::Output;
use telltale::engine::snapshot::{Alarm, CountermeasureState, Snapshot};
use telltale::engine::state::State;
use telltale::engine::time::Span;

use crate::by_hand::{Vehicle, model};

const CONFIG: &str = "
signals:
  active: { topic: /mission/active, type: std_msgs/msg/Bool }
stops: [{ id: depot, name: Depot, x: 0, y: 0, yaw_deg: 0 }]
localized_after: 1s
groups:
  - { id: sensors, modules: [{ id: lidar, status: lidar, timeout: 10s }] }
  - { id: planning, depends_on: [sensors], modules: [{ id: planner, status: planner, timeout: 10s }] }
countermeasures:
  - { request: maneuver_stop, when: { groups: [sensors], state: error } }
  - { request: decelerate, mps2: 1.5, when: { modules: [planning/planner], state: error } }
";

impl Vehicle {
    fn reporting(stage: Stage) -> Vehicle {
        let mut vehicle = Vehicle::of(CONFIG, stage);
        vehicle.report(&[("lidar", 0), ("planner", 0)]);
        vehicle
    }

    fn acknowledge(&mut self, node: &str) -> Response {
        self.does(OperatorAction::Acknowledge { alarm: AlarmRef::Node(node.into()) })
    }

    fn clear(&mut self) -> Response {
        self.does(OperatorAction::Clear { display_live: true, storage_ok: true })
    }

    fn send(&mut self, output: Output, error: Option<&str>) {
        let news = OutputReport { output, topic: "/t".into(), error: error.map(Box::from) };
        self.input(&Input::Output(news));
    }
}

fn state(snapshot: &Snapshot, name: &str) -> State {
    snapshot.shown(snapshot.node(name).unwrap()).0
}

/// The strongest request in words: its kind, its causes and whether it waits for the operator.
fn asked(snapshot: &Snapshot) -> Option<(&'static str, Vec<&str>, bool)> {
    let measure = snapshot.countermeasure()?;
    let causes = measure.causes.iter().map(|cause| &**snapshot.node_name(cause.node)).collect();
    Some((measure.request.as_str(), causes, measure.latched))
}

#[test]
fn a_masked_node_lets_its_root_ask_for_what_it_would_have_asked() {
    let mut vehicle = Vehicle::reporting(Stage::Active);
    vehicle.report(&[("lidar", 2), ("planner", 2)]);
    let snapshot = vehicle.look();
    assert_eq!(state(&snapshot, "planning/planner"), State::Ignore);
    assert_eq!(asked(&snapshot), Some(("decelerate", vec!["sensors/lidar"], false)));
    assert_eq!((snapshot.deceleration(), snapshot.maneuver_stop()), (Some(1.5), true));
    vehicle.report(&[("lidar", 0), ("planner", 0)]);
    assert_eq!(asked(&vehicle.look()), Some(("decelerate", vec!["sensors/lidar"], true)));
    assert_eq!(vehicle.acknowledge("sensors/lidar"), Response::Done);
    assert_eq!(vehicle.look().countermeasures.len(), 2, "that moves nothing");
    assert_eq!(vehicle.release(), Response::Done);
    assert_eq!(vehicle.look().countermeasures.len(), 0);
}

#[test]
fn a_request_stays_while_the_cause_that_was_named_for_it_is_there() {
    let mut vehicle = Vehicle::reporting(Stage::Active);
    vehicle.report(&[("lidar", 2), ("planner", 2)]);
    let held = Some(("decelerate", vec!["sensors/lidar"], false));
    assert_eq!(asked(&vehicle.look()), held);
    // The planner is well again behind its mask, and the operator knows of the LiDAR.
    vehicle.report(&[("planner", 0)]);
    assert_eq!(vehicle.acknowledge("sensors/lidar"), Response::Done);
    assert_eq!(asked(&vehicle.look()), held);
    vehicle.report(&[("lidar", 0)]);
    assert_eq!(asked(&vehicle.look()), Some(("decelerate", vec!["sensors/lidar"], true)));
    assert_eq!(vehicle.release(), Response::Done);
    assert_eq!(asked(&vehicle.look()), None);
}

#[test]
fn silence_lets_a_rule_for_unknown_ask() {
    let text = CONFIG.replace("[planning/planner], state: error", "[planning/planner], state: unknown");
    let mut vehicle = Vehicle::of(&text, Stage::Active);
    vehicle.report(&[("lidar", 0), ("planner", 1)]);
    assert!(asked(&vehicle.look()).is_some(), "nothing was heard at the start");
    assert_eq!(vehicle.release(), Response::Done);
    assert_eq!(asked(&vehicle.look()), None, "a WARNING is better than UNKNOWN");
    vehicle.now = vehicle.now + Span::from_secs(9);
    vehicle.report(&[("lidar", 0)]);
    assert_eq!(asked(&vehicle.look()), None);
    vehicle.pass(Span::from_secs(1));
    assert_eq!(asked(&vehicle.look()), Some(("decelerate", vec!["planning/planner"], false)));
}

#[test]
fn a_request_that_cannot_be_sent_is_an_error_of_its_own() {
    let mut vehicle = Vehicle::reporting(Stage::Active);
    vehicle.send(Output::Deceleration, Some("no network"));
    assert_eq!(state(&vehicle.look(), "telltale/outputs"), State::Warning);
    assert_eq!(state(&vehicle.look(), "telltale/countermeasure"), State::Ok);
    vehicle.report(&[("planner", 2)]);
    let snapshot = vehicle.look();
    assert_eq!(state(&snapshot, "telltale/countermeasure"), State::Error);
    assert_eq!(snapshot.countermeasure().unwrap().state, CountermeasureState::Unconfirmed);
    vehicle.send(Output::Deceleration, None);
    assert_eq!(state(&vehicle.look(), "telltale/countermeasure"), State::Ok);
    assert_eq!(vehicle.look().countermeasure().unwrap().state, CountermeasureState::Requested);
}

#[test]
fn a_restart_in_the_middle_of_a_fault_takes_nothing_back() {
    let mut vehicle = Vehicle::reporting(Stage::Active);
    vehicle.report(&[("planner", 2)]);
    assert_eq!(vehicle.acknowledge("planning/planner"), Response::Done);
    vehicle.restart(CONFIG);
    let snapshot = vehicle.look();
    assert_eq!((snapshot.stage, snapshot.operator.as_deref()), (Stage::Active, Some("operator")));
    // Nothing says yet whether it drives, and nothing says that the fault is over.
    assert_eq!(state(&snapshot, "telltale/active"), State::Unknown);
    assert_eq!(asked(&snapshot), Some(("decelerate", vec!["planning/planner"], false)));
    assert_eq!(snapshot.alarms[0].id, 1);
    assert!(snapshot.alarms[0].active);
    vehicle.signal("active", true);
    vehicle.report(&[("lidar", 0), ("planner", 2)]);
    assert_eq!(state(&vehicle.look(), "telltale/active"), State::Ok);
    assert_eq!(vehicle.look().alarms[0].id, 1, "the same alarm");
    vehicle.report(&[("planner", 0)]);
    assert_eq!(vehicle.release(), Response::Done);
    assert_eq!(asked(&vehicle.look()), None);
}

#[test]
fn after_a_restart_active_has_its_time_to_be_heard() {
    for heard in [true, false] {
        let mut vehicle = Vehicle::reporting(Stage::Active);
        vehicle.signal("active", true);
        vehicle.restart(CONFIG);
        let start = vehicle.now;
        if heard {
            vehicle.signal("active", true);
        }
        vehicle.report(&[("lidar", 0), ("planner", 0)]);
        let expected = if heard { State::Ok } else { State::Unknown };
        assert_eq!(state(&vehicle.look(), "telltale/active"), expected);
        assert!(vehicle.look().alarms.is_empty());
        vehicle.now = start + Span::from_secs(4);
        vehicle.input(&Input::Tick);
        let expected = if heard { State::Ok } else { State::Error };
        assert_eq!(state(&vehicle.look(), "telltale/active"), expected);
        assert_eq!(vehicle.look().alarms.is_empty(), heard);
    }
}

/// Numbers, nodes and whether they are active.
fn alarms(snapshot: &Snapshot) -> Vec<(u64, &str, bool, bool)> {
    let alarm = |it: &Alarm| (it.id, &**snapshot.node_name(it.node), it.active, it.acknowledged);
    snapshot.alarms.iter().map(alarm).collect()
}

#[test]
fn after_a_restart_an_alarm_is_over_once_its_module_is_known_and_no_root() {
    let mut vehicle = Vehicle::reporting(Stage::Active);
    vehicle.signal("active", true);
    vehicle.report(&[("planner", 2)]);
    vehicle.acknowledge("planning/planner");
    vehicle.restart(CONFIG);
    vehicle.signal("active", true);
    assert_eq!(alarms(&vehicle.look()), [(1, "planning/planner", true, true)]);
    vehicle.report(&[("lidar", 0), ("planner", 0)]);
    assert_eq!(alarms(&vehicle.look()), []);
    vehicle.report(&[("planner", 2)]);
    assert_eq!(alarms(&vehicle.look()), [(2, "planning/planner", true, false)]);
}

#[test]
fn a_fault_of_the_vehicles_side_that_lasts_over_a_restart_keeps_its_number() {
    let seconds = |vehicle: &mut Vehicle, seconds| vehicle.pass(Span::from_secs(seconds));
    let mut vehicle = Vehicle::reporting(Stage::Active);
    vehicle.signal("active", true);
    vehicle.send(Output::Deceleration, Some("no writer"));
    vehicle.report(&[("planner", 2)]);
    let before = alarms(&vehicle.look()).len();
    vehicle.restart(CONFIG);
    let restored: Vec<u64> = vehicle.look().alarms.iter().map(|it| it.id).collect();
    assert_eq!(restored.len(), before);
    vehicle.signal("active", true);
    vehicle.report(&[("lidar", 0), ("planner", 2)]);
    seconds(&mut vehicle, 1);
    vehicle.send(Output::Deceleration, Some("no writer"));
    seconds(&mut vehicle, 5);
    let ids: Vec<u64> = vehicle.look().alarms.iter().filter(|it| it.active).map(|it| it.id).collect();
    assert_eq!((ids, state(&vehicle.look(), "telltale/countermeasure")), (restored, State::Error));
    // Nobody says whether it drives, before the restart and after it.
    let mut vehicle = Vehicle::reporting(Stage::Active);
    vehicle.signal("active", true);
    vehicle.restart(CONFIG);
    vehicle.report(&[("lidar", 0), ("planner", 0)]);
    seconds(&mut vehicle, 5);
    assert_eq!(alarms(&vehicle.look()), [(1, "telltale/active", true, false)]);
    vehicle.restart(CONFIG);
    vehicle.report(&[("lidar", 0), ("planner", 0)]);
    seconds(&mut vehicle, 5);
    assert_eq!(alarms(&vehicle.look()), [(1, "telltale/active", true, false)]);
    vehicle.restart(CONFIG);
    vehicle.signal("active", true);
    assert_eq!(alarms(&vehicle.look()), [(1, "telltale/active", false, false)], "over as soon as it is said");
}

#[test]
fn after_a_restart_the_stage_is_the_same_but_nothing_is_cleared() {
    for (stage, after) in [
        (Stage::Locked, Stage::Locked),
        (Stage::Localizing, Stage::Localizing),
        (Stage::Standby, Stage::Standby),
        (Stage::Cleared, Stage::Standby),
        (Stage::Active, Stage::Active),
    ] {
        let mut vehicle = Vehicle::reporting(stage);
        assert_eq!(vehicle.look().stage, stage);
        vehicle.restart(CONFIG);
        assert_eq!(vehicle.look().stage, after);
        assert!(!vehicle.look().clearance);
    }
}

#[test]
fn an_accepted_warning_outlives_a_restart_and_a_reload_but_not_its_end() {
    let mut vehicle = Vehicle::reporting(Stage::Standby);
    vehicle.report(&[("lidar", 1)]);
    assert!(matches!(vehicle.clear(), Response::Refused(_)));
    assert_eq!(vehicle.acknowledge("sensors"), Response::Done);
    assert_eq!(vehicle.look().accepted.len(), 1);
    vehicle.restart(CONFIG);
    vehicle.report(&[("lidar", 1), ("planner", 0)]);
    vehicle.reload(CONFIG);
    assert_eq!(*vehicle.look().clearance_refusals, []);
    vehicle.report(&[("lidar", 0)]);
    vehicle.report(&[("lidar", 1)]);
    assert_eq!(vehicle.look().accepted.len(), 0);
    assert!(matches!(vehicle.clear(), Response::Refused(_)));
}

#[test]
fn a_reload_keeps_what_is_held_and_another_configuration_withdraws_a_clearance() {
    let mut vehicle = Vehicle::reporting(Stage::Active);
    vehicle.report(&[("lidar", 2), ("planner", 2)]);
    let before = vehicle.look();
    let other = CONFIG.replace("1.5", "2.5");
    vehicle.reload(&other);
    assert_eq!(asked(&vehicle.look()), asked(&before));

    let mut vehicle = Vehicle::reporting(Stage::Standby);
    assert_eq!(vehicle.clear(), Response::Done);
    vehicle.reload(CONFIG);
    assert_eq!(vehicle.look().stage, Stage::Cleared);
    vehicle.reload(&other);
    assert_eq!((vehicle.look().stage, vehicle.look().clearance), (Stage::Standby, false));
}

#[test]
fn a_pose_grows_the_number_that_is_published_by() {
    let mut vehicle = Vehicle::reporting(Stage::Localizing);
    let at_depot = || OperatorAction::Localize { place: Place::Stop("depot".into()) };
    assert_eq!(vehicle.look().localization.number, 0);
    assert_eq!(vehicle.does(at_depot()), Response::Done);
    assert_eq!(vehicle.does(at_depot()), Response::Done);
    assert_eq!((vehicle.look().localization.number, vehicle.look().stage), (2, Stage::Localizing));
    vehicle.restart(CONFIG);
    assert_eq!(vehicle.look().localization.number, 2);
}

#[test]
fn what_is_worse_asks_for_more_after_a_reload_too() {
    let text = format!(
        "{CONFIG}  - {{ request: decelerate, mps2: 3.0, when: {{ groups: [sensors], state: error }} }}
  - {{ request: decelerate, mps2: 1.0, when: {{ groups: [sensors], state: warning }} }}
"
    );
    let mut vehicle = Vehicle::of(&text, Stage::Active);
    vehicle.report(&[("lidar", 1), ("planner", 0)]);
    // What nobody had said anything of at the start is well now.
    vehicle.report(&[("lidar", 0), ("planner", 0)]);
    assert_eq!(vehicle.release(), Response::Done);
    vehicle.report(&[("lidar", 1), ("planner", 0)]);
    assert_eq!(vehicle.look().deceleration(), Some(1.0));
    vehicle.reload(&text);
    assert_eq!(vehicle.look().deceleration(), Some(1.0));
    vehicle.report(&[("lidar", 2)]);
    assert_eq!(vehicle.look().deceleration(), Some(3.0));
}

#[test]
fn a_set_of_which_one_is_enough_asks_for_nothing_once_one_is_well() {
    let text = "
signals:
  active: { topic: /mission/active, type: std_msgs/msg/Bool }
groups:
  - { id: sensors, combine: any, modules: [{ id: front, status: front }, { id: rear, status: rear }] }
countermeasures:
  - { request: maneuver_stop, when: { groups: [sensors], state: error } }
";
    let mut vehicle = Vehicle::of(text, Stage::Active);
    vehicle.report(&[("front", 2), ("rear", 2)]);
    let causes = vec!["sensors/front", "sensors/rear"];
    assert_eq!(asked(&vehicle.look()), Some(("maneuver_stop", causes.clone(), false)));
    vehicle.report(&[("rear", 0)]);
    assert_eq!(asked(&vehicle.look()), Some(("maneuver_stop", causes, true)));
    assert_eq!(vehicle.release(), Response::Done);
    assert_eq!(asked(&vehicle.look()), None);
}

#[test]
fn every_stop_of_the_operator_is_counted_over_reloads_and_keyframes_too() {
    let mut vehicle = Vehicle::reporting(Stage::Active);
    let mut seq = vehicle.look().seq;
    for number in 1..=3 {
        assert_eq!(vehicle.does(OperatorAction::RequestStop), Response::Done);
        let snapshot = vehicle.look();
        assert_eq!(snapshot.last_stop, number);
        assert!(snapshot.seq > seq, "it is a change of the state");
        seq = snapshot.seq;
    }
    vehicle.reload(CONFIG);
    assert_eq!(vehicle.look().last_stop, 3);
    let resumed = Engine::from_keyframe(model(CONFIG), &vehicle.engine.keyframe()).unwrap();
    assert_eq!(resumed.last_stop(), 3);
    vehicle.signal("active", false);
    vehicle.pass(Span::from_secs(60));
    assert!(matches!(vehicle.does(OperatorAction::RequestStop), Response::Refused(_)));
    assert_eq!(vehicle.look().last_stop, 4, "also one that is refused");
}
