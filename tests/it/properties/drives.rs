//! The stage machine and the countermeasures, over random vehicles and random histories.

use std::collections::BTreeSet;
use std::sync::Arc;

use proptest::prelude::*;
use telltale::engine::Engine;
use telltale::engine::event::EventKind;
use telltale::engine::input::{AlarmRef, Input, OperatorAction, Place, Refusal, Response, StatusArray};
use telltale::engine::model::countermeasure::{Request, Rule};
use telltale::engine::model::{
    GroupId, Model, ModuleId, ModuleMonitor, ModuleSpec, NodeId, SignalSpec, Stage, StageModel, When,
};
use telltale::engine::restart::resume::Restored;
use telltale::engine::snapshot::{Countermeasure, Snapshot};
use telltale::engine::stage::machine::TRANSITIONS;
use telltale::engine::state::State;
use telltale::engine::time::{Span, Timestamp};

use super::cases::{self, Choices, history};
use super::{config, numbers};

proptest! {
    #![proptest_config(config())]

    #[test]
    fn stages_follow_the_table_and_only_a_clearance_clears(numbers in numbers(), begin in 0..6_usize) {
        let mut choices = Choices::new(&numbers);
        let simple = begin < 4;
        let model = if simple { Arc::new(simple_vehicle(&mut choices)) } else { cases::model(&mut choices) };
        let mut engine = Engine::new(model.clone(), Timestamp::ZERO);
        engine.keep_events();
        if let Some(&stage) = Stage::ALL.get(begin) {
            engine.start_in(stage);
            prop_assert!(engine.snapshot().stage == stage || model.stages == StageModel::None);
            follow_table(&mut engine, Some(&Input::Operator(CLEAR)));
        }
        let mut earlier = engine.snapshot();
        let mut held_on_its_way = false;
        for (at, input) in if simple { story(&mut choices) } else { history(&mut choices) } {
            // Changes by time alone are not changes by the input.
            engine.handle(&Input::Tick, at);
            follow_table(&mut engine, None);
            let before = engine.snapshot();
            stands_still(&earlier, &before)?;
            let preview = preview(&mut engine, &input, at);
            let response = engine.handle(&input, at);
            follow_table(&mut engine, Some(&input));
            let after = engine.snapshot();
            check_preview(preview, &input, &response, &after);
            if let Response::Refused(reasons) = &response {
                prop_assert!(!reasons.is_empty());
                // A STOP that is refused counts too.
                let stop = u64::from(input == Input::Operator(OperatorAction::RequestStop));
                let (seq, revision, last_stop) =
                    (before.seq + stop, before.revision + stop, before.last_stop + stop);
                let expected = Snapshot { seq, revision, last_stop, ..Snapshot::clone(&before) };
                prop_assert_eq!(&expected, &*after, "refused: {:?}", reasons);
            }
            holds(&model, &after);
            may_be_cleared(&before, &input, &response);
            let released = matches!(input, Input::Operator(OperatorAction::Release { .. }));
            if !released {
                stands_still(&before, &after)?;
            }
            let is_released = released && response == Response::Done;
            held_on_its_way &= !is_released;
            for shown in [&before, &after] {
                prop_assert!(!held_on_its_way || shown.hold == Some(true), "{input:?} released it");
                let drives = shown.stage == Stage::Active && !(is_released && std::ptr::eq(shown, &before));
                held_on_its_way |= drives && shown.hold == Some(true) && shown.stop_requested();
            }
            let cleared = matches!(input, Input::Operator(OperatorAction::Clear { .. }));
            let is_known = |it: &Snapshot| it.hold == Some(false);
            prop_assert!(earlier.hold.is_some() || !is_known(&before), "time says that it is not held");
            prop_assert!(
                before.hold.is_some() || !is_known(&after) || is_released || cleared,
                "{input:?} says that it is not held"
            );
            earlier = after;
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
        let mut resumed = Engine::resume(model.clone(), &before.to_restore(), end);
        let after = resumed.snapshot();
        stands_still(&before, &after)?;
        let (open, kept) = (open_alarms(&before), open_alarms(&after));
        // At the limit of discovered modules a node may find no place again: then its group stands in.
        let is_full = before.modules.iter().zip(0..).any(|(_, id)| {
            before.module(ModuleId(id)).0.id.ends_with("(names past the limit)")
        });
        prop_assert!(is_full || open.is_subset(&kept), "{open:?} became {kept:?}");
        // The statuses go on, and the program restarts once more: none of this releases anything.
        resumed.handle(&all_well(&model, &before), end);
        let well = resumed.snapshot();
        stands_still(&before, &well)?;
        stands_still(&before, &Engine::resume(model.clone(), &well.to_restore(), end).snapshot())?;
        let stage = match before.stage {
            Stage::Standby if before.localization.is_open() => Stage::Localizing,
            Stage::Cleared => Stage::Standby,
            stage => stage,
        };
        prop_assert_eq!(after.stage, stage);
        if matches!(after.stage, Stage::Standby | Stage::Active) && model.stages == StageModel::Shuttle {
            prop_assert_eq!(after.localization.is_open(), before.localization.is_open());
        }
        prop_assert_eq!(&after.operator, &before.operator);
        prop_assert!(!after.clearance && after.last_alarm >= before.last_alarm);
        holds(&model, &after);
    }
}

/// A request that moves a vehicle that drove still stands, and as strongly.
fn stands_still(before: &Snapshot, after: &Snapshot) -> Result<(), TestCaseError> {
    if before.stage != Stage::Active {
        return Ok(());
    }
    for measure in before.countermeasures.iter().filter(|it| it.request.kind().moves()) {
        let same_kind = |it: &&Countermeasure| it.request.kind() == measure.request.kind();
        let kept = after.countermeasures.iter().find(same_kind);
        prop_assert!(kept.is_some(), "{measure:?} became {kept:?}");
        if let (Request::Decelerate { mps2 }, Some(Request::Decelerate { mps2: kept })) =
            (measure.request, kept.map(|it| it.request))
        {
            prop_assert!(kept >= mps2);
        }
    }
    Ok(())
}

/// Numbers and names of alarms that nobody acknowledged.
fn open_alarms(snapshot: &Snapshot) -> BTreeSet<(u64, String)> {
    let open = snapshot.alarms.iter().filter(|alarm| !alarm.acknowledged);
    open.map(|alarm| (alarm.id, snapshot.node_name(alarm.node).to_string())).collect()
}

/// Every module that has a status reports OK.
fn all_well(model: &Model, seen: &Snapshot) -> Input {
    let mut array = StatusArray::default();
    for module in &model.modules {
        if let Some(status) = module.monitor.status() {
            array.push_status(0, status, "", "");
        }
    }
    for module in seen.layout.modules.iter().filter(|module| module.discovered && !module.gone) {
        let path = &seen.layout.groups[module.group.0 as usize].path;
        array.push_status(0, &module.id[path.len() + 1..], "", "");
    }
    Input::Diagnostics(array)
}

const CLEAR: OperatorAction = OperatorAction::Clear { display_live: true, storage_ok: true };

/// A vehicle that is easily cleared: it needs a position and a goal.
fn simple_vehicle(choices: &mut Choices<'_>) -> Model {
    let mut parts = cases::parts(&mut Choices::new(&[]));
    parts.stages = StageModel::Shuttle;
    parts.groups[0].path = "localization".into();
    parts.groups[0].when = Some(When { posed: Some(true), ..When::default() });
    let monitor = ModuleMonitor::SelfState("s0".into());
    parts.modules.push(ModuleSpec::new("localization/m", GroupId(0), monitor));
    let goal =
        SignalSpec { name: "goal".into(), present_for: Some(Span::from_secs(5)), ..parts.signals[0].clone() };
    parts.signals.push(goal);
    parts.signals[0].timeout = choices.one_in(2).then(|| Span::from_secs(2));
    parts.driving.countermeasures.push(Rule {
        request: Request::ManeuverStop,
        nodes: vec![NodeId::Group(GroupId(0))],
        state: State::Error,
        stages: vec![Stage::Active, Stage::Cleared],
        confirmation: None,
    });
    Model::new(parts).expect("nothing depends on anything")
}

/// What mostly leads on: all is well, and an operator who wants to drive.
fn story(choices: &mut Choices<'_>) -> Vec<(Timestamp, Input)> {
    let mut inputs = Vec::new();
    let mut millis = 0;
    while !choices.is_empty() && inputs.len() < 80 {
        millis += [0, 10, 300][choices.below(3)];
        let signal = |name: &str, value| Input::Signal { name: name.into(), value };
        let input = match choices.below(12) {
            0 => Input::Operator(OperatorAction::Login { name: "anna".into() }),
            1 => Input::Operator(OperatorAction::Localize {
                place: Place::Pose { x_m: 0.0, y_m: 0.0, yaw_deg: 0.0 },
            }),
            2 => signal("goal", true),
            3 | 4 => Input::Operator(CLEAR),
            5 => signal("active", true),
            6 => signal("active", choices.one_in(4)),
            7 => Input::Operator(OperatorAction::Acknowledge {
                alarm: AlarmRef::Node("localization/m".into()),
            }),
            8 => match choices.below(4) {
                0 => Input::Operator(OperatorAction::Logout),
                1 => Input::Operator(OperatorAction::RequestStop),
                2 => Input::Operator(OperatorAction::Release { display_live: true, storage_ok: true }),
                _ => Input::Tick,
            },
            _ => {
                let mut array = StatusArray::default();
                array.push_status([0, 0, 0, 0, 0, 1, 2][choices.below(7)], "s0", "", "");
                Input::Diagnostics(array)
            }
        };
        inputs.push((Timestamp::from_millis(millis), input));
    }
    inputs
}

fn strength(snapshot: &Snapshot) -> u32 {
    snapshot.countermeasure().map_or(0, |it| match it.request {
        Request::Notify => 1,
        Request::ManeuverStop => 2,
        Request::Decelerate { .. } => 3,
    })
}

/// Every change of the stage is in the table, and only a clearance leads into `cleared`.
fn follow_table(engine: &mut Engine, input: Option<&Input>) {
    for event in engine.take_events() {
        let EventKind::Stage { from, to } = event.what else { continue };
        let known = TRANSITIONS.iter().any(|row| row.from.contains(&from) && row.to == to);
        assert!(known, "no row leads from {from:?} to {to:?}");
        if to == Stage::Cleared {
            assert!(matches!(input, Some(Input::Operator(OperatorAction::Clear { .. }))), "{input:?}");
        }
    }
}

/// What would be remembered of an action, which nothing shows.
fn preview(engine: &mut Engine, input: &Input, at: Timestamp) -> Option<Result<Restored, Vec<Refusal>>> {
    let Input::Operator(action) = input else { return None };
    let before = (engine.seq(), engine.revision());
    let preview = engine.preview(action, at);
    engine.handle(&Input::Tick, at);
    assert_eq!(before, (engine.seq(), engine.revision()), "{action:?} was only to be judged");
    Some(preview.map(|preview| preview.vehicle))
}

/// What is written down before an action is what is there after it.
fn check_preview(
    preview: Option<Result<Restored, Vec<Refusal>>>,
    input: &Input,
    response: &Response,
    after: &Snapshot,
) {
    let (Some(preview), Input::Operator(action)) = (preview, input) else { return };
    let mut preview = match (preview, response) {
        (Ok(preview), Response::Done) => preview,
        (Err(reasons), Response::Refused(refused)) => return assert_eq!(reasons, *refused),
        (preview, response) => panic!("{preview:?} was the preview, and then {response:?}"),
    };
    let mut after = after.to_restore();
    match action {
        // A stop is not written before. A pose may be confirmed at once, and an alarm whose node
        // matters no more with the new stage is over.
        OperatorAction::RequestStop => return,
        // That a request is not confirmed is over with the request.
        OperatorAction::Acknowledge { .. } | OperatorAction::Release { .. } => {
            for vehicle in [&mut preview, &mut after] {
                vehicle.alarms.retain(|alarm| &*alarm.node != "telltale/countermeasure");
            }
        }
        _ => {
            (preview.alarms, preview.last_alarm) = (after.alarms.clone(), after.last_alarm);
            preview.accepted.clone_from(&after.accepted);
            preview.countermeasures.clone_from(&after.countermeasures);
        }
    }
    if matches!(action, OperatorAction::Localize { .. }) && after.stage == Stage::Standby {
        (preview.stage, preview.posed) = (after.stage, after.posed);
        preview.last_known = after.last_known;
    }
    assert_eq!(preview, after, "{action:?}");
}

/// Conditions that hold for every snapshot.
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
