//! Publishers are read with the quality of service that they offer, so none has a reason to complain.

use std::time::Duration;

use serde_json::json;
use telltale::engine::input::Input;
use telltale::msg::messages::GidSize;
use telltale::ros::BridgeOptions;

use crate::dds::{Reading, one, summary, until_heard};
use crate::peer::{Domain, Limit, PATIENCE, Peer, Vendor};

with_each_peer!(
    a_second_publisher_of_another_quality_is_read_too_and_nothing_twice,
    no_publisher_complains_of_our_reader_in_either_order_of_start,
    publishers_of_two_kinds_are_read_and_none_that_sends_complains,
    a_publisher_of_best_effort_that_comes_back_does_not_complain,
    a_publisher_that_sends_nothing_takes_no_last_value,
    of_two_publishers_of_a_signal_the_one_that_published_last_counts,
    what_is_published_while_the_reader_is_replaced_is_not_lost,
    a_replaced_reader_ends_though_the_publishers_are_gone,
);

/// A publisher that keeps its last value.
const LATCHED: &str = "--reliability reliable --durability transient_local --depth 1";

/// Longer than discovery takes to settle and a replaced reader to end.
const REPLACED: Duration = Duration::from_secs(5);

/// How many readers asked this publisher for more than it offers.
fn complaints(peer: &mut Peer) -> i64 {
    peer.tell_and_expect(&json!({"complaints": true}), "complaints")["complaints"].as_i64().expect("a number")
}

/// Waits until our side has found this many publishers too: earlier best-effort messages are lost.
pub async fn found(reading: &Reading, topic: &str, publishers: usize) {
    publishers_are(reading, topic, |count| count >= publishers).await;
}

/// Waits until our side knows of one publisher alone.
async fn gone(reading: &Reading, topic: &str) {
    publishers_are(reading, topic, |count| count == 1).await;
}

async fn publishers_are(reading: &Reading, topic: &str, wanted: impl Fn(usize) -> bool) {
    let mut discovery = reading.bridge.discovery();
    let seen = discovery
        .wait_for(|seen| seen.topics.iter().any(|it| it.name == topic && wanted(it.publishers.len())));
    tokio::time::timeout(PATIENCE, seen).await.expect("seen in time").expect("the bridge lives");
}

async fn a_second_publisher_of_another_quality_is_read_too_and_nothing_twice(vendor: Vendor) {
    let (domain, mut reading, mut reliable) = Reading::beside_publisher(vendor).await;
    reliable.write(&one("before"));
    reading.status("before").await;
    let mut best_effort = Peer::start(&domain, "--reliability best_effort pub");
    best_effort.wait_matched(1);
    reliable.wait_matched(1);
    // It may match the reader that is just being replaced.
    let mut numbers = 0..;
    let is_other = |input: &Input| names(input).any(|name| name.starts_with("other")).then_some(());
    until_heard(reading.until("other", is_other), || {
        best_effort.write(&one(&format!("other {}", numbers.next().unwrap_or(0))));
    })
    .await;
    for number in 0..50 {
        reliable.write(&one(&format!("reliable {number}")));
    }
    reading.status("reliable 49").await;
    let mut heard: Vec<_> = reading.received.iter().flat_map(names).collect();
    assert_eq!(heard.iter().filter(|name| name.starts_with("reliable")).count(), 50, "{heard:?}");
    heard.sort_unstable();
    assert!(heard.windows(2).all(|two| two[0] != two[1]), "{heard:?}");
    assert_eq!(heard.len(), reading.received.len(), "{}", summary(&reading.received));
    reading.bridge.shutdown().await;
}

/// The statuses of an array.
fn names(input: &Input) -> impl Iterator<Item = &str> {
    let array = if let Input::Diagnostics(array) = input { Some(array) } else { None };
    array.into_iter().flat_map(|array| array.iter().map(|status| status.name()))
}

async fn no_publisher_complains_of_our_reader_in_either_order_of_start(vendor: Vendor) {
    let mut cases = Vec::new();
    for quality in [
        "--reliability best_effort",
        "--reliability best_effort --durability transient_local --depth 1",
        "--reliability reliable",
        "--reliability reliable --durability transient_local --depth 1",
    ] {
        for publisher_first in [true, false] {
            let domain = Domain::of(vendor);
            // A signal: its last value is wanted from publishers that keep it.
            let arguments = format!("{quality} pub --topic rt/mission/active --type Bool");
            let start = || Peer::start(&domain, &arguments);
            let early = publisher_first.then(start);
            let mut reading = Reading::start(&domain).await;
            let mut peer = early.unwrap_or_else(start);
            found(&reading, "/mission/active", 1).await;
            peer.wait_matched(1);
            peer.write(&json!({"bool": true}));
            reading.signal("active", true).await;
            cases.push((quality, publisher_first, domain, reading, peer));
        }
    }
    tokio::time::sleep(REPLACED).await;
    for (quality, publisher_first, _domain, mut reading, mut peer) in cases {
        peer.wait_matched(1);
        peer.write(&json!({"bool": false}));
        reading.signal("active", false).await;
        assert_eq!(complaints(&mut peer), 0, "{quality}, publisher first: {publisher_first}");
        assert_eq!(reading.received.len(), 2, "{}", summary(&reading.received));
        reading.bridge.shutdown().await;
    }
}

async fn publishers_of_two_kinds_are_read_and_none_that_sends_complains(vendor: Vendor) {
    let mut cases = Vec::new();
    // One of best effort that is silent beside a last value may complain once, until its first message.
    for (kinds, may_complain) in [
        (["--reliability reliable", "--reliability best_effort"], 0),
        (["--reliability reliable", LATCHED], 0),
        (["--reliability best_effort", LATCHED], 1),
    ] {
        let domain = Domain::of(vendor);
        let start =
            |quality| Peer::start(&domain, &format!("{quality} pub --topic rt/mission/active --type Bool"));
        let peers = kinds.map(start);
        let reading = Reading::start(&domain).await;
        found(&reading, "/mission/active", 2).await;
        cases.push((kinds, may_complain, domain, reading, peers));
    }
    for round in 0..2 {
        for ([first, second], may_complain, _, reading, [first_peer, second_peer]) in &mut cases {
            first_peer.wait_matched(1);
            second_peer.wait_matched(1);
            first_peer.write(&json!({"bool": true}));
            reading.signal("active", true).await;
            second_peer.write(&json!({"bool": false}));
            reading.signal("active", false).await;
            let complain = [complaints(first_peer), complaints(second_peer)];
            let is_quiet = complain[0] <= *may_complain && complain[1] == 0;
            assert!(is_quiet, "{complain:?}: {first} beside {second}, round {round}");
        }
        tokio::time::sleep(REPLACED).await;
    }
    for (.., reading, _) in cases {
        assert_eq!(reading.received.len(), 4, "{}", summary(&reading.received));
        reading.bridge.shutdown().await;
    }
}

async fn a_publisher_of_best_effort_that_comes_back_does_not_complain(vendor: Vendor) {
    let (domain, mut reading, mut reliable) = Reading::beside_publisher(vendor).await;
    for round in 0..2 {
        let mut driver = Peer::start(&domain, "--reliability best_effort pub");
        driver.wait_matched(1);
        found(&reading, "/diagnostics", 2).await;
        driver.write(&one(&format!("driver {round}")));
        reading.status(&format!("driver {round}")).await;
        let complain = complaints(&mut driver);
        assert!(round == 0 || complain == 0, "{complain} after it was known");
        driver.end();
        tokio::time::sleep(REPLACED).await;
        gone(&reading, "/diagnostics").await;
    }
    assert_eq!(complaints(&mut reliable), 0);
    reading.bridge.shutdown().await;
}

async fn a_publisher_that_sends_nothing_takes_no_last_value(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let start =
        |quality| Peer::start(&domain, &format!("{quality} pub --topic rt/mission/active --type Bool"));
    let silent = start("--reliability best_effort");
    let mut latched = start(LATCHED);
    latched.write(&json!({"bool": true}));
    let mut reading = Reading::start(&domain).await;
    reading.signal("active", true).await;
    drop(silent);
    reading.bridge.shutdown().await;
}

async fn of_two_publishers_of_a_signal_the_one_that_published_last_counts(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let start = || Peer::start(&domain, &format!("{LATCHED} pub --topic rt/mission/active --type Bool"));
    let mut newer = start();
    newer.write(&json!({"bool": true, "age_s": 60}));
    let mut reading = Reading::start(&domain).await;
    reading.signal("active", true).await;
    let mut older = start();
    older.write(&json!({"bool": false, "age_s": 90}));
    older.wait_matched(1);
    older.write(&json!({"bool": true}));
    reading.signal("active", true).await;
    let is_false = |input: &&Input| matches!(input, Input::Signal { value: false, .. });
    assert_eq!(reading.received.iter().find(is_false), None);
    reading.bridge.shutdown().await;
}

async fn a_replaced_reader_ends_though_the_publishers_are_gone(vendor: Vendor) {
    const LISTEN: &str =
        "--durability transient_local sub --topic ros_discovery_info=ParticipantEntitiesInfo";
    let domain = Domain::of(vendor);
    let mut listener = Peer::start(&domain, LISTEN);
    let options = BridgeOptions { gid_size: Some(GidSize::Bytes16), ..BridgeOptions::loopback(domain.id) };
    let reading = Reading::with(options).await;
    let peer = Peer::start(&domain, "pub");
    let mut readers = || loop {
        let line = listener.next().expect("our node is announced");
        if line["value"]["nodes"][0]["name"] == "telltale" {
            return line["value"]["nodes"][0]["readers"].as_array().map_or(0, Vec::len);
        }
    };
    // The reliable one of /diagnostics beside the one that it replaces.
    let limit = Limit::start();
    while limit.holds() && readers() != 2 {}
    peer.end();
    while limit.holds() && readers() != 1 {}
    reading.bridge.shutdown().await;
}

async fn what_is_published_while_the_reader_is_replaced_is_not_lost(vendor: Vendor) {
    let (domain, mut reading, mut peer) = Reading::beside_publisher(vendor).await;
    let mut driver = None;
    for number in 0..160 {
        peer.write(&one(&format!("number {number}")));
        tokio::time::sleep(Duration::from_millis(50)).await;
        if number == 100 {
            driver = Some(Peer::start(&domain, "--reliability best_effort pub"));
        }
    }
    reading.status("number 159").await;
    assert_eq!(reading.received.len(), 160, "{}", summary(&reading.received));
    drop(driver);
    reading.bridge.shutdown().await;
}
