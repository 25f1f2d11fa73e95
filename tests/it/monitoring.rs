//! From a foreign publisher to the state and the message of a monitor: the bridge and the engine as `serve`
//! runs them, with all faults of a topic.

use std::time::{Duration, UNIX_EPOCH};

use serde_json::{Value, json};
use telltale::clock::Clock;
use telltale::engine::input::TroubleKind;
use telltale::engine::model::NodeId;
use telltale::engine::state::State::{self, Error, Ok as Good, Unknown, Warning};
use telltale::ros::{self, Bridge, BridgeOptions};
use telltale::runtime::{self, Link};

use crate::by_hand;
use crate::peer::{Domain, PATIENCE, Peer, Vendor};

with_each_peer!(whatever_is_wrong_with_a_message_is_said, a_flood_a_crash_and_another_type_are_said);

const SPEED: &str = "pub --topic rt/speed --type TwistStamped";
const CLOUD: &str =
    "--reliability best_effort pub --topic rt/cloud --type sensor_msgs::msg::dds_::PointCloud2_";
const TF: &str = "pub --topic rt/tf --type tf2_msgs::msg::dds_::TFMessage_";

const CONFIG: &str = "
vehicle: { id: v, name: V, stages: none }
defaults: { timeout: 60s }
groups:
  - id: g
    modules:
      - id: speed
        monitor: { value: { topic: /speed, type: geometry_msgs/msg/TwistStamped, field: twist.linear.x, warning_above: 9, error_above: 12 } }
      - id: rate
        monitor: { frequency: { topic: /speed, type: geometry_msgs/msg/TwistStamped, window: 500ms, error_below: 1, warning_above: 1000 } }
      - id: cloud
        monitor: { latency: { topic: /cloud, type: sensor_msgs/msg/PointCloud2, window: 300ms, warning_above: 10s, error_above: 30s } }
      - id: places
        monitor:
          agreement:
            a: { topic: /tf, type: tf2_msgs/msg/TFMessage, pose: 'transforms[child_frame_id=a].transform' }
            b: { topic: /tf, type: tf2_msgs/msg/TFMessage, pose: 'transforms[child_frame_id=b].transform' }
            translation: { warning_above: 1, error_above: 2 }
            max_age: 60s
";

/// The bridge and the engine.
struct Watching {
    bridge: Bridge,
    link: Link,
    clock: Clock,
}

impl Watching {
    async fn start(domain: &Domain) -> Watching {
        let model = by_hand::model(CONFIG);
        let clock = Clock::start();
        let link = runtime::start(model.clone(), clock);
        let options = BridgeOptions::loopback(domain.id);
        let bridge = ros::start(options, &model, link.inputs.clone(), clock).await;
        Watching { bridge: bridge.expect("the bridge starts"), link, clock }
    }

    /// What a module of the one group shows, and the words for it.
    fn shown(&self, module: &str) -> (State, String) {
        let snapshot = self.link.snapshots.borrow().snapshot.clone();
        let Some(NodeId::Module(id)) = snapshot.node(&format!("g/{module}")) else { panic!("no {module}") };
        let view = snapshot.module(id).1;
        (view.state, view.report.message.to_string())
    }

    async fn shows(&mut self, module: &str, state: State, words: &str) {
        let fits = async {
            loop {
                let (shown, said) = self.shown(module);
                if shown == state && said.contains(words) {
                    return;
                }
                self.link.snapshots.changed().await.expect("the engine lives");
            }
        };
        if tokio::time::timeout(PATIENCE, fits).await.is_err() {
            panic!("{module} shows {:?}, not {state:?} and {words:?}", self.shown(module));
        }
    }

    /// Waits until a fault in the reception of a topic was reported.
    async fn tells(&mut self, topic: &str, kind: TroubleKind) {
        let told = self.link.snapshots.wait_for(|published| {
            let mut reception = published.snapshot.reception.iter();
            reception.any(|it| &*it.topic == topic && it.kind == kind)
        });
        let told = tokio::time::timeout(PATIENCE, told).await;
        assert!(told.is_ok_and(|told| told.is_ok()), "no {kind:?} on {topic}");
    }

    /// Publishes again and again, as every sensor does, until a module shows this.
    async fn shows_for(&mut self, peer: &mut Peer, command: &str, (module, state, words): Shows) {
        let again = async {
            loop {
                peer.tell_raw(command);
                peer.expect("written");
                tokio::time::sleep(Duration::from_millis(50)).await;
            }
        };
        tokio::select! {
            () = self.shows(module, state, words) => {}
            () = again => unreachable!("it goes on for ever"),
        }
    }

    /// A header stamped so many seconds from now.
    fn header(&self, seconds: i64) -> Value {
        let now = self.clock.wall().duration_since(UNIX_EPOCH).expect("it is after 1970");
        let now = i64::try_from(now.as_secs()).expect("it fits");
        json!({"stamp": {"sec": now + seconds, "nanosec": 0}, "frame_id": "f"})
    }
}

/// A module, its state and a part of its words.
type Shows = (&'static str, State, &'static str);

fn speed(mps: &str) -> String {
    format!(r#"{{"message": "TwistStamped", "fields": {{"twist": {{"linear": {{"x": {mps}}}}}}}}}"#)
}

/// Two frames, `a` and `b`, by a coordinate and the scalar part of their rotation.
fn frames(a: (&str, &str), b: (&str, &str)) -> String {
    let [a, b] = [("a", a), ("b", b)].map(|(name, (x, w))| {
        format!(
            r#"{{"child_frame_id": "{name}", "transform": {{"translation": {{"x": {x}}}, "rotation": {{"w": {w}}}}}}}"#
        )
    });
    format!(r#"{{"message": "TFMessage", "fields": {{"transforms": [{a}, {b}]}}}}"#)
}

/// A `TwistStamped` of 3.5 m/s with this encapsulation, frame and words in big endian.
fn big_endian(encapsulation: &str, frame_length: &str) -> String {
    let zeros = "0".repeat(80);
    let body = format!("{}{frame_length}00000000400c000000000000{zeros}", "0".repeat(16));
    json!({"raw": format!("{encapsulation}{body}")}).to_string()
}

async fn whatever_is_wrong_with_a_message_is_said(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let mut watching = Watching::start(&domain).await;
    // The depth is what ROS 2 has by default.
    let speeds = format!("--depth 10 {SPEED}");
    let mut peers = [&speeds, CLOUD, TF].map(|arguments| Peer::start(&domain, arguments));
    peers.iter_mut().for_each(|peer| peer.wait_matched(1));
    let [speeds, clouds, tf] = &mut peers;

    let lie = json!({"raw": format!("00010000{}ffffffff{}", "0".repeat(16), "0".repeat(104))}).to_string();
    let bad_text = format!("00010000{}03000000ff800000{}", "0".repeat(16), "0".repeat(96));
    let cut = json!({"message": "TwistStamped", "cut": 24}).to_string();
    // Each shows something else than the one before it.
    let mut cases = vec![
        (speed("3.5"), ("speed", Good, "3.5")),
        (speed("NaN"), ("speed", Unknown, "/speed twist.linear.x is not a number")),
        (speed("9.5"), ("speed", Warning, "9.5 m/s, at most 9 m/s wanted")),
        (speed("Infinity"), ("speed", Unknown, "is infinite")),
        (speed("13"), ("speed", Error, "13")),
        (speed("-Infinity"), ("speed", Unknown, "is infinite")),
        (lie, ("speed", Unknown, "cannot be read")),
        (speed("1e300"), ("speed", Error, "")),
        (cut, ("speed", Unknown, "cannot be read")),
        // Text that is not UTF-8 in another field does not affect the number.
        (json!({"raw": bad_text}).to_string(), ("speed", Good, "0 m/s, at most 9 m/s wanted")),
    ];
    // Cyclone writes the encapsulation itself, and something after it.
    if matches!(vendor, Vendor::FastDds) {
        cases.extend([
            (big_endian("00000000", "00000001"), ("speed", Good, "3.5")),
            (big_endian("00000000", "7fffffff"), ("speed", Unknown, "cannot be read")),
            (speed("3"), ("speed", Good, "3")),
            (big_endian("00070000", "00000001"), ("speed", Unknown, "cannot be read")),
            (speed("3"), ("speed", Good, "3")),
            (json!({"raw": "00010000"}).to_string(), ("speed", Unknown, "cannot be read")),
            (speed("3"), ("speed", Good, "3")),
            (json!({"raw": "0001"}).to_string(), ("speed", Unknown, "cannot be read")),
        ]);
    }
    for (command, shows) in cases {
        watching.shows_for(speeds, &command, shows).await;
    }
    watching.tells("/speed", TroubleKind::Malformed).await;
    if matches!(vendor, Vendor::FastDds) {
        // The library waits for an empty sample until the publisher no longer keeps it.
        speeds.write(&json!({"raw": ""}));
        watching.shows_for(speeds, &speed("4"), ("speed", Good, "4")).await;
        watching.tells("/speed", TroubleKind::Lost).await;
    }

    let points = |header: Value| json!({"message": "PointCloud2", "fields": {"header": header, "width": 5000, "data": {"zeros": 5000}}});
    for (header, state, words) in [
        (watching.header(0), Good, "s late"),
        (watching.header(60), Unknown, "in the future: set the clocks"),
        (watching.header(-20), Warning, "at most 10 s wanted"),
        (watching.header(-40), Error, "at most 10 s wanted"),
        (watching.header(-1_000_000), Unknown, "from another clock"),
        (json!({}), Unknown, "the stamp was not set"),
        (json!({"stamp": {"sec": -2_000_000_000}}), Unknown, "from another clock"),
        (watching.header(0), Good, "s late"),
    ] {
        watching.shows_for(clouds, &points(header).to_string(), ("cloud", state, words)).await;
    }

    for (a, b, state, words) in [
        (("0", "1"), ("0.5", "1"), Good, "0.5 m"),
        (("0", "1"), ("NaN", "1"), Unknown, "is not a number"),
        (("0", "1"), ("3", "1"), Error, "3 m"),
        (("Infinity", "1"), ("0", "1"), Unknown, "is infinite"),
        (("0", "NaN"), ("0", "1"), Unknown, "is not a number"),
        (("0", "0"), ("0", "1"), Unknown, "a rotation of length zero"),
    ] {
        watching.shows_for(tf, &frames(a, b), ("places", state, words)).await;
    }
    watching.bridge.shutdown().await;
}

async fn a_flood_a_crash_and_another_type_are_said(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let mut watching = Watching::start(&domain).await;
    let mut peer = Peer::start(&domain, &format!("--lease-s 2 {SPEED}"));
    watching.shows_for(&mut peer, &speed("3"), ("speed", Good, "3")).await;
    let flood = json!({"message": "TwistStamped", "times": 10_000});
    watching.shows_for(&mut peer, &flood.to_string(), ("rate", Warning, "Hz, 1 to 1000 Hz wanted")).await;
    watching.shows("rate", Error, "0 Hz, 1 to 1000 Hz wanted").await;
    // It is gone without a goodbye.
    peer.kill();
    watching.shows("speed", Unknown, "nobody publishes /speed").await;
    watching.shows("rate", Error, "0 Hz, 1 to 1000 Hz wanted; nobody publishes /speed").await;
    let mut other = Peer::start(&domain, "pub --topic rt/speed --type String");
    let words = "/speed has type std_msgs/msg/String, configuration says geometry_msgs/msg/TwistStamped";
    watching.shows("speed", Unknown, words).await;
    watching.shows("rate", Error, words).await;
    other.write(&json!({"text": "not for us"}));
    let mut again = Peer::start(&domain, SPEED);
    watching.shows_for(&mut again, &speed("3"), ("speed", Good, "3")).await;
    watching.bridge.shutdown().await;
}
