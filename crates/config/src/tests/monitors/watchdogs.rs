//! Tests of watchdogs: their targets and their limits.

use super::{means, wrong};

#[test]
fn watchdogs_ask_what_can_be_asked() {
    let one = "a watchdog asks one of `icmp`, `tcp`, `node`, `service`, `lifecycle`, `qos` (for example `icmp: 192.168.1.201`, `tcp: gateway:22` or `node: /mission`)";
    wrong("watchdog: { every: 1s }", &[&format!("11: {one}")]);
    wrong("watchdog: { icmp: a, node: /b }", &[&format!("11: {one}")]);
    wrong(
        "watchdog: { icmp: 'a b' }",
        &["19: `a b` cannot be asked by icmp (write the name or the address of a machine: `192.168.1.201`)"],
    );
    for address in ["gateway", "gateway:0", "gateway:70000", ":80", "fe80::1:80"] {
        wrong(
            &format!("watchdog: {{ tcp: '{address}' }}"),
            &[&format!(
                "18: `{address}` cannot be asked by tcp (write `HOST:PORT`: `gateway:22`, `192.168.1.201:80` or `[fe80::1]:80`)"
            )],
        );
    }
    wrong(
        "watchdog: { node: planner }",
        &["19: `planner` cannot be asked by node (write the node with its namespace: `/planning/planner`)"],
    );
}

#[test]
fn an_answer_has_limits_where_somebody_is_asked() {
    means(
        "watchdog: { icmp: lidar, every: 2s, warning_above: 20ms, error_above: 0.1s }",
        "an echo from lidar every 2s: error after 3 misses, warning above 0.02 s, error above 0.1 s",
    );
    means(
        "watchdog: { lifecycle: /planner_server, error_above: 500ms }",
        "whether the lifecycle node /planner_server is active every 1s: error after 3 misses, error above 0.5 s",
    );
    means("watchdog: { service: /map/get }", "who serves /map/get every 1s: error after 3 misses");
    wrong(
        "watchdog: { service: get }",
        &[
            "22: `get` cannot be asked by service (write the service with its namespace: `/planning/get_plan`)",
        ],
    );
    for target in ["node: /n", "service: /n"] {
        let column = 11 + "{ , ".len() + target.len();
        wrong(
            &format!("watchdog: {{ {target}, error_above: 1ms }}"),
            &[&format!(
                "{column}: discovery says that it is there, not how soon it answers (remove the limit; for a time, watch the latency of what it publishes, or ask its machine by `icmp` or `tcp`)"
            )],
        );
    }
    wrong(
        "watchdog: { lifecycle: planner }",
        &[
            "24: `planner` cannot be asked by lifecycle (write the lifecycle node with its namespace: `/planner_server`)",
        ],
    );
    wrong(
        "watchdog: { icmp: lidar, restarts_error_above: 2 }",
        &["48: only the restarts of a `node` are known (remove the limit, or watch the `node`)"],
    );
    wrong(
        "watchdog: { node: /n, restarts_warning_above: 2, restarts_error_above: 1 }",
        &[
            "72: `restarts_error_above` is below `restarts_warning_above` (exchange the two, or correct one of them)",
        ],
    );
    wrong(
        "watchdog: { icmp: lidar, every: 1s, warning_above: 0s, error_above: 1s }",
        &[
            "37: an answer always takes longer than this (choose a duration above 0, for example `20ms`)",
            "56: `error_above` is never reached: no answer within `every` is a miss (choose less than 1s, or ask less often)",
        ],
    );
    wrong(
        "watchdog: { icmp: lidar, warning_above: 30ms, error_above: 20ms }",
        &["41: `warning_above` is above `error_above` (exchange the two, or correct one of them)"],
    );
    wrong(
        "watchdog: { icmp: lidar, error_above: 20 }",
        &[
            "39: expected a duration, found `20` (write a number with one of the units ns, us, ms, s, m, h, d: for example `300ms`)",
        ],
    );
    wrong(
        "watchdog: { icmp: lidar, error_below: 20ms }",
        &[
            "26: unknown key `error_below` in a watchdog monitor (known here: icmp, tcp, node, service, lifecycle, qos, every, misses, warning_above, error_above, restarts_warning_above, restarts_error_above)",
        ],
    );
}
