//! Any path is compiled or refused in words; any bytes have a value or a reason for each field.

#![no_main]

use libfuzzer_sys::fuzz_target;
use telltale::engine::model::monitors::{FieldKind, FieldSpec, TopicSpec};
use telltale::engine::model::sample::FieldValue;
use telltale::msg::cdr::Endian;
use telltale::msg::fields::Definitions;

/// Types with a path that goes through all that a message can hold.
const TYPES: [(&str, &str); 6] = [
    ("tf2_msgs/msg/TFMessage", "transforms[child_frame_id=a].transform.rotation.w"),
    ("nav_msgs/msg/Path", "poses[1].pose.position.x"),
    ("sensor_msgs/msg/PointCloud2", "is_dense"),
    ("sensor_msgs/msg/JointState", "effort[2]"),
    ("velodyne_msgs/msg/VelodyneScan", "packets[1].data.length"),
    ("diagnostic_msgs/msg/DiagnosticArray", "status[level=2].values[key=a].value"),
];

fuzz_target!(|input: (u8, bool, bool, &str, &[u8])| {
    let (which, little, pose, path, body) = input;
    let (type_name, known_path) = TYPES[which as usize % TYPES.len()];
    let field = |path: &str, kind| FieldSpec { path: path.into(), kind };
    let kind = if pose { FieldKind::Pose } else { FieldKind::Scalar };
    for fields in [vec![field(known_path, FieldKind::Scalar)], vec![field(path, kind)]] {
        let spec = TopicSpec { topic: "/x".into(), type_name: type_name.into(), stamp: true, fields };
        let reader = match Definitions::default().check(&spec) {
            Ok(reader) => reader,
            Err(errors) => {
                assert!(!errors.0.is_empty() && errors.0.iter().all(|error| !error.help.is_empty()));
                continue;
            }
        };
        let endian = if little { Endian::Little } else { Endian::Big };
        let reading = reader.read(body, endian);
        assert_eq!(reading.values.len(), 1);
        assert!(reading.fault.is_none() || matches!(reading.values[0], FieldValue::Unreadable(_)));
    }
});
