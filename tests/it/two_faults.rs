//! Two single faults at once, in every pair of modules of the shipped vehicles: dependencies explain what follows from
//! a fault, and hide no second one.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use telltale::config;
use telltale::engine::Engine;
use telltale::engine::input::{Input, StatusArray};
use telltale::engine::model::wording::Urgency;
use telltale::engine::model::{
    Dependency, GroupId, Model, ModuleId, ModuleMonitor, NodeId, Parts, Stage, Within,
};
use telltale::engine::snapshot::{Reason, Snapshot};
use telltale::engine::state::State;
use telltale::engine::time::{Span, Timestamp};

const OK: u8 = 0;
const ERROR: u8 = 2;

/// Longer than the time within which a cause explains an ERROR, unless a dependency states another.
const LATER: Span = Span::from_secs(6);
const SOON: Span = Span::from_secs(2);

/// A shipped vehicle whose modules report by themselves: a fault is that of one module and no other. All else, the
/// dependencies too, is as it is shipped.
fn vehicle(file: &str) -> Arc<Model> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("config").join(file);
    let loaded = config::load(&path).unwrap_or_else(|problems| panic!("{problems}"));
    let mut parts = Parts::clone(&loaded.model);
    for module in &mut parts.modules {
        module.monitor = ModuleMonitor::SelfState(module.id.clone());
    }
    Arc::new(Model::new(parts).expect("the dependencies are those of a model"))
}

/// The vehicle on its way: first all modules are OK, then each of these is in ERROR from its time on, until a second
/// after the slowest module has raised it. Everything is said once a second, and signals twice.
fn shows(model: &Arc<Model>, faults: &[(ModuleId, Timestamp)]) -> Arc<Snapshot> {
    let mut engine = Engine::new(model.clone(), Timestamp::ZERO);
    engine.start_in(Stage::Active);
    let first = faults.iter().map(|(_, at)| *at).min().expect("there is a fault");
    let last = faults.iter().map(|(_, at)| *at).max().expect("there is a fault");
    let raised =
        model.modules.iter().map(|module| module.policy.raise_after).max().expect("there are modules");
    for half_seconds in 0.. {
        let now = Timestamp::from_millis(500 * half_seconds);
        if now > last + after(raised) {
            break;
        }
        while let Some(due) = engine.next_deadline().filter(|due| *due < now) {
            engine.handle(&Input::Tick, due);
        }
        for signal in model.signals.iter().filter(|signal| signal.present_for.is_none()) {
            engine.handle(&Input::Signal { name: signal.name.clone(), value: true }, now);
        }
        if half_seconds % 2 == 1 {
            continue;
        }
        if now == first {
            let snapshot = engine.snapshot();
            assert_eq!((snapshot.stage, snapshot.overall), (Stage::Active, State::Ok));
        }
        let mut array = StatusArray::default();
        for (id, module) in (0..).map(ModuleId).zip(&model.modules) {
            let fails = faults.iter().any(|(of, since)| *of == id && *since <= now);
            array.push_status(if fails { ERROR } else { OK }, &module.id, "", "");
        }
        engine.handle(&Input::Diagnostics(array), now);
    }
    engine.snapshot()
}

/// The first fault after a few seconds without any, and the second one so long after the first is an ERROR.
fn two(model: &Arc<Model>, pair: [ModuleId; 2], apart: Span) -> Arc<Snapshot> {
    let first = Timestamp::from_millis(7_000);
    let second = first + model.modules[pair[0].0 as usize].policy.raise_after + apart;
    shows(model, &[(pair[0], first), (pair[1], second)])
}

/// Shown in ERROR, with an active alarm of its own.
fn is_called(snapshot: &Snapshot, id: ModuleId) -> bool {
    let node = NodeId::Module(id);
    let alarms = snapshot.alarms.iter().filter(|alarm| alarm.active && alarm.node == node);
    snapshot.shown(node) == (State::Error, None) && alarms.count() == 1
}

fn is_masked_by(snapshot: &Snapshot, id: ModuleId, cause: ModuleId) -> bool {
    let (state, reason) = snapshot.shown(NodeId::Module(id));
    let by_it = |by: &[NodeId]| by == [NodeId::Module(cause)];
    state == State::Ignore && matches!(reason, Some(Reason::Masked { by }) if by_it(by))
}

fn pairs(model: &Model) -> impl Iterator<Item = [ModuleId; 2]> {
    let ids = move || (0..model.modules.len() as u32).map(ModuleId);
    ids().flat_map(move |first| {
        ids().filter(move |second| *second != first).map(move |second| [first, second])
    })
}

/// The longest time within which a dependency of one of these, or of a group around it, lets a cause explain it.
fn longest_within(model: &Model, pair: [ModuleId; 2]) -> Span {
    let of = |id: ModuleId| {
        let module = &model.modules[id.0 as usize];
        let group = |id: GroupId| &model.groups[id.0 as usize];
        let around = std::iter::successors(Some(module.group), move |at| group(*at).parent);
        module.depends_on.iter().chain(around.flat_map(move |at| &group(at).depends_on))
    };
    let limit = |it: &Dependency| match it.within {
        Within::Limit(limit) => limit,
        Within::Always => panic!("it hides every second fault"),
    };
    pair.into_iter().flat_map(of).map(limit).max().expect("one of them waits for the other")
}

/// How urgent an ERROR of the module is for the operator of a vehicle that drives.
fn urgency(model: &Model, id: ModuleId) -> Option<Urgency> {
    let help = model.modules[id.0 as usize].help.as_ref();
    help.and_then(|help| help.of(State::Error, Stage::Active)).and_then(|advice| advice.urgency)
}

/// Both faults reach the operator. Which one the instruction follows is decided here and nowhere else in this file:
/// the more urgent one is shown, or waits behind the other while the instruction asks for it.
fn assert_nothing_urgent_is_lost(model: &Model, snapshot: &Snapshot, pair: [ModuleId; 2]) {
    let [first, second] = pair;
    let (urgent, other) =
        if urgency(model, second) > urgency(model, first) { (second, first) } else { (first, second) };
    let said =
        is_called(snapshot, urgent) || is_called(snapshot, other) && is_masked_by(snapshot, urgent, other);
    assert!(said, "{:?} {:?}", name(model, urgent), snapshot.shown(NodeId::Module(urgent)));
}

/// A second more.
fn after(within: Span) -> Span {
    Span::from_nanos(within.as_nanos() + 1_000_000_000)
}

fn name(model: &Model, id: ModuleId) -> &str {
    &model.modules[id.0 as usize].id
}

/// Every ordered pair of single faults, and how many of them need more than six seconds, because a dependency states a
/// longer time for a cause that is noticed late.
#[test]
fn a_later_fault_is_shown_beside_an_earlier_one_in_every_pair_of_modules() {
    for (file, all, slow) in [("shuttle.yaml", 870, 2), ("robot.yaml", 306, 54)] {
        let model = vehicle(file);
        let (mut shown, mut later) = (0, BTreeMap::new());
        for pair in pairs(&model) {
            let both = |apart| {
                let snapshot = two(&model, pair, apart);
                pair.into_iter().all(|id| is_called(&snapshot, id))
            };
            let names = pair.map(|id| name(&model, id));
            if !both(LATER) {
                let within = longest_within(&model, pair);
                assert!(within > LATER && both(after(within)), "{file}: {names:?}");
                later.insert(names, within);
            }
            shown += 1;
        }
        assert_eq!((shown, later.len()), (all, slow), "{file}: {later:?}");
    }
}

#[test]
fn of_two_faults_that_come_together_the_more_urgent_one_is_never_lost() {
    for file in ["shuttle.yaml", "robot.yaml"] {
        let model = vehicle(file);
        for pair in pairs(&model) {
            assert_nothing_urgent_is_lost(&model, &two(&model, pair, SOON), pair);
        }
    }
}
