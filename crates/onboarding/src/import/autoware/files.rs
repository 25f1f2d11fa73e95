//! The files of a graph, with the substitutions in their paths.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use super::unit::{Edit, Graph};
use crate::import::Findings;
use crate::import::Lookup;
use telltale_yaml::decode::scalar;
use telltale_yaml::{Kind, Log, Node, Problem, Sources, Span, tree};

/// More files than any graph has.
const FILES_MAX: usize = 1000;

/// Reads the units of a file and of the files that it names.
pub(super) fn read(
    sources: &mut Sources,
    file: u16,
    root: Node,
    lookup: &Lookup,
    graph: &mut Graph,
    findings: &mut Findings,
) {
    let mut seen: HashSet<PathBuf> = HashSet::from([identity(Path::new(sources.name(file)))]);
    let mut waiting = vec![(file, root)];
    while let Some((file, root)) = waiting.pop() {
        let folder = Path::new(sources.name(file)).parent().unwrap_or(Path::new("")).to_owned();
        let mut named = Vec::new();
        for item in list(&root, "files", findings) {
            let Some(path) = item.get("path").and_then(|node| Some((scalar(node)?, node.span))) else {
                findings.lost(
                    Problem::at(item.span, "this names no file")
                        .help("write `{ path: $(dirname)/NAME.yaml }`"),
                );
                continue;
            };
            if seen.len() >= FILES_MAX {
                findings.lost(
                    Problem::at(path.1, format!("there are more than {FILES_MAX} files"))
                        .help("import parts of the graph"),
                );
                break;
            }
            named.extend(open(sources, &folder, path, lookup, &mut seen, findings));
        }
        // The files that it names come after it, in their order.
        waiting.extend(named.into_iter().rev());
        for item in list(&root, "edits", findings) {
            edit(item, graph, findings);
        }
        for item in list(&root, "units", findings) {
            let unit = graph.add(item, findings);
            graph.tops.extend(unit);
        }
    }
}

fn list<'n>(root: &'n Node, key: &str, findings: &mut Findings) -> &'n [Node] {
    match root.get(key) {
        None => &[],
        Some(node) => match &node.kind {
            Kind::Sequence(items) => items,
            _ if node.is_null() => &[],
            _ => {
                let problem = Problem::at(node.span, format!("`{key}` is no list, but {}", node.describe()));
                findings.lost(problem.help("write each item in a line of its own after `- `"));
                &[]
            }
        },
    }
}

fn edit(item: &Node, graph: &mut Graph, findings: &mut Findings) {
    let text = |key: &str| item.get(key).and_then(scalar).map(str::to_owned).filter(|text| !text.is_empty());
    match text("type").as_deref() {
        Some("remove") => {
            graph.edits.push(Edit { span: item.span, regex: text("regex"), path: text("path") })
        }
        other => {
            let text =
                other.map_or("this edit has no `type`".into(), |other| format!("there is no edit `{other}`"));
            findings.lost(Problem::at(item.span, text).help("write `{ type: remove, path: /PATH }`"));
        }
    }
}

/// Opens a file that a graph names. `None`: the findings say why.
fn open(
    sources: &mut Sources,
    folder: &Path,
    (written, span): (&str, Span),
    lookup: &Lookup,
    seen: &mut HashSet<PathBuf>,
    findings: &mut Findings,
) -> Option<(u16, Node)> {
    let candidates = match resolve(written, folder, lookup) {
        Ok(candidates) => candidates,
        Err((what, help)) => {
            findings.lost(Problem::at(span, what).help(help));
            return None;
        }
    };
    let mut refused = None;
    for path in candidates {
        let identity = identity(&path);
        if seen.contains(&identity) {
            let problem = Problem::at(span, format!("`{}` is in the graph already", path.display()));
            findings.lost(problem.help("it is read once: files must not name one another in a circle"));
            return None;
        }
        if path.exists() && !path.is_file() {
            // To read a pipe or a device may last for ever.
            refused = Some(Problem::of_file(&path.display().to_string(), "is no file", "name a file"));
            continue;
        }
        match sources.read(&path) {
            Ok(file) => {
                seen.insert(identity);
                let mut log = Log::default();
                let root = tree::parse(sources, file, &mut log);
                log.into_problems().into_iter().for_each(|problem| findings.lost(problem));
                return root.map(|root| (file, root));
            }
            Err(problem) => refused = Some(problem),
        }
    }
    let what = refused.map_or_else(|| format!("`{written}` names no file"), |problem| problem.message);
    findings
        .lost(Problem::at(span, what).help("its units are missing here: check the path, and import again"));
    None
}

/// The paths that may be meant, the first that exists is.
fn resolve(written: &str, folder: &Path, lookup: &Lookup) -> Result<Vec<PathBuf>, (String, String)> {
    let mut texts = vec![written.to_owned()];
    // Each round replaces the innermost substitution, which is the last one that opens.
    for _ in 0..32 {
        let Some(start) = texts[0].rfind("$(") else {
            return Ok(texts.into_iter().map(|text| tidy(&folder.join(text))).collect());
        };
        let Some(length) = texts[0][start..].find(')') else {
            return Err((format!("`{written}` lacks a `)`"), "write `$(dirname)/NAME.yaml`".into()));
        };
        let inside = texts[0][start + 2..start + length].to_owned();
        let values = substitution(&inside, folder, lookup)?;
        let (before, after) = (&texts[0][..start], &texts[0][start + length + 1..]);
        texts = values.iter().map(|value| format!("{before}{value}{after}")).collect();
    }
    Err((format!("`{written}` has too many substitutions"), "write the path out".into()))
}

fn substitution(inside: &str, folder: &Path, lookup: &Lookup) -> Result<Vec<String>, (String, String)> {
    let words: Vec<&str> = inside.split_whitespace().collect();
    let text = |path: PathBuf| path.display().to_string();
    match words[..] {
        // Relative paths are joined to the folder anyway.
        ["dirname"] if folder.as_os_str().is_empty() => Ok(vec![".".into()]),
        ["dirname"] if folder.is_relative() => Ok(vec![text(Path::new(".").to_owned())]),
        ["dirname"] => Ok(vec![text(folder.to_owned())]),
        ["var", name] => match lookup.variables.iter().find(|(known, _)| known == name) {
            Some((_, value)) => Ok(vec![value.clone()]),
            None => Err((
                format!("the variable `{name}` has no value"),
                format!("give it one: `telltale import --var {name}=VALUE`"),
            )),
        },
        ["find-pkg-share", package] => {
            let given =
                lookup.packages.iter().filter(|(known, _)| known == package).map(|(_, path)| path.clone());
            let installed = lookup.prefixes.iter().map(|prefix| prefix.join("share").join(package));
            let found: Vec<String> = given.chain(installed).map(text).collect();
            match found.is_empty() {
                false => Ok(found),
                true => Err((
                    format!("where the package `{package}` is installed is not known"),
                    format!(
                        "source the workspace, or name its folder: `telltale import --package {package}=DIR`"
                    ),
                )),
            }
        }
        _ => Err((
            format!("there is no substitution `$({inside})`"),
            "known: `$(dirname)`, `$(find-pkg-share PACKAGE)`, `$(var NAME)`".into(),
        )),
    }
}

/// The same for all names of one file.
fn identity(path: &Path) -> PathBuf {
    path.canonicalize().unwrap_or_else(|_| tidy(path))
}

/// The path without `.` and `..`, as far as its text shows.
fn tidy(path: &Path) -> PathBuf {
    use std::path::Component;
    let mut out = PathBuf::new();
    for part in path.components() {
        match part {
            Component::CurDir => {}
            Component::ParentDir if out.file_name().is_some() => {
                out.pop();
            }
            other => out.push(other),
        }
    }
    out
}
