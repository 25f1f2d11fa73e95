//! Countermeasures: read, and bound to the nodes that they watch (`DESIGN.md` 5).

use std::collections::HashMap;

use super::names::Names;
use super::relations::Signals;
use crate::engine::model::countermeasure::{Confirmation, ConfirmedBy, Kind, Request, Rule};
use crate::engine::model::{ACTIVE_SIGNAL, NodeId, Stage};
use crate::engine::state::State;
use crate::engine::time;
use crate::yaml::decode::{All, did_you_mean, scalar, word};
use crate::yaml::{Fields, FromNode, Log, Node, Problem, Span, Spanned, suggest};

/// The strongest that passengers who stand can be asked to bear.
const MPS2_MAX: f64 = 3.0;
const MPS2: f64 = 1.0;
const WITHIN: time::Span = time::Span::from_secs(1);
const WITHIN_MAX: time::Span = time::Span::from_secs(60);

#[derive(Debug)]
pub(super) struct RawRule {
    request: Option<Request>,
    when: Option<RawWhen>,
    confirmation: Option<(RawConfirmedBy, time::Span)>,
}

#[derive(Debug)]
struct RawWhen {
    span: Span,
    groups: Vec<Spanned<String>>,
    modules: Vec<Spanned<String>>,
    state: Option<State>,
    stages: Vec<Stage>,
}

#[derive(Debug)]
enum RawConfirmedBy {
    Signal(Spanned<String>),
    Status(String),
}

impl FromNode for RawRule {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a countermeasure", log)?;
        let kind = fields.node("request");
        if kind.is_none() {
            let problem = Problem::at(node.span, "a countermeasure needs `request`");
            fields.log.push(problem.help("add `request: decelerate`, `maneuver_stop` or `notify`"));
        }
        let mps2: Option<Spanned<f64>> = fields.optional("mps2");
        let request = kind.and_then(|node| request(node, mps2, fields.log));
        let when = fields.required("when");
        let by = fields.optional("confirmed_by");
        let within: Option<Spanned<time::Span>> = fields.optional("within");
        if let Some(within) = within {
            if within.value.is_zero() || within.value > WITHIN_MAX {
                let problem = Problem::at(within.span, "`within` is not between 0 and 1m");
                fields.log.push(problem.help("for example `1s`"));
            }
            if fields.key_span("confirmed_by").is_none() {
                let problem = Problem::at(within.span, "`within` without `confirmed_by`");
                fields.log.push(problem.help("add `confirmed_by: { signal: NAME }`, or remove `within`"));
            }
        }
        if let (Some(Request::Notify), Some(span)) = (request, fields.key_span("confirmed_by")) {
            let problem = Problem::at(span, "a notice is shown here; nobody else has to confirm it");
            fields.log.push(problem.help("remove `confirmed_by`"));
        }
        fields.finish();
        let within = within.map_or(WITHIN, |within| within.value);
        Some(RawRule { request, when, confirmation: by.map(|by| (by, within)) })
    }
}

fn request(node: &Node, mps2: Option<Spanned<f64>>, log: &mut Log) -> Option<Request> {
    if scalar(node) == Some("record") {
        let problem =
            Problem::at(node.span, "a countermeasure asks the vehicle or the operator; recording is neither");
        log.push(problem.help("remove this countermeasure"));
        return None;
    }
    let strength = mps2.map_or(MPS2, |mps2| mps2.value);
    let choices = [
        ("decelerate", Request::Decelerate { mps2: strength }),
        ("maneuver_stop", Request::ManeuverStop),
        ("notify", Request::Notify),
    ];
    let request = word(node, log, "request", &choices)?;
    match (request, mps2) {
        (Request::Decelerate { .. }, Some(mps2)) if !(mps2.value > 0.0 && mps2.value <= MPS2_MAX) => {
            let problem =
                Problem::at(mps2.span, format!("{} m/s² is not above 0 and up to {MPS2_MAX}", mps2.value));
            log.push(problem.help(format!("the default is {MPS2}")));
        }
        (Request::ManeuverStop | Request::Notify, Some(mps2)) => {
            let problem = Problem::at(mps2.span, "only `decelerate` has a strength");
            log.push(problem.help("remove `mps2`"));
        }
        _ => {}
    }
    Some(request)
}

impl FromNode for RawWhen {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "the `when` of a countermeasure", log)?;
        let mut names = |key| match fields.optional::<All<_>>(key) {
            Some(All(names)) => Some(names),
            // The log says what is wrong with it: it is not that nothing is watched.
            None => fields.key_span(key).is_none().then(Vec::new),
        };
        let (groups, modules) = (names("groups"), names("modules"));
        let states = [State::Warning, State::Unknown, State::Error].map(|state| (state.as_str(), state));
        let state = fields.node("state").and_then(|node| word(node, fields.log, "state", &states));
        let stages: Option<Spanned<All<Stage>>> = fields.optional("stages");
        if let Some(empty) = stages.as_ref().filter(|stages| stages.value.0.is_empty()) {
            let problem = Problem::at(empty.span, "without a stage this would never be asked for");
            fields.log.push(problem.help("name the stages, or remove `stages`: then it is `[active]`"));
        }
        fields.finish();
        let stages = stages.map_or_else(|| vec![Stage::Active], |stages| stages.value.0);
        Some(RawWhen { span: node.span, groups: groups?, modules: modules?, state, stages })
    }
}

impl FromNode for RawConfirmedBy {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let mut fields = Fields::of(node, "a confirmation", log)?;
        let (signal, status) = (fields.optional("signal"), fields.optional("status"));
        if fields.key_span("signal").is_some() == fields.key_span("status").is_some() {
            let problem = Problem::at(node.span, "a confirmation needs either `signal` or `status`");
            fields.log.push(problem.help("for example `confirmed_by: { signal: braking }`"));
        }
        fields.finish();
        signal.map(RawConfirmedBy::Signal).or(status.map(RawConfirmedBy::Status))
    }
}

/// The rules that can be said to the engine; the log says what is wrong with the others.
pub(super) fn rules(raw: &[RawRule], names: &Names, signals: &Signals, log: &mut Log) -> Vec<Rule> {
    let mut rules: Vec<Rule> = Vec::new();
    let mut spans: Vec<Span> = Vec::new();
    for (raw, when) in raw.iter().filter_map(|raw| raw.when.as_ref().map(|when| (raw, when))) {
        let Some(rule) = rule(raw, names, signals, log) else { continue };
        let earlier = rules.iter().position(|earlier| is_same(earlier, &rule));
        if let Some(&first) = earlier.and_then(|index| spans.get(index)) {
            let text = "another countermeasure asks to decelerate for the same already";
            let problem = Problem::at(when.span, text).label("again here").also(first, "first here");
            log.push(problem.help("keep one of the two, or let them differ in what they watch"));
        }
        rules.push(rule);
        spans.push(when.span);
    }
    rules
}

/// Whether both ask to decelerate, perhaps with other figures, when the same happens.
fn is_same(a: &Rule, b: &Rule) -> bool {
    [a, b].iter().all(|rule| rule.request.kind() == Kind::Decelerate)
        && a.state == b.state
        && a.nodes.iter().any(|node| b.nodes.contains(node))
        && a.stages.iter().any(|stage| b.stages.contains(stage))
}

/// Where each node of each rule is written; in the order of [`rules`] where nothing is wrong.
pub(super) fn spans(raw: &[RawRule]) -> Vec<Vec<Span>> {
    let spans = |when: &RawWhen| when.groups.iter().chain(&when.modules).map(|name| name.span).collect();
    raw.iter().filter_map(|raw| raw.when.as_ref()).map(spans).collect()
}

fn rule(raw: &RawRule, names: &Names, signals: &Signals, log: &mut Log) -> Option<Rule> {
    let when = raw.when.as_ref()?;
    let nodes = nodes(when, names, log);
    let confirmation = raw.confirmation.as_ref();
    let confirmation = confirmation
        .and_then(|(by, within)| Some(Confirmation { by: confirmed_by(by, signals, log)?, within: *within }));
    let request = raw.request?;
    let least = if request == Request::Notify { State::Warning } else { State::Error };
    let (state, stages) = (when.state.unwrap_or(least), when.stages.clone());
    Some(Rule { request, nodes, state, stages, confirmation })
}

fn nodes(when: &RawWhen, names: &Names, log: &mut Log) -> Vec<NodeId> {
    if when.groups.is_empty() && when.modules.is_empty() {
        let problem = Problem::at(when.span, "this countermeasure watches nothing");
        log.push(problem.help("add `groups: [...]` or `modules: [...]`"));
    }
    let mut seen: HashMap<NodeId, Span> = HashMap::new();
    let mut nodes = Vec::new();
    let groups = when.groups.iter().map(|name| (name, "group"));
    for (name, what) in groups.chain(when.modules.iter().map(|name| (name, "module"))) {
        let Some(node) = names.find(name, log) else { continue };
        let is = if matches!(node, NodeId::Group(_)) { "group" } else { "module" };
        if is != what {
            let problem = Problem::at(name.span, format!("`{}` is a {is}", name.value));
            log.push(problem.help(format!("name it in `{is}s`")));
        }
        if let Some(first) = seen.insert(node, name.span) {
            let problem =
                Problem::at(name.span, format!("`{}` is named twice", name.value)).label("again here");
            log.push(problem.also(first, "first here").help("remove one of the two"));
            continue;
        }
        nodes.push(node);
    }
    nodes
}

fn confirmed_by(raw: &RawConfirmedBy, signals: &Signals, log: &mut Log) -> Option<ConfirmedBy> {
    let name = match raw {
        RawConfirmedBy::Status(name) => return Some(ConfirmedBy::Status(name.as_str().into())),
        RawConfirmedBy::Signal(name) => name,
    };
    if name.value == ACTIVE_SIGNAL {
        let text = format!("`{ACTIVE_SIGNAL}` says that the vehicle drives, which confirms no stop");
        log.push(
            Problem::at(name.span, text)
                .help("name a signal that is true while the vehicle does what was asked"),
        );
        return None;
    }
    let found = signals.get(name.value.as_str()).copied();
    if found.is_none() {
        let mut known: Vec<&str> = signals.keys().copied().collect();
        known.sort_unstable();
        let problem = Problem::at(name.span, format!("there is no signal `{}`", name.value));
        let help = suggest(&name.value, known).map_or("declare it under `signals`".into(), did_you_mean);
        log.push(problem.help(help));
    }
    found.map(ConfirmedBy::Signal)
}
