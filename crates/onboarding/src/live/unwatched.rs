//! Statuses, topics and nodes that were heard and that no part of a configuration watches: nobody would notice their
//! end.

use std::collections::BTreeSet;

use super::{Heard, listed};
use crate::init::ModuleKind;
use crate::init::names::is_tool;
use crate::init::observations::measured_type;
use telltale_engine::model::monitors::ProbeTarget;
use telltale_engine::model::{Model, same_topic};

#[derive(Debug, Default)]
pub struct Unwatched {
    /// No status was heard at all.
    pub no_status: bool,
    /// Statuses that no module and no `match` takes.
    pub statuses: BTreeSet<String>,
    /// Statuses that a `match` takes, and that are forgotten when they fall silent.
    pub forgotten: BTreeSet<String>,
    /// Topics that come steadily and that nothing reads.
    pub topics: BTreeSet<String>,
    /// Topics without a steady rate, or without a message, that nothing reads: no monitor is proposed for them.
    pub unsteady: BTreeSet<String>,
    /// Nodes without a watchdog, whose topics and statuses are not watched either.
    pub nodes: BTreeSet<String>,
    /// Topics of diagnostics that are not read.
    pub diagnostics: BTreeSet<String>,
}

/// The topics on which a configuration expects statuses.
pub fn diagnostics(model: &Model) -> impl Iterator<Item = &str> {
    model.watched.diagnostics_topics().map(|(topic, _)| topic)
}

/// Whether something of a configuration reads the messages of a topic.
pub fn reads(model: &Model, topic: &str) -> bool {
    let of_signals = model.signals.iter().filter_map(|signal| signal.source.field()).map(|it| &*it.topic);
    let watched = model.watched.topics.iter().map(|spec| &*spec.topic);
    let matched = model.watched.watchdogs.iter().filter_map(|it| match &it.target {
        ProbeTarget::Qos { topic } => Some(&**topic),
        _ => None,
    });
    of_signals.chain(watched).chain(matched).chain(diagnostics(model)).any(|it| same_topic(it, topic))
}

impl Unwatched {
    pub fn of(model: &Model, heard: &Heard) -> Unwatched {
        let seen = &heard.seen;
        let mut found = Unwatched { no_status: seen.statuses.is_empty(), ..Unwatched::default() };
        let declared: BTreeSet<&str> =
            model.modules.iter().filter_map(|it| it.monitor.status()).map(|name| &**name).collect();
        let mut taken: BTreeSet<&str> = BTreeSet::new();
        for name in seen.statuses.keys().map(|name| &**name) {
            let filters = model.groups.iter().flat_map(|group| &group.filters).filter(|it| it.takes(name));
            let policies: Vec<_> = filters.map(|filter| filter.policy.as_ref()).collect();
            if declared.contains(name) {
                taken.insert(name);
            } else if policies.is_empty() {
                if !model.unclaimed.except.iter().any(|filter| filter.matches(name)) {
                    found.statuses.insert(name.to_owned());
                }
            } else {
                taken.insert(name);
                // Where the `match` itself says when they are forgotten, they are meant to come and go.
                if policies.iter().all(Option::is_none) && model.discovered.forget_after.is_some() {
                    found.forgotten.insert(name.to_owned());
                }
            }
        }
        let proposed = heard.draft.groups.iter().flat_map(|group| &group.modules);
        for module in proposed {
            match &module.kind {
                ModuleKind::Rate { topic, .. }
                | ModuleKind::Age { topic, .. }
                | ModuleKind::Value { topic, .. }
                    if !reads(model, topic) =>
                {
                    found.topics.insert(topic.clone());
                }
                ModuleKind::Node { name, .. } if !is_noticed(model, heard, &taken, name) => {
                    found.nodes.insert(name.clone());
                }
                ModuleKind::Status { .. }
                | ModuleKind::Rate { .. }
                | ModuleKind::Age { .. }
                | ModuleKind::Value { .. }
                | ModuleKind::Node { .. } => {}
            }
        }
        let unread = seen.discovery.topics.iter().filter(|topic| measured_type(topic).is_some());
        let unread = unread.map(|topic| &topic.name).filter(|name| !reads(model, name));
        found.unsteady = unread.filter(|name| !found.topics.contains(*name)).cloned().collect();
        let read: BTreeSet<&str> = diagnostics(model).collect();
        let more = seen.more_diagnostics();
        found.diagnostics = more.into_iter().filter(|topic| !read.contains(&**topic)).collect();
        found
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        let Unwatched { no_status: _, statuses, forgotten, topics, unsteady, nodes, diagnostics } = self;
        [statuses, forgotten, topics, unsteady, nodes, diagnostics].map(BTreeSet::len).iter().sum()
    }

    /// A sentence for each kind.
    pub fn sentences(&self) -> Vec<String> {
        let update = "`telltale init --update` adds";
        let kinds: [(&BTreeSet<String>, [&str; 2], &str); 5] = [
            (&self.statuses, ["status that no module takes", "statuses that no module takes"], update),
            (
                &self.forgotten,
                [
                    "status that only a `match` takes, and that is forgotten when it falls silent",
                    "statuses that only a `match` takes, and that are forgotten when they fall silent",
                ],
                update,
            ),
            (&self.topics, ["topic that nothing reads", "topics that nothing reads"], update),
            (
                &self.nodes,
                ["node whose end would not be noticed", "nodes whose end would not be noticed"],
                update,
            ),
            (
                &self.diagnostics,
                ["topic of diagnostics that is not read", "topics of diagnostics that are not read"],
                "`diagnostics: { topics: [...] }` names",
            ),
        ];
        let sentences =
            kinds.into_iter().filter_map(|(names, what, what_names)| sentence(names, what, what_names));
        sentences.chain(self.sentence_of_unsteady()).collect()
    }

    /// The sentence on topics for which `init` proposes nothing.
    pub fn sentence_of_unsteady(&self) -> Option<String> {
        let what = [
            "topic without a steady rate that nothing reads",
            "topics without a steady rate that nothing reads",
        ];
        sentence(
            &self.unsteady,
            what,
            "`init` proposes no monitor; a `frequency` with a longer `window` can watch",
        )
    }
}

/// For a reader: how many there are of one kind, what to do about them, and their names.
fn sentence(names: &BTreeSet<String>, [one, many]: [&str; 2], what_names: &str) -> Option<String> {
    let (what, them) = if names.len() == 1 { (one, "it") } else { (many, "them") };
    let list = listed(names.iter().map(|name| &**name));
    (!names.is_empty()).then(|| format!("{} {what} ({what_names} {them}): {list}", names.len()))
}

/// Whether something of a configuration changes when a node ends: a watchdog, a topic that it publishes, or a status that
/// it says.
fn is_noticed(model: &Model, heard: &Heard, taken: &BTreeSet<&str>, node: &str) -> bool {
    let asked = model.watched.watchdogs.iter().any(|it| match &it.target {
        ProbeTarget::Node { name } | ProbeTarget::Lifecycle { name } => **name == *node,
        _ => false,
    });
    let publishes = heard.seen.discovery.topics.iter().any(|topic| {
        let by_it = topic.publishers.iter().any(|it| !it.ours && it.node.as_deref() == Some(node));
        by_it && !diagnostics(model).any(|it| same_topic(it, &topic.name)) && reads(model, &topic.name)
    });
    let statuses =
        heard.draft.groups.iter().flat_map(|group| &group.modules).filter(
            |module| matches!(&module.kind, ModuleKind::Status { name, .. } if taken.contains(&**name)),
        );
    let says = statuses.flat_map(|module| &module.nodes).any(|it| it == node);
    asked || publishes || says || is_tool(node)
}
