//! Tests of the sources of the vehicle's motion.

use super::*;
use crate::describe::words;
use telltale_engine::model::monitors::FieldKind;

const SPEED: &str = "topic: /can/speed, type: geometry_msgs/msg/TwistStamped, field: twist.linear.x";

#[track_caller]
fn model(text: &str) -> Arc<telltale_engine::model::Model> {
    parse("c", &format!("{GROUP}{text}")).unwrap_or_else(|problems| panic!("{problems}")).model
}

#[test]
fn a_speed_has_a_timeout_and_a_limit_of_standing() {
    let of = |text: &str| words::motion(&model(text));
    assert_eq!(of(""), "no speed is configured");
    assert_eq!(
        of(&format!("motion: {{ speed: {{ {SPEED} }} }}\n")),
        "twist.linear.x of /can/speed (geometry_msgs/msg/TwistStamped), unknown when older than 1s, standing below 0.1 m/s"
    );
    assert_eq!(
        of(
            "motion: { speed: { topic: /v, type: std_msgs/msg/Float64, timeout: 200ms }, standing_below: 0.3 }\n"
        ),
        "data of /v (std_msgs/msg/Float64), unknown when older than 200ms, standing below 0.3 m/s"
    );
    let position = "position: { topic: /pose, type: geometry_msgs/msg/PoseStamped, pose: pose, timeout: 2s }";
    assert!(of(&format!("motion: {{ speed: {{ {SPEED} }}, {position} }}\n")).ends_with(
        "; position from the pose pose of /pose (geometry_msgs/msg/PoseStamped), unknown when older than 2s"
    ));
    // A machine without stages may move too.
    of(&format!("vehicle: {{ stages: none }}\nmotion: {{ speed: {{ {SPEED} }} }}\n"));
}

#[test]
fn what_makes_no_motion_is_said_at_its_place() {
    check_beside_group("motion: {}\n", &["2:9: the motion needs `speed` (add `speed: ...`)"]);
    check_beside_group(
        &format!("motion: {{ speed: {{ {SPEED}, timeout: 0s }}, standing_below: -1 }}\n"),
        &[
            "2:109: an older speed says nothing about the present motion (write a duration above 0 and up to 10s)",
            "2:131: -1 m/s is no limit of standing (write a speed above 0 and up to 1, for example `0.1`)",
        ],
    );
    check_beside_group(
        "motion: { speed: { topic: /v, type: std_msgs/msg/Float64 }, position: { topic: /p, type: geometry_msgs/msg/PoseStamped, pose: pose, timeout: 11s } }\n",
        &[
            "2:142: an older position says nothing about the present place (write a duration above 0 and up to 10s)",
        ],
    );
    check_beside_group(
        "motion: { speed: { topic: /v, type: geometry_msgs/msg/TwistStamped } }\n",
        &["2:37: which field of a geometry_msgs/msg/TwistStamped? (add `field: PATH`)"],
    );
}

#[test]
fn the_destination_comes_from_goals_that_are_poses() {
    let goal_of = |goal: &str, stops: &str| {
        let model = model(&format!("signals: {{ goal: {{ {goal} }} }}\n{stops}"));
        model.driving.goal.map(|goal| {
            let topic = &model.watched.topics[goal.topic.0 as usize];
            let field = &topic.fields[goal.field as usize];
            assert_eq!((&*field.path, field.kind), ("pose", FieldKind::Pose));
            topic.topic.to_string()
        })
    };
    let pose = "topic: /goal_pose, type: geometry_msgs/msg/PoseStamped, present_for: 3s";
    let stops = "stops: [{ id: depot, x: 1, y: 2 }]\n";
    assert_eq!(goal_of(pose, stops).as_deref(), Some("/goal_pose"));
    assert_eq!(
        goal_of(&format!("{pose}, field: header.frame_id, when: value == 'map'"), stops).as_deref(),
        Some("/goal_pose")
    );
    assert_eq!(goal_of(pose, ""), None);
    assert_eq!(goal_of("topic: /goal, type: std_msgs/msg/Bool", stops), None);
    assert_eq!(goal_of("topic: /goal, present_for: 3s", stops), None);
}
