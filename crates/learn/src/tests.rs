//! Tests of the learner with made-up pasts.

use telltale_engine::model::monitors::{Bands, MonitorSpec, TopicId};
use telltale_engine::model::{
    Dependency, DependsOn, GroupId, GroupSpec, Model, ModuleId, ModuleMonitor, ModuleSpec, NodeId, Parts,
    StageModel, Within,
};
use telltale_engine::state::State;
use telltale_engine::text::Text;
use telltale_engine::time::Span;

use super::{Direction, History, Proposals, Stretch, learn, learn_within};

/// Trials are so long.
const TRIAL_MS: i64 = 60_000;

/// Modules `0`, `1`, ... of one group that judge themselves; each pair makes the second one depend on the first.
fn parts(count: u32, waits: &[(u32, u32)]) -> Parts {
    let mut parts = Parts::empty("vehicle", StageModel::None);
    parts.groups.push(GroupSpec::new("all", Text::plain("All")));
    for index in 0..count {
        let status = ModuleMonitor::SelfState(index.to_string().into());
        let mut module = ModuleSpec::new(&format!("all/{index}"), GroupId(0), status);
        let causes = waits.iter().filter(|(_, dependent)| *dependent == index);
        module.depends_on = causes.map(|(cause, _)| on(DependsOn::Node(node(*cause)))).collect();
        parts.modules.push(module);
    }
    parts
}

fn node(index: u32) -> NodeId {
    NodeId::Module(ModuleId(index))
}

fn on(on: DependsOn) -> Dependency {
    Dependency { on, masks_unknown: true, within: Within::default() }
}

fn model(parts: Parts) -> Model {
    Model::new(parts).expect("it has no circle")
}

/// In each trial these modules fail, so many milliseconds after ten seconds, for ten seconds.
fn history(count: usize, trials: &[Vec<(usize, i64)>]) -> History {
    let mut history = History { modules: vec![Vec::new(); count], ..History::default() };
    for (index, trial) in trials.iter().enumerate() {
        let zero = index as i64 * TRIAL_MS;
        for (module, stretches) in history.modules.iter_mut().enumerate() {
            let (mut at, mut add) =
                (zero, |from_ms, to_ms, own| stretches.push(Stretch { from_ms, to_ms, own }));
            if let Some((_, late)) = trial.iter().find(|(it, _)| *it == module) {
                at = zero + 20_000 + late;
                add(zero, zero + 10_000 + late, State::Ok);
                add(zero + 10_000 + late, at, State::Error);
            }
            add(at, zero + TRIAL_MS, State::Ok);
        }
    }
    history
}

fn of(proposals: &Proposals) -> Vec<(u32, u32)> {
    proposals.learned.iter().map(|it| (it.cause.0, it.dependent.0)).collect()
}

fn times(count: usize, trial: &[(usize, i64)]) -> Vec<Vec<(usize, i64)>> {
    vec![trial.to_vec(); count]
}

#[test]
fn a_chain_gives_its_links_and_no_edge_from_end_to_end() {
    let trials =
        [times(10, &[(0, 0), (1, 300), (2, 600)]), times(10, &[(1, 0), (2, 300)]), times(10, &[(2, 0)])]
            .concat();
    let found = learn(&history(3, &trials), &model(parts(3, &[])));
    assert_eq!(of(&found), [(0, 1), (1, 2)]);
    assert_eq!(found.add, [0, 1]);
    let evidence = &found.learned[0].evidence;
    assert_eq!((evidence.examples.len(), evidence.counterexamples.len()), (10, 0));
    assert_eq!(evidence.examples[1], 70_000, "the notice of the cause");
    assert_eq!(evidence.delays_ms, [300; 10]);
    assert!(evidence.lift() > 3.0 && evidence.p < 1e-3);
    assert_eq!(found.learned[0].direction, Some(Direction::Alone(10)));
    // A configured dependency is neither proposed nor doubted.
    let found = learn(&history(3, &trials), &model(parts(3, &[(0, 1), (1, 2)])));
    assert_eq!((of(&found), found.add, found.doubted), (vec![(0, 1), (1, 2)], vec![], vec![]));
}

#[test]
fn effects_of_one_cause_are_not_causes_of_each_other() {
    let trials =
        [times(12, &[(0, 0), (1, 200), (2, 900)]), times(8, &[(1, 0)]), times(8, &[(2, 0)])].concat();
    let found = learn(&history(3, &trials), &model(parts(3, &[])));
    assert_eq!(of(&found), [(0, 1), (0, 2)]);
    assert_eq!(found.undecided, []);
}

#[test]
fn a_cause_that_is_noticed_last_is_the_cause() {
    // 1 fails alone, too, so it is not what makes 0 fail.
    let trials = [times(10, &[(0, 900), (1, 0)]), times(5, &[(1, 0)])].concat();
    let mut late = parts(2, &[]);
    late.modules[0].policy.raise_after = Span::from_millis(1_500);
    assert_eq!(of(&learn(&history(2, &trials), &model(late.clone()))), [(0, 1)]);
    // If they always fail together, the known lateness tells the order. Without it nothing is proposed.
    let together = times(10, &[(0, 900), (1, 0)]);
    let found = learn(&history(2, &together), &model(late));
    assert_eq!((of(&found), found.learned[0].direction), (vec![(0, 1)], Some(Direction::Earlier(600))));
    let at_once = learn(&history(2, &times(10, &[(0, 10), (1, 0)])), &model(parts(2, &[])));
    assert_eq!((of(&at_once), at_once.undecided), (vec![], vec![(ModuleId(0), ModuleId(1))]));
}

#[test]
fn chance_few_examples_and_counterexamples_give_nothing() {
    let nothing = |trials: &[Vec<(usize, i64)>]| {
        let found = learn(&history(2, trials), &model(parts(2, &[])));
        assert_eq!((of(&found), found.undecided), (vec![], vec![]));
    };
    // Four of four.
    nothing(&[times(4, &[(0, 0), (1, 300)]), times(4, &[(1, 0)])].concat());
    // Six of twelve.
    nothing(&[times(6, &[(0, 0), (1, 300)]), times(6, &[(0, 0)]), times(6, &[(1, 0)])].concat());
    // So far apart that no cause explains it.
    nothing(&times(20, &[(0, 0), (1, 6_000)]));
    // 1 fails every five seconds anyway.
    let mut often = history(2, &times(12, &[(0, 0)]));
    often.modules[1] = (0..12 * TRIAL_MS / 5_000)
        .flat_map(|it| {
            let (from, middle) = (it * 5_000, it * 5_000 + 4_000);
            [(from, middle, State::Ok), (middle, from + 5_000, State::Error)]
        })
        .map(|(from_ms, to_ms, own)| Stretch { from_ms, to_ms, own })
        .collect();
    assert_eq!(of(&learn(&often, &model(parts(2, &[])))), []);
}

#[test]
fn a_dependency_without_effect_is_doubted_and_a_group_is_narrowed() {
    let sixteen = history(3, &times(16, &[(0, 0)]));
    let found = learn(&sixteen, &model(parts(3, &[(0, 1)])));
    let [doubt] = &found.doubted[..] else { panic!("{:?}", found.doubted) };
    assert_eq!((doubt.node, doubt.index, &doubt.remains[..]), (node(1), 0, &[][..]));
    assert_eq!(doubt.edges[0].evidence.counterexamples.len(), 16);
    assert_eq!(learn(&history(3, &times(15, &[(0, 0)])), &model(parts(3, &[(0, 1)]))).doubted, []);
    // 2 waits for the whole group of 0 and 1, and fails with 1 alone.
    let mut wide = parts(3, &[]);
    wide.groups.push(GroupSpec::new("two", Text::plain("Two")));
    wide.modules[2].group = GroupId(1);
    wide.modules[2].depends_on = vec![on(DependsOn::Node(NodeId::Group(GroupId(0))))];
    let trials = [times(16, &[(0, 0)]), times(10, &[(1, 0), (2, 200)])].concat();
    let found = learn(&history(3, &trials), &model(wide));
    let [doubt] = &found.doubted[..] else { panic!("{:?}", found.doubted) };
    assert_eq!((doubt.node, &doubt.remains[..]), (node(2), &[ModuleId(1)][..]));
    // Of two that replace each other, one may fail without effect.
    let mut redundant = parts(3, &[]);
    redundant.modules[2].depends_on = vec![on(DependsOn::AnyOf(vec![node(0), node(1)]))];
    assert_eq!(learn(&sixteen, &model(redundant)).doubted, []);
}

#[test]
fn what_a_doubted_dependency_did_for_others_is_added() {
    let trials = times(16, &[(0, 0), (2, 300)]);
    let found = learn(&history(3, &trials), &model(parts(3, &[(0, 1), (1, 2)])));
    assert_eq!((of(&found), &found.add[..], found.doubted.len()), (vec![(0, 2)], &[0][..], 1));
}

#[test]
fn an_edge_that_closes_a_circle_is_no_proposal() {
    let trials = [times(10, &[(0, 0), (1, 300)]), times(5, &[(1, 0)])].concat();
    let found = learn(&history(2, &trials), &model(parts(2, &[(1, 0)])));
    assert_eq!((of(&found), found.add), (vec![(0, 1)], vec![]));
}

#[test]
fn who_measures_arrivals_comes_before_who_reads_the_messages() {
    let mut both = parts(2, &[]);
    let (topic, window, bands) = (TopicId(0), Span::from_secs(1), Bands::default());
    both.modules[0].monitor = MonitorSpec::Latency { topic, window, bands }.into();
    both.modules[1].monitor = MonitorSpec::Frequency { topic, window, bands }.into();
    let at_once = history(2, &times(10, &[(0, 0), (1, 0)]));
    let found = learn(&at_once, &model(both));
    assert_eq!((of(&found), found.learned[0].direction), (vec![(1, 0)], Some(Direction::Feeds)));
}

#[test]
fn the_caller_ends_it_by_its_bytes_or_its_time() {
    let (history, model) = (history(2, &times(10, &[(0, 0), (1, 300)])), model(parts(2, &[])));
    let most = std::cell::Cell::new(0);
    let all = learn_within(&history, &model, &|bytes| {
        most.set(most.get().max(bytes));
        true
    });
    assert_eq!(all.map(|it| it.learned.len()), Some(1));
    // Twenty instants and ten delays of eight bytes each for one cause, beside the table of all pairs.
    assert!(most.get() >= 20 * 8, "{}", most.get());
    assert_eq!(learn_within(&history, &model, &|bytes| bytes < most.get()), None);
}
