//! The simulated robot and the engine: what somebody sees of each fault, with the demo's patience.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::story::{masked_by, state, wall};
use crate::cli::running::demo::load_config;
use crate::cli::running::vehicle::in_process::{Ears, listening};
use crate::cli::running::vehicle::machine::{Kind, Machine, SEED};
use crate::config::demo_patience::patient;
use crate::config::publishing::Publishing;
use crate::engine::Engine;
use crate::engine::input::Input;
use crate::engine::snapshot::Snapshot;
use crate::engine::state::State;
use crate::engine::time::Timestamp;
use crate::ros::DIAGNOSTICS;

struct Floor {
    machine: Machine,
    engine: Engine,
    ears: Ears,
    now_ms: u64,
    roots: BTreeSet<String>,
    alarms: u64,
}

impl Floor {
    fn new() -> Floor {
        let loaded = load_config(Kind::Robot).unwrap();
        let machine = Machine::new(Kind::Robot, SEED, &loaded, Timestamp::ZERO);
        let (engine, ears) = listening(&patient(loaded), Timestamp::ZERO);
        Floor { machine, engine, ears, now_ms: 0, roots: BTreeSet::new(), alarms: 0 }
    }

    /// Lets time pass until the condition holds, at most so long; how long it took.
    fn until(&mut self, within_ms: u64, holds: impl Fn(&Snapshot) -> bool) -> Option<u64> {
        let start_ms = self.now_ms;
        while self.now_ms < start_ms + within_ms {
            self.now_ms += 10;
            let now = Timestamp::from_millis(self.now_ms);
            for input in self.ears.hear(&mut self.machine, now, wall) {
                self.engine.handle(&input, now);
            }
            self.engine.handle(&Input::Tick, now);
            let snapshot = self.snapshot();
            self.roots.extend(snapshot.roots.iter().map(|root| snapshot.node_name(root.node).to_string()));
            self.alarms = snapshot.alarms.iter().map(|alarm| alarm.id).fold(self.alarms, u64::max);
            if holds(&snapshot) {
                return Some(self.now_ms - start_ms);
            }
        }
        None
    }

    fn snapshot(&mut self) -> Arc<Snapshot> {
        self.engine.snapshot()
    }

    /// Waits until the robot is on its way.
    fn on_its_way(&mut self) {
        let relevant = |snapshot: &Snapshot| state(snapshot, "navigation/commands") == State::Ok;
        self.until(60_000, relevant).expect("it leaves");
    }
}

#[test]
fn a_healthy_robot_raises_nothing_on_two_rounds() {
    let mut floor = Floor::new();
    assert!(floor.until(10_000, |snapshot| snapshot.overall == State::Ok).is_some());
    floor.until(240_000, |_| false);
    assert_eq!((floor.roots, floor.alarms), (BTreeSet::new(), 0));
}

#[test]
fn each_fault_of_the_robot_shows_its_one_cause_and_who_waits_for_it() {
    let table: [(&str, &str, &[&str]); 6] = [
        ("lidar_outage", "lidars/front", &["localization", "navigation"]),
        ("wheel_slip", "base/wheel_slip", &["localization", "navigation"]),
        ("localization_lost", "localization/certainty", &["navigation"]),
        ("navigation_stall", "navigation/commands", &[]),
        ("controller_crash", "navigation/controller", &[]),
        ("docking_failed", "docking/charging", &[]),
    ];
    for (fault, cause, waiting) in table {
        let mut floor = Floor::new();
        if fault == "docking_failed" {
            floor.until(5_000, |_| false);
        } else {
            floor.on_its_way();
        }
        floor.machine.set_fault(fault, true);
        let shows = |snapshot: &Snapshot| {
            state(snapshot, cause) == State::Error
                && waiting.iter().all(|tile| masked_by(snapshot, tile) == [cause])
        };
        assert!(floor.until(5_000, shows).is_some(), "{fault}: {:?}", floor.roots);
        floor.machine.set_fault(fault, false);
        let well = floor.until(8_000, |snapshot| snapshot.overall == State::Ok);
        assert!(well.is_some(), "{fault}: {:?}", floor.roots);
        floor.until(4_000, |_| false);
        assert_eq!((floor.roots, floor.alarms), (BTreeSet::from([cause.to_owned()]), 1), "{fault}");
    }
    let mut floor = Floor::new();
    floor.machine.set_fault("battery_low", true);
    let warns = |snapshot: &Snapshot| state(snapshot, "battery") == State::Warning;
    assert!(floor.until(5_000, warns).is_some());
    assert!(floor.until(5_000, |snapshot| snapshot.overall == State::Warning).is_some());
    assert_eq!(floor.alarms, 0);
}

#[test]
fn nothing_that_the_robot_reads_commands_it() {
    let loaded = load_config(Kind::Robot).unwrap();
    let Publishing { diagnostics_agg, tree, toplevel_state, rosout, .. } = loaded.publishing.clone();
    let only = Publishing {
        diagnostics_agg,
        tree,
        toplevel_state,
        rosout,
        initialpose: None,
        stage: None,
        clearance: None,
        deceleration_request: None,
        maneuver_stop_request: None,
        hold: None,
    };
    assert_eq!(loaded.publishing, only);
    // Everything that the configuration reads is published by the simulation, with the type that it names.
    let machine = Machine::new(Kind::Robot, SEED, &loaded, Timestamp::ZERO);
    let offers = machine.offers();
    for topic in &loaded.model.watched.topics {
        let offer = offers.iter().find(|(name, ..)| *name == &*topic.topic);
        assert_eq!(offer.map(|(_, type_name, _)| *type_name), Some(&*topic.type_name), "{}", topic.topic);
    }
    let of_nodes: Vec<&str> = machine.nodes().into_iter().flat_map(|node| machine.topics_of(node)).collect();
    assert!(offers.iter().all(|(topic, ..)| *topic == DIAGNOSTICS || of_nodes.contains(topic)));
}
