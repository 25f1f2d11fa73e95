//! Tests of what a recording tells.

use super::*;
use crate::record::summary::{Recording, TriggerLine};

fn shown(at_ms: i64, node: &str, shown: &str, masked_by: Option<&str>) -> Transition<'static> {
    let change = Change::Shown {
        node: node.to_owned().into(),
        shown: shown.to_owned().into(),
        own: shown.to_owned().into(),
        masked_by: masked_by.map(|it| it.to_owned().into()),
        message: Some("no packets".into()),
    };
    Transition { at_ms, change }
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
fn a_fault_is_told_with_what_it_hides_and_what_is_done_about_it() {
    let changes = vec![
        stage(1_000, "active"),
        shown(1_000, "sensors", "ok", None),
        shown(1_000, "sensors/lidar", "ok", None),
        shown(1_000, "perception", "ok", None),
        shown(1_000, "can/fine", "ok", None),
        // Before the first instant that is shown.
        shown(5_000, "sensors/lidar", "warning", None),
        shown(6_000, "sensors/lidar", "ok", None),
        shown(40_000, "sensors/lidar", "error", None),
        shown(40_000, "sensors", "error", None),
        shown(40_000, "perception", "ignore", Some("sensors/lidar")),
        shown(40_000, "perception/costmap", "ignore", Some("sensors/lidar")),
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
        (42_000, Happened::Stage { stage: "standby".into() }),
        (45_000, Happened::Recovers { nodes: vec!["sensors/lidar".into()], more: 0 }),
    ];
    assert_eq!(told, expected);
    let names: Vec<&str> = story.strips.iter().map(|strip| &*strip.node).collect();
    assert_eq!(names, ["sensors/lidar", "sensors", "perception"], "the cause, then what changed");
    let states: Vec<_> =
        story.strips[0].periods.iter().map(|it| (it.from_ms, it.to_ms, &*it.state)).collect();
    assert_eq!(states, [(10_000, 40_000, "ok"), (40_000, 45_000, "error"), (45_000, 50_000, "ok")]);
    let stages: Vec<_> = story.stages.iter().map(|it| (it.from_ms, it.to_ms, &*it.state)).collect();
    assert_eq!(stages, [(10_000, 42_000, "active"), (42_000, 50_000, "standby")]);
}

#[test]
fn a_story_is_bounded() {
    let changes: Vec<_> =
        (0..3000).map(|index| shown(20_000 + index, &format!("g{}/m", index % 700), "error", None)).collect();
    let story = Heard { changes, ..Heard::default() }.tell(&summary());
    assert_eq!((story.moments.len(), story.strips.len()), (MOMENTS_MAX, STRIPS_MAX));
    assert!(story.more_moments > 0);
    let mut moments = Vec::new();
    (0..100).for_each(|index| add(&mut moments, 1, Some("cause"), &index.to_string()));
    assert!(matches!(&moments[..], [Moment { what: Happened::Masks { more: 88, .. }, .. }]), "{moments:?}");
}
