//! Computes the state to store after an operator's action, without carrying the action out. The web server
//! stores it first.

use std::sync::Arc;

use super::resume::Restored;
use crate::Engine;
use crate::input::{AlarmRef, OperatorAction, Refusal};
use crate::model::{NodeId, Stage};
use crate::react::held::{Acknowledged, Countermeasures};
use crate::snapshot::{Countermeasure, Snapshot};
use crate::stage::machine::StageEvent;
use crate::time::Timestamp;

/// The result of an action that would be granted.
#[derive(Debug, Clone, PartialEq)]
pub struct Preview {
    /// The `seq` of the state in which it was judged.
    pub seq: u64,
    pub vehicle: Restored,
}

impl Engine {
    /// Judges an action as [`Engine::handle`] would at `now`, without carrying it out; time passes as with
    /// [`Input::Tick`](crate::input::Input). Consequences such as the end of an acknowledged alarm follow
    /// from the stored state.
    ///
    /// # Errors
    ///
    /// Every reason for a refusal.
    pub fn preview(&mut self, action: &OperatorAction, now: Timestamp) -> Result<Preview, Vec<Refusal>> {
        self.advance(now);
        self.check(action)?;
        let mut after = Snapshot::clone(&self.snapshot());
        let mut vehicle = self.vehicle.clone();
        match action {
            OperatorAction::Login { name } => {
                let event = vehicle.put_in_charge(name);
                vehicle.raise(event);
            }
            OperatorAction::Logout | OperatorAction::Shutdown => {
                vehicle.operator = None;
                vehicle.raise(StageEvent::Logout);
            }
            OperatorAction::Localize { place } => {
                let pose = self.pose(place).map_err(|reason| vec![reason])?;
                vehicle.localize(pose, self.now);
            }
            OperatorAction::Clear { .. } => {
                vehicle.raise(StageEvent::Clearance);
            }
            OperatorAction::Withdraw => {
                vehicle.raise(StageEvent::Withdrawn);
            }
            OperatorAction::Release { .. } => {
                after.countermeasures = self.list_after(Countermeasures::release)
            }
            OperatorAction::Acknowledge { alarm } => self.preview_acknowledged(alarm, &mut after),
            // Its alarms end. After a restart nothing is shelved, and what still fails calls anew.
            OperatorAction::Shelve { module, .. } => {
                let shelved = self.modules_with(module);
                let is_its = |node| matches!(node, NodeId::Module(id) if shelved.contains(&id));
                after.alarms =
                    after.alarms.iter().filter(|it| !(it.active && is_its(it.node))).cloned().collect();
            }
            // These change nothing else that is stored; and a stop does not wait for the disk.
            OperatorAction::AskClearance { .. }
            | OperatorAction::AskRelease { .. }
            | OperatorAction::Reset { .. }
            | OperatorAction::Unshelve { .. }
            | OperatorAction::RequestStop => {}
        }
        (after.operator, after.stage, after.localization) =
            (vehicle.operator, vehicle.stage, vehicle.localization);
        let mut stored = after.to_restore();
        // The latch ends with the action.
        if let OperatorAction::Reset { module } = action {
            stored.latched.retain(|latched| latched != module);
        }
        Ok(Preview { seq: after.seq, vehicle: stored })
    }

    /// The stage and the requests. The list is replaced whenever it changes.
    pub fn requests(&self) -> (Stage, Arc<[Countermeasure]>) {
        (self.vehicle.stage, self.views.vehicle().countermeasures.clone())
    }

    /// The number of the operator's last STOP.
    pub fn last_stop(&self) -> u64 {
        self.countermeasures.last_stop
    }

    /// The requests after a change of the held ones.
    fn list_after(&mut self, done: impl FnOnce(&mut Countermeasures)) -> Arc<[Countermeasure]> {
        let held = self.countermeasures.held.clone();
        done(&mut self.countermeasures);
        let list = self.countermeasures.list(self.net.nobody());
        let is_held = |kind| self.countermeasures.held.iter().any(|held| held.request.kind() == kind);
        let after = list.iter().filter(|it| is_held(it.request.kind())).cloned().collect();
        self.countermeasures.held = held;
        after
    }

    fn preview_acknowledged(&mut self, alarm: &AlarmRef, after: &mut Snapshot) {
        let known: Vec<(NodeId, Option<u64>)> = match alarm {
            AlarmRef::Number(_) | AlarmRef::Over { .. } => {
                let numbers = self.numbers(alarm).into_iter();
                numbers.filter_map(|number| Some((self.alarms.node(number)?, Some(number)))).collect()
            }
            AlarmRef::Node(name) => {
                let places = self.node_named(name).map(|node| self.places_of(node));
                places.into_iter().flatten().map(|node| (node, None)).collect()
            }
        };
        let is_known = |id, about| {
            known.iter().any(|&(node, number)| number.map_or(about == node, |number| id == number))
        };
        let mut alarms = after.alarms.to_vec();
        alarms.iter_mut().filter(|it| is_known(it.id, it.node)).for_each(|it| it.acknowledged = true);
        alarms.retain(|it| it.active || !it.acknowledged);
        after.alarms = alarms.into();
        let latest: Vec<_> =
            known.iter().map(|(_, number)| number.map(|number| self.alarms.latest(number))).collect();
        if latest.iter().any(|it| !matches!(it, Some(None))) {
            after.countermeasures = self.list_after(|held| {
                for (&(node, _), latest) in known.iter().zip(&latest) {
                    match latest {
                        None => held.acknowledge(Acknowledged { node, alarm: None }),
                        Some(Some(alarm)) => held.acknowledge(Acknowledged { node, alarm: Some(alarm) }),
                        // The node has raised another one since.
                        Some(None) => {}
                    }
                }
            });
        }
        let nodes = known.iter().filter(|(_, number)| number.is_none());
        let warned = nodes.flat_map(|&(node, _)| self.warned_in(node)).map(NodeId::Module);
        let accepted = Arc::make_mut(&mut after.accepted);
        for node in warned {
            accepted.entry(node).or_insert(Some(self.now));
        }
    }
}
