//! Monitors of the content of messages, where their type or the name of their topic says what it means: the charge of a
//! battery, an emergency stop, the goals of an action.

use super::observations::Messages;
use super::rhythm::at_least_ms;
use telltale_engine::model::sample::FieldValue;
use telltale_engine::time::Timestamp;

const BATTERY: &str = "sensor_msgs/msg/BatteryState";
const SWITCH: &str = "std_msgs/msg/Bool";
const GOALS: &str = "action_msgs/msg/GoalStatusArray";
/// The end of the name of an action's topic of goals, behind the name of the action.
const OF_ACTION: &str = "/_action/status";
/// Last words of topics that belong to an emergency stop and do not say that it is pressed.
const OTHERS: [&str; 8] = ["reset", "release", "released", "clear", "cleared", "ok", "enable", "enabled"];
/// The timeout of a value that was heard once.
const GUESS_MS: u64 = 600_000;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Meaning {
    Charge,
    Stop,
    Goal,
}

/// A monitor of a value.
#[derive(Debug)]
pub struct Value {
    pub meaning: Meaning,
    /// `None`: its messages are events, and their silence means nothing.
    pub timeout_ms: Option<u64>,
    /// The evidence, for a comment.
    pub about: String,
}

impl Meaning {
    pub fn of(topic: &str, type_name: &str) -> Option<Meaning> {
        match type_name {
            BATTERY => Some(Meaning::Charge),
            SWITCH if says_stop(topic) => Some(Meaning::Stop),
            GOALS if action(topic).is_some() => Some(Meaning::Goal),
            _ => None,
        }
    }

    /// The words for the id of a module.
    pub fn words(self, topic: &str) -> String {
        match self {
            Meaning::Charge => format!("{topic}_charge"),
            Meaning::Stop => topic.to_owned(),
            Meaning::Goal => format!("{}_goal", action(topic).unwrap_or(topic)),
        }
    }

    /// The field and its limits, as the configuration has them.
    pub fn rule(self) -> &'static str {
        match self {
            Meaning::Charge => "field: percentage, warning_below: 0.2, error_below: 0.08",
            Meaning::Stop => "field: data, error_unless: false",
            Meaning::Goal => "field: 'status_list[-1].status', error_above: 5",
        }
    }
}

/// The field that is read of messages of a type.
pub fn field(type_name: &str) -> Option<&'static str> {
    match type_name {
        BATTERY => Some("percentage"),
        SWITCH => Some("data"),
        GOALS => Some("status_list[-1].status"),
        _ => None,
    }
}

/// The action whose goals a topic tells.
pub fn action(topic: &str) -> Option<&str> {
    topic.strip_suffix(OF_ACTION)
}

/// Whether the name of a switch says that it is an emergency stop: `e_stop`, `estop` or `emergency_stop`.
fn says_stop(topic: &str) -> bool {
    let words: Vec<String> = topic.split(['/', '_']).map(str::to_lowercase).collect();
    let is_one = |word: &String| ["estop", "emergencystop"].contains(&&**word);
    let are_two = |pair: &[String]| ["e", "emergency"].contains(&&*pair[0]) && pair[1] == "stop";
    let is_other = words.last().is_some_and(|last| OTHERS.contains(&&**last));
    !is_other && (words.iter().any(is_one) || words.windows(2).any(are_two))
}

/// The monitor of a topic with this meaning, or the reason why there is none. `is_kept`: its publishers tell a late reader
/// their last message.
pub fn propose(
    meaning: Meaning,
    messages: Option<&Messages>,
    is_kept: bool,
    end: Timestamp,
) -> Result<Value, String> {
    let last = messages.and_then(|messages| messages.value.as_ref());
    let (about, timeout_ms) = match (meaning, last) {
        (Meaning::Goal, last) => (goal(last), None),
        (_, None) => return Err("no message was received".to_owned()),
        (Meaning::Charge, Some(FieldValue::Number(charge))) => {
            let about = format!("Charged to {:.0} %", known(*charge)? * 100.0);
            match messages.and_then(|it| it.rhythm.longest_between_s().map(|_| it.rhythm.longest_s(end))) {
                Some(longest_s) => (
                    format!("{about}, longest pause {longest_s:.1} s."),
                    Some(at_least_ms((3.0 * longest_s).max(1.0))),
                ),
                None => (format!("{about}; heard once, so its timeout is a guess."), Some(GUESS_MS)),
            }
        }
        (Meaning::Stop, Some(FieldValue::Bool(false))) => {
            let steady = messages.and_then(|it| it.rhythm.steady(end));
            let seldom =
                if steady.is_none() { " It comes seldom, so its silence is not judged." } else { "" };
            let about = format!("It said false: it is not pressed.{seldom}");
            (about, steady.map(|it| at_least_ms((3.0 * it.longest_s).max(1.0))))
        }
        (Meaning::Stop, Some(FieldValue::Bool(true))) => {
            return Err("it said true last: it is pressed, or true means that the robot may drive. Where true means pressed, \
                        add a `value` with `field: data, error_unless: false`"
                .to_owned());
        }
        (Meaning::Charge | Meaning::Stop, Some(_)) => return Err("its value cannot be read".to_owned()),
    };
    if timeout_ms.is_none() && !is_kept {
        return Err("it comes seldom, and its publisher keeps no message for a Telltale that starts later: publish it \
                    reliable and transient local, or several times a second"
            .to_owned());
    }
    Ok(Value { meaning, timeout_ms, about })
}

/// A charge from 0 to 1, or the reason why it is none.
fn known(charge: f64) -> Result<f64, String> {
    let voltage = "Limits of the voltage are not guessed, because they depend on the cells: add a `value` with `field: voltage`";
    if charge.is_nan() {
        Err(format!(
            "its percentage is not a number (NaN), so the driver does not know the charge. {voltage}"
        ))
    } else if charge <= 0.0 {
        Err(format!("its percentage is {charge}, so the driver probably does not know the charge. {voltage}"))
    } else if charge > 1.0 {
        Err(format!(
            "its percentage is {charge:.0}, where the message has 0 to 1, so its charge is not judged: correct the driver"
        ))
    } else {
        Ok(charge)
    }
}

/// As `action_msgs/msg/GoalStatus` numbers them.
fn goal(last: Option<&FieldValue>) -> String {
    let status = match last {
        Some(FieldValue::Number(status)) => *status,
        _ => return "No goal came; ERROR while the last one is aborted (6).".to_owned(),
    };
    let names = ["unknown", "accepted", "executing", "canceling", "succeeded", "canceled", "aborted"];
    let name = names.get(status as usize).copied().unwrap_or("unknown");
    format!("The last goal: {name}; ERROR while it is aborted (6).")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::init::text;
    use crate::pretend::Robot;
    use std::sync::Arc;
    use telltale_engine::Engine;
    use telltale_engine::input::Input;
    use telltale_engine::model::monitors::TopicSpec;
    use telltale_engine::model::sample::{ProbeOutcome, PublisherReport, Sample};
    use telltale_engine::state::State;
    use telltale_engine::time::Span;

    const NAVIGATION: (&str, &str) = ("/navigate_to_pose/_action/status", GOALS);
    const NAVIGATION_GOAL: &str = "- { id: navigate_to_pose_goal, monitor: { value: { topic: /navigate_to_pose/_action/status, \
                                   type: action_msgs/msg/GoalStatusArray, field: 'status_list[-1].status', error_above: 5, empty: ok } } }";

    fn number(value: f64) -> Option<FieldValue> {
        Some(FieldValue::Number(value))
    }

    /// The written file, if `check` warns of nothing in it.
    fn written(robot: Robot) -> String {
        let text = text(&robot.heard().draft, true);
        let loaded = telltale_config::parse("draft", &text).unwrap_or_else(|it| panic!("{it}\n{text}"));
        if let (_, Some(problems)) = loaded.soundness() {
            panic!("{problems}\n{text}");
        }
        text
    }

    #[track_caller]
    fn has(text: &str, lines: &[&str]) {
        for line in lines {
            assert!(text.contains(line), "lacks {line}:\n{text}");
        }
    }

    #[test]
    fn an_emergency_stop_is_known_by_its_words() {
        for name in
            ["/e_stop", "/base/estop", "/emergency_stop", "/eStop", "/EmergencyStop", "/e_stop_active"]
        {
            assert_eq!(Meaning::of(name, SWITCH), Some(Meaning::Stop), "{name}");
        }
        for name in ["/base_stop", "/testop", "/e_stop/reset", "/estop_ok", "/emergency", "/bus_stop"] {
            assert_eq!(Meaning::of(name, SWITCH), None, "{name}");
        }
        assert_eq!(Meaning::of("/e_stop", "std_msgs/msg/String"), None);
    }

    #[test]
    fn a_charge_a_stop_and_the_goals_of_an_action_are_proposed_and_well_as_they_were_heard() {
        let robot = Robot::default()
            .tells("/bms", ("/battery_state", BATTERY), Some(1000), number(0.85))
            .tells("/panel", ("/e_stop", SWITCH), Some(100), Some(FieldValue::Bool(false)))
            .tells("/base", ("/base/emergency_stop", SWITCH), None, Some(FieldValue::Bool(false)))
            .tells("/navigator", NAVIGATION, None, None)
            .tells("/dock", ("/dock/_action/status", GOALS), None, number(4.0));
        let text = written(robot);
        has(
            &text,
            &[
                "# Charged to 85 %, longest pause 1.0 s.\n      - { id: battery_state_charge, monitor: { value: { topic: /battery_state, \
                 type: sensor_msgs/msg/BatteryState, field: percentage, warning_below: 0.2, error_below: 0.08 } }, timeout: 3s }",
                "- { id: e_stop, monitor: { value: { topic: /e_stop, type: std_msgs/msg/Bool, field: data, error_unless: false } }, timeout: 1s }",
                "# It said false: it is not pressed. It comes seldom, so its silence is not judged.\n      - { id: base_emergency_stop, \
                 monitor: { value: { topic: /base/emergency_stop, type: std_msgs/msg/Bool, field: data, error_unless: false, empty: unknown } } }",
                "# No goal came; ERROR while the last one is aborted (6).",
                NAVIGATION_GOAL,
                "# The last goal: succeeded; ERROR while it is aborted (6).\n      - { id: dock_goal,",
                "frequency: { topic: /battery_state",
            ],
        );
        assert!(!text.contains("Not judged") && !text.contains("frequency: { topic: /dock"), "{text}");

        // The same again: nothing is worse than UNKNOWN, and then all is OK.
        let model = telltale_config::parse("draft", &text).unwrap().model;
        let mut engine = Engine::new(model.clone(), Timestamp::ZERO);
        for at_ms in (0..=12_000).step_by(100) {
            let now = Timestamp::from_millis(at_ms);
            for source in &model.watched.topics {
                if at_ms == 500 {
                    let report = PublisherReport {
                        source: source.clone(),
                        publishers: 1,
                        other_type: None,
                        transient_local: true,
                        best_effort: false,
                        anew: false,
                    };
                    engine.handle(&Input::Topic(report), now);
                }
                let value = match &*source.topic {
                    "/battery_state" if at_ms % 1000 == 0 => FieldValue::Number(0.85),
                    "/e_stop" => FieldValue::Bool(false),
                    // Its publisher tells a late reader its last message.
                    "/base/emergency_stop" if at_ms == 600 => FieldValue::Bool(false),
                    _ => continue,
                };
                engine.handle(&Input::Sample(sample(source, value)), now);
            }
            for probe in &model.watched.watchdogs {
                let outcome = ProbeOutcome::Answered { after: Span::ZERO };
                let probe = telltale_engine::model::sample::Probe { source: probe.clone(), outcome };
                engine.handle(&Input::Probe(probe), now);
            }
            engine.handle(&Input::Tick, now);
            let snapshot = engine.snapshot();
            for id in snapshot.module_ids() {
                let (info, view) = snapshot.module(id);
                let is_well = match view.state {
                    State::Ok => true,
                    State::Unknown => at_ms < 11_000 || info.id.starts_with("telltale/"),
                    _ => false,
                };
                assert!(is_well, "{at_ms}: {} {} {}", info.id, view.state, view.report.message);
            }
        }
        let aborted = model.watched.topics.iter().find(|it| *it.topic == *NAVIGATION.0).unwrap();
        engine
            .handle(&Input::Sample(sample(aborted, FieldValue::Number(6.0))), Timestamp::from_millis(12_100));
        let snapshot = engine.snapshot();
        let goal = snapshot.node("navigator/navigate_to_pose_goal").map(|node| snapshot.shown(node).0);
        assert_eq!(goal, Some(State::Error), "{text}");
    }

    fn sample(source: &Arc<TopicSpec>, value: FieldValue) -> Sample {
        let values = std::iter::repeat_n(value, source.fields.len()).collect();
        Sample::of(source.clone(), values)
    }

    #[test]
    fn a_switch_that_comes_seldom_is_judged_only_if_its_publisher_would_tell_a_late_reader() {
        let switch = ("/e_stop", SWITCH);
        let robot = Robot::default().tells("/panel", switch, None, Some(FieldValue::Bool(false)));
        let text = written(robot.volatile("/e_stop"));
        has(&text, &["/e_stop (std_msgs/msg/Bool): it comes seldom, and its publisher keeps no message"]);
        assert!(!text.contains("{ id: e_stop,"), "{text}");
    }

    #[test]
    fn what_is_not_known_is_said_and_not_guessed() {
        for (value, why) in [
            (
                number(f64::NAN),
                "its percentage is not a number (NaN), so the driver does not know the charge. Limits of the voltage are not guessed",
            ),
            (
                number(0.0),
                "its percentage is 0, so the driver probably does not know the charge. Limits of the voltage",
            ),
            (number(87.0), "its percentage is 87, where the message has 0 to 1"),
            (Some(FieldValue::Unreadable("it ends early".into())), "its value cannot be read"),
            (None, "no message was received"),
        ] {
            let text = written(Robot::default().tells("/bms", ("/battery", BATTERY), Some(1000), value));
            has(
                &text,
                &[&format!("    # Not judged:\n    #   /battery (sensor_msgs/msg/BatteryState): {why}")],
            );
            assert!(!text.contains("percentage, warning"), "{text}");
        }
        let pressed = Some(FieldValue::Bool(true));
        let text = written(Robot::default().tells("/panel", ("/e_stop", SWITCH), Some(100), pressed));
        has(&text, &["/e_stop (std_msgs/msg/Bool): it said true last", "frequency: { topic: /e_stop,"]);
        assert!(!text.contains("{ id: e_stop,"), "{text}");
    }

    #[test]
    fn a_client_of_an_action_does_not_wait_for_its_goals() {
        let robot = Robot::default()
            .tells("/navigator", NAVIGATION, None, None)
            .publishes("/mission", "/plan", 100)
            .listens("/mission", NAVIGATION.0);
        let text = written(robot);
        has(&text, &[NAVIGATION_GOAL]);
        assert!(!text.contains("depends_on"), "{text}");
    }
}
