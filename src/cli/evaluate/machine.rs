//! The simulated shuttle and robot as machines of a campaign: their faults with the truth of each, and what a diagnosis
//! hears of them.

use std::sync::Arc;
use std::time::{Duration, SystemTime};

use anyhow::{Context as _, bail};

use crate::cli::running::demo::load_config;
use crate::cli::running::vehicle::in_process::{Ears, listening, publishers};
use crate::cli::running::vehicle::machine::{Kind, Machine, SEED, diagnostics};
use crate::config::Loaded;
use crate::engine::action::{OperatorAction, Place as Where};
use crate::engine::input::{Input, StatusArray};
use crate::engine::model::monitors::MonitorSpec;
use crate::engine::model::sample::Pose;
use crate::engine::model::wording::Urgency;
use crate::engine::model::{Limits, Model, ModuleMonitor, ModuleSpec, Stage, Stop};
use crate::engine::snapshot::Snapshot;
use crate::engine::state::State;
use crate::engine::text::Text;
use crate::engine::time::Timestamp;
use crate::evaluate::machine::{self, History, STEP, Step};
use crate::evaluate::plan::{Fault, Injection, Place, Plan};
use crate::msg::cdr::Endian;
use crate::msg::messages::diagnostic_array;
use crate::ros::DIAGNOSTICS;
use crate::sim::machine::Order;

/// A machine comes to its place within this time, or never.
const COMES_WITHIN_MS: u64 = 120_000;
/// And stays there, before a trial begins, until nothing is unsettled.
const SETTLES_MS: u64 = 5_000;

/// The shuttle's stops in a campaign: so far apart that it drives for longer than a trial takes.
const STOPS: [(&str, f64); 2] = [("start", -150.0), ("end", 550.0)];

/// The modules that name each fault of the machines, and whether others follow from it.
const TRUTHS: [(&str, &[&str], bool); 14] = [
    ("sensor_outage", &["sensors/velodyne_packet_alive"], true),
    ("localization_jump", &["localization/tf_quality", "localization/scan_matching"], true),
    ("costmap_delay", &["perception/costmap_delay"], true),
    ("planner_stall", &["planning/planner_submitted"], true),
    ("can_loss", &["can/bus"], true),
    ("low_battery", &["can/battery"], false),
    ("camera_crash", &["sensors/camera_driver"], true),
    ("lidar_outage", &["lidars/front"], true),
    ("wheel_slip", &["base/wheel_slip"], true),
    ("localization_lost", &["localization/certainty"], false),
    ("navigation_stall", &["navigation/commands"], false),
    ("controller_crash", &["navigation/controller"], true),
    ("docking_failed", &["docking/charging"], false),
    ("battery_low", &["battery/charge"], false),
];

/// How a fault is made.
#[derive(Debug, Clone)]
enum Cause {
    /// In the simulated machine.
    Machine(&'static str),
    /// The component finds a fault of its own and says so in this status, whatever else it is right about.
    Status(Arc<str>),
}

pub struct Simulated {
    kind: Kind,
    loaded: Loaded,
    faults: Vec<Fault>,
    causes: Vec<Cause>,
    on_its_way: Begun,
    at_a_stop: Begun,
}

/// A machine at its place, and how it came there.
struct Begun {
    start: Machine,
    machine: Machine,
    history: History,
    /// What the machine was told on its way.
    orders: Vec<(Timestamp, Order)>,
}

impl Begun {
    fn zero(&self) -> Timestamp {
        self.history.last().map_or(Timestamp::ZERO, |step| step.at)
    }
}

/// A machine that goes through a trial from its start on, step by step. It publishes what the trial has in virtual time.
pub struct Ride<'a> {
    of: &'a Simulated,
    begun: &'a Begun,
    plan: &'a Plan,
    pub machine: Machine,
    /// The machine's own time.
    pub now: Timestamp,
    /// When the trial begins.
    pub zero: Timestamp,
}

impl Ride<'_> {
    /// The operator's actions of the last step.
    pub fn actions(&self) -> impl Iterator<Item = &OperatorAction> {
        let step = self.begun.history.get((self.now.as_nanos() / STEP.as_nanos()) as usize);
        step.into_iter().flat_map(|step| &step.inputs).filter_map(|input| match input {
            Input::Operator(action) => Some(action),
            _ => None,
        })
    }

    /// Goes on by one step, and returns the messages with their topics; `wall` is the wall time of an instant.
    pub fn step(&mut self, wall: impl Fn(Timestamp) -> SystemTime) -> Vec<(&str, Vec<u8>)> {
        let told = self.begun.orders.iter().filter(|(at, _)| *at == self.now);
        told.for_each(|(_, order)| self.machine.obey(*order));
        self.now = self.now + STEP;
        let raised = match self.now > self.zero {
            true => self.of.switch(
                &mut self.machine,
                &self.plan.injections,
                self.now.since(self.zero).as_millis(),
            ),
            false => Vec::new(),
        };
        let stamp = wall(self.now);
        let mut sent = self.machine.advance(self.now, wall);
        for (_, body) in sent.iter_mut().filter(|(topic, _)| *topic == DIAGNOSTICS && !raised.is_empty()) {
            let (array, _) = diagnostic_array(body, Endian::Little, &Limits::default());
            *body = diagnostics(&with_errors(&array, &raised), stamp);
        }
        sent
    }
}

impl Simulated {
    pub fn new(kind: Kind) -> anyhow::Result<Simulated> {
        let loaded = load_config(kind)?;
        let model = &loaded.model;
        let (mut faults, mut causes) = (Vec::new(), Vec::new());
        for info in kind.faults() {
            let (_, truth, spreads) = TRUTHS.iter().find(|it| it.0 == info.name).context(info.name)?;
            faults.push(Fault {
                name: info.name.to_owned(),
                truth: truth.iter().map(|it| (*it).to_owned()).collect(),
                spreads: *spreads,
                urgency: truth.iter().filter_map(|id| urgency(model, id)).max().unwrap_or(0),
            });
            causes.push(Cause::Machine(info.name));
        }
        for module in &model.modules {
            if let Some(status) = status(module) {
                let urgency = urgency(model, &module.id).unwrap_or(0);
                faults.push(Fault {
                    name: format!("status {}", module.id),
                    truth: vec![module.id.to_string()],
                    spreads: false,
                    urgency,
                });
                causes.push(Cause::Status(status.clone()));
            }
        }
        let (on_its_way, at_a_stop) =
            (begin(kind, &loaded, Place::OnItsWay)?, begin(kind, &loaded, Place::AtAStop)?);
        Ok(Simulated { kind, loaded, faults, causes, on_its_way, at_a_stop })
    }

    fn begun(&self, place: Place) -> &Begun {
        match place {
            Place::OnItsWay => &self.on_its_way,
            Place::AtAStop => &self.at_a_stop,
        }
    }

    pub fn ride<'a>(&'a self, plan: &'a Plan) -> Ride<'a> {
        let begun = self.begun(plan.place);
        let (machine, zero) = (begun.start.clone(), begun.zero());
        Ride { of: self, begun, plan, machine, now: Timestamp::ZERO, zero }
    }

    /// Switches the faults of the machine as they are then. Returns the statuses that report one of their own.
    fn switch(&self, machine: &mut Machine, injections: &[Injection], ms: u64) -> Vec<&str> {
        let mut raised: Vec<&str> = Vec::new();
        for injection in injections {
            let is_there = injection.spells.iter().any(|(from, to)| (*from..*to).contains(&ms));
            match &self.causes[injection.fault] {
                Cause::Machine(name) => machine.set_fault(name, is_there),
                Cause::Status(name) if is_there => raised.push(name),
                Cause::Status(_) => {}
            }
        }
        raised
    }
}

impl machine::Machine for Simulated {
    fn name(&self) -> &'static str {
        match self.kind {
            Kind::Shuttle(_) => "shuttle",
            Kind::Robot => "robot",
        }
    }

    fn model(&self) -> &Arc<Model> {
        &self.loaded.model
    }

    fn faults(&self) -> &[Fault] {
        &self.faults
    }

    fn beginning(&self, place: Place) -> &History {
        &self.begun(place).history
    }

    fn history(&self, place: Place, injections: &[Injection], length_ms: u64) -> History {
        let begun = self.begun(place);
        let zero = begun.zero();
        let mut machine = begun.machine.clone();
        let mut ears = Ears::of(&self.loaded, Timestamp::ZERO);
        let mut history = History::new();
        let mut now = zero;
        while now.since(zero).as_millis() < length_ms {
            now = now + STEP;
            let ms = now.since(zero).as_millis();
            let raised = self.switch(&mut machine, injections, ms);
            let mut inputs = ears.hear(&mut machine, now, wall);
            for input in &mut inputs {
                if let Input::Diagnostics(array) = input
                    && array.iter().any(|status| raised.contains(&status.name()))
                {
                    *array = with_errors(array, &raised);
                }
            }
            history.push(Step { at: now, inputs });
        }
        history
    }
}

/// Lets a machine come to its place, with an operator who does what is to be done.
fn begin(kind: Kind, loaded: &Loaded, place: Place) -> anyhow::Result<Begun> {
    let stop =
        |(id, x_m): (&str, f64)| Stop { id: id.into(), name: Text::plain(id), x_m, y_m: 0.0, yaw_deg: 0.0 };
    let mut machine = Machine::along(kind, SEED, &loaded.model, &STOPS.map(stop), Timestamp::ZERO);
    let start = machine.clone();
    let mut orders = Vec::new();
    let (mut engine, mut ears) = listening(loaded, Timestamp::ZERO);
    let mut history = vec![Step { at: Timestamp::ZERO, inputs: publishers(&loaded.model).collect() }];
    let mut now = Timestamp::ZERO;
    let mut there_since = None;
    while there_since.is_none_or(|since: Timestamp| now.since(since).as_millis() < SETTLES_MS) {
        if now.since(Timestamp::ZERO).as_millis() >= COMES_WITHIN_MS {
            let snapshot = engine.snapshot();
            let roots: Vec<&str> =
                snapshot.roots.iter().map(|root| &**snapshot.node_name(root.node)).collect();
            bail!("the machine stays {} and does not come to its place: {roots:?}", snapshot.stage.as_str());
        }
        now = now + STEP;
        let mut inputs = ears.hear(&mut machine, now, wall);
        let snapshot = engine.snapshot();
        if let Kind::Shuttle(_) = kind {
            let (actions, order) = operate(&snapshot, place, now);
            inputs.extend(actions.into_iter().map(Input::Operator));
            if let Some(order) = order {
                machine.obey(order);
                orders.push((now, order));
            }
        }
        inputs.iter().for_each(|input| drop(engine.handle(input, now)));
        engine.handle(&Input::Tick, now);
        history.push(Step { at: now, inputs });
        let snapshot = engine.snapshot();
        let is_there = is_at(&snapshot, place);
        there_since = there_since.filter(|_| is_there).or(is_there.then_some(now));
    }
    Ok(Begun { start, machine, history, orders })
}

/// Whether it is at this place, with everything in order.
pub fn is_at(snapshot: &Snapshot, place: Place) -> bool {
    let moves = match snapshot.has_stages() {
        true => snapshot.stage == Stage::Active,
        false => snapshot.signals.iter().any(|(name, value)| &**name == "navigating" && *value == Some(true)),
    };
    let is_there = match place {
        Place::OnItsWay => moves,
        Place::AtAStop => !moves && (snapshot.stage == Stage::Standby || !snapshot.has_stages()),
    };
    is_there && snapshot.overall == State::Ok
}

/// What the operator of the shuttle does now, and what the shuttle is told of it.
fn operate(snapshot: &Snapshot, place: Place, now: Timestamp) -> (Vec<OperatorAction>, Option<Order>) {
    let (display_live, storage_ok) = (true, true);
    let is_whole_second = now.as_nanos().is_multiple_of(1_000_000_000);
    match snapshot.stage {
        Stage::Locked if is_whole_second => (vec![OperatorAction::Login { name: "operator".into() }], None),
        // Each time it is told where it is, it begins to look anew.
        Stage::Localizing if now == Timestamp::from_millis(4_000) => {
            let place = Where::Pose { x_m: STOPS[0].1, y_m: 0.0, yaw_deg: 0.0 };
            let pose = Pose { x_m: STOPS[0].1, qw: 1.0, ..Pose::default() };
            (vec![OperatorAction::Localize { place }], Some(Order::Localize(pose)))
        }
        Stage::Standby if place == Place::OnItsWay && snapshot.clearance_refusals.is_empty() => {
            let ask = OperatorAction::AskClearance { display_live, storage_ok };
            (vec![ask, OperatorAction::Clear { display_live, storage_ok }], Some(Order::Clear(true)))
        }
        _ => (Vec::new(), None),
    }
}

/// Some day in 2026: stamps are of the wall clock.
const EPOCH: Duration = Duration::from_secs(1_795_000_000);

fn wall(at: Timestamp) -> SystemTime {
    SystemTime::UNIX_EPOCH + EPOCH + Duration::from_nanos(at.as_nanos())
}

/// The same statuses, with these as ERROR.
fn with_errors(array: &StatusArray, raised: &[&str]) -> StatusArray {
    let mut changed = StatusArray::default().said_by(array.writer());
    for status in array.iter() {
        let (level, message) = match raised.contains(&status.name()) {
            true => (2, "A fault of its own"),
            false => (status.level(), status.message()),
        };
        changed.push_status(level, status.name(), message, status.hardware_id());
        status.values().for_each(|(key, value)| changed.push_value(key, value));
    }
    changed
}

/// The status that a module reports by.
fn status(module: &ModuleSpec) -> Option<&Arc<str>> {
    match &module.monitor {
        ModuleMonitor::SelfState(status) => Some(status),
        ModuleMonitor::Other(spec) => match &**spec {
            MonitorSpec::External { status, .. } => Some(status),
            _ => None,
        },
    }
}

/// What an ERROR of a module asks of the operator on the way.
fn urgency(model: &Model, id: &str) -> Option<u8> {
    let module = model.modules.iter().find(|module| &*module.id == id)?;
    let advice = module.help.as_ref()?.of(State::Error, Stage::Active)?;
    Some(match advice.urgency? {
        Urgency::BeReady => 1,
        Urgency::TakeOver => 2,
    })
}
