//! A thousand monitors of all kinds on two hundred topics.

use std::sync::Arc;

use telltale::engine::input::Input;
use telltale::engine::model::monitors::{
    AgreementRule, Bands, FieldKind, FieldSpec, TopicId, TopicSpec, ValueRule, ValueSource, Watched,
};
use telltale::engine::model::sample::{FieldValue, Pose, Sample};
use telltale::engine::model::{Model, MonitorSpec, Parts};
use telltale::engine::time::{Span, Timestamp};

pub const MONITORS: usize = 1_000;
pub const TOPICS: usize = 200;

/// The vehicle of the other benchmarks, with monitors.
pub fn model() -> Model {
    let mut parts: Parts = (**crate::vehicle::model(MONITORS)).clone();
    let topics: Vec<Arc<TopicSpec>> = (0..TOPICS).map(topic).collect();
    parts.watched = Watched { topics, ..Watched::default() };
    for (index, module) in parts.modules.iter_mut().enumerate() {
        module.monitor = monitor(index).into();
    }
    Model::new(parts).expect("monitors depend on nothing")
}

fn topic(index: usize) -> Arc<TopicSpec> {
    Arc::new(TopicSpec {
        topic: format!("/component_{index:03}/output").into(),
        type_name: "nav_msgs/msg/Odometry".into(),
        stamp: true,
        fields: vec![
            FieldSpec::new("twist.twist.linear.x", FieldKind::Scalar),
            FieldSpec::new("pose.pose", FieldKind::Pose),
        ],
    })
}

fn monitor(index: usize) -> MonitorSpec {
    let topic = |index: usize| TopicId((index % TOPICS) as u32);
    let field = |index: usize, field| ValueSource::Field { topic: topic(index), field };
    let window = Span::from_secs(2);
    let at_least = Bands { warning_below: Some(90.0), error_below: Some(50.0), ..Bands::default() };
    let at_most = Bands { warning_above: Some(0.5), error_above: Some(1.0), ..Bands::default() };
    let balanced = Bands { warning_below: Some(0.9), warning_above: Some(1.1), ..Bands::default() };
    match index % 5 {
        0 => MonitorSpec::Frequency { topic: topic(index / 5), window, bands: at_least },
        1 => MonitorSpec::Latency { topic: topic(index / 5), window, bands: at_most },
        2 => MonitorSpec::Value { source: field(index / 5, 0), rule: ValueRule::Bands(at_most), empty: None },
        3 => MonitorSpec::RateRatio {
            input: topic(index / 5),
            output: topic(index / 5 + 1),
            window,
            bands: balanced,
        },
        _ => MonitorSpec::Agreement {
            a: field(index / 5, 1),
            b: field(index / 5 + 1, 1),
            max_age: window,
            motion_over: Some(Span::from_secs(1)),
            rule: AgreementRule::Pose { translation: at_most, rotation_deg: at_most },
        },
    }
}

/// Message `number` of a stream over all topics in turn, at 20,000 a second.
pub fn message(topics: &[Arc<TopicSpec>], number: u64) -> (Input, Timestamp) {
    let now = Timestamp::from_nanos(number * 50_000);
    let seconds = now.as_nanos() as f64 / 1e9;
    let pose = Pose { x_m: 5.0 * seconds, qw: 1.0, ..Pose::default() };
    let sample = Sample {
        stamp_ns: Some(1 + now.as_nanos() as i64),
        received_wall_ns: 20_000_001 + now.as_nanos() as i64,
        ..Sample::of(
            topics[number as usize % topics.len()].clone(),
            [FieldValue::Number(seconds.sin() * 0.4), FieldValue::Pose(pose)].into(),
        )
    };
    (Input::Sample(sample), now)
}
