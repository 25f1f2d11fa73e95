//! Tests of agreements: their sources and their limits.

use super::{TOPIC, means, wrong};

#[test]
fn two_sources_are_of_one_kind_with_its_own_limits() {
    let agreement = |a: &str, b: &str, rest: &str| {
        format!("agreement: {{ a: {{ {TOPIC}, {a} }}, b: {{ {TOPIC}, {b} }}, {rest} }}")
    };
    wrong(
        &agreement("pose: p", "field: x", "error_above: 1"),
        &["12: a pose is compared with a single value (write `pose` on both sides, or `field` on both)"],
    );
    wrong(
        &agreement("pose: p, field: x", "field: x", "error_above: 1"),
        &[
            "17: either `field`, `pose` or `list` (`field` for a single value, `pose` for a position with its rotation, `list` for many positions)",
        ],
    );
    wrong(
        &agreement("pose: p", "pose: q", "error_above: 1"),
        &[
            "12: limits of poses stand in `translation` and `rotation_deg` (for example `translation: { warning_above: 0.5, error_above: 1 }`)",
        ],
    );
    wrong(
        &agreement("pose: p", "pose: q", "max_age: 1s"),
        &[
            "12: without a limit this would never be anything but OK (add `translation: { error_above: 1 }` or `rotation_deg: { error_above: 10 }`)",
        ],
    );
    wrong(
        &agreement("pose: p", "pose: q", "rotation_deg: { error_above: 181 }, translation: {}"),
        &[
            "127: what is measured here is never above 181 (choose a limit between 0 and 180, or remove it)",
            "147: without a limit this would never be anything but OK (add at least one of warning_below, error_below, warning_above, error_above)",
        ],
    );
    wrong(
        &agreement("field: x", "field: y", "translation: { error_above: 1 }"),
        &[
            "100: only poses have a translation and a rotation (write the limits beside `a` and `b`, or `pose` instead of `field`)",
        ],
    );
    wrong(
        &agreement("field: x", "field: x", "error_above: 1"),
        &["95: this is the same value as the other (name a second, independent source)"],
    );
}

#[test]
fn lists_have_limits_on_their_number_and_their_distance() {
    let agreement = |a: &str, b: &str, rest: &str| {
        format!("agreement: {{ a: {{ {TOPIC}, {a} }}, b: {{ {TOPIC}, {b} }}, {rest} }}")
    };
    means(
        &agreement(
            "list: p",
            "list: 'd[].bbox'",
            "count: { error_above: 2 }, nearest: { warning_above: 1, error_above: 3 }",
        ),
        "the positions in p of /t (a/msg/B) against the positions in d[].bbox of /t (a/msg/B), not older than 1s: difference in number error above 2; distance to the nearest warning above 1 m, error above 3 m",
    );
    let refused = "\
list: p | pose: q | count: { error_above: 1 } | 12: a list is compared with what is none (write `list` on both sides, or compare lengths: `field: poses.length`)
list: p | list: q | error_above: 1 | 12: limits of lists stand in `count` and `nearest` (for example `nearest: { warning_above: 1, error_above: 3 }`)
list: p | list: q | max_age: 1s | 12: without a limit this would never be anything but OK (add `count: { error_above: 2 }` or `nearest: { error_above: 3 }`)
list: p | list: q | count: { error_above: 1 }, motion_over: 1s | 125: lists of positions have no motion (remove `motion_over`; it is for poses)
field: p | field: q | count: { error_above: 1 } | 100: only lists have a number of elements and distances between them (write `list` on both sides)
list: p | list: q | translation: { error_above: 1 } | 98: only poses have a translation and a rotation (write the limits in `count` and `nearest`, or `pose` instead of `list`)
list: p, pose: p | list: q | count: { error_above: 1 } | 17: either `field`, `pose` or `list` (`field` for a single value, `pose` for a position with its rotation, `list` for many positions)
list: p | list: p | count: { error_above: 1 } | 93: this is the same value as the other (name a second, independent source)";
    for row in refused.lines() {
        let row: Vec<&str> = row.split(" | ").collect();
        let [a, b, rest, text] = row[..] else { panic!("{row:?}") };
        wrong(&agreement(a, b, rest), &[text]);
    }
    let path = "`a[].b[]` is no path of a list (name the array, or what has `x` and `y` in each element: `poses`, `detections[].bbox.center.position`)";
    wrong(&agreement("list: 'a[].b[]'", "list: q", "count: { error_above: 1 }"), &[&format!("51: {path}")]);
    let path = "`a[]` is no path of a field";
    let found = super::parse(
        "c",
        &super::module(&agreement("pose: 'a[]'", "pose: q", "translation: { error_above: 1 }")),
    );
    let lines = found.unwrap_err().lines();
    assert!(lines.len() == 1 && lines[0].contains(path), "{lines:?}");
}
