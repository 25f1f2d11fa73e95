//! The parameters of one node from the sections of several files, put together as ROS 2 does it: sections of the node
//! and of patterns such as `/**` in the order in which their names first appear; what comes later counts.

use std::collections::HashMap;

use super::parameters::Parameters;
use crate::import::Findings;
use telltale_yaml::decode::scalar;
use telltale_yaml::{Kind, Node, Problem, Span};

/// The key below which a file for ROS 2 has the parameters of a node.
const MARK: &str = "ros__parameters";

/// The parts of a name with dots, beyond which an analyzer would nest deeper than a configuration may.
const PARTS_MAX: usize = 24;

/// The section of a file without names of nodes, as ROS 1 had them: it is for every node.
const ANY: &str = "/**";

/// A part of a parameter's name.
#[derive(Debug, Clone)]
pub(super) struct Name {
    pub text: String,
    pub span: Span,
}

/// The parameters of a node, or of all nodes with a name of this pattern.
#[derive(Debug)]
struct Section<'n> {
    /// With a `/` in front.
    name: String,
    span: Span,
    parameters: Vec<(Vec<Name>, &'n Node)>,
    /// The position of each parameter, by its name with dots.
    index: HashMap<String, usize>,
}

/// Whether a file has parameters, for ROS 2 or with analyzers in them as for ROS 1.
pub(in crate::import) fn are_in(root: &Node) -> bool {
    is_marked(root) || !analyzers_of_ros_1(root).is_empty()
}

/// The parameters of the aggregator. `wanted` is its name; without it, it is the first node with analyzers.
///
/// # Errors
///
/// No section is for the wanted node.
pub(super) fn aggregator<'n>(
    roots: &'n [Node],
    wanted: Option<&str>,
    findings: &mut Findings,
) -> Result<Parameters<'n>, Problem> {
    let mut sections = Vec::new();
    for root in roots {
        match is_marked(root) {
            true => marked(root, "", &mut sections, findings),
            false => unmarked(root, &mut sections, findings),
        }
    }
    let wanted = wanted.map(|name| format!("/{}", name.trim_matches('/')));
    let node = wanted.clone().or_else(|| aggregator_among(&sections));
    let is_of_node = |section: &&Section| node.as_ref().is_none_or(|node| matches(&section.name, node));
    let nowhere = Span { file: 0, start: 0, end: 0 };
    let mut all = Section::new(String::new(), roots.first().map_or(nowhere, |root| root.span));
    for section in sections.iter().filter(is_of_node) {
        if all.parameters.is_empty() {
            all.span = section.span;
        }
        section.parameters.iter().for_each(|(name, value)| _ = all.put(name.clone(), value));
    }
    let others: Vec<&Section> = sections.iter().filter(|section| !is_of_node(section)).collect();
    if let (true, Some(wanted)) = (all.parameters.is_empty(), &wanted) {
        let names = others.iter().map(|section| format!("`{}`", section.name)).collect::<Vec<_>>();
        let problem = Problem::at(all.span, format!("there are no parameters of the node `{wanted}`"));
        return Err(problem.help(format!("there are those of {}", names.join(", "))));
    }
    for section in others {
        left_out(section, node.as_deref().unwrap_or_default(), wanted.is_some(), findings);
    }
    Ok(all.tree())
}

/// Analyzers of another node are lost, unless somebody asked for this one.
fn left_out(section: &Section, node: &str, is_asked: bool, findings: &mut Findings) {
    let text = format!("the parameters of `{}` are not those of `{node}`", section.name);
    let problem = Problem::at(section.span, text);
    match section.has_analyzers() && !is_asked {
        true => findings.lost(problem.help(format!(
            "they are left out: import that node with `--node {}` into a file of its own",
            section.name
        ))),
        false => findings.differs(problem.help("they are left out; `--node NAME` names another node")),
    }
}

/// The first node with analyzers, else that which is called as an aggregator is. `None`: all sections are patterns.
fn aggregator_among(sections: &[Section]) -> Option<String> {
    let mut nodes = sections.iter().filter(|section| !section.name.contains('*'));
    let is_called_so = |section: &&Section| {
        let name = section.name.rsplit('/').next().unwrap_or_default();
        name == "analyzers" || name.contains("aggregator")
    };
    let found = nodes.clone().find(|section| section.has_analyzers()).or_else(|| nodes.find(is_called_so));
    found.map(|section| section.name.clone())
}

/// Whether a section is for the node: `*` stands for one part of its name, `**` for any number of them.
fn matches(pattern: &str, node: &str) -> bool {
    fn parts(name: &str) -> impl Iterator<Item = &str> {
        name.split('/').filter(|part| !part.is_empty())
    }
    let node: Vec<&str> = parts(node).collect();
    // Whether the pattern so far is for the first parts of the name, by their number.
    let mut fits = vec![false; node.len() + 1];
    fits[0] = true;
    for part in parts(pattern) {
        let fits_now = |taken: usize| match part {
            "**" => fits[..=taken].contains(&true),
            _ => taken > 0 && fits[taken - 1] && (part == "*" || part == node[taken - 1]),
        };
        fits = (0..fits.len()).map(fits_now).collect();
    }
    fits[node.len()]
}

impl<'n> Section<'n> {
    fn new(name: String, span: Span) -> Section<'n> {
        Section { name, span, parameters: Vec::new(), index: HashMap::new() }
    }

    /// Returns the place of the earlier value that this one replaces.
    fn put(&mut self, name: Vec<Name>, value: &'n Node) -> Option<Span> {
        let whole = name.iter().map(|part| &*part.text).collect::<Vec<_>>().join(".");
        match self.index.get(&whole) {
            Some(&at) => {
                let (_, before) = std::mem::replace(&mut self.parameters[at], (name, value));
                Some(before.span)
            }
            None => {
                self.index.insert(whole, self.parameters.len());
                self.parameters.push((name, value));
                None
            }
        }
    }

    /// Takes all parameters in a map, each with its whole name.
    fn take(&mut self, around: &[Name], map: &'n Node, findings: &mut Findings) {
        let Kind::Mapping(entries) = &map.kind else {
            if !map.is_null() {
                let problem = Problem::at(map.span, format!("expected parameters, found {}", map.describe()));
                findings.lost(problem.help("write a map: `NAME: VALUE`"));
            }
            return;
        };
        for (key, value) in entries {
            let parts = key.text.split('.').map(|part| Name { text: part.to_owned(), span: key.span });
            let name: Vec<Name> = around.iter().cloned().chain(parts).collect();
            match &value.kind {
                _ if name.len() > PARTS_MAX => {
                    let text = format!("this name has more than {PARTS_MAX} parts");
                    findings.lost(Problem::at(key.span, text).help("nest the analyzers less deep"));
                }
                Kind::Mapping(inner) if inner.is_empty() => {
                    let problem = Problem::at(key.span, format!("`{}` is empty", key.text));
                    findings.differs(problem.help("it has no effect, here as in ROS"));
                }
                Kind::Mapping(_) => self.take(&name, value, findings),
                _ => {
                    if let Some(before) = self.put(name, value).filter(|it| it.file == value.span.file) {
                        let problem = Problem::at(value.span, format!("`{}` is given again", key.text));
                        let problem = problem.label("this counts").also(before, "not this");
                        findings.differs(problem.help("keep one of the two"));
                    }
                }
            }
        }
    }

    fn tree(&self) -> Parameters<'n> {
        let mut tree = Parameters::new(self.span);
        self.parameters.iter().for_each(|(name, value)| tree.put(name, value));
        tree
    }

    fn has_analyzers(&self) -> bool {
        self.tree().has_analyzers()
    }
}

/// The section with this name, a new one if there is none.
fn section<'s, 'n>(sections: &'s mut Vec<Section<'n>>, name: &str, span: Span) -> &'s mut Section<'n> {
    let at = sections.iter().position(|section| section.name == name).unwrap_or_else(|| {
        sections.push(Section::new(name.to_owned(), span));
        sections.len() - 1
    });
    &mut sections[at]
}

fn is_marked(node: &Node) -> bool {
    let Kind::Mapping(entries) = &node.kind else { return false };
    entries.iter().any(|(key, value)| key.text == MARK || is_marked(value))
}

/// The sections of a file for ROS 2: the name of the node stands around its parameters, perhaps with a namespace.
fn marked<'n>(node: &'n Node, around: &str, sections: &mut Vec<Section<'n>>, findings: &mut Findings) {
    let Kind::Mapping(entries) = &node.kind else { return };
    for (key, value) in entries {
        if key.text == MARK {
            let name = if around.is_empty() { ANY } else { around };
            section(sections, name, key.span).take(&[], value, findings);
        } else if is_marked(value) {
            let name = format!("{around}/{}", key.text.trim_matches('/'));
            marked(value, &name, sections, findings);
        } else {
            let problem = Problem::at(key.span, format!("`{}` stands outside of `{MARK}`", key.text));
            findings
                .lost(problem.help("it is left out, as ROS 2 does not load it: move it into the parameters"));
        }
    }
}

/// A file as ROS 1 had them: the parameters of the aggregator at the top, or with names of nodes around them.
fn unmarked<'n>(root: &'n Node, sections: &mut Vec<Section<'n>>, findings: &mut Findings) {
    let found = analyzers_of_ros_1(root);
    let Kind::Mapping(entries) = &root.kind else {
        return section(sections, ANY, root.span).take(&[], root, findings);
    };
    if found.iter().any(|(name, _)| name.is_empty()) || found.is_empty() {
        return section(sections, ANY, root.span).take(&[], root, findings);
    }
    for (name, node) in &found {
        section(sections, name, node.span).take(&[], node, findings);
    }
    let is_around = |key: &str| found.iter().any(|(name, _)| name.split('/').nth(1) == Some(key));
    for (key, value) in entries {
        let name = key.text.trim_matches('/');
        match &value.kind {
            _ if is_around(name) => {}
            Kind::Mapping(_) => section(sections, &format!("/{name}"), key.span).take(&[], value, findings),
            _ => {
                let problem = Problem::at(key.span, format!("`{}` stands outside of the node", key.text));
                findings.lost(problem.help("it is left out: move it to the parameters of the node"));
            }
        }
    }
}

/// The maps with analyzers in a file of ROS 1, each with the names around it.
fn analyzers_of_ros_1(root: &Node) -> Vec<(String, &Node)> {
    fn below<'n>(node: &'n Node, name: &str, found: &mut Vec<(String, &'n Node)>) {
        let Kind::Mapping(entries) = &node.kind else { return };
        if entries.iter().any(|(key, value)| is_analyzer(value) || key.text == "analyzers" && has_maps(value))
        {
            return found.push((name.to_owned(), node));
        }
        for (key, value) in entries {
            below(value, &format!("{name}/{}", key.text.trim_matches('/')), found);
        }
    }
    let mut found = Vec::new();
    below(root, "", &mut found);
    found
}

/// A map with the type of an analyzer.
fn is_analyzer(node: &Node) -> bool {
    let ends = |text: &str| text.ends_with("Analyzer") || text.ends_with("AnalyzerGroup");
    node.get("type").and_then(scalar).is_some_and(ends)
}

fn has_maps(node: &Node) -> bool {
    let Kind::Mapping(entries) = &node.kind else { return false };
    entries.iter().any(|(_, value)| matches!(value.kind, Kind::Mapping(_)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_star_is_one_part_of_a_name_and_two_are_any_number() {
        for (pattern, node, expected) in [
            ("/**", "/analyzers", true),
            ("/**", "/robot/analyzers", true),
            ("/*", "/robot/analyzers", false),
            ("/*/analyzers", "/robot/analyzers", true),
            ("/**/analyzers", "/analyzers", true),
            ("/robot/**", "/robot/a/b", true),
            ("/robot/**", "/other/a", false),
            ("/analyzers", "/analyzers", true),
            ("/analyzers", "/robot/analyzers", false),
        ] {
            assert_eq!(matches(pattern, node), expected, "{pattern} {node}");
        }
    }
}
