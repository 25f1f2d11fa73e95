//! The group of a configuration to which something new belongs: the one with the most modules of that ROS node, or else
//! of the draft's group.

use std::collections::BTreeMap;

use crate::init::draft::{Draft, Module, ModuleKind};
use telltale_engine::model::monitors::{MonitorSpec, ProbeTarget, TopicId, ValueSource};
use telltale_engine::model::{GroupId, Model, ModuleSpec, same_topic};

pub struct Homes<'m> {
    model: &'m Model,
    /// How often a group of the model watches something of a node.
    of_nodes: BTreeMap<String, BTreeMap<GroupId, usize>>,
    /// The same for each group of the draft.
    of_groups: BTreeMap<String, BTreeMap<GroupId, usize>>,
}

impl<'m> Homes<'m> {
    pub fn of(model: &'m Model, draft: &Draft) -> Homes<'m> {
        let mut homes = Homes { model, of_nodes: BTreeMap::new(), of_groups: BTreeMap::new() };
        for group in &draft.groups {
            for module in &group.modules {
                for home in groups(model, &module.kind) {
                    *homes.of_groups.entry(group.id.clone()).or_default().entry(home).or_default() += 1;
                    for node in &module.nodes {
                        *homes.of_nodes.entry(node.clone()).or_default().entry(home).or_default() += 1;
                    }
                }
            }
        }
        homes
    }

    /// The path of the group of the model, for a module of the draft's group with this id.
    pub fn of_module(&self, group: &str, module: &Module) -> Option<&'m str> {
        let of_node = module.nodes.iter().find_map(|node| most(self.of_nodes.get(node)?));
        of_node.map(|id| &*self.model.groups[id.0 as usize].path).or_else(|| self.of_group(group))
    }

    /// The group that has the most of the draft's group with this id, or one with its id.
    pub fn of_group(&self, group: &str) -> Option<&'m str> {
        let most = self.of_groups.get(group).and_then(most);
        let path = most.map(|id| &*self.model.groups[id.0 as usize].path);
        let named = || self.model.groups.iter().map(|it| &*it.path).find(|path| *path == group);
        path.or_else(named)
    }

    /// The whole names of the modules of a draft that the model has, as the model calls them.
    pub fn names(&self, draft: &Draft) -> BTreeMap<String, String> {
        let all = draft.groups.iter().flat_map(|group| group.modules.iter().map(move |it| (group, it)));
        let named = all.filter_map(|(group, module)| {
            let known = watching(self.model, &module.kind).next()?;
            Some((format!("{}/{}", group.id, module.id), known.id.to_string()))
        });
        named.collect()
    }
}

/// Of equally many, the first in the file.
fn most(counts: &BTreeMap<GroupId, usize>) -> Option<GroupId> {
    counts.iter().max_by_key(|(id, count)| (**count, std::cmp::Reverse(**id))).map(|(id, _)| *id)
}

/// The groups that watch the same already.
fn groups(model: &Model, kind: &ModuleKind) -> Vec<GroupId> {
    let mut found: Vec<GroupId> = watching(model, kind).map(|module| module.group).collect();
    if let (ModuleKind::Status { name, .. }, true) = (kind, found.is_empty()) {
        let groups = (0..).map(GroupId).zip(&model.groups);
        let takes = groups.filter(|(_, group)| group.filters.iter().any(|filter| filter.takes(name)));
        found.extend(takes.map(|(id, _)| id));
    }
    found
}

/// The modules that watch the same already.
fn watching<'m>(model: &'m Model, kind: &'m ModuleKind) -> impl Iterator<Item = &'m ModuleSpec> {
    let topic_is = |id: &TopicId, topic: &str| same_topic(&model.watched.topics[id.0 as usize].topic, topic);
    model.modules.iter().filter(move |module| match (kind, module.monitor.other()) {
        (ModuleKind::Status { name, .. }, _) => module.monitor.status().is_some_and(|it| **it == **name),
        (ModuleKind::Rate { topic, .. }, Some(MonitorSpec::Frequency { topic: id, .. }))
        | (ModuleKind::Age { topic, .. }, Some(MonitorSpec::Latency { topic: id, .. })) => {
            topic_is(id, topic)
        }
        (ModuleKind::Value { topic, .. }, Some(MonitorSpec::Value { source, .. })) => {
            matches!(source, ValueSource::Field { topic: id, .. } if topic_is(id, topic))
        }
        (ModuleKind::Node { name, .. }, Some(MonitorSpec::Watchdog { watchdog, .. })) => {
            match &model.watched.watchdogs[watchdog.0 as usize].target {
                ProbeTarget::Node { name: watched } | ProbeTarget::Lifecycle { name: watched } => {
                    **watched == **name
                }
                _ => false,
            }
        }
        _ => false,
    })
}
