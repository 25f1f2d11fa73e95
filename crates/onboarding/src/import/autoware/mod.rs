//! Autoware's diagnostic graphs. The rules are those of autoware_diagnostic_graph_aggregator.

mod files;
mod links;
mod tree;
mod unit;

use super::{Findings, Lookup, write};
use telltale_yaml::{Node, Problem, Sources};
use unit::Graph;

/// The configuration as text.
///
/// # Errors
///
/// There is no unit in it.
pub(super) fn import(
    sources: &mut Sources,
    file: u16,
    root: Node,
    lookup: &Lookup,
    findings: &mut Findings,
) -> Result<String, Problem> {
    let (name, place) = (sources.name(file).to_owned(), root.span);
    let mut graph = Graph::default();
    files::read(sources, file, root, lookup, &mut graph, findings);
    links::resolve(&mut graph, findings);
    links::remove(&mut graph, findings);
    links::cut_loops(&mut graph, findings);
    if graph.roots().is_empty() {
        let problem = Problem::at(place, "there are no units in this graph");
        return Err(problem.help("a unit is `{ path: /autoware/..., type: and, list: [...] }` below `units`"));
    }
    let comments = [
        format!("Made by `telltale import` from {name}, a diagnostic graph of Autoware."),
        "Each unit that nothing refers to, mostly a mode, is a group at the top. A unit that several others refer to".into(),
        "stands in each of them: its statuses feed modules in several places, and are one fault to the operator.".into(),
    ];
    let keys = [
        "# A machine without stages is always diagnosed. Remove `stages` for a shuttle, which an operator clears.".into(),
        "vehicle: { id: autoware, name: Autoware, stages: none }".into(),
        "# In a graph a stale status makes its units an error.".into(),
        "defaults: { timeout: 1s, stale: error }".into(),
        String::new(),
    ];
    let groups = tree::build(&graph, true, sources, findings);
    let text = write::file(&comments, &keys, &groups);
    if !graph.has_dependents() || telltale_config::parse("the result", &text).is_ok() {
        return Ok(text);
    }
    // A dependency that goes in a circle is no configuration.
    links::drop_dependents(&graph, findings);
    let groups = tree::build(&graph, false, sources, &mut Findings::default());
    Ok(write::file(&comments, &keys, &groups))
}
