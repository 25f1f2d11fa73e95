//! Root causes of masked nodes and of nodes in ERROR, and the paths to them.
//!
//! Only the *region* of failing or blocked nodes is searched, and only when it changes; the size of the healthy
//! rest does not matter.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::hash::{BuildHasherDefault, Hasher};
use std::sync::Arc;

use super::net::{Change, Net};
use super::node::ModuleKind;
use super::paths::Ways;
use crate::model::{GroupId, ModuleId, NodeId};
use crate::snapshot::{Path, RootCause};
use crate::state::State;
use crate::time::Timestamp;

/// Root causes that are named for one node, and paths from it: the first by rank. More would not help on a
/// screen; all of them are counted.
const NAMED_MAX: usize = 64;

/// A reason to look further upstream.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(crate) enum Vertex {
    /// The dependencies that block a group and everything inside it.
    Blocked(GroupId),
    Module(ModuleId),
    /// The members that make a group fail.
    Failing(GroupId),
    /// The causes behind second faults: they are no causes of the second fault, but of all that waits for it.
    Beyond(NodeId),
    /// The causes of a group that only shows IGNORE.
    Hidden(GroupId),
}

/// Positions in [`SearchResult::roots`], ascending.
type RootSet = Arc<[u32]>;

#[derive(Debug, Clone, Default)]
pub(crate) struct Causes {
    region: BTreeSet<(u32, Vertex)>,
    since: HashMap<NodeId, Timestamp, IdHash>,
    dirty: bool,
    /// Groups with paths in the snapshot.
    explained: BTreeSet<GroupId>,
}

/// Hashes ids that the engine itself assigns, so no attacker can choose them: one multiplication for each word.
#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct IdHasher(u64);

pub(crate) type IdHash = BuildHasherDefault<IdHasher>;

impl Hasher for IdHasher {
    fn finish(&self) -> u64 {
        // A table takes the low bits as the place and the high bits to distinguish entries.
        self.0 ^ (self.0 >> 32)
    }

    fn write(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.write_u64(u64::from(byte));
        }
    }

    fn write_u32(&mut self, word: u32) {
        self.write_u64(u64::from(word));
    }

    fn write_u64(&mut self, word: u64) {
        self.0 = (self.0.rotate_left(5) ^ word).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    }

    fn write_isize(&mut self, word: isize) {
        self.write_u64(word as u64);
    }
}

/// The result of one search, for the snapshot.
#[derive(Debug)]
pub(crate) struct Explained {
    /// Ranked.
    pub(crate) roots: Vec<RootCause>,
    /// The ranked causes of each masked node.
    pub(crate) masked: Vec<(NodeId, Arc<[NodeId]>)>,
    /// The paths of each group that is in ERROR or masked; an empty list for a group that no longer is.
    pub(crate) paths: Vec<(GroupId, Arc<[Path]>)>,
}

pub(crate) struct SearchResult {
    pub(crate) order: Vec<Vertex>,
    pub(crate) position: HashMap<Vertex, usize, IdHash>,
    sets: Vec<RootSet>,
    roots: Vec<NodeId>,
    /// The position of each root.
    pub(crate) ends: Vec<u32>,
}

impl Causes {
    /// Copies the start times of root causes.
    pub(crate) fn copy_since(&mut self, old: &Causes, renamed: impl Fn(NodeId) -> Option<NodeId>) {
        let kept = old.since.iter().filter_map(|(&node, &since)| Some((renamed(node)?, since)));
        self.since = kept.collect();
    }

    /// When the present root causes began, in order of their ids.
    pub(crate) fn since(&self) -> Vec<(NodeId, Timestamp)> {
        let mut since: Vec<_> = self.since.iter().map(|(&node, &since)| (node, since)).collect();
        since.sort_unstable();
        since
    }

    /// Sets when the present root causes began, before they are searched.
    pub(crate) fn set_since(&mut self, since: &[(NodeId, Timestamp)]) {
        self.since = since.iter().copied().collect();
    }

    /// Notes a change of the graph. Cheap unless a node began or ceased to fail or to be blocked.
    pub(crate) fn note(&mut self, net: &Net, change: &Change) {
        let Change { node, before, after } = *change;
        if before.for_causes(net.threshold) == after.for_causes(net.threshold) {
            return;
        }
        self.dirty = true;
        match node {
            NodeId::Group(id) => {
                if net.groups[id.0 as usize].aside {
                    return;
                }
                self.toggle(net.enter_rank(id), Vertex::Blocked(id), after.blocked);
                self.toggle(net.leave_rank(id), Vertex::Failing(id), after.failing(net.threshold));
                self.toggle(net.leave_rank(id), Vertex::Beyond(node), after.second);
                self.toggle(net.leave_rank(id), Vertex::Hidden(id), after.masked);
            }
            NodeId::Module(id) => {
                let module = &net.modules[id.0 as usize];
                if module.node.parent.is_some_and(|group| net.groups[group.0 as usize].aside) {
                    return;
                }
                let matters = after.blocked || after.failing(net.threshold);
                self.toggle(module.rank, Vertex::Module(id), matters);
                self.toggle(module.rank, Vertex::Beyond(node), after.second);
            }
        }
    }

    fn toggle(&mut self, rank: u32, vertex: Vertex, present: bool) {
        if present {
            self.region.insert((rank, vertex));
        } else {
            self.region.remove(&(rank, vertex));
        }
    }

    /// Searches again if a relevant change was noted.
    pub(crate) fn explain(&mut self, net: &Net, now: Timestamp) -> Option<Explained> {
        if !std::mem::take(&mut self.dirty) {
            return None;
        }
        let found = search(net, &self.region);
        let (masks, hides_error) = found.count_masked(net);
        let mut roots: Vec<u32> = (0..found.roots.len() as u32)
            .filter(|&root| masks[root as usize] > 0 || shows_error(net, found.roots[root as usize]))
            .collect();
        let before = std::mem::take(&mut self.since);
        let since = |&root: &u32| {
            let node = found.roots[root as usize];
            (node, before.get(&node).copied().unwrap_or(now))
        };
        self.since = roots.iter().map(since).collect();
        roots.sort_by_cached_key(|&root| {
            let node = found.roots[root as usize];
            (Reverse(masks[root as usize]), self.since[&node], arrival(net, node), node)
        });
        let mut rank = vec![u32::MAX; found.roots.len()];
        for (place, &root) in roots.iter().enumerate() {
            rank[root as usize] = place as u32;
        }
        let paths = self.paths(net, &found, &rank);
        let cause = |&root: &u32| RootCause {
            node: found.roots[root as usize],
            masks: masks[root as usize],
            since: self.since[&found.roots[root as usize]],
            second: net.node(found.roots[root as usize]).facts.second,
            grace: !hides_error[root as usize] && in_grace(net, found.roots[root as usize]),
        };
        Some(Explained { masked: found.masked(net, &rank), paths, roots: roots.iter().map(cause).collect() })
    }

    fn paths(&mut self, net: &Net, found: &SearchResult, rank: &[u32]) -> Vec<(GroupId, Arc<[Path]>)> {
        let mut shown: Vec<(GroupId, u32)> = Vec::new();
        // By rank, so that each group's paths are in that order.
        let mut wanted: BTreeMap<u32, (u32, Vec<usize>)> = BTreeMap::new();
        for (position, &vertex) in (0..).zip(&found.order) {
            let (Vertex::Failing(id) | Vertex::Hidden(id)) = vertex else { continue };
            let facts = net.groups[id.0 as usize].node.facts;
            if matches!(vertex, Vertex::Hidden(_)) || facts.shown == State::Error {
                for root in ranked(&found.sets[position as usize], rank) {
                    let (_, groups) = wanted.entry(rank[root as usize]).or_insert((root, Vec::new()));
                    groups.push(shown.len());
                }
                shown.push((id, position));
            }
        }
        let mut lists: Vec<Vec<Path>> = shown.iter().map(|_| Vec::new()).collect();
        let mut ways = Ways::new(net, found);
        for (root, groups) in wanted.into_values() {
            ways.walk_from(root);
            for index in groups {
                lists[index].push(ways.path(shown[index].1));
            }
        }
        let before = std::mem::replace(&mut self.explained, shown.iter().map(|(id, ..)| *id).collect());
        let gone = before.difference(&self.explained).map(|&id| (id, Arc::from(Vec::new())));
        let mut paths: Vec<(GroupId, Arc<[Path]>)> = gone.collect();
        let listed = shown.into_iter().zip(lists);
        paths.extend(listed.map(|((id, _), list)| (id, list.into())));
        paths
    }
}

fn shows_error(net: &Net, node: NodeId) -> bool {
    net.node(node).facts.shown == State::Error
}

/// Whether the module only says that names were dropped.
fn says_dropped(net: &Net, node: NodeId) -> bool {
    matches!(node, NodeId::Module(id) if net.modules[id.0 as usize].kind == ModuleKind::Overflow)
}

/// UNKNOWN only because the node still has time to report.
fn in_grace(net: &Net, node: NodeId) -> bool {
    let facts = net.node(node).facts;
    facts.shown == State::Unknown && facts.grace
}

/// Declared nodes come before discovered ones.
fn arrival(net: &Net, node: NodeId) -> u64 {
    match node {
        NodeId::Group(_) => 0,
        NodeId::Module(id) => net.modules[id.0 as usize].arrival,
    }
}

/// The best ranked of a set, at most [`NAMED_MAX`], in order of rank.
fn ranked(set: &[u32], rank: &[u32]) -> Vec<u32> {
    let mut named: Vec<u32> = set.iter().copied().filter(|&root| rank[root as usize] != u32::MAX).collect();
    named.sort_unstable_by_key(|&root| rank[root as usize]);
    named.truncate(NAMED_MAX);
    named
}

/// Walks through the region in the order of the graph: every target of a vertex comes before it.
fn search(net: &Net, region: &BTreeSet<(u32, Vertex)>) -> SearchResult {
    let mut found = SearchResult {
        order: Vec::with_capacity(region.len()),
        position: HashMap::with_capacity_and_hasher(region.len(), IdHash::default()),
        sets: Vec::with_capacity(region.len()),
        roots: Vec::new(),
        ends: Vec::new(),
    };
    for &(_, vertex) in region {
        let set = match end(net, vertex) {
            Some(node) => {
                found.roots.push(node);
                found.ends.push(found.order.len() as u32);
                Arc::from([found.roots.len() as u32 - 1])
            }
            None => found.union(net, vertex),
        };
        found.position.insert(vertex, found.order.len());
        found.order.push(vertex);
        found.sets.push(set);
    }
    found
}

/// The node itself, if it ends a path upstream.
pub(crate) fn end(net: &Net, vertex: Vertex) -> Option<NodeId> {
    match vertex {
        Vertex::Module(id) => {
            let facts = net.modules[id.0 as usize].node.facts;
            (!facts.blocked || facts.second).then_some(NodeId::Module(id))
        }
        Vertex::Failing(id) => {
            let group = &net.groups[id.0 as usize];
            (group.members.is_empty() && !group.node.facts.blocked).then_some(NodeId::Group(id))
        }
        Vertex::Blocked(_) | Vertex::Beyond(_) | Vertex::Hidden(_) => None,
    }
}

/// The ways upstream from a dependency to the causes of all that waits for it: the dependencies that block its node,
/// and the members for which the node fails.
pub(crate) fn for_each_way(net: &Net, node: NodeId, masks_unknown: bool, mut hop: impl FnMut(Vertex)) {
    let facts = net.node(node).facts;
    match node {
        NodeId::Module(id) => hop(Vertex::Module(id)),
        NodeId::Group(id) => {
            if facts.blocked {
                hop(Vertex::Blocked(id));
            }
            if facts.standing().fails(masks_unknown) {
                hop(Vertex::Failing(id));
            }
        }
    }
    if facts.second {
        hop(Vertex::Beyond(node));
    }
}

/// One step upstream from a vertex, in configuration order. A step through a dependency says whether UNKNOWN masks
/// there.
pub(crate) fn for_each_hop(net: &Net, vertex: Vertex, mut hop: impl FnMut(Vertex, Option<bool>)) {
    match vertex {
        Vertex::Blocked(id) => blocked_hops(net, NodeId::Group(id), &mut hop),
        Vertex::Beyond(NodeId::Module(id)) => blocked_hops(net, NodeId::Module(id), &mut hop),
        Vertex::Module(id) => {
            if net.modules[id.0 as usize].node.facts.blocked {
                blocked_hops(net, NodeId::Module(id), &mut hop);
            }
        }
        Vertex::Failing(id) => {
            for member in responsible(net, id) {
                match member {
                    NodeId::Module(id) => hop(Vertex::Module(id), None),
                    NodeId::Group(id) => {
                        let facts = net.groups[id.0 as usize].node.facts;
                        if facts.blocked && facts.masked {
                            hop(Vertex::Blocked(id), None);
                        }
                        hop(Vertex::Failing(id), None);
                    }
                }
            }
        }
        Vertex::Beyond(NodeId::Group(id)) => {
            for member in responsible(net, id).filter(|&member| net.node(member).facts.second) {
                match member {
                    NodeId::Group(id) if net.groups[id.0 as usize].node.facts.blocked => {
                        hop(Vertex::Blocked(id), None);
                    }
                    _ => {}
                }
                hop(Vertex::Beyond(member), None);
            }
        }
        Vertex::Hidden(id) => {
            let group = &net.groups[id.0 as usize];
            if group.node.facts.blocked {
                blocked_hops(net, NodeId::Group(id), &mut hop);
            }
            for &member in &group.masked {
                let member = match member {
                    NodeId::Module(id) => Vertex::Module(id),
                    NodeId::Group(id) => Vertex::Hidden(id),
                };
                hop(member, None);
            }
        }
    }
}

/// The members for which a group fails, in configuration order.
fn responsible(net: &Net, id: GroupId) -> impl Iterator<Item = NodeId> {
    let group = &net.groups[id.0 as usize];
    let standing = group.node.facts.standing();
    let is_responsible =
        move |&member: &NodeId| net.node(member).facts.standing().is_responsible_for(standing);
    group.failing.iter().copied().filter(is_responsible)
}

/// The dependencies that block a node: its own, then those of the enclosing groups.
fn blocked_hops(net: &Net, node: NodeId, hop: &mut impl FnMut(Vertex, Option<bool>)) {
    let mut at = Some(node);
    while let Some(node) = at.map(|id| net.node(id)).filter(|node| node.facts.blocked) {
        for need in node.needs.iter().filter(|need| need.blocks()) {
            for &member in &need.members {
                for_each_way(net, member, need.masks_unknown, |vertex| hop(vertex, Some(need.masks_unknown)));
            }
        }
        at = node.parent.map(NodeId::Group);
    }
}

impl SearchResult {
    fn set(&self, vertex: Vertex) -> Option<&RootSet> {
        self.position.get(&vertex).map(|&position| &self.sets[position])
    }

    fn union(&self, net: &Net, vertex: Vertex) -> RootSet {
        if let Vertex::Module(id) = vertex {
            let node = &net.modules[id.0 as usize].node;
            let around =
                node.parent.filter(|_| node.blocking == 0).and_then(|id| self.set(Vertex::Blocked(id)));
            // Blocked only by its group: thousands of modules share one set.
            if let Some(set) = around {
                return set.clone();
            }
        }
        let mut parts: Vec<&RootSet> = Vec::new();
        for_each_hop(net, vertex, |hop, _| {
            if let Some(set) = self.set(hop)
                && !parts.iter().rev().take(4).any(|part| Arc::ptr_eq(part, set))
            {
                parts.push(set);
            }
        });
        match parts.as_slice() {
            [only] => (*only).clone(),
            _ => {
                let mut all: Vec<u32> = parts.iter().flat_map(|set| set.iter().copied()).collect();
                all.sort_unstable();
                all.dedup();
                all.into()
            }
        }
    }

    fn is_masked(&self, net: &Net, vertex: Vertex) -> Option<NodeId> {
        match vertex {
            Vertex::Module(id) if net.modules[id.0 as usize].node.facts.masked => Some(NodeId::Module(id)),
            Vertex::Hidden(id) => Some(NodeId::Group(id)),
            Vertex::Module(_) | Vertex::Blocked(_) | Vertex::Failing(_) | Vertex::Beyond(_) => None,
        }
    }

    /// How many modules and groups show IGNORE because of each root, and whether a module among them is
    /// in ERROR itself. What says that names were dropped is in no count.
    fn count_masked(&self, net: &Net) -> (Vec<u32>, Vec<bool>) {
        let mut masks = vec![0; self.roots.len()];
        let mut hides_error = vec![false; self.roots.len()];
        for (position, &vertex) in self.order.iter().enumerate() {
            let Some(node) = self.is_masked(net, vertex).filter(|&node| !says_dropped(net, node)) else {
                continue;
            };
            let in_error = matches!(node, NodeId::Module(_)) && net.node(node).facts.own == State::Error;
            for &root in &*self.sets[position] {
                masks[root as usize] += 1;
                hides_error[root as usize] |= in_error;
            }
        }
        (masks, hides_error)
    }

    fn masked(&self, net: &Net, rank: &[u32]) -> Vec<(NodeId, Arc<[NodeId]>)> {
        let mut shared: HashMap<*const u32, Arc<[NodeId]>> = HashMap::new();
        let mut masked = Vec::new();
        for (position, &vertex) in self.order.iter().enumerate() {
            let Some(node) = self.is_masked(net, vertex) else { continue };
            let set = &self.sets[position];
            let by = shared.entry(set.as_ptr()).or_insert_with(|| {
                // A cause that masks only the report of dropped names has no rank, and is named all the same.
                let mut named = set.to_vec();
                named.sort_unstable_by_key(|&root| (rank[root as usize], root));
                named.truncate(NAMED_MAX);
                named.into_iter().map(|root| self.roots[root as usize]).collect()
            });
            masked.push((node, by.clone()));
        }
        masked
    }
}
