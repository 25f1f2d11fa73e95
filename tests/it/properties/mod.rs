//! The invariants of the engine, over random vehicles and random histories. `PROPTEST_CASES` sets their
//! number; a failure prints the numbers from which its case was made.

mod cases;
mod clones;
mod drives;
mod files;
mod keyframes;
mod lines;
mod monitors;
mod motion;
mod oracle;
mod recordings;
mod schemas;
mod soundness;
mod times;
mod urgency;
mod writers;

use std::collections::BTreeSet;
use std::sync::Arc;

use cases::{Choices, history, model};
use monitors::{History, Since, Window};
use oracle::Oracle;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::strategy::ValueTree as _;
use telltale::engine::Engine;
use telltale::engine::event::EventKind;
use telltale::engine::input::{Input, NodeOf, StatusArray, WriterList};
use telltale::engine::model::{
    Combine, GroupId, Model, ModuleId, ModuleMonitor, NodeId, Other, POSED_SIGNAL,
};
use telltale::engine::snapshot::{NotRelevant, Path, Reason, Snapshot};
use telltale::engine::state::State;
use telltale::engine::time::Timestamp;
use times::Times;

fn numbers() -> impl Strategy<Value = Vec<u32>> {
    vec(any::<u32>(), 20..400)
}

fn config() -> ProptestConfig {
    let cases = std::env::var("PROPTEST_CASES").ok().and_then(|cases| cases.parse().ok()).unwrap_or(2000);
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn incremental_equals_from_scratch_and_explains_itself(numbers in numbers()) {
        let mut choices = Choices::new(&numbers);
        let model = model(&mut choices);
        let mut engine = Engine::new(model.clone(), Timestamp::ZERO);
        let mut last = Seen::default();
        check(&model, &engine.snapshot(), &mut last);
        for (at, input) in history(&mut choices) {
            while let Some(due) = engine.next_deadline().filter(|due| *due < at) {
                engine.handle(&Input::Tick, due);
                check(&model, &engine.snapshot(), &mut last);
            }
            engine.handle(&Input::Tick, at);
            check(&model, &engine.snapshot(), &mut last);
            engine.handle(&input, at);
            check(&model, &engine.snapshot(), &mut last);
        }
    }

    #[test]
    fn monitors_say_what_follows_from_all_that_was_received(numbers in numbers()) {
        let mut choices = Choices::new(&numbers);
        let model = cases::model_that(&mut choices, |parts| {
            parts.modules.iter_mut().for_each(|module| module.policy.forget_after = None);
            writers::admit_all(parts);
        });
        let history = writers::said_by_one(history(&mut choices));
        let mut engine = Engine::new(model.clone(), Timestamp::ZERO);
        let mut windows = vec![Window::default(); model.modules.len()];
        let mut times = Times::default();
        for (index, (at, input)) in history.iter().enumerate() {
            let seen = |now| History { model: &model, seen: &history[..index], now };
            note_windows(&seen(engine.now()), &engine.snapshot(), (&mut windows, &mut times));
            // Time alone may make a module relevant between two inputs, as the end of a localization does.
            while let Some(due) = engine.next_deadline().filter(|due| due <= at) {
                engine.handle(&Input::Tick, due);
                note_windows(&seen(due), &engine.snapshot(), (&mut windows, &mut times));
            }
            engine.handle(input, *at);
            let snapshot = engine.snapshot();
            let seen = History { model: &model, seen: &history[..=index], now: *at };
            note_windows(&seen, &snapshot, (&mut windows, &mut times));
            for (id, window) in (0..).map(ModuleId).zip(&mut windows) {
                if let Some(verdict) = seen.verdict(id, window) {
                    let reported = snapshot.module(id).1.steps.reported;
                    let counts_as = model.modules[id.0 as usize].policy.counts_as;
                    prop_assert_eq!(reported, verdict.map(|state| counts_as.of(state)), "{:?} at {:?}", model.modules[id.0 as usize].monitor, at);
                }
            }
        }
    }

    #[test]
    fn the_same_inputs_give_the_same_snapshots_whatever_the_batching(numbers in numbers()) {
        let mut choices = Choices::new(&numbers);
        let model = model(&mut choices);
        let history = history(&mut choices);
        let mut plain = Engine::new(model.clone(), Timestamp::ZERO);
        let mut busy = Engine::new(model, Timestamp::ZERO);
        let mut last = Timestamp::ZERO;
        for (index, (at, input)) in history.iter().enumerate() {
            // The busy one is woken at every deadline and at odd times, and looked at each time.
            while let Some(due) = busy.next_deadline().filter(|due| due <= at) {
                busy.handle(&Input::Tick, due);
                busy.snapshot();
                last = last.max(due);
            }
            let between = Timestamp::from_nanos(last.as_nanos().midpoint(at.as_nanos()));
            busy.handle(&Input::Tick, between);
            busy.snapshot();
            plain.handle(input, *at);
            busy.handle(input, *at);
            last = *at;
            if index % 7 == 0 || index + 1 == history.len() {
                prop_assert_eq!(plain.snapshot(), busy.snapshot());
            }
        }
    }

    #[test]
    fn a_reload_of_the_same_configuration_changes_nothing(numbers in numbers(), pick in any::<usize>()) {
        let mut choices = Choices::new(&numbers);
        let model = model(&mut choices);
        let history = history(&mut choices);
        let mut plain = Engine::new(model.clone(), Timestamp::ZERO);
        let mut reloaded = Engine::new(model.clone(), Timestamp::ZERO);
        for (index, (at, input)) in history.iter().enumerate() {
            plain.handle(input, *at);
            reloaded.handle(input, *at);
            if index == pick % history.len() {
                reloaded.reload(model.clone(), *at);
            }
        }
        // Names that all groups refused are not known: which of them finds room first may differ.
        if plain.snapshot().counters.dropped_names == 0 {
            prop_assert_eq!(told(&plain.snapshot()), told(&reloaded.snapshot()));
        }
    }

    #[test]
    fn a_worse_module_makes_no_tile_better_but_by_masking(numbers in numbers(), pick in any::<u32>()) {
        let mut choices = Choices::new(&numbers);
        let model = model(&mut choices);
        let history = history(&mut choices);
        let mut engine = Engine::new(model.clone(), Timestamp::ZERO);
        let mut end = Timestamp::ZERO;
        for (at, input) in &history {
            engine.handle(input, *at);
            end = *at;
        }
        // The node of who says it is known: else its ERROR counts and its OK does not.
        let mut list = WriterList { as_of: end, ..WriterList::default() };
        list.writers.insert(cases::writer(0), NodeOf::Named(cases::WRITERS[0].into()));
        engine.handle(&Input::Writers(Arc::new(list)), end);
        let name = format!("s{}", pick % 9);
        let (before, after) = (probe(&mut engine, &name, 0, end), probe(&mut engine, &name, 2, end));
        for id in before.module_ids() {
            let (was, is) = (before.module(id).1.own, after.module(id).1.own);
            if rank(is) < rank(was) {
                // What the display says of itself, and what is made at run time, the tiles below hold.
                let Some(spec) = model.modules.get(id.0 as usize) else { continue };
                let reads_values = !matches!(spec.monitor, ModuleMonitor::SelfState(_));
                prop_assert!(reads_values, "{} itself went from {was} to {is}", spec.id);
                // Values count with the ERROR that did not count with the OK, beside a WARNING of somebody else.
                return Ok(());
            }
        }
        prop_assert!(urgency::is_no_weaker(&before, &after), "{:?} became {:?}", before.asked, after.asked);
        for tile in before.tiles() {
            let (was, is) = (before.group(tile).1.state, after.group(tile).1.state);
            if rank(is) < rank(was) {
                prop_assert!(
                    newly_masked(&model, tile, &before, &after),
                    "{} went from {was} to {is}", before.group(tile).0.path
                );
            }
        }
    }
}

/// Everything that is shown, by names, because ids may differ.
fn told(snapshot: &Snapshot) -> Vec<String> {
    let name = |node: &NodeId| snapshot.node_name(*node).clone();
    let reason = |node| match snapshot.shown(node).1 {
        Some(Reason::Masked { by }) => format!("masked by {:?}", by.iter().map(name).collect::<Vec<_>>()),
        other => format!("{other:?}"),
    };
    let groups = (0..).map(GroupId).zip(snapshot.groups.iter()).map(|(id, view)| {
        let node = NodeId::Group(id);
        let paths: Vec<Vec<_>> = view.paths.iter().map(|path| path.iter().map(name).collect()).collect();
        let told = (view.state, view.own, view.since, view.ok, view.counted);
        format!("{} {told:?} {} {paths:?}", name(&node), reason(node))
    });
    let mut modules: Vec<String> = snapshot
        .module_ids()
        .map(|id| {
            let (info, view) = snapshot.module(id);
            let told = (view.state, view.own, view.since, view.received, view.silent, view.steps);
            format!("{} {told:?} {} {:?}", info.id, reason(NodeId::Module(id)), view.report)
        })
        .collect();
    modules.sort_unstable();
    let roots = snapshot.roots.iter();
    let roots = roots.map(|root| format!("{} {:?}", name(&root.node), (root.masks, root.since, root.grace)));
    let alarms = snapshot.alarms.iter().map(|it| {
        let told = (it.id, it.raised, it.ended, it.acknowledged, it.active, it.repeats, it.asked);
        format!("{} {told:?}", name(&it.node))
    });
    groups
        .chain(modules)
        .chain(roots)
        .chain(alarms)
        .chain([format!("{} {:?}", snapshot.stage.as_str(), snapshot.motion)])
        .chain([format!("{:?}", snapshot.asked.map(|asked| (asked.urgency, name(&asked.node))))])
        .collect()
}

/// A window begins when its module becomes relevant, or is no longer blocked and was well when it was blocked.
/// While its module is well then, what came before counts on as long as it makes nothing worse.
fn note_windows(seen: &History<'_>, snapshot: &Snapshot, (windows, times): (&mut [Window], &mut Times)) {
    times.see(snapshot);
    let mut oracle = Oracle::new(seen.model, snapshot, times);
    let since = Some(Since { at: snapshot.now, inputs: seen.seen.len() });
    for (id, window) in (0..).map(ModuleId).zip(windows) {
        let said = seen.verdict(id, window).flatten();
        let relevant = oracle.relevant(NodeId::Module(id));
        let blocked = oracle.blocked(NodeId::Module(id));
        let is_well = snapshot.module(id).1.own <= State::Warning;
        let recovers = !blocked && window.blocked.is_some_and(|(at, was_well)| was_well && at < snapshot.now);
        let earlier = window.blocked.filter(|(at, _)| *at < snapshot.now);
        window.blocked = blocked.then(|| earlier.unwrap_or((snapshot.now, is_well)));
        if !relevant {
            (window.since, window.recovery) = (None, None);
        } else if window.since.is_some()
            && recovers
            && is_well
            && said.is_some_and(|state| state <= State::Warning)
        {
            window.recovery = since.zip(seen.rate(id, window.since));
        } else if window.since.is_none() || recovers {
            (window.since, window.recovery) = (since, None);
            window.last_begin = seen.seen.len();
        }
    }
    times.see_shown(snapshot);
}

fn rank(state: State) -> usize {
    [State::Ignore, State::Ok, State::Warning, State::Unknown, State::Error]
        .iter()
        .position(|&other| other == state)
        .expect("all states are listed")
}

fn probe(engine: &mut Engine, name: &str, level: u8, now: Timestamp) -> Arc<Snapshot> {
    let mut array = StatusArray::default();
    array.push_status(level, name, "", "");
    engine.handle(&Input::Diagnostics(array), now);
    engine.snapshot()
}

/// Whether something inside the tile is masked in `after` by a cause that was none before.
fn newly_masked(model: &Model, tile: GroupId, before: &Snapshot, after: &Snapshot) -> bool {
    let times = Times::default();
    let oracle = Oracle::new(model, after, &times);
    let mut inside = vec![NodeId::Group(tile)];
    let mut next = 0;
    while next < inside.len() {
        if let NodeId::Group(id) = inside[next] {
            inside.extend(oracle.members(id));
        }
        next += 1;
    }
    inside.into_iter().any(|node| {
        let masked = |snapshot: &Snapshot| matches!(snapshot.shown(node).1, Some(Reason::Masked { .. }));
        masked(after) && !masked(before)
    })
}

/// What was seen of the snapshots before.
#[derive(Debug, Default)]
struct Seen {
    last_alarm: u64,
    times: Times,
}

/// Compares everything in a snapshot with the definitions.
fn check(model: &Model, snapshot: &Snapshot, seen: &mut Seen) {
    seen.times.see(snapshot);
    let mut oracle = Oracle::new(model, snapshot, &seen.times);
    for node in oracle.nodes() {
        let name = snapshot.node_name(node);
        let (state, reason) = snapshot.shown(node);
        assert_eq!(state, oracle.shown(node), "shown state of {name}");
        let masked = matches!(reason, Some(Reason::Masked { .. }));
        assert_eq!(masked, oracle.masked(node), "masked: {name}");
        assert_eq!(reason.is_some(), state == State::Ignore, "reason of {name}");
        match reason {
            Some(Reason::NotRelevant(NotRelevant::Stage(stage))) => {
                assert_eq!(*stage, snapshot.stage, "the stage that {name} names");
            }
            Some(Reason::NotRelevant(NotRelevant::Signal { name: signal, value }))
                if &**signal == POSED_SIGNAL =>
            {
                assert_eq!(oracle.posed(), *value, "the pose that {name} names");
            }
            Some(Reason::NotRelevant(NotRelevant::Signal { name: signal, value })) => {
                let now = snapshot.signals.iter().find(|(known, _)| known == signal);
                assert_eq!(now.and_then(|(_, now)| *now), Some(*value), "the signal that {name} names");
            }
            _ => {}
        }
        if let NodeId::Group(id) = node {
            let view = &snapshot.groups[id.0 as usize];
            assert_eq!(view.own, oracle.own(node), "own state of {name}");
            let shown: Vec<State> =
                oracle.members(id).into_iter().map(|member| oracle.shown(member)).collect();
            let count =
                |wanted: fn(State) -> bool| shown.iter().filter(|&&state| wanted(state)).count() as u32;
            assert_eq!(view.ok, count(|state| state == State::Ok), "ok of {name}");
            assert_eq!(view.counted, count(|state| state != State::Ignore), "counted of {name}");
        }
    }
    let top = snapshot.layout.groups.iter().enumerate();
    let counts = |is_other: bool| !is_other || model.other == Other::Counted;
    let top = top.filter(|(_, group)| group.parent.is_none() && counts(group.is_other));
    let overall = top
        .map(|(index, _)| snapshot.groups[index].state)
        .filter(|&state| state != State::Ignore)
        .max()
        .unwrap_or(State::Ignore);
    assert_eq!(snapshot.overall, overall);
    check_roots(snapshot, &mut oracle, &mut seen.last_alarm);
    urgency::check(snapshot, &oracle);
    seen.times.see_shown(snapshot);
}

fn check_roots(snapshot: &Snapshot, oracle: &mut Oracle<'_>, last_alarm: &mut u64) {
    let roots = oracle.roots();
    let told: std::collections::BTreeMap<NodeId, u32> =
        snapshot.roots.iter().map(|root| (root.node, root.masks)).collect();
    assert_eq!(told, roots, "root causes");
    let ranked = snapshot.roots.windows(2).all(|pair| {
        let arrival = |node| match node {
            NodeId::Group(_) => 0,
            NodeId::Module(id) => snapshot.module(id).0.number,
        };
        let key = |index: usize| {
            let root = &pair[index];
            (std::cmp::Reverse(root.masks), root.since, arrival(root.node), root.node)
        };
        key(0) < key(1)
    });
    assert!(ranked, "root causes are ranked");

    let mut any_error = false;
    for node in oracle.nodes() {
        any_error |= matches!(node, NodeId::Module(_))
            && !oracle.is_aside(node)
            && oracle.relevant(node)
            && oracle.own(node) == State::Error;
        let named: BTreeSet<NodeId> = match snapshot.shown(node).1 {
            Some(Reason::Masked { by }) => by.iter().copied().collect(),
            _ => {
                // A root cause is not masked, and a masked node is no root cause.
                continue;
            }
        };
        assert!(!named.is_empty(), "{} is masked by nothing", snapshot.node_name(node));
        assert!(!roots.contains_key(&node), "{} is masked and a root cause", snapshot.node_name(node));
        assert_eq!(named, oracle.causes(node), "causes of {}", snapshot.node_name(node));
        for root in named {
            // I1: every masked node has a visible root.
            assert!(snapshot.shown(root).0 >= State::Unknown, "{} is visible", snapshot.node_name(root));
        }
    }
    assert!(!any_error || !roots.is_empty(), "an ERROR is hidden");
    check_paths(snapshot, oracle);
    check_alarms(snapshot, oracle, last_alarm);
    check_self(snapshot);
}

fn check_paths(snapshot: &Snapshot, oracle: &mut Oracle<'_>) {
    for index in 0..snapshot.groups.len() as u32 {
        let node = NodeId::Group(GroupId(index));
        let view = &snapshot.groups[index as usize];
        let explained = oracle.shown(node) == State::Error || oracle.masked(node);
        let expected =
            if explained && !oracle.is_aside(node) { oracle.causes(node) } else { BTreeSet::new() };
        let ends: BTreeSet<NodeId> = view.paths.iter().filter_map(|path| path.last().copied()).collect();
        assert_eq!(ends, expected, "ends of the paths of {}", snapshot.node_name(node));
        for path in &*view.paths {
            check_path(snapshot, oracle, node, path);
        }
    }
}

fn check_path(snapshot: &Snapshot, oracle: &mut Oracle<'_>, start: NodeId, path: &Path) {
    let names: Vec<_> = path.iter().map(|&node| snapshot.node_name(node)).collect();
    assert_eq!(path.first(), Some(&start), "{names:?}");
    for pair in path.windows(2) {
        let mut hops = oracle.upstream(pair[0]);
        if let (NodeId::Group(id), State::Ignore) = (pair[0], oracle.shown(pair[0])) {
            hops.extend(oracle.members(id));
        }
        assert!(hops.contains(&pair[1]), "{names:?} has a step that explains nothing");
    }
}

fn check_self(snapshot: &Snapshot) {
    let Some(NodeId::Module(id)) = snapshot.node("telltale/invariants") else { panic!("it is always there") };
    assert_eq!(
        snapshot.modules[id.0 as usize].own,
        State::Ok,
        "{:?}",
        snapshot.modules[id.0 as usize].report
    );
}

fn check_alarms(snapshot: &Snapshot, oracle: &mut Oracle<'_>, last_alarm: &mut u64) {
    let active = || snapshot.alarms.iter().filter(|alarm| alarm.active);
    let alarmed: BTreeSet<NodeId> = active().map(|alarm| alarm.node).collect();
    assert_eq!(alarmed.len(), active().count(), "one alarm for each");
    let roots: BTreeSet<NodeId> = snapshot.roots.iter().map(|root| root.node).collect();
    assert!(alarmed.is_subset(&roots), "an alarm is of a root cause");
    let calling = oracle.calling();
    assert!(calling.is_subset(&alarmed), "a root cause that is not given time has an alarm");
    for new in active().filter(|alarm| alarm.id > *last_alarm) {
        assert!(calling.contains(&new.node), "{} is given time", snapshot.node_name(new.node));
    }
    *last_alarm = snapshot.last_alarm;
    assert!(snapshot.alarms.windows(2).all(|pair| pair[0].id < pair[1].id), "numbers of alarms ascend");
}

/// The cases contain what they are meant for: groups with dropped names (also redundant ones that fail, and
/// empty ones), modules that leave and come back, and modules that are given time.
#[test]
fn the_cases_hold_what_is_rare() {
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let mut seen = [0; 5];
    for _ in 0..600 {
        let numbers = numbers().new_tree(&mut runner).expect("numbers are made of nothing").current();
        let mut choices = Choices::new(&numbers);
        let model = model(&mut choices);
        let mut engine = Engine::new(model.clone(), Timestamp::ZERO);
        engine.keep_events();
        let mut left: BTreeSet<Arc<str>> = BTreeSet::new();
        for (at, input) in history(&mut choices) {
            engine.handle(&input, at);
            let snapshot = engine.snapshot();
            let times = Times::default();
            let oracle = Oracle::new(&model, &snapshot, &times);
            for (id, spec) in (0..).map(GroupId).zip(&model.groups).filter(|(id, _)| oracle.overflowed(*id)) {
                let failed = snapshot.group(id).1.state == State::Error;
                seen[0] += usize::from(spec.combine == Combine::Any && failed);
                seen[1] += usize::from(oracle.members(id).is_empty() && oracle.relevant(NodeId::Group(id)));
            }
            seen[2] += usize::from(snapshot.module_ids().any(|id| left.contains(&snapshot.module(id).0.id)));
            seen[3] += usize::from(snapshot.roots.iter().any(|root| root.grace));
            left.extend(engine.take_events().into_iter().filter_map(|event| match event.what {
                EventKind::Left { node } => Some(node),
                _ => None,
            }));
        }
        seen[4] += left.len();
    }
    assert!(seen.iter().all(|&times| times >= 10), "{seen:?}");
}
