//! `telltale learn` on a data folder: its proposals, and that `check` accepts the file that it writes.

use std::path::Path;

use telltale::clock::Clock;
use telltale::engine::state::State;
use telltale::engine::time::{Span, Timestamp};
use telltale::engine::view::record::{Record, Recorded};
use telltale::store::{DemoSecrets, History, Store};

use crate::folder::TestFolder;
use crate::program::{run, said};

pub const CONFIG: &str = "\
vehicle: { id: v, name: V, stages: none }
groups:
  - id: sensors
    modules:
      - { id: lidar, status: lidar }
      - { id: camera, status: camera }
  - id: perception
    modules:
      - id: objects
        status: objects
        depends_on: [sensors/camera]
";

fn shown(at_ms: u64, node: &str, own: State) -> (u64, Recorded) {
    (at_ms, Recorded::Shown { node: node.into(), state: own, own, cause: None, said: None, began: None })
}

/// A history that begins with a start of the program, with these records and their times in milliseconds.
async fn write(data: &Path, records: Vec<(u64, Recorded)>) {
    let (clock, hand) = Clock::standing();
    Store::open(data, clock, DemoSecrets::Refused).unwrap().close().await;
    let (history, queue) = History::open(data, clock).unwrap();
    hand.advance(Span::from_secs(3600));
    let record = |(at_ms, what)| Record { at: Timestamp::from_millis(at_ms), what };
    let started = (0, Recorded::Started { anew: false });
    queue.send([started].into_iter().chain(records).map(record).collect()).unwrap();
    drop(queue);
    history.written().await;
}

/// A history of twenty failures of the camera, which nothing follows, and of ten of the lidar, half a second before the
/// objects fail.
pub async fn past(data: &Path) {
    let nodes = ["sensors/lidar", "sensors/camera", "perception/objects"];
    let mut records = Vec::from(nodes.map(|it| shown(0, it, State::Ok)));
    for minute in 1..=30 {
        let at = minute * 60_000;
        let failing: &[(&str, u64)] = match minute % 3 {
            0 => &[("sensors/lidar", 0), ("perception/objects", 500)],
            _ => &[("sensors/camera", 0)],
        };
        for (after, own) in [(0, State::Error), (10_000, State::Ok)] {
            records.extend(failing.iter().map(|(node, late)| shown(at + late + after, node, own)));
        }
    }
    write(data, records).await;
}

#[tokio::test]
async fn a_history_gives_proposals_that_check_accepts() {
    let data = TestFolder::new("learn");
    past(&data).await;
    let [config, output] = ["config.yaml", "proposed.yaml"].map(|name| data.join(name));
    std::fs::write(&config, CONFIG).unwrap();
    let [data, config, output] = [&*data, &*config, &*output].map(|it| it.to_str().unwrap());
    let learned = run(["learn", "--data", data, "--config", config, "-o", output]);
    let (out, err, code) = said(&learned);
    assert_eq!(code, Some(0), "{out}{err}");
    for line in [
        "add: perception/objects depends on sensors/lidar\n    it failed in 10 of 10 failures (72 % to 100 %), ",
        "    noticed 0.5 s to 0.5 s after it\n    sensors/lidar began to fail earlier, by about 0.5 s\n    together: ",
        "remove: perception/objects depends on sensors/camera\n    sensors/camera failed 20 times, and perception/objects \
         in 0 of them\n    counterexamples: ",
        "1 to add, 1 to remove or narrow; 0 of 1 dependencies that the history shows are configured; 3 of 3 modules",
    ] {
        assert!(out.contains(line), "{line}\n{out}");
    }
    let written = std::fs::read_to_string(output).unwrap();
    assert_eq!(written, CONFIG.replace("[sensors/camera]", "[sensors/lidar]"));
    assert_eq!(said(&run(["check", output])).2, Some(0));
    // An existing file is not overwritten, and a proposal that was taken is not made again.
    let (_, err, code) = said(&run(["learn", "--data", data, "--config", config, "-o", output]));
    assert!(code == Some(2) && err.contains("exists already"), "{err}");
    let (out, ..) = said(&run(["learn", "--data", data, "--config", output]));
    assert!(out.starts_with("0 to add, 0 to remove or narrow; 1 of 1 dependencies"), "{out}");
    // Without a recording nobody knows the configuration.
    let (_, err, code) = said(&run(["learn", "--data", data]));
    assert!(code == Some(2) && err.contains("--config"), "{err}");
}

pub const SILENT: &str = "vehicle: { id: v, name: V, stages: none }\nsignals:\n  moving: { topic: /moving, type: std_msgs/msg/Bool }\n\
     groups:\n  - { id: sensors, modules: [{ id: wheels, status: wheels }] }\n";

/// A history: the wheels are silent while the robot does not move, with one counterexample of thirty.
pub async fn silent_past(data: &Path) {
    let mut records = Vec::new();
    for minute in 0..60 {
        let (at, moves) = (minute * 60_000, minute % 2 == 1);
        // Once it is heard all the same.
        let own = if moves || minute == 30 { State::Ok } else { State::Unknown };
        records.push((at, Recorded::Signal { name: "moving".into(), value: Some(moves) }));
        records.push(shown(at, "sensors/wheels", own));
    }
    write(data, records).await;
}

#[tokio::test]
async fn a_module_that_is_silent_in_a_state_is_told_with_its_counterexamples() {
    let data = TestFolder::new("learn-silent");
    silent_past(&data).await;
    let config = data.join("config.yaml");
    std::fs::write(&config, SILENT).unwrap();
    let [data, config] = [&*data, &*config].map(|it| it.to_str().unwrap());
    let (out, err, code) = said(&run(["learn", "--data", data, "--config", config]));
    assert_eq!(code, Some(0), "{out}{err}");
    for line in [
        "when: sensors/wheels has nothing to say in some states: `when: { signals: { moving: true } }`\n",
        "    moving is false: silent 29 of 30 times (83 % to 99 %)\n    counterexamples: ",
        "    moving is true: silent 0 of 30 times (0 % to 11 %)\n",
    ] {
        assert!(out.contains(line), "{line}\n{out}");
    }
}

#[tokio::test]
async fn nothing_recorded_is_no_answer() {
    let data = TestFolder::new("learn-nothing");
    past(&data).await;
    let config = data.join("config.yaml");
    std::fs::write(
        &config,
        CONFIG.replace("lidar", "radar").replace("camera", "eye").replace("objects", "things"),
    )
    .unwrap();
    let [data, config] = [&*data, &*config].map(|it| it.to_str().unwrap());
    let (_, err, code) = said(&run(["learn", "--data", data, "--config", config]));
    assert!(code == Some(1) && err.contains("nothing of the modules"), "{err}");
}
