//! Tests of monitors together with their modules, other monitors and signals.

use super::*;

#[test]
fn a_status_stands_in_the_module_or_in_its_monitor() {
    let module = |module: &str| format!("groups: [{{ id: a, modules: [{{ id: m, {module} }}] }}]\n");
    let class = "class: { location: isolated, information: meta }";
    for good in [
        "status: s, monitor: { self_state: {} }".to_owned(),
        format!("status: s, monitor: {{ external: {{ {class} }} }}"),
        format!("monitor: {{ external: {{ status: s, {class} }} }}"),
    ] {
        let loaded = parse("c", &module(&good)).unwrap_or_else(|problems| panic!("{problems}"));
        assert_eq!(loaded.model.modules[0].monitor.status().map(|status| &**status), Some("s"));
    }
    check(
        &module("monitor: { self_state: {} }"),
        &["1:38: a monitor of a status needs `status` (add `status: 'NAME OF THE STATUS'` to it)"],
    );
    check(
        &module("status: s, monitor: { frequency: { topic: /t, type: a/msg/B, error_below: 1 } }"),
        &["1:49: a module has either `status` or `monitor` (remove one of the two)"],
    );
}

#[test]
fn a_topic_has_one_type_for_all_its_readers() {
    let text = "signals: { s: { topic: /s, type: std_msgs/msg/Bool } }\ngroups:\n- id: a\n  modules:\n  - { id: m, monitor: { frequency: { topic: /s, type: a/msg/B, error_below: 1 } } }\n  - { id: n, monitor: { frequency: { topic: /t, type: a/msg/B, error_below: 1 } } }\n  - { id: o, monitor: { frequency: { topic: /t, type: a/msg/C, error_below: 1 } } }\n  - { id: p, monitor: { frequency: { topic: /diagnostics, type: a/msg/C, error_below: 1 } } }\n";
    let help = "(a topic has one type; correct the type, or name another topic)";
    check(
        text,
        &[
            &format!("5:55: /s is read as std_msgs/msg/Bool already {help}"),
            &format!("7:55: /t is read as a/msg/B already {help}"),
            &format!("8:65: /diagnostics is read as diagnostic_msgs/msg/DiagnosticArray already {help}"),
        ],
    );
}

#[test]
fn no_publisher_is_unknown_or_an_error() {
    let text = "defaults: { no_publisher: error }\ngroups: [{ id: a, modules: [{ id: m, status: s }, { id: n, status: t, no_publisher: unknown }] }]\n";
    let loaded = parse("c", text).unwrap_or_else(|problems| panic!("{problems}"));
    let states: Vec<_> = loaded.model.modules.iter().map(|module| module.policy.no_publisher).collect();
    assert_eq!(states, [State::Error, State::Unknown]);
    check_beside_group(
        "defaults: { no_publisher: warning }\n",
        &["2:27: unknown state `warning` (one of: unknown, error)"],
    );
}
