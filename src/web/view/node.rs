//! How parts of the vehicle are called and marked, wherever they appear.

use crate::engine::model::{GroupId, ModuleId, NodeId};
use crate::engine::snapshot::{ModuleInfo, ModuleView, Reason, Report};
use crate::engine::state::State;

use super::Lang;
use super::View;
use super::clean::{MESSAGE, NAME, clean};

/// The icon for a state: the two reasons of IGNORE never look alike.
pub fn icon(state: State, reason: Option<&Reason>) -> &'static str {
    match (state, reason) {
        (State::Ok, _) => "ok",
        (State::Warning, _) => "warning",
        (State::Error, _) => "error",
        (State::Unknown, _) => "unknown",
        (State::Ignore, Some(Reason::Masked { .. })) => "masked",
        (State::Ignore, _) => "idle",
    }
}

/// The word of the `data-reason` attribute; empty where nothing is ignored.
pub fn reason_word(reason: Option<&Reason>) -> &'static str {
    match reason {
        Some(Reason::Masked { .. }) => "masked",
        Some(Reason::NotRelevant(_)) => "not_relevant",
        None => "",
    }
}

impl View<'_> {
    pub(super) fn group_name(&self, id: GroupId) -> String {
        self.lang.pick(&self.snapshot.layout.groups[id.0 as usize].name, NAME)
    }

    /// The name of the component in which a node stands, or of the group where it is in none.
    pub(super) fn tile_name(&self, node: NodeId) -> String {
        let tile = self.board.tile_of(node).map(|tile| self.board.tiles[tile]);
        self.group_name(tile.unwrap_or_else(|| match node {
            NodeId::Group(id) => id,
            NodeId::Module(id) => self.snapshot.layout.modules[id.0 as usize].group,
        }))
    }

    /// The groups that the operator hears of: the components, then what the diagnosis says of itself.
    pub(super) fn watched(&self) -> impl Iterator<Item = GroupId> {
        let groups = self.snapshot.layout.groups.iter().enumerate();
        let system = groups.filter(|(_, group)| group.is_system).map(|(index, _)| GroupId(index as u32));
        self.board.tiles.iter().copied().chain(system)
    }

    /// What a developer calls a module, without the group it stands in.
    pub(super) fn label(&self, info: &ModuleInfo) -> String {
        let path = &self.snapshot.layout.groups[info.group.0 as usize].path;
        let tail = info.id.strip_prefix(&**path).and_then(|rest| rest.strip_prefix('/'));
        clean(tail.unwrap_or(&info.id), NAME)
    }

    /// What is wrong with a module, in the operator's words. The configuration's text names the
    /// fault ("Position jumped"), so it must not stand beside a state that is not one.
    pub(super) fn fault(&self, id: ModuleId, state: State) -> String {
        let (info, view) = self.snapshot.module(id);
        match state {
            State::Unknown if view.received.is_none() || view.silent => {
                self.lang.no_news_from(&self.tile_name(NodeId::Module(id)))
            }
            State::Unknown => self.lang.state_unknown(&self.tile_name(NodeId::Module(id))),
            _ => match &info.name {
                Some(name) => self.lang.pick(name, NAME),
                // What a publisher says is no headline: it may be anything.
                None => format!("{}: {}", self.tile_name(NodeId::Module(id)), self.lang.state(state)),
            },
        }
    }

    /// What was reported. Publishers have one language; the engine has that of the page.
    pub(super) fn said(&self, report: &Report) -> String {
        let german = report.german.as_ref().filter(|_| self.lang == Lang::De);
        clean(german.unwrap_or(&report.message), MESSAGE)
    }

    pub(super) fn help(&self, node: NodeId) -> String {
        match node {
            NodeId::Group(_) => String::new(),
            NodeId::Module(id) => {
                let help = self.snapshot.module(id).0.help.as_ref();
                help.map(|help| self.lang.pick(help, 120)).unwrap_or_default()
            }
        }
    }

    /// Why a node is ignored: `waits for Localization`, `not driving`. Empty where it is not.
    pub(super) fn reason(&self, node: NodeId, reason: Option<&Reason>) -> String {
        match reason {
            None => String::new(),
            Some(Reason::NotRelevant(because)) => self.lang.not_relevant(because),
            Some(Reason::Masked { by }) => {
                let Some(&root) = by.first() else { return String::new() };
                // Within one component its name says nothing: the module's does.
                let near = self.board.tile_of(root) == self.board.tile_of(node);
                self.lang.waits_for(&match root {
                    NodeId::Module(id) if near => self.label(self.snapshot.module(id).0),
                    _ => self.tile_name(root),
                })
            }
        }
    }

    /// The modules of a group and of the groups inside it, in configuration order.
    pub(super) fn modules_of(&self, id: GroupId) -> Vec<ModuleId> {
        let layout = &self.snapshot.layout;
        let mut modules = Vec::new();
        let mut groups = vec![id];
        while let Some(id) = groups.pop() {
            let group = &layout.groups[id.0 as usize];
            modules.extend(group.modules.iter().copied());
            groups.extend(group.groups.iter().rev().copied());
        }
        modules
    }
}

/// Whether what a module reports itself is worth a word beside what it shows.
pub fn own_matters(view: &ModuleView) -> bool {
    view.state == State::Ignore && matches!(view.own, State::Warning | State::Error)
}
