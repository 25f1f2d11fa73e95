//! Recordings of Telltale with damage that only a replay meets.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::time::UNIX_EPOCH;

use telltale::config;
use telltale::engine::Engine;
use telltale::engine::input::{Input, StatusArray};
use telltale::engine::time::Timestamp;
use telltale::msg::cdr::Endian;
use telltale::msg::fields::Definitions;
use telltale::msg::messages;
use telltale::record::file::{IncidentFile, JOURNAL, KEYFRAMES, MessageStamps, check, repair};
use telltale::record::journal::{Line, MessageRef, Took};
use telltale::record::ring::ConfigurationText;
use telltale::record::writer::digest;
use telltale::replay::line::lines;
use telltale::replay::{Gap, Playback, Recording, ReplayError, Run};

use crate::by_hand;
use crate::folder::TestFolder;
use crate::program::run;

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
        let line = Line { at_ns, took: Took::Input(Cow::Borrowed(input)), message: None, left_out: None };
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
    let folder = TestFolder::new("replayed-ticks");
    std::fs::create_dir(&*folder).unwrap();
    let path = folder.join("incident-1.mcap");
    let zero_ns = 1_800_000_000_000_000_000;
    let about = BTreeMap::from([("start_of_clock_ns".to_owned(), zero_ns.to_string())]);
    let mut file = IncidentFile::create(&path, about).unwrap();
    file.attach("configuration/v.yaml", "application/yaml", 1, ALONE.as_bytes()).unwrap();
    let model = by_hand::model(ALONE);
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
        let line =
            Line { at_ns: Timestamp::from_millis(at_ms), took, message: Some(message), left_out: None };
        file.json(&JOURNAL, at_ns, &line).unwrap();
    }
    let line = Line {
        at_ns: Timestamp::from_millis(3000),
        took: Took::Input(Cow::Owned(Input::Tick)),
        message: None,
        left_out: None,
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

const ALONE: &str = "vehicle: { id: v, stages: none }\ngroups: [{ id: sensors, modules: [{ id: imu, status: imu, timeout: 1s, stale: error }] }]\n";
const ZERO_NS: u64 = 1_800_000_000_000_000_000;

/// A recording of 40 s with a chunk every 10 s and a state of the engine every 20 s; a bit of the chunk with this number is wrong.
/// The module reports OK every half second, and an ERROR from 15 s on.
fn with_wrong_chunk(folder: &TestFolder, wrong: Option<usize>) -> PathBuf {
    std::fs::create_dir_all(&**folder).unwrap();
    let path = folder.join(format!("incident-{}.mcap", wrong.unwrap_or(9)));
    let about = BTreeMap::from([("start_of_clock_ns".to_owned(), ZERO_NS.to_string())]);
    let mut file = IncidentFile::create(&path, about).unwrap();
    file.attach("configuration/v.yaml", "application/yaml", 1, ALONE.as_bytes()).unwrap();
    let model = by_hand::model(ALONE);
    let mut engine = Engine::begin(model, Timestamp::ZERO);
    engine.keep_events();
    let mut chunks = Vec::new();
    for number in 0..80_u64 {
        let (at, ns) = (Timestamp::from_millis(500 * number), ZERO_NS + 500_000_000 * number);
        if number % 40 == 0 {
            file.json(&KEYFRAMES, ns, &engine.keyframe()).unwrap();
        }
        let input = says(if number < 30 { 0 } else { 2 });
        engine.handle(&input, at);
        let line = Line { at_ns: at, took: Took::Input(Cow::Owned(input)), message: None, left_out: None };
        file.json(&JOURNAL, ns, &line).unwrap();
        if number % 20 == 19 {
            let begin = file.len();
            file.end_chunk().unwrap();
            chunks.push(begin);
        }
    }
    file.finish().unwrap();
    if let Some(wrong) = wrong {
        let mut bytes = std::fs::read(&path).unwrap();
        bytes[chunks[wrong] as usize + 100] ^= 1;
        std::fs::write(&path, bytes).unwrap();
    }
    path
}

fn replay(path: &Path, options: &[&str]) -> Output {
    run([&["replay", path.to_str().unwrap()], options].concat())
}

fn lines_of(text: &[u8]) -> Vec<String> {
    String::from_utf8_lossy(text).lines().map(str::to_owned).collect()
}

#[test]
fn what_a_wrong_bit_takes_away_is_said_with_its_seconds_and_the_next_recorded_state_counts() {
    let s = |seconds: f64| Timestamp::from_millis((1000.0 * seconds) as u64);
    let folder = TestFolder::new("replayed-gap");
    for (wrong, from, to, exact_from) in
        [(0, 0.0, 9.5, Some(19.5)), (1, 10.0, 19.5, Some(19.5)), (2, 20.0, 29.5, None), (3, 30.0, 39.5, None)]
    {
        let path = with_wrong_chunk(&folder, Some(wrong));
        let run = Run::recorded(Recording::open(&path).unwrap()).unwrap();
        let mut playback = Playback::open(run).unwrap();
        let gap = Gap { from: s(from), to: Some(s(to)), exact_from: exact_from.map(s), is_damage: true };
        assert_eq!(playback.gaps().list(), [gap], "{wrong}");
        // Behind the next recorded state it is as it was, also where one goes back and forth.
        for at in [25.0, 5.0, 35.0, 25.0] {
            if playback.gaps().may_differ(s(at)) || at > 29.0 && wrong >= 2 {
                continue;
            }
            playback.go_to(s(at)).unwrap();
            let snapshot = playback.snapshot().unwrap();
            let imu = snapshot.node("sensors/imu").unwrap();
            assert_eq!(
                snapshot.shown(imu).0.as_str(),
                if at < 15.0 { "ok" } else { "error" },
                "{wrong} {at}"
            );
        }
        if wrong == 1 {
            // The change that nobody saw is told where the state is known again.
            let changes: Vec<_> = playback.changes().iter().map(|it| it.at).collect();
            assert!(changes.contains(&s(19.5)), "{changes:?}");
        }
    }
}

#[test]
fn a_repair_keeps_where_a_gap_was_and_makes_none_of_the_end() {
    let folder = TestFolder::new("replayed-gap-repaired");
    for wrong in [None, Some(1), Some(3)] {
        let path = with_wrong_chunk(&folder, wrong);
        let gaps = |path: &Path| {
            let playback = Playback::open(Run::recorded(Recording::open(path).unwrap()).unwrap()).unwrap();
            playback.gaps().list().to_vec()
        };
        let before = gaps(&path);
        // Interrupted in the middle of what it writes at its end.
        let whole = std::fs::read(&path).unwrap();
        std::fs::write(&path, &whole[..whole.len() - 100]).unwrap();
        assert!(repair(&path).unwrap().is_some(), "{wrong:?}");
        let followed: Vec<Gap> =
            before.into_iter().filter(|gap| gap.to != Some(Timestamp::from_millis(39_500))).collect();
        assert_eq!(gaps(&path), followed, "{wrong:?}");
        // It is a complete file, and a second repair finds nothing to do.
        assert_eq!(check(&path).unwrap(), Vec::<String>::new());
        assert!(repair(&path).unwrap().is_none());
    }
}

#[test]
fn people_and_programs_are_told_of_a_gap() {
    let folder = TestFolder::new("replayed-gap-told");
    let whole = with_wrong_chunk(&folder, None);
    let said = replay(&whole, &["--json"]);
    assert!(said.status.success() && said.stderr.is_empty(), "{said:?}");
    let path = with_wrong_chunk(&folder, Some(1));
    let told = replay(&path, &[]);
    assert!(told.status.success(), "{told:?}");
    let missing: Vec<String> =
        lines_of(&told.stderr).into_iter().filter(|line| line.starts_with("telltale: missing")).collect();
    assert_eq!(
        missing,
        [
            "telltale: missing 2027-01-15T08:00:10.000Z to 2027-01-15T08:00:19.500Z (9.500 s): the file is damaged or gone there; \
          states from there on up to 2027-01-15T08:00:19.500Z may differ from what was shown then"
        ]
    );
    let text = lines_of(&told.stdout);
    let place = |words: &str| text.iter().position(|line| line.contains(words));
    let (gap, known) = (
        place("something is missing before this"),
        place("sensors/imu                           ok -> error"),
    );
    assert!(gap.is_some() && gap < known, "{text:#?}");
    let json = replay(&path, &["--json"]);
    // Deadlines act within the gap; its line stands at its beginning, and all stand in the order of their times.
    let same = folder.join("same.yaml");
    std::fs::write(&same, ALONE).unwrap();
    let text = lines_of(&replay(&path, &["--config", same.to_str().unwrap()]).stdout);
    assert_eq!(text[0], "2027-01-15 UTC");
    let begins = text.iter().position(|line| line.contains("from here on something is missing")).unwrap();
    assert!(text[begins].starts_with("08:00:10.000    +10.000 s"), "{text:#?}");
    assert!(text[begins + 1].starts_with("08:00:10.5"), "{text:#?}");
    assert!(text[1..].is_sorted_by_key(|line| &line[..12]), "{text:#?}");
    let path = with_wrong_chunk(&folder, Some(0));
    let text = lines_of(&replay(&path, &[]).stdout);
    let place = |words: &str| text.iter().position(|line| line.contains(words));
    let (differs, as_shown) = (place("may differ from what was shown"), place("as it was shown"));
    assert!(differs.is_some() && differs < as_shown, "{text:#?}");
    let path = with_wrong_chunk(&folder, Some(3));
    let text = lines_of(&replay(&path, &[]).stdout);
    assert!(!text.iter().any(|line| line.contains("---")), "nothing follows: {text:#?}");
    let objects = lines_of(&json.stdout);
    assert!(objects.len() >= 2 && objects.iter().all(|line| line.starts_with('{')), "{objects:#?}");
    assert_eq!(lines_of(&json.stderr).iter().filter(|line| line.starts_with("telltale: missing")).count(), 1);
}

#[test]
fn a_gap_is_no_difference_between_two_configurations() {
    let folder = TestFolder::new("replayed-gap-what-if");
    let path = with_wrong_chunk(&folder, Some(1));
    let same = folder.join("same.yaml");
    std::fs::write(&same, ALONE).unwrap();
    let what_if = replay(&path, &["--what-if", &same.to_string_lossy()]);
    let told = String::from_utf8_lossy(&what_if.stdout).into_owned();
    assert!(what_if.status.success(), "{what_if:?}");
    assert_eq!(told.matches("note: missing 2027-01-15T08:00:10.000Z to ").count(), 1, "{told}");
}

#[test]
fn a_span_in_which_nothing_lies_is_refused() {
    let folder = TestFolder::new("replayed-span");
    let path = with_wrong_chunk(&folder, None);
    for (options, why) in [
        (
            &["--from", "12s", "--to", "5s"][..],
            "--from +12.000 s (2027-01-15T08:00:12.000Z) is later than --to +5.000 s",
        ),
        (&["--from", "100s"], "is later than the end of the recording, +39.500 s"),
        (&["--to", "2026-01-01T00:00:00Z"], "--to is earlier than the beginning of the recording"),
    ] {
        let refused = replay(&path, options);
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(2), "{options:?} {said}");
        assert!(said.contains(why) && refused.stdout.is_empty(), "{options:?} {said}");
    }
    assert!(replay(&path, &["--from", "14s", "--to", "16s"]).status.success());
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
        let run = replay(&path, &[]);
        let (err, code) = (String::from_utf8_lossy(&run.stderr), run.status.code());
        assert!(
            code == Some(2) && err.contains("the configuration in the recording is damaged"),
            "{code:?} {err}"
        );
        let run = replay(&path, &["--config", folder.join("main.yaml").to_str().unwrap()]);
        let out = String::from_utf8_lossy(&run.stdout);
        assert!(run.status.success() && out.contains("sensors/imu"), "{out}");
    }
}
