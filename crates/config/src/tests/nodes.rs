//! Tests of mistakes in groups, modules and signals.

use super::*;
use telltale_engine::model::wording::{Advice, ByStage, Urgency};

#[test]
fn ids_are_safe_and_unique() {
    check(
        "groups:\n  - { id: 'a b', match: [{ name: n }] }\n  - { id: other, match: [{ name: n }] }\n",
        &[
            "2:11: `a b` cannot be the id of a group (use letters, digits, `_`, `.` and `-`; what people read stands in `name`)",
            "3:11: the group `other` is made by the program itself (choose another id)",
        ],
    );
    check(
        "groups:\n  - { id: a, modules: [{ id: m, status: s }, { id: m, status: t }], groups: [{ id: m }] }\n  - { id: a }\n",
        &[
            "2:52: module `a/m` is declared twice (rename or remove one of the two)",
            "2:84: group `a/m` is declared twice (rename or remove one of the two)",
            "3:11: group `a` is declared twice (rename or remove one of the two)",
        ],
    );
    check_beside_group(
        "stops: [{ id: s, x: 0, y: 0 }, { id: s, x: 1, y: 1 }]\n",
        &["2:38: stop `s` is declared twice (rename or remove one of the two)"],
    );
    // A name that is not found may be meant for the node whose id is wrong: nothing is said about it.
    check(
        "groups:\n  - { id: 'a b', match: [{ name: n }] }\n  - { id: b, depends_on: [a_b], match: [{ name: n }] }\n",
        &[
            "2:11: `a b` cannot be the id of a group (use letters, digits, `_`, `.` and `-`; what people read stands in `name`)",
        ],
    );
}

#[test]
fn modules_say_what_they_watch() {
    let module = |module: &str| format!("groups: [{{ id: a, modules: [{{ {module} }}] }}]\n");
    check(
        &module("id: m"),
        &["1:29: a module needs `status` or `monitor` (add `status: 'NAME OF THE STATUS'`)"],
    );
    check(
        &module("id: m, status: s, monitor: { self_state: { status: s } }"),
        &["1:49: a module has either `status` or `monitor` (remove one of the two)"],
    );
    check(&module("status: s"), &["1:29: a module needs `id` (add `id: ...`)"]);
    check(
        &module("id: m, monitor: { frequenzy: { topic: /t } }"),
        &["1:49: unknown kind of monitor `frequenzy` (did you mean `frequency`?)"],
    );
    check(&module("id: m, monitor: { frequency: { topic: /t, error_below: 1 } }"), &[]);
    check(
        &module("id: m, status: s }, { id: n, status: s"),
        &["1:68: two modules of `a` take the status `s` (remove one of the two modules)"],
    );
}

#[test]
fn filters_can_take_something() {
    let filters = |filters: &str| {
        format!("groups: [{{ id: a, modules: [{{ id: m, status: s }}], match: [{filters}] }}]\n")
    };
    check(
        &filters("{ regex: 'a(b' }"),
        &["1:71: this is no regular expression: unclosed group (see character 2 of the expression)"],
    );
    // An empty class, and what cannot stand in the middle of a name.
    for pattern in ["a[b&&c]", "a^b", "a$b", r"x\Ay|z\zz", r"(?-u:a\bb)"] {
        check(
            &filters(&format!("{{ regex: '{pattern}' }}")),
            &[
                "1:69: this regular expression can never match (remove the filter, or what contradicts itself in the expression)",
            ],
        );
    }
    for pattern in ["^a$", "a|b^c", r"(?-u:\b)a.*", "", ".*", "(a|b)*c{3,}"] {
        assert!(parse("c", &filters(&format!("{{ regex: 'x|{pattern}' }}"))).is_ok(), "{pattern}");
    }
    check(
        &filters("{ regex: 'a{1000}{1000}' }"),
        &[
            "1:69: this regular expression cannot be used: Compiled regex exceeds size limit of 10485760 bytes. (make it shorter)",
        ],
    );
    // Each of them may be used, and many of them would fill the memory: the first that is too much is told, once.
    let many: Vec<String> = (0..400).map(|number| format!("{{ regex: '\\w{{200}}{number}' }}")).collect();
    let problems = parse("c", &filters(&many.join(", "))).unwrap_err();
    let [problem] = problems.list() else { panic!("{problems}") };
    assert_eq!(problem.message, "the regular expressions up to this one take more than 10 MiB of memory");
    assert!(parse("c", &filters(&many[..2].join(", "))).is_ok());
    check(
        &filters("{ name: s }"),
        &["1:60: the declared module `a/m` takes this status before any filter (remove the filter)"],
    );
    for (first, second) in [
        ("namespace: /x", "namespace: /x"),
        ("namespace: /x", "namespace: /x/y"),
        ("contains: x", "namespace: /x"),
        ("regex: 'x.*'", "name: xy"),
        ("regex: 'x.*'", "regex: 'x.*'"),
    ] {
        let column = 60 + first.len() + 6;
        let expected = format!(
            "1:{column}: this filter takes nothing that an earlier one leaves (remove one of the two)"
        );
        check(&filters(&format!("{{ {first} }}, {{ {second} }}")), &[&expected]);
    }
    check(
        &filters("{ name: x, contains: y }"),
        &[
            "1:60: a filter needs one of `name`, `namespace`, `contains`, `regex` (write one filter for each: `- { namespace: /sensors }`)",
        ],
    );
    check(
        &filters("{ zzzz: x }"),
        &[
            "1:60: a filter needs one of `name`, `namespace`, `contains`, `regex` (write one filter for each: `- { namespace: /sensors }`)",
            "1:62: unknown key `zzzz` in a filter (known here: name, namespace, contains, regex, except, prefix, expected, forget_after, stale, timeout, writers)",
        ],
    );
    check(&filters("{ contains: '' }"), &["1:72: expected a text, found nothing (write a value)"]);
}

#[test]
fn dependencies_lead_somewhere_else() {
    let text = "groups:
  - id: sensors
    depends_on: [sensors, sensors/imu, sensors/lidar, localisation, imuu, brake]
    modules:
      - { id: imu, status: s, depends_on: [sensors] }
      - { id: gnss, status: t, depends_on: [sensors/imu, { on: sensors/imu }] }
    groups: [{ id: lidar, match: [{ name: n }] }]
  - { id: localization, depends_on: [imu, { any_of: [] }, { any_of: [lidar, lidra] }] }
";
    check(
        text,
        &[
            "3:18: `sensors` depends on itself (remove this dependency)",
            "3:27: `sensors` depends on its own member `sensors/imu` (remove this dependency)",
            "3:40: `sensors` depends on its own member `sensors/lidar` (remove this dependency)",
            "3:55: there is no group or module `localisation` (did you mean `localization`?)",
            "3:69: there is no group or module `imuu` (did you mean `sensors/imu`?)",
            "3:75: there is no group or module `brake` (write the full name: `group`, `group/module` or `group/group/module`)",
            "5:44: `sensors/imu` depends on `sensors`, which it is a member of (remove this dependency)",
            "6:64: `sensors/imu` is named twice (remove one of the two)",
            "8:38: there is no group or module `imu` (did you mean `sensors/imu`?)",
            "8:43: an `any_of` without members could never block (name at least one group or module)",
            "8:70: there is no group or module `lidar` (did you mean `sensors/lidar`?)",
            "8:77: there is no group or module `lidra` (did you mean `sensors/lidar`?)",
        ],
    );
    check(
        "groups:\n  - { id: a, match: [{ name: n }] }\n  - { id: b, depends_on: [{ on: a, masks_when: [unknown] }, { masks_when: [error] }, { on: a, masks_when: [warning] }] }\n",
        &[
            "3:48: `masks_when` lacks `error` (write `[error]` or `[error, unknown]`)",
            "3:61: a dependency needs either `on` or `any_of` (write the name alone, `{ on: NAME }` or `{ any_of: [NAME, NAME] }`)",
            "3:92: `a` is named twice (remove one of the two)",
            "3:108: unknown masking state `warning` (one of: error, unknown)",
        ],
    );
}

#[test]
fn a_cycle_is_shown_whole_with_the_line_of_each_step() {
    let text = "groups:
  - { id: a, depends_on: [b], modules: [{ id: m, status: x }] }
  - { id: b, depends_on: [c/x], match: [{ contains: q }] }
  - { id: c, depends_on: [{ any_of: [a/m] }], modules: [{ id: x, status: y }] }
";
    let problems = parse("c", text).unwrap_err();
    let [problem] = problems.list() else { panic!("{problems}") };
    assert_eq!(problem.message, "dependencies go round in a circle: b -> c/x -> a/m -> b");
    let labels: Vec<&str> = std::iter::once(&*problem.label)
        .chain(problem.also.iter().map(|(_, label)| label.as_str()))
        .collect();
    assert_eq!(labels, ["b depends on c/x", "c depends on a/m", "a depends on b"]);
    let rendered = problems.render(false);
    for line in [" 2 │", " 3 │", " 4 │"] {
        assert!(rendered.contains(line), "{rendered}");
    }
}

#[test]
fn conditions_can_hold() {
    let when = |when: &str| {
        format!(
            "signals: {{ active: {{ topic: /a, type: std_msgs/msg/Bool }} }}\ngroups: [{{ id: a, match: [{{ name: n }}], when: {when} }}]\n"
        )
    };
    check(&when("{ stages: [standbye] }"), &["2:58: unknown stage `standbye` (did you mean `standby`?)"]);
    check(
        &when("{ stages: [] }"),
        &["2:57: without a stage this would never be diagnosed (name the stages, or remove `stages`)"],
    );
    check(
        &when("{ }"),
        &[
            "2:47: this `when` has no condition (add `stages: [...]` or `signals: { NAME: true }`, or remove it)",
        ],
    );
    check(
        &when("{ signals: { activ: true } }"),
        &["2:60: there is no signal `activ` (did you mean `active`?)"],
    );
    check(&when("{ signals: { active: yes } }"), &["2:68: unknown truth value `yes` (one of: true, false)"]);
    check(&when("{ signals: { pose: true } }"), &["2:60: there is no signal `pose` (did you mean `posed`?)"]);
    check(&when("{ signals: { posed: true } }"), &[]);
}

#[test]
fn signals_name_a_topic_that_can_be() {
    check_beside_group(
        "signals:\n  b: { topic: active, type: std_msgs/Bool }\n  c: { topic: /c, type: a/msg/B }\n  posed: { topic: /p, type: std_msgs/msg/Bool, timeout: 0s }\n",
        &[
            "3:15: `active` is no full topic name (begin with `/`; letters, digits, `_` and `/` follow: `/mission/active`)",
            "3:29: `std_msgs/Bool` is no message type (did you mean `std_msgs/msg/Bool`?)",
            "4:25: which field of a a/msg/B? (add `field: PATH`, or `present_for: 1h` if only its arrival matters)",
            "5:3: `posed` is built in: it says that the operator gave a pose (choose another name)",
            "5:57: expected a duration above 0 (for example `2s`)",
        ],
    );
}

#[test]
fn tiles_have_a_place_of_their_own() {
    check(
        "groups:\n  - { id: a, tile: { column: 1, row: 1 }, groups: [{ id: b, tile: { column: 2, row: 1 } }] }\n  - { id: c, tile: { column: 1, row: 1 } }\n  - { id: d, tile: { column: 0, row: 1 } }\n  - { id: e, tile: { column: 1 } }\n",
        &[
            "2:67: only a group at the top has a tile (remove `tile` from this group)",
            "3:20: two tiles stand in one place (choose another column or row)",
            "4:20: column and row go from 1 to 12 (the first column and the first row are 1)",
            "5:20: a tile needs `row` (add `row: ...`)",
        ],
    );
}

#[test]
fn a_signal_is_any_field_of_any_type() {
    check(
        "signals:\n  a: { topic: /a, type: nav_msgs/msg/Odometry, field: 'x[0].on' }\n  b: { topic: /diagnostics, type: std_msgs/msg/Bool }\ngroups: [{ id: g, match: [{ name: n }] }]\n",
        &[
            "3:35: /diagnostics is read as diagnostic_msgs/msg/DiagnosticArray already (a topic has one type; correct the type, or name another topic)",
        ],
    );
}

#[test]
fn what_is_forgotten_was_silent_before() {
    check(
        "groups:\n  - { id: a, match: [{ name: n, timeout: 5s, forget_after: 4s }, { contains: c, forget_after: 1s }] }\n",
        &[
            "2:60: it would be forgotten before it counts as silent (write a duration that is not below its `timeout`, which is 5s)",
            "2:95: it would be forgotten before it counts as silent (write a duration that is not below its `timeout`, which is 2s)",
        ],
    );
    check(
        "defaults: { timeout: 2s, forget_after: 1s }\ngroups: [{ id: a, match: [{ name: n }] }]\n",
        &[
            "1:40: it would be forgotten before it counts as silent (write a duration that is not below its `timeout`, which is 2s)",
        ],
    );
    check(
        "defaults: { forget_after: 1m }\ngroups: [{ id: a, match: [{ name: n, timeout: 2m }] }]\n",
        &[
            "2:47: it would be forgotten before it counts as silent (add a `forget_after` here that is not below it, or write a duration up to that of `defaults`, which is 1m)",
        ],
    );
    check(
        "groups:\n  - { id: a, modules: [{ id: m, forget_after: 9s, monitor: { watchdog: { node: /n } } }] }\n",
        &["2:47: this monitor judges by the clock: it is never silent (remove `forget_after`)"],
    );
    check(
        "groups:\n  - { id: a, match: [{ name: n, latch: 1s }] }\n",
        &[
            "2:33: unknown key `latch` in a filter (known here: name, namespace, contains, regex, except, prefix, expected, forget_after, stale, timeout, writers)",
        ],
    );
    check_beside_group(
        "other: quiet\n",
        &["2:8: unknown way to treat other statuses `quiet` (one of: hidden, shown, counted)"],
    );
    let model = parse("c", "other: counted\ngroups: [{ id: a, match: [{ name: n }, { name: o, stale: error, forget_after: 1m }] }]\n")
        .unwrap_or_else(|problems| panic!("{problems}"))
        .model;
    assert_eq!(model.other, telltale_engine::model::Other::Counted);
    let policies: Vec<_> = model.groups[0].filters.iter().map(|it| it.policy.clone()).collect();
    assert_eq!(policies[0], None);
    assert_eq!(
        policies[1].as_ref().map(crate::describe::words::policy).as_deref(),
        Some("error after 2s of silence, forgotten after 1m")
    );
}

#[test]
fn the_default_for_forgetting_is_for_what_statuses_make() {
    let text = "defaults: { forget_after: 1m }
groups:
  - { id: a, match: [{ name: n, timeout: 5s }, { name: o }], modules: [{ id: m, status: s, timeout: 2m }] }
";
    let model = parse("c", text).unwrap_or_else(|problems| panic!("{problems}")).model;
    let minute = Some(telltale_engine::time::Span::from_secs(60));
    assert_eq!(model.discovered.forget_after, minute, "of `other` too");
    let own = model.groups[0].filters.iter().map(|it| it.policy.as_ref().map(|it| it.forget_after));
    assert_eq!(own.collect::<Vec<_>>(), [Some(minute), None], "an entry with keys of its own keeps it");
    assert_eq!(model.modules[0].policy.forget_after, None, "what is declared is expected");
}

#[test]
fn a_worse_level_never_asks_for_less() {
    let module =
        |help: &str| format!("groups: [{{ id: a, modules: [{{ id: m, status: s, help: {help} }}] }}]\n");
    let take_over = "{ en: T, urgency: take_over }";
    let be_ready = "{ en: B, urgency: be_ready }";
    let says = |stage: &str| {
        format!(
            "in `{stage}`, an ERROR asks for less than a WARNING (give `error` the `urgency: take_over` too, or `warning` a lower one)"
        )
    };
    for (warning, error, wrong) in [
        (take_over, be_ready, Some("active")),
        (take_over, "E", Some("active")),
        (
            "{ cleared: { en: T, urgency: take_over } }",
            "{ active: { en: T, urgency: take_over }, cleared: C }",
            Some("cleared"),
        ),
        (take_over, take_over, None),
        (be_ready, "E", None),
        ("{ standby: S }", be_ready, None),
    ] {
        let text = module(&format!("{{ warning: {warning}, error: {error}, unknown: {take_over} }}"));
        let column = text.find(" error:").expect("it is written") + 2;
        let expected: Vec<String> =
            wrong.into_iter().map(|stage| format!("1:{column}: {}", says(stage))).collect();
        check(&text, &expected.iter().map(String::as_str).collect::<Vec<_>>());
    }
    let alone = module(&format!("{{ warning: {take_over} }}"));
    let column = alone.find("warning:").expect("it is written") + 1;
    let expected = format!("1:{column}: {}", says("active"));
    check(&alone, &[expected.as_str()]);
}

#[test]
fn words_are_written_for_all_or_for_each_level_and_stage() {
    let module = |words: &str| format!("groups: [{{ id: a, modules: [{{ id: m, status: s, {words} }}] }}]\n");
    let of = |words: &str| {
        let loaded = parse("c", &module(words)).unwrap_or_else(|problems| panic!("{problems}"));
        loaded.model.modules[0].clone()
    };
    let plain = of("name: N, help: { en: H, de: G }");
    assert_eq!(plain.name, Some(Wording::name("N".into()).into()));
    assert_eq!(plain.help, Some(Wording::help(Text { en: "H".into(), de: "G".into() }).into()));
    let urgent = of("help: { error: { active: { en: Take over., urgency: take_over }, standby: Stay. } }");
    let urgency = |stage| urgent.help.as_ref().unwrap().of(State::Error, stage).unwrap().urgency;
    assert_eq!((urgency(Stage::Cleared), urgency(Stage::Standby)), (Some(Urgency::TakeOver), None));
    assert_eq!(of("help: { en: H, urgency: be_ready }").help.unwrap().error, {
        let advice = Advice { text: "H".into(), urgency: Some(Urgency::BeReady) };
        ByStage::In(vec![(Stage::Active, advice)])
    });
    check(
        &module(
            "name: { en: N, urgency: take_over }, help: { error: { standby: { en: S, urgency: now }, localizing: { en: L, urgency: be_ready } } }",
        ),
        &[
            "1:64: unknown key `urgency` in a text in two languages (known here: en, de)",
            "1:130: unknown urgency `now` (one of: be_ready, take_over)",
            "1:149: nobody takes over a vehicle that stands (remove `urgency` here; it is for `cleared` and `active`)",
        ],
    );
    let each = of(
        "name: { error: E }, help: { warning: W, error: { standby: S, active: { en: A, de: B } }, unknown: U }",
    );
    let named = |state, stage| each.name.as_ref().unwrap().of(state, stage).map(|text| &*text.de);
    assert_eq!(named(State::Warning, Stage::Active), None);
    assert_eq!(named(State::Ok, Stage::Active), None);
    let working = of("name: { ok: O, error: E }").name.unwrap();
    assert_eq!(working.of(State::Ok, Stage::Active), Some(&"O".into()));
    check(
        &module("help: { ok: Drive on., error: E }"),
        &["1:57: unknown key `ok` in advice for levels (known here: warning, error, unknown)"],
    );
    assert_eq!(named(State::Error, Stage::Standby), Some("E"));
    let advised = |state, stage| each.help.as_ref().unwrap().of(state, stage).map(|it| &*it.text.de);
    for (state, stage, words) in [
        (State::Warning, Stage::Active, "W"),
        (State::Error, Stage::Localizing, "S"),
        (State::Error, Stage::Cleared, "B"),
        (State::Unknown, Stage::Standby, "U"),
    ] {
        assert_eq!(advised(state, stage), Some(words), "{state:?} {stage:?}");
    }
    check(
        &module("name: { eror: E }, help: { error: { actve: A } }"),
        &[
            "1:55: there are words for no level (write one text, or `{ warning: ..., error: ..., unknown: ... }`)",
            "1:57: unknown key `eror` in words for levels (did you mean `error`?)",
            "1:83: there are words for no stage (write one text, or `{ standby: ..., active: ... }`)",
            "1:85: unknown key `actve` in advice for stages (did you mean `active`?)",
        ],
    );
    check(
        &module("name: [a], help: { warning: { en: W } }"),
        &["1:55: expected a text, found a list (quote it with '...' if it is meant as a text)"],
    );
}

#[test]
fn who_may_say_a_status_is_named_as_ros_names_it() {
    let module = |module: &str| format!("groups: [{{ id: a, modules: [{{ id: m, {module} }}] }}]\n");
    check(
        &module("status: s, writers: []"),
        &["1:58: without a node nobody could say it (name the nodes, or remove `writers`)"],
    );
    check(
        &module("status: s, writers: [/a/b_1, lidar, /x/, '/9']"),
        &[
            "1:67: `lidar` is not the whole name of a node (write it as `ros2 node list` does, with its namespace: `/sensors/driver`)",
            "1:74: `/x/` is not the whole name of a node (write it as `ros2 node list` does, with its namespace: `/sensors/driver`)",
            "1:79: `/9` is not the whole name of a node (write it as `ros2 node list` does, with its namespace: `/sensors/driver`)",
        ],
    );
    check(
        &module("monitor: { frequency: { topic: /t, error_below: 1 } }, writers: [/a]"),
        &[
            "1:102: `writers` is only for a module that takes a status (remove it, or put it beside the `status` of a module)",
        ],
    );
    let loaded = parse("c", &module("status: s, writers: [/a, /b/c]")).unwrap();
    let writers = loaded.model.modules[0].policy.writers.as_ref().unwrap();
    assert_eq!(writers.iter().map(|name| &**name).collect::<Vec<_>>(), ["/a", "/b/c"]);
}

#[test]
fn what_a_group_expects_leaves_and_shortens_is_checked() {
    let filters = |filters: &str| {
        format!("groups: [{{ id: a, modules: [{{ id: m, status: s }}], match: [{filters}] }}]\n")
    };
    check(&filters("{ contains: x, except: [{ name: xy }], prefix: [x, y], expected: [xz, q] }"), &[]);
    check(&filters("{ expected: [q], timeout: 9s }, { contains: q, prefix: q }"), &[]);
    check(
        &filters("{ contains: x, expected: [s] }, { expected: [q, q] }"),
        &[
            "1:86: `s` is expected in this group already (name it once)",
            "1:108: `q` is expected in this group already (name it once)",
        ],
    );
    check(
        &filters("{ contains: xy, except: [{ contains: x }] }"),
        &["1:60: this filter takes nothing that its `except` leaves (remove one of the two)"],
    );
    // A topic that an entry leaves may match a later one.
    check(&filters("{ contains: x, except: [{ contains: y }] }, { contains: xy }"), &[]);
    check(
        &filters("{ contains: x, except: [{ startswith: y }] }"),
        &[
            "1:86: there is no filter `startswith` (write `namespace: y` for names that begin with it up to a `/` or `:`, or `regex: 'y.*'` for any)",
        ],
    );
    check(
        &filters("{ prefix: /x }"),
        &[
            "1:62: there is no filter `prefix` (write `namespace: /x` for names that begin with it up to a `/` or `:`, or `regex: '/x.*'` for any)",
        ],
    );
    check(
        "groups: [{ id: a, empty: error, count: x, modules: [{ id: m, status: s, warning_as: unknown }] }]\n",
        &[
            "1:26: unknown state of an empty group `error` (one of: ok, unknown)",
            "1:40: expected a whole number, found `x` (write digits only, for example `12`)",
            "1:85: unknown way to count a warning `unknown` (one of: ok, error)",
        ],
    );
    check(
        "groups: [{ id: a, count: 0, match: [{ name: x }] }]\n",
        &["1:26: 0 is not between 1 and 100000 (write `empty: ok` where there need be none)"],
    );
    check(
        "groups: [{ id: a, modules: [{ id: m, monitor: { constant: { state: ignore } } }, { id: n, monitor: { constant: {} } }] }]\n",
        &[
            "1:68: unknown state `ignore` (one of: ok, warning, error, unknown)",
            "1:112: a constant monitor needs `state` (add `state: ok`)",
        ],
    );
    check_beside_group(
        "other: { show: all, state: ok, except: [{ name: x }, { regex: '(' }] }\n",
        &[
            "2:16: unknown way to treat other statuses `all` (one of: hidden, shown, counted)",
            "2:28: unknown state of other statuses `ok` (one of: error)",
            "2:64: this is no regular expression: unclosed group (see character 1 of the expression)",
        ],
    );
}

#[test]
fn a_group_that_is_named_by_its_title_is_answered_with_its_id() {
    check(
        "groups:\n  - { id: lidars, name: Laser scanners, match: [{ name: n }] }\n  - { id: b, depends_on: [Laser scanners], match: [{ name: m }] }\n",
        &[
            "3:27: there is no group or module `Laser scanners` (that is its `name`, which people read; write its id: `lidars`)",
        ],
    );
}
