//! Tests of countermeasures: their requests, and possible mistakes.

use super::*;
use crate::describe::words;

const HEAD: &str = "signals: { braking: { topic: /b, type: std_msgs/msg/Bool } }\ngroups: [{ id: planning, modules: [{ id: m, status: s }] }, { id: execution, modules: [{ id: m, status: t }] }]\n";

#[track_caller]
fn wrong(rule: &str, expected: &[&str]) {
    check(&format!("{HEAD}countermeasures:\n- {rule}\n"), expected);
}

#[test]
fn rules_reach_the_model_with_their_defaults() {
    let cases = [
        (
            "{ request: decelerate, when: { groups: [planning, execution] } }",
            "decelerate by 1 m/s² when planning or execution is error in active",
        ),
        (
            "{ request: decelerate, mps2: 2.5, when: { groups: [planning], modules: [execution/m], state: warning, stages: [cleared, active] }, confirmed_by: { signal: braking } }",
            "decelerate by 2.5 m/s² when planning or execution/m is warning in cleared or active, confirmed by the signal braking within 1s",
        ),
        (
            "{ request: maneuver_stop, when: { modules: [planning/m] }, confirmed_by: { status: 'maneuver: stop' }, within: 500ms }",
            "maneuver_stop when planning/m is error in active, confirmed by the status 'maneuver: stop' within 500ms",
        ),
        ("{ request: notify, when: { groups: [planning] } }", "notify when planning is warning in active"),
        (
            "{ request: notify, when: { groups: [planning], state: error } }",
            "notify when planning is error in active",
        ),
    ];
    for (rule, expected) in cases {
        let loaded = parse("c", &format!("{HEAD}countermeasures: [{rule}]\n"));
        let loaded = loaded.unwrap_or_else(|problems| panic!("{problems}"));
        let [rule] = &loaded.model.driving.countermeasures[..] else { panic!() };
        assert_eq!(words::countermeasure(&loaded.model, rule), expected);
    }
}

#[test]
fn requests_are_known_and_bearable() {
    let when = "when: { groups: [planning] }";
    wrong(
        &format!("{{ request: decelarate, {when} }}"),
        &["4:14: unknown request `decelarate` (did you mean `decelerate`?)"],
    );
    wrong(
        &format!("{{ {when} }}"),
        &["4:3: a countermeasure needs `request` (add `request: decelerate`, `maneuver_stop` or `notify`)"],
    );
    wrong(
        &format!("{{ request: record, {when} }}"),
        &[
            "4:14: a countermeasure asks the vehicle or the operator; recording is neither (remove this countermeasure)",
        ],
    );
    for mps2 in ["0", "-1", "0.09", "3.1"] {
        wrong(
            &format!("{{ request: decelerate, mps2: {mps2}, {when} }}"),
            &[&format!("4:32: {mps2} m/s² is not between 0.1 and 3 (the default is 1)")],
        );
    }
    wrong(
        &format!("{{ request: notify, mps2: 1, {when} }}"),
        &["4:28: only `decelerate` has a strength (remove `mps2`)"],
    );
    wrong("{ request: notify }", &["4:3: a countermeasure needs `when` (add `when: ...`)"]);
    wrong(
        &format!("{{ request: notify, {when}, level: 2 }}"),
        &[
            "4:52: unknown key `level` in a countermeasure (known here: request, mps2, when, confirmed_by, within)",
        ],
    );
}

#[test]
fn rules_watch_nodes_that_there_are() {
    let rule = |when: &str| format!("{{ request: notify, when: {{ {when} }} }}");
    wrong(
        &rule("state: error"),
        &["4:28: this countermeasure watches nothing (add `groups: [...]` or `modules: [...]`)"],
    );
    wrong(
        &rule("groups: [planing]"),
        &["4:39: there is no group or module `planing` (did you mean `planning`?)"],
    );
    wrong(&rule("groups: [planning/m]"), &["4:39: `planning/m` is a module (name it in `modules`)"]);
    wrong(&rule("modules: [planning]"), &["4:40: `planning` is a group (name it in `groups`)"]);
    wrong(
        &rule("groups: [planning, planning]"),
        &["4:49: `planning` is named twice (remove one of the two)"],
    );
    wrong(
        &rule("groups: [planning], state: ok"),
        &["4:57: unknown state `ok` (one of: warning, unknown, error)"],
    );
    wrong(
        &rule("groups: [planning], stages: [activ]"),
        &["4:59: unknown stage `activ` (did you mean `active`?)"],
    );
    wrong(
        &rule("groups: [planning], stages: []"),
        &[
            "4:58: without a stage this would never be asked for (name the stages, or remove `stages`: then it is `[active]`)",
        ],
    );
}

#[test]
fn confirmations_come_from_somewhere() {
    let rule = |rest: &str| format!("{{ request: decelerate, when: {{ groups: [planning] }}, {rest} }}");
    wrong(
        &rule("confirmed_by: { signal: brakin }"),
        &["4:80: there is no signal `brakin` (did you mean `braking`?)"],
    );
    wrong(
        &rule("confirmed_by: { signal: braking, status: s }"),
        &[
            "4:70: a confirmation needs either `signal` or `status` (for example `confirmed_by: { signal: braking }`)",
        ],
    );
    wrong(
        &rule("within: 1s"),
        &["4:64: `within` without `confirmed_by` (add `confirmed_by: { signal: NAME }`, or remove `within`)"],
    );
    wrong(
        &rule("confirmed_by: { signal: braking }, within: 2m"),
        &["4:99: `within` is not between 0 and 1m (for example `1s`)"],
    );
    wrong(
        "{ request: notify, when: { groups: [planning] }, confirmed_by: { signal: braking } }",
        &["4:52: a notice is shown here; nobody else has to confirm it (remove `confirmed_by`)"],
    );
}

#[test]
fn driving_confirms_no_stop() {
    for request in ["decelerate", "maneuver_stop"] {
        let when = "when: { groups: [planning] }";
        let text = "signals: { active: { topic: /b, type: std_msgs/msg/Bool } }\ngroups: [{ id: planning, modules: [{ id: m, status: s }] }]\n";
        let problems = parse(
            "c",
            &format!(
                "{text}countermeasures:\n- {{ request: {request}, {when}, confirmed_by: {{ signal: active }} }}\n"
            ),
        );
        let lines = problems.map(|_| ()).unwrap_err().lines();
        assert!(
            lines.len() == 1 && lines[0].contains("the vehicle drives, which confirms no stop"),
            "{lines:?}"
        );
    }
}

#[test]
fn one_countermeasure_decelerates_for_one_thing() {
    let decelerate = |when: &str| format!("- {{ request: decelerate, mps2: 2, when: {{ {when} }} }}\n");
    let first = decelerate("groups: [planning]");
    for (second, same) in [
        (decelerate("groups: [execution, planning]"), true),
        (decelerate("groups: [planning], stages: [cleared, active]"), true),
        (decelerate("groups: [planning], stages: [cleared]"), false),
        (decelerate("groups: [planning], state: warning"), false),
        (decelerate("groups: [execution]"), false),
        ("- { request: maneuver_stop, when: { groups: [planning] } }\n".to_owned(), false),
    ] {
        let found = parse("c", &format!("{HEAD}countermeasures:\n{first}{second}")).map(|_| ());
        let lines = found.map_err(|problems| problems.lines()).err().unwrap_or_default();
        let fits = lines.iter().any(|line| line.contains("another countermeasure asks to decelerate"));
        assert!(lines.len() == usize::from(same) && fits == same, "{second}: {lines:?}");
    }
}
