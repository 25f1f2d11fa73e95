//! A goal that is not a pose, over DDS, from a foreign publisher to the operator's message.

use std::sync::Arc;

use serde_json::json;
use telltale::clock::Clock;
use telltale::engine::input::{OperatorAction, Response, TroubleKind};
use telltale::engine::model::{FieldSource, Model, NodeId, Parts, SignalSource, SignalSpec, StageModel};
use telltale::engine::snapshot::Snapshot;
use telltale::engine::state::State;
use telltale::engine::time::Span;
use telltale::ros::{self, BridgeOptions};
use telltale::runtime::{self, Command, Published};
use tokio::sync::oneshot;

use crate::peer::{Domain, PATIENCE, Peer};

const GOAL: &str = "pub --topic rt/goal_pose --type geometry_msgs::msg::dds_::PoseStamped_";

fn model() -> Model {
    let source = FieldSource {
        topic: "/goal_pose".into(),
        type_name: "geometry_msgs/msg/PoseStamped".into(),
        field: "data".into(),
    };
    let source = SignalSource::Field(source);
    let present_for = Some(Span::from_secs(3600));
    let goal = SignalSpec { present_for, ..SignalSpec::new("goal", source) };
    let parts = Parts { signals: vec![goal], ..Parts::empty("test", StageModel::Shuttle) };
    Model::new(parts).expect("nothing depends on anything")
}

fn has_goal(snapshot: &Snapshot) -> bool {
    snapshot.signals.iter().any(|(name, value)| &**name == "goal" && *value == Some(true))
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_goal_that_is_no_pose_is_refused_counted_and_told() {
    let domain = Domain::take();
    let (model, clock) = (Arc::new(model()), Clock::start());
    let mut link = runtime::start(model.clone(), clock);
    let (reply, answer) = oneshot::channel();
    let action = OperatorAction::Login { name: "anna".into() };
    link.commands.send(Command { action, last_stop: None, reply }).await.unwrap();
    assert_eq!(answer.await.unwrap(), Response::Done);
    let options = BridgeOptions::loopback(domain.id);
    let bridge = ros::start(options, &model, link.inputs.clone(), clock).await.expect("the bridge starts");
    let mut peer = Peer::start(&domain, GOAL);
    peer.wait_matched(1);
    let pose = |fields: &str| format!(r#"{{"message": "PoseStamped", "fields": {{"pose": {fields}}}}}"#);
    let bad = [
        (json!({"message": "PoseStamped", "cut": 40}).to_string(), "cut at byte"),
        (json!({"raw": "0001000000000000000000000000ffff"}).to_string(), "cut at byte"),
        (pose(r#"{"position": {"y": NaN}, "orientation": {"w": 1}}"#), "refused: position.y is NaN"),
        (pose(r#"{"position": {"x": -Infinity}, "orientation": {"w": 1}}"#), "position.x is -inf"),
        (pose(r#"{"orientation": {"w": 0}}"#), "orientation is no rotation"),
        (pose(r#"{"orientation": {"w": 1, "z": 1}}"#), "orientation is no rotation"),
    ];
    for (told, (command, words)) in (1..).zip(&bad) {
        peer.tell_raw(command);
        peer.expect("written");
        let is_told = |published: &Published| {
            let reception = published.snapshot.reception.iter();
            let mut troubles = reception.filter(|it| it.kind == TroubleKind::Malformed);
            troubles.any(|it| it.count == told && &*it.topic == "/goal_pose" && it.last_text.contains(words))
        };
        let seen = tokio::time::timeout(PATIENCE, link.snapshots.wait_for(is_told)).await;
        let seen = seen.unwrap_or_else(|_| panic!("{command} is not told")).unwrap();
        assert!(!has_goal(&seen.snapshot), "{command}");
        let Some(NodeId::Module(check)) = seen.snapshot.node("telltale/reception") else { panic!("it is") };
        assert_eq!(seen.snapshot.module(check).1.state, State::Warning, "{command}");
    }
    peer.tell_raw(&pose(r#"{"position": {"x": 12.5}, "orientation": {"z": 0.7071, "w": -0.7071}}"#));
    let goal = link.snapshots.wait_for(|published| has_goal(&published.snapshot));
    tokio::time::timeout(PATIENCE, goal).await.expect("a pose is a goal").unwrap();
    bridge.shutdown().await;
}
