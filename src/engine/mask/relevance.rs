//! Which conditions hold: the vehicle's state decides what is worth looking at (`ENGINE.md` 3).

use super::net::Net;
use crate::engine::model::{NodeId, POSED_SIGNAL, Stage, When};
use crate::engine::signals::Signals;
use crate::engine::snapshot::NotRelevant;

/// The first condition that does not hold. A signal that is unknown meets every condition: what
/// is not known to be irrelevant is diagnosed.
pub(in crate::engine) fn unmet(when: Option<&When>, stage: Stage, signals: &Signals) -> Option<NotRelevant> {
    let in_stage = match when {
        Some(when) if !when.stages.is_empty() => when.stages.contains(&stage),
        _ => stage != Stage::Locked,
    };
    if !in_stage {
        return Some(NotRelevant::Stage(stage));
    }
    if when.and_then(|when| when.posed).is_some_and(|wanted| wanted != signals.posed) {
        return Some(NotRelevant::Signal { name: POSED_SIGNAL.into(), value: signals.posed });
    }
    let wanted = when.map_or(&[][..], |when| &when.signals);
    wanted.iter().find_map(|&(index, wanted)| {
        let value = signals.value(index).filter(|&value| value != wanted)?;
        Some(NotRelevant::Signal { name: signals.name(index).into(), value })
    })
}

impl Net {
    /// The condition that keeps a node out: its own, or that of the first member that has one.
    pub(in crate::engine) fn kept_out_by(&self, node: NodeId) -> Option<NotRelevant> {
        let own = self.node(node).not_relevant.clone();
        own.or_else(|| match node {
            NodeId::Module(_) => None,
            NodeId::Group(id) => {
                self.groups[id.0 as usize].members.iter().find_map(|&member| self.kept_out_by(member))
            }
        })
    }
}
