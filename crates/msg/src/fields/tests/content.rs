//! Tests of fingerprints: what is equal has the same one.

use super::*;
use telltale_engine::model::sample::Fingerprint;

const STAMP: std::ops::Range<usize> = 0..8;
/// Behind the 5 bytes of "odom" with its end, before the length of the next text.
const PADDING: std::ops::Range<usize> = 17..20;
/// The last number, in the covariance of the twist.
const LAST: usize = 8;

fn odometry() -> Vec<u8> {
    encode::odometry(header("odom"), "base_link", at(1.0, -2.0), Motion::default())
}

fn contents(path: &str, bodies: &[Vec<u8>]) -> Vec<Fingerprint> {
    let reader = reader(encode::ODOMETRY, false, &[(path, FieldKind::Content)]);
    let content = |body: &Vec<u8>| match reader.read(body, Endian::Little).values[..] {
        [FieldValue::Content(content)] => content,
        ref other => panic!("{other:?}"),
    };
    bodies.iter().map(content).collect()
}

#[test]
fn stamps_and_what_stands_between_the_values_do_not_count() {
    let (mut later, mut padded) = (odometry(), odometry());
    later[STAMP].fill(7);
    padded[PADDING].fill(0xaa);
    assert!(later != odometry() && padded != odometry());
    for path in ["", "header", "pose.pose"] {
        let found = contents(path, &[odometry(), later.clone(), padded.clone()]);
        assert!(found.iter().all(|it| *it == found[0]), "{path}: {found:?}");
    }
    let stamps = contents("header.stamp", &[odometry(), later]);
    assert_ne!(stamps[0], stamps[1], "a stamp that is asked for counts");
}

#[test]
fn every_bit_of_a_value_counts() {
    let mut last = odometry();
    let at_end = last.len() - LAST;
    // Minus zero.
    last[at_end + 7] = 0x80;
    let found = contents("", &[odometry(), last.clone()]);
    assert_ne!(found[0], found[1]);
    let found = contents("pose", &[odometry(), last]);
    assert_eq!(found[0], found[1], "it is not in this part");
    let named = |name| encode::odometry(header(name), "base", at(0.0, 0.0), Motion::default());
    let found = contents("header.frame_id", &[named("a"), named("b")]);
    assert_ne!(found[0], found[1]);
}

#[test]
fn a_message_that_ends_early_has_none() {
    let body = odometry();
    let reader = reader(encode::ODOMETRY, false, &[("", FieldKind::Content)]);
    let reading = reader.read(&body[..body.len() - LAST], Endian::Little);
    assert!(matches!(reading.values[..], [FieldValue::Unreadable(_)]) && reading.fault.is_some());
}
