//! Which nodes stand behind one that fails.

use super::model::NodeId;
use super::net::Net;
use super::state::State;

/// Causes that are named for one node.
pub(super) const CAUSES_MAX: usize = 64;

/// The root causes of a node that fails, at most [`CAUSES_MAX`]; the node itself where it is one.
pub(super) fn roots(net: &Net, masked_by: &impl Fn(NodeId) -> Vec<NodeId>, node: NodeId) -> Vec<NodeId> {
    let mut found = Vec::new();
    collect(net, masked_by, node, &mut found);
    if found.is_empty() {
        found.push(node);
    }
    found
}

fn collect(net: &Net, masked_by: &impl Fn(NodeId) -> Vec<NodeId>, node: NodeId, found: &mut Vec<NodeId>) {
    if found.len() >= CAUSES_MAX {
        return;
    }
    let mut add = |node| {
        if !found.contains(&node) && found.len() < CAUSES_MAX {
            found.push(node);
        }
    };
    let facts = net.node(node).facts;
    if facts.masked {
        masked_by(node).into_iter().for_each(add);
        return;
    }
    match node {
        NodeId::Module(_) => add(node),
        NodeId::Group(id) => {
            let group = &net.groups[id.0 as usize];
            let bar = facts.worst().min(State::Error);
            // There may be thousands of them, and only so many are named.
            for &member in &group.failing {
                if found.len() >= CAUSES_MAX {
                    break;
                }
                if net.node(member).facts.worst() >= bar {
                    collect(net, masked_by, member, found);
                }
            }
        }
    }
}
