//! Parameters of a ROS node as they stand in YAML: maps in maps, or names with dots.

use crate::import::findings::Findings;
use telltale_yaml::decode::scalar;
use telltale_yaml::{Kind, Node, Problem, Span};

/// A map of parameters.
#[derive(Debug)]
pub(in crate::import) struct Parameters<'n> {
    pub span: Span,
    pub entries: Vec<Entry<'n>>,
}

#[derive(Debug)]
pub(in crate::import) struct Entry<'n> {
    pub key: String,
    pub span: Span,
    pub value: Value<'n>,
}

#[derive(Debug)]
pub(in crate::import) enum Value<'n> {
    Map(Parameters<'n>),
    Leaf(&'n Node),
}

/// The parameters with analyzers in a file: below `ros__parameters`, or at the top as in ROS 1.
pub(in crate::import) fn parameters(root: &Node) -> Option<Parameters<'_>> {
    let mut found = Vec::new();
    below(root, &mut found);
    let all: Vec<Parameters> = found.into_iter().map(Parameters::of).collect();
    let is_full = |parameters: &Parameters| parameters.has_analyzers();
    if !all.is_empty() {
        let at = all.iter().position(is_full).unwrap_or(0);
        return all.into_iter().nth(at);
    }
    let top = Parameters::of(root);
    let is_map = |entry: &Entry| matches!(entry.value, Value::Map(_));
    (top.get("analyzers").is_some_and(is_map) || top.has_analyzers()).then_some(top)
}

/// The maps below `ros__parameters`. The name of the node stands around it, perhaps with a namespace.
fn below<'n>(node: &'n Node, found: &mut Vec<&'n Node>) {
    let Kind::Mapping(entries) = &node.kind else { return };
    for (key, value) in entries {
        if key.text == "ros__parameters" {
            found.push(value);
        } else {
            below(value, found);
        }
    }
}

impl<'n> Parameters<'n> {
    fn of(node: &'n Node) -> Parameters<'n> {
        let mut map = Parameters { span: node.span, entries: Vec::new() };
        if let Kind::Mapping(entries) = &node.kind {
            for (key, value) in entries {
                map.put(&key.text, key.span, value);
            }
        }
        map
    }

    /// Puts `a.b: value` where `a: { b: value }` would be.
    fn put(&mut self, key: &str, span: Span, value: &'n Node) {
        let (first, rest) = key.split_once('.').map_or((key, None), |(first, rest)| (first, Some(rest)));
        let known = self.entries.iter().position(|entry| entry.key == first);
        let inner = match (rest, &value.kind) {
            (None, Kind::Mapping(_)) => Value::Map(Parameters::of(value)),
            (None, _) => Value::Leaf(value),
            (Some(_), _) => Value::Map(Parameters { span, entries: Vec::new() }),
        };
        let at = known.unwrap_or(self.entries.len());
        if known.is_none() {
            self.entries.push(Entry { key: first.to_owned(), span, value: inner });
        } else if let (Value::Map(map), Value::Map(more)) = (&mut self.entries[at].value, inner) {
            map.entries.extend(more.entries);
        }
        if let (Some(rest), Value::Map(map)) = (rest, &mut self.entries[at].value) {
            map.put(rest, span, value);
        }
    }

    pub fn get(&self, key: &str) -> Option<&Entry<'n>> {
        self.entries.iter().find(|entry| entry.key == key)
    }

    fn has_analyzers(&self) -> bool {
        self.entries.iter().any(|entry| match &entry.value {
            Value::Map(map) => map.get("type").is_some() || entry.key == "analyzers" && map.has_analyzers(),
            Value::Leaf(_) => false,
        })
    }

    /// A text that is not empty.
    pub fn text(&self, key: &str) -> Option<(String, Span)> {
        let entry = self.get(key)?;
        let Value::Leaf(node) = entry.value else { return None };
        scalar(node).filter(|text| !text.is_empty()).map(|text| (text.to_owned(), node.span))
    }

    pub fn number(&self, key: &str, findings: &mut Findings) -> Option<(f64, Span)> {
        if let Some(entry) = self.get(key)
            && self.text(key).is_none()
        {
            let problem = Problem::at(entry.span, format!("`{key}` is no number"));
            findings.lost(problem.help("write one, as in `5.0`"));
        }
        let (text, span) = self.text(key)?;
        let number = text.parse::<f64>().ok().filter(|number| number.is_finite());
        if number.is_none() {
            findings.lost(
                Problem::at(span, format!("`{key}` is no number: `{text}`")).help("write one, as in `5.0`"),
            );
        }
        number.map(|number| (number, span))
    }

    pub fn flag(&self, key: &str, findings: &mut Findings) -> Option<bool> {
        let (text, span) = self.text(key)?;
        match text.to_ascii_lowercase().as_str() {
            "true" | "yes" | "on" => Some(true),
            "false" | "no" | "off" => Some(false),
            _ => {
                let problem = Problem::at(span, format!("`{key}` is neither true nor false: `{text}`"));
                findings.lost(problem.help("write `true` or `false`"));
                None
            }
        }
    }

    /// A list of texts, or one text.
    pub fn texts(&self, key: &str, findings: &mut Findings) -> Option<Vec<(String, Span)>> {
        let entry = self.get(key)?;
        let Value::Leaf(node) = entry.value else {
            let problem = Problem::at(entry.span, format!("`{key}` is a map, not a list of texts"));
            findings.lost(problem.help("write `['one', 'two']`"));
            return None;
        };
        let items = match &node.kind {
            Kind::Sequence(items) => &items[..],
            _ if node.is_null() => &[],
            _ => std::slice::from_ref(node),
        };
        let mut texts = Vec::new();
        for item in items {
            match scalar(item) {
                Some(text) => texts.push((text.to_owned(), item.span)),
                None => {
                    let problem = Problem::at(
                        item.span,
                        format!("in `{key}`: expected a text, found {}", item.describe()),
                    );
                    findings.lost(problem.help("write `['one', 'two']`"));
                }
            }
        }
        Some(texts)
    }
}
