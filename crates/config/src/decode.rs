//! Converts the tree into types. Problems are logged and decoding continues.

use telltale_yaml::decode::{mapping, scalar, word};
use telltale_yaml::tree::Key;
use telltale_yaml::{Kind, Log, Members, Node, Problem, Schema, Span, schema};

/// A type that is read from a node. `None` if it could not be read; the log says why.
pub trait FromNode: Sized {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self>;

    /// How it is written, for the schema. By default it is a map, whose decoder describes it.
    fn form(schema: &mut Schema) -> Members {
        schema.decoder(Self::from_node)
    }
}

/// A value with its place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spanned<T> {
    pub value: T,
    pub span: Span,
}

impl<T: FromNode> FromNode for Spanned<T> {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        T::from_node(node, log).map(|value| Spanned { value, span: node.span })
    }

    fn form(schema: &mut Schema) -> Members {
        T::form(schema)
    }
}

impl<T: FromNode> FromNode for Vec<T> {
    /// Items that could not be read are left out. A key without a value is an empty list.
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        match &node.kind {
            Kind::Sequence(items) => Some(items.iter().filter_map(|item| T::from_node(item, log)).collect()),
            _ if node.is_null() => Some(Vec::new()),
            _ => {
                let problem = Problem::at(node.span, format!("expected a list, found {}", node.describe()));
                log.push(problem.help("write `[one, two]`, or each item in a line of its own after `- `"));
                None
            }
        }
    }

    fn form(schema: &mut Schema) -> Members {
        schema::list(T::form(schema))
    }
}

/// A list that is `None` if one of its items cannot be read.
#[derive(Debug, Clone, PartialEq)]
pub struct All<T>(pub Vec<T>);

impl<T: FromNode> FromNode for All<T> {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let items: Vec<T> = Vec::from_node(node, log)?;
        let written = if let Kind::Sequence(written) = &node.kind { written.len() } else { 0 };
        (items.len() == written).then_some(All(items))
    }

    fn form(schema: &mut Schema) -> Members {
        Vec::<T>::form(schema)
    }
}

impl FromNode for String {
    /// Any text but an empty one; a number counts as text.
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        match &node.kind {
            Kind::Scalar { text, .. } if !text.trim().is_empty() && !node.is_null() => Some(text.clone()),
            Kind::Scalar { .. } => {
                log.push(Problem::at(node.span, "expected a text, found nothing").help("write a value"));
                None
            }
            _ => {
                let problem = Problem::at(node.span, format!("expected a text, found {}", node.describe()));
                log.push(problem.help("quote it with '...' if it is meant as a text"));
                None
            }
        }
    }

    fn form(_: &mut Schema) -> Members {
        schema::of_type("string")
    }
}

impl FromNode for bool {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        word(node, log, "truth value", &[("true", true), ("false", false)])
    }

    fn form(_: &mut Schema) -> Members {
        schema::of_type("boolean")
    }
}

impl FromNode for u64 {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let number = scalar(node).and_then(|text| text.parse().ok());
        if number.is_none() {
            let problem =
                Problem::at(node.span, format!("expected a whole number, found {}", node.describe()));
            log.push(problem.help("write digits only, for example `12`"));
        }
        number
    }

    fn form(_: &mut Schema) -> Members {
        schema::of_type("integer")
    }
}

impl FromNode for f64 {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let number =
            scalar(node).and_then(|text| text.parse().ok()).filter(|number: &f64| number.is_finite());
        if number.is_none() {
            let problem = Problem::at(node.span, format!("expected a number, found {}", node.describe()));
            let percent = scalar(node).and_then(|text| text.strip_suffix('%')?.trim().parse::<f64>().ok());
            let with_unit = scalar(node).and_then(|text| text.split_once(' '));
            let with_unit = with_unit.filter(|(number, _)| number.parse().is_ok_and(f64::is_finite));
            log.push(problem.help(match (percent.filter(|percent| percent.is_finite()), with_unit) {
                (Some(percent), _) => format!(
                    "write the number alone, in the unit of the value: `{percent}`, or `{}` where it goes from 0 to 1",
                    percent / 100.0
                ),
                (None, Some((number, _))) => {
                    format!("write the number alone, in the unit of the value: `{number}`")
                }
                _ if scalar(node).is_some_and(|text| text.starts_with(char::is_alphabetic)) => {
                    "write the number that is meant: the definition of a message has those of its names".into()
                }
                (None, None) => "write digits with a point, for example `12.5`".into(),
            }));
        }
        number
    }

    fn form(_: &mut Schema) -> Members {
        schema::of_type("number")
    }
}

/// A map with free keys.
#[derive(Debug, Clone)]
pub struct Entries<T>(pub Vec<(Key, T)>);

impl<T> Default for Entries<T> {
    fn default() -> Self {
        Entries(Vec::new())
    }
}

impl<T: FromNode> FromNode for Entries<T> {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        if node.is_null() {
            return Some(Entries::default());
        }
        let entries = mapping(node, "names with values", log)?;
        let read = |(key, value): &(Key, Node)| T::from_node(value, log).map(|value| (key.clone(), value));
        Some(Entries(entries.iter().filter_map(read).collect()))
    }

    fn form(schema: &mut Schema) -> Members {
        schema::entries(T::form(schema))
    }
}

/// A map with free keys that is `None` if one of its entries cannot be read.
#[derive(Debug, Clone)]
pub struct AllEntries<T>(pub Vec<(Key, T)>);

impl<T: FromNode> FromNode for AllEntries<T> {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let Entries(entries) = Entries::from_node(node, log)?;
        let written = if let Kind::Mapping(written) = &node.kind { written.len() } else { 0 };
        (entries.len() == written).then_some(AllEntries(entries))
    }

    fn form(schema: &mut Schema) -> Members {
        Entries::<T>::form(schema)
    }
}
