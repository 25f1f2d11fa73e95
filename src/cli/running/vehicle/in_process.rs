//! The bridge to DDS between a simulated machine and an engine in one process: what is read of each message, and what
//! the machine is told.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::SystemTime;

use super::machine::Machine;
use crate::clock::unix_ns;
use crate::config::Loaded;
use crate::engine::Engine;
use crate::engine::input::Input;
use crate::engine::model::monitors::{ProbeTarget, TopicSpec, WatchdogSpec};
use crate::engine::model::sample::{Pose, Probe, PublisherReport, Sample};
use crate::engine::model::{Limits, Model};
use crate::engine::time::Timestamp;
use crate::msg::cdr::Endian;
use crate::msg::fields::{BooleanReader, Definitions, Reader};
use crate::msg::messages::{GidSize, NodeEntities, diagnostic_array, encode_nodes};
use crate::ros::publish::outputs::VehicleMessage;
use crate::ros::{DIAGNOSTICS, Nodes};
use crate::sim::machine::Order;

const WHOLE: &str = "the simulation's messages are as the configuration expects them";

/// An engine that knows of a publisher of each topic, and its ears.
///
/// # Panics
/// If a topic of the configuration has a field that its type has not.
pub fn listening(loaded: &Loaded, start: Timestamp) -> (Engine, Ears) {
    let mut engine = Engine::new(loaded.model.clone(), start);
    know_publishers(&mut engine, &loaded.model, start);
    (engine, Ears::of(loaded, start))
}

pub fn know_publishers(engine: &mut Engine, model: &Model, now: Timestamp) {
    for news in publishers(model) {
        engine.handle(&news, now);
    }
}

/// The news that each topic has a publisher.
pub fn publishers(model: &Model) -> impl Iterator<Item = Input> + '_ {
    let news = |source| PublisherReport {
        source,
        publishers: 1,
        other_type: None,
        transient_local: false,
        best_effort: false,
        anew: false,
    };
    model.watched.topics.iter().cloned().map(move |source| Input::Topic(news(source)))
}

/// The bridge's part: what is read of each topic.
pub struct Ears {
    watched: BTreeMap<Box<str>, (Arc<TopicSpec>, Reader)>,
    /// `None`: each message is an event.
    signals: Vec<(Box<str>, Box<str>, Option<BooleanReader>)>,
    nodes: Nodes,
    start: Timestamp,
    watchdogs: Vec<Arc<WatchdogSpec>>,
}

impl Ears {
    /// # Panics
    /// If a topic of the configuration has a field that its type has not.
    pub fn of(loaded: &Loaded, start: Timestamp) -> Ears {
        let definitions = Definitions::default();
        let watched = loaded.model.watched.topics.iter().map(|spec| {
            let reader = definitions.check(spec).unwrap_or_else(|error| panic!("{}: {error}", spec.topic));
            (spec.topic.clone(), (spec.clone(), reader))
        });
        let fields = loaded.model.signals.iter().filter_map(|signal| Some((signal, signal.source.field()?)));
        let signals = fields.map(|(signal, source)| {
            let level = signal.present_for.is_none();
            let reader = level.then(|| definitions.boolean(&source.type_name, &source.field).expect(WHOLE));
            (source.topic.clone(), signal.name.clone(), reader)
        });
        Ears {
            watched: watched.collect(),
            signals: signals.collect(),
            nodes: Nodes::new(start),
            start,
            watchdogs: loaded.model.watched.watchdogs.clone(),
        }
    }

    /// What a diagnosis hears of a machine until now; `wall` is the wall time of an instant.
    pub fn hear(
        &mut self,
        machine: &mut Machine,
        now: Timestamp,
        wall: impl Fn(Timestamp) -> SystemTime,
    ) -> Vec<Input> {
        let received = wall(now);
        let sent = machine.advance(now, wall);
        let mut inputs: Vec<Input> =
            sent.iter().flat_map(|(topic, body)| self.inputs(topic, body, received)).collect();
        inputs.extend(self.probes(machine.nodes(), now));
        inputs
    }

    /// The answers to watchdogs that are due, where these nodes are announced.
    pub fn probes(&mut self, nodes: Vec<&'static str>, now: Timestamp) -> Vec<Input> {
        let passed_ns = now.since(self.start).as_nanos();
        let due: Vec<_> =
            self.watchdogs.iter().filter(|it| passed_ns.is_multiple_of(it.every.as_nanos())).collect();
        if due.is_empty() {
            return Vec::new();
        }
        let named = |name| NodeEntities { name, ..NodeEntities::default() };
        let body = encode_nodes([1; 16], &nodes.into_iter().map(named).collect::<Vec<_>>(), GidSize::Bytes16);
        self.nodes.announce([1; 16], &body, Endian::Little, None);
        let answer = |source: &Arc<WatchdogSpec>| {
            let ProbeTarget::Node { name } = &source.target else { return None };
            let outcome = self.nodes.ask(name, now);
            Some(Input::Probe(Probe { source: source.clone(), outcome }))
        };
        due.into_iter().filter_map(answer).collect()
    }

    pub fn inputs(&self, topic: &str, body: &[u8], received: SystemTime) -> Vec<Input> {
        if topic == DIAGNOSTICS {
            let (array, fault) = diagnostic_array(body, Endian::Little, &Limits::default());
            assert_eq!(fault, None);
            return vec![Input::Diagnostics(array)];
        }
        let mut inputs = Vec::new();
        for (of, name, reader) in &self.signals {
            if **of == *topic {
                let value =
                    reader.as_ref().is_none_or(|reader| reader.read(body, Endian::Little).expect(WHOLE));
                inputs.push(Input::Signal { name: name.clone(), value });
            }
        }
        if let Some((source, reader)) = self.watched.get(topic) {
            let reading = reader.read(body, Endian::Little);
            assert_eq!(reading.fault, None, "{topic}");
            let received_wall_ns = unix_ns(received) as i64;
            let sample = Sample {
                stamp_ns: reading.stamp_ns,
                received_wall_ns,
                ..Sample::of(source.clone(), reading.values)
            };
            inputs.push(Input::Sample(sample));
        }
        inputs
    }
}

/// What a machine understands of a message to the vehicle.
pub fn order(said: VehicleMessage) -> Option<Order> {
    Some(match said {
        VehicleMessage::Deceleration(mps2) => Order::Decelerate(mps2),
        VehicleMessage::ManeuverStop(on) => Order::Stop(on),
        VehicleMessage::Hold(on) => Order::Hold(on),
        VehicleMessage::Clearance(on) => Order::Clear(on),
        VehicleMessage::Stage(_) => return None,
        VehicleMessage::Pose(_, pose) => {
            let (qz, qw) = (pose.yaw_deg.to_radians() / 2.0).sin_cos();
            Order::Localize(Pose { x_m: pose.x_m, y_m: pose.y_m, qz, qw, ..Pose::default() })
        }
    })
}
