//! Tests of monitors: what they watch, and possible mistakes.

mod agreements;
mod expression;
mod frozen;
mod lists;
mod system;
mod tf;
mod watchdogs;
mod watching;

use super::*;
use crate::describe::words;
use telltale_engine::model::MonitorSpec;
use telltale_engine::model::monitors::{FieldKind, ProbeTarget, ValueSource};

/// One monitor, whose text begins in column 3 of line 5.
pub(super) fn module(monitor: &str) -> String {
    format!("groups:\n- id: a\n  modules:\n  - id: m\n    monitor:\n      {monitor}\n")
}

/// Problems of a monitor, with columns counted from where its text begins.
#[track_caller]
pub(super) fn wrong(monitor: &str, expected: &[&str]) {
    let found = parse("c", &module(monitor)).map_or_else(|problems| problems.lines(), |_| Vec::new());
    let inside = |line: &String| {
        let line = line.strip_prefix("c:6:").unwrap_or(line);
        let (column, rest) = line.split_once(": ").unwrap_or(("", line));
        column.parse().map_or_else(|_| line.to_owned(), |column: usize| format!("{}: {rest}", column - 6))
    };
    let found: Vec<String> = found.iter().map(inside).collect();
    assert_eq!(found, expected);
}

/// A monitor in the words in which a difference shows it.
#[track_caller]
pub(super) fn means(monitor: &str, expected: &str) {
    let loaded = parse("c", &module(monitor)).unwrap_or_else(|problems| panic!("{problems}"));
    assert_eq!(words::monitor(&loaded.model, &loaded.model.modules[0].monitor), expected);
}

pub(super) const TOPIC: &str = "topic: /t, type: a/msg/B";

#[test]
fn every_kind_reaches_the_model_with_its_defaults() {
    means("self_state: { status: s }", "status 's'");
    means(
        "external: { status: s, class: { location: contextual, information: meta, flow: parallel } }",
        "external status 's', contextual, meta, parallel",
    );
    means(
        &format!("frequency: {{ {TOPIC}, window: 3s, warning_below: 9 Hz, error_below: 5 }}"),
        "the rate of /t (a/msg/B) over 3s: warning below 9 Hz, error below 5 Hz",
    );
    means(
        &format!("latency: {{ {TOPIC}, warning_above: 100ms, error_above: 0.3s, ahead: error }}"),
        "the latency of /t (a/msg/B) over 2s: warning above 0.1 s, error above 0.3 s, error if it cannot be measured",
    );
    means(
        &format!("value: {{ {TOPIC}, field: 'x[0].y', warning_below: -1, error_above: 1e3, nan: warning }}"),
        "x[0].y of /t (a/msg/B): warning below -1, error above 1000, warning if it cannot be measured",
    );
    means(
        "value: { status: s, key: 'a key', error_unless: true, warning_unless: 'true' }",
        "'a key' of the status 's': warning unless 'true', error unless true",
    );
    means("value: { status: s, key: k, error_unless: -3 }", "'k' of the status 's': error unless -3");
    means(
        &format!("value: {{ {TOPIC}, field: x, error_above: 5, empty: unknown }}"),
        "x of /t (a/msg/B): error above 5, unknown before the first message",
    );
    means("watchdog: { icmp: lidar }", "an echo from lidar every 1s: error after 3 misses");
    means(
        "watchdog: { tcp: '[fe80::1]:80', every: 200ms, misses: 1 }",
        "a connection to [fe80::1]:80 every 200ms: error after 1 misses",
    );
    means(
        "watchdog: { qos: /camera/image }",
        "matching publishers and subscribers of /camera/image every 1s: error after 3 misses",
    );
    means(
        "watchdog: { node: /a/b }",
        "the node /a/b (one that crashed counts as running for some 35 s) every 1s: error after 3 misses",
    );
    means(
        "watchdog: { node: /a/b, restarts_warning_above: 0, restarts_error_above: 2 }",
        "the node /a/b (one that crashed counts as running for some 35 s) every 1s: error after 3 misses, warning above 0 restarts, error above 2 restarts",
    );
    means(
        "rate_ratio: { input: { topic: /i, type: a/msg/B }, output: { topic: /o, type: a/msg/B }, error_below: 0.5 }",
        "the rate of /o (a/msg/B) by that of /i (a/msg/B) over 2s: error below 0.5",
    );
    means(
        "sequence: { earlier: { topic: /e, type: a/msg/B, field: n }, later: { status: s, key: k }, max_gap: 2s, error_above: 3 }",
        "'k' of the status 's' minus n of /e (a/msg/B) within 2s: error above 3",
    );
    means(
        &format!("agreement: {{ a: {{ {TOPIC}, field: x }}, b: {{ {TOPIC}, field: y }}, error_above: 1 }}"),
        "x of /t (a/msg/B) against y of /t (a/msg/B), not older than 1s: error above 1",
    );
    means(
        &format!(
            "agreement: {{ a: {{ {TOPIC}, pose: p }}, b: {{ {TOPIC}, pose: q }}, motion_over: 1s, translation: {{ error_above: 1 }}, rotation_deg: {{ warning_above: 9 }} }}"
        ),
        "the motion over 1s of the pose p of /t (a/msg/B) against the pose q of /t (a/msg/B), not older than 1s: translation error above 1 m; rotation warning above 9°",
    );
    means(
        &format!("expression: {{ inputs: {{ x: {{ {TOPIC}, field: x }} }}, max_age: 3s, error: x > 3 }}"),
        "error if `x > 3` with x = x of /t (a/msg/B), not older than 3s, isolated, content",
    );
}

#[test]
fn what_is_watched_stands_in_the_model_once() {
    let text = "groups:
- id: a
  modules:
  - { id: f, monitor: { frequency: { topic: /t, type: a/msg/B, error_below: 1 } } }
  - { id: v, monitor: { value: { topic: /t, type: a/msg/B, field: x, error_above: 1 } } }
  - { id: w, monitor: { value: { topic: /t, type: a/msg/B, field: x, error_below: 1 } } }
  - { id: y, monitor: { value: { topic: /t, type: a/msg/B, field: y, error_below: 1 } } }
  - { id: l, monitor: { latency: { topic: /t, type: a/msg/B, error_above: 1s } } }
  - { id: n, monitor: { watchdog: { node: /n } } }
  - { id: o, monitor: { watchdog: { node: /n, misses: 9 } } }
  - { id: p, monitor: { watchdog: { node: /n, every: 5s } } }
  - { id: u, monitor: { value: { topic: /u, type: a/msg/B, field: x, error_above: 1 } } }
";
    let loaded = parse("c", text).unwrap_or_else(|problems| panic!("{problems}"));
    let watched = &loaded.model.watched;
    let [t, u] = &watched.topics[..] else { panic!("{watched:?}") };
    assert_eq!((&*t.topic, t.stamp, &*u.topic, u.stamp), ("/t", true, "/u", false));
    let paths: Vec<_> = t.fields.iter().map(|field| (&*field.path, field.kind)).collect();
    assert_eq!(paths, [("x", FieldKind::Scalar), ("y", FieldKind::Scalar)]);
    let fields = loaded.model.modules.iter().filter_map(|module| match module.monitor.other() {
        Some(MonitorSpec::Value { source: ValueSource::Field { topic, field }, .. }) => {
            Some((topic.0, *field))
        }
        _ => None,
    });
    assert_eq!(fields.collect::<Vec<_>>(), [(0, 0), (0, 0), (0, 1), (1, 0)]);
    let [one, five] = &watched.watchdogs[..] else { panic!("{watched:?}") };
    assert_eq!(
        (&one.target, one.every),
        (&ProbeTarget::Node { name: "/n".into() }, time::Span::from_secs(1))
    );
    assert_eq!(five.every, time::Span::from_secs(5));
}

#[test]
fn the_places_of_types_and_fields_are_kept() {
    let text = "signals: { s: { topic: /s, type: a/msg/C, field: on } }\ngroups:\n- id: a\n  modules:\n  - { id: v, monitor: { value: { topic: /t, type: a/msg/B, field: x, error_above: 1 } } }\n  - { id: l, monitor: { latency: { topic: /t, type: a/msg/B, error_above: 1s } } }\n";
    let loaded = parse("c", text).unwrap_or_else(|problems| panic!("{problems}"));
    let topic = telltale_engine::model::monitors::TopicId(0);
    let places = [
        ModelPlace::Type(topic),
        ModelPlace::Field(topic, 0),
        ModelPlace::Stamp(topic),
        ModelPlace::SignalType(0),
        ModelPlace::SignalField(0),
    ];
    let problems = loaded.problems(places.map(|place| (place, format!("{place:?}"), "correct it".into())));
    assert_eq!(
        problems.unwrap().lines(),
        [
            "c:1:34: SignalType(0) (correct it)",
            "c:1:50: SignalField(0) (correct it)",
            "c:5:51: Type(TopicId(0)) (correct it)",
            "c:5:67: Field(TopicId(0), 0) (correct it)",
            "c:6:53: Stamp(TopicId(0)) (correct it)",
        ]
    );
    assert!(loaded.problems([]).is_none());
}

#[test]
fn a_monitor_has_one_known_kind_and_known_keys() {
    wrong(
        "frequenzy: { topic: /t }",
        &["1: unknown kind of monitor `frequenzy` (did you mean `frequency`?)"],
    );
    let kinds = "one of: self_state, frequency, latency, value, frozen, watchdog, system, rate_ratio, sequence, agreement, tf, expression, external, constant";
    wrong("magic: {}", &[&format!("1: unknown kind of monitor `magic` ({kinds})")]);
    wrong(
        "{ self_state: { status: s }, external: { status: s } }",
        &[&format!("1: a monitor has one kind ({kinds})")],
    );
    wrong(
        &format!("frequency: {{ {TOPIC}, windo: 2s, error_below: 1 }}"),
        &["40: unknown key `windo` in a frequency monitor (did you mean `window`?)"],
    );
    wrong("frequency: { error_below: 1 }", &["12: a frequency monitor needs `topic` (add `topic: ...`)"]);
    wrong(
        "frequency: { topic: t, type: a/B, error_below: 1 }",
        &[
            "21: `t` is no full topic name (begin with `/`; letters, digits, `_` and `/` follow: `/mission/active`)",
            "30: `a/B` is no message type (did you mean `a/msg/B`?)",
        ],
    );
}

#[test]
fn limits_are_there_and_in_order() {
    let frequency = |bands: &str| format!("frequency: {{ {TOPIC}, {bands} }}");
    wrong(
        &frequency("window: 2s"),
        &[
            "12: without a limit this would never be anything but OK (add at least one of warning_below, error_below, warning_above, error_above)",
        ],
    );
    wrong(
        &frequency("warning_below: 3, error_below: 5"),
        &["71: `error_below` is above `warning_below` (exchange the two, or correct one of them)"],
    );
    wrong(
        &frequency("warning_above: 5, error_above: 3"),
        &["55: `warning_above` is above `error_above` (exchange the two, or correct one of them)"],
    );
    wrong(
        &frequency("error_below: 5, error_above: 3"),
        &["53: no value lies between these limits (exchange the two, or correct one of them)"],
    );
    for bad in ["x", "NaN", ".inf", "inf", "5 kHz", "[1]"] {
        let found = if bad == "[1]" { "a list".to_owned() } else { format!("`{bad}`") };
        wrong(
            &frequency(&format!("error_below: {bad}")),
            &[&format!(
                "53: expected a rate, found {found} (write a number in hertz, for example `9` or `9 Hz`)"
            )],
        );
    }
    wrong(
        &frequency("error_below: 0"),
        &["53: what is measured here is never below 0 (choose a limit above 0, or remove it)"],
    );
    wrong(
        &frequency("error_above: -1"),
        &["53: what is measured here is never below 0 (choose a limit above 0, or remove it)"],
    );
    wrong(
        &format!("latency: {{ {TOPIC}, error_above: 300 }}"),
        &[
            "51: expected a duration, found `300` (write a number with one of the units ns, us, ms, s, m, h, d: for example `300ms`)",
        ],
    );
    wrong(
        &format!("value: {{ {TOPIC}, field: x, error_above: .nan }}"),
        &["59: expected a number, found `.nan` (write digits with a point, for example `12.5`)"],
    );
}

#[test]
fn times_are_within_bounds() {
    let cases = [
        ("frequency", "window", "0s", "`window` is not between 1ms and 10m"),
        ("frequency", "window", "1h", "`window` is not between 1ms and 10m"),
        ("latency", "window", "11m", "`window` is not between 1ms and 10m"),
    ];
    for (kind, key, value, text) in cases {
        let limit = if kind == "latency" { "1s" } else { "1" };
        let found =
            parse("c", &module(&format!("{kind}: {{ {TOPIC}, {key}: {value}, error_above: {limit} }}")));
        let lines = found.unwrap_err().lines();
        assert!(lines.len() == 1 && lines[0].contains(text), "{lines:?}");
    }
    wrong(
        &format!("frequency: {{ {TOPIC}, window: -2s, error_below: 1 }}"),
        &[
            "48: expected a duration, found `-2s` (write a number with one of the units ns, us, ms, s, m, h, d: for example `2s`)",
        ],
    );
    for limit in ["error_below", "error_above"] {
        let found = parse("c", &module(&format!("latency: {{ {TOPIC}, {limit}: -50ms }}")));
        let lines = found.unwrap_err().lines();
        assert!(
            lines.len() == 1 && lines[0].contains("never below 0") && lines[0].contains("`ahead`"),
            "{lines:?}"
        );
    }
    wrong(
        "watchdog: { node: /n, every: 0s, misses: 0 }",
        &[
            "30: `every` is not between 100ms and 1h (choose another duration)",
            "42: 0 is not between 1 and 1000 (the default is 3)",
        ],
    );
    wrong(
        "sequence: { earlier: { status: s, key: a }, later: { status: s, key: b }, max_gap: 0s, error_above: 1 }",
        &["84: `max_gap` is not between 1ns and 1h (choose another duration)"],
    );
    wrong(
        "agreement: { a: { status: s, key: a }, b: { status: s, key: b }, max_age: 2h, motion_over: 0s, error_above: 1 }",
        &[
            "75: `max_age` is not between 1ns and 1h (choose another duration)",
            "92: `motion_over` is not between 1ns and 10m (choose another duration)",
        ],
    );
}

#[test]
fn a_value_comes_from_one_place_and_is_judged_in_one_way() {
    wrong(
        "value: { error_above: 1 }",
        &[
            "8: it is not said where the value comes from (write `topic`, `type` and `field`, or `status` and `key`)",
        ],
    );
    wrong(
        &format!("value: {{ {TOPIC}, field: x, status: s, key: k, error_above: 1 }}"),
        &[
            "8: the value comes either from a topic or from a status (write `topic`, `type` and `field`, or `status` and `key`)",
        ],
    );
    wrong("value: { status: s, error_above: 1 }", &["8: a value monitor needs `key` (add `key: ...`)"]);
    wrong(
        &format!("value: {{ {TOPIC}, error_above: 1 }}"),
        &["8: a value monitor needs `field` (add `field: ...`)"],
    );
    for path in ["x.", ".x", "x[", "x[]", "x[a]", "9x", "x y", "x[-2]"] {
        wrong(
            &format!("value: {{ {TOPIC}, field: '{path}', error_above: 1 }}"),
            &[&format!(
                "43: `{path}` is no path of a field (write names with dots, elements in brackets: `twist.linear.x`, `poses[0].position.x`, `transforms[child_frame_id=base_link].transform`)"
            )],
        );
    }
    wrong(
        "value: { status: s, key: k }",
        &[
            "8: without a limit this would never be anything but OK (add at least one of warning_below, error_below, warning_above, error_above, error_unless, warning_unless)",
        ],
    );
    wrong(
        "value: { status: s, key: k, error_above: 1, error_unless: 2 }",
        &[
            "45: limits and `..._unless` do not go together (limits are for numbers, `..._unless` is for the one good value)",
        ],
    );
    wrong(
        "value: { status: s, key: k, warning_unless: 2, error_unless: 2.0 }",
        &["45: this WARNING is always an ERROR (remove one of the two)"],
    );
    wrong(
        "value: { status: s, key: k, error_above: 1, empty: ok }",
        &[
            "45: `empty` is for a topic whose messages are events (a status is said again and again; `stale` says what its silence is)",
        ],
    );
    wrong(
        &format!("value: {{ {TOPIC}, field: x, error_above: 1, empty: ok }}"),
        &[
            "62: `empty: ok` is for the goals of an action (action_msgs/msg/GoalStatusArray) (write `empty: unknown`: nobody knows the state before the first message)",
        ],
    );
    wrong(
        &format!("value: {{ {TOPIC}, pose: p, error_above: 1 }}"),
        &[
            "8: a value monitor needs `field` (add `field: ...`)",
            "36: unknown key `pose` in a value monitor (known here: topic, type, field, status, key, unit, warning_below, error_below, warning_above, error_above, nan, empty, error_unless, warning_unless)",
        ],
    );
}

#[test]
fn two_sides_are_of_one_kind_and_not_the_same() {
    wrong(
        "rate_ratio: { input: { topic: /i, type: a/msg/B }, output: { topic: /i, type: a/msg/B }, error_below: 1 }",
        &["69: input and output are one topic (name the topic that goes out)"],
    );
    wrong(
        "rate_ratio: { input: { topic: /i }, error_below: 1 }",
        &["13: a rate_ratio monitor needs `output` (add `output: ...`)"],
    );
}

#[test]
fn classes_are_words_of_the_paper() {
    let external = |class: &str| format!("external: {{ status: s, class: {class} }}");
    wrong("external: { status: s }", &["11: an external monitor needs `class` (add `class: ...`)"]);
    wrong(
        &external("{ location: isolatd, information: data, flow: up }"),
        &[
            "43: unknown location `isolatd` (did you mean `isolated`?)",
            "65: unknown information `data` (one of: content, meta)",
            "77: unknown flow `up` (one of: sequential, parallel)",
        ],
    );
    wrong(
        &external("{ flow: null }"),
        &[
            "31: a class needs `location` (add `location: isolated` or `location: contextual`)",
            "31: a class needs `information` (add `information: content` or `information: meta`)",
        ],
    );
}
