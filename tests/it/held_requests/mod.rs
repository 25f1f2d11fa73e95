//! Requests stay held until the operator releases them: over restarts, reloads, other causes and
//! acknowledgements.

mod on_its_way;
mod over_a_restart;

use telltale::engine::Engine;
use telltale::engine::input::{AlarmRef, Input, OperatorAction, Place, Refusal, Response, StatusArray};
use telltale::engine::model::Stage;
use telltale::engine::state::State;
use telltale::engine::time::{Span, Timestamp};

use crate::by_hand::{Vehicle, alarms, model, said, warnings};

const CONFIG: &str = "
signals:
  active: { topic: /mission/active, type: std_msgs/msg/Bool }
groups:
  - { id: sensors, match: [{ namespace: /sensors }], modules: [{ id: own, status: own }] }
countermeasures:
  - { request: decelerate, mps2: 1.5, when: { groups: [sensors], state: error } }
";

/// The causes of the request, with whether each is active and acknowledged; and whether the request waits.
type Asked = (Vec<(String, bool, bool)>, bool);

impl Vehicle {
    fn driving() -> Vehicle {
        Vehicle::of(CONFIG, Stage::Active)
    }

    /// A start that remembers nothing, with an operator.
    fn without_memory(text: &str) -> Vehicle {
        let mut vehicle = Vehicle::of(text, Stage::Locked);
        vehicle.engine = Engine::begin(vehicle.model.clone(), Timestamp::ZERO);
        assert_eq!(vehicle.does(OperatorAction::Login { name: "anna".into() }), Response::Done);
        vehicle
    }

    /// A sample of the signal `active`, and what all components say that are well, after some time.
    fn says(&mut self, active: bool, wait_s: u64) {
        self.signal("active", active);
        self.now = self.now + Span::from_secs(wait_s);
        self.say(0, 0);
    }

    fn hold(&mut self) -> Option<bool> {
        self.look().hold
    }

    /// Levels of `own` and of `/sensors/x`, which nobody declared.
    fn say(&mut self, own: u8, x: u8) {
        self.report(&[("own", own), ("/sensors/x", x)]);
    }

    fn knows(&mut self, alarm: AlarmRef) {
        assert_eq!(self.does(OperatorAction::Acknowledge { alarm }), Response::Done);
    }

    fn knows_node(&mut self, node: &str) {
        self.knows(AlarmRef::Node(node.into()));
    }

    /// Requires that a release is refused because of this cause alone.
    fn keeps(&mut self, node: &str) {
        let remains = Refusal::CauseRemains { node: node.into() };
        assert_eq!(self.release(), Response::Refused(vec![remains]));
    }

    fn asked(&mut self) -> Option<Asked> {
        let snapshot = self.look();
        let measure = snapshot.countermeasure()?;
        let causes = measure.causes.iter();
        let cause = causes.map(|it| (snapshot.node_name(it.node).to_string(), it.present, it.acknowledged));
        Some((cause.collect(), measure.latched))
    }

    /// Numbers, nodes, whether they are active, and how many are counted there.
    fn alarms(&mut self) -> Vec<(u64, String, bool, u32)> {
        let snapshot = self.look();
        let name = |node| snapshot.node_name(node).to_string();
        snapshot.alarms.iter().map(|it| (it.id, name(it.node), it.active, 1 + it.repeats)).collect()
    }
}

/// One cause alone.
fn cause(node: &str, present: bool) -> Option<Asked> {
    Some((vec![(node.into(), present, false)], !present))
}

const X: &str = "sensors//sensors/x";

#[test]
fn a_restart_keeps_what_a_discovered_module_caused() {
    for over in [false, true] {
        let mut vehicle = Vehicle::driving();
        vehicle.say(0, 2);
        if over {
            vehicle.say(0, 0);
        }
        assert_eq!(vehicle.asked(), cause(X, !over));
        vehicle.restart(CONFIG);
        // Nothing says yet that it is over.
        assert_eq!(vehicle.asked(), cause(X, true));
        assert_eq!(vehicle.alarms(), [(1, X.to_owned(), !over, 1)]);
        vehicle.say(0, 0);
        assert_eq!(vehicle.asked(), cause(X, false));
        vehicle.restart(CONFIG);
        vehicle.keeps(X);
        vehicle.say(0, 0);
        assert_eq!(vehicle.asked(), cause(X, false));
        vehicle.knows(AlarmRef::Number(1));
        assert_eq!(vehicle.asked(), Some((vec![(X.to_owned(), false, true)], true)), "it moves nothing");
        assert_eq!(vehicle.alarms(), []);
        assert_eq!(vehicle.release(), Response::Done);
        assert_eq!(vehicle.asked(), None);
        assert_eq!(vehicle.release(), Response::Refused(vec![Refusal::NothingToRelease]));
    }
}

#[test]
fn a_cause_that_is_only_a_warning_now_is_over_after_a_restart_as_without_one() {
    for restart in [false, true] {
        let mut vehicle = Vehicle::driving();
        vehicle.say(0, 2);
        if restart {
            vehicle.restart(CONFIG);
            vehicle.signal("active", true);
            vehicle.keeps(X);
        }
        vehicle.say(0, 1);
        assert_eq!(vehicle.release(), Response::Done, "{restart}");
        assert_eq!(vehicle.asked(), None);
    }
    // Where a WARNING asks, it is the cause still.
    let text = CONFIG.replace("state: error", "state: warning");
    let mut vehicle = Vehicle::of(&text, Stage::Active);
    vehicle.say(0, 2);
    vehicle.restart(&text);
    vehicle.signal("active", true);
    vehicle.say(0, 1);
    vehicle.keeps("sensors");
}

#[test]
fn a_restart_keeps_what_the_second_of_a_name_caused() {
    let text = CONFIG
        .replace("namespace: /sensors", "contains: lidar")
        .replace("{ id: own, status: own }", "{ id: lidar, status: 'lidar: beam' }");
    let report = |vehicle: &mut Vehicle, level| vehicle.report(&[("lidar: beam", 0), ("lidar", level)]);
    let second = "sensors/lidar (2)";
    let mut vehicle = Vehicle::of(&text, Stage::Active);
    report(&mut vehicle, 2);
    assert_eq!(vehicle.asked(), cause(second, true));
    vehicle.restart(&text);
    assert_eq!(vehicle.asked(), cause(second, true));
    assert_eq!(vehicle.alarms(), [(1, second.to_owned(), true, 1)]);
    report(&mut vehicle, 0);
    assert_eq!(vehicle.asked(), cause(second, false));
    vehicle.knows_node(second);
    assert_eq!((vehicle.release(), vehicle.asked(), vehicle.alarms()), (Response::Done, None, vec![]));
}

#[test]
fn a_discovered_module_that_finds_no_place_any_more_leaves_its_request_to_its_group() {
    let no_room = format!("{CONFIG}limits: {{ discovered_modules: 0 }}\n");
    let no_filter = CONFIG.replace("namespace: /sensors", "namespace: /other");
    for text in [&no_room, &no_filter] {
        let mut vehicle = Vehicle::driving();
        vehicle.say(0, 2);
        vehicle.knows_node(X);
        vehicle.restart(text);
        vehicle.say(0, 0);
        assert_eq!(vehicle.asked().map(|(causes, _)| causes[0].0.clone()), Some("sensors".to_owned()));
        vehicle.say(0, 0);
        // Statuses that are dropped make the group a WARNING, and that may be the cause itself.
        match text == &no_room {
            true => vehicle.keeps("sensors"),
            false => assert_eq!(vehicle.release(), Response::Done),
        }
    }
}

#[test]
fn a_reload_that_renames_or_removes_the_cause_releases_nothing() {
    let renamed = CONFIG.replace("id: own", "id: renamed");
    let removed = CONFIG.replace("{ id: own, status: own }", "{ id: another, status: another }");
    let no_group = removed.replace("id: sensors", "id: others").replace("[sensors]", "[others]");
    let no_rule = renamed.split("countermeasures").next().unwrap().to_owned();
    for (text, place) in [
        (&renamed, "sensors"),
        (&removed, "sensors"),
        (&no_group, "telltale/countermeasure"),
        (&no_rule, "sensors"),
    ] {
        for (over, known) in [(false, false), (true, false), (false, true)] {
            let mut vehicle = Vehicle::driving();
            vehicle.say(2, 0);
            if known {
                vehicle.knows_node("sensors/own");
            }
            if over {
                vehicle.say(0, 0);
            }
            vehicle.reload(text);
            let asked = vehicle.asked().expect("it is held");
            assert_eq!((&*asked.0[0].0, asked.0[0].2), (place, false), "{text}");
            vehicle.report(&["own", "another", "/sensors/x"].map(|name| (name, 0)));
            assert!(vehicle.asked().is_some(), "{text}");
            assert_eq!((vehicle.release(), vehicle.asked()), (Response::Done, None), "{text}");
        }
    }
}

#[test]
fn a_fault_that_lasts_over_its_modules_new_name_is_asked_for_throughout() {
    let mut vehicle = Vehicle::driving();
    vehicle.say(2, 0);
    vehicle.knows_node("sensors/own");
    vehicle.reload(&CONFIG.replace("id: own", "id: renamed"));
    assert_eq!(vehicle.look().deceleration(), Some(1.5));
    vehicle.say(2, 0);
    vehicle.say(0, 0);
    assert_eq!(vehicle.look().deceleration(), Some(1.5));
    assert_eq!((vehicle.release(), vehicle.asked()), (Response::Done, None));
}

#[test]
fn of_two_causes_one_after_the_other_both_are_named_until_the_release() {
    let mut vehicle = Vehicle::driving();
    vehicle.say(0, 2);
    vehicle.say(0, 0);
    vehicle.say(2, 0);
    vehicle.knows_node("sensors/own");
    vehicle.say(0, 0);
    let causes = |x| vec![("sensors/own".to_owned(), false, true), (X.to_owned(), false, x)];
    assert_eq!(vehicle.asked(), Some((causes(false), true)));
    vehicle.restart(CONFIG);
    vehicle.say(0, 0);
    assert_eq!(vehicle.asked(), Some((causes(false), true)));
    vehicle.knows_node(X);
    assert_eq!(vehicle.asked(), Some((causes(true), true)));
    assert_eq!((vehicle.release(), vehicle.asked()), (Response::Done, None));
}

#[test]
fn a_release_needs_every_cause_gone_a_live_display_and_a_store() {
    let mut vehicle = Vehicle::driving();
    vehicle.say(2, 2);
    let remains = |node: &str| Refusal::CauseRemains { node: node.into() };
    assert_eq!(vehicle.release(), Response::Refused(vec![remains("sensors/own"), remains(X)]));
    vehicle.say(0, 2);
    vehicle.keeps(X);
    // The operator's own stop does not hide that.
    assert_eq!(vehicle.does(OperatorAction::RequestStop), Response::Done);
    vehicle.keeps(X);
    vehicle.say(0, 0);
    assert_eq!(*vehicle.look().release_refusals, []);
    let blind = OperatorAction::Release { display_live: false, storage_ok: false };
    let besides = vec![Refusal::DisplayNotLive, Refusal::StorageNotWritable];
    assert_eq!(vehicle.input(&Input::Operator(blind)), Response::Refused(besides));
    assert_eq!(vehicle.look().countermeasures.len(), 2);
    assert_eq!((vehicle.release(), vehicle.asked()), (Response::Done, None));
    // A new fault asks anew.
    vehicle.say(2, 0);
    assert_eq!(vehicle.asked(), cause("sensors/own", true));
}

#[test]
fn a_request_that_was_made_at_a_stop_ends_with_its_cause_unless_the_vehicle_drives_meanwhile() {
    let text = CONFIG.replace("state: error }", "state: error, stages: [standby, active] }");
    for drives in [false, true] {
        let mut vehicle = Vehicle::of(&text, Stage::Standby);
        vehicle.says(false, 4);
        vehicle.say(2, 0);
        assert_eq!(vehicle.asked(), cause("sensors/own", true));
        vehicle.keeps("sensors/own");
        vehicle.says(drives, 0);
        vehicle.says(false, 60);
        assert_eq!(vehicle.asked(), cause("sensors/own", false).filter(|_| drives));
        assert_eq!(vehicle.look().stage, Stage::Standby);
    }
    // Right after a drive it is not certain that this is a stop.
    let mut vehicle = Vehicle::of(&text, Stage::Active);
    vehicle.says(false, 0);
    vehicle.say(2, 0);
    vehicle.says(false, 0);
    assert_eq!(vehicle.asked(), cause("sensors/own", false), "it may drive on");
    vehicle.says(false, 4);
    assert_eq!(vehicle.asked(), None);
}

#[test]
fn at_a_stop_a_request_of_the_drive_ends_with_its_cause() {
    let mut vehicle = Vehicle::driving();
    vehicle.say(2, 0);
    vehicle.says(false, 0);
    assert_eq!(vehicle.asked(), cause("sensors/own", false), "it may drive on");
    vehicle.says(false, 4);
    assert_eq!((vehicle.look().stage, vehicle.asked()), (Stage::Standby, None));
    vehicle.says(true, 0);
    vehicle.say(2, 0);
    vehicle.signal("active", false);
    vehicle.now = vehicle.now + Span::from_secs(4);
    vehicle.say(2, 0);
    assert_eq!(vehicle.asked(), cause("sensors/own", true), "the cause is there");
    vehicle.keeps("sensors/own");
}

/// Whether the vehicle is held, with its stage, once the cause has long been gone.
fn held_much_later(vehicle: &mut Vehicle) -> (Stage, Option<bool>) {
    vehicle.now = vehicle.now + Span::from_secs(60);
    vehicle.say(0, 0);
    let snapshot = vehicle.look();
    (snapshot.stage, snapshot.hold)
}

#[test]
fn where_nothing_says_that_the_vehicle_drives_a_request_is_held_until_it_is_released() {
    let without = CONFIG.replace("  active:", "  other:");
    let held = || {
        let mut vehicle = Vehicle::driving();
        vehicle.say(2, 0);
        vehicle.say(0, 0);
        vehicle
    };
    let stopped = || {
        let mut vehicle = Vehicle::driving();
        vehicle.say(0, 0);
        assert_eq!(vehicle.does(OperatorAction::RequestStop), Response::Done);
        vehicle
    };
    for begin in [&held as &dyn Fn() -> Vehicle, &stopped] {
        for change in [Vehicle::reload, Vehicle::restart] {
            let mut vehicle = begin();
            change(&mut vehicle, &without);
            assert_eq!(held_much_later(&mut vehicle), (Stage::Active, Some(true)));
            // Nor does another start forget it.
            vehicle.restart(&without);
            assert_eq!(held_much_later(&mut vehicle), (Stage::Active, Some(true)));
            assert_eq!(vehicle.release(), Response::Done);
            assert_eq!(held_much_later(&mut vehicle), (Stage::Active, Some(false)));
        }
    }
    let mut vehicle = Vehicle::of(CONFIG, Stage::Standby);
    vehicle.restart(&without);
    assert_eq!(held_much_later(&mut vehicle), (Stage::Standby, None), "nothing says that it is at a stop");
}

#[test]
fn a_machine_that_becomes_a_shuttle_is_locked_at_first() {
    let machine = format!("vehicle: {{ stages: none }}{}", CONFIG.replace("  active:", "  other:"));
    let mut vehicle = Vehicle::of(&machine, Stage::Active);
    assert_eq!(vehicle.look().stage, Stage::Active);
    vehicle.restart(&machine.replace("stages: none", "stages: shuttle"));
    assert_eq!(vehicle.look().stage, Stage::Locked, "nothing would ever end a drive that was none");
}

#[test]
fn a_shuttle_without_a_word_on_whether_it_drives_is_warned_of() {
    let without = CONFIG.replace("  active:", "  other:");
    let written = format!("vehicle: {{ stages: shuttle }}{without}");
    for (text, said) in [
        (&without, "c:5:11: this counts as a shuttle, because `vehicle` has no `stages`"),
        (&written, "c:1:20: nothing says whether this shuttle drives"),
    ] {
        let [line] = &warnings(text)[..] else { panic!("{:?}", warnings(text)) };
        assert!(line.starts_with(said), "{line}");
    }
    assert_eq!(warnings(CONFIG), [""; 0]);
}

#[test]
fn while_it_is_unknown_whether_the_vehicle_drives_a_request_is_held_also_in_standby() {
    let text = CONFIG.replace("std_msgs/msg/Bool }", "std_msgs/msg/Bool, timeout: 10s }");
    let mut vehicle = Vehicle::of(&text, Stage::Active);
    vehicle.say(2, 0);
    vehicle.signal("active", false);
    vehicle.say(0, 0);
    // The signal has been silent for long when the time of an arrival would end.
    vehicle.now = vehicle.now + Span::from_secs(60);
    vehicle.say(0, 0);
    assert_eq!(held_much_later(&mut vehicle), (Stage::Standby, Some(true)));
    // Nor does one sample of it release anything.
    vehicle.says(false, 4);
    assert_eq!(vehicle.hold(), Some(true));
    assert_eq!((vehicle.release(), vehicle.hold()), (Response::Done, Some(false)));
}

#[test]
fn before_the_vehicle_drives_a_clearance_is_withdrawn_and_a_stop_is_held_until_it_surely_stands() {
    let mut vehicle = Vehicle::of(CONFIG, Stage::Cleared);
    vehicle.say(0, 0);
    let withdraw = |vehicle: &mut Vehicle| vehicle.does(OperatorAction::Withdraw);
    assert_eq!(withdraw(&mut vehicle), Response::Done);
    assert_eq!((vehicle.look().stage, vehicle.look().clearance), (Stage::Standby, false));
    assert_eq!(withdraw(&mut vehicle), Response::Refused(vec![Refusal::WrongStage(Stage::Standby)]));
    for drives in [false, true] {
        let mut vehicle = Vehicle::of(CONFIG, Stage::Cleared);
        vehicle.say(0, 0);
        assert_eq!(vehicle.does(OperatorAction::RequestStop), Response::Done);
        assert_eq!((vehicle.look().stage, vehicle.look().maneuver_stop()), (Stage::Standby, true));
        // It may have set off before the stop came.
        vehicle.signal("active", drives);
        vehicle.now = vehicle.now + Span::from_secs(4);
        vehicle.say(0, 0);
        assert_eq!(vehicle.look().maneuver_stop(), drives);
    }
}

#[test]
fn a_stop_that_is_released_before_the_vehicle_surely_stands_is_over() {
    let mut vehicle = Vehicle::driving();
    vehicle.say(0, 0);
    assert_eq!(vehicle.does(OperatorAction::RequestStop), Response::Done);
    vehicle.signal("active", false);
    assert_eq!((vehicle.release(), vehicle.asked()), (Response::Done, None));
    // The engine once waited for the arrival without an end.
    vehicle.now = vehicle.now + Span::from_secs(9);
    vehicle.say(0, 0);
    assert_eq!(vehicle.asked(), None);
}

#[test]
fn more_causes_than_are_named_are_not_forgotten() {
    let report = |vehicle: &mut Vehicle, level| {
        let mut array = StatusArray::default();
        (0..80).for_each(|index| array.push_status(level, &format!("/sensors/{index}"), "", ""));
        array.push_status(0, "own", "", "");
        vehicle.input(&Input::Diagnostics(array));
    };
    for restart in [false, true] {
        let mut vehicle = Vehicle::driving();
        report(&mut vehicle, 2);
        report(&mut vehicle, 0);
        if restart {
            vehicle.restart(CONFIG);
            report(&mut vehicle, 0);
        }
        let (causes, _) = vehicle.asked().expect("it is held");
        assert_eq!((causes.len(), &*causes[63].0), (64, "sensors"));
        assert_eq!((vehicle.release(), vehicle.asked()), (Response::Done, None));
    }
}

#[test]
fn an_old_alarm_says_nothing_of_today() {
    let mut vehicle = Vehicle::driving();
    vehicle.say(0, 2);
    vehicle.say(0, 0);
    vehicle.say(0, 2);
    let alarms = vec![(1, X.to_owned(), false, 1), (2, X.to_owned(), true, 1)];
    assert_eq!(vehicle.alarms(), alarms);
    vehicle.knows(AlarmRef::Number(1));
    vehicle.say(0, 0);
    assert_eq!(vehicle.asked(), cause(X, false));
    vehicle.knows(AlarmRef::Number(2));
    assert_eq!(vehicle.asked(), Some((vec![(X.to_owned(), false, true)], true)));
}

#[test]
fn an_alarm_from_before_the_request_says_nothing_of_it() {
    let text = CONFIG.replace("groups: [sensors], state: error", "modules: [sensors/own], state: warning");
    let mut vehicle = Vehicle::of(&text, Stage::Standby);
    vehicle.say(2, 0);
    vehicle.say(0, 0);
    vehicle.signal("active", true);
    assert_eq!(vehicle.asked(), None);
    vehicle.say(1, 0);
    vehicle.knows(AlarmRef::Number(1));
    vehicle.say(0, 0);
    assert_eq!(vehicle.asked(), cause("sensors/own", false));
    assert_eq!((vehicle.release(), vehicle.asked()), (Response::Done, None));
}

#[test]
fn a_module_that_flaps_pushes_no_other_alarm_away() {
    let mut vehicle = Vehicle::driving();
    vehicle.say(0, 2);
    (0..600_u32).for_each(|round| vehicle.say(2 * (round % 2) as u8, 0));
    vehicle.say(0, 0);
    let alarms = vehicle.alarms();
    assert_eq!(alarms[0], (1, X.to_owned(), false, 1));
    assert_eq!(alarms.iter().skip(1).map(|(.., count)| count).sum::<u32>(), 300);
    assert_eq!(alarms.len(), 9);
    let counters = vehicle.look().counters;
    assert_eq!((counters.merged_alarms, counters.dropped_alarms), (292, 0));
    assert_eq!(vehicle.look().overall, State::Ok);
}

#[test]
fn an_alarm_of_what_is_unknown_goes_on_over_a_restart_though_it_is_given_time_again() {
    let text = "
vehicle: { stages: none }
defaults: { timeout: 1s }
groups:
  - { id: bus, modules: [{ id: link, status: link }] }
  - { id: strict, depends_on: [{ on: bus, masks_when: [error, unknown] }], modules: [{ id: m, status: m }] }
";
    let report = |engine: &mut Engine, link: u8, millis: u64| {
        engine.handle(&said(&[("link", link)]), Timestamp::from_millis(millis));
    };
    let mut engine = Engine::new(model(text), Timestamp::ZERO);
    assert_eq!(alarms(&engine.snapshot()), [], "it is given time");
    report(&mut engine, 3, 100);
    let expected = [(1, "bus/link".to_owned(), true)];
    assert_eq!(alarms(&engine.snapshot()), expected, "it says that it does not know");
    let restored = engine.snapshot().to_restore();
    let resume = || Engine::resume(model(text), &restored, Timestamp::from_millis(200));
    let mut silent = resume();
    for millis in [200, 900, 1200, 9000] {
        silent.handle(&Input::Tick, Timestamp::from_millis(millis));
        assert_eq!(alarms(&silent.snapshot()), expected, "at {millis} ms");
    }
    let mut well = resume();
    report(&mut well, 0, 300);
    assert_eq!(alarms(&well.snapshot()), [(1, "bus/link".to_owned(), false)]);
    // Without an alarm from before, the time to report is given as at any start.
    let mut fresh = Engine::resume(model(text), &Default::default(), Timestamp::from_millis(200));
    fresh.handle(&Input::Tick, Timestamp::from_millis(1199));
    assert_eq!(alarms(&fresh.snapshot()), []);
    fresh.handle(&Input::Tick, Timestamp::from_millis(1200));
    assert_eq!(alarms(&fresh.snapshot()), expected);
}
