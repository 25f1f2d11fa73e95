//! Messages to the vehicle, against foreign DDS peers: what Telltale publishes, and how the simulated
//! shuttle reacts.

use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::time::Duration;

use serde_json::{Value, json};
use telltale::clock::Clock;
use telltale::config;
use telltale::engine::Engine;
use telltale::engine::input::{Input, ListenerReport, OperatorAction, Place, StatusArray};
use telltale::engine::model::Stage;
use telltale::engine::model::output::Output;
use telltale::engine::model::sample::Pose;
use telltale::engine::snapshot::Snapshot;
use telltale::engine::time::Timestamp;
use telltale::msg::messages::encode::{self, Header, Motion};
use telltale::msg::messages::{BOOL, GidSize};
use telltale::ros::publish::outputs::{self, Outputs, Snapshots};
use telltale::ros::{self, Bridge, BridgeOptions, Publisher, Quality};
use telltale::runtime::Stamped;
use tokio::sync::{mpsc, watch};

use crate::peer::{Domain, Limit, Peer, Vendor};
use crate::program::telltale;

/// An engine whose snapshots are published, and what the foreign peer hears.
pub struct Published {
    engine: Engine,
    now_ms: u64,
    snapshots: watch::Sender<Arc<Snapshot>>,
    pub outputs: Outputs,
    /// The inputs to the engine.
    pub news: mpsc::Receiver<Stamped>,
    /// It knows who else is there.
    pub bridge: Bridge,
}

impl Published {
    pub async fn start(domain: &Domain) -> Published {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/config/self-diagnosing-shuttle.yaml");
        let text = std::fs::read_to_string(path).expect("it is there")
            + "\ncountermeasures: [{ request: decelerate, mps2: 1.5, when: { groups: [execution], stages: [active] } }, \
               { request: maneuver_stop, when: { groups: [mission], stages: [active] } }]\n";
        let loaded = config::parse("c", &text).unwrap_or_else(|problems| panic!("{problems}"));
        let mut engine = Engine::new(loaded.model.clone(), Timestamp::ZERO);
        let (snapshots, latest) = watch::channel(engine.snapshot());
        let pulse = snapshots.clone();
        // As an idle engine does: an old snapshot is not published.
        tokio::spawn(async move {
            while !pulse.is_closed() {
                tokio::time::sleep(Duration::from_millis(250)).await;
                pulse.send_modify(|_| ());
            }
        });
        let topics = telltale::cli::running::server::outputs::topics(&loaded.publishing);
        let options = BridgeOptions::loopback(domain.id);
        let (inputs, news) = mpsc::channel(64);
        let (clock, heard) = (Clock::start(), inputs.clone());
        let options = BridgeOptions { gid_size: Some(GidSize::Bytes16), ..options };
        let bridge =
            ros::start(options.clone(), &loaded.model, heard, clock).await.expect("DDS is to be had");
        let latest = Snapshots { vehicle: latest.clone(), tools: latest };
        let outputs = outputs::start(options, topics, latest, inputs, bridge.graph(), clock).await;
        Published { engine, now_ms: 0, snapshots, outputs: outputs.expect("DDS is to be had"), news, bridge }
    }

    fn happen(&mut self, input: &Input) {
        self.now_ms += 10;
        self.engine.handle(input, Timestamp::from_millis(self.now_ms));
        self.snapshots.send_replace(self.engine.snapshot());
    }

    pub fn status(&mut self, name: &str, level: u8) {
        let mut array = StatusArray::default();
        array.push_status(level, name, "said so", "");
        self.happen(&Input::Diagnostics(array));
    }

    fn active(&mut self, value: bool) {
        self.happen(&Input::Signal { name: "active".into(), value });
    }
}

/// The next value on a topic that fits.
fn hear(peer: &mut Peer, topic: &str, fits: impl Fn(&Value) -> bool) -> Value {
    let limit = Limit::start();
    loop {
        let line = peer.expect("topic");
        if limit.holds() && line["topic"] == format!("rt{topic}") && fits(&line["value"]) {
            return line["value"].clone();
        }
    }
}

/// What the engine is told next of who listens to requests of a kind.
async fn told(inputs: &mut mpsc::Receiver<Stamped>, of: Output) -> bool {
    let next = async {
        loop {
            match inputs.recv().await.expect("the outputs run").input {
                Input::Listened(ListenerReport { output, heard, .. }) if output == of => return heard,
                _ => {}
            }
        }
    };
    tokio::time::timeout(Duration::from_secs(60), next).await.expect("discovery gets there")
}

with_each_peer!(
    who_listens_is_known_and_hears_what_was_asked_before,
    stage_clearance_pose_and_countermeasures_reach_a_foreign_peer,
    the_aggregated_diagnosis_is_as_the_tools_of_ros_expect_it,
    a_clearance_is_taken_back_at_the_end,
);

async fn who_listens_is_known_and_hears_what_was_asked_before(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let mut published = Published::start(&domain).await;
    assert!(!told(&mut published.news, Output::ManeuverStop).await, "nobody is there");
    published.happen(&Input::Operator(OperatorAction::Login { name: "anna".into() }));
    published.active(true);
    published.happen(&Input::Operator(OperatorAction::RequestStop));
    // This one wants of requests to slow down what is not offered: it hears none of them.
    let both = "rt/telltale/maneuver_stop_request=Bool rt/telltale/deceleration_request=AccelStamped";
    let mut peer = Peer::start(&domain, &format!("--durability transient_local sub --topic {both}"));
    assert!(told(&mut published.news, Output::ManeuverStop).await);
    hear(&mut peer, "/telltale/maneuver_stop_request", |value| value["data"] == true);
    assert!(peer.so_far().iter().all(|line| line["topic"] != "rt/telltale/deceleration_request"));
    let fitting = Peer::start(&domain, "sub --topic rt/telltale/deceleration_request=AccelStamped");
    assert!(told(&mut published.news, Output::Deceleration).await);
    fitting.kill();
    peer.kill();
    assert!(!told(&mut published.news, Output::ManeuverStop).await, "it has gone");
    published.outputs.shutdown().await;
}

async fn stage_clearance_pose_and_countermeasures_reach_a_foreign_peer(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let mut published = Published::start(&domain).await;
    published.happen(&Input::Operator(OperatorAction::Login { name: "anna".into() }));
    // A late joiner gets the levels.
    let levels = "rt/telltale/stage=String rt/telltale/clearance=Bool rt/telltale/maneuver_stop_request=Bool \
                  rt/telltale/hold=Bool";
    let mut late = Peer::start(&domain, &format!("--durability transient_local sub --topic {levels}"));
    hear(&mut late, "/telltale/stage", |value| value["data"] == "localizing");
    let events = "rt/initialpose=PoseWithCovarianceStamped rt/telltale/deceleration_request=AccelStamped";
    let mut peer = Peer::start(&domain, &format!("sub --topic {events}"));
    // A pose is an event: it is sent again until the peer is found.
    let localize = Input::Operator(OperatorAction::Localize { place: Place::Stop("station".into()) });
    let limit = Limit::start();
    let pose = loop {
        assert!(limit.holds());
        published.happen(&localize);
        tokio::time::sleep(Duration::from_millis(100)).await;
        if let Some(line) = peer.so_far().into_iter().find(|line| line.get("topic").is_some()) {
            break line["value"].clone();
        }
    };
    assert_eq!((&pose["frame_id"], &pose["position"]), (&json!("map"), &json!([148.2, 61.0, 0.0])));

    published.active(true);
    hear(&mut late, "/telltale/stage", |value| value["data"] == "active");
    published.status("mission: route", 2);
    hear(&mut late, "/telltale/hold", |value| value["data"] == true);
    hear(&mut late, "/telltale/maneuver_stop_request", |value| value["data"] == true);
    assert!(peer.so_far().iter().all(|line| line["topic"] != "rt/telltale/deceleration_request"));
    published.status("execution: brake", 2);
    let stamps: Vec<f64> = (0..21)
        .map(|_| hear(&mut peer, "/telltale/deceleration_request", |value| value["linear"][0] == -1.5))
        .map(|request| seconds(&request))
        .collect();
    // The median: a busy machine holds a few of them up.
    let mut gaps: Vec<f64> = stamps.windows(2).map(|pair| pair[1] - pair[0]).collect();
    gaps.sort_by(f64::total_cmp);
    let every_s = gaps[gaps.len() / 2];
    assert!((0.045..0.065).contains(&every_s), "{every_s}");
    // It is repeated, and ends with a release alone.
    hear(&mut late, "/telltale/hold", |value| value["data"] == true);
    let mut released = (*published.engine.snapshot()).clone();
    (released.hold, released.countermeasures) = (Some(false), Arc::default());
    published.snapshots.send_replace(Arc::new(released));
    hear(&mut late, "/telltale/hold", |value| value["data"] == false);
    published.outputs.shutdown().await;
}

async fn the_aggregated_diagnosis_is_as_the_tools_of_ros_expect_it(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let mut published = Published::start(&domain).await;
    let topics = "rt/diagnostics_agg=DiagnosticArray rt/diagnostics_toplevel_state=DiagnosticStatus";
    let mut peer = Peer::start(&domain, &format!("sub --topic {topics}"));
    published.active(true);
    published.status("localization: scan_matching", 2);
    published.status("/a/strange: name", 1);
    let tree = hear(&mut peer, "/diagnostics_agg", |value| value["statuses"][0]["level"] == 2);
    let statuses = tree["statuses"].as_array().expect("an array");
    let find = |name: &str| {
        let found = statuses.iter().find(|status| status["name"] == name);
        found.unwrap_or_else(|| panic!("no {name} in {tree:#}"))
    };
    let position = |name: &str| statuses.iter().position(|status| status["name"] == name);
    let group = find("/Shuttle 1/Localization");
    assert_eq!((&group["level"], &group["message"]), (&json!(2), &json!("Error")));
    assert!(group["values"].as_array().expect("values").contains(&json!(["scan_matching", "Error"])));
    let module = find("/Shuttle 1/Localization/scan_matching");
    assert_eq!((&module["level"], &module["message"]), (&json!(2), &json!("said so")));
    assert!(position("/Shuttle 1/Localization") < position("/Shuttle 1/Localization/scan_matching"));
    let masked = find("/Shuttle 1/Perception");
    assert_eq!(masked["level"], 0);
    assert_eq!(masked["message"], "Ignored: waits for localization/scan_matching");
    assert!(masked["values"].as_array().expect("values").contains(&json!(["telltale_state", "ignore"])));
    // Never heard: UNKNOWN, which is STALE there.
    assert_eq!(find("/Shuttle 1/Sensors/LiDAR units/front")["level"], 3);
    assert!(
        statuses
            .iter()
            .any(|status| status["name"].as_str().unwrap_or_default().ends_with("/a strange: name"))
    );
    let top = hear(&mut peer, "/diagnostics_toplevel_state", |value| value["level"] == 2);
    assert_eq!(top["name"], "toplevel_state");
    published.outputs.shutdown().await;
}

async fn a_clearance_is_taken_back_at_the_end(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let mut published = Published::start(&domain).await;
    let mut peer =
        Peer::start(&domain, "--durability transient_local sub --topic rt/telltale/clearance=Bool");
    hear(&mut peer, "/telltale/clearance", |value| value["data"] == false);
    let mut cleared = (*published.engine.snapshot()).clone();
    (cleared.clearance, cleared.stage) = (true, Stage::Cleared);
    published.snapshots.send_replace(Arc::new(cleared));
    hear(&mut peer, "/telltale/clearance", |value| value["data"] == true);
    published.outputs.shutdown().await;
    hear(&mut peer, "/telltale/clearance", |value| value["data"] == false);
}

/// `telltale sim`, or another process, which ends with this.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended by itself; then the test has failed.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Running {
    fn start(domain: &Domain) -> Running {
        let config = concat!(env!("CARGO_MANIFEST_DIR"), "/config/shuttle.yaml");
        let domain = domain.id.to_string();
        let words = ["sim", "--interface", "127.0.0.1", "--config", config, "--domain", &domain];
        let mut command = telltale(words);
        Running(command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("the program starts"))
    }
}

fn seconds(message: &Value) -> f64 {
    let part = |index: usize| message["stamp"][index].as_f64().expect("a stamp");
    part(0) + part(1) * 1e-9
}

/// A message as `peer.py` writes it: with its encapsulation, in hexadecimal.
fn raw(body: &[u8]) -> Value {
    let digits: String = body.iter().map(|byte| format!("{byte:02x}")).collect();
    json!({ "raw": format!("00010000{digits}") })
}

fn wait_for_speed(peer: &mut Peer, fits: impl Fn(f64) -> bool) {
    hear(peer, "/can/speed", |value| value["linear"][0].as_f64().is_some_and(&fits));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_shuttle_localizes_drives_and_decelerates_as_a_foreign_peer_asks() {
    let domain = Domain::take();
    let _shuttle = Running::start(&domain);
    let topics = "rt/can/speed=TwistStamped rt/mission/active=Bool rt/mission/state=String \
                  rt/vehicle/deceleration_active=Bool rt/vehicle/maneuver_stop_active=Bool";
    let mut listener = Peer::start(&domain, &format!("sub --topic {topics}"));
    let stamped = |frame_id| Header { stamp: std::time::UNIX_EPOCH, frame_id };

    let mut pose = Peer::start(&domain, "pub --topic rt/initialpose --type PoseWithCovarianceStamped");
    pose.wait_matched(1);
    let half = std::f64::consts::FRAC_PI_4;
    let depot = Pose { x_m: 12.5, y_m: 3.0, qz: half.sin(), qw: half.cos(), ..Pose::default() };
    pose.write(&raw(&encode::pose_with_covariance_stamped(stamped("map"), depot, &[0.0; 36])));
    hear(&mut listener, "/mission/state", |value| value["data"] == "waiting");
    let mut clearance =
        Peer::start(&domain, "--durability transient_local pub --topic rt/telltale/clearance --type Bool");
    clearance.wait_matched(1);
    clearance.write(&json!({ "bool": true }));
    hear(&mut listener, "/mission/active", |value| value["data"] == true);
    wait_for_speed(&mut listener, |mps| mps >= 5.0);

    let mut brake = Peer::start(&domain, "pub --topic rt/telltale/deceleration_request --type AccelStamped");
    brake.wait_matched(1);
    let request = |mps2: f64| {
        let backwards = Motion { linear: [-mps2, 0.0, 0.0], ..Motion::default() };
        raw(&encode::accel_stamped(stamped("base_link"), backwards))
    };
    let mut requests = tokio::time::interval(Duration::from_millis(50));
    brake.write(&request(1.0));
    hear(&mut listener, "/vehicle/deceleration_active", |value| value["data"] == true);
    let (mut speeds, mut mps) = (Vec::new(), f64::INFINITY);
    let limit = Limit::start();
    while limit.holds() && mps > 0.0 {
        requests.tick().await;
        brake.write(&request(1.0));
        for line in listener.so_far() {
            if line["topic"] == "rt/can/speed" {
                mps = line["value"]["linear"][0].as_f64().expect("a number");
                speeds.push((seconds(&line["value"]), mps));
            }
        }
    }
    // The median: a busy machine may brake late for a moment.
    let falling: Vec<_> = speeds.iter().filter(|(_, mps)| (0.3..4.7).contains(mps)).collect();
    let slopes =
        falling.windows(26).map(|window| (window[0].1 - window[25].1) / (window[25].0 - window[0].0));
    let mut slopes: Vec<f64> = slopes.collect();
    slopes.sort_by(f64::total_cmp);
    let mps2 = slopes[slopes.len() / 2];
    assert!((mps2 - 1.0).abs() < 0.04, "{mps2} m/s², of {} slopes", slopes.len());

    // Silence is no release.
    let mut hold =
        Peer::start(&domain, "--durability transient_local pub --topic rt/telltale/hold --type Bool");
    hold.wait_matched(1);
    listener.so_far();
    let limit = Limit::start();
    for _ in 0..100 {
        assert!(limit.holds());
        hear(&mut listener, "/can/speed", |value| value["linear"][0].as_f64().is_some_and(|mps| mps < 0.1));
    }
    assert!(
        listener
            .so_far()
            .iter()
            .all(|line| line["topic"] != "rt/vehicle/deceleration_active" || line["value"]["data"] == true)
    );
    hold.write(&json!({ "bool": false }));
    hear(&mut listener, "/vehicle/deceleration_active", |value| value["data"] == false);

    wait_for_speed(&mut listener, |mps| mps >= 1.0);
    let mut stop = Peer::start(
        &domain,
        "--durability transient_local pub --topic rt/telltale/maneuver_stop_request --type Bool",
    );
    stop.wait_matched(1);
    stop.write(&json!({ "bool": true }));
    hear(&mut listener, "/vehicle/maneuver_stop_active", |value| value["data"] == true);
    wait_for_speed(&mut listener, |mps| mps <= 0.0);
    stop.write(&json!({ "bool": false }));
    hold.write(&json!({ "bool": false }));
    hear(&mut listener, "/vehicle/maneuver_stop_active", |value| value["data"] == false);
    wait_for_speed(&mut listener, |mps| mps >= 0.5);
}

/// The library counts all that a writer ever sent against a reader that has not acknowledged anything yet.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_reader_that_acknowledges_nothing_holds_back_no_message_for_the_vehicle() {
    let domain = Domain::of(Vendor::Cyclone);
    let options = BridgeOptions::loopback(domain.id);
    let mut publisher = Publisher::empty(&options).await.expect("DDS is to be had");
    publisher.offer("/held", BOOL, Quality::Reliable).expect("it is a type");
    publisher.offer("/free", BOOL, Quality::Command).expect("it is a type");
    let forger = Command::new(std::env::var("TELLTALE_PEER_PYTHON").expect("tests/run.sh sets it"))
        .args([concat!(env!("CARGO_MANIFEST_DIR"), "/tests/dds/rtps.py"), "silence", "--rate", "12"])
        .args(["--seconds", "600", "--domain", &domain.id.to_string()])
        .stdout(Stdio::null())
        .spawn();
    let _forger = Running(forger.expect("Python starts"));
    let limit = Limit::start();
    // So many are sent that the first one is held back.
    while publisher.publish("/held", encode::boolean(true)).await.is_ok() {
        publisher.publish("/free", encode::boolean(true)).await.expect("nobody holds it back");
        assert!(limit.holds());
    }
    for _ in 0..100 {
        publisher.publish("/free", encode::boolean(true)).await.expect("nobody holds it back");
    }
    publisher.shutdown().await;
}
