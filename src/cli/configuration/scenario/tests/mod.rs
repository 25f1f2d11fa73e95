//! Tests of scenario files: files that are read, files that are refused, and every file in the repository.

mod samples;

use super::*;
use crate::engine::state::State;
use crate::picture::strips::{Segment, Strip};

/// Failures of a scenario, one line each: `line: message`, or what is wrong with the file.
#[track_caller]
fn check(text: &str, expected: &[&str]) {
    let found = match scenario_file::parse("s", text)
        .and_then(|file| run_file(&file).map(|run| (file, run.outcome)))
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

/// Runs every scenario below a folder of the repository and names all that fail. Returns how many there are.
#[track_caller]
fn check_all_below(folder: &str) -> usize {
    let mut folders = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join(folder)];
    let (mut count, mut failed) = (0, String::new());
    while let Some(folder) = folders.pop() {
        let entries = std::fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path());
        let (inner, files): (Vec<PathBuf>, Vec<PathBuf>) = entries.partition(|path| path.is_dir());
        folders.extend(inner);
        for path in files {
            count += 1;
            match scenario_file::load(&path).and_then(|file| run_file(&file).map(|run| (file, run))) {
                Ok((_, run)) if run.outcome.failures.is_empty() => {}
                Ok((file, run)) => failed += &summary(&path, &file, &run.outcome),
                Err(problems) => failed += &problems.to_string(),
            }
        }
    }
    assert!(failed.is_empty(), "{failed}");
    count
}

#[test]
fn every_scenario_that_is_shipped_holds() {
    let count = check_all_below("config/scenarios");
    assert!(count >= 20, "only {count} scenarios were found");
}

/// Those of no shipped vehicle: each is a small vehicle with one situation that is easily got wrong.
#[test]
fn every_scenario_of_the_tests_holds() {
    assert!(check_all_below("tests/scenarios") > 0, "no scenario was found");
}

#[test]
fn a_display_sounds_once_for_each_fault_of_the_paper() {
    // Where nothing is known of dependencies, as in the first, each component sounds. What matters
    // only while the vehicle drives, and it stands, is no fault.
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/scenarios");
    for (name, sounds) in [
        ("1-sensor-outage-without-dependencies", 3),
        ("2-sensor-outage", 1),
        ("3-localization-failure", 1),
        ("4-planner-error-at-a-stop", 0),
        ("5-becoming-active", 0),
        ("6-planner-error-while-active", 1),
    ] {
        let file = scenario_file::load(&folder.join(format!("{name}.yaml")));
        let file = file.unwrap_or_else(|problems| panic!("{problems}"));
        let outcome = run_file(&file).unwrap_or_else(|problems| panic!("{problems}")).outcome;
        assert_eq!(outcome.sounds, sounds, "{name}");
    }
}

#[test]
fn of_a_component_what_comes_at_once_is_one_call_and_a_later_fault_another() {
    for (second_s, sounds) in [("2.3", 1), ("5.9", 1), ("6", 2)] {
        let text = format!(
            "name: n
config: {{ vehicle: {{ stages: none }}, groups: [{{ id: a, modules: [{{ id: m, status: s }}, {{ id: n, status: t }}] }}] }}
steps:
  - {{ at: 0, every: 0.1, until: 0.9, status: {{ name: s, level: ok }} }}
  - {{ at: 1, every: 0.1, status: {{ name: s, level: error }} }}
  - {{ at: 0, every: 0.1, until: {second_s}, status: {{ name: t, level: ok }} }}
  - {{ at: {second_s}, every: 0.1, status: {{ name: t, level: error }} }}
expect: [{{ at: 9, alarms: 2 }}]
"
        );
        let file = scenario_file::parse("s", &text).unwrap_or_else(|problems| panic!("{problems}"));
        let outcome = run_file(&file).unwrap_or_else(|problems| panic!("{problems}")).outcome;
        assert_eq!((outcome.sounds, outcome.failures.len()), (sounds, 0), "{second_s} s");
    }
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
            "5:24: at 1 s, a: expected ok, got error (a shows error; its members' own states make error; a/m shows error; itself error, heard at 1 s, \"broken\")",
            "5:40: at 1 s, the own state of a/m: expected warning, got error (a/m shows error; itself error, heard at 1 s, \"broken\")",
            "5:66: at 1 s, the count of a: expected 1/1, got 0/1 (a shows error; its members' own states make error; a/m shows error; itself error, heard at 1 s, \"broken\")",
            "5:84: at 1 s, the number of alarms: expected 2, got 1",
            "6:25: at 2.5 s, the root causes of a: expected [], got [a/m] (a shows error; its members' own states make error; a/m shows error; itself error, heard at 1 s, \"broken\")",
            "6:45: at 2.5 s, the reason of a: expected masked, got none (a shows error; its members' own states make error; a/m shows error; itself error, heard at 1 s, \"broken\")",
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
fn a_scenario_that_cannot_fail_is_refused() {
    let expected = "1:1: this scenario expects nothing, so it cannot fail (add `expect: [{ at: 1, groups: { NAME: ok } }]`, or `figure: { nodes: [NAME] }` if it is only drawn)";
    for text in ["", "expect: []\n", "steps: [{ at: 1, status: { name: s, level: ok } }]\n"] {
        check_run(text, &[expected]);
    }
    check_run("figure: { nodes: [a] }\n", &[]);
}

#[test]
fn a_refused_action_is_a_failure_only_where_it_is_said() {
    check_run("steps: [{ at: 1, operator: { reset: a/m } }]\nfigure: {}\n", &[]);
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
        "start: { stage: parked }\ndependencies: of\nstep: []\n",
        &[
            "3:17: unknown stage `parked` (one of: locked, localizing, standby, cleared, active)",
            "4:15: unknown switch `of` (one of: on, off)",
            "5:1: unknown key `step` in a scenario (did you mean `steps`?)",
        ],
    );
    check_run(
        "figure: { nodes: [a, b], signals: [active], from: 2, to: 1, event: x, strips: 3 }\n",
        &[
            "3:9: the figure ends before it begins (exchange `from` and `to`)",
            "3:9: `event` without `zero` (add `zero: 3`, when it happens)",
            "3:22: the configuration has no group or module `b` (write the full name)",
            "3:36: the configuration has no signal `active` (declare it under `signals`)",
            "3:71: unknown key `strips` in a figure (known here: from, to, zero, nodes, signals, event)",
        ],
    );
    check_run(
        "figure: { nodes: [a, b], signals: [active] }\n",
        &[
            "3:22: the configuration has no group or module `b` (write the full name)",
            "3:36: the configuration has no signal `active` (declare it under `signals`)",
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
  - { at: 1, sample: { stamp: 1, delay: 2 } }
  - { at: 1, operator: { clearance: now } }
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
            "8:5: a step needs one of status, others, signal, operator, sample, publishers, listeners, probe, clock_step (write one step for each thing that happens)",
            "9:5: a step needs one of status, others, signal, operator, sample, publishers, listeners, probe, clock_step (write one step for each thing that happens)",
            "10:22: a sample needs `topic` (add `topic: ...`)",
            "10:41: a sample has either `stamp` or `delay` (remove one of the two)",
            "11:37: unknown truth value `now` (one of: true, false)",
            "12:26: unknown key `logn` in an operator's action (did you mean `login`?)",
            "14:5: this expects nothing (add `groups: { sensors: error }`, or remove it)",
            "15:27: unknown state `good` (one of: ignore, ok, warning, unknown, error)",
            "15:48: expected a count, found `2` (write how many are OK of how many that count: `2/3`)",
            "15:69: unknown countermeasure `stop` (one of: none, notify, maneuver_stop, decelerate)",
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
    let outcome = run_file(&file).unwrap().outcome;
    let value = json(Path::new("s"), &file, &outcome);
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

/// A panel in words: each strip with its segments.
fn described(panel: &Panel) -> Vec<String> {
    let segment = |segment: &Segment| {
        let own = segment.own.filter(|own| *own > State::Ok).map_or(String::new(), |own| format!("+{own}"));
        let cause = segment.cause.as_ref().map_or(String::new(), |cause| format!("({cause})"));
        format!("{} {:?}{own}{cause}", seconds(segment.from), segment.look)
    };
    let strip = |strip: &Strip| {
        format!("{}: {}", strip.label, strip.segments.iter().map(segment).collect::<Vec<_>>().join(", "))
    };
    panel.strips.iter().map(strip).collect()
}

#[test]
fn a_figure_shows_attributed_symptoms_and_what_lies_behind_an_ignore() {
    let text = "name: a <b> & \"c\"
config:
  vehicle: { stages: none }
  signals: { active: { topic: /a, type: std_msgs/msg/Bool } }
  groups:
    - { id: a, modules: [{ id: m, status: a }] }
    - { id: b, depends_on: [a], modules: [{ id: m, status: b }] }
    - { id: c, when: { signals: { active: true } }, modules: [{ id: m, status: c }] }
figure: { nodes: [a, b, b/m, c, c/m], signals: [active], from: 1, to: 8, zero: 2, event: it breaks }
steps:
  - { at: 0, signal: { active: false } }
  - { at: 0, every: 0.5, until: 8, others: ok }
  - { at: 0, every: 0.5, until: 2.5, status: [{ name: a, level: ok }, { name: b, level: ok }] }
  - { at: 3, every: 0.5, until: 5, status: { name: b, level: error } }
  - { at: 4, every: 0.5, until: 6, status: { name: a, level: error } }
  - { at: 6.5, every: 0.5, status: { name: a, level: warning } }
  - { at: 3, every: 0.5, until: 3.5, status: { name: a, level: ok } }
  - { at: 5.5, every: 0.5, status: { name: b, level: stale } }
";
    let file = scenario_file::parse("s", text).unwrap_or_else(|problems| panic!("{problems}"));
    let panel = run_file(&file).unwrap_or_else(|problems| panic!("{problems}")).panel;
    assert_eq!(
        described(&panel),
        [
            "a: 1 s Ok, 4 s Error, 6.5 s Warning",
            "b: 1 s Ok, 3 s Attributed(a/m), 4 s Masked+error(a/m), 5.5 s Masked+unknown(a/m), 6.5 s Unknown",
            "m: 1 s Ok, 3 s Attributed(a/m), 4 s Masked+error(a/m), 5.5 s Masked+unknown(a/m), 6.5 s Unknown",
            "c: 1 s NotRelevant",
            "m: 1 s NotRelevant",
            "active: 1 s False",
        ]
    );
    assert_eq!(panel.moved.iter().map(|it| (it.symptom, it.cause)).collect::<Vec<_>>(), [(2, 0)]);
    let drawn = figure::draw(&[panel.clone(), panel]);
    assert!(drawn.contains("(b) a &lt;b&gt; &amp; &quot;c&quot;"), "{drawn}");
    for class in ["ok", "warning", "error", "attributed", "masked", "not-relevant", "unknown", "false"] {
        assert!(drawn.contains(&format!("class=\"bar bar-{class}\"")), "{class}");
    }
}

#[test]
fn a_figure_without_strips_or_time_is_still_a_figure() {
    for text in
        ["figure: {}\n", "steps: [{ at: 0, status: { name: s, level: ok } }]\nfigure: { nodes: [a] }\n"]
    {
        let file = scenario_file::parse("s", &format!("{HEAD}{text}")).unwrap();
        let panel = run_file(&file).unwrap().panel;
        let drawn = figure::draw(&[panel]);
        assert!(drawn.ends_with("</svg>\n") && !drawn.contains("NaN"), "{drawn}");
    }
    assert!(figure::draw(&[]).ends_with("</svg>\n"));
}

#[test]
fn a_wrong_key_hides_no_unknown_name() {
    check_run(
        "tolerance: 1\nexpect: [{ at: 1, groups: { b: ok } }]\n",
        &[
            "3:1: unknown key `tolerance` in a scenario (known here: config, name, dependencies, start, steps, expect, figure)",
            "4:29: the configuration has no group or module `b` (write the full name)",
        ],
    );
}
