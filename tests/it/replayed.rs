//! Recordings of Telltale with damage that only a replay meets.

use std::borrow::Cow;
use std::collections::BTreeMap;

use telltale::config;
use telltale::engine::Engine;
use telltale::engine::input::{Input, StatusArray};
use telltale::engine::time::Timestamp;
use telltale::record::file::{IncidentFile, JOURNAL, KEYFRAMES};
use telltale::record::journal::{Line, Took};
use telltale::replay::line::lines;
use telltale::replay::{Playback, Recording, Run};

use crate::folder::TestFolder;

const MAIN: &str = "vehicle: { id: v, stages: none }\ninclude: [sensors.yaml]\n";
const INCLUDED: &str =
    "groups: [{ id: sensors, modules: [{ id: imu, status: imu, timeout: 1s, stale: error }] }]\n";

fn says(level: u8) -> Input {
    let mut array = StatusArray::default();
    array.push_status(level, "imu", "as it is", "");
    Input::Diagnostics(array)
}

/// A recording whose journal has these inputs, and whose configuration has two files.
fn recording(folder: &TestFolder, inputs: &[(u64, Input)]) -> std::path::PathBuf {
    std::fs::create_dir(&**folder).unwrap();
    for (name, text) in [("main.yaml", MAIN), ("sensors.yaml", INCLUDED)] {
        std::fs::write(folder.join(name), text).unwrap();
    }
    let loaded = config::load(&folder.join("main.yaml")).unwrap_or_else(|problems| panic!("{problems}"));
    let path = folder.join("incident-1.mcap");
    let about = BTreeMap::from([("start_of_clock_ns".to_owned(), "1800000000000000000".to_owned())]);
    let mut file = IncidentFile::create(&path, about).unwrap();
    for (name, text) in loaded.sources().texts() {
        file.attach(&format!("configuration/{name}"), "application/yaml", 1, text.as_bytes()).unwrap();
    }
    let mut engine = Engine::begin(loaded.model, Timestamp::ZERO);
    engine.keep_events();
    file.json(&KEYFRAMES, 1, &engine.keyframe()).unwrap();
    for (at_ms, input) in inputs {
        let at_ns = Timestamp::from_millis(*at_ms);
        let line = Line { at_ns, took: Took::Input(Cow::Borrowed(input)), message: None };
        file.json(&JOURNAL, 1_800_000_000_000_000_000 + at_ms * 1_000_000, &line).unwrap();
    }
    file.finish().unwrap();
    path
}

#[test]
fn a_time_far_ahead_is_left_out_and_the_configuration_is_that_of_the_recording() {
    let folder = TestFolder::new("replayed-ahead");
    let year_2300 = 9_000_000_000_000;
    let inputs = [(100, says(0)), (year_2300, says(0)), (500, says(2)), (9000, Input::Tick)];
    let path = recording(&folder, &inputs);
    // The configuration is read from the recording, with what it includes.
    for name in ["main.yaml", "sensors.yaml"] {
        std::fs::remove_file(folder.join(name)).unwrap();
    }
    let mut run = Run::recorded(Recording::open(&path).unwrap()).unwrap();
    let facts = run.facts().clone();
    let mut shown = Vec::new();
    while let Some(taken) = run.step().unwrap() {
        shown.extend(lines(&taken, &facts, false).into_iter().map(|line| line.json));
    }
    let of_imu: Vec<_> = shown.iter().filter(|line| line.contains("\"sensors/imu\"")).collect();
    assert!(
        of_imu.iter().any(|line| line.contains("\"t_s\":0.5") && line.contains("\"error\"")),
        "{of_imu:?}"
    );
    assert_eq!(run.notes().said, ["a step more than a day after the one before is left out"]);
    let mut playback = Playback::open(Run::recorded(Recording::open(&path).unwrap()).unwrap()).unwrap();
    playback.go_to(Timestamp::from_millis(700)).unwrap();
    let snapshot = playback.snapshot().unwrap();
    let imu = snapshot.node("sensors/imu").unwrap();
    assert_eq!(snapshot.shown(imu).0.as_str(), "error");
}
