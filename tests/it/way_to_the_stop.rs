//! How far the next stop is, and how long the drive to it takes.

use telltale::engine::input::{Input, OperatorAction};
use telltale::engine::model::Stage;
use telltale::engine::model::monitors::FieldKind;
use telltale::engine::model::sample::{FieldValue, Pose, Sample};
use telltale::engine::time::Span;

use crate::by_hand::Vehicle;

const CONFIG: &str = "
signals:
  active: { topic: /active, type: std_msgs/msg/Bool }
  goal: { topic: /goal_pose, type: geometry_msgs/msg/PoseStamped, present_for: 1h }
stops: [{ id: station, x: 1000, y: 0 }]
motion:
  speed: { topic: /speed, type: std_msgs/msg/Float64 }
  position: { topic: /pose, type: geometry_msgs/msg/PoseStamped, pose: pose, timeout: 2s }
groups: [{ id: localization, modules: [{ id: match, status: match }] }]
";

/// The vehicle drives to the station.
fn driving() -> Vehicle {
    let mut vehicle = Vehicle::of(CONFIG, Stage::Active);
    vehicle.signal("active", true);
    vehicle.signal("goal", true);
    vehicle.report(&[("match", 0)]);
    hear(&mut vehicle, "/goal_pose", 1000.0);
    vehicle
}

fn hear(vehicle: &mut Vehicle, topic: &str, x_m: f64) {
    let topics = &vehicle.model.watched.topics;
    let source = topics.iter().find(|it| &*it.topic == topic).expect("it is read").clone();
    let pose = Pose { x_m, ..Pose::default() };
    let values = source.fields.iter().map(|field| match field.kind {
        FieldKind::Pose => FieldValue::Pose(pose),
        _ => FieldValue::Absent,
    });
    let values = values.collect();
    vehicle.input(&Input::Sample(Sample::of(source, values)));
}

/// Goes on for so many seconds at this speed, from this place. Returns where it is then.
fn drive(vehicle: &mut Vehicle, from_m: f64, mps: f64, seconds: u32) -> f64 {
    let at = |second: u32| from_m + mps * f64::from(second);
    for second in 1..=seconds {
        vehicle.pass(Span::from_secs(1));
        vehicle.report(&[("match", 0)]);
        hear(vehicle, "/pose", at(second));
    }
    at(seconds)
}

fn shown(vehicle: &mut Vehicle) -> (Option<u32>, Option<u32>) {
    let motion = vehicle.look().motion;
    (motion.goal_m, motion.goal_min)
}

#[test]
fn the_distance_is_shown_in_steps_while_both_places_are_known() {
    let mut vehicle = driving();
    assert_eq!(shown(&mut vehicle), (None, None));
    for (x_m, goal_m) in [(757.0, 240), (761.0, 240), (768.0, 230), (1000.0, 0), (-240.0, 1200), (1e4, 9000)]
    {
        hear(&mut vehicle, "/pose", x_m);
        assert_eq!(shown(&mut vehicle), (Some(goal_m), None), "{x_m}");
    }
    for x_m in [f64::NAN, f64::INFINITY, 1e9] {
        hear(&mut vehicle, "/pose", 757.0);
        assert_eq!(shown(&mut vehicle).0, Some(240));
        hear(&mut vehicle, "/pose", x_m);
        assert_eq!(shown(&mut vehicle), (None, None), "{x_m}");
    }
}

#[test]
fn nothing_is_shown_of_a_place_that_is_old_or_not_sure_or_of_a_drive_that_is_over() {
    let mut vehicle = driving();
    hear(&mut vehicle, "/pose", 757.0);
    vehicle.pass(Span::from_millis(1900));
    assert_eq!(shown(&mut vehicle).0, Some(240));
    vehicle.pass(Span::from_millis(100));
    assert_eq!(shown(&mut vehicle).0, None);
    vehicle.report(&[("match", 1)]);
    hear(&mut vehicle, "/pose", 757.0);
    assert_eq!(shown(&mut vehicle).0, Some(240));
    vehicle.report(&[("match", 2)]);
    assert_eq!(shown(&mut vehicle).0, None);
    vehicle.report(&[("match", 0)]);
    assert_eq!(shown(&mut vehicle).0, Some(240));
    vehicle.signal("goal", false);
    vehicle.signal("active", false);
    assert_eq!(shown(&mut vehicle).0, None);
}

#[test]
fn the_time_follows_from_how_much_nearer_the_stop_came_in_a_minute() {
    let mut vehicle = driving();
    hear(&mut vehicle, "/pose", 0.0);
    let at_m = drive(&mut vehicle, 0.0, 5.0, 59);
    assert_eq!(shown(&mut vehicle), (Some(710), None));
    // 700 m at 5 m/s.
    let at_m = drive(&mut vehicle, at_m, 5.0, 1);
    assert_eq!(shown(&mut vehicle), (Some(700), Some(3)));
    // It stood for half of the last minute.
    let at_m = drive(&mut vehicle, at_m, 0.0, 30);
    assert_eq!(shown(&mut vehicle), (Some(700), Some(5)));
    let at_m = drive(&mut vehicle, at_m, 0.0, 30);
    assert_eq!(shown(&mut vehicle), (Some(700), None));
    drive(&mut vehicle, at_m, -5.0, 60);
    assert_eq!(shown(&mut vehicle), (Some(1000), None));
    // What came before a gap does not count.
    drive(&mut vehicle, 0.0, 5.0, 61);
    assert!(shown(&mut vehicle).1.is_some());
    vehicle.pass(Span::from_secs(2));
    drive(&mut vehicle, 305.0, 5.0, 59);
    assert_eq!(shown(&mut vehicle).1, None);
}

#[test]
fn a_reload_keeps_that_the_vehicle_stands_between_stops() {
    let mut vehicle = driving();
    vehicle.report(&[("match", 0)]);
    hear(&mut vehicle, "/pose", 400.0);
    vehicle.signal("active", false);
    hear(&mut vehicle, "/pose", 400.0);
    assert!(vehicle.look().may_set_off);
    // The next operator localizes it.
    vehicle.does(OperatorAction::Logout);
    vehicle.does(OperatorAction::Login { name: "anna".into() });
    assert_eq!((vehicle.look().stage, vehicle.look().may_set_off), (Stage::Localizing, true));
    vehicle.reload(&CONFIG.replace("timeout: 2s", "timeout: 3s"));
    assert!(vehicle.look().may_set_off);
}
