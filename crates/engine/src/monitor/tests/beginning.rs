//! A healthy vehicle whose diagnosis begins: after a start, a reload, a change of the stage. Nothing may be
//! worse than UNKNOWN then.

use std::collections::BTreeSet;

use State::{Error, Ok, Unknown, Warning};

use super::*;
use crate::input::OperatorAction;
use crate::model::monitors::Class;
use crate::model::monitors::{AgreementRule, Condition, FrozenLimits, ValueRule, WatchdogId};
use crate::model::{Dependency, DependsOn, NodeId, Within};
use crate::restart::resume::Restored;

const WINDOW_MS: u64 = 1000;
const PERIOD_MS: u64 = 100;
/// Discovery takes no longer.
const SEARCH_MS: u64 = 3000;

/// One of each kind that is fed by topics or probes.
fn each_kind() -> Vec<(MonitorSpec, Policy)> {
    let window = millis(WINDOW_MS);
    let motion = AgreementRule::Pose { translation: at_most(0.1, 0.5), rotation_deg: Bands::default() };
    let agreement = |slot, motion_over, rule| MonitorSpec::Agreement {
        a: field(A, slot),
        b: field(B, slot),
        max_age: millis(500),
        motion_over,
        rule,
    };
    let condition = Condition::new("v > 1.5", |values| match values {
        [FieldValue::Number(value), _] => Result::Ok(*value > 1.5),
        _ => Err("no number".into()),
    });
    let kinds = vec![
        MonitorSpec::Frequency { topic: A, window, bands: at_least(8.0, 5.0) },
        MonitorSpec::Latency { topic: A, window, bands: at_most(0.05, 0.1) },
        MonitorSpec::Value { source: field(A, 0), rule: ValueRule::Bands(at_most(1.5, 2.0)), empty: None },
        MonitorSpec::Value {
            source: field(A, 0),
            rule: ValueRule::Bands(at_most(1.5, 2.0)),
            empty: Some(State::Ok),
        },
        MonitorSpec::Frozen {
            source: field(A, 1),
            limits: FrozenLimits { time: at_most(0.3, 0.5), repeats: at_most(2.0, 3.0) },
        },
        MonitorSpec::Watchdog { watchdog: WatchdogId(0), misses: 2, bands: Bands::default() },
        MonitorSpec::RateRatio { input: A, output: B, window, bands: at_least(0.8, 0.5) },
        MonitorSpec::Sequence {
            earlier: field(A, 0),
            later: field(B, 0),
            max_gap: millis(300),
            bands: at_most(0.1, 0.5),
        },
        agreement(0, None, AgreementRule::Number(at_most(0.1, 0.5))),
        agreement(1, Some(window), motion),
        MonitorSpec::Expression {
            inputs: vec![("v".into(), field(A, 0)), ("w".into(), field(B, 0))],
            max_age: millis(500),
            warning: None,
            error: Some(condition),
            class: Class { location: "contextual", information: "content", flow: None },
        },
    ];
    kinds.into_iter().map(|kind| (kind, Policy::default())).collect()
}

/// What comes of a vehicle at 36 km/h on which all is well: each topic from an instant on, and before
/// its first message discovery speaks of it, if it `announces` it so long before.
#[derive(Debug, Clone, Copy)]
struct Healthy {
    from_ms: [u64; 2],
    announced_ms: Option<u64>,
}

impl Healthy {
    fn feed(&self, engine: &mut Engine, watched: &Watched, at_ms: u64) {
        let now = Timestamp::from_millis(at_ms);
        engine.handle(&Input::Tick, now);
        for (topic, from_ms) in self.from_ms.into_iter().enumerate() {
            if self.announced_ms.is_some_and(|before_ms| at_ms + before_ms == from_ms) {
                engine.handle(&input(watched, at_ms, &Do::Publishers(topic, 1)), now);
            }
            if at_ms >= from_ms && (at_ms - from_ms).is_multiple_of(PERIOD_MS) {
                let Input::Sample(mut sample) = input(watched, at_ms, &Do::Number(topic, 1.0)) else {
                    return;
                };
                sample.stamp_ns = Some(sample.received_wall_ns - 10_000_000);
                let pose = Pose { x_m: at_ms as f64 / 100.0, qw: 1.0, ..Pose::default() };
                sample.values[1] = FieldValue::Pose(pose);
                engine.handle(&Input::Sample(sample), now);
            }
        }
        if at_ms.is_multiple_of(100) {
            let answer = ProbeOutcome::Answered { after: millis(1) };
            engine.handle(&input(watched, at_ms, &Do::Probe(answer)), now);
        }
    }

    /// Lets it drive for so long; every kind is OK at the end, and none was ever worse than UNKNOWN.
    #[track_caller]
    fn check(&self, mut engine: Engine, model: &Model, from_ms: u64, until_ms: u64) {
        for at_ms in (from_ms..=until_ms).step_by(10) {
            self.feed(&mut engine, &model.watched, at_ms);
            let snapshot = engine.snapshot();
            for module in 0..model.modules.len() as u32 {
                let (state, message) = own(&snapshot, module);
                let well = matches!(state, Ok | Unknown) && (at_ms < until_ms || state == Ok);
                assert!(well, "{self:?}, at {at_ms} ms: module {module} is {state}: {message}");
            }
        }
    }
}

/// Starts of the two topics, in any order, up to the end of the search.
fn beginnings() -> impl Iterator<Item = Healthy> {
    let offsets = [10, 730, 1480, SEARCH_MS - 10];
    let pairs = offsets.into_iter().flat_map(move |a| offsets.map(|b| [a, b]));
    pairs.flat_map(|from_ms| {
        [None, Some(0), Some(10), Some(50)]
            .into_iter()
            .filter(move |before| before.is_none_or(|before| before <= from_ms[0].min(from_ms[1])))
            .map(move |announced_ms| Healthy { from_ms, announced_ms })
    })
}

#[test]
fn after_a_start_no_kind_is_worse_than_unknown_on_a_healthy_vehicle() {
    for healthy in beginnings() {
        let model = model(parts(each_kind()));
        let again = Engine::resume(model.clone(), &Restored::default(), Timestamp::ZERO);
        for engine in [Engine::begin(model.clone(), Timestamp::ZERO), again] {
            healthy.check(engine, &model, 0, SEARCH_MS + 2 * WINDOW_MS);
        }
    }
}

#[test]
fn after_a_reload_what_is_new_has_the_time_of_a_start_and_what_stays_goes_on() {
    let before_ms = 1500;
    // The first knows nothing of the second topic, or the first one alone.
    for known in [0, 1, 2] {
        let mut old = parts(each_kind());
        old.modules.truncate(if known == 0 { 0 } else { 1 });
        old.watched.topics.truncate(known);
        let (old, new) = (model(old), model(parts(each_kind())));
        for mut healthy in beginnings() {
            let mut engine = Engine::resume(old.clone(), &Restored::default(), Timestamp::ZERO);
            let from_ms = healthy.from_ms.map(|from_ms| before_ms + from_ms);
            // A topic that is read already was discovered long ago.
            healthy.from_ms = std::array::from_fn(|topic| if topic < known { 0 } else { from_ms[topic] });
            let known_ms = Healthy { from_ms: healthy.from_ms, announced_ms: Some(0) };
            for at_ms in (0..before_ms).step_by(10) {
                known_ms.feed(&mut engine, &old.watched, at_ms);
            }
            engine.reload(new.clone(), Timestamp::from_millis(before_ms));
            if known > 0 {
                assert_eq!(own(&engine.snapshot(), 0).0, Ok, "it goes on");
            }
            healthy.check(engine, &new, before_ms, before_ms + SEARCH_MS + 2 * WINDOW_MS);
        }
    }
}

#[test]
fn where_the_stage_makes_it_matter_data_that_flows_or_begins_with_it_is_no_fault() {
    let login_ms = 5000;
    for from_ms in [[0, 0], [0, login_ms], [login_ms, login_ms]] {
        let mut parts = parts(each_kind());
        parts.stages = StageModel::Shuttle;
        let model = model(parts);
        let mut engine = Engine::resume(model.clone(), &Restored::default(), Timestamp::ZERO);
        let healthy = Healthy { from_ms, announced_ms: Some(0) };
        for at_ms in (0..login_ms).step_by(10) {
            healthy.feed(&mut engine, &model.watched, at_ms);
        }
        let login = Input::Operator(OperatorAction::Login { name: "anna".into() });
        engine.handle(&login, Timestamp::from_millis(login_ms));
        healthy.check(engine, &model, login_ms, login_ms + 2 * WINDOW_MS);
    }
}

#[test]
fn what_was_unknown_before_it_mattered_calls_nobody_while_it_is_given_time() {
    let latency = MonitorSpec::Latency { topic: A, window: millis(WINDOW_MS), bands: at_most(0.05, 0.1) };
    let value =
        MonitorSpec::Value { source: field(A, 0), rule: ValueRule::Bands(at_most(1.5, 2.0)), empty: None };
    let mut parts = parts(vec![(latency, Policy::default()), (value, Policy::default())]);
    parts.stages = StageModel::Shuttle;
    // The nodes that wait for it make it a root cause also while it is given time.
    let on = DependsOn::Node(NodeId::Module(ModuleId(0)));
    parts.modules[1].depends_on = vec![Dependency { on, masks_unknown: true, within: Within::default() }];
    let model = model(parts);
    let mut engine = Engine::resume(model.clone(), &Restored::default(), Timestamp::ZERO);
    for at_ms in (0..5000).step_by(100) {
        let now = Timestamp::from_millis(at_ms);
        engine.handle(&input(&model.watched, at_ms, &Do::Stamp(None)), now);
    }
    assert_eq!(own(&engine.snapshot(), 0).0, Unknown);
    let login = Input::Operator(OperatorAction::Login { name: "anna".into() });
    engine.handle(&login, Timestamp::from_millis(5000));
    let snapshot = engine.snapshot();
    let root = snapshot.roots.iter().find(|root| root.node == NodeId::Module(ModuleId(0)));
    assert_eq!(root.map(|root| root.grace), Some(true), "it is given time");
    assert_eq!(snapshot.last_alarm, 0);
}

#[test]
fn what_is_from_before_our_time_is_neither_counted_nor_timed_and_the_first_window_begins_after_it() {
    use Do::{Age, Late, Nothing, Publishers};
    let window = millis(WINDOW_MS);
    let burst = [(0, Publishers(0, 1), Unknown, ""), (300, Late(9000), Unknown, "")];
    let burst = burst.into_iter().chain((400..=490).step_by(10).map(|at| (at, Late(100), Unknown, "")));
    let rate = [
        (1000, Nothing, Unknown, "measuring"),
        (1489, Nothing, Unknown, "measuring"),
        (1490, Nothing, Error, "0 Hz"),
        (1500, Late(100), Error, "0 Hz"),
    ];
    let bands = Bands { error_above: Some(8.0), ..at_least(2.0, 1.0) };
    check(MonitorSpec::Frequency { topic: A, window, bands }, &burst.clone().chain(rate).collect::<Vec<_>>());
    let age = [(500, Age(10), Ok, "0.01 s late"), (510, Late(9000), Ok, "0.01 s late")];
    check(
        MonitorSpec::Latency { topic: A, window, bands: at_most(0.05, 0.1) },
        &burst.clone().chain(age).collect::<Vec<_>>(),
    );
    check(
        MonitorSpec::Value { source: field(A, 0), rule: ValueRule::Bands(at_most(1.5, 2.0)), empty: None },
        &[(300, Late(9000), Ok, "1, at most 1.5")],
    );
}

#[test]
fn what_is_late_at_either_end_of_a_ratio_begins_its_first_window_anew() {
    use Do::{Late, Nothing, Number};
    let window = millis(WINDOW_MS);
    for (input, output) in [(A, B), (B, A)] {
        // Late is what comes on A: of what came before it, nothing is compared.
        let before = [(100, Number(output.0 as usize, 1.0)), (490, Number(output.0 as usize, 1.0))];
        let both = [(600, Number(0, 1.0)), (600, Number(1, 1.0))];
        let judged = [
            (1499, Nothing, Unknown, "measuring"),
            (1500, Nothing, Ok, "1 output per input"),
            (1510, Late(900), Ok, "1 output per input"),
        ];
        let late = (500, Late(9000));
        let steps = before.into_iter().chain([late]).chain(both).map(|(at, what)| (at, what, Unknown, ""));
        let bands = Bands { error_above: Some(1.5), ..at_least(0.8, 0.5) };
        check(
            MonitorSpec::RateRatio { input, output, window, bands },
            &steps.chain(judged).collect::<Vec<_>>(),
        );
    }
}

#[test]
fn a_ratio_is_judged_one_window_after_the_later_of_its_publishers_was_found() {
    use Do::{Number, Publishers};
    let ratio = || {
        let window = millis(WINDOW_MS);
        MonitorSpec::RateRatio { input: A, output: B, window, bands: at_least(0.9, 0.5) }
    };
    let stream = |topic: usize, from_ms: u64| {
        (from_ms..=6000).step_by(100).map(move |at_ms| (at_ms, Number(topic, 1.0))).collect::<Vec<_>>()
    };
    // The events, the time of the first verdict, and the verdict.
    type Case = (Vec<(u64, Do)>, u64, State);
    let cases: [Case; 7] = [
        (Vec::new(), 4000, Unknown),
        ([stream(0, 700), stream(1, 700)].concat(), 1700, Ok),
        ([stream(0, 200), stream(1, 1900)].concat(), 2900, Ok),
        ([stream(0, 1900), stream(1, 200)].concat(), 2900, Ok),
        // No output: none until the end of the search, and none that discovery knows.
        (stream(0, 200), 4000, Error),
        ([vec![(200, Publishers(1, 1))], stream(0, 700)].concat(), 1700, Error),
        ([vec![(1500, Publishers(1, 0))], stream(0, 700)].concat(), 2500, Error),
    ];
    for (mut steps, judged_ms, expected) in cases {
        steps.sort_by_key(|(at_ms, _)| *at_ms);
        let model = model(parts(vec![(ratio(), Policy::default())]));
        let mut engine = Engine::resume(model.clone(), &Restored::default(), Timestamp::ZERO);
        let mut steps = steps.into_iter().peekable();
        let mut states = BTreeSet::new();
        for at_ms in (0..=5000).step_by(50) {
            while let Some((at_ms, what)) = steps.next_if(|step| step.0 <= at_ms) {
                feed(&mut engine, &model, at_ms, &what);
            }
            engine.handle(&Input::Tick, Timestamp::from_millis(at_ms));
            let state = own(&engine.snapshot(), 0).0;
            states.insert(state);
            let judged = if at_ms < judged_ms { Unknown } else { expected };
            assert_eq!(state, judged, "{at_ms} ms, judged from {judged_ms} ms");
        }
        assert!(!states.contains(&Warning));
    }
}
