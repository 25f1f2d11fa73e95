//! Runs a scenario through the engine in virtual time. Nothing here reads a clock or a file.
//!
//! At one instant deadlines act first, then steps in the order of the file, then expectations are
//! compared: they hold for the state after everything at that instant was handled.

use std::cmp::Reverse;
use std::collections::{BinaryHeap, HashMap};
use std::sync::Arc;

use crate::engine::Engine;
use crate::engine::input::{Input, OperatorAction, Response};
use crate::engine::model::{ACTIVE_SIGNAL, GroupId, Model, ModuleId, NodeId, Stage};
use crate::engine::snapshot::{NotRelevant, Reason, Snapshot};
use crate::engine::state::State;
use crate::engine::time::{Span, Timestamp};
use crate::yaml;

/// What happens, and what is expected of it.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scenario {
    /// Entered at once, with what it implies.
    pub start: Option<Stage>,
    pub steps: Vec<Step>,
    pub expectations: Vec<Expectation>,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Step {
    /// Where it is written.
    pub span: yaml::Span,
    pub at: Timestamp,
    pub repeat: Option<Repeat>,
    pub inputs: Vec<Input>,
    /// Whether the engine is to refuse it; `None`: either will do.
    pub refused: Option<bool>,
}

/// A step happens again after each `every`, the last time not after `until`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Repeat {
    pub every: Span,
    pub until: Timestamp,
}

#[derive(Debug, Clone, PartialEq)]
pub struct Expectation {
    pub span: yaml::Span,
    pub at: Timestamp,
    pub what: What,
}

/// Nodes are named as on the wire; they may be discovered only while the scenario runs.
#[derive(Debug, Clone, PartialEq)]
pub enum What {
    Stage(Stage),
    Overall(State),
    Shown(String, State),
    Own(String, State),
    /// Root causes of one node, in any order.
    Roots(String, Vec<String>),
    /// All root causes, worst first.
    Ranking(Vec<String>),
    Why(String, Why),
    /// Members shown OK, of those counted.
    Counts(String, u32, u32),
    /// Raised since the start; one that moved to its cause counts once.
    Alarms(u64),
}

/// Why a node shows IGNORE, if it does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Why {
    None,
    Masked,
    NotRelevant,
}

/// An expectation that does not hold.
#[derive(Debug, Clone, PartialEq)]
pub struct Failure {
    pub span: yaml::Span,
    pub at: Timestamp,
    /// What it is about: `perception`, `the stage`.
    pub subject: String,
    pub expected: String,
    pub got: String,
    /// What the engine says about it.
    pub why: Option<String>,
}

/// A node that shows something else than before.
#[derive(Debug, Clone, PartialEq)]
pub struct Transition {
    pub at: Timestamp,
    pub node: Arc<str>,
    pub state: State,
    pub why: Why,
}

/// What came of a run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Outcome {
    pub failures: Vec<Failure>,
    /// In order of time; the first ones say how everything began.
    pub transitions: Vec<Transition>,
}

/// Runs a scenario to its last step or expectation.
pub fn run(model: Arc<Model>, scenario: &Scenario) -> Outcome {
    let mut run = Run {
        engine: Engine::new(model.clone(), Timestamp::ZERO),
        shown: Vec::new(),
        seq: None,
        alarms: 0,
        outcome: Outcome::default(),
    };
    for input in start_inputs(&model, scenario.start) {
        run.engine.handle(&input, Timestamp::ZERO);
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

/// The same vehicle without knowledge of its dependencies, as in scenario 1 of the paper.
pub fn without_dependencies(model: &Model) -> Model {
    let mut parts = (**model).clone();
    parts.groups.iter_mut().for_each(|group| group.depends_on.clear());
    parts.modules.iter_mut().for_each(|module| module.depends_on.clear());
    Model::new(parts)
        .expect("groups that only contain each other have no cycle: parents stand before children")
}

/// What makes a vehicle be in a stage.
fn start_inputs(model: &Model, stage: Option<Stage>) -> Vec<Input> {
    let login = Input::Operator(OperatorAction::Login { name: "operator".into() });
    let active = || Input::Signal { name: ACTIVE_SIGNAL.into(), value: true };
    let knows_active = model.signals.iter().any(|signal| &*signal.name == ACTIVE_SIGNAL);
    match stage {
        None | Some(Stage::Locked) => Vec::new(),
        Some(Stage::Active) if knows_active => vec![login, active()],
        Some(_) => vec![login],
    }
}

struct Run {
    engine: Engine,
    /// What each node showed last: groups, then modules.
    shown: Vec<(NodeId, State, Why)>,
    seq: Option<u64>,
    alarms: u64,
    outcome: Outcome,
}

impl Run {
    /// Lets every deadline up to `now` act at its own instant.
    fn pass_time(&mut self, now: Timestamp) {
        while let Some(due) = self.engine.next_deadline().filter(|&due| due <= now) {
            self.engine.handle(&Input::Tick, due);
            self.follow();
        }
        self.engine.handle(&Input::Tick, now);
    }

    fn step(&mut self, step: &Step, now: Timestamp) {
        for input in &step.inputs {
            let response = self.engine.handle(input, now);
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

    /// Notes what changed since the last look.
    fn follow(&mut self) {
        if self.seq == Some(self.engine.seq()) {
            return;
        }
        let snapshot = self.engine.snapshot();
        self.seq = Some(snapshot.seq);
        self.alarms = snapshot.alarms.iter().map(|alarm| alarm.id).fold(self.alarms, u64::max);
        let before: HashMap<NodeId, (State, Why)> =
            self.shown.drain(..).map(|(node, state, why)| (node, (state, why))).collect();
        for node in nodes(&snapshot) {
            let (state, reason) = snapshot.shown(node);
            let why = why_of(reason);
            if before.get(&node) != Some(&(state, why)) {
                let (at, node) = (snapshot.now, snapshot.node_name(node).clone());
                self.outcome.transitions.push(Transition { at, node, state, why });
            }
            self.shown.push((node, state, why));
        }
    }

    fn compare(&mut self, expectation: &Expectation) {
        let snapshot = self.engine.snapshot();
        let Err((subject, expected, got, why)) = compare(&snapshot, self.alarms, &expectation.what) else {
            return;
        };
        let (span, at) = (expectation.span, expectation.at);
        self.outcome.failures.push(Failure { span, at, subject, expected, got, why });
    }
}

/// Subject, expected, got, why.
type Difference = (String, String, String, Option<String>);

fn compare(snapshot: &Snapshot, alarms: u64, what: &What) -> Result<(), Difference> {
    let plain = |subject: &str, expected: String, got: String| equal(subject.into(), expected, got, || None);
    match what {
        What::Stage(stage) => plain("the stage", stage.as_str().into(), snapshot.stage.as_str().into()),
        What::Overall(state) => plain("the vehicle", state.to_string(), snapshot.overall.to_string()),
        What::Alarms(count) => plain("the number of alarms", count.to_string(), alarms.to_string()),
        What::Ranking(names) => {
            let got: Vec<&str> = snapshot.roots.iter().map(|root| &**snapshot.node_name(root.node)).collect();
            plain("the ranking of root causes", list(names), list(&got))
        }
        What::Shown(name, state) => {
            of_node(snapshot, "", name, state.to_string(), |node| snapshot.shown(node).0.to_string())
        }
        What::Own(name, state) => of_node(snapshot, "the own state of ", name, state.to_string(), |node| {
            own(snapshot, node).to_string()
        }),
        What::Why(name, why) => of_node(snapshot, "the reason of ", name, why_word(*why).into(), |node| {
            why_word(why_of(snapshot.shown(node).1)).into()
        }),
        What::Counts(name, ok, counted) => {
            of_node(snapshot, "the count of ", name, format!("{ok}/{counted}"), |node| match node {
                NodeId::Group(id) => {
                    let view = snapshot.group(id).1;
                    format!("{}/{}", view.ok, view.counted)
                }
                NodeId::Module(_) => "a module, which counts nothing".into(),
            })
        }
        What::Roots(name, names) => {
            let sorted = |mut names: Vec<&str>| {
                names.sort_unstable();
                list(&names)
            };
            let expected = sorted(names.iter().map(|name| &**name).collect());
            of_node(snapshot, "the root causes of ", name, expected, |node| {
                sorted(roots(snapshot, node).into_iter().map(|root| &**snapshot.node_name(root)).collect())
            })
        }
    }
}

/// Compares something of a node, which `about` names together with the node.
fn of_node(
    snapshot: &Snapshot,
    about: &str,
    name: &str,
    expected: String,
    got: impl Fn(NodeId) -> String,
) -> Result<(), Difference> {
    match snapshot.node(name) {
        Some(node) => equal(format!("{about}{name}"), expected, got(node), || Some(explain(snapshot, node))),
        None => Err((format!("{about}{name}"), expected, "no such node: no status made it yet".into(), None)),
    }
}

fn equal(
    subject: String,
    expected: String,
    got: String,
    why: impl FnOnce() -> Option<String>,
) -> Result<(), Difference> {
    if expected == got { Ok(()) } else { Err((subject, expected, got, why())) }
}

fn list(names: &[impl AsRef<str>]) -> String {
    format!("[{}]", names.iter().map(AsRef::as_ref).collect::<Vec<_>>().join(", "))
}

fn nodes(snapshot: &Snapshot) -> impl Iterator<Item = NodeId> {
    let groups = (0..snapshot.layout.groups.len() as u32).map(|id| NodeId::Group(GroupId(id)));
    groups.chain((0..snapshot.layout.modules.len() as u32).map(|id| NodeId::Module(ModuleId(id))))
}

fn own(snapshot: &Snapshot, node: NodeId) -> State {
    match node {
        NodeId::Group(id) => snapshot.group(id).1.own,
        NodeId::Module(id) => snapshot.module(id).1.own,
    }
}

/// What a node's state comes from, itself included where it is the cause.
fn roots(snapshot: &Snapshot, node: NodeId) -> Vec<NodeId> {
    if let (_, Some(Reason::Masked { by })) = snapshot.shown(node) {
        return by.to_vec();
    }
    match node {
        NodeId::Group(id) => {
            snapshot.group(id).1.paths.iter().filter_map(|path| path.last().copied()).collect()
        }
        NodeId::Module(_) => {
            snapshot.roots.iter().map(|root| root.node).filter(|&root| root == node).collect()
        }
    }
}

fn why_of(reason: Option<&Reason>) -> Why {
    match reason {
        None => Why::None,
        Some(Reason::Masked { .. }) => Why::Masked,
        Some(Reason::NotRelevant(_)) => Why::NotRelevant,
    }
}

pub fn why_word(why: Why) -> &'static str {
    match why {
        Why::None => "none",
        Why::Masked => "masked",
        Why::NotRelevant => "not_relevant",
    }
}

/// What a node shows and why, for whoever looks for the fault in a scenario.
fn explain(snapshot: &Snapshot, node: NodeId) -> String {
    let (state, reason) = snapshot.shown(node);
    let name = snapshot.node_name(node);
    let reason = match reason {
        None => String::new(),
        Some(Reason::Masked { by }) => {
            let names: Vec<&str> = by.iter().map(|&root| &**snapshot.node_name(root)).collect();
            format!(", masked by {}", names.join(", "))
        }
        Some(Reason::NotRelevant(NotRelevant::Stage(stage))) => format!(", the stage is {}", stage.as_str()),
        Some(Reason::NotRelevant(NotRelevant::Signal { name, value })) => format!(", {name} is {value}"),
    };
    let own = own(snapshot, node);
    match node {
        NodeId::Module(id) => {
            let view = snapshot.module(id).1;
            let heard = match view.received {
                None => "never heard".into(),
                Some(_) if view.silent => "silent".into(),
                Some(at) => format!("heard at {}, \"{}\"", seconds(at), view.report.message),
            };
            format!("{name} shows {state}{reason}; itself {own}, {heard}")
        }
        NodeId::Group(id) => {
            let info = &snapshot.layout.groups[id.0 as usize];
            let groups = info.groups.iter().map(|&id| NodeId::Group(id));
            let members = groups.chain(info.modules.iter().map(|&id| NodeId::Module(id)));
            let bad = members.filter(|&member| snapshot.shown(member).0 != State::Ok);
            let bad: Vec<String> = bad.map(|member| explain(snapshot, member)).collect();
            let bad = if bad.is_empty() { String::new() } else { format!("\n{}", bad.join("\n")) };
            format!("{name} shows {state}{reason}; its members' own states make {own}{bad}")
        }
    }
}

/// An instant in seconds, exactly.
pub fn seconds(at: Timestamp) -> String {
    let (whole, rest) = (at.as_nanos() / 1_000_000_000, at.as_nanos() % 1_000_000_000);
    let text = format!("{whole}.{rest:09}");
    format!("{} s", text.trim_end_matches('0').trim_end_matches('.'))
}
