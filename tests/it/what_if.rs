//! `telltale replay --what-if`: what another configuration would have shown of recordings.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use telltale::clock::Clock;
use telltale::config;
use telltale::engine::Engine;
use telltale::engine::input::Input;
use telltale::engine::time::Timestamp;
use telltale::record::file::{IncidentFile, JOURNAL, KEYFRAMES};
use telltale::record::folder::{file_name, folder_in};
use telltale::record::journal::{Line, Took};
use telltale::record::ring::ConfigurationText;
use telltale::record::summary::{Recording, Summary};
use telltale::record::writer::hash_file;
use telltale::sim::scenario_file;
use telltale::sim::scenario_sample::Stamp;
use telltale::store::audit::{Action, COMMAND_LINE, Record};
use telltale::store::{DemoSecrets, Store};

use crate::folder::TestFolder;
use crate::program::{run, said};

/// The wall time at which the scenarios begin.
pub const BEGAN_NS: i64 = 1_800_000_000_000_000_000;
pub const SHUTTLE: &str = include_str!("../../config/shuttle.yaml");

/// The shuttle whose Localization does not depend on Sensors: its false alarms are those that masking hides.
pub fn without_sensors() -> String {
    let text = SHUTTLE.replace(
        "depends_on: [sensors/velodyne_packet_alive, can/wheel_speed]",
        "depends_on: [can/wheel_speed]",
    );
    assert_ne!(text, SHUTTLE);
    text
}

/// Records scenario 1 of the paper, the outage of a sensor, as the shuttle with its dependencies judges it.
pub fn record_outage(path: &Path) {
    record(path, "1-sensor-outage-without-dependencies.yaml", &[], None);
}

/// As `record_outage`, with a recording that says this of itself beside, and a reload after two seconds.
fn record(path: &Path, scenario: &str, more: &[(&str, &str)], reload: Option<&str>) {
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("config");
    let file = scenario_file::load(&folder.join("scenarios").join(scenario));
    let file = file.unwrap_or_else(|problems| panic!("{problems}"));
    let loaded = config::parse("shuttle.yaml", SHUTTLE).unwrap_or_else(|problems| panic!("{problems}"));
    let scenario = file.bind(&loaded.model).unwrap_or_else(|problems| panic!("{problems}"));
    let began = BEGAN_NS.to_string();
    let about = [("start_of_clock_ns", &*began), ("shown_from_ns", "1000000000")];
    let about: BTreeMap<String, String> =
        about.iter().chain(more).map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
    let mut to = IncidentFile::create(path, about).unwrap();
    to.attach("configuration/shuttle.yaml", "application/yaml", 1, SHUTTLE.as_bytes()).unwrap();
    let mut engine = Engine::begin(loaded.model, Timestamp::ZERO);
    engine.keep_events();
    engine.start_in(scenario.start.expect("it drives"));
    to.json(&KEYFRAMES, BEGAN_NS as u64, &engine.keyframe()).unwrap();
    let mut inputs: Vec<(Timestamp, Input)> = Vec::new();
    for step in &scenario.steps {
        let until = step.repeat.map_or(step.at, |repeat| repeat.until);
        let times = std::iter::successors(Some(step.at), |at| Some(*at + step.repeat?.every));
        for at in times.take_while(|at| *at <= until) {
            inputs.extend(step.inputs.iter().map(|input| (at, received(input, step.stamp, at))));
        }
    }
    inputs.sort_by_key(|(at, _)| *at);
    let mut reload =
        reload.map(|text| ConfigurationText { name: "shuttle.yaml".to_owned(), text: text.to_owned() });
    for (at, input) in &inputs {
        if *at >= Timestamp::from_millis(2000)
            && let Some(text) = reload.take()
        {
            let line = Line { at_ns: *at, took: Took::Reload(vec![text]), message: None, left_out: None };
            to.json(&JOURNAL, BEGAN_NS as u64 + at.as_nanos(), &line).unwrap();
        }
        let line =
            Line { at_ns: *at, took: Took::Input(Cow::Borrowed(input)), message: None, left_out: None };
        to.json(&JOURNAL, BEGAN_NS as u64 + at.as_nanos(), &line).unwrap();
    }
    to.finish().unwrap();
}

/// As it is received at an instant, by right clocks.
fn received(input: &Input, stamp: Option<Stamp>, at: Timestamp) -> Input {
    let Input::Sample(sample) = input else { return input.clone() };
    let mut sample = sample.clone();
    sample.received_wall_ns = BEGAN_NS + at.as_nanos() as i64;
    sample.stamp_ns = stamp.map(|stamp| match stamp {
        Stamp::At(ns) => BEGAN_NS + ns,
        Stamp::Behind(ns) => BEGAN_NS + at.as_nanos() as i64 - ns,
    });
    Input::Sample(sample)
}

struct Files(TestFolder);

impl Files {
    fn new(name: &str) -> Files {
        let folder = TestFolder::new(name);
        std::fs::create_dir(&*folder).unwrap();
        Files(folder)
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) -> String {
        let path = self.0.join(name);
        std::fs::write(&path, content).unwrap();
        path.display().to_string()
    }

    fn recording(&self, name: &str) -> String {
        let path = self.0.join(name);
        record_outage(&path);
        path.display().to_string()
    }
}

fn what_if(words: &[&str]) -> (String, String, Option<i32>) {
    said(&run([&["replay", "--what-if"], words].concat()))
}

fn objects(words: &[&str]) -> (Vec<Value>, Option<i32>) {
    let (out, err, code) = what_if(&[words, &["--json"]].concat());
    let object =
        |line: &str| serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line} {err}"));
    (out.lines().map(object).collect(), code)
}

#[test]
fn without_a_dependency_the_false_alarms_come_back() {
    let files = Files::new("what-if-alarms");
    let (recording, new) = (files.recording("a.mcap"), files.write("new.yaml", without_sensors()));
    let (out, err, code) = what_if(&[&new, &recording]);
    assert_eq!((err.as_str(), code), ("", Some(1)), "{out}");
    let lines: Vec<&str> = out.lines().collect();
    assert!(lines[0].starts_with("recording ") && lines[0].ends_with("to root"), "{out}");
    assert!(lines[1].contains(" 2 -> 4 "), "{out}");
    assert!(
        lines[2]
            .contains("localization/scan_matching: ignore because of sensors/velodyne_packet_alive -> error"),
        "{out}"
    );
    assert_eq!(lines[3], "  new alarms: localization/tf_map, localization/tf_quality", "{out}");
    assert_eq!(lines.last(), Some(&"1 of 1 differ"), "{out}");
    let (found, code) = objects(&[&new, &recording]);
    assert_eq!((found.len(), code), (2, Some(1)));
    let one = &found[0];
    assert_eq!((&one["recording"], &one["differs"]), (&json!(recording), &json!(true)));
    assert_eq!((&one["recorded"]["alarms"], &one["new"]["alarms"]), (&json!(2), &json!(4)), "{one}");
    assert_eq!(one["alarms_new"], json!(["localization/tf_map", "localization/tf_quality"]));
    assert!(one["recorded"]["masked"].as_u64() > one["new"]["masked"].as_u64(), "{one}");
    assert_eq!(one["first"]["node"], "localization/scan_matching", "{one}");
    assert_eq!(one["first"]["recorded"]["masked_by"], "sensors/velodyne_packet_alive");
    assert_eq!(one["first"]["new"], json!({ "shown": "error", "own": "error", "masked_by": null }));
    let at_s = one["first"]["t_s"].as_f64().unwrap();
    assert!((2.0..4.0).contains(&at_s), "the outage begins after 3 s, 2 s after the first instant: {one}");
    assert!(one["first"]["at"].as_str().unwrap().starts_with("2027-01-15T08:00:0"), "{one}");
    let total = &found[1];
    assert_eq!((&total["total"], &total["differ"], &total["failed"]), (&json!(1), &json!(1), &json!(0)));
    assert_eq!(total["new"]["alarms"], 4);
}

#[test]
fn what_led_to_the_first_instant_is_printed_on_demand() {
    let files = Files::new("replay-before");
    let recording = files.recording("a.mcap");
    let lines = |words: &[&str]| -> Vec<Value> {
        let run = run([&["replay", &recording, "--json"], words].concat());
        assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
        let lines = String::from_utf8(run.stdout).unwrap();
        lines.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    };
    let (shown, all) = (lines(&[]), lines(&["--from", "1970-01-01T00:00:00Z"]));
    let before: Vec<&Value> = all.iter().take_while(|line| line["t_s"].as_f64().unwrap() < 0.0).collect();
    assert!(!before.is_empty() && !shown.is_empty());
    assert!(all.ends_with(&shown[1..]), "{} {}", all.len(), shown.len());
}

#[test]
fn the_same_configuration_changes_nothing_and_a_folder_has_many_recordings() {
    let files = Files::new("what-if-same");
    let same = files.write("same.yaml", format!("# The same.\n{SHUTTLE}"));
    files.recording("incident-2.mcap");
    files.recording("incident-10.mcap");
    let folder = files.0.display().to_string();
    let (found, code) = objects(&[&same, &folder]);
    assert_eq!((found.len(), code), (3, Some(0)), "{found:?}");
    assert!(found[0]["recording"].as_str().unwrap().ends_with("/incident-2.mcap"), "{}", found[0]);
    for one in &found[..2] {
        assert_eq!(
            (&one["differs"], &one["first"], &one["nodes"]),
            (&json!(false), &Value::Null, &json!([]))
        );
        assert_eq!((&one["recorded"], &one["notes"]), (&one["new"], &json!([])), "{one}");
        assert_eq!(one["recorded"]["alarms"], 2, "{one}");
        assert!(one["recorded"]["to_root_s"].as_f64().is_some_and(|s| s > 0.0), "{one}");
    }
    let (out, _, code) = what_if(&[&same, &folder]);
    assert_eq!((out.matches("nothing differs").count(), code), (2, Some(0)), "{out}");
    assert!(out.ends_with("0 of 2 differ\n"), "{out}");
}

#[test]
fn a_suite_of_recordings_keeps_its_order_on_all_cores_and_is_written_for_continuous_integration() {
    let files = Files::new("what-if-suite");
    let same = files.write("same.yaml", SHUTTLE);
    let recordings: Vec<String> = (0..40).map(|number| files.recording(&format!("{number}.mcap"))).collect();
    let results = files.0.join("results.xml");
    let words =
        [&same, "/nowhere.mcap", &files.0.display().to_string(), "--junit", &results.display().to_string()];
    let (found, code) = objects(&words);
    assert_eq!(code, Some(1));
    let named: Vec<&str> = found.iter().filter_map(|it| it["recording"].as_str()).collect();
    assert_eq!(named[0], "/nowhere.mcap");
    assert_eq!(named[1..], recordings);
    // All of them are of the same seconds of one vehicle, which count once.
    let total = found.last().unwrap();
    assert_eq!((&total["total"], &total["recorded"]), (&json!(40), &found[1]["recorded"]), "{total}");
    let text = std::fs::read_to_string(&results).unwrap();
    assert!(text.contains("tests=\"41\" failures=\"0\" errors=\"1\""), "{text}");
    assert!(
        text.contains("name=\"/nowhere.mcap\"")
            && text.contains("<error message=\"there is no such file\"/>")
    );
    let new = files.write("new.yaml", without_sensors());
    let (_, _, code) = what_if(&[&new, &recordings[0], "--junit", &results.display().to_string()]);
    let text = std::fs::read_to_string(&results).unwrap();
    assert!(code == Some(1) && text.contains("<failure message=\"differs from "), "{text}");
}

#[test]
fn what_cannot_be_used_is_said_and_the_rest_is_compared() {
    let files = Files::new("what-if-wrong");
    let (recording, same) = (files.recording("good.mcap"), files.write("same.yaml", SHUTTLE));
    let bytes = std::fs::read(&recording).unwrap();
    let damaged = files.write("damaged.mcap", &bytes[..2000]);
    let (out, err, code) = what_if(&[&same, &damaged, &recording]);
    assert_eq!(code, Some(1), "{out}{err}");
    assert!(err.contains("damaged.mcap: ") && err.contains("the file ends in the middle"), "{err}");
    assert!(out.contains("nothing differs") && out.ends_with("0 of 1 differ; 1 cannot be used\n"), "{out}");
    let (out, err, code) = what_if(&[&same, "/nowhere.mcap", &recording]);
    assert_eq!((code, err.as_str()), (Some(1), "telltale: /nowhere.mcap: there is no such file\n"), "{out}");
    assert!(out.ends_with("0 of 1 differ; 1 cannot be used\n"), "{out}");
    // A bag of others has no configuration of its own.
    let bag = files.write("bag.mcap", foreign_bag());
    let (found, code) = objects(&[&same, &bag]);
    let why = found[0]["error"].as_str().unwrap();
    assert!(code == Some(2) && why.contains("no configuration of its own: name one with --config"), "{why}");
    let watches = |limit: &str| {
        format!(
            "vehicle: {{ stages: none }}\ngroups: [{{ id: a, modules: [{{ id: m, monitor: {{ value: {{ topic: /a, type: std_msgs/msg/UInt8, field: data, error_above: {limit} }} }} }}] }}]\n"
        )
    };
    let (old, new) = (files.write("old.yaml", watches("100")), files.write("above.yaml", watches("3")));
    let (found, code) = objects(&[&new, "--config", &old, &bag]);
    assert_eq!((&found[0]["first"]["node"], code), (&json!("a/m"), Some(1)), "{found:?}");
    assert_eq!(found[0]["first"]["t_s"], 4.0);
    let (_, err, code) = what_if(&[&new, "--config", &old, &bag, "--stage", "active"]);
    assert!(code == Some(2) && err.contains("--stage needs a configuration with `stages: shuttle`"), "{err}");
    let (_, err, code) = what_if(&[&same, "/nowhere.mcap"]);
    assert!(code == Some(2) && err.contains("there is no such file"), "{err}");
    let wrong = files.write("wrong.yaml", SHUTTLE.replace("timeout: 1s", "timeout: soon"));
    let (out, err, code) = what_if(&[&wrong, &recording]);
    assert_eq!((out.as_str(), code), ("", Some(2)));
    assert!(err.contains("expected a duration") && err.contains("wrong.yaml:"), "{err}");
    let (_, err, code) = what_if(&[&same, "12"]);
    assert!(code == Some(2) && err.contains("--data"), "{err}");
    let (_, err, code) = what_if(&[&same, &recording, "--stage", "active"]);
    assert!(code == Some(2) && err.contains("--stage is for recordings of others"), "{err}");
    // Both configurations can be given.
    let new = files.write("new.yaml", without_sensors());
    let (found, code) = objects(&[&same, "--config", &new, &recording]);
    assert_eq!(
        (&found[0]["recorded"]["alarms"], &found[0]["new"]["alarms"], code),
        (&json!(4), &json!(2), Some(1))
    );
}

/// A message a second, as a recorder of others writes them.
fn foreign_bag() -> Vec<u8> {
    let mut bytes = Vec::new();
    let to = std::io::Cursor::new(&mut bytes);
    let mut writer = mcap::WriteOptions::new().profile("ros2").create(to).unwrap();
    let schema = writer.add_schema("std_msgs/msg/UInt8", "ros2msg", b"uint8 data\n").unwrap();
    let channel_id = writer.add_channel(schema, "/a", "cdr", &BTreeMap::new()).unwrap();
    for at in 0..10_u8 {
        let log_time = BEGAN_NS as u64 + u64::from(at) * 1_000_000_000;
        let header =
            mcap::records::MessageHeader { channel_id, sequence: 0, log_time, publish_time: log_time };
        writer.write_to_known_channel(&header, &[0, 1, 0, 0, at, 0, 0, 0]).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    bytes
}

#[test]
fn what_the_new_configuration_adds_differs_where_it_shows_something() {
    let files = Files::new("what-if-more");
    let recording = files.recording("a.mcap");
    let more = |module: &str| {
        let group = format!("groups:\n  - id: more\n    modules: [{module}]\n");
        let text = SHUTTLE.replacen("groups:\n", &group, 1);
        assert_ne!(text, SHUTTLE);
        files.write("more.yaml", text)
    };
    let (found, code) = objects(&[&more("{ id: fix, status: 'gnss: fix', timeout: 5s }"), &recording]);
    let one = &found[0];
    assert_eq!(
        (&one["only_new"], &one["only_recorded"]),
        (&json!(["more", "more/fix"]), &json!([])),
        "{one}"
    );
    assert_eq!((&one["nodes"], &one["alarms_new"], code), (&json!([]), &json!([]), Some(0)), "{one}");
    let (found, code) = objects(&[&more("{ id: lacks, status: nobody, timeout: 1s }"), &recording]);
    let one = &found[0];
    assert_eq!((&one["first"]["node"], code), (&json!("more/lacks"), Some(1)), "{one}");
    assert_eq!(
        (&one["first"]["recorded"], &one["first"]["new"]["shown"]),
        (&Value::Null, &json!("unknown")),
        "{one}"
    );
    // Requests that are no longer made, with all nodes as they were.
    let rules = SHUTTLE.find("\ncountermeasures:").expect("it has some");
    let (found, code) = objects(&[&files.write("less.yaml", &SHUTTLE[..rules]), &recording]);
    let one = &found[0];
    assert_eq!((&one["new"]["countermeasures"], code), (&json!(0), Some(1)), "{one}");
    assert!(one["recorded"]["countermeasures"].as_u64() > Some(0), "{one}");
    // Another urgency, with all nodes as they were.
    let urgent = SHUTTLE.replace("urgency: be_ready", "urgency: take_over");
    let (found, code) = objects(&[&files.write("urgent.yaml", urgent), &recording]);
    let first = &found[0]["first"];
    assert_eq!((&first["of"], code), (&json!("instruction"), Some(1)), "{first}");
    assert_eq!((&first["recorded"], &first["new"]), (&json!("be_ready"), &json!("take_over")), "{first}");
}

#[test]
fn a_reload_on_the_way_counts_as_recorded_and_the_demo_has_its_patience_on_both_sides() {
    let files = Files::new("what-if-reload");
    let path = |name: &str| files.0.join(name);
    let outage = "1-sensor-outage-without-dependencies.yaml";
    let new = files.write("new.yaml", without_sensors());
    record(&path("reload.mcap"), outage, &[], Some(&without_sensors()));
    let (found, code) = objects(&[&new, &path("reload.mcap").display().to_string()]);
    let one = &found[0];
    assert_eq!((&one["differs"], code), (&json!(false), Some(0)), "{one}");
    assert!(one["notes"].to_string().contains("took another configuration meanwhile"), "{one}");
    assert_eq!((&one["recorded"], &one["new"]["alarms"]), (&one["new"], &json!(4)), "{one}");
    record(&path("demo.mcap"), outage, &[("demo", "true")], None);
    let (found, code) =
        objects(&[&files.write("same.yaml", SHUTTLE), &path("demo.mcap").display().to_string()]);
    assert_eq!((&found[0]["differs"], code), (&json!(false), Some(0)), "{}", found[0]);
    // Its faults count later.
    let (plain, _) = objects(&[&new, &files.recording("plain.mcap")]);
    assert_ne!(found[0]["recorded"], plain[0]["recorded"]);
}

#[tokio::test]
async fn with_a_data_folder_incidents_have_numbers_and_those_that_are_kept_are_the_suite() {
    let data = TestFolder::new("what-if-data");
    std::fs::create_dir_all(folder_in(&data)).unwrap();
    let store = Store::open(&data, Clock::start(), DemoSecrets::Refused).unwrap();
    for id in 1..=3 {
        let path = folder_in(&data).join(file_name(id));
        record_outage(&path);
        let sha256 = Some(hash_file(&path).unwrap());
        let recording = Recording { file: file_name(id), finished: true, sha256, ..Recording::default() };
        let summary = Summary { id, since_ms: 1, until_ms: Some(2), recording, ..Summary::default() };
        store.incident_finished(&summary).await.unwrap();
    }
    let (folder, new) = (data.display().to_string(), data.join("new.yaml"));
    std::fs::write(&new, without_sensors()).unwrap();
    let new = new.display().to_string();
    let (_, err, code) = what_if(&[&new, "--data", &folder]);
    assert!(code == Some(2) && err.contains("no incident in"), "{err}");
    for id in [3, 1] {
        store.keep_incident(id, true, Record::of(Action::IncidentKept, COMMAND_LINE)).await.unwrap();
    }
    let names =
        |found: &[Value]| -> Vec<Value> { found.iter().map(|one| one["recording"].clone()).collect() };
    let (found, code) = objects(&[&new, "--data", &folder]);
    assert_eq!(code, Some(1));
    assert_eq!(names(&found), [json!("incident 1"), json!("incident 3"), Value::Null]);
    assert_eq!((&found[2]["total"], &found[2]["differ"]), (&json!(2), &json!(2)));
    // Both recorded the same seconds, and an alarm is one in the sums.
    assert_eq!(found[0]["new"]["alarms"], found[1]["new"]["alarms"]);
    for side in ["recorded", "new"] {
        assert_eq!(found[2][side], found[0][side]);
    }
    let (found, _) = objects(&[&new, "2", "--data", &folder]);
    assert_eq!(names(&found), [json!("incident 2"), Value::Null]);
    let (_, err, code) = what_if(&[&new, "9", "--data", &folder]);
    assert!(code == Some(2) && err.contains('9'), "{err}");
    store.close().await;
}
