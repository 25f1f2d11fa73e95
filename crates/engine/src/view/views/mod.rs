//! The content of snapshots, updated piece by piece.

pub(crate) mod kept;
pub(crate) mod members;
mod questions;

use std::collections::HashSet;
use std::sync::Arc;

use super::layout::layout;
use crate::discovery::WriterId;
use crate::input::{ReceptionTrouble, Status};
use crate::mask::causes::Explained;
use crate::mask::net::{Change, Net};
use crate::model::{GroupId, Limits, Model, ModuleId, NodeId, Stage};
use crate::module::budget::Budget;
use crate::monitor::Words;
use crate::persistent::PersistentVec;
use crate::signals::Signals;
use crate::snapshot::{
    Alarm, Counters, GroupView, Layout, ModuleView, Motion, Reason, Reception, Report, RootCause, Snapshot,
};
use crate::stage::advance::VehicleView;
use crate::stage::machine::Vehicle;
use crate::state::State;
use crate::text::Text;
use crate::time::Timestamp;

/// Topics with remembered faults, for each kind of fault; further topics are not remembered.
const RECEPTION_MAX: usize = 256;

#[derive(Debug, Clone)]
pub(crate) struct Views {
    pub(crate) seq: u64,
    pub(crate) revision: u64,
    layout: Arc<Layout>,
    /// The names of groups and modules: no two are equal. Shared with copies of the engine until a module comes or
    /// goes.
    names: Arc<HashSet<Arc<str>>>,
    pub(crate) groups: PersistentVec<GroupView>,
    pub(crate) modules: PersistentVec<ModuleView>,
    roots: Arc<[RootCause]>,
    alarms: Arc<[Alarm]>,
    vehicle: VehicleView,
    motion: Motion,
    signals: Arc<[(Box<str>, Option<bool>)]>,
    pub(crate) reception: Arc<[Reception]>,
    overall: State,
    stage: Option<Stage>,
    operator: Option<Arc<str>>,
    /// Modules with reports since their age was last updated.
    pub(crate) heard: Vec<ModuleId>,
    pub(crate) is_heard: Vec<bool>,
    /// A second copy of each module's report, in one vector: every status is compared with it.
    reports: Vec<Arc<Report>>,
    pub(crate) budget: Budget,
    /// A masked node for which the last search found no cause.
    unexplained: Option<NodeId>,
    /// A root cause that was masked itself after the last search.
    masked_root: Option<NodeId>,
    seq_changed: bool,
    revision_changed: bool,
}

impl Views {
    pub(crate) fn new(model: &Model, now: Timestamp) -> Views {
        let layout = layout(model);
        let groups = layout.groups.iter().map(|group| group.path.clone());
        let names: HashSet<_> = groups.chain(layout.modules.iter().map(|module| module.id.clone())).collect();
        let mut views = Views {
            seq: 0,
            revision: 0,
            layout: Arc::new(layout),
            names: Arc::new(names),
            groups: (0..model.groups.len() + 2).map(|_| new_group(now)).collect(),
            modules: PersistentVec::default(),
            roots: Arc::from([]),
            alarms: Arc::from([]),
            vehicle: VehicleView::default(),
            motion: Motion::default(),
            signals: Arc::from([]),
            reception: Arc::from([]),
            overall: State::Unknown,
            stage: None,
            operator: None,
            heard: Vec::new(),
            is_heard: Vec::new(),
            reports: Vec::new(),
            budget: Budget::new(&model.limits),
            unexplained: None,
            masked_root: None,
            seq_changed: true,
            revision_changed: true,
        };
        for _ in 0..views.layout.modules.len() {
            views.push_module(now);
        }
        views.set_signals(&Signals::new(&model.signals));
        views
    }

    pub(crate) fn snapshot(
        &self,
        now: Timestamp,
        vehicle: &Vehicle,
        driven_m: f64,
        counters: Counters,
    ) -> Snapshot {
        Snapshot {
            seq: self.seq,
            revision: self.revision,
            now,
            stage: vehicle.stage,
            operator: vehicle.operator.clone(),
            overall: self.overall,
            layout: self.layout.clone(),
            groups: self.groups.clone(),
            modules: self.modules.clone(),
            roots: self.roots.clone(),
            asking: self.vehicle.asking.clone(),
            asked: self.vehicle.asked,
            alarms: self.alarms.clone(),
            last_alarm: self.vehicle.last_alarm,
            accepted: self.vehicle.accepted.clone(),
            shelved: self.vehicle.shelved.clone(),
            countermeasures: self.vehicle.countermeasures.clone(),
            localization: self.vehicle.localization,
            motion: self.motion,
            driven_m,
            clearance: self.vehicle.clearance,
            hold: self.vehicle.hold,
            last_stop: self.vehicle.last_stop,
            may_set_off: self.vehicle.may_set_off,
            clearance_refusals: self.vehicle.clearance_refusals.clone(),
            release_refusals: self.vehicle.release_refusals.clone(),
            unreached: self.vehicle.unreached.clone(),
            listened: self.vehicle.listened.clone(),
            signals: self.signals.clone(),
            reception: self.reception.clone(),
            counters,
        }
    }

    /// Updates the age of each module's last report.
    pub(crate) fn refresh_ages(&mut self, net: &Net) {
        for id in self.heard.drain(..) {
            let index = id.0 as usize;
            self.is_heard[index] = false;
            if let Some(view) = self.modules.get_mut(index) {
                view.received = net.modules[index].own.received();
            }
        }
    }

    /// Sets the message of a module that the engine itself reports.
    pub(crate) fn set_message(&mut self, id: ModuleId, message: Text) {
        let index = id.0 as usize;
        if *self.reports[index].message != *message.en {
            self.set_report(id, Arc::new(Report::of_engine(message, Vec::new())));
        }
        self.note_heard(id);
    }

    /// Sets the message of a monitor. Returns whether it changed.
    pub(crate) fn set_words(&mut self, id: ModuleId, words: Words, aged: bool) -> bool {
        let values = words.values.into_iter().map(|(key, value)| (key.into(), value.into()));
        self.set_said(id, Report { aged, ..Report::of_engine(words.message, values.collect()) })
    }

    /// Sets a report that the engine made. Returns whether it changed.
    pub(crate) fn set_said(&mut self, id: ModuleId, report: Report) -> bool {
        let changed = *self.reports[id.0 as usize] != report;
        if changed {
            self.set_report(id, Arc::new(report));
        }
        changed
    }

    /// Notes that the age of a module's last report changed.
    pub(crate) fn note_heard(&mut self, id: ModuleId) {
        if !std::mem::replace(&mut self.is_heard[id.0 as usize], true) {
            self.heard.push(id);
        }
    }

    /// Keeps the texts of a status, if they changed.
    pub(crate) fn take_report(
        &mut self,
        id: ModuleId,
        status: Status<'_>,
        source: WriterId,
        limits: &Limits,
    ) {
        let index = id.0 as usize;
        self.note_heard(id);
        if self.reports[index].says(status) {
            return;
        }
        let mut report = Report::of(status, limits);
        // A cut report stays as it is until there is room again.
        if self.reports[index].cut > 0 {
            let room = self.budget.room(id, source);
            if report.weight() > room {
                report = report.cut_to(room);
            }
        }
        if *self.reports[index] != report {
            self.keep_report(id, Arc::new(report), source);
        }
    }

    pub(crate) fn set_report(&mut self, id: ModuleId, report: Arc<Report>) {
        self.keep_report(id, report, WriterId::default());
    }

    /// Keeps the report of a writer. If the sum is too large, the longest reports are cut.
    pub(crate) fn keep_report(&mut self, id: ModuleId, report: Arc<Report>, source: WriterId) {
        self.budget.store(id, source, report.weight(), report.cut > 0);
        self.put_report(id, report);
        while let Some((longest, bytes)) = self.budget.over(source) {
            let shorter = Arc::new(self.reports[longest.0 as usize].cut_to(bytes));
            let its_source = self.budget.source(longest);
            self.budget.store(longest, its_source, shorter.weight(), true);
            self.put_report(longest, shorter);
        }
    }

    fn put_report(&mut self, id: ModuleId, report: Arc<Report>) {
        self.reports[id.0 as usize] = report.clone();
        if let Some(view) = self.modules.get_mut(id.0 as usize) {
            view.report = report;
        }
        self.revision_changed = true;
    }

    pub(crate) fn set_signals(&mut self, signals: &Signals) {
        self.signals = signals.list().map(|(name, value)| (name.into(), value)).collect();
        self.seq_changed = true;
    }

    pub(crate) fn take_trouble(&mut self, trouble: &ReceptionTrouble, now: Timestamp) {
        let mut list = self.reception.to_vec();
        let fresh = Reception {
            topic: trouble.topic.clone(),
            kind: trouble.kind,
            count: trouble.count,
            last: now,
            last_text: trouble.text.clone(),
        };
        match list.iter().position(|it| it.topic == fresh.topic && it.kind == fresh.kind) {
            Some(known) => {
                list[known] = Reception { count: list[known].count.saturating_add(fresh.count), ..fresh }
            }
            None if list.len() < RECEPTION_MAX => list.push(fresh),
            None => return,
        }
        self.reception = list.into();
        self.revision_changed = true;
    }

    /// Takes over a change of a node.
    pub(crate) fn follow(&mut self, net: &Net, change: &Change, now: Timestamp) {
        match change.node {
            NodeId::Group(id) => self.follow_group(net, id, now),
            NodeId::Module(id) => self.follow_module(net, id, now),
        }
    }

    fn follow_group(&mut self, net: &Net, id: GroupId, now: Timestamp) {
        let group = &net.groups[id.0 as usize];
        let facts = group.node.facts;
        let view = &self.groups[id.0 as usize];
        let reason =
            reason(facts.shown, facts.masked, || net.kept_out_by(NodeId::Group(id)), view.reason.as_ref());
        let next = GroupView {
            state: facts.shown,
            own: facts.own,
            since: since(view.state, view.reason.as_ref(), facts.shown, reason.as_ref(), view.since, now),
            ok: group.shown.of(State::Ok),
            counted: group.shown.counted(),
            reason,
            paths: view.paths.clone(),
        };
        if *view != next
            && let Some(view) = self.groups.get_mut(id.0 as usize)
        {
            *view = next;
            self.seq_changed = true;
        }
    }

    fn follow_module(&mut self, net: &Net, id: ModuleId, now: Timestamp) {
        let module = &net.modules[id.0 as usize];
        let facts = module.node.facts;
        let view = &self.modules[id.0 as usize];
        let reason =
            reason(facts.shown, facts.masked, || module.node.not_relevant.clone(), view.reason.as_ref());
        let silent = module.own.silent();
        let steps = module.own.steps(net.policy(id));
        let known = (view.state, view.own, view.silent, &view.reason, view.steps);
        if known == (facts.shown, facts.own, silent, &reason, steps) {
            return;
        }
        // Changed steps explain more, but change nothing that an operator decides by.
        let same = (view.state, view.own, &view.reason) == (facts.shown, facts.own, &reason);
        self.seq_changed |= !same;
        self.revision_changed = true;
        if let Some(view) = self.modules.get_mut(id.0 as usize) {
            view.since =
                since(view.state, view.reason.as_ref(), facts.shown, reason.as_ref(), view.since, now);
            (view.state, view.own, view.reason) = (facts.shown, facts.own, reason);
            (view.silent, view.steps) = (silent, steps);
            view.began = net.began(id);
        }
    }

    /// Takes the result of a search. Returns whether the root causes changed.
    pub(crate) fn set_causes(&mut self, explained: Explained) -> bool {
        self.unexplained = explained.masked.iter().find(|(_, by)| by.is_empty()).map(|(node, _)| *node);
        for (node, by) in explained.masked {
            self.set_masked_by(node, by);
        }
        for (id, paths) in explained.paths {
            if self.groups[id.0 as usize].paths != paths
                && let Some(view) = self.groups.get_mut(id.0 as usize)
            {
                view.paths = paths;
                self.seq_changed = true;
            }
        }
        let changed = *self.roots != *explained.roots;
        if changed {
            self.roots = explained.roots.into();
            self.seq_changed = true;
        }
        let masked = self.roots.iter().find(|root| self.reason(root.node).is_some());
        self.masked_root = masked.map(|root| root.node);
        changed
    }

    fn set_masked_by(&mut self, node: NodeId, by: Arc<[NodeId]>) {
        if matches!(self.reason(node), Some(Reason::Masked { by: known }) if *known == by) {
            return;
        }
        let slot = match node {
            NodeId::Group(id) => self.groups.get_mut(id.0 as usize).map(|view| &mut view.reason),
            NodeId::Module(id) => self.modules.get_mut(id.0 as usize).map(|view| &mut view.reason),
        };
        if let Some(slot) = slot {
            *slot = Some(Reason::Masked { by });
            self.seq_changed = true;
        }
    }

    pub(crate) fn set_alarms(&mut self, alarms: &[Alarm]) {
        self.alarms = alarms.into();
        self.seq_changed = true;
    }

    pub(crate) fn vehicle(&self) -> &VehicleView {
        &self.vehicle
    }

    pub(crate) fn set_vehicle(&mut self, vehicle: VehicleView) {
        if self.vehicle != vehicle {
            self.vehicle = vehicle;
            self.seq_changed = true;
        }
    }

    /// Sets the motion. An operator decides by the destination; the speed is only shown. Returns whether
    /// anything changed.
    pub(crate) fn set_motion(&mut self, motion: Motion) -> bool {
        let before = std::mem::replace(&mut self.motion, motion);
        self.seq_changed |= before.destination != motion.destination;
        self.revision_changed |= before != motion;
        before != motion
    }

    /// Whether something that an operator decides by changed since [`Views::settle`].
    pub(crate) fn is_changed(&self) -> bool {
        self.seq_changed
    }

    /// Counts the changes since the last call.
    pub(crate) fn settle(&mut self, vehicle: &Vehicle, net: &Net) {
        let overall = match net.root.worst() {
            Some(worst) => worst,
            None if net.groups.len() > 1 => State::Ignore,
            None => State::Unknown,
        };
        if (self.overall, self.stage, &self.operator) != (overall, Some(vehicle.stage), &vehicle.operator) {
            (self.overall, self.stage) = (overall, Some(vehicle.stage));
            self.operator.clone_from(&vehicle.operator);
            self.seq_changed = true;
        }
        let seq_changed = std::mem::take(&mut self.seq_changed);
        let revision_changed = std::mem::take(&mut self.revision_changed) || seq_changed;
        self.seq += u64::from(seq_changed);
        self.revision += u64::from(revision_changed);
    }
}

/// The reason why a node shows IGNORE. The causes of a masked node are searched later; until then the known
/// ones stay.
fn reason(
    shown: State,
    masked: bool,
    not_relevant: impl FnOnce() -> Option<crate::snapshot::NotRelevant>,
    before: Option<&Reason>,
) -> Option<Reason> {
    if shown != State::Ignore {
        return None;
    }
    if !masked {
        return not_relevant().map(Reason::NotRelevant);
    }
    match before {
        Some(masked @ Reason::Masked { .. }) => Some(masked.clone()),
        Some(Reason::NotRelevant(_)) | None => Some(Reason::Masked { by: Arc::from([]) }),
    }
}

fn since(
    before: State,
    before_reason: Option<&Reason>,
    after: State,
    after_reason: Option<&Reason>,
    since: Timestamp,
    now: Timestamp,
) -> Timestamp {
    let kind = |reason: Option<&Reason>| matches!(reason, Some(Reason::Masked { .. }));
    if before == after && kind(before_reason) == kind(after_reason) { since } else { now }
}

fn new_group(now: Timestamp) -> GroupView {
    GroupView {
        state: State::Ignore,
        own: State::Unknown,
        since: now,
        ok: 0,
        counted: 0,
        reason: None,
        paths: Arc::from([]),
    }
}
