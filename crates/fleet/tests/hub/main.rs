//! A vehicle and a real hub: nats-server with the configuration that `telltale fleet hub-config` writes, over TLS.

// Helpers of tests are outside of tests for clippy.
#![allow(clippy::unwrap_used)]

mod faults;
mod hostile;
mod proxy;
mod recordings;
mod server;
mod vehicle;

use std::os::unix::fs::PermissionsExt as _;

use async_nats::{ConnectOptions, Event, HeaderMap, ServerError};
use telltale_engine::state::State;
use telltale_engine::time::Timestamp;
use telltale_fleet::delivery::{Answer, Delivery, Last, Learned, Order, Said};
use telltale_fleet::identity::Identity;
use telltale_fleet::line::{Line, NoLine, OwnLast, Want};
use telltale_fleet::message::{AuditHead, Batch, Content, VehicleId};
use telltale_fleet::outbox::{FILE_NAME, Limits, Outbox, Seed};
use telltale_fleet::reading::Reading;
use telltale_fleet::status::{Contact, Status};
use tempfile::TempDir;
use tokio::sync::{mpsc, watch};

use server::{Hub, until};
use vehicle::Vehicle;

impl Vehicle {
    /// A fault of the clock, which is a change of a state, and a record that does not wait as changes do.
    async fn tell(&mut self, is_wrong: bool, record: u64) {
        self.clock_is(is_wrong);
        let head = AuditHead { record, hash: "ab".repeat(32) };
        self.news.send(Content::AuditHead(head)).await.unwrap();
    }

    async fn contact(&self, is_it: impl Fn(&Contact) -> bool) {
        let mut status: watch::Receiver<Status> = self.fleet.status();
        until("the contact", status.wait_for(|status| is_it(&status.contact))).await.unwrap();
    }
}

fn reached(contact: &Contact) -> bool {
    matches!(contact, Contact::Reached { .. })
}

fn records(contents: &[Content]) -> Vec<u64> {
    let record = |content: &Content| match content {
        Content::AuditHead(head) => Some(head.record),
        _ => None,
    };
    contents.iter().filter_map(record).collect()
}

/// A hub, and a vehicle `a` that has told it of its first record.
async fn vehicle_that_told(name: &str) -> (Hub, Vehicle, TempDir) {
    let mut hub = Hub::start(name).await;
    hub.enrol("a");
    let data = TempDir::new().unwrap();
    let mut vehicle = Vehicle::start(&hub, "a", &data);
    vehicle.tell(true, 1).await;
    hub.console().await.history_with("a", |seen| records(seen) == [1]).await;
    (hub, vehicle, data)
}

#[tokio::test]
async fn what_an_enrolled_vehicle_shows_arrives_over_tls_until_its_goodbye() {
    let mut hub = Hub::start("delivers").await;
    hub.enrol("shuttle-03");
    let data = TempDir::new().unwrap();
    let mut vehicle = Vehicle::start(&hub, "shuttle-03", &data);
    vehicle.contact(reached).await;
    vehicle.tell(true, 7).await;
    let console = hub.console().await;
    let seen = console.history_with("shuttle-03", |seen| {
        records(seen) == [7] && seen.iter().any(|it| matches!(it, Content::Delta(_)))
    });
    let seen = seen.await;
    assert!(matches!(&seen[0], Content::Keyframe(all) if all.nodes.len() > 5), "{seen:?}");
    let delta = seen.iter().find_map(|it| if let Content::Delta(delta) = it { Some(delta) } else { None });
    let node = delta.unwrap().nodes.iter().find(|node| node.node == "telltale/clock").unwrap();
    assert_eq!((node.state, &*node.words), (State::Warning, "the clock shows 1970"));
    vehicle.end().await;
    let seen = console.history_with("shuttle-03", |seen| seen.last() == Some(&Content::Goodbye)).await;
    assert_eq!(records(&seen), [7]);
    let head = console.head("shuttle-03").await;
    assert!(head.ending && head.config == "c0ffee" && head.version == "0.1.0", "{head:?}");
    assert_eq!(head.cause.map(|cause| cause.node).as_deref(), Some("telltale/clock"));
}

#[tokio::test]
async fn what_a_server_says_without_a_bound_ends_the_line_and_nothing_else() {
    let endless: &[u8] = &[b'x'; 40_000];
    for before in [&b"-ERR\r\n"[..], b"INFO {}x\r\n", endless] {
        let refused = hostile::line_to(before, b"").await.unwrap_err();
        assert!(matches!(refused, NoLine::Unreachable(_)), "{refused}");
    }
    for (after, why) in [
        (&b"MSG tt.1.a.want 1 4000000000\r\n"[..], "4000000000 bytes"),
        (b"PING\r\n", "PING"),
        (b"-ERR\r\n", "not of the protocol"),
        (endless, "not of the protocol"),
    ] {
        match hostile::line_to(b"", after).await {
            Ok(mut line) => assert!(until("the end", line.next()).await.unwrap_err().contains(why)),
            Err(error) => assert!(error.to_string().contains(why), "{error}"),
        }
    }
}

#[tokio::test]
async fn a_lost_acknowledgement_makes_no_message_twice() {
    let mut hub = Hub::start("ack").await;
    hub.enrol("a");
    let id = VehicleId::new("a").unwrap();
    let identity = Identity::read(&hub.key_file("a")).unwrap();
    let (data, now) = (TempDir::new().unwrap(), Timestamp::ZERO);
    let at_ms = 1_780_000_000_000;
    let seed = Seed { first: 1, nonce: 7 };
    let mut outbox = Outbox::open(data.path(), Limits::default(), seed, now).unwrap();
    let line = Line::open(&hub.address(), &id, &identity).await.unwrap();
    let mut delivery = Delivery::new(identity.public(), 1_000_000);
    delivery.connected();
    let mut acknowledgements = 0;
    for record in 1..=3 {
        let head = Content::AuditHead(AuditHead { record, hash: String::new() });
        outbox.push(at_ms, &[head], now).unwrap();
        loop {
            let answer = match delivery.order(outbox.has_unsent().unwrap(), Timestamp::from_millis(60_000)) {
                Order::Rest | Order::Until(_) => break,
                Order::Ask => {
                    delivery.asks();
                    match line.requests().own_last().await {
                        OwnLast::Nothing => Answer::Nothing,
                        OwnLast::Unknown(answer) => panic!("{answer:?}"),
                        OwnLast::Stored(stored) => {
                            let batch = Batch::unpack(&stored.packed, &id).unwrap();
                            let end = batch.end().unwrap();
                            let known = outbox.knows(end).unwrap();
                            let said = Some(Said { key: batch.key, end, known });
                            Answer::Last(Last { sequence: stored.sequence, said })
                        }
                    }
                }
                Order::Send { after } => {
                    let batch = outbox.batch(&id, identity.public(), at_ms, 1 << 16).unwrap().unwrap();
                    delivery.sends(batch.end, batch.packed.len(), now);
                    let answer = line.requests().log(after, batch.packed).await;
                    assert!(matches!(answer, Answer::Stored(_)), "{answer:?}");
                    acknowledgements += 1;
                    Answer::Silence
                }
            };
            match delivery.answered(&answer, now) {
                Learned::Nothing => {}
                Learned::HubHas(last) => outbox.hub_has(last, at_ms, now).unwrap(),
                Learned::TwoVehicles => panic!("there is one vehicle"),
            }
        }
    }
    assert_eq!(acknowledgements, 3);
    let mode = data.path().join(FILE_NAME).metadata().unwrap().permissions().mode();
    assert_eq!(mode & 0o777, 0o600);
    let seen = hub.console().await.history_with("a", |seen| seen.len() == 3).await;
    assert_eq!(records(&seen), [1, 2, 3]);
    // Another one that goes on from an older message is refused.
    assert_eq!(line.requests().log(1, vec![1]).await, Answer::WrongLast);
}

#[tokio::test]
async fn what_happened_while_the_hub_was_away_arrives_later() {
    let (mut hub, mut vehicle, _data) = vehicle_that_told("away").await;
    hub.kill();
    vehicle.contact(|it| matches!(it, Contact::Away { .. })).await;
    vehicle.tell(false, 2).await;
    hub.start_again().await;
    vehicle.contact(reached).await;
    vehicle.tell(true, 3).await;
    hub.console().await.history_with("a", |seen| records(seen) == [1, 2, 3]).await;
}

#[tokio::test]
async fn a_hub_that_goes_on_from_an_old_copy_gets_again_what_it_lost() {
    let (mut hub, mut vehicle, _data) = vehicle_that_told("copy").await;
    hub.kill();
    hub.copy_store();
    hub.start_again().await;
    vehicle.tell(false, 2).await;
    hub.console().await.history_with("a", |seen| records(seen) == [1, 2]).await;
    hub.kill();
    hub.restore_store();
    hub.start_again().await;
    hub.console().await.history_with("a", |seen| records(seen) == [1, 2]).await;
    vehicle.tell(true, 3).await;
    hub.console().await.history_with("a", |seen| records(seen) == [1, 2, 3]).await;
}

#[tokio::test]
async fn a_console_reads_more_than_it_asks_for_at_once_on_one_line() {
    const BATCHES: u64 = 200;
    let mut hub = Hub::start("many").await;
    hub.enrol("a");
    let id = VehicleId::new("a").unwrap();
    let vehicle = Identity::read(&hub.key_file("a")).unwrap();
    let line = Line::open(&hub.address(), &id, &vehicle).await.unwrap();
    for after in 0..BATCHES {
        let stored = line.requests().log(after, vec![0; 8]).await;
        assert_eq!(stored, Answer::Stored(after + 1));
    }
    let console = Identity::read(&hub.key_file("console")).unwrap();
    let mut reading = Reading::open(&hub.address(), &console, 0).await.unwrap();
    for number in 1..=BATCHES {
        let read = until("a batch", reading.next()).await.unwrap();
        assert_eq!(read.sequence, number);
    }
}

#[tokio::test]
async fn two_vehicles_with_one_key_are_an_error_of_one_of_them() {
    let (hub, mut first, _data) = vehicle_that_told("two").await;
    let copied = TempDir::new().unwrap();
    let second = Vehicle::start(&hub, "a", &copied);
    second.contact(|it| *it == Contact::TwoVehicles).await;
    let status = second.fleet.status().borrow().clone();
    assert!(status.fault(Timestamp::ZERO).is_some_and(|fault| fault.is_error));
    // The other goes on.
    first.tell(false, 2).await;
    hub.console().await.history_with("a", |seen| records(seen) == [1, 2]).await;
}

#[tokio::test]
async fn a_revoked_vehicle_is_closed_at_once_and_one_with_a_new_key_goes_on() {
    let (mut hub, mut vehicle, _data) = vehicle_that_told("revoked").await;
    hub.revoke("a");
    vehicle.contact(|it| matches!(it, Contact::Refused { .. })).await;
    vehicle.tell(false, 2).await;
    vehicle.end().await;
    // Its outbox is lost, too: the key is new, so nobody else can be telling by this name.
    hub.enrol("a");
    let data = TempDir::new().unwrap();
    let mut vehicle = Vehicle::start(&hub, "a", &data);
    vehicle.tell(true, 3).await;
    hub.console().await.history_with("a", |seen| records(seen) == [1, 3]).await;
}

#[tokio::test]
async fn a_vehicle_hears_wishes_and_nothing_of_others() {
    let mut hub = Hub::start("permissions").await;
    hub.enrol("a");
    hub.enrol("b");
    let id = VehicleId::new("a").unwrap();
    let identity = Identity::read(&hub.key_file("a")).unwrap();
    let mut line = Line::open(&hub.address(), &id, &identity).await.unwrap();
    let console = hub.console().await;
    console.want("a", r#"{"stop":true}"#).await;
    console.want("a", r#"{"live_s":5,"incidents":[7]}"#).await;
    assert_eq!(until("no wish", line.next()).await, Ok(None));
    let live = Some(telltale_engine::time::Span::from_secs(5));
    assert_eq!(until("the wish", line.next()).await, Ok(Some(Want { live, incidents: vec![7] })));

    let (refused, mut refusals) = mpsc::unbounded_channel();
    let seed = std::fs::read_to_string(hub.key_file("a")).unwrap();
    let hostile = ConnectOptions::with_nkey(seed.trim().to_owned())
        .add_root_certificates(hub.address().ca)
        .require_tls(true)
        .custom_inbox_prefix("_INBOX.a")
        .event_callback(move |event| {
            if let Event::ServerError(ServerError::Other(error)) = event {
                let _ = refused.send(error);
            }
            std::future::ready(())
        })
        .connect(hub.address().url)
        .await
        .unwrap();
    let mut subscriptions = Vec::new();
    for subject in ["tt.1.b.head", "tt.1.>", "tt.1.b.want", "_INBOX.b.>", "_INBOX.>", ">"] {
        subscriptions.push(hostile.subscribe(subject).await.unwrap());
        let error = until(subject, refusals.recv()).await.unwrap().to_lowercase();
        assert!(error.contains("permissions violation for subscription"), "{subject}: {error}");
    }
    for subject in [
        "tt.1.b.log",
        "tt.1.b.inc.c0ffee.0",
        "$JS.API.STREAM.PURGE.INC",
        "$JS.API.DIRECT.GET.INC.tt.1.a.inc.c0ffee.0",
        "tt.1.a.want",
        "tt.1.b.want",
        "$JS.API.STREAM.PURGE.LOG",
        "$JS.API.STREAM.MSG.GET.LOG",
        "$JS.API.DIRECT.GET.LOG",
        "$JS.API.DIRECT.GET.LOG.tt.1.b.log",
        "$JS.API.CONSUMER.CREATE.LOG",
        "$JS.API.STREAM.DELETE.LOG",
    ] {
        hostile.publish(subject, "{}".into()).await.unwrap();
        let error = until(subject, refusals.recv()).await.unwrap().to_lowercase();
        assert!(error.contains("permissions violation for publish"), "{subject}: {error}");
    }

    // JetStream sends an answer to any subject that a request names, but not into another account.
    let (other, key) = (VehicleId::new("b").unwrap(), Identity::read(&hub.key_file("b")).unwrap());
    let mut others = Line::open(&hub.address(), &other, &key).await.unwrap();
    let own_last = "$JS.API.DIRECT.GET.LOG.tt.1.a.log";
    let mut stored = 0;
    for (reply, body) in [
        ("tt.1.b.head", "forged"),
        ("tt.1.b.log", "forged"),
        ("tt.1.b.want", r#"{"live_s":6}"#),
        ("$JS.API.STREAM.PURGE.LOG", "{}"),
        ("$JS.API.STREAM.DELETE.LOG", ""),
        ("$JS.API.CONSUMER.CREATE.LOG", r#"{"stream_name":"LOG","config":{"deliver_subject":"_INBOX.a.x"}}"#),
    ] {
        for subject in [own_last, "tt.1.a.log"] {
            let _ = hostile.request("tt.1.a.log", body.into()).await.unwrap();
            hostile.publish_with_reply(subject, reply, body.into()).await.unwrap();
            stored += 1 + u64::from(subject != own_last);
        }
    }
    // A header of the message itself is not what the hub says of it.
    let mut headers = HeaderMap::new();
    headers.insert("Nats-Sequence", "18446744073709551615");
    hostile.request_with_headers("tt.1.a.log", headers, "last".into()).await.unwrap();
    stored += 1;
    match until("the last of a", line.requests().own_last()).await {
        OwnLast::Stored(last) => assert_eq!((last.sequence, &*last.packed), (stored, &b"last"[..])),
        other => panic!("{other:?}"),
    }
    let nothing = until("the last of b", others.requests().own_last()).await;
    assert!(matches!(nothing, OwnLast::Nothing), "{nothing:?}");
    assert!(!console.has_head("b").await);
    console.want("b", r#"{"live_s":7}"#).await;
    let live = Some(telltale_engine::time::Span::from_secs(7));
    assert_eq!(until("the wish", others.next()).await, Ok(Some(Want { live, incidents: vec![] })));
}
