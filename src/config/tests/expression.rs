//! Conditions in CEL: what they mean, and what is wrong with them before there are values.

use super::*;
use crate::engine::model::MonitorSpec;
use crate::engine::monitor::spec::Condition;
use crate::engine::sample::{FieldValue, Pose};

fn text(condition: &str) -> String {
    let inputs = ["x", "y", "on", "word"].map(|name| format!("{name}: {{ status: s, key: {name} }}")).join(", ");
    format!(
        "groups:\n- id: a\n  modules:\n  - id: m\n    monitor:\n      expression:\n        inputs: {{ {inputs} }}\n        error: {condition}\n"
    )
}

fn condition(condition: &str) -> Condition {
    let loaded = parse("c", &text(condition)).unwrap_or_else(|problems| panic!("{problems}"));
    let MonitorSpec::Expression { error, .. } = &loaded.model.modules[0].monitor else { panic!() };
    error.clone().unwrap()
}

/// x is 2.5, y is 4, on is true, word is `ready`.
fn values() -> [FieldValue; 4] {
    [FieldValue::Number(2.5), FieldValue::Number(4.0), FieldValue::Bool(true), FieldValue::Text("ready".into())]
}

#[track_caller]
fn wrong(condition: &str, expected: &[&str]) {
    let lines = parse("c", &text(condition)).map_or_else(|problems| problems.lines(), |_| Vec::new());
    let found: Vec<&str> = lines.iter().map(|line| line.strip_prefix("c:8:").unwrap_or(line)).collect();
    assert_eq!(found, expected, "{condition}");
}

#[test]
fn conditions_mean_what_they_say() {
    let cases = [
        ("x > 2", true),
        ("x > 2.5", false),
        ("x >= 2.5 && y == 4", true),
        ("x * 2 == 5", true),
        ("y / 8 == 0.5", true),
        ("1 / 2 == 0.5", true),
        ("-x < 0 - 2", true),
        ("x + 1 > 3 ? on : false", true),
        ("!on || x > 3", false),
        ("word == 'ready'", true),
        ("word in ['ready', 'busy']", true),
        ("x in [1, 2, 3]", false),
        ("y in [2, 4]", true),
        ("word.startsWith('re') && word.endsWith('y') && word.contains('ad')", true),
        ("math.abs(x - y) > 1", true),
        ("math.greatest(x, y) == 4", true),
        ("math.least(x, y, 1) == 1", true),
        ("math.sqrt(y) == 2", true),
        ("math.floor(x) == 2 && math.ceil(x) == 3 && math.trunc(x) == 2 && math.round(y) == 4", true),
        ("double('1.5') == 1.5", true),
        ("on == true", true),
        ("on", true),
        ("x != y", true),
        // Texts and numbers are never equal.
        ("word == 'x' || x == 'x'", false),
    ];
    for (written, expected) in cases {
        assert_eq!(condition(&format!("\"{written}\"")).holds(&values()), Ok(expected), "{written}");
    }
}

#[test]
fn without_an_answer_there_is_a_reason() {
    let cases = [
        ("x", "the condition is neither true nor false"),
        ("word > 3", "can not be compared"),
        ("word * 2 > 3", "overload"),
        ("double(word) > 1", ""),
    ];
    for (written, expected) in cases {
        let error = condition(written).holds(&values()).unwrap_err();
        assert!(error.contains(expected), "{written}: {error}");
    }
    for missing in [FieldValue::Unreadable("ends early".into()), FieldValue::Pose(Pose::default())] {
        assert!(condition("x > 1").holds(&[missing]).is_err());
    }
    assert!(condition("x > 1").holds(&[]).is_err());
    // NaN is no answer that could be OK by accident: the engine does not ask with it.
    assert_eq!(condition("x > 1").holds(&[FieldValue::Number(f64::NAN)]), Ok(false));
}

#[test]
fn what_is_wrong_is_said_with_its_place() {
    wrong("x >", &[]);
    wrong("spede > 3", &[]);
    wrong("worrd == 'a'", &[]);
    wrong("maths.abs(x) > 1", &[]);
    wrong("math.abz(x) > 1", &[]);
    wrong("x + 1", &[]);
    wrong("x && y > 1", &[]);
    wrong("x + 'a' == 'b'", &[]);
    wrong("(x > 1) + 1 > 2", &[]);
    wrong("(x > 1) * 2 > 2", &[]);
    wrong("x.y > 1", &[]);
    wrong("x[0] > 1", &[]);
    wrong("x % 2 == 0", &[]);
    wrong("\"[1, 2].all(i, i > x)\"", &[]);
    wrong("\"has(x.y)\"", &[]);
    wrong("\"{'a': 1} == x\"", &[]);
    wrong("x == null", &[]);
    wrong("'x > 1 && yy'", &[]);
    wrong("''", &[]);
}

#[test]
fn hostile_conditions_are_bounded() {
    let deep = format!("\"{}x{} > 1\"", "(".repeat(480), ")".repeat(480));
    let lines = parse("c", &text(&deep)).unwrap_err().lines();
    assert!(lines[0].contains("this is no CEL"), "{lines:?}");
    wrong(&format!("{} > 1", "x+".repeat(600)), &[]);
    let long = format!("\"{}x > 1\"", "x + ".repeat(240));
    assert_eq!(condition(&long).holds(&values()), Ok(true));
    let nots = format!("\"{}on\"", "!".repeat(900));
    assert!(parse("c", &text(&nots)).is_err() || condition(&nots).holds(&values()).is_ok());
}

#[test]
fn inputs_have_names_that_conditions_can_write() {
    let text = |name: &str| {
        format!("groups: [{{ id: a, modules: [{{ id: m, monitor: {{ expression: {{ inputs: {{ {name}: {{ status: s, key: k }} }}, error: 'true' }} }} }}] }}]\n")
    };
    for name in ["'a b'", "9a", "in", "math", "true", "a-b"] {
        let lines = parse("c", &text(name)).unwrap_err().lines();
        let expected = format!(
            "c:1:71: `{}` cannot be the name of an input (use letters, digits and `_`, for example `speed`)",
            name.trim_matches('\'')
        );
        assert_eq!(lines, [expected]);
    }
    let none = "groups: [{ id: a, modules: [{ id: m, monitor: { expression: { inputs: {} } } }] }]\n";
    check(none, &[]);
}
