use super::*;

/// Failures of a scenario, one line each: `line: message`, or what is wrong with the file.
#[track_caller]
fn check(text: &str, expected: &[&str]) {
    let found = match scenario_file::parse("s", text)
        .and_then(|file| run_file(&file).map(|outcome| (file, outcome)))
    {
        Ok((file, outcome)) => {
            let failures = outcome.failures.iter().map(problem).collect();
            Problems::new(file.sources, failures).lines()
        }
        Err(problems) => problems.lines(),
    };
    let found: Vec<&str> = found.iter().map(|line| line.strip_prefix("s:").unwrap_or(line)).collect();
    assert_eq!(found, expected);
}

/// A vehicle with one module, always active.
const HEAD: &str = "name: n
config: { vehicle: { stages: none }, groups: [{ id: a, modules: [{ id: m, status: s }] }] }
";

#[track_caller]
fn check_run(text: &str, expected: &[&str]) {
    check(&format!("{HEAD}{text}"), expected);
}

#[test]
fn every_scenario_that_is_shipped_holds() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/scenarios");
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let file = scenario_file::load(&path).unwrap_or_else(|problems| panic!("{problems}"));
        let outcome = run_file(&file).unwrap_or_else(|problems| panic!("{problems}"));
        assert!(outcome.failures.is_empty(), "{}", summary(&path, &file, &outcome));
        count += 1;
    }
    assert!(count >= 13, "only {count} scenarios were found");
}

#[test]
fn a_failure_says_expected_got_and_why() {
    check_run(
        "steps: [{ at: 1, status: { name: s, level: error, message: broken } }]
expect:
  - { at: 1, groups: { a: ok }, own: { a/m: warning }, counts: { a: 1/1 }, alarms: 2 }
  - { at: 2.5, roots: { a: [] }, reasons: { a: masked }, stage: standby, overall: ok, ranking: [] }
",
        &[
            "5:24: at 1 s, a: expected ok, got error (a shows error; its members' own states make error\na/m shows error; itself error, heard at 1 s, \"broken\")",
            "5:40: at 1 s, the own state of a/m: expected warning, got error (a/m shows error; itself error, heard at 1 s, \"broken\")",
            "5:66: at 1 s, the count of a: expected 1/1, got 0/1 (a shows error; its members' own states make error\na/m shows error; itself error, heard at 1 s, \"broken\")",
            "5:84: at 1 s, the number of alarms: expected 2, got 1",
            "6:25: at 2.5 s, the root causes of a: expected [], got [a/m] (a shows error; its members' own states make error\na/m shows error; itself error, heard at 1 s, \"broken\")",
            "6:45: at 2.5 s, the reason of a: expected masked, got none (a shows error; its members' own states make error\na/m shows error; itself error, heard at 1 s, \"broken\")",
            "6:65: at 2.5 s, the stage: expected standby, got active",
            "6:83: at 2.5 s, the vehicle: expected ok, got error",
            "6:96: at 2.5 s, the ranking of root causes: expected [], got [a/m]",
        ],
    );
}

#[test]
fn at_one_instant_deadlines_act_first_then_steps_then_expectations() {
    // At 2 s the first status is stale; the second arrives in the same instant, and is what counts.
    check_run(
        "steps:
  - { at: 0, status: { name: s, level: ok } }
  - { at: 2, status: { name: s, level: error } }
  - { at: 2, status: { name: s, level: ok } }
expect: [{ at: 2, modules: { a/m: ok }, alarms: 1 }]
",
        &[],
    );
}

#[test]
fn repetitions_do_not_drift() {
    // 2 s of silence after the last of them, to the nanosecond.
    check_run(
        "steps: [{ at: 0, every: 0.1, until: 1000, status: { name: s, level: ok } }]
expect:
  - { at: 1001.999999999, modules: { a/m: ok } }
  - { at: 1002, modules: { a/m: unknown } }
",
        &[],
    );
}

#[test]
fn a_refused_action_is_a_failure_only_where_it_is_said() {
    check_run("steps: [{ at: 1, operator: { reset: a/m } }]\n", &[]);
    check_run(
        "steps: [{ at: 1, operator: { reset: a/m }, refused: false }]\n",
        &["3:9: at 1 s, the operator's action: expected granted, got refused ([NotLatched(\"a/m\")])"],
    );
    check_run(
        "steps: [{ at: 1, operator: logout, refused: true }]\n",
        &["3:9: at 1 s, the operator's action: expected refused, got granted"],
    );
}

#[test]
fn names_must_be_those_of_the_configuration() {
    check_run(
        "steps: [{ at: 0, signal: { active: true } }]\nexpect: [{ at: 0, groups: { b: ok }, modules: { a/n: ok, x/mm: ok, other/z: ok }, roots: { a: [a/mm] } }]\n",
        &[
            "3:28: the configuration has no signal `active` (declare it under `signals`)",
            "4:29: the configuration has no group or module `b` (write the full name)",
            "4:49: the configuration has no group or module `a/n` (did you mean `a/m`?)",
            "4:58: the configuration has no group or module `x/mm` (write the full name)",
            "4:92: the configuration has no group or module `a/mm` (did you mean `a/m`?)",
        ],
    );
}

#[test]
fn a_file_that_is_wrong_says_where() {
    check(
        "steps: []\n",
        &[
            "1:1: a scenario needs `config` (add `config: ../shuttle.yaml`, or the configuration itself)",
            "1:1: a scenario needs `name` (add `name: ...`)",
        ],
    );
    check_run(
        "start: { stage: cleared }\ndependencies: of\nstep: []\n",
        &[
            "3:17: starting in this stage is not supported by this version (remove it)",
            "4:15: unknown switch `of` (one of: on, off)",
            "5:1: unknown key `step` in a scenario (did you mean `steps`?)",
        ],
    );
    check_run(
        "steps:
  - { at: 1s, status: { name: s, level: good } }
  - { at: 1, every: 0, status: { name: s, level: ok } }
  - { at: 1, until: 2, status: { name: s, level: ok } }
  - { at: 3, every: 1, until: 2, status: { name: s, level: ok } }
  - { at: 1 }
  - { at: 1, status: { level: ok }, signal: {} }
  - { at: 1, sample: { topic: /t } }
  - { at: 1, operator: { clearance: } }
  - { at: 1, operator: { logn: a } }
expect:
  - { at: 1 }
  - { at: 1, groups: { a: good }, counts: { a: 2 }, countermeasure: stop }
",
        &[
            "4:11: expected seconds, found `1s` (write a number without a unit, for example `3.5`)",
            "4:41: unknown level `good` (one of: ok, warning, error, stale)",
            "5:21: `every` must be above 0 (for example `every: 0.1`)",
            "6:21: `until` without `every` (add `every: 0.1`, or remove `until`)",
            "7:31: `until` is before `at` (exchange them)",
            "8:5: a step needs one of status, others, signal, operator, sample, clock_step (write one step for each thing that happens)",
            "9:5: a step needs one of status, others, signal, operator, sample, clock_step (write one step for each thing that happens)",
            "10:22: `sample` is not supported by this version (remove it)",
            "11:35: `clearance` is not supported by this version (remove it)",
            "12:26: unknown key `logn` in an operator's action (did you mean `login`?)",
            "14:5: this expects nothing (add `groups: { sensors: error }`, or remove it)",
            "15:27: unknown state `good` (one of: ignore, ok, warning, unknown, error)",
            "15:48: expected a count, found `2` (write how many are OK of how many that count: `2/3`)",
            "15:69: `countermeasure` is not supported by this version (remove it)",
        ],
    );
    check_run(
        "steps: [{ at: 0, every: 0.000001, until: 100, status: { name: s, level: ok } }]\n",
        &["3:9: the steps repeat more than 10000000 times (choose a longer `every` or an earlier `until`)"],
    );
    check(
        "name: n\nconfig: { groups: [{ id: a, dependson: [b], match: [{ name: n }] }] }\n",
        &["2:29: unknown key `dependson` in a group (did you mean `depends_on`?)"],
    );
}

#[test]
fn transitions_say_when_each_node_changed() {
    let text = format!(
        "{HEAD}steps: [{{ at: 1.5, status: {{ name: s, level: ok }} }}]\nexpect: [{{ at: 4, groups: {{ a: unknown }} }}]\n"
    );
    let file = scenario_file::parse("s", &text).unwrap();
    let outcome = run_file(&file).unwrap();
    let value: serde_json::Value = serde_json::from_str(&json(Path::new("s"), &file, &outcome)).unwrap();
    let changes: Vec<String> = value["transitions"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|change| change["node"] == "a/m")
        .map(|change| format!("{} {}", change["at_s"], change["state"].as_str().unwrap()))
        .collect();
    assert_eq!(changes, ["0.0 unknown", "1.5 ok", "3.5 unknown"]);
    assert_eq!(value["ok"], true);
}
