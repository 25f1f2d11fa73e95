//! What goes wrong between a vehicle and its hub: bad lines, a hub that is full, and a key that is revoked.

use std::time::Duration;

use telltale_fleet::delivery::Answer;
use telltale_fleet::identity::Identity;
use telltale_fleet::line::Line;
use telltale_fleet::message::{AuditHead, Content, PIECE_BYTES, VehicleId};
use telltale_fleet::status::Contact;
use tempfile::TempDir;

use crate::proxy::{Mode, Proxy};
use crate::recordings::{SHA, hub, piece, recording};
use crate::server::{Hub, until};
use crate::vehicle::Vehicle;
use crate::{reached, records};

/// A hub with a vehicle `a` behind a line.
async fn behind(name: &str, mode: Mode) -> (Hub, Proxy, Vehicle, TempDir) {
    let mut hub = Hub::start(name).await;
    hub.enrol("a");
    let proxy = Proxy::start(&hub, mode).await;
    let data = TempDir::new().unwrap();
    let vehicle = Vehicle::over(proxy.address(&hub), hub.key_file("a"), "a", &data, true);
    (hub, proxy, vehicle, data)
}

/// Records with a hash that is not packed to nothing.
async fn tell_many(vehicle: &Vehicle, records: std::ops::RangeInclusive<u64>) {
    for record in records {
        let hash = (0..4).map(|it| format!("{:016x}", (record * 4 + it).wrapping_mul(0x9e37_79b9_7f4a_7c15)));
        vehicle.news.send(Content::AuditHead(AuditHead { record, hash: hash.collect() })).await.unwrap();
    }
}

#[tokio::test]
async fn on_a_slow_line_that_is_cut_again_and_again_each_message_arrives_once() {
    let (hub, proxy, vehicle, _data) = behind("cuts", Mode::Slow(1024)).await;
    // In the handshake, and in batches, which are larger than all that may pass before.
    proxy.cut_after(&[300, 5000, 9000]);
    tell_many(&vehicle, 1..=600).await;
    let console = hub.console().await;
    let all: Vec<u64> = (1..=600).collect();
    console.history_with("a", |seen| records(seen) == all).await;
    assert!(proxy.has_cut_all());
    vehicle.end().await;
    let seen = console.history_with("a", |seen| seen.last() == Some(&Content::Goodbye)).await;
    assert_eq!(records(&seen), all);
}

#[tokio::test]
async fn the_head_of_an_engine_that_hangs_is_not_told_again() {
    let (hub, proxy, mut vehicle, _data) = behind("hangs", Mode::Open).await;
    let console = hub.console().await;
    vehicle.tell(true, 1).await;
    console.history_with("a", |seen| records(seen) == [1]).await;
    let told = console.head_when("a", |_, head| head.cause.is_some()).await;
    vehicle.hang();
    proxy.is(Mode::Reset);
    vehicle.contact(|it| matches!(it, Contact::Away { .. })).await;
    proxy.is(Mode::Open);
    vehicle.contact(reached).await;
    // The first thing on a new line is a head, else.
    tell_many(&vehicle, 2..=2).await;
    console.history_with("a", |seen| records(seen) == [1, 2]).await;
    assert_eq!(console.head_when("a", |_, _| true).await, told);
    vehicle.clock_is(false);
    console.head_when("a", |at, _| at > told).await;
}

#[tokio::test]
async fn a_line_that_swallows_everything_is_given_up_and_nothing_is_lost() {
    let (hub, proxy, mut vehicle, _data) = behind("hole", Mode::Open).await;
    let console = hub.console().await;
    vehicle.tell(true, 1).await;
    console.history_with("a", |seen| records(seen) == [1]).await;
    proxy.is(Mode::BlackHole);
    vehicle.tell(false, 2).await;
    // No answer for 25 s, and no packet that says why.
    let status = &mut vehicle.fleet.status();
    let away = status.wait_for(|it| matches!(it.contact, Contact::Away { .. }));
    tokio::time::timeout(Duration::from_secs(60), away).await.expect("it is given up").unwrap();
    vehicle.tell(true, 3).await;
    proxy.is(Mode::Open);
    vehicle.contact(reached).await;
    console.history_with("a", |seen| records(seen) == [1, 2, 3]).await;
}

#[tokio::test]
async fn a_vehicle_that_is_revoked_while_it_sends_a_recording_goes_on_with_its_new_key() {
    let (mut hub, pieces, data) = hub("revoked-upload").await;
    let vehicle = Vehicle::start(&hub, "a", &data);
    let (finished, content) = recording(&data, 7, 60 * PIECE_BYTES);
    vehicle.finished.send(finished).await.unwrap();
    piece(&pieces, 5).await;
    hub.revoke("a");
    vehicle.contact(|it| matches!(it, Contact::Refused { .. })).await;
    let id = VehicleId::new("a").unwrap();
    assert!(pieces.read(&id, SHA, 59).await.unwrap().is_none(), "it was not done yet");
    vehicle.end().await;
    hub.enrol("a");
    let vehicle = Vehicle::start(&hub, "a", &data);
    for number in [0, 30, 59] {
        let from = number as usize * PIECE_BYTES;
        assert_eq!(piece(&pieces, number).await, content[from..from + PIECE_BYTES], "{number}");
    }
    vehicle.end().await;
}

#[tokio::test]
async fn a_hub_that_is_full_of_recordings_takes_messages_and_the_rest_when_it_has_room() {
    let (mut hub, pieces, data) = hub("full").await;
    hub.enrol("b");
    let id = |text| VehicleId::new(text).unwrap();
    let key = Identity::read(&hub.key_file("b")).unwrap();
    let line = Line::open(&hub.address(), &id("b"), &key).await.unwrap();
    let mut number = 0;
    while let Answer::Stored(_) = line.requests().piece(SHA, number, vec![7; PIECE_BYTES]).await {
        number += 1;
    }
    assert!(number > 100, "{number}");
    let mut vehicle = Vehicle::start(&hub, "a", &data);
    let (finished, content) = recording(&data, 7, PIECE_BYTES + 5);
    vehicle.finished.send(finished).await.unwrap();
    vehicle.tell(true, 1).await;
    let console = hub.console().await;
    let announced = |seen: &[Content]| seen.iter().any(|it| matches!(it, Content::Recording(_)));
    console.history_with("a", |seen| records(seen) == [1] && announced(seen)).await;
    assert!(pieces.read(&id("a"), SHA, 0).await.unwrap().is_none(), "there is no room");
    pieces.remove(&id("b"), SHA, None).await.unwrap();
    // The vehicle tries again after 30 s.
    let arrives = async {
        while pieces.read(&id("a"), SHA, 1).await.unwrap().is_none() {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    };
    tokio::time::timeout(Duration::from_secs(90), arrives).await.expect("it comes");
    assert_eq!(until("the first", piece(&pieces, 0)).await, content[..PIECE_BYTES]);
    vehicle.end().await;
    console.history_with("a", |seen| seen.last() == Some(&Content::Goodbye)).await;
}

#[tokio::test]
async fn a_cluster_that_loses_the_leader_of_its_logs_goes_on_without_a_loss() {
    let mut nodes = Hub::start_cluster("cluster").await;
    let leader = until("a leader", nodes[0].console().await.leader()).await;
    // The vehicle talks to another node, which stays.
    let at = nodes.iter().position(|node| node.node_name() != leader).unwrap();
    let data = TempDir::new().unwrap();
    let mut vehicle = Vehicle::start(&nodes[at], "a", &data);
    vehicle.tell(true, 1).await;
    let console = nodes[at].console().await;
    console.history_with("a", |seen| records(seen) == [1]).await;
    let led = nodes.iter_mut().find(|node| node.node_name() == leader).unwrap();
    led.kill();
    vehicle.tell(false, 2).await;
    let elected = async {
        while console.leader().await == leader {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    };
    until("another leader", elected).await;
    vehicle.tell(true, 3).await;
    // An answer that never came is waited for 25 s.
    let arrived = async {
        while records(&console.contents("a").await) != [1, 2, 3] {
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    };
    tokio::time::timeout(Duration::from_secs(90), arrived).await.expect("the messages arrive");
    vehicle.end().await;
    let seen = console.history_with("a", |seen| seen.last() == Some(&Content::Goodbye)).await;
    assert_eq!(records(&seen), [1, 2, 3]);
}
