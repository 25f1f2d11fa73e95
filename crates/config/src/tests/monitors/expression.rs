//! Tests of conditions in CEL: their meaning, and mistakes that are found without values.

use super::*;
use telltale_engine::model::MonitorSpec;
use telltale_engine::model::monitors::Condition;
use telltale_engine::model::sample::{FieldValue, Pose};

fn text(condition: &str) -> String {
    let inputs =
        ["x", "y", "on", "word"].map(|name| format!("{name}: {{ status: s, key: {name} }}")).join(", ");
    format!(
        "groups:\n- id: a\n  modules:\n  - id: m\n    monitor:\n      expression:\n        inputs: {{ {inputs} }}\n        error: {condition}\n"
    )
}

fn condition(condition: &str) -> Condition {
    let loaded = parse("c", &text(condition)).unwrap_or_else(|problems| panic!("{problems}"));
    let Some(MonitorSpec::Expression { error, .. }) = loaded.model.modules[0].monitor.other() else {
        panic!()
    };
    error.clone().unwrap()
}

/// x is 2.5, y is 4, on is true, word is `ready`.
fn values() -> [FieldValue; 4] {
    [
        FieldValue::Number(2.5),
        FieldValue::Number(4.0),
        FieldValue::Bool(true),
        FieldValue::Text("ready".into()),
    ]
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
        ("x * 2 in [4, 5] && !(x * 2 in [4])", true),
        ("y in [x, 4, (x - x) / 0]", true),
        ("x * 2 in []", false),
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
        ("math.isNaN(0 / 0)", true),
        ("x * 2 != 5", false),
    ];
    for (written, expected) in cases {
        assert_eq!(condition(&format!("\"{written}\"")).holds(&values()), Ok(expected), "{written}");
    }
}

#[test]
fn without_an_answer_there_is_a_reason() {
    let cases = [
        ("x", "`x` is a number, not a truth value"),
        // What is of another kind is unlike everything, which would be no answer to the question.
        ("x == 'x'", "`x` is a number, not a text"),
        ("x in ['1', '2.5']", "`x` is a number, not a text"),
        ("word == 5", "`word` is a text, not a number"),
        ("x == true", "`x` is a number, not a truth value"),
        ("(x - x) / 0 == 0", ""),
        ("(x - x) / 0 != 0", ""),
        ("(x - x) / 0 in [1, 2]", ""),
        ("x in [1, (x - x) / 0]", ""),
        ("word > 3", "`word` is a text, not a number"),
        ("word > x", "no matching overload"),
        ("word * 2 > 3", "`word` is a text, not a number"),
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
    assert!(condition("x > 1").holds(&[FieldValue::Number(f64::NAN)]).is_err());
}

#[test]
fn what_is_wrong_is_said_with_its_place() {
    wrong("x >", &["18: this is no CEL: mismatched input the end (for example `speed > 3 && !stopped`)"]);
    wrong("spede > 3", &["16: there is no input `spede` (the inputs are: x, y, on, word)"]);
    wrong("worrd == 'a'", &["16: there is no input `worrd` (did you mean `word`?)"]);
    wrong("maths.abs(x) > 1", &["25: there is no function `maths.abs` (did you mean `math.abs`?)"]);
    wrong("math.abz(x) > 1", &["24: there is no function `math.abz` (did you mean `math.abs`?)"]);
    wrong("'x > 1 ? 1 : 2'", &["23: a condition must be true or false (compare it: `... > 0`)"]);
    wrong("\"on ? 'a' : 3\"", &["28: this is a number, not a text (correct one of the parts)"]);
    wrong("x > 1 == 3", &["25: this is a number, not a truth value (correct one of the parts)"]);
    wrong("math.abs('a') > 1", &["25: this is a text, not a number (correct one of the parts)"]);
    wrong("x + 1", &["18: a condition must be true or false (compare it: `... > 0`)"]);
    wrong(
        "(x > 1) + 1 > 2",
        &[
            "26: this is a number, not a truth value (correct one of the parts)",
            "30: this is a number, not a truth value (correct one of the parts)",
        ],
    );
    wrong("(x > 1) * 2 > 2", &["19: this is a truth value, not a number (correct one of the parts)"]);
    wrong("x.y > 1", &["17: an input has no members (name the field in the input's `field`)"]);
    wrong(
        "x[0] > 1",
        &[
            "17: there is no function `[_]` (an input is one value: choose the element in the input's `field`)",
        ],
    );
    wrong("x % 2 == 0", &["18: there is no function `%` (numbers are not whole here; compare with a limit)"]);
    wrong(
        "\"[1, 2].all(i, i > x)\"",
        &[
            "27: `exists` and `all` take an input, a name and a condition (write `goals.exists(goal, goal.status == 6)`, or `all` for every element)",
        ],
    );
    wrong(
        "\"has(x.y)\"",
        &[
            "20: there is no function `has` (the functions are: contains, startsWith, endsWith, double, math.abs, math.sign, math.sqrt, math.floor, math.ceil, math.round, math.trunc, math.greatest, math.least, math.isNaN)",
        ],
    );
    wrong(
        "\"{'a': 1} == x\"",
        &["17: this is not supported (an input is a number, a truth value or a text)"],
    );
    wrong("x == null", &["21: no input is like this (compare with a number, a truth value or a text)"]);
    wrong(
        "\"x == 'a' || x > 3\"",
        &[
            "29: `x` is taken for a number here and for a text elsewhere (give each its own input, or compare it with one kind of value)",
        ],
    );
    wrong(
        "\"x in ['a', 3]\"",
        &[
            "17: `x` is taken for a number here and for a text elsewhere (give each its own input, or compare it with one kind of value)",
        ],
    );
    let words = "(write `&&` for and, `||` for or, `!` for not)";
    wrong("x > 1 and y > 2", &[&format!("22: CEL has no `and` {words}")]);
    wrong("x > 1 OR on", &[&format!("22: CEL has no `or` {words}")]);
    wrong("not on", &[&format!("16: CEL has no `not` {words}")]);
    wrong("not (on)", &[&format!("20: there is no function `not` {words}")]);
    wrong(
        "word == 'this and that' && x >",
        &["45: this is no CEL: mismatched input the end (for example `speed > 3 && !stopped`)"],
    );
    wrong("'x > 1 && yy'", &["26: there is no input `yy` (the inputs are: x, y, on, word)"]);
    wrong("''", &["16: expected a text, found nothing (write a value)"]);
}

#[test]
fn conditions_that_contradict_themselves_are_refused() {
    let help = "(correct one of the two, or remove it)";
    let never = |at: u32, a: &str, b: &str| {
        format!("{at}: `{a}` and `{b}` exclude each other: together they never hold {help}")
    };
    wrong("x > 5 && x < 3", &[&never(25, "x > 5", "x < 3")]);
    wrong("x > 5 && on && x <= 5", &[&never(31, "x > 5", "x <= 5")]);
    wrong("on || (x == 5 && 6 == x)", &[&never(33, "x == 5", "x == 6")]);
    wrong("x < -3 && x > -2", &[&never(26, "x < -3", "x > -2")]);
    wrong("\"word == 'a' && word == 'b'\"", &[&never(32, "word == 'a'", "word == 'b'")]);
    wrong(
        "x > 3 || x < 5",
        &[&format!("25: whatever fails `x > 3` meets `x < 5`: together they always hold {help}")],
    );
    wrong(
        "\"word != 'a' || word != 'b'\"",
        &[&format!("32: whatever fails `word != 'a'` meets `word != 'b'`: together they always hold {help}")],
    );
    wrong("x > y && x < y", &[&never(25, "x > y", "x < y")]);
    wrong("x > y && y >= x", &[&never(25, "x > y", "x <= y")]);
    wrong("on && !on", &[&never(23, "on", "!on")]);
    wrong("on == false && x > 1 && on", &[&never(40, "!on", "on")]);
    wrong("math.abs( x ) > 5 && math.abs(x) < 3", &[&never(45, "math.abs(x) > 5", "math.abs(x) < 3")]);
    wrong(
        "math.abs(x - y) == 5 && math.abs(x-y) == 3",
        &[&never(48, "math.abs(x - y) == 5", "math.abs(x - y) == 3")],
    );
    wrong("on || !on", &[&format!("23: whatever fails `on` meets `!on`: together they always hold {help}")]);
    for fine in [
        "x > 3 && x < 5",
        "x >= y && x <= y",
        "x - y > 3 && y - x > 3",
        "on && x > 1 || !on && x > 2",
        "on == false || x > 1 && on",
        "math.abs(x) > 3 && math.abs(y) < 3",
        "x >= 5 && x <= 5",
        "x > 5 && y < 3",
        "x > 5 || x < 3",
        "x != 3 && x != 4",
        "x == 3 || x == 4",
        "x < 3 || y > 2 && x > 5",
        "\"word != 'a' && word != 'b'\"",
        "math.abs(x) > 5 && x < 3",
    ] {
        condition(fine);
    }
}

#[test]
fn both_conditions_take_an_input_for_the_same() {
    check(
        "groups: [{ id: a, modules: [{ id: m, monitor: { expression: { inputs: { x: { status: s, key: k } }, warning: x > 3, error: x == 'a' } } }] }]\n",
        &[
            "1:124: `x` is taken for a number in `warning` and for a text in `error` (give each its own input)",
        ],
    );
}

#[test]
fn a_warning_that_is_always_an_error_is_refused() {
    let of = |warning: &str, error: &str| {
        let inputs = "x: { status: s, key: k }, t: { status: s, key: t }, u: { status: s, key: u }";
        let monitor =
            format!("expression: {{ inputs: {{ {inputs} }}, warning: {warning:?}, error: {error:?} }}");
        let text = format!("groups: [{{ id: a, modules: [{{ id: m, monitor: {{ {monitor} }} }}] }}]\n");
        parse("c", &text).map_or_else(|problems| problems.lines(), |_| Vec::new())
    };
    for (warning, error) in [
        ("x > 9", "x > 5"),
        ("x > 5", "x > 5"),
        ("x > 9 && t", "x > 5"),
        ("x == 7", "x > 5 || x < 0"),
        ("t", "u || t"),
        ("t && u", "u && t"),
        ("math.abs(x) > 3", "math.abs(x)>2.5"),
    ] {
        let lines = of(warning, error);
        assert!(
            lines.len() == 1
                && lines[0].ends_with(
                    "wherever this WARNING holds, `error` holds too: it never shows (let the WARNING begin before the ERROR does, or remove it)"
                ),
            "{warning} {error}: {lines:?}"
        );
    }
    for (warning, error) in [
        ("x > 5", "x > 9"),
        ("x > 9", "x > 5 && t"),
        ("x > 9 || t", "x > 5"),
        ("x < 3", "x > 5"),
        ("t", "!t && x > 1"),
        ("x > 3", "math.abs(x) > 2"),
    ] {
        assert_eq!(of(warning, error), [""; 0], "{warning} {error}");
    }
}

#[test]
fn hostile_conditions_are_bounded() {
    let deep = format!("\"{}x{} > 1\"", "(".repeat(480), ")".repeat(480));
    let lines = parse("c", &text(&deep)).unwrap_err().lines();
    assert!(lines[0].contains("this is no CEL"), "{lines:?}");
    wrong(
        &format!("{} > 1", "x+".repeat(600)),
        &[
            "16: a condition of more than 1000 bytes (let a node of your own diagnose this, and read its status)",
        ],
    );
    let long = format!("\"{}x > 1\"", "x + ".repeat(240));
    assert_eq!(condition(&long).holds(&values()), Ok(true));
    let nots = format!("\"{}on\"", "!".repeat(900));
    assert!(parse("c", &text(&nots)).is_err() || condition(&nots).holds(&values()).is_ok());
}

#[test]
fn inputs_have_names_that_conditions_can_write() {
    let text = |name: &str| {
        format!(
            "groups: [{{ id: a, modules: [{{ id: m, monitor: {{ expression: {{ inputs: {{ {name}: {{ status: s, key: k }} }}, error: 'true' }} }} }}] }}]\n"
        )
    };
    for name in ["'a b'", "9a", "in", "math", "true", "a-b"] {
        let lines = parse("c", &text(name)).unwrap_err().lines();
        let expected = format!(
            "c:1:73: `{}` cannot be the name of an input (use letters, digits and `_`, for example `speed`)",
            name.trim_matches('\'')
        );
        assert_eq!(lines, [expected]);
    }
    let none = "groups: [{ id: a, modules: [{ id: m, monitor: { expression: { inputs: {} } } }] }]\n";
    check(
        none,
        &[
            "1:61: an expression needs `warning` or `error` (for example `error: x > 3 && !stopped`)",
            "1:63: 0 inputs, not 1 to 32 (name what the conditions use: `x: { topic: /t, type: T, field: PATH }`)",
        ],
    );
}

proptest::proptest! {
    #[test]
    fn any_text_is_a_condition_or_is_refused(parts in proptest::collection::vec(0..TOKENS.len(), 0..24), gap in 0..2_usize) {
        let written: Vec<&str> = parts.into_iter().map(|part| TOKENS[part]).collect();
        let written = written.join(if gap == 0 { "" } else { " " }).replace('\\', "\\\\").replace('"', "\\\"");
        match parse("c", &text(&format!("\"{written}\""))) {
            Err(problems) => assert!(!problems.render(false).is_empty()),
            Ok(loaded) => {
                let Some(MonitorSpec::Expression { error, .. }) = loaded.model.modules[0].monitor.other() else { panic!() };
                let _ = error.clone().unwrap().holds(&values());
            }
        }
    }
}

const TOKENS: [&str; 48] = [
    "x",
    "y",
    "on",
    "word",
    "true",
    "1",
    "2.5",
    "1e400",
    "0x1F",
    "9223372036854775808",
    "-9223372036854775808",
    "7u",
    "'a'",
    "\"b\"",
    "'\\u00e4'",
    "'\\",
    "b'x'",
    "r'\\d'",
    "'''",
    "ä",
    "\u{1F600}",
    "\n",
    "(",
    ")",
    "[",
    "]",
    "{",
    "}",
    ",",
    ".",
    ":",
    "?",
    "+",
    "-",
    "*",
    "/",
    "%",
    "&&",
    "||",
    "!",
    "==",
    ">",
    "<=",
    "in",
    "math.abs(",
    "math.greatest(",
    "contains(",
    "`",
];

#[test]
fn what_cannot_be_read_is_not_said_to_be_missing_too() {
    for text in [
        "signals: { a: { inputs: { x: 5 }, when: 'x == 1' } }\ngroups: [{ id: g, match: [{ name: n }] }]\n",
        "groups: [{ id: g, modules: [{ id: m, monitor: { expression: { inputs: { x: 5 }, error: 'x > 3' } } }] }]\n",
        "groups: [{ id: g, modules: [{ id: m, monitor: { expression: { inputs: { x: 5, y: { status: s, key: y } }, error: 'x > y' } } }] }]\n",
        "diagnostics: { topics: [[]] }\ngroups: [{ id: g, match: [{ name: n }] }]\n",
        "groups: [{ id: g, match: [{ name: n }] }]\ncountermeasures: [{ request: maneuver_stop, when: { groups: [[]] } }]\n",
    ] {
        let lines = parse("c", text).map_or_else(|problems| problems.lines(), |_| Vec::new());
        assert_eq!(lines.len(), 1, "{lines:?}");
        assert!(lines[0].contains("expected"), "{lines:?}");
    }
}
