//! Replaces the configuration while the vehicle runs: modules that stay keep their state.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use crate::Engine;
use crate::discovery::DISCOVERY;
use crate::event::EventKind;
use crate::mask::node::ModuleKind;
use crate::model::{GroupId, Model, ModuleId, NodeId, Stage};
use crate::module::names::Names;
use crate::module::names::NewModule;
use crate::module::overflow;
use crate::react::held::{HeldRequest, RequestCause, RequestOrigin};
use crate::signals::driving_word::ARRIVAL;
use crate::snapshot::Reason;
use crate::stage::machine::StageEvent;
use crate::time::Timestamp;
use crate::timers::TimerKey;
use crate::view::views::Views;

impl Engine {
    /// Takes a complete new configuration. Nodes that keep their names keep their state: modules their reports
    /// and timers, root causes their age, alarms their numbers, signals their values. The operator and the
    /// stage stay.
    pub fn reload(&mut self, model: Arc<Model>, now: Timestamp) {
        self.advance(now);
        let mut next = Engine::build(model, self.now);
        next.vehicle = self.vehicle.clone();
        next.counters = self.counters;
        next.events = std::mem::take(&mut self.events);
        next.reception = std::mem::take(&mut self.reception);
        let dds_fault = self.dds_fault.take();
        next.vehicle_faults = std::mem::take(&mut self.vehicle_faults);
        next.reports_cut = self.reports_cut;
        next.active_by = self.active_by;
        next.timers.arm(TimerKey::Active, next.active_by);
        next.take_signals(self);
        next.keep_motion(self);
        // New topics have to be discovered first, as after a start.
        next.search_until((self.now + DISCOVERY).max(self.watching.searching_until.unwrap_or(self.now)));
        next.watching.keep_topics(&self.watching);
        next.writers = std::mem::take(&mut self.writers);
        next.take_modules(self);
        if dds_fault.is_some() {
            next.take_dds(dds_fault);
        }
        next.names.keep_writer_reports(&self.names);
        next.keep_dropped(self);
        next.keep_disputes(self);
        if let Some(due) = next.reception.due() {
            next.timers.arm(TimerKey::Reception, due);
        }
        next.take_history(self);
        next.take_vehicle(self);
        next.settle();
        next.views.set_alarms(next.alarms.list());
        next.views.keep_since(&self.views);
        next.views.continue_from(&self.views);
        next.events.push(next.now, EventKind::Reloaded);
        *self = next;
    }

    fn take_signals(&mut self, old: &Engine) {
        for index in 0..self.model.signals.len() {
            let spec = &self.model.signals[index];
            let (watched, others) = (&self.model.watched, &old.model.watched);
            let before = old.model.signals.iter().position(|it| {
                it.name == spec.name && spec.source.means_the_same(watched, &it.source, others)
            });
            let Some(before) = before else { continue };
            self.watching.keep_condition(index, &old.watching, before);
            self.signals.copy(index, &old.signals, before, self.now);
            if let Some(due) = self.signals.due(index, self.now) {
                self.timers.arm(TimerKey::Signal(index as u32), due);
            }
        }
        self.views.set_signals(&self.signals);
    }

    fn take_modules(&mut self, old: &Engine) {
        // Discovered names are matched against the new filters, in their old order.
        self.take_overflow(old);
        for (name, modules) in old.names.in_order() {
            let modules: Vec<ModuleId> = modules.collect();
            let mut kinds = modules.iter().map(|id| old.net.modules[id.0 as usize].kind);
            if kinds.any(|kind| kind == ModuleKind::Discovered)
                && self.names.find(name).is_none_or(|route| self.names.is_lacking(route))
            {
                self.discover_but(name, &self.groups_without(old, name, &modules));
            }
        }
        self.leave_out(old);
        let groups: HashMap<&str, GroupId> = old.views.paths().map(|(id, path)| (path, id)).collect();
        for (id, path) in self.views.paths() {
            let before = groups.get(path).map(|before| old.net.groups[before.0 as usize].relevant_since);
            self.net.groups[id.0 as usize].relevant_since = before.flatten();
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
            if let Some(spec) = self.model.modules.get(id.0 as usize) {
                self.watching.keep(id, &spec.policy, &old.watching, before);
            }
            self.net.modules[id.0 as usize].own = old.net.modules[before.0 as usize].own.clone();
            let arrival = old.net.modules[before.0 as usize].arrival;
            self.net.modules[id.0 as usize].arrival = arrival;
            self.net.arrivals = self.net.arrivals.max(arrival);
            self.views.copy_report(id, &old.views, before);
        }
        self.resume_monitors();
    }

    /// Groups with dropped names keep that warning, unless the limit was raised: then all names are matched
    /// again.
    fn take_overflow(&mut self, old: &Engine) {
        if self.model.limits.discovered_modules > old.model.limits.discovered_modules {
            return;
        }
        let mut refused: Vec<_> = old.overflow.groups().collect();
        refused.sort_unstable_by_key(|(_, module, _)| old.net.modules[module.0 as usize].arrival);
        for (group, _, count) in refused {
            let Some(group) = self.same_group(old, group) else { continue };
            let module = self.make(&NewModule::of(group), ModuleKind::Overflow, overflow::MODULE);
            self.overflow.keep(group, module, count);
        }
    }

    /// Names that were counted as dropped are not counted again, unless the limit was raised.
    fn keep_dropped(&mut self, old: &Engine) {
        if self.model.limits.discovered_modules <= old.model.limits.discovered_modules {
            let groups: HashMap<GroupId, GroupId> = (0..old.net.groups.len() as u32)
                .map(GroupId)
                .filter_map(|group| Some((group, self.same_group(old, group)?)))
                .collect();
            self.names.keep_dropped(&old.names, |group| groups.get(&group).copied());
        }
    }

    /// Groups that claim the name and have no module of it, because it left or there was no room: existing
    /// modules come first.
    fn groups_without(&self, old: &Engine, name: &str, modules: &[ModuleId]) -> Vec<GroupId> {
        let there =
            |group| modules.iter().any(|id| old.net.modules[id.0 as usize].node.parent == Some(group));
        let wanted = Names::wanted(&old.model, name, old.net.other_group()).into_iter();
        wanted.filter(|it| !there(it.group)).filter_map(|it| self.same_group(old, it.group)).collect()
    }

    /// The group with the same name in the new configuration.
    fn same_group(&self, old: &Engine, group: GroupId) -> Option<GroupId> {
        let path = old.views.name(NodeId::Group(group));
        self.views.paths().find(|(_, known)| *known == path).map(|(group, _)| group)
    }

    /// A status may feed several groups and have left some of them: there it is not made again, and alarms of
    /// those modules keep their name.
    fn leave_out(&mut self, old: &Engine) {
        let live: HashSet<&str> = old.views.module_ids().map(|(name, _)| name).collect();
        let left: Vec<(Arc<str>, GroupId)> = old.departed_names(&self.views);
        for (name, group) in left {
            match self.views.module(&name) {
                Some(id) if !live.contains(&*name) => self.net.remove(id),
                None => self.keep_departed(&name, group),
                _ => {}
            }
        }
        self.remove_departed();
    }

    fn take_history(&mut self, old: &Engine) {
        let names: HashMap<&str, NodeId> = self.views.nodes().map(|(node, name)| (name, node)).collect();
        let renamed = |node: NodeId| names.get(old.views.name(node)).copied();
        self.causes.copy_since(&old.causes, renamed);
        self.alarms.copy(&old.alarms, renamed);
        let accepted =
            old.warnings.accepted().filter_map(|(id, at)| Some((renamed(NodeId::Module(id))?, at)));
        for (node, at) in accepted.collect::<Vec<_>>() {
            if let NodeId::Module(id) = node {
                self.warnings.expect(id, at);
            }
        }
        self.countermeasures.keep(&old.countermeasures, &old.model, &self.model);
        for held in old.countermeasures.held() {
            let by = match held.by {
                RequestOrigin::Rule(index, node) => {
                    let rule = &old.model.driving.countermeasures[index];
                    renamed(node)
                        .and_then(|it| self.countermeasures.rule(&self.model, it, rule))
                        .unwrap_or(RequestOrigin::Past)
                }
                by => by,
            };
            let watched = if let RequestOrigin::Rule(_, node) = by { Some(node) } else { None };
            let still = |it: &&RequestCause| renamed(it.node).is_some() || it.present || !it.acknowledged;
            // An acknowledgement of a cause that is gone does not cover its substitute.
            let cause = |it: &RequestCause| match renamed(it.node) {
                Some(node) => RequestCause { node, ..*it },
                None => {
                    let node = self.stand_in(old.views.name(it.node), watched);
                    RequestCause { stands_in: true, ..RequestCause::new(node, false, it.present) }
                }
            };
            let causes = held.causes.iter().filter(still).map(cause).collect();
            let asking = match by {
                RequestOrigin::Past => {
                    held.about().map(|node| cause(&RequestCause::new(node, false, true))).collect()
                }
                RequestOrigin::Rule(..) | RequestOrigin::Operator => Vec::new(),
            };
            let held = HeldRequest { by, causes, asking, ..held.clone() };
            self.countermeasures.take_over(held, self.net.nobody());
        }
    }

    /// A clearance is for the vehicle as it was judged: another configuration withdraws it.
    fn take_vehicle(&mut self, old: &Engine) {
        self.vehicle.reload(self.model.stages, self.says_it_drives());
        if self.model != old.model {
            self.vehicle.raise(StageEvent::Reloaded);
        }
        if self.vehicle.stage != old.vehicle.stage {
            let (from, to) = (old.vehicle.stage, self.vehicle.stage);
            if from == Stage::Cleared {
                // It may have set off already.
                self.countermeasures.arrives = Some(self.now + ARRIVAL);
            }
            self.events.push(self.now, EventKind::Stage { from, to });
        }
        self.stage_changed();
    }
}

impl Views {
    /// Takes over the report of a module from before a reload.
    pub(crate) fn copy_report(&mut self, id: ModuleId, old: &Views, from: ModuleId) {
        let before = &old.modules[from.0 as usize];
        self.keep_report(id, before.report.clone(), old.budget.source(from));
        if let Some(view) = self.modules.get_mut(id.0 as usize) {
            view.received = before.received;
        }
        if !std::mem::replace(&mut self.is_heard[id.0 as usize], true) {
            self.heard.push(id);
        }
    }

    /// Nodes that show the same as before a reload keep the time since which they show it.
    pub(crate) fn keep_since(&mut self, old: &Views) {
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

    /// Continues the counters of the views from before a reload.
    pub(crate) fn continue_from(&mut self, old: &Views) {
        self.seq = old.seq + 1;
        self.revision = old.revision + 1;
        self.reception = old.reception.clone();
    }
}
