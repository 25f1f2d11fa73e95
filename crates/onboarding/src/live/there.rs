//! The topics, nodes and services that discovery has found, by their names.

use std::collections::{BTreeMap, BTreeSet};

use crate::init::Observations;
use telltale_engine::discovery::Endpoint;

pub struct There<'a> {
    /// The topics that others publish.
    pub topics: Vec<&'a str>,
    /// Their types, by their names without the first `/`.
    published: BTreeMap<&'a str, BTreeSet<&'a str>>,
    pub nodes: BTreeSet<&'a str>,
    pub services: BTreeSet<String>,
    /// No topic is left out.
    pub all_topics: bool,
}

impl<'a> There<'a> {
    pub fn of(seen: &'a Observations) -> There<'a> {
        let (mut topics, mut published) = (Vec::new(), BTreeMap::new());
        for topic in &seen.discovery.topics {
            let types = others(&topic.publishers).map(|it| &*it.type_name);
            let types: BTreeSet<&str> = types.collect();
            if !types.is_empty() {
                topics.push(&*topic.name);
                published.insert(topic.name.trim_start_matches('/'), types);
            }
        }
        let nodes = seen.discovery.nodes.iter().map(|node| &**node).collect();
        There { topics, published, nodes, services: services(seen), all_topics: seen.discovery.more == 0 }
    }

    pub fn types_of(&self, topic: &str) -> BTreeSet<&'a str> {
        self.published.get(topic.trim_start_matches('/')).cloned().unwrap_or_default()
    }
}

fn others(endpoints: &[Endpoint]) -> impl Iterator<Item = &Endpoint> {
    endpoints.iter().filter(|it| !it.ours)
}

/// A service is there if one participant reads its requests and writes its replies.
fn services(seen: &Observations) -> BTreeSet<String> {
    let topics = &seen.discovery.topics;
    let named = |name: &'_ str, prefix: &str, suffix: &str| {
        name.trim_start_matches('/').strip_prefix(prefix)?.strip_suffix(suffix).map(str::to_owned)
    };
    let mut replying: BTreeMap<String, BTreeSet<&str>> = BTreeMap::new();
    for topic in topics {
        if let Some(service) = named(&topic.name, "rr/", "Reply") {
            replying.entry(service).or_default().extend(others(&topic.publishers).map(|it| &*it.participant));
        }
    }
    let offered = topics.iter().filter_map(|topic| {
        let service = named(&topic.name, "rq/", "Request")?;
        let replying = replying.get(&service)?;
        others(&topic.subscribers)
            .any(|it| replying.contains(&*it.participant))
            .then(|| format!("/{service}"))
    });
    offered.collect()
}
