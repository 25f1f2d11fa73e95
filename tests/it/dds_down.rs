//! While the part that speaks DDS is down, nothing of the vehicle is known: no false OK, and no false
//! ERROR.

use std::sync::Arc;

use telltale::engine::Engine;
use telltale::engine::input::{Input, StatusArray};
use telltale::engine::model::monitors::ProbeTarget;
use telltale::engine::model::sample::{FieldValue, Probe, ProbeOutcome, PublisherReport, Sample};
use telltale::engine::model::{Model, NodeId};
use telltale::engine::snapshot::Snapshot;
use telltale::engine::state::State::{self, Error, Ok, Unknown, Warning};
use telltale::engine::time::{Span, Timestamp};

use crate::by_hand;

const CONFIG: &str = "
vehicle: { stages: none }
groups:
  - id: parts
    match: [{ regex: 'found.*', timeout: 1h }]
    modules:
      - { id: fine, status: fine, timeout: 1h }
      - { id: warned, status: warned, timeout: 1h }
      - { id: broken, status: broken, timeout: 1h }
      - { id: silent, status: silent, timeout: 1h, stale: error }
      - { id: rate, monitor: { frequency: { topic: /scan, type: std_msgs/msg/Empty, window: 1s, error_below: 5 } } }
      - { id: dead_rate, monitor: { frequency: { topic: /dead, type: std_msgs/msg/Empty, window: 1s, error_below: 5 } } }
      - { id: node, monitor: { watchdog: { node: /planner } } }
      - { id: host, monitor: { watchdog: { icmp: 127.0.0.1, error_above: 50ms } } }
";
const MODULES: [&str; 9] =
    ["fine", "warned", "broken", "silent", "rate", "dead_rate", "node", "host", "found it"];

struct Vehicle {
    engine: Engine,
    model: Arc<Model>,
    now: Timestamp,
}

impl Vehicle {
    /// After three seconds in which each module said what it says.
    fn after_three_seconds() -> Vehicle {
        let model = by_hand::model(CONFIG);
        let engine = Engine::new(model.clone(), Timestamp::ZERO);
        let mut vehicle = Vehicle { engine, model, now: Timestamp::ZERO };
        for topic in ["/scan", "/dead"] {
            let source = vehicle.topic(topic);
            vehicle.take(&Input::Topic(PublisherReport {
                source,
                publishers: 1,
                other_type: None,
                transient_local: false,
                best_effort: false,
                anew: false,
            }));
        }
        vehicle.report();
        vehicle.run(3000);
        vehicle
    }

    fn take(&mut self, input: &Input) {
        self.engine.handle(input, self.now);
    }

    fn topic(&self, name: &str) -> Arc<telltale::engine::model::monitors::TopicSpec> {
        let topics = &self.model.watched.topics;
        topics.iter().find(|spec| &*spec.topic == name).unwrap().clone()
    }

    fn report(&mut self) {
        let mut array = StatusArray::default();
        for (name, level) in [("fine", 0), ("warned", 1), ("broken", 2), ("found it", 0)] {
            array.push_status(level, name, "said so", "");
        }
        self.take(&Input::Diagnostics(array));
    }

    /// Publishes ten scans a second, and answers probes.
    fn run(&mut self, millis: u64) {
        for _ in 0..millis / 100 {
            self.pass(100);
            let source = self.topic("/scan");
            let values: Box<[FieldValue]> = vec![FieldValue::Absent; source.fields.len()].into();
            let sample = Sample::of(source, values);
            self.take(&Input::Sample(sample));
            self.probe(ProbeOutcome::Announced);
        }
    }

    fn probe(&mut self, of_node: ProbeOutcome) {
        for source in self.model.watched.watchdogs.clone() {
            let outcome = match source.target {
                ProbeTarget::Icmp { .. } => ProbeOutcome::Answered { after: Span::from_millis(1) },
                _ => of_node.clone(),
            };
            self.take(&Input::Probe(Probe { source, outcome }));
        }
    }

    fn pass(&mut self, millis: u64) {
        self.now = self.now + Span::from_millis(millis);
        self.take(&Input::Tick);
    }

    fn dds(&mut self, fault: Option<&str>) {
        self.take(&Input::Dds { fault: fault.map(Box::from) });
    }

    fn states(&mut self) -> [State; 9] {
        let snapshot = self.engine.snapshot();
        MODULES.map(|name| shown(&snapshot, &format!("parts/{name}")))
    }
}

fn shown(snapshot: &Snapshot, name: &str) -> State {
    let node = snapshot.node(name).unwrap_or_else(|| panic!("no {name}"));
    snapshot.shown(node).0
}

fn says(snapshot: &Snapshot, name: &str) -> String {
    let Some(NodeId::Module(id)) = snapshot.node(name) else { panic!("no {name}") };
    snapshot.module(id).1.says(snapshot.now).into_owned()
}

#[test]
fn all_that_came_by_dds_is_unknown_at_once_and_until_it_is_heard_again() {
    let mut vehicle = Vehicle::after_three_seconds();
    assert_eq!(vehicle.states(), [Ok, Warning, Error, Unknown, Ok, Error, Ok, Ok, Ok]);
    vehicle.dds(Some("it hears nothing"));
    let down = [Unknown, Unknown, Error, Unknown, Unknown, Error, Unknown, Ok, Unknown];
    assert_eq!(vehicle.states(), down, "what is in ERROR stays so, and the host is asked without DDS");
    let snapshot = vehicle.engine.snapshot();
    assert_eq!(shown(&snapshot, "telltale/dds"), Error);
    for (name, last) in [("fine", "said so"), ("rate", "9 Hz, at least 5 Hz wanted")] {
        let said = says(&snapshot, &format!("parts/{name}"));
        let why = "nothing received since the connection to the vehicle failed";
        assert_eq!(said, format!("{why}; last: {last}"));
    }
    // A silence of everybody is nobody's fault.
    for _ in 0..20 {
        vehicle.pass(500);
        vehicle.probe(ProbeOutcome::Missed("no node /planner is announced".into()));
        assert_eq!(vehicle.states(), down);
    }
    vehicle.dds(None);
    assert_eq!(vehicle.states(), down);
    assert_eq!(shown(&vehicle.engine.snapshot(), "telltale/dds"), Ok);
    vehicle.report();
    for _ in 0..20 {
        vehicle.run(100);
        assert!(vehicle.states()[4] != Error, "half a window is no rate");
    }
    vehicle.run(3000);
    assert_eq!(vehicle.states(), [Ok, Warning, Error, Unknown, Ok, Error, Ok, Ok, Ok]);
}

#[test]
fn who_is_not_there_any_more_is_found_afterwards() {
    let mut vehicle = Vehicle::after_three_seconds();
    vehicle.dds(Some("it was killed"));
    vehicle.pass(1000);
    vehicle.dds(None);
    for _ in 0..60 {
        vehicle.pass(100);
        vehicle.probe(ProbeOutcome::Missed("no node /planner is announced".into()));
    }
    let states = vehicle.states();
    assert_eq!([states[0], states[4], states[6]], [Unknown, Error, Error], "{states:?}");
}

#[test]
fn a_second_fault_after_some_were_heard_again_hides_these_too() {
    let mut vehicle = Vehicle::after_three_seconds();
    vehicle.dds(Some("it was killed"));
    vehicle.report();
    assert_eq!(vehicle.states()[0], Ok, "it is heard");
    vehicle.dds(Some("it was killed"));
    assert_eq!(vehicle.states()[..3], [Unknown, Unknown, Error]);
}

#[test]
fn a_new_configuration_changes_nothing_of_it() {
    let mut vehicle = Vehicle::after_three_seconds();
    vehicle.dds(Some("it was killed"));
    let before = vehicle.states();
    vehicle.engine.reload(vehicle.model.clone(), vehicle.now);
    vehicle.pass(100);
    assert_eq!(vehicle.states(), before);
    assert_eq!(shown(&vehicle.engine.snapshot(), "telltale/dds"), Error);
}
