//! Topics whose type the configuration leaves out, over DDS: the type is learned from their publishers.

use std::time::Duration;

use telltale::clock::Clock;
use telltale::engine::input::Input;
use telltale::engine::model::sample::FieldValue;
use telltale::msg::messages::encode;
use telltale::ros::{self, BridgeOptions, Publisher, Quality};
use tokio::sync::mpsc;

use crate::by_hand;
use crate::peer::{Domain, PATIENCE};

const TEXT: &str = "
vehicle: { stages: none }
signals: { far: { topic: /distance, when: value > 3 } }
groups: [{ id: g, modules: [{ id: rate, monitor: { frequency: { topic: /scan, error_below: 1 } } }] }]
";

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn what_is_published_says_its_type_and_a_reload_goes_on_with_it() {
    let domain = Domain::take();
    let model = by_hand::model(TEXT);
    let (sender, mut inputs) = mpsc::channel(1024);
    let bridge = ros::start(BridgeOptions::loopback(domain.id), &model, sender, Clock::start());
    let bridge = bridge.await.expect("the bridge starts");
    let mut publisher =
        Publisher::open(&BridgeOptions::loopback(domain.id), &[]).await.expect("the publisher starts");
    publisher.offer("/distance", encode::FLOAT64, Quality::Reliable).expect("it is offered");
    publisher.offer("/scan", encode::VELODYNE_SCAN, Quality::BestEffort).expect("it is offered");
    let publishing = async {
        loop {
            let stamp = Clock::start().wall();
            let scan = encode::velodyne_scan(encode::Header { stamp, frame_id: "velodyne" }, 3);
            publisher.publish("/distance", encode::float64(4.5)).await.expect("nobody holds it back");
            publisher.publish("/scan", scan).await.expect("nobody holds it back");
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    };
    let listening = async {
        for round in 0..2 {
            let (mut distance, mut scan) = (false, false);
            while !(distance && scan) {
                if let Input::Sample(sample) = inputs.recv().await.expect("the bridge lives").input {
                    match &*sample.source.topic {
                        "/distance" => distance = *sample.values == [FieldValue::Number(4.5)],
                        _ => scan = true,
                    }
                }
            }
            if round == 0 {
                bridge.follow(&model).expect("it can be read");
                while inputs.try_recv().is_ok() {}
            }
        }
    };
    let both = async {
        tokio::select! {
            () = listening => {}
            () = publishing => unreachable!("it goes on for ever"),
        }
    };
    tokio::time::timeout(PATIENCE, both).await.expect("both are read, before and after");
    bridge.shutdown().await;
    publisher.shutdown().await;
}
