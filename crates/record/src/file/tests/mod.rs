//! Files of incidents are read byte for byte as they were written.

mod damage;
mod foreign;

use std::collections::BTreeMap;
use std::fs;
use std::io::{Cursor, ErrorKind};
use std::path::Path;

use mcap::MessageStream;
use mcap::read::Options;
use serde_json::json;

use super::*;
use telltale_msg::cdr::Endian;
use telltale_msg::fields::Definitions;

fn about() -> BTreeMap<String, String> {
    [("incident".to_owned(), "7".to_owned())].into()
}

fn stamps(log_time_ns: u64) -> MessageStamps {
    MessageStamps { log_time_ns, publish_time_ns: log_time_ns - 1, sequence: log_time_ns as u32 }
}

/// The messages of a file as the library reads them: topic, type, time, sequence, bytes.
fn read(bytes: &[u8]) -> Vec<(String, String, u64, u32, Vec<u8>)> {
    let options = [Options::IgnoreEndMagic, Options::ValidateChunkCrcs].into_iter().collect();
    let messages = MessageStream::new_with_options(bytes, options).unwrap().map_while(Result::ok);
    let told = messages.map(|message| {
        let schema = message.channel.schema.as_ref().unwrap();
        let names = (message.channel.topic.clone(), schema.name.clone());
        (names.0, names.1, message.log_time, message.sequence, message.data.to_vec())
    });
    told.collect()
}

#[test]
fn messages_and_documents_are_written_byte_for_byte() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let path = folder.join("a.mcap");
    let definitions = Definitions::default();
    let mut file = IncidentFile::create(&path, about()).unwrap();
    let mut topic = |name: &str, type_name: &str| file.topic(name, type_name, || definitions.text(type_name));
    let cloud = topic("/cloud", "sensor_msgs/msg/PointCloud2").unwrap();
    let thing = topic("/thing", "my_msgs/msg/Thing").unwrap();
    assert_eq!(topic("/cloud", "sensor_msgs/msg/PointCloud2").unwrap(), cloud);
    assert_ne!(topic("/cloud", "sensor_msgs/msg/Image").unwrap(), cloud);
    file.message(cloud, stamps(10), (b"little", Endian::Little)).unwrap();
    file.message(thing, stamps(11), (b"big", Endian::Big)).unwrap();
    file.json(&JOURNAL, 12, &json!({"text": "ä\u{0}\"", "n": 1})).unwrap();
    file.json(&JOURNAL, 13, &json!([])).unwrap();
    file.attach("config.yaml", "application/yaml", 14, b"groups: []\n").unwrap();
    let written = file.finish().unwrap();
    assert_eq!(written.messages, 4);
    let bytes = fs::read(&path).unwrap();
    assert_eq!(written.bytes, bytes.len() as u64);
    let found = read(&bytes);
    assert_eq!(found[0].4, b"\0\x01\0\0little");
    assert_eq!(found[1].4, b"\0\0\0\0big");
    assert_eq!(found[2].4[..8], [0, 1, 0, 0, found[2].4.len() as u8 - 8, 0, 0, 0]);
    let text = found[2].4[8..].strip_suffix(&[0]).unwrap();
    assert_eq!(serde_json::from_slice::<serde_json::Value>(text).unwrap()["text"], "ä\u{0}\"");
    let told: Vec<_> = found.iter().map(|it| (&*it.0, &*it.1, it.2, it.3)).collect();
    assert_eq!(
        told,
        [
            ("/cloud", "sensor_msgs/msg/PointCloud2", 10, 10),
            ("/thing", "my_msgs/msg/Thing", 11, 11),
            ("/telltale/journal", "std_msgs/msg/String", 12, 0),
            ("/telltale/journal", "std_msgs/msg/String", 13, 1),
        ]
    );
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    let stats = summary.stats.unwrap();
    assert_eq!((stats.message_count, stats.channel_count, stats.chunk_count), (4, 4, 1));
    assert_eq!((stats.attachment_count, stats.metadata_count), (1, 1));
    assert_eq!((stats.message_start_time, stats.message_end_time), (10, 13));
    let schemas: BTreeMap<_, _> = summary.schemas.values().map(|it| (&*it.name, &*it.data)).collect();
    assert_eq!(schemas["my_msgs/msg/Thing"], UNDEFINED.as_bytes());
    assert!(schemas["sensor_msgs/msg/PointCloud2"].ends_with(b"uint32 count\n"));
    let attachment = mcap::read::attachment(&bytes, &summary.attachment_indexes[0]).unwrap();
    assert_eq!((&*attachment.name, &*attachment.data), ("config.yaml", &b"groups: []\n"[..]));
    let described = mcap::read::metadata(&bytes, &summary.metadata_indexes[0]).unwrap();
    assert_eq!((described.name, described.metadata), (ABOUT.to_owned(), about()));
}

/// Every entry of a file, as text, and what was left out.
fn entries<R: std::io::Read + std::io::Seek>(reader: &mut Reader<R>) -> Vec<String> {
    let mut told = Vec::new();
    while let Some(entry) = reader.next_entry() {
        told.push(match entry {
            Entry::Message { channel, stamps, body } => {
                format!("{} {} {stamps:?} {body:?}", channel.topic, channel.type_name)
            }
            Entry::Json { channel, stamps, text } => {
                format!("{} {} {stamps:?}", channel.topic, String::from_utf8(text.to_vec()).unwrap())
            }
            Entry::Missing(_) => continue,
        });
    }
    told
}

fn left_out<R: std::io::Read + std::io::Seek>(reader: &Reader<R>) -> Vec<String> {
    reader.omissions().list().iter().map(ToString::to_string).collect()
}

fn of(bytes: &[u8]) -> Result<Reader<Cursor<&[u8]>>, FileError> {
    Reader::new(Path::new("x"), Cursor::new(bytes))
}

fn findings(bytes: &[u8]) -> Vec<String> {
    check_bytes(Path::new("x"), Cursor::new(bytes)).unwrap()
}

#[test]
fn what_is_written_is_read_and_found_right() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let path = folder.join("a.mcap");
    let mut file = IncidentFile::create(&path, about()).unwrap();
    let thing = file.topic("/thing", "my_msgs/msg/Thing", || None).unwrap();
    let number = file.topic("/number", "std_msgs/msg/UInt8", || Some("uint8 data\n".to_owned())).unwrap();
    file.message(thing, stamps(10), (b"big", Endian::Big)).unwrap();
    file.json(&TRANSITIONS, 11, &json!({"node": "loc"})).unwrap();
    file.attach("config.yaml", "application/yaml", 12, b"old").unwrap();
    file.attach("config.yaml", "application/yaml", 12, b"groups: []").unwrap();
    file.message(number, stamps(9), (&[7], Endian::Little)).unwrap();
    file.message(number, stamps(20), (&[], Endian::Little)).unwrap();
    file.finish().unwrap();
    let mut reader = Reader::open(&path).unwrap();
    assert_eq!((reader.profile(), reader.span_ns()), ("ros2", Some((9, 20))));
    assert!(reader.library().starts_with("telltale "));
    assert!(reader.is_complete());
    assert_eq!(reader.metadata().collect::<Vec<_>>(), [(ABOUT, &about())]);
    assert_eq!(reader.attachments().collect::<Vec<_>>(), [("config.yaml", "application/yaml"); 2]);
    assert_eq!(reader.attachment("config.yaml").unwrap(), b"groups: []");
    assert_eq!(reader.attachment("other"), None);
    let told = entries(&mut reader);
    let stamp = |at: u64, published: u64, sequence: u32| {
        format!("{:?}", MessageStamps { log_time_ns: at, publish_time_ns: published, sequence })
    };
    assert_eq!(
        told,
        [
            format!("/thing my_msgs/msg/Thing {} Ok((b\"big\", Big))", stamp(10, 9, 10)),
            format!("/telltale/transitions {{\"node\":\"loc\"}} {}", stamp(11, 11, 0)),
            format!("/number std_msgs/msg/UInt8 {} Ok((b\"\\x07\", Little))", stamp(9, 8, 9)),
            format!("/number std_msgs/msg/UInt8 {} Ok((b\"\", Little))", stamp(20, 19, 20)),
        ]
    );
    assert_eq!(left_out(&reader), [""; 0]);
    reader.seek(0);
    let Some(Entry::Message { channel, .. }) = reader.next_entry() else { panic!("it has one") };
    assert_eq!(channel.definition, None);
    reader.seek(12);
    assert_eq!(entries(&mut reader), told[2..]);
    let Some(Entry::Message { channel, .. }) = ({
        reader.seek(20);
        reader.next_entry()
    }) else {
        panic!("it has one")
    };
    assert_eq!(channel.definition.as_deref(), Some("uint8 data\n"));
    assert_eq!(check(&path).unwrap(), [""; 0]);
    assert!(repair(&path).unwrap().is_none());
}

#[test]
fn an_unfinished_file_has_everything_up_to_its_last_ended_chunk() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let path = folder.join("a.mcap");
    let mut file = IncidentFile::create(&path, about()).unwrap();
    assert!(
        IncidentFile::create(&path, about()).is_err_and(|it| it.kind() == Some(ErrorKind::AlreadyExists))
    );
    let topic = file.topic("/a", "std_msgs/msg/Empty", || Some(String::new())).unwrap();
    let mut wanted = 0;
    for at in 1..=20 {
        file.message(topic, stamps(at), (b"body", Endian::Little)).unwrap();
        if at % 3 == 0 {
            file.end_chunk().unwrap();
            file.sync().unwrap();
            wanted = at as usize;
        }
        let bytes = fs::read(&path).unwrap();
        assert_eq!(bytes.len() as u64, file.len());
        assert_eq!(read(&bytes).len(), wanted);
    }
    drop(file);
    assert_eq!(read(&fs::read(&path).unwrap()).len(), 18);
    let mode = std::os::unix::fs::PermissionsExt::mode(&fs::metadata(&path).unwrap().permissions());
    assert_eq!(mode & 0o777, 0o600);
}

#[test]
fn a_chunk_ends_by_itself_when_it_is_large() {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let mut file = IncidentFile::create(&folder.join("a.mcap"), about()).unwrap();
    let topic = file.topic("/a", "std_msgs/msg/Empty", || Some(String::new())).unwrap();
    let before = file.len();
    let body = vec![7; writer::CHUNK_BYTES / 2];
    file.message(topic, stamps(1), (&body, Endian::Little)).unwrap();
    assert_eq!(file.len(), before);
    file.message(topic, stamps(2), (&body, Endian::Little)).unwrap();
    assert!(file.len() > before);
}

/// A disk that is full. The tests of the whole program fill a real one.
#[test]
fn an_error_of_the_disk_is_named_and_final() {
    let path = Path::new("/dev/full");
    let error = output::Output::create(path, "ros2", "").err().unwrap();
    assert!(error.to_string().starts_with("/dev/full cannot be created: "), "{error}");
    let missing = IncidentFile::create(Path::new("/nowhere/a.mcap"), about()).err().unwrap();
    assert_eq!(missing.kind(), Some(ErrorKind::NotFound));
}
