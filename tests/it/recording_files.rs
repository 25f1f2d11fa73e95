//! A recording is read by the programs of others: same count, bytes, stamps and values.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::process::Command;

use serde_json::{Value, json};
use sha2::{Digest, Sha256};
use telltale::msg::cdr::Endian;
use telltale::msg::fields::Definitions;
use telltale::record::file::{IncidentFile, MessageStamps, TRANSITIONS, check};

use crate::folder::TestFolder;

/// Writes CDR in either order of bytes.
struct Cdr {
    endian: Endian,
    bytes: Vec<u8>,
}

impl Cdr {
    fn put<const N: usize>(mut self, little: [u8; N]) -> Cdr {
        self.bytes.resize(self.bytes.len().next_multiple_of(N), 0);
        match self.endian {
            Endian::Little => self.bytes.extend(little),
            Endian::Big => self.bytes.extend(little.iter().rev()),
        }
        self
    }

    fn count(self, value: usize) -> Cdr {
        self.put((value as u32).to_le_bytes())
    }

    fn doubles(self, values: &[f64]) -> Cdr {
        values.iter().fold(self, |cdr, value| cdr.put(value.to_le_bytes()))
    }

    fn text(self, text: &str) -> Cdr {
        let mut cdr = self.count(text.len() + 1);
        cdr.bytes.extend(text.as_bytes());
        cdr.bytes.push(0);
        cdr
    }

    fn header(self, seconds: i32, frame: &str) -> Cdr {
        self.put(seconds.to_le_bytes()).put(500_u32.to_le_bytes()).text(frame)
    }
}

fn header(seconds: i32, frame: &str) -> Value {
    json!({ "stamp": { "sec": seconds, "nanosec": 500 }, "frame_id": frame })
}

fn vector(values: &[f64], names: &[&str]) -> Value {
    names.iter().zip(values).map(|(name, value)| ((*name).to_owned(), json!(value))).collect::<Value>()
}

const POSITION: [f64; 3] = [1.5, -2.25, 1e9];
const ROTATION: [f64; 4] = [0.0, 0.0, 0.6, 0.8];
const AXES: [&str; 4] = ["x", "y", "z", "w"];
const POINTS: usize = 200_000;

/// Topic, type, body, and its values.
fn messages(endian: Endian) -> Vec<(&'static str, &'static str, Vec<u8>, Value)> {
    let cdr = || Cdr { endian, bytes: Vec::new() };
    let diagnostics =
        cdr().header(7, "").count(1).put([2]).text("lidar: top").text("kein Signal ä").text("sn 4");
    let diagnostics = diagnostics.count(1).text("rate").text("9.5 Hz");
    let pose = cdr().header(-1, "map").doubles(&POSITION).doubles(&ROTATION);
    let cloud = cdr().header(9, "lidar").count(1).count(POINTS).count(1).text("i").count(0).put([2]).count(1);
    let mut cloud = cloud.put([0]).count(1).count(POINTS).count(POINTS);
    cloud.bytes.extend((0..POINTS).map(|at| (at % 251) as u8));
    let cloud = cloud.put([1]);
    let tf = cdr().count(1).header(3, "odom").text("base_link").doubles(&POSITION).doubles(&ROTATION);
    let position = vector(&POSITION, &AXES[..3]);
    let sum: usize = (0..POINTS).map(|at| at % 251).sum();
    vec![
        (
            "/diagnostics",
            "diagnostic_msgs/msg/DiagnosticArray",
            diagnostics.bytes,
            json!({ "header": header(7, ""), "status": [{
                "level": 2, "name": "lidar: top", "message": "kein Signal ä", "hardware_id": "sn 4",
                "values": [{ "key": "rate", "value": "9.5 Hz" }],
            }] }),
        ),
        (
            "/pose",
            "geometry_msgs/msg/PoseStamped",
            pose.bytes,
            json!({ "header": header(-1, "map"),
                "pose": { "position": position, "orientation": vector(&ROTATION, &AXES) } }),
        ),
        (
            "/cloud",
            "sensor_msgs/msg/PointCloud2",
            cloud.bytes,
            json!({ "header": header(9, "lidar"), "height": 1, "width": POINTS,
                "fields": [{ "name": "i", "offset": 0, "datatype": 2, "count": 1 }], "is_bigendian": false,
                "point_step": 1, "row_step": POINTS, "data": { "length": POINTS, "sum": sum }, "is_dense": true }),
        ),
        (
            "/tf",
            "tf2_msgs/msg/TFMessage",
            tf.bytes,
            json!({ "transforms": [{ "header": header(3, "odom"), "child_frame_id": "base_link",
                "transform": { "translation": position, "rotation": vector(&ROTATION, &AXES) } }] }),
        ),
        ("/thing", "my_msgs/msg/Thing", cdr().text("nobody knows this type").bytes, json!({})),
        ("/nothing", "std_msgs/msg/Empty", vec![0], json!({})),
    ]
}

fn python() -> String {
    std::env::var("TELLTALE_PEER_PYTHON")
        .expect("TELLTALE_PEER_PYTHON names a Python with tests/requirements.txt: tests/run.sh makes one")
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[test]
fn a_recording_is_read_by_the_programs_of_others() {
    let folder = TestFolder::new("recording-files");
    std::fs::create_dir_all(&*folder).expect("a folder for temporary files");
    let path: PathBuf = folder.join("a.mcap");
    let definitions = Definitions::default();
    let about = BTreeMap::from([("incident".to_owned(), "1".to_owned())]);
    let mut file = IncidentFile::create(&path, about).expect("the file is new");
    let (mut raw, mut decoded, mut bags) = (Vec::new(), Vec::new(), Vec::new());
    let mut time = 1_790_000_000_000_000_000_u64;
    for endian in [Endian::Little, Endian::Big] {
        for (topic, type_name, body, value) in messages(endian) {
            let known = file.topic(topic, type_name, || definitions.text(type_name)).expect("there is room");
            let stamps = MessageStamps {
                log_time_ns: time,
                publish_time_ns: time - 1_000,
                sequence: raw.len() as u32,
            };
            file.message(known, stamps, (&body, endian)).expect("the disk has room");
            let data = [&[0, u8::from(endian == Endian::Little), 0, 0], &body[..]].concat();
            let digest = hex(&Sha256::digest(&data));
            raw.push(json!([topic, type_name, time, time - 1_000, raw.len(), digest]));
            decoded.push(json!([topic, time, time - 1_000, value]));
            let value = if topic == "/thing" { Value::Null } else { value };
            bags.push(json!([topic, type_name, time, digest, value]));
            time += 1_000_000;
        }
        file.end_chunk().expect("the disk has room");
    }
    let document = json!({ "at_ms": 7, "kind": "shown", "node": "loc", "shown": "error", "own": "error" });
    file.json(&TRANSITIONS, time, &document).expect("the disk has room");
    file.attach("configuration.yaml", "application/yaml", time, b"groups: []\n").expect("the disk has room");
    file.finish().expect("the disk has room");
    assert_eq!(check(&path).expect("it can be read"), [""; 0]);

    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/record/readers.py");
    let output = Command::new(python()).arg(script).arg(&path).output().expect("Python starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let read: Value = serde_json::from_slice(&output.stdout).expect("one JSON object");
    let mcap = &read["mcap"];
    assert_eq!(mcap["profile"], "ros2");
    assert_eq!(mcap["counts"], json!([13, 1, 1]));
    assert_eq!(mcap["attachments"], json!({ "configuration.yaml": "groups: []\n" }));
    // `ros2 bag` refuses files with several encodings, and topics without a schema.
    assert_eq!((&mcap["encodings"], &mcap["without_schema"]), (&json!(["cdr"]), &json!([])));
    let list = |value: &Value| value.as_array().cloned().expect("a list");
    let (mcap, ros2, rosbags) =
        (list(&mcap["messages"]), list(&read["mcap_ros2"]), list(&read["rosbags"]["messages"]));
    assert_eq!(mcap[..12], raw);
    assert_eq!(ros2[..12], decoded);
    assert_eq!(rosbags[..12], bags);
    assert_eq!((mcap.len(), ros2.len(), rosbags.len(), &read["rosbags"]["count"]), (13, 13, 13, &json!(13)));
    for text in [&ros2[12][3]["data"], &rosbags[12][4]["data"]] {
        let text = text.as_str().expect("a text");
        assert_eq!(serde_json::from_str::<Value>(text).expect("a document"), document);
    }
}
