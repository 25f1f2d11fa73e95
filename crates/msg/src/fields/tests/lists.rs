//! Tests of lists of positions, from arrays of various messages.

use super::*;
use telltale_engine::model::sample::Elements;

fn list(path: &str) -> Vec<(&str, FieldKind)> {
    vec![(path, FieldKind::Positions)]
}

#[test]
fn each_element_has_a_value() {
    let read = |path: &str, type_name: &str, body: &[u8]| {
        let reader = reader(type_name, false, &[(path, FieldKind::Elements)]);
        let kinds: Vec<_> = reader.kinds().collect();
        (reader.read(body, Endian::Little).values.into_iter().next().unwrap(), kinds[0])
    };
    // An id of 16 bytes, which are not aligned, a stamp of 8, which are, and the status.
    let goals = [&3_u32.to_le_bytes()[..], &[0; 24], &[2], &[0; 27], &[6], &[0; 27], &[4]].concat();
    let (found, kind) = read("status_list[].status", "action_msgs/msg/GoalStatusArray", &goals);
    let list = |values: &[f64], count: u32| {
        let taken = values.iter().map(|value| number(*value)).collect();
        FieldValue::Elements(Arc::new(Elements { taken, count }))
    };
    assert_eq!((found, kind), (list(&[2.0, 6.0, 4.0], 3), Some(ScalarKind::Number)));
    let many: Vec<u8> = [&[0; 8][..], &300_u32.to_le_bytes(), &[7; 300]].concat();
    let (found, _) = read("data[]", "std_msgs/msg/UInt8MultiArray", &many);
    assert_eq!(found, list(&[7.0; 256], 300));
    let (found, _) = read("status_list[].status", "action_msgs/msg/GoalStatusArray", &goals[..40]);
    assert!(matches!(found, FieldValue::Unreadable(_)));
    for path in ["status_list[].stat", "status_list[].goal_info", "status_list", "status_list[][]"] {
        let of = spec("action_msgs/msg/GoalStatusArray", false, &[(path, FieldKind::Elements)]);
        assert!(Definitions::default().check(&of).is_err(), "{path}");
    }
}

#[test]
fn positions_are_read_wherever_an_element_has_them() {
    let folder = std::env::temp_dir().join(format!("telltale-lists-{}", std::process::id()));
    let write = |name: &str, text: &str| {
        let file = folder.join("my_msgs/msg").join(format!("{name}.msg"));
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, text).unwrap();
    };
    // As in vision_msgs, and objects that have only numbers.
    write("Detections", "Detection[] detections\nFlat[] flat\nFlag[] flags\nfloat64[] numbers");
    write("Detection", "string id\nBox bbox");
    write("Box", "geometry_msgs/Pose center\nfloat64 size");
    write("Flat", "bool sure\nfloat32 x\nfloat32 y");
    write("Flag", "bool x\nbool y");
    let definitions = Definitions::new(vec![folder.clone()]);
    let check = |path: &str| definitions.check(&spec("my_msgs/msg/Detections", false, &list(path)));
    let pose = |x: f64| [x, 2.0, 0.5, 0.0, 0.0, 0.0, 1.0].map(f64::to_le_bytes).concat();
    let body = [
        // Two detections.
        &2_u32.to_le_bytes()[..],
        &[2, 0, 0, 0, b'a', 0, 0, 0, 0, 0, 0, 0],
        &pose(1.0),
        &4.0_f64.to_le_bytes(),
        &[3, 0, 0, 0, b'b', b'c', 0, 0],
        &pose(-7.0),
        &4.0_f64.to_le_bytes(),
        // One flat object.
        &[1, 0, 0, 0, 1, 0, 0, 0],
        &3.5_f32.to_le_bytes(),
        &4.5_f32.to_le_bytes(),
        &[0; 8],
    ]
    .concat();
    for (path, found) in [
        ("detections[].bbox.center.position", positions(&[(1.0, 2.0), (-7.0, 2.0)])),
        ("detections[].bbox", positions(&[(1.0, 2.0), (-7.0, 2.0)])),
        ("flat", positions(&[(3.5, 4.5)])),
    ] {
        let reading = check(path).unwrap_or_else(|error| panic!("{error}")).read(&body, Endian::Little);
        assert_eq!((&*reading.values, reading.fault), (&[found][..], None), "{path}");
    }
    for (path, words) in [
        ("detections", "my_msgs/msg/Detection has no position"),
        ("detections[].bbox.size", "a number has no position"),
        ("flags[]", "my_msgs/msg/Flag has no position"),
        ("numbers", "a number has no position"),
        ("detections[0].bbox", "my_msgs/msg/Box is no array"),
        ("detections[].bbox[]", "stands for all elements"),
    ] {
        let FieldsError(errors) = check(path).unwrap_err();
        assert!(errors[0].text.contains(words), "{path}: {errors:?}");
    }
    let scalar = definitions.check(&spec("my_msgs/msg/Detections", false, &scalars(&["flat[].x"])));
    assert!(scalar.unwrap_err().to_string().contains("belongs into a `list`"));
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn of_a_long_list_the_first_are_taken_and_all_are_counted() {
    let poses: Vec<Pose> = (0..300).map(|index| at(f64::from(index), 0.0)).collect();
    let reader = reader(encode::POSE_ARRAY, true, &list("poses"));
    let reading = reader.read(&encode::pose_array(header("map"), &poses), Endian::Little);
    let FieldValue::Positions(found) = &reading.values[0] else { panic!("{reading:?}") };
    assert_eq!((found.taken.len(), found.count, found.is_cut()), (POSITIONS_MAX, 300, true));
    assert_eq!(found.taken[255], Position { x_m: 255.0, y_m: 0.0 });
    // A message that is cut, or a wrong length: nothing is compared.
    let whole = encode::pose_array(header("map"), &poses[..3]);
    for body in [&whole[..whole.len() - 60], &[&whole[..24], &[0xff; 40][..]].concat()] {
        let value = &reader.read(body, Endian::Little).values[0];
        assert!(matches!(value, FieldValue::Unreadable(_)), "{value:?}");
    }
}
