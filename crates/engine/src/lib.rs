//! The pure core: statuses, signals and operator actions in, snapshots out.
//!
//! No clock, no I/O, no async, no file format, no logging. The caller passes the time, and asks
//! [`Engine::next_deadline`] when to call again. Inputs and the state derive serde's traits, so that a caller can
//! record them.

pub mod action;
mod counters;
mod dds_down;
pub mod discovery;
pub mod event;
mod files;
pub mod input;
mod judgement;
pub mod keyframe;
mod layout;
mod lookalikes;
pub mod mask;
mod membership;
pub mod model;
pub mod module;
pub mod monitor;
mod motion;
pub mod pace;
pub mod persistent;
pub mod react;
pub mod restart;
mod signals;
pub mod snapshot;
pub mod stage;
pub mod state;
pub mod text;
pub mod time;
mod timers;
pub mod view;

use std::collections::HashSet;
use std::sync::Arc;

use discovery::{WriterId, WriterList};
use event::{Event, Events};
use input::{FleetFault, Input, ReceptionTrouble, Response, Status, StatusArray};
use judgement::Received;
use mask::causes::Causes;
use mask::net::Net;
use membership::Departed;
use model::{ACTIVE_SIGNAL, GOAL_SIGNAL, GroupId, Model, ModuleId, NodeId};
use module::contradictions::Disputes;
use module::names::Names;
use module::overflow::Overflow;
use module::system::{self, ReceptionCheck, SystemCheck};
use module::writers::WriterReport;
use monitor::feeds::Watching;
use motion::MotionState;
use react::alarms::Alarms;
use react::held::Countermeasures;
use react::shelves::Shelves;
use react::urgency::Asks;
use react::warnings::Warnings;
use signals::Signals;
use snapshot::{Counters, Snapshot};
use stage::advance::{VehicleFaults, localization_group};
use stage::machine::Vehicle;
use state::State;
use text::Text;
use time::{Span, Timestamp};
use timers::{TimerKey, Timers};
use view::views::Views;

/// The aggregation engine of one vehicle. A clone is a complete engine of its own, from which a replay or a
/// second configuration goes on: it shares model, reports and snapshots, and copies the states.
#[derive(Debug, Clone)]
pub struct Engine {
    model: Arc<Model>,
    now: Timestamp,
    vehicle: Vehicle,
    signals: Signals,
    motion: MotionState,
    active_signal: Option<usize>,
    goal_signal: Option<usize>,
    localization_group: Option<GroupId>,
    names: Names,
    net: Net,
    causes: Causes,
    alarms: Alarms,
    warnings: Warnings,
    shelves: Shelves,
    asks: Asks,
    countermeasures: Countermeasures,
    vehicle_faults: VehicleFaults,
    /// After a start, the time until which no component has to report whether the vehicle drives.
    active_by: Timestamp,
    /// Something changed that the stage or a request may depend on.
    vehicle_changed: bool,
    timers: Timers,
    overflow: Overflow,
    departed: Departed,
    watching: Watching,
    reception: ReceptionCheck,
    /// The writers of statuses with their nodes.
    writers: WriterList,
    disputes: Disputes,
    /// Some module accepts its status only from certain writers.
    restricted: bool,
    /// Whether the module `telltale/memory` reports cut texts at present.
    reports_cut: bool,
    /// The reason why nothing is received over DDS.
    dds_fault: Option<Box<str>>,
    counters: Counters,
    events: Events,
    views: Views,
    /// Routes of the present array, kept to save allocations.
    touched: Vec<u32>,
    /// Names of the present array that some group takes only from another node, or from a known one.
    held_back: HashSet<Arc<str>>,
    /// The remaining comparisons of new names with configured ones.
    comparisons: u32,
    /// A module in ERROR that was masked without a cause that explains it, after the last search.
    hidden_unexplained: Option<ModuleId>,
}

impl Engine {
    pub fn new(model: Arc<Model>, now: Timestamp) -> Engine {
        let mut engine = Engine::build(model, now);
        engine.settle();
        engine
    }

    /// Builds all parts; nothing is judged yet.
    fn build(model: Arc<Model>, now: Timestamp) -> Engine {
        let signals = Signals::new(&model.signals);
        let mut engine = Engine {
            now,
            vehicle: Vehicle::new(model.stages),
            motion: MotionState::default(),
            active_signal: signals.index(ACTIVE_SIGNAL),
            goal_signal: signals.index(GOAL_SIGNAL),
            localization_group: localization_group(&model),
            names: Names::new(&model),
            net: Net::new(model.clone(), now),
            causes: Causes::default(),
            alarms: Alarms::default(),
            warnings: Warnings::default(),
            shelves: Shelves::default(),
            asks: Asks::default(),
            countermeasures: Countermeasures::new(&model),
            vehicle_faults: VehicleFaults::default(),
            active_by: now,
            vehicle_changed: true,
            timers: Timers::default(),
            overflow: Overflow::default(),
            departed: Departed::default(),
            watching: Watching::new(&model),
            reception: ReceptionCheck::default(),
            writers: WriterList::default(),
            disputes: Disputes::default(),
            restricted: model.restricts_writers(),
            reports_cut: false,
            dds_fault: None,
            counters: Counters::default(),
            events: Events::default(),
            views: Views::new(&model, now),
            touched: Vec::new(),
            held_back: HashSet::new(),
            comparisons: lookalikes::COMPARISONS_MAX,
            hidden_unexplained: None,
            signals,
            model,
        };
        engine.signals.posed = engine.vehicle.posed();
        for check in SystemCheck::ALL {
            engine.report_on_self(check, State::Ok, "");
        }
        engine
    }

    /// Takes one input at `now`; an instant before the last one counts as the last one. Deadlines up to `now`
    /// act first, each at its own instant.
    pub fn handle(&mut self, input: &Input, now: Timestamp) -> Response {
        self.advance(now);
        let mut response = Response::Done;
        match input {
            Input::Diagnostics(array) => {
                self.net.late = array.late();
                self.take_array(array);
                self.net.late = Span::ZERO;
            }
            Input::Writers(list) => self.take_writers(list),
            Input::Signal { name, value } => self.take_signal(name, *value),
            Input::Reception(trouble) => self.take_trouble(trouble),
            Input::Aggregator { other } => {
                self.take_fault(SystemCheck::Aggregator, other.as_deref().map(system::other_aggregator));
            }
            Input::Voices { other } => {
                self.take_voices(other.as_deref());
            }
            Input::Nodes { repeated } => {
                self.take_fault(SystemCheck::Nodes, repeated.as_deref().map(system::repeated_nodes));
            }
            Input::Storage { fault } => {
                self.take_fault(SystemCheck::Storage, fault.as_deref().map(Text::from))
            }
            Input::Display { late } => {
                self.take_fault(SystemCheck::Display, late.as_deref().map(system::display_late));
            }
            Input::Dds { fault } => self.take_dds(fault.clone()),
            Input::Upkeep(upkeep) => {
                self.take_fault(SystemCheck::Clock, upkeep.clock.clone());
                self.take_fault(SystemCheck::Certificate, upkeep.certificate.clone());
                self.take_fault(SystemCheck::Recording, upkeep.recording.clone());
                self.take_fleet(upkeep.fleet.as_ref());
            }
            // Nearly every message repeats the one before; then there is nothing to settle.
            Input::Sample(sample) if !self.take_watched(Received::Sample(sample)) => return response,
            Input::Topic(news) if !self.take_watched(Received::Topic(news)) => return response,
            Input::Probe(probe) if !self.take_watched(Received::Probe(probe)) => return response,
            Input::Sample(_) | Input::Topic(_) | Input::Probe(_) => {}
            Input::Output(news) => self.take_output(news),
            Input::Listened(news) => self.take_listeners(news),
            Input::Operator(action) => response = self.operate(action),
            Input::Tick => return response,
        }
        self.settle();
        response
    }

    /// The present state of everything. Unchanged parts are shared with the snapshot before.
    pub fn snapshot(&mut self) -> Arc<Snapshot> {
        self.views.refresh_ages(&self.net);
        let counters = Counters {
            cut_statuses: self.views.budget.cut() as u64,
            status_bytes: self.views.budget.total(),
            ..self.counters
        };
        Arc::new(self.views.snapshot(self.now, &self.vehicle, self.motion.driven_m(), counters))
    }

    /// The time of the last input.
    pub fn now(&self) -> Timestamp {
        self.now
    }

    /// Grows with every change of a state, a reason, a root cause, an alarm or the stage.
    pub fn seq(&self) -> u64 {
        self.views.seq
    }

    /// Grows with every change that a snapshot shows, words and values included.
    pub fn revision(&self) -> u64 {
        self.views.revision
    }

    /// Keeps events from now on, for [`Engine::take_events`].
    pub fn keep_events(&mut self) {
        self.events.keep();
    }

    /// The events since the last call, in order. Of more than 65,536 the oldest are gone. The index of a module
    /// that left is not used again while an event names it: a run is repeated exactly only if its events are taken
    /// after the same inputs.
    pub fn take_events(&mut self) -> Vec<Event> {
        self.events.take()
    }

    /// The next instant at which time alone may change something: call [`Engine::handle`] with [`Input::Tick`]
    /// then.
    pub fn next_deadline(&self) -> Option<Timestamp> {
        self.timers.next()
    }

    fn advance(&mut self, now: Timestamp) {
        while let Some((due, key)) = self.timers.pop(now) {
            self.now = self.now.max(due);
            self.fire(key);
            while let Some((_, key)) = self.timers.pop(self.now) {
                self.fire(key);
            }
            self.settle();
        }
        self.now = self.now.max(now);
    }

    fn fire(&mut self, key: TimerKey) {
        match key {
            TimerKey::Module(index) => self.net.mark_module(ModuleId(index)),
            TimerKey::Group(index) => self.net.mark_leave(GroupId(index)),
            TimerKey::Reception => self.judge_reception(),
            TimerKey::Disputes => self.judge_disputes(),
            // `settle` evaluates them.
            TimerKey::Localization | TimerKey::Countermeasures | TimerKey::Active | TimerKey::Searched => {
                self.vehicle_changed = true;
            }
            TimerKey::Motion | TimerKey::Shelves => {}
            TimerKey::Monitor(index) => {
                self.judge_monitor(index, false);
            }
            TimerKey::Signal(index) => {
                let changed = self.signals.refresh(index as usize, self.now);
                self.signal_changed(index as usize, changed);
            }
        }
    }

    fn take_array(&mut self, array: &StatusArray) {
        self.counters.arrays += 1;
        self.counters.statuses += array.len() as u64;
        let number = self.counters.arrays;
        let mut touched = std::mem::take(&mut self.touched);
        self.held_back.clear();
        let mut before = None;
        for (position, status) in array.iter().enumerate() {
            let known = self.names.find_behind(before, status.name());
            if known.is_none() && self.names.is_dropped(status.name()) {
                continue;
            }
            before = known.filter(|&index| !self.may_grow(index)).or_else(|| {
                let report = WriterReport { writer: array.writer(), state: status.state(), at: self.now };
                self.discover_heard(status.name(), report)
            });
            let Some(index) = before else { continue };
            let route = &mut self.names.routes[index as usize];
            if route.array != number {
                route.array = number;
                route.position = position as u32;
                touched.push(index);
            } else if status.state() > array.get(route.position as usize).state() {
                route.position = position as u32;
            }
        }
        for index in touched.drain(..) {
            let route = &self.names.routes[index as usize];
            let status = array.get(route.position as usize);
            let report = WriterReport { writer: array.writer(), state: status.state(), at: self.now };
            if self.restricts(index) || !self.names.routes[index as usize].writer_reports.take_alone(report) {
                self.take_disputed(index, status, report, number);
                continue;
            }
            let mut position = 0;
            while let Some(module) = self.names.routes[index as usize].module(position) {
                self.take_status(module, status, report.writer);
                position += 1;
            }
        }
        self.touched = touched;
        self.take_keys(array, number);
    }

    /// Whether a known name may feed further modules, or is to be held against someone.
    fn may_grow(&self, route: u32) -> bool {
        self.names.may_grow(route) || self.restricted && self.names.is_lacking(route)
    }

    fn take_status(&mut self, id: ModuleId, status: Status<'_>, source: WriterId) {
        if self.net.report(id, status.state(), self.now) {
            self.net.mark_module(id);
        }
        self.views.take_report(id, status, source, &self.model.limits);
    }

    fn take_trouble(&mut self, trouble: &ReceptionTrouble) {
        self.views.take_trouble(trouble, self.now);
        self.reception.take(trouble, self.now);
        self.judge_reception();
    }

    fn judge_reception(&mut self) {
        let state = self.reception.state(self.now);
        if let Some(due) = self.reception.due() {
            self.timers.arm(TimerKey::Reception, due);
        }
        self.report_on_self(SystemCheck::Reception, state, self.reception.message.clone());
    }

    /// Takes a fault of Telltale itself, or its end.
    fn take_fault(&mut self, check: SystemCheck, fault: Option<Text>) {
        let state = if fault.is_some() { State::Warning } else { State::Ok };
        self.report_on_self(check, state, fault.unwrap_or_default());
    }

    fn take_fleet(&mut self, fault: Option<&FleetFault>) {
        let state = fault.map_or(State::Ok, |it| if it.is_error { State::Error } else { State::Warning });
        let words = fault.map_or_else(Text::default, |it| it.text.clone());
        self.report_on_self(SystemCheck::Fleet, state, words);
    }

    /// Reports the state of one of Telltale's own modules. One that was left out comes back with its first fault.
    fn report_on_self(&mut self, check: SystemCheck, state: State, message: impl Into<Text>) {
        let id = self.net.system_module(check);
        if self.is_left_out(id) && !self.take_back(id, state) {
            return;
        }
        if self.net.report(id, state, self.now) {
            self.net.mark_module(id);
        }
        self.views.set_message(id, message.into());
    }

    /// Evaluates everything that was marked, at the present instant.
    fn settle(&mut self) {
        self.say_cut();
        let mut causes_changed = self.follow_changes();
        while self.turn_monitors() || self.count_members() || self.follow_vehicle() {
            causes_changed |= self.follow_changes();
        }
        if let Some(breach) = self.breach() {
            self.report_on_self(SystemCheck::Invariants, State::Error, &*breach);
            causes_changed |= self.follow_changes();
        }
        self.show_motion();
        let unshelved = self.end_shelving();
        // Only now all states are final: a module that is given time from now on calls nobody.
        if self.release_awaited_alarms() || causes_changed || unshelved {
            self.follow_alarms();
        }
        self.follow_urgency();
        if let Some(node) = self.under_asked() {
            let what = format!("{} asks for more than the instruction says", self.views.name(node));
            self.report_on_self(SystemCheck::Invariants, State::Error, what);
            if self.follow_changes() {
                self.follow_alarms();
            }
            self.follow_urgency();
        }
        self.show_vehicle();
        self.views.settle(&self.vehicle, &self.net);
    }

    /// Follows the states that changed. Returns whether the root causes, or what they explain, changed.
    fn follow_changes(&mut self) -> bool {
        self.evaluate();
        for (GroupId(index), until) in self.net.graces.drain(..) {
            self.timers.arm(TimerKey::Group(index), until);
        }
        for id in self.net.rearm.drain(..).collect::<Vec<_>>() {
            let due = self.net.modules[id.0 as usize].own.due(self.net.policy(id), self.now);
            if let Some(due) = due {
                self.timers.arm(TimerKey::Module(id.0), due);
            }
        }
        self.remove_departed();
        let changes = std::mem::take(&mut self.net.changes);
        for change in &changes {
            self.causes.note(&self.net, change);
            self.countermeasures.note(change);
            self.vehicle_changed |= self.warnings.note(&self.net, change);
            self.asks.note(&self.net, change, |id| self.views.help(id).is_some());
            self.views.follow(&self.net, change, self.now);
            if let NodeId::Module(id) = change.node {
                self.watching.note_relevance(id, change.after.relevant);
            }
        }
        let explained = self.causes.explain(&self.net, self.now);
        if explained.is_some() {
            self.hidden_unexplained = self.net.masked_unexplained(self.now);
        }
        let mut blamed = Vec::new();
        let changed = explained.is_some_and(|explained| {
            if self.events.wanted() {
                blamed = self.views.changed_causes(&explained.masked, &changes);
            }
            self.views.set_causes(explained)
        });
        if self.events.wanted() {
            self.keep_changes(&changes, blamed);
        }
        // The empty list is handed back, so that its memory is used again.
        self.net.changes = changes;
        self.net.changes.clear();
        changed || self.alarms.active() != self.views.alarm_count(&self.shelves)
    }

    /// A contradiction between shown states: a fault of this program, never of the vehicle.
    fn breach(&self) -> Option<String> {
        if let Some(node) = self.views.masked_by_nothing() {
            return Some(format!("{node} is hidden and nothing explains it"));
        }
        if let Some(node) = self.views.masked_root() {
            return Some(format!("{node} is a root cause and hidden"));
        }
        if let Some(id) = self.hidden_unexplained {
            let node = self.views.name(NodeId::Module(id));
            return Some(format!("{node} is in ERROR and hidden, and no cause explains it"));
        }
        (self.net.own_errors > 0 && self.views.root_count() == 0).then(|| match self.net.own_errors {
            1 => "1 module is in ERROR and is not shown".to_owned(),
            count => format!("{count} modules are in ERROR and none is shown"),
        })
    }
}
