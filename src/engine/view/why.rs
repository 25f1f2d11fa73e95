//! Explains a node's state: each step from the report to the shown state.

use crate::engine::model::{NodeId, NodeNames};
use crate::engine::snapshot::{NotRelevant, Reason, Snapshot};
use crate::engine::state::State;

/// One step of an explanation, in the order of `ENGINE.md` 2 to 5. Programs and pages put it into words.
#[derive(Debug, Clone, PartialEq)]
pub enum WhyStep {
    /// Only these nodes may say it.
    OnlyFrom(NodeNames),
    /// No report ever came.
    NeverReported,
    /// The last report said this.
    Reported(State),
    /// Nothing came for the module's timeout: it counts as this.
    Silent(State),
    /// Reports changed too briefly: it counts as this still.
    Debounced(State),
    /// An ERROR stays until it is reset by name.
    Latched,
    /// It has been relevant for less than its timeout and is given time to report.
    Grace,
    /// These members make the group what it is.
    Members { own: State, responsible: Vec<NodeId> },
    /// The condition that does not hold.
    NotRelevant(NotRelevant),
    /// It needs `on`, which fails or waits itself; `holder` is the node, or a group around it.
    Waits { holder: NodeId, on: NodeId },
    /// The root causes that mask it, ranked.
    Masked { by: Vec<NodeId> },
    /// What is shown in the end.
    Shown(State),
}

impl Snapshot {
    /// Explains a node, from what was reported of it to what it shows.
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
            None => {}
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

    /// The dependencies that the node, or a group around it, waits for.
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
