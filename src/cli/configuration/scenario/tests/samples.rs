//! Tests of scenario steps for watched topics and probes.

use super::check;

/// Monitors of a field, a pose, a latency and a node.
const HEAD: &str = "name: n
config:
  vehicle: { stages: none }
  groups:
    - id: a
      modules:
        - { id: v, monitor: { value: { topic: /speed, type: a/msg/B, field: x, error_above: 3 } } }
        - { id: p, monitor: { agreement: { a: { topic: /pose, type: a/msg/P, pose: p }, b: { topic: /pose, type: a/msg/P, pose: q }, rotation_deg: { error_above: 10 } } } }
        - { id: l, monitor: { latency: { topic: /scan, type: a/msg/S, error_above: 1s } } }
        - { id: n, monitor: { watchdog: { node: /planner, misses: 1 } } }
steps:
";

#[track_caller]
fn check_steps(steps: &str, expected: &[&str]) {
    check(&format!("{HEAD}{steps}"), expected);
}

#[test]
fn samples_name_what_is_watched() {
    check_steps(
        "  - { at: 1, sample: { topic: /sped } }
  - { at: 1, sample: { topic: /speed, fields: { y: 1 } } }
  - { at: 1, sample: { topic: /speed, delay: 1, fields: { x: { x: 1 } } } }
  - { at: 1, sample: { topic: /pose, fields: { p: 1, q: { unreadable: it is short } } } }
  - { at: 1, publishers: { topic: /scam } }
  - { at: 1, probe: { node: /planer, answered: true } }
  - { at: 1, probe: { icmp: lidar, answered: true } }
  - { at: 1, sample: { topic: /scan, fields: { y: 1 } } }
",
        &[
            "12:31: nothing watches the topic `/sped` (did you mean `/speed`?)",
            "13:49: nothing reads `y` of /speed (these are read: x)",
            "14:46: no monitor reads the stamp of /speed (remove it, or add a latency monitor)",
            "14:62: `x` is read as one value (for example `1.5`)",
            "15:51: `p` is read as a pose (for example `{ x: 1, y: 2, yaw_deg: 90 }`)",
            "16:35: nothing watches the topic `/scam` (did you mean `/scan`?)",
            "17:29: the configuration has no such watchdog (did you mean `/planner`?)",
            "18:29: the configuration has no such watchdog (add a monitor of the kind `watchdog`)",
            "19:48: nothing reads `y` of /scan (its messages are only counted or timed: remove it from `fields`)",
        ],
    );
}

#[test]
fn samples_and_probes_are_written_in_one_way() {
    check_steps(
        "  - { at: 1, sample: { topic: /speed, fields: { x: [1] } } }
  - { at: 1, sample: { topic: /pose, fields: { p: { yaw_deg: 1, qw: 1 }, q: { w: 1 } } } }
  - { at: 1, every: 1, sample: { topic: /scan, stamp: 3 } }
  - { at: 1, probe: { answered: true } }
  - { at: 1, probe: { node: /n, tcp: 'a:1', answered: true } }
  - { at: 1, probe: { node: /planner } }
  - { at: 1, clock_step: 1h }
  - { at: 1, probe: { node: /planner, answered: true, after: 1 } }
  - { at: 1, probe: { node: /planner, answered: true, state: inactive } }
",
        &[
            "12:52: `x` is read as one value (for example `1.5`)",
            "13:51: a rotation is either `yaw_deg` or a quaternion (remove one of the two)",
            "13:79: unknown key `w` in a pose of a sample (known here: x, y, z, yaw_deg, qx, qy, qz, qw)",
            "14:55: every one of these messages would have the same stamp (write how old each is when it comes: `delay: 0.05`)",
            "15:21: a probe asks one of `icmp`, `tcp`, `node`, `service`, `lifecycle`, `qos`, `system` (for example `probe: { node: /planner, answered: false }`)",
            "16:21: a probe asks one of `icmp`, `tcp`, `node`, `service`, `lifecycle`, `qos`, `system` (for example `probe: { node: /planner, answered: false }`)",
            "16:38: the configuration has no such watchdog (add a monitor of the kind `watchdog`)",
            "17:21: a probe needs either `answered` or `impossible` (write `answered: true`, `answered: false` or `impossible: WHY`; `measured: 70` beside `system`)",
            "18:26: expected a number, found `1h` (write digits with a point, for example `12.5`)",
            "19:62: only an answer of `icmp`, `tcp` or `lifecycle` takes a time (remove `after`, or write `answered: true` beside one of these)",
            "20:62: only a `lifecycle` node that answers says its state (write `probe: { lifecycle: /planner, answered: true, state: inactive }`)",
        ],
    );
}

#[test]
fn what_is_written_reaches_the_monitors() {
    check_steps(
        "  - { at: 0.5, sample: { topic: /speed, fields: { x: 3.5 } } }
  - { at: 0.5, sample: { topic: /pose, fields: { p: { x: 1, yaw_deg: 90 }, q: { qz: 1, qw: 1 } } } }
  - { at: 0.5, sample: { topic: /scan, stamp: 0.4 } }
  - { at: 0.5, probe: { node: /planner, answered: false } }
  - { at: 1, sample: { topic: /pose, fields: { p: { yaw_deg: 90 }, q: { yaw_deg: 101 } } } }
  - { at: 1.2, clock_step: 2 }
  - { at: 1.3, sample: { topic: /scan, delay: 0.1 } }
expect:
  - { at: 0.9, modules: { a/v: error, a/p: ok, a/l: ok, a/n: error } }
  - { at: 1.4, modules: { a/p: error, a/l: error } }
",
        &[],
    );
}

#[test]
fn listeners_are_of_a_request_that_is_published() {
    check(
        "name: n
config:
  groups: [{ id: a, match: [{ name: n }] }]
  publish: { deceleration_request: false }
steps:
  - { at: 1, listeners: { request: brake, count: 0 } }
  - { at: 1, listeners: { count: 0 } }
  - { at: 1, listeners: { request: maneuver_stop } }
  - { at: 1, listeners: { request: decelerate, count: 1 } }
",
        &[
            "6:36: unknown request `brake` (one of: maneuver_stop, decelerate)",
            "7:25: a step of listeners needs `request` (add `request: maneuver_stop`)",
            "8:25: a step of listeners needs `count` (add `count: ...`)",
            "9:36: the configuration does not publish `decelerate` (remove the step, or the line of `publish` that switches it off)",
        ],
    );
}
