//! Which countermeasures are held, and whether the vehicle confirms them (`ENGINE.md` 10).
//!
//! What a rule asked for is held by itself: until its own cause is gone and acknowledged. The
//! strongest of all that are held wins, so nothing falls back while its cause is there.

use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

use super::countermeasure::{ConfirmedBy, Kind, Request, Rule};
use super::input::{Output, OutputNews};
use super::model::{Model, NodeId, Stage, Text};
use super::monitor::say;
use super::names::Names;
use super::net::{Change, Net};
use super::node::Facts;
use super::roots::CAUSES_MAX;
use super::signals::Signals;
use super::snapshot::{Countermeasure, MeasureCause, MeasureState};
use super::state::State;
use super::time::Timestamp;

/// One reason for a request.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Held {
    pub(super) request: Request,
    pub(super) by: By,
    pub(super) since: Timestamp,
    pub(super) present: bool,
    pub(super) causes: Vec<Cause>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum By {
    /// A rule of the model, by its position, and the node that it is about.
    Rule(usize, NodeId),
    /// From before a restart or another configuration: its causes alone are known.
    Past,
    Operator,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Cause {
    pub(super) node: NodeId,
    pub(super) acknowledged: bool,
}

impl Held {
    fn is_over(&self) -> bool {
        let released = self.request.kind() == Kind::Notify || self.causes.iter().all(|it| it.acknowledged);
        !self.present && released
    }

    fn is_about(&self, node: NodeId) -> bool {
        matches!(self.by, By::Rule(_, it) if it == node)
    }

    /// Whether a cause that was named for it is still there. What a node that is well again bears
    /// in itself, such as one of a set of which one is enough, is no cause any more.
    fn is_caused(&self, net: &Net, state: State, by_itself: Option<NodeId>) -> bool {
        let lies_in = |node| by_itself.is_some_and(|around| is_part_of(net, node, around));
        self.causes.iter().any(|it| !lies_in(it.node) && fails(&net.node(it.node).facts, state))
    }

    /// Takes the causes as they are now; what is acknowledged of them stays so.
    fn explain(&mut self, roots: &[NodeId]) {
        let known = |node| self.causes.iter().any(|it| it.node == node && it.acknowledged);
        self.causes = roots.iter().map(|&node| Cause { node, acknowledged: known(node) }).collect();
    }
}

/// One kind of request, while it is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Asked {
    request: Request,
    since: Timestamp,
    /// Since when the vehicle could have confirmed it and has not.
    unconfirmed_since: Timestamp,
    state: MeasureState,
}

#[derive(Debug, Default)]
pub(super) struct Measures {
    /// Rules by the nodes that they are about.
    rules: HashMap<NodeId, Vec<usize>>,
    /// Nodes with rules that changed.
    dirty: BTreeSet<NodeId>,
    pub(super) held: Vec<Held>,
    /// The drive has ended, if it has not begun again by then: until then nothing is let go.
    arrives: Option<Timestamp>,
    asked: [Option<Asked>; 3],
    /// Why requests of a kind cannot be sent, with the topic.
    unsent: HashMap<Output, OutputNews>,
}

impl Measures {
    pub(super) fn new(model: &Model) -> Measures {
        let mut measures = Measures::default();
        for (index, rule) in model.driving.countermeasures.iter().enumerate() {
            for &node in &rule.nodes {
                measures.rules.entry(node).or_default().push(index);
            }
        }
        measures
    }

    pub(super) fn note(&mut self, change: &Change) {
        if self.rules.contains_key(&change.node) {
            self.dirty.insert(change.node);
        }
    }

    /// The stage changed: rules may hold now that did not before.
    pub(super) fn mark_all(&mut self) {
        self.dirty.extend(self.rules.keys());
    }

    pub(super) fn is_idle(&self) -> bool {
        self.dirty.is_empty() && self.held.is_empty() && self.asked == [None; 3]
    }

    /// Brings what is held to what follows from the nodes. `causes` names the root causes of a node.
    pub(super) fn follow(
        &mut self,
        model: &Model,
        net: &Net,
        stage: Stage,
        now: Timestamp,
        causes: impl Fn(NodeId) -> Vec<NodeId>,
    ) {
        if stage == Stage::Active {
            self.arrives = None;
        } else if self.arrives.take_if(|at| *at <= now).is_some() {
            self.release_stop();
        }
        for node in std::mem::take(&mut self.dirty) {
            for &index in &self.rules[&node] {
                let rule = &model.driving.countermeasures[index];
                let fails = fails(&net.node(node).facts, rule.state);
                let by = By::Rule(index, node);
                let known = self.held.iter().any(|held| held.by == by);
                if fails && !known && rule.stages.contains(&stage) {
                    let (request, causes) = (rule.request, Vec::new());
                    self.held.push(Held { request, by, since: now, present: true, causes });
                }
            }
        }
        for held in &mut self.held {
            match held.by {
                By::Rule(index, node) => {
                    let state = model.driving.countermeasures[index].state;
                    held.present = fails(&net.node(node).facts, state);
                    if held.present {
                        held.explain(&causes(node));
                    } else {
                        // What waited for its cause may be well before the cause is.
                        held.present = held.is_caused(net, state, Some(node));
                    }
                }
                By::Past => held.present = held.is_caused(net, State::Warning, None),
                By::Operator => {}
            }
        }
        self.let_go();
    }

    /// The drive has ended, as far as is known before `certain`.
    pub(super) fn arrive(&mut self, certain: Timestamp) {
        self.arrives = Some(certain).filter(|_| !self.held.is_empty());
    }

    fn let_go(&mut self) {
        if self.arrives.is_none() {
            self.held.retain(|held| !held.is_over());
        }
    }

    /// Holds a stop that the operator asked for. Twice is once.
    pub(super) fn request_stop(&mut self, now: Timestamp) {
        if !self.is_requested() {
            let (request, causes) = (Request::ManeuverStop, Vec::new());
            self.held.push(Held { request, by: By::Operator, since: now, present: true, causes });
        }
    }

    pub(super) fn is_requested(&self) -> bool {
        self.held.iter().any(|held| held.by == By::Operator)
    }

    pub(super) fn release_stop(&mut self) {
        self.held.retain(|held| held.by != By::Operator);
    }

    /// Whether a node has a part in what is held that the operator can know of.
    pub(super) fn is_held_for(&self, node: NodeId) -> bool {
        let has_part =
            |held: &Held| held.causes.iter().any(|cause| held.is_about(node) || cause.node == node);
        self.held.iter().any(has_part)
    }

    /// Takes note that the operator knows of a node's part.
    pub(super) fn acknowledge(&mut self, node: NodeId) {
        for held in &mut self.held {
            let about = held.is_about(node);
            for cause in held.causes.iter_mut().filter(|cause| about || cause.node == node) {
                cause.acknowledged = true;
            }
        }
        self.let_go();
    }

    pub(super) fn take_news(&mut self, news: &OutputNews) {
        match news.error {
            Some(_) => self.unsent.insert(news.output, news.clone()),
            None => self.unsent.remove(&news.output),
        };
    }

    /// Whether the vehicle has time left to confirm what is asked of it.
    pub(super) fn waits(&self, model: &Model) -> bool {
        let waits = |asked: &Asked| {
            asked.state == MeasureState::Requested && self.confirmation(model, asked.request.kind()).is_some()
        };
        self.asked.iter().flatten().any(waits)
    }

    /// What cannot be sent, in order.
    pub(super) fn unsent(&self) -> Vec<&OutputNews> {
        let mut all: Vec<&OutputNews> = self.unsent.values().collect();
        all.sort_by_key(|news| news.output);
        all
    }

    /// Kinds that ask the vehicle to move differently.
    pub(super) fn moving(&self) -> impl Iterator<Item = Kind> {
        Kind::ALL.into_iter().rev().filter(|kind| kind.moves() && self.strongest(*kind).is_some())
    }

    fn strongest(&self, kind: Kind) -> Option<Request> {
        let all = self.held.iter().map(|held| held.request).filter(|request| request.kind() == kind);
        all.reduce(|a, b| match (a, b) {
            (Request::Decelerate { mps2: x }, Request::Decelerate { mps2: y }) if y > x => b,
            _ => a,
        })
    }

    /// Compares what is asked with what the vehicle confirms. Returns when time alone changes that.
    pub(super) fn confirm(
        &mut self,
        model: &Model,
        net: &Net,
        names: &Names,
        signals: &Signals,
        now: Timestamp,
    ) -> Option<Timestamp> {
        let mut next: Option<Timestamp> = self.arrives;
        for kind in Kind::ALL {
            let slot = kind as usize;
            let Some(request) = self.strongest(kind) else {
                self.asked[slot] = None;
                continue;
            };
            let before = self.asked[slot].filter(|asked| asked.request == request);
            let since = self.asked[slot].map_or(now, |asked| asked.since);
            let mut asked = before.unwrap_or(Asked {
                request,
                since,
                unconfirmed_since: now,
                state: MeasureState::Requested,
            });
            if output(kind).is_some_and(|output| self.unsent.contains_key(&output)) {
                (asked.state, asked.unconfirmed_since) = (MeasureState::Unconfirmed, now);
            } else if let Some(confirmation) = self.confirmation(model, kind) {
                let confirmed = match &confirmation.by {
                    ConfirmedBy::Signal(index) => signals.value(*index) == Some(true),
                    ConfirmedBy::Status(name) => is_ok(net, names, name),
                };
                let due = |asked: &Asked| asked.unconfirmed_since + confirmation.within;
                asked.state = match asked.state {
                    _ if confirmed => MeasureState::Engaged,
                    MeasureState::Engaged => {
                        asked.unconfirmed_since = now;
                        MeasureState::Requested
                    }
                    state => state,
                };
                if asked.state == MeasureState::Requested && due(&asked) <= now {
                    asked.state = MeasureState::Unconfirmed;
                }
                let waits = asked.state == MeasureState::Requested;
                next = next.into_iter().chain(waits.then(|| due(&asked))).min();
            } else {
                asked.state = MeasureState::Requested;
            }
            self.asked[slot] = Some(asked);
        }
        next
    }

    /// How the vehicle confirms a kind: as the rules that ask for it say, or the first rule of the kind.
    fn confirmation<'m>(
        &self,
        model: &'m Model,
        kind: Kind,
    ) -> Option<&'m super::countermeasure::Confirmation> {
        let rules = &model.driving.countermeasures;
        let held = self.held.iter().filter_map(|held| match held.by {
            By::Rule(index, _) if held.request.kind() == kind => Some(index),
            _ => None,
        });
        let any = (0..rules.len()).filter(|&index| rules[index].request.kind() == kind);
        held.chain(any).find_map(|index| rules[index].confirmation.as_ref())
    }

    /// What is wrong with the requests that are made now.
    pub(super) fn trouble(&self, model: &Model) -> Option<Text> {
        let unconfirmed = |asked: &&Asked| asked.state == MeasureState::Unconfirmed;
        let wrong = self.asked.iter().flatten().filter(unconfirmed).map(|asked| {
            let kind = asked.request.kind();
            let name = kind.said();
            match output(kind).and_then(|output| self.unsent.get(&output)) {
                Some(news) => {
                    let error = news.error.as_deref().unwrap_or_default();
                    say!(
                        "{name} cannot be sent on {topic}: {error}",
                        "{name} nicht zu senden auf {topic}: {error}",
                        name = name,
                        topic = &*news.topic,
                        error = error
                    )
                }
                None => {
                    let within = self.confirmation(model, kind).map_or(0, |it| it.within.as_millis());
                    say!(
                        "{name} is not confirmed within {within} ms",
                        "{name} nach {within} ms nicht bestätigt",
                        name = name,
                        within = within.to_string()
                    )
                }
            }
        });
        wrong.reduce(|all, next| say!("{all}; {next}", "{all}; {next}", all = all, next = next))
    }

    /// For the snapshot: strongest first.
    pub(super) fn list(&self) -> Arc<[Countermeasure]> {
        let measure = |asked: &Asked| {
            let of_kind = || self.held.iter().filter(|held| held.request.kind() == asked.request.kind());
            let mut causes: Vec<MeasureCause> = Vec::new();
            for held in of_kind() {
                for cause in &held.causes {
                    let Cause { node, acknowledged } = *cause;
                    match causes.iter_mut().find(|known| known.node == node) {
                        Some(known) => {
                            known.present |= held.present;
                            known.acknowledged &= acknowledged;
                        }
                        None => causes.push(MeasureCause { node, acknowledged, present: held.present }),
                    }
                }
            }
            causes.truncate(CAUSES_MAX);
            Countermeasure {
                request: asked.request,
                by_operator: of_kind().any(|held| held.by == By::Operator),
                causes: causes.into(),
                since: asked.since,
                state: asked.state,
                latched: of_kind().all(|held| !held.present),
            }
        };
        self.asked.iter().rev().flatten().map(measure).collect()
    }

    pub(super) fn held(&self) -> &[Held] {
        &self.held
    }

    /// Takes over what was held before a restart or under another configuration.
    pub(super) fn hold(&mut self, held: Held) {
        if !held.is_over() && !self.held.iter().any(|it| it.by == held.by && held.by != By::Past) {
            self.held.push(held);
        }
    }

    /// The rule that asks for the same because of a node as a rule of another configuration did.
    pub(super) fn rule(&self, model: &Model, node: NodeId, before: &Rule) -> Option<By> {
        let rules = &model.driving.countermeasures;
        let asks =
            |&&index: &&usize| rules[index].request == before.request && rules[index].state == before.state;
        let alike = || self.rules.get(&node).into_iter().flatten().filter(asks);
        let index = alike().find(|&&index| rules[index].stages == before.stages).or_else(|| alike().next());
        index.map(|&index| By::Rule(index, node))
    }

    /// Takes over since when requests are made, and what cannot be sent.
    pub(super) fn keep(&mut self, old: &Measures) {
        (self.asked, self.arrives) = (old.asked, old.arrives);
        self.unsent.clone_from(&old.unsent);
    }
}

fn fails(facts: &Facts, state: State) -> bool {
    facts.relevant && facts.worst() >= state
}

/// Whether a node is another one or one of its members, at any depth.
fn is_part_of(net: &Net, mut node: NodeId, whole: NodeId) -> bool {
    while node != whole {
        let Some(parent) = net.node(node).parent else { return false };
        node = NodeId::Group(parent);
    }
    true
}

fn output(kind: Kind) -> Option<Output> {
    match kind {
        Kind::Notify => None,
        Kind::ManeuverStop => Some(Output::ManeuverStop),
        Kind::Decelerate => Some(Output::Deceleration),
    }
}

fn is_ok(net: &Net, names: &Names, status: &str) -> bool {
    let module = names.find(status).and_then(|route| names.routes[route as usize].module(0));
    module.is_some_and(|id| {
        let own = &net.modules[id.0 as usize].own;
        own.received().is_some() && !own.silent() && net.modules[id.0 as usize].node.facts.own == State::Ok
    })
}
