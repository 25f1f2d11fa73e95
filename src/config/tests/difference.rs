//! What a reload says of two configurations.

use crate::config::{difference, parse};

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
localized_after: 5s
groups:
  - { id: a, combine: any, tile: { column: 1, row: 2 }, match: [{ regex: 'a.*' }], modules: [{ id: m, status: other, help: Stop., latch: 1s }] }
  - { id: b, depends_on: [{ on: a, masks_when: [error, unknown] }, { any_of: [a/m] }], when: { stages: [active] }, modules: [{ id: m, status: t, stale: unknown, depends_on: [a/m] }] }
  - { id: d, modules: [{ id: m, status: u, stale: unknown }] }
";
    check(
        old,
        new,
        &[
            "the vehicle: name from \"Van\" to \"Van\" / \"Bus\"; stages from shuttle to none; defaults from unknown after 2s of silence to error after 2s of silence; limits.discovered_modules from 4096 to 9; localized_after from 2s to 5s",
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
