//! Names, icons, messages and reasons of groups and modules, for all parts of a page.

use telltale_engine::model::wording::{Advice, Urgency};
use telltale_engine::model::{GroupId, ModuleId, NodeId, Stage};
use telltale_engine::snapshot::{Asked, ModuleInfo, ModuleView, Reason, Report};
use telltale_engine::state::State;

use super::View;
use crate::texts::{Lang, MESSAGE, NAME, clean};

/// Letters of an advice.
const HELP: usize = 120;

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

/// A module's last message, and since when the module is silent. Alone, an old message would look like a new one.
#[derive(Debug, Clone, Default)]
pub struct ModuleMessage {
    pub silent: Option<Silence>,
    pub text: String,
}

/// The texts around a duration, which the page's script counts on.
#[derive(Debug, Clone)]
pub struct Silence {
    pub before: String,
    pub since: String,
    pub after: String,
}

impl Silence {
    /// The words before and after the time, which the page counts.
    fn of(lang: Lang, since: String) -> Silence {
        let around = lang.silent_for("\n");
        let (before, after) = around.split_once('\n').unwrap_or_default();
        Silence { before: before.to_owned(), since, after: after.to_owned() }
    }
}

impl ModuleMessage {
    pub fn is_empty(&self) -> bool {
        self.silent.is_none() && self.text.is_empty()
    }
}

impl View<'_> {
    pub fn group_name(&self, id: GroupId) -> String {
        self.lang.pick(&self.snapshot.layout.groups[id.0 as usize].name, NAME)
    }

    /// The line of a group without a member that counts.
    pub(super) fn no_member(&self, id: GroupId) -> String {
        self.hint(id).unwrap_or_else(|| self.words.no_member.to_owned())
    }

    /// Which statuses were probably meant for a group that got none.
    pub(super) fn hint(&self, id: GroupId) -> Option<String> {
        let hint = self.snapshot.layout.groups[id.0 as usize].hint.as_ref();
        hint.map(|hint| self.lang.pick(hint, MESSAGE))
    }

    /// The name of the component that contains a node, or of its group if none does.
    pub(super) fn tile_name(&self, node: NodeId) -> String {
        let tile = self.board.tile_of(node).map(|tile| self.board.tiles[tile]);
        self.group_name(tile.unwrap_or_else(|| self.snapshot.layout.group_of(node)))
    }

    /// The groups whose faults are listed: the components, then the group `telltale`.
    pub(super) fn watched(&self) -> impl Iterator<Item = GroupId> {
        let groups = self.snapshot.layout.groups.iter().enumerate();
        let system = groups.filter(|(_, group)| group.is_system).map(|(index, _)| GroupId(index as u32));
        self.board.tiles.iter().copied().chain(system)
    }

    /// The name of a module without the path of its group.
    pub fn label(&self, info: &ModuleInfo) -> String {
        let path = &self.snapshot.layout.groups[info.group.0 as usize].path;
        let tail = info.id.strip_prefix(&**path).and_then(|rest| rest.strip_prefix('/'));
        clean(info.shown.as_deref().filter(|name| !name.is_empty()).or(tail).unwrap_or(&info.id), NAME)
    }

    /// The title of a module's fault: the configuration's name for it ("Position jumped"), or the component
    /// with its state. A name is no title for a state that is no fault.
    pub(super) fn fault(&self, id: ModuleId, state: State) -> String {
        self.fault_at(id, state, &self.tile_name(NodeId::Module(id)))
    }

    /// The same for a fault that several components show: `place` names them.
    pub(super) fn fault_at(&self, id: ModuleId, state: State, place: &str) -> String {
        let (info, view) = self.snapshot.module(id);
        if let Some(name) = self.name_of_fault(info, state) {
            return name;
        }
        match state {
            State::Unknown if view.received.is_none() || view.silent => self.lang.not_reporting(place),
            State::Unknown => self.lang.state_unknown(place),
            // A publisher's message may be anything, so it is no title.
            _ => format!("{place}: {}", self.lang.state(state)),
        }
    }

    /// The configuration's name for the fault of a module in this state; without a fault, the name of its
    /// ERROR.
    pub(super) fn name_of_fault(&self, info: &ModuleInfo, state: State) -> Option<String> {
        let state = if matches!(state, State::Ok | State::Ignore) { State::Error } else { state };
        let name = info.name.as_ref()?.of(state, self.snapshot.stage)?;
        Some(self.lang.pick(name, NAME))
    }

    /// The configuration's name for a module that works.
    pub(super) fn name_of_part(&self, info: &ModuleInfo) -> Option<String> {
        Some(self.lang.pick(info.name.as_ref()?.of(State::Ok, self.snapshot.stage)?, NAME))
    }

    /// All names that the configuration gives a module and its faults, for a search.
    pub fn names_of_faults(&self, info: &ModuleInfo) -> String {
        let levels = info.name.iter().flat_map(|name| name.levels());
        let names = levels.flat_map(|(_, words)| words.all()).map(|text| self.lang.pick(text, NAME));
        names.collect::<Vec<_>>().join("\n")
    }

    pub(super) fn report_text(&self, report: &Report) -> String {
        clean(self.lang.message(report), MESSAGE)
    }

    /// The last message of a module, and since when it is silent, if it is.
    pub(super) fn message_of(&self, module: &ModuleView) -> ModuleMessage {
        let silent = module.received.filter(|_| module.silent);
        ModuleMessage {
            silent: silent.map(|since| Silence::of(self.lang, self.wall(since))),
            text: match module.received.is_none() && module.report.message.is_empty() {
                true => self.words.no_report.to_owned(),
                false => without_topics(&self.last_message(module)),
            },
        }
    }

    /// The last message, behind the reason for UNKNOWN if that is another one than a silence.
    fn last_message(&self, module: &ModuleView) -> String {
        let last = match module.report.last_words(module.silent) {
            "" => String::new(),
            _ => self.report_text(&module.report),
        };
        match module.why_unknown().map(|why| self.lang.pick(&why, MESSAGE)) {
            None => last,
            Some(why) if last.is_empty() => why,
            Some(why) => format!("{why}; {} {last}", self.words.last_words),
        }
    }

    /// The same as one text, for pages on which no time counts on.
    pub fn message_text(&self, module: &ModuleView) -> String {
        self.lang.with_silence(self.last_message(module), module.silent_for(self.snapshot.now))
    }

    /// The configuration's `help` for a node in this state and stage.
    pub(super) fn help(&self, node: NodeId, state: State) -> Option<String> {
        Some(self.lang.pick(&self.advice_on(node, state)?.text, HELP))
    }

    fn advice_on(&self, node: NodeId, state: State) -> Option<&Advice> {
        let NodeId::Module(id) = node else { return None };
        self.snapshot.module(id).0.help.as_ref()?.of(state, self.stage_of_advice())
    }

    /// The urgency of a node in this state, or of one inside it, for the operator; a vehicle that stands asks
    /// for nothing soon.
    pub(super) fn asks(&self, node: NodeId, state: State) -> Option<Urgency> {
        if !self.is_advised_to_drive() {
            return None;
        }
        let inside = match node {
            NodeId::Group(id) => self.within(id),
            NodeId::Module(_) => vec![node],
        };
        let visible = inside.into_iter().filter(|&node| self.snapshot.shown(node).0 == state);
        visible.filter_map(|node| self.snapshot.asks(node)).max()
    }

    /// The most that any fault asks for, masked or not.
    pub(super) fn asked(&self) -> Option<Asked> {
        self.snapshot.asked.filter(|_| self.is_advised_to_drive())
    }

    fn is_advised_to_drive(&self) -> bool {
        matches!(self.stage_of_advice(), Stage::Cleared | Stage::Active) && self.has_stages()
    }

    /// The advice of the node that asks for the most. If it does so no more, its advice of that urgency, or else the
    /// page's own.
    pub(super) fn advice_of(&self, asked: Asked) -> String {
        let Asked { urgency, node } = asked;
        let now = self.snapshot.asks(node) == Some(urgency);
        let own = now.then(|| self.help(node, self.snapshot.own(node))).flatten();
        let before = || {
            let levels = [State::Error, State::Unknown, State::Warning].into_iter();
            let mut advice = levels.filter_map(|state| self.advice_on(node, state));
            let alike = advice.find(|advice| advice.urgency == Some(urgency))?;
            Some(self.lang.pick(&alike.text, HELP))
        };
        own.or_else(before).unwrap_or_else(|| match urgency {
            Urgency::TakeOver => self.words.take_over_stop.to_owned(),
            Urgency::BeReady => self.words.take_over_ready.to_owned(),
        })
    }

    /// Why a node is ignored: `waits for Localization`, `not driving`. Empty where it is not.
    pub fn reason(&self, node: NodeId, reason: Option<&Reason>) -> String {
        match reason {
            None => String::new(),
            Some(Reason::NotRelevant(because)) => self.lang.not_relevant(because, &self.snapshot.layout),
            Some(Reason::Masked { by }) => match self.cause_name(node, by) {
                name if name.is_empty() => name,
                name => format!("{} {name}", self.words.waiting),
            },
        }
    }

    /// The name of the first root cause that masks a node. Within one component, the module's name tells more
    /// than the component's.
    pub(super) fn cause_name(&self, node: NodeId, by: &[NodeId]) -> String {
        let near = |root: NodeId| self.board.tile_of(root) == self.board.tile_of(node);
        match by.first() {
            None => String::new(),
            Some(&NodeId::Module(id)) if near(NodeId::Module(id)) => self.label(self.snapshot.module(id).0),
            Some(&root) => self.tile_name(root),
        }
    }

    /// The modules of a group and of the groups inside it, in configuration order.
    pub(super) fn modules_of(&self, id: GroupId) -> Vec<ModuleId> {
        let module = |node| if let NodeId::Module(id) = node { Some(id) } else { None };
        self.within(id).into_iter().filter_map(module).collect()
    }

    /// A group and all that is inside it, in configuration order.
    fn within(&self, id: GroupId) -> Vec<NodeId> {
        let layout = &self.snapshot.layout;
        let mut nodes = Vec::new();
        let mut groups = vec![id];
        while let Some(id) = groups.pop() {
            let group = &layout.groups[id.0 as usize];
            nodes.push(NodeId::Group(id));
            nodes.extend(group.modules.iter().map(|&id| NodeId::Module(id)));
            groups.extend(group.groups.iter().rev().copied());
        }
        nodes
    }

    /// How many modules of a group that waits report a fault of their own.
    pub(super) fn own_faults(&self, id: GroupId) -> usize {
        let is_masked = |reason: &Option<Reason>| matches!(reason, Some(Reason::Masked { .. }));
        if !is_masked(&self.snapshot.group(id).1.reason) {
            return 0;
        }
        let modules = self.modules_of(id).into_iter().map(|id| self.snapshot.module(id).1);
        modules.filter(|module| own_matters(module) && is_masked(&module.reason)).count()
    }
}

/// A message for the operator: `a (/tf transform) is older than 500 ms` without the topic in parentheses. Developers read
/// the whole message on their pages.
fn without_topics(message: &str) -> String {
    let mut parts = message.split(" (/");
    let mut out = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        match part.split_once(')') {
            Some((_, rest)) => out.push_str(rest),
            None => out.push('…'),
        }
    }
    out
}

/// Whether a module reports a fault behind its IGNORE.
pub fn own_matters(view: &ModuleView) -> bool {
    view.state == State::Ignore && matches!(view.own, State::Warning | State::Error)
}

#[cfg(test)]
mod tests {
    use super::without_topics;

    #[test]
    fn a_message_for_the_operator_has_no_topics() {
        for (message, expect) in [
            ("a (/tf transforms[child=base_link].transform) is older than 500 ms", "a is older than 500 ms"),
            ("a (/x) and b (/y z) differ", "a and b differ"),
            ("nothing came yet of a (/a_name_that_was_cut", "nothing came yet of a…"),
            ("17 % (of 40 Ah), 5 m/s", "17 % (of 40 Ah), 5 m/s"),
        ] {
            assert_eq!(without_topics(message), expect);
        }
    }
}
