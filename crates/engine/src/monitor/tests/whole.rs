//! Properties of all kinds: topics, relevance, policies, other configurations, reloads.

use State::{Error, Ok, Unknown};

use super::*;
use crate::input::OperatorAction;
use crate::model::ModuleMonitor;
use crate::model::filter::Filter;
use crate::model::monitors::ValueRule;
use crate::restart::resume::{Restored, RestoredAlarm};

fn value(source: ValueSource) -> MonitorSpec {
    MonitorSpec::Value { source, rule: ValueRule::Bands(at_most(80.0, 90.0)), empty: None }
}

fn frequency() -> MonitorSpec {
    MonitorSpec::Frequency { topic: A, window: millis(1000), bands: at_least(9.0, 5.0) }
}

#[test]
fn a_topic_without_publisher_or_of_another_type_is_said_in_words() {
    check(
        value(field(A, 0)),
        &[
            (0, Do::Number(0, 1.0), Ok, "1, at most 80"),
            (10, Do::Publishers(0, 0), Unknown, "nobody publishes /a"),
            (300, Do::OtherType(0), Unknown, "/a has type other/msg/Type, configuration says test/msg/Both"),
            (330, Do::Publishers(0, 1), Unknown, ""),
            (600, Do::Nothing, Unknown, "nothing came since /a is published again"),
            (610, Do::Number(0, 2.0), Ok, "2, at most 80"),
            (620, Do::OtherType(1), Ok, ""),
            // A wrong value stays wrong, with and without publishers.
            (630, Do::Number(0, 99.0), Error, "99, at most 80"),
            (640, Do::Publishers(0, 0), Error, ""),
            (890, Do::Nothing, Error, "99, at most 80 wanted; nobody publishes /a"),
            (900, Do::Publishers(0, 1), Error, ""),
            (1150, Do::Nothing, Error, "99, at most 80 wanted; nothing came since /a is published again"),
            (1160, Do::Number(0, 1.0), Ok, "1, at most 80"),
        ],
    );
    let strict = Policy { no_publisher: Error, ..Policy::default() };
    check_with(
        value(field(A, 0)),
        strict,
        &[
            (0, Do::Publishers(0, 0), Unknown, "nobody publishes /a"),
            (1999, Do::Nothing, Unknown, ""),
            // From the start there is one timeout of grace.
            (2000, Do::Nothing, Error, "nobody publishes /a"),
            (2010, Do::Publishers(0, 1), Unknown, ""),
            (2020, Do::Number(0, 1.0), Ok, ""),
            (2030, Do::Publishers(0, 0), Error, "nobody publishes /a"),
        ],
    );
}

#[test]
fn what_is_unknown_says_why_before_its_last_good_value() {
    let says = |engine: &mut Engine| {
        let snapshot = engine.snapshot();
        let module = snapshot.module(ModuleId(0)).1;
        (module.own, module.says(snapshot.now).into_owned())
    };
    let policy = Policy { clear_after: millis(500), timeout: millis(2000), ..Policy::default() };
    let (mut engine, model) = start(value(field(A, 0)), policy);
    assert_eq!(says(&mut engine), (Unknown, "nothing received yet".to_owned()));
    feed(&mut engine, &model, 0, &Do::Number(0, f64::NAN));
    feed(&mut engine, &model, 300, &Do::Number(0, 5.0));
    let held = "unknown until it has been better for long enough; last: 5, at most 80 wanted";
    assert_eq!(says(&mut engine), (Unknown, held.to_owned()));
    feed(&mut engine, &model, 900, &Do::Number(0, 5.0));
    assert_eq!(says(&mut engine), (Ok, "5, at most 80 wanted".to_owned()));
    engine.handle(&Input::Dds { fault: Some("killed".into()) }, Timestamp::from_millis(1000));
    let cut = "nothing received since the connection to the vehicle failed; last: 5, at most 80 wanted";
    assert_eq!(says(&mut engine), (Unknown, cut.to_owned()));
    engine.handle(&Input::Tick, Timestamp::from_millis(2900));
    assert_eq!(says(&mut engine), (Unknown, "silent for 2 s; last: 5, at most 80 wanted".to_owned()));
}

#[test]
fn a_rate_that_may_be_as_low_as_it_likes_is_not_ok_when_nobody_publishes() {
    let most = || MonitorSpec::Frequency { topic: A, window: millis(1000), bands: at_most(9.0, 20.0) };
    let both = Bands { error_below: Some(5.0), ..at_most(9.0, 20.0) };
    let both = || MonitorSpec::Frequency { topic: A, window: millis(1000), bands: both };
    let cases = [(most(), Unknown, Unknown), (most(), Error, Error), (both(), Unknown, Error)];
    for (monitor, no_publisher, expected) in cases {
        let policy = Policy { no_publisher, ..Policy::default() };
        check_with(
            monitor,
            policy,
            &[(0, Do::Publishers(0, 0), Unknown, ""), (1000, Do::Nothing, expected, "nobody publishes /a")],
        );
    }
    check(
        most(),
        &[
            (0, Do::Publishers(0, 1), Unknown, ""),
            (1000, Do::Nothing, Ok, "0 Hz"),
            (1010, Do::Publishers(0, 0), Unknown, "0 Hz"),
            (1020, Do::Publishers(0, 1), Ok, "0 Hz"),
        ],
    );
}

#[test]
fn without_news_and_messages_the_timeout_decides() {
    let stale = Policy { stale: Error, ..Policy::default() };
    check_with(
        value(field(A, 0)),
        stale,
        &[
            (1999, Do::Nothing, Unknown, ""),
            (2000, Do::Nothing, Error, ""),
            (2001, Do::Number(0, 1.0), Ok, ""),
        ],
    );
}

#[test]
fn what_is_judged_by_the_clock_starts_anew_when_it_becomes_relevant() {
    let mut parts = parts(vec![(frequency(), Policy::default())]);
    parts.stages = StageModel::Shuttle;
    let model = model(parts);
    let mut engine = Engine::new(model.clone(), Timestamp::ZERO);
    let at = Timestamp::from_millis;
    engine.handle(&Input::Tick, at(5000));
    assert_eq!(own(&engine.snapshot(), 0), (Unknown, ""));
    let login = Input::Operator(OperatorAction::Login { name: "anna".into() });
    for (start, input) in [(5000, &login), (9000, &login)] {
        engine.handle(input, at(start));
        for (after, state) in [(0, Unknown), (999, Unknown), (1000, Error)] {
            engine.handle(&Input::Tick, at(start + after));
            assert_eq!(own(&engine.snapshot(), 0).0, state, "{after} ms after {start}");
        }
        engine.handle(&Input::Operator(OperatorAction::Logout), at(start + 2000));
        assert_eq!(own(&engine.snapshot(), 0), (Unknown, "not measured while it does not matter"));
    }
}

#[test]
fn a_watched_status_feeds_its_module_and_what_claims_it_too() {
    let mut parts = parts(vec![
        (value(key("cpu", "none")), Policy::default()),
        (value(key("cpu", "t")), Policy::default()),
        (value(key("disc", "t")), Policy::default()),
    ]);
    parts.modules[0].monitor = ModuleMonitor::SelfState("cpu".into());
    parts.groups[0].filters = vec![Filter::Namespace("disc".into()).into()];
    parts.limits.discovered_modules = 1;
    let model = model(parts);
    let mut engine = Engine::new(model, Timestamp::ZERO);
    let mut array = StatusArray::default();
    for (name, level, t) in
        [("cpu", 0, "1"), ("cpu", 1, "95"), ("cpu", 0, "2"), ("disc", 0, "3"), ("more", 0, "4")]
    {
        array.push_status(level, name, "", "");
        array.push_value("t", t);
    }
    engine.handle(&Input::Diagnostics(array), Timestamp::ZERO);
    let snapshot = engine.snapshot();
    // Of two statuses with one name the worse one counts, with its values.
    let states: Vec<State> = (0..3).map(|module| own(&snapshot, module).0).collect();
    assert_eq!(states, [State::Warning, Error, Ok]);
    assert!(snapshot.node("g/disc").is_some());
}

#[test]
fn what_another_configuration_asked_for_is_dropped_and_counted() {
    let (mut engine, model) = start(value(field(A, 0)), Policy::default());
    let mut foreign = model.watched.clone();
    for topic in &mut foreign.topics {
        *topic = Arc::new(TopicSpec { stamp: false, ..(**topic).clone() });
    }
    engine.handle(&input(&foreign, 0, &Do::Number(0, 99.0)), Timestamp::ZERO);
    engine.handle(&input(&foreign, 0, &Do::Publishers(0, 0)), Timestamp::ZERO);
    let Input::Sample(mut sample) = input(&model.watched, 0, &Do::Number(0, 99.0)) else { return };
    sample.values = [FieldValue::Number(99.0)].into();
    engine.handle(&Input::Sample(sample.clone()), Timestamp::ZERO);
    sample.source = Arc::new(TopicSpec { topic: "/unknown".into(), ..(*sample.source).clone() });
    engine.handle(&Input::Sample(sample), Timestamp::ZERO);
    let snapshot = engine.snapshot();
    assert_eq!((snapshot.counters.samples, snapshot.counters.dropped_samples), (3, 4));
    assert_eq!(own(&snapshot, 0), (Unknown, ""));
    // Equal is as good as the same.
    let mut equal = model.watched.clone();
    equal.topics[0] = Arc::new((*equal.topics[0]).clone());
    engine.handle(&input(&equal, 0, &Do::Number(0, 99.0)), Timestamp::ZERO);
    assert_eq!(own(&engine.snapshot(), 0).0, Error);
}

#[test]
fn after_a_reload_a_monitor_that_means_the_same_goes_on() {
    let policy = Policy::default;
    let first = model(parts(vec![(frequency(), policy()), (value(field(A, 0)), policy())]));
    // The topics change their numbers and fields; the second module looks at another topic.
    let mut parts = parts(vec![
        (MonitorSpec::Frequency { topic: B, window: millis(1000), bands: at_least(9.0, 5.0) }, policy()),
        (value(field(A, 0)), policy()),
    ]);
    parts.watched.topics.swap(0, 1);
    let more = Arc::make_mut(&mut parts.watched.topics[1]);
    more.fields.push(FieldSpec::new("y", FieldKind::Scalar));
    let second = model(parts);
    let mut engine = Engine::new(first.clone(), Timestamp::ZERO);
    let send = |engine: &mut Engine, range: std::ops::Range<u64>| {
        for at in range.step_by(100) {
            engine.handle(&input(&first.watched, at, &Do::Number(0, 1.0)), Timestamp::from_millis(at));
        }
    };
    send(&mut engine, 0..1500);
    assert_eq!(own(&engine.snapshot(), 0).0, Ok);
    engine.reload(second, Timestamp::from_millis(1500));
    let snapshot = engine.snapshot();
    assert_eq!((own(&snapshot, 0).0, own(&snapshot, 1).0), (Ok, Unknown));
    // The counted messages leave in time, and those that the old readers still bring are not taken.
    send(&mut engine, 1500..2000);
    let snapshot = engine.snapshot();
    assert_eq!((own(&snapshot, 0).0, snapshot.counters.dropped_samples), (State::Warning, 5));
    engine.handle(&Input::Tick, Timestamp::from_millis(3000));
    assert_eq!(own(&engine.snapshot(), 0), (Error, "0 Hz, at least 9 Hz wanted"));
}

#[test]
fn words_change_rarely_and_states_at_once() {
    let (mut engine, model) = start(value(field(A, 0)), Policy::default());
    let mut revisions = Vec::new();
    for at in 0..1000 {
        let sample = input(&model.watched, at, &Do::Number(0, at as f64 / 20.0));
        engine.handle(&sample, Timestamp::from_millis(at));
        revisions.push(engine.revision());
    }
    assert_eq!(revisions[999] - revisions[0], 3, "once every 250 ms");
    // The last words come by themselves.
    assert_eq!(engine.next_deadline(), Some(Timestamp::from_millis(1000)));
    engine.handle(&Input::Tick, Timestamp::from_millis(1000));
    assert_eq!(own(&engine.snapshot(), 0), (Ok, "50, at most 80 wanted"));
}

#[test]
fn after_a_restart_a_rate_is_judged_one_window_after_its_publisher_was_found() {
    let found = |at: u64| vec![(at, Do::Publishers(0, 1))];
    let rate = |from: u64| (from..=from + 5000).step_by(100).map(|at| (at, Do::Number(0, 1.0))).collect();
    // The events, the time of the first verdict, and the verdict.
    type Case = (Vec<(u64, Do)>, u64, State);
    let cases: [Case; 5] = [
        (Vec::new(), 4000, Error),
        (found(700), 1700, Error),
        (vec![(700, Do::Number(0, 1.0))], 1700, Error),
        (vec![(2500, Do::Publishers(0, 0))], 3500, Error),
        (rate(700), 1700, Ok),
    ];
    for (steps, judged, expected) in cases {
        let model = model(parts(vec![(frequency(), Policy::default())]));
        let mut engine = Engine::resume(model.clone(), &Restored::default(), Timestamp::ZERO);
        let mut steps = steps.into_iter().peekable();
        for at in (0..=5000).step_by(50) {
            while let Some((at, what)) = steps.next_if(|step| step.0 <= at) {
                feed(&mut engine, &model, at, &what);
            }
            engine.handle(&Input::Tick, Timestamp::from_millis(at));
            let state = if at < judged { Unknown } else { expected };
            assert_eq!(own(&engine.snapshot(), 0).0, state, "{at} ms, judged from {judged} ms");
        }
    }
}

#[test]
fn what_the_clock_finds_ok_after_a_restart_has_no_alarm_any_more() {
    let model = model(parts(vec![(frequency(), Policy::default())]));
    let alarm = RestoredAlarm {
        id: 7,
        node: "g/m0".into(),
        age: millis(0),
        acknowledged: true,
        active: true,
        asked: None,
    };
    let restored = Restored { alarms: vec![alarm], last_alarm: 7, ..Restored::default() };
    let mut engine = Engine::resume(model.clone(), &restored, Timestamp::ZERO);
    for at in (0..=2000).step_by(100) {
        // Time acts first, so the first judgement is the clock's and not a message's.
        feed(&mut engine, &model, at, &Do::Number(0, 1.0));
        let snapshot = engine.snapshot();
        assert_eq!(own(&snapshot, 0).0, if at < 1000 { Unknown } else { Ok }, "{at} ms");
        assert_eq!(snapshot.alarms.is_empty(), at >= 1000, "{at} ms");
    }
}
