//! The vehicle's stages and their guards (`ENGINE.md` 9; paper, Sec. IV-B).

use std::sync::Arc;

use super::input::{OperatorAction, Refusal};
use super::model::{Stage, StageModel};

/// Who leads the vehicle, and how far it is.
#[derive(Debug, Clone)]
pub(super) struct Vehicle {
    model: StageModel,
    pub(super) stage: Stage,
    pub(super) operator: Option<Arc<str>>,
    active: bool,
}

impl Vehicle {
    pub(super) fn new(model: StageModel) -> Vehicle {
        let stage = match model {
            StageModel::Shuttle => Stage::Locked,
            StageModel::None => Stage::Active,
        };
        Vehicle { model, stage, operator: None, active: false }
    }

    /// The same vehicle under another model of stages.
    pub(super) fn with_stages(&self, model: StageModel) -> Vehicle {
        let mut vehicle = Vehicle { model, ..self.clone() };
        vehicle.settle();
        vehicle
    }

    /// Takes an operator's action, or refuses it with every reason and changes nothing.
    pub(super) fn operate(&mut self, action: &OperatorAction) -> Result<(), Vec<Refusal>> {
        match action {
            OperatorAction::Login { name } => self.operator = Some(Arc::from(&**name)),
            OperatorAction::Logout => {
                if self.stage == Stage::Active && self.model == StageModel::Shuttle {
                    return Err(vec![Refusal::LogoutWhileActive]);
                }
                self.operator = None;
            }
            // Says nothing about the vehicle's stage.
            _ => {}
        }
        self.settle();
        Ok(())
    }

    /// The Mission component's word on whether the vehicle drives itself. It is the truth: it
    /// makes the stage active with or without an operator.
    pub(super) fn set_active(&mut self, active: bool) {
        self.active = active;
        self.settle();
    }

    fn settle(&mut self) {
        self.stage = match (self.model, self.active, &self.operator) {
            (StageModel::None, ..) | (StageModel::Shuttle, true, _) => Stage::Active,
            (StageModel::Shuttle, false, Some(_)) => Stage::Standby,
            (StageModel::Shuttle, false, None) => Stage::Locked,
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn login() -> OperatorAction {
        OperatorAction::Login { name: "anna".into() }
    }

    #[test]
    fn a_login_leads_to_standby_and_the_active_signal_to_active_and_back() {
        let mut vehicle = Vehicle::new(StageModel::Shuttle);
        assert_eq!(vehicle.stage, Stage::Locked);
        vehicle.operate(&login()).unwrap();
        assert_eq!(vehicle.stage, Stage::Standby);
        vehicle.set_active(true);
        assert_eq!(vehicle.stage, Stage::Active);
        vehicle.set_active(false);
        assert_eq!(vehicle.stage, Stage::Standby);
        vehicle.operate(&OperatorAction::Logout).unwrap();
        assert_eq!((vehicle.stage, vehicle.operator), (Stage::Locked, None));
    }

    #[test]
    fn logout_while_active_is_refused_and_changes_nothing() {
        let mut vehicle = Vehicle::new(StageModel::Shuttle);
        vehicle.operate(&login()).unwrap();
        vehicle.set_active(true);
        assert_eq!(vehicle.operate(&OperatorAction::Logout), Err(vec![Refusal::LogoutWhileActive]));
        assert_eq!((vehicle.stage, vehicle.operator.as_deref()), (Stage::Active, Some("anna")));
    }

    #[test]
    fn active_without_an_operator_is_active_all_the_same() {
        let mut vehicle = Vehicle::new(StageModel::Shuttle);
        vehicle.set_active(true);
        assert_eq!((vehicle.stage, &vehicle.operator), (Stage::Active, &None));
        vehicle.set_active(false);
        assert_eq!(vehicle.stage, Stage::Locked);
    }

    #[test]
    fn a_machine_without_stages_is_always_active() {
        let mut vehicle = Vehicle::new(StageModel::None);
        vehicle.operate(&login()).unwrap();
        vehicle.set_active(false);
        vehicle.operate(&OperatorAction::Logout).unwrap();
        assert_eq!((vehicle.stage, vehicle.operator), (Stage::Active, None));
    }
}
