//! A robot as tests need it: ten seconds of its messages, without a network.

use std::sync::Arc;

use crate::init::{Observations, more_fields};
use crate::live::Heard;
use telltale_engine::discovery::{Discovery, Endpoint, TopicSeen};
use telltale_engine::input::{Input, NodeOf, StatusArray, WriterId, WriterList};
use telltale_engine::model::monitors::TopicSpec;
use telltale_engine::model::sample::{FieldValue, Fingerprint, Sample};
use telltale_engine::time::Timestamp;

const END: Timestamp = Timestamp::from_millis(10_000);
const SCAN: &str = "sensor_msgs/msg/LaserScan";

#[derive(Default)]
pub struct Robot {
    discovery: Discovery,
    seen: Observations,
    writers: WriterList,
}

impl Robot {
    fn endpoint(node: &str, type_name: &str) -> Endpoint {
        let (participant, type_name) = (node.to_owned(), type_name.to_owned());
        Endpoint { participant, node: Some(node.to_owned()), type_name, ..Endpoint::default() }
    }

    fn topic(&mut self, name: &str) -> &mut TopicSeen {
        let topics = &mut self.discovery.topics;
        let place = topics.binary_search_by(|topic| (*topic.name).cmp(name)).unwrap_or_else(|place| {
            topics.insert(place, TopicSeen { name: name.to_owned(), ..TopicSeen::default() });
            place
        });
        &mut topics[place]
    }

    pub fn node(mut self, node: &str) -> Robot {
        if !self.discovery.nodes.iter().any(|known| known == node) {
            self.discovery.nodes.push(node.to_owned());
        }
        self
    }

    /// A node that publishes laser scans, each so often and as old on arrival.
    pub fn publishes(mut self, node: &str, topic: &str, period_ms: u64) -> Robot {
        let endpoint = Robot::endpoint(node, SCAN);
        self.topic(topic).publishers.push(endpoint);
        let (name, type_name) = (topic.into(), SCAN.into());
        let source = Arc::new(TopicSpec { topic: name, type_name, stamp: true, fields: Vec::new() });
        for at_ms in (0..10_000).step_by(period_ms as usize) {
            let received_wall_ns = 1_700_000_000_000_000_000;
            let stamp_ns = Some(received_wall_ns - 20_000_000);
            let values = Box::default();
            let sample = Sample { stamp_ns, received_wall_ns, ..Sample::of(source.clone(), values) };
            self.seen.take(&Input::Sample(sample), Timestamp::from_millis(at_ms));
        }
        self.node(node)
    }

    /// A node that publishes messages with this value so often, beginning with one that was kept for us. `None`: nothing
    /// but that one.
    pub fn tells(
        mut self,
        node: &str,
        (topic, type_name): (&str, &str),
        period_ms: Option<u64>,
        value: Option<FieldValue>,
    ) -> Robot {
        let endpoint = Robot::endpoint(node, type_name);
        self.topic(topic).publishers.push(Endpoint { reliable: true, transient_local: true, ..endpoint });
        let source = Arc::new(TopicSpec {
            topic: topic.into(),
            type_name: type_name.into(),
            stamp: false,
            fields: more_fields(type_name).collect(),
        });
        let later = period_ms.into_iter().flat_map(|period_ms| (0..10_000).step_by(period_ms as usize));
        let all = std::iter::once((0, true)).chain(later.map(|at_ms| (at_ms, false)));
        for (at_ms, late) in all.filter(|_| value.is_some()) {
            let content = FieldValue::Content(Fingerprint(at_ms));
            let sample = Sample {
                late,
                ..Sample::of(source.clone(), std::iter::once(content).chain(value.clone()).collect())
            };
            self.seen.take(&Input::Sample(sample), Timestamp::from_millis(at_ms));
        }
        self.node(node)
    }

    /// The publishers of this topic keep nothing for late readers.
    pub fn volatile(mut self, topic: &str) -> Robot {
        self.topic(topic).publishers.iter_mut().for_each(|it| it.transient_local = false);
        self
    }

    pub fn listens(mut self, node: &str, topic: &str) -> Robot {
        let endpoint = Robot::endpoint(node, SCAN);
        self.topic(topic).subscribers.push(endpoint);
        self.node(node)
    }

    pub fn serves(mut self, node: &str, service: &str) -> Robot {
        self.discovery.services.push(service.to_owned());
        self.node(node)
    }

    /// A node that says a status every half second.
    pub fn says(mut self, node: &str, status: &str) -> Robot {
        let known = self.writers.writers.len() as u8;
        let named = |it: &NodeOf| matches!(it, NodeOf::Named(name) if **name == *node);
        let known_writer = self.writers.writers.iter().find(|(_, it)| named(it)).map(|(writer, _)| *writer);
        let writer = known_writer.unwrap_or(WriterId([known + 1; 16]));
        self.writers.writers.insert(writer, NodeOf::Named(node.into()));
        self.seen.take(&Input::Writers(Arc::new(self.writers.clone())), Timestamp::ZERO);
        for at_ms in (0..10_000).step_by(500) {
            let mut array = StatusArray::default();
            array.push_status(0, status, "", "");
            self.seen.take(&Input::Diagnostics(array.said_by(writer)), Timestamp::from_millis(at_ms));
        }
        self.node(node)
    }

    /// The observations of ten seconds, and the draft made of them.
    pub fn heard(self) -> Heard {
        let Robot { mut discovery, mut seen, .. } = self;
        discovery.participants = discovery.nodes.len();
        seen.see(Arc::new(discovery));
        Heard::of(seen, Timestamp::ZERO, END)
    }
}
