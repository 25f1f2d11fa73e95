//! Replacing the configuration while the vehicle runs: modules that stay keep their state.

use std::collections::HashMap;
use std::sync::Arc;

use super::Engine;
use super::event::What;
use super::measures::{By, Cause, Held};
use super::model::{Model, ModuleId, NodeId};
use super::node::ModuleKind;
use super::resume::DISCOVERY;
use super::snapshot::Reason;
use super::time::Timestamp;
use super::timers::TimerKey;
use super::vehicle::Event;
use super::views::Views;

impl Engine {
    /// Takes a new configuration as a whole. What keeps its name keeps its state: modules their
    /// reports and timers, root causes their age, alarms their numbers, signals their values. The
    /// operator and the stage stay.
    pub fn reload(&mut self, model: Arc<Model>, now: Timestamp) {
        self.advance(now);
        let mut next = Engine::build(model, self.now);
        next.vehicle = self.vehicle.clone();
        next.counters = self.counters;
        next.events = std::mem::take(&mut self.events);
        next.reception = std::mem::take(&mut self.reception);
        next.take_storage(self.storage_fault.take());
        next.take_display(self.display_late.take());
        next.told = std::mem::take(&mut self.told);
        next.active_by = self.active_by;
        next.timers.arm(TimerKey::Active, next.active_by);
        next.take_signals(self);
        // Topics that are new to the bridge have to be discovered, as after a start.
        next.search_until((self.now + DISCOVERY).max(self.watching.searching_until.unwrap_or(self.now)));
        next.watching.keep_topics(&self.watching);
        next.take_modules(self);
        if let Some(due) = next.reception.due() {
            next.timers.arm(TimerKey::Reception, due);
        }
        next.take_history(self);
        next.take_lead(self);
        next.settle();
        next.views.set_alarms(next.alarms.list());
        next.views.keep_since(&self.views);
        next.views.continue_from(&self.views);
        next.events.push(next.now, What::Reloaded);
        *self = next;
    }

    fn take_signals(&mut self, old: &Engine) {
        for index in 0..self.model.signals.len() {
            let spec = &self.model.signals[index];
            let before =
                old.model.signals.iter().position(|it| it.name == spec.name && it.source == spec.source);
            let Some(before) = before else { continue };
            self.signals.copy(index, &old.signals, before, self.now);
            if let Some(due) = self.signals.due(index, self.now) {
                self.timers.arm(TimerKey::Signal(index as u32), due);
            }
        }
        self.views.set_signals(&self.signals);
    }

    fn take_modules(&mut self, old: &Engine) {
        // Names that were discovered find their place again, by the new filters, in their old order.
        for (name, mut modules) in old.names.in_order() {
            let discovered = modules.any(|id| old.net.modules[id.0 as usize].kind == ModuleKind::Discovered);
            if discovered && self.names.find(name).is_none() {
                self.discover(name);
            }
        }
        let ids: HashMap<&str, ModuleId> = old.views.module_ids().collect();
        let kept: Vec<(ModuleId, ModuleId)> =
            self.views.module_ids().filter_map(|(name, id)| Some((id, *ids.get(name)?))).collect();
        for (id, before) in kept {
            let same = match (self.model.modules.get(id.0 as usize), old.model.modules.get(before.0 as usize))
            {
                (None, None) => true,
                (Some(spec), Some(before)) => {
                    let (watched, others) = (&self.model.watched, &old.model.watched);
                    spec.monitor.means_the_same(watched, &before.monitor, others)
                }
                _ => false,
            };
            if !same {
                continue;
            }
            self.watching.keep(id, &old.watching, before);
            self.net.modules[id.0 as usize].own = old.net.modules[before.0 as usize].own.clone();
            self.views.copy_report(id, &old.views, before);
        }
        self.resume_monitors();
    }

    fn take_history(&mut self, old: &Engine) {
        let names: HashMap<&str, NodeId> = self.views.nodes().map(|(node, name)| (name, node)).collect();
        let renamed = |node: NodeId| names.get(old.views.name(node)).copied();
        self.causes.copy_since(&old.causes, renamed);
        self.alarms.copy(&old.alarms, renamed);
        let accepted = old.warnings.accepted().filter_map(|id| renamed(NodeId::Module(id)));
        for node in accepted.collect::<Vec<_>>() {
            if let NodeId::Module(id) = node {
                self.warnings.expect(id);
            }
        }
        self.measures.keep(&old.measures, &old.model, &self.model);
        for held in old.measures.held() {
            let by = match held.by {
                By::Rule(index, node) => {
                    let rule = &old.model.driving.countermeasures[index];
                    renamed(node).and_then(|it| self.measures.rule(&self.model, it, rule)).unwrap_or(By::Past)
                }
                by => by,
            };
            let watched = if let By::Rule(_, node) = by { Some(node) } else { None };
            let still = |it: &&Cause| renamed(it.node).is_some() || it.present || !it.acknowledged;
            // Whoever knew of a cause that is gone does not know of what it left.
            let cause = |it: &Cause| match renamed(it.node) {
                Some(node) => Cause { node, ..*it },
                None => {
                    let node = self.stand_in(old.views.name(it.node), watched);
                    Cause { node, acknowledged: false, present: it.present }
                }
            };
            let causes = held.causes.iter().filter(still).map(cause).collect();
            self.measures.hold(Held { by, causes, ..held.clone() }, self.net.nobody());
        }
    }

    /// A clearance is for the vehicle as it was judged: another configuration withdraws it.
    fn take_lead(&mut self, old: &Engine) {
        let active = self.active_signal.map(|index| self.signals.value(index));
        self.vehicle.reload(self.model.stages, active);
        if self.model != old.model {
            self.vehicle.raise(Event::Reloaded);
        }
        if self.vehicle.stage != old.vehicle.stage {
            let (from, to) = (old.vehicle.stage, self.vehicle.stage);
            self.events.push(self.now, What::Stage { from, to });
        }
        self.stage_changed();
    }
}

impl Views {
    /// Takes over the words of a module from before a reload.
    pub(super) fn copy_report(&mut self, id: ModuleId, old: &Views, from: ModuleId) {
        let before = &old.modules[from.0 as usize];
        self.set_report(id, before.report.clone());
        if let Some(view) = self.modules.get_mut(id.0 as usize) {
            view.received = before.received;
        }
        if !std::mem::replace(&mut self.is_heard[id.0 as usize], true) {
            self.heard.push(id);
        }
    }

    /// What shows the same as before a reload has shown it since then.
    pub(super) fn keep_since(&mut self, old: &Views) {
        let before: HashMap<&str, NodeId> = old.nodes().map(|(node, name)| (name, node)).collect();
        let kept: Vec<(NodeId, NodeId)> =
            self.nodes().filter_map(|(node, name)| Some((node, *before.get(name)?))).collect();
        for (node, before) in kept {
            let masked = |views: &Views, node| matches!(views.reason(node), Some(Reason::Masked { .. }));
            let same_reason = masked(self, node) == masked(old, before);
            match (node, before) {
                (NodeId::Group(id), NodeId::Group(before)) => {
                    let before = &old.groups[before.0 as usize];
                    if let Some(view) = self.groups.get_mut(id.0 as usize)
                        && view.state == before.state
                        && same_reason
                    {
                        view.since = before.since;
                    }
                }
                (NodeId::Module(id), NodeId::Module(before)) => {
                    let before = &old.modules[before.0 as usize];
                    if let Some(view) = self.modules.get_mut(id.0 as usize)
                        && view.state == before.state
                        && same_reason
                    {
                        view.since = before.since;
                    }
                }
                _ => {}
            }
        }
    }

    /// Goes on counting where the views before a reload stopped, and keeps what they counted.
    pub(super) fn continue_from(&mut self, old: &Views) {
        self.seq = old.seq + 1;
        self.revision = old.revision + 1;
        self.reception = old.reception.clone();
    }
}
