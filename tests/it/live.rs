//! `telltale check --live` and `telltale init --update`: a configuration beside a foreign robot over DDS.

use std::process::Output;

use serde_json::{Value, json};

use crate::first_configuration::{Robot, telltale};
use crate::folder::TestFolder;
use crate::peer::{Domain, Peer, Vendor};
use crate::program::run;

fn robot(domain: &mut Domain) -> Robot {
    let good =
        |name: &str| json!({"level": 0, "name": name, "message": "fine", "hardware_id": "", "values": {}});
    let statuses = json!({"statuses": [good("gripper: motor"), good("gripper: vacuum")]});
    let announced = json!({"info": {"size": 16, "name": "gripper"}});
    let info = "--durability transient_local pub --topic ros_discovery_info --type ParticipantEntitiesInfo";
    let odometry = "pub --topic rt/base/odom --type nav_msgs::msg::dds_::Odometry_";
    let mut peers = vec![
        (Peer::start(domain, "pub"), vec![statuses]),
        (Peer::start(domain, odometry), vec![json!({"message": "Odometry", "fields": {}})]),
    ];
    domain.vendor = Vendor::Cyclone;
    peers.push((Peer::start(domain, info), vec![announced]));
    peers.push((Peer::start(domain, "pub --topic rt/driving --type Bool"), vec![json!({"bool": true})]));
    Robot::start(peers)
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn a_file_is_compared_with_a_foreign_robot_and_what_is_new_is_added() {
    let mut domain = Domain::of(Vendor::FastDds);
    let running = robot(&mut domain);
    let folder = TestFolder::new("live");
    std::fs::create_dir_all(&*folder).expect("a folder can be made");
    let file = folder.join("robot.yaml");
    let path = file.to_str().expect("it is text");
    // On a busy machine it hears too little in a short time.
    for time in ["6s", "15s", "60s"] {
        let is_last = time == "60s";
        let run = |words: &[&str]| telltale(&domain, &[words, &["--for", time]].concat());
        let made = run(&["init"]);
        assert!(made.status.success(), "{}", text(&made.stderr));
        let whole = text(&made.stdout);
        std::fs::write(&file, &whole).expect("it can be written");

        // Nothing has changed.
        let same = run(&["check", "--live", "--json", path]);
        let updated = run(&["init", "--update", path]);
        let found: Value = serde_json::from_slice(&same.stdout).expect("it is JSON");
        let is_same = |output: &Output| output.status.code() == Some(0);
        let unwatched = &found["live"]["unwatched"];
        let none = ["statuses", "topics", "nodes"].iter().all(|kind| unwatched[kind] == json!([]));
        let stays = is_same(&updated) && text(&updated.stdout) == whole;
        if !(is_last || is_same(&same) && none && stays) {
            continue;
        }
        assert!(is_same(&same) && none, "{found:#}");
        assert!(stays, "{}\n{}", text(&updated.stdout), text(&updated.stderr));

        // People changed the file, and it names what this robot does not have.
        let old = "\
# Ours.
vehicle: { id: robot, name: Robot, stages: none }
groups:
  - id: hand # the gripper
    modules:
      - { id: motor, status: 'gripper: motor', timeout: 5s }
      - { id: vacuum, status: 'gripper: vacum', timeout: 5s }
      - id: odometry
        monitor: { frequency: { topic: /base/odom, type: nav_msgs/msg/Path, error_below: 1 } }
      - { id: scan, monitor: { frequency: { topic: /scan, type: sensor_msgs/msg/LaserScan, error_below: 1 } } }
      - { id: arm, monitor: { watchdog: { node: /arm } } }
";
        std::fs::write(&file, old).expect("it can be written");
        let other = run(&["check", "-q", "--live", "--json", path]);
        let found: Value = serde_json::from_slice(&other.stdout).expect("it is JSON");
        let problems = found["problems"].as_array().expect("it is a list");
        let lines = problems.iter().filter(|it| it["severity"] == "error");
        let lines: Vec<_> = lines.map(|it| (it["line"].as_u64(), it["message"].to_string())).collect();
        let expected = [
            (Some(7), "\"no status `gripper: vacum` was heard\""),
            (Some(9), "\"/base/odom is published as nav_msgs/msg/Odometry, and read as nav_msgs/msg/Path\""),
            (Some(10), "\"nobody publishes /scan\""),
            (Some(11), "\"there is no node /arm\""),
        ]
        .map(|(line, message)| (line, message.to_owned()));
        let update = run(&["init", "--update", path, "-o", path]);
        let written = std::fs::read_to_string(&file).expect("it is there");
        let wanted = [
            "status: 'gripper: vacuum'",
            "topic: /driving, type: std_msgs/msg/Bool",
            "# Added by `telltale init --update`",
        ];
        let is_whole = lines == expected && wanted.iter().all(|part| written.contains(part));
        if !is_whole && !is_last {
            continue;
        }
        assert_eq!(lines, expected, "{found:#}");
        assert_eq!((other.status.code(), &found["ok"]), (Some(1), &json!(false)), "{found:#}");
        assert_eq!(update.status.code(), Some(1), "a missing name is told: {}", text(&update.stderr));
        for part in wanted.iter().copied().chain(old.lines()) {
            assert!(written.contains(part), "lacks {part}:\n{written}");
        }
        let checked = telltale::config::load(&file);
        assert!(checked.is_ok(), "{checked:?}");
        break;
    }
    drop(running);
}

#[test]
fn a_file_is_not_judged_where_nobody_is() {
    let domain = Domain::take();
    let file = concat!(env!("CARGO_MANIFEST_DIR"), "/config/robot.yaml");
    let checked = telltale(&domain, &["check", "-q", "--live", "--for", "1s", file]);
    let said = text(&checked.stderr);
    assert_eq!(checked.status.code(), Some(1), "{said}");
    assert!(said.contains("nobody was found, so nothing was compared"), "{said}");
    assert!(said.contains("for 5 s: nobody was found.") && !said.contains("/scan_front"), "{said}");
    let updated = telltale(&domain, &["init", "--update", file, "--for", "1s"]);
    let said = text(&updated.stderr);
    assert!(updated.status.code() == Some(2) && updated.stdout.is_empty(), "{said}");
    let said = text(&run(["check", "--domain", "1", file]).stderr);
    assert!(said.contains("--live"), "{said}");
}
