//! Tests of monitors of one source.

use State::{Error, Ok, Unknown, Warning};

use super::*;
use crate::model::monitors::{ValueRule, WatchdogId};

fn frequency(bands: Bands) -> MonitorSpec {
    MonitorSpec::Frequency { topic: A, window: millis(2000), bands }
}

#[test]
fn frequency_is_judged_from_one_window_on_whether_the_topic_exists_or_not() {
    let bands = at_least(9.0, 5.0);
    check(
        frequency(bands),
        &[
            (0, Do::Nothing, Unknown, "measuring for 2 s"),
            (1999, Do::Nothing, Unknown, "measuring"),
            (2000, Do::Nothing, Error, "0 Hz, at least 9 Hz wanted"),
            (60_000, Do::Publishers(0, 0), Error, "0 Hz, at least 9 Hz wanted; nobody publishes /a"),
            (61_000, Do::OtherType(0), Error, "/a has type other/msg/Type, configuration says test/msg/Both"),
        ],
    );
}

#[test]
fn silence_is_ok_only_where_somebody_could_speak_and_no_least_rate_is_asked_for() {
    let unheard = (2000, Do::Nothing, Unknown, "0 Hz, at most 10 Hz wanted; nobody publishes /a");
    for (step, after) in [
        (Do::Nothing, unheard.clone()),
        (Do::Publishers(0, 0), unheard),
        (Do::Publishers(0, 1), (2000, Do::Nothing, Ok, "0 Hz, at most 10 Hz wanted")),
        (Do::Number(0, 1.0), (2000, Do::Nothing, Ok, "0 Hz, at most 10 Hz wanted")),
    ] {
        check(frequency(at_most(10.0, 20.0)), &[(0, step, Unknown, "measuring for 2 s"), after]);
    }
}

#[test]
fn frequency_reports_by_the_clock() {
    let tenth = |_| vec![Do::Number(0, 1.0)];
    // At 10 Hz the 18th message of a window of 2 s is the first that must not be missing.
    check_every(
        frequency(at_least(9.0, 5.0)),
        100,
        4000,
        tenth,
        &[
            (4000, Do::Nothing, Ok, "Hz, at least 9 Hz wanted"),
            (4299, Do::Nothing, Ok, ""),
            (4300, Do::Nothing, Warning, "8.5 Hz"),
            (5099, Do::Nothing, Warning, ""),
            (5100, Do::Nothing, Error, "4.5 Hz, at least 9 Hz wanted"),
            (9000, Do::Nothing, Error, "0 Hz"),
        ],
    );
}

#[test]
fn before_the_first_window_only_what_cannot_get_better_is_judged() {
    let bands = Bands { warning_below: Some(9.0), ..at_most(11.0, 20.0) };
    let (mut engine, model) = start(frequency(bands), Policy::default());
    let mut states = Vec::new();
    for number in 0..50 {
        feed(&mut engine, &model, number, &Do::Number(0, 0.0));
        states.push(own(&engine.snapshot(), 0).0);
    }
    assert_eq!((states[21], states[22], states[39], states[40]), (Unknown, Warning, Warning, Error));
}

#[test]
fn a_flood_and_a_slow_topic_are_both_counted() {
    for (hertz, bands, state) in [
        (1, at_least(1.0, 0.5), Ok),
        (1, at_least(1.1, 0.5), Warning),
        (20_000, at_most(1000.0, 15_000.0), Error),
    ] {
        let (mut engine, model) = start(frequency(bands), Policy::default());
        let sample = input(&model.watched, 0, &Do::Number(0, 0.0));
        for number in 0..5 * hertz {
            engine.handle(&sample, Timestamp::from_nanos(number * 1_000_000_000 / hertz));
        }
        assert_eq!(own(&engine.snapshot(), 0).0, state, "{hertz} Hz");
    }
}

#[test]
fn latency_is_the_worst_of_the_window_and_a_doubtful_stamp_is_never_ok() {
    let latency = MonitorSpec::Latency { topic: A, window: millis(1000), bands: at_most(0.2, 0.5) };
    check(
        latency.clone(),
        &[
            (0, Do::Age(200), Ok, "0.2 s late, at most 0.2 s wanted"),
            (100, Do::Age(300), Warning, "0.3 s late"),
            (200, Do::Age(600), Error, "0.6 s late"),
            (300, Do::Age(10), Error, "0.6 s late"),
            (1199, Do::Age(10), Error, ""),
            (1200, Do::Nothing, Ok, "0.01 s late"),
            (1300, Do::Age(-40), Ok, ""),
            (1400, Do::Age(-60), Unknown, "60 ms in the future"),
            (1500, Do::Stamp(None), Unknown, ""),
            (1700, Do::Nothing, Unknown, "no readable stamp"),
            (1800, Do::Stamp(Some(0)), Unknown, ""),
            (1900, Do::Nothing, Unknown, "not set"),
            (2100, Do::Stamp(Some(5_000_000_000)), Unknown, ""),
            (2400, Do::Stamp(Some(i64::MAX)), Unknown, "another clock"),
            (2700, Do::Stamp(Some(i64::MIN)), Unknown, ""),
            // An ERROR that was measured is worse than a doubt.
            (2800, Do::Age(600), Error, "0.6 s late"),
            (3799, Do::Age(10), Error, ""),
            (3800, Do::Nothing, Ok, ""),
            // No message: the module's timeout decides.
            (5798, Do::Nothing, Ok, ""),
            (5799, Do::Nothing, Unknown, ""),
        ],
    );
    let ahead = |state| Bands { unmeasurable: Some(state), ..at_most(0.2, 0.5) };
    let stated = |state| MonitorSpec::Latency { topic: A, window: millis(1000), bands: ahead(state) };
    check(
        stated(Error),
        &[
            (0, Do::Age(300), Warning, "0.3 s late"),
            (100, Do::Age(-60), Error, "60 ms in the future"),
            (200, Do::Stamp(None), Unknown, "no readable stamp"),
        ],
    );
    check(
        stated(Warning),
        &[(0, Do::Age(-60), Warning, "60 ms in the future"), (100, Do::Age(600), Error, "0.6 s late")],
    );
    check(latency.clone(), &[(0, Do::NoClock, Unknown, "nothing was heard of /clock yet")]);
    check(
        latency,
        &[(0, Do::Age(600), Error, ""), (1500, Do::Nothing, Error, ""), (9000, Do::Nothing, Error, "")],
    );
}

#[test]
fn a_value_that_is_no_number_is_unknown_or_what_the_configuration_says() {
    for state in [Error, Warning, Unknown] {
        let bands = Bands { unmeasurable: Some(state), ..at_most(80.0, 90.0) };
        let (value, other) = (field(A, 0), field(B, 0));
        let steps =
            [(0, Do::Number(0, 1.0), Ok, ""), (10, Do::Number(0, f64::NAN), state, "/a x is not a number")];
        check(
            MonitorSpec::Value { source: value.clone(), rule: ValueRule::Bands(bands), empty: None },
            &steps,
        );
        let max_gap = millis(1000);
        check(
            MonitorSpec::Sequence { earlier: value, later: other, max_gap, bands },
            &[
                (0, Do::Number(0, 1.0), Unknown, "nothing came yet"),
                (10, Do::Number(1, 1.0), Ok, ""),
                (20, Do::Number(0, f64::NAN), Ok, ""),
                (30, Do::Number(1, 1.0), state, "earlier (/a x) is not a number"),
                (2000, Do::Number(0, 1.0), Unknown, "more than 1 s behind"),
                (2500, Do::Number(1, f64::NAN), state, "later (/b x) is not a number"),
                (2800, Do::Number(1, f64::INFINITY), Unknown, "later (/b x) is infinite"),
            ],
        );
    }
}

#[test]
fn values_are_judged_by_bands_or_compared() {
    let number =
        |bands| MonitorSpec::Value { source: field(A, 0), rule: ValueRule::Bands(bands), empty: None };
    let unreadable = FieldValue::Unreadable("the message ends early".into());
    check(
        number(at_most(80.0, 90.0)),
        &[
            (0, Do::Nothing, Unknown, ""),
            (10, Do::Number(0, 80.0), Ok, "80, at most 80 wanted"),
            (20, Do::Number(0, 80.1), Warning, "80.1"),
            (30, Do::Number(0, 90.1), Error, "90.1"),
            (40, Do::Number(0, f64::NAN), Unknown, "/a x is not a number"),
            (50, Do::Number(0, 0.0), Ok, "0, at most 80"),
            (60, Do::Number(0, f64::NEG_INFINITY), Unknown, "/a x is infinite"),
            (600, Do::Value(0, unreadable), Unknown, "cannot be read: the message ends early"),
            (
                900,
                Do::Value(0, FieldValue::Text("hot".into())),
                Unknown,
                "/a x is \"hot\", text where a number",
            ),
            (1200, Do::Value(0, FieldValue::Bool(true)), Unknown, "a boolean where a number is wanted"),
            (1210, Do::Number(0, 1.0), Ok, ""),
            // Messages of others say nothing, and keep nothing alive.
            (2000, Do::Value(0, FieldValue::Absent), Ok, "1, at most 80"),
            (3209, Do::Value(0, FieldValue::Absent), Ok, ""),
            (3210, Do::Nothing, Unknown, ""),
        ],
    );
    let text = |text: &str| FieldValue::Text(text.into());
    let rule = ValueRule::Unless { error: None, warning: Some(text("idle")) };
    let said = |value: FieldValue| Do::Value(0, value);
    check(
        MonitorSpec::Value { source: field(A, 0), rule, empty: None },
        &[
            (0, said(text("idle")), Ok, "\"idle\""),
            (10, said(text("busy")), Warning, "\"busy\", \"idle\" wanted"),
            (20, said(FieldValue::Bool(false)), Warning, ""),
        ],
    );
    let rule = ValueRule::Unless { error: Some(FieldValue::Bool(true)), warning: None };
    check(
        MonitorSpec::Value { source: field(A, 0), rule, empty: None },
        &[
            (0, said(FieldValue::Bool(true)), Ok, "true"),
            (10, said(FieldValue::Bool(false)), Error, "false, true wanted"),
            (20, Do::Number(0, 1.0), Error, ""),
            (260, Do::Nothing, Error, "1, true wanted"),
            (270, Do::Number(0, f64::NAN), Unknown, "not a number"),
        ],
    );
}

#[test]
fn key_values_of_a_status_are_values() {
    let rule = ValueRule::Bands(at_most(80.0, 90.0));
    check(
        MonitorSpec::Value { source: key("cpu", "temperature"), rule, empty: None },
        &[
            (0, Do::Status("cpu", 2, &[("load", "1"), ("temperature", " 12.5 ")]), Ok, "12.5"),
            (10, Do::Status("cpu", 0, &[("temperature", "95")]), Error, "95, at most 80 wanted"),
            (20, Do::Status("cpu", 0, &[("load", "1")]), Unknown, "has no such key"),
            (30, Do::Status("cpu", 0, &[("temperature", "80")]), Ok, ""),
            (
                40,
                Do::Status("cpu", 0, &[("temperature", "nan")]),
                Unknown,
                "cpu: temperature is not a number",
            ),
            (50, Do::Status("gpu", 0, &[("temperature", "1")]), Unknown, ""),
        ],
    );
    let rule = ValueRule::Unless { error: Some(FieldValue::Text("12".into())), warning: None };
    check(
        MonitorSpec::Value { source: key("cpu", "firmware"), rule, empty: None },
        &[
            (0, Do::Status("cpu", 0, &[("firmware", "12")]), Ok, ""),
            (10, Do::Status("cpu", 0, &[("firmware", "13")]), Error, "\"13\", \"12\" wanted"),
        ],
    );
}

#[test]
fn a_watchdog_counts_misses_in_a_row() {
    let missed = || Do::Probe(ProbeOutcome::Missed("connection refused".into()));
    let answered = || Do::Probe(ProbeOutcome::Answered { after: millis(3) });
    let impossible = || Do::Probe(ProbeOutcome::Impossible("no permission".into()));
    let watchdog = MonitorSpec::Watchdog { watchdog: WatchdogId(0), misses: 3, bands: Bands::default() };
    check(
        watchdog,
        &[
            (0, Do::Nothing, Unknown, "not asked yet"),
            (100, missed(), Unknown, ""),
            (200, answered(), Ok, "answers"),
            (300, missed(), Ok, ""),
            (400, missed(), Ok, ""),
            (500, answered(), Ok, ""),
            (600, missed(), Ok, ""),
            (700, missed(), Ok, ""),
            (800, missed(), Error, "3 of 3 in a row: connection refused"),
            (900, impossible(), Error, ""),
            (1000, missed(), Error, ""),
            (1060, impossible(), Error, ""),
            (1080, answered(), Ok, "answers"),
            (1090, impossible(), Unknown, "no permission"),
            (1100, answered(), Ok, "answers"),
            (1599, Do::Nothing, Ok, ""),
            (1600, Do::Nothing, Unknown, "nobody asked it for 500 ms"),
        ],
    );
    let watchdog = MonitorSpec::Watchdog { watchdog: WatchdogId(0), misses: 0, bands: Bands::default() };
    check(watchdog, &[(0, missed(), Error, "1 of 1"), (9000, Do::Nothing, Error, "nobody asked")]);
}

#[test]
fn a_watchdog_judges_how_long_an_answer_takes() {
    let after = |ms| Do::Probe(ProbeOutcome::Answered { after: millis(ms) });
    let missed = || Do::Probe(ProbeOutcome::Missed("connection refused".into()));
    let bands = Bands { warning_above: Some(0.01), error_above: Some(0.05), ..Bands::default() };
    check(
        MonitorSpec::Watchdog { watchdog: WatchdogId(0), misses: 2, bands },
        &[
            (0, Do::Nothing, Unknown, "not asked yet"),
            (100, after(3), Ok, "answers after 3 ms, at most 10 ms wanted"),
            (200, after(10), Ok, ""),
            (300, after(12), Warning, "answers after 12 ms, at most 10 ms wanted"),
            (400, after(50), Warning, ""),
            (500, after(51), Error, "answers after 51 ms, at most 10 ms wanted"),
            // One miss alone does not say that it is well again.
            (760, missed(), Error, ""),
            (770, after(4), Ok, ""),
            (800, missed(), Ok, ""),
            (900, missed(), Error, "2 of 2"),
            (1000, after(20), Warning, ""),
        ],
    );
    let announced = Do::Probe(ProbeOutcome::Announced);
    let watchdog = MonitorSpec::Watchdog { watchdog: WatchdogId(0), misses: 2, bands: Bands::default() };
    let repeated = |times| Do::Probe(ProbeOutcome::Repeated { times });
    check(
        watchdog,
        &[(0, announced.clone(), Ok, "is running"), (1000, repeated(2), Ok, "announced 2 times: it crashed")],
    );
    let bands = Bands { warning_above: Some(0.0), error_above: Some(2.0), ..Bands::default() };
    let watchdog = MonitorSpec::Watchdog { watchdog: WatchdogId(0), misses: 2, bands };
    check(
        watchdog,
        &[
            (0, announced.clone(), Ok, "is running"),
            (1000, repeated(2), Warning, "announced 2 times"),
            (2000, repeated(4), Error, "announced 4 times"),
            (3000, announced, Ok, "is running"),
        ],
    );
}

#[test]
fn the_last_event_counts_until_the_next_one_and_none_is_ok_where_a_late_reader_would_be_told() {
    use Do::{KeepingPublishers, NewReader, Nothing, Number, Publishers};
    let rule = ValueRule::Bands(at_most(4.0, 5.0));
    let events = MonitorSpec::Value { source: field(A, 0), rule, empty: Some(State::Ok) };
    check(
        events,
        &[
            (0, Nothing, Unknown, "nothing came yet of /a x; nobody publishes /a"),
            (
                500,
                Publishers(0, 1),
                Unknown,
                "nothing came yet of /a x, and its publisher keeps nothing for late readers (volatile)",
            ),
            (90_000, KeepingPublishers(0, 1), Unknown, "nothing came yet of /a x"),
            (99_999, Nothing, Unknown, "nothing came yet of /a x"),
            (100_000, Nothing, Ok, "nothing came yet of /a x"),
            (500_000, Number(0, 6.0), Error, "6, at most 4 wanted"),
            (900_000, Nothing, Error, "6, at most 4 wanted"),
            (900_500, Publishers(0, 0), Error, "6, at most 4 wanted; nobody publishes /a"),
            // Its server was started again.
            (901_000, KeepingPublishers(0, 1), Unknown, "nothing came yet of /a x"),
            (911_000, Nothing, Ok, "nothing came yet of /a x"),
            (912_000, Number(0, 2.0), Ok, "2, at most 4"),
            (913_000, Publishers(0, 0), Unknown, "2, at most 4 wanted; nobody publishes /a"),
            (914_000, KeepingPublishers(0, 1), Unknown, "nothing came yet of /a x"),
            (924_000, Nothing, Ok, "nothing came yet of /a x"),
        ],
    );
    // Of a switch nobody knows it.
    let rule = ValueRule::Bands(at_most(4.0, 5.0));
    let events = MonitorSpec::Value { source: field(A, 0), rule, empty: Some(State::Unknown) };
    check(
        events,
        &[
            (0, Nothing, Unknown, "nobody publishes /a"),
            (500, KeepingPublishers(0, 1), Unknown, "nothing came yet of /a x"),
            (500_000, Nothing, Unknown, "nothing came yet of /a x"),
            (500_100, Number(0, 2.0), Ok, "2, at most 4"),
            (900_000, Nothing, Ok, "2, at most 4"),
            (900_100, Number(0, 6.0), Error, "6, at most 4 wanted"),
            (900_500, Publishers(0, 0), Error, "6, at most 4 wanted; nobody publishes /a"),
            (901_000, KeepingPublishers(0, 1), Error, "6, at most 4 wanted"),
            (901_100, Number(0, 2.0), Ok, "2, at most 4"),
            // A message may be lost between two readers.
            (
                902_000,
                NewReader(0),
                Unknown,
                "nothing came yet of /a x, and its publisher keeps nothing for late readers (volatile)",
            ),
            (902_100, Number(0, 6.0), Error, "6, at most 4 wanted"),
            (902_200, NewReader(0), Error, "6, at most 4 wanted"),
        ],
    );
}

#[test]
fn events_of_a_best_effort_publisher_may_be_lost() {
    let rule = ValueRule::Bands(at_most(4.0, 5.0));
    let monitor = |empty| MonitorSpec::Value { source: field(A, 0), rule: rule.clone(), empty };
    for (empty, lossy) in [(Some(State::Unknown), State::Unknown), (None, State::Ok)] {
        let (mut engine, model) = start(monitor(empty), Policy::default());
        for (at_ms, what, state) in [
            (1000, Do::Publishers(0, 1), State::Unknown),
            (1100, Do::Number(0, 2.0), State::Ok),
            (1200, Do::LossyPublisher(0), lossy),
            (1300, Do::Number(0, 6.0), State::Error),
            (1400, Do::Number(0, 2.0), lossy),
            (1500, Do::Publishers(0, 1), State::Ok),
        ] {
            feed(&mut engine, &model, at_ms, &what);
            assert_eq!(own(&engine.snapshot(), 0).0, state, "{empty:?} at {at_ms}: {what:?}");
        }
    }
}

/// Kept messages of two publishers come in any order.
#[test]
fn of_kept_messages_the_newest_counts() {
    let rule = ValueRule::Bands(at_most(4.0, 5.0));
    let value = MonitorSpec::Value { source: field(A, 0), rule, empty: None };
    let policy = Policy { timeout: Span::from_secs(3600), ..Policy::default() };
    let (mut engine, model) = start(value, policy);
    for (at_ms, what, state) in [
        (40_000, Do::Older(6.0, 10_000), State::Error),
        (40_100, Do::Older(2.0, 30_000), State::Error),
        (40_200, Do::Older(2.0, 5000), State::Ok),
        (40_300, Do::Older(6.0, 8000), State::Ok),
        (40_400, Do::Number(0, 6.0), State::Error),
    ] {
        feed(&mut engine, &model, at_ms, &what);
        assert_eq!(own(&engine.snapshot(), 0).0, state, "at {at_ms}: {what:?}");
    }
}

/// Two publishers of one switch: the older word of the one may come after the newer word of the other.
#[test]
fn an_event_that_was_told_earlier_ends_no_fault() {
    let rule = ValueRule::Bands(at_most(4.0, 5.0));
    let events = MonitorSpec::Value { source: field(A, 0), rule, empty: Some(State::Unknown) };
    let (mut engine, model) = start(events, Policy::default());
    let check = |engine: &mut Engine, steps: &[(u64, Do, State)]| {
        for (at_ms, what, state) in steps {
            feed(engine, &model, *at_ms, what);
            assert_eq!(own(&engine.snapshot(), 0).0, *state, "at {at_ms}: {what:?}");
        }
    };
    let steps = [
        (40_000, Do::KeepingPublishers(0, 2), State::Unknown),
        (41_000, Do::Number(0, 6.0), State::Error),
        // It was lost, or kept.
        (41_500, Do::Older(2.0, 20_000), State::Error),
        (42_000, Do::Number(0, 2.0), State::Ok),
        // A fault counts at any time: the clocks of two computers may disagree.
        (42_500, Do::Older(6.0, 20_000), State::Error),
    ];
    check(&mut engine, &steps);
    let restored = engine.snapshot().to_restore();
    for kept in [[2.0, 6.0], [6.0, 2.0]] {
        let mut engine = Engine::resume(model.clone(), &restored, Timestamp::from_millis(60_000));
        let after = |value: f64| if value > 5.0 || kept[0] > 5.0 { State::Error } else { State::Unknown };
        let age = |value: f64| if value > 5.0 { 18_000 } else { 40_000 };
        let steps = [
            (60_100, Do::KeepingPublishers(0, 2), State::Unknown),
            (60_200, Do::Older(kept[0], age(kept[0])), after(kept[0])),
            (60_300, Do::Older(kept[1], age(kept[1])), State::Error),
            // Let go while Telltale was away.
            (60_400, Do::Older(2.0, 500), State::Ok),
        ];
        check(&mut engine, &steps);
    }
}

#[test]
fn a_fault_that_an_event_told_before_a_restart_ends_by_another_event_alone() {
    let rule = ValueRule::Bands(at_most(4.0, 5.0));
    let events = MonitorSpec::Value { source: field(A, 0), rule, empty: Some(State::Unknown) };
    let (mut engine, model) = start(events, Policy::default());
    feed(&mut engine, &model, 1000, &Do::KeepingPublishers(0, 1));
    feed(&mut engine, &model, 2000, &Do::Number(0, 6.0));
    let restored = engine.snapshot().to_restore();
    assert!(restored.alarms[0].active);
    let mut engine = Engine::resume(model.clone(), &restored, Timestamp::ZERO);
    // Its last message is lost.
    feed(&mut engine, &model, 1000, &Do::KeepingPublishers(0, 1));
    for (at_ms, what, state, active) in
        [(60_000, Do::Nothing, State::Unknown, true), (61_000, Do::Number(0, 2.0), State::Ok, false)]
    {
        feed(&mut engine, &model, at_ms, &what);
        let snapshot = engine.snapshot();
        assert_eq!((own(&snapshot, 0).0, snapshot.alarms[0].active), (state, active), "at {at_ms}");
    }
}
