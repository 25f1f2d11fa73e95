//! Monitors at the boundary of the engine: from received messages to the module's state.

mod beginning;
mod contextual;
mod isolated;
mod tf;
mod whole;

use std::sync::Arc;

use crate::Engine;
use crate::input::{Input, StatusArray};
use crate::model::monitors::{
    Bands, FieldKind, FieldSpec, MonitorSpec, ProbeTarget, TopicId, TopicSpec, ValueSource, WatchdogSpec,
    Watched,
};
use crate::model::sample::{
    FieldValue, POSITIONS_MAX, Pose, Position, Positions, Probe, ProbeOutcome, PublisherReport, Sample,
};
use crate::model::{GroupId, GroupSpec, Model, ModuleId, ModuleSpec, Parts, Policy, StageModel};
use crate::snapshot::{ModuleView, Snapshot};
use crate::state::State;
use crate::text::Text;
use crate::time::{Span, Timestamp};

pub(super) const A: TopicId = TopicId(0);
pub(super) const B: TopicId = TopicId(1);

/// The event of an instant, by the topic's number.
#[derive(Debug, Clone)]
pub(super) enum Do {
    Nothing,
    Number(usize, f64),
    Value(usize, FieldValue),
    Pose(usize, Pose),
    Objects(usize, Positions),
    /// A message on topic A with a stamp this many milliseconds before its receipt.
    Age(i64),
    /// The same, from before our time.
    Late(i64),
    /// A message on topic A with this stamp.
    Stamp(Option<i64>),
    /// A number on topic A that was published so many milliseconds earlier, and kept for late readers.
    Older(f64, u64),
    /// A stamp that there is no time to compare with.
    NoClock,
    Publishers(usize, u32),
    /// A best-effort one.
    LossyPublisher(usize),
    /// A volatile one, for a new reader.
    NewReader(usize),
    /// Transient local.
    KeepingPublishers(usize, u32),
    OtherType(usize),
    Probe(ProbeOutcome),
    /// A status with these KeyValues.
    Status(&'static str, u8, &'static [(&'static str, &'static str)]),
}

pub(super) fn millis(millis: u64) -> Span {
    Span::from_millis(millis)
}

pub(super) fn at_least(warning: f64, error: f64) -> Bands {
    Bands { warning_below: Some(warning), error_below: Some(error), ..Bands::default() }
}

pub(super) fn at_most(warning: f64, error: f64) -> Bands {
    Bands { warning_above: Some(warning), error_above: Some(error), ..Bands::default() }
}

pub(super) fn field(topic: TopicId, field: u32) -> ValueSource {
    ValueSource::Field { topic, field }
}

pub(super) fn key(status: &str, key: &str) -> ValueSource {
    ValueSource::Key { status: status.into(), key: key.into(), unit: None }
}

/// Two topics with a number, a pose and a list each, and one probe.
pub(super) fn watched() -> Watched {
    let topic = |name: &str| TopicSpec {
        topic: name.into(),
        type_name: "test/msg/Both".into(),
        stamp: true,
        fields: vec![
            FieldSpec::new("x", FieldKind::Scalar),
            FieldSpec::new("pose", FieldKind::Pose),
            FieldSpec::new("objects", FieldKind::Positions),
        ],
    };
    let probe = WatchdogSpec { target: ProbeTarget::Icmp { host: "lidar".into() }, every: millis(100) };
    Watched {
        topics: vec![Arc::new(topic("/a")), Arc::new(topic("/b"))],
        watchdogs: vec![Arc::new(probe)],
        ..Watched::default()
    }
}

pub(super) fn parts(modules: Vec<(MonitorSpec, Policy)>) -> Parts {
    let group = GroupSpec::new("g", Text::plain("G"));
    let module = |(index, (monitor, policy)): (usize, (MonitorSpec, Policy))| ModuleSpec {
        policy,
        ..ModuleSpec::new(&format!("g/m{index}"), GroupId(0), monitor.into())
    };
    Parts {
        groups: vec![group],
        modules: modules.into_iter().enumerate().map(module).collect(),
        watched: watched(),
        ..Parts::empty("v", StageModel::None)
    }
}

pub(super) fn model(parts: Parts) -> Arc<Model> {
    Arc::new(Model::new(parts).expect("nothing depends on anything"))
}

/// Wall time of the engine's zero, in nanoseconds since 1970.
const WALL: i64 = 1_700_000_000_000_000_000;

pub(super) fn input(watched: &Watched, at_ms: u64, what: &Do) -> Input {
    let received_wall_ns = WALL + at_ms as i64 * 1_000_000;
    let none = || FieldValue::Unreadable("the message ends early".into());
    let whole = |topic: usize, stamp_ns, values: [FieldValue; 3]| {
        let source = watched.topics[topic].clone();
        Input::Sample(Sample { stamp_ns, received_wall_ns, ..Sample::of(source, values.into()) })
    };
    let sample = |topic: usize, stamp_ns, [number, pose]: [FieldValue; 2]| {
        whole(topic, stamp_ns, [number, pose, none()])
    };
    let news = |topic: usize, publishers, other_type: Option<&str>, (transient_local, best_effort, anew)| {
        let source = watched.topics[topic].clone();
        let other_type = other_type.map(Into::into);
        Input::Topic(PublisherReport { source, publishers, other_type, transient_local, best_effort, anew })
    };
    match what.clone() {
        Do::Nothing => Input::Tick,
        Do::Number(topic, value) => sample(topic, None, [FieldValue::Number(value), none()]),
        Do::Value(topic, value) => sample(topic, None, [value, none()]),
        Do::Objects(topic, positions) => {
            let positions = FieldValue::Positions(Arc::new(positions));
            whole(topic, None, [none(), none(), positions])
        }
        Do::Pose(topic, pose) => sample(topic, None, [none(), FieldValue::Pose(pose)]),
        Do::Age(age_ms) => sample(0, Some(received_wall_ns - age_ms * 1_000_000), [none(), none()]),
        Do::Late(age_ms) => {
            let Input::Sample(old) = input(watched, at_ms, &Do::Age(age_ms)) else { unreachable!() };
            let values = [FieldValue::Number(1.0), none(), none()].into();
            Input::Sample(Sample { late: true, delay: Span::ZERO, values, ..old })
        }
        Do::Older(value, ms) => {
            let Input::Sample(number) = input(watched, at_ms, &Do::Number(0, value)) else { unreachable!() };
            Input::Sample(Sample { late: true, delay: millis(ms), ..number })
        }
        Do::Stamp(stamp) => sample(0, stamp, [none(), none()]),
        Do::NoClock => {
            let Input::Sample(sample) = input(watched, at_ms, &Do::Age(0)) else { unreachable!() };
            Input::Sample(Sample { received_wall_ns: Sample::NO_CLOCK, ..sample })
        }
        Do::Publishers(topic, publishers) => news(topic, publishers, None, (false, false, false)),
        Do::KeepingPublishers(topic, publishers) => news(topic, publishers, None, (true, false, false)),
        Do::NewReader(topic) => news(topic, 1, None, (false, false, true)),
        Do::LossyPublisher(topic) => news(topic, 1, None, (false, true, false)),
        Do::OtherType(topic) => news(topic, 0, Some("other/msg/Type"), (false, false, false)),
        Do::Probe(outcome) => Input::Probe(Probe { source: watched.watchdogs[0].clone(), outcome }),
        Do::Status(name, level, values) => {
            let mut array = StatusArray::default();
            array.push_status(level, name, "", "");
            for (key, value) in values {
                array.push_value(key, value);
            }
            Input::Diagnostics(array)
        }
    }
}

/// Words that no German sentence has. What is quoted from outside is as it is.
const ENGLISH: &str = "\
    a ago and another answer answers asked at away behind by came cannot clock configuration days deg \
    differ earlier false for from future has holds infinite is it late later least length measured \
    measuring message more most motions nobody not number of older other over publishes row says stamp \
    than the their they to too true type wanted was where with yet zero";

/// Whatever a test makes a monitor say, it says in German too.
#[track_caller]
fn expect_german(view: &ModuleView) {
    let report = &view.report;
    let Some(german) = report.german.as_deref() else {
        assert!(report.message.is_empty(), "no German: {}", report.message);
        return;
    };
    let ours = german.replace("the message ends early", "");
    // Names of topics and types stay what they are.
    let names = |word: &&str| !word.contains('/');
    let mut words = ours
        .split_whitespace()
        .filter(names)
        .map(|word| word.trim_matches(|letter: char| !letter.is_alphabetic()));
    // Sources are called `/a x`, inputs of conditions as the tests like.
    let english = words.find(|word| ENGLISH.split(' ').any(|it| it == *word) && *word != "a");
    assert!(english.is_none(), "{english:?} in: {german}");
}

pub(super) fn own(snapshot: &Snapshot, module: u32) -> (State, &str) {
    let view = snapshot.module(ModuleId(module)).1;
    expect_german(view);
    (view.own, &view.report.message)
}

/// The event at these milliseconds, the own state right after it, and words that the message then holds.
pub(super) type Step<'a> = (u64, Do, State, &'a str);

#[track_caller]
pub(super) fn check(monitor: MonitorSpec, steps: &[Step<'_>]) {
    check_with(monitor, Policy::default(), steps);
}

#[track_caller]
pub(super) fn check_with(monitor: MonitorSpec, policy: Policy, steps: &[Step<'_>]) {
    let (mut engine, model) = start(monitor, policy);
    follow(&mut engine, &model, steps);
}

/// The same thing at every so many milliseconds, then one last look.
#[track_caller]
pub(super) fn check_every(
    monitor: MonitorSpec,
    every_ms: usize,
    until_ms: u64,
    what: impl Fn(u64) -> Vec<Do>,
    then: &[Step<'_>],
) {
    let (mut engine, model) = start(monitor, Policy::default());
    for at in (0..=until_ms).step_by(every_ms) {
        what(at).iter().for_each(|what| feed(&mut engine, &model, at, what));
    }
    follow(&mut engine, &model, then);
}

/// An engine with one module.
pub(super) fn start(monitor: MonitorSpec, policy: Policy) -> (Engine, Arc<Model>) {
    let model = model(parts(vec![(monitor, policy)]));
    (Engine::new(model.clone(), Timestamp::ZERO), model)
}

pub(super) fn feed(engine: &mut Engine, model: &Model, at_ms: u64, what: &Do) {
    engine.handle(&input(&model.watched, at_ms, what), Timestamp::from_millis(at_ms));
}

#[track_caller]
fn follow(engine: &mut Engine, model: &Model, steps: &[Step<'_>]) {
    for (at, what, state, words) in steps {
        feed(engine, model, *at, what);
        let snapshot = engine.snapshot();
        let (own, message) = own(&snapshot, 0);
        assert!(own == *state && message.contains(words), "at {at} ms after {what:?}: {own}: {message}");
    }
}
