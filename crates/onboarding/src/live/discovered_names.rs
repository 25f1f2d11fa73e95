//! The topics, nodes and services that discovery has found, by their names.

use std::collections::{BTreeMap, BTreeSet};

use crate::init::Observations;

pub struct There<'a> {
    /// The topics that others publish.
    pub topics: Vec<&'a str>,
    /// Their types, by their names without the first `/`.
    published: BTreeMap<&'a str, BTreeSet<&'a str>>,
    pub nodes: BTreeSet<&'a str>,
    pub services: BTreeSet<&'a str>,
    /// No topic is left out.
    pub all_topics: bool,
}

impl<'a> There<'a> {
    pub fn of(seen: &'a Observations) -> There<'a> {
        let (mut topics, mut published) = (Vec::new(), BTreeMap::new());
        for topic in &seen.discovery.topics {
            let others = topic.publishers.iter().filter(|it| !it.ours);
            let types: BTreeSet<&str> = others.map(|it| &*it.type_name).collect();
            if !types.is_empty() {
                topics.push(&*topic.name);
                published.insert(topic.name.trim_start_matches('/'), types);
            }
        }
        let names = |of: &'a [String]| of.iter().map(|name| &**name).collect();
        let (nodes, services) = (names(&seen.discovery.nodes), names(&seen.discovery.services));
        There { topics, published, nodes, services, all_topics: seen.discovery.more == 0 }
    }

    pub fn types_of(&self, topic: &str) -> BTreeSet<&'a str> {
        self.published.get(topic.trim_start_matches('/')).cloned().unwrap_or_default()
    }
}
