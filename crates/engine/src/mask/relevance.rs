//! Evaluates the conditions of relevance: the state of the vehicle decides which nodes are relevant.

use super::net::Net;
use super::rules;
use super::rules::Unmet;
use crate::model::{NodeId, POSED_SIGNAL, Stage, When};
use crate::signals::Signals;
use crate::snapshot::NotRelevant;

/// The name of the first condition that does not hold.
pub(crate) fn unmet(when: Option<&When>, stage: Stage, signals: &Signals) -> Option<NotRelevant> {
    let unmet = rules::unmet(when, stage, signals.posed, |index| signals.value(index))?;
    Some(match unmet {
        Unmet::Stage => NotRelevant::Stage(stage),
        Unmet::Posed => NotRelevant::Signal { name: POSED_SIGNAL.into(), value: signals.posed },
        Unmet::Signal(index, value) => NotRelevant::Signal { name: signals.name(index).into(), value },
    })
}

impl Net {
    /// The condition that makes a node irrelevant: its own, or that of the first member that has one.
    pub(crate) fn kept_out_by(&self, node: NodeId) -> Option<NotRelevant> {
        let own = self.node(node).not_relevant.clone();
        own.or_else(|| match node {
            NodeId::Module(_) => None,
            NodeId::Group(id) => {
                self.groups[id.0 as usize].members.iter().find_map(|&member| self.kept_out_by(member))
            }
        })
    }
}
