//! Tests of the topics that are read for a model, and of the inputs that their messages mean.

use super::*;
use crate::cdr::{Fault, FaultKind};
use crate::messages::{BOOL, encode};
use telltale_engine::input::StatusArray;
use telltale_engine::model::monitors::{FieldKind, FieldSpec, RecordedTopic};
use telltale_engine::model::sample::Pose;
use telltale_engine::model::{FieldSource, Parts, SignalSource, StageModel};
use telltale_engine::time::Span;

fn signal(name: &str, topic: &str, type_name: &str, present_for: Option<Span>) -> SignalSpec {
    let source = FieldSource { topic: topic.into(), type_name: type_name.into(), field: "data".into() };
    SignalSpec { present_for, ..SignalSpec::new(name, SignalSource::Field(source)) }
}

fn read(signals: Vec<SignalSpec>) -> Result<Vec<Arc<Subscription>>, String> {
    read_all(signals, Vec::new())
}

fn read_all(signals: Vec<SignalSpec>, topics: Vec<TopicSpec>) -> Result<Vec<Arc<Subscription>>, String> {
    let parts = Parts {
        signals,
        watched: Watched { topics: topics.into_iter().map(Arc::new).collect(), ..Watched::default() },
        ..Parts::empty("v", StageModel::None)
    };
    let model = Model::new(parts).expect("nothing depends on anything");
    let plan = Plan::of(&model, &Definitions::default());
    plan.map(|plan| plan.subscriptions).map_err(|error| error.to_string())
}

#[test]
fn topics_are_read_once_with_their_wire_names() {
    let all = read(vec![
        signal("active", "/mission/active", BOOL, None),
        signal("moving", "mission/active", BOOL, None),
        signal("goal", "/goal_pose", "geometry_msgs/msg/PoseStamped", Some(Span::from_secs(1))),
    ])
    .unwrap();
    let wire: Vec<_> = all.iter().map(|one| (&*one.dds_topic, &*one.dds_type)).collect();
    assert_eq!(
        wire,
        [
            ("rt/diagnostics", "diagnostic_msgs::msg::dds_::DiagnosticArray_"),
            ("rt/mission/active", "std_msgs::msg::dds_::Bool_"),
            ("rt/goal_pose", "geometry_msgs::msg::dds_::PoseStamped_"),
        ]
    );
    assert_eq!(all.iter().map(|one| one.wants_last_value()).collect::<Vec<_>>(), [false, true, false]);
}

#[test]
fn the_value_of_a_signal_that_comes_later_than_its_timeout_is_over() {
    let timeout = Some(Span::from_secs(2));
    let all = read(vec![
        SignalSpec { timeout, ..signal("arm_on", "/a", BOOL, None) },
        signal("docked", "/a", BOOL, None),
    ])
    .unwrap();
    let is_over = |name: &str, late_ms: u64| {
        let input = Input::Signal { name: name.into(), value: false };
        all[1].is_over(&input, Span::from_millis(late_ms))
    };
    assert_eq!([0, 1999, 2000, 9000].map(|ms| is_over("arm_on", ms)), [false, false, true, true]);
    assert!(!is_over("docked", 9000), "without a timeout it is never too old");
    assert!(!all[1].is_over(&Input::Tick, Span::from_secs(9)));
}

#[test]
fn messages_become_inputs() {
    let all = read(vec![
        signal("active", "/a", BOOL, None),
        signal("moving", "/a", BOOL, None),
        signal("goal", "/g", "geometry_msgs/msg/PoseStamped", Some(Span::from_secs(1))),
    ])
    .unwrap();
    let signal = |name: &str, value| Input::Signal { name: name.into(), value };
    let decode = |index: usize, body: &[u8]| {
        let body = Ok((body.to_vec().into(), Endian::Little));
        all[index].decode(Received { body: &body, writer: [0; 16], wall_ns: 0, when: PublicationTime::Now })
    };
    assert_eq!(decode(1, &[1, 0, 0, 0]), (vec![signal("active", true), signal("moving", true)], None));
    assert_eq!(decode(1, &[0]), (vec![signal("active", false), signal("moving", false)], None));
    let header = encode::Header { stamp: std::time::UNIX_EPOCH, frame_id: "map" };
    let pose = encode::pose_stamped(header, Pose { qw: 1.0, ..Pose::default() });
    assert_eq!(decode(2, &pose), (vec![signal("goal", true)], None));
    let (inputs, fault) = decode(2, &[]);
    assert!(inputs.is_empty() && fault.is_some());
    let (inputs, fault) = decode(1, &[]);
    assert!(inputs.is_empty() && fault.is_some());
    let (inputs, fault) = decode(0, &[1, 2]);
    assert!(inputs.is_empty() && fault.is_some());
    let empty = messages::encode_diagnostic_arrays(&StatusArray::default(), std::time::UNIX_EPOCH, 100);
    assert_eq!(decode(0, &empty[0]), (vec![Input::Diagnostics(StatusArray::default())], None));
}

#[test]
fn what_cannot_be_read_is_refused() {
    let pose = "geometry_msgs/msg/PoseStamped";
    let error = read(vec![signal("goal", "/g", pose, None)]).unwrap_err();
    assert!(error.contains("goal") && error.contains(pose) && error.contains("present_for"), "{error}");
    let error = read(vec![signal("goal", "/g", "PoseStamped", Some(Span::from_secs(1)))]).unwrap_err();
    assert!(error.contains("package/msg/Name"), "{error}");
    let error = read(vec![signal("a", "/diagnostics", BOOL, None)]).unwrap_err();
    assert!(error.contains("two types"), "{error}");
}

fn topic(topic: &str, type_name: &str, stamp: bool, paths: &[&str]) -> TopicSpec {
    let fields = paths.iter().map(|&path| FieldSpec::new(path, FieldKind::Scalar));
    TopicSpec { topic: topic.into(), type_name: type_name.into(), stamp, fields: fields.collect() }
}

#[test]
fn a_signal_and_monitors_share_one_topic() {
    let mut ready = signal("dense", "/cloud", encode::POINT_CLOUD_2, None);
    let SignalSource::Field(source) = &mut ready.source else { panic!() };
    source.field = "is_dense".into();
    let topics = vec![
        topic("/cloud", encode::POINT_CLOUD_2, true, &["width", "nothing[0].x"]),
        topic("/number", encode::FLOAT64, false, &["data"]),
        topic("/counted", "my_msgs/msg/Unknown", false, &[]),
    ];
    let error = read_all(vec![ready.clone()], topics.clone()).unwrap_err();
    assert!(error.contains("/cloud") && error.contains("no field `nothing`"), "{error}");
    let mut topics = topics;
    topics[0].fields.truncate(1);
    let all = read_all(vec![ready], topics).unwrap();
    assert_eq!(all.len(), 4);
    assert_eq!(all.iter().map(|one| one.wants_last_value()).collect::<Vec<_>>(), [false, true, true, false]);

    let header = encode::Header { stamp: std::time::UNIX_EPOCH, frame_id: "" };
    let body = Ok((encode::point_cloud(header, 3).into(), Endian::Little));
    let decode = |when| all[1].decode(Received { body: &body, writer: [0; 16], wall_ns: 7, when });
    let signal = Input::Signal { name: "dense".into(), value: true };
    let sample = |stamp_ns, late, value| {
        let source = all[1].watched().unwrap().clone();
        Input::Sample(Sample { stamp_ns, received_wall_ns: 7, late, ..Sample::of(source, [value].into()) })
    };
    let of_now = |late| sample(Some(0), late, FieldValue::Number(3.0));
    assert_eq!(decode(PublicationTime::Now), (vec![signal.clone(), of_now(false)], None));
    assert_eq!(decode(PublicationTime::Late), (vec![signal.clone(), of_now(true)], None));
    let past = sample(None, true, FieldValue::Absent);
    assert_eq!(decode(PublicationTime::Kept), (vec![signal, past.clone()], None), "ages are judged there");
    assert_eq!(decode(PublicationTime::Past), (vec![past], None));

    let unreadable: RawBody = Err(Fault { at: 0, what: FaultKind::Encoding([0, 7]) });
    let (inputs, wrong) = all[2].decode(Received {
        body: &unreadable,
        writer: [0; 16],
        wall_ns: 7,
        when: PublicationTime::Now,
    });
    let Input::Sample(sample) = &inputs[0] else { panic!("{inputs:?}") };
    assert!(matches!(&sample.values[..], [FieldValue::Unreadable(_)]) && wrong.is_some());
    let (inputs, wrong) = all[3].decode(Received {
        body: &Ok((vec![].into(), Endian::Big)),
        writer: [0; 16],
        wall_ns: 7,
        when: PublicationTime::Now,
    });
    assert!(matches!(&inputs[..], [Input::Sample(sample)] if sample.values.is_empty()) && wrong.is_none());
}

#[test]
fn a_recording_needs_no_content_of_what_is_only_counted_unless_it_is_named() {
    let topic = |topic: &str, fields: &[&str]| {
        let field = |path: &&str| FieldSpec::new(*path, FieldKind::Scalar);
        Arc::new(TopicSpec {
            topic: topic.into(),
            type_name: if fields.is_empty() { String::new() } else { BOOL.to_owned() }.into(),
            stamp: false,
            fields: fields.iter().map(field).collect(),
        })
    };
    let recorded =
        |pattern: &str, ms| RecordedTopic { pattern: pattern.into(), every: Span::from_millis(ms) };
    let watched = Watched {
        topics: vec![
            topic("/points", &[]),
            topic("/thin", &[]),
            topic("/whole", &[]),
            topic("/door", &[]),
            topic("/read", &["data"]),
            topic("/never", &[]),
        ],
        recorded: vec![
            recorded("/thin", 500),
            RecordedTopic { pattern: "/never*".into(), every: RecordedTopic::NEVER },
            recorded("/whole", 0),
            recorded("/diagnostics", 500),
        ],
        ..Watched::default()
    };
    let signals = vec![signal("door", "door", BOOL, None)];
    let model = Model::new(Parts { signals, watched, ..Parts::empty("v", StageModel::None) }).unwrap();
    assert_eq!(model.counted_topics().collect::<Vec<_>>(), ["/points"]);
    let plan = Plan::of(&model, &Definitions::default()).unwrap();
    let keeping = |topic: &str| {
        plan.subscriptions.iter().filter(|one| *one.topic == *topic).map(|one| one.keeping()).next_back()
    };
    assert_eq!(keeping("/points"), Some(Keeping::UnlessLarge));
    assert_eq!(keeping("/thin"), Some(Keeping::Every(Span::from_millis(500))));
    assert_eq!(keeping("/never"), Some(Keeping::Never));
    assert!(plan.recorded("/never_read", BOOL).is_none());
    for whole in ["/whole", "/read", "/diagnostics", "/door"] {
        assert_eq!(keeping(whole), Some(Keeping::Whole), "{whole}");
    }
}
