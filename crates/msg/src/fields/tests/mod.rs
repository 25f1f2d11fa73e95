//! Tests of fields: paths are compiled, and values are read from the bytes of messages.

mod content;
mod lists;
mod transforms;

use std::time::{Duration, UNIX_EPOCH};

use proptest::prelude::*;

use super::*;
use crate::messages::encode::{self, Header, Motion, Transform};
use telltale_engine::model::sample::{POSITIONS_MAX, Pose, Position, Positions};

fn spec(type_name: &str, stamp: bool, fields: &[(&str, FieldKind)]) -> TopicSpec {
    let field = |(path, kind): &(&str, FieldKind)| FieldSpec::new(*path, *kind);
    TopicSpec {
        topic: "/x".into(),
        type_name: type_name.into(),
        stamp,
        fields: fields.iter().map(field).collect(),
    }
}

fn reader(type_name: &str, stamp: bool, fields: &[(&str, FieldKind)]) -> Reader {
    Definitions::default().check(&spec(type_name, stamp, fields)).unwrap_or_else(|error| panic!("{error}"))
}

fn scalars<'a>(paths: &[&'a str]) -> Vec<(&'a str, FieldKind)> {
    paths.iter().map(|path| (*path, FieldKind::Scalar)).collect()
}

fn header(frame_id: &str) -> Header<'_> {
    Header { stamp: UNIX_EPOCH + Duration::new(1_700_000_000, 5), frame_id }
}

fn at(x_m: f64, y_m: f64) -> Pose {
    Pose { x_m, y_m, z_m: 0.5, qw: 1.0, ..Pose::default() }
}

fn positions(places: &[(f64, f64)]) -> FieldValue {
    let taken = places.iter().map(|&(x_m, y_m)| Position { x_m, y_m }).collect();
    FieldValue::Positions(Arc::new(Positions { taken, count: places.len() as u32 }))
}

fn number(value: f64) -> FieldValue {
    FieldValue::Number(value)
}

fn text(value: &str) -> FieldValue {
    FieldValue::Text(value.into())
}

const STAMP_NS: i64 = 1_700_000_000_000_000_005;

#[test]
fn a_number_with_a_name_is_read_as_that_name() {
    let status = |number: u8| {
        let reader = reader("action_msgs/msg/GoalStatus", false, &[("status", FieldKind::Named)]);
        reader.read(&[&[0; 24][..], &[number]].concat(), Endian::Little).values
    };
    assert_eq!(*status(4), [text("STATUS_SUCCEEDED")]);
    assert_eq!(*status(255), [text("-1")], "none is called so");
    let kinds = |type_name: &str, path: &str| {
        let reader = reader(type_name, false, &[(path, FieldKind::Named)]);
        reader.kinds().next().flatten()
    };
    assert_eq!(kinds("action_msgs/msg/GoalStatus", "status"), Some(ScalarKind::Text));
    assert_eq!(kinds("sensor_msgs/msg/PointCloud2", "width"), Some(ScalarKind::Number), "without names");
    let two = spec("visualization_msgs/msg/Marker", false, &[("action", FieldKind::Named)]);
    let error = Definitions::default().check(&two).unwrap_err().to_string();
    assert_eq!(error, "`action`: 0 is called ARROW and ADD (write the number)");
    let mut misspelt = spec("diagnostic_msgs/msg/DiagnosticStatus", false, &[("level", FieldKind::Named)]);
    misspelt.fields[0].names = ["EROR".into(), "WARN".into()].into();
    let error = Definitions::default().check(&misspelt).unwrap_err().to_string();
    assert_eq!(error, "`level`: no number of it is called EROR (write one of OK, WARN, ERROR, STALE)");
}

#[test]
fn what_a_newer_release_adds_behind_is_passed_over_and_an_older_one_is_whole() {
    let reader = reader("sensor_msgs/msg/Range", true, &scalars(&["range"]));
    let header = [&0_u64.to_le_bytes()[..], &1_u32.to_le_bytes(), &[0; 4]].concat();
    let numbers = [0.1_f32, 0.2, 4.0, 1.5, 0.01].map(f32::to_le_bytes).concat();
    // Up to Humble four numbers; later a variance follows.
    for (bytes, whole) in [(16, true), (20, true), (14, false)] {
        let reading = reader.read(&[&header[..], &numbers[..bytes]].concat(), Endian::Little);
        assert_eq!(reading.fault.is_none(), whole, "{bytes} bytes: {reading:?}");
        assert_eq!(reading.values[0] == number(1.5), whole, "{reading:?}");
    }
}

#[test]
fn fields_of_what_a_shuttle_publishes() {
    let velocity = Motion { linear: [4.5, 0.0, 0.0], angular: [0.0, 0.0, -0.25] };
    let transform =
        |child_frame_id, x_m| Transform { header: header("map"), child_frame_id, pose: at(x_m, 1.0) };
    let transforms = [transform("odom", 7.0), transform("base_link", 8.0), transform("lidar/top", 9.0)];
    let grid = encode::Grid {
        resolution_m: 0.5,
        width: 2,
        origin_x_m: -3.0,
        origin_y_m: 1.0,
        cells: &[0, 100, -1, 5],
    };
    let pose = FieldKind::Pose;
    let scalar = FieldKind::Scalar;
    let list = FieldKind::Positions;
    type Fields<'a> = Vec<(&'a str, FieldKind, FieldValue)>;
    let cases: Vec<(&str, Vec<u8>, bool, Fields<'_>)> = vec![
        (
            encode::FLOAT64,
            encode::float64(f64::INFINITY),
            false,
            vec![("data", scalar, number(f64::INFINITY))],
        ),
        (encode::STRING, encode::string("größer"), false, vec![("data", scalar, text("größer"))]),
        (
            encode::ODOMETRY,
            encode::odometry(header("map"), "base_link", at(1.0, -2.0), velocity),
            true,
            vec![
                ("twist.twist.linear.x", scalar, number(4.5)),
                ("twist.twist.angular.z", scalar, number(-0.25)),
                ("pose", pose, FieldValue::Pose(at(1.0, -2.0))),
                ("pose.pose.position.y", scalar, number(-2.0)),
                ("twist.covariance[35]", scalar, number(0.0)),
                ("twist.covariance.length", scalar, number(36.0)),
                ("child_frame_id", scalar, text("base_link")),
                ("header.stamp.nanosec", scalar, number(5.0)),
                ("header.stamp", scalar, number(1_700_000_000.000_000_005)),
            ],
        ),
        (
            encode::TF_MESSAGE,
            encode::tf_message(&transforms),
            true,
            vec![
                ("transforms[child_frame_id=base_link].transform.translation.x", scalar, number(8.0)),
                ("transforms[child_frame_id=lidar/top]", pose, FieldValue::Pose(at(9.0, 1.0))),
                ("transforms[header.frame_id=map].child_frame_id", scalar, text("odom")),
                ("transforms[2].transform", pose, FieldValue::Pose(at(9.0, 1.0))),
                ("transforms.length", scalar, number(3.0)),
                ("transforms", list, positions(&[(7.0, 1.0), (8.0, 1.0), (9.0, 1.0)])),
            ],
        ),
        (
            encode::OCCUPANCY_GRID,
            encode::occupancy_grid(header("map"), grid),
            true,
            vec![
                ("info.resolution", scalar, number(0.5)),
                ("info.height", scalar, number(2.0)),
                ("info.origin", pose, FieldValue::Pose(Pose { z_m: 0.0, ..at(-3.0, 1.0) })),
                ("data[2]", scalar, number(-1.0)),
                ("data.length", scalar, number(4.0)),
            ],
        ),
        (
            encode::VELODYNE_SCAN,
            encode::velodyne_scan(header("velodyne"), 3),
            true,
            vec![("packets.length", scalar, number(3.0)), ("packets[2].data[1205]", scalar, number(0.0))],
        ),
        (
            encode::POINT_CLOUD_2,
            encode::point_cloud(header("lidar"), 100_000),
            true,
            vec![
                ("fields[name=z].offset", scalar, number(8.0)),
                ("fields[offset=4].name", scalar, text("y")),
                ("data.length", scalar, number(1_200_000.0)),
                ("is_dense", scalar, FieldValue::Bool(true)),
            ],
        ),
        (
            encode::PATH,
            encode::path(header("map"), &[at(1.0, 2.0), at(3.0, 4.0)]),
            true,
            vec![
                ("poses[1].pose.position.x", scalar, number(3.0)),
                ("poses[0]", pose, FieldValue::Pose(at(1.0, 2.0))),
                ("poses", list, positions(&[(1.0, 2.0), (3.0, 4.0)])),
            ],
        ),
        (
            encode::POSE_ARRAY,
            encode::pose_array(header("map"), &[at(1.0, 2.0), at(3.0, 4.0)]),
            true,
            vec![
                ("poses[1].position.y", scalar, number(4.0)),
                ("poses.length", scalar, number(2.0)),
                ("poses", list, positions(&[(1.0, 2.0), (3.0, 4.0)])),
                ("poses[].position", list, positions(&[(1.0, 2.0), (3.0, 4.0)])),
            ],
        ),
        (
            encode::POSE_WITH_COVARIANCE_STAMPED,
            encode::pose_with_covariance_stamped(header("map"), at(5.0, 6.0), &[0.25; 36]),
            true,
            vec![
                ("pose", pose, FieldValue::Pose(at(5.0, 6.0))),
                ("pose.covariance[35]", scalar, number(0.25)),
            ],
        ),
        (
            encode::POSE_STAMPED,
            encode::pose_stamped(header(""), at(5.0, 6.0)),
            true,
            vec![("pose.position.x", scalar, number(5.0))],
        ),
        (
            encode::TWIST_STAMPED,
            encode::twist_stamped(header("b"), velocity),
            true,
            vec![("twist.linear.x", scalar, number(4.5))],
        ),
        (
            encode::ACCEL_STAMPED,
            encode::accel_stamped(header("b"), velocity),
            true,
            vec![("accel.angular.z", scalar, number(-0.25))],
        ),
    ];
    for (type_name, body, stamp, fields) in cases {
        let wanted: Vec<_> = fields.iter().map(|(path, kind, _)| (*path, *kind)).collect();
        let reader = reader(type_name, stamp, &wanted);
        let reading = reader.read(&body, Endian::Little);
        let expected: Vec<_> = fields.into_iter().map(|(_, _, value)| value).collect();
        assert_eq!(&*reading.values, expected, "{type_name}");
        assert_eq!((reading.stamp_ns, &reading.fault), (stamp.then_some(STAMP_NS), &None), "{type_name}");
        for end in 0..body.len().min(300) {
            reader.read(&body[..end], Endian::Little);
        }
    }
}

#[test]
fn big_endian_is_read_too() {
    let mut body = vec![0, 0, 0, 7, 0, 0, 0, 9, 0, 0, 0, 2, b'm', 0, 0, 0];
    for value in [1.5_f64, -2.5, 0.0, 0.0, 0.0, 0.25] {
        body.extend(value.to_be_bytes());
    }
    let reader =
        reader("geometry_msgs/msg/TwistStamped", true, &scalars(&["twist.linear.y", "twist.angular.z"]));
    let reading = reader.read(&body, Endian::Big);
    assert_eq!(&*reading.values, [number(-2.5), number(0.25)]);
    assert_eq!(reading.stamp_ns, Some(7_000_000_009));
}

#[test]
fn what_is_cut_behind_its_fields_has_their_values_and_a_fault() {
    let pose = Transform { header: header("map"), child_frame_id: "a", pose: at(8.0, 1.0) };
    let whole = encode::tf_message(&[pose, pose]);
    let field = ["transforms[child_frame_id=a].transform.translation.x"];
    let reader = reader(encode::TF_MESSAGE, true, &scalars(&field));
    for bytes in [whole.len() - 8, whole.len() - 1, whole.len()] {
        let reading = reader.read(&whole[..bytes], Endian::Little);
        assert_eq!((&*reading.values, reading.stamp_ns), (&[number(8.0)][..], Some(STAMP_NS)));
        assert_eq!(reading.fault.is_some(), bytes < whole.len(), "{bytes} of {}", whole.len());
    }
}

#[test]
fn the_last_element_is_that_of_each_message() {
    let path = ["poses[-1].position.x"];
    let reader = reader(encode::POSE_ARRAY, true, &scalars(&path));
    for (poses, expected) in [
        (&[at(1.0, 2.0)][..], number(1.0)),
        (&[at(1.0, 2.0), at(3.0, 4.0), at(5.0, 6.0)], number(5.0)),
        (&[], FieldValue::Unreadable("there is no last element: there are 0".into())),
    ] {
        let bytes = encode::pose_array(header("map"), poses);
        assert_eq!(&*reader.read(&bytes, Endian::Little).values, [expected]);
    }
}

#[test]
fn what_is_not_there_is_unreadable_and_says_why() {
    let poses = encode::pose_array(header("map"), &[at(1.0, 2.0)]);
    let reader = reader(
        encode::POSE_ARRAY,
        true,
        &scalars(&["poses[1].position.x", "poses[0].position.x", "poses.length"]),
    );
    let reading = reader.read(&poses, Endian::Little);
    assert_eq!(
        &*reading.values,
        [FieldValue::Unreadable("there is no element 1: there are 1".into()), number(1.0), number(1.0)]
    );
    assert_eq!(reading.fault, None);

    let cut = reader.read(&poses[..40], Endian::Little);
    assert!(
        cut.values
            .iter()
            .all(|value| matches!(value, FieldValue::Unreadable(why) if why.contains("cut at byte")))
    );
    assert!(cut.fault.is_some() && cut.stamp_ns == Some(STAMP_NS));
    assert_eq!(reader.unreadable(&cut.fault.unwrap()).values.len(), 3);

    let transforms = encode::tf_message(&[]);
    let tf =
        super::tests::reader(encode::TF_MESSAGE, true, &[("transforms[child_frame_id=a]", FieldKind::Pose)]);
    let reading = tf.read(&transforms, Endian::Little);
    assert_eq!(&*reading.values, [FieldValue::Absent]);
    assert_eq!((reading.stamp_ns, reading.fault), (None, None));

    let words = super::tests::reader(encode::STRING, false, &scalars(&["data"]));
    for (body, why) in [
        (vec![2, 0, 0, 0, 0xff, 0], "no UTF-8"),
        (encode::string(&"x".repeat(5000)), "at most 4096"),
        (vec![0xff; 8], "cut at byte"),
    ] {
        let values = words.read(&body, Endian::Little).values;
        assert!(matches!(&values[0], FieldValue::Unreadable(text) if text.contains(why)), "{values:?}");
    }
}

#[test]
fn paths_that_cannot_be_read_are_refused() {
    let (scalar, pose) = (FieldKind::Scalar, FieldKind::Pose);
    let cases = [
        (
            "twist.twst.linear.x",
            scalar,
            "has no field `twst`",
            "did you mean `twist`? it has: twist, covariance",
        ),
        ("twist.twist", scalar, "no single value", "go on to one of its fields: linear, angular"),
        ("twist.covariance", scalar, "an array is no single value", ".length"),
        ("twist.covariance[36]", scalar, "always has 36", "0 to 35"),
        ("child_frame_id.x", scalar, "there is no `x` in a string", "leave out"),
        ("child_frame_id[0]", scalar, "is no array", "leave out"),
        ("twist.covariance.x", scalar, "there is no `x` in an array", "[0]"),
        ("twist", pose, "is no pose", "Pose or Transform"),
        ("pose.pose.position", pose, "is no pose", "Pose or Transform"),
        ("pose..x", scalar, "is no path", "twist.twist.linear.x"),
    ];
    for (path, kind, words, help) in cases {
        let FieldsError(errors) =
            Definitions::default().check(&spec(encode::ODOMETRY, false, &[(path, kind)])).unwrap_err();
        let error = &errors[0];
        assert!(error.text.contains(words) && error.help.contains(help), "{path}: {error:?}");
        assert_eq!(error.path.as_deref(), Some(path));
    }
    let battery = spec("sensor_msgs/msg/BatteryState", false, &scalars(&["percent"]));
    let FieldsError(errors) = Definitions::default().check(&battery).unwrap_err();
    assert!(errors[0].help.starts_with("did you mean `percentage`?"), "{errors:?}");
    let FieldsError(errors) = Definitions::default()
        .check(&spec("std_msgs/msg/Float64", true, &scalars(&["dat", "data.x"])))
        .unwrap_err();
    assert_eq!(errors.len(), 3, "{errors:?}");
    assert!(errors[0].text.contains("has no stamp") && errors[0].path.is_none());
    let anything = spec("my_msgs/msg/Unknown", false, &[]);
    assert!(Definitions::default().check(&anything).is_ok(), "only its messages are counted");
}

#[test]
fn definitions_in_folders_win_and_may_be_broken() {
    let folder = std::env::temp_dir().join(format!("telltale-definitions-{}", std::process::id()));
    let write = |name: &str, text: &str| {
        let file = folder.join("my_msgs/msg").join(format!("{name}.msg"));
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, text).unwrap();
    };
    write("Speed", "uint8 kind 3\nbuiltin_interfaces/Time stamp\nMode[] modes\nwstring label\nbool late\n");
    write("Mode", "uint16 LOW=1\nstring<=8 name\nbool on true\n");
    write("Loop", "Knot knot");
    write("Knot", "string name\nLoop[] loops");
    write("Bad", "float64 a\nfloat64\n");
    let definitions = Definitions::new(vec!["/nowhere".into(), folder.clone()]);
    let fields = scalars(&["modes[name=fast].on", "kind"]);
    let reader = definitions.check(&spec("my_msgs/msg/Speed", true, &fields)).unwrap();
    let body = [
        &[9, 0, 0, 0, 1, 0, 0, 0, 2, 0, 0, 0, 2, 0, 0, 0][..],
        &[5, 0, 0, 0, b's', b'l', b'o', b'w', 0, 0, 0, 0, 5, 0, 0, 0, b'f', b'a', b's', b't', 0, 1],
    ]
    .concat();
    let reading = reader.read(&body, Endian::Little);
    assert_eq!(&*reading.values, [FieldValue::Bool(true), number(9.0)]);
    assert_eq!(reading.stamp_ns, Some(1_000_000_002));
    assert!(definitions.boolean("my_msgs/msg/Speed", "modes[0].on").is_ok());
    assert!(
        definitions.boolean("my_msgs/msg/Speed", "kind").unwrap_err().text.contains("neither true nor false")
    );
    for (type_name, field, words) in [
        ("my_msgs/msg/Loop", "x", "contains itself: my_msgs/msg/Loop, in it my_msgs/msg/Knot"),
        ("my_msgs/msg/Bad", "a", "line 2: `float64` has a type and no name"),
        ("my_msgs/msg/Speed", "late", "wstring"),
        ("my_msgs/msg/Speed", "label", "wstring"),
        ("my_msgs/msg/Other", "x", folder.to_str().unwrap()),
    ] {
        let error = definitions.check(&spec(type_name, false, &scalars(&[field]))).unwrap_err().to_string();
        assert!(error.contains(words), "{type_name}: {error}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

proptest! {
    #[test]
    fn any_definition_and_path_is_taken_or_refused(
        text in prop::collection::vec(
            prop::sample::select(vec![
                "float64", "string", "<=", "Pose", "geometry_msgs/", "[", "]", "3", "99999999999", " ", "x", "=", "#",
                "'", "\n", ".", "length", "ä", "\0",
            ]),
            0..30,
        ),
    ) {
        let text = text.concat();
        if let Err(why) = definition::parse("own", &text) {
            prop_assert!(!why.is_empty());
        }
        let spec = spec(encode::PATH, false, &scalars(&[&text]));
        if let Err(FieldsError(errors)) = Definitions::default().check(&spec) {
            prop_assert!(errors.len() == 1 && !errors[0].help.is_empty());
        }
    }

    #[test]
    fn any_bytes_are_read_or_say_why_not(
        body in prop::collection::vec(prop_oneof![4 => 0..3_u8, 1 => any::<u8>()], 0..400),
        little in any::<bool>(),
    ) {
        let endian = if little { Endian::Little } else { Endian::Big };
        for (type_name, path) in [
            (encode::TF_MESSAGE, "transforms[child_frame_id=a].transform.rotation.w"),
            (encode::PATH, "poses[1].pose.position.x"),
            (encode::POINT_CLOUD_2, "is_dense"),
            (encode::VELODYNE_SCAN, "packets.length"),
            ("diagnostic_msgs/msg/DiagnosticArray", "status[level=2].values[key=a].value"),
        ] {
            let reading = reader(type_name, true, &scalars(&[path])).read(&body, endian);
            prop_assert_eq!(reading.values.len(), 1);
            if matches!(&reading.values[0], FieldValue::Unreadable(why) if why.contains("cut at byte")) {
                prop_assert!(reading.fault.is_some());
            }
        }
    }
}

#[test]
fn an_event_counts_only_if_it_is_what_its_type_says() {
    const POSES: &str = "geometry_msgs/msg/PoseArray";
    let check = |type_name: &str, body: &[u8]| {
        let reader = Definitions::default().event(type_name).expect("the type is built in");
        reader.check(body, Endian::Little).map_err(|miss| miss.to_string())
    };
    let cases = [
        (at(1.0, 2.0), ""),
        (Pose { qz: -0.6, qw: 0.8, ..at(1.0, 2.0) }, ""),
        (at(f64::NAN, 2.0), "position.x is NaN"),
        (at(1.0, f64::NEG_INFINITY), "position.y is -inf"),
        (Pose { qx: f64::INFINITY, ..at(1.0, 2.0) }, "orientation.x is inf"),
        (
            Pose { qw: 0.0, ..at(1.0, 2.0) },
            "refused: orientation is no rotation, its quaternion has the length 0.000 and not 1",
        ),
        (Pose { qw: f64::MAX, qx: f64::MAX, ..at(1.0, 2.0) }, "orientation is no rotation"),
    ];
    for (pose, expected) in cases {
        let bodies = [
            ("geometry_msgs/msg/PoseStamped", encode::pose_stamped(header("map"), pose)),
            (
                "geometry_msgs/msg/PoseWithCovarianceStamped",
                encode::pose_with_covariance_stamped(header("map"), pose, &[f64::NAN; 36]),
            ),
            (POSES, encode::pose_array(header("map"), &[at(0.0, 0.0), pose])),
            ("nav_msgs/msg/Path", encode::path(header("map"), &[at(0.0, 0.0), pose])),
        ];
        for (type_name, body) in bodies {
            let came_to = check(type_name, &body);
            assert_eq!(came_to.is_ok(), expected.is_empty(), "{type_name} {pose:?}: {came_to:?}");
            came_to.is_err().then(|| assert!(check(type_name, &body).unwrap_err().contains(expected)));
            for length in 0..body.len() {
                assert!(check(type_name, &body[..length]).is_err(), "{type_name} cut at {length}");
            }
        }
    }
    assert!(check(POSES, &[0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 255, 255, 255, 255]).is_err());
    assert_eq!(check("std_msgs/msg/Empty", &[0]), Ok(()));
    assert_eq!(check("std_msgs/msg/String", &[2, 0, 0, 0, b'a', 0]), Ok(()));
    assert!(check("std_msgs/msg/String", &[9, 0, 0, 0, b'a', 0]).is_err());
    assert!(Definitions::default().event("my_msgs/msg/Goal").is_none(), "its messages alone count");
}

#[test]
fn the_names_for_the_values_of_a_field_are_those_of_its_message() {
    let labels = |type_name: &str, path: &str| -> Vec<String> {
        let found = Definitions::default().labels(type_name, path);
        found.into_iter().map(|(name, value)| format!("{name}={value}")).collect()
    };
    let battery = labels("sensor_msgs/msg/BatteryState", "power_supply_status");
    assert_eq!(battery[..2], ["POWER_SUPPLY_STATUS_UNKNOWN=0", "POWER_SUPPLY_STATUS_CHARGING=1"]);
    assert_eq!(battery.len(), 5, "those of `power_supply_health` are not among them");
    let levels = ["OK=0", "WARN=1", "ERROR=2", "STALE=3"];
    assert_eq!(labels("diagnostic_msgs/msg/DiagnosticArray", "status[name=base].level"), levels);
    assert_eq!(labels("sensor_msgs/msg/BatteryState", "voltage"), [""; 0]);
    for nothing in ["header", "none", "power_supply_status.x", "cell_voltage[0]"] {
        assert_eq!(labels("sensor_msgs/msg/BatteryState", nothing), [""; 0], "{nothing}");
    }
    assert_eq!(labels("my_msgs/msg/Own", "state"), [""; 0]);
}

#[test]
fn what_holds_bytes_without_a_bound_may_be_large() {
    let definitions = Definitions::default();
    let large = ["sensor_msgs/msg/PointCloud2", "nav_msgs/msg/OccupancyGrid", "nobody_knows/msg/This"];
    for type_name in large.into_iter().chain(["sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"]) {
        assert!(definitions.may_be_large(type_name), "{type_name}");
    }
    for type_name in
        ["sensor_msgs/msg/LaserScan", "nav_msgs/msg/Odometry", "diagnostic_msgs/msg/DiagnosticArray"]
    {
        assert!(!definitions.may_be_large(type_name), "{type_name}");
    }
}

#[test]
fn types_that_hold_each_other_in_more_ways_than_can_be_walked_take_no_time() {
    let mut definitions = Definitions::default();
    let mut whole = "B0 b\nint32 y\n".to_owned();
    for at in 0..24 {
        whole.push_str(&format!("{}\nMSG: deep/B{at}\n", "=".repeat(80)));
        (0..8).for_each(|field| whole.push_str(&format!("B{} f{field}\n", at + 1)));
    }
    whole.push_str(&format!("{}\nMSG: deep/B24\nstring s\n", "=".repeat(80)));
    definitions.give("deep/msg/A", &whole);
    assert!(!definitions.may_be_large("deep/msg/A"));
    assert!(definitions.text("deep/msg/A").is_some() && definitions.labels("deep/msg/A", "y").is_empty());
    let spec = spec("deep/msg/A", true, &[("y", FieldKind::Scalar), ("", FieldKind::Content)]);
    let (reader, errors) = definitions.reader(&spec).unwrap();
    assert_eq!(errors.len(), 1, "it has no stamp: {errors:?}");
    let reading = reader.read(&[0; 4096], Endian::Little);
    assert!(reading.fault.is_some(), "8^24 texts are not in 4096 bytes");
    assert!(definitions.event("deep/msg/A").unwrap().check(&[0; 4096], Endian::Little).is_err());
}
