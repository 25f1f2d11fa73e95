//! The vehicle's stages and the transitions between them (paper, Sec. IV-B).

use std::sync::Arc;

use crate::model::{Stage, StageModel};
use crate::snapshot::{Localization, MapPose};
use crate::text::words;
use crate::time::Timestamp;
use Stage::{Active, Cleared, Localizing, Locked, Standby};

/// A transition between two stages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Transition {
    pub from: &'static [Stage],
    pub event: StageEvent,
    pub guard: Guard,
    pub to: Stage,
}

const fn row(from: &'static [Stage], event: StageEvent, guard: Guard, to: Stage) -> Transition {
    Transition { from, event, guard, to }
}

/// All transitions. Every other one is impossible.
pub const TRANSITIONS: &[Transition] = &[
    row(&[Locked], StageEvent::Login, Guard::None, Localizing),
    row(&[Localizing], StageEvent::Localized, Guard::Localized, Standby),
    row(&[Standby], StageEvent::Clearance, Guard::Checks, Cleared),
    row(&[Cleared], StageEvent::Withdrawn, Guard::None, Standby),
    row(&[Cleared], StageEvent::GoalGone, Guard::None, Standby),
    row(&[Cleared], StageEvent::Countermeasure, Guard::None, Standby),
    row(&[Cleared], StageEvent::Reloaded, Guard::None, Standby),
    row(&[Cleared], StageEvent::HandOver, Guard::None, Standby),
    row(&[Locked, Localizing, Standby, Cleared], StageEvent::ActiveTrue, Guard::None, Active),
    row(&[Active], StageEvent::ActiveFalse, Guard::Operator, Standby),
    row(&[Active], StageEvent::ActiveFalse, Guard::Nobody, Locked),
    row(&[Localizing, Standby, Cleared], StageEvent::Logout, Guard::None, Locked),
    row(&[Localizing, Standby, Cleared], StageEvent::Shutdown, Guard::None, Locked),
];

words! {
    /// An event that may lead to another stage. Its words are for people.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum StageEvent {
        Login = "login",
        Localized = "localized",
        Clearance = "clearance",
        Withdrawn = "clearance withdrawn",
        GoalGone = "goal gone",
        Countermeasure = "countermeasure engaged",
        Reloaded = "another configuration",
        HandOver = "another operator",
        ActiveTrue = "Active true",
        ActiveFalse = "Active false",
        Logout = "logout",
        Shutdown = "shutdown",
    }
}

words! {
    /// A further condition of a transition. Its words are for people.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum Guard {
        None = "",
        Localized = "pose given, localization OK since then for long enough",
        Checks = "goal set, groups OK or WARNINGs accepted, no countermeasure, display live, storage writable",
        Operator = "an operator is logged in",
        Nobody = "nobody is logged in",
    }
}

/// The operator and the stage.
#[derive(Debug, Clone)]
pub(crate) struct Vehicle {
    pub(crate) model: StageModel,
    pub(crate) stage: Stage,
    pub(crate) operator: Option<Arc<str>>,
    pub(crate) localization: Localization,
    /// Whether it drove when its stages went by a reload.
    pub(crate) drove: bool,
}

impl Vehicle {
    pub(crate) fn new(model: StageModel) -> Vehicle {
        let stage = match model {
            StageModel::Shuttle => Locked,
            StageModel::None => Active,
        };
        Vehicle { model, stage, operator: None, localization: Localization::default(), drove: false }
    }

    /// Raises an event. Returns whether the stage changed.
    pub(crate) fn raise(&mut self, event: StageEvent) -> bool {
        if self.model == StageModel::None {
            return false;
        }
        let holds = |guard| match guard {
            // The caller of `Clear` has just made its checks.
            Guard::None | Guard::Checks => true,
            Guard::Localized => self.localization.done,
            Guard::Operator => self.operator.is_some(),
            Guard::Nobody => self.operator.is_none(),
        };
        let mut rows = TRANSITIONS.iter();
        let taken = rows.find(|row| row.event == event && row.from.contains(&self.stage) && holds(row.guard));
        let Some(row) = taken else { return false };
        if row.to == Active {
            self.localization.last_known = None;
            self.localization.skipped |= matches!(self.stage, Locked | Localizing) && !self.localization.done;
        }
        if matches!(row.to, Locked | Localizing) {
            self.localization = Localization {
                given: None,
                ok_since: None,
                done: false,
                skipped: false,
                late: false,
                ..self.localization
            };
        }
        self.stage = row.to;
        true
    }

    /// An operator logs in. Returns the event of that login.
    pub(crate) fn put_in_charge(&mut self, name: &str) -> StageEvent {
        let before = self.operator.replace(Arc::from(name));
        if before.is_some_and(|before| *before != *name) { StageEvent::HandOver } else { StageEvent::Login }
    }

    /// Takes the operator's pose, which must be confirmed from now on.
    pub(crate) fn localize(&mut self, pose: MapPose, now: Timestamp) {
        let number = self.localization.number + 1;
        self.localization = Localization {
            number,
            pose: Some(pose),
            given: Some(now),
            ok_since: None,
            done: false,
            late: false,
            ..self.localization
        };
    }

    /// The built-in signal `posed`: true in every stage after localizing.
    pub(crate) fn posed(&self) -> bool {
        match self.stage {
            Locked => false,
            Localizing => self.localization.given.is_some(),
            Standby | Cleared | Active => true,
        }
    }

    /// The stage under another model of stages. `drives` is the signal `active`, `None` while it is not known. A
    /// shuttle that drives goes on driving until the signal says otherwise, also where the signal is gone.
    pub(crate) fn reload(&mut self, model: StageModel, drives: Option<bool>) {
        let before = std::mem::replace(&mut self.model, model);
        let parked = if self.operator.is_some() { Standby } else { Locked };
        if before == StageModel::Shuttle {
            self.drove = self.stage == Active;
        }
        self.stage = match (model, before) {
            (StageModel::None, _) => Active,
            (StageModel::Shuttle, StageModel::None) if drives.unwrap_or(self.drove) => Active,
            (StageModel::Shuttle, StageModel::None) => parked,
            (StageModel::Shuttle, StageModel::Shuttle) => self.stage,
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Raises events in order and compares the stage after each.
    fn check(vehicle: &mut Vehicle, steps: &[(StageEvent, Stage)]) {
        for (index, (event, stage)) in steps.iter().enumerate() {
            vehicle.raise(*event);
            assert_eq!(vehicle.stage, *stage, "after event {index}, {event:?}");
        }
    }

    fn vehicle() -> Vehicle {
        Vehicle { operator: Some("anna".into()), ..Vehicle::new(StageModel::Shuttle) }
    }

    #[test]
    fn the_story_from_login_to_arrival_and_again() {
        let mut vehicle = vehicle();
        check(&mut vehicle, &[(StageEvent::Login, Localizing), (StageEvent::Localized, Localizing)]);
        vehicle.localization.done = true;
        check(
            &mut vehicle,
            &[
                (StageEvent::Localized, Standby),
                (StageEvent::Clearance, Cleared),
                (StageEvent::ActiveTrue, Active),
                (StageEvent::Clearance, Active),
                (StageEvent::Logout, Active),
                (StageEvent::Shutdown, Active),
                (StageEvent::ActiveFalse, Standby),
                (StageEvent::Clearance, Cleared),
                (StageEvent::GoalGone, Standby),
                (StageEvent::Logout, Locked),
            ],
        );
    }

    #[test]
    fn active_is_the_truth_in_every_stage_and_flapping_never_brings_a_clearance_back() {
        for stage in [Locked, Localizing, Standby, Cleared] {
            let mut vehicle = Vehicle { stage, ..vehicle() };
            check(
                &mut vehicle,
                &[
                    (StageEvent::ActiveTrue, Active),
                    (StageEvent::ActiveFalse, Standby),
                    (StageEvent::ActiveTrue, Active),
                ],
            );
            vehicle.operator = None;
            check(&mut vehicle, &[(StageEvent::ActiveFalse, Locked), (StageEvent::ActiveFalse, Locked)]);
        }
    }

    #[test]
    fn only_one_row_of_the_table_answers() {
        for stage in Stage::ALL {
            for row in TRANSITIONS.iter().filter(|row| row.from.contains(&stage)) {
                let alike = TRANSITIONS
                    .iter()
                    .filter(|it| it.event == row.event && it.guard == row.guard && it.from.contains(&stage));
                assert_eq!(alike.count(), 1, "{row:?}");
            }
        }
    }

    #[test]
    fn a_vehicle_that_drove_before_it_had_no_stages_drives_until_it_says_otherwise() {
        for (stage, drives, expected) in [
            (Active, None, Active),
            (Active, Some(false), Standby),
            (Standby, None, Standby),
            (Standby, Some(true), Active),
        ] {
            let mut vehicle = Vehicle { stage, ..vehicle() };
            vehicle.reload(StageModel::None, None);
            vehicle.reload(StageModel::None, None);
            vehicle.reload(StageModel::Shuttle, drives);
            assert_eq!(vehicle.stage, expected, "{stage:?}, {drives:?}");
        }
    }

    #[test]
    fn a_machine_without_stages_is_always_active() {
        let mut vehicle = Vehicle::new(StageModel::None);
        check(
            &mut vehicle,
            &[(StageEvent::Login, Active), (StageEvent::ActiveFalse, Active), (StageEvent::Logout, Active)],
        );
    }
}
