//! Countermeasures that are held, and their release by the operator.
//!
//! The request of each rule is held by itself. A request that moves the vehicle is held until the operator
//! releases it, which is granted once its causes are gone. Only one whose causes are still there at a stop, where a
//! clearance is needed anyway, ends with them. The strongest held request wins.

use crate::files::KeyframeError;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::sync::Arc;

use super::confirmation::{ActiveRequest, ConfirmationHeard};
use crate::input::OutputReport;
use crate::mask::net::{Change, Net};
use crate::mask::node::NodeFacts;
use crate::mask::responsible::CAUSES_MAX;
use crate::model::countermeasure::{Request, RequestKind, Rule};
use crate::model::output::Output;
use crate::model::{Model, NodeId, Stage};
use crate::snapshot::{Alarm, Countermeasure, CountermeasureCause};
use crate::state::State;
use crate::time::{Since, Span, Timestamp};

/// One reason for a request.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct HeldRequest {
    pub(crate) request: Request,
    pub(crate) by: RequestOrigin,
    pub(crate) since: Timestamp,
    /// For how long it was held before that, by an earlier run of the program.
    pub(crate) before: Span,
    pub(crate) present: bool,
    /// Only a release ends it: it outlived its cause on the way, it is the operator's own stop there, the vehicle stood
    /// there, or did not say meanwhile whether it drives.
    pub(crate) needs_release: bool,
    /// Empty only for a stop of the operator.
    pub(crate) causes: Vec<RequestCause>,
    /// For a request from before: the nodes that asked for it by a rule. A node that waited for a cause can still fail
    /// when the cause is over.
    #[serde(default)]
    pub(crate) asking: Vec<RequestCause>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum RequestOrigin {
    /// A rule of the model, by its index, and the node that triggered it.
    Rule(usize, NodeId),
    /// From before a restart or another configuration: only its causes are known.
    Past,
    Operator,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct RequestCause {
    pub(crate) node: NodeId,
    pub(crate) acknowledged: bool,
    pub(crate) present: bool,
    /// A group in place of a module that is not heard any more, which a WARNING of the group may say.
    pub(crate) stands_in: bool,
}

/// A node that the operator acknowledges.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Acknowledged<'a> {
    pub(crate) node: NodeId,
    /// Only by this alarm, the latest of the node.
    pub(crate) alarm: Option<&'a Alarm>,
}

impl RequestCause {
    pub(crate) fn new(node: NodeId, acknowledged: bool, present: bool) -> RequestCause {
        RequestCause { node, acknowledged, present, stands_in: false }
    }
}

impl HeldRequest {
    pub(crate) fn new(request: Request, by: RequestOrigin, since: Since) -> HeldRequest {
        let Since { at: since, before } = since;
        HeldRequest {
            request,
            by,
            since,
            before,
            present: true,
            needs_release: false,
            causes: Vec::new(),
            asking: Vec::new(),
        }
    }

    pub(crate) fn since(&self) -> Since {
        Since { at: self.since, before: self.before }
    }

    /// Checks whether the named causes are still present. A failing member inside a node that is well again,
    /// such as one of a redundancy set, is no cause any more.
    fn look_at_causes(
        &mut self,
        net: &Net,
        state: impl Fn(&RequestCause) -> State,
        by_itself: Option<NodeId>,
    ) {
        let lies_in = |node| by_itself.is_some_and(|around| is_part_of(net, node, around));
        for cause in self.causes.iter_mut().chain(&mut self.asking) {
            let is_nobody = cause.node == net.nobody();
            cause.present =
                !is_nobody && !lies_in(cause.node) && fails(&net.node(cause.node).facts, state(cause));
        }
        self.present = self.causes.iter().chain(&self.asking).any(|cause| cause.present);
    }

    /// Takes the present causes; acknowledged ones stay acknowledged. A cause that is over stays until it is
    /// acknowledged, and a masked one is replaced by the causes that mask it, as its alarm is. If there are too
    /// many, `about` represents the others.
    fn explain(&mut self, about: NodeId, net: &Net, causes: &impl Fn(NodeId) -> Vec<NodeId>) {
        let before = std::mem::take(&mut self.causes);
        let known = |node| before.iter().any(|it| it.node == node && it.acknowledged);
        let named = |node| {
            let mut named = causes(node);
            if named.len() > CAUSES_MAX {
                named.truncate(CAUSES_MAX - 1);
                named.push(about);
            }
            named
        };
        let is_there = |node| {
            let facts = &net.node(node).facts;
            !facts.masked && fails(facts, State::Warning)
        };
        let now = |node| RequestCause::new(node, known(node), true);
        self.causes = named(about).into_iter().map(now).collect();
        let mut past: Vec<NodeId> = Vec::new();
        for &RequestCause { node, present, acknowledged, .. } in &before {
            match (acknowledged, net.node(node).facts.masked && present) {
                (false, true) => past.extend(named(node).into_iter().filter(|&node| !known(node))),
                (false, false) => past.push(node),
                (true, _) if is_there(node) => past.push(node),
                (true, _) => {}
            }
        }
        let mut seen: HashSet<NodeId> = self.causes.iter().map(|cause| cause.node).collect();
        past.retain(|&node| seen.insert(node));
        if past.len() > CAUSES_MAX {
            past.retain(|&node| node != about);
            past.truncate(CAUSES_MAX - 1);
            past.insert(0, about);
        }
        for node in past {
            self.add(RequestCause::new(node, known(node), is_there(node)));
        }
    }

    fn add(&mut self, cause: RequestCause) {
        match self.causes.iter_mut().find(|known| known.node == cause.node) {
            Some(known) => {
                known.acknowledged &= cause.acknowledged;
                known.present |= cause.present;
                known.stands_in |= cause.stands_in;
            }
            None => self.causes.push(cause),
        }
    }

    /// Reduces the causes to the number that is named; one node represents the others.
    fn cut(&mut self, others: NodeId) {
        if self.causes.len() <= CAUSES_MAX {
            return;
        }
        self.causes.sort_by_key(|cause| cause.acknowledged);
        let rest = self.causes.split_off(CAUSES_MAX - 1);
        let acknowledged = rest.iter().all(|cause| cause.acknowledged);
        let present = rest.iter().any(|cause| cause.present);
        self.add(RequestCause::new(others, acknowledged, present));
    }

    /// The nodes that ask for it by a rule, or did before.
    pub(crate) fn about(&self) -> impl Iterator<Item = NodeId> {
        let rule = if let RequestOrigin::Rule(_, node) = self.by { Some(node) } else { None };
        rule.into_iter().chain(self.asking.iter().map(|it| it.node))
    }

    fn is_about(&self, node: NodeId) -> bool {
        matches!(self.by, RequestOrigin::Rule(_, it) if it == node)
    }

    /// Notes an acknowledgement. By the name of the node that triggered it, all causes are acknowledged; by an
    /// alarm, only the cause of that alarm, if the alarm was active while this was held.
    fn acknowledge(&mut self, known: Acknowledged<'_>) {
        let Acknowledged { node, alarm } = known;
        let about = alarm.is_none() && self.is_about(node);
        let counts = alarm.is_none_or(|it| it.active || it.ended.is_some_and(|ended| ended >= self.since));
        for cause in self.causes.iter_mut().filter(|cause| about || (counts && cause.node == node)) {
            cause.acknowledged = true;
        }
        if self.present {
            self.causes.retain(|cause| cause.present || !cause.acknowledged);
        }
    }
}

/// The stage of the vehicle, and whether it stands at a stop or may drive.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Whereabouts {
    pub(crate) stage: Stage,
    /// It is known to stand at a stop.
    pub(crate) at_a_stop: bool,
    /// The vehicle does not say whether it drives.
    pub(crate) active_unknown: bool,
    /// It stands although it is to drive, or is not known to have arrived although it is not.
    pub(crate) between_stops: bool,
}

#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(crate) struct Countermeasures {
    /// Rules by the nodes that trigger them.
    #[serde(skip)]
    rules: HashMap<NodeId, Vec<usize>>,
    /// Nodes with rules that changed.
    dirty: BTreeSet<NodeId>,
    pub(crate) held: Vec<HeldRequest>,
    /// The vehicle surely stands at a stop from this time on, unless it drives again earlier: until then
    /// nothing is released.
    pub(crate) arrives: Option<Timestamp>,
    pub(crate) asked: [Option<ActiveRequest>; 3],
    /// The last value of each expected confirmation.
    pub(crate) heard: Vec<ConfirmationHeard>,
    /// Outputs that cannot be sent, with the topic and the reason.
    pub(crate) unsent: BTreeMap<Output, OutputReport>,
    /// Topics without a reader.
    pub(crate) unheard: BTreeMap<Output, Box<str>>,
    /// The other programs that publish on Telltale's topics to the vehicle, with these topics.
    pub(crate) other_voices: Option<Box<str>>,
    /// Outputs with a reader.
    pub(crate) listened: BTreeSet<Output>,
    /// The operator has released or cleared the vehicle since this run of the program began: only then it knows
    /// that nothing is held where nothing is. No word of the vehicle says so: one that is held stands, too.
    pub(crate) knows_all: bool,
    /// Counts every STOP of the operator, also one that holds already or is refused: a confirmation that was
    /// asked for before the last one counts no more.
    pub(crate) last_stop: u64,
}

impl Countermeasures {
    pub(crate) fn new(model: &Model) -> Countermeasures {
        let mut measures = Countermeasures::default();
        for (index, rule) in model.driving.countermeasures.iter().enumerate() {
            for &node in &rule.nodes {
                measures.rules.entry(node).or_default().push(index);
            }
        }
        measures
    }

    /// Goes on with the state of a keyframe.
    pub(crate) fn resume(&mut self, kept: Countermeasures) -> Result<(), KeyframeError> {
        let rules = std::mem::take(&mut self.rules);
        let known = |held: &HeldRequest| match held.by {
            RequestOrigin::Rule(index, node) => rules.get(&node).is_some_and(|it| it.contains(&index)),
            RequestOrigin::Past | RequestOrigin::Operator => true,
        };
        if !kept.held.iter().all(known) || !kept.dirty.iter().all(|node| rules.contains_key(node)) {
            return Err(KeyframeError::new("a countermeasure follows a rule that the configuration lacks"));
        }
        *self = Countermeasures { rules, ..kept };
        Ok(())
    }

    /// The nodes that the held requests name.
    pub(crate) fn nodes(&self) -> impl Iterator<Item = NodeId> {
        self.held.iter().flat_map(|held| held.causes.iter().map(|cause| cause.node))
    }

    pub(crate) fn note(&mut self, change: &Change) {
        if self.rules.contains_key(&change.node) {
            self.dirty.insert(change.node);
        }
    }

    /// The stage changed: further rules may apply.
    pub(crate) fn mark_all(&mut self) {
        self.dirty.extend(self.rules.keys());
    }

    pub(crate) fn is_idle(&self) -> bool {
        self.dirty.is_empty() && self.held.is_empty() && self.asked == [None; 3]
    }

    /// Updates the held requests to the present states of the nodes. `causes` names the root causes of a node.
    pub(crate) fn follow(
        &mut self,
        model: &Model,
        net: &Net,
        Whereabouts { stage, at_a_stop, active_unknown, between_stops }: Whereabouts,
        now: Timestamp,
        causes: impl Fn(NodeId) -> Vec<NodeId>,
    ) {
        for node in std::mem::take(&mut self.dirty) {
            for &index in &self.rules[&node] {
                let rule = &model.driving.countermeasures[index];
                let fails = fails(&net.node(node).facts, rule.state);
                let by = RequestOrigin::Rule(index, node);
                let known = self.held.iter().any(|held| held.by == by);
                if fails && !known && rule.stages.contains(&stage) {
                    let request = rule.request;
                    self.held.push(HeldRequest::new(request, by, Since { at: now, before: Span::ZERO }));
                }
            }
        }
        for held in &mut self.held {
            match held.by {
                RequestOrigin::Rule(index, node) => {
                    let facts = &net.node(node).facts;
                    let state = model.driving.countermeasures[index].state;
                    if fails(facts, state) {
                        held.present = true;
                        held.explain(node, net, &causes);
                    } else {
                        // A failure is over only when the node is known to be well. A node that waited for its
                        // cause may recover before the cause.
                        let is_unclear = fails(facts, state.min(State::Unknown));
                        let is_over = (!is_unclear).then_some(node);
                        held.look_at_causes(net, |_| state.min(State::Unknown), is_over);
                        held.present |= is_unclear;
                    }
                }
                // Where a WARNING asks, its rule asks again.
                RequestOrigin::Past => {
                    let of =
                        |cause: &RequestCause| if cause.stands_in { State::Warning } else { State::Unknown };
                    held.look_at_causes(net, of, None);
                }
                RequestOrigin::Operator => {}
            }
            // A cause that is gone on the way leaves a vehicle that only the operator sets going again. So does a
            // silence of `active`: its publisher may have started again between stops, and then says false first.
            let is_latched = held.by == RequestOrigin::Operator || !held.present;
            held.needs_release |= active_unknown || between_stops || is_latched && stage == Stage::Active;
        }
        let surely_at_a_stop = at_a_stop && self.arrives.is_none_or(|at| at <= now);
        self.held.retain(|held| {
            let is_over = held.by == RequestOrigin::Operator || !held.present;
            !is_over || held.request.kind().moves() && (held.needs_release || !surely_at_a_stop)
        });
    }

    /// Holds a stop that the operator requested, once.
    pub(crate) fn request_stop(&mut self, since: Since) {
        if !self.held.iter().any(|held| held.by == RequestOrigin::Operator) {
            self.held.push(HeldRequest::new(Request::ManeuverStop, RequestOrigin::Operator, since));
        }
    }

    /// Whether a node causes a held request that the operator can acknowledge.
    pub(crate) fn is_held_for(&self, node: NodeId) -> bool {
        let has_part =
            |held: &HeldRequest| held.causes.iter().any(|cause| held.is_about(node) || cause.node == node);
        self.held.iter().any(has_part)
    }

    /// Notes that the operator acknowledges a node. That releases nothing.
    pub(crate) fn acknowledge(&mut self, known: Acknowledged<'_>) {
        self.held.iter_mut().for_each(|held| held.acknowledge(known));
    }

    pub(crate) fn take_news(&mut self, news: &OutputReport) {
        match news.error {
            Some(_) => self.unsent.insert(news.output, news.clone()),
            None => self.unsent.remove(&news.output),
        };
    }

    /// Outputs that cannot be sent, in order.
    pub(crate) fn unsent(&self) -> Vec<&OutputReport> {
        let mut all: Vec<&OutputReport> = self.unsent.values().collect();
        all.sort_by_key(|news| news.output);
        all
    }

    /// Kinds of requests that change the vehicle's motion.
    pub(crate) fn moving(&self) -> impl Iterator<Item = RequestKind> {
        RequestKind::ALL.into_iter().rev().filter(|kind| kind.moves() && self.strongest(*kind).is_some())
    }

    pub(crate) fn strongest(&self, kind: RequestKind) -> Option<Request> {
        let all = self.held.iter().map(|held| held.request).filter(|request| request.kind() == kind);
        all.reduce(|a, b| if b.mps2() > a.mps2() { b } else { a })
    }

    /// The countermeasures for the snapshot: strongest first.
    pub(crate) fn list(&self, others: NodeId) -> Arc<[Countermeasure]> {
        let measure = |asked: &ActiveRequest| {
            let of_kind = || self.held.iter().filter(|held| held.request.kind() == asked.request.kind());
            let since = Since { at: asked.since, before: self.earliest(asked.request.kind()).before };
            let mut all = HeldRequest::new(asked.request, RequestOrigin::Past, since);
            of_kind().flat_map(|held| &held.causes).for_each(|cause| all.add(*cause));
            all.cut(others);
            let cause = |&RequestCause { node, acknowledged, present, .. }: &RequestCause| {
                CountermeasureCause { node, acknowledged, present }
            };
            Countermeasure {
                request: asked.request,
                by_operator: of_kind()
                    .find(|held| held.by == RequestOrigin::Operator)
                    .map(HeldRequest::since),
                causes: all.causes.iter().map(cause).collect(),
                about: of_kind().flat_map(HeldRequest::about).collect::<BTreeSet<_>>().into_iter().collect(),
                since,
                state: asked.state,
                latched: of_kind().all(|held| !held.present || held.by == RequestOrigin::Operator),
            }
        };
        self.asked.iter().rev().flatten().map(measure).collect()
    }

    pub(crate) fn held(&self) -> &[HeldRequest] {
        &self.held
    }

    /// Takes over a request from before a restart or a reload.
    pub(crate) fn take_over(&mut self, held: HeldRequest, others: NodeId) {
        let same = |it: &&mut HeldRequest| {
            it.by == held.by && (held.by != RequestOrigin::Past || it.request == held.request)
        };
        match self.held.iter_mut().find(same) {
            Some(known) => {
                held.causes.iter().for_each(|cause| known.add(*cause));
                let is_new = |it: &RequestCause| known.asking.iter().all(|other| other.node != it.node);
                let news: Vec<RequestCause> = held.asking.into_iter().filter(is_new).collect();
                known.asking.extend(news);
                known.present |= held.present;
                known.needs_release |= held.needs_release;
                known.cut(others);
            }
            None => self.held.push(held),
        }
    }

    /// The rule with the same request for a node as a rule of another configuration.
    pub(crate) fn rule(&self, model: &Model, node: NodeId, before: &Rule) -> Option<RequestOrigin> {
        let rules = &model.driving.countermeasures;
        let asks =
            |&&index: &&usize| rules[index].request == before.request && rules[index].state == before.state;
        let alike = || self.rules.get(&node).into_iter().flatten().filter(asks);
        let index = alike().find(|&&index| rules[index].stages == before.stages).or_else(|| alike().next());
        index.map(|&index| RequestOrigin::Rule(index, node))
    }
}

pub(crate) fn fails(facts: &NodeFacts, state: State) -> bool {
    facts.relevant && facts.worst() >= state
}

/// Whether a node is `whole` or one of its members, at any depth.
fn is_part_of(net: &Net, mut node: NodeId, whole: NodeId) -> bool {
    while node != whole {
        let Some(parent) = net.node(node).parent else { return false };
        node = NodeId::Group(parent);
    }
    true
}
