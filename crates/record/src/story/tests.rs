//! Tests of what a recording tells.

use super::*;
use crate::summary::{FrozenNode, Recording};

fn shown(at_ms: i64, node: &str, shown: &str, masked_by: Option<&str>) -> Transition<'static> {
    let change = Change::Shown {
        node: node.to_owned().into(),
        shown: shown.to_owned().into(),
        own: shown.to_owned().into(),
        masked_by: masked_by.map(|it| it.to_owned().into()),
        message: Some("no packets".into()),
        began_ms: None,
    };
    Transition { at_ms, change }
}

fn signal(at_ms: i64, signal: &'static str, value: Option<bool>) -> Transition<'static> {
    Transition { at_ms, change: Change::Signal { signal: signal.into(), value } }
}

fn stage(at_ms: i64, stage: &'static str) -> Transition<'static> {
    Transition { at_ms, change: Change::Stage { stage: stage.into() } }
}

fn summary() -> Summary {
    let trigger = |at_ms, kind: &str, what: &str| TriggerLine {
        at_ms,
        kind: kind.into(),
        what: what.into(),
        alarm: None,
        note: "rain".into(),
    };
    Summary {
        since_ms: 40_000,
        until_ms: Some(50_000),
        triggers: vec![
            trigger(40_000, kind::ROOT, "sensors/lidar"),
            trigger(40_100, kind::COUNTERMEASURE, "decelerate"),
            trigger(41_000, kind::MARK, "anna"),
        ],
        roots: vec!["sensors/lidar".into()],
        recording: Recording { pre_roll_s: 30.0, ..Recording::default() },
        ..Summary::default()
    }
}

#[test]
fn a_fault_stands_where_it_is_estimated_to_have_begun() {
    let late = |at_ms, began_ms, node: &str| {
        let mut late = shown(at_ms, node, "error", None);
        let Change::Shown { began_ms: began, .. } = &mut late.change else { unreachable!("it is shown") };
        *began = began_ms;
        late
    };
    let changes = vec![
        late(39_000, None, "sensors/lidar"),
        late(40_000, None, "perception/lanes"),
        late(41_000, Some(39_500), "sensors/camera"),
    ];
    let story = Heard { changes, ..Heard::default() }.tell(&summary());
    let told = story.moments.iter().filter_map(|moment| match &moment.what {
        Happened::Fails { node, .. } => Some((&**node, moment.at_ms)),
        _ => None,
    });
    let expected = [("sensors/lidar", 39_000), ("sensors/camera", 41_000), ("perception/lanes", 40_000)];
    assert_eq!(told.collect::<Vec<_>>(), expected);
}

#[test]
fn an_interrupted_recording_ends_at_its_last_entry_and_before_the_trigger_if_it_has_none() {
    let mut summary = summary();
    (summary.recording.interrupted, summary.until_ms) = (true, None);
    let told = |changes| Heard { changes, ..Heard::default() }.tell(&summary);
    let ends = |changes| {
        let story = told(changes);
        let is_said = story.moments.iter().any(|it| it.what == Happened::Interrupted);
        (story.interrupted_ms, story.to_ms, is_said)
    };
    let ok = |at_ms| shown(at_ms, "sensors/lidar", "ok", None);
    assert_eq!(ends(vec![ok(9_000), ok(43_000)]), (Some(43_000), 43_000, true));
    assert_eq!(ends(vec![ok(9_000), ok(20_000)]), (Some(20_000), 20_000, true));
    assert_eq!(ends(vec![]), (Some(10_000), 10_001, true));
}

#[test]
fn a_fault_is_told_with_what_it_hides_and_what_is_done_about_it() {
    let changes = vec![
        stage(1_000, "active"),
        shown(1_000, "sensors", "ok", None),
        shown(1_000, "sensors/lidar", "ok", None),
        shown(1_000, "perception", "ok", None),
        shown(1_000, "can/fine", "ok", None),
        signal(1_000, "slowing", Some(false)),
        signal(1_000, "goal", None),
        // Before the first instant that is shown.
        shown(5_000, "sensors/lidar", "warning", None),
        shown(6_000, "sensors/lidar", "ok", None),
        shown(40_000, "sensors/lidar", "error", None),
        // Empty, and no tile.
        shown(40_000, "other", "unknown", None),
        shown(39_000, "other", "ignore", None),
        shown(40_000, "sensors", "error", None),
        shown(40_000, "perception", "ignore", Some("sensors/lidar")),
        shown(40_000, "perception/costmap", "ignore", Some("sensors/lidar")),
        // It changed behind its cause.
        shown(40_050, "perception/costmap", "ignore", Some("sensors/lidar")),
        signal(41_500, "slowing", Some(true)),
        stage(42_000, "standby"),
        shown(45_000, "sensors/lidar", "ok", None),
    ];
    let mut heard = Heard { changes, ..Heard::default() };
    let took = r#"{"at_ns":1,"took":{"input":{"operator":"request_stop"}}}"#;
    heard.journal(40_500, took.as_bytes());
    heard.journal(40_600, br#"{"at_ns":1,"took":{"lost":3}}"#);
    heard.journal(40_700, b"\"operator\" is no journal");
    let story = heard.tell(&summary());
    assert_eq!((story.from_ms, story.to_ms, story.lost), (10_000, 50_000, 3));
    let told: Vec<(i64, Happened)> = story.moments.into_iter().map(|it| (it.at_ms, it.what)).collect();
    let expected = vec![
        (
            40_000,
            Happened::Fails {
                node: "sensors/lidar".into(),
                state: "error".into(),
                message: "no packets".into(),
                began_ms: None,
            },
        ),
        (
            40_000,
            Happened::Masks {
                by: "sensors/lidar".into(),
                nodes: vec!["perception".into(), "perception/costmap".into()],
                more: 0,
            },
        ),
        (40_100, Happened::Request { request: "decelerate".into() }),
        (40_500, Happened::Operator { action: "stop", on: String::new() }),
        (41_000, Happened::Mark { by: "anna".into(), note: "rain".into() }),
        (41_500, Happened::Signal { signal: "slowing".into(), value: Some(true) }),
        (42_000, Happened::Stage { stage: "standby".into() }),
        (45_000, Happened::Recovers { nodes: vec!["sensors/lidar".into()], more: 0 }),
    ];
    assert_eq!(told, expected);
    let names: Vec<&str> = story.strips.iter().map(|strip| &*strip.node).collect();
    assert_eq!(names, ["sensors/lidar", "sensors", "perception"], "the cause, then what changed");
    let states: Vec<_> =
        story.strips[0].periods.iter().map(|it| (it.from_ms, it.to_ms, &*it.state)).collect();
    assert_eq!(states, [(10_000, 40_000, "ok"), (40_000, 45_000, "error"), (45_000, 50_000, "ok")]);
    let signals: Vec<_> = story.signals.iter().map(|strip| (&*strip.node, strip.periods.len())).collect();
    assert_eq!(signals, [("slowing", 2)], "those that changed");
    let stages: Vec<_> = story.stages.iter().map(|it| (it.from_ms, it.to_ms, &*it.state)).collect();
    assert_eq!(stages, [(10_000, 42_000, "active"), (42_000, 50_000, "standby")]);
}

#[test]
fn what_is_given_time_to_report_is_no_event() {
    let told = |states: &[(i64, &str)], node: &str| {
        let change = |(at_ms, state): &(i64, &str)| match *state {
            "alarm" => Transition {
                at_ms: 20_000 + at_ms,
                change: Change::AlarmRaised { alarm: 1, node: node.to_owned().into() },
            },
            state => shown(20_000 + at_ms, node, state, None),
        };
        let before = [shown(1_000, node, "ignore", None)];
        let changes: Vec<_> = before.into_iter().chain(states.iter().map(change)).collect();
        happened(&changes, &summary(), 10_000).len()
    };
    assert_eq!(told(&[(0, "unknown"), (2_000, "ok")], "can/bus"), 0);
    assert_eq!(told(&[(0, "unknown"), (5_000, "ok")], "can/bus"), 0, "it measures for that long");
    assert_eq!(told(&[(0, "unknown")], "can/bus"), 0, "it measures still");
    assert_eq!(told(&[(0, "unknown"), (2_000, "ignore")], "can/bus"), 0, "it matters no longer");
    assert_eq!(told(&[(0, "unknown"), (3_000, "alarm"), (5_000, "ok")], "can/bus"), 2, "it took too long");
    assert_eq!(told(&[(0, "unknown"), (3_000, "alarm")], "can/bus"), 1, "it never reported");
    assert_eq!(told(&[(0, "unknown"), (100, "error"), (100, "alarm")], "can/bus"), 1, "then it fails");
    assert_eq!(
        told(&[(0, "ok"), (100, "unknown"), (100, "alarm"), (200, "ok")], "can/bus"),
        2,
        "it had reported"
    );
    assert_eq!(told(&[(0, "unknown"), (100, "ok")], "sensors/lidar"), 2, "it raised an alarm");
}

#[test]
fn a_story_is_bounded() {
    let changes: Vec<_> =
        (0..3000).map(|index| shown(20_000 + index, &format!("g{}/m", index % 700), "error", None)).collect();
    let story = Heard { changes, ..Heard::default() }.tell(&summary());
    assert_eq!((story.moments.len(), story.strips.len()), (MOMENTS_MAX, 40));
    assert!(story.more_moments > 0);
    // Ten modules that change all the time.
    let flaps = (0..20_000).map(|index| {
        let state = if index / 10 % 2 == 0 { "error" } else { "ok" };
        shown(20_000 + index, &format!("g/{}", index % 10), state, None)
    });
    let story = Heard { changes: flaps.collect(), ..Heard::default() }.tell(&summary());
    let periods = || story.strips.iter().map(|strip| strip.periods.len());
    assert_eq!((periods().sum::<usize>(), periods().max(), story.more_periods), (4000, Some(1000), 16_000));
    let last = story.strips[1].periods.last().unwrap();
    assert_eq!(last.to_ms, 30_000, "what is left out is not drawn as the state before it");
    let mut moments = Vec::new();
    (0..100).for_each(|index| add(&mut moments, 1, Some("cause"), &index.to_string()));
    assert!(matches!(&moments[..], [Moment { what: Happened::Masks { more: 88, .. }, .. }]), "{moments:?}");
}

#[test]
fn without_its_file_an_incident_is_known_by_its_triggers() {
    let frozen = FrozenNode {
        node: "sensors/lidar".into(),
        state: "error".into(),
        message: "no packets".into(),
        values: Vec::new(),
        at_ms: None,
    };
    let story = known(&Summary { freeze: vec![frozen], more_triggers: 7, ..summary() });
    assert_eq!((story.from_ms, story.to_ms, story.more_moments), (10_000, 50_000, 7));
    let told: Vec<Happened> = story.moments.into_iter().map(|it| it.what).collect();
    let expected = [
        Happened::Fails {
            node: "sensors/lidar".into(),
            state: "error".into(),
            message: "no packets".into(),
            began_ms: None,
        },
        Happened::Request { request: "decelerate".into() },
        Happened::Mark { by: "anna".into(), note: "rain".into() },
    ];
    assert_eq!(told, expected);
}

fn has_limits(values: &[(&str, &str)], expected: &[(&str, &str, f64)]) {
    let values: Vec<(Box<str>, Box<str>)> =
        values.iter().map(|(key, value)| ((*key).into(), (*value).into())).collect();
    let limits = Limit::reported(&values);
    let found: Vec<_> = limits.iter().map(|(of, limit)| (*of, &*limit.name, limit.value)).collect();
    assert_eq!(found, expected);
}

#[test]
fn the_limits_of_a_report_bound_what_its_monitor_measures() {
    let values = [
        ("source", "lidar"),
        ("rate_hz", "9"),
        ("warning_below", "8"),
        ("count", "3"),
        ("error_below", "5"),
        ("error_above", "nan"),
        ("warning_above", "none"),
    ];
    has_limits(&values, &[("rate_hz", "warning_below", 8.0), ("rate_hz", "error_below", 5.0)]);
    // A limit of nothing.
    has_limits(&values[2..3], &[]);
}

#[test]
fn limits_that_name_their_number_bound_that_one() {
    let values = [
        ("translation_m", "0.2"),
        ("rotation_deg", "3"),
        ("translation_m_warning_above", "0.5"),
        ("translation_m_error_above", "1"),
        ("rotation_deg_error_above", "20"),
    ];
    let expected = [
        ("translation_m", "warning_above", 0.5),
        ("translation_m", "error_above", 1.0),
        ("rotation_deg", "error_above", 20.0),
    ];
    has_limits(&values, &expected);
    for (key, is_limit) in [
        ("error_above", true),
        ("rotation_deg_error_above", true),
        ("_error_above", false),
        ("terror_above", false),
    ] {
        assert_eq!(Limit::is_name(key), is_limit, "{key}");
    }
}
