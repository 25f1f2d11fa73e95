//! Fields that monitors watch, over DDS: topics of any type from foreign peers, encoded by the types of
//! Eclipse Cyclone DDS; and watchdogs.

use std::sync::Arc;

use serde_json::{Value, json};
use telltale::clock::Clock;
use telltale::engine::input::{Input, TroubleKind};
use telltale::engine::model::monitors::{
    FieldKind, FieldSpec, ProbeTarget, TopicSpec, WatchdogSpec, Watched,
};
use telltale::engine::model::sample::{FieldValue, Pose, ProbeOutcome, PublisherReport, Sample, Transform};
use telltale::engine::model::{Model, Parts, StageModel};
use telltale::engine::time::Span;
use telltale::msg::messages::encode;
use telltale::ros::{self, Bridge, BridgeOptions, Publisher, Quality};
use telltale::runtime::Stamped;
use tokio::sync::mpsc;

use crate::peer::{Domain, Limit, PATIENCE, Peer, Vendor};

const ODOMETRY: &str = "pub --topic rt/odometry --type nav_msgs::msg::dds_::Odometry_";
const CLOUD: &str =
    "--reliability best_effort pub --topic rt/cloud --type sensor_msgs::msg::dds_::PointCloud2_";
const TF: &str = "pub --topic rt/tf --type tf2_msgs::msg::dds_::TFMessage_";
const TF_STATIC: &str =
    "--durability transient_local --depth 1 pub --topic rt/tf_static --type tf2_msgs::msg::dds_::TFMessage_";
const POSE: &str = "--durability transient_local --depth 1 pub --topic rt/pose --type geometry_msgs::msg::dds_::PoseStamped_";

fn topic(name: &str, type_name: &str, stamp: bool, fields: &[(&str, FieldKind)]) -> TopicSpec {
    let field = |(path, kind): &(&str, FieldKind)| FieldSpec::new(*path, *kind);
    TopicSpec {
        topic: name.into(),
        type_name: type_name.into(),
        stamp,
        fields: fields.iter().map(field).collect(),
    }
}

fn model(topics: Vec<TopicSpec>, targets: Vec<ProbeTarget>) -> Model {
    let every = Span::from_millis(200);
    watching(topics, targets.into_iter().map(|target| WatchdogSpec { target, every }).collect())
}

fn watching(topics: Vec<TopicSpec>, watchdogs: Vec<WatchdogSpec>) -> Model {
    let watchdogs = watchdogs.into_iter().map(Arc::new).collect();
    let parts = Parts {
        watched: Watched {
            topics: topics.into_iter().map(Arc::new).collect(),
            watchdogs,
            ..Watched::default()
        },
        ..Parts::empty("test", StageModel::None)
    };
    Model::new(parts).expect("nothing depends on anything")
}

pub struct Watching {
    pub bridge: Bridge,
    inputs: mpsc::Receiver<Stamped>,
}

impl Watching {
    pub async fn start(domain: &Domain, model: &Model) -> Watching {
        let (sender, inputs) = mpsc::channel(1024);
        let options = BridgeOptions::loopback(domain.id);
        let bridge = ros::start(options, model, sender, Clock::start()).await.expect("the bridge starts");
        Watching { bridge, inputs }
    }

    /// Receives until an input fits.
    pub async fn until<T>(&mut self, what: &str, mut fits: impl FnMut(&Input) -> Option<T>) -> T {
        let mut last = Vec::new();
        let found = async {
            loop {
                let input = self.inputs.recv().await.expect("the bridge lives").input;
                if let Some(found) = fits(&input) {
                    return found;
                }
                last.push(format!("{input:?}"));
            }
        };
        let found = tokio::time::timeout(PATIENCE, found).await;
        found.unwrap_or_else(|_| panic!("no {what}; received: {last:#?}"))
    }

    pub async fn sample(&mut self, topic: &str) -> Sample {
        self.until(topic, |input| match input {
            Input::Sample(sample) if *sample.source.topic == *topic => Some(sample.clone()),
            _ => None,
        })
        .await
    }

    async fn news(&mut self, topic: &str, publishers: u32) -> PublisherReport {
        self.until(&format!("{publishers} publishers of {topic}"), |input| match input {
            Input::Topic(news) if *news.source.topic == *topic && news.publishers == publishers => {
                Some(news.clone())
            }
            _ => None,
        })
        .await
    }
}

fn number(value: f64) -> FieldValue {
    FieldValue::Number(value)
}

fn stamped(frame_id: &str) -> Value {
    json!({"stamp": {"sec": 1_700_000_000, "nanosec": 5}, "frame_id": frame_id})
}

const STAMP_NS: Option<i64> = Some(1_700_000_000_000_000_005);

with_each_peer!(
    fields_of_foreign_messages_arrive_right,
    the_transforms_of_a_frame_arrive_also_those_sent_once_before_our_start,
    hostile_bodies_are_unreadable_and_counted_and_a_publisher_that_leaves_is_noticed,
    another_configuration_learns_the_last_value_and_who_publishes,
    a_node_is_there_until_it_is_announced_no_longer,
    a_service_is_there_while_somebody_serves_it,
    a_lifecycle_node_says_its_state_before_any_transition,
    each_watchdog_of_a_lifecycle_node_hears_its_own_replies_and_the_worst_of_two_nodes_counts,
);

async fn fields_of_foreign_messages_arrive_right(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let (scalar, pose) = (FieldKind::Scalar, FieldKind::Pose);
    let odometry = [("twist.twist.linear.x", scalar), ("pose", pose), ("twist.covariance[35]", scalar)];
    let cloud =
        [("width", scalar), ("fields[name=y].offset", scalar), ("data.length", scalar), ("is_dense", scalar)];
    let tf =
        [("transforms[child_frame_id=base_link].transform.translation.x", scalar), ("transforms[5]", pose)];
    let model = model(
        vec![
            topic("/odometry", "nav_msgs/msg/Odometry", true, &odometry),
            topic("/cloud", "sensor_msgs/msg/PointCloud2", true, &cloud),
            topic("/tf", "tf2_msgs/msg/TFMessage", false, &tf),
        ],
        Vec::new(),
    );
    let mut watching = Watching::start(&domain, &model).await;
    let mut peers = [ODOMETRY, CLOUD, TF].map(|arguments| Peer::start(&domain, arguments));
    peers.iter_mut().for_each(|peer| {
        peer.wait_matched(1);
    });
    let [odometry, cloud, tf] = &mut peers;

    odometry.write(&json!({"message": "Odometry", "fields": {
        "header": stamped("map"), "child_frame_id": "base_link",
        "pose": {"pose": {"position": {"x": 1.5, "y": -2.5, "z": 3.0}, "orientation": {"w": 1.0}}},
        "twist": {"twist": {"linear": {"x": 4.25}}, "covariance": [0.5]},
    }}));
    let sample = watching.sample("/odometry").await;
    let at = Pose { x_m: 1.5, y_m: -2.5, z_m: 3.0, qw: 1.0, ..Pose::default() };
    assert_eq!(&*sample.values, [number(4.25), FieldValue::Pose(at), number(0.0)]);
    assert_eq!(sample.stamp_ns, STAMP_NS);
    assert!(sample.received_wall_ns > 1_700_000_000_000_000_005);

    // Best effort: lost messages are published again.
    let points = json!({"message": "PointCloud2", "fields": {
        "header": stamped("lidar"), "height": 1, "width": 5000, "point_step": 12, "row_step": 60_000,
        "fields": [{"name": "x", "datatype": 7, "count": 1}, {"name": "y", "offset": 4, "datatype": 7, "count": 1}],
        "data": {"zeros": 60_000}, "is_dense": true,
    }});
    let again = async {
        loop {
            cloud.write(&points);
            tokio::time::sleep(std::time::Duration::from_millis(200)).await;
        }
    };
    let sample = tokio::select! {
        sample = watching.sample("/cloud") => sample,
        () = again => unreachable!("it goes on for ever"),
    };
    assert_eq!(&*sample.values, [number(5000.0), number(4.0), number(60_000.0), FieldValue::Bool(true)]);
    assert_eq!(sample.stamp_ns, STAMP_NS);

    // Another broadcaster sends frames of its own.
    let mut other = Peer::start(&domain, TF);
    other.wait_matched(1);
    other.write(&json!({"message": "TFMessage", "fields": {"transforms": [{"child_frame_id": "wheel"}]}}));
    let sample = watching.sample("/tf").await;
    assert_eq!(sample.values[0], FieldValue::Absent);
    tf.write(&json!({"message": "TFMessage", "fields": {"transforms": [
        {"child_frame_id": "odom"}, {"child_frame_id": "base_link", "transform": {"translation": {"x": 8.0}}},
    ]}}));
    let sample = watching.sample("/tf").await;
    assert_eq!(sample.values[0], number(8.0));
    assert!(
        matches!(&sample.values[1], FieldValue::Unreadable(why) if why.contains("there are 2")),
        "{sample:?}"
    );
    watching.bridge.shutdown().await;
}

async fn the_transforms_of_a_frame_arrive_also_those_sent_once_before_our_start(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let of = |name: &str| TopicSpec {
        fields: vec![FieldSpec::transforms_of("base_link")],
        ..topic(name, "tf2_msgs/msg/TFMessage", false, &[])
    };
    let message = |frames: &[(&str, &str)]| {
        let transform =
            |(parent, child): &(&str, &str)| json!({"header": stamped(parent), "child_frame_id": child});
        json!({"message": "TFMessage", "fields": {"transforms": frames.iter().map(transform).collect::<Value>()}})
    };
    let found = |parents: &[&str]| {
        let transform = |parent: &&str| Transform { parent: (*parent).into(), stamp_ns: STAMP_NS };
        FieldValue::Transforms(parents.iter().map(transform).collect())
    };
    let mut fixed = Peer::start(&domain, TF_STATIC);
    // Within 50 ms of our start it might be one of now: clocks differ.
    let mut long_ago = message(&[("base_link", "lidar"), ("footprint", "base_link")]);
    long_ago["age_s"] = json!(60);
    fixed.write(&long_ago);
    let mut watching = Watching::start(&domain, &model(vec![of("/tf"), of("/tf_static")], Vec::new())).await;
    let sample = watching.sample("/tf_static").await;
    assert_eq!((&*sample.values, sample.late), (&[found(&["footprint"])][..], true));
    let mut tf = Peer::start(&domain, TF);
    tf.wait_matched(1);
    tf.write(&message(&[("map", "odom")]));
    assert_eq!(&*watching.sample("/tf").await.values, [FieldValue::Absent]);
    tf.write(&message(&[("map", "odom"), ("odom", "base_link"), ("ekf", "base_link")]));
    assert_eq!(&*watching.sample("/tf").await.values, [found(&["odom", "ekf"])]);
    watching.bridge.shutdown().await;
}

async fn hostile_bodies_are_unreadable_and_counted_and_a_publisher_that_leaves_is_noticed(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let fields = [("twist.twist.linear.x", FieldKind::Scalar), ("child_frame_id", FieldKind::Scalar)];
    let model = model(vec![topic("/odometry", "nav_msgs/msg/Odometry", true, &fields)], Vec::new());
    let mut watching = Watching::start(&domain, &model).await;
    let mut peer = Peer::start(&domain, ODOMETRY);
    peer.wait_matched(1);
    assert_eq!(watching.news("/odometry", 1).await.other_type, None);
    let body = json!({"message": "Odometry", "fields": {"child_frame_id": "base_link"}});
    for hostile in [
        json!({"raw": "0001000001"}),
        json!({"raw": "0001000000000000000000000000000000ffffffffffff"}),
        json!({"message": "Odometry", "cut": 100}),
    ] {
        peer.write(&hostile);
        let sample = watching.sample("/odometry").await;
        assert!(matches!(sample.values[0], FieldValue::Unreadable(_)), "{hostile}: {sample:?}");
    }
    watching
        .until("trouble", |input| match input {
            Input::Reception(trouble) if trouble.kind == TroubleKind::Malformed => Some(()),
            _ => None,
        })
        .await;
    peer.write(&body);
    let sample = watching.sample("/odometry").await;
    assert_eq!(&*sample.values, [number(0.0), FieldValue::Text("base_link".into())]);
    peer.end();
    watching.news("/odometry", 0).await;
    let mut other = Peer::start(&domain, "pub --topic rt/odometry --type String");
    let news = watching.news("/odometry", 0).await;
    assert_eq!(news.other_type.as_deref(), Some("std_msgs/msg/String"));
    other.write(&json!({"text": "not for us"}));
    watching.bridge.shutdown().await;
}

async fn another_configuration_learns_the_last_value_and_who_publishes(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let mut peer = Peer::start(&domain, POSE);
    peer.write(&json!({"message": "PoseStamped", "fields": {"pose": {"position": {"x": 7.0}}}, "age_s": 60}));
    let counted = || topic("/pose", "geometry_msgs/msg/PoseStamped", false, &[]);
    let first = model(vec![counted()], Vec::new());
    let mut watching = Watching::start(&domain, &first).await;
    watching.news("/pose", 1).await;
    peer.wait_matched(1);

    let fields = [("pose.position.x", FieldKind::Scalar)];
    let read = topic("/pose", "geometry_msgs/msg/PoseStamped", false, &fields);
    let second = model(vec![read, topic("/other", "my_msgs/msg/Unknown", false, &[])], Vec::new());
    watching.bridge.follow(&second).expect("it can be read");
    let news = watching.news("/pose", 1).await;
    assert!(Arc::ptr_eq(&news.source, &second.watched.topics[0]));
    // A topic whose messages are only counted has no history; of a value, the last one is read.
    let sample = watching.sample("/pose").await;
    assert!(Arc::ptr_eq(&sample.source, &second.watched.topics[0]));
    assert_eq!(&*sample.values, [number(7.0)]);
    watching.news("/other", 0).await;

    let mut wrong = model(vec![counted()], Vec::new());
    watching.bridge.follow(&wrong).expect("it can be read");
    assert!(Arc::ptr_eq(&watching.news("/pose", 1).await.source, &wrong.watched.topics[0]));
    peer.write(&json!({"message": "PoseStamped"}));
    assert!(watching.sample("/pose").await.values.is_empty());
    wrong = model(
        vec![topic("/pose", "geometry_msgs/msg/PoseStamped", false, &[("x", FieldKind::Scalar)])],
        Vec::new(),
    );
    assert!(watching.bridge.follow(&wrong).is_err());
    watching.bridge.shutdown().await;
}

/// A probe whose outcome is as wanted.
fn outcome(wanted: fn(&ProbeOutcome) -> bool) -> impl FnMut(&Input) -> Option<()> {
    move |input| match input {
        Input::Probe(probe) if wanted(&probe.outcome) => Some(()),
        _ => None,
    }
}

async fn a_node_is_there_until_it_is_announced_no_longer(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let node = ProbeTarget::Node { name: "/camera".into() };
    let model = model(Vec::new(), vec![node]);
    let mut watching = Watching::start(&domain, &model).await;
    watching.until("patience", outcome(|it| matches!(it, ProbeOutcome::Impossible(_)))).await;
    let info = "--lease-s 60 --durability transient_local pub --topic ros_discovery_info --type ParticipantEntitiesInfo";
    let mut peer = Peer::start(&domain, info);
    peer.write(&json!({"info": {"size": 16, "name": "camera"}}));
    watching.until("the node", outcome(|it| matches!(it, ProbeOutcome::Announced))).await;
    peer.write(&json!({"info": {"size": 16}}));
    watching.until("its end", outcome(|it| matches!(it, ProbeOutcome::Missed(_)))).await;
    peer.write(&json!({"info": {"size": 16, "name": "camera"}}));
    watching.until("the node", outcome(|it| matches!(it, ProbeOutcome::Announced))).await;
    peer.end();
    watching.until("its end", outcome(|it| matches!(it, ProbeOutcome::Missed(_)))).await;
    // One that crashes counts until its leases end, so it is seen that it was started again.
    let [mut crashed, mut again] = [(); 2].map(|()| Peer::start(&domain, info));
    crashed.write(&json!({"info": {"size": 16, "name": "camera"}}));
    watching.until("the node", outcome(|it| matches!(it, ProbeOutcome::Announced))).await;
    crashed.kill();
    again.write(&json!({"info": {"size": 16, "name": "camera"}}));
    let repeated = outcome(|it| matches!(it, ProbeOutcome::Repeated { times: 2 }));
    watching.until("its restart", repeated).await;
    again.end();
    watching.until("the one that crashed", outcome(|it| matches!(it, ProbeOutcome::Announced))).await;
    watching.bridge.shutdown().await;
}

async fn a_service_is_there_while_somebody_serves_it(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let model = model(Vec::new(), vec![ProbeTarget::Service { name: "/map/get".into() }]);
    let mut watching = Watching::start(&domain, &model).await;
    // A client writes requests too.
    let request = "--topic rq/map/getRequest --type std_srvs::srv::dds_::Trigger_Request_";
    let client = Peer::start(&domain, &format!("pub {request}"));
    watching.until("patience", outcome(|it| matches!(it, ProbeOutcome::Impossible(_)))).await;
    watching.until("nobody", outcome(|it| matches!(it, ProbeOutcome::Missed(_)))).await;
    let server = Peer::start(&domain, "serve --service /map/get");
    watching.until("the service", outcome(|it| matches!(it, ProbeOutcome::Announced))).await;
    server.end();
    watching.until("its end", outcome(|it| matches!(it, ProbeOutcome::Missed(_)))).await;
    client.end();
    watching.bridge.shutdown().await;
}

async fn a_lifecycle_node_says_its_state_before_any_transition(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let model = model(Vec::new(), vec![ProbeTarget::Lifecycle { name: "/planner_server".into() }]);
    let mut watching = Watching::start(&domain, &model).await;
    let inactive =
        |it: &ProbeOutcome| matches!(it, ProbeOutcome::Inactive { state } if &**state == "inactive");
    let is_silent = |it: &ProbeOutcome| matches!(it, ProbeOutcome::Missed(why) if why.contains("no answer"));
    watching.until("nobody", outcome(|it| matches!(it, ProbeOutcome::Missed(_)))).await;
    let serve = "serve --service /planner_server/get_state --type lifecycle_msgs::srv::dds_::GetState";
    let mut server = Peer::start(&domain, serve);
    watching.until("no answer", outcome(is_silent)).await;
    server.tell_and_expect(&json!({"state": 2, "label": "inactive"}), "told");
    watching.until("its state", outcome(inactive)).await;
    server.tell_and_expect(&json!({"state": 3, "label": "active"}), "told");
    watching.until("its work", outcome(|it| matches!(it, ProbeOutcome::Answered { .. }))).await;
    server.tell_and_expect(&json!({}), "told");
    watching.until("a node that hangs", outcome(is_silent)).await;
    server.tell_and_expect(&json!({"state": 3, "label": "active"}), "told");
    watching.until("its answer", outcome(|it| matches!(it, ProbeOutcome::Answered { .. }))).await;
    server.kill();
    watching.until("its end", outcome(|it| matches!(it, ProbeOutcome::Missed(_)))).await;
    // It was started again, and waits to be configured.
    let mut again = Peer::start(&domain, serve);
    again.tell_and_expect(&json!({"state": 1, "label": "unconfigured"}), "told");
    let unconfigured =
        |it: &ProbeOutcome| matches!(it, ProbeOutcome::Inactive { state } if &**state == "unconfigured");
    watching.until("its state", outcome(unconfigured)).await;
    again.end();
    watching.bridge.shutdown().await;
}

async fn each_watchdog_of_a_lifecycle_node_hears_its_own_replies_and_the_worst_of_two_nodes_counts(
    vendor: Vendor,
) {
    let domain = Domain::of(vendor);
    let target = || ProbeTarget::Lifecycle { name: "/planner_server".into() };
    let [often, seldom] =
        [100, 700].map(|ms| WatchdogSpec { target: target(), every: Span::from_millis(ms) });
    let mut watching = Watching::start(&domain, &watching(Vec::new(), vec![often, seldom.clone()])).await;
    let serve = "serve --service /planner_server/get_state --type lifecycle_msgs::srv::dds_::GetState";
    let mut server = Peer::start(&domain, serve);
    // Another tool only listens to the calls.
    let calls = "rq/planner_server/get_stateRequest=lifecycle_msgs::srv::dds_::GetState_Request_";
    let dds = if matches!(vendor, Vendor::Cyclone) { "fastdds" } else { "cyclone" };
    let listener = Peer::start(&domain, &format!("--dds {dds} sub --topic {calls}"));
    server.tell_and_expect(&json!({"state": 3, "label": "active"}), "told");
    let told = |input: &Input| match input {
        Input::Probe(probe) if *probe.source == seldom => Some(probe.outcome.clone()),
        _ => None,
    };
    let is_active = |it: &ProbeOutcome| matches!(it, ProbeOutcome::Answered { .. });
    for _ in 0..5 {
        watching.until("its work", |input| told(input).filter(is_active)).await;
    }
    server.tell_and_expect(&json!({"state": 2, "label": "inactive"}), "told");
    // One call may be under way.
    watching.until("a call", told).await;
    let is_inactive = |it: &ProbeOutcome| matches!(it, ProbeOutcome::Inactive { .. });
    let next = watching.until("the next call", told).await;
    assert!(is_inactive(&next), "{next:?}");
    // Launched twice: the one that works hides no other.
    let mut twice = Peer::start(&domain, serve);
    twice.tell_and_expect(&json!({"state": 3, "label": "active"}), "told");
    for _ in 0..6 {
        let next = watching.until("the next call", told).await;
        assert!(!is_active(&next), "{next:?}");
    }
    for peer in [server, twice, listener] {
        peer.kill();
    }
    watching.bridge.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn our_own_publisher_offers_any_type_in_every_quality() {
    let domain = Domain::take();
    let fields = [("packets.length", FieldKind::Scalar)];
    let names = ["/reliable", "/best_effort", "/last_value"];
    let topics = names.map(|name| topic(name, encode::VELODYNE_SCAN, true, &fields));
    let mut watching = Watching::start(&domain, &model(topics.to_vec(), Vec::new())).await;
    let options = BridgeOptions::loopback(domain.id);
    let mut publisher = Publisher::open(&options, &[]).await.expect("the publisher starts");
    assert!(publisher.offer("/x", "no type", Quality::Reliable).is_err());
    assert!(publisher.publish("/reliable", Vec::new()).await.is_err(), "it is not offered yet");
    for (name, quality) in names.into_iter().zip([Quality::Reliable, Quality::BestEffort, Quality::LastValue])
    {
        publisher.offer(name, encode::VELODYNE_SCAN, quality).expect("the topic is offered");
    }
    for name in names {
        let again = async {
            loop {
                let stamp = std::time::UNIX_EPOCH + std::time::Duration::new(1_700_000_000, 5);
                let scan = encode::velodyne_scan(encode::Header { stamp, frame_id: "velodyne" }, 76);
                publisher.publish(name, scan).await.expect("nobody holds it back");
                tokio::time::sleep(std::time::Duration::from_millis(100)).await;
            }
        };
        // The first one, of a publisher that keeps its last value, may be from before our time.
        let limit = Limit::start();
        let of_now = async {
            loop {
                let sample = watching.sample(name).await;
                if limit.holds() && !sample.late {
                    return sample;
                }
            }
        };
        let sample = tokio::select! {
            sample = of_now => sample,
            () = again => unreachable!("it goes on for ever"),
        };
        assert_eq!((&*sample.values, sample.stamp_ns), (&[number(76.0)][..], STAMP_NS), "{name}");
    }
    watching.bridge.shutdown().await;
    publisher.shutdown().await;
}
