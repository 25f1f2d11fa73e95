//! Configurations of other diagnostics as Telltale's: diagnostic_aggregator's analyzers.yaml and Autoware's
//! diagnostic graphs. Text in, text and findings out; files are read through [`Sources`] alone.

mod aggregator;
mod autoware;
mod write;

use std::path::PathBuf;

use telltale_yaml::{Kind, Log, Node, Problem, Problems, Sources, Span, tree};

/// Facts that the sources alone do not give: of a graph, the files of its paths; of parameters, their node.
#[derive(Debug, Clone, Default)]
pub struct Lookup {
    /// The folders of packages, for `$(find-pkg-share NAME)`.
    pub packages: Vec<(String, PathBuf)>,
    /// Where packages are installed, as in AMENT_PREFIX_PATH.
    pub prefixes: Vec<PathBuf>,
    /// The values of `$(var NAME)`.
    pub variables: Vec<(String, String)>,
    /// The name of the aggregator's node, where a file has the parameters of several.
    pub node: Option<String>,
}

/// A configuration of Telltale, and what differs in it.
#[derive(Debug)]
pub struct Imported {
    pub format: &'static str,
    pub text: String,
    /// Errors are what could not be carried over, warnings what has another meaning.
    pub findings: Option<Problems>,
    /// How many things could not be carried over.
    pub lost: usize,
}

/// Imports some of the sources. Several are files of parameters that one node is given, in their order.
///
/// # Errors
///
/// A file is no YAML, has neither format, or they contain nothing to import.
pub fn import(mut sources: Sources, files: &[u16], lookup: &Lookup) -> Result<Imported, Problems> {
    let mut log = Log::default();
    let roots: Vec<Node> = files.iter().filter_map(|&file| tree::parse(&sources, file, &mut log)).collect();
    if roots.len() < files.len() || roots.is_empty() {
        return Err(Problems::new(sources, log.into_problems()));
    }
    let mut findings = Findings::default();
    log.into_problems().into_iter().for_each(|problem| findings.lost(problem));
    let names = files.iter().map(|&file| sources.name(file).to_owned()).collect::<Vec<_>>().join(", ");
    let made = match format_of(&roots) {
        Ok(Format::Analyzers) => aggregator::import(&names, &roots, lookup.node.as_deref(), &mut findings)
            .map(|text| ("diagnostic_aggregator's analyzers", text)),
        Ok(Format::Graph(root)) => {
            autoware::import(&mut sources, root.span.file, root.clone(), lookup, &mut findings)
                .map(|text| ("an Autoware diagnostic graph", text))
        }
        Err(problem) => Err(problem),
    };
    let lost = findings.count();
    let mut problems = findings.into_problems();
    match made {
        Ok((format, text)) => {
            let text = write::with_list(&text, &list(&sources, &problems));
            let findings = (!problems.is_empty()).then(|| Problems::new(sources, problems));
            Ok(Imported { format, text, findings, lost })
        }
        Err(problem) => {
            problems.push(problem);
            Err(Problems::new(sources, problems))
        }
    }
}

enum Format<'n> {
    Analyzers,
    Graph(&'n Node),
}

/// By the keys at the top.
fn format_of(roots: &[Node]) -> Result<Format<'_>, Problem> {
    let help = "give it the parameters of diagnostic_aggregator (`ros__parameters:` with analyzers in it), or a diagnostic graph of Autoware (`units:`, `files:`)";
    if roots.iter().any(aggregator::are_in) {
        return Ok(Format::Analyzers);
    }
    let [root, others @ ..] = roots else { return Ok(Format::Analyzers) };
    let Kind::Mapping(entries) = &root.kind else {
        let text = format!("expected a map of keys, found {}", root.describe());
        return Err(Problem::at(root.span, text).help(help));
    };
    let list = |name: &str| {
        let is_list = |value: &Node| matches!(value.kind, Kind::Sequence(_));
        entries.iter().find(|(key, value)| key.text == name && is_list(value))
    };
    if let Some((key, _)) = ["units", "files", "edits"].into_iter().find_map(list) {
        if !others.is_empty() {
            let problem = Problem::at(key.span, "this is a graph, and a graph is one file");
            return Err(problem.help("give only the file that names the others under `files`"));
        }
        return Ok(Format::Graph(root));
    }
    if let Some((key, _)) = list("groups") {
        let problem = Problem::at(key.span, "this is a configuration of Telltale already");
        return Err(problem.help("try `telltale check` with it"));
    }
    let place = entries.first().map_or(root.span, |(key, _)| key.span);
    Err(Problem::at(place, "these are neither analyzers nor a diagnostic graph").help(help))
}

/// The findings as lines of a comment.
fn list(sources: &Sources, problems: &[Problem]) -> Vec<String> {
    let mut sorted: Vec<&Problem> = problems.iter().collect();
    sorted.sort_by_key(|problem| problem.span);
    let mut lines = Vec::new();
    for (title, warning) in [("Not carried over:", false), ("With another meaning, or worth a look:", true)] {
        let of_kind = sorted.iter().filter(|problem| problem.warning == warning);
        let all: Vec<String> = of_kind
            .map(|problem| match problem.span {
                Some(span) => format!("  {}: {}", sources.place(span), problem.message),
                None => format!("  {}", problem.message),
            })
            .collect();
        if !all.is_empty() {
            lines.push(String::new());
            lines.push(title.to_owned());
            lines.extend(all);
        }
    }
    lines
}

/// `analyzers.yaml:12`: where the source says something, for comments in the result.
fn line(sources: &Sources, span: Span) -> String {
    sources.place(span)
}

/// Findings beyond this many are counted, not kept.
const FINDINGS_MAX: usize = 1000;

/// The findings of an import: parts that could not be carried over, and parts with another meaning.
#[derive(Debug, Default)]
struct Findings {
    list: Vec<Problem>,
    lost: usize,
}

impl Findings {
    /// Something could not be carried over.
    fn lost(&mut self, problem: Problem) {
        self.lost += 1;
        self.keep(problem);
    }

    /// Something means another thing here.
    fn differs(&mut self, problem: Problem) {
        self.keep(problem.as_warning());
    }

    fn keep(&mut self, problem: Problem) {
        if self.list.len() < FINDINGS_MAX {
            self.list.push(problem);
        }
    }

    fn count(&self) -> usize {
        self.lost
    }

    fn into_problems(self) -> Vec<Problem> {
        self.list
    }
}

#[cfg(test)]
mod tests;
