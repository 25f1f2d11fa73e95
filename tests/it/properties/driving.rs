//! The stage machine and the countermeasures, over random vehicles and random histories.

use std::sync::Arc;

use proptest::prelude::*;
use telltale::engine::Engine;
use telltale::engine::countermeasure::Request;
use telltale::engine::event::What;
use telltale::engine::input::{Input, OperatorAction, Response};
use telltale::engine::model::{Model, Stage, StageModel};
use telltale::engine::snapshot::Snapshot;
use telltale::engine::time::Timestamp;
use telltale::engine::vehicle::TRANSITIONS;

use super::cases::{self, Choices, history};
use super::{config, numbers};

proptest! {
    #![proptest_config(config())]

    #[test]
    fn stages_follow_the_table_and_only_a_clearance_clears(numbers in numbers()) {
        let mut choices = Choices::new(&numbers);
        let model = cases::model(&mut choices);
        let mut engine = Engine::new(model.clone(), Timestamp::ZERO);
        engine.keep_events();
        for (at, input) in history(&mut choices) {
            // What time alone does is not what the input does.
            engine.handle(&Input::Tick, at);
            follow_table(&mut engine, None);
            let before = engine.snapshot();
            let response = engine.handle(&input, at);
            follow_table(&mut engine, Some(&input));
            let after = engine.snapshot();
            if let Response::Refused(reasons) = &response {
                prop_assert!(!reasons.is_empty());
                prop_assert_eq!(format!("{before:#?}"), format!("{after:#?}"), "refused: {:?}", reasons);
            }
            holds(&model, &after);
            may_be_cleared(&before, &input, &response);
        }
    }

    #[test]
    fn masking_never_weakens_a_reaction(numbers in numbers()) {
        let mut choices = Choices::new(&numbers);
        let parts = cases::parts(&mut choices);
        let mut plain = parts.clone();
        plain.groups.iter_mut().for_each(|group| group.depends_on.clear());
        plain.modules.iter_mut().for_each(|module| module.depends_on.clear());
        let engine = |parts| Engine::new(Arc::new(Model::new(parts).expect("no cycles")), Timestamp::ZERO);
        let (mut masking, mut plain) = (engine(parts), engine(plain));
        for (at, input) in history(&mut choices) {
            // What an operator decides depends on what is shown; here both are to be in one stage.
            let decides = matches!(&input, Input::Operator(action) if !matches!(
                action, OperatorAction::Login { .. } | OperatorAction::Logout | OperatorAction::Reset { .. }
            ));
            if decides {
                continue;
            }
            masking.handle(&input, at);
            plain.handle(&input, at);
            let (with, without) = (masking.snapshot(), plain.snapshot());
            prop_assert_eq!(with.stage, without.stage);
            prop_assert!(
                strength(&with) >= strength(&without),
                "{:?} with masking, {:?} without", with.countermeasures, without.countermeasures
            );
            prop_assert!(with.deceleration() >= without.deceleration());
            prop_assert!(with.maneuver_stop() || !without.maneuver_stop());
            for measure in with.countermeasures.iter().filter(|it| !it.latched) {
                prop_assert!(!measure.causes.is_empty(), "{measure:?} has no cause");
            }
        }
    }

    #[test]
    fn a_restart_keeps_what_the_operator_decided_but_no_clearance(numbers in numbers()) {
        let mut choices = Choices::new(&numbers);
        let model = cases::model(&mut choices);
        let mut engine = Engine::new(model.clone(), Timestamp::ZERO);
        let mut end = Timestamp::ZERO;
        for (at, input) in history(&mut choices) {
            engine.handle(&input, at);
            end = at;
        }
        let before = engine.snapshot();
        let after = Engine::resume(model.clone(), &before.to_restore(), end).snapshot();
        let cleared = before.stage == Stage::Cleared;
        prop_assert_eq!(after.stage, if cleared { Stage::Standby } else { before.stage });
        prop_assert_eq!(&after.operator, &before.operator);
        prop_assert!(!after.clearance && after.last_alarm >= before.last_alarm);
        holds(&model, &after);
    }
}

fn strength(snapshot: &Snapshot) -> u32 {
    snapshot.countermeasure().map_or(0, |it| match it.request {
        Request::Notify => 1,
        Request::ManeuverStop => 2,
        Request::Decelerate { .. } => 3,
    })
}

/// Every change of the stage is a row of the table, and one into `cleared` comes of a clearance alone.
fn follow_table(engine: &mut Engine, input: Option<&Input>) {
    for event in engine.take_events() {
        let What::Stage { from, to } = event.what else { continue };
        let known = TRANSITIONS.iter().any(|row| row.from.contains(&from) && row.to == to);
        assert!(known, "no row leads from {from:?} to {to:?}");
        if to == Stage::Cleared {
            assert!(matches!(input, Some(Input::Operator(OperatorAction::Clear { .. }))), "{input:?}");
        }
    }
}

/// What must be true of every snapshot.
fn holds(model: &Model, snapshot: &Snapshot) {
    assert_eq!(snapshot.clearance, snapshot.stage == Stage::Cleared);
    let active = snapshot.signals.iter().find(|(name, _)| &**name == "active").and_then(|(_, value)| *value);
    if model.stages == StageModel::None || active == Some(true) {
        assert_eq!(snapshot.stage, Stage::Active);
    }
    if !matches!(snapshot.stage, Stage::Locked | Stage::Active) {
        assert!(snapshot.operator.is_some(), "{:?} without an operator", snapshot.stage);
        assert_ne!(active, Some(true));
    }
    let mut kinds: Vec<_> = snapshot.countermeasures.iter().map(|it| it.request.kind()).collect();
    let listed = kinds.clone();
    kinds.sort_unstable_by(|a, b| b.cmp(a));
    kinds.dedup();
    assert_eq!(listed, kinds, "strongest first, each once");
}

/// A clearance that is granted had nothing against it.
fn may_be_cleared(before: &Snapshot, input: &Input, response: &Response) {
    let Input::Operator(OperatorAction::Clear { display_live, storage_ok }) = input else { return };
    let granted = *response == Response::Done;
    let expected = before.clearance_refusals.is_empty() && *display_live && *storage_ok;
    assert_eq!(granted, expected, "{:?}", before.clearance_refusals);
    if granted {
        assert_eq!(before.stage, Stage::Standby);
    }
}
