//! A snapshot in the form of ROS 2's aggregated diagnostics (rqt_robot_monitor and similar tools): one
//! status for each node of the tree, named by its path, a group before its members.

#[cfg(test)]
mod aggregator_rules;

use std::borrow::Cow;

use telltale_engine::input::StatusArray;
use telltale_engine::model::{GroupId, ModuleId, NodeId, Stage};
use telltale_engine::snapshot::{GroupInfo, ModuleView, NotRelevant, Reason, Snapshot};
use telltale_engine::state::State;
use telltale_engine::time::Timestamp;
use telltale_engine::view::ros_names::{NO_NAME, part, unique};

/// The tree of the vehicle. Before a login it contains nothing that modules report. With a `path`, which may be
/// empty, paths and levels are exactly those of ROS 2's diagnostic_aggregator.
pub fn tree(snapshot: &Snapshot, path: Option<&str>) -> StatusArray {
    let tree = Tree { snapshot, exact: path.is_some() };
    let mut out = StatusArray::default();
    let root = match path {
        Some("") => String::new(),
        Some(path) => format!("/{path}"),
        None => match part(&snapshot.layout.vehicle_name.en) {
            name if name.is_empty() => format!("/{}", part(&snapshot.layout.vehicle_id)),
            name => format!("/{name}"),
        },
    };
    let tops: Vec<NodeId> = (0..snapshot.layout.groups.len() as u32)
        .map(GroupId)
        .filter(|&id| snapshot.group(id).0.parent.is_none() && !tree.is_idle(id))
        .map(NodeId::Group)
        .collect();
    let named = tree.named(&tops);
    let level = if tree.exact {
        let configured = tops.iter().filter(|node| tree.is_configured(**node));
        fold_levels(configured.map(|&node| tree.node_level(node)))
    } else {
        header(snapshot, snapshot.overall, tops.iter().copied())
    };
    if !root.is_empty() {
        out.push_status(level as u8, &root, level.word(tree.known(snapshot.overall)), "");
        for &(node, ref part) in &named {
            out.push_value(part, tree.word(node));
        }
    }
    for (node, part) in named {
        tree.status(node, &format!("{root}/{part}"), &mut out);
    }
    out
}

/// The worst state of the whole, in one status.
pub fn top(snapshot: &Snapshot) -> StatusArray {
    let mut out = StatusArray::default();
    let level = top_level(snapshot);
    out.push_status(level as u8, "toplevel_state", level.word(snapshot.overall), "");
    out.push_value("telltale_state", snapshot.overall.as_str());
    out.push_value("stage", snapshot.stage.as_str());
    out
}

/// The level of the whole: STALE only if nothing is known of any component.
pub fn top_level(snapshot: &Snapshot) -> Level {
    let mut in_tile: Vec<bool> = Vec::with_capacity(snapshot.layout.groups.len());
    for group in &snapshot.layout.groups {
        // Parents stand before their children.
        in_tile.push(group.parent.map_or(group.is_tile(), |parent| in_tile[parent.0 as usize]));
    }
    let modules = snapshot.module_ids().filter(|&id| in_tile[snapshot.module(id).0.group.0 as usize]);
    header(snapshot, snapshot.overall, modules.map(NodeId::Module))
}

/// The tree of one snapshot, in Telltale's own form or exactly as diagnostic_aggregator has it.
#[derive(Clone, Copy)]
struct Tree<'s> {
    snapshot: &'s Snapshot,
    exact: bool,
}

impl Tree<'_> {
    /// The empty group of statuses that no group takes.
    fn is_idle(self, id: GroupId) -> bool {
        let (info, _) = self.snapshot.group(id);
        let empty = info.groups.is_empty() && info.modules.is_empty();
        empty && info.is_other && (self.exact || !info.counted)
    }

    /// Whether the aggregator counts a group for the level of the whole: one of the configuration.
    fn is_configured(self, node: NodeId) -> bool {
        let NodeId::Group(id) = node else { return true };
        let (info, _) = self.snapshot.group(id);
        !info.is_other && !info.is_system
    }

    fn status(self, node: NodeId, path: &str, out: &mut StatusArray) {
        match node {
            NodeId::Group(id) => self.group(id, path, out),
            NodeId::Module(id) => module(self.snapshot, id, path, out),
        }
    }

    fn group(self, id: GroupId, path: &str, out: &mut StatusArray) {
        let (info, view) = self.snapshot.group(id);
        let level = self.node_level(NodeId::Group(id));
        let said = match view.reason {
            None if self.known(view.state) != State::Ignore => level.word(view.state).to_owned(),
            _ => message(self.snapshot, view.state, view.reason.as_ref(), ""),
        };
        out.push_status(level as u8, path, &said, "");
        let members = self.named(&self.members(info));
        for &(node, ref part) in &members {
            out.push_value(part, self.word(node));
        }
        own_values(self.snapshot, view.state, view.own, out);
        for (node, part) in members {
            self.status(node, &format!("{path}/{part}"), out);
        }
    }

    /// First groups inside, then modules.
    fn members(self, info: &GroupInfo) -> Vec<NodeId> {
        let groups = info.groups.iter().map(|&id| NodeId::Group(id));
        let shown = |id: &ModuleId| !self.exact || self.snapshot.module(*id).0.kind != COUNT;
        let modules = info.modules.iter().copied().filter(shown).map(NodeId::Module);
        groups.chain(modules).collect()
    }

    /// Siblings, each with its part of the path. Programs know a status only by its path, so each is unique:
    /// later ones are called `NAME (2)`.
    fn named(self, nodes: &[NodeId]) -> Vec<(NodeId, String)> {
        let name = |&node: &NodeId| match node {
            NodeId::Group(id) => self.part(&self.snapshot.group(id).0.name.en, false),
            NodeId::Module(id) => self.part(self.module_name(id), true),
        };
        let parts = unique(nodes.iter().map(name));
        // A prefix may be the whole name.
        let whole = |part: String| if self.exact && part == NO_NAME { String::new() } else { part };
        nodes.iter().copied().zip(parts.into_iter().map(whole)).collect()
    }

    /// The name that people read: without its prefix, or the last part of the id, after the path of the group.
    fn module_name(&self, id: ModuleId) -> &str {
        let (info, _) = self.snapshot.module(id);
        let group = self.snapshot.group(info.group).0.path.len();
        let shown = info.shown.as_deref().filter(|name| self.exact || !name.is_empty());
        shown.unwrap_or_else(|| info.id.get(group + 1..).unwrap_or(&info.id))
    }

    /// The aggregator keeps the spaces that slashes become, and the slashes in the names of its groups.
    fn part(self, name: &str, is_status: bool) -> String {
        match (self.exact, is_status) {
            (false, _) => part(name),
            (true, true) => name.replace('/', " "),
            (true, false) => name.trim_matches('/').to_owned(),
        }
    }

    fn word(self, node: NodeId) -> &'static str {
        self.node_level(node).word(self.known(self.snapshot.shown(node).0))
    }

    /// A group of the aggregator is never ignored: without members it has a level like any other.
    fn known(self, state: State) -> State {
        if self.exact && state == State::Ignore { State::Ok } else { state }
    }

    fn node_level(self, node: NodeId) -> Level {
        match node {
            NodeId::Group(id) if self.exact => self.exact_level(id),
            NodeId::Group(_) | NodeId::Module(_) => node_level(self.snapshot, node),
        }
    }

    /// The level of a header by the rules of the aggregator.
    fn exact_level(self, id: GroupId) -> Level {
        let snapshot = self.snapshot;
        let (info, view) = snapshot.group(id);
        if info.is_any || view.reason.is_some() || snapshot.stage == Stage::Locked {
            return group_level(snapshot, id);
        }
        let members = self.members(info);
        let folded = fold_levels(members.iter().map(|&node| self.node_level(node)));
        // Where statuses may come and go, their absence is no fault: neither is it if all say that they are stale.
        let silent = |&id: &ModuleId| snapshot.module(id).1.silent;
        let is_absent = members.is_empty() || info.groups.is_empty() && !info.modules.iter().any(silent);
        let folded = match folded {
            _ if members.is_empty() && !info.may_be_empty => Level::Stale,
            Level::Stale if info.may_be_empty && is_absent => Level::Ok,
            folded => folded,
        };
        let counts = info.modules.iter().filter(|id| snapshot.module(**id).0.kind == COUNT);
        let is_wrong = counts.map(|&id| snapshot.module(id).1.state).any(|state| state == State::Error);
        if is_wrong && folded != Level::Stale { Level::Error } else { folded }
    }
}

/// The kind of the module that counts those of its group.
const COUNT: &str = "count";

/// The worst level; STALE only if all are.
fn fold_levels(levels: impl Iterator<Item = Level>) -> Level {
    let (mut worst, mut all_stale) = (Level::Ok, true);
    for level in levels {
        all_stale &= level == Level::Stale;
        worst = if level as u8 > worst as u8 { level } else { worst };
    }
    if worst == Level::Stale && !all_stale { Level::Error } else { worst }
}

fn module(snapshot: &Snapshot, id: ModuleId, path: &str, out: &mut StatusArray) {
    let (_, view) = snapshot.module(id);
    let said = if snapshot.stage == Stage::Locked { Cow::default() } else { words(view, snapshot.now) };
    let said = message(snapshot, view.state, view.reason.as_ref(), &said);
    out.push_status(level(snapshot, view.state) as u8, path, &said, &view.report.hardware_id);
    own_values(snapshot, view.state, view.own, out);
    if snapshot.stage != Stage::Locked {
        for (key, value) in &view.report.values {
            out.push_value(key, value);
        }
    }
}

/// A header is STALE only if everything below it is; if some of it is, the header is an error, as in the
/// aggregator of ROS 2.
fn header(snapshot: &Snapshot, state: State, mut below: impl Iterator<Item = NodeId>) -> Level {
    let own = level(snapshot, state);
    let mut known = || below.any(|node| node_level(snapshot, node) != Level::Stale);
    if own == Level::Stale && known() { Level::Error } else { own }
}

fn group_level(snapshot: &Snapshot, id: GroupId) -> Level {
    let (info, view) = snapshot.group(id);
    let groups = info.groups.iter().map(|&id| NodeId::Group(id));
    header(snapshot, view.state, groups.chain(info.modules.iter().map(|&id| NodeId::Module(id))))
}

fn node_level(snapshot: &Snapshot, node: NodeId) -> Level {
    match node {
        NodeId::Group(id) => group_level(snapshot, id),
        NodeId::Module(id) => level(snapshot, snapshot.module(id).1.state),
    }
}

/// The last message of a module; a silent module says first for how long.
pub fn words(view: &ModuleView, now: Timestamp) -> Cow<'_, str> {
    let is_new = view.received.is_none() && view.report.message.is_empty();
    match view.own {
        State::Unknown if is_new => "nothing is known yet".into(),
        State::Warning | State::Error if is_new => "nothing was received yet".into(),
        _ => view.says(now),
    }
}

/// What the level does not express: IGNORE has no level, and hides the module's own state.
fn own_values(snapshot: &Snapshot, state: State, own: State, out: &mut StatusArray) {
    out.push_value("telltale_state", state.as_str());
    if snapshot.stage != Stage::Locked && own != state {
        out.push_value("telltale_own", own.as_str());
    }
}

fn message(snapshot: &Snapshot, state: State, reason: Option<&Reason>, said: &str) -> String {
    let why = match reason {
        Some(Reason::Masked { by }) => {
            let names: Vec<&str> = by.iter().map(|&node| &**snapshot.node_name(node)).collect();
            format!("waits for {}", names.join(", "))
        }
        Some(Reason::NotRelevant(NotRelevant::Stage(stage))) => {
            format!("not relevant in the stage {}", stage.as_str())
        }
        Some(Reason::NotRelevant(NotRelevant::Signal { name, value })) => {
            format!("not relevant while {name} is {value}")
        }
        None if state == State::Ignore => "nothing in it is relevant".to_owned(),
        None if said.is_empty() => return level(snapshot, state).word(state).to_owned(),
        None => return said.to_owned(),
    };
    format!("Ignored: {why}")
}

/// The level in `diagnostic_msgs/DiagnosticStatus`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Level {
    Ok = 0,
    Warning = 1,
    Error = 2,
    Stale = 3,
}

/// UNKNOWN is STALE. IGNORE has no level there and must not alarm, so it is OK; but while the vehicle is
/// locked nothing is diagnosed at all, and OK would be a claim.
fn level(snapshot: &Snapshot, state: State) -> Level {
    match state {
        State::Ignore if snapshot.stage == Stage::Locked => Level::Stale,
        State::Ok | State::Ignore => Level::Ok,
        State::Warning => Level::Warning,
        State::Error => Level::Error,
        State::Unknown => Level::Stale,
    }
}

impl Level {
    /// In the words of the aggregator of ROS 2.
    const fn word(self, state: State) -> &'static str {
        match (self, state) {
            (_, State::Ignore) => "Ignored",
            (Level::Ok, _) => "OK",
            (Level::Warning, _) => "Warning",
            (Level::Error, _) => "Error",
            (Level::Stale, _) => "Stale",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    use telltale_engine::Engine;
    use telltale_engine::input::Input;
    use telltale_engine::model::{Model, Parts, StageModel};

    /// Levels of the tree by path, and of the whole, with these levels reported.
    fn levels(config: &str, reported: &[(&str, u8)], locked: bool) -> (Vec<(String, u8, String)>, u8) {
        let model = telltale_config::parse("c", config).unwrap_or_else(|problems| panic!("{problems}")).model;
        let mut engine = Engine::new(model, Timestamp::ZERO);
        if !locked {
            engine.start_in(Stage::Standby);
        }
        let mut array = StatusArray::default();
        reported.iter().for_each(|(name, level)| array.push_status(*level, name, "", ""));
        engine.handle(&Input::Diagnostics(array), Timestamp::from_millis(10));
        let snapshot = engine.snapshot();
        let told = |status: telltale_engine::input::Status<'_>| {
            (status.name().to_owned(), status.level(), status.message().to_owned())
        };
        let levels = tree(&snapshot, None).iter().map(told).collect();
        (levels, top(&snapshot).get(0).level())
    }

    const TWO: &str = "
vehicle: { id: v, name: V }
groups:
  - { id: a, name: A, modules: [{ id: m, status: m }, { id: n, status: n }] }
  - { id: b, name: B, modules: [{ id: o, status: o }], when: { stages: [standby] } }
  - { id: c, name: C, modules: [{ id: p, status: p }], when: { stages: [active] } }
";

    #[test]
    fn what_is_stale_in_part_is_an_error_and_stale_only_as_a_whole() {
        let level = |levels: &[(String, u8, String)], path: &str| {
            levels.iter().find(|(name, ..)| name == path).map(|(_, level, said)| (*level, said.clone()))
        };
        let all = [("m", 0), ("n", 0), ("o", 0)];
        let (levels_, top) = levels(TWO, &all, false);
        assert_eq!((level(&levels_, "/V/A"), top), (Some((0, "OK".into())), 0));
        let (levels_, top) = levels(TWO, &all[1..], false);
        assert_eq!((level(&levels_, "/V"), top), (Some((2, "Error".into())), 2));
        assert_eq!(level(&levels_, "/V/A"), Some((2, "Error".into())));
        assert_eq!(level(&levels_, "/V/A/m").map(|it| it.0), Some(3));
        let (levels_, top) = levels(TWO, &all[2..], false);
        assert_eq!((level(&levels_, "/V/A"), top), (Some((3, "Stale".into())), 2));
        let without = TWO.replace("  - { id: c", "  #");
        assert_eq!(levels(&without, &[], false).1, 3, "nothing is known of any component");
    }

    #[test]
    fn while_it_is_locked_nothing_is_said_to_be_well() {
        let (levels, top) = levels(TWO, &[("m", 0), ("n", 0), ("o", 0)], true);
        assert_eq!(top, 3);
        assert!(levels.iter().all(|(_, level, _)| *level == 3), "{levels:?}");
    }

    #[test]
    fn every_status_of_the_tree_has_a_path_of_its_own() {
        let config = "
vehicle: { id: v, name: V }
groups:
  - { id: a, name: Same, modules: [{ id: m, status: m }] }
  - id: b
    name: Same
    match: [{ contains: x }]
    modules: [{ id: inner, status: n }]
    groups: [{ id: c, name: inner, modules: [{ id: m, status: o }] }]
  - { id: d, name: S/a me }
  - { id: e, name: S a me }
  - { id: f, name: Telltale }
";
        let (levels, _) = levels(config, &[("m", 2), ("n", 0), ("o", 2), ("x/1", 2), ("x 1", 0)], false);
        let mut paths: Vec<&str> = levels.iter().map(|(path, ..)| &**path).collect();
        for path in ["/V/Same", "/V/Same (2)/inner", "/V/Same (2)/inner (2)", "/V/Same (2)/x 1 (2)"] {
            assert!(paths.contains(&path), "{path} in {paths:?}");
        }
        assert!(paths.contains(&"/V/S a me (2)") && paths.contains(&"/V/Telltale (2)"), "{paths:?}");
        let all = paths.len();
        paths.sort_unstable();
        paths.dedup();
        assert_eq!(paths.len(), all);
    }

    #[test]
    fn what_nothing_claims_is_there_only_when_it_is_and_silence_is_said() {
        let parts = Parts::empty("v", StageModel::None);
        let model = Arc::new(Model::new(parts).expect("nothing depends on anything"));
        let mut engine = Engine::new(model, Timestamp::ZERO);
        let others = |engine: &mut Engine| -> Vec<(String, String)> {
            let tree = tree(&engine.snapshot(), None);
            let others = tree.iter().filter(|status| status.name().contains("Other"));
            others.map(|status| (status.name().to_owned(), status.message().to_owned())).collect()
        };
        assert_eq!(others(&mut engine), []);
        let mut array = StatusArray::default();
        array.push_status(0, "lidar", "fine", "");
        engine.handle(&Input::Diagnostics(array), Timestamp::from_millis(10));
        assert_eq!(others(&mut engine)[1].1, "fine");
        engine.handle(&Input::Tick, Timestamp::from_millis(60_000));
        assert_eq!(others(&mut engine)[1].1, "silent for 1 min; last: fine");
    }
}
