//! The names and marks of the vehicle's parts, wherever they appear.

use crate::engine::model::{GroupId, ModuleId, NodeId};
use crate::engine::snapshot::{ModuleInfo, ModuleView, Reason, Report};
use crate::engine::state::State;

use super::text::{MESSAGE, NAME, clean};
use super::{Lang, View};

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

/// The words of a module: without the silence, those of before would be all that there is.
#[derive(Debug, Clone, Default)]
pub struct Spoken {
    pub silent: Option<Silence>,
    pub message: String,
}

/// Words around a time that counts on by itself.
#[derive(Debug, Clone)]
pub struct Silence {
    pub before: &'static str,
    pub since: String,
    pub after: &'static str,
}

impl Spoken {
    pub fn is_empty(&self) -> bool {
        self.silent.is_none() && self.message.is_empty()
    }

    /// About as long as it is shown, for estimates of its room.
    pub fn estimate(&self) -> String {
        let silent = self.silent.as_ref().map(|it| format!("{}00 min{}; last: ", it.before, it.after));
        silent.unwrap_or_default() + &self.message
    }
}

impl View<'_> {
    pub fn group_name(&self, id: GroupId) -> String {
        self.lang.pick(&self.snapshot.layout.groups[id.0 as usize].name, NAME)
    }

    /// Why a group has no member that counts.
    pub(super) fn no_member(&self, id: GroupId) -> String {
        self.hint(id).unwrap_or_else(|| self.words.no_member.to_owned())
    }

    /// What may be meant for a group to which nothing came.
    pub(super) fn hint(&self, id: GroupId) -> Option<String> {
        let hint = self.snapshot.layout.groups[id.0 as usize].hint.as_ref();
        hint.map(|hint| self.lang.pick(hint, MESSAGE))
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
    pub fn label(&self, info: &ModuleInfo) -> String {
        let path = &self.snapshot.layout.groups[info.group.0 as usize].path;
        let tail = info.id.strip_prefix(&**path).and_then(|rest| rest.strip_prefix('/'));
        clean(tail.unwrap_or(&info.id), NAME)
    }

    /// What is wrong with a module, in the operator's words. The configuration's text names the
    /// fault ("Position jumped"), so it must not stand beside a state that is not one.
    pub(super) fn fault(&self, id: ModuleId, state: State) -> String {
        self.fault_at(id, state, &self.tile_name(NodeId::Module(id)))
    }

    /// The same of a fault that shows at other places too: they are all named.
    pub(super) fn fault_at(&self, id: ModuleId, state: State, place: &str) -> String {
        let (info, view) = self.snapshot.module(id);
        if let Some(name) = self.name_of_fault(info, state) {
            return name;
        }
        match state {
            State::Unknown if view.received.is_none() || view.silent => self.lang.no_news_from(place),
            State::Unknown => self.lang.state_unknown(place),
            // What a publisher says is no headline: it may be anything.
            _ => format!("{place}: {}", self.lang.state(state)),
        }
    }

    /// What the configuration calls the fault of a module in this state. A module that is well is
    /// called by the fault that is over.
    pub(super) fn name_of_fault(&self, info: &ModuleInfo, state: State) -> Option<String> {
        let state = if matches!(state, State::Ok | State::Ignore) { State::Error } else { state };
        let name = info.name.as_ref()?.of(state, self.snapshot.stage)?;
        Some(self.lang.pick(name, NAME))
    }

    /// What was reported. Publishers have one language; the engine has that of the page.
    pub(super) fn said(&self, report: &Report) -> String {
        let german = report.german.as_ref().filter(|_| self.lang == Lang::De);
        clean(german.unwrap_or(&report.message), MESSAGE)
    }

    /// What a module said last, and since when it is silent, if it is: the page counts on from there.
    pub(super) fn words_of(&self, module: &ModuleView) -> Spoken {
        let (before, after) = self.lang.silent_around();
        let silent = module.received.filter(|_| module.silent);
        Spoken {
            silent: silent.map(|since| Silence { before, since: self.wall(since), after }),
            message: match module.received.is_none() && module.report.message.is_empty() {
                true => self.words.no_report.to_owned(),
                false => self.last_words(module),
            },
        }
    }

    fn last_words(&self, module: &ModuleView) -> String {
        match module.report.last_words(module.silent) {
            "" => String::new(),
            _ => self.said(&module.report),
        }
    }

    /// The same as one text, for pages that count nothing.
    pub fn says(&self, module: &ModuleView) -> String {
        self.lang.with_silence(self.last_words(module), module.silent_for(self.snapshot.now))
    }

    /// What the configuration says to do about a node in this state, now.
    pub(super) fn help(&self, node: NodeId, state: State) -> Option<String> {
        let NodeId::Module(id) = node else { return None };
        let help = self.snapshot.module(id).0.help.as_ref()?.of(state, self.snapshot.stage)?;
        Some(self.lang.pick(help, 120))
    }

    /// Why a node is ignored: `waits for Localization`, `not driving`. Empty where it is not.
    pub fn reason(&self, node: NodeId, reason: Option<&Reason>) -> String {
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
