//! Tests of the differences between two configurations.

use crate::describe::difference::difference;
use crate::parse;

/// All differences between two texts, as sentences.
#[track_caller]
fn check(old: &str, new: &str, expected: &[&str]) {
    let load = |text: &str| parse("c", text).unwrap_or_else(|problems| panic!("{problems}"));
    let (old, new) = (load(old), load(new));
    let found: Vec<String> = difference(&old, &new).iter().map(ToString::to_string).collect();
    assert_eq!(found, expected);
    assert_eq!(difference(&old, &old), []);
    assert_eq!(difference(&new, &new), []);
}

#[test]
fn each_part_of_a_configuration_can_be_different() {
    let old = "
vehicle: { id: v, name: Van }
signals: { active: { topic: /a, type: std_msgs/msg/Bool }, old: { topic: /o, type: std_msgs/msg/Bool } }
stops: [{ id: depot, name: Depot, x: 1, y: 2 }]
defaults: { timeout: 2s }
groups:
  - { id: a, match: [{ namespace: /a }], modules: [{ id: m, status: s }] }
  - { id: b, depends_on: [a], when: { signals: { active: true } }, modules: [{ id: m, status: t }] }
  - { id: c, modules: [{ id: m, status: u }] }
";
    let new = "
vehicle: { id: v, name: { en: Van, de: Bus }, stages: none }
signals: { active: { topic: /a, type: std_msgs/msg/Bool, timeout: 3s }, new: { topic: /n, type: std_msgs/msg/Bool } }
stops: [{ id: depot, name: Depot, x: 1.5, y: 2 }, { id: home, x: 0, y: 0 }]
defaults: { timeout: 2s, stale: error }
limits: { discovered_modules: 9 }
display: { dpi: 170 }
localized_after: 5s
motion: { speed: { topic: /v, type: std_msgs/msg/Float64 } }
groups:
  - { id: a, combine: any, tile: { column: 1, row: 2 }, match: [{ regex: 'a.*' }], modules: [{ id: m, status: other, help: Stop., latch: 1s }] }
  - { id: b, depends_on: [{ on: a, masks_when: [error, unknown] }, { any_of: [a/m] }], when: { stages: [active] }, modules: [{ id: m, status: t, stale: unknown, depends_on: [a/m] }] }
  - { id: d, modules: [{ id: m, status: u, stale: unknown }] }
";
    check(
        old,
        new,
        &[
            "the vehicle: name from \"Van\" to \"Van\" / \"Bus\"; stages from shuttle to none; defaults from unknown after 2s of silence to error after 2s of silence; limits.discovered_modules from 4096 to 9; display.dpi from 149 to 170; localized_after from 2s to 5s; motion from no speed is configured to data of /v (std_msgs/msg/Float64), unknown when older than 1s, standing below 0.1 m/s; initialpose from /initialpose to switched off; stage from /telltale/stage to switched off; clearance from /telltale/clearance to switched off; deceleration_request from /telltale/deceleration_request every 50ms to switched off; maneuver_stop_request from /telltale/maneuver_stop_request to switched off; hold from /telltale/hold to switched off",
            "signal `old` is gone",
            "signal `active`: source from /a std_msgs/msg/Bool.data to /a std_msgs/msg/Bool.data, unknown when older than 3s",
            "signal `new` is new",
            "stop `depot`: place from x 1 m, y 2 m, 0 degrees to x 1.5 m, y 2 m, 0 degrees",
            "stop `home` is new",
            "group `c` is gone",
            "group `a`: combine from worst to any; match from [the namespace '/a'] to [a name that matches 'a.*']; tile from by itself to column 1, row 2",
            "group `b`: when from active is true to the stage is active; depends_on from [a] to [a (also when unknown), any of (a/m)]",
            "group `d` is new",
            "module `c/m` is gone",
            "module `a/m`: help from none to \"Stop.\"; policy from unknown after 2s of silence to error after 2s of silence, an error of 1s stays until reset; monitor from status 's' to status 'other'",
            "module `b/m`: depends_on from nothing to [a/m]",
            "module `d/m` is new",
        ],
    );
}

#[test]
fn what_means_the_same_is_not_different() {
    let old = "groups: [{ id: a, depends_on: [b], modules: [{ id: m, status: s, timeout: 1m }] }, { id: b, match: [{ name: x }] }]\n";
    let new = "# The same.\ngroups:\n  - { id: a, depends_on: [{ on: b, masks_when: [error] }], modules: [{ id: m, timeout: 60s, monitor: { self_state: { status: s } } }] }\n  - { id: b, match: [{ name: x }] }\n";
    check(old, new, &[]);
}

#[test]
fn an_order_is_a_difference() {
    check(
        "groups: [{ id: a, match: [{ name: x }] }, { id: b, match: [{ name: y }] }]\n",
        "groups: [{ id: b, match: [{ name: y }] }, { id: new, match: [{ name: z }] }, { id: a, match: [{ name: x }] }]\n",
        &["group `new` is new", "the groups: they stand in another order"],
    );
}

#[test]
fn every_key_of_a_monitor_is_a_difference() {
    let text = |monitor: &str| {
        let monitor =
            monitor.replace('T', "topic: /t, type: a/msg/B").replace('U', "topic: /u, type: a/msg/B");
        format!("groups: [{{ id: a, modules: [{{ id: m, monitor: {{ {monitor} }} }}] }}]\n")
    };
    // T and U stand for two topics.
    let pairs = "\
frequency: { T, error_below: 1 } => frequency: { U, error_below: 1 }
frequency: { T, error_below: 1 } => frequency: { T, warning_below: 1 }
frequency: { T, error_below: 1 } => frequency: { T, window: 3s, error_below: 1 }
frequency: { topic: /t, type: a/msg/B, error_below: 1 } => frequency: { topic: /t, type: a/msg/C, error_below: 1 }
latency: { T, error_above: 1s } => latency: { T, error_above: 2s }
value: { T, field: x, error_above: 1 } => value: { T, field: y, error_above: 1 }
value: { status: s, key: k, error_unless: 1 } => value: { status: s, key: k, error_unless: '1' }
value: { status: s, key: k, error_unless: 1 } => value: { status: s, key: l, error_unless: 1 }
watchdog: { node: /n } => watchdog: { icmp: n }
watchdog: { node: /n } => watchdog: { qos: /n }
watchdog: { node: /n } => watchdog: { node: /n, every: 2s }
watchdog: { node: /n } => watchdog: { node: /n, misses: 2 }
rate_ratio: { input: { T }, output: { U }, error_below: 1 } => rate_ratio: { input: { U }, output: { T }, error_below: 1 }
sequence: { earlier: { status: s, key: a }, later: { status: s, key: b }, error_above: 1 } => sequence: { earlier: { status: s, key: a }, later: { status: s, key: b }, max_gap: 3s, error_above: 1 }
agreement: { a: { T, pose: x }, b: { U, pose: x }, translation: { error_above: 1 } } => agreement: { a: { T, pose: x }, b: { U, pose: x }, rotation_deg: { error_above: 1 } }
agreement: { a: { T, field: x }, b: { U, field: x }, error_above: 1 } => agreement: { a: { T, field: x }, b: { U, field: x }, motion_over: 1s, error_above: 1 }
expression: { inputs: { x: { status: s, key: k } }, error: x > 1 } => expression: { inputs: { x: { status: s, key: k } }, error: x > 2 }
expression: { inputs: { x: { status: s, key: k } }, error: x > 1 } => expression: { inputs: { x: { status: s, key: k } }, max_age: 2s, error: x > 1 }
external: { status: s, class: { location: isolated, information: meta } } => external: { status: s, class: { location: isolated, information: meta, flow: parallel } }";
    let load = |text: &str| parse("c", text).unwrap_or_else(|problems| panic!("{problems}"));
    for pair in pairs.lines() {
        let (old, new) = pair.split_once(" => ").unwrap();
        let (was, is) = (load(&text(old)), load(&text(new)));
        assert_eq!(difference(&was, &was), []);
        let found = difference(&was, &is);
        assert!(
            matches!(&found[..], [one] if one.subject == "module `a/m`" && one.detail.starts_with("monitor from")),
            "{pair}: {found:?}"
        );
    }
}

#[test]
fn countermeasures_and_topics_that_are_published_can_be_different() {
    let head =
        "groups: [{ id: a, modules: [{ id: m, status: s }] }, { id: b, modules: [{ id: m, status: t }] }]\n";
    let (stop, slow) = (
        "{ request: maneuver_stop, when: { groups: [a] } }",
        "{ request: decelerate, when: { groups: [b] } }",
    );
    check(
        &format!("{head}countermeasures: [{stop}, {slow}]\n"),
        &format!(
            "{head}countermeasures: [{{ request: decelerate, mps2: 2, when: {{ groups: [b] }} }}, {stop}]\npublish: {{ toplevel_state: false, diagnostics_agg: {{ rate: 2 }}, stage: {{ topic: /s }} }}\ndefaults: {{ no_publisher: error }}\n"
        ),
        &[
            "the vehicle: defaults from unknown after 2s of silence to unknown after 2s of silence, error without a publisher; diagnostics_agg from /diagnostics_agg every 1s to /diagnostics_agg every 500ms; toplevel_state from /diagnostics_toplevel_state every 1s to switched off; stage from /telltale/stage to /s",
            "module `a/m`: policy from unknown after 2s of silence to unknown after 2s of silence, error without a publisher",
            "module `b/m`: policy from unknown after 2s of silence to unknown after 2s of silence, error without a publisher",
            "countermeasure `decelerate by 1 m/s² when b is error in active` is gone",
            "countermeasure `decelerate by 2 m/s² when b is error in active` is new",
        ],
    );
    check(
        &format!("{head}countermeasures: [{stop}, {slow}]\n"),
        &format!("{head}countermeasures: [{slow}, {stop}]\n"),
        &["the countermeasures: they stand in another order"],
    );
}

#[test]
fn what_becomes_of_other_statuses_and_of_silence_is_a_difference() {
    check(
        "groups: [{ id: a, match: [{ name: x, forget_after: 1m }], modules: [{ id: m, status: s }] }]\n",
        "other: counted\ngroups: [{ id: a, match: [{ name: x }], modules: [{ id: m, status: s, forget_after: 1m }] }]\n",
        &[
            "the vehicle: other from shown to counted",
            "group `a`: match from [the name 'x' (unknown after 2s of silence, forgotten after 1m)] to [the name 'x']",
            "module `a/m`: policy from unknown after 2s of silence to unknown after 2s of silence, forgotten after 1m",
        ],
    );
}

#[test]
fn other_words_at_one_level_are_a_difference() {
    let text = |help: &str| {
        format!("groups: [{{ id: a, modules: [{{ id: m, status: s, name: N, help: {help} }}] }}]\n")
    };
    check(
        &text("H"),
        &text("{ warning: W, error: { standby: S, active: { en: A, de: B, urgency: be_ready } } }"),
        &[
            "module `a/m`: help from \"H\" to warning \"W\", error \"S\" in standby and \"A\" / \"B\" (be_ready) in active",
        ],
    );
}

#[test]
fn who_may_say_a_status_can_be_different() {
    check(
        "groups: [{ id: a, match: [{ namespace: /a }], modules: [{ id: m, status: s, writers: [/x] }] }]",
        "groups: [{ id: a, match: [{ namespace: /a, writers: [/x] }], modules: [{ id: m, status: s, writers: [/x, /y] }] }]",
        &[
            "group `a`: match from [the namespace '/a'] to [the namespace '/a' (unknown after 2s of silence, said by /x alone)]",
            "module `a/m`: policy from unknown after 2s of silence, said by /x alone to unknown after 2s of silence, said by /x or /y alone",
        ],
    );
}
