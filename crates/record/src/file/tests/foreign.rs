//! Recordings that others wrote: with and without chunks, compression, checksums and a summary.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Cursor;

use mcap::records::MessageHeader;
use mcap::{Compression, WriteOptions, Writer};

use super::*;

/// Ten messages on two topics, with an attachment, in the way of these options.
fn written(options: WriteOptions, finished: bool) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = options.profile("ros2").library("rosbag2").create(Cursor::new(&mut bytes)).unwrap();
    let schema = writer.add_schema("std_msgs/msg/UInt8", "ros2msg", b"uint8 data\n").unwrap();
    let ids = ["/a", "/b"].map(|topic| writer.add_channel(schema, topic, "cdr", &BTreeMap::new()).unwrap());
    for at in 0..10_u8 {
        let time = u64::from(at) + 100;
        let id = ids[usize::from(at % 2)];
        let header = MessageHeader { channel_id: id, sequence: 0, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, &[0, at % 2, 0, 3, at, 0, 0, 0]).unwrap();
        if at == 4 {
            let data = Cow::Borrowed(&b"text"[..]);
            let (name, media_type) = ("a".to_owned(), "text/plain".to_owned());
            writer.attach(&mcap::Attachment { log_time: 0, create_time: 0, name, media_type, data }).unwrap();
        }
    }
    writer.flush().unwrap();
    if finished {
        writer.finish().unwrap();
    }
    writer.into_inner();
    bytes
}

#[test]
fn metadata_without_end_is_left_out_with_its_channel_and_others_are_read() {
    let mut bytes = Vec::new();
    let mut writer = WriteOptions::new().use_chunks(false).create(Cursor::new(&mut bytes)).unwrap();
    let schema = writer.add_schema("std_msgs/msg/UInt8", "ros2msg", b"uint8 data\n").unwrap();
    let keys = (0..150_000).map(|key: u32| (key.to_string(), String::new())).collect();
    for (topic, metadata) in [("/large", keys), ("/small", BTreeMap::new())] {
        let channel_id = writer.add_channel(schema, topic, "cdr", &metadata).unwrap();
        let header = MessageHeader { channel_id, sequence: 0, log_time: 1, publish_time: 1 };
        writer.write_to_known_channel(&header, &[0, 1, 0, 0, 7]).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    let mut reader = of(&bytes).unwrap();
    assert_eq!(entries(&mut reader).len(), 1);
    assert!(left_out(&reader).iter().any(|said| said.contains("is too large")), "{:?}", left_out(&reader));
}

#[test]
fn recordings_of_others_are_read_whatever_their_options() {
    let all = || WriteOptions::new().chunk_size(Some(40));
    let bare = || all().calculate_chunk_crcs(false).calculate_data_section_crc(false);
    let ways = [
        (all(), true),
        (all().compression(None), true),
        (all().compression(Some(Compression::Zstd)), false),
        (all().use_chunks(false), true),
        (all().use_chunks(false), false),
        (bare().emit_summary_records(false).emit_message_indexes(false), true),
        (bare().calculate_summary_section_crc(false).emit_summary_offsets(false), true),
    ];
    let mut seen = Vec::new();
    for (number, (options, finished)) in ways.into_iter().enumerate() {
        let bytes = written(options, finished);
        let mut reader = of(&bytes).unwrap();
        let told = entries(&mut reader);
        assert_eq!(told.len(), 10, "{number}");
        assert_eq!(reader.attachment("a").unwrap(), b"text");
        assert_eq!(left_out(&reader).len(), usize::from(!finished), "{number}: {:?}", left_out(&reader));
        let findings = findings(&bytes);
        assert_eq!(findings.is_empty(), finished, "{number}: {findings:?}");
        for from in [0, 103, 109, 110] {
            reader.seek(from);
            let after = entries(&mut reader);
            assert_eq!(after, told[told.len() - after.len()..], "{number}");
            assert!(after.len() as u64 >= 110 - from.max(100), "{number} {from}");
        }
        seen.push(told);
    }
    assert!(seen.iter().all(|told| *told == seen[0]));
}

#[test]
fn a_small_file_that_unpacks_without_an_end_is_left_out() {
    let bytes = written(WriteOptions::new().chunk_size(Some(40)).compression(Some(Compression::Zstd)), true);
    let open = || of(&bytes).unwrap();
    let all = entries(&mut open());
    let mut reader = open();
    reader.unpack_at_most(300);
    let told = entries(&mut reader);
    assert!((1..all.len()).contains(&told.len()) && told[..] == all[..told.len()], "{told:?}");
    assert!(left_out(&reader).iter().any(|it| it.contains(SPENT)), "{:?}", left_out(&reader));
    // A part that was unpacked once may be read again, as often as one likes.
    for _ in 0..3 {
        reader.seek(0);
        assert_eq!(entries(&mut reader), told);
    }
    // Messages that rosbag2 compressed count as what they unpack to.
    let mut bomb = Vec::new();
    let mut writer = WriteOptions::new().compression(None).create(Cursor::new(&mut bomb)).unwrap();
    let schema = writer.add_schema("std_msgs/msg/UInt8", "ros2msg", b"uint8 data\n").unwrap();
    let id = writer.add_channel(schema, "/a", "cdr", &BTreeMap::new()).unwrap();
    let packed = zstd::encode_all(&[&[0, 1, 0, 0][..], &[0; 100_000]].concat()[..], 1).unwrap();
    for time in 1..=20 {
        let header = MessageHeader { channel_id: id, sequence: 0, log_time: time, publish_time: time };
        writer.write_to_known_channel(&header, &packed).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    let mut reader = of(&bomb).unwrap();
    reader.unpack_at_most(bomb.len() as u64 + 250_000);
    assert_eq!(entries(&mut reader).len(), 3);
    assert!(left_out(&reader).iter().any(|it| it.contains(SPENT)), "{:?}", left_out(&reader));
}

#[test]
fn a_chunk_of_lz4_is_read() {
    use std::io::Write;
    let bytes = written(WriteOptions::new().compression(None), false);
    let (at, data_at) = {
        let at = bytes.windows(9).position(|it| it[0] == 6 && it[4..] == [0; 5]).unwrap();
        (at, at + 9 + 40)
    };
    let length = u64::from_le_bytes(bytes[at + 1..at + 9].try_into().unwrap()) as usize - 40;
    let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
    encoder.write_all(&bytes[data_at..data_at + length]).unwrap();
    let packed = encoder.finish().unwrap();
    let mut other = bytes[..at].to_vec();
    other.push(6);
    other.extend((packed.len() as u64 + 43).to_le_bytes());
    other.extend(&bytes[at + 9..at + 9 + 28]);
    other.extend(b"\x03\0\0\0lz4");
    other.extend((packed.len() as u64).to_le_bytes());
    other.extend(packed);
    let told = |bytes: &[u8]| entries(&mut of(bytes).unwrap());
    assert_eq!(told(&other), told(&bytes)[..5]);
}

#[test]
fn channels_of_other_encodings_are_left_out_once_each() {
    let mut bytes = Vec::new();
    let mut writer = Writer::new(Cursor::new(&mut bytes)).unwrap();
    let none = BTreeMap::new();
    let protobuf = writer.add_channel(0, "/p", "protobuf", &none).unwrap();
    let json = writer.add_channel(0, "/j", "json", &none).unwrap();
    let cdr = writer.add_channel(0, "/c", "cdr", &none).unwrap();
    let messages =
        [(protobuf, &b"x"[..]), (protobuf, b"y"), (json, b"{}"), (cdr, b"\0\x07\0\0x"), (cdr, b"\0")];
    for (channel_id, data) in messages {
        let header = MessageHeader { channel_id, sequence: 0, log_time: 1, publish_time: 1 };
        writer.write_to_known_channel(&header, data).unwrap();
    }
    writer.finish().unwrap();
    drop(writer);
    let mut reader = of(&bytes).unwrap();
    let told = entries(&mut reader);
    assert!(told[0].starts_with("/j {} ") && told[1].contains("Encoding([0, 7])"), "{told:?}");
    let left_out = left_out(&reader);
    assert_eq!((told.len(), left_out.len()), (2, 2), "{left_out:?}");
    assert!(left_out[0].contains("/p: their encoding is \"protobuf\""), "{left_out:?}");
    assert!(left_out[1].contains("/c has no body"), "{left_out:?}");
}
