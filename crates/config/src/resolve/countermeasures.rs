//! Converts the written countermeasures into rules of the model.

use std::collections::HashMap;

use super::names::Names;
use super::relations::Signals;
use crate::file::countermeasure::{RawConfirmedBy, RawRule, RawWhen};
use telltale_engine::model::countermeasure::{Confirmation, ConfirmedBy, Request, RequestKind, Rule};
use telltale_engine::model::{ACTIVE_SIGNAL, NodeId};
use telltale_engine::state::State;
use telltale_yaml::decode::did_you_mean;
use telltale_yaml::{Log, Problem, Span, suggest};

/// The valid rules; the log has the problems of the others.
pub(crate) fn rules(raw: &[RawRule], names: &Names, signals: &Signals, log: &mut Log) -> Vec<Rule> {
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

/// Whether both are the same kind of request in the same case, perhaps with other figures.
fn is_same(a: &Rule, b: &Rule) -> bool {
    [a, b].iter().all(|rule| rule.request.kind() == RequestKind::Decelerate)
        && a.state == b.state
        && a.nodes.iter().any(|node| b.nodes.contains(node))
        && a.stages.iter().any(|stage| b.stages.contains(stage))
}

/// The places of each rule's nodes; in the order of [`rules`] if all are valid.
pub(crate) fn spans(raw: &[RawRule]) -> Vec<Vec<Span>> {
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
