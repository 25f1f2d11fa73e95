//! Runs a scenario through the engine in virtual time. Nothing here reads a clock or a file.
//!
//! At one instant, deadlines act first, then steps in the order of the file; then expectations are compared
//! with the resulting state.

use std::borrow::Cow;
use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};
use std::sync::Arc;

use super::expectation::compare;
use super::scenario_sample::Stamp;
use telltale_engine::input::{Input, Response};
use telltale_engine::model::countermeasure::RequestKind;
use telltale_engine::model::sample::FieldValue;
use telltale_engine::model::{Model, NodeId, Stage};
use telltale_engine::snapshot::{Moving, Reason, Snapshot};
use telltale_engine::state::State;
use telltale_engine::time::{Span, Timestamp};
use telltale_engine::{Engine, event};
use telltale_yaml as yaml;

/// The time of a right clock when a scenario starts: 2026-11-20 12:00:00 UTC.
const START_WALL_NS: i64 = 1_795_176_000 * 1_000_000_000;

/// The steps, and what is expected of them.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scenario {
    /// The stage at the start, with everything it implies.
    pub start: Option<Stage>,
    pub steps: Vec<Step>,
    pub expectations: Vec<Expectation>,
    pub figure: Figure,
}

/// The content of a scenario's figure.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Figure {
    /// One strip each, from top to bottom.
    pub nodes: Vec<String>,
    pub signals: Vec<String>,
    pub from: Timestamp,
    pub to: Timestamp,
    /// The zero of the axis, and the event there.
    pub zero: Option<(Timestamp, String)>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Its place in the file.
    pub span: yaml::Span,
    pub at: Timestamp,
    pub repeat: Option<Repeat>,
    /// Samples get their times when they happen.
    pub inputs: Vec<Input>,
    /// The stamp in the header of a sample; `None` without one.
    pub stamp: Option<Stamp>,
    /// The step of this machine's wall clock. Only stamps are compared with that clock.
    pub clock_step_ns: i64,
    /// Whether the engine must refuse it; `None` if either will do.
    pub refused: Option<bool>,
}

/// A step is repeated after each `every`, for the last time not after `until`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Repeat {
    pub every: Span,
    pub until: Timestamp,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Expectation {
    pub span: yaml::Span,
    pub at: Timestamp,
    pub what: Expected,
}

/// Nodes by their names on the wire; they may be discovered only while the scenario runs.
#[derive(Debug, Clone, PartialEq)]
pub enum Expected {
    Stage(Stage),
    Overall(State),
    Shown(String, State),
    Own(String, State),
    /// Root causes of one node, in any order.
    Roots(String, Vec<String>),
    /// All root causes, worst first.
    Ranking(Vec<String>),
    Why(String, IgnoreReason),
    /// Members that show OK, of the counted members.
    Counts(String, u32, u32),
    /// Alarms raised since the start; an alarm that moved to its cause counts once.
    Alarms(u64),
    /// The strongest countermeasure that is held.
    Countermeasure(Option<RequestKind>),
    Moving(Moving),
    /// The id of a stop.
    Destination(Option<String>),
    /// All active alarms: their numbers and nodes.
    ActiveAlarms(Vec<(String, String)>),
}

/// Why a node shows IGNORE, if it does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum IgnoreReason {
    None,
    Masked,
    NotRelevant,
}

/// An expectation that does not hold.
#[derive(Debug, Clone, PartialEq)]
pub struct Failure {
    pub span: yaml::Span,
    pub at: Timestamp,
    /// The subject: `perception`, `the stage`.
    pub subject: String,
    pub expected: String,
    pub got: String,
    /// The engine's report about it.
    pub why: Option<String>,
}

/// A change of the state that a node shows, or of the state that it reports behind that.
#[derive(Debug, Clone, PartialEq)]
pub struct Transition {
    pub at: Timestamp,
    pub node: Arc<str>,
    pub state: State,
    pub why: IgnoreReason,
    /// The state that it would show if nothing were masked.
    pub own: State,
    /// Its causes if it is masked, by rank.
    pub causes: Vec<Arc<str>>,
}

/// A change of a signal that conditions see; `None` is unknown.
#[derive(Debug, Clone, PartialEq)]
pub struct SignalChange {
    pub at: Timestamp,
    pub name: Box<str>,
    pub value: Option<bool>,
}

/// An alarm of a symptom that moved to its cause.
#[derive(Debug, Clone, PartialEq)]
pub struct AlarmMove {
    pub at: Timestamp,
    pub symptom: Arc<str>,
    pub cause: Arc<str>,
}

/// The result of a run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Outcome {
    pub failures: Vec<Failure>,
    /// In order of time; the first changes are the initial states.
    pub transitions: Vec<Transition>,
    pub signals: Vec<SignalChange>,
    pub moved: Vec<AlarmMove>,
    /// The number of alarms that were raised, and of sounds on a display.
    pub alarms: u64,
    pub sounds: usize,
}

/// Runs a scenario to its last step or expectation.
pub fn run(model: Arc<Model>, scenario: &Scenario) -> Outcome {
    let mut run = Run {
        engine: Engine::new(model, Timestamp::ZERO),
        shown: Vec::new(),
        seq: None,
        clock_offset_ns: 0,
        outcome: Outcome::default(),
    };
    run.engine.keep_events();
    run.signals_at_start();
    if let Some(stage) = scenario.start {
        run.engine.start_in(stage);
    }
    run.follow();
    let mut waiting: BinaryHeap<Reverse<(Timestamp, usize)>> =
        scenario.steps.iter().enumerate().map(|(index, step)| Reverse((step.at, index))).collect();
    let mut expectations: Vec<&Expectation> = scenario.expectations.iter().collect();
    expectations.sort_by_key(|expectation| expectation.at);
    let mut expectations = expectations.into_iter().peekable();
    loop {
        let step = waiting.peek().map(|Reverse((at, _))| *at);
        let expectation = expectations.peek().map(|expectation| expectation.at);
        let Some(now) = step.into_iter().chain(expectation).min() else { return run.outcome };
        run.pass_time(now);
        while waiting.peek().is_some_and(|Reverse((at, _))| *at == now) {
            let Some(Reverse((_, index))) = waiting.pop() else { break };
            let step = &scenario.steps[index];
            run.step(step, now);
            let again = step.repeat.map(|repeat| (now + repeat.every, repeat.until));
            waiting.extend(again.filter(|(at, until)| at <= until).map(|(at, _)| Reverse((at, index))));
        }
        while let Some(expectation) = expectations.next_if(|expectation| expectation.at == now) {
            run.compare(expectation);
        }
    }
}

type ShownNode = (State, IgnoreReason, State);

struct Run {
    engine: Engine,
    /// The last state of each node: groups, then modules.
    shown: Vec<(NodeId, ShownNode)>,
    seq: Option<u64>,
    clock_offset_ns: i64,
    outcome: Outcome,
}

impl Run {
    /// Handles every deadline up to `now` at its own instant.
    fn pass_time(&mut self, now: Timestamp) {
        while let Some(due) = self.engine.next_deadline().filter(|&due| due <= now) {
            self.engine.handle(&Input::Tick, due);
            self.follow();
        }
        self.engine.handle(&Input::Tick, now);
    }

    fn step(&mut self, step: &Step, now: Timestamp) {
        self.clock_offset_ns = self.clock_offset_ns.saturating_add(step.clock_step_ns);
        for input in &step.inputs {
            let response = self.engine.handle(&self.timed(input, step.stamp, now), now);
            self.follow();
            let reasons = match response {
                Response::Done => None,
                Response::Refused(reasons) => Some(reasons),
            };
            if step.refused.is_some_and(|expected| expected != reasons.is_some()) {
                let word = |refused| if refused { "refused" } else { "granted" };
                self.outcome.failures.push(Failure {
                    span: step.span,
                    at: now,
                    subject: "the operator's action".into(),
                    expected: word(reasons.is_none()).into(),
                    got: word(reasons.is_some()).into(),
                    why: reasons.map(|reasons| format!("{reasons:?}")),
                });
            }
        }
    }

    /// A sample as it is received now: stamped by a right clock, received by this machine's clock.
    fn timed<'i>(&self, input: &'i Input, stamp: Option<Stamp>, now: Timestamp) -> Cow<'i, Input> {
        let Input::Sample(sample) = input else { return Cow::Borrowed(input) };
        let since_start = i64::try_from(now.as_nanos()).unwrap_or(i64::MAX);
        let right = |ns: i64| START_WALL_NS.saturating_add(ns);
        let mut sample = sample.clone();
        sample.received_wall_ns = right(since_start).saturating_add(self.clock_offset_ns);
        sample.stamp_ns = stamp.map(|stamp| match stamp {
            Stamp::At(ns) => right(ns),
            Stamp::Behind(ns) => right(since_start.saturating_sub(ns)),
        });
        let stamp_ns = sample.stamp_ns.or_else(|| Some(right(since_start)));
        for value in &mut sample.values {
            if let FieldValue::Transforms(list) = value {
                list.iter_mut().for_each(|transform| transform.stamp_ns = stamp_ns);
            }
        }
        Cow::Owned(Input::Sample(sample))
    }

    fn signals_at_start(&mut self) {
        let snapshot = self.engine.snapshot();
        let start = |(name, value): &(Box<str>, Option<bool>)| SignalChange {
            at: snapshot.now,
            name: name.clone(),
            value: *value,
        };
        self.outcome.signals = snapshot.signals.iter().map(start).collect();
    }

    /// Notes what changed since the last look.
    fn follow(&mut self) {
        if self.seq == Some(self.engine.seq()) {
            return;
        }
        let snapshot = self.engine.snapshot();
        self.seq = Some(snapshot.seq);
        let numbers = snapshot.alarms.iter().map(|alarm| alarm.id);
        self.outcome.sounds += snapshot.audible().iter().filter(|&&id| id > self.outcome.alarms).count();
        self.outcome.alarms = numbers.fold(self.outcome.alarms, u64::max);
        let before: HashMap<NodeId, ShownNode> = self.shown.drain(..).collect();
        for node in snapshot.nodes() {
            let (state, reason) = snapshot.shown(node);
            let shown = (state, why_of(reason), snapshot.own(node));
            if before.get(&node) != Some(&shown) {
                self.outcome.transitions.push(transition(&snapshot, node));
            }
            self.shown.push((node, shown));
        }
        for event in self.engine.take_events() {
            let at = event.at;
            match event.what {
                event::EventKind::Signal { index, value } => {
                    let name = snapshot.signals[index].0.clone();
                    self.outcome.signals.push(SignalChange { at, name, value });
                }
                event::EventKind::AlarmMoved { symptom, cause, .. } => {
                    let name = |node| snapshot.node_name(node).clone();
                    self.outcome.moved.push(AlarmMove { at, symptom: name(symptom), cause: name(cause) });
                }
                _ => {}
            }
        }
    }

    fn compare(&mut self, expectation: &Expectation) {
        let snapshot = self.engine.snapshot();
        let Err((subject, expected, got, why)) = compare(&snapshot, self.outcome.alarms, &expectation.what)
        else {
            return;
        };
        let (span, at) = (expectation.span, expectation.at);
        self.outcome.failures.push(Failure { span, at, subject, expected, got, why });
    }
}

fn transition(snapshot: &Snapshot, node: NodeId) -> Transition {
    let (state, reason) = snapshot.shown(node);
    let causes = match reason {
        Some(Reason::Masked { by }) => by.iter().map(|&root| snapshot.node_name(root).clone()).collect(),
        _ => Vec::new(),
    };
    let (at, name) = (snapshot.now, snapshot.node_name(node).clone());
    Transition { at, node: name, state, why: why_of(reason), own: snapshot.own(node), causes }
}

pub(super) fn why_of(reason: Option<&Reason>) -> IgnoreReason {
    match reason {
        None => IgnoreReason::None,
        Some(Reason::Masked { .. }) => IgnoreReason::Masked,
        Some(Reason::NotRelevant(_)) => IgnoreReason::NotRelevant,
    }
}

pub fn why_word(why: IgnoreReason) -> &'static str {
    match why {
        IgnoreReason::None => "none",
        IgnoreReason::Masked => "masked",
        IgnoreReason::NotRelevant => "not_relevant",
    }
}

/// An instant in seconds, exactly.
pub fn seconds(at: Timestamp) -> String {
    let (whole, rest) = (at.as_nanos() / 1_000_000_000, at.as_nanos() % 1_000_000_000);
    let text = format!("{whole}.{rest:09}");
    format!("{} s", text.trim_end_matches('0').trim_end_matches('.'))
}
