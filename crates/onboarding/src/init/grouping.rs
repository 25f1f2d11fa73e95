//! Groups by namespace and node: to which group a node and a status belong.

use std::collections::{BTreeMap, BTreeSet};

use super::names::{is_tool, prefix};
use super::observations::{Observations, is_of_components};
use telltale_engine::discovery::Endpoint;
use telltale_engine::input::WriterId;

/// More tiles nobody can look at.
const GROUPS_MAX: usize = 64;

/// The rest of the names when there are too many.
const REST: &str = "further";

/// Where nodes and statuses belong, by the keys of their groups.
#[derive(Debug, Default)]
pub struct Grouping {
    pub of_node: BTreeMap<String, String>,
    pub of_status: BTreeMap<Box<str>, String>,
    /// The node that a status tells about, if one is known.
    pub node_of_status: BTreeMap<Box<str>, String>,
    /// Of topics whose publishers announced no node.
    pub of_topic: BTreeMap<String, String>,
    /// The only node with a group in a participant: it stands for endpoints of nodes without one.
    alone: BTreeMap<String, String>,
}

impl Grouping {
    pub fn of(seen: &Observations) -> Grouping {
        let speaking = speaking(seen);
        let common = common_namespace(&speaking);
        let mut grouping = Grouping::default();
        for node in &speaking {
            let inner = node.strip_prefix(&*common).unwrap_or(node).trim_start_matches('/');
            let key = inner.split('/').next().unwrap_or(inner);
            grouping.of_node.insert((*node).to_owned(), key.to_owned());
        }
        let named = Named::new(&speaking);
        let collectors = collectors(seen, &named);
        for (name, status) in &seen.statuses {
            let by_name = prefix(name).and_then(|prefix| named.by(prefix));
            let mut writers = status.writers.iter().filter(|writer| !collectors.contains(writer));
            let node = by_name.or_else(|| writers.find_map(|writer| seen.nodes.get(writer)).map(|it| &**it));
            let first = |prefix: &str| prefix.trim_matches('/').split('/').next().unwrap_or("").to_owned();
            let key = match node.and_then(|node| grouping.of_node.get(node)) {
                Some(key) => key.clone(),
                None => prefix(name).map_or_else(|| "statuses".to_owned(), first),
            };
            if let Some(node) = node {
                grouping.node_of_status.insert(name.clone(), node.to_owned());
            }
            grouping.of_status.insert(name.clone(), key);
        }
        for topic in seen.discovery.topics.iter().filter(|topic| is_of_components(topic)) {
            let anonymous = topic.publishers.iter().any(|it| !it.ours && it.node.is_none());
            if anonymous && topic.publishers.iter().all(|it| it.ours || it.node.is_none()) {
                let mut parts = topic.name.trim_start_matches('/').split('/');
                let (first, more) = (parts.next().unwrap_or(""), parts.next());
                let key = if more.is_some() { first } else { "topics" };
                grouping.of_topic.insert(topic.name.clone(), key.to_owned());
            }
        }
        grouping.fold();
        grouping.find_those_alone(seen);
        grouping
    }

    /// The group of an endpoint of a topic.
    pub fn of_endpoint(&self, endpoint: &Endpoint) -> Option<&str> {
        let node = endpoint.node.as_ref().and_then(|node| self.of_node.get(node));
        node.or_else(|| self.alone.get(&endpoint.participant)).map(|key| &**key)
    }

    /// Joins groups until there are few enough.
    fn fold(&mut self) {
        let all = || self.of_node.values().chain(self.of_status.values()).chain(self.of_topic.values());
        let distinct: BTreeSet<&str> = all().map(|key| &**key).collect();
        if distinct.len() <= GROUPS_MAX {
            return;
        }
        let mut weights: BTreeMap<&str, usize> = BTreeMap::new();
        for key in all() {
            *weights.entry(word(key)).or_default() += 1;
        }
        let mut heaviest: Vec<(&str, usize)> = weights.into_iter().collect();
        heaviest.sort_by_key(|(_, weight)| std::cmp::Reverse(*weight));
        heaviest.truncate(GROUPS_MAX - 1);
        let kept: BTreeSet<String> = heaviest.into_iter().map(|(key, _)| key.to_owned()).collect();
        let keys =
            self.of_node.values_mut().chain(self.of_status.values_mut()).chain(self.of_topic.values_mut());
        for key in keys {
            let short = word(key);
            *key = if kept.contains(short) { short.to_owned() } else { REST.to_owned() };
        }
    }

    fn find_those_alone(&mut self, seen: &Observations) {
        let mut groups: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
        for topic in &seen.discovery.topics {
            for endpoint in topic.publishers.iter().chain(&topic.subscribers).filter(|it| !it.ours) {
                let key = endpoint.node.as_ref().and_then(|node| self.of_node.get(node));
                if let Some(key) = key {
                    groups.entry(&endpoint.participant).or_default().insert(key);
                }
            }
        }
        let alone = groups.into_iter().filter(|(_, keys)| keys.len() == 1);
        self.alone = alone
            .filter_map(|(participant, keys)| Some((participant.to_owned(), (*keys.first()?).to_owned())))
            .collect();
    }
}

/// Nodes that publish statuses, or topics that connect components.
fn speaking(seen: &Observations) -> BTreeSet<&str> {
    let topics = seen.discovery.topics.iter().filter(|topic| is_of_components(topic));
    let publishers = topics.flat_map(|topic| &topic.publishers).filter(|it| !it.ours);
    let of_topics = publishers.filter_map(|it| it.node.as_deref());
    let writers = seen.statuses.values().flat_map(|status| &status.writers);
    let of_statuses = writers.filter_map(|writer| seen.nodes.get(writer)).map(|node| &**node);
    let known: BTreeSet<&str> = seen.announced.iter().map(|node| &**node).collect();
    let index = Named::new(&known);
    let named = seen.statuses.keys().filter_map(|name| prefix(name)).filter_map(|it| index.by(it));
    of_topics.chain(of_statuses).chain(named).filter(|node| !is_tool(node)).collect()
}

/// Nodes by their full names, and by the last parts that only one has.
struct Named<'s, 'a> {
    full: &'s BTreeSet<&'a str>,
    by_end: BTreeMap<&'a str, Option<&'a str>>,
}

impl<'s, 'a> Named<'s, 'a> {
    fn new(full: &'s BTreeSet<&'a str>) -> Named<'s, 'a> {
        let mut by_end: BTreeMap<&str, Option<&str>> = BTreeMap::new();
        for &node in full {
            let end = node.rsplit('/').next().unwrap_or_default();
            by_end.entry(end).and_modify(|one| *one = None).or_insert(Some(node));
        }
        Named { full, by_end }
    }

    /// The node that a prefix names.
    fn by(&self, prefix: &str) -> Option<&'a str> {
        let wanted = prefix.trim_matches('/');
        let full = self.full.get(&*format!("/{wanted}")).copied();
        full.or_else(|| self.by_end.get(wanted).copied().flatten())
    }
}

/// Writers that report for others: one of their statuses names another node.
fn collectors<'a>(seen: &'a Observations, nodes: &Named<'_, '_>) -> BTreeSet<&'a WriterId> {
    let mut found = BTreeSet::new();
    for (name, status) in &seen.statuses {
        let Some(named) = prefix(name).and_then(|prefix| nodes.by(prefix)) else { continue };
        let others =
            status.writers.iter().filter(|it| seen.nodes.get(it).is_some_and(|node| **node != *named));
        found.extend(others);
    }
    found
}

/// The namespace that all nodes share, as those of one of several robots do.
fn common_namespace(nodes: &BTreeSet<&str>) -> String {
    let mut namespaces = nodes.iter().map(|node| node.rsplit_once('/').map_or("", |(space, _)| space));
    let Some(first) = namespaces.next() else { return String::new() };
    let first = first.split('/').nth(1).unwrap_or("");
    let is_shared = |space: &str| space.split('/').nth(1) == Some(first);
    if !first.is_empty() && nodes.len() > 1 && namespaces.all(is_shared) {
        format!("/{first}")
    } else {
        String::new()
    }
}

/// The first word of a name: `wheel` of `wheel_12`, `n` of `n0001`.
fn word(key: &str) -> &str {
    let end = key.find(|letter: char| letter == '_' || letter.is_ascii_digit()).unwrap_or(key.len());
    if end == 0 { REST } else { &key[..end] }
}
