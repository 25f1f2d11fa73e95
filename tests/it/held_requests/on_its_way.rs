//! No word of the vehicle releases it between stops, and none says that nothing is held.

use super::*;

#[test]
fn a_vehicle_that_is_held_on_its_way_stays_held_whatever_it_says_of_driving() {
    let by_a_rule = || {
        let mut vehicle = Vehicle::driving();
        vehicle.say(2, 0);
        vehicle.say(0, 0);
        vehicle
    };
    let by_the_operator = || {
        let mut vehicle = Vehicle::driving();
        vehicle.say(0, 0);
        assert_eq!(vehicle.does(OperatorAction::RequestStop), Response::Done);
        vehicle
    };
    for begin in [&by_a_rule as &dyn Fn() -> Vehicle, &by_the_operator] {
        for silent_s in [1, 4, 60] {
            let mut vehicle = begin();
            // The component that says it restarts.
            vehicle.says(false, silent_s);
            assert_eq!((vehicle.look().stage, vehicle.hold()), (Stage::Standby, Some(true)));
            vehicle.says(true, 1);
            assert_eq!((vehicle.look().stage, vehicle.hold()), (Stage::Active, Some(true)));
            vehicle.says(false, silent_s);
            vehicle.restart(CONFIG);
            vehicle.says(false, silent_s);
            vehicle.reload(CONFIG);
            vehicle.says(false, silent_s);
            assert_eq!((vehicle.look().stage, vehicle.hold()), (Stage::Standby, Some(true)));
            let refused = vehicle.look().clearance_refusals.to_vec();
            assert!(refused.iter().any(|it| matches!(it, Refusal::Countermeasure(_))), "{refused:?}");
            // In standby too, the operator's release ends it.
            assert_eq!((vehicle.release(), vehicle.hold()), (Response::Done, Some(false)));
            assert!(!vehicle.look().clearance);
        }
    }
}

#[test]
fn a_start_that_remembers_nothing_learns_from_no_word_of_the_vehicle_that_it_is_not_held() {
    let speed = "motion: { speed: { topic: /can/speed, type: std_msgs/msg/Float64, field: data }, standing_below: 0.1 }";
    for text in [CONFIG.to_owned(), format!("{speed}{CONFIG}")] {
        let mut vehicle = Vehicle::without_memory(&text);
        for (active, wait_s) in
            [(false, 0), (true, 1), (false, 4), (false, 60), (true, 60), (false, 60), (true, 0), (false, 4)]
        {
            vehicle.says(active, wait_s);
            assert_eq!(vehicle.hold(), None, "after {active} for {wait_s} s");
        }
        vehicle.restart(&text);
        vehicle.says(false, 60);
        assert_eq!(vehicle.hold(), None);
    }
}

#[test]
fn an_operator_sets_a_vehicle_going_of_which_nothing_is_remembered() {
    // On its way: a stop, and its release.
    let mut vehicle = Vehicle::without_memory(CONFIG);
    vehicle.says(true, 60);
    assert_eq!(vehicle.release(), Response::Refused(vec![Refusal::NothingToRelease]));
    assert_eq!(vehicle.does(OperatorAction::RequestStop), Response::Done);
    assert_eq!(vehicle.hold(), Some(true));
    assert_eq!((vehicle.release(), vehicle.hold()), (Response::Done, Some(false)));
    assert_eq!(vehicle.look().stage, Stage::Active);

    // In standby: a clearance.
    let mut vehicle = Vehicle::without_memory(CONFIG);
    vehicle.says(false, 1);
    let place = Place::Pose { x_m: 0.0, y_m: 0.0, yaw_deg: 0.0 };
    assert_eq!(vehicle.does(OperatorAction::Localize { place }), Response::Done);
    vehicle.says(false, 10);
    assert_eq!((vehicle.look().stage, vehicle.hold()), (Stage::Standby, None));
    let (display_live, storage_ok) = (true, true);
    let asks = OperatorAction::AskClearance { display_live, storage_ok };
    assert_eq!((vehicle.does(asks), vehicle.hold()), (Response::Done, None), "this was the first tap");
    let clears = OperatorAction::Clear { display_live, storage_ok };
    assert_eq!((vehicle.does(clears), vehicle.hold()), (Response::Done, Some(false)));
    vehicle.says(true, 1);
    assert_eq!((vehicle.look().stage, vehicle.hold()), (Stage::Active, Some(false)));
}

#[test]
fn a_component_that_was_silent_and_starts_again_releases_nothing_with_its_first_words() {
    let text = CONFIG.replace("std_msgs/msg/Bool }", "std_msgs/msg/Bool, timeout: 2s }");
    let mut vehicle = Vehicle::of(&text, Stage::Active);
    vehicle.signal("active", true);
    vehicle.say(2, 0);
    vehicle.pass(Span::from_secs(3));
    // The cause is still there when it says so, and gone afterwards.
    vehicle.signal("active", false);
    vehicle.say(2, 0);
    for _ in 0..6 {
        vehicle.says(false, 1);
    }
    assert_eq!((vehicle.look().stage, vehicle.hold()), (Stage::Standby, Some(true)));
    vehicle.says(true, 0);
    assert_eq!((vehicle.look().stage, vehicle.hold()), (Stage::Active, Some(true)));
    assert_eq!((vehicle.release(), vehicle.hold()), (Response::Done, Some(false)));
}

#[test]
fn the_first_word_that_a_new_start_hears_is_no_arrival() {
    let text = CONFIG.replace("state: error }", "state: error, stages: [standby, active] }");
    for heard in [false, true] {
        let mut vehicle = Vehicle::of(&text, Stage::Active);
        vehicle.says(true, 1);
        vehicle.restart(&text);
        if heard {
            vehicle.says(true, 1);
        }
        vehicle.says(false, 0);
        vehicle.say(2, 0);
        assert_eq!(vehicle.asked(), cause("sensors/own", true));
        (0..10).for_each(|_| vehicle.says(false, 1));
        assert_eq!(vehicle.asked(), cause("sensors/own", false).filter(|_| !heard));
        assert_eq!(vehicle.look().stage, Stage::Standby);
    }
}

#[test]
fn a_stop_is_forgotten_while_the_vehicle_has_no_stages() {
    let text = CONFIG.replace("state: error }", "state: error, stages: [standby, active] }");
    let without = format!("vehicle: {{ stages: none }}{text}");
    for drives_on in [false, true] {
        let mut vehicle = Vehicle::of(&text, Stage::Active);
        vehicle.says(true, 1);
        vehicle.says(false, 4);
        if drives_on {
            vehicle.reload(&without);
            vehicle.says(true, 60);
            vehicle.says(false, 4);
            vehicle.reload(&text);
        }
        vehicle.says(false, 1);
        vehicle.say(2, 0);
        assert_eq!(vehicle.asked(), cause("sensors/own", true));
        (0..10).for_each(|_| vehicle.says(false, 1));
        assert_eq!(vehicle.asked(), cause("sensors/own", false).filter(|_| drives_on));
        assert_eq!(vehicle.look().stage, Stage::Standby);
    }
}
