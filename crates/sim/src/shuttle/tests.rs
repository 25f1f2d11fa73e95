//! Tests of the simulated shuttle: its drive, its faults, and how it obeys requests.

use super::*;

const STEP_S: f64 = 0.01;

fn at(ms: u64) -> Timestamp {
    Timestamp::from_millis(ms)
}

/// A shuttle with everything that it published, and when.
struct Watched {
    shuttle: Shuttle,
    now_ms: u64,
    heard: Vec<(u64, Message)>,
}

impl Watched {
    fn new(departure: Departure) -> Watched {
        Watched { shuttle: Shuttle::new(7, Timestamp::ZERO, &[], departure), now_ms: 0, heard: Vec::new() }
    }

    /// Drives by itself, at full speed.
    fn driving() -> Watched {
        let mut watched = Watched::new(Departure::Alone);
        watched.pass(35_000);
        assert_eq!(watched.active(), Some(true));
        assert!(watched.speed_mps() > 6.9);
        watched.heard.clear();
        watched.pass(100);
        watched
    }

    fn pass(&mut self, ms: u64) {
        self.giving(ms, None);
    }

    /// Advances with an order twenty times a second.
    fn giving(&mut self, ms: u64, order: Option<Order>) {
        for _ in 0..ms / 10 {
            if let Some(order) = order.filter(|_| self.now_ms.is_multiple_of(50)) {
                self.shuttle.obey(order);
            }
            self.now_ms += 10;
            let sent = self.shuttle.advance(at(self.now_ms));
            self.heard.extend(sent.into_iter().map(|sent| (sent.at.as_nanos() / 1_000_000, sent.message)));
        }
    }

    /// The times and contents of some messages.
    fn all<T>(&self, pick: impl Fn(&Message) -> Option<T>) -> Vec<(u64, T)> {
        self.heard.iter().filter_map(|(at_ms, message)| Some((*at_ms, pick(message)?))).collect()
    }

    fn last<T>(&self, pick: impl Fn(&Message) -> Option<T>) -> Option<T> {
        self.all(pick).pop().map(|(_, value)| value)
    }

    fn active(&self) -> Option<bool> {
        self.last(active)
    }

    fn speed_mps(&self) -> f64 {
        self.last(speed).expect("the wheels are heard")
    }

    /// Levels above OK, the latest of each status.
    fn complaints(&self) -> Vec<(String, u8)> {
        let mut levels = std::collections::BTreeMap::new();
        for (_, message) in &self.heard {
            if let Message::Diagnostics(array) = message {
                for status in array.iter() {
                    levels.insert(status.name().to_owned(), status.level());
                }
            }
        }
        levels.into_iter().filter(|(_, level)| *level != 0).collect()
    }
}

fn active(message: &Message) -> Option<bool> {
    if let Message::Active(active) = message { Some(*active) } else { None }
}

fn speed(message: &Message) -> Option<f64> {
    if let Message::WheelSpeed { mps } = message { Some(*mps) } else { None }
}

fn position(message: &Message) -> Option<Pose2d> {
    if let Message::Position(pose) = message { Some(Pose2d::of_pose(pose)) } else { None }
}

fn odometry(message: &Message) -> Option<Pose2d> {
    if let Message::Odometry { pose, .. } = message { Some(Pose2d::of_pose(pose)) } else { None }
}

fn goal(message: &Message) -> Option<Pose2d> {
    if let Message::Goal(pose) = message { Some(Pose2d::of_pose(pose)) } else { None }
}

fn decelerates(message: &Message) -> Option<bool> {
    if let Message::Decelerates(on) = message { Some(*on) } else { None }
}

fn stops(message: &Message) -> Option<bool> {
    if let Message::Stops(on) = message { Some(*on) } else { None }
}

#[test]
fn same_seed_and_instants_same_messages_however_time_is_cut() {
    let run = |seed, cut_ms: usize| {
        let mut shuttle = Shuttle::new(seed, Timestamp::ZERO, &[], Departure::Alone);
        (0..=24_000).step_by(cut_ms).flat_map(|ms| shuttle.advance(at(ms as u64))).collect::<Vec<_>>()
    };
    assert_eq!(run(1, 10), run(1, 1000));
    assert_ne!(run(1, 10), run(2, 10));
}

#[test]
fn alone_it_alternates_between_stops_and_drives_and_complains_of_nothing() {
    let mut watched = Watched::new(Departure::Alone);
    watched.pass(300_000);
    assert_eq!(watched.complaints(), []);
    let mut changes = watched.all(active);
    changes.dedup_by_key(|(_, active)| *active);
    assert!(changes.len() >= 8, "{changes:?}");
    for pair in changes[1..].windows(2) {
        let length_ms = pair[1].0 - pair[0].0;
        let expected = if pair[0].1 { 25_000..70_000 } else { 9_000..11_000 };
        assert!(expected.contains(&length_ms), "{changes:?}");
    }
    let rates = [
        (watched.all(speed).len(), 50),
        (watched.all(position).len(), 25),
        (watched.all(odometry).len(), 25),
        (watched.all(|message| (*message == Message::Scan).then_some(())).len(), 10),
    ];
    for (count, per_s) in rates {
        assert!((count as i64 - per_s * 300).abs() <= 3, "{count} in 300 s, not {per_s} a second");
    }
}

#[test]
fn the_position_moves_as_the_wheels_say_and_both_as_the_speed_does() {
    let watched = {
        let mut watched = Watched::driving();
        watched.pass(5_000);
        watched
    };
    for (pick, slack_m) in [(position as fn(&Message) -> Option<Pose2d>, 0.1), (odometry, 0.15)] {
        let places = watched.all(pick);
        for pair in places.windows(13).map(|window| (window[0], window[12])) {
            let ((from_ms, from), (to_ms, to)) = pair;
            let speeds = watched.all(speed);
            let between = speeds.iter().filter(|(at_ms, _)| (from_ms..to_ms).contains(at_ms));
            let way_m: f64 = between.map(|(_, mps)| mps * 0.02).sum();
            assert!((from.distance_m(to) - way_m).abs() < slack_m, "{from_ms}: {way_m}");
        }
    }
}

#[test]
fn the_whole_story_localize_wait_for_a_goal_clear_drive_arrive_and_again() {
    let mut watched = Watched::new(Departure::Cleared);
    watched.pass(20_000);
    assert_eq!((watched.last(position), watched.last(goal)), (None, None), "nobody said where it is");
    let complains: Vec<String> = watched.complaints().into_iter().map(|(name, _)| name).collect();
    assert_eq!(
        complains,
        ["localization: scan_matching", "prediction: lane_matching", "prediction: trajectories"]
    );

    let depot = Pose2d { x_m: 12.0, y_m: 3.5, yaw: 1.57 };
    watched.shuttle.obey(Order::Localize(Pose2d { x_m: 20.0, ..depot }.pose()));
    watched.pass(3_000);
    assert_eq!(watched.last(position), None, "8 m off is too far");
    assert!(watched.complaints().contains(&("localization: scan_matching".into(), 2)));
    let given_ms = watched.now_ms;
    watched.shuttle.obey(Order::Localize(Pose2d { x_m: 13.0, ..depot }.pose()));
    watched.pass(4_000);
    let (found_ms, found) = watched.all(position)[0];
    assert!((1_000..1_400).contains(&(found_ms - given_ms)), "{}", found_ms - given_ms);
    assert!(found.distance_m(depot) < 0.1, "the scans know better");
    assert_eq!(watched.complaints(), []);

    for _journey in 0..4 {
        watched.pass(10_000);
        let goal = watched.last(goal).expect("the mission has one");
        watched.pass(20_000);
        assert_eq!(watched.active(), Some(false), "it was not cleared");
        let cleared_ms = watched.now_ms;
        watched.shuttle.obey(Order::Clear(true));
        watched.pass(4_000);
        let left_ms = watched.all(active).iter().rev().find(|(_, active)| !active).expect("it stood").0;
        assert!(watched.active() == Some(true) && left_ms - cleared_ms < 3_000);
        watched.pass(70_000);
        assert_eq!((watched.active(), watched.speed_mps()), (Some(false), 0.0), "it has arrived");
        assert!(watched.last(position).expect("it knows").distance_m(goal) < 0.1);
        // The old clearance is used up, even if it is repeated.
        watched.shuttle.obey(Order::Clear(true));
        watched.pass(20_000);
        assert_eq!(watched.active(), Some(false));
        watched.shuttle.obey(Order::Clear(false));
    }
}

#[test]
fn a_clearance_that_is_taken_back_before_it_leaves_is_none() {
    let mut watched = Watched::new(Departure::Cleared);
    watched.shuttle.obey(Order::Localize(Pose2d { x_m: 12.0, y_m: 3.5, yaw: 1.57 }.pose()));
    watched.pass(10_000);
    watched.shuttle.obey(Order::Clear(true));
    watched.pass(2_000);
    watched.shuttle.obey(Order::Clear(false));
    watched.pass(5_000);
    assert_eq!(watched.active(), Some(false));
}

#[test]
fn it_decelerates_as_it_is_asked_to_and_stands_until_it_is_released() {
    for (asked_mps2, expected_mps2) in [(0.5, 0.5), (1.0, 1.0), (2.5, 2.5), (f64::INFINITY, 6.0)] {
        let mut watched = Watched::driving();
        let from_mps = watched.speed_mps();
        let takes_ms = (from_mps / expected_mps2 * 1000.0) as u64;
        let begin_ms = watched.now_ms;
        watched.giving(takes_ms + 1_000, Some(Order::Decelerate(asked_mps2)));
        for (at_ms, mps) in watched.all(speed).into_iter().filter(|(at_ms, _)| *at_ms > begin_ms) {
            let expected = (from_mps - expected_mps2 * (at_ms - begin_ms) as f64 / 1000.0).max(0.0);
            assert!((mps - expected).abs() < 0.15, "{asked_mps2}: {mps} instead of {expected} at {at_ms}");
        }
        assert_eq!((watched.speed_mps(), watched.active()), (0.0, Some(true)));
        let confirmed_ms = watched.all(decelerates).iter().find(|(_, on)| *on).expect("it confirms").0;
        assert!(confirmed_ms - begin_ms <= 10);
        watched.pass(60_000);
        assert_eq!(
            (watched.last(decelerates), watched.speed_mps()),
            (Some(true), 0.0),
            "silence ends nothing"
        );
        watched.shuttle.obey(Order::Hold(false));
        watched.pass(3_000);
        assert_eq!(watched.last(decelerates), Some(false));
        assert!(watched.speed_mps() > 2.0);
    }
}

#[test]
fn whatever_was_asked_once_brakes_it_to_a_halt_and_holds_it() {
    let orders = [Order::Decelerate(1.0), Order::Stop(true), Order::Hold(true)];
    for order in orders {
        let mut watched = Watched::driving();
        watched.shuttle.obey(order);
        // Only the end of the request, not a release.
        watched.shuttle.obey(Order::Stop(false));
        watched.pass(15_000);
        let begin_ms = watched.now_ms;
        watched.pass(60_000);
        let moved = watched.all(speed).iter().any(|(at_ms, mps)| *at_ms > begin_ms && *mps > 0.0);
        assert!(!moved, "{order:?}");
        watched.shuttle.obey(Order::Hold(false));
        watched.pass(5_000);
        assert!(watched.speed_mps() > 2.0, "{order:?}");
    }
    // At a stop it does not set off.
    let mut watched = Watched::new(Departure::Alone);
    watched.shuttle.obey(Order::Stop(true));
    watched.shuttle.obey(Order::Stop(false));
    watched.pass(60_000);
    assert_eq!(watched.active(), Some(false));
    watched.shuttle.obey(Order::Hold(false));
    watched.pass(5_000);
    assert_eq!(watched.active(), Some(true));
}

#[test]
fn what_is_no_deceleration_asks_for_nothing() {
    for mps2 in [f64::NAN, -1.0, 0.0, f64::NEG_INFINITY] {
        let mut watched = Watched::driving();
        watched.giving(2_000, Some(Order::Decelerate(mps2)));
        assert_eq!(watched.last(decelerates), Some(false), "{mps2}");
        assert!(watched.speed_mps() > 6.9, "{mps2}");
    }
    let mut watched = Watched::new(Departure::Cleared);
    watched.shuttle.obey(Order::Localize(Pose { x_m: f64::NAN, ..Pose::default() }));
    watched.pass(3_000);
    assert_eq!(watched.last(position), None);
}

#[test]
fn a_safe_stop_is_comfortable_and_lasts_until_the_release() {
    let mut watched = Watched::driving();
    watched.shuttle.obey(Order::Stop(true));
    watched.pass(15_000);
    assert_eq!((watched.speed_mps(), watched.last(stops)), (0.0, Some(true)));
    let speeds = watched.all(speed);
    for pair in speeds.windows(26).map(|window| (window[0].1, window[25].1)) {
        let mps2 = (pair.0 - pair.1) / 0.5;
        assert!(mps2 < 0.95, "{mps2} m/s²");
    }
    let first_mps2 = (speeds[0].1 - speeds[10].1) / 0.2;
    assert!(first_mps2 < 0.5, "it begins gently: {first_mps2} m/s²");
    watched.shuttle.obey(Order::Hold(false));
    watched.pass(5_000);
    assert_eq!(watched.speed_mps(), 0.0, "the request itself has not ended");
    watched.shuttle.obey(Order::Stop(false));
    watched.pass(5_000);
    assert!(watched.speed_mps() > 2.0);
}

#[test]
fn faults_are_faults_of_the_data() {
    let silent = |watched: &Watched, from_ms: u64, pick: &dyn Fn(&Message) -> bool| {
        !watched.heard.iter().any(|(at_ms, message)| *at_ms > from_ms && pick(message))
    };
    let scan = |message: &Message| *message == Message::Scan;
    let plan = |message: &Message| matches!(message, Message::Trajectory(_));
    let bus = |message: &Message| speed(message).is_some() || matches!(message, Message::Battery { .. });
    for fault in Fault::ALL {
        let mut watched = Watched::driving();
        watched.shuttle.set_fault(fault, true);
        let from_ms = watched.now_ms;
        watched.pass(2_000);
        let missing = [
            silent(&watched, from_ms, &scan),
            silent(&watched, from_ms, &plan),
            silent(&watched, from_ms, &bus),
        ];
        let places = watched.all(position);
        let steps = places.windows(2).map(|pair| pair[0].1.distance_m(pair[1].1));
        let jumps = steps.filter(|step_m| *step_m > 1.0).count();
        let ages = watched.all(|message| {
            if let Message::Costmap { age } = message { Some(age.as_nanos() / 1_000_000) } else { None }
        });
        let charge = watched
            .last(|message| if let Message::Battery { charge, .. } = message { Some(*charge) } else { None });
        let last_seen_ms = places.last().map_or(0, |(at_ms, _)| at_ms - from_ms);
        match fault {
            Fault::SensorOutage => {
                assert_eq!(missing, [true, false, false]);
                assert!((500..800).contains(&last_seen_ms), "{last_seen_ms}");
                let stands = places.windows(2).filter(|pair| pair[0].1 == pair[1].1).count();
                assert!(stands > 8, "the position stands still before it is gone");
            }
            Fault::LocalizationJump => {
                assert!(missing == [false, true, false] && jumps >= 3, "{jumps} {missing:?}")
            }
            Fault::CostmapDelay => {
                let last_ms = ages.last().expect("maps come").1;
                assert!(missing == [false; 3] && (1_800..2_100).contains(&last_ms), "{last_ms}");
            }
            Fault::PlannerStall => assert_eq!(missing, [false, true, false]),
            Fault::CanLoss => assert_eq!((missing[0], missing[2]), (false, true)),
            Fault::LowBattery => assert!(missing == [false; 3] && charge == Some(0.17)),
            Fault::CameraCrash => {
                let said = |status: &str| {
                    let from_camera = |message: &Message| matches!(message, Message::Diagnostics(array) if array.iter().any(|it| it.name() == status));
                    !silent(&watched, from_ms + 100, &from_camera)
                };
                assert!(missing == [false; 3] && said("imu: status") && !said("camera_front: image_rate"));
                let nodes = watched.shuttle.nodes();
                assert!(nodes.contains(&"imu_driver") && !nodes.contains(&"camera_driver"), "{nodes:?}");
            }
        }
        watched.shuttle.set_fault(fault, false);
        watched.pass(8_000);
        assert_eq!(watched.complaints(), [], "{fault:?} is over");
        assert_eq!(watched.shuttle.nodes().len(), 11, "{fault:?}");
        assert!(watched.speed_mps() > 1.0 || watched.active() == Some(false), "{fault:?}");
    }
}

#[test]
fn without_a_trajectory_it_rolls_to_a_halt() {
    let mut watched = Watched::driving();
    watched.shuttle.set_fault(Fault::PlannerStall, true);
    let from_mps = watched.speed_mps();
    watched.pass(4_300);
    let lost_mps = from_mps - watched.speed_mps();
    assert!((lost_mps - 0.5 * 4.0).abs() < 0.1 + 50.0 * STEP_S * 0.1, "{lost_mps}");
}

#[test]
fn a_stopped_process_does_not_flood_the_bus_afterwards() {
    let mut shuttle = Shuttle::new(7, Timestamp::ZERO, &[], Departure::Alone);
    let a_second = shuttle.advance(at(1_000)).len();
    let after_an_hour = shuttle.advance(at(3_600_000)).len();
    assert!(after_an_hour < a_second * 7, "{after_an_hour} messages after an hour");
    let next = shuttle.advance(at(3_601_000)).len();
    assert!((a_second / 2..a_second * 2).contains(&next));
}

#[test]
fn the_words_of_faults_are_read_back() {
    for fault in Fault::ALL {
        assert_eq!(Fault::from_word(fault.info().name), Some(fault));
    }
    assert_eq!(Fault::from_word("none"), None);
}
