//! The graph as a tree of groups: a unit that several others refer to stands in each of them.

use std::collections::HashMap;

use super::unit::{Graph, What};
use crate::import::Findings;
use crate::import::write::{Ids, OutGroup, OutModule, duration, quoted};
use telltale_yaml::{Problem, Sources};

/// The places of units in the tree. A small graph could have very many.
const PLACES_MAX: usize = 20_000;

/// Levels of groups: a deeper configuration could not be read.
const DEPTH_MAX: usize = 24;

/// Stands above what has a dependency.
const DEPENDENT: &str = "`dependent`: it is ignored while that fails, instead of being marked.";

/// What the units above do to the levels below.
#[derive(Debug, Clone, Copy, Default)]
struct Above {
    /// As which a WARNING counts. The nearest unit decides, because it acts first.
    warning: Option<&'static str>,
    latch_s: Option<f64>,
}

struct Builder<'a> {
    graph: &'a Graph,
    sources: &'a Sources,
    findings: &'a mut Findings,
    /// The first name of each unit in the tree.
    names: HashMap<usize, String>,
    places: usize,
    /// Groups and modules with the unit on which they depend.
    with_dependents: bool,
    said_latch: bool,
    said_dependent: bool,
}

pub(super) fn build(
    graph: &Graph,
    with_dependents: bool,
    sources: &Sources,
    findings: &mut Findings,
) -> Vec<OutGroup> {
    let names = HashMap::new();
    let mut builder = Builder {
        graph,
        sources,
        findings,
        names,
        places: 0,
        with_dependents,
        said_latch: false,
        said_dependent: false,
    };
    let mut ids = Ids::at_the_top();
    let mut groups: Vec<OutGroup> =
        graph.roots().into_iter().filter_map(|root| builder.top(root, &mut ids)).collect();
    let paths: HashMap<&str, usize> = graph.by_path();
    for group in &mut groups {
        let own = group.id.clone();
        builder.depend(group, &own, &paths);
    }
    groups
}

/// As which a unit counts a WARNING of its item.
fn mapped(what: &What) -> Option<&'static str> {
    match what {
        What::WarnToOk => Some("ok"),
        What::WarnToError => Some("error"),
        _ => None,
    }
}

enum Place {
    Group(OutGroup),
    Module(OutModule),
}

impl Builder<'_> {
    /// A root is a group even if it is a single status.
    fn top(&mut self, root: usize, ids: &mut Ids) -> Option<OutGroup> {
        let (id, name) = self.id(root, ids);
        match self.place(root, Above::default(), id.clone(), name.clone(), &id)? {
            Place::Group(group) => Some(group),
            Place::Module(module) => {
                let path = format!("{id}/{}", module.id);
                self.names.insert(root, path);
                Some(OutGroup { id, name, modules: vec![module], ..OutGroup::default() })
            }
        }
    }

    /// An id, and a name for people: the last part of the path.
    fn id(&self, unit: usize, ids: &mut Ids) -> (String, String) {
        let name = self.graph.name(unit);
        let last = match name.starts_with('/') {
            true => name.rsplit('/').find(|part| !part.is_empty()).unwrap_or(&name),
            false => &name,
        };
        (ids.of(last), last.to_owned())
    }

    /// A unit at a place in the tree; `path` is its full name there.
    fn place(&mut self, index: usize, above: Above, id: String, name: String, path: &str) -> Option<Place> {
        self.places += 1;
        let unit = &self.graph.units[index];
        if self.places == PLACES_MAX {
            let text = "units refer to one another in too many ways: the tree would be too large";
            self.findings
                .lost(Problem::at(unit.span, text).help("import parts of the graph, or remove modes"));
        }
        if self.places >= PLACES_MAX {
            return None;
        }
        if path.matches('/').count() >= DEPTH_MAX {
            let text = format!("this unit is more than {DEPTH_MAX} levels below the top of the graph");
            self.findings.lost(Problem::at(unit.span, text).help("import parts of the graph"));
            return None;
        }
        self.names.entry(index).or_insert_with(|| path.to_owned());
        // Where nobody names the unit that maps levels, its item stands alone.
        if let (None, [item], Some(warning)) = (&unit.path, &unit.children[..], mapped(&unit.what)) {
            let above = self.latched(index, above, &mut Vec::new());
            return self.place(*item, Above { warning: Some(warning), ..above }, id, name, path);
        }
        let mut comments = vec![match &unit.path {
            Some((path, span)) => format!("{path} ({})", super::super::line(self.sources, *span)),
            None => super::super::line(self.sources, unit.span),
        }];
        let above = self.latched(index, above, &mut comments);
        match &unit.what {
            What::Diag { .. } | What::Constant(_) => {
                let keys = self.keys(index, above);
                Some(Place::Module(OutModule {
                    comments,
                    id,
                    keys,
                    unit: Some(index),
                    depends_on: Vec::new(),
                }))
            }
            What::Link(_) => None,
            What::And | What::Or | What::WarnToOk | What::WarnToError => {
                let warning = mapped(&unit.what).or(above.warning);
                let any = unit.what == What::Or;
                let group = OutGroup {
                    comments,
                    id,
                    name,
                    any,
                    unit: Some(index),
                    may_be_empty: unit.children.is_empty() && !unit.is_unread,
                    ..OutGroup::default()
                };
                Some(Place::Group(self.inside(index, Above { warning, ..above }, group, path)))
            }
        }
    }

    fn inside(&mut self, index: usize, above: Above, mut group: OutGroup, path: &str) -> OutGroup {
        let mut ids = Ids::default();
        let mut statuses: Vec<&str> = Vec::new();
        for &child in &self.graph.units[index].children {
            if let What::Diag { status, .. } = &self.graph.units[child].what {
                // Twice the same changes nothing.
                if statuses.contains(&status.as_str()) {
                    continue;
                }
                statuses.push(status);
            }
            let (id, name) = self.id(child, &mut ids);
            let inner = format!("{path}/{id}");
            match self.place(child, above, id, name, &inner) {
                Some(Place::Group(inside)) => group.groups.push(inside),
                Some(Place::Module(module)) => group.modules.push(module),
                None => {}
            }
        }
        group
    }

    /// Adds the dependencies, once all units have their names.
    fn depend(&mut self, group: &mut OutGroup, path: &str, paths: &HashMap<&str, usize>) {
        let on = group.unit.and_then(|unit| self.dependency(unit, path, paths));
        group.comments.extend(on.is_some().then(|| DEPENDENT.to_owned()));
        group.depends_on.extend(on);
        for module in &mut group.modules {
            let own = format!("{path}/{}", module.id);
            let on = module.unit.and_then(|unit| self.dependency(unit, &own, paths));
            module.comments.extend(on.is_some().then(|| DEPENDENT.to_owned()));
            module.depends_on.extend(on);
        }
        for inside in &mut group.groups {
            let own = format!("{path}/{}", inside.id);
            self.depend(inside, &own, paths);
        }
    }

    /// The name of the node on which a unit depends.
    fn dependency(&mut self, unit: usize, own: &str, paths: &HashMap<&str, usize>) -> Option<String> {
        let (wanted, span) = self.graph.units[unit].dependent.as_ref().filter(|_| self.with_dependents)?;
        let found = paths.get(wanted.as_str()).and_then(|target| self.names.get(target)).cloned();
        let Some(found) = found else {
            let problem = Problem::at(*span, format!("there is no unit `{wanted}` to depend on"));
            self.findings.lost(problem.help("the dependency is left out: check the path"));
            return None;
        };
        let contains = |outer: &str, inner: &str| {
            inner.strip_prefix(outer).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
        };
        if contains(&found, own) || contains(own, &found) {
            let problem = Problem::at(*span, format!("`{wanted}` contains this unit, or is in it"));
            self.findings.lost(problem.help("the dependency is left out: it would depend on itself"));
            return None;
        }
        if !std::mem::replace(&mut self.said_dependent, true) {
            let text =
                "here a unit is ignored while what it depends on is in ERROR or UNKNOWN, and names the cause";
            let help = "in Autoware it keeps its level and is marked; see docs/how-to/move-from-autoware.md";
            self.findings.differs(Problem::at(*span, text).help(help));
        }
        Some(found)
    }

    /// A latch of a unit acts on each status below it.
    fn latched(&mut self, index: usize, above: Above, comments: &mut Vec<String>) -> Above {
        let unit = &self.graph.units[index];
        let Some(own) = unit.latch_s else { return above };
        if !std::mem::replace(&mut self.said_latch, true) {
            let text = "here an ERROR latches, and a WARNING does not";
            self.findings.differs(Problem::at(unit.span, text).help("an operator or developer resets it"));
        }
        match unit.what {
            What::Or if unit.children.len() > 1 => {
                let problem = Problem::at(unit.span, "the latch of a redundant unit cannot be carried over");
                self.findings
                    .lost(problem.help("latch the statuses in it, if one of them alone is worth it"));
                comments.push(format!("The latch after {} is left out.", duration(own)));
                return above;
            }
            What::And if unit.children.len() > 1 => {
                comments.push("Its latch is one of each status in it: errors in turn do not add up.".into());
            }
            _ => {}
        }
        Above { latch_s: Some(above.latch_s.map_or(own, |outer| outer.min(own))), ..above }
    }

    fn keys(&self, index: usize, above: Above) -> String {
        let mut keys = match &self.graph.units[index].what {
            What::Diag { status, timeout_s, hysteresis_s } => {
                let mut keys = format!("status: {}", quoted(status));
                if *timeout_s != 1.0 {
                    keys.push_str(&format!(", timeout: {}", duration(*timeout_s)));
                }
                if let Some(seconds) = hysteresis_s {
                    keys.push_str(&format!(", raise_after: {0}, clear_after: {0}", duration(*seconds)));
                }
                keys
            }
            What::Constant(state) => format!("monitor: {{ constant: {{ state: {state} }} }}"),
            _ => String::new(),
        };
        if let Some(state) = above.warning {
            keys.push_str(&format!(", warning_as: {state}"));
        }
        if let Some(seconds) = above.latch_s {
            keys.push_str(&format!(", latch: {}", duration(seconds)));
        }
        keys
    }
}
