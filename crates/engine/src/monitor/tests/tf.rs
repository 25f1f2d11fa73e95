//! Monitors of transforms: what a chain of frames says of messages with any frames.

use super::*;
use crate::model::monitors::TfLink;
use crate::model::sample::Transform;

const MOVING: usize = 0;
const FIXED: usize = 1;

/// The chain map -> odom -> base, with limits of 0.3 and 1 s.
fn chain() -> (Engine, Arc<Model>) {
    let topic = |name: &str| TopicSpec {
        topic: name.into(),
        type_name: "tf2_msgs/msg/TFMessage".into(),
        stamp: false,
        fields: vec![FieldSpec::transforms_of("odom"), FieldSpec::transforms_of("base")],
    };
    let link = |(parent, child, at): (&str, &str, u32)| TfLink {
        parent: parent.into(),
        child: child.into(),
        moving: field(A, at),
        fixed: field(B, at),
    };
    let links = [("map", "odom", 0), ("odom", "base", 1)].map(link).into();
    let mut parts = parts(vec![(MonitorSpec::Tf { links, bands: at_most(0.3, 1.0) }, Policy::default())]);
    parts.watched =
        Watched { topics: vec![topic("/tf").into(), topic("/tf_static").into()], ..parts.watched };
    let model = model(parts);
    (Engine::new(model.clone(), Timestamp::ZERO), model)
}

const WALL: i64 = 1_700_000_000_000_000_000;

/// A message with the parents of both frames, `lag_ms` old; of a frame without one it says nothing.
fn message(model: &Model, topic: usize, at_ms: u64, [odom, base]: [&[&str]; 2], lag_ms: i64) -> Sample {
    let received_wall_ns = WALL + at_ms as i64 * 1_000_000;
    let of = |parents: &[&str]| {
        let stamp_ns = Some(received_wall_ns - lag_ms * 1_000_000);
        let all = parents.iter().map(|parent| Transform { parent: (*parent).into(), stamp_ns });
        if parents.is_empty() { FieldValue::Absent } else { FieldValue::Transforms(all.collect()) }
    };
    let source = model.watched.topics[topic].clone();
    Sample { received_wall_ns, ..Sample::of(source, [of(odom), of(base)].into()) }
}

struct Chain {
    engine: Engine,
    model: Arc<Model>,
}

impl Chain {
    fn new() -> Chain {
        let (engine, model) = chain();
        Chain { engine, model }
    }

    fn hear(&mut self, topic: usize, at_ms: u64, parents: [&[&str]; 2], lag_ms: i64) {
        let sample = message(&self.model, topic, at_ms, parents, lag_ms);
        self.engine.handle(&Input::Sample(sample), Timestamp::from_millis(at_ms));
    }

    fn pass(&mut self, at_ms: u64) {
        while let Some(due) = self.engine.next_deadline().filter(|due| *due <= Timestamp::from_millis(at_ms))
        {
            self.engine.handle(&Input::Tick, due);
        }
        self.engine.handle(&Input::Tick, Timestamp::from_millis(at_ms));
    }

    #[track_caller]
    fn is(&mut self, state: State, words: &str) {
        let snapshot = self.engine.snapshot();
        let (own, message) = own(&snapshot, 0);
        assert!(own == state && message.contains(words), "{own}: {message}");
    }
}

#[test]
fn a_chain_is_as_old_as_its_oldest_transform() {
    let mut tf = Chain::new();
    tf.hear(MOVING, 100, [&["map"], &[]], 0);
    tf.pass(260);
    tf.is(State::Unknown, "nothing came yet of odom -> base");
    tf.hear(MOVING, 270, [&[], &["odom"]], 50);
    tf.is(State::Ok, "map -> odom: 0.17 s old, at most 0.3 s wanted");
    tf.pass(400);
    tf.is(State::Ok, "");
    tf.pass(401);
    tf.is(State::Warning, "map -> odom is older than 300 ms");
    // The newest stamp counts, also when an older one comes after it.
    tf.hear(MOVING, 410, [&["map"], &["odom"]], 0);
    tf.hear(MOVING, 420, [&["map"], &["odom"]], 900);
    tf.is(State::Ok, "");
    tf.pass(1411);
    tf.is(State::Error, "is older than 1 s");
    // A localization stamps its transform ahead; another clock says nothing.
    tf.hear(MOVING, 1500, [&["map"], &["odom"]], -900);
    tf.is(State::Ok, "");
    // The same one again and again grows old.
    for at_ms in (1600..=2600).step_by(100) {
        tf.hear(MOVING, at_ms, [&["map"], &["odom"]], at_ms as i64 - 1500 - 900);
    }
    tf.is(State::Error, "is older than 1 s");
    tf.hear(MOVING, 2610, [&["map"], &["odom"]], 10_000_000);
    tf.is(State::Unknown, "another clock");
}

/// Each publisher of a static transform keeps its own, whichever comes first.
#[test]
fn an_older_kept_message_tells_of_another_transform() {
    let mut tf = Chain::new();
    for (at_ms, parents, age_s) in [(60_000, [&["map"][..], &[]], 1), (60_010, [&[], &["odom"][..]], 40)] {
        let kept = message(&tf.model, FIXED, at_ms, parents, 0);
        let kept = Sample { late: true, delay: Span::from_secs(age_s), ..kept };
        tf.engine.handle(&Input::Sample(kept), Timestamp::from_millis(at_ms));
    }
    tf.is(State::Ok, "map -> odom: static");
}

#[test]
fn a_static_transform_has_no_age() {
    let mut tf = Chain::new();
    tf.hear(FIXED, 0, [&["map"], &["odom"]], 5_000_000);
    tf.is(State::Ok, "map -> odom: static");
    tf.pass(3_600_000);
    tf.is(State::Ok, "");
}

#[test]
fn two_parents_are_named_and_no_other_name_is_remembered() {
    let mut tf = Chain::new();
    tf.hear(MOVING, 0, [&["map"], &["odom"]], 0);
    tf.hear(MOVING, 100, [&["earth", "map"], &["odom"]], 0);
    tf.is(State::Error, "odom has two parents: map and earth");
    let names: Vec<String> = (0..1000).map(|at| format!("evil{at}")).collect();
    for name in &names {
        tf.hear(MOVING, 200, [&[name], &[name]], 0);
    }
    let kept = format!("{:?}", tf.engine.watching);
    assert_eq!(kept.matches("evil").count(), 4, "{kept}");
    for at in (300..=10_300).step_by(100) {
        tf.hear(MOVING, at, [&["map"], &["odom"]], 0);
    }
    tf.is(State::Ok, "");
    tf.hear(FIXED, 10_400, [&["earth"], &[]], 0);
    tf.pass(10_500);
    tf.is(State::Error, "odom has two parents: map and earth");
}

#[test]
fn a_wrong_parent_is_named_while_the_right_one_is_missing() {
    let mut tf = Chain::new();
    tf.hear(MOVING, 0, [&["map"], &["footprint"]], 0);
    tf.pass(260);
    tf.is(State::Unknown, "the parent of base is footprint, not odom");
}
