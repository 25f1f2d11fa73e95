//! The operator's actions, and the checks that refuse them.

use std::sync::Arc;

use super::machine::StageEvent;
use crate::Engine;
use crate::input::{AlarmRef, OperatorAction, Place, Refusal, Response};
use crate::mask::node::NodeFacts;
use crate::mask::responsible;
use crate::model::countermeasure::RequestKind;
use crate::model::{GroupId, ModuleId, NodeId, Stage, StageModel};
use crate::module::system::SystemCheck;
use crate::react::held::{Acknowledged, Whereabouts};
use crate::snapshot::{MapPose, Unreached, may_move, moves};
use crate::state::State;
use crate::time::{Since, Span};

/// A pose farther than this from every stop is surely a typing error.
const FROM_STOP_MAX_M: f64 = 200.0;

/// WARNINGs that are named in the refusal of a clearance.
const WARNINGS_MAX: usize = 64;

impl Engine {
    pub(crate) fn operate(&mut self, action: &OperatorAction) -> Response {
        // A STOP that is refused counts too: its operator does not want a drive to begin.
        if *action == OperatorAction::RequestStop {
            self.countermeasures.last_stop += 1;
            self.vehicle_changed = true;
        }
        match self.try_to(action) {
            Ok(()) => {
                self.vehicle_changed = true;
                Response::Done
            }
            Err(reasons) => Response::Refused(reasons),
        }
    }

    /// Carries an action out, or changes nothing and names every reason.
    fn try_to(&mut self, action: &OperatorAction) -> Result<(), Vec<Refusal>> {
        self.check(action)?;
        match action {
            OperatorAction::Login { name } => {
                let event = self.vehicle.put_in_charge(name);
                self.step(event);
            }
            OperatorAction::Logout => self.leave(StageEvent::Logout),
            OperatorAction::Shutdown => self.leave(StageEvent::Shutdown),
            OperatorAction::Localize { place } => {
                let pose = self.pose(place).map_err(|reason| vec![reason])?;
                self.vehicle.localize(pose, self.now);
                self.set_posed();
            }
            OperatorAction::AskClearance { .. } | OperatorAction::AskRelease { .. } => {}
            OperatorAction::Clear { .. } => {
                self.step(StageEvent::Clearance);
            }
            OperatorAction::Withdraw => {
                self.step(StageEvent::Withdrawn);
            }
            OperatorAction::Release { .. } => self.countermeasures.release(),
            OperatorAction::RequestStop => {
                self.countermeasures.request_stop(Since { at: self.now, before: Span::ZERO });
            }
            OperatorAction::Acknowledge { alarm } => self.acknowledge(alarm),
            OperatorAction::Reset { module } => {
                let id = self.resettable(module).map_err(|reason| vec![reason])?;
                let policy = self.net.policy(id).clone();
                self.net.modules[id.0 as usize].own.reset(&policy);
                self.net.mark_module(id);
            }
            OperatorAction::Shelve { module, lasts, by } => self.shelve(module, *lasts, by),
            OperatorAction::Unshelve { module } => self.unshelve(module),
        }
        Ok(())
    }

    /// Names every reason for which an action would be refused now.
    pub(crate) fn check(&self, action: &OperatorAction) -> Result<(), Vec<Refusal>> {
        match action {
            OperatorAction::Login { .. } => Ok(()),
            OperatorAction::Logout => self.may_leave(Refusal::LogoutWhileActive),
            OperatorAction::Shutdown => {
                self.need_operator()?;
                self.may_leave(Refusal::ShutdownWhileActive)
            }
            OperatorAction::Localize { place } => self.may_localize(place),
            OperatorAction::AskClearance { display_live, storage_ok }
            | OperatorAction::Clear { display_live, storage_ok } => {
                refuse(self.clearance_refusals(), *display_live, *storage_ok)
            }
            OperatorAction::RequestStop => {
                self.need_operator()?;
                if !may_move(self.vehicle.stage, self.motion.shown(), self.may_set_off()) {
                    return Err(vec![Refusal::NotDriving]);
                }
                // Without a reader the request is still made: it is sent as soon as there is one.
                match self.countermeasures.unreached(&self.model, RequestKind::ManeuverStop) {
                    Some(Unreached::Unpublished) => Err(vec![Refusal::StopNotPublished]),
                    Some(Unreached::Unheard) | None => Ok(()),
                }
            }
            OperatorAction::Withdraw => {
                self.need_operator()?;
                match self.vehicle.stage {
                    Stage::Cleared => Ok(()),
                    stage => Err(vec![Refusal::WrongStage(stage)]),
                }
            }
            OperatorAction::AskRelease { display_live, storage_ok }
            | OperatorAction::Release { display_live, storage_ok } => {
                refuse(self.release_refusals(), *display_live, *storage_ok)
            }
            OperatorAction::Acknowledge { alarm } => {
                self.need_operator()?;
                self.acknowledgeable(alarm).map_err(|reason| vec![reason])
            }
            OperatorAction::Reset { module } => {
                self.resettable(module).map(drop).map_err(|reason| vec![reason])
            }
            OperatorAction::Shelve { module, lasts, by: _ } => {
                let reasons = self.shelving_refusals(module, *lasts);
                if reasons.is_empty() { Ok(()) } else { Err(reasons) }
            }
            OperatorAction::Unshelve { module } => {
                self.unshelving_refusal(module).map_or(Ok(()), |reason| Err(vec![reason]))
            }
        }
    }

    /// On a machine without stages, only the page requires a login.
    fn need_operator(&self) -> Result<(), Vec<Refusal>> {
        match (&self.vehicle.operator, self.vehicle.model) {
            (None, StageModel::Shuttle) => Err(vec![Refusal::NobodyLoggedIn]),
            (None, StageModel::None) | (Some(_), _) => Ok(()),
        }
    }

    fn may_leave(&self, refusal: Refusal) -> Result<(), Vec<Refusal>> {
        if moves(self.vehicle.stage, self.motion.shown()) && self.vehicle.model == StageModel::Shuttle {
            return Err(vec![refusal]);
        }
        Ok(())
    }

    fn leave(&mut self, event: StageEvent) {
        self.vehicle.operator = None;
        self.step(event);
    }

    fn may_localize(&self, place: &Place) -> Result<(), Vec<Refusal>> {
        if self.vehicle.model == StageModel::None {
            return Err(vec![Refusal::NoStages]);
        }
        self.need_operator()?;
        let mut reasons = Vec::new();
        if !matches!(self.vehicle.stage, Stage::Localizing | Stage::Standby) {
            reasons.push(Refusal::WrongStage(self.vehicle.stage));
        }
        reasons.extend(self.pose(place).err());
        if reasons.is_empty() { Ok(()) } else { Err(reasons) }
    }

    pub(crate) fn pose(&self, place: &Place) -> Result<MapPose, Refusal> {
        let stops = &self.model.driving.stops;
        let pose = match place {
            Place::Stop(id) => {
                let stop = stops.iter().find(|stop| stop.id == Arc::from(&**id));
                let stop = stop.ok_or_else(|| Refusal::NoSuchStop(id.clone()))?;
                return Ok(stop.into());
            }
            Place::Pose { x_m, y_m, yaw_deg } => MapPose { x_m: *x_m, y_m: *y_m, yaw_deg: *yaw_deg },
        };
        if ![pose.x_m, pose.y_m, pose.yaw_deg].iter().all(|value| value.is_finite()) {
            return Err(Refusal::PoseNotFinite);
        }
        let distance = |stop: &crate::model::Stop| (stop.x_m - pose.x_m).hypot(stop.y_m - pose.y_m);
        match stops.iter().map(distance).min_by(f64::total_cmp) {
            Some(nearest) if nearest > FROM_STOP_MAX_M => Err(Refusal::PoseTooFar {
                // Saturates: every distance beyond 4 million km is equal.
                nearest_m: nearest as u32,
                limit_m: FROM_STOP_MAX_M as u32,
            }),
            _ => Ok(pose),
        }
    }

    fn acknowledgeable(&self, alarm: &AlarmRef) -> Result<(), Refusal> {
        match alarm {
            AlarmRef::Number(number) => {
                self.alarms.node(*number).map(drop).ok_or(Refusal::NoSuchAlarm(*number))
            }
            // If somebody else has acknowledged them, nothing is left to do.
            AlarmRef::Over { .. } => Ok(()),
            AlarmRef::Node(name) => {
                let node = self.node_named(name).ok_or_else(|| Refusal::NoSuchNode(name.clone()))?;
                let has_something = |&node: &NodeId| {
                    let alarmed = self.alarms.list().iter().any(|alarm| alarm.node == node);
                    let accepted = matches!(node, NodeId::Module(id) if self.warnings.is_accepted(id));
                    alarmed
                        || accepted
                        || self.countermeasures.is_held_for(node)
                        || !self.warned_in(node).is_empty()
                };
                if self.places_of(node).iter().any(has_something) {
                    return Ok(());
                }
                Err(Refusal::NothingToAcknowledge(self.views.name(node).into()))
            }
        }
    }

    /// One status in several groups is one fault: an acknowledgement in one place counts in all.
    fn acknowledge(&mut self, alarm: &AlarmRef) {
        match alarm {
            AlarmRef::Number(_) | AlarmRef::Over { .. } => {
                for number in self.numbers(alarm) {
                    let Some(node) = self.alarms.node(number) else { continue };
                    // The alarm of an earlier failure says nothing about the present one.
                    let latest = self.alarms.latest(number);
                    self.alarms.acknowledge(|alarm| alarm.id == number, self.now, &mut self.events);
                    if let Some(alarm) = &latest {
                        self.countermeasures.acknowledge(Acknowledged { node, alarm: Some(alarm) });
                    }
                }
            }
            AlarmRef::Node(name) => {
                let Some(node) = self.node_named(name) else { return };
                for node in self.places_of(node) {
                    self.alarms.acknowledge(|alarm| alarm.node == node, self.now, &mut self.events);
                    self.countermeasures.acknowledge(Acknowledged { node, alarm: None });
                    for id in self.warned_in(node) {
                        self.warnings.accept(id, self.now);
                    }
                }
            }
        }
        self.views.set_alarms(self.alarms.list());
    }

    /// The numbers of the alarms that are acknowledged together, unless a node is acknowledged by its name.
    pub(crate) fn numbers(&self, alarm: &AlarmRef) -> Vec<u64> {
        match alarm {
            AlarmRef::Number(number) => self.of_one_status(*number),
            AlarmRef::Over { last } => self.alarms.over(*last),
            AlarmRef::Node(_) => Vec::new(),
        }
    }

    /// An alarm, and those that the same status raised in other groups meanwhile.
    fn of_one_status(&self, number: u64) -> Vec<u64> {
        let list = self.alarms.list();
        let Some(alarm) = list.iter().find(|alarm| alarm.id == number) else { return vec![number] };
        let places = self.places_of(alarm.node);
        let others =
            list.iter().filter(|it| it.node != alarm.node && places.contains(&it.node) && it.overlaps(alarm));
        std::iter::once(number).chain(others.map(|alarm| alarm.id)).collect()
    }

    /// A node, and the modules with the same status.
    pub(crate) fn places_of(&self, node: NodeId) -> Vec<NodeId> {
        let status = self.views.status_of(node).and_then(|status| self.names.find(status));
        let Some(route) = status.map(|route| &self.names.routes[route as usize]) else { return vec![node] };
        let others = route.modules().map(NodeId::Module).filter(|&it| it != node);
        std::iter::once(node).chain(others).collect()
    }

    pub(crate) fn node_named(&self, name: &str) -> Option<NodeId> {
        self.views.nodes().find(|(_, known)| **known == *name).map(|(node, _)| node)
    }

    /// Modules inside a node with a WARNING that is not accepted.
    pub(crate) fn warned_in(&self, node: NodeId) -> Vec<ModuleId> {
        self.warnings.open().filter(|&id| self.around(NodeId::Module(id)).any(|it| it == node)).collect()
    }

    /// A node and its enclosing groups.
    pub(crate) fn around(&self, node: NodeId) -> impl Iterator<Item = NodeId> {
        std::iter::successors(Some(node), |&node| self.net.node(node).parent.map(NodeId::Group))
    }

    fn resettable(&self, name: &str) -> Result<ModuleId, Refusal> {
        let id = self.views.module(name).ok_or_else(|| Refusal::NoSuchModule(name.into()))?;
        let own = &self.net.modules[id.0 as usize].own;
        if !own.latched() {
            return Err(Refusal::NotLatched(name.into()));
        }
        if own.is_in_error(self.net.policy(id)) {
            return Err(Refusal::StillInError(name.into()));
        }
        Ok(id)
    }

    /// Every check of a release that fails and that the vehicle's state decides.
    pub(crate) fn release_refusals(&self) -> Vec<Refusal> {
        let mut reasons = self.need_operator().err().unwrap_or_default();
        if self.countermeasures.moving().next().is_none() {
            reasons.push(Refusal::NothingToRelease);
        }
        let remaining = self.countermeasures.remaining_causes().into_iter();
        reasons.extend(remaining.map(|node| Refusal::CauseRemains { node: self.views.name(node).into() }));
        reasons
    }

    /// Every failed check of a clearance that depends on the vehicle's state.
    pub(crate) fn clearance_refusals(&self) -> Vec<Refusal> {
        let vehicle = &self.vehicle;
        if vehicle.model == StageModel::None {
            return vec![Refusal::NoStages];
        }
        let mut reasons = Vec::new();
        if vehicle.operator.is_none() {
            reasons.push(Refusal::NobodyLoggedIn);
        }
        if vehicle.stage != Stage::Standby {
            reasons.push(Refusal::WrongStage(vehicle.stage));
        }
        if vehicle.localization.is_open() {
            reasons.push(Refusal::NotLocalized);
        }
        if !self.has_goal() {
            reasons.push(Refusal::NoGoal);
        }
        let counted = self.net.groups.iter().zip(0..).filter(|(group, _)| !group.aside);
        for (group, index) in counted.filter(|(group, _)| group.node.parent.is_none()) {
            let NodeFacts { relevant, masked, shown, .. } = group.node.facts;
            let is_unfit = relevant && (masked || shown >= State::Unknown);
            if is_unfit && !self.only_the_fleet_fails(GroupId(index)) {
                let name = self.views.name(NodeId::Group(GroupId(index)));
                reasons.push(Refusal::Group { group: name.into(), state: shown });
            }
        }
        let counts = |node: NodeId| self.net.node(node).facts.shown >= State::Warning;
        let warned = self.warnings.open().filter(|&id| {
            id != self.net.system_module(SystemCheck::Fleet) && self.around(NodeId::Module(id)).all(counts)
        });
        reasons.extend(
            warned
                .take(WARNINGS_MAX)
                .map(|id| Refusal::Warning { module: self.views.name(NodeId::Module(id)).into() }),
        );
        reasons.extend(self.countermeasures.moving().map(Refusal::Countermeasure));
        reasons.extend(self.possible_requests_without_reader().map(Refusal::NobodyListens));
        reasons
    }

    /// Whether the group would be fit but for the line to the fleet. That line holds no vehicle: a hub could.
    fn only_the_fleet_fails(&self, group: GroupId) -> bool {
        let fleet = NodeId::Module(self.net.system_module(SystemCheck::Fleet));
        let is_fit = |&node: &NodeId| node == fleet || self.net.node(node).facts.shown < State::Unknown;
        group == self.net.system_group() && self.net.groups[group.0 as usize].members.iter().all(is_fit)
    }

    /// Whether a goal is set; always true for a vehicle without that signal.
    pub(crate) fn has_goal(&self) -> bool {
        self.goal_signal.is_none_or(|index| self.signals.value(index) == Some(true))
    }

    /// Updates the countermeasures with the root causes of failing nodes.
    pub(crate) fn follow_measures(&mut self) {
        let (net, views) = (&self.net, &self.views);
        let masked_by = |node| views.masked_by(node);
        let causes = |node| responsible::roots(net, &masked_by, node);
        let whereabouts = Whereabouts {
            stage: self.vehicle.stage,
            at_a_stop: self.stands_at_a_stop(),
            active_unknown: self.says_it_drives().is_none(),
            between_stops: if self.vehicle.stage == Stage::Active {
                self.has_stood()
            } else {
                !self.motion.is_parked() || self.may_roll_fast()
            },
        };
        self.countermeasures.follow(&self.model, net, whereabouts, self.now, causes);
    }
}

/// Adds the checks that the vehicle's state does not decide.
fn refuse(mut reasons: Vec<Refusal>, display_live: bool, storage_ok: bool) -> Result<(), Vec<Refusal>> {
    let besides = [(display_live, Refusal::DisplayNotLive), (storage_ok, Refusal::StorageNotWritable)];
    reasons.extend(besides.into_iter().filter(|(holds, _)| !holds).map(|(_, reason)| reason));
    if reasons.is_empty() { Ok(()) } else { Err(reasons) }
}
