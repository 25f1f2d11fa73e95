//! Explains a node's state: each step from the report to the shown state.

use crate::model::{NodeId, NodeNames};
use crate::snapshot::{NotRelevant, Reason, Snapshot};
use crate::state::State;

/// One step of an explanation, in the order of the computation: report, silence, debounce, latch, members,
/// relevance, dependencies. Programs and pages have words for each.
#[derive(Debug, Clone, PartialEq)]
pub enum WhyStep {
    /// Only reports of these nodes count.
    OnlyFrom(NodeNames),
    /// There is no report yet.
    NeverReported,
    /// The state of the last report.
    Reported(State),
    /// No report came within the module's timeout: it counts as this.
    Silent(State),
    /// Reports changed too briefly: it still counts as this.
    Debounced(State),
    /// An ERROR stays until it is reset by name.
    Latched,
    /// It has been relevant for less than its timeout and still has time to report.
    Grace,
    /// These members determine the state of the group.
    Members { own: State, responsible: Vec<NodeId> },
    /// The condition that does not hold.
    NotRelevant(NotRelevant),
    /// It depends on `on`, which fails or waits itself; `holder` is the node, or an enclosing group.
    Waits { holder: NodeId, on: NodeId },
    /// The root causes that mask it, ranked.
    Masked { by: Vec<NodeId> },
    /// It waits too, but no cause began near it: a fault of its own.
    SecondFault,
    /// The shown state.
    Shown(State),
}

impl Snapshot {
    /// Explains a node, from its report to its shown state.
    pub fn why(&self, node: NodeId) -> Vec<WhyStep> {
        let mut steps = match node {
            NodeId::Module(_) => self.why_own(node),
            NodeId::Group(_) => vec![self.why_members(node)],
        };
        let (shown, reason) = self.shown(node);
        match reason {
            Some(Reason::NotRelevant(condition)) => steps.push(WhyStep::NotRelevant(condition.clone())),
            Some(Reason::Masked { by }) => {
                steps.extend(self.waits(node));
                steps.push(WhyStep::Masked { by: by.to_vec() });
            }
            None => {
                if self.roots.iter().any(|root| root.node == node && root.second) {
                    steps.extend(self.waits(node));
                    steps.push(WhyStep::SecondFault);
                }
            }
        }
        steps.push(WhyStep::Shown(shown));
        steps
    }

    fn why_own(&self, node: NodeId) -> Vec<WhyStep> {
        let NodeId::Module(id) = node else { return Vec::new() };
        let (info, view) = self.module(id);
        let how = view.steps;
        let mut steps: Vec<WhyStep> = info.writers.iter().cloned().map(WhyStep::OnlyFrom).collect();
        steps.push(how.reported.map_or(WhyStep::NeverReported, WhyStep::Reported));
        if let Some(judged) = how.judged.filter(|_| view.silent) {
            steps.push(WhyStep::Silent(judged));
        }
        if let Some(debounced) = how.debounced.filter(|_| how.debounced != how.judged) {
            steps.push(WhyStep::Debounced(debounced));
        }
        if how.latched {
            steps.push(WhyStep::Latched);
        } else if how.grace {
            steps.push(WhyStep::Grace);
        } else if how.reported.is_none() {
            steps.push(WhyStep::Silent(view.own));
        }
        steps
    }

    fn why_members(&self, node: NodeId) -> WhyStep {
        let NodeId::Group(id) = node else { return WhyStep::Shown(self.shown(node).0) };
        let (info, view) = self.group(id);
        let members = info.groups.iter().map(|&id| NodeId::Group(id));
        let members = members.chain(info.modules.iter().map(|&id| NodeId::Module(id)));
        let state = if view.state == State::Ignore { view.own } else { view.state };
        let responsible = members.filter(|&member| self.shown(member).0.max(self.own(member)) == state);
        WhyStep::Members { own: view.own, responsible: responsible.collect() }
    }

    /// The dependencies that the node, or an enclosing group, waits for.
    fn waits(&self, node: NodeId) -> Vec<WhyStep> {
        let mut waits = Vec::new();
        let mut at = Some(node);
        while let Some(holder) = at {
            let (depends_on, parent) = match holder {
                NodeId::Group(id) => (&self.group(id).0.depends_on, self.group(id).0.parent),
                NodeId::Module(id) => (&self.module(id).0.depends_on, Some(self.module(id).0.group)),
            };
            for dependency in depends_on {
                let bad = |&&on: &&NodeId| {
                    let (shown, reason) = self.shown(on);
                    let masked = matches!(reason, Some(Reason::Masked { .. }));
                    masked || shown.max(self.own(on)) >= State::Unknown
                };
                waits.extend(dependency.nodes().iter().filter(bad).map(|&on| WhyStep::Waits { holder, on }));
            }
            at = parent.map(NodeId::Group);
        }
        waits
    }
}
