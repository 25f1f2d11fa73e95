//! Keyframes: the whole state of an engine as data. Together with its configuration, another engine goes on from
//! it exactly as the first one did.
//!
//! A keyframe has what cannot be computed: own states with their times, windows, deadlines, alarms, texts. What
//! follows from the configuration or from these states is made again by the same code as always, so a damaged
//! keyframe cannot contradict itself.

mod fit;

use std::sync::Arc;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer, Serialize};

use super::Engine;
use super::discovery::WriterList;
use super::event::Events;
pub use super::files::KeyframeError;
use super::lookalikes::COMPARISONS_MAX;
use super::mask::kept::KeptNet;
use super::mask::net::Change;
use super::mask::node::{ModuleKind, UNSEEN};
use super::membership::Departed;
use super::model::{GroupId, Model, ModuleId, NodeId, Stage, StageModel};
use super::module::contradictions::Disputes;
use super::module::names::kept::KeptNames;
use super::module::overflow::Overflow;
use super::module::system::ReceptionCheck;
use super::monitor::feeds::Watching;
use super::motion::MotionState;
use super::react::alarms::Alarms;
use super::react::held::Countermeasures;
use super::react::shelves::Shelves;
use super::react::warnings::Warnings;
use super::signals::Signals;
use super::snapshot::{Counters, Localization};
use super::stage::advance::VehicleFaults;
use super::stage::machine::Vehicle;
use super::time::Timestamp;
use super::timers::{KeptTimer, TimerKey, Timers};
use super::view::views::kept::KeptViews;

/// The format of keyframes. It grows when an older program could not read a new one, or the reverse.
const FORMAT: u32 = 1;

/// The whole state of an engine at one instant. Times are nanoseconds on the engine's clock.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Keyframe {
    #[serde(deserialize_with = "known_format")]
    format: u32,
    /// Distinguishes configurations by their names.
    configuration: String,
    state: Kept,
}

fn known_format<'de, D: Deserializer<'de>>(from: D) -> Result<u32, D::Error> {
    let format = u32::deserialize(from)?;
    if format != FORMAT {
        let what = format!("the keyframe has format {format}; this program reads format {FORMAT}");
        return Err(D::Error::custom(what));
    }
    Ok(format)
}

/// The state of the [`Engine`], by its fields.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Kept {
    now: Timestamp,
    stage: Stage,
    operator: Option<Arc<str>>,
    localization: Localization,
    drove: bool,
    signals: Signals,
    motion: MotionState,
    names: KeptNames,
    net: KeptNet,
    /// When each root cause began.
    causes: Vec<(NodeId, Timestamp)>,
    alarms: Alarms,
    warnings: Warnings,
    shelves: Shelves,
    countermeasures: Countermeasures,
    vehicle_faults: VehicleFaults,
    active_by: Timestamp,
    vehicle_changed: bool,
    timers: Vec<KeptTimer>,
    overflow: Overflow,
    departed: Departed,
    watching: Watching,
    reception: ReceptionCheck,
    writers: WriterList,
    disputes: Disputes,
    reports_cut: bool,
    dds_fault: Option<Box<str>>,
    counters: Counters,
    events: Events,
    views: KeptViews,
    comparisons: u32,
}

impl Keyframe {
    /// The time of the state.
    pub fn at(&self) -> Timestamp {
        self.state.now
    }
}

impl Engine {
    /// The whole state as data, for [`Engine::from_keyframe`]. It may take long: make it of a clone.
    pub fn keyframe(&self) -> Keyframe {
        // A new field has to be kept, or to be named here with the reason why it need not be.
        let Engine {
            model,
            now,
            vehicle: Vehicle { model: _, stage, operator, localization, drove },
            signals,
            motion,
            names,
            net,
            causes,
            alarms,
            warnings,
            shelves,
            countermeasures,
            vehicle_faults,
            active_by,
            vehicle_changed,
            timers,
            overflow,
            departed,
            watching,
            reception,
            writers,
            disputes,
            reports_cut,
            dds_fault,
            counters,
            events,
            views,
            comparisons,
            // About one input, which is over.
            held_back: _,
            // From the configuration.
            active_signal: _,
            goal_signal: _,
            localization_group: _,
            restricted: _,
            // From the own states, the stage and the alarms.
            asks: _,
            // About one array, which is over.
            touched: _,
            // Found again with the next search.
            hidden_unexplained: _,
        } = self;
        let state = Kept {
            now: *now,
            stage: *stage,
            operator: operator.clone(),
            localization: *localization,
            drove: *drove,
            signals: signals.clone(),
            motion: motion.clone(),
            names: names.kept(net.fixed()),
            net: net.kept(),
            causes: causes.since(),
            alarms: alarms.clone(),
            warnings: warnings.clone(),
            shelves: shelves.clone(),
            countermeasures: countermeasures.clone(),
            vehicle_faults: vehicle_faults.clone(),
            active_by: *active_by,
            vehicle_changed: *vehicle_changed,
            timers: timers.kept(),
            overflow: overflow.clone(),
            departed: departed.clone(),
            watching: watching.clone(),
            reception: reception.clone(),
            writers: writers.clone(),
            disputes: disputes.clone(),
            reports_cut: *reports_cut,
            dds_fault: dds_fault.clone(),
            counters: *counters,
            events: events.clone(),
            views: views.kept(net.fixed()),
            comparisons: *comparisons,
        };
        Keyframe { format: FORMAT, configuration: fit::fingerprint(model), state }
    }

    /// Goes on from a keyframe, under the configuration under which it was made. For another configuration,
    /// [`Engine::reload`] it afterwards.
    ///
    /// # Errors
    ///
    /// If the keyframe is of another configuration, or damaged.
    pub fn from_keyframe(model: Arc<Model>, keyframe: &Keyframe) -> Result<Engine, KeyframeError> {
        if keyframe.configuration != fit::fingerprint(&model) {
            return Err(KeyframeError::new("the keyframe is of another configuration"));
        }
        let kept = keyframe.state.clone();
        let mut engine = Engine::build(model, kept.now);
        engine.vehicle.stage = kept.stage;
        engine.vehicle.operator = kept.operator;
        engine.vehicle.localization = kept.localization;
        engine.vehicle.drove = kept.drove;
        if engine.vehicle.model == StageModel::None && kept.stage != Stage::Active {
            return Err(KeyframeError::new("a machine without stages is always active"));
        }
        engine.signals.resume(kept.signals)?;
        engine.motion = kept.motion;
        engine.net.resume(kept.net, kept.views.members())?;
        engine.views.resume_names(&kept.views, &engine.net, kept.now)?;
        let net = &engine.net;
        let kind = |id: ModuleId| net.modules.get(id.0 as usize).map(|module| module.kind);
        engine.names.resume(kept.names, |id| kind(id) == Some(ModuleKind::Discovered))?;
        engine.overflow = kept.overflow;
        engine.departed = kept.departed;
        engine.check_modules()?;
        engine.alarms = kept.alarms;
        engine.warnings = kept.warnings;
        engine.shelves = kept.shelves;
        engine.countermeasures.resume(kept.countermeasures)?;
        engine.watching.resume(kept.watching)?;
        engine.timers = Timers::resume(kept.timers, |key| engine.knows(key))?;
        engine.vehicle_faults = kept.vehicle_faults;
        engine.active_by = kept.active_by;
        engine.reception = kept.reception;
        engine.writers = kept.writers;
        engine.disputes = kept.disputes;
        engine.reports_cut = kept.reports_cut;
        engine.dds_fault = kept.dds_fault;
        engine.counters = kept.counters;
        engine.events = kept.events;
        engine.comparisons = kept.comparisons.min(COMPARISONS_MAX);
        engine.check_nodes()?;
        engine.judge_again(&kept.causes)?;
        engine.views.resume_times(kept.views);
        engine.vehicle_changed = kept.vehicle_changed;
        Ok(engine)
    }

    /// Whether the modules that stand for dropped names, and those that left, are such.
    fn check_modules(&self) -> Result<(), KeyframeError> {
        let of_group = |group: GroupId| self.net.groups.get(group.0 as usize)?.overflow;
        let counted = self.overflow.groups().filter(|&(group, id, _)| of_group(group) == Some(id)).count();
        let all = self.net.groups.iter().filter(|group| group.overflow.is_some()).count();
        if counted != all || self.overflow.groups().count() != all {
            return Err(KeyframeError::new("the counts of dropped names do not fit the modules"));
        }
        if !self.departed.is_sound(&self.net) {
            return Err(KeyframeError::new("a module has left that is there"));
        }
        Ok(())
    }

    /// Whether every node that anything refers to exists.
    fn check_nodes(&self) -> Result<(), KeyframeError> {
        let exists = |node: NodeId| match node {
            NodeId::Group(id) => (id.0 as usize) < self.net.groups.len(),
            NodeId::Module(id) => (id.0 as usize) < self.net.modules.len(),
        };
        let named = self.alarms.nodes().chain(self.warnings.nodes()).chain(self.countermeasures.nodes());
        let named = named.chain(self.shelves.nodes());
        match named.chain(self.events.nodes()).find(|&node| !exists(node)) {
            Some(node) => Err(KeyframeError::new(format!("there is no {node:?}"))),
            None => Ok(()),
        }
    }

    /// Whether the owner of a deadline exists.
    fn knows(&self, key: TimerKey) -> bool {
        let (index, count) = match key {
            TimerKey::Signal(index) => (index, self.model.signals.len()),
            TimerKey::Module(index) => (index, self.net.modules.len()),
            TimerKey::Group(index) => (index, self.net.groups.len()),
            TimerKey::Monitor(index) => (index, self.watching.watches.len()),
            TimerKey::Reception
            | TimerKey::Disputes
            | TimerKey::Localization
            | TimerKey::Countermeasures
            | TimerKey::Active
            | TimerKey::Searched
            | TimerKey::Motion
            | TimerKey::Shelves => return true,
        };
        (index as usize) < count
    }

    /// Computes everything that follows from the own states of the modules, at the present instant.
    fn judge_again(&mut self, causes: &[(NodeId, Timestamp)]) -> Result<(), KeyframeError> {
        self.net.mark_conditions(self.vehicle.stage);
        self.net.evaluate(self.vehicle.stage, &self.signals, self.now);
        if !self.net.left.is_empty() || !self.net.forgotten.is_empty() {
            return Err(KeyframeError::new("a report expired before the keyframe and still counts"));
        }
        // The deadlines of the keyframe are those that were armed.
        self.net.graces.clear();
        self.net.rearm.clear();
        for change in std::mem::take(&mut self.net.changes) {
            self.causes.note(&self.net, &change);
        }
        for node in NodeId::all(self.net.groups.len(), self.net.modules.len()) {
            let change = Change { node, before: UNSEEN, after: self.net.node(node).facts };
            self.views.follow(&self.net, &change, self.now);
            self.asks.note(&self.net, &change, |id| self.views.help(id).is_some());
        }
        self.causes.set_since(causes);
        if let Some(explained) = self.causes.explain(&self.net, self.now) {
            self.views.set_causes(explained);
        }
        self.views.set_alarms(self.alarms.list());
        self.views.set_signals(&self.signals);
        self.views.set_motion(self.motion.shown());
        self.vehicle_changed = true;
        self.follow_urgency();
        self.show_vehicle();
        self.views.settle(&self.vehicle, &self.net);
        Ok(())
    }
}
