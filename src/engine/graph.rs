//! Order, masking and root causes over the graph of dependencies (`ENGINE.md` 4 and 6).

use super::model::{NodeId, Parts};

/// An order of evaluation: whatever a node's state rests on stands before it.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Order {}

impl Order {
    pub(super) fn of(_parts: &Parts) -> Result<Order, Cycle> {
        Ok(Order {})
    }
}

/// Dependencies that end where they began: each node rests on the next, the last on the first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Cycle(pub Vec<NodeId>);
