//! Requests that nobody hears: they never count as sent, and go out once somebody listens.

use std::sync::Arc;

use telltale::engine::input::{Input, ListenerReport, OperatorAction, Refusal, Response};
use telltale::engine::model::Stage;
use telltale::engine::model::countermeasure::RequestKind;
use telltale::engine::model::output::Output;
use telltale::engine::snapshot::{CountermeasureState, Snapshot, Unreached};
use telltale::engine::state::State;
use telltale::engine::time::Span;

use crate::by_hand::{Vehicle, warnings};

const CONFIG: &str = "
signals:
  active: { topic: /mission/active, type: std_msgs/msg/Bool }
  stopping: { topic: /stopping, type: std_msgs/msg/Bool }
groups:
  - { id: sensors, modules: [{ id: lidar, status: lidar, timeout: 1h }] }
countermeasures:
  - { request: maneuver_stop, when: { groups: [sensors] }, confirmed_by: { signal: stopping }, within: 1s }
";
const TOPIC: &str = "/telltale/maneuver_stop_request";

impl Vehicle {
    fn well(text: &str, stage: Stage) -> Vehicle {
        let mut vehicle = Vehicle::of(text, stage);
        vehicle.report(&[("lidar", 0)]);
        vehicle
    }

    fn listeners(&mut self, heard: bool) -> Arc<Snapshot> {
        let news = ListenerReport { output: Output::ManeuverStop, topic: TOPIC.into(), heard };
        self.input(&Input::Listened(news));
        self.look()
    }

    fn seconds_later(&mut self, seconds: u64) -> Arc<Snapshot> {
        self.pass(Span::from_secs(seconds));
        self.look()
    }
}

/// The state of Telltale's own module for its outputs.
fn outputs(snapshot: &Snapshot) -> (State, String) {
    let node = snapshot.node("telltale/outputs").unwrap();
    let telltale::engine::model::NodeId::Module(id) = node else { panic!("{node:?}") };
    let (_, module) = snapshot.module(id);
    (module.state, module.says(snapshot.now).into_owned())
}

#[test]
fn a_request_that_nobody_hears_is_an_error_of_its_own_until_somebody_does() {
    for by_operator in [true, false] {
        let mut vehicle = Vehicle::well(CONFIG, Stage::Active);
        let calm = vehicle.listeners(false);
        assert_eq!(calm.unreached(Output::ManeuverStop), Some(Unreached::Unheard));
        assert_eq!((outputs(&calm).0, calm.alarms.len()), (State::Ok, 0), "nothing is asked for");
        match by_operator {
            true => assert_eq!(vehicle.does(OperatorAction::RequestStop), Response::Done),
            false => vehicle.report(&[("lidar", 2)]),
        }
        let asked = vehicle.seconds_later(0);
        assert_eq!(asked.countermeasure().unwrap().state, CountermeasureState::Unconfirmed);
        assert_eq!(outputs(&asked), (State::Error, format!("nobody listens to {TOPIC}")));
        let own = asked.node("telltale/countermeasure").unwrap();
        assert_eq!(asked.shown(own).0, State::Ok, "that it is not confirmed follows");
        assert!(asked.maneuver_stop(), "it is published all the same: the last value waits for a reader");
        let later = vehicle.seconds_later(60);
        assert_eq!(
            later.alarms.iter().filter(|it| it.node == later.node("telltale/outputs").unwrap()).count(),
            1
        );

        let heard = vehicle.listeners(true);
        assert_eq!((heard.unreached.len(), outputs(&heard).0), (0, State::Ok));
        vehicle.signal("stopping", true);
        assert_eq!(vehicle.seconds_later(0).countermeasure().unwrap().state, CountermeasureState::Engaged);
        assert_eq!(outputs(&vehicle.listeners(false)).0, State::Error, "the reader went away");
    }
}

#[test]
fn another_program_that_speaks_to_the_vehicle_is_an_error_and_forbids_a_clearance() {
    let mut vehicle = Vehicle::well(CONFIG, Stage::Active);
    let who = "/telltale/hold by /rosbag2_player";
    vehicle.input(&Input::Voices { other: Some(who.into()) });
    let (state, message) = outputs(&vehicle.listeners(true));
    assert_eq!(state, State::Error);
    assert!(message.contains(who) && message.contains("end that program"), "{message}");
    // Another configuration does not hide it.
    vehicle.reload(&CONFIG.replace("within: 1s", "within: 2s"));
    assert_eq!(outputs(&vehicle.seconds_later(1)).0, State::Error);
    vehicle.signal("active", false);
    let refusals = vehicle.seconds_later(1).clearance_refusals.to_vec();
    let by_itself = |it: &Refusal| matches!(it, Refusal::Group { group, .. } if &**group == "telltale");
    assert!(refusals.iter().any(by_itself), "{refusals:?}");
    vehicle.input(&Input::Voices { other: None });
    assert_eq!(outputs(&vehicle.seconds_later(1)).0, State::Ok);
}

#[test]
fn a_vehicle_that_hears_no_stop_gets_no_clearance() {
    let refusals = |text: &str, heard: bool| {
        let mut vehicle = Vehicle::well(text, Stage::Standby);
        let refusals = vehicle.listeners(heard).clearance_refusals.to_vec();
        refusals.into_iter().filter(|it| matches!(it, Refusal::NobodyListens(_))).collect::<Vec<_>>()
    };
    assert_eq!(refusals(CONFIG, false), [Refusal::NobodyListens(RequestKind::ManeuverStop)]);
    assert_eq!(refusals(CONFIG, true), []);
    // The operator may ask for a stop where no rule does.
    let without_rules = CONFIG.split("countermeasures").next().unwrap();
    assert_eq!(refusals(without_rules, false), [Refusal::NobodyListens(RequestKind::ManeuverStop)]);
    let off = format!("{without_rules}publish: {{ maneuver_stop_request: false }}\n");
    assert_eq!(refusals(&off, false), [], "an operator who switched it off stops it in another way");
}

#[test]
fn a_stop_that_is_not_published_is_refused_and_check_warns_of_it() {
    let without_rules = CONFIG.split("countermeasures").next().unwrap();
    let text = format!("{without_rules}publish: {{ maneuver_stop_request: false }}\n");
    let mut vehicle = Vehicle::well(&text, Stage::Active);
    let refused = vehicle.does(OperatorAction::RequestStop);
    assert_eq!(refused, Response::Refused(vec![Refusal::StopNotPublished]));
    let shown = vehicle.seconds_later(1);
    assert_eq!(shown.unreached(Output::ManeuverStop), Some(Unreached::Unpublished));
    assert_eq!((shown.countermeasures.len(), outputs(&shown).0), (0, State::Ok));

    assert_eq!(
        warnings(&text),
        [
            "c:7:35: the vehicle drives, and no request to stop is published: the operator's page offers no stop \
          (remove the line, or make sure that it can be stopped in another way)"
        ]
    );
    assert_eq!(warnings(without_rules), [""; 0]);
    assert_eq!(warnings(&format!("vehicle: {{ stages: none }}{text}")), [""; 0]);
}
