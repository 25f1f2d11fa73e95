//! Each input comes with the message from which it was made, for recordings.

use std::sync::Arc;
use std::time::Duration;

use serde_json::json;
use telltale::clock::Clock;
use telltale::engine::input::Input;
use telltale::msg::cdr::Endian;
use telltale::msg::messages;
use telltale::msg::received::{Message, Stamped};
use telltale::ros::{self, BridgeOptions};
use tokio::sync::mpsc;

use crate::by_hand;
use crate::dds::one;
use crate::peer::{Domain, PATIENCE, Peer};

const CONFIG: &str = "
vehicle: { stages: none }
signals: { lit: { topic: /lamp, type: std_msgs/msg/Bool } }
groups: [{ id: g, modules: [{ id: rate, monitor: { frequency: { topic: /lamp, type: std_msgs/msg/Bool, error_below: 1 } } }] }]
";

async fn next(inputs: &mut mpsc::Receiver<Stamped>) -> (Input, Arc<Message>) {
    let message = async {
        loop {
            let stamped = inputs.recv().await.expect("the bridge lives");
            if let Some(message) = stamped.message {
                return (stamped.input, message);
            }
        }
    };
    tokio::time::timeout(PATIENCE, message).await.expect("a message comes")
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_message_goes_with_its_inputs_as_it_was_received() {
    let domain = Domain::take();
    let model = by_hand::model(CONFIG);
    let (sender, mut inputs) = mpsc::channel(64);
    let bridge = ros::start(BridgeOptions::loopback(domain.id), &model, sender, Clock::start())
        .await
        .expect("the bridge starts");
    let mut status = Peer::start(&domain, "pub");
    status.wait_matched(1);
    let clock = Clock::start();
    let began = clock.wall();
    status.write(&one("first"));
    status.write(&json!({ "statuses": [{ "name": "cut" }], "cut": 20 }));
    let (input, first) = next(&mut inputs).await;
    let Ok((body, Endian::Little)) = &first.body else { panic!("{first:?}") };
    let (array, fault) = messages::diagnostic_array(body, Endian::Little, &model.limits);
    assert_eq!(
        (input, fault),
        (Input::Diagnostics(array.said_by(telltale::engine::input::WriterId(first.writer))), None)
    );
    assert_eq!((&*first.topic, &*first.type_name), ("/diagnostics", messages::DIAGNOSTIC_ARRAY));
    let late = Duration::from_secs(1);
    assert!(first.source.is_some_and(|source| source + late > began), "{:?}", first.source);
    assert!(first.received + late > began);
    // A message without a meaning comes too, in its place.
    let (input, second) = next(&mut inputs).await;
    assert_eq!((input, second.sequence, second.len()), (Input::Tick, first.sequence + 1, 16));
    assert_eq!(second.writer, first.writer);
    // There is one message, however many inputs use it.
    let mut lamp = Peer::start(&domain, "pub --topic rt/lamp --type Bool");
    lamp.wait_matched(1);
    lamp.write(&json!({ "bool": true }));
    let (signal, of_signal) = next(&mut inputs).await;
    let (sample, of_sample) = next(&mut inputs).await;
    assert_eq!(signal, Input::Signal { name: "lit".into(), value: true });
    assert!(matches!(sample, Input::Sample(_)), "{sample:?}");
    assert!(Arc::ptr_eq(&of_signal, &of_sample));
    bridge.shutdown().await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn topics_that_are_only_recorded_come_with_ticks_and_no_more_often_than_asked() {
    let domain = Domain::take();
    let topics = "recording: { topics: [{ topic: /camera/front, every: 1h }, { topic: '/camera/*' }] }\n";
    let text = format!("{CONFIG}{topics}");
    let model = by_hand::model(&text);
    let (sender, mut inputs) = mpsc::channel(64);
    let bridge = ros::start(BridgeOptions::loopback(domain.id), &model, sender, Clock::start())
        .await
        .expect("the bridge starts");
    let mut front = Peer::start(&domain, "pub --topic rt/camera/front --type Bool");
    let mut other = Peer::start(&domain, "pub --topic rt/lidar --type Bool");
    let mut rear = Peer::start(&domain, "pub --topic rt/camera/rear --type Bool");
    front.wait_matched(1);
    rear.wait_matched(1);
    for _ in 0..3 {
        front.write(&json!({ "bool": true }));
    }
    let (input, first) = next(&mut inputs).await;
    assert_eq!(
        (input, &*first.topic, &*first.type_name),
        (Input::Tick, "/camera/front", "std_msgs/msg/Bool")
    );
    let bool_of = |message: &Message| message.body.as_ref().ok().map(|(body, _)| body[0] == 1);
    assert_eq!(bool_of(&first), Some(true));
    other.write(&json!({ "bool": true }));
    for value in [false, true] {
        rear.write(&json!({ "bool": value }));
        let (input, message) = next(&mut inputs).await;
        assert_eq!((input, &*message.topic), (Input::Tick, "/camera/rear"));
        assert_eq!(bool_of(&message), Some(value));
    }
    // Another configuration records nothing of it.
    let model = by_hand::model(CONFIG);
    bridge.follow(&model).expect("it can be read");
    rear.wait_matched(0);
    bridge.shutdown().await;
}
