//! Tests of the settings of the recording.

use super::*;
use crate::describe::words;
use crate::recording::Recording;

fn parsed(text: &str) -> Loaded {
    parse("c", &format!("{GROUP}{text}")).unwrap_or_else(|problems| panic!("{problems}"))
}

fn of(text: &str) -> String {
    words::recording(parsed(text).recording.as_ref())
}

#[test]
fn incidents_are_recorded_unless_it_is_switched_off() {
    assert_eq!(of(""), "30s before and 10s after, 256MB of memory, 10GB of disk, kept for 30d");
    assert_eq!(parsed("").recording, Some(Recording::default()));
    assert_eq!(of("recording: false\n"), "switched off");
    assert_eq!(
        of("recording: { before: 1m, after: 20s, memory: 1.5 GB, disk: 2TB, keep: 12h }\n"),
        "1m before and 20s after, 1500MB of memory, 2TB of disk, kept for 12h"
    );
}

#[test]
fn what_cannot_be_recorded_is_said_at_its_place() {
    check_beside_group(
        "recording: { before: 3m, after: 10, memory: 1kB, disk: 10, keep: 1m }\n",
        &[
            "2:22: 3m is not between 1s and 2m (the default is 30s)",
            "2:33: expected a duration, found `10` (write a number with one of the units ns, us, ms, s, m, h, d: for example `2s`)",
            "2:45: 1kB is not between 4MB and 16GB (the default is 256MB)",
            "2:56: expected a size, found `10` (write a number with one of the units kB, MB, GB, TB: for example `256MB`)",
            "2:66: 1m is not between 1h and 3650d (the default is 30d)",
        ],
    );
}

#[test]
fn further_topics_are_recorded_by_name_or_pattern() {
    let text = "recording: { topics: [{ topic: /points, every: 500ms }, { topic: '/camera/*' }] }\n";
    assert!(of(text).ends_with("kept for 30d; also /points every 500ms, /camera/*"), "{}", of(text));
    let never = "recording: { topics: [{ topic: /imu, every: never }] }\n";
    assert!(of(never).ends_with("also /imu never"), "{}", of(never));
    let watched = &parsed(text).model.watched;
    let every = |topic: &str| watched.recorded(topic).map(|it| it.every.as_millis());
    assert_eq!(
        [every("/points"), every("/camera/a/b"), every("/camera"), every("/points2")],
        [Some(500), Some(0), None, None]
    );
}

/// A reader of our own requests would count as a listener.
#[test]
fn own_topics_are_never_read_for_a_recording() {
    let watched = &parsed("recording: { topics: [{ topic: '/*' }] }\n").model.watched;
    let is_recorded = |topic| watched.recorded(topic).is_some();
    assert!(is_recorded("/any/thing"));
    for own in ["/diagnostics_agg", "/telltale/stage", "/telltale/maneuver_stop_request", "/initialpose"] {
        assert!(!is_recorded(own), "{own}");
    }
}

#[test]
fn a_star_stands_for_any_characters() {
    let names = |pattern: &str, topic| {
        let every = telltale_engine::time::Span::ZERO;
        telltale_engine::model::monitors::RecordedTopic { pattern: pattern.into(), every }.names(topic)
    };
    for (pattern, topic, is_named) in [
        ("/a", "/a", true),
        ("/a", "/ab", false),
        ("/*", "/a/b", true),
        ("/a*a", "/a", false),
        ("/a*a", "/aa", true),
        ("/*/points", "/front/points", true),
        ("/*/points", "/points", false),
        ("/*ab*ab", "/xab", false),
        ("/*ab*ab", "/xabab", true),
        ("/**", "/", true),
    ] {
        assert_eq!(names(pattern, topic), is_named, "{pattern} {topic}");
    }
}

#[test]
fn topics_that_cannot_be_recorded_are_said_at_their_place() {
    check_beside_group(
        "recording: { topics: [{ topic: points }, { topic: /a b }, { topic: /a, every: 2h }, { topic: /a }, { every: 1s }] }\n",
        &[
            "2:32: `points` names no topic (begin with `/`; letters, digits, `_`, `/` and `*` follow: `/camera/*`)",
            "2:51: `/a b` names no topic (begin with `/`; letters, digits, `_`, `/` and `*` follow: `/camera/*`)",
            "2:79: 2h is not between 1ms and 1h (without `every`, all messages are recorded)",
            "2:94: /a is recorded already (name each topic once)",
            "2:100: a recorded topic needs `topic` (add `topic: ...`)",
        ],
    );
}
