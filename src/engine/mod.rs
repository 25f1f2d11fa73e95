//! The pure core: statuses, signals and operator actions in, snapshots out (`ENGINE.md`).
//!
//! No clock, no I/O, no async, no serde, no logging. Whoever feeds it says what time it is, and
//! asks [`Engine::next_deadline`] when to call again.

mod alarm;
mod causes;
pub mod filter;
pub mod graph;
pub mod input;
pub mod model;
mod module;
mod names;
mod net;
pub mod persistent;
mod signals;
pub mod snapshot;
pub mod state;
pub mod time;
mod timers;
mod vehicle;
mod views;

use std::sync::Arc;

use alarm::Alarms;
use causes::Causes;
use input::{Input, OperatorAction, ReceptionTrouble, Refusal, Response, Status, StatusArray};
use model::{ACTIVE_SIGNAL, GroupId, Model, ModuleId};
use names::{Claim, Names};
use net::Net;
use signals::Signals;
use snapshot::{Counters, Snapshot};
use time::Timestamp;
use timers::{TimerKey, Timers};
use vehicle::Vehicle;
use views::Views;

/// The aggregation engine of one vehicle.
#[derive(Debug)]
pub struct Engine {
    model: Arc<Model>,
    now: Timestamp,
    vehicle: Vehicle,
    signals: Signals,
    active_signal: Option<usize>,
    names: Names,
    net: Net,
    causes: Causes,
    alarms: Alarms,
    timers: Timers,
    counters: Counters,
    views: Views,
    /// Names of the array in hand, kept to save allocations.
    touched: Vec<u32>,
}

impl Engine {
    pub fn new(model: Arc<Model>, now: Timestamp) -> Engine {
        let signals = Signals::new(&model.signals);
        let mut engine = Engine {
            now,
            vehicle: Vehicle::new(model.stages),
            active_signal: signals.index(ACTIVE_SIGNAL),
            names: Names::new(&model),
            net: Net::new(model.clone()),
            causes: Causes::default(),
            alarms: Alarms::default(),
            timers: Timers::default(),
            counters: Counters::default(),
            views: Views::new(&model, now),
            touched: Vec::new(),
            signals,
            model,
        };
        engine.settle();
        engine
    }

    /// Takes one input at `now`; an instant before the last one counts as the last one. What time
    /// alone changed up to `now` happens first, each at its own instant.
    pub fn handle(&mut self, input: &Input, now: Timestamp) -> Response {
        self.advance(now);
        let mut response = Response::Done;
        match input {
            Input::Diagnostics(array) => self.take_array(array),
            Input::Signal { name, value } => self.take_signal(name, *value),
            Input::Reception(trouble) => self.take_trouble(trouble),
            Input::Operator(action) => response = self.operate(action),
            Input::Tick => return response,
        }
        self.settle();
        response
    }

    /// What everything shows now. Parts that did not change are shared with the snapshot before.
    pub fn snapshot(&mut self) -> Arc<Snapshot> {
        self.views.refresh_ages(&self.net);
        Arc::new(self.views.snapshot(self.now, &self.vehicle, self.counters))
    }

    /// Grows with every change of a state, a reason, a root cause, an alarm or the stage.
    pub fn seq(&self) -> u64 {
        self.views.seq
    }

    /// Grows with every change that a snapshot shows, words and values included.
    pub fn revision(&self) -> u64 {
        self.views.revision
    }

    /// When time alone may change something next: call [`Engine::handle`] with [`Input::Tick`] then.
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
        for (position, status) in array.iter().enumerate() {
            let Some(index) = self.names.find(status.name()).or_else(|| self.discover(status.name())) else {
                self.counters.dropped_names += 1;
                continue;
            };
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
            for position in 0..route.modules.len() {
                let module = self.names.routes[index as usize].modules[position];
                self.take_status(module, status);
            }
        }
        self.touched = touched;
    }

    fn take_status(&mut self, id: ModuleId, status: Status<'_>) {
        let policy =
            self.model.modules.get(id.0 as usize).map_or(&self.model.discovered, |spec| &spec.policy);
        let module = &mut self.net.modules[id.0 as usize];
        if module.own.report(status.state(), policy, self.now) {
            self.net.mark_module(id);
        }
        self.views.take_report(id, status, &self.model.limits);
    }

    fn discover(&mut self, name: &str) -> Option<u32> {
        let other = GroupId(self.model.groups.len() as u32);
        let Claim::Groups(groups) = self.names.claim(&self.model, name, other) else { return None };
        let mut modules = Vec::with_capacity(groups.len());
        for group in groups {
            modules.push(self.net.discover(group));
            self.views.discover(group, name, self.now);
        }
        Some(self.names.discovered(name, modules))
    }

    fn take_signal(&mut self, name: &str, value: bool) {
        let Some(index) = self.signals.index(name) else {
            self.counters.unknown_signals += 1;
            return;
        };
        let changed = self.signals.take(index, value, self.now);
        self.signal_changed(index, changed);
    }

    fn signal_changed(&mut self, index: usize, changed: bool) {
        if let Some(due) = self.signals.due(index).filter(|&due| due > self.now) {
            self.timers.arm(TimerKey::Signal(index as u32), due);
        }
        if !changed {
            return;
        }
        // An unknown Active changes no stage: the last word holds, and conditions on it are met.
        if let Some(value) = self.signals.value(index).filter(|_| Some(index) == self.active_signal) {
            self.vehicle.set_active(value);
        }
        self.net.mark_conditions(self.vehicle.stage);
        self.views.set_signals(&self.signals);
    }

    fn take_trouble(&mut self, trouble: &ReceptionTrouble) {
        self.views.take_trouble(trouble, self.now);
    }

    fn operate(&mut self, action: &OperatorAction) -> Response {
        let granted = match action {
            OperatorAction::Reset { module } => self.reset(module).map_err(|reason| vec![reason]),
            OperatorAction::Login { .. } | OperatorAction::Logout => self.vehicle.operate(action),
        };
        match granted {
            Ok(()) => {
                self.net.mark_conditions(self.vehicle.stage);
                Response::Done
            }
            Err(reasons) => Response::Refused(reasons),
        }
    }

    fn reset(&mut self, name: &str) -> Result<(), Refusal> {
        let id = self.views.module(name).ok_or_else(|| Refusal::NoSuchModule(name.into()))?;
        let own = &mut self.net.modules[id.0 as usize].own;
        if !own.latched() {
            return Err(Refusal::NotLatched(name.into()));
        }
        if !own.reset() {
            return Err(Refusal::StillInError(name.into()));
        }
        self.net.mark_module(id);
        Ok(())
    }

    /// Brings everything to what follows from what was marked, at the present instant.
    fn settle(&mut self) {
        self.net.evaluate(self.vehicle.stage, &self.signals, self.now);
        for id in self.net.rearm.drain(..) {
            let policy =
                self.model.modules.get(id.0 as usize).map_or(&self.model.discovered, |spec| &spec.policy);
            let own = &self.net.modules[id.0 as usize].own;
            if let Some(due) = own.due(policy, self.now) {
                self.timers.arm(TimerKey::Module(id.0), due);
            }
        }
        for change in std::mem::take(&mut self.net.changes) {
            self.causes.note(&self.net, &change);
            self.views.follow(&self.net, &change, self.now);
        }
        if let Some(explained) = self.causes.explain(&self.net, self.now) {
            let roots: Vec<_> = explained.roots.iter().map(|root| root.node).collect();
            self.views.set_causes(explained);
            let views = &self.views;
            if self.alarms.follow(&roots, |node| views.masked_by(node), self.now) {
                self.views.set_alarms(self.alarms.list());
            }
        }
        self.views.settle(&self.vehicle, &self.net);
    }
}
