//! Dependencies between nodes, and conditions of relevance.

use std::collections::HashMap;

use super::names::Names;
use crate::decode::Spanned;
use crate::file;
use telltale_engine::model::order::{Cycle, CycleEdge, CycleStep};
use telltale_engine::model::{Dependency, DependsOn, NodeId, POSED_SIGNAL, When, Within};
use telltale_yaml::{Log, Problem, Span, suggest};

/// Indices of the signals by name.
pub(crate) type Signals<'a> = HashMap<&'a str, usize>;

pub(crate) fn when(raw: &file::When, signals: &Signals, log: &mut Log) -> Option<When> {
    let mut found = Vec::new();
    let mut posed = None;
    for (key, value) in &raw.signals.0 {
        match signals.get(key.text.as_str()) {
            Some(&index) => found.push((index, *value)),
            None if key.text == POSED_SIGNAL => posed = Some(*value),
            None => {
                let mut known: Vec<&str> = signals.keys().copied().chain([POSED_SIGNAL]).collect();
                known.sort_unstable();
                let problem = Problem::at(key.span, format!("there is no signal `{}`", key.text));
                log.push(problem.help(match suggest(&key.text, known) {
                    Some(meant) => format!("did you mean `{meant}`?"),
                    None => "declare it under `signals`".into(),
                }));
            }
        }
    }
    Some(When { stages: raw.stages.clone(), signals: found, posed })
}

pub(crate) fn depends_on(
    names: &Names,
    node: NodeId,
    (raw, within): (&[file::Dependency], Within),
    log: &mut Log,
) -> Vec<Dependency> {
    let mut seen: HashMap<NodeId, Span> = HashMap::new();
    let mut resolved = Vec::new();
    for dependency in raw {
        let on = match &dependency.on {
            file::DependsOn::Node(name) => find(names, node, name, &mut seen, log).map(DependsOn::Node),
            file::DependsOn::AnyOf(members) => any_of(names, node, dependency.span, members, log),
        };
        let within = dependency.within.unwrap_or(within);
        resolved.extend(on.map(|on| Dependency { on, masks_unknown: dependency.masks_unknown, within }));
    }
    resolved
}

fn any_of(
    names: &Names,
    node: NodeId,
    span: Span,
    members: &[Spanned<String>],
    log: &mut Log,
) -> Option<DependsOn> {
    if members.is_empty() {
        let problem = Problem::at(span, "an `any_of` without members could never block");
        log.push(problem.help("name at least one group or module"));
        return None;
    }
    let mut seen = HashMap::new();
    let found = members.iter().filter_map(|name| find(names, node, name, &mut seen, log)).collect();
    Some(DependsOn::AnyOf(found))
}

/// The node of a dependency, unless its holder is inside of it or contains it.
fn find(
    names: &Names,
    node: NodeId,
    name: &Spanned<String>,
    seen: &mut HashMap<NodeId, Span>,
    log: &mut Log,
) -> Option<NodeId> {
    let on = names.find(name, log)?;
    let (path, other) = (names.path_of(node), &name.value);
    let inside = |inner: NodeId, outer: NodeId| {
        std::iter::successors(names.parent(inner), |&group| names.parent(NodeId::Group(group)))
            .any(|group| NodeId::Group(group) == outer)
    };
    let problem = if on == node {
        format!("`{path}` depends on itself")
    } else if inside(on, node) {
        format!("`{path}` depends on its own member `{other}`")
    } else if inside(node, on) {
        format!("`{path}` depends on `{other}`, which it is a member of")
    } else if let Some(first) = seen.insert(on, name.span) {
        let problem = Problem::at(name.span, format!("`{other}` is named twice")).label("again here");
        log.push(problem.also(first, "first here").help("remove one of the two"));
        return None;
    } else {
        return Some(on);
    };
    log.push(Problem::at(name.span, problem).help("remove this dependency"));
    None
}

/// A cycle as a problem: the whole cycle in words, and the line of each step.
pub(crate) fn describe_cycle(names: &Names, cycle: &Cycle) -> Problem {
    let steps = &cycle.0;
    let nodes = || steps.iter().map(|step| step.node);
    let mut places = steps.iter().zip(nodes().cycle().skip(1)).map(|(step, next)| place(names, step, next));
    let way: Vec<&str> = nodes().chain(nodes().take(1)).map(|node| &**names.path_of(node)).collect();
    let message = format!("dependencies go round in a circle: {}", way.join(" -> "));
    let (span, label) = places.next().unwrap_or((Span { file: 0, start: 0, end: 0 }, String::new()));
    let mut problem = Problem::at(span, message).label(label);
    for (span, label) in places {
        problem = problem.also(span, label);
    }
    problem.help("remove one of these dependencies, or let it name a single module instead of a group")
}

/// The place where a node of a cycle depends on the next.
fn place(names: &Names, step: &CycleStep, next: NodeId) -> (Span, String) {
    let target = names.path_of(next);
    let CycleEdge::Depends { holder, .. } = step.by else {
        return (names.span(next), format!("{target} is a member of {}", names.path_of(step.node)));
    };
    let named = |dependency: &file::Dependency| match &dependency.on {
        file::DependsOn::Node(name) => (name.value == **target).then_some(name.span),
        file::DependsOn::AnyOf(members) => {
            members.iter().find(|name| name.value == **target).map(|name| name.span)
        }
    };
    let span = names.dependencies(holder).iter().find_map(named).unwrap_or_else(|| names.span(holder));
    (span, format!("{} depends on {target}", names.path_of(holder)))
}
