//! The edges of a graph: links, removed units, loops.

use std::collections::HashMap;

use super::unit::{Graph, What};
use crate::import::Findings;
use telltale_yaml::{Problem, suggest};

/// Replaces each link by the unit that it leads to.
pub(super) fn resolve(graph: &mut Graph, findings: &mut Findings) {
    same_paths(graph, findings);
    let paths: HashMap<String, usize> =
        graph.by_path().into_iter().map(|(path, index)| (path.to_owned(), index)).collect();
    let mut targets: Vec<Option<usize>> = Vec::with_capacity(graph.units.len());
    for start in 0..graph.units.len() {
        targets.push(follow(graph, start, &paths, findings));
    }
    for unit in &mut graph.units {
        unit.children = unit.children.iter().filter_map(|&child| targets[child]).collect();
    }
}

/// The unit at the end of a chain of links.
fn follow(
    graph: &Graph,
    start: usize,
    paths: &HashMap<String, usize>,
    findings: &mut Findings,
) -> Option<usize> {
    let mut at = start;
    for _ in 0..=graph.units.len() {
        let What::Link(path) = &graph.units[at].what else { return Some(at) };
        let Some(&next) = paths.get(path) else {
            if at == start {
                let text = format!("there is no unit `{path}`");
                let known = suggest(path, paths.keys().map(String::as_str));
                let help = known.map_or_else(
                    || "the link is left out: is a file missing?".into(),
                    |meant| format!("the link is left out; did you mean `{meant}`?"),
                );
                findings.lost(Problem::at(graph.units[at].span, text).help(help));
            }
            return None;
        };
        at = next;
    }
    let problem = Problem::at(graph.units[start].span, "this link leads back to itself");
    findings.lost(problem.help("it is left out: let it lead to a unit that is no link"));
    None
}

/// Of two units with one path, the first counts.
fn same_paths(graph: &mut Graph, findings: &mut Findings) {
    let mut first: HashMap<String, usize> = HashMap::new();
    for index in 0..graph.units.len() {
        let Some((path, span)) = graph.units[index].path.clone() else { continue };
        match first.get(&path) {
            None => {
                first.insert(path, index);
            }
            Some(&before) => {
                let problem =
                    Problem::at(span, format!("two units have the path `{path}`")).label("again here");
                let problem = problem.also(graph.units[before].span, "first here");
                findings.lost(problem.help("links lead to the first; give the other a path of its own"));
                graph.units[index].path = None;
            }
        }
    }
}

/// Removes what the graph's edits remove, and every link to it.
pub(super) fn remove(graph: &mut Graph, findings: &mut Findings) {
    for edit in std::mem::take(&mut graph.edits) {
        let regex = match &edit.regex {
            None => None,
            Some(pattern) => match regex::Regex::new(&format!(r"\A(?:{pattern})\z")) {
                Ok(regex) => Some(regex),
                Err(_) => {
                    let problem =
                        Problem::at(edit.span, format!("`{pattern}` cannot be used as a regular expression"));
                    findings.lost(problem.help("name the paths one by one"));
                    continue;
                }
            },
        };
        let is_meant = |path: &str| match &regex {
            Some(regex) => regex.is_match(path),
            None => edit.path.as_deref() == Some(path),
        };
        let mut found = false;
        for unit in &mut graph.units {
            let meant = unit.path.as_ref().is_some_and(|(path, _)| is_meant(path));
            unit.removed |= meant;
            found |= meant;
        }
        if !found {
            let what = edit.regex.or(edit.path).unwrap_or_default();
            let problem = Problem::at(edit.span, format!("there is no unit `{what}` to remove"));
            findings.lost(problem.help("check the path"));
        }
    }
    // What was written inside of a removed unit, and stands nowhere else, goes with it.
    let kept: Vec<bool> = graph.units.iter().map(|unit| !unit.removed).collect();
    for unit in &mut graph.units {
        unit.children.retain(|&child| kept[child]);
    }
    let mut reached = vec![false; graph.units.len()];
    let mut waiting = graph.tops.clone();
    while let Some(index) = waiting.pop() {
        if kept[index] && !std::mem::replace(&mut reached[index], true) {
            waiting.extend(&graph.units[index].children);
        }
    }
    for (unit, reached) in graph.units.iter_mut().zip(reached) {
        unit.removed |= !reached;
    }
}

/// Cuts each loop at the link that closes it.
pub(super) fn cut_loops(graph: &mut Graph, findings: &mut Findings) {
    #[derive(Clone, Copy, PartialEq)]
    enum Mark {
        New,
        Open,
        Done,
    }
    let mut marks = vec![Mark::New; graph.units.len()];
    for start in 0..graph.units.len() {
        if marks[start] != Mark::New || graph.units[start].removed {
            continue;
        }
        marks[start] = Mark::Open;
        let mut way = vec![(start, 0)];
        while let Some((unit, position)) = way.last_mut() {
            let (at, next) = (*unit, *position);
            let Some(&child) = graph.units[at].children.get(next) else {
                marks[at] = Mark::Done;
                way.pop();
                continue;
            };
            match marks[child] {
                Mark::Open => {
                    graph.units[at].children.remove(next);
                    let from = way.iter().position(|(unit, _)| *unit == child).unwrap_or(0);
                    let names: Vec<String> = way[from..].iter().map(|(unit, _)| graph.name(*unit)).collect();
                    let text = format!("these units form a loop: {} -> {}", names.join(" -> "), names[0]);
                    let problem = Problem::at(graph.units[at].span, text).label("it closes here");
                    let help =
                        "Autoware does not load such a graph; here the last link of the loop is left out";
                    findings.lost(problem.also(graph.units[child].span, "and leads back here").help(help));
                }
                Mark::New => {
                    marks[child] = Mark::Open;
                    *position += 1;
                    way.push((child, 0));
                }
                Mark::Done => *position += 1,
            }
        }
    }
}

/// Says that no `dependent` is carried over.
pub(super) fn drop_dependents(graph: &Graph, findings: &mut Findings) {
    for unit in graph.units.iter().filter(|unit| !unit.removed) {
        if let Some((path, span)) = &unit.dependent {
            let problem = Problem::at(*span, format!("the dependency on `{path}` is left out"));
            let help = "with the dependencies of this graph some unit would depend on itself: add those that matter as `depends_on`";
            findings.lost(problem.help(help));
        }
    }
}
