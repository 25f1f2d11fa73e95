//! A snapshot in the form of ROS 2's aggregated diagnostics (rqt_robot_monitor and similar tools): one
//! status for each node of the tree, named by its path, a group before its members.

#[cfg(test)]
mod aggregator_rules;
mod level;

use std::borrow::Cow;

pub use level::Level;
use level::{fold_levels, level};
use telltale_engine::input::{Status, StatusArray};
use telltale_engine::model::output::{Like, TreeForm};
use telltale_engine::model::{GroupId, ModuleId, NodeId, Stage};
use telltale_engine::snapshot::{GroupInfo, ModuleView, NotRelevant, Reason, Snapshot};
use telltale_engine::state::State;
use telltale_engine::time::Timestamp;
use telltale_engine::view::ros_names::{NO_NAME, part, unique};

/// The tree of the vehicle. Before a login it contains nothing that modules report. With a path, which may be
/// empty, paths and levels are exactly those of ROS 2's diagnostic_aggregator.
pub fn tree(snapshot: &Snapshot, form: &TreeForm) -> StatusArray {
    let tree = Tree::new(snapshot, form);
    let written = tree.written(&tree.tops(|_| true), form.path.as_deref()).statuses;
    if form.values { written } else { without_values(&written) }
}

/// The worst state of the whole, in one status. As in diagnostic_aggregator, the message names the worst status.
pub fn top(snapshot: &Snapshot, form: &TreeForm) -> StatusArray {
    let tree = Tree::new(snapshot, form);
    let level = top_level(snapshot, form);
    let mut out = StatusArray::default();
    let names_it = form.like == Like::Since && level != Level::Ok && snapshot.stage != Stage::Locked;
    let written =
        names_it.then(|| tree.written(&tree.tops(|group| tree.is_judged(group)), form.path.as_deref()));
    let worst = written.as_ref().and_then(|written| Some(written.statuses.get(written.worst(tree.exact)?)));
    let word = level.word(snapshot.overall);
    match worst {
        Some(worst) => {
            let message = format!("{}: {}", worst.name(), worst.message());
            out.push_status(level as u8, "toplevel_state", &message, worst.hardware_id());
        }
        None => out.push_status(level as u8, "toplevel_state", word, ""),
    }
    out.push_value("telltale_state", snapshot.overall.as_str());
    out.push_value("stage", snapshot.stage.as_str());
    let own = |key: &str| ["telltale_state", "telltale_own", "stage"].contains(&key);
    for (key, value) in worst.into_iter().flat_map(|worst| worst.values()).filter(|(key, _)| !own(key)) {
        out.push_value(key, value);
    }
    out
}

/// The level of the whole, by the rules of the aggregator's release.
pub fn top_level(snapshot: &Snapshot, form: &TreeForm) -> Level {
    let tree = Tree::new(snapshot, form);
    let judged = tree.tops(|group| tree.is_judged(group));
    if !tree.exact {
        return tree
            .folded(level(snapshot, snapshot.overall), || judged.iter().map(|&top| tree.node_level(top)));
    }
    let mut all = Vec::with_capacity(snapshot.layout.modules.len() + snapshot.layout.groups.len());
    judged.iter().for_each(|&node| tree.levels(node, &mut all));
    if form.path.as_deref() != Some("") {
        all.push(tree.root_level(&judged));
    }
    match (all.is_empty(), form.like) {
        (true, Like::Before) => Level::Error,
        (true, Like::Since) => Level::Stale,
        (false, like) => fold_levels(like, all.into_iter()),
    }
}

/// The tree of one snapshot, in Telltale's own form or exactly as diagnostic_aggregator has it.
#[derive(Clone, Copy)]
struct Tree<'s> {
    snapshot: &'s Snapshot,
    exact: bool,
    like: Like,
}

/// The statuses of a tree, and whether each is one of a module.
#[derive(Default)]
struct Written {
    statuses: StatusArray,
    of_module: Vec<bool>,
}

impl Written {
    fn push(&mut self, level: Level, path: &str, message: &str, hardware_id: &str, of_module: bool) {
        self.statuses.push_status(level as u8, path, message, hardware_id);
        self.of_module.push(of_module);
    }

    /// The worst status; of several the deepest, and of these the first. For the aggregator nothing is worse than
    /// STALE, and a header is a status like any other.
    fn worst(&self, exact: bool) -> Option<usize> {
        let badness = |level: u8| match (exact, level) {
            (true, level) => level,
            (false, 2) => 3,
            (false, 3) => 2,
            (false, level) => level,
        };
        let all = self.statuses.iter().zip(&self.of_module).enumerate();
        let rank = |(index, (status, of_module)): (usize, (Status<'_>, &bool))| {
            let depth = status.name().matches('/').count();
            (exact || *of_module).then_some((badness(status.level()), depth, std::cmp::Reverse(index)))
        };
        all.filter_map(rank).max().map(|(.., index)| index.0)
    }
}

/// The same statuses without their values.
fn without_values(statuses: &StatusArray) -> StatusArray {
    let mut out = StatusArray::default();
    for status in statuses.iter() {
        out.push_status(status.level(), status.name(), status.message(), status.hardware_id());
    }
    out
}

impl<'s> Tree<'s> {
    fn new(snapshot: &'s Snapshot, form: &TreeForm) -> Tree<'s> {
        Tree { snapshot, exact: form.path.is_some(), like: form.like }
    }

    /// The groups at the top that are published, as far as they are wanted.
    fn tops(self, wanted: impl Fn(&GroupInfo) -> bool) -> Vec<NodeId> {
        let groups = (0..self.snapshot.layout.groups.len() as u32).map(GroupId);
        let is_top = |&id: &GroupId| {
            let group = self.snapshot.group(id).0;
            group.parent.is_none() && !self.is_idle(id) && wanted(group)
        };
        groups.filter(is_top).map(NodeId::Group).collect()
    }

    /// Whether the level of the whole is that of this group, too: for the aggregator also what nobody takes. That
    /// Telltale itself is well says nothing about the vehicle.
    fn is_judged(self, group: &GroupInfo) -> bool {
        if self.exact { !group.is_system } else { group.is_tile() }
    }

    /// The statuses of these groups, with that of the whole first.
    fn written(self, tops: &[NodeId], path: Option<&str>) -> Written {
        let snapshot = self.snapshot;
        let mut out = Written::default();
        let root = match path {
            Some("") => String::new(),
            Some(path) => format!("/{path}"),
            None => match part(&snapshot.layout.vehicle_name.en) {
                name if name.is_empty() => format!("/{}", part(&snapshot.layout.vehicle_id)),
                name => format!("/{name}"),
            },
        };
        let named = self.named(tops);
        if !root.is_empty() {
            let level = self.root_level(tops);
            out.push(level, &root, level.word(self.known(snapshot.overall)), "", false);
            for &(node, ref part) in &named {
                out.statuses.push_value(part, self.word(node));
            }
        }
        for (node, part) in named {
            self.status(node, &format!("{root}/{part}"), &mut out);
        }
        out
    }

    /// The level of the status of the whole tree.
    fn root_level(self, tops: &[NodeId]) -> Level {
        let levels = tops.iter().map(|&node| (node, self.node_level(node)));
        if self.exact {
            let configured = levels.filter(|(node, _)| self.is_configured(*node));
            return fold_levels(self.like, configured.map(|(_, level)| level));
        }
        self.folded(level(self.snapshot, self.snapshot.overall), || levels.map(|(_, level)| level))
    }

    /// The levels of a node and of all below it.
    fn levels(self, node: NodeId, out: &mut Vec<Level>) {
        out.push(self.node_level(node));
        if let NodeId::Group(id) = node {
            self.members(self.snapshot.group(id).0).into_iter().for_each(|node| self.levels(node, out));
        }
    }
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

    fn status(self, node: NodeId, path: &str, out: &mut Written) {
        match node {
            NodeId::Group(id) => self.group(id, path, out),
            NodeId::Module(id) => self.module(id, path, out),
        }
    }

    fn group(self, id: GroupId, path: &str, out: &mut Written) {
        let (info, view) = self.snapshot.group(id);
        let level = self.node_level(NodeId::Group(id));
        let said = match view.reason {
            None if self.known(view.state) != State::Ignore => level.word(view.state).to_owned(),
            _ => message(self.snapshot, view.state, view.reason.as_ref(), ""),
        };
        out.push(level, path, &said, "", false);
        let members = self.named(&self.members(info));
        for &(node, ref part) in &members {
            out.statuses.push_value(part, self.word(node));
        }
        own_values(self.snapshot, view.state, view.own, &mut out.statuses);
        for (node, part) in members {
            self.status(node, &format!("{path}/{part}"), out);
        }
    }

    fn module(self, id: ModuleId, path: &str, out: &mut Written) {
        let snapshot = self.snapshot;
        let (_, view) = snapshot.module(id);
        let said = if snapshot.stage == Stage::Locked { Cow::default() } else { words(view, snapshot.now) };
        let said = message(snapshot, view.state, view.reason.as_ref(), &said);
        out.push(self.module_level(id), path, &said, &view.report.hardware_id, true);
        let out = &mut out.statuses;
        own_values(snapshot, view.state, view.own, out);
        if snapshot.stage != Stage::Locked {
            for (key, value) in &view.report.values {
                out.push_value(key, value);
            }
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
            (true, false) => name.to_owned(),
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
            NodeId::Group(id) => self.own_level(id),
            NodeId::Module(id) => self.module_level(id),
        }
    }

    /// For the aggregator whatever is silent is STALE; Telltale keeps an ERROR that was said last.
    fn module_level(self, id: ModuleId) -> Level {
        let view = self.snapshot.module(id).1;
        let is_stale = self.exact && view.silent && view.state != State::Ignore;
        if is_stale { Level::Stale } else { level(self.snapshot, view.state) }
    }

    /// The level of a group by its state.
    fn own_level(self, id: GroupId) -> Level {
        let (info, view) = self.snapshot.group(id);
        let groups = info.groups.iter().map(|&id| NodeId::Group(id));
        let members = groups.chain(info.modules.iter().map(|&id| NodeId::Module(id)));
        self.folded(level(self.snapshot, view.state), || members.map(|node| self.node_level(node)))
    }

    /// A group is STALE as a whole only where nothing below it is known, or where the newer aggregator says so.
    fn folded<L: Iterator<Item = Level>>(self, own: Level, below: impl FnOnce() -> L) -> Level {
        if own != Level::Stale {
            return own;
        }
        let mut below = below().filter(|&level| level != Level::Stale).peekable();
        match (below.peek(), self.like) {
            (None, _) => Level::Stale,
            (Some(_), Like::Before) => Level::Error,
            (Some(_), Like::Since) => fold_levels(Like::Since, below.chain([Level::Stale])),
        }
    }

    /// The level of a header by the rules of the aggregator.
    fn exact_level(self, id: GroupId) -> Level {
        let snapshot = self.snapshot;
        let (info, view) = snapshot.group(id);
        if info.is_any || view.reason.is_some() || snapshot.stage == Stage::Locked {
            return self.own_level(id);
        }
        let members = self.members(info);
        // An analyzer's own statuses are judged as ever; the newer rule is one for groups of analyzers.
        let like = if info.groups.is_empty() { Like::Before } else { self.like };
        let folded = fold_levels(like, members.iter().map(|&node| self.node_level(node)));
        // Where statuses may come and go, their absence is no fault: neither is it if all say that they are stale.
        let silent = |&id: &ModuleId| snapshot.module(id).1.silent;
        let is_absent = members.is_empty() || info.groups.is_empty() && !info.modules.iter().any(silent);
        let folded = match folded {
            _ if members.is_empty() && !info.may_be_empty => Level::Stale,
            Level::Stale if info.may_be_empty && is_absent => Level::Ok,
            folded => folded,
        };
        // The aggregator counts from the first moment on.
        let statuses = members.iter().filter(|node| matches!(node, NodeId::Module(_))).count();
        let is_wrong = info.wanted.is_some_and(|wanted| wanted as usize != statuses);
        if is_wrong && folded != Level::Stale { Level::Error } else { folded }
    }
}

/// The kind of the module that counts those of its group.
const COUNT: &str = "count";

/// The last message of a module; a silent module says first for how long.
pub fn words(view: &ModuleView, now: Timestamp) -> Cow<'_, str> {
    let is_new = view.received.is_none() && view.report.message.is_empty();
    match view.own {
        State::Unknown if is_new => "nothing is known yet".into(),
        State::Warning | State::Error if is_new => "nothing was received yet".into(),
        _ => view.says(now),
    }
}

/// The part that the level does not express: IGNORE has no level, and hides the module's own state.
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

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;

    use telltale_engine::Engine;
    use telltale_engine::input::Input;
    use telltale_engine::model::{Model, Parts, StageModel};

    fn like(like: Like) -> TreeForm {
        TreeForm { like, ..TreeForm::default() }
    }

    /// Levels of the tree by path, and of the whole, with these levels reported.
    fn levels(config: &str, reported: &[(&str, u8)], locked: bool) -> (Vec<(String, u8, String)>, u8) {
        levels_in(&like(Like::Before), config, reported, locked)
    }

    fn levels_in(
        form: &TreeForm,
        config: &str,
        reported: &[(&str, u8)],
        locked: bool,
    ) -> (Vec<(String, u8, String)>, u8) {
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
        let levels = tree(&snapshot, form).iter().map(told).collect();
        (levels, top(&snapshot, form).get(0).level())
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
    fn since_the_newer_aggregator_what_is_silent_in_part_is_stale_unless_the_rest_is_worse() {
        let of = |reported: &[(&str, u8)]| {
            let (levels, top) = levels_in(&like(Like::Since), TWO, reported, false);
            let level = |path| levels.iter().find(|(name, ..)| name == path).map(|(_, level, _)| *level);
            (level("/V"), level("/V/A"), top)
        };
        assert_eq!(of(&[("n", 0), ("o", 0)]), (Some(3), Some(3), 3));
        assert_eq!(of(&[("n", 1), ("o", 0)]), (Some(1), Some(1), 1));
        assert_eq!(of(&[("n", 0), ("o", 2)]), (Some(2), Some(3), 2));
        assert_eq!(of(&[("m", 0), ("n", 0), ("o", 0)]), (Some(0), Some(0), 0));
    }

    #[test]
    fn the_whole_names_a_module_in_error_before_a_silent_one_and_nothing_while_it_is_locked() {
        let message = |reported: &[(&str, u8)], stage| {
            let model =
                telltale_config::parse("c", TWO).unwrap_or_else(|problems| panic!("{problems}")).model;
            let mut engine = Engine::new(model, Timestamp::ZERO);
            engine.start_in(stage);
            let mut array = StatusArray::default();
            reported.iter().for_each(|(name, level)| array.push_status(*level, name, "said so", ""));
            engine.handle(&Input::Diagnostics(array), Timestamp::from_millis(10));
            top(&engine.snapshot(), &TreeForm::default()).get(0).message().to_owned()
        };
        assert_eq!(message(&[("n", 0), ("o", 2)], Stage::Standby), "/V/B/o: said so");
        assert_eq!(message(&[("n", 1), ("o", 0)], Stage::Standby), "/V/A/m: nothing is known yet");
        assert_eq!(message(&[("m", 0), ("n", 0), ("o", 0)], Stage::Standby), "OK");
        assert_eq!(message(&[("n", 0), ("o", 2)], Stage::Locked), "Ignored");
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
            let tree = tree(&engine.snapshot(), &TreeForm::default());
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
