//! The bridge against Eclipse Cyclone DDS and eProsima Fast DDS, in processes of their own.

use std::cell::Cell;
use std::time::Duration;

use serde_json::{Value, json};
use telltale::clock::Clock;
use telltale::engine::input::{Input, ReceptionTrouble, StatusArray, TroubleKind};
use telltale::engine::model::{FieldSource, Model, Parts, SignalSource, SignalSpec, StageModel};
use telltale::engine::time::Span;
use telltale::msg::messages::GidSize;
use telltale::ros::{self, Bridge, BridgeOptions, Publisher};
use telltale::runtime::Stamped;
use tokio::sync::mpsc;

use crate::peer::{Domain, Limit, PATIENCE, Peer, Vendor};

pub struct Reading {
    pub bridge: Bridge,
    inputs: mpsc::Receiver<Stamped>,
    pub received: Vec<Input>,
}

impl Reading {
    pub async fn start(domain: &Domain) -> Reading {
        Reading::with(BridgeOptions::loopback(domain.id)).await
    }

    pub async fn with(options: BridgeOptions) -> Reading {
        let (sender, inputs) = mpsc::channel(1024);
        let bridge = ros::start(options, &model(), sender, Clock::start()).await.expect("the bridge starts");
        Reading { bridge, inputs, received: Vec::new() }
    }

    /// Beside a publisher of diagnostics that has found it.
    pub async fn beside_publisher(vendor: Vendor) -> (Domain, Reading, Peer) {
        let domain = Domain::of(vendor);
        let reading = Reading::start(&domain).await;
        let mut peer = Peer::start(&domain, "pub");
        peer.wait_matched(1);
        (domain, reading, peer)
    }

    /// Receives until an input fits; earlier ones stay in `received`.
    pub async fn until<T>(&mut self, what: &str, mut fits: impl FnMut(&Input) -> Option<T>) -> T {
        let found = async {
            loop {
                let input = self.inputs.recv().await.expect("the bridge lives").input;
                let found = fits(&input);
                // Who could say something is said by the clock; what means nothing comes for recorders alone.
                if !matches!(input, Input::Writers(_) | Input::Tick) {
                    self.received.push(input);
                }
                if let Some(found) = found {
                    return found;
                }
            }
        };
        let found = tokio::time::timeout(PATIENCE, found).await;
        found.unwrap_or_else(|_| panic!("no {what}; received: {}", summary(&self.received)))
    }

    pub async fn status(&mut self, name: &str) -> StatusArray {
        self.until(name, |input| match input {
            Input::Diagnostics(array) if array.iter().any(|status| status.name() == name) => {
                Some(array.clone())
            }
            _ => None,
        })
        .await
    }

    async fn trouble(&mut self, kind: TroubleKind) -> ReceptionTrouble {
        self.until(&format!("{kind:?}"), |input| match input {
            Input::Reception(trouble) if trouble.kind == kind => Some(trouble.clone()),
            _ => None,
        })
        .await
    }

    pub async fn signal(&mut self, name: &str, value: bool) {
        let expected = Input::Signal { name: name.into(), value };
        self.until(&format!("{expected:?}"), |input| (*input == expected).then_some(())).await;
    }

    fn troubles(&self) -> Vec<&Input> {
        self.received.iter().filter(|input| matches!(input, Input::Reception(_))).collect()
    }
}

pub fn summary(received: &[Input]) -> String {
    let words = received.iter().rev().take(20).map(|input| match input {
        Input::Diagnostics(array) => format!("{} statuses", array.len()),
        other => format!("{other:?}"),
    });
    words.collect::<Vec<_>>().join(", ")
}

fn model() -> Model {
    let signal = |name: &str, topic: &str, type_name: &str, present_for| {
        let (topic, type_name) = (topic.into(), type_name.into());
        let source = SignalSource::Field(FieldSource { topic, type_name, field: "data".into() });
        SignalSpec { present_for, ..SignalSpec::new(name, source) }
    };
    let active = signal("active", "/mission/active", "std_msgs/msg/Bool", None);
    let goal = signal("goal", "/goal", "std_msgs/msg/String", Some(Span::from_secs(1)));
    let parts = Parts { signals: vec![active, goal], ..Parts::empty("test", StageModel::None) };
    Model::new(parts).expect("nothing depends on anything")
}

/// Says something again and again until it is heard.
pub async fn until_heard<T>(heard: impl Future<Output = T>, mut say: impl FnMut()) -> T {
    let again = async {
        loop {
            say();
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    };
    tokio::select! {
        heard = heard => heard,
        () = again => unreachable!("it goes on"),
    }
}

pub fn one(name: &str) -> Value {
    json!({"statuses": [{"name": name, "level": 1, "message": "m", "hardware_id": "h", "values": {"k": "v"}}]})
}

with_each_peer!(
    every_quality_of_service_in_both_orders_of_start,
    one_bad_string_does_not_lose_its_array,
    a_cut_message_is_told_and_the_next_one_is_read,
    a_flood_of_bad_messages_is_summed_up,
    what_a_slow_engine_loses_is_counted,
    another_type_on_the_topic_is_told_and_never_decoded,
    a_late_joiner_learns_the_last_value_of_a_signal_but_no_old_event,
    a_new_participant_goes_on_where_the_old_one_ended,
    what_is_missed_between_two_participants_is_told_as_lost,
    large_arrays_arrive_from_both_sides,
    published_signals_reach_foreign_late_joiners_and_our_own_bridge,
    the_node_is_announced_in_the_size_that_the_others_use,
);

async fn every_quality_of_service_in_both_orders_of_start(vendor: Vendor) {
    for quality in ["reliable", "best_effort"] {
        for publisher_first in [true, false] {
            let domain = Domain::of(vendor);
            let arguments = format!("--reliability {quality} pub");
            let (mut peer, mut reading);
            if publisher_first {
                peer = Peer::start(&domain, &arguments);
                reading = Reading::start(&domain).await;
            } else {
                reading = Reading::start(&domain).await;
                peer = Peer::start(&domain, &arguments);
            }
            peer.wait_matched(1);
            peer.write(&one("first"));
            peer.write(&one("second"));
            let array = reading.status("second").await;
            let status = array.get(0);
            assert_eq!((status.level(), status.message(), status.hardware_id()), (1, "m", "h"));
            assert_eq!(status.values().collect::<Vec<_>>(), [("k", "v")]);
            assert_eq!(reading.received.len(), 2, "{quality}, publisher first: {publisher_first}");
            reading.bridge.shutdown().await;
        }
    }
}

async fn one_bad_string_does_not_lose_its_array(vendor: Vendor) {
    let (_domain, mut reading, mut peer) = Reading::beside_publisher(vendor).await;
    // A lone surrogate is a byte that is not UTF-8.
    peer.tell_raw(r#"{"statuses": [{"name": "a", "message": "b\udcffc"}, {"name": "b"}]}"#);
    let array = reading.status("b").await;
    assert_eq!((array.len(), array.get(0).message()), (2, "b\u{fffd}c"));
    assert!(reading.troubles().is_empty());
    reading.bridge.shutdown().await;
}

async fn a_cut_message_is_told_and_the_next_one_is_read(vendor: Vendor) {
    let (_domain, mut reading, mut peer) = Reading::beside_publisher(vendor).await;
    peer.write(&json!({"statuses": [{"name": "kept"}, {"name": "lost"}], "cut": 64}));
    let array = reading.status("kept").await;
    assert_eq!(array.len(), 1);
    let trouble = reading.trouble(TroubleKind::Malformed).await;
    assert_eq!((&*trouble.topic, trouble.count), ("/diagnostics", 1));
    assert!(trouble.text.contains("cut at byte"), "{}", trouble.text);
    // A wrong length, noise, almost nothing.
    for raw in ["00010000ffffffffffffffffffffffff", "000100000102ffffff0001", "00010000ff"] {
        peer.write(&json!({"raw": raw}));
    }
    peer.write(&one("good"));
    reading.status("good").await;
    reading.bridge.shutdown().await;
}

async fn a_flood_of_bad_messages_is_summed_up(vendor: Vendor) {
    let (_domain, mut reading, mut peer) = Reading::beside_publisher(vendor).await;
    // Losses count from the first received message of a publisher.
    peer.write(&one("first"));
    reading.status("first").await;
    peer.write(&json!({"raw": "0001000001", "times": 2000}));
    peer.write(&one("good"));
    reading.status("good").await;
    // Losses of such a flood on a busy machine are reported as well: every message is accounted for.
    let counts = |inputs: &[Input]| {
        let troubles = inputs.iter().filter_map(|input| match input {
            Input::Reception(trouble) => Some(trouble.count),
            _ => None,
        });
        troubles.collect::<Vec<_>>()
    };
    let limit = Limit::start();
    while limit.holds() && counts(&reading.received).iter().sum::<u64>() < 2000 {
        reading.until("trouble", |input| matches!(input, Input::Reception(_)).then_some(())).await;
    }
    let told = counts(&reading.received);
    assert!(told.len() < 200 && told.iter().sum::<u64>() == 2000, "{told:?}");
    reading.bridge.shutdown().await;
}

async fn what_a_slow_engine_loses_is_counted(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let (sender, mut inputs) = mpsc::channel(1);
    let options = BridgeOptions::loopback(domain.id);
    let bridge = ros::start(options, &model(), sender, Clock::start()).await.expect("the bridge starts");
    let mut peer = Peer::start(&domain, "pub");
    peer.wait_matched(1);
    // Gaps count from the first received message of a publisher.
    peer.write(&one("first"));
    let first = async {
        while !matches!(inputs.recv().await.expect("the bridge lives").input, Input::Diagnostics(_)) {}
    };
    tokio::time::timeout(PATIENCE, first).await.expect("the first array comes");
    // More than may wait. The publisher answers once all is sent: the engine takes nothing before that.
    let sent = Cell::new(6_000);
    peer.write(&json!({"statuses": [{"name": "many", "message": "m".repeat(20_000)}], "times": sent.get()}));
    peer.tell_and_expect(&json!({"complaints": true}), "complaints");
    let (arrays, lost) = (Cell::new(0), Cell::new(0));
    let (mut number, mut untold) = (None, 0);
    let all = async {
        while arrays.get() + lost.get() < sent.get() {
            let Stamped { input, message, .. } = inputs.recv().await.expect("the bridge lives");
            match input {
                Input::Diagnostics(_) => {
                    let next = message.expect("it was one").sequence;
                    let gap = number.replace(next).is_some_and(|before| next > before + 1);
                    arrays.set(arrays.get() + 1);
                    untold += u32::from(lost.get() == 0 && (gap || untold > 0));
                    assert!(untold <= 1, "message {next} came before the first loss was told");
                }
                Input::Writers(_) => {}
                Input::Reception(trouble) if trouble.kind == TroubleKind::Lost => {
                    lost.set(lost.get() + trouble.count);
                }
                other => panic!("{other:?}"),
            }
        }
    };
    // That the last ones are lost shows with those after them.
    let all = until_heard(all, || {
        peer.write(&one("after"));
        sent.set(sent.get() + 1);
    });
    let is_counted = tokio::time::timeout(PATIENCE, all).await.is_ok();
    assert!(is_counted && lost.get() > 0, "{arrays:?} taken, {lost:?} told as lost, {sent:?} sent");
    bridge.shutdown().await;
}

async fn another_type_on_the_topic_is_told_and_never_decoded(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let mut reading = Reading::start(&domain).await;
    let mut wrong = Peer::start(&domain, "pub --type String");
    let trouble = reading.trouble(TroubleKind::WrongType).await;
    assert_eq!(&*trouble.topic, "/diagnostics");
    assert_eq!(
        &*trouble.text,
        "topic has type std_msgs/msg/String, configuration says diagnostic_msgs/msg/DiagnosticArray"
    );
    wrong.write(&json!({"text": "not for us", "times": 3}));
    let mut right = Peer::start(&domain, "pub");
    right.wait_matched(1);
    right.write(&one("right"));
    reading.status("right").await;
    assert!(reading.received.iter().all(|input| !matches!(
        input,
        Input::Reception(ReceptionTrouble { kind: TroubleKind::Malformed, .. })
    )));
    reading.bridge.shutdown().await;
}

async fn a_late_joiner_learns_the_last_value_of_a_signal_but_no_old_event(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let mut active = Peer::start(
        &domain,
        "--durability transient_local --depth 1 pub --topic rt/mission/active --type Bool",
    );
    active.write(&json!({"bool": false}));
    active.write(&json!({"bool": true}));
    let mut goal =
        Peer::start(&domain, "--durability transient_local --depth 1 pub --topic rt/goal --type String");
    goal.write(&json!({"text": "long ago", "age_s": 60}));
    let mut reading = Reading::start(&domain).await;
    reading.signal("active", true).await;
    active.write(&json!({"bool": false}));
    reading.signal("active", false).await;
    // A volatile publisher of the same signal does not match a reader that asks for last values.
    let mut volatile = Peer::start(&domain, "pub --topic rt/mission/active --type Bool");
    volatile.wait_matched(1);
    // It may match the best-effort reader that every topic begins with, which has nothing sent again.
    until_heard(reading.signal("active", true), || volatile.write(&json!({"bool": true}))).await;
    goal.wait_matched(1);
    assert!(
        reading
            .received
            .iter()
            .all(|input| !matches!(input, Input::Signal { name, .. } if &**name == "goal"))
    );
    goal.write(&json!({"text": "now"}));
    reading.signal("goal", true).await;
    reading.received.dedup();
    assert_eq!(reading.received.len(), 4, "{}", summary(&reading.received));
    reading.bridge.shutdown().await;
}

async fn a_new_participant_goes_on_where_the_old_one_ended(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let mut active = Peer::start(
        &domain,
        "--durability transient_local --depth 1 pub --topic rt/mission/active --type Bool",
    );
    active.write(&json!({"bool": true}));
    let mut reading = Reading::start(&domain).await;
    reading.signal("active", true).await;
    for round in 0..2 {
        reading.bridge.rebuild();
        // The engine may have forgotten it meanwhile, and its publisher says nothing new.
        reading.signal("active", true).await;
        let mut peer = Peer::start(&domain, "--durability transient_local pub");
        // Published to the participant that exists: messages that the old one took are not sent again.
        peer.wait_matched(1);
        let name = format!("round {round}");
        peer.write(&one(&name));
        until_heard(reading.status(&name), || peer.write(&one(&name))).await;
    }
    active.write(&json!({"bool": false}));
    reading.signal("active", false).await;
    let signals = reading.received.iter().filter(|input| matches!(input, Input::Signal { .. })).count();
    assert_eq!(signals, 4, "{}", summary(&reading.received));
    reading.bridge.shutdown().await;
}

/// Where the loopback interface has multicast, as others have, Fast DDS speaks to two readers by one address: then it
/// depends on whether it knows that the old participant is gone.
#[test]
fn a_new_participant_goes_on_where_loopback_has_multicast() {
    let root = env!("CARGO_MANIFEST_DIR");
    let name = "a_new_participant_goes_on_where_the_old_one_ended";
    let done = std::process::Command::new("sh")
        .current_dir(root)
        .arg("tests/dds/alone.sh")
        .arg(std::env::current_exe().expect("it runs"))
        .args(["--exact", &format!("dds::cyclone::{name}"), &format!("dds::fast_dds::{name}")])
        .output()
        .expect("there is a shell");
    let said = String::from_utf8_lossy(&done.stdout);
    let errors = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success() && said.contains("2 passed"), "{said}{errors}");
}

async fn what_is_missed_between_two_participants_is_told_as_lost(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let mut peer = Peer::start(&domain, "--reliability best_effort pub");
    let mut reading = Reading::start(&domain).await;
    peer.wait_matched(1);
    peer.write(&one("before"));
    reading.status("before").await;
    reading.bridge.rebuild();
    // The old participant says goodbye: the publisher does not keep its reader for a lease.
    let limit = Limit::start();
    loop {
        peer.write(&one("missed"));
        let readers = peer.tell_and_expect(&json!({"wait_matched": 0}), "matched");
        if limit.holds() && readers["matched"] == 0 {
            break;
        }
    }
    peer.write(&one("missed"));
    peer.wait_matched(1);
    let trouble = until_heard(reading.trouble(TroubleKind::Lost), || peer.write(&one("after"))).await;
    assert_eq!(&*trouble.topic, "/diagnostics");
    reading.bridge.shutdown().await;
}

async fn large_arrays_arrive_from_both_sides(vendor: Vendor) {
    let (_domain, mut reading, mut peer) = Reading::beside_publisher(vendor).await;
    peer.write(&json!({"count": 10_000, "times": 3}));
    for _ in 0..3 {
        assert_eq!(reading.status("/load/node_09999: rate").await.len(), 10_000);
    }
    assert!(reading.troubles().is_empty());
    reading.bridge.shutdown().await;
    drop(peer);

    let domain = Domain::of(vendor);
    let mut foreign = Peer::start(&domain, "sub --topic rt/diagnostics=DiagnosticArray");
    let publisher =
        Publisher::open(&BridgeOptions::loopback(domain.id), &[]).await.expect("the publisher starts");
    let mut array = StatusArray::default();
    for index in 0..10_000 {
        array.push_status(2, &format!("node {index}"), "an odd length of text", "");
    }
    // No event tells when the reader has matched, so it publishes until the reader hears it.
    let stamp = std::time::UNIX_EPOCH + Duration::new(1_700_000_000, 5);
    let mut names = std::collections::BTreeSet::new();
    let mut largest = 0;
    for _ in 0..300 {
        publisher.diagnostics(&array, stamp).await.expect("a reader takes it");
        tokio::time::sleep(Duration::from_millis(100)).await;
        for line in foreign.so_far() {
            assert_eq!(line["value"]["stamp"], json!([1_700_000_000, 5]));
            largest = largest.max(line["bytes"].as_u64().expect("it counts bytes"));
            let statuses = line["value"]["statuses"].as_array().expect("an array");
            names.extend(statuses.iter().map(|status| status["name"].as_str().expect("a name").to_owned()));
        }
        if names.len() == 10_000 {
            break;
        }
    }
    assert_eq!(names.len(), 10_000);
    // Larger than one datagram, so that fragments were put together.
    assert!(largest > 100_000, "{largest}");
    publisher.shutdown().await;
}

async fn published_signals_reach_foreign_late_joiners_and_our_own_bridge(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let options = BridgeOptions::loopback(domain.id);
    let publisher = Publisher::open(&options, &["/mission/active"]).await.expect("the publisher starts");
    publisher.boolean("/mission/active", false).await.expect("nobody holds it back");
    publisher.boolean("mission/active", true).await.expect("nobody holds it back");
    assert!(publisher.boolean("/other", true).await.is_err());
    let mut foreign = Peer::start(&domain, "--durability transient_local sub --topic rt/mission/active=Bool");
    let limit = Limit::start();
    while limit.holds() && foreign.expect("value")["value"]["data"] != json!(true) {}
    let mut reading = Reading::start(&domain).await;
    reading.signal("active", true).await;
    publisher.boolean("/mission/active", false).await.expect("nobody holds it back");
    reading.signal("active", false).await;
    reading.bridge.shutdown().await;
    publisher.shutdown().await;
}

async fn the_node_is_announced_in_the_size_that_the_others_use(vendor: Vendor) {
    const LISTEN: &str =
        "--durability transient_local sub --topic ros_discovery_info=ParticipantEntitiesInfo";
    for (told, theirs, expected) in
        [(Some(GidSize::Bytes24), None, 24), (None, Some(24), 24), (None, Some(16), 16), (None, None, 0)]
    {
        let domain = Domain::of(vendor);
        let mut listener = Peer::start(&domain, LISTEN);
        let options = BridgeOptions { gid_size: told, ..BridgeOptions::loopback(domain.id) };
        let mut reading = Reading::with(options).await;
        let mut other = Peer::start(
            &domain,
            "--durability transient_local pub --topic ros_discovery_info --type ParticipantEntitiesInfo",
        );
        if let Some(size) = theirs {
            other.write(&json!({"info": {"size": size, "name": "other"}}));
        }
        let is_ours = |line: &Value| line["value"]["nodes"][0]["name"] == "telltale";
        if expected == 0 {
            // A message over the same two participants arrives after an announcement would have.
            let mut peer = Peer::start(&domain, "pub");
            peer.wait_matched(1);
            peer.write(&one("a while later"));
            reading.status("a while later").await;
            assert!(!listener.so_far().iter().any(is_ours));
        } else {
            let limit = Limit::start();
            let ours = loop {
                let line = listener.next().expect("our node is announced");
                if limit.holds() && is_ours(&line) {
                    break line;
                }
            };
            assert_eq!(ours["value"]["gid_size"], expected);
            let readers = ours["value"]["nodes"][0]["readers"].as_array().expect("gids");
            assert_eq!(readers.len(), 0, "nobody publishes what it reads");
        }
        reading.bridge.shutdown().await;
    }
}
