//! The statements of `telltale check` about a configuration, compared with the engine: every reachable
//! situation, with every combination of failing statuses.

use std::sync::Arc;

use proptest::collection::vec;
use proptest::prelude::*;
use telltale::config::soundness::judge::Judge;
use telltale::config::soundness::situation::{self, Situation};
use telltale::config::soundness::{Finding, FindingKind, look};
use telltale::engine::Engine;
use telltale::engine::input::{Input, OperatorAction, Place, StatusArray};
use telltale::engine::model::{GroupId, Model, ModuleId, ModuleMonitor, NodeId, Parts, Stage, StageModel};
use telltale::engine::snapshot::{Reason, Snapshot};
use telltale::engine::state::State;
use telltale::engine::time::{Span, Timestamp};

use super::cases::{self, Choices};

fn numbers() -> impl Strategy<Value = Vec<u32>> {
    vec(any::<u32>(), 20..160)
}

fn config() -> ProptestConfig {
    ProptestConfig { cases: super::config().cases.div_ceil(100), ..super::config() }
}

/// A random vehicle of few enough statuses, with room for what its filters take.
fn parts(numbers: &[u32]) -> Parts {
    let mut parts = cases::parts(&mut Choices::new(numbers));
    for module in &mut parts.modules {
        let ModuleMonitor::SelfState(status) = &mut module.monitor else { continue };
        let number = status[1..].parse::<usize>().expect("named s0 to s8");
        *status = format!("s{}", number % 4).into();
    }
    // The writers do not matter here.
    parts.modules.iter_mut().for_each(|module| module.policy.writers = None);
    let filters = parts.groups.iter_mut().flat_map(|group| &mut group.filters);
    filters.filter_map(|filter| filter.policy.as_mut()).for_each(|policy| policy.writers = None);
    parts.discovered.writers = None;
    parts.limits.discovered_modules = 100;
    parts.driving.localized_after = Span::from_nanos(1);
    parts
}

/// Situations that the engine can be brought into.
fn reachable(model: &Model) -> Vec<Situation> {
    let named = (0..model.signals.len()).collect();
    let all = situation::all(model, &named, true, 1000).expect("there are two signals");
    // What is cleared was in standby, and nobody clears a broken vehicle.
    all.into_iter().filter(|situation| situation.stage != Stage::Cleared).collect()
}

/// What the engine shows where status `s{n}` has the state of `states[n]`, and what filters take is OK.
fn run(model: &Arc<Model>, situation: &Situation, states: &[State]) -> Arc<Snapshot> {
    let mut now = Timestamp::ZERO;
    let mut engine = Engine::new(model.clone(), now);
    if situation.stage != Stage::Locked {
        engine.handle(&Input::Operator(OperatorAction::Login { name: "anna".into() }), now);
    }
    if situation.posed {
        let place = Place::Pose { x_m: 0.0, y_m: 0.0, yaw_deg: 0.0 };
        engine.handle(&Input::Operator(OperatorAction::Localize { place }), now);
    }
    if situation.stage == Stage::Standby {
        now = Timestamp::from_nanos(1);
    }
    for (spec, value) in model.signals.iter().zip(&situation.signals) {
        if let Some(value) = *value {
            engine.handle(&Input::Signal { name: spec.name.clone(), value }, now);
        }
    }
    let mut array = StatusArray::default();
    for (number, state) in states.iter().enumerate() {
        let level = match state {
            State::Ok => 0,
            State::Error => 2,
            _ => 3,
        };
        array.push_status(level, &format!("s{number}"), "", "");
    }
    array.push_status(0, "/d0/x", "", "");
    array.push_status(0, "/d1/x", "", "");
    engine.handle(&Input::Diagnostics(array), now);
    let snapshot = engine.snapshot();
    assert!(model.stages == StageModel::None || snapshot.stage == situation.stage);
    snapshot
}

/// OK or ERROR for each of the four statuses, and UNKNOWN for all.
fn assignments() -> Vec<Vec<State>> {
    let state = |failing: bool| if failing { State::Error } else { State::Ok };
    let errors = (0..16).map(|bits| (0..4).map(|bit| state(bits & 1 << bit != 0)).collect());
    errors.chain([vec![State::Unknown; 4]]).collect()
}

fn status_of(model: &Model, id: ModuleId) -> usize {
    let status = model.modules[id.0 as usize].monitor.status().expect("they judge a status");
    status[1..].parse().expect("named s0 to s3")
}

fn masked(snapshot: &Snapshot, node: NodeId) -> bool {
    matches!(snapshot.shown(node).1, Some(Reason::Masked { .. }))
}

fn any_tile_is_bad(snapshot: &Snapshot) -> bool {
    snapshot.tiles().any(|tile| is_bad(snapshot.group(tile).1.state))
}

fn is_bad(state: State) -> bool {
    state >= State::Unknown
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn the_still_picture_of_a_check_is_what_the_engine_shows(numbers in numbers()) {
        let model = Arc::new(Model::new(parts(&numbers)).expect("no cycles"));
        let judge = Judge::new(&model);
        for situation in reachable(&model) {
            for states in assignments() {
                let snapshot = run(&model, &situation, &states);
                let picture =
                    judge.picture(&situation, |id| states[status_of(&model, id)], Some(State::Ok));
                for node in model.nodes() {
                    let facts = picture.of(node);
                    let name = judge.model.node_name(node);
                    prop_assert_eq!(facts.shown, snapshot.shown(node).0, "{} in {:?}", name, situation);
                    if facts.relevant {
                        prop_assert_eq!(facts.own, snapshot.own(node), "own state of {}", name);
                        prop_assert!(!facts.blocked || masked(&snapshot, node), "{}", name);
                    }
                }
            }
        }
    }

    #[test]
    fn what_a_check_claims_holds_in_the_engine(numbers in numbers()) {
        claims_hold(parts(&numbers));
    }
}

fn claims_hold(parts: Parts) {
    let model = Arc::new(Model::new(parts.clone()).expect("no cycles"));
    let found = look(&model);
    assert!(found.complete);
    let hidden = found.findings.iter().any(|it| matches!(it.what, FindingKind::HiddenCause { .. }));
    let mut ok = vec![false; model.groups.len()];
    for situation in reachable(&model) {
        for states in assignments() {
            let snapshot = run(&model, &situation, &states);
            for (group, ok) in (0..).map(GroupId).zip(&mut ok) {
                *ok |= snapshot.group(group).1.state == State::Ok;
            }
            for node in model.nodes() {
                let Some(Reason::Masked { by }) = snapshot.shown(node).1 else { continue };
                assert!(!by.is_empty());
                assert!(by.iter().all(|&root| snapshot.shown(root).0 >= State::Unknown));
                assert!(hidden || any_tile_is_bad(&snapshot), "{situation:?} {states:?}");
            }
        }
    }
    assert!(hidden || nothing_is_hidden(&model));
    for finding in &found.findings {
        assert!(finding.what != FindingKind::Unexplained);
        if let (FindingKind::NeverOk { .. }, NodeId::Group(id)) = (&finding.what, finding.node) {
            assert!(!ok[id.0 as usize], "{finding:?}");
        }
        replay(&model, finding);
        without(&parts, &model, finding);
    }
}

/// With every combination of OK, UNKNOWN and ERROR, a tile is bad where anything is masked.
fn nothing_is_hidden(model: &Model) -> bool {
    let judge = Judge::new(model);
    let states = |mut number: usize| {
        [(); 4].map(|()| {
            let state = [State::Ok, State::Unknown, State::Error][number % 3];
            number /= 3;
            state
        })
    };
    let mut all = (0..81).map(states).flat_map(|it| reachable(model).into_iter().map(move |at| (at, it)));
    all.all(|(situation, states)| {
        let picture = judge.picture(&situation, |id| states[status_of(model, id)], Some(State::Ok));
        let mut tiles = model.nodes().filter(|&node| judge.model.parent(node).is_none());
        !model.nodes().any(|node| picture.of(node).masked())
            || tiles.any(|tile| is_bad(picture.of(tile).shown))
    })
}

/// Brings the engine into the example of a finding.
fn replay(model: &Arc<Model>, finding: &Finding) {
    let Some(example) = &finding.example else { return };
    if !reachable(model).iter().any(|it| it.stage == example.situation.stage) {
        return;
    }
    let mut states = vec![State::Ok; 4];
    for &id in &example.failing {
        states[status_of(model, id)] = example.state;
    }
    // Modules may share a status; then more fails than the example says.
    let shared = (0..model.modules.len() as u32)
        .map(ModuleId)
        .any(|id| states[status_of(model, id)] != State::Ok && !example.failing.contains(&id));
    if shared {
        return;
    }
    let mut situation = example.situation.clone();
    if situation.stage == Stage::Active && model.stages == StageModel::Shuttle {
        // No condition asks for it, but without it nothing drives.
        situation.signals[0] = Some(true);
    }
    let snapshot = run(model, &situation, &states);
    match finding.what {
        FindingKind::HiddenCause { masked: node, .. } => {
            let before = run(model, &situation, &[State::Ok; 4]);
            let worse = snapshot
                .tiles()
                .any(|tile| is_bad(snapshot.group(tile).1.state) && !is_bad(before.group(tile).1.state));
            assert!(masked(&snapshot, node) && !worse, "{finding:?}");
        }
        FindingKind::AlwaysMasked { .. } => assert!(masked(&snapshot, finding.node), "{finding:?}"),
        _ => {}
    }
}

/// The state of a node and its causes. Which of several conditions makes it irrelevant is not compared.
fn told(snapshot: &Snapshot, node: NodeId) -> (State, Vec<NodeId>) {
    match snapshot.shown(node) {
        (state, Some(Reason::Masked { by })) => (state, by.to_vec()),
        (state, _) => (state, Vec::new()),
    }
}

/// What can never mask, and a condition that changes nothing, can be left out.
fn without(parts: &Parts, model: &Arc<Model>, finding: &Finding) {
    let mut less = parts.clone();
    match (&finding.what, finding.node) {
        (FindingKind::DeadDependency { dependency, .. }, NodeId::Group(id)) => {
            less.groups[id.0 as usize].depends_on.remove(*dependency);
        }
        (FindingKind::DeadDependency { dependency, .. }, NodeId::Module(id)) => {
            less.modules[id.0 as usize].depends_on.remove(*dependency);
        }
        (FindingKind::AlwaysHolds, NodeId::Group(id)) => less.groups[id.0 as usize].when = None,
        (FindingKind::AlwaysHolds, NodeId::Module(id)) => less.modules[id.0 as usize].when = None,
        _ => return,
    }
    let less = Arc::new(Model::new(less).expect("leaving out closes no circle"));
    for situation in reachable(model) {
        if finding.what == FindingKind::AlwaysHolds && situation.signals.contains(&None) {
            continue;
        }
        for states in assignments() {
            let (with, without) = (run(model, &situation, &states), run(&less, &situation, &states));
            for node in model.nodes() {
                assert_eq!(told(&with, node), told(&without, node), "{finding:?} in {situation:?}");
            }
        }
    }
}
