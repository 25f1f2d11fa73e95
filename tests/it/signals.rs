//! Signals that are conditions over values of messages.

use telltale::engine::input::Input;
use telltale::engine::model::Stage;
use telltale::engine::model::sample::{FieldValue, Sample};
use telltale::engine::time::Timestamp;

use crate::by_hand::Vehicle;

fn configuration(signals: &str) -> String {
    format!(
        "vehicle: {{ stages: none }}\nsignals:\n{signals}\ngroups:\n- {{ id: g, modules: [{{ id: m, status: s }}] }}\n"
    )
}

impl Vehicle {
    fn with_signals(signals: &str) -> Vehicle {
        Vehicle::of(&configuration(signals), Stage::Active)
    }

    fn reload_signals(&mut self, at_ms: u64, signals: &str) {
        self.now = Timestamp::from_millis(at_ms);
        self.reload(&configuration(signals));
    }

    fn hear(&mut self, at_ms: u64, topic: &str, value: FieldValue) {
        self.now = Timestamp::from_millis(at_ms);
        let source = self.model.watched.topics.iter().find(|spec| *spec.topic == *topic).unwrap().clone();
        let values = [value].into();
        let sample = Sample::of(source, values);
        self.engine.handle(&Input::Sample(sample), self.now);
    }

    fn value(&mut self, at_ms: u64, signal: &str) -> Option<bool> {
        self.now = Timestamp::from_millis(at_ms);
        self.engine.handle(&Input::Tick, self.now);
        self.look().signals.iter().find(|(name, _)| **name == *signal).unwrap().1
    }
}

const DOCKED: &str = "  docked: { topic: /battery, type: sensor_msgs/msg/BatteryState, field: power_supply_status, when: 'value == 1', timeout: 2s }";

#[test]
fn what_was_heard_for_a_condition_outlives_a_reload_that_renumbers_the_topics() {
    let two = "  both: { inputs: { a: { topic: /a, type: std_msgs/msg/Float64, field: data }, b: { topic: /b, type: std_msgs/msg/Float64, field: data } }, when: a > b }";
    let mut vehicle = Vehicle::with_signals(&format!("{DOCKED}\n{two}"));
    vehicle.hear(1000, "/battery", FieldValue::Number(1.0));
    vehicle.hear(1000, "/a", FieldValue::Number(2.0));
    vehicle.hear(1000, "/b", FieldValue::Number(1.0));
    assert_eq!((vehicle.value(1100, "docked"), vehicle.value(1100, "both")), (Some(true), Some(true)));
    let first = "  first: { topic: /c, type: std_msgs/msg/Float64, when: value > 0 }";
    vehicle.reload_signals(1200, &format!("{first}\n{two}\n{DOCKED}"));
    assert_eq!((vehicle.value(1300, "docked"), vehicle.value(1300, "both")), (Some(true), Some(true)));
    // One input alone is judged with the last value of the other before the reload.
    vehicle.hear(1400, "/b", FieldValue::Number(3.0));
    assert_eq!(vehicle.value(1400, "both"), Some(false));
    assert_eq!((vehicle.value(2999, "docked"), vehicle.value(3000, "docked")), (Some(true), None));
    // Another condition knows nothing yet.
    vehicle.hear(3100, "/battery", FieldValue::Number(1.0));
    vehicle.reload_signals(3200, &DOCKED.replace("== 1", "!= 1"));
    assert_eq!(vehicle.value(3200, "docked"), None);
}

#[test]
fn an_event_is_the_message_with_which_the_condition_holds() {
    let mut vehicle = Vehicle::with_signals(
        "  goal: { topic: /goal, type: std_msgs/msg/String, when: 'value != \"\"', present_for: 5s }",
    );
    let text = |text: &str| FieldValue::Text(text.into());
    assert_eq!(vehicle.value(0, "goal"), Some(false));
    vehicle.hear(1000, "/goal", text("depot"));
    assert_eq!((vehicle.value(5999, "goal"), vehicle.value(6000, "goal")), (Some(true), Some(false)));
    vehicle.hear(7000, "/goal", text("depot"));
    vehicle.hear(8000, "/goal", FieldValue::Unreadable("cut".into()));
    assert_eq!(vehicle.value(8000, "goal"), Some(true), "what cannot be read takes no goal back");
    vehicle.hear(9000, "/goal", text(""));
    assert_eq!(vehicle.value(9000, "goal"), Some(false));
}

#[test]
fn a_value_of_another_kind_leaves_the_signal_unknown() {
    let mut vehicle = Vehicle::with_signals(DOCKED);
    vehicle.hear(1000, "/battery", FieldValue::Number(1.0));
    assert_eq!(vehicle.value(1000, "docked"), Some(true));
    for value in [FieldValue::Text("1".into()), FieldValue::Bool(true), FieldValue::Number(f64::NAN)] {
        vehicle.hear(1500, "/battery", value.clone());
        assert_eq!(vehicle.value(1500, "docked"), None, "{value:?}");
    }
    // A message without the element says nothing of it.
    vehicle.hear(1600, "/battery", FieldValue::Number(3.0));
    vehicle.hear(1700, "/battery", FieldValue::Absent);
    assert_eq!(vehicle.value(1700, "docked"), Some(false));
}
