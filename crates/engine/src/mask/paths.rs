//! The shortest ways upstream from groups to the root causes that explain them.

use super::causes::{SearchResult, Vertex, end, for_each_hop};
use super::net::Net;
use crate::model::NodeId;
use crate::snapshot::Path;

/// The reversed hops of one search, with room for one walk at a time. A walk starts at a root cause and visits
/// only the nodes that lead to it, so thousands of other roots cost nothing.
pub(crate) struct Ways<'a> {
    found: &'a SearchResult,
    /// By position: the vertices that hop there, and the index of each hop.
    back: Vec<Vec<(u32, u32)>>,
    /// By position: the step of the latest walk that passed.
    steps: Vec<Step>,
    walk: u32,
}

#[derive(Debug, Clone, Copy, Default)]
struct Step {
    /// The walk of this step; steps of earlier walks do not count.
    walk: u32,
    length: u32,
    /// The index of the hop. Among equally short paths the first hop counts.
    hop: u32,
    next: u32,
}

impl<'a> Ways<'a> {
    pub(crate) fn new(net: &Net, found: &'a SearchResult) -> Ways<'a> {
        let mut back = vec![Vec::new(); found.order.len()];
        for (position, &vertex) in (0..).zip(&found.order) {
            // A path ends here.
            if end(net, vertex).is_some() {
                continue;
            }
            let mut number = 0;
            for_each_hop(net, vertex, |hop, _| {
                if let Some(&next) = found.position.get(&hop) {
                    back[next].push((position, number));
                }
                number += 1;
            });
        }
        Ways { found, back, steps: vec![Step::default(); found.order.len()], walk: 0 }
    }

    /// Finds the shortest path to one root from every vertex that leads to it.
    pub(crate) fn walk_from(&mut self, root: u32) {
        self.walk += 1;
        let start = self.found.ends[root as usize];
        self.steps[start as usize] = Step { walk: self.walk, length: 0, hop: 0, next: start };
        let mut reached = vec![start];
        let mut at = 0;
        while let Some(&next) = reached.get(at) {
            at += 1;
            let length = self.steps[next as usize].length + 1;
            for &(position, hop) in &self.back[next as usize] {
                let step = &mut self.steps[position as usize];
                if step.walk != self.walk {
                    reached.push(position);
                } else if (step.length, step.hop) <= (length, hop) {
                    continue;
                }
                *step = Step { walk: self.walk, length, hop, next };
            }
        }
    }

    /// The path of the latest walk from a vertex to its root.
    pub(crate) fn path(&self, start: u32) -> Path {
        let mut path = Vec::new();
        let mut position = start;
        loop {
            let step = self.steps[position as usize];
            if step.walk != self.walk {
                return path.into();
            }
            path.push(match self.found.order[position as usize] {
                Vertex::Module(id) => NodeId::Module(id),
                Vertex::Beyond(node) => node,
                Vertex::Blocked(id) | Vertex::Failing(id) | Vertex::Hidden(id) => NodeId::Group(id),
            });
            if step.length == 0 {
                return path.into();
            }
            position = step.next;
        }
    }
}
