//! Tests of the messages that Telltale itself reads and writes.

use std::time::{Duration, UNIX_EPOCH};

use proptest::prelude::*;

use super::*;

fn limits() -> Limits {
    Limits::default()
}

fn sample() -> StatusArray {
    let mut array = StatusArray::default();
    array.push_status(0, "imu: status", "fine", "imu-7");
    array.push_value("hz", "100.2");
    array.push_value("temperature", "31 °C");
    array.push_status(2, "velodyne_packet_alive", "", "");
    array
}

fn fields(status: Status<'_>) -> (u8, Vec<String>) {
    let texts = [status.name(), status.message(), status.hardware_id()].into_iter();
    let values = status.values().flat_map(|(key, value)| [key, value]);
    (status.level(), texts.chain(values).map(str::to_owned).collect())
}

fn encoded(array: &StatusArray) -> Vec<u8> {
    let bodies = encode_diagnostic_arrays(array, UNIX_EPOCH + Duration::from_secs(1), usize::MAX);
    assert_eq!(bodies.len(), 1);
    bodies.into_iter().next().unwrap()
}

#[test]
fn type_names_travel_both_ways() {
    assert_eq!(dds_type_name(BOOL).as_deref(), Some("std_msgs::msg::dds_::Bool_"));
    for wrong in ["Bool", "std_msgs/Bool", "a/msg/B/c", "a//B", "a/msg/B c"] {
        assert_eq!(dds_type_name(wrong), None, "{wrong}");
    }
    assert_eq!(ros_type_name("std_msgs::msg::dds_::Bool_"), BOOL);
    assert_eq!(ros_type_name("Shape"), "Shape");
}

#[test]
fn what_was_encoded_is_decoded() {
    let body = encoded(&sample());
    assert_eq!(diagnostic_array(&body, Endian::Little, &limits()), (sample(), None));
}

#[test]
fn big_endian_is_read_as_well() {
    let mut body = Vec::new();
    let word = |body: &mut Vec<u8>, value: u32| body.extend(value.to_be_bytes());
    word(&mut body, 1);
    word(&mut body, 2);
    word(&mut body, 0);
    word(&mut body, 1);
    body.extend([2, 0, 0, 0]);
    for text in [*b"nam\0", *b"msg\0", *b"hwd\0"] {
        word(&mut body, 4);
        body.extend(text);
    }
    word(&mut body, 0);
    let (array, fault) = diagnostic_array(&body, Endian::Big, &limits());
    assert_eq!(fault, None);
    assert_eq!(fields(array.get(0)), (2, vec!["nam".to_owned(), "msg".to_owned(), "hwd".to_owned()]));
}

#[test]
fn one_bad_string_loses_nothing_else() {
    let mut body = encoded(&sample());
    let at = body.windows(4).position(|bytes| bytes == b"fine").unwrap();
    body[at..at + 4].copy_from_slice(&[b'f', 0xff, 0, b'e']);
    let (array, fault) = diagnostic_array(&body, Endian::Little, &limits());
    assert_eq!(fault, None);
    assert_eq!(array.get(0).message(), "f\u{fffd}\u{fffd}e");
    assert_eq!(fields(array.get(1)), fields(sample().get(1)));
}

#[test]
fn a_cut_array_keeps_what_stands_before_the_cut() {
    let body = encoded(&sample());
    let second = body.windows(8).position(|bytes| bytes == b"velodyne").unwrap();
    let (array, fault) = diagnostic_array(&body[..second + 3], Endian::Little, &limits());
    assert_eq!(array.len(), 1);
    assert_eq!(fields(array.get(0)), fields(sample().get(0)));
    assert!(fault.unwrap().to_string().starts_with("cut at byte"));
}

#[test]
fn a_status_that_is_cut_in_its_values_is_dropped_whole() {
    let mut array = StatusArray::default();
    array.push_status(1, "first", "", "");
    array.push_status(2, "second", "", "");
    array.push_value("key", "value");
    let body = encoded(&array);
    let (decoded, fault) = diagnostic_array(&body[..body.len() - 8], Endian::Little, &limits());
    assert!(fault.is_some());
    array.truncate(1);
    assert_eq!(decoded, array);
}

#[test]
fn limits_hold() {
    let narrow = Limits { string_bytes: 6, values_per_status: 1, ..limits() };
    let mut array = StatusArray::default();
    array.push_status(0, "grün°°", "123456", "1234567");
    array.push_value("a", "1234567890123");
    array.push_value("c", "d");
    let (decoded, fault) = diagnostic_array(&encoded(&array), Endian::Little, &narrow);
    assert_eq!(fault, None);
    let status = decoded.get(0);
    assert_eq!((status.name(), status.message(), status.hardware_id()), ("grün", "123456", "123456"));
    // A value that was cut is longer than the limit, so that nobody takes it for complete.
    assert_eq!(status.values().collect::<Vec<_>>(), [("a", "1234567890")]);
}

#[test]
fn a_claim_of_billions_is_neither_believed_nor_paid_for() {
    let mut writer = Writer::default();
    writer.u32(0);
    writer.u32(0);
    writer.string("");
    writer.u32(u32::MAX);
    let (array, fault) = diagnostic_array(&writer.finish(), Endian::Little, &limits());
    assert!(array.is_empty());
    assert!(fault.unwrap().to_string().starts_with("cut at byte"));
}

#[test]
fn statuses_past_the_limit_are_dropped_and_named() {
    let mut array = StatusArray::default();
    for _ in 0..STATUSES_MAX + 5 {
        array.push_status(0, "n", "", "");
    }
    let (decoded, fault) = diagnostic_array(&encoded(&array), Endian::Little, &limits());
    assert_eq!(decoded.len(), STATUSES_MAX);
    assert_eq!(
        fault.unwrap().what,
        FaultKind::TooMany { claimed: STATUSES_MAX as u32 + 5, limit: STATUSES_MAX }
    );
}

#[test]
fn large_arrays_are_split_and_nothing_is_lost() {
    let mut array = StatusArray::default();
    for index in 0..1000 {
        array.push_status(0, &format!("node {index}"), "a message of some length", "");
    }
    let bodies = encode_diagnostic_arrays(&array, UNIX_EPOCH, 10_000);
    assert!(bodies.iter().all(|body| body.len() <= 10_100 && body.len() % 4 == 0));
    let names: Vec<String> = bodies
        .iter()
        .flat_map(|body| {
            let (part, fault) = diagnostic_array(body, Endian::Little, &limits());
            assert_eq!(fault, None);
            part.iter().map(|status| status.name().to_owned()).collect::<Vec<_>>()
        })
        .collect();
    assert_eq!(names, (0..1000).map(|index| format!("node {index}")).collect::<Vec<_>>());
    assert_eq!(encode_diagnostic_arrays(&StatusArray::default(), UNIX_EPOCH, 10).len(), 1);
}

#[test]
fn the_size_of_a_gid_is_told_by_its_message() {
    for size in [GidSize::Bytes16, GidSize::Bytes24] {
        for readers in 0..4 {
            let gids = vec![[9; 16]; readers];
            let node = NodeEntities { name: "/ns/telltale", readers: &gids, writers: &gids };
            let body = encode_nodes([7; 16], &[node], size);
            assert_eq!(GidSize::of_message(&body, Endian::Little), Some(size), "{readers} readers");
        }
    }
    assert_eq!(GidSize::of_message(b"no such message", Endian::Little), None);
    assert_eq!(GidSize::of_distro("humble"), Some(GidSize::Bytes24));
    assert_eq!(GidSize::of_distro("jazzy"), Some(GidSize::Bytes16));
    assert_eq!(GidSize::of_distro("unheard-of"), None);
}

/// The property of a decoder for any bytes: it returns, within its limits, and every range it made can be
/// read.
fn decode_all(body: &[u8]) {
    let narrow = Limits { string_bytes: 16, values_per_status: 2, ..limits() };
    for endian in [Endian::Big, Endian::Little] {
        let (array, _) = diagnostic_array(body, endian, &narrow);
        for status in array.iter() {
            let longest = [status.name(), status.message(), status.hardware_id()].map(str::len);
            // A byte that is not UTF-8 becomes the three bytes of U+FFFD.
            assert!(longest.into_iter().all(|bytes| bytes <= 3 * narrow.string_bytes));
            assert!(status.values().count() <= narrow.values_per_status);
        }
        let _ = boolean(body, endian);
        let _ = GidSize::of_message(body, endian);
    }
}

proptest! {
    #[test]
    fn no_bytes_make_it_panic(body in prop::collection::vec(any::<u8>(), 0..600)) {
        decode_all(&body);
    }

    #[test]
    fn no_damage_to_a_message_makes_it_panic(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 0..8),
        end in any::<prop::sample::Index>(),
    ) {
        let mut body = encoded(&sample());
        for (at, byte) in damage {
            let at = at.index(body.len());
            body[at] = byte;
        }
        body.truncate(end.index(body.len() + 1));
        decode_all(&body);
    }

    #[test]
    fn every_text_comes_back(
        statuses in prop::collection::vec((any::<u8>(), "\\PC{0,20}", "\\PC{0,20}"), 0..20),
        bytes_max in 1..2000_usize,
    ) {
        let mut array = StatusArray::default();
        for (level, name, value) in &statuses {
            array.push_status(*level, name, value, name);
            array.push_value(name, value);
        }
        let mut decoded = StatusArray::default();
        for body in encode_diagnostic_arrays(&array, UNIX_EPOCH, bytes_max) {
            let (part, fault) = diagnostic_array(&body, Endian::Little, &limits());
            prop_assert_eq!(fault, None);
            for status in part.iter() {
                decoded.push_status(status.level(), status.name(), status.message(), status.hardware_id());
                for (key, value) in status.values() {
                    decoded.push_value(key, value);
                }
            }
        }
        prop_assert_eq!(decoded, array);
    }
}
