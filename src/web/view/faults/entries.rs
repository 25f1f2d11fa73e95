//! The entries of the list of faults, before they are fitted into the available room.

use std::collections::{BTreeMap, HashMap};

use crate::engine::model::{GroupId, ModuleId, NodeId, Stage};
use crate::engine::snapshot::{Reason, RootCause};
use crate::engine::state::State;
use crate::engine::time::Timestamp;

use crate::web::view::View;
use crate::web::view::node_names::Spoken;
use crate::web::view::versions::Aspect;

/// WARNINGs of one component that are entries of their own; more of them are one.
const WARNINGS_NAMED: usize = 3;

/// One entry of the list.
#[derive(Debug, Clone)]
pub struct Entry {
    pub node: NodeId,
    pub state: State,
    pub title: String,
    pub spoken: Spoken,
    pub place: String,
    /// The components in which it shows.
    pub places: Vec<String>,
    pub since: Timestamp,
    pub waits: String,
    /// How many errors hide behind it, as words that go on after `waits`.
    pub behind: String,
    pub masks: u32,
    pub help: String,
    /// It is an alarm that nobody has taken note of.
    pub calls: bool,
    /// It was wrong, and nobody has taken note of it.
    pub over: bool,
    /// What the operator has to take note of.
    pub acknowledge: Option<Target>,
}

/// What an acknowledgement is for, as its route names it.
#[derive(Debug, Clone)]
pub struct Target {
    pub id: String,
    pub aspect: Aspect,
}

pub fn entries(view: &View<'_>) -> Vec<Entry> {
    let behind = behind(view);
    let roots = view.snapshot.roots.iter();
    let mut entries: Vec<Entry> = roots.map(|root| of_root(view, root, &behind)).collect();
    lesser(view, &mut entries);
    past(view, &mut entries);
    held(view, &mut entries);
    of_one_status(view, entries)
}

/// What one status says in several components is one entry, which names them all.
fn of_one_status(view: &View<'_>, entries: Vec<Entry>) -> Vec<Entry> {
    let mut first: HashMap<&str, usize> = HashMap::new();
    let mut found: Vec<Entry> = Vec::with_capacity(entries.len());
    for entry in entries {
        let status = view.snapshot.status_of(entry.node);
        match status.and_then(|status| first.insert(status, found.len())) {
            None => found.push(entry),
            Some(index) => {
                first.extend(status.map(|status| (&**status, index)));
                let known = found[index].clone();
                found[index] = joined(view, known, entry);
            }
        }
    }
    found
}

/// The worse one, at all places, with what there is to acknowledge at any of them.
fn joined(view: &View<'_>, a: Entry, b: Entry) -> Entry {
    let (entry, other) = if (b.over, a.state) < (a.over, b.state) { (b, a) } else { (a, b) };
    let mut places = entry.places;
    places.extend(other.places.into_iter().filter(|place| !places.contains(place)).collect::<Vec<_>>());
    let (title, place) = match entry.node {
        NodeId::Module(id) => titled(view, id, entry.state, &places.join(", ")),
        NodeId::Group(_) => (entry.title, entry.place),
    };
    let acknowledge = match (&entry.acknowledge, &other.acknowledge) {
        (Some(_), Some(_)) => Some(by_name(view, entry.node)),
        (one, another) => one.clone().or_else(|| another.clone()),
    };
    let masks_more = other.masks > entry.masks;
    let (waits, behind) = if masks_more { (other.waits, other.behind) } else { (entry.waits, entry.behind) };
    Entry {
        title,
        place,
        places,
        since: entry.since.min(other.since),
        waits,
        behind,
        masks: entry.masks.max(other.masks),
        calls: entry.calls || other.calls,
        acknowledge,
        ..entry
    }
}

fn of_root(view: &View<'_>, root: &RootCause, behind: &HashMap<NodeId, usize>) -> Entry {
    let state = view.snapshot.shown(root.node).0;
    let entry = match root.node {
        NodeId::Module(id) => of_module(view, id, state),
        NodeId::Group(id) => of_group(view, id, state, view.no_member(id)),
    };
    let alarm = view.snapshot.alarms.iter().find(|alarm| alarm.active && alarm.node == root.node);
    let target = alarm.filter(|alarm| !alarm.acknowledged);
    Entry {
        since: root.since,
        masks: root.masks,
        waits: waits(view, root),
        behind: behind.get(&root.node).map(|&count| view.lang.with_errors(count)).unwrap_or_default(),
        calls: target.is_some(),
        acknowledge: target.map(|alarm| by_number(alarm.id)),
        ..entry
    }
}

/// What a root cause puts aside: `Four others wait`.
fn waits(view: &View<'_>, root: &RootCause) -> String {
    let own = view.board.tile_of(root.node);
    let masked =
        |reason: &Option<Reason>| matches!(reason, Some(Reason::Masked { by }) if by.contains(&root.node));
    let tiles = view.board.tiles.iter().enumerate();
    let waiting =
        tiles.filter(|&(tile, &id)| Some(tile) != own && masked(&view.snapshot.group(id).1.reason)).count();
    match (waiting, root.masks) {
        (0, 0) => String::new(),
        (0, masks) => view.lang.modules_wait(masks as usize),
        (tiles, _) => view.lang.others_wait(tiles),
    }
}

/// How many masked modules report an ERROR themselves, by the root cause that hides them.
fn behind(view: &View<'_>) -> HashMap<NodeId, usize> {
    let mut behind = HashMap::new();
    if view.snapshot.roots.iter().all(|root| root.masks == 0) {
        return behind;
    }
    for module in view.snapshot.modules.iter().filter(|module| module.own == State::Error) {
        if let Some(Reason::Masked { by }) = &module.reason {
            for &root in by.iter() {
                *behind.entry(root).or_default() += 1;
            }
        }
    }
    behind
}

fn of_module(view: &View<'_>, id: ModuleId, state: State) -> Entry {
    let (_, module) = view.snapshot.module(id);
    let component = view.tile_name(NodeId::Module(id));
    let (title, place) = titled(view, id, state, &component);
    let mut spoken = view.words_of(module);
    // A judgement without a silence says nothing beside UNKNOWN; nothing is said twice.
    if spoken.message == title || (state == State::Unknown && spoken.silent.is_none()) {
        spoken.message.clear();
    }
    let node = NodeId::Module(id);
    Entry {
        node,
        state,
        spoken,
        title,
        place,
        places: vec![component],
        since: module.since,
        waits: String::new(),
        behind: String::new(),
        masks: 0,
        help: help(view, node, state),
        calls: false,
        over: false,
        acknowledge: None,
    }
}

/// What a fault is called, and where it is. Without a name of its own it is called by its component,
/// and then its place is its label.
fn titled(view: &View<'_>, id: ModuleId, state: State, components: &str) -> (String, String) {
    let (info, _) = view.snapshot.module(id);
    let named = view.name_of_fault(info, state).is_some();
    let place = if named { components.to_owned() } else { view.label(info) };
    (view.fault_at(id, state, components), place)
}

/// What to do: as the configuration says, or else what is right at this level in this stage.
fn help(view: &View<'_>, node: NodeId, state: State) -> String {
    if is_held(view, node) {
        return view.lang.steps().reset_here.to_owned();
    }
    view.help(node, state).unwrap_or_else(|| advice(view, node, state).to_owned())
}

/// Nobody is told to take over at a stop, nor on a machine that is no shuttle.
fn advice(view: &View<'_>, node: NodeId, state: State) -> &'static str {
    let steps = view.lang.steps();
    let (drives, fails) = match (view.snapshot.stage, state) {
        (_, State::Ok | State::Ignore) | (Stage::Locked, _) => return "",
        (stage, state) => (matches!(stage, Stage::Cleared | Stage::Active), state != State::Warning),
    };
    match (view.has_stages(), drives, fails) {
        (false, _, true) => steps.check_machine,
        (false, _, false) => steps.keep_an_eye,
        (true, true, true) => steps.take_over_ready,
        (true, true, false) => steps.go_on_alert,
        (true, false, true) if state == State::Unknown => steps.wait_for_report,
        (true, false, true) => steps.stay,
        (true, false, false) if view.snapshot.stage == Stage::Localizing => steps.nothing_to_do,
        (true, false, false) if view.snapshot.accepted.contains(&node) => steps.nothing_to_do,
        (true, false, false) => steps.acknowledge_first,
    }
}

/// The fault is over, and its ERROR stays until somebody resets it.
fn is_held(view: &View<'_>, node: NodeId) -> bool {
    let NodeId::Module(id) = node else { return false };
    let steps = view.snapshot.module(id).1.steps;
    steps.latched && !steps.in_error && view.board.tile_of(node).is_some()
}

fn of_group(view: &View<'_>, id: GroupId, state: State, place: String) -> Entry {
    let node = NodeId::Group(id);
    Entry {
        node,
        state,
        title: view.group_name(id),
        spoken: Spoken::default(),
        place,
        places: Vec::new(),
        since: view.snapshot.group(id).1.since,
        waits: String::new(),
        behind: String::new(),
        masks: 0,
        help: help(view, node, state),
        calls: false,
        over: false,
        acknowledge: None,
    }
}

/// Adds what is visible and not okay without being a root: several of one kind in one component
/// are one entry. A component that shows a fault which nothing inside it explains is one itself.
fn lesser(view: &View<'_>, entries: &mut Vec<Entry>) {
    let roots: Vec<NodeId> = view.snapshot.roots.iter().map(|root| root.node).collect();
    let mut found = Vec::new();
    for id in view.watched() {
        let modules = view.modules_of(id);
        for state in [State::Error, State::Unknown, State::Warning] {
            let visible = |&module: &ModuleId| view.snapshot.module(module).1.state == state;
            let of_state: Vec<ModuleId> = modules
                .iter()
                .copied()
                .filter(|module| visible(module) && !roots.contains(&NodeId::Module(*module)))
                .collect();
            // Somebody who accepts a WARNING reads which one.
            if state == State::Warning && of_state.len() <= WARNINGS_NAMED {
                found.extend(of_state.iter().map(|&one| Entry {
                    acknowledge: of_warnings(view, id, &[one]),
                    ..of_module(view, one, state)
                }));
                continue;
            }
            let entry = match *of_state {
                [] => continue,
                [one] => of_module(view, one, state),
                _ => {
                    let since = of_state.iter().map(|&module| view.snapshot.module(module).1.since);
                    let since = since.min().unwrap_or(view.snapshot.now);
                    Entry { since, ..of_group(view, id, state, view.lang.times(of_state.len(), state)) }
                }
            };
            let acknowledge = (state == State::Warning).then(|| of_warnings(view, id, &of_state)).flatten();
            found.push(Entry { acknowledge, ..entry });
        }
        let (_, group) = view.snapshot.group(id);
        let faulty = !matches!(group.state, State::Ok | State::Ignore);
        let mut said = roots.iter().copied().chain(found.iter().map(|entry| entry.node));
        let tile = view.board.tile_of(NodeId::Group(id));
        if faulty && !said.any(|node| node == NodeId::Group(id) || view.board.tile_of(node) == tile) {
            found.push(of_group(view, id, group.state, view.lang.state(group.state).to_owned()));
        }
    }
    found.sort_by_key(|entry| std::cmp::Reverse(entry.state));
    entries.extend(found);
}

/// The first WARNING of a component that nobody has accepted.
fn of_warnings(view: &View<'_>, group: GroupId, modules: &[ModuleId]) -> Option<Target> {
    let is_component = view.board.tiles.contains(&group);
    let open = modules.iter().find(|&&module| !view.snapshot.accepted.contains(&NodeId::Module(module)))?;
    let aspect = if is_component { Aspect::Component(group) } else { Aspect::Stage };
    Some(Target { id: view.snapshot.node_name(NodeId::Module(*open)).to_string(), aspect })
}

/// Adds the alarms that are over: those of one node are one entry, and where its fault is back
/// they are a part of that one.
fn past(view: &View<'_>, entries: &mut Vec<Entry>) {
    let mut of_node: BTreeMap<NodeId, (usize, u64, Timestamp)> = BTreeMap::new();
    for alarm in view.snapshot.alarms.iter().filter(|alarm| !alarm.active && !alarm.acknowledged) {
        let (count, id, raised) = of_node.entry(alarm.node).or_insert((0, alarm.id, alarm.raised));
        *count += 1 + alarm.repeats as usize;
        (*id, *raised) = (alarm.id, alarm.raised);
    }
    let mut found: Vec<(u64, Entry)> = Vec::new();
    for (node, (count, id, raised)) in of_node {
        if let Some(back) = entries.iter_mut().find(|entry| entry.node == node) {
            let of_both = back.acknowledge.is_some();
            back.acknowledge = Some(if of_both || count > 1 { by_name(view, node) } else { by_number(id) });
            continue;
        }
        let entry = match node {
            NodeId::Module(module) => of_module(view, module, State::Error),
            NodeId::Group(group) => of_group(view, group, State::Error, String::new()),
        };
        let acknowledge = Some(if count > 1 { by_name(view, node) } else { by_number(id) });
        let spoken = Spoken { message: view.lang.so_often(count), silent: None };
        let help = String::new();
        found.push((id, Entry { since: raised, spoken, help, over: true, acknowledge, ..entry }));
    }
    found.sort_by_key(|(id, _)| *id);
    entries.extend(found.into_iter().map(|(_, entry)| entry));
}

/// Adds what a countermeasure waits for where nothing else lets the operator take note of it, such as
/// a cause that was acknowledged before, was a WARNING, or left its place to its group.
fn held(view: &View<'_>, entries: &mut Vec<Entry>) {
    let moving = view.snapshot.countermeasures.iter().filter(|it| it.request.kind().moves());
    for cause in moving.flat_map(|it| it.causes.iter()).filter(|cause| !cause.acknowledged) {
        let target = Some(by_name(view, cause.node));
        if let Some(entry) = entries.iter_mut().find(|entry| entry.node == cause.node) {
            entry.acknowledge = entry.acknowledge.take().or(target);
            continue;
        }
        let entry = match cause.node {
            NodeId::Module(module) => of_module(view, module, State::Error),
            NodeId::Group(group) => of_group(view, group, State::Error, String::new()),
        };
        let (spoken, help) = (Spoken::default(), String::new());
        entries.push(Entry { spoken, help, over: !cause.present, acknowledge: target, ..entry });
    }
}

fn by_number(id: u64) -> Target {
    Target { id: id.to_string(), aspect: Aspect::Alarm(id) }
}

/// All alarms of a node: they are decided by what its component shows.
fn by_name(view: &View<'_>, node: NodeId) -> Target {
    let tile = view.board.tile_of(node).map(|tile| view.board.tiles[tile]);
    Target {
        id: view.snapshot.node_name(node).to_string(),
        aspect: tile.map_or(Aspect::Stage, Aspect::Component),
    }
}
