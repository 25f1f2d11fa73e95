//! Tests of an update: its additions to a configuration, and that it keeps the text that people wrote.

use super::*;
use crate::init;
use crate::live;
use crate::pretend::Robot;

const WHEN: &str = "heard on 2026-01-02";

fn robot() -> Robot {
    Robot::default()
        .publishes("/lidar", "/scan", 100)
        .says("/lidar", "lidar: device")
        .publishes("/base", "/odom", 50)
        .says("/base", "base: motors")
}

/// The text after an update with the observations of a robot. A second update adds nothing.
#[track_caller]
fn updated(text: &str, robot: fn() -> Robot) -> Updated {
    let once = once(text, robot);
    let twice = self::once(&once.text, robot);
    assert_eq!((&*twice.text, &*twice.modules), (&*once.text, &[][..]), "{:?}", twice);
    once
}

fn once(text: &str, robot: fn() -> Robot) -> Updated {
    let is_known = |type_name: &str| type_name.starts_with("sensor_msgs/");
    of_files(&[("f", text)], robot(), is_known).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

/// An update of a file, which includes the others.
fn of_files(
    files: &[(&str, &str)],
    robot: Robot,
    is_known: impl Fn(&str) -> bool,
) -> Result<Updated, NoPlace> {
    let texts = files.iter().map(|(name, text)| ((*name).to_owned(), (*text).to_owned()));
    let loaded = telltale_config::of_texts(texts).unwrap_or_else(|problems| panic!("{problems}\n{files:?}"));
    let heard = robot.heard();
    let unwatched = live::compare(&loaded, &heard).unwatched;
    update(&loaded, heard.draft, &unwatched, is_known, WHEN)
}

/// Each line of the old text stands in the new one, in order.
#[track_caller]
fn keeps(old: &str, new: &str) {
    let mut lines = new.lines();
    for line in old.lines() {
        assert!(lines.any(|it| it == line), "{line} is gone:\n{new}");
    }
}

#[test]
fn the_file_of_an_unchanged_robot_stays_byte_for_byte() {
    let text = init::text(&robot().heard().draft, false);
    let updated = updated(&text, robot);
    assert_eq!((updated.text, updated.left), (text, Vec::new()));
}

#[test]
fn what_is_new_joins_its_group_or_a_new_one_and_people_keep_their_words() {
    let text = "\
# Mine.
vehicle: { id: r, stages: none } # no stages
defaults: { timeout: 2s, forget_after: 1h }

groups:
  - id: sensors   # all of them
    name: Sensors
    modules:
      - id: front
        status: 'lidar: device'
        help: |
          Wipe it.

          # Not a comment.
      # Not yet: { id: rear }

    match:
    - namespace: lidar

  # The rest.
  - id: other_things
    match: [{ name: x }]
# The end.
";
    let more = || robot().says("/lidar", "lidar: mirror");
    let updated = updated(text, more);
    keeps(text, &updated.text);
    let expected = [
        "      # Not yet: { id: rear }\n      # Added by `telltale init --update`, heard on 2026-01-02:\n      # OK, 2.0 Hz, longest pause 0.5 s.\n      \
         - { id: mirror, status: 'lidar: mirror', timeout: 2s }\n",
        "      - { id: scan_rate, monitor: { frequency: { topic: /scan,",
        "    match: [{ name: x }]\n\n  # Added by `telltale init --update`, heard on 2026-01-02:\n  # Of /base.\n  - id: base\n    name: 'Base'\n    \
         match: [{ namespace: 'base' }]\n    modules:\n",
    ];
    for part in expected {
        assert!(updated.text.contains(part), "lacks {part}:\n{}", updated.text);
    }
    assert!(updated.text.ends_with("# The end.\n"), "{}", updated.text);
    assert_eq!(updated.groups, ["base"]);
    // The node of the lidar is watched by its status already.
    let new = [
        "sensors/mirror",
        "sensors/scan_rate",
        "sensors/scan_age",
        "base/motors",
        "base/odom_rate",
        "base/odom_age",
    ];
    for name in new {
        assert!(updated.modules.iter().any(|module| module == name), "{:?}", updated.modules);
    }
    assert!(!updated.modules.iter().any(|module| module == "sensors/lidar_runs"), "{:?}", updated.modules);
}

#[test]
fn every_form_of_a_list_takes_what_is_new() {
    let head = "vehicle: { id: r, stages: none }";
    for groups in [
        "groups:\n- id: base\n  modules:\n  - { id: motors, status: 'base: motors' }\n- id: lidar\n  match: [{ namespace: lidar }]\n",
        "groups:\n- { id: base, modules: [{ id: motors, status: 'base: motors' }] }\n- { id: lidar, match: [{ namespace: lidar }] } # it's\n",
        "groups: [{ id: base, modules: [{ id: motors, status: 'base: motors' }, ] }, { id: lidar, match: [{ namespace: lidar }], modules: [] }]\n",
        // Without a line feed at the end, and with those of another system.
        "groups:\n  - id: base\n    modules: [{ id: motors, status: 'base: motors' }]\n  - id: lidar\n    match: [{ namespace: lidar }]",
        "groups:\r\n  - id: base\r\n    match: [{ namespace: base }]\r\n  - id: lidar\r\n    modules:\r\n      - id: d\r\n        status: 'lidar: device'\r\n",
    ] {
        let newline = if groups.contains('\r') { "\r\n" } else { "\n" };
        let text = format!("{head}{newline}{groups}");
        let updated = updated(&text, robot);
        for name in ["base/odom_rate", "lidar/scan_rate"] {
            assert!(
                updated.modules.iter().any(|module| module == name),
                "{:?}:\n{}",
                updated.modules,
                updated.text
            );
        }
        let others = updated.text.replace(newline, "");
        assert!(!others.contains(['\r', '\n']), "{:?}", updated.text);
    }
}

#[test]
fn ids_that_are_taken_and_types_without_a_definition_are_seen_to() {
    let text = "vehicle: { id: r, stages: none }\ngroups:\n- id: lidar\n  match: [{ namespace: lidar }]\n  modules:\n  \
                - { id: scan_rate, status: 'lidar: device' }\n- { id: base, match: [{ namespace: x }] }\n";
    let updated = updated(text, robot);
    assert!(updated.modules.iter().any(|module| module == "lidar/scan_rate_2"), "{:?}", updated.modules);
    let unknown = of_files(&[("f", text)], robot(), |_| false).unwrap();
    assert!(!unknown.text.contains("frequency"), "{}", unknown.text);
    let left = "the type sensor_msgs/msg/LaserScan of /odom is not defined for the file: name the folder with it in `message_folders`";
    assert!(unknown.left.iter().any(|it| it == left), "{:?}", unknown.left);
}

#[test]
fn a_list_that_stands_in_two_groups_is_not_changed() {
    let text = "vehicle: { id: r, stages: none }\ngroups:\n- id: lidar\n  match: [{ namespace: lidar }]\n  modules: &m\n  \
                - { id: c, monitor: { constant: { state: ok } } }\n- { id: b, modules: *m }\n";
    let refused = of_files(&[("f", text)], robot(), |_| true).unwrap_err().to_string();
    assert!(
        refused
            .starts_with("what was heard cannot be added to f without a change of what is there (module `b/"),
        "{refused}"
    );
}

#[test]
fn what_belongs_to_a_group_of_another_file_is_told() {
    let files = [
        ("a", "include: [b]\nvehicle: { id: r, stages: none }\n"),
        ("b", "groups:\n- { id: lidar, match: [{ namespace: lidar }] }\n"),
    ];
    let lidar = Robot::default().publishes("/lidar", "/scan", 100).says("/lidar", "lidar: device");
    let updated = of_files(&files, lidar, |_| true).unwrap();
    assert_eq!(updated.text, files[0].1);
    assert_eq!(updated.left, ["2 modules for the group lidar, which stands in another file"]);
}

#[test]
fn a_guess_has_the_names_of_the_file() {
    let robot = || robot().listens("/base", "/scan");
    let text = "vehicle: { id: r, stages: none }\ngroups:\n- id: eyes\n  modules:\n  - { id: device, status: 'lidar: device' }\n  \
                - { id: scans, monitor: { frequency: { topic: /scan, type: sensor_msgs/msg/LaserScan, error_below: 1 } } }\n";
    let updated = updated(text, robot);
    assert!(updated.text.contains("# depends_on: [eyes/scans]\n"), "{}", updated.text);
}
