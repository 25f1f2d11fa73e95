//! The entries of the list of faults, before they are fitted into the available room.

use std::cmp::Reverse;
use std::collections::{BTreeMap, HashMap};

use telltale_engine::model::wording::Urgency;
use telltale_engine::model::{GroupId, LOCALIZATION_GROUP, ModuleId, NodeId, Stage};
use telltale_engine::snapshot::{Alarm, Reason, RootCause, Shelved};
use telltale_engine::state::State;
use telltale_engine::time::{Span, Timestamp};

use crate::view::View;
use crate::view::node_names::ModuleMessage;
use crate::view::versions::Aspect;

/// WARNINGs of one component that are entries of their own; more of them are one.
const WARNINGS_NAMED: usize = 3;

/// One entry of the list.
#[derive(Debug, Clone)]
pub struct FaultEntry {
    pub node: NodeId,
    pub state: State,
    pub title: String,
    pub message: ModuleMessage,
    pub place: String,
    /// The components that show it.
    pub places: Vec<String>,
    pub since: Timestamp,
    pub waits: String,
    pub masks: u32,
    pub help: String,
    /// How soon the operator of a driving vehicle has to act.
    pub urgency: Option<Urgency>,
    /// It waits for a cause too, which does not explain it.
    pub second: bool,
    /// It is an alarm that nobody has acknowledged.
    pub unacknowledged: bool,
    /// The fault is over, and nobody has acknowledged it.
    pub over: bool,
    /// For how long it lasted, once it is over.
    pub lasted: Option<Span>,
    /// A developer has shelved it: it asks nobody for anything.
    pub shelved: Option<Shelved>,
    /// Somebody has acknowledged it, and when, if that is known.
    pub seen: Option<Option<Timestamp>>,
    /// The fault that an acknowledgement of this entry names.
    pub acknowledge: Option<AcknowledgeTarget>,
}

/// An alarm or a node, as the route of the acknowledgement names it.
#[derive(Debug, Clone)]
pub struct AcknowledgeTarget {
    pub id: String,
    pub aspect: Aspect,
}

/// All entries: the most urgent advice first, then the shelved modules, and last the alarms that are over.
pub fn entries(view: &View<'_>) -> Vec<FaultEntry> {
    let roots = view.snapshot.roots.iter();
    let mut entries: Vec<FaultEntry> = roots.map(|root| of_root(view, root)).collect();
    add_unexplained(view, &mut entries);
    add_past_alarms(view, &mut entries);
    add_causes_of_countermeasures(view, &mut entries);
    add_shelved(view, &mut entries);
    let mut entries = join_by_status(view, entries);
    entries.sort_by_key(|entry| (entry.over, entry.shelved.is_some(), Reverse(entry.urgency)));
    entries
}

/// Marks the entries of shelved modules, and adds those that have none: a shelved module is never out of sight. What
/// an operator has to accept before a clearance can still be accepted.
fn add_shelved(view: &View<'_>, entries: &mut Vec<FaultEntry>) {
    for shelved in view.snapshot.shelved.iter() {
        let node = NodeId::Module(shelved.module);
        if let Some(entry) = entries.iter_mut().find(|entry| entry.node == node && !entry.over) {
            (entry.help, entry.urgency, entry.unacknowledged) = (String::new(), None, false);
            entry.shelved = Some(shelved.clone());
            continue;
        }
        let (info, module) = view.snapshot.module(shelved.module);
        let component = view.tile_name(node);
        let entry = plain(view, node, module.state, (view.label(info), component.clone()), module.since);
        let (help, urgency) = (String::new(), None);
        let shelved = Some(shelved.clone());
        entries.push(FaultEntry { help, urgency, shelved, places: vec![component], ..entry });
    }
}

/// Entries of one status in several components become one, which names the components.
fn join_by_status(view: &View<'_>, entries: Vec<FaultEntry>) -> Vec<FaultEntry> {
    let mut first: HashMap<&str, usize> = HashMap::new();
    let mut found: Vec<FaultEntry> = Vec::with_capacity(entries.len());
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

/// The worse of two entries, with the components of both and the acknowledgement of either.
fn joined(view: &View<'_>, a: FaultEntry, b: FaultEntry) -> FaultEntry {
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
    let waits = if other.masks > entry.masks { other.waits } else { entry.waits };
    FaultEntry {
        title,
        place,
        places,
        since: entry.since.min(other.since),
        waits,
        masks: entry.masks.max(other.masks),
        urgency: entry.urgency.max(other.urgency),
        second: entry.second || other.second,
        unacknowledged: entry.unacknowledged || other.unacknowledged,
        acknowledge,
        shelved: entry.shelved.or(other.shelved),
        seen: entry.seen.and(other.seen),
        ..entry
    }
}

fn of_root(view: &View<'_>, root: &RootCause) -> FaultEntry {
    let state = view.snapshot.shown(root.node).0;
    let entry = match root.node {
        NodeId::Module(id) => of_module(view, id, state),
        NodeId::Group(id) => of_group(view, id, state, view.no_member(id)),
    };
    let entry = if root.grace || has_time(view, root.node) { asking_nothing(entry) } else { entry };
    let alarm = view.snapshot.alarms.iter().find(|alarm| alarm.active && alarm.node == root.node);
    let target = alarm.filter(|alarm| !alarm.acknowledged);
    FaultEntry {
        since: root.since,
        masks: root.masks,
        second: root.second,
        waits: waits(view, root),
        unacknowledged: target.is_some(),
        acknowledge: target.map(|alarm| by_number(alarm.id)),
        seen: alarm.filter(|alarm| alarm.acknowledged).map(|alarm| alarm.acknowledged_at),
        ..entry
    }
}

/// The number of nodes that a root cause masks: `4 parts wait`.
fn waits(view: &View<'_>, root: &RootCause) -> String {
    let own = view.board.tile_of(root.node);
    let masked =
        |reason: &Option<Reason>| matches!(reason, Some(Reason::Masked { by }) if by.contains(&root.node));
    let tiles = view.board.tiles.iter().enumerate();
    let waiting =
        tiles.filter(|&(tile, &id)| Some(tile) != own && masked(&view.snapshot.group(id).1.reason)).count();
    match (waiting, root.masks) {
        (0, 0) => String::new(),
        (0, masks) => view.lang.parts_wait(masks as usize),
        (tiles, _) => view.lang.parts_wait(tiles),
    }
}

fn of_module(view: &View<'_>, id: ModuleId, state: State) -> FaultEntry {
    let (info, module) = view.snapshot.module(id);
    let component = view.tile_name(NodeId::Module(id));
    let (title, place) = titled(view, id, state, &component);
    let mut message = view.message_of(module);
    // Of a fault with a name, what its module reports and measures stands behind its component, if it has one; here
    // only its silence counts. Without a name the message is all that says what is wrong.
    let is_named = view.name_of_fault(info, state).is_some();
    let is_behind_tile = view.board.tile_of(NodeId::Module(id)).is_some();
    // Topics and settings are words for developers, who read the message on the page of the module.
    let is_technical = is_named && !is_behind_tile && message.text.contains(['/', '_', '`']);
    if state == State::Unknown || is_technical || (module.received.is_some() && is_behind_tile && is_named) {
        message.text.clear();
    }
    let entry = plain(view, NodeId::Module(id), state, (title, place), module.since);
    FaultEntry { message, places: vec![component], ..entry }
}

fn plain(
    view: &View<'_>,
    node: NodeId,
    state: State,
    (title, place): (String, String),
    since: Timestamp,
) -> FaultEntry {
    let urgency = view.asks(node, state);
    FaultEntry {
        node,
        state,
        title,
        message: ModuleMessage::default(),
        place,
        places: Vec::new(),
        since,
        waits: String::new(),
        masks: 0,
        help: help(view, node, state, urgency),
        urgency,
        second: false,
        unacknowledged: false,
        over: false,
        lasted: None,
        shelved: None,
        seen: None,
        acknowledge: None,
    }
}

/// The entry of what still has time to report. It asks nobody for anything: each change of the stage makes components
/// relevant that have to be heard first.
fn asking_nothing(entry: FaultEntry) -> FaultEntry {
    FaultEntry { help: String::new(), urgency: None, ..entry }
}

/// Whether an UNKNOWN is no fault yet: nothing was heard since the module became relevant, or the localization has
/// nothing to measure while it looks for the position that it was given.
fn has_time(view: &View<'_>, node: NodeId) -> bool {
    let NodeId::Module(id) = node else { return false };
    let module = view.snapshot.module(id).1;
    let localization = view.snapshot.localization;
    let searches =
        view.snapshot.stage == Stage::Localizing && localization.given.is_some() && !localization.late;
    let says_so = !module.silent && module.steps.reported == Some(State::Unknown);
    module.own == State::Unknown
        && (module.steps.grace || (searches && says_so && is_of_localization(view, node)))
}

/// Whether it stands behind the tile of the localization.
pub fn is_of_localization(view: &View<'_>, node: NodeId) -> bool {
    let localization = view.snapshot.node(LOCALIZATION_GROUP).and_then(|it| view.board.tile_of(it));
    localization.is_some() && view.board.tile_of(node) == localization
}

/// The title of a fault, and its place. Without a configured name the title names the component, and the
/// place is the module.
pub fn titled(view: &View<'_>, id: ModuleId, state: State, components: &str) -> (String, String) {
    let (info, _) = view.snapshot.module(id);
    let named = view.name_of_fault(info, state).is_some();
    let place = if named { components.to_owned() } else { view.label(info) };
    (view.fault_at(id, state, components), place)
}

/// What to do: the configuration's `help`, or else the page's advice for this state and stage.
fn help(view: &View<'_>, node: NodeId, state: State, urgency: Option<Urgency>) -> String {
    if is_held(view, node) {
        return view.words.reset_here.to_owned();
    }
    // The words of the configuration ask for the acknowledgement that was given.
    let is_accepted = state == State::Warning && view.snapshot.accepted.contains_key(&node);
    if is_accepted && view.stage_of_advice() == Stage::Standby {
        return view.words.nothing_to_do.to_owned();
    }
    view.help(node, state).unwrap_or_else(|| advice(view, state, urgency).to_owned())
}

/// The page's own advice. To take over is advised only while the vehicle drives.
fn advice(view: &View<'_>, state: State, urgency: Option<Urgency>) -> &'static str {
    let (drives, fails) = match (view.stage_of_advice(), state) {
        (_, State::Ok | State::Ignore) | (Stage::Locked, _) => return "",
        (stage, state) => (matches!(stage, Stage::Cleared | Stage::Active), state != State::Warning),
    };
    match (view.has_stages(), drives, fails) {
        (false, _, true) => view.words.check_machine,
        (false, _, false) => view.words.keep_an_eye,
        (true, true, true) if urgency == Some(Urgency::TakeOver) => view.words.take_over_stop,
        (true, true, true) => view.words.take_over_ready,
        (true, true, false) => view.words.go_on_alert,
        (true, false, true) if state == State::Unknown => view.words.wait_for_report,
        (true, false, true) => view.words.stay,
        (true, false, false) if view.snapshot.stage == Stage::Localizing => view.words.nothing_to_do,
        (true, false, false) => view.words.acknowledge_first,
    }
}

/// The fault is over, and its ERROR stays until somebody resets it.
fn is_held(view: &View<'_>, node: NodeId) -> bool {
    let NodeId::Module(id) = node else { return false };
    let steps = view.snapshot.module(id).1.steps;
    steps.latched && !steps.in_error && view.board.tile_of(node).is_some()
}

fn of_group(view: &View<'_>, id: GroupId, state: State, place: String) -> FaultEntry {
    let since = view.snapshot.group(id).1.since;
    plain(view, NodeId::Group(id), state, (view.group_name(id), place), since)
}

/// Adds faults that are no root causes. Several of one state in one component are one entry. A component
/// whose fault no entry explains is an entry itself.
fn add_unexplained(view: &View<'_>, entries: &mut Vec<FaultEntry>) {
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
            // An operator who accepts a WARNING must read which one.
            if state == State::Warning && of_state.len() <= WARNINGS_NAMED {
                let entry = |&one| acknowledgeable(view, id, &[one], of_module(view, one, state));
                found.extend(of_state.iter().map(entry));
                continue;
            }
            let all_have_time = of_state.iter().all(|&module| has_time(view, NodeId::Module(module)));
            let entry = match *of_state {
                [] => continue,
                [one] => of_module(view, one, state),
                _ => {
                    let since = of_state.iter().map(|&module| view.snapshot.module(module).1.since);
                    let since = since.min().unwrap_or(view.snapshot.now);
                    FaultEntry {
                        since,
                        ..of_group(
                            view,
                            id,
                            state,
                            format!("{} × {}", of_state.len(), view.lang.state(state)),
                        )
                    }
                }
            };
            let entry = if all_have_time { asking_nothing(entry) } else { entry };
            found.push(match state {
                State::Warning => acknowledgeable(view, id, &of_state, entry),
                _ => entry,
            });
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

/// The entry of WARNINGs of a component: an acknowledgement names the first that nobody has accepted. Once all are
/// accepted, the entry is one that somebody has seen.
fn acknowledgeable(view: &View<'_>, group: GroupId, modules: &[ModuleId], entry: FaultEntry) -> FaultEntry {
    let is_component = view.board.tiles.contains(&group);
    let accepted = |module: &ModuleId| view.snapshot.accepted.get(&NodeId::Module(*module));
    let mut open = modules.iter().filter(|module| accepted(module).is_none());
    let aspect = if is_component { Aspect::Component(group) } else { Aspect::Stage };
    let acknowledge = open.next().map(|&module| {
        let id = view.snapshot.node_name(NodeId::Module(module)).to_string();
        AcknowledgeTarget { id, aspect }
    });
    let last = || modules.iter().filter_map(accepted).max().copied().flatten();
    FaultEntry { seen: acknowledge.is_none().then(last), acknowledge, ..entry }
}

/// Adds alarms that are over and not acknowledged: one entry for each node. If the fault of the node is
/// back, its entry acknowledges them too.
fn add_past_alarms(view: &View<'_>, entries: &mut Vec<FaultEntry>) {
    let mut of_node: BTreeMap<NodeId, (usize, &Alarm)> = BTreeMap::new();
    for alarm in view.snapshot.alarms.iter().filter(|alarm| !alarm.active && !alarm.acknowledged) {
        let (count, last) = of_node.entry(alarm.node).or_insert((0, alarm));
        *count += 1 + alarm.repeats as usize;
        *last = alarm;
    }
    let mut found: Vec<(u64, FaultEntry)> = Vec::new();
    for (node, (count, alarm)) in of_node {
        let id = alarm.id;
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
        let message = ModuleMessage { text: view.lang.so_often(count), silent: None };
        let help = String::new();
        let lasted = alarm.ended.map(|ended| ended.since(alarm.raised));
        let since = alarm.raised;
        found.push((id, FaultEntry { since, message, help, over: true, lasted, acknowledge, ..entry }));
    }
    found.sort_by_key(|(id, _)| *id);
    entries.extend(found.into_iter().map(|(_, entry)| entry));
}

/// Adds the acknowledgements for which a countermeasure waits, where no entry offers them: for a cause
/// whose alarm was acknowledged before, for a WARNING, for a node whose group became the cause.
fn add_causes_of_countermeasures(view: &View<'_>, entries: &mut Vec<FaultEntry>) {
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
        let (message, help) = (ModuleMessage::default(), String::new());
        entries.push(FaultEntry { message, help, over: !cause.present, acknowledge: target, ..entry });
    }
}

fn by_number(id: u64) -> AcknowledgeTarget {
    AcknowledgeTarget { id: id.to_string(), aspect: Aspect::Alarm(id) }
}

/// All alarms of a node. The version is that of the component around it.
fn by_name(view: &View<'_>, node: NodeId) -> AcknowledgeTarget {
    let tile = view.board.tile_of(node).map(|tile| view.board.tiles[tile]);
    AcknowledgeTarget {
        id: view.snapshot.node_name(node).to_string(),
        aspect: tile.map_or(Aspect::Stage, Aspect::Component),
    }
}
