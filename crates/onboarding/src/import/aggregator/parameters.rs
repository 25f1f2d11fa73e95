//! Parameters of a ROS node as a tree: names with dots and maps in maps are the same.

use super::sections::Name;
use crate::import::Findings;
use telltale_yaml::decode::scalar;
use telltale_yaml::{Kind, Node, Problem, Span};

/// A map of parameters. A name may be a parameter and a map at once, as in `analyzers: [a]` beside `analyzers.a.type`.
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

impl<'n> Parameters<'n> {
    pub fn new(span: Span) -> Parameters<'n> {
        Parameters { span, entries: Vec::new() }
    }

    /// Puts the value at its name; each name comes once.
    pub fn put(&mut self, name: &[Name], value: &'n Node) {
        let (first, rest) = match name {
            [] => return,
            [first, rest @ ..] => (first, rest),
        };
        if rest.is_empty() {
            let entry = Entry { key: first.text.clone(), span: first.span, value: Value::Leaf(value) };
            return self.entries.push(entry);
        }
        let is_map = |entry: &Entry| entry.key == first.text && matches!(entry.value, Value::Map(_));
        let at = self.entries.iter().position(is_map).unwrap_or_else(|| {
            let value = Value::Map(Parameters::new(first.span));
            self.entries.push(Entry { key: first.text.clone(), span: first.span, value });
            self.entries.len() - 1
        });
        if let Value::Map(map) = &mut self.entries[at].value {
            map.put(rest, value);
        }
    }

    /// The parameter with this name.
    pub fn leaf(&self, key: &str) -> Option<&'n Node> {
        self.entries.iter().filter(|entry| entry.key == key).find_map(|entry| match entry.value {
            Value::Leaf(node) => Some(node),
            Value::Map(_) => None,
        })
    }

    pub fn get(&self, key: &str) -> Option<&Entry<'n>> {
        self.entries.iter().find(|entry| entry.key == key)
    }

    /// Whether it is an analyzer.
    pub fn has_type(&self) -> bool {
        self.leaf("type").is_some()
    }

    /// Whether analyzers are directly in it, or below `analyzers`.
    pub fn has_analyzers(&self) -> bool {
        self.entries.iter().any(|entry| match &entry.value {
            Value::Map(map) => map.has_type() || entry.key == "analyzers" && map.has_analyzers(),
            Value::Leaf(_) => false,
        })
    }

    /// A text that is not empty.
    pub fn text(&self, key: &str) -> Option<(String, Span)> {
        let node = self.leaf(key)?;
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
        let Some(node) = self.leaf(key) else {
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
