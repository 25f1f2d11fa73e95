//! Telltale in the ROS 2 graph, beside other programs that publish the same topics.

use std::time::Duration;

use serde_json::Value;
use telltale::engine::input::Input;

use crate::driving::Published;
use crate::peer::{Domain, Limit, PATIENCE, Peer, Vendor};

with_each_peer!(
    what_is_published_belongs_to_a_node_that_its_participant_announces,
    another_aggregator_is_told_of_and_left_alone_until_it_is_gone,
    of_two_telltales_one_publishes,
    another_program_that_speaks_to_the_vehicle_is_told_of_until_it_is_gone,
);

async fn what_is_published_belongs_to_a_node_that_its_participant_announces(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let mut listener = Peer::start(
        &domain,
        "--durability transient_local sub --topic ros_discovery_info=ParticipantEntitiesInfo",
    );
    let published = Published::start(&domain).await;
    let limit = Limit::start();
    let ours = loop {
        let line = listener.next().expect("our node is announced");
        if limit.holds() && line["value"]["nodes"][0]["name"] == "telltale_outputs" {
            break line["value"].clone();
        }
    };
    let prefix = &ours["gid"].as_str().expect("hexadecimal digits")[..24];
    let writers = ours["nodes"][0]["writers"].as_array().expect("gids");
    assert_eq!(writers.len(), 9, "one for each topic");
    assert!(writers.iter().all(|gid| gid.as_str().is_some_and(|gid| gid.starts_with(prefix))), "{ours}");

    // The page of topics names the node, too.
    let mut discovery = published.bridge.discovery();
    let named = discovery.wait_for(|seen| {
        let clearance = seen.topics.iter().find(|topic| topic.name == "/telltale/clearance");
        let publisher = clearance.and_then(|topic| topic.publishers.first());
        publisher.is_some_and(|it| it.ours && it.node.as_deref() == Some("/telltale_outputs"))
    });
    tokio::time::timeout(PATIENCE, named).await.expect("in time").expect("the bridge lives");
    let both = discovery.wait_for(|seen| seen.nodes == ["/telltale", "/telltale_outputs"]);
    tokio::time::timeout(PATIENCE, both).await.expect("in time").expect("the bridge lives");
    published.outputs.shutdown().await;
    published.bridge.shutdown().await;
}

/// What the engine is told next of other aggregators.
async fn told(published: &mut Published) -> Option<Box<str>> {
    let told = async {
        loop {
            if let Input::Aggregator { other } = published.news.recv().await.expect("it lives").input {
                return other;
            }
        }
    };
    tokio::time::timeout(PATIENCE, told).await.expect("the engine is told in time")
}

/// The next word to the engine about other programs that speak to the vehicle.
async fn told_of_voices(published: &mut Published) -> Option<Box<str>> {
    let told = async {
        loop {
            if let Input::Voices { other } = published.news.recv().await.expect("it lives").input {
                return other;
            }
        }
    };
    tokio::time::timeout(PATIENCE, told).await.expect("the engine is told in time")
}

async fn another_program_that_speaks_to_the_vehicle_is_told_of_until_it_is_gone(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let mut published = Published::start(&domain).await;
    assert_eq!(told_of_voices(&mut published).await, None);
    let durable = "--durability transient_local pub --type Bool --topic";
    for topic in ["/telltale/hold", "/telltale/maneuver_stop_request", "/telltale/clearance"] {
        let other = Peer::start(&domain, &format!("{durable} rt{topic}"));
        let words = told_of_voices(&mut published).await.expect("who it is");
        assert!(words.starts_with(&format!("{topic} by participant ")), "{words}");
        other.end();
        assert_eq!(told_of_voices(&mut published).await, None);
    }
    // Another Telltale with data of its own is named, and each tells of the other.
    let mut second = Published::start(&domain).await;
    let limit = Limit::start();
    for each in [&mut published, &mut second] {
        let words = loop {
            assert!(limit.holds());
            let words = told_of_voices(each).await.unwrap_or_default();
            if ["hold", "maneuver_stop_request", "deceleration_request", "clearance"]
                .iter()
                .all(|topic| words.contains(&format!("/telltale/{topic} by ")))
            {
                break words;
            }
        };
        assert!(!words.contains("/telltale/stage"), "{words}");
    }
    for published in [published, second] {
        published.outputs.shutdown().await;
        published.bridge.shutdown().await;
    }
}

/// The trees that come in a while.
async fn trees(listener: &mut Peer, seconds: u64) -> Vec<Value> {
    listener.so_far();
    tokio::time::sleep(Duration::from_secs(seconds)).await;
    listener.so_far()
}

async fn another_aggregator_is_told_of_and_left_alone_until_it_is_gone(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let mut published = Published::start(&domain).await;
    assert_eq!(told(&mut published).await, None);
    let mut listener = Peer::start(&domain, "sub --topic rt/diagnostics_agg=DiagnosticArray");
    listener.expect("value");
    let other = Peer::start(&domain, "pub --topic rt/diagnostics_agg");
    let words = told(&mut published).await.expect("who it is");
    assert!(words.starts_with("/diagnostics_agg by participant "), "{words}");
    // One may have been under way; otherwise three would have come.
    let heard = trees(&mut listener, 3).await;
    assert!(heard.len() <= 1, "{} in three seconds", heard.len());
    // Another topic of the same name and another type is not an aggregator.
    let stranger = Peer::start(&domain, "pub --topic rt/diagnostics_agg --type String");
    other.end();
    assert_eq!(told(&mut published).await, None);
    listener.expect("value");
    drop(stranger);
    published.outputs.shutdown().await;
    published.bridge.shutdown().await;
}

async fn of_two_telltales_one_publishes(vendor: Vendor) {
    let domain = Domain::of(vendor);
    let (mut first, mut second) = (Published::start(&domain).await, Published::start(&domain).await);
    let mut listener = Peer::start(&domain, "sub --topic rt/diagnostics_agg=DiagnosticArray");
    let limit = Limit::start();
    while limit.holds() && told(&mut first).await.is_none() {}
    while limit.holds() && told(&mut second).await.is_none() {}
    listener.expect("value");
    let heard = trees(&mut listener, 4).await.len();
    assert!((2..=6).contains(&heard), "{heard} in four seconds, at one a second");
    for published in [first, second] {
        published.outputs.shutdown().await;
        published.bridge.shutdown().await;
    }
}
