//! The demo's story in virtual time: the simulated shuttle through the real configuration and the
//! real engine. What an operator sees of each fault, from its start to after its end.

use std::collections::BTreeSet;

use super::load_config;
use crate::engine::Engine;
use crate::engine::input::{Input, OperatorAction, Place};
use crate::engine::snapshot::{Reason, Snapshot};
use crate::engine::state::State;
use crate::engine::time::Timestamp;
use crate::sim::shuttle::{Fault, Message, Shuttle};

struct Story {
    shuttle: Shuttle,
    engine: Engine,
    now_ms: u64,
    /// Every root cause that was shown.
    roots: BTreeSet<String>,
    /// The highest number of an alarm.
    alarms: u64,
}

impl Story {
    /// The operator logs in and says where the shuttle stands, and nothing is unsettled any more.
    fn begin() -> Story {
        let model = load_config().unwrap().model;
        let mut engine = Engine::new(model, Timestamp::ZERO);
        let login = OperatorAction::Login { name: "operator".into() };
        engine.handle(&Input::Operator(login), Timestamp::ZERO);
        let localize = OperatorAction::Localize { place: Place::Stop("depot".into()) };
        engine.handle(&Input::Operator(localize), Timestamp::ZERO);
        let shuttle = Shuttle::new(1, Timestamp::ZERO);
        let mut story = Story { shuttle, engine, now_ms: 0, roots: BTreeSet::new(), alarms: 0 };
        story.pass(3_000);
        assert_eq!(story.engine.snapshot().overall, State::Ok);
        story
    }

    fn pass(&mut self, ms: u64) {
        self.until(ms, |_| false);
    }

    /// Lets time pass until the condition holds, at most so long; how long it took.
    fn until(&mut self, within_ms: u64, holds: impl Fn(&Snapshot) -> bool) -> Option<u64> {
        let start_ms = self.now_ms;
        while self.now_ms < start_ms + within_ms {
            self.now_ms += 10;
            let now = Timestamp::from_millis(self.now_ms);
            for message in self.shuttle.advance(now) {
                self.engine.handle(&input(message), now);
            }
            self.engine.handle(&Input::Tick, now);
            let snapshot = self.engine.snapshot();
            let names = snapshot.roots.iter().map(|root| snapshot.node_name(root.node).to_string());
            self.roots.extend(names);
            self.alarms = snapshot.alarms.iter().map(|alarm| alarm.id).fold(self.alarms, u64::max);
            if holds(&snapshot) {
                return Some(self.now_ms - start_ms);
            }
        }
        None
    }

    fn drive(&mut self) {
        self.until(90_000, |snapshot| state(snapshot, "execution") == State::Ok).expect("it drives");
        self.pass(5_000);
    }
}

fn input(message: Message) -> Input {
    match message {
        Message::Diagnostics(array) => Input::Diagnostics(array),
        Message::Active(value) => Input::Signal { name: "active".into(), value },
    }
}

fn state(snapshot: &Snapshot, node: &str) -> State {
    snapshot.shown(snapshot.node(node).unwrap_or_else(|| panic!("no node {node}"))).0
}

fn masked_by(snapshot: &Snapshot, node: &str) -> Vec<String> {
    match snapshot.shown(snapshot.node(node).unwrap_or_else(|| panic!("no node {node}"))).1 {
        Some(Reason::Masked { by }) => by.iter().map(|&root| snapshot.node_name(root).to_string()).collect(),
        _ => Vec::new(),
    }
}

#[test]
fn a_healthy_shuttle_raises_nothing_over_five_loops() {
    let mut story = Story::begin();
    let unsettled = story.until(600_000, |snapshot| snapshot.overall != State::Ok);
    assert_eq!(unsettled, None);
    assert_eq!((story.roots.len(), story.alarms), (0, 0));
}

/// The fault, its root cause, who waits for it, who shows ERROR before the cause does, and within
/// how many milliseconds all of that is settled.
type FaultRow = (Fault, &'static str, &'static [&'static str], &'static [&'static str], u64);

#[test]
fn every_fault_has_its_one_cause_from_its_start_to_after_its_end() {
    let after_localization = &["perception", "prediction", "planning", "execution"][..];
    let table: [FaultRow; 5] = [
        (
            Fault::SensorOutage,
            "sensors/velodyne_packet_alive",
            &["localization", "perception", "prediction", "planning", "execution"],
            &["localization/tf_quality", "localization/scan_matching", "localization/tf_map"],
            1_400,
        ),
        (Fault::LocalizationJump, "localization/tf_quality", after_localization, &[], 200),
        (Fault::CostmapDelay, "perception/costmap_delay", &after_localization[1..], &[], 200),
        (Fault::PlannerStall, "planning/planner_submitted", &["execution"], &[], 700),
        (
            Fault::CanLoss,
            "can/bus",
            &["localization", "perception", "prediction", "planning", "execution"],
            &[],
            500,
        ),
    ];
    let lasting = table.iter().flat_map(|row| [0, 100, 250, 600, 8_000].map(|more_ms| (row, more_ms)));
    for (&(fault, cause, waiting, early, within_ms), more_ms) in lasting {
        let mut story = Story::begin();
        story.drive();
        story.shuttle.set_fault(fault, true);
        let all_wait = |snapshot: &Snapshot| waiting.iter().all(|tile| masked_by(snapshot, tile) == [cause]);
        let shown_ms = story.until(5_000, all_wait).unwrap_or_else(|| panic!("{fault:?}: {:?}", story.roots));
        assert!(shown_ms <= within_ms, "{fault:?} after {shown_ms} ms");
        let unsteady = story.until(more_ms, |snapshot| !all_wait(snapshot));
        assert_eq!(unsteady, None, "{fault:?}: {:?}", story.roots);

        let expected: BTreeSet<String> = [cause].iter().chain(early).map(|name| (*name).to_owned()).collect();
        assert!(story.roots.is_subset(&expected), "{fault:?}: {:?}", story.roots);
        story.roots.clear();
        story.shuttle.set_fault(fault, false);
        let gone_ms = story.until(5_000, |snapshot| snapshot.overall == State::Ok);
        assert!(gone_ms.is_some(), "{fault:?} is not gone: {:?}", story.roots);
        story.pass(3_000);
        let expected = BTreeSet::from([cause.to_owned()]);
        assert_eq!(story.roots, expected, "{fault:?}: on its way out, after {more_ms} ms");
        if early.is_empty() {
            assert_eq!(story.alarms, 1, "{fault:?}: {:?}", story.roots);
        }
    }
}

#[test]
fn in_a_sensor_outage_localization_is_in_error_until_sensors_is() {
    let mut story = Story::begin();
    story.shuttle.set_fault(Fault::SensorOutage, true);
    let localization_ms =
        story.until(1_000, |snapshot| state(snapshot, "localization") == State::Error).unwrap();
    assert!(localization_ms <= 400, "{localization_ms}");
    assert_eq!(state(&story.engine.snapshot(), "sensors"), State::Ok);
    let until_cause = story.until(2_000, |snapshot| state(snapshot, "localization") != State::Error).unwrap();
    let snapshot = story.engine.snapshot();
    assert_eq!(state(&snapshot, "sensors"), State::Error, "after {until_cause} ms");
    assert_eq!(masked_by(&snapshot, "localization"), ["sensors/velodyne_packet_alive"]);
    assert_eq!(state(&snapshot, "can"), State::Ok);
}

#[test]
fn at_a_stop_a_stalled_planner_does_not_matter_until_the_shuttle_drives() {
    let mut story = Story::begin();
    story.shuttle.set_fault(Fault::PlannerStall, true);
    let departs = story.until(60_000, |snapshot| state(snapshot, "planning") != State::Ignore).unwrap();
    assert!(departs > 5_000);
    assert_eq!(state(&story.engine.snapshot(), "planning"), State::Error);
    assert_eq!(story.roots, BTreeSet::from(["planning/planner_submitted".to_owned()]));
}

#[test]
fn a_low_battery_is_a_warning_and_no_more() {
    let mut story = Story::begin();
    story.shuttle.set_fault(Fault::LowBattery, true);
    story.until(2_000, |snapshot| state(snapshot, "can") == State::Warning).unwrap();
    story.pass(2_000);
    let snapshot = story.engine.snapshot();
    assert_eq!((snapshot.overall, state(&snapshot, "localization")), (State::Warning, State::Ok));
    assert_eq!((story.roots.len(), story.alarms), (0, 0));
}
