//! The order in which states can be computed, and the cycles that have none.
//!
//! A group appears twice: it is *entered* when its relevance and its own dependencies are known, and *left*
//! when its members are known. A dependency is judged after its group was left.

use super::{Dependency, GroupId, ModuleId, NodeId, Parts};

/// Ranks: every state depends only on states of smaller rank. Ranks of the model are even; discovered modules
/// stand just before their group is left, on an odd rank.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Order {
    pub(crate) enter: Vec<u32>,
    pub(crate) leave: Vec<u32>,
    pub(crate) module: Vec<u32>,
}

/// A cycle of dependencies: each step's node depends on the next, the last on the first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cycle(pub Vec<CycleStep>);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CycleStep {
    pub node: NodeId,
    pub by: CycleEdge,
}

/// The reason why a node depends on the next one of its cycle.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CycleEdge {
    /// Entry `index` in the `depends_on` of `holder`: the node itself or an enclosing group.
    Depends { holder: NodeId, index: usize },
    /// The next node is a member of this one.
    Contains,
}

impl Order {
    /// All visits, each after everything that it depends on.
    pub(crate) fn visits(&self) -> Vec<Visit> {
        let groups = (0..).map(GroupId).zip(self.enter.iter().zip(&self.leave));
        let groups =
            groups.flat_map(|(id, (enter, leave))| [(*enter, Visit::Enter(id)), (*leave, Visit::Leave(id))]);
        let modules = (0..).map(ModuleId).zip(&self.module).map(|(id, rank)| (*rank, Visit::Module(id)));
        let mut visits: Vec<(u32, Visit)> = groups.chain(modules).collect();
        visits.sort_unstable_by_key(|(rank, _)| *rank);
        visits.into_iter().map(|(_, visit)| visit).collect()
    }

    /// Orders the parts; where dependencies leave a choice, in configuration order.
    pub(crate) fn of(parts: &Parts) -> Result<Order, Cycle> {
        let members = parts.members();
        find_cycle(parts, &members)?;
        Ok(Sorter::sort(parts, &members))
    }
}

/// The direct dependencies of `node`: its own, those of the enclosing groups, and its members.
fn edges(parts: &Parts, members: &[Vec<NodeId>], node: NodeId) -> Vec<(NodeId, CycleEdge)> {
    let mut found = Vec::new();
    for holder in std::iter::once(node).chain(parts.around(node).map(NodeId::Group)) {
        for (index, dependency) in parts.depends_on(holder).iter().enumerate() {
            let edge = CycleEdge::Depends { holder, index };
            found.extend(dependency.targets().iter().map(|&target| (target, edge)));
        }
    }
    if let NodeId::Group(id) = node {
        found.extend(members[id.0 as usize].iter().map(|&member| (member, CycleEdge::Contains)));
    }
    found
}

#[derive(Clone, Copy, PartialEq)]
enum Mark {
    New,
    Open,
    Done,
}

/// Depth first with a stack of its own: a chain of dependencies may be longer than the thread's stack.
fn find_cycle(parts: &Parts, members: &[Vec<NodeId>]) -> Result<(), Cycle> {
    let groups = parts.groups.len();
    let key = |node: NodeId| match node {
        NodeId::Group(id) => id.0 as usize,
        NodeId::Module(id) => groups + id.0 as usize,
    };
    let mut marks = vec![Mark::New; groups + parts.modules.len()];
    for start in parts.nodes() {
        if marks[key(start)] != Mark::New {
            continue;
        }
        marks[key(start)] = Mark::Open;
        let mut path = vec![(start, edges(parts, members, start), 0)];
        while let Some((node, out, next)) = path.last_mut() {
            let Some(&(target, _)) = out.get(*next) else {
                marks[key(*node)] = Mark::Done;
                path.pop();
                continue;
            };
            *next += 1;
            match marks[key(target)] {
                Mark::Done => {}
                Mark::New => {
                    marks[key(target)] = Mark::Open;
                    path.push((target, edges(parts, members, target), 0));
                }
                Mark::Open => {
                    let first = path.iter().position(|(node, ..)| *node == target).unwrap_or(0);
                    let step = |(node, out, next): &(NodeId, Vec<(NodeId, CycleEdge)>, usize)| CycleStep {
                        node: *node,
                        by: out[*next - 1].1,
                    };
                    return Err(Cycle(path[first..].iter().map(step).collect()));
                }
            }
        }
    }
    Ok(())
}

/// One visit of a node: see the top of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Visit {
    Enter(GroupId),
    Leave(GroupId),
    Module(ModuleId),
}

struct Sorter {
    order: Order,
    next: u32,
}

const UNSET: u32 = u32::MAX;

impl Sorter {
    fn sort(parts: &Parts, members: &[Vec<NodeId>]) -> Order {
        let order = Order {
            enter: vec![UNSET; parts.groups.len()],
            leave: vec![UNSET; parts.groups.len()],
            module: vec![UNSET; parts.modules.len()],
        };
        let mut sorter = Sorter { order, next: 0 };
        for id in 0..parts.groups.len() as u32 {
            sorter.visit(Visit::Leave(GroupId(id)), parts, members);
        }
        sorter.order
    }

    /// Post-order over the dependencies of each visit; [`find_cycle`] has excluded cycles.
    fn visit(&mut self, start: Visit, parts: &Parts, members: &[Vec<NodeId>]) {
        let mut stack = vec![(start, false)];
        while let Some((visit, ready)) = stack.pop() {
            if *self.rank(visit) != UNSET {
                continue;
            }
            if ready {
                let rank = self.next;
                self.next += 2;
                *self.rank(visit) = rank;
                continue;
            }
            stack.push((visit, true));
            let needs = needs(visit, parts, members);
            stack.extend(needs.into_iter().rev().map(|need| (need, false)));
        }
    }

    fn rank(&mut self, visit: Visit) -> &mut u32 {
        match visit {
            Visit::Enter(id) => &mut self.order.enter[id.0 as usize],
            Visit::Leave(id) => &mut self.order.leave[id.0 as usize],
            Visit::Module(id) => &mut self.order.module[id.0 as usize],
        }
    }
}

fn needs(visit: Visit, parts: &Parts, members: &[Vec<NodeId>]) -> Vec<Visit> {
    let leave = |node: NodeId| match node {
        NodeId::Group(id) => Visit::Leave(id),
        NodeId::Module(id) => Visit::Module(id),
    };
    let node = match visit {
        Visit::Leave(id) => {
            let own = members[id.0 as usize].iter().copied().map(leave);
            return std::iter::once(Visit::Enter(id)).chain(own).collect();
        }
        Visit::Enter(id) => NodeId::Group(id),
        Visit::Module(id) => NodeId::Module(id),
    };
    let depends = parts.depends_on(node).iter().flat_map(Dependency::targets).copied().map(leave);
    parts.parent(node).map(Visit::Enter).into_iter().chain(depends).collect()
}
