//! `telltale init`: what is concluded from observations, and from a foreign robot over DDS.

use std::path::Path;
use std::process::Output;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use serde_json::{Value, json};
use telltale::clock::Clock;
use telltale::engine::Engine;
use telltale::engine::discovery::{Discovery, Endpoint, TopicSeen};
use telltale::engine::input::{Input, NodeOf, StatusArray, WriterId, WriterList};
use telltale::engine::model::monitors::TopicSpec;
use telltale::engine::model::sample::Sample;
use telltale::engine::state::State;
use telltale::engine::time::{Span, Timestamp};
use telltale::onboarding::init::{self, Observations};
use telltale::ros::{self, BridgeOptions};
use telltale::{config, runtime};

use crate::folder::TestFolder;
use crate::peer::{Domain, PATIENCE, Peer, Vendor};
use crate::program::run;

const SCAN: &str = "sensor_msgs/msg/LaserScan";

fn endpoint(node: &str, type_name: &str) -> Endpoint {
    let node = (!node.is_empty()).then(|| node.to_owned());
    let participant = node.clone().unwrap_or_else(|| "stranger".to_owned());
    Endpoint { participant, node, type_name: type_name.to_owned(), ..Endpoint::default() }
}

fn topic(name: &str, type_name: &str, publishers: &[&str], subscribers: &[&str]) -> TopicSeen {
    let ends = |nodes: &[&str]| nodes.iter().map(|node| endpoint(node, type_name)).collect();
    TopicSeen {
        name: name.to_owned(),
        publishers: ends(publishers),
        subscribers: ends(subscribers),
        ..TopicSeen::default()
    }
}

fn seen(topics: Vec<TopicSeen>, nodes: &[&str]) -> Observations {
    let nodes = nodes.iter().map(|node| (*node).to_owned()).collect();
    let mut seen = Observations::default();
    seen.see(Arc::new(Discovery { topics, nodes, participants: 1, ..Discovery::default() }));
    seen
}

/// Ten seconds of messages of a topic, each so old.
fn messages(seen: &mut Observations, name: &str, period_ms: u64, age_ms: i64) {
    let (topic, type_name) = (name.into(), SCAN.into());
    let source = Arc::new(TopicSpec { topic, type_name, stamp: true, fields: Vec::new() });
    for at_ms in (0..10_000).step_by(period_ms as usize) {
        let received_wall_ns = 1_700_000_000_000_000_000;
        let stamp_ns = Some(received_wall_ns - age_ms * 1_000_000);
        let values = Box::default();
        let sample = Sample { stamp_ns, received_wall_ns, ..Sample::of(source.clone(), values) };
        seen.take(&Input::Sample(sample), Timestamp::from_millis(at_ms));
    }
}

/// Ten seconds of a status, by the writer of this number.
fn status(seen: &mut Observations, name: &str, level: u8, period_ms: u64, writer: u8) {
    for at_ms in (0..10_000).step_by(period_ms as usize) {
        let mut array = StatusArray::default();
        array.push_status(level, name, "", "");
        let array = array.said_by(WriterId([writer; 16]));
        seen.take(&Input::Diagnostics(array), Timestamp::from_millis(at_ms));
    }
}

/// A status that is said every half second between these two seconds.
fn spoken(seen: &mut Observations, name: &str, (from_s, to_s): (u64, u64), writer: u8) {
    for at_ms in (from_s * 1000..=to_s * 1000).step_by(500) {
        let mut array = StatusArray::default();
        array.push_status(0, name, "", "");
        seen.take(&Input::Diagnostics(array.said_by(WriterId([writer; 16]))), Timestamp::from_millis(at_ms));
    }
}

/// Tells whose nodes the writers are.
fn writers(seen: &mut Observations, nodes: &[(u8, &str)]) {
    let named = |(writer, node): &(u8, &str)| (WriterId([*writer; 16]), NodeOf::Named((*node).into()));
    let writers = nodes.iter().map(named).collect();
    let list = WriterList { as_of: Timestamp::ZERO, complete: true, writers };
    seen.take(&Input::Writers(Arc::new(list)), Timestamp::ZERO);
}

/// The text, which has to be a valid configuration, with and without its guesses in force.
fn text(seen: &Observations, accept_guesses: bool) -> String {
    let draft = init::draft(seen, Timestamp::ZERO, Timestamp::ZERO + Span::from_secs(10));
    for text in [init::text(&draft, false), init::text(&draft, true), init::heard_text(&draft)] {
        config::parse("draft", &text).unwrap_or_else(|problems| panic!("{problems}\n{text}"));
    }
    init::text(&draft, accept_guesses)
}

#[track_caller]
fn has(text: &str, lines: &[&str]) {
    for line in lines {
        assert!(text.contains(line), "lacks {line}:\n{text}");
    }
}

/// `check` warns of nothing in it.
#[track_caller]
fn is_sound(text: &str) {
    let loaded = config::parse("draft", text).unwrap_or_else(|problems| panic!("{problems}\n{text}"));
    if let (_, Some(problems)) = loaded.soundness() {
        panic!("{problems}\n{text}");
    }
}

fn small_robot() -> Observations {
    let topics = vec![
        topic("/cmd_vel", "geometry_msgs/msg/Twist", &["/navigation"], &["/base"]),
        topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", &["/lidar", "/base"], &[]),
        topic("/map", "nav_msgs/msg/OccupancyGrid", &["/navigation"], &[]),
        topic("/odom", "nav_msgs/msg/Odometry", &["/base"], &["/navigation", "/localization"]),
        topic("/pose", SCAN, &["/localization"], &["/navigation"]),
        topic("/rosout", "rcl_interfaces/msg/Log", &["/lidar", "/viewer"], &["/viewer"]),
        topic("/scan", SCAN, &["/lidar"], &["/localization", "/viewer"]),
    ];
    let nodes =
        ["/_ros2cli_7", "/base", "/lidar", "/localization", "/navigation", "/telltale_init", "/viewer"];
    let mut seen = seen(topics, &nodes);
    messages(&mut seen, "/scan", 100, 40);
    messages(&mut seen, "/odom", 50, -3_600_000);
    messages(&mut seen, "/pose", 100, 10);
    messages(&mut seen, "/cmd_vel", 100, 10);
    writers(&mut seen, &[(1, "/lidar"), (2, "/base")]);
    status(&mut seen, "lidar: device", 0, 1000, 1);
    status(&mut seen, "motors", 1, 500, 2);
    seen
}

#[test]
fn what_was_heard_is_written_with_its_evidence() {
    let text = text(&small_robot(), false);
    has(
        &text,
        &[
            "  # Of /lidar.\n  - id: lidar\n    name: 'Lidar'\n    match: [{ namespace: 'lidar' }]\n",
            "# OK, 1.0 Hz, longest pause 1.0 s.\n      - { id: device, status: 'lidar: device', timeout: 3s }",
            "# 10.0 Hz, longest pause 0.10 s.\n      - { id: scan_rate, monitor: { frequency: { topic: /scan, \
             type: sensor_msgs/msg/LaserScan, window: 2s, warning_below: 7, error_below: 4 } } }",
            "# At most 40 ms old on arrival.\n      - { id: scan_age, monitor: { latency: { topic: /scan, type: \
             sensor_msgs/msg/LaserScan, warning_above: 200ms, error_above: 400ms } } }",
            "{ id: lidar_runs, monitor: { watchdog: { node: /lidar, every: 1s, misses: 3 } } }",
            // Said by its writer alone: the name of the status tells nothing.
            "- id: base\n",
            "# WARNING, 2.0 Hz, longest pause 0.5 s.\n      # Not proposed, because it would close a circle:\n      #   \
             navigation: /base subscribes to /cmd_vel",
            "      - { id: motors, status: 'motors', timeout: 2s }",
            "/odom (nav_msgs/msg/Odometry): its stamps are not of this computer's clock",
            "/map (nav_msgs/msg/OccupancyGrid): no message was received.",
            "      # A guess from the graph. If it is right, remove the `#` in front of `depends_on`:\n      \
             #   base: /localization subscribes to /odom, published by /base\n      \
             #   lidar: /localization subscribes to /scan, published by /lidar\n      \
             - id: pose_rate\n        monitor: { frequency: { topic: /pose,",
            "        # depends_on: [base/odom_rate, lidar/scan_rate, lidar/scan_age]\n",
            "#   /viewer\n",
        ],
    );
    for absent in ["_ros2cli", "/telltale", "/rosout", "\n        depends_on", "\n    depends_on"] {
        assert!(!text.contains(absent), "has {absent}:\n{text}");
    }
}

#[test]
fn names_that_come_and_go_are_no_modules_and_are_forgotten() {
    let mut seen = small_robot();
    writers(&mut seen, &[(3, "/worker")]);
    spoken(&mut seen, "worker: job 17", (0, 3), 3);
    spoken(&mut seen, "worker: job 18", (4, 10), 3);
    spoken(&mut seen, "worker: queue", (0, 10), 3);
    // A sensor that fell silent is followed by nothing.
    spoken(&mut seen, "lidar: channel 1", (0, 3), 1);
    spoken(&mut seen, "lidar: channel 2", (0, 10), 1);
    let written = text(&seen, false);
    has(
        &written,
        &[
            "    # Names such as \"worker: job 17\" come and go: 2 were heard, 1 of them fell silent, and others followed.\n    \
             match: [{ regex: 'worker: job [0-9A-Za-z]+', timeout: 2s, forget_after: 60s }, { namespace: 'worker' }]\n",
            "status: 'worker: queue'",
            "status: 'lidar: channel 1'",
            "status: 'lidar: channel 2'",
            "defaults: { timeout: 3s, stale: unknown, forget_after: 1h }",
        ],
    );
    assert!(!written.contains("status: 'worker: job"), "{written}");

    // What is declared stays, and is UNKNOWN.
    let model = config::parse("draft", &written).unwrap_or_else(|problems| panic!("{problems}")).model;
    let mut engine = Engine::new(model, Timestamp::ZERO);
    let mut array = StatusArray::default();
    for name in ["lidar: channel 1", "worker: job 19"] {
        array.push_status(0, name, "", "");
    }
    engine.handle(&Input::Diagnostics(array), Timestamp::from_millis(500));
    let heard = engine.snapshot();
    assert!(heard.node("lidar/channel_1").is_some() && heard.node("worker/worker: job 19").is_some());
    engine.handle(&Input::Tick, Timestamp::from_millis(7_200_000));
    let later = engine.snapshot();
    let lidar = later.node("lidar/channel_1").map(|node| later.shown(node).0);
    assert_eq!((lidar, later.node("worker/worker: job 19")), (Some(State::Unknown), None));
}

#[test]
fn guesses_are_in_force_when_asked_for_and_never_a_circle() {
    let text = text(&small_robot(), true);
    // The base is subscribed to the commands; that one of the two relations stays out which closes the circle.
    has(
        &text,
        &[
            "        depends_on: [base/odom_rate, localization/pose_rate, localization/pose_age]\n",
            "# Not proposed, because it would close a circle:\n      #   navigation: /base subscribes to /cmd_vel",
        ],
    );
    is_sound(&text);
    // What a node tells waits for what it receives; that it runs does not.
    assert!(text.contains("- { id: localization_runs, monitor: "), "{text}");
}

#[test]
fn a_status_of_one_node_hides_no_fault_of_those_that_read_another_topic() {
    let topics = vec![
        topic("/camera_rear/image", SCAN, &["/camera_rear"], &["/detector"]),
        topic("/obstacles", SCAN, &["/detector"], &["/base"]),
        topic("/speed", SCAN, &["/base"], &[]),
    ];
    let nodes = ["/camera_rear", "/detector", "/base"];
    let mut seen = seen(topics, &nodes);
    for name in ["/camera_rear/image", "/obstacles", "/speed"] {
        messages(&mut seen, name, 100, 10);
    }
    writers(&mut seen, &[(1, "/camera_rear"), (2, "/detector"), (3, "/base")]);
    for (writer, name) in (1..).zip(["camera_rear: stream", "detector: pipeline", "base: motors"]) {
        status(&mut seen, name, 0, 500, writer);
    }
    let text = text(&seen, true);
    has(
        &text,
        &[
            "depends_on: [detector/obstacles_rate, detector/obstacles_age]",
            "on: [camera_rear/camera_rear_image_rate",
        ],
    );
    is_sound(&text);
    let model = config::parse("draft", &text).unwrap_or_else(|problems| panic!("{problems}")).model;
    let mut engine = Engine::new(model, Timestamp::ZERO);
    let mut array = StatusArray::default();
    array.push_status(2, "camera_rear: stream", "", "");
    array.push_status(2, "base: motors", "", "");
    engine.handle(&Input::Diagnostics(array), Timestamp::from_millis(500));
    let snapshot = engine.snapshot();
    let shown = |name: &str| snapshot.shown(snapshot.node(name).expect("it is a group")).0;
    assert_eq!((shown("camera_rear"), shown("base")), (State::Error, State::Error), "{text}");
}

#[test]
fn a_group_is_a_namespace_or_else_a_node() {
    let nodes = ["/r1/arm/joint", "/r1/arm/tool", "/r1/lidar"];
    let topics = nodes.map(|node| topic(&format!("{node}/data"), SCAN, &[node], &[])).to_vec();
    let text = text(&seen(topics, &nodes), false);
    has(&text, &["# Of /r1/arm/joint, /r1/arm/tool.\n  - id: arm\n", "# Of /r1/lidar.\n  - id: lidar\n"]);
}

#[test]
fn a_writer_that_reports_for_others_does_not_own_their_statuses() {
    let nodes = ["/collector", "/lidar"];
    let topics = nodes.map(|node| topic(&format!("/{node}/x"), SCAN, &[node], &[])).to_vec();
    let mut seen = seen(topics, &nodes);
    writers(&mut seen, &[(1, "/collector")]);
    for name in ["lidar: device", "battery: charge", "/arm/joint_1"] {
        status(&mut seen, name, 0, 1000, 1);
    }
    let text = text(&seen, false);
    has(
        &text,
        &[
            "- id: lidar\n    name: 'Lidar'\n    match",
            "- id: battery\n    name: 'Battery'\n    match",
            "- id: arm\n    name: 'ARM'\n    match",
            "status: '/arm/joint_1'",
        ],
    );
}

#[test]
fn nothing_heard_and_no_diagnostics_are_said_and_a_file_to_begin_with_is_written() {
    has(&text(&Observations::default(), false), &["Nothing was heard", "match: [{ regex: '(?s).*' }]"]);
    let mut silent = seen(vec![topic("/scan", SCAN, &["/lidar"], &[])], &["/lidar"]);
    messages(&mut silent, "/scan", 100, 10);
    has(&text(&silent, false), &["No status was heard on /diagnostics", "id: scan_rate"]);
}

#[test]
fn hostile_names_make_a_valid_file_and_break_out_of_no_comment() {
    let names = [
        "a: b\ngroups: []",
        "'; {}",
        "\u{1b}[2J: x",
        "日本: 語",
        "日本: 話",
        "other: a",
        "telltale: a",
        ": : :",
        "#",
        "\\",
        "\u{202e}rtl: x",
        "- id: evil",
        "{{ x }}",
        "/",
        "//",
        "%%%: \"",
        "&a *b !c",
        "null",
        "true: x",
        "false: null",
        "12: 5",
    ];
    let nodes = ["/x\n  - id: evil", "/日本", "/ok", "/a b", "/{}: #", "/\u{1b}]0;x", "/null", "/false"];
    let topics = vec![
        topic("/x\n  - id: evil", "a/msg/B\n- c", &nodes, &nodes),
        topic("/y", "pkg/msg/Ty pe", &["/ok"], &nodes),
        topic("/z", "x", &["/a b", ""], &["/ok", ""]),
    ];
    let mut seen = seen(topics, &nodes);
    let named: Vec<(u8, &str)> = (0..).zip(nodes).collect();
    writers(&mut seen, &named);
    for (number, name) in (0..).zip(names) {
        status(&mut seen, name, 0, 1000, number % 6);
    }
    status(&mut seen, "", 0, 1000, 1);
    status(&mut seen, &"n".repeat(300), 0, 1000, 1);
    let text = text(&seen, true);
    assert!(!text.contains('\u{1b}') && !text.contains('\u{202e}'), "{text}");
    // A module may be called so, but no name begins a group.
    assert!(text.lines().all(|line| !line.starts_with("  - id: evil")), "{text}");
    has(&text, &["20 reports are left out"]);
}

#[test]
fn ten_thousand_nodes_are_few_groups() {
    let nodes: Vec<String> = (0..10_000).map(|number| format!("/part{}_n{number}", number % 90)).collect();
    let nodes: Vec<&str> = nodes.iter().map(|node| &**node).collect();
    let topics: Vec<TopicSeen> = nodes
        .iter()
        .take(2000)
        .map(|node| topic(&format!("{node}/x"), SCAN, &[node], &["/part1_n1"]))
        .collect();
    let mut seen = seen(topics, &nodes);
    for number in 0..6000 {
        status(&mut seen, &format!("part{}_n{number}: s", number % 90), 0, 5000, 1);
    }
    let text = text(&seen, true);
    let groups = text.lines().filter(|line| line.starts_with("  - id: ")).count();
    assert!((1..=64).contains(&groups), "{groups}");
    assert!(text.len() < 1 << 20, "{}", text.len());
    has(&text, &["It is a start, not all that was heard", "nodes: whether they run is not watched"]);
}

/// Runs the program against a domain.
pub(super) fn telltale(domain: &Domain, words: &[&str]) -> Output {
    let domain = domain.id.to_string();
    run([words, &["--interface", "loopback", "--domain", &domain]].concat())
}

#[test]
fn a_domain_without_anybody_is_said() {
    let domain = Domain::take();
    let output = telltale(&domain, &["init", "--for", "1s"]);
    let (out, err) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    assert_eq!(output.status.code(), Some(1), "{err}");
    has(&err, &["Nothing was heard", "ROS_DOMAIN_ID", "--interface"]);
    config::parse("out", &out).unwrap_or_else(|problems| panic!("{problems}"));
}

/// Peers that write as fast as a robot does, until they are dropped.
pub(super) struct Robot {
    stop: Arc<AtomicBool>,
    threads: Vec<std::thread::JoinHandle<()>>,
}

impl Robot {
    /// When it returns, each peer runs: on a busy machine they start slowly.
    pub fn start(mut peers: Vec<(Peer, Vec<Value>)>) -> Robot {
        for (peer, commands) in &mut peers {
            commands.iter().for_each(|command| peer.write(command));
        }
        let stop = Arc::new(AtomicBool::new(false));
        let writing = |(mut peer, commands): (Peer, Vec<Value>)| {
            let stop = stop.clone();
            std::thread::spawn(move || {
                while !stop.load(Ordering::Relaxed) {
                    commands.iter().for_each(|command| peer.tell(command));
                    std::thread::sleep(Duration::from_millis(100));
                }
            })
        };
        let threads = peers.into_iter().map(writing).collect();
        Robot { stop, threads }
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_file_of_a_foreign_robot_passes_check_and_shows_it_ok() {
    let mut domain = Domain::of(Vendor::FastDds);
    let good =
        |name: &str| json!({"level": 0, "name": name, "message": "fine", "hardware_id": "", "values": {}});
    let statuses =
        json!({"statuses": [good("gripper: motor"), good("gripper: vacuum"), good("/arm/joint_1")]});
    let announced = json!({"info": {"size": 16, "name": "gripper"}});
    let info = "--durability transient_local pub --topic ros_discovery_info --type ParticipantEntitiesInfo";
    let odometry = "pub --topic rt/base/odom --type nav_msgs::msg::dds_::Odometry_";
    let mut peers = vec![
        (Peer::start(&domain, "pub"), vec![statuses]),
        (Peer::start(&domain, odometry), vec![json!({"message": "Odometry", "fields": {}})]),
    ];
    domain.vendor = Vendor::Cyclone;
    peers.push((Peer::start(&domain, info), vec![announced]));
    // So much that a participant which keeps 256 messages of each topic would have to be replaced.
    let cloud = json!({"raw": format!("00010000{}", "00".repeat(1_500_000)), "times": 3});
    let clouds = "pub --topic rt/points --type sensor_msgs::msg::dds_::PointCloud2_";
    peers.push((Peer::start(&domain, clouds), vec![cloud]));
    peers.push((Peer::start(&domain, "pub --topic rt/e_stop --type Bool"), vec![json!({"bool": false})]));
    // Nobody has asked for anything yet.
    let goals = "--durability transient_local pub --topic rt/go/_action/status --type action_msgs::msg::dds_::GoalStatusArray_";
    peers.push((Peer::start(&domain, goals), Vec::new()));
    let robot = Robot::start(peers);
    let folder = TestFolder::new("first-configuration");
    std::fs::create_dir_all(&*folder).expect("a folder can be made");
    let file = folder.join("robot.yaml");
    let wanted = [
        "- id: gripper\n",
        "status: 'gripper: vacuum'",
        "status: '/arm/joint_1'",
        "node: /gripper",
        "topic: /base/odom, type: nav_msgs/msg/Odometry",
        "frequency: { topic: /e_stop, type: std_msgs/msg/Bool",
        "value: { topic: /e_stop, type: std_msgs/msg/Bool, field: data, error_unless: false }",
        "- { id: go_goal, monitor: { value: { topic: /go/_action/status,",
        "topic: /points, type: sensor_msgs/msg/PointCloud2",
    ];
    // On a busy machine it hears too little in a short time.
    for time in ["6s", "15s", "60s"] {
        let words = ["init", "--for", time, "-o", file.to_str().expect("it is text")];
        let output = telltale(&domain, &words);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let again = telltale(&domain, &words);
        let err = String::from_utf8_lossy(&again.stderr);
        assert!(again.status.code() == Some(2) && err.contains("is not overwritten"), "{err}");
        let written = std::fs::read_to_string(&file).expect("it was written");
        if wanted.iter().all(|part| written.contains(part)) || time == "60s" {
            break;
        }
        std::fs::remove_file(&file).expect("it is there");
    }
    let written = std::fs::read_to_string(&file).expect("it was written");
    has(&written, &wanted);
    let checked = run([Path::new("check"), &file]);
    assert!(checked.status.success(), "{}", String::from_utf8_lossy(&checked.stderr));

    let model = config::load(&file).unwrap_or_else(|problems| panic!("{problems}")).model;
    let clock = Clock::start();
    let mut link = runtime::start(model.clone(), clock);
    let bridge = ros::start(BridgeOptions::loopback(domain.id), &model, link.inputs.clone(), clock).await;
    let bridge = bridge.expect("the bridge starts");
    let declared = model.modules.len();
    let states = |link: &runtime::Link| {
        let snapshot = link.snapshots.borrow().snapshot.clone();
        let shown = |id| {
            let (info, view) = snapshot.module(id);
            (info.id.to_string(), view.state, view.report.message.to_string())
        };
        let own = |(name, ..): &(String, State, String)| !name.starts_with("telltale/");
        snapshot.module_ids().map(shown).filter(own).collect::<Vec<_>>()
    };
    let fine = async {
        loop {
            let all = states(&link);
            if all.len() >= declared && all.iter().all(|(_, state, _)| *state == State::Ok) {
                return;
            }
            link.snapshots.changed().await.expect("the engine lives");
        }
    };
    let fine = tokio::time::timeout(PATIENCE, fine).await;
    assert!(fine.is_ok(), "not all are OK: {:#?}\n{written}", states(&link));
    bridge.shutdown().await;
    drop(robot);
}
