//! Tests of the simulated robot: its drive, its topics and its faults.

use super::*;

fn at(ms: u64) -> Timestamp {
    Timestamp::from_millis(ms)
}

/// The messages of a robot in this time, in steps of its own time.
fn heard(robot: &mut Robot, from_ms: u64, until_ms: u64) -> Vec<Message> {
    (from_ms..until_ms).step_by(10).flat_map(|ms| robot.advance(at(ms))).map(|sent| sent.message).collect()
}

fn number<T>(messages: &[Message], pick: impl Fn(&Message) -> Option<T>) -> usize {
    messages.iter().filter_map(pick).count()
}

#[test]
fn it_charges_drives_to_both_places_and_charges_again() {
    let mut robot = Robot::new(1, Timestamp::ZERO);
    let messages = heard(&mut robot, 0, 180_000);
    let mut places: Vec<(bool, bool)> = Vec::new();
    let (mut docked, mut navigating) = (true, false);
    for message in &messages {
        match message {
            Message::Docked(is) => docked = *is,
            Message::Navigating(is) => navigating = *is,
            _ => continue,
        }
        if places.last() != Some(&(docked, navigating)) && !(docked && navigating) {
            places.push((docked, navigating));
        }
    }
    let journey =
        [(true, false), (false, true), (false, false), (false, true), (false, false), (false, true)];
    assert!(places.len() > 6 && places.iter().zip(journey).all(|(found, it)| *found == it), "{places:?}");
    assert_eq!(places.iter().filter(|it| **it == (true, false)).count(), 2, "{places:?}");
    let rate = |pick: fn(&Message) -> bool| messages.iter().filter(|it| pick(it)).count() / 180;
    assert!((9..=10).contains(&rate(|it| matches!(it, Message::Scan(Lidar::Front)))));
    assert!((49..=50).contains(&rate(|it| matches!(it, Message::Imu { .. }))));
    let charging = |message: &Message| match message {
        Message::Battery { current_a, .. } if *current_a > 5.0 => Some(()),
        _ => None,
    };
    assert!(number(&messages, charging) > 20);
}

#[test]
fn faults_are_faults_of_the_data_and_end() {
    let drives = || {
        let mut robot = Robot::new(1, Timestamp::ZERO);
        heard(&mut robot, 0, 22_000);
        robot
    };
    let command = |it: &Message| matches!(it, Message::Command { .. }).then_some(());
    let front = |it: &Message| matches!(it, Message::Scan(Lidar::Front)).then_some(());
    let turns = |it: &Message| match it {
        Message::Odometry { yaw_rate, .. } if *yaw_rate > 0.4 => Some(()),
        _ => None,
    };
    let lost = |it: &Message| match it {
        Message::Position { variance_m2, .. } if *variance_m2 > 1.0 => Some(()),
        _ => None,
    };
    for fault in Fault::ALL {
        let mut robot = drives();
        robot.set_fault(fault, true);
        let messages = heard(&mut robot, 22_000, 24_000);
        assert_eq!(number(&messages, front) == 0, fault == Fault::LidarOutage, "{fault:?}");
        assert_eq!(number(&messages, lost) > 0, fault == Fault::LocalizationLost, "{fault:?}");
        assert_eq!(number(&messages, turns) > 30, fault == Fault::WheelSlip, "{fault:?}");
        let stalls = [Fault::NavigationStall, Fault::ControllerCrash, Fault::LocalizationLost];
        assert_eq!(number(&messages, command) == 0, stalls.contains(&fault), "{fault:?}");
        assert_eq!(robot.nodes().len(), if fault == Fault::ControllerCrash { 10 } else { 11 });
        robot.set_fault(fault, false);
        let messages = heard(&mut robot, 24_000, 26_000);
        assert!(number(&messages, command) > 30 && number(&messages, lost) == 0, "{fault:?}");
    }
    assert!(Fault::ALL.into_iter().all(|fault| Fault::from_word(fault.info().name) == Some(fault)));
}

#[test]
fn what_is_asked_of_it_holds_it_until_it_is_released() {
    let fastest_mps = |messages: &[Message]| {
        let speeds = messages.iter().filter_map(|message| match message {
            Message::Odometry { speed_mps, .. } => Some(*speed_mps),
            _ => None,
        });
        speeds.fold(0.0, f64::max)
    };
    for order in [Order::Decelerate(1.0), Order::Stop(true), Order::Hold(true)] {
        let mut robot = Robot::new(1, Timestamp::ZERO);
        assert!(fastest_mps(&heard(&mut robot, 0, 25_000)) > 1.0);
        robot.obey(order);
        robot.obey(Order::Stop(false));
        heard(&mut robot, 25_000, 30_000);
        assert_eq!(fastest_mps(&heard(&mut robot, 30_000, 90_000)), 0.0, "{order:?}");
        robot.obey(Order::Hold(false));
        assert!(fastest_mps(&heard(&mut robot, 90_000, 95_000)) > 1.0, "{order:?}");
    }
}
