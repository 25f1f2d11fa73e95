//! Tests of transforms: the parents of one child frame, from messages with any others.

use super::*;
use telltale_engine::model::sample::Transform as Found;

const PATH: &str = "transforms[child_frame_id=base_link]";

fn read(transforms: &[(&str, &str)]) -> FieldValue {
    let reader = reader("tf2_msgs/msg/TFMessage", false, &[(PATH, FieldKind::Transforms)]);
    let transforms: Vec<_> = transforms
        .iter()
        .map(|&(parent, child)| Transform {
            header: header(parent),
            child_frame_id: child,
            pose: at(1.0, 2.0),
        })
        .collect();
    let reading = reader.read(&encode::tf_message(&transforms), Endian::Little);
    assert_eq!(reading.fault, None);
    reading.values.into_iter().next().unwrap()
}

fn found(parents: &[&str]) -> FieldValue {
    let of = |parent: &&str| Found { parent: (*parent).into(), stamp_ns: Some(STAMP_NS) };
    FieldValue::Transforms(parents.iter().map(of).collect())
}

#[test]
fn the_parents_of_a_frame_are_read_and_all_else_is_passed_over() {
    assert_eq!(read(&[("map", "odom"), ("odom", "base_link"), ("base_link", "lidar")]), found(&["odom"]));
    assert_eq!(read(&[("odom", "base_link"), ("odom", "base_link")]), found(&["odom"]));
    assert_eq!(read(&[("/odom", "/base_link")]), found(&["odom"]));
    assert_eq!(read(&[("map", "odom")]), FieldValue::Absent);
    assert_eq!(read(&[]), FieldValue::Absent);
    // As tf2 does.
    assert_eq!(read(&[("", "base_link"), ("base_link", "base_link")]), FieldValue::Absent);
    let many: Vec<String> = (0..50).map(|at| format!("odom{at}")).collect();
    let many: Vec<_> = many.iter().map(|parent| (parent.as_str(), "base_link")).collect();
    assert_eq!(read(&many), found(&["odom0", "odom1"]));
    let long = "x".repeat(5000);
    assert!(matches!(read(&[(&long, "base_link")]), FieldValue::Unreadable(_)));
}

#[test]
fn a_message_that_is_cut_is_unreadable_and_other_types_are_refused() {
    let reader = reader("tf2_msgs/msg/TFMessage", false, &[(PATH, FieldKind::Transforms)]);
    let header = header("odom");
    let body = encode::tf_message(&[Transform { header, child_frame_id: "base_link", pose: at(1.0, 2.0) }]);
    let reading = reader.read(&body[..body.len() - 8], Endian::Little);
    assert!(matches!(&reading.values[..], [FieldValue::Unreadable(_)]) && reading.fault.is_some());
    let refused = |type_name, path| {
        Definitions::default().check(&spec(type_name, false, &[(path, FieldKind::Transforms)])).is_err()
    };
    assert!(refused("nav_msgs/msg/Odometry", PATH));
    assert!(refused("tf2_msgs/msg/TFMessage", "transforms"));
}
