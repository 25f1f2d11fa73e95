//! Finds the nodes that are responsible for the failure of another.

use super::net::Net;
use crate::model::NodeId;

/// The number of causes that are named for one node.
pub(crate) const CAUSES_MAX: usize = 64;

const ROOTS_MAX: usize = CAUSES_MAX + 1;

/// The root causes of a failing node, one more than [`CAUSES_MAX`] if there are more; the node itself if it is
/// a root cause.
pub(crate) fn roots(net: &Net, masked_by: &impl Fn(NodeId) -> Vec<NodeId>, node: NodeId) -> Vec<NodeId> {
    let mut found = Vec::new();
    collect(net, masked_by, node, &mut found);
    if found.is_empty() {
        found.push(node);
    }
    found
}

fn collect(net: &Net, masked_by: &impl Fn(NodeId) -> Vec<NodeId>, node: NodeId, found: &mut Vec<NodeId>) {
    if found.len() >= ROOTS_MAX {
        return;
    }
    let mut add = |node| {
        if !found.contains(&node) && found.len() < ROOTS_MAX {
            found.push(node);
        }
    };
    let facts = net.node(node).facts;
    if facts.masked {
        let causes = masked_by(node);
        // If there are more causes than can be named, the node itself represents the others.
        let others = (causes.len() >= CAUSES_MAX).then_some(node);
        causes.into_iter().chain(others).for_each(add);
        return;
    }
    match node {
        NodeId::Module(_) => add(node),
        NodeId::Group(id) => {
            let group = &net.groups[id.0 as usize];
            // There may be thousands of roots; only a few are named.
            for &member in &group.failing {
                if found.len() >= ROOTS_MAX {
                    break;
                }
                if net.node(member).facts.standing().is_responsible_for(facts.standing()) {
                    collect(net, masked_by, member, found);
                }
            }
        }
    }
}
