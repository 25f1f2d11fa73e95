//! Resumes after a restart, also in the middle of a drive.

use crate::discovery::DISCOVERY;
use serde::{Deserialize, Serialize};
use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use crate::Engine;
use crate::mask::node::ModuleKind;
use crate::model::countermeasure::Request;
use crate::model::wording::Urgency;
use crate::model::{Model, NodeId, Stage, StageModel};
use crate::module::system::SystemCheck;
use crate::react::held::{HeldRequest, RequestCause, RequestOrigin};
use crate::snapshot::{Alarm, KnownPlace, Localization, MapPose, Snapshot};
use crate::stage::machine::StageEvent;
use crate::time::{Since, Span, Timestamp};
use crate::timers::TimerKey;

/// The state that outlives the program: everything that an operator decided or has to decide. The states of the
/// components are UNKNOWN until they report. Nodes have their names of the wire.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Restored {
    /// A clearance does not outlive the program: `cleared` becomes `standby`.
    pub stage: Stage,
    pub operator: Option<Box<str>>,
    /// In `localizing`, whether the operator gave a pose; while `active`, whether the pose is confirmed.
    pub posed: bool,
    /// Number and value of the last pose, which is not published again.
    pub pose: Option<(u64, MapPose)>,
    /// Where the vehicle was last known to be.
    pub last_known: Option<KnownPlace>,
    pub alarms: Vec<RestoredAlarm>,
    /// The number of the last alarm: no number is used twice.
    pub last_alarm: u64,
    /// Modules whose WARNING is accepted.
    pub accepted: Vec<Box<str>>,
    /// Modules with a latched ERROR, which stays until somebody resets it.
    #[serde(default)]
    pub latched: Vec<Box<str>>,
    pub countermeasures: Vec<RestoredCountermeasure>,
}

impl Default for Restored {
    fn default() -> Restored {
        Restored {
            stage: Stage::Locked,
            operator: None,
            posed: false,
            pose: None,
            last_known: None,
            alarms: Vec::new(),
            last_alarm: 0,
            accepted: Vec::new(),
            latched: Vec::new(),
            countermeasures: Vec::new(),
        }
    }
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RestoredAlarm {
    pub id: u64,
    pub node: Box<str>,
    /// How long ago it was raised.
    pub age: Span,
    pub acknowledged: bool,
    pub active: bool,
    /// The highest urgency that its fault had.
    pub asked: Option<Urgency>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct RestoredCountermeasure {
    pub request: Request,
    /// How long it has been made.
    pub age: Span,
    /// How long the operator has requested it too.
    pub by_operator: Option<Span>,
    /// Causes, and whether each is acknowledged.
    pub causes: Vec<(Box<str>, bool)>,
    /// The nodes that ask for it by a rule. They may still fail when the causes that masked them are over.
    #[serde(default)]
    pub about: Vec<Box<str>>,
}

impl Snapshot {
    /// The state to store of this snapshot, for [`Engine::resume`].
    pub fn to_restore(&self) -> Restored {
        let name = |node| Box::from(&**self.node_name(node));
        let alarm = |alarm: &Alarm| RestoredAlarm {
            id: alarm.id,
            node: name(alarm.node),
            age: self.now.since(alarm.raised),
            acknowledged: alarm.acknowledged,
            active: alarm.active,
            asked: alarm.asked,
        };
        let Localization { number, pose, given, last_known, .. } = self.localization;
        let open = self.localization.is_open();
        let to_localize = open && self.stage == Stage::Standby;
        Restored {
            stage: match (self.has_stages(), to_localize) {
                // A machine without stages is always active, which says nothing of a drive.
                (false, _) => Stage::Locked,
                (true, true) => Stage::Localizing,
                (true, false) => self.stage,
            },
            operator: self.operator.as_deref().map(Box::from),
            posed: if self.stage == Stage::Active { !open } else { given.is_some() },
            pose: pose.map(|pose| (number, pose)),
            last_known,
            alarms: self.alarms.iter().map(alarm).collect(),
            last_alarm: self.last_alarm,
            accepted: self.accepted.keys().map(|&node| name(node)).collect(),
            latched: {
                let latched = self.module_ids().filter(|&id| self.module(id).1.steps.latched);
                latched.map(|id| name(NodeId::Module(id))).collect()
            },
            countermeasures: self
                .countermeasures
                .iter()
                .map(|it| RestoredCountermeasure {
                    request: it.request,
                    age: it.since.age(self.now),
                    by_operator: it.by_operator.map(|since| since.age(self.now)),
                    causes: it.causes.iter().map(|cause| (name(cause.node), cause.acknowledged)).collect(),
                    about: it.about.iter().map(|&node| name(node)).collect(),
                })
                .collect(),
        }
    }
}

impl Engine {
    /// Starts without an earlier run: no publisher has been found yet.
    pub fn begin(model: Arc<Model>, now: Timestamp) -> Engine {
        let mut engine = Engine::build(model, now);
        engine.await_publishers();
        engine.settle();
        engine
    }

    /// Resumes an earlier run of the program. Alarms and countermeasures stay until their nodes report again;
    /// nodes that the configuration no longer has are left out.
    pub fn resume(model: Arc<Model>, restored: &Restored, now: Timestamp) -> Engine {
        let mut engine = Engine::build(model, now);
        engine.await_publishers();
        engine.take_restored(restored);
        engine.settle();
        engine.views.set_alarms(engine.alarms.list());
        engine
    }

    /// Topics without a found publisher are silent only because Telltale has just started.
    fn await_publishers(&mut self) {
        self.search_until(self.now + DISCOVERY);
        let timeout = self.active_signal.and_then(|index| self.model.signals[index].timeout);
        self.active_by = self.now + timeout.unwrap_or(DISCOVERY);
        self.timers.arm(TimerKey::Active, self.active_by);
    }

    /// Rates of topics without a publisher so far are not judged before one window after `until`.
    pub(crate) fn search_until(&mut self, until: Timestamp) {
        self.watching.search_until(until);
        self.timers.arm(TimerKey::Searched, until);
    }

    /// Stops waiting for alarms from before the restart whose modules have reported. Telltale's own modules
    /// depend on others: they count as known once those had their time.
    pub(crate) fn release_awaited_alarms(&mut self) -> bool {
        if !self.alarms.awaits() {
            return false;
        }
        let (net, now) = (&self.net, self.now);
        let active = net.system_module(SystemCheck::Active);
        let is_active_known =
            now >= self.active_by || self.active_signal.is_some_and(|it| self.signals.value(it).is_some());
        let searched = self.watching.searching_until.is_none_or(|until| now >= until);
        let confirmed = searched && !self.countermeasures.waits(&self.model);
        self.alarms.hear(|node| match node {
            NodeId::Module(id) if id == active => is_active_known,
            NodeId::Module(id) => match net.modules[id.0 as usize].kind {
                ModuleKind::BuiltIn => confirmed,
                // A module that left will report nothing more.
                ModuleKind::Gone => true,
                ModuleKind::Declared | ModuleKind::Discovered | ModuleKind::Overflow => {
                    net.modules[id.0 as usize].own.known()
                }
            },
            NodeId::Group(_) => true,
        })
    }

    fn take_restored(&mut self, restored: &Restored) {
        self.vehicle.operator = restored.operator.as_deref().map(Arc::from);
        if self.vehicle.model == StageModel::Shuttle {
            let someone = self.vehicle.operator.is_some();
            self.vehicle.stage = match restored.stage {
                Stage::Active => Stage::Active,
                Stage::Localizing if someone => Stage::Localizing,
                Stage::Standby | Stage::Cleared if someone => Stage::Standby,
                Stage::Locked | Stage::Localizing | Stage::Standby | Stage::Cleared => Stage::Locked,
            };
        }
        let (number, pose) = restored.pose.map_or((0, None), |(number, pose)| (number, Some(pose)));
        let given = restored.posed.then_some(self.now).filter(|_| self.vehicle.stage == Stage::Localizing);
        let skipped = self.vehicle.stage == Stage::Active && !restored.posed;
        self.vehicle.localization = Localization {
            number,
            pose,
            given,
            ok_since: None,
            done: false,
            skipped,
            last_known: restored.last_known,
            late: false,
        };
        let nodes = self.find_again(restored);
        let find = |name: &str| nodes.get(name).copied();
        for name in &restored.accepted {
            if let Some(NodeId::Module(id)) = find(name) {
                self.warnings.expect(id, None);
            }
        }
        for name in &restored.latched {
            if let Some(NodeId::Module(id)) = find(name) {
                let policy = self.net.policy(id).clone();
                self.net.modules[id.0 as usize].own.latch_again(&policy);
                self.net.mark_module(id);
            }
        }
        let alarm = |it: &RestoredAlarm| {
            let raised = self.now - it.age;
            let RestoredAlarm { id, acknowledged, active, asked, .. } = *it;
            let ended = Some(self.now).filter(|_| !active);
            Some(Alarm {
                id,
                node: find(&it.node)?,
                raised,
                ended,
                acknowledged,
                acknowledged_at: None,
                active,
                repeats: 0,
                asked,
            })
        };
        self.alarms.restore(restored.alarms.iter().filter_map(alarm).collect(), restored.last_alarm);
        for alarm in self.alarms.list().iter().filter(|alarm| alarm.active) {
            if let NodeId::Module(id) = alarm.node {
                self.net.modules[id.0 as usize].own.onset.restore_shown(alarm.raised);
                self.watching.note_failed(id, alarm.raised);
            }
        }
        for measure in &restored.countermeasures {
            if let Some(age) = measure.by_operator {
                self.countermeasures.request_stop(Since::of_age(age, self.now));
            }
            // A cause that no longer exists can never be found to be over: it must be acknowledged again.
            let cause = |(name, acknowledged): &(Box<str>, bool)| match find(name) {
                Some(node) => RequestCause::new(node, *acknowledged, true),
                None => RequestCause {
                    stands_in: true,
                    ..RequestCause::new(self.stand_in(name, None), false, true)
                },
            };
            let mut causes: Vec<RequestCause> = measure.causes.iter().map(cause).collect();
            let asking = measure.about.iter().map(|name| cause(&(name.clone(), false))).collect();
            let others = self.net.nobody();
            if causes.is_empty() && measure.by_operator.is_none() {
                causes.push(RequestCause::new(others, false, true));
            }
            if !causes.is_empty() {
                let since = Since::of_age(measure.age, self.now);
                let held = HeldRequest::new(measure.request, RequestOrigin::Past, since);
                self.countermeasures.take_over(HeldRequest { causes, asking, ..held }, others);
            }
        }
        for held in &self.countermeasures.held {
            for cause in held.causes.iter().chain(&held.asking) {
                if let NodeId::Module(id) = cause.node {
                    self.watching.note_failed(id, held.since);
                }
            }
        }
        // Where the vehicle was meanwhile is not known.
        self.countermeasures.held.iter_mut().for_each(|held| held.needs_release = true);
        self.stage_changed();
    }

    /// All nodes by name, with the discovered ones that the stored state refers to.
    fn find_again(&mut self, restored: &Restored) -> HashMap<Box<str>, NodeId> {
        let known: HashSet<Box<str>> = self.views.nodes().map(|(_, name)| name.into()).collect();
        let measures = &restored.countermeasures;
        let causes = measures.iter().flat_map(|it| &it.causes).map(|(name, _)| name);
        let alarms = restored.alarms.iter().filter(|alarm| alarm.active).map(|alarm| &alarm.node);
        let about = measures.iter().flat_map(|it| &it.about);
        let named = causes.chain(alarms).chain(&restored.accepted).chain(&restored.latched).chain(about);
        for name in named.filter(|&name| !known.contains(name)) {
            self.rediscover(name);
        }
        let past = restored.alarms.iter().filter(|alarm| !alarm.active);
        for alarm in past.filter(|alarm| !known.contains(&alarm.node)) {
            self.remember(&alarm.node);
        }
        self.views.nodes().map(|(node, name)| (name.into(), node)).collect()
    }

    /// Enters a stage at once with everything that it implies: an operator, a pose, a goal and the signal that
    /// the vehicle drives. For scenarios; a sample of a signal replaces the implied value.
    pub fn start_in(&mut self, stage: Stage) {
        if self.vehicle.model == StageModel::None || stage == Stage::Locked {
            return;
        }
        self.vehicle.operator = Some("operator".into());
        self.step(StageEvent::Login);
        self.vehicle.localization.done = true;
        let active = (self.active_signal, stage == Stage::Active);
        let goal = (self.goal_signal, matches!(stage, Stage::Cleared | Stage::Active));
        for (index, value) in [active, goal] {
            if let Some(index) = index {
                self.signals.assume(index, value);
                self.signal_changed(index, true);
            }
        }
        let path = [(Stage::Standby, StageEvent::Localized), (Stage::Cleared, StageEvent::Clearance)];
        for (_, event) in path.into_iter().filter(|(reached, _)| *reached <= stage && stage != Stage::Active)
        {
            self.step(event);
        }
        if stage == Stage::Active {
            self.step(StageEvent::ActiveTrue);
        }
        self.vehicle.localization.done = false;
        self.settle();
    }
}
