//! Every document that a recording may hold follows the JSON Schema in its channel's metadata.

use std::collections::BTreeMap;
use std::process::Command;
use std::sync::Arc;

use serde_json::Value;
use telltale::engine::action::{AlarmRef, OperatorAction, Place};
use telltale::engine::discovery::{NodeOf, WriterId, WriterList};
use telltale::engine::input::{
    FleetFault, Input, ListenerReport, OutputReport, ReceptionTrouble, StatusArray, TroubleKind, Upkeep,
};
use telltale::engine::model::monitors::{
    FieldKind, FieldSpec, ProbeTarget, ProcessMeasure, Resource, TopicSpec, WatchdogSpec,
};
use telltale::engine::model::output::Output;
use telltale::engine::model::sample::{
    Elements, FieldValue, Fingerprint, Pose, Position, Positions, Probe, ProbeOutcome, PublisherReport,
    Sample, Transform,
};
use telltale::engine::text::Text;
use telltale::engine::time::{Span, Timestamp};
use telltale::record::file::{IncidentFile, JOURNAL, TRANSITIONS};
use telltale::record::journal::{LeftOut, Line, MessageRef, Took};
use telltale::record::ring::ConfigurationText;
use telltale::record::transition::{Change, Transition};

use crate::folder::TestFolder;

/// A number for each kind of input, so that a new kind has to be named here and below.
fn kind(input: &Input) -> usize {
    match input {
        Input::Diagnostics(_) => 0,
        Input::Writers(_) => 1,
        Input::Signal { .. } => 2,
        Input::Sample(_) => 3,
        Input::Topic(_) => 4,
        Input::Probe(_) => 5,
        Input::Reception(_) => 6,
        Input::Output(_) => 7,
        Input::Listened(_) => 8,
        Input::Aggregator { .. } => 9,
        Input::Storage { .. } => 10,
        Input::Dds { .. } => 11,
        Input::Upkeep(_) => 12,
        Input::Display { .. } => 13,
        Input::Operator(_) => 14,
        Input::Tick => 15,
        Input::Nodes { .. } => 16,
        Input::Voices { .. } => 17,
    }
}

fn inputs() -> Vec<Input> {
    let mut array = StatusArray::default().said_by(WriterId([0xab; 16]));
    array.push_status(255, "lidar: top", "kein Signal ä", "");
    array.push_value("rate", "9.5 Hz");
    let writers = [NodeOf::Pending, NodeOf::Unannounced, NodeOf::Named("/lidar".into())];
    let writers = writers.into_iter().enumerate().map(|(at, node)| (WriterId([at as u8; 16]), node));
    let list = WriterList { as_of: Timestamp::from_millis(7), complete: true, writers: writers.collect() };
    let field = |kind| match kind {
        FieldKind::Named => {
            FieldSpec { names: ["ERROR".into()].into(), ..FieldSpec::new("status[0].level", kind) }
        }
        _ => FieldSpec::new("pose.pose", kind),
    };
    let topic = Arc::new(TopicSpec {
        topic: "/odometry".into(),
        type_name: "nav_msgs/msg/Odometry".into(),
        stamp: true,
        fields: [
            FieldKind::Scalar,
            FieldKind::Named,
            FieldKind::Pose,
            FieldKind::Positions,
            FieldKind::Transforms,
            FieldKind::Elements,
            FieldKind::Content,
        ]
        .map(field)
        .into(),
    });
    let pose = Pose { x_m: f64::NAN, y_m: f64::INFINITY, z_m: f64::NEG_INFINITY, ..Pose::default() };
    let positions = Positions { taken: [Position { x_m: 1.5, y_m: -2.0 }].into(), count: 3 };
    let elements =
        Elements { taken: [FieldValue::Number(6.0), FieldValue::Text("a".into())].into(), count: 3 };
    let of = |stamp_ns| Transform { parent: "map".into(), stamp_ns };
    let transforms = [of(Some(7)), of(None)];
    let values = [
        FieldValue::Number(f64::NAN),
        FieldValue::Number(-1e300),
        FieldValue::Bool(true),
        FieldValue::Text("".into()),
        FieldValue::Pose(pose),
        FieldValue::Positions(Arc::new(positions)),
        FieldValue::Transforms(transforms.into()),
        FieldValue::Elements(Arc::new(elements)),
        FieldValue::Content(Fingerprint(u64::MAX)),
        FieldValue::Absent,
        FieldValue::Unreadable("it ends early".into()),
    ];
    let sample = |stamp_ns| Sample {
        stamp_ns,
        received_wall_ns: Sample::NO_CLOCK,
        ..Sample::of(topic.clone(), values.clone().into())
    };
    let targets = [
        ProbeTarget::Icmp { host: "10.0.0.1".into() },
        ProbeTarget::Tcp { address: "10.0.0.1:80".into() },
        ProbeTarget::Node { name: "/ns/a".into() },
        ProbeTarget::Service { name: "/ns/s".into() },
        ProbeTarget::Qos { topic: "/a".into() },
        ProbeTarget::System(Resource::Cpu),
        ProbeTarget::System(Resource::Memory),
        ProbeTarget::System(Resource::Disk { path: "/var".into() }),
        ProbeTarget::System(Resource::Temperature { sensor: "coretemp".into() }),
        ProbeTarget::System(Resource::Process { name: "a".into(), measure: None }),
        ProbeTarget::System(Resource::Process { name: "a".into(), measure: Some(ProcessMeasure::Cpu) }),
    ];
    let outcomes = [
        ProbeOutcome::Answered { after: Span::from_millis(3) },
        ProbeOutcome::Announced,
        ProbeOutcome::Repeated { times: 3 },
        ProbeOutcome::Measured(70.5),
        ProbeOutcome::Missed("refused".into()),
        ProbeOutcome::Impossible("no permission".into()),
    ];
    let probe = |target: &ProbeTarget, outcome: &ProbeOutcome| {
        let source = Arc::new(WatchdogSpec { target: target.clone(), every: Span::from_secs(1) });
        Input::Probe(Probe { source, outcome: outcome.clone() })
    };
    let trouble = |kind| {
        let (topic, text) = ("/a".into(), "it is short".into());
        Input::Reception(ReceptionTrouble { topic, kind, count: 2, text })
    };
    let pose = Place::Pose { x_m: 1.0, y_m: 2.0, yaw_deg: -90.0 };
    let (display_live, storage_ok) = (true, false);
    let actions = [
        OperatorAction::Login { name: "anna".into() },
        OperatorAction::Logout,
        OperatorAction::Shutdown,
        OperatorAction::Localize { place: Place::Stop("depot".into()) },
        OperatorAction::Localize { place: pose },
        OperatorAction::AskClearance { display_live, storage_ok },
        OperatorAction::Clear { display_live, storage_ok },
        OperatorAction::RequestStop,
        OperatorAction::Withdraw,
        OperatorAction::AskRelease { display_live, storage_ok },
        OperatorAction::Release { display_live, storage_ok },
        OperatorAction::Acknowledge { alarm: AlarmRef::Number(1) },
        OperatorAction::Acknowledge { alarm: AlarmRef::Over { last: 2 } },
        OperatorAction::Acknowledge { alarm: AlarmRef::Node("a/b".into()) },
        OperatorAction::Reset { module: "a/b".into() },
        OperatorAction::Shelve { module: "a/b".into(), lasts: Span::from_secs(60), by: "dev".into() },
        OperatorAction::Unshelve { module: "a/b".into() },
    ];
    let outputs = [
        Output::Stage,
        Output::Clearance,
        Output::Pose,
        Output::Deceleration,
        Output::ManeuverStop,
        Output::Hold,
    ];
    let report = |output| OutputReport { output, topic: "/t".into(), error: None };
    let fault = Some("the disk is full".into());
    let text = Some(Text::plain("It is late."));
    let mut all = vec![
        Input::Diagnostics(array),
        Input::Writers(Arc::new(list)),
        Input::Signal { name: "active".into(), value: true },
        Input::Sample(sample(None)),
        Input::Sample(sample(Some(-5))),
        Input::Topic(PublisherReport {
            source: topic.clone(),
            publishers: 1,
            other_type: None,
            transient_local: false,
            best_effort: true,
            anew: true,
        }),
        Input::Topic(PublisherReport {
            source: topic.clone(),
            publishers: 0,
            other_type: Some("a/msg/B".into()),
            transient_local: true,
            best_effort: false,
            anew: false,
        }),
        Input::Output(OutputReport { error: Some("no reader".into()), ..report(Output::Stage) }),
        Input::Aggregator { other: None },
        Input::Aggregator { other: Some("/diagnostics_agg of /other".into()) },
        Input::Voices { other: None },
        Input::Voices { other: Some("/telltale/hold by /other".into()) },
        Input::Nodes { repeated: None },
        Input::Nodes { repeated: Some("/planner".into()) },
        Input::Storage { fault: fault.clone() },
        Input::Dds { fault },
        Input::Dds { fault: None },
        Input::Upkeep(Upkeep::default()),
        Input::Upkeep(Upkeep {
            clock: text.clone(),
            certificate: text.clone(),
            recording: text.clone(),
            fleet: text.map(|text| FleetFault { text, is_error: true }),
        }),
        Input::Display { late: Some("anna".into()) },
        Input::Tick,
    ];
    all.extend(targets.iter().map(|target| probe(target, &outcomes[0])));
    all.extend(outcomes.iter().map(|outcome| probe(&targets[0], outcome)));
    all.extend([TroubleKind::Malformed, TroubleKind::WrongType, TroubleKind::Lost].map(trouble));
    all.extend(outputs.map(|output| Input::Output(report(output))));
    let heard = |output| ListenerReport { output, topic: "/t".into(), heard: false };
    all.extend(outputs.map(|output| Input::Listened(heard(output))));
    all.extend(actions.map(Input::Operator));
    all
}

/// As `kind`, for changes.
fn kind_of_change(change: &Change<'_>) -> usize {
    match change {
        Change::Started { .. } => 0,
        Change::Shown { .. } => 1,
        Change::Stage { .. } => 2,
        Change::Signal { .. } => 3,
        Change::AlarmRaised { .. } => 4,
        Change::AlarmMoved { .. } => 5,
        Change::AlarmAcknowledged { .. } => 6,
        Change::AlarmCleared { .. } => 7,
        Change::Left { .. } => 8,
        Change::Lost { .. } => 9,
        Change::ClockSet { .. } => 10,
        Change::Trigger { .. } => 11,
        Change::Refused { .. } => 12,
    }
}

fn changes() -> Vec<Change<'static>> {
    let (node, alarm) = ("a/b", 7);
    let shown = |masked_by: Option<&'static str>, message: Option<&'static str>| Change::Shown {
        node: node.into(),
        shown: "ignore".into(),
        own: "error".into(),
        masked_by: masked_by.map(Into::into),
        message: message.map(Into::into),
        began_ms: message.map(|_| 1_763_640_000_000),
    };
    let trigger = |alarm, note: &'static str| Change::Trigger {
        of: "root".into(),
        what: node.into(),
        alarm,
        note: note.into(),
    };
    vec![
        Change::Started { reloaded: true },
        shown(None, None),
        shown(Some("c"), Some("late")),
        Change::Stage { stage: "cleared".into() },
        Change::Signal { signal: "active".into(), value: None },
        Change::Signal { signal: "active".into(), value: Some(false) },
        Change::AlarmRaised { alarm, node: node.into() },
        Change::AlarmMoved { alarm, symptom: "c".into(), node: node.into() },
        Change::AlarmAcknowledged { alarm, node: node.into() },
        Change::AlarmCleared { alarm, node: node.into() },
        Change::Left { node: node.into() },
        Change::Lost { count: 3 },
        Change::ClockSet { by_ms: -5 },
        trigger(None, ""),
        trigger(Some(7), "a strange noise"),
        Change::Refused {
            action: "clear".into(),
            on: "".into(),
            by: "anna".into(),
            why: "No goal.".into(),
            why_de: "Kein Ziel.".into(),
        },
    ]
}

#[test]
fn every_kind_of_document_follows_its_schema() {
    let folder = TestFolder::new("recording-schemas");
    std::fs::create_dir_all(&*folder).expect("a folder for temporary files");
    let path = folder.join("a.mcap");
    let mut file = IncidentFile::create(&path, BTreeMap::new()).expect("the file is new");
    let message = MessageRef {
        topic: "/diagnostics".into(),
        writer: "ab".repeat(16),
        sequence: -1,
        received_ns: 1_790_000_000_000_000_000,
    };
    let (inputs, changes) = (inputs(), changes());
    let mut kinds: Vec<usize> = inputs.iter().map(kind).collect();
    kinds.sort_unstable();
    kinds.dedup();
    assert!(kinds.iter().copied().eq(0..18), "{kinds:?}");
    let mut kinds: Vec<usize> = changes.iter().map(kind_of_change).collect();
    kinds.dedup();
    assert!(kinds.iter().copied().eq(0..13), "{kinds:?}");
    let texts = vec![ConfigurationText { name: "v.yaml".into(), text: "vehicle: {}\n".into() }];
    let others = [Took::Statuses, Took::Reload(texts), Took::Lost(3)];
    let all = inputs.into_iter().map(|input| Took::Input(std::borrow::Cow::Owned(input))).chain(others);
    let lines: Vec<Line> = all
        .enumerate()
        .map(|(at, took)| {
            let message = at.is_multiple_of(2).then(|| message.clone());
            let left_out = message.is_none().then(|| LeftOut {
                topic: "/points".into(),
                writer: "01".repeat(16),
                sequence: 7,
                received_ns: 8,
                published_ns: (at % 2 == 0).then_some(9),
                bytes: 10,
            });
            Line { at_ns: Timestamp::from_millis(at as u64), took, message, left_out }
        })
        .collect();
    for line in &lines {
        file.json(&JOURNAL, 1, line).expect("the disk has room");
    }
    for change in &changes {
        file.json(&TRANSITIONS, 1, &Transition { at_ms: 1, change: change.clone() })
            .expect("the disk has room");
    }
    file.finish().expect("the disk has room");
    assert_eq!(
        read(&path),
        Ok(BTreeMap::from([
            ("/telltale/journal".to_owned(), lines.len()),
            ("/telltale/transitions".to_owned(), changes.len()),
        ]))
    );

    // A document of another kind does not.
    let path = folder.join("b.mcap");
    let mut file = IncidentFile::create(&path, BTreeMap::new()).expect("the file is new");
    let wrong = serde_json::json!({ "at_ns": 1, "took": { "input": { "signal": { "name": "a" } } } });
    file.json(&JOURNAL, 1, &wrong).expect("the disk has room");
    file.finish().expect("the disk has room");
    let refused = read(&path).expect_err("a signal has a value");
    assert!(refused.contains("AssertionError: /telltale/journal"), "{refused}");
}

/// How many documents of each channel a foreign program finds to follow the schema, or what it says.
fn read(path: &std::path::Path) -> Result<BTreeMap<String, usize>, String> {
    let python = std::env::var("TELLTALE_PEER_PYTHON")
        .expect("TELLTALE_PEER_PYTHON names a Python with tests/requirements.txt: tests/run.sh makes one");
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/record/readers.py");
    let output = Command::new(python).arg(script).arg(path).output().expect("Python starts");
    if !output.status.success() {
        return Err(String::from_utf8_lossy(&output.stderr).into_owned());
    }
    let read: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    Ok(serde_json::from_value(read["schema"].clone()).expect("counts"))
}
