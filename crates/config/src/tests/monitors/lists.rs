//! Tests of conditions over the elements of arrays.

use std::sync::Arc;

use super::*;
use crate::describe::words;
use telltale_engine::model::MonitorSpec;
use telltale_engine::model::sample::{Elements, FieldValue};

const INPUTS: &str = "goals: { topic: /s, type: action_msgs/msg/GoalStatusArray, field: status_list }, \
                      ranges: { topic: /r, type: sensor_msgs/msg/LaserScan, field: ranges }, \
                      x: { status: s, key: x }";

fn text(condition: &str) -> String {
    format!(
        "groups:\n- id: a\n  modules:\n  - id: m\n    monitor:\n      expression:\n        inputs: {{ {INPUTS} }}\n        error: {condition}\n"
    )
}

#[track_caller]
fn wrong(condition: &str, expected: &str) {
    let lines = parse("c", &text(condition)).map_or_else(|problems| problems.lines(), |_| Vec::new());
    assert!(lines.len() == 1 && lines[0].contains(expected), "{condition}: {lines:?}");
}

fn list(values: &[f64], count: u32) -> FieldValue {
    let taken = values.iter().map(|value| FieldValue::Number(*value)).collect();
    FieldValue::Elements(Arc::new(Elements { taken, count }))
}

/// The answer of a condition, given one value for each name of its inputs.
fn answer(condition: &str, value: impl Fn(&str) -> FieldValue) -> Result<bool, Box<str>> {
    let loaded = parse("c", &text(condition)).unwrap_or_else(|problems| panic!("{problems}"));
    let Some(MonitorSpec::Expression { inputs, error, .. }) = loaded.model.modules[0].monitor.other() else {
        panic!()
    };
    let values: Vec<FieldValue> = inputs.iter().map(|(name, _)| value(name)).collect();
    error.as_ref().unwrap().holds(&values)
}

#[test]
fn a_condition_asks_the_elements_of_a_list() {
    let status = |values: &'static [f64], count: u32| {
        move |name: &str| match name {
            "goals[].status" => list(values, count),
            "goals[].goal_info.stamp" => list(&[1.0, 2.0, 3.0], 3),
            "ranges[]" => list(&[0.5, 4.0], 2),
            _ => FieldValue::Number(6.0),
        }
    };
    let three = status(&[2.0, 6.0, 4.0], 3);
    for (condition, expected) in [
        ("goals.exists(g, g.status == 6)", true),
        ("goals.exists(g, g.status == 5)", false),
        ("goals.exists(g, g.status == x)", true),
        ("goals.all(g, g.status >= 2)", true),
        ("goals.all(g, g.status > 2)", false),
        ("goals.exists(g, g.status == 6 && g.goal_info.stamp > 2)", false),
        ("goals.exists(g, g.status == 6) && !ranges.exists(r, r < 0.2)", true),
        ("'ranges.all(r, math.abs(r) < 5) ? x == 6 : false'", true),
    ] {
        assert_eq!(answer(condition, three), Ok(expected), "{condition}");
    }
    let none = status(&[], 0);
    assert_eq!(answer("goals.exists(g, g.status == 6)", none), Ok(false));
    assert_eq!(answer("goals.all(g, g.status == 6)", none), Ok(true));
    // Not all of them are known.
    let cut = status(&[2.0, 6.0], 300);
    assert_eq!(answer("goals.exists(g, g.status == 6)", cut), Ok(true));
    assert!(answer("goals.exists(g, g.status == 5)", cut).is_err());
    assert_eq!(answer("goals.all(g, g.status == 2)", cut), Ok(false));
    assert!(answer("goals.exists(g, g.status == 6)", |_| FieldValue::Bool(true)).is_err());
    let broken = status(&[f64::NAN, 6.0], 2);
    assert_eq!(answer("goals.exists(g, g.status == 6)", broken), Ok(true), "one settles it");
    assert!(answer("goals.exists(g, g.status > 7)", broken).is_err());
}

#[test]
fn only_the_members_that_are_used_are_read() {
    let loaded = parse("c", &text("goals.exists(g, g.status == 6)")).unwrap_or_else(|it| panic!("{it}"));
    let read: Vec<&str> = loaded.model.watched.topics[0].fields.iter().map(|it| &*it.path).collect();
    assert_eq!(read, ["status_list[].status"]);
    let words = words::monitor(&loaded.model, &loaded.model.modules[0].monitor);
    assert!(words.contains("goals[].status = each status_list[].status of /s"), "{words}");
}

#[test]
fn what_is_wrong_with_a_list_is_said() {
    wrong("goals > 3 && goals.exists(g, g.status == 6)", "`goals` is a list here");
    wrong("x.exists(g, g.status == 6)", "or it is no list");
    wrong("goals.exists(g, true)", "nothing is asked of an element of `goals`");
    wrong("goal.exists(g, g.status == 6)", "there is no input `goal` (did you mean `goals`?)");
    wrong("goals.exists(g)", "`exists` and `all` take an input, a name and a condition");
    wrong("goals.exists(x, x.status == 6)", "`x` is an input already");
    wrong("goals.exists(g, g.status + 1)", "must be true or false");
    wrong("goals.exists(g, g.status == 6 && ranges.all(r, r > 1))", "one after the other");
    wrong("goals.exists(g, g.status == 6 && h.status == 6)", "an input has no members");
}
