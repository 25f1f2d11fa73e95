//! The release of a held vehicle: what forbids it, what it ends, and what the vehicle is told of it.

use std::cmp::Reverse;
use std::collections::HashSet;

use super::held::{Countermeasures, HeldRequest, RequestOrigin};
use crate::mask::responsible::CAUSES_MAX;
use crate::model::NodeId;
use crate::model::countermeasure::RequestKind;
use crate::time::{Since, Span, Timestamp};

impl Countermeasures {
    /// Ends every request that moves the vehicle and has no cause any more, and the operator's stop.
    pub(crate) fn release(&mut self) {
        self.knows_all = true;
        let stays = |held: &HeldRequest| {
            !held.request.kind().moves() || held.present && held.by != RequestOrigin::Operator
        };
        self.held.retain(stays);
    }

    /// Nodes whose failure forbids a release, each once: the causes that are still there.
    pub(crate) fn remaining_causes(&self) -> Vec<NodeId> {
        let moving = self.held.iter().filter(|held| held.present && held.request.kind().moves());
        let nodes = moving.flat_map(|held| {
            let present = held.causes.iter().filter(|cause| cause.present).map(|cause| cause.node);
            // Where no cause is left, it is what asked and waited for one.
            let is_left = held.causes.iter().all(|cause| !cause.present);
            let is_over = |node| held.asking.iter().any(|it| it.node == node && !it.present);
            present.chain(held.about().filter(move |&node| is_left && !is_over(node)))
        });
        let mut seen = HashSet::new();
        nodes.filter(|&node| seen.insert(node)).take(CAUSES_MAX).collect()
    }

    /// Since when requests of a kind are held.
    pub(crate) fn earliest(&self, kind: RequestKind) -> Since {
        let of_kind = self.held.iter().filter(|held| held.request.kind() == kind);
        let earliest = of_kind.map(HeldRequest::since).min_by_key(|it| (it.at, Reverse(it.before)));
        earliest.unwrap_or(Since { at: Timestamp::MAX, before: Span::ZERO })
    }

    /// Whether the vehicle is held: it must not go on before it is released. `None`: nothing is known to be held,
    /// and this run of the program does not know what an earlier one has asked for.
    pub(crate) fn hold(&self) -> Option<bool> {
        let is_held = self.moving().next().is_some();
        (is_held || self.knows_all).then_some(is_held)
    }
}
