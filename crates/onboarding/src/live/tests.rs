//! Tests of the comparison of a configuration with the observations of a running system.

use super::*;
use crate::pretend::Robot;
use telltale_yaml::Problems;

const FILE: &str = "\
vehicle: { id: r, stages: none }
defaults: { timeout: 2s }
groups:
- id: lidar
  match: [{ namespace: lidar }]
  modules:
  - id: device
    status: 'lidar: device'
  - { id: slow, status: 'lidar: slow', timeout: 60s }
  - { id: rate, monitor: { frequency: { topic: /scan, type: sensor_msgs/msg/LaserScan, warning_below: 7, error_below: 4 } } }
  - { id: runs, monitor: { watchdog: { node: /lidar } } }
  - { id: reset, monitor: { watchdog: { service: /lidar/reset } } }
";

fn robot() -> Robot {
    let robot = Robot::default().publishes("/lidar", "/scan", 100).says("/lidar", "lidar: device");
    robot.serves("/lidar", "/lidar/reset")
}

fn compared(file: &str, robot: Robot) -> (Vec<String>, Comparison) {
    let loaded = telltale_config::parse("f", file).unwrap_or_else(|problems| panic!("{problems}"));
    let comparison = compare(&loaded, &robot.heard());
    let lines = Problems::new(loaded.sources().clone(), comparison.problems.clone()).lines();
    (lines, comparison)
}

#[test]
fn a_robot_that_is_as_the_file_says_has_no_findings() {
    let (lines, comparison) = compared(FILE, robot());
    assert_eq!(lines, [] as [&str; 0]);
    // A minute of silence is allowed, and ten seconds say nothing.
    assert_eq!((comparison.absent, &*comparison.undecided), (0, &["lidar: slow".to_owned()][..]));
    assert_eq!(comparison.unwatched.count(), 0, "{:?}", comparison.unwatched);
}

#[test]
fn what_the_file_names_and_is_not_there_is_found_at_its_place() {
    let robot = Robot::default()
        .publishes("/lidar_front", "/scan_front", 100)
        .says("/lidar_front", "lidar: devices")
        .serves("/lidar_front", "/lidar/restart");
    let (lines, comparison) = compared(FILE, robot);
    assert_eq!(
        lines,
        [
            "f:8:13: no status `lidar: device` was heard (`lidar: devices` is there: was it renamed?)",
            "f:10:48: nobody publishes /scan (`/scan_front` is there: was it renamed?)",
            "f:11:46: there is no node /lidar (`/lidar_front` is there: was it renamed?)",
            "f:12:50: no node offers the service /lidar/reset (`/lidar/restart` is there: was it renamed?)",
        ]
    );
    assert_eq!(comparison.absent, 4);
    let unwatched = ["1 topic that nothing reads (`telltale init --update` adds it): /scan_front"];
    assert_eq!(comparison.unwatched.sentences(), unwatched);
}

#[test]
fn another_type_and_another_rate_are_changes() {
    let file = FILE.replace("LaserScan", "Imu");
    let (lines, comparison) = compared(&file, robot());
    let expected = "f:10:61: /scan is published as sensor_msgs/msg/LaserScan, and read as sensor_msgs/msg/Imu (write the type \
                    that is published, or name the topic that is meant)";
    assert_eq!((&*lines, comparison.absent), (&[expected.to_owned()][..], 1));
    let slow = Robot::default()
        .publishes("/lidar", "/scan", 200)
        .says("/lidar", "lidar: device")
        .serves("/lidar", "/lidar/reset");
    let (lines, comparison) = compared(FILE, slow);
    let expected = "f:10:11: /scan came at 5.0 Hz, for which this is WARNING: the limit is 7 Hz (look whether the robot \
                    changed or the limit is right)";
    assert_eq!((&*lines, comparison.absent), (&[expected.to_owned()][..], 0));
}

#[test]
fn what_nobody_watches_is_listed_in_order_and_bounded() {
    let mut robot = robot().publishes("/imu", "/imu/data", 20).says("/imu", "imu: device");
    robot = robot.says("/lidar", "lidar: mirror").says("/battery", "battery\n- id: forged: x");
    for number in 0..30 {
        robot = robot.says("/many", &format!("part {number:02}"));
    }
    let file = FILE.replace("timeout: 2s", "timeout: 2s, forget_after: 1h");
    let (lines, comparison) = compared(&file, robot);
    assert_eq!((lines, comparison.absent), (Vec::new(), 0));
    let lines = comparison.unwatched.sentences();
    let adds = |them: &str| format!("(`telltale init --update` adds {them})");
    let forgotten = format!(
        "1 status that only a `match` takes, and that is forgotten when it falls silent {}: lidar: mirror",
        adds("it")
    );
    assert!(lines.contains(&forgotten), "{lines:#?}");
    assert!(lines.contains(&format!("1 topic that nothing reads {}: /imu/data", adds("it"))), "{lines:#?}");
    let statuses = lines.iter().find(|line| {
        line.starts_with(&format!("32 statuses that no module takes {}: battery - id: forged", adds("them")))
    });
    let ends = "part 17 and 12 more";
    assert!(statuses.is_some_and(|line| line.ends_with(ends) && !line.contains('\n')), "{lines:#?}");
}

#[test]
fn a_topic_for_which_no_monitor_is_proposed_is_named_unless_something_reads_it() {
    let unsteady = |file: &str| {
        let robot = robot().publishes("/teleop", "/joy", 6000).publishes("/lidar", "/map", 20_000);
        compared(file, robot).1.unwatched.sentences()
    };
    let watch = "(`init` proposes no monitor; a `frequency` with a longer `window` can watch";
    let both = format!("2 topics without a steady rate that nothing reads {watch} them): /joy, /map");
    assert!(unsteady(FILE).contains(&both), "{:#?}", unsteady(FILE));
    let reads = "  - { id: joy, monitor: { frequency: { topic: /joy, type: sensor_msgs/msg/LaserScan, error_below: 0.1 } } }\n";
    let one = format!("1 topic without a steady rate that nothing reads {watch} it): /map");
    assert!(unsteady(&format!("{FILE}{reads}")).contains(&one), "{:#?}", unsteady(&format!("{FILE}{reads}")));
}

#[test]
fn nothing_is_said_of_a_file_when_nobody_was_there() {
    let (lines, comparison) = compared(FILE, Robot::default());
    assert!(comparison.nobody && comparison.absent == 1 && lines.len() == 1, "{lines:?}");
    assert!(lines[0].starts_with("nobody was found, so nothing was compared"), "{lines:?}");
}

#[test]
fn a_robot_without_diagnostics_is_one_finding() {
    let robot = Robot::default().publishes("/lidar", "/scan", 100).serves("/lidar", "/lidar/reset");
    let (lines, comparison) = compared(FILE, robot);
    assert!(lines.len() == 1 && lines[0].starts_with("no status was heard on /diagnostics"), "{lines:?}");
    assert_eq!(comparison.absent, 1);
}
