//! Tests of publications, and of folders with message definitions.

use super::*;
use crate::publishing::{Periodic, Publishing, Rosout};
use telltale_engine::model::output::LogLevel;

#[test]
fn names_and_rates_can_be_chosen() {
    let loaded = parse("c", GROUP).unwrap();
    assert_eq!(loaded.publishing, Publishing::default());
    let text = format!(
        "{GROUP}publish: {{ diagnostics_agg: {{ rate: 2 Hz, beside_others: true }}, rosout: {{ level: error }}, toplevel_state: false, initialpose: {{ topic: /pose }}, deceleration_request: {{ topic: /slow, rate: 10 }} }}\n"
    );
    let loaded = parse("c", &text).unwrap_or_else(|problems| panic!("{problems}"));
    let periodic = |topic: &str, millis, beside_others| {
        Some(Periodic { topic: topic.into(), period: time::Span::from_millis(millis), beside_others })
    };
    let expected = Publishing {
        diagnostics_agg: periodic("/diagnostics_agg", 500, true),
        toplevel_state: None,
        rosout: Some(Rosout { topic: "/rosout".into(), level: LogLevel::Error }),
        initialpose: Some("/pose".into()),
        deceleration_request: periodic("/slow", 100, false),
        ..Publishing::default()
    };
    assert_eq!(loaded.publishing, expected);
}

#[test]
fn a_machine_without_stages_is_told_nothing_but_what_its_configuration_asks_for() {
    let of = |more: &str| {
        let text = format!("vehicle: {{ stages: none }}\n{GROUP}{more}");
        parse("c", &text).unwrap_or_else(|problems| panic!("{problems}")).publishing
    };
    let full = Publishing::default();
    let diagnosis = Publishing {
        initialpose: None,
        stage: None,
        clearance: None,
        deceleration_request: None,
        maneuver_stop_request: None,
        hold: None,
        ..full.clone()
    };
    assert_eq!(of(""), diagnosis);
    let stage = Publishing { stage: full.stage.clone(), ..diagnosis.clone() };
    assert_eq!(of("publish: { stage: {} }\n"), stage);
    let stops = Publishing {
        maneuver_stop_request: full.maneuver_stop_request,
        hold: full.hold.clone(),
        ..diagnosis.clone()
    };
    assert_eq!(of("countermeasures:\n- { request: maneuver_stop, when: { groups: [a] } }\n"), stops);
    assert_eq!(of("publish: { hold: {} }\n"), Publishing { hold: full.hold, ..diagnosis });
}

#[test]
fn what_is_published_can_be_and_is_not_read() {
    check_beside_group(
        "publish: { stage: { topic: stage }, clearence: false, toplevel_state: { rate: 0 }, clearance: { rate: 1 } }\n",
        &[
            "2:28: `stage` is no full topic name (begin with `/`; letters, digits, `_` and `/` follow: `/mission/active`)",
            "2:37: unknown key `clearence` in what is published (did you mean `clearance`?)",
            "2:79: expected a rate, found `0` (write 0.1 Hz to 100 Hz, for example `20 Hz`)",
            "2:97: unknown key `rate` in a published topic (known here: topic)",
        ],
    );
    check_beside_group(
        "publish: { stage: { topic: /a }, clearance: { topic: /a } }\n",
        &["2:54: `clearance` and `stage` would publish one topic, /a (give each a topic of its own)"],
    );
    check_beside_group(
        "publish: { deceleration_request: { beside_others: true } }\n",
        &[
            "2:36: unknown key `beside_others` in a topic that is published again and again (known here: topic, rate)",
        ],
    );
    check_beside_group(
        "publish: { initialpose: false, deceleration_request: false, maneuver_stop_request: false }\n",
        &["2:25: this cannot be switched off: operators could not localize the vehicle (remove the line)"],
    );
    check_beside_group(
        "vehicle: { stages: none }\npublish: { initialpose: false, deceleration_request: false, maneuver_stop_request: false }\ncountermeasures:\n- { request: decelerate, when: { groups: [a] } }\n- { request: maneuver_stop, when: { groups: [a] } }\n",
        &[
            "3:54: this cannot be switched off: a countermeasure asks for a deceleration (remove the line)",
            "3:84: this cannot be switched off: a countermeasure asks for a stop (remove the line)",
        ],
    );
    for (rest, why) in [
        ("publish: { hold: false }\n", "2:18"),
        (
            "vehicle: { stages: none }\npublish: { hold: false }\ncountermeasures:\n- { request: maneuver_stop, when: { groups: [a] } }\n",
            "3:18",
        ),
    ] {
        let problem = format!(
            "{why}: this cannot be switched off: nothing else releases a vehicle that was asked to stop (remove the line)"
        );
        check_beside_group(rest, &[&problem]);
    }
    let unstoppable = format!("{GROUP}publish: {{ hold: false, maneuver_stop_request: false }}\n");
    assert_eq!(parse("c", &unstoppable).unwrap().publishing.hold, None);
    check_beside_group(
        "signals: { s: { topic: /telltale/clearance, type: std_msgs/msg/Bool } }\n",
        &[
            "2:24: /telltale/clearance is read here, and published by this program as `clearance` (read another topic, or write `publish: { clearance: { topic: /OTHER } }`, or `clearance: false`)",
        ],
    );
}

#[test]
fn message_folders_are_relative_to_the_file_that_names_them() {
    let scratch = Scratch::new("folders");
    std::fs::create_dir_all(scratch.0.join("inner/share")).unwrap();
    scratch.write("inner/b.yaml", b"message_folders: [share]\n");
    let main = scratch.write("a.yaml", format!("include: [inner/b.yaml]\n{GROUP}").as_bytes());
    let loaded = load(&main).unwrap_or_else(|problems| panic!("{problems}"));
    assert_eq!(loaded.message_folders, [scratch.0.join("inner/share")]);
    let wrong = scratch.write("w.yaml", format!("message_folders: [none, inner, inner]\n{GROUP}").as_bytes());
    assert_eq!(
        scratch.problems(&wrong),
        [
            "w.yaml:1:19: there is no folder `none` (name a folder that holds `package/msg/Name.msg`, such as a ROS installation's `share`)",
            "w.yaml:1:32: this folder is named twice (remove one of the two)",
        ]
    );
}
