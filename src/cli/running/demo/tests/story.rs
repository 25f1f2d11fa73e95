//! The shuttle and the engine, with the task of DDS between them: bytes one way, orders the other.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use crate::cli::running::demo::load_config;
use crate::cli::running::vehicle::in_process::{Ears, know_publishers, listening, order};
use crate::cli::running::vehicle::machine::Kind;
use crate::cli::running::vehicle::shuttle_wire::ShuttleWire;
use crate::config::Loaded;
use crate::config::demo_patience::patient;
use crate::engine::Engine;
use crate::engine::input::{Input, OperatorAction, Place, Response};
use crate::engine::model::{Model, Stage};
use crate::engine::restart::resume::Restored;
use crate::engine::snapshot::{Reason, Snapshot};
use crate::engine::state::State;
use crate::engine::time::{Span, Timestamp};
use crate::ros::publish::outputs::Levels;
use crate::sim::machine::Departure;
use crate::sim::shuttle::{Fault, Message, Sent, Shuttle};

const REPEAT: Span = Span::from_millis(50);

pub struct Story {
    shuttle: Shuttle,
    model: Arc<Model>,
    engine: Engine,
    ears: Ears,
    /// What Telltale has told the shuttle.
    levels: Levels,
    /// Telltale does nothing.
    pub gone: bool,
    wire: ShuttleWire,
    pub now_ms: u64,
    /// Every root cause that was shown.
    pub roots: BTreeSet<String>,
    /// Every node that showed WARNING or ERROR.
    pub bad: BTreeSet<String>,
    /// The highest number of an alarm.
    pub alarms: u64,
    silenced: Option<&'static str>,
    heard_mps: f64,
    true_mps: f64,
    /// In each period, messages wait for so long and then come all at once: milliseconds.
    pub stalls_ms: Option<(u64, u64)>,
    waiting: Vec<Sent>,
}

impl Story {
    /// Nobody is logged in, and the shuttle stands at its depot.
    pub fn locked() -> Story {
        Story::of(&load_config(Kind::Shuttle(Departure::Cleared)).unwrap())
    }

    fn of(loaded: &Loaded) -> Story {
        let (mut engine, ears) = listening(loaded, Timestamp::ZERO);
        let levels = Levels::new(REPEAT, &engine.snapshot());
        let stops = &loaded.model.driving.stops;
        let mut story = Story {
            shuttle: Shuttle::new(1, Timestamp::ZERO, stops, Departure::Cleared),
            model: loaded.model.clone(),
            engine,
            ears,
            levels,
            gone: false,
            wire: ShuttleWire::of(&loaded.model),
            now_ms: 0,
            roots: BTreeSet::new(),
            bad: BTreeSet::new(),
            alarms: 0,
            silenced: None,
            heard_mps: 0.0,
            true_mps: 0.0,
            stalls_ms: None,
            waiting: Vec::new(),
        };
        story.pass(1_000);
        story
    }

    /// The operator has logged in and said where the shuttle stands, and nothing is unsettled.
    pub fn begin() -> Story {
        Story::locked().at_the_depot()
    }

    /// The same with the demo's patience.
    pub fn patient() -> Story {
        Story::of(&patient(load_config(Kind::Shuttle(Departure::Cleared)).unwrap())).at_the_depot()
    }

    fn at_the_depot(self) -> Story {
        let mut story = self;
        story.log_in();
        story.pass(2_500);
        story.localize("depot");
        let ready = |snapshot: &Snapshot| snapshot.stage == Stage::Standby && snapshot.overall == State::Ok;
        let ready_ms = story.until(10_000, ready);
        assert!(ready_ms.is_some(), "{:?}", story.complaints());
        story
    }

    pub fn log_in(&mut self) {
        assert_eq!(self.act(&OperatorAction::Login { name: "operator".into() }), Response::Done);
    }

    pub fn localize(&mut self, stop: &str) {
        let place = Place::Stop(stop.into());
        assert_eq!(self.act(&OperatorAction::Localize { place }), Response::Done);
    }

    /// Waits for a goal and clears the shuttle.
    pub fn clear(&mut self) {
        let ready = self.until(20_000, |snapshot| snapshot.clearance_refusals.is_empty());
        assert!(ready.is_some(), "{:?}", self.snapshot().clearance_refusals);
        let (display_live, storage_ok) = (true, true);
        assert_eq!(self.act(&OperatorAction::AskClearance { display_live, storage_ok }), Response::Done);
        assert_eq!(self.act(&OperatorAction::Clear { display_live, storage_ok }), Response::Done);
    }

    /// Clears the shuttle and lets it drive at full speed.
    pub fn drive(&mut self) {
        self.clear();
        self.until(5_000, |snapshot| snapshot.stage == Stage::Active).expect("it leaves");
        self.pass(10_000);
    }

    pub fn act(&mut self, action: &OperatorAction) -> Response {
        self.engine.handle(&Input::Operator(action.clone()), Timestamp::from_millis(self.now_ms))
    }

    pub fn set_fault(&mut self, fault: Fault, on: bool) {
        self.shuttle.set_fault(fault, on);
    }

    /// Nothing more comes on this topic.
    pub fn silence(&mut self, topic: &'static str) {
        self.silenced = Some(topic);
    }

    pub fn snapshot(&mut self) -> Arc<Snapshot> {
        self.engine.snapshot()
    }

    /// As it was last heard.
    pub fn speed_mps(&self) -> f64 {
        self.heard_mps
    }

    /// As it is, whether or not it is heard.
    pub fn true_speed_mps(&self) -> f64 {
        self.true_mps
    }

    pub fn complaints(&mut self) -> Vec<(String, State, String)> {
        let snapshot = self.snapshot();
        let modules = snapshot.layout.modules.iter().zip(snapshot.modules.iter());
        let bad = modules.filter(|(_, view)| !matches!(view.state, State::Ok | State::Ignore));
        bad.map(|(info, view)| (info.id.to_string(), view.state, view.report.message.to_string())).collect()
    }

    pub fn pass(&mut self, ms: u64) {
        self.until(ms, |_| false);
    }

    /// Lets time pass until the condition holds, at most so long; how long it took.
    pub fn until(&mut self, within_ms: u64, holds: impl Fn(&Snapshot) -> bool) -> Option<u64> {
        let start_ms = self.now_ms;
        while self.now_ms < start_ms + within_ms {
            self.now_ms += 10;
            let now = Timestamp::from_millis(self.now_ms);
            let sent = self.shuttle.advance(now);
            sent.iter().for_each(|sent| self.watch(&sent.message));
            if self.gone {
                continue;
            }
            self.waiting.extend(sent);
            if self.stalls_ms.is_none_or(|(period_ms, stall_ms)| self.now_ms % period_ms >= stall_ms) {
                for sent in std::mem::take(&mut self.waiting) {
                    self.hear(&sent, now);
                }
            }
            for probe in self.ears.probes(self.shuttle.nodes(), now) {
                self.engine.handle(&probe, now);
            }
            self.engine.handle(&Input::Tick, now);
            let snapshot = self.engine.snapshot();
            self.speak(&snapshot, now);
            self.note(&snapshot);
            if holds(&snapshot) {
                return Some(self.now_ms - start_ms);
            }
        }
        None
    }

    /// Another process, which knows what the one before stored, takes its place.
    pub fn restart(&mut self, memory: &Restored) {
        let now = Timestamp::from_millis(self.now_ms);
        self.engine = Engine::resume(self.model.clone(), memory, now);
        know_publishers(&mut self.engine, &self.model, now);
        self.levels = Levels::new(REPEAT, &self.engine.snapshot());
        self.gone = false;
    }

    fn watch(&mut self, message: &Message) {
        match message {
            Message::SpeedCommand(mps) => self.true_mps = *mps,
            Message::Active(false) => self.true_mps = 0.0,
            _ => {}
        }
    }

    fn hear(&mut self, Sent { at, message }: &Sent, now: Timestamp) {
        if let Message::WheelSpeed { mps } = message {
            self.heard_mps = *mps;
        }
        let (topic, body) = self.wire.encode(message, wall(*at));
        if self.silenced == Some(topic) {
            return;
        }
        for input in self.ears.inputs(topic, &body, wall(now)) {
            self.engine.handle(&input, now);
        }
    }

    /// The shuttle hears at once what is published.
    fn speak(&mut self, snapshot: &Snapshot, now: Timestamp) {
        self.levels.repeat_at(snapshot);
        for said in self.levels.due(snapshot, now) {
            self.levels.said(said, now);
            if let Some(order) = order(said) {
                self.shuttle.obey(order);
            }
        }
    }

    fn note(&mut self, snapshot: &Snapshot) {
        let names = snapshot.roots.iter().map(|root| snapshot.node_name(root.node).to_string());
        self.roots.extend(names);
        self.alarms = snapshot.alarms.iter().map(|alarm| alarm.id).fold(self.alarms, u64::max);
        if snapshot.stage != Stage::Localizing
            && !matches!(snapshot.overall, State::Ok | State::Ignore | State::Unknown)
        {
            let modules = snapshot.layout.modules.iter().zip(snapshot.modules.iter());
            let bad = modules.filter(|(_, view)| matches!(view.state, State::Warning | State::Error));
            self.bad.extend(bad.map(|(info, _)| info.id.to_string()));
        }
    }
}

/// Some day in 2026: stamps are of the wall clock.
const EPOCH: Duration = Duration::from_secs(1_800_000_000);

pub fn wall(at: Timestamp) -> SystemTime {
    SystemTime::UNIX_EPOCH + EPOCH + Duration::from_nanos(at.as_nanos())
}

pub fn state(snapshot: &Snapshot, node: &str) -> State {
    snapshot.shown(snapshot.node(node).unwrap_or_else(|| panic!("no node {node}"))).0
}

pub fn masked_by(snapshot: &Snapshot, node: &str) -> Vec<String> {
    match snapshot.shown(snapshot.node(node).unwrap_or_else(|| panic!("no node {node}"))).1 {
        Some(Reason::Masked { by }) => by.iter().map(|&root| snapshot.node_name(root).to_string()).collect(),
        _ => Vec::new(),
    }
}
