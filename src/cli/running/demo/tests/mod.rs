//! The demo in virtual time: the simulated shuttle, its messages as bytes, the real configuration and the
//! real engine. The tests check what an operator sees of each fault from beginning to end, and how the
//! shuttle reacts.

mod held;
mod robot;
mod story;

use std::collections::BTreeSet;

use crate::engine::input::{AlarmRef, OperatorAction, Response};
use crate::engine::model::Stage;
use crate::engine::model::countermeasure::RequestKind;
use crate::engine::snapshot::{CountermeasureState, Motion, Moving, Snapshot};
use crate::engine::state::State;
use crate::sim::shuttle::Fault;
use story::{Story, masked_by, state};

#[test]
fn the_whole_story_and_a_healthy_shuttle_raises_nothing_on_four_journeys() {
    let mut story = Story::begin();
    for _journey in 0..4 {
        story.drive();
        let arrives_ms = story.until(120_000, |snapshot| snapshot.stage == Stage::Standby);
        assert!(arrives_ms.is_some());
        let settled = |snapshot: &Snapshot| snapshot.overall == State::Ok;
        assert!(story.until(100, settled).is_some(), "{:?}", story.complaints());
    }
    assert_eq!((story.roots.len(), story.alarms), (0, 0), "{:?}", story.roots);
    assert_eq!(story.bad, BTreeSet::new());
}

#[test]
fn the_motion_is_that_of_the_shuttle_from_stop_to_stop() {
    let mut story = Story::begin();
    let at_stop =
        |snapshot: &Snapshot| (snapshot.motion.moving, snapshot.motion.speed_kmh) == (Moving::No, Some(0));
    let leads_to = |snapshot: &Snapshot| snapshot.destination().map(|stop| stop.id.to_string());
    story.until(10_000, |snapshot| snapshot.clearance_refusals.is_empty()).expect("there is a goal");
    assert!(at_stop(&story.snapshot()) && leads_to(&story.snapshot()).as_deref() == Some("station"));
    let known = |snapshot: &Snapshot| {
        let place = snapshot.localization.last_known?;
        let stop = snapshot.layout.stops.iter().find(|stop| place.pose == (*stop).into())?;
        Some((stop.id.to_string(), place.driven))
    };
    assert_eq!(known(&story.snapshot()), Some(("depot".to_owned(), false)), "as it was chosen");
    story.drive();
    let driving = story.snapshot();
    assert_eq!(known(&driving), None);
    assert_eq!((driving.motion.moving, leads_to(&driving).as_deref()), (Moving::Yes, Some("station")));
    let kmh = driving.motion.speed_kmh.expect("it moves");
    assert!(
        (f64::from(kmh) - story.true_speed_mps() * 3.6).abs() < 1.5,
        "{kmh} of {}",
        story.true_speed_mps()
    );
    // Fifty speeds a second with their noise are no change that a person could see.
    let but_the_way = |motion: Motion| Motion { goal_m: None, goal_min: None, ..motion };
    let motion = but_the_way(driving.motion);
    assert!(story.until(3_000, |snapshot| but_the_way(snapshot.motion) != motion).is_none());
    let (before_m, after_m) = (driving.motion.goal_m, story.snapshot().motion.goal_m);
    assert!(after_m.is_some() && after_m < before_m, "it comes nearer: {before_m:?}, {after_m:?}");
    let arrived = story.until(120_000, |snapshot| snapshot.stage == Stage::Standby);
    assert!(arrived.is_some(), "it arrives: {:?}", story.roots);
    assert_eq!(story.snapshot().destination(), None);
    assert_eq!(known(&story.snapshot()), Some(("station".to_owned(), true)), "where the drive led");
    story.until(600, at_stop).expect("it stands");
}

#[test]
fn without_the_bus_nobody_says_that_the_shuttle_drives() {
    let mut story = Story::begin();
    story.drive();
    story.set_fault(Fault::CanLoss, true);
    let unknown = |snapshot: &Snapshot| snapshot.motion.moving == Moving::Unknown;
    let after_ms = story.until(2_000, unknown).expect("nothing is heard");
    assert!((980..=1_050).contains(&after_ms), "{after_ms}");
    let motion = story.snapshot().motion;
    assert!(motion.has_source && motion.speed_kmh.is_none() && motion.destination.is_some(), "{motion:?}");
    assert!(story.until(5_000, |snapshot| !unknown(snapshot)).is_none(), "not even that it stands");
}

#[test]
fn every_refusal_on_the_way_says_why_and_changes_nothing() {
    let mut story = Story::locked();
    let stage = |story: &mut Story| story.snapshot().stage;
    let clear = OperatorAction::Clear { display_live: true, storage_ok: true };
    let refused = |story: &mut Story, action: &OperatorAction| matches!(story.act(action), Response::Refused(reasons) if !reasons.is_empty());
    assert!(refused(&mut story, &clear) && stage(&mut story) == Stage::Locked);
    story.log_in();
    assert!(refused(&mut story, &clear) && stage(&mut story) == Stage::Localizing);
    // A pose from which the scans do not find it.
    story.localize("campus");
    assert_eq!(story.until(10_000, |snapshot| snapshot.stage == Stage::Standby), None);
    story.localize("depot");
    story.until(10_000, |snapshot| snapshot.stage == Stage::Standby).expect("it finds itself");
    assert!(refused(&mut story, &clear), "there is no goal yet");
    story.until(10_000, |snapshot| snapshot.clearance_refusals.is_empty()).expect("there is a goal");
    story.set_fault(Fault::CostmapDelay, true);
    story.until(3_000, |snapshot| state(snapshot, "perception") == State::Error).expect("it shows");
    assert!(refused(&mut story, &clear));
    story.set_fault(Fault::CostmapDelay, false);
    story.until(5_000, |snapshot| snapshot.clearance_refusals.is_empty()).expect("all is well");
    assert_eq!(story.act(&clear), Response::Done);
    assert_eq!(stage(&mut story), Stage::Cleared);
    story.until(5_000, |snapshot| snapshot.stage == Stage::Active).expect("it leaves");
    assert!(refused(&mut story, &OperatorAction::Logout) && refused(&mut story, &clear));
}

#[test]
fn messages_that_wait_for_most_of_a_second_again_and_again_raise_nothing_in_the_demo() {
    for stalls_ms in [(1_000, 400), (3_000, 900), (7_100, 900)] {
        let mut story = Story::patient();
        story.stalls_ms = Some(stalls_ms);
        for _journey in 0..2 {
            story.clear();
            story.until(5_000, |snapshot| snapshot.stage == Stage::Active).expect("it leaves");
            let arrived = story.until(120_000, |snapshot| snapshot.stage == Stage::Standby);
            assert!(arrived.is_some(), "{stalls_ms:?}: {:?}", story.roots);
        }
        assert_eq!((story.roots.len(), story.alarms), (0, 0), "{stalls_ms:?}: {:?}", story.roots);
    }
    // A vehicle says so.
    let mut story = Story::begin();
    story.stalls_ms = Some((3_000, 900));
    story.pass(3_000);
    assert!(story.roots.contains("can/bus"), "{:?}", story.roots);
}

#[test]
fn the_demo_shows_each_fault_with_its_one_cause_and_a_sensor_outage_at_the_localization_first() {
    let table = [
        (Fault::SensorOutage, "sensors/velodyne_packet_alive", "execution", 3_000),
        (Fault::LocalizationJump, "localization/tf_quality", "execution", 1_800),
        (Fault::CostmapDelay, "perception/costmap_delay", "execution", 2_000),
        (Fault::PlannerStall, "planning/planner_submitted", "execution", 2_200),
        (Fault::CanLoss, "can/bus", "execution", 2_100),
        (Fault::CameraCrash, "sensors/camera_driver", "sensors/camera_front", 2_600),
    ];
    for (fault, cause, waits, within_ms) in table {
        let mut story = Story::patient();
        story.drive();
        story.set_fault(fault, true);
        if fault == Fault::SensorOutage {
            story
                .until(3_000, |snapshot| state(snapshot, "localization") == State::Error)
                .expect("it notices");
            assert_eq!(state(&story.snapshot(), "sensors"), State::Ok);
            story.roots.clear();
        }
        let shows = |snapshot: &Snapshot| masked_by(snapshot, waits) == [cause];
        let shown_ms = story.until(within_ms, shows);
        assert!(shown_ms.is_some(), "{fault:?}: {:?}", story.complaints());
        assert_eq!(story.until(8_000, |snapshot| !shows(snapshot)), None, "{fault:?}: {:?}", story.roots);
        story.set_fault(fault, false);
        story.until(6_000, |snapshot| snapshot.overall == State::Ok).expect("it is over");
        story.pass(3_000);
        let early = ["localization/tf_quality".to_owned(), "localization/scan_matching".to_owned()];
        story.roots.retain(|root| fault != Fault::SensorOutage || !early.contains(root));
        assert_eq!(story.roots, BTreeSet::from([cause.to_owned()]), "{fault:?}");
    }
}

/// The fault, its root cause, who waits for it, who shows ERROR before the cause does, and within
/// how many milliseconds all of that is settled.
type FaultRow = (Fault, &'static str, &'static [&'static str], &'static [&'static str], u64);

#[test]
fn every_fault_has_its_one_cause_from_its_start_to_after_its_end() {
    let after_localization = &["perception", "prediction", "planning", "execution"][..];
    let table: [FaultRow; 6] = [
        (
            Fault::SensorOutage,
            "sensors/velodyne_packet_alive",
            &["localization", "perception", "prediction", "planning", "execution"],
            &["localization/tf_quality", "localization/scan_matching"],
            1_400,
        ),
        (Fault::LocalizationJump, "localization/tf_quality", after_localization, &[], 200),
        (Fault::CostmapDelay, "perception/costmap_delay", &after_localization[1..], &[], 400),
        (Fault::PlannerStall, "planning/planner_submitted", &["execution"], &[], 700),
        (
            Fault::CanLoss,
            "can/bus",
            &["localization", "perception", "prediction", "planning", "execution"],
            &[],
            500,
        ),
        (Fault::CameraCrash, "sensors/camera_driver", &["sensors/camera_front"], &[], 1_000),
    ];
    let lasting = table.iter().flat_map(|row| [0, 100, 250, 600, 8_000].map(|more_ms| (row, more_ms)));
    for (&(fault, cause, waiting, early, within_ms), more_ms) in lasting {
        let mut story = Story::begin();
        story.drive();
        story.set_fault(fault, true);
        let all_wait = |snapshot: &Snapshot| waiting.iter().all(|tile| masked_by(snapshot, tile) == [cause]);
        let shown_ms = story.until(5_000, all_wait).unwrap_or_else(|| panic!("{fault:?}: {:?}", story.roots));
        assert!(shown_ms <= within_ms, "{fault:?} after {shown_ms} ms");
        let unsteady = story.until(more_ms, |snapshot| !all_wait(snapshot));
        assert_eq!(unsteady, None, "{fault:?}: {:?}", story.roots);

        let expected: BTreeSet<String> = [cause].iter().chain(early).map(|name| (*name).to_owned()).collect();
        assert!(story.roots.is_subset(&expected), "{fault:?}: {:?}", story.roots);
        story.roots.clear();
        story.set_fault(fault, false);
        let gone_ms = story.until(5_000, |snapshot| snapshot.overall == State::Ok);
        assert!(gone_ms.is_some(), "{fault:?} is not gone: {:?}", story.complaints());
        story.pass(3_000);
        let expected = BTreeSet::from([cause.to_owned()]);
        assert!(story.roots.is_subset(&expected), "{fault:?}, after {more_ms} ms: {:?}", story.roots);
        if early.is_empty() {
            assert_eq!(story.alarms, 1, "{fault:?}: {:?}", story.roots);
        }
    }
}

#[test]
fn in_a_sensor_outage_localization_is_in_error_until_sensors_is() {
    for driving in [false, true] {
        let mut story = Story::begin();
        if driving {
            story.drive();
        }
        story.set_fault(Fault::SensorOutage, true);
        let localization_ms =
            story.until(1_000, |snapshot| state(snapshot, "localization") == State::Error).unwrap();
        assert!(localization_ms <= 450, "{localization_ms}");
        assert_eq!(state(&story.snapshot(), "sensors"), State::Ok);
        let until_cause =
            story.until(2_000, |snapshot| state(snapshot, "localization") != State::Error).unwrap();
        let snapshot = story.snapshot();
        assert_eq!(state(&snapshot, "sensors"), State::Error, "after {until_cause} ms");
        assert_eq!(masked_by(&snapshot, "localization"), ["sensors/velodyne_packet_alive"]);
        assert_eq!(state(&snapshot, "can"), State::Ok);
    }
}

#[test]
fn at_a_stop_a_stalled_planner_does_not_matter_until_the_shuttle_drives() {
    let mut story = Story::begin();
    story.set_fault(Fault::PlannerStall, true);
    story.pass(20_000);
    assert_eq!(state(&story.snapshot(), "planning"), State::Ignore);
    story.clear();
    story.until(5_000, |snapshot| snapshot.stage == Stage::Active).expect("it sets off");
    story.until(1_000, |snapshot| state(snapshot, "planning") == State::Error).expect("it matters now");
    assert_eq!(story.roots, BTreeSet::from(["planning/planner_submitted".to_owned()]));
}

#[test]
fn a_low_battery_is_a_warning_and_no_more() {
    let mut story = Story::begin();
    story.drive();
    story.set_fault(Fault::LowBattery, true);
    story.until(2_000, |snapshot| state(snapshot, "can") == State::Warning).unwrap();
    story.pass(2_000);
    let snapshot = story.snapshot();
    assert_eq!((snapshot.overall, state(&snapshot, "localization")), (State::Warning, State::Ok));
    assert_eq!((story.roots.len(), story.alarms), (0, 0));
    assert!(snapshot.countermeasures.iter().all(|measure| !measure.request.kind().moves()));
    assert!(story.speed_mps() > 6.0, "it drives on");
}

/// The fault and what is asked of the shuttle, at last.
#[test]
fn a_fault_stops_the_shuttle_until_it_is_over_and_the_operator_releases_it() {
    let table = [
        (Fault::PlannerStall, "planning/planner_submitted", RequestKind::Decelerate, 1.0),
        (Fault::CanLoss, "can/bus", RequestKind::Decelerate, 1.0),
        (Fault::LocalizationJump, "localization/tf_quality", RequestKind::Decelerate, 1.0),
        (Fault::CostmapDelay, "perception/costmap_delay", RequestKind::Decelerate, 1.0),
        (Fault::CameraCrash, "sensors/camera_driver", RequestKind::ManeuverStop, 0.8),
    ];
    for (fault, cause, kind, mps2) in table {
        let mut story = Story::begin();
        story.drive();
        let asked = |kind: RequestKind| {
            move |snapshot: &Snapshot| {
                snapshot
                    .countermeasures
                    .iter()
                    .any(|it| it.request.kind() == kind && it.state == CountermeasureState::Engaged)
            }
        };
        story.set_fault(fault, true);
        story
            .until(1_500, asked(kind))
            .unwrap_or_else(|| panic!("{fault:?}: {:?}", story.snapshot().countermeasures));
        story.pass(1_000);
        let (before_mps, before_ms) = (story.true_speed_mps(), story.now_ms);
        story.pass(2_000);
        let fell_mps2 = (before_mps - story.true_speed_mps()) * 1000.0 / (story.now_ms - before_ms) as f64;
        assert!((fell_mps2 - mps2).abs() < 0.05, "{fault:?}: {fell_mps2} m/s²");
        let acknowledge = OperatorAction::Acknowledge { alarm: AlarmRef::Node(cause.into()) };
        assert_eq!(story.act(&acknowledge), Response::Done, "{fault:?}");
        story.pass(15_000);
        assert_eq!(story.true_speed_mps(), 0.0, "{fault:?}");
        let release = OperatorAction::Release { display_live: true, storage_ok: true };
        assert!(matches!(story.act(&release), Response::Refused(_)), "{fault:?}");
        story.set_fault(fault, false);
        story.pass(10_000);
        assert_eq!(story.true_speed_mps(), 0.0, "{fault:?}: nobody has released it");
        assert_eq!(story.act(&release), Response::Done, "{fault:?}");
        story.pass(8_000);
        assert!(story.snapshot().countermeasures.iter().all(|it| !it.request.kind().moves()));
        assert!(story.true_speed_mps() > 3.0, "{fault:?}: it drives on, {}", story.true_speed_mps());
    }
}

#[test]
fn when_the_mission_dies_everything_is_diagnosed_on_and_said() {
    let mut story = Story::begin();
    story.drive();
    story.silence("/mission/active");
    story.until(4_000, |snapshot| state(snapshot, "mission") == State::Error).expect("it is missed");
    let snapshot = story.snapshot();
    assert_eq!((snapshot.stage, state(&snapshot, "telltale")), (Stage::Active, State::Error));
    assert_ne!(state(&snapshot, "planning"), State::Ok);
}
