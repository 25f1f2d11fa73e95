//! Recordings of Telltale with damage that only a replay meets.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::process::Command;
use std::time::UNIX_EPOCH;

use telltale::config;
use telltale::engine::Engine;
use telltale::engine::input::{Input, StatusArray};
use telltale::engine::time::Timestamp;
use telltale::msg::cdr::Endian;
use telltale::msg::fields::Definitions;
use telltale::msg::messages;
use telltale::record::file::{IncidentFile, JOURNAL, KEYFRAMES, MessageStamps};
use telltale::record::journal::{Line, MessageRef, Took};
use telltale::record::ring::ConfigurationText;
use telltale::record::writer::digest;
use telltale::replay::line::lines;
use telltale::replay::{Playback, Recording, ReplayError, Run};

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
    let texts = loaded
        .sources()
        .texts()
        .map(|(name, text)| ConfigurationText { name: name.into(), text: text.into() });
    let about = BTreeMap::from([
        ("start_of_clock_ns".to_owned(), "1800000000000000000".to_owned()),
        ("configuration_sha256".to_owned(), digest(&texts.collect::<Vec<_>>())),
    ]);
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

#[test]
fn a_message_that_means_nothing_lets_the_same_time_pass_by_any_configuration() {
    const ALONE: &str = "vehicle: { id: v, stages: none }\ngroups: [{ id: sensors, modules: [{ id: imu, status: imu, timeout: 1s, stale: error }] }]\n";
    let folder = TestFolder::new("replayed-ticks");
    std::fs::create_dir(&*folder).unwrap();
    let path = folder.join("incident-1.mcap");
    let zero_ns = 1_800_000_000_000_000_000;
    let about = BTreeMap::from([("start_of_clock_ns".to_owned(), zero_ns.to_string())]);
    let mut file = IncidentFile::create(&path, about).unwrap();
    file.attach("configuration/v.yaml", "application/yaml", 1, ALONE.as_bytes()).unwrap();
    let model = config::parse("v.yaml", ALONE).unwrap_or_else(|problems| panic!("{problems}")).model;
    let engine = Engine::begin(model.clone(), Timestamp::ZERO);
    file.json(&KEYFRAMES, 1, &engine.keyframe()).unwrap();
    let Input::Diagnostics(array) = says(0) else { panic!("it is one") };
    let status = messages::encode_diagnostic_arrays(&array, UNIX_EPOCH, usize::MAX).remove(0);
    // The status was received first, and taken behind a message that nobody reads.
    for (topic, type_name, body, at_ms) in [
        ("/other", "std_msgs/msg/UInt8", vec![1], 100),
        ("/diagnostics", messages::DIAGNOSTIC_ARRAY, status, 50),
    ] {
        let channel = file.topic(topic, type_name, || None).unwrap();
        let at_ns = zero_ns + at_ms * 1_000_000;
        let stamps = MessageStamps { log_time_ns: at_ns, publish_time_ns: at_ns, sequence: 1 };
        file.message(channel, stamps, (&body, Endian::Little)).unwrap();
        let message = MessageRef {
            topic: Cow::Borrowed(topic),
            writer: "07".repeat(16),
            sequence: 1,
            received_ns: at_ns,
        };
        let took = if topic == "/other" { Took::Input(Cow::Owned(Input::Tick)) } else { Took::Statuses };
        let line = Line { at_ns: Timestamp::from_millis(at_ms), took, message: Some(message) };
        file.json(&JOURNAL, at_ns, &line).unwrap();
    }
    let line = Line {
        at_ns: Timestamp::from_millis(3000),
        took: Took::Input(Cow::Owned(Input::Tick)),
        message: None,
    };
    file.json(&JOURNAL, zero_ns + 3_000_000_000, &line).unwrap();
    file.finish().unwrap();
    let shown = |mut run: Run| {
        let (facts, mut shown) = (run.facts().clone(), Vec::new());
        while let Some(taken) = run.step().unwrap() {
            shown.extend(lines(&taken, &facts, false).into_iter().map(|line| line.json));
        }
        shown.into_iter().filter(|line| line.contains("\"sensors/imu\"")).collect::<Vec<_>>()
    };
    let recorded = shown(Run::recorded(Recording::open(&path).unwrap()).unwrap());
    let recording = Recording::open(&path).unwrap();
    let anew = shown(Run::judged_by(recording, model, &Definitions::default(), None).unwrap());
    assert_eq!(recorded, anew);
    assert!(recorded.last().is_some_and(|line| line.contains("\"t_s\":1.1,")), "{recorded:?}");
}

#[test]
fn a_damaged_configuration_is_told_as_that_and_another_one_takes_its_place() {
    let folder = TestFolder::new("replayed-damaged");
    let path = recording(&folder, &[(100, says(0)), (500, says(2)), (9000, Input::Tick)]);
    let whole = std::fs::read(&path).unwrap();
    let place = |text: &str| whole.windows(text.len()).position(|it| it == text.as_bytes()).unwrap();
    // In the text of the second file, in the name of it, and in the record that has it.
    for (at, byte) in
        [(place("imu, timeout"), b'x'), (place("configuration/") + 3, b'x'), (place(MAIN), b'#')]
    {
        let mut bytes = whole.clone();
        bytes[at] = byte;
        std::fs::write(&path, bytes).unwrap();
        let Err(error) = Run::recorded(Recording::open(&path).unwrap()) else { panic!("at byte {at}") };
        assert!(matches!(error, ReplayError::DamagedConfiguration(_)), "at byte {at}: {error}");
        let said = error.to_string();
        assert!(said.contains("is damaged") && said.contains("name the right one with --config"), "{said}");
        let replay = |words: &[&OsStr]| {
            Command::new(env!("CARGO_BIN_EXE_telltale"))
                .arg("replay")
                .arg(&path)
                .args(words)
                .output()
                .unwrap()
        };
        let run = replay(&[]);
        let (err, code) = (String::from_utf8_lossy(&run.stderr), run.status.code());
        assert!(
            code == Some(2) && err.contains("the configuration in the recording is damaged"),
            "{code:?} {err}"
        );
        let run = replay(&["--config".as_ref(), folder.join("main.yaml").as_ref()]);
        let out = String::from_utf8_lossy(&run.stdout);
        assert!(run.status.success() && out.contains("sensors/imu"), "{out}");
    }
}
