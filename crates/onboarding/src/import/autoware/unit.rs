//! The units of a graph.

use std::collections::HashMap;

use crate::import::Findings;
use telltale_engine::state::State;
use telltale_yaml::decode::scalar;
use telltale_yaml::{Kind, Node, Problem, Span, suggest};

/// More units than any graph has.
const UNITS_MAX: usize = 20_000;

/// The status of a diag unit is stale after this, where nothing else is said.
const TIMEOUT_S: f64 = 1.0;

/// All units of all files.
#[derive(Debug, Default)]
pub(super) struct Graph {
    pub units: Vec<Unit>,
    pub edits: Vec<Edit>,
    /// Units at the top of a file: the others are written inside of one.
    pub tops: Vec<usize>,
}

#[derive(Debug)]
pub(super) struct Unit {
    pub span: Span,
    /// With its place.
    pub path: Option<(String, Span)>,
    pub what: What,
    pub children: Vec<usize>,
    /// Its content could not be read: it must not count as empty, which is OK.
    pub is_unread: bool,
    pub dependent: Option<(String, Span)>,
    pub latch_s: Option<f64>,
    pub removed: bool,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) enum What {
    And,
    Or,
    WarnToOk,
    WarnToError,
    Diag { status: String, timeout_s: f64, hysteresis_s: Option<f64> },
    Constant(State),
    Link(String),
}

#[derive(Debug)]
pub(super) struct Edit {
    pub span: Span,
    pub regex: Option<String>,
    pub path: Option<String>,
}

const TYPES: [&str; 11] = [
    "and",
    "or",
    "short-circuit-and",
    "warn-to-ok",
    "warn-to-error",
    "diag",
    "link",
    "ok",
    "warn",
    "error",
    "stale",
];

/// The kind of value that a key of a unit has.
#[derive(Clone, Copy)]
enum Wanted {
    Text,
    List,
    Unit,
}

impl Wanted {
    fn is(self, value: &Node) -> bool {
        match self {
            Wanted::Text => scalar(value).is_some(),
            Wanted::List => matches!(value.kind, Kind::Sequence(_)),
            Wanted::Unit => matches!(value.kind, Kind::Mapping(_)),
        }
    }

    fn word(self) -> &'static str {
        match self {
            Wanted::Text => "one word or number",
            Wanted::List => "a list of units",
            Wanted::Unit => "a unit",
        }
    }
}

fn wanted(key: &str) -> Option<Wanted> {
    Some(match key {
        "type" | "path" | "node" | "name" | "timeout" | "hysteresis" | "latch" | "link" | "dependent" => {
            Wanted::Text
        }
        "list" => Wanted::List,
        "item" => Wanted::Unit,
        _ => return None,
    })
}

impl Graph {
    /// Adds a unit with all that is written inside of it. Returns its index.
    pub fn add(&mut self, node: &Node, findings: &mut Findings) -> Option<usize> {
        let Kind::Mapping(entries) = &node.kind else {
            let problem = Problem::at(node.span, format!("expected a unit, found {}", node.describe()));
            findings.lost(problem.help("write `{ path: /autoware/..., type: and, list: [...] }`"));
            return None;
        };
        if self.units.len() >= UNITS_MAX {
            let problem = Problem::at(node.span, format!("there are more than {UNITS_MAX} units"));
            findings.lost(problem.help("import parts of the graph"));
            return None;
        }
        for (key, value) in entries {
            if let Some(wanted) = wanted(&key.text).filter(|wanted| !wanted.is(value)) {
                let text = format!("`{}` is {}, found {}", key.text, wanted.word(), value.describe());
                findings.lost(
                    Problem::at(value.span, text).help("it is left out: write it as Autoware reads it"),
                );
            }
        }
        let text = |key: &str| node.get(key).and_then(|node| Some((scalar(node)?.to_owned(), node.span)));
        let Some((kind, kind_span)) = text("type") else {
            let problem = Problem::at(node.span, "this unit has no `type`");
            findings.lost(problem.help(format!("add one of: {}", TYPES.join(", "))));
            return None;
        };
        let mut seconds = |key: &str| {
            let (text, span) = text(key)?;
            let number = text.parse::<f64>().ok().filter(|it| it.is_finite() && *it >= 0.0);
            if number.is_none() {
                let problem = Problem::at(span, format!("`{key}` is no number of seconds: `{text}`"));
                findings.lost(problem.help("write one, as in `1.0`"));
            }
            number.map(|number| (number, span))
        };
        let (timeout, hysteresis, latch) = (seconds("timeout"), seconds("hysteresis"), seconds("latch"));
        let what = match kind.as_str() {
            "and" | "short-circuit-and" => What::And,
            "or" => What::Or,
            "warn-to-ok" => What::WarnToOk,
            "warn-to-error" => What::WarnToError,
            "ok" => What::Constant(State::Ok),
            "warn" => What::Constant(State::Warning),
            "error" => What::Constant(State::Error),
            "stale" => What::Constant(State::Unknown),
            "link" => match text("link") {
                Some((path, _)) => What::Link(path),
                None => {
                    let problem = Problem::at(node.span, "this link names no unit");
                    findings.lost(problem.help("add `link: /PATH`"));
                    return None;
                }
            },
            "diag" => {
                let part = |key: &str| text(key).map(|(text, _)| text).unwrap_or_default();
                let (from, name) = (part("node"), part("name"));
                if name.is_empty() {
                    let problem = Problem::at(node.span, "this diag unit names no status");
                    findings.lost(problem.help("add `node: NODE` and `name: NAME`"));
                    return None;
                }
                let status = if from.is_empty() { name } else { format!("{from}: {name}") };
                let timeout_s = match timeout {
                    Some((timeout, span)) if timeout <= 0.0 => {
                        let problem = Problem::at(span, "with a timeout of 0 this would always be stale");
                        findings.differs(problem.help(format!("it is {TIMEOUT_S} s here")));
                        TIMEOUT_S
                    }
                    Some((timeout, _)) => timeout,
                    None => TIMEOUT_S,
                };
                let hysteresis_s = hysteresis.map(|(seconds, _)| seconds).filter(|&seconds| seconds > 0.0);
                What::Diag { status, timeout_s, hysteresis_s }
            }
            _ => {
                let problem = Problem::at(kind_span, format!("there is no unit of the type `{kind}`"));
                let help = suggest(&kind, TYPES).map_or_else(
                    || format!("it is an `and` here; known: {}", TYPES.join(", ")),
                    |meant| format!("did you mean `{meant}`? It is an `and` here"),
                );
                findings.lost(problem.help(help));
                What::And
            }
        };
        for (key, _) in entries {
            if wanted(&key.text).is_none() {
                let problem = Problem::at(key.span, format!("`{}` has no equal here", key.text));
                findings.lost(problem.help(match key.text.as_str() {
                    "allow_override" => "Telltale has no overrides: a state is what was reported",
                    _ => "it is left out",
                }));
            }
        }
        let index = self.units.len();
        self.units.push(Unit {
            span: node.span,
            path: text("path").filter(|(path, _)| !path.is_empty()),
            what,
            children: Vec::new(),
            is_unread: entries.iter().any(|(key, value)| {
                matches!(wanted(&key.text), Some(it @ (Wanted::List | Wanted::Unit)) if !it.is(value))
            }),
            dependent: text("dependent").filter(|(path, _)| !path.is_empty()),
            latch_s: latch.map(|(seconds, _)| seconds),
            removed: false,
        });
        let inside: Vec<&Node> = match (node.get("list").map(|list| &list.kind), node.get("item")) {
            (Some(Kind::Sequence(items)), _) => items.iter().collect(),
            (_, Some(item)) => vec![item],
            _ => Vec::new(),
        };
        let is_node =
            matches!(self.units[index].what, What::And | What::Or | What::WarnToOk | What::WarnToError);
        for node in inside.into_iter().filter(|_| is_node) {
            let child = self.add(node, findings);
            self.units[index].children.extend(child);
        }
        Some(index)
    }

    /// Units by their paths, without those that were removed.
    pub fn by_path(&self) -> HashMap<&str, usize> {
        let units = self.units.iter().enumerate().filter(|(_, unit)| !unit.removed);
        let mut found = HashMap::new();
        for (index, unit) in units {
            if let Some((path, _)) = &unit.path {
                found.entry(path.as_str()).or_insert(index);
            }
        }
        found
    }

    /// The units that no other one contains, in the order of the files.
    pub fn roots(&self) -> Vec<usize> {
        let mut is_inside = vec![false; self.units.len()];
        for unit in self.units.iter().filter(|unit| !unit.removed) {
            unit.children.iter().for_each(|&child| is_inside[child] = true);
        }
        let is_root = |&index: &usize| {
            let unit = &self.units[index];
            !is_inside[index] && !unit.removed && !matches!(unit.what, What::Link(_))
        };
        (0..self.units.len()).filter(is_root).collect()
    }

    pub fn has_dependents(&self) -> bool {
        self.units.iter().any(|unit| unit.dependent.is_some())
    }

    /// The common name of a unit.
    pub fn name(&self, index: usize) -> String {
        let unit = &self.units[index];
        match (&unit.path, &unit.what) {
            (Some((path, _)), _) => path.clone(),
            (None, What::Diag { status, .. }) => status.clone(),
            (None, What::WarnToOk | What::WarnToError) if unit.children.len() == 1 => {
                self.name(unit.children[0])
            }
            (None, What::Or) => "any".into(),
            (None, _) => "all".into(),
        }
    }
}
