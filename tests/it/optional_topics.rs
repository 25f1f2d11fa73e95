//! Optional topics of the bridge: further topics of diagnostics, the clock of a simulation, and the QoS of
//! others.

use serde_json::json;
use telltale::config;
use telltale::engine::input::Input;
use telltale::engine::model::monitors::ProbeTarget;
use telltale::engine::model::sample::{ProbeOutcome, Sample};

use crate::dds::one;
use crate::fields::Watching;
use crate::peer::{Domain, Limit, Peer, Vendor};

with_each_peer!(
    several_topics_of_diagnostics_are_read_with_their_prefixes,
    stamps_are_compared_with_the_clock_of_a_simulation,
    publishers_and_subscribers_that_never_match_are_found,
);

async fn watching(domain: &Domain, text: &str) -> Watching {
    let loaded = config::parse("c", text).unwrap_or_else(|problems| panic!("{problems}"));
    Watching::start(domain, &loaded.model).await
}

async fn several_topics_of_diagnostics_are_read_with_their_prefixes(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let text = "groups: [{ id: a, modules: [{ id: m, status: s }] }]\n\
                diagnostics: { topics: [/diagnostics, { topic: /robot1/diagnostics, prefix: 'robot1: ' }] }\n";
    let mut watching = watching(&domain, text).await;
    let mut names = Vec::new();
    for topic in ["rt/robot1/diagnostics", "rt/diagnostics"] {
        let mut peer = Peer::start(&domain, &format!("pub --topic {topic}"));
        peer.wait_matched(1);
        peer.write(&one("lidar"));
        let name = watching.until(topic, |input| match input {
            Input::Diagnostics(array) => Some(array.get(0).name().to_owned()),
            _ => None,
        });
        names.push(name.await);
    }
    assert_eq!(names, ["robot1: lidar", "lidar"]);
    watching.bridge.shutdown().await;
}

async fn stamps_are_compared_with_the_clock_of_a_simulation(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let text = "clock: ros\ngroups: [{ id: a, modules: [{ id: m, monitor: { latency: { topic: /speed, \
                type: geometry_msgs/msg/TwistStamped, error_above: 1s } } }] }]\n";
    let mut watching = watching(&domain, text).await;
    let mut speed =
        Peer::start(&domain, "pub --topic rt/speed --type geometry_msgs::msg::dds_::TwistStamped_");
    speed.wait_matched(1);
    let stamped =
        json!({"message": "TwistStamped", "fields": {"header": {"stamp": {"sec": 6, "nanosec": 5}}}});
    speed.write(&stamped);
    let sample = watching.sample("/speed").await;
    assert_eq!((sample.stamp_ns, sample.received_wall_ns), (Some(6_000_000_005), Sample::NO_CLOCK));

    let mut clock = Peer::start(
        &domain,
        "--reliability best_effort pub --topic rt/clock --type rosgraph_msgs::msg::dds_::Clock_",
    );
    clock.wait_matched(1);
    let limit = Limit::start();
    while limit.holds() {
        clock.write(&json!({"raw": "000100000700000009000000"}));
        speed.write(&stamped);
        let sample = watching.sample("/speed").await;
        if sample.received_wall_ns != Sample::NO_CLOCK {
            assert_eq!((sample.stamp_ns, sample.received_wall_ns), (Some(6_000_000_005), 7_000_000_009));
            break;
        }
    }
    watching.bridge.shutdown().await;
}

async fn publishers_and_subscribers_that_never_match_are_found(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let text =
        "groups: [{ id: a, modules: [{ id: m, monitor: { watchdog: { qos: /camera, every: 200ms } } }] }]\n";
    let mut watching = watching(&domain, text).await;
    let _camera = Peer::start(&domain, "--reliability best_effort pub --topic rt/camera --type String");
    let blind = Peer::start(&domain, "--lease-s 2 sub --topic rt/camera=String");
    let is_ours = |target: &ProbeTarget| *target == ProbeTarget::Qos { topic: "/camera".into() };
    let missed = watching.until("a miss", |input| match input {
        Input::Probe(probe) if is_ours(&probe.source.target) => match &probe.outcome {
            ProbeOutcome::Missed(why) => Some(why.clone()),
            _ => None,
        },
        _ => None,
    });
    let missed = missed.await;
    assert!(missed.contains(") asks for reliability, a program without a node ("), "{missed}");
    drop(blind);
    let answered = watching.until("an answer", |input| match input {
        Input::Probe(probe) => matches!(probe.outcome, ProbeOutcome::Announced).then_some(()),
        _ => None,
    });
    answered.await;
    watching.bridge.shutdown().await;
}
