//! Tests of the warnings of `telltale check`.

use crate::parse;
use crate::soundness::{Soundness, look};
use telltale_engine::model::{GroupSpec, Model, ModuleId, NodeId};

const SIGNALS: &str = "signals:
  active: { topic: /active, type: std_msgs/msg/Bool }
  doors: { topic: /doors, type: std_msgs/msg/Bool }
";

/// All warnings of a list of groups, as `line:column: message (what to do)`, lines from that of `groups:`.
#[track_caller]
fn check(groups: &str, expected: &[&str]) -> Soundness {
    let text = format!("{SIGNALS}{groups}");
    let loaded = parse("c", &text).unwrap_or_else(|problems| panic!("{problems}"));
    let (found, problems) = loaded.soundness();
    let lines = problems.map_or_else(Vec::new, |problems| problems.lines());
    let from_groups = |line: &String| {
        let mut parts = line.splitn(3, ':');
        let (_, number, rest) = (parts.next(), parts.next().unwrap(), parts.next().unwrap());
        format!("{}:{rest}", number.parse::<usize>().unwrap() - 3)
    };
    let lines: Vec<String> = lines.iter().map(from_groups).collect();
    assert_eq!(lines, expected);
    assert!(found.complete);
    found
}

#[test]
fn a_sound_vehicle_has_no_warnings() {
    let found = check(
        "groups:
  - { id: a, combine: any, modules: [{ id: m, status: a }, { id: n, status: b }] }
  - { id: b, depends_on: [a, { any_of: [c, d] }], when: { signals: { doors: true } }, modules: [{ id: m, status: c }] }
  - { id: c, match: [{ contains: c }], when: { stages: [locked, standby, active] } }
  - { id: d, modules: [{ id: m, status: d, when: { signals: { active: true } } }] }
",
        &[],
    );
    // Four stages in which nobody drives, with the doors open, shut and unknown; then the same while
    // driving. Not driving may be unknown.
    assert_eq!(found.situations, 4 * 2 * 3 + 3);
}

#[test]
fn the_shuttle_is_sound() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/shuttle.yaml");
    let loaded = crate::load(&path).unwrap();
    assert_eq!(look(&loaded.model).findings, []);
    // The sensors serve several components (paper, Fig. 4).
    let lidar = module(&loaded.model, "sensors/velodyne_packet_alive");
    let serves = |group: &GroupSpec| group.depends_on.iter().any(|it| it.on.nodes() == [lidar]);
    let served = loaded.model.groups.iter().filter(|group| serves(group)).map(|group| &*group.path);
    assert_eq!(served.collect::<Vec<_>>(), ["localization", "perception"]);
}

fn module(model: &Model, id: &str) -> NodeId {
    let found = model.modules.iter().position(|module| &*module.id == id);
    NodeId::Module(ModuleId(found.expect("the vehicle has it") as u32))
}

/// Whole groups would hide what has nothing to do with a fault: Localization does not use the camera.
#[test]
fn the_shipped_vehicles_depend_on_single_modules() {
    for name in ["shuttle.yaml", "self-diagnosing-shuttle.yaml", "robot.yaml"] {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config").join(name);
        let model = crate::load(&path).unwrap().model;
        let of_groups = model.groups.iter().flat_map(|group| &group.depends_on);
        let of_modules = model.modules.iter().flat_map(|module| &module.depends_on);
        for dependency in of_groups.chain(of_modules) {
            let is_module = |node: &NodeId| matches!(node, NodeId::Module(_));
            assert!(dependency.on.nodes().iter().all(is_module), "{name}: {dependency:?}");
        }
        assert_eq!(look(&model).findings, [], "{name}");
    }
}

#[test]
fn expressions_that_look_at_nothing() {
    let module = |id: &str, inputs: &str, conditions: &str| {
        let expression = format!("{{ inputs: {{ {inputs} }}, max_age: 1s, {conditions} }}");
        format!("      - id: {id}\n        monitor:\n          expression: {expression}\n")
    };
    let x = "x: { topic: /x, type: std_msgs/msg/Float64, field: data }";
    let both = format!("{x}, y: {{ status: s, key: k }}");
    let modules = [
        module("m0", x, "error: 'x > 1 && math.abs(x) < 9'"),
        module(
            "m1",
            &both,
            "class: { location: contextual, information: content, flow: parallel }, error: x > 1",
        ),
        module(
            "m2",
            &both,
            "class: { location: contextual, information: content, flow: sequential }, error: x > 1, warning: 'y in [1, 2]'",
        ),
        module("m3", x, "error: 1 > 2, warning: x > 1"),
        module("m4", x, "error: 'true'"),
    ];
    check(
        &format!("groups:\n  - id: a\n    modules:\n{}", modules.concat()),
        &[
            "7:13: no condition of `a/m1` looks at its input `y` (use it in `error` or `warning`, or remove it)",
            "13:13: the condition `1 > 2` of `a/m3` looks at no input: it never holds (compare an input: `... > 0`)",
            "16:13: the condition `true` of `a/m4` looks at no input: it always holds (compare an input: `... > 0`)",
            "16:13: no condition of `a/m4` looks at its input `x` (use it in `error` or `warning`, or remove it)",
        ],
    );
}

#[test]
fn a_class_that_the_classification_does_not_have_is_said() {
    let external = |id: &str, class: &str| {
        format!("      - {{ id: {id}, monitor: {{ external: {{ status: {id}, class: {{ {class} }} }} }} }}\n")
    };
    let both = "{ x: { status: s, key: k }, y: { status: s, key: l } }";
    let modules = [
        external("m0", "location: isolated, information: content, flow: parallel"),
        external("m1", "location: isolated, information: meta"),
        external("m2", "location: contextual, information: meta, flow: sequential"),
        external("m3", "location: contextual, information: content"),
        format!("      - {{ id: m4, monitor: {{ expression: {{ inputs: {both}, error: x > y }} }} }}\n"),
    ];
    let unstated = |place: &str, id: &str| {
        format!(
            "{place}: `a/{id}` sets contents against each other and does not say how they flow (give its `class` a `flow`: `sequential` from an earlier stage to a later one, `parallel` for independent sources; or write `location: isolated`)"
        )
    };
    check(
        &format!("groups:\n  - id: a\n    modules:\n{}", modules.concat()),
        &[
            "4:15: `a/m0` is isolated and has a flow: the classification has no such column (what looks at one part alone has no flow: remove `flow`, or write `location: contextual`)",
            &unstated("7:15", "m3"),
            &unstated("8:15", "m4"),
        ],
    );
}

#[test]
fn conditions_that_never_hold_or_change_nothing() {
    check(
        "groups:
  - { id: a, when: { stages: [standby], signals: { active: true } }, modules: [{ id: m, status: a, when: { signals: { doors: true } } }] }
  - id: b
    when: { signals: { doors: true } }
    modules:
      - { id: m, status: b, when: { signals: { doors: false } } }
      - { id: n, status: c, when: { stages: [active] } }
      - { id: o, status: d, when: { stages: [localizing, standby, cleared, active] } }
  - { id: c, modules: [{ id: m, status: e, when: { stages: [locked] } }], match: [{ name: x }] }
",
        &[
            "2:20: `a` is never relevant while its signals are known (its own condition and those of the groups around it exclude each other: widen one of them)",
            "6:35: `b/m` is never relevant while its signals are known (its own condition and those of the groups around it exclude each other: widen one of them)",
            "8:35: this condition of `b/o` changes nothing (it holds whenever the groups around it are relevant: remove it)",
            "9:50: `c/m` is never relevant while its signals are known (its own condition and those of the groups around it exclude each other: widen one of them)",
        ],
    );
}

#[test]
fn groups_that_can_never_be_ok() {
    check(
        "groups:
  - { id: a }
  - { id: b, groups: [{ id: in }], modules: [{ id: m, status: b }] }
  - { id: c, when: { stages: [standby] }, modules: [{ id: m, status: c, when: { stages: [standby], signals: { active: true } } }] }
  - { id: d, when: { stages: [standby] }, modules: [{ id: m, status: d, when: { stages: [active] } }] }
",
        &[
            "2:11: `a` can never show OK: `a` has no members (in stage localizing, active false) (give it `modules`, `match` or `groups`, or remove it)",
            "3:29: `b/in` can never show OK: `b/in` has no members (in stage localizing, active false) (give it `modules`, `match` or `groups`, or remove it)",
            "4:79: `c/m` is never relevant while its signals are known (its own condition and those of the groups around it exclude each other: widen one of them)",
            "5:11: `d` can never show OK: `d`, or what is in it, is never relevant then (in stage standby, active false) (let its members be relevant when it is)",
            "5:79: `d/m` is never relevant while its signals are known (its own condition and those of the groups around it exclude each other: widen one of them)",
        ],
    );
}

#[test]
fn dependencies_that_never_or_always_mask() {
    check(
        "groups:
  - { id: empty }
  - { id: late, when: { stages: [active] }, modules: [{ id: m, status: a }] }
  - { id: b, when: { stages: [standby] }, depends_on: [late, { any_of: [c, late] }], modules: [{ id: m, status: b }] }
  - { id: c, depends_on: [empty], modules: [{ id: m, status: c }] }
  - { id: d, depends_on: [{ on: empty, masks_when: [error, unknown] }], modules: [{ id: m, status: d }] }
",
        &[
            "2:11: `empty` can never show OK: `empty` has no members (in stage localizing) (give it `modules`, `match` or `groups`, or remove it)",
            "4:56: this dependency of `b` can never mask: `late`, or what is in it, is never relevant then (remove it)",
            "4:62: this dependency of `b` can never mask: `late`, or what is in it, is never relevant then (remove it)",
            "5:27: this dependency of `c` can never mask: `empty` has no members (remove it)",
            "6:27: this masks `d` even while every module is OK (in stage localizing) (give the group that it names members, or let only `error` mask)",
        ],
    );
}

#[test]
fn a_dependency_passes_on_what_is_behind_it() {
    // `mid` is never relevant together with `last`, but what `mid` needs is.
    check(
        "groups:
  - { id: first, modules: [{ id: m, status: a }] }
  - { id: mid, when: { stages: [standby] }, depends_on: [first], modules: [{ id: m, status: b }] }
  - { id: last, when: { stages: [active] }, depends_on: [mid], modules: [{ id: m, status: c }] }
",
        &[],
    );
}

#[test]
fn a_cause_inside_of_a_redundant_group_is_seen_by_no_tile() {
    check(
        "groups:
  - { id: position, combine: any, modules: [{ id: gnss, status: g }, { id: slam, status: s }] }
  - { id: clock, depends_on: [position/gnss], modules: [{ id: drift, status: d }] }
  - { id: driving, depends_on: [position], modules: [{ id: m, status: m }] }
  - { id: both, depends_on: [{ any_of: [position/gnss, position/slam] }], modules: [{ id: m, status: b }] }
",
        &[
            "3:31: `clock` can be masked while no tile gets worse (in stage localizing, with position/gnss in ERROR) (the cause is named in the list of causes only: depend on the redundant group as a whole, or let the group combine the worst)",
        ],
    );
}

#[test]
fn a_countermeasure_watches_what_counts_in_its_stages() {
    check(
        "groups:\n- { id: a, when: { stages: [standby] }, modules: [{ id: m, status: s }] }\n- { id: b, when: { signals: { active: true } }, modules: [{ id: m, status: t }] }\ncountermeasures:\n- { request: decelerate, when: { groups: [b], modules: [a/m] } }\n- { request: notify, when: { groups: [a], stages: [standby, active] } }\n- { request: notify, when: { modules: [b/m], stages: [locked] } }\n",
        &[
            "5:57: `a/m` is never relevant in the stages of this countermeasure (remove it there, or name the stages in which it counts)",
            "7:40: `b/m` is never relevant in the stages of this countermeasure (remove it there, or name the stages in which it counts)",
        ],
    );
}

#[test]
fn an_unknown_cause_may_be_hidden_where_an_error_would_not() {
    // In ERROR, `b` takes the good member of its tile with it; in UNKNOWN only `c` goes.
    check(
        "groups:
  - id: a
    combine: any
    groups:
      - { id: good, depends_on: [a/b], modules: [{ id: m, status: g }] }
      - { id: b, modules: [{ id: m, status: b }] }
  - { id: c, depends_on: [{ on: a/b, masks_when: [error, unknown] }], modules: [{ id: m, status: c }] }
",
        &[
            "7:27: `c` can be masked while no tile gets worse (in stage localizing, with a/b/m in UNKNOWN) (the cause is named in the list of causes only: depend on the redundant group as a whole, or let the group combine the worst)",
            "7:27: while `a/b/m` is only silent, this hides an ERROR of `c/m` (give `a/b/m` `stale: error`, so that its silence is a fault, or let only `error` mask)",
        ],
    );
}

#[test]
fn what_is_called_alike_beside_each_other() {
    check(
        "groups:
  - { id: a, name: Same, match: [{ name: a }] }
  - { id: b, name: Same, match: [{ name: b }] }
  - { id: c, name: { en: S/ame, de: x }, modules: [{ id: m, status: s }], groups: [{ id: d, name: m, match: [{ name: d }] }] }
  - { id: e, name: S ame, match: [{ name: e }] }
",
        &[
            "3:11: `b` and `a` are both called \"Same\" on /diagnostics_agg (give one of them another name: the second is called after the first there, with a number)",
            "4:58: `c/m` and `c/d` are both called \"m\" on /diagnostics_agg (give one of them another name: the second is called after the first there, with a number)",
            "5:11: `e` and `c` are both called \"S ame\" on /diagnostics_agg (give one of them another name: the second is called after the first there, with a number)",
        ],
    );
}

#[test]
fn what_is_called_as_a_group_that_telltale_makes() {
    check(
        "groups:
  - { id: a, name: telltale, match: [{ name: a }] }
  - { id: b, name: { en: Rest, de: Sonstige }, match: [{ name: b }] }
  - { id: c, name: { en: ' Other/', de: Rest }, match: [{ name: c }] }
  - { id: d, name: Fine, groups: [{ id: e, name: Other, match: [{ name: e }] }] }
",
        &[
            "2:11: `a` is called \"telltale\", as the group `telltale` that Telltale makes by itself (give it another name: on the page nobody can tell the two apart, and on /diagnostics_agg the path that programs know the built-in group by may be taken)",
            "3:11: `b` is called \"Sonstige\", as the group `other` that Telltale makes by itself (give it another name: on the page nobody can tell the two apart, and on /diagnostics_agg the path that programs know the built-in group by may be taken)",
            "4:11: `c` is called \"Other\", as the group `other` that Telltale makes by itself (give it another name: on the page nobody can tell the two apart, and on /diagnostics_agg the path that programs know the built-in group by may be taken)",
        ],
    );
}

#[test]
fn a_limit_in_percent_of_a_fraction_is_told() {
    let of = |field: &str, limits: &str| {
        format!(
            "groups: [{{ id: a, modules: [{{ id: m, monitor: {{ value: {{ topic: /b, type: sensor_msgs/msg/BatteryState, field: {field}, {limits} }} }} }}] }}]\n"
        )
    };
    check(
        &of("percentage", "warning_below: 20, error_below: 10"),
        &[
            "1:35: `a/m` has a limit of 20, and `percentage` goes from 0 to 1 (write the limit as a fraction: 20 % is `0.2`; a driver that publishes percent is not as its type says)",
        ],
    );
    check(&of("percentage", "warning_below: 0.2, error_above: 1"), &[]);
    check(&of("voltage", "error_below: 20"), &[]);
    let help = "(write the limit as a fraction: 20 % is `0.2`; a driver that publishes percent is not as its type says)";
    let battery = "topic: /b, type: sensor_msgs/msg/BatteryState, field: percentage";
    let monitor =
        |kind: &str| "groups: [{ id: a, modules: [{ id: m, monitor: { KIND } }] }]\n".replace("KIND", kind);
    let said = format!("1:35: `a/m` has a limit of 20, and `percentage` goes from 0 to 1 {help}");
    let expression = |error: &str| {
        monitor(&format!(
            "expression: {{ inputs: {{ b: {{ {battery} }}, s: {{ status: s, key: k }} }}, error: {error}, class: {{ location: contextual, information: content, flow: parallel }} }}"
        ))
    };
    check(&expression("s > 50 && !(20 < b)"), &[&said]);
    check(&expression("s > 50 && b < 0.2"), &[]);
    let other = "{ status: s, key: k }";
    check(&monitor(&format!("agreement: {{ a: {{ {battery} }}, b: {other}, error_above: 20 }}")), &[&said]);
    check(&monitor(&format!("value: {{ {battery}, error_unless: 20 }}")), &[&said]);
    let group = "groups: [{ id: a, modules: [{ id: m, status: s, when: { signals: { low: true } } }] }]\n";
    let signals = format!("  low: {{ {battery}, when: value < 20 }}\n{group}");
    check(
        &signals,
        &[&format!("1:82: signal `low` has a limit of 20, and `percentage` goes from 0 to 1 {help}")],
    );
}

#[test]
fn a_window_that_is_too_short_for_its_limit_is_told_with_one_that_is_not() {
    let of = |keys: &str| {
        format!(
            "groups: [{{ id: a, modules: [{{ id: m, monitor: {{ frequency: {{ topic: /b, type: std_msgs/msg/Bool, {keys} }} }} }}] }}]\n"
        )
    };
    let said = |window: &str, limit: &str, least: &str| {
        format!(
            "1:35: the window of `a/m`, {window}, holds fewer than two messages at its limit of {limit} Hz: each message that comes a little early or late may raise or end an alarm (write `window: {least}` or more)"
        )
    };
    for (keys, [window, limit, least]) in [
        ("window: 100ms, warning_below: 7, error_below: 4", ["100ms", "7", "300ms"]),
        ("window: 200ms, error_below: 9.5", ["200ms", "9.5", "300ms"]),
        ("window: 1ms, error_below: 100", ["1ms", "100", "20ms"]),
        ("error_below: 0.3", ["2s", "0.3", "6s 700ms"]),
        ("error_below: 0.1", ["2s", "0.1", "20s"]),
        ("window: 100ms, warning_above: 12, error_above: 15", ["100ms", "12", "200ms"]),
    ] {
        check(&of(keys), &[&said(window, limit, least)]);
    }
    for keys in [
        "window: 300ms, warning_below: 7, error_below: 4",
        "window: 2s, warning_below: 7, error_below: 0.1",
        // Any message at all, and none.
        "window: 2s, error_below: 0.5",
        "window: 100ms, error_below: 10",
        "error_above: 0",
        // No window that may be written is long enough.
        "error_below: 0.003",
    ] {
        check(&of(keys), &[]);
    }
}

#[test]
fn a_pattern_of_file_names_is_told() {
    let regex = |regex: &str| format!("(write `regex: '{regex}'`, or leave it if statuses are called so)");
    let name = "(name the status as it is called; `match` in a group takes several)";
    let said = |line: u32, text: &str, of: &str, help: &str| {
        format!(
            "{line}:9: `{text}` of `{of}` looks like a pattern of file names, and every character stands for itself {help}"
        )
    };
    let found = check(
        "groups:
  - id: a
    match: [{ namespace: 'a*' }, { contains: '[x-z]' }, { name: 'joint [!a-c] b' }, { contains: '[C]' }, { name: 'well?' }, { name: '[left] d' }, { regex: 'e.?[xy]' }]
    modules: [{ id: m, status: 'lidar*' }, { id: n, monitor: { value: { status: 'b [x-y]', key: k, error_above: 1 } } }, { id: o, status: 'fine [V]: well?' }]
",
        &[
            &said(2, "a*", "a", &regex("a.*(?:[/:].*)?")),
            &said(2, "[x-z]", "a", &regex(".*[x-z].*")),
            &said(2, "joint [!a-c] b", "a", &regex("joint [^a-c] b")),
            "4:21: `lidar*` of `a/m` looks like a pattern of file names, and every character stands for itself (name the status as it is called; `match` in a group takes several)",
            &format!("4:50: `b [x-y]` of `a/n` looks like a pattern of file names, and every character stands for itself {name}"),
        ],
    );
    assert!(found.complete);
    check(
        "  low: { status: 'bat*', key: k, when: value < 20 }\ngroups: [{ id: a, modules: [{ id: m, status: s, when: { signals: { low: true } } }] }]\n",
        &[&format!(
            "1:40: `bat*` of signal `low` looks like a pattern of file names, and every character stands for itself {name}"
        )],
    );
}

#[test]
fn what_is_noticed_later_than_a_dependency_waits_is_said_once() {
    check(
        "groups:
  - { id: a, modules: [{ id: m, status: a, timeout: 8s, stale: error }, { id: w, monitor: { watchdog: { node: /n, every: 1s, misses: 2 } } }] }
  - { id: b, depends_on: [a], modules: [{ id: m, status: b }] }
  - { id: c, depends_on: [{ on: a/w, within: 36s }], modules: [{ id: m, status: c, depends_on: [{ on: b, within: 2s }], raise_after: 3s }] }
  - { id: d, depends_on: [{ on: a, within: always }], modules: [{ id: m, status: d }] }
",
        &[
            "3:27: `a/m` may be noticed only after 8s, and this dependency of `b` explains within 5s: one fault may be shown as two (write `within: 8s` or more here, or let `a/m` be noticed earlier)",
            "3:27: `a/w` may be noticed only after 36s, and this dependency of `b` explains within 5s: one fault may be shown as two (write `within: 36s` or more here, or let `a/w` be noticed earlier)",
            "4:97: `c/m` may be noticed only after 3s, and this dependency of `c/m` explains within 2s: one fault may be shown as two (write `within: 3s` or more here, or let `c/m` be noticed earlier)",
        ],
    );
}

#[test]
fn less_urgent_faults_before_more_urgent_ones_are_a_warning_where_they_hide_them_for_ever() {
    let text = |within: &str| {
        format!(
            "groups:
  - {{ id: a, modules: [{{ id: m, status: a, help: {{ en: Look., urgency: be_ready }} }}, {{ id: n, status: n }}] }}
  - {{ id: b, depends_on: [{within}], modules: [{{ id: m, status: b, help: {{ en: Take over., urgency: take_over }} }}] }}
"
        )
    };
    check(&text("a"), &[]);
    check(
        &text("{ on: a, within: always }"),
        &[
            "3:27: b waits for a (explains everything): 2 less urgent faults stand before b/m (write `within: 5s` in place of `always`)",
        ],
    );
    let loaded = parse("c", &text("a/m")).unwrap();
    let behind = crate::soundness::urgency::behind(&loaded.model);
    let said: Vec<String> = behind.iter().map(|it| crate::soundness::behind(&loaded.model, it)).collect();
    assert_eq!(said, ["b waits for a/m: 1 less urgent fault stands before b/m; give a/m the same urgency"]);
}

#[test]
fn a_later_stage_depends_on_what_judges_the_earlier_one() {
    let topic = |name: &str| format!("topic: /{name}, type: std_msgs/msg/Float64");
    let (points, objects) = (topic("points"), topic("objects"));
    let ratio = format!("rate_ratio: {{ input: {{ {points} }}, output: {{ {objects} }}, error_below: 0.5 }}");
    let sequence = format!(
        "sequence: {{ earlier: {{ {points}, field: data }}, later: {{ {objects}, field: data }}, error_above: 1 }}"
    );
    let sum = |flow: &str| {
        format!(
            "expression: {{ inputs: {{ p: {{ {points}, field: data }}, k: {{ status: k, key: v }} }}, max_age: 1s, error: p > k, class: {{ location: contextual, information: content, flow: {flow} }} }}"
        )
    };
    check(
        &format!(
            "groups:
  - {{ id: a, modules: [{{ id: rate, monitor: {{ frequency: {{ {points}, error_below: 5 }} }} }}, {{ id: k, status: k }}] }}
  - {{ id: b, modules: [{{ id: ratio, monitor: {{ {ratio} }} }}] }}
  - {{ id: c, modules: [{{ id: sequence, monitor: {{ {sequence} }} }}] }}
  - {{ id: d, modules: [{{ id: sum, monitor: {{ {} }} }}] }}
  - {{ id: e, modules: [{{ id: sum, monitor: {{ {} }} }}] }}
  - {{ id: f, depends_on: [g], modules: [{{ id: ratio, monitor: {{ {ratio} }} }}] }}
  - {{ id: g, modules: [{{ id: m, status: m, depends_on: [a] }}] }}
  - {{ id: h, depends_on: [a/rate], modules: [{{ id: sequence, monitor: {{ {sequence} }} }}] }}
",
            sum("sequential"),
            sum("parallel"),
        ),
        &[
            "3:30: a fault of `a/rate` is one of `b/ratio` too, which compares with what it judges (add `depends_on: [a/rate]`, so that only the cause is shown)",
            "4:30: a fault of `a/rate` is one of `c/sequence` too, which compares with what it judges (add `depends_on: [a/rate]`, so that only the cause is shown)",
            "5:30: a fault of `a/rate` is one of `d/sum` too, which compares with what it judges (add `depends_on: [a/rate]`, so that only the cause is shown)",
            "5:30: a fault of `a/k` is one of `d/sum` too, which compares with what it judges (add `depends_on: [a/k]`, so that only the cause is shown)",
        ],
    );
}

#[test]
fn silence_that_masks_hides_an_error() {
    // What is judged by the clock is never silent, a silence that is an ERROR is a cause of its own, and what is never in ERROR
    // has none to hide.
    check(
        "groups:
  - { id: a, modules: [{ id: m, status: a }] }
  - { id: b, modules: [{ id: m, status: b, stale: error }, { id: rate, monitor: { frequency: { topic: /t, type: std_msgs/msg/Bool, error_below: 5 } } }] }
  - { id: c, depends_on: [{ on: a, masks_when: [error, unknown] }, { on: b, masks_when: [error, unknown] }], modules: [{ id: m, status: c }] }
  - { id: d, match: [{ namespace: /d }] }
  - { id: e, modules: [{ id: m, status: e, depends_on: [{ any_of: [a, b], masks_when: [error, unknown] }, { on: d, masks_when: [error, unknown] }] }] }
  - { id: f, depends_on: [{ on: a, masks_when: [error, unknown] }], modules: [{ id: rate, monitor: { frequency: { topic: /t, type: std_msgs/msg/Bool, warning_below: 5 } } }] }
",
        &[
            "4:27: while `a/m` is only silent, this hides an ERROR of `c/m` (give `a/m` `stale: error`, so that its silence is a fault, or let only `error` mask)",
            "6:107: while `d` is only silent, this hides an ERROR of `e/m` (give `d` `stale: error`, so that its silence is a fault, or let only `error` mask)",
        ],
    );
}

#[test]
fn statuses_that_join_two_groups_are_said() {
    let twice = |first: &str, second: &str| {
        let text = format!(
            "vehicle: {{ stages: none }}\ngroups:\n- {{ id: a, match: [{first}] }}\n- {{ id: b, match: [{second}] }}\n"
        );
        let loaded = parse("c", &text).unwrap_or_else(|problems| panic!("{problems}"));
        loaded.soundness().1.map_or_else(Vec::new, |problems| problems.lines())
    };
    let said = |statuses: &str| {
        vec![format!(
            "c:4:9: statuses with `{statuses}` join `a` and `b`: both show them (add `except: [{{ {statuses} }}]` to the filter \
             of the one that is not meant, or leave it if both are meant)"
        )]
    };
    assert_eq!(twice("{ namespace: lidar }", "{ namespace: lidar/front }"), said("namespace: 'lidar/front'"));
    assert_eq!(twice("{ name: 'lidar: it''s on' }", "{ contains: lidar }"), said("name: 'lidar: it''s on'"));
    // One sentence for two groups.
    assert_eq!(twice("{ regex: 'a.*' }", "{ name: ab }, { regex: 'a.*' }"), said("name: 'ab'"));
    let apart = [
        ("{ namespace: lidar }", "{ namespace: lidar2 }"),
        ("{ namespace: lidar, except: [{ namespace: lidar/front }] }", "{ namespace: lidar/front }"),
        ("{ contains: lidar, except: [{ name: lidar }] }", "{ name: lidar }"),
        ("{ name: lidar }", "{ contains: lidar, except: [{ name: lidar }] }"),
    ];
    for (first, second) in apart {
        assert_eq!(twice(first, second), [""; 0], "{first} {second}");
    }
}

#[test]
fn a_vehicle_that_is_a_shuttle_by_default_alone_is_said() {
    let said = |vehicle: &str| {
        let text = format!("{vehicle}groups:\n- {{ id: a, match: [{{ name: s }}] }}\n");
        let loaded = parse("c", &text).unwrap_or_else(|problems| panic!("{problems}"));
        let lines = loaded.soundness().1.map_or_else(Vec::new, |problems| problems.lines());
        (loaded.is_shuttle_unsaid(), lines.first().cloned().unwrap_or_default())
    };
    let (is_unsaid, line) = said("");
    assert!(
        is_unsaid
            && line.contains("this counts as a shuttle, because `vehicle` has no `stages`: it begins locked"),
        "{line}"
    );
    assert!(line.contains("write `vehicle: { stages: none }` for a machine that is no shuttle"), "{line}");
    let (is_unsaid, line) = said("vehicle: { stages: shuttle }\n");
    assert!(!is_unsaid && line.contains("nothing says whether this shuttle drives"), "{line}");
    assert_eq!(said("vehicle: { stages: none }\n"), (false, String::new()));
    assert_eq!(said("signals: { active: { topic: /a, type: std_msgs/msg/Bool } }\n"), (false, String::new()));
}
