//! Tests of signals that are conditions over values.

use super::check_beside_group;
use crate::describe::words;
use crate::parse;

fn said(signal: &str) -> Vec<String> {
    let text = format!("{}signals: {{ {signal} }}\n", super::GROUP);
    let loaded = parse("c", &text).unwrap_or_else(|problems| panic!("{problems}"));
    loaded.model.signals.iter().map(|signal| words::signal(&loaded.model, signal)).collect()
}

#[test]
fn a_signal_may_be_a_condition_over_several_values_or_over_one() {
    let battery = "topic: /battery, type: sensor_msgs/msg/BatteryState, field: power_supply_status";
    let cases = [
        (
            format!("docked: {{ inputs: {{ status: {{ {battery} }} }}, when: 'status == 1', timeout: 2s }}"),
            "true if `status == 1` with status = power_supply_status of /battery (sensor_msgs/msg/BatteryState), \
             unknown when older than 2s",
        ),
        (
            format!("docked: {{ {battery}, when: 'value == 1' }}"),
            "true if `value == 1` with value = power_supply_status of /battery (sensor_msgs/msg/BatteryState)",
        ),
        (
            "active: { topic: /mission, type: std_msgs/msg/String, when: 'value == \"driving\"' }".to_owned(),
            "true if `value == \"driving\"` with value = data of /mission (std_msgs/msg/String)",
        ),
        (
            "parked: { status: 'can: gear', key: gear, when: value == 'P', present_for: 3s }".to_owned(),
            "true if `value == 'P'` with value = 'gear' of the status 'can: gear', \
             true for 3s after each message with which the condition holds",
        ),
    ];
    for (text, expected) in cases {
        assert_eq!(said(&text), [expected], "{text}");
    }
}

#[test]
fn what_makes_no_condition_is_said_at_its_place() {
    let of =
        |text: &str, expected: &[&str]| check_beside_group(&format!("signals: {{ {text} }}\n"), expected);
    of(
        "s: { inputs: { x: { topic: /t, type: std_msgs/msg/Bool, field: data } } }",
        &["2:17: a signal of values needs `when` (say when it is true, for example `when: value == 1`)"],
    );
    of(
        "s: { topic: /t, type: sensor_msgs/msg/Imu, when: value > 1 }",
        &["2:34: which field of a sensor_msgs/msg/Imu? (add `field: PATH`)"],
    );
    of(
        "s: { topic: /t, type: std_msgs/msg/Float64, when: x > 1 }",
        &["2:62: there is no input `x` (the inputs are: value)"],
    );
    of(
        "s: { inputs: {}, when: x > 1 }",
        &[
            "2:25: 0 inputs, not 1 to 32 (name what the condition uses: `x: { topic: /t, type: T, field: PATH }`)",
            "2:35: there is no input `x` (name what the condition uses under `inputs`)",
        ],
    );
    of(
        "s: { topic: /t, inputs: { x: { status: s, key: k } }, when: x > 1 }",
        &["2:17: the values of a condition come from `inputs` (move this into one of the `inputs`)"],
    );
}
