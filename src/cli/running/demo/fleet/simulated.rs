//! A simulated vehicle with its engine and an operator who does what is due, in real or in virtual time.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::SystemTime;

use serde::Serialize;

use super::cast::Member;
use super::tape::Tape;
use crate::cli::running::vehicle::in_process::{Ears, listening, order};
use crate::cli::running::vehicle::machine::Machine;
use crate::config::Loaded;
use crate::engine::Engine;
use crate::engine::input::{AlarmRef, Input, OperatorAction, Place};
use crate::engine::model::Stage;
use crate::engine::snapshot::Snapshot;
use crate::engine::time::{Span, Timestamp};
use crate::fleet::message::{Content, Incident};
use crate::ros::publish::outputs::Levels;
use crate::sim::machine::STEP;

/// What is seen of it, and said to it, comes this often.
pub const PERIOD: Span = Span::from_millis(100);

/// A request to slow down is repeated this often.
const REPEAT: Span = Span::from_millis(50);

/// The operator looks this often, takes note of an alarm after a while, and says again where a vehicle stands that did
/// not find itself.
const OPERATES_EVERY: Span = Span::from_secs(1);
const ACKNOWLEDGES_AFTER: Span = Span::from_secs(25);
const LOCALIZES_EVERY: Span = Span::from_secs(8);

pub struct Simulated {
    machine: Machine,
    engine: Engine,
    ears: Ears,
    /// What the machine was told.
    levels: Levels,
    /// Where it begins.
    stop: Option<Box<str>>,
    at: Timestamp,
    operates_at: Timestamp,
    localizes_at: Timestamp,
    tape: Option<Tape>,
}

impl Simulated {
    pub fn new(member: &Member, loaded: &Loaded, start: Timestamp) -> Simulated {
        let (mut engine, ears) = listening(loaded, start);
        let levels = Levels::new(REPEAT, &engine.snapshot());
        Simulated {
            machine: Machine::new(member.kind, member.seed, loaded, start),
            engine,
            ears,
            levels,
            stop: loaded.model.driving.stops.first().map(|stop| stop.id.as_ref().into()),
            at: start,
            operates_at: start,
            localizes_at: start,
            tape: None,
        }
    }

    /// The state of its engine.
    pub fn keyframe(&self) -> impl Serialize + use<> {
        self.engine.keyframe()
    }

    /// Records what its engine hears from now on.
    pub fn record(&mut self, tape: Tape) {
        self.tape = Some(tape);
    }

    /// The recording; `None` if there is none, or the disk took not all of it.
    pub fn take_tape(&mut self) -> Option<Tape> {
        self.tape.take()
    }

    fn hear(&mut self, input: &Input) {
        if let Some(tape) = &mut self.tape
            && let Err(error) = tape.take(self.at, input)
        {
            tracing::error!("a recording of the demo is lost: {error:#}");
            self.tape = None;
        }
        // What the engine refuses of an operator is tried again.
        let _ = self.engine.handle(input, self.at);
    }

    /// Until when it has run.
    pub fn at(&self) -> Timestamp {
        self.at
    }

    /// The time until then was slept through.
    pub fn skip_to(&mut self, at: Timestamp) {
        self.at = at;
    }

    pub fn set_fault(&mut self, name: &str, on: bool) {
        self.machine.set_fault(name, on);
    }

    /// Lets a [`PERIOD`] pass; `wall` is the wall time of an instant.
    pub fn pass(&mut self, wall: impl Fn(Timestamp) -> SystemTime) -> Arc<Snapshot> {
        let end = self.at + PERIOD;
        while self.at < end {
            self.step(&wall);
        }
        let snapshot = self.engine.snapshot();
        self.levels.repeat_at(&snapshot);
        for said in self.levels.due(&snapshot, self.at) {
            self.levels.said(said, self.at);
            if let Some(order) = order(said) {
                self.machine.obey(order);
            }
        }
        if self.at >= self.operates_at {
            self.operates_at = self.at + OPERATES_EVERY;
            for action in self.due(&snapshot) {
                self.hear(&Input::Operator(action));
            }
        }
        snapshot
    }

    fn step(&mut self, wall: &impl Fn(Timestamp) -> SystemTime) {
        self.at = self.at + STEP;
        let now = self.at;
        for input in self.ears.hear(&mut self.machine, now, wall) {
            self.hear(&input);
        }
        self.engine.handle(&Input::Tick, now);
    }

    /// What an operator in the vehicle would do now.
    fn due(&mut self, snapshot: &Snapshot) -> Vec<OperatorAction> {
        let (display_live, storage_ok) = (true, true);
        let mut due = Vec::new();
        match snapshot.stage {
            Stage::Locked => due.push(OperatorAction::Login { name: "operator".into() }),
            Stage::Localizing if self.at >= self.localizes_at => {
                self.localizes_at = self.at + LOCALIZES_EVERY;
                let place = self.stop.clone().map(Place::Stop);
                due.extend(place.map(|place| OperatorAction::Localize { place }));
            }
            Stage::Standby if snapshot.clearance_refusals.is_empty() => {
                due.push(OperatorAction::AskClearance { display_live, storage_ok });
                due.push(OperatorAction::Clear { display_live, storage_ok });
            }
            _ => {}
        }
        let is_due = |raised| self.at.since(raised) >= ACKNOWLEDGES_AFTER;
        let alarms = snapshot.alarms.iter().filter(|it| !it.acknowledged && is_due(it.raised));
        due.extend(alarms.map(|it| OperatorAction::Acknowledge { alarm: AlarmRef::Number(it.id) }));
        let is_held = snapshot.countermeasures.iter().any(|it| it.request.kind().moves());
        if is_held && snapshot.release_refusals.is_empty() {
            due.push(OperatorAction::Release { display_live, storage_ok });
        }
        due
    }
}

/// The incidents of a simulated vehicle: one for each alarm, without a recording.
pub struct Incidents {
    /// The number before the first one.
    before: u64,
    version: String,
    config: String,
    told: BTreeMap<u64, Incident>,
}

impl Incidents {
    pub fn new(before: u64, version: &str, config: &str) -> Incidents {
        Incidents { before, version: version.into(), config: config.into(), told: BTreeMap::new() }
    }

    /// Those that are new or changed.
    pub fn news(&mut self, snapshot: &Snapshot, unix_ms: impl Fn(Timestamp) -> i64) -> Vec<Content> {
        let mut news = Vec::new();
        for alarm in snapshot.alarms.iter() {
            let known = self.told.get(&alarm.id);
            let ended = alarm.ended.map(&unix_ms);
            if known.is_some_and(|it| it.until.is_some() == ended.is_some()) {
                continue;
            }
            let incident = Incident {
                number: self.before + alarm.id,
                since: known.map_or_else(|| unix_ms(alarm.raised), |it| it.since),
                until: ended,
                stage: known.map_or_else(|| snapshot.stage.as_str().to_owned(), |it| it.stage.clone()),
                causes: vec![snapshot.node_name(alarm.node).to_string()],
                triggers: 1,
                version: self.version.clone(),
                config: self.config.clone(),
                bytes: 0,
                sha256: None,
            };
            news.push(Content::Incident(incident.clone()));
            self.told.insert(alarm.id, incident);
        }
        // An alarm that was acknowledged before is gone at its end.
        self.told.retain(|number, incident| {
            let is_there = snapshot.alarms.iter().any(|alarm| alarm.id == *number);
            if !is_there && incident.until.is_none() {
                let until = Some(unix_ms(snapshot.now));
                news.push(Content::Incident(Incident { until, ..incident.clone() }));
            }
            is_there
        });
        news
    }
}
