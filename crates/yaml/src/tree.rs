//! From the parser's events to a tree with places.

use std::collections::HashMap;

use granit_parser::{Event, Parser, ScalarStyle, ScanError, StrInput};

use super::decode::Log;
use super::problem::Problem;
use super::slips;
use super::source::{Sources, Span};

/// The nesting of collections. Groups nest far less deep.
const DEPTH_MAX: usize = 64;
/// Values that aliases may add in total: a small file must not become a large tree.
const ALIASED_NODES_MAX: usize = 100_000;

/// A value with its place.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    pub span: Span,
    pub kind: Kind,
}

#[derive(Debug, Clone, PartialEq)]
pub enum Kind {
    /// As written, after quotes and escapes; `plain` if it had no quotes.
    Scalar {
        text: String,
        plain: bool,
    },
    Sequence(Vec<Node>),
    /// In the order of the file, each key once.
    Mapping(Vec<(Key, Node)>),
}

#[derive(Debug, Clone, PartialEq)]
pub struct Key {
    pub text: String,
    pub span: Span,
}

impl Node {
    pub fn is_null(&self) -> bool {
        matches!(&self.kind, Kind::Scalar { text, plain: true } if matches!(text.as_str(), "" | "~" | "null"))
    }

    /// The value of a key of a map.
    pub fn get(&self, key: &str) -> Option<&Node> {
        let Kind::Mapping(entries) = &self.kind else { return None };
        entries.iter().find(|(found, _)| found.text == key).map(|(_, value)| value)
    }

    /// Its kind, for messages.
    pub fn describe(&self) -> String {
        match &self.kind {
            _ if self.is_null() => "nothing".into(),
            Kind::Scalar { text, .. } => format!("`{text}`"),
            Kind::Sequence(_) => "a list".into(),
            Kind::Mapping(_) => "a map of keys".into(),
        }
    }

    fn size(&self) -> usize {
        1 + match &self.kind {
            Kind::Scalar { .. } => 0,
            Kind::Sequence(items) => items.iter().map(Node::size).sum(),
            Kind::Mapping(entries) => entries.iter().map(|(_, value)| 1 + value.size()).sum(),
        }
    }
}

/// Parses one of the sources. Problems that leave a tree (a key that stands twice) are logged.
pub fn parse(sources: &Sources, file: u16, log: &mut Log) -> Option<Node> {
    let text = sources.text(file);
    let mut options = granit_parser::Options::default();
    options.flow_nesting_limit = DEPTH_MAX;
    options.block_nesting_limit = DEPTH_MAX;
    let parser = Parser::new_from_str_with_options(text, options);
    let mut tree = Tree { parser, text, file, anchors: HashMap::new(), aliased: 0, log };
    match tree.document() {
        Ok(node) => node,
        Err(problem) => {
            log.push(problem);
            None
        }
    }
}

struct Tree<'s, 'l> {
    parser: Parser<'s, StrInput<'s>>,
    text: &'s str,
    file: u16,
    /// Finished nodes that have an anchor.
    anchors: HashMap<usize, Node>,
    aliased: usize,
    log: &'l mut Log,
}

impl<'s> Tree<'s, '_> {
    fn document(&mut self) -> Result<Option<Node>, Problem> {
        loop {
            match self.next()? {
                (Event::StreamStart | Event::DocumentStart(..), _) => {}
                (Event::StreamEnd, _) => {
                    return Err(Problem::at(self.span(0, 0), "the file is empty"));
                }
                (event, span) => {
                    let node = self.node(event, span)?;
                    self.end()?;
                    return Ok(Some(node));
                }
            }
        }
    }

    /// Only one document is allowed.
    fn end(&mut self) -> Result<(), Problem> {
        loop {
            match self.next()? {
                (Event::StreamEnd, _) => return Ok(()),
                (Event::DocumentStart(..), span) => {
                    let problem = Problem::at(span, "a second document begins here");
                    return Err(problem.help("keep one document in a file: remove the `---`"));
                }
                _ => {}
            }
        }
    }

    fn node(&mut self, event: Event<'s>, span: Span) -> Result<Node, Problem> {
        let (anchor, kind) = match event {
            Event::Alias(id) => return self.alias(id, span),
            Event::Scalar(_, _, _, Some(_))
            | Event::SequenceStart(_, _, Some(_))
            | Event::MappingStart(_, _, Some(_)) => {
                let problem = Problem::at(span, "a value has a tag (`!...`), which means nothing here");
                return Err(problem.help(
                    "quote the whole value if the `!` belongs to it, such as CEL's not: `'!value'`; else remove the tag",
                ));
            }
            Event::Scalar(text, style, anchor, None) => {
                (anchor, Kind::Scalar { text: text.into_owned(), plain: style == ScalarStyle::Plain })
            }
            Event::SequenceStart(_, anchor, None) => (anchor, Kind::Sequence(self.sequence()?)),
            Event::MappingStart(_, anchor, None) => (anchor, Kind::Mapping(self.mapping()?)),
            other => return Err(Problem::at(span, format!("unexpected {other:?}"))),
        };
        let node = Node { span, kind };
        if anchor != 0 {
            self.anchors.insert(anchor, node.clone());
        }
        Ok(node)
    }

    fn alias(&mut self, id: usize, span: Span) -> Result<Node, Problem> {
        let Some(node) = self.anchors.get(&id) else {
            return Err(Problem::at(span, "this alias lies inside of what it refers to")
                .help("write the value out, or refer to another anchor"));
        };
        self.aliased += node.size();
        if self.aliased > ALIASED_NODES_MAX {
            return Err(Problem::at(
                span,
                format!("the aliases of this file stand for more than {ALIASED_NODES_MAX} values"),
            )
            .help("write the values out instead of nesting anchors"));
        }
        Ok(node.clone())
    }

    fn sequence(&mut self) -> Result<Vec<Node>, Problem> {
        let mut items = Vec::new();
        loop {
            match self.next()? {
                (Event::SequenceEnd, _) => return Ok(items),
                (event, span) => items.push(self.node(event, span)?),
            }
        }
    }

    fn mapping(&mut self) -> Result<Vec<(Key, Node)>, Problem> {
        let mut entries = Vec::new();
        let mut seen: HashMap<String, Span> = HashMap::new();
        loop {
            let key = match self.next()? {
                (Event::MappingEnd, _) => return Ok(entries),
                (event, span) => self.node(event, span)?,
            };
            let Kind::Scalar { text, .. } = key.kind else {
                return Err(Problem::at(key.span, "a key must be one word").help("write `key: value`"));
            };
            let key = Key { text, span: key.span };
            let (event, span) = self.next()?;
            let value = self.node(event, span)?;
            if let Some(&first) = seen.get(&key.text) {
                let problem =
                    Problem::at(key.span, format!("`{}` stands twice", key.text)).label("again here");
                self.log.push(problem.also(first, "first here").help("keep one of the two"));
                continue;
            }
            seen.insert(key.text.clone(), key.span);
            entries.push((key, value));
        }
    }

    fn next(&mut self) -> Result<(Event<'s>, Span), Problem> {
        match self.parser.next_event() {
            Some(Ok((event, span))) => {
                let start = span.start.byte_offset().unwrap_or_default();
                let end = span.end.byte_offset().unwrap_or(start);
                Ok((event, self.span(start, end)))
            }
            Some(Err(error)) => Err(self.syntax(&error)),
            None => Ok((Event::StreamEnd, self.span(self.text.len(), self.text.len()))),
        }
    }

    fn syntax(&self, error: &ScanError) -> Problem {
        let start = error.marker().byte_offset().unwrap_or(self.text.len());
        if let Some(tab) = slips::tab(self.text, start) {
            let problem = Problem::at(self.span(tab, tab + 1), "this is not YAML: a tab indents this line");
            return problem.label("a tab").help("use spaces: YAML allows no tab in an indentation");
        }
        if let Some(slip) = slips::unquoted(self.text, start) {
            let span = self.span(slip.start, slip.start + slip.value.len());
            if slip.nested {
                let problem = Problem::at(span, "this is not YAML: a second key on one line");
                let (key, inner) = (slip.key, slip.value);
                return problem.help(format!(
                    "write `{key}: {{ {inner} ... }}`, or `{inner}` on a line of its own below, further in than `{key}`"
                ));
            }
            let problem = Problem::at(span, "this is not YAML: a second `: ` in one value");
            return problem.help(format!("quote it: `{}: '{}'`", slip.key, slip.value.replace('\'', "''")));
        }
        let problem = Problem::at(self.span(start, start), format!("this is not YAML: {}", error.info()));
        problem.help("check the indentation, the quotes and the brackets here and in the line above")
    }

    /// A block collection has an empty span; then the span is its first character, so that a caret shows.
    /// The end of a plain scalar or a block collection may reach into the next line: it is cut there.
    fn span(&self, start: usize, end: usize) -> Span {
        let start = self.text.floor_char_boundary(start.min(self.text.len()));
        let rest = &self.text[start..];
        let first = rest.chars().next().filter(|&c| c != '\n').map_or(0, char::len_utf8);
        let line = rest.find('\n').unwrap_or(rest.len());
        let length =
            self.text.floor_char_boundary(end.max(start)).saturating_sub(start).clamp(first, line.max(first));
        Span { file: self.file, start: start as u32, end: (start + length) as u32 }
    }
}
