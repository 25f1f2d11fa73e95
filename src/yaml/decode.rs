//! Converts the tree into types. Problems are logged and decoding continues.

use super::problem::Problem;
use super::schema;
use super::schema::{Members, Schema};
use super::source::Span;
use super::tree::{Key, Kind, Node};

/// Collects problems, or the schema of what is decoded.
#[derive(Debug, Default)]
pub struct Log {
    problems: Vec<Problem>,
    /// Present while decoders describe themselves; problems do not count then.
    pub(super) schema: Option<Schema>,
}

impl Log {
    pub(super) fn describing(schema: Schema) -> Log {
        Log { problems: Vec::new(), schema: Some(schema) }
    }

    pub(super) fn into_schema(self) -> Schema {
        self.schema.unwrap_or_default()
    }

    pub fn push(&mut self, problem: Problem) {
        self.problems.push(problem);
    }

    pub fn is_empty(&self) -> bool {
        self.problems.is_empty()
    }

    pub fn into_problems(self) -> Vec<Problem> {
        self.problems
    }
}

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

/// The text of a scalar.
pub fn scalar(node: &Node) -> Option<&str> {
    match &node.kind {
        Kind::Scalar { text, .. } if !node.is_null() => Some(text),
        _ => None,
    }
}

/// One of a few given words.
pub fn word<T: Copy>(node: &Node, log: &mut Log, what: &str, choices: &[(&str, T)]) -> Option<T> {
    let text = scalar(node);
    if let Some(&(_, value)) = choices.iter().find(|(word, _)| Some(*word) == text) {
        return Some(value);
    }
    let known: Vec<&str> = choices.iter().map(|(word, _)| *word).collect();
    let problem = Problem::at(node.span, format!("unknown {what} {}", node.describe()));
    let meant = text.and_then(|text| suggest(text, known.iter().copied()));
    log.push(problem.help(meant.map_or_else(|| format!("one of: {}", known.join(", ")), did_you_mean)));
    None
}

/// A decimal number times `scale`, exactly: `0.1` of a second is 100,000,000 ns. Finer digits are cut.
pub fn scaled(text: &str, scale: u64) -> Option<u64> {
    let (whole, fraction) = text.split_once('.').unwrap_or((text, "0"));
    let digits =
        |part: &str| !part.is_empty() && part.len() <= 18 && part.bytes().all(|b| b.is_ascii_digit());
    if !digits(whole) || !digits(fraction) {
        return None;
    }
    let number = |part: &str| part.parse::<u128>().ok();
    let fraction = number(fraction)? * u128::from(scale) / 10u128.pow(fraction.len() as u32);
    u64::try_from(number(whole)? * u128::from(scale) + fraction).ok()
}

/// The candidate that was probably meant.
pub fn suggest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let name = name.to_lowercase();
    let distance = |candidate: &str| {
        let candidate = candidate.to_lowercase();
        // A shortened word.
        if name.len() > 3 && candidate.starts_with(&name) {
            return 1;
        }
        // Users often write only the last part of a path, or a wrong path to it.
        let by_end = match name.contains('/') {
            false => strsim::damerau_levenshtein(&name, last(&candidate)),
            true if last(&name) == last(&candidate) => 1,
            true => usize::MAX,
        };
        strsim::damerau_levenshtein(&name, &candidate).min(by_end)
    };
    let limit = match name.chars().count() {
        0..=2 => 0,
        3..=5 => 1,
        length => length / 3,
    };
    let near = candidates.into_iter().map(|candidate| (distance(candidate), candidate));
    near.filter(|(distance, _)| *distance <= limit)
        .min_by_key(|(distance, _)| *distance)
        .map(|(_, found)| found)
}

fn last(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}

pub fn did_you_mean(name: &str) -> String {
    format!("did you mean `{name}`?")
}

pub(super) fn mapping<'n>(node: &'n Node, what: &str, log: &mut Log) -> Option<&'n [(Key, Node)]> {
    match &node.kind {
        Kind::Mapping(entries) => Some(entries),
        _ => {
            let problem = Problem::at(node.span, format!("expected {what}, found {}", node.describe()));
            log.push(problem.help("write `key: value` lines, or `{ key: value }`"));
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_decimal_is_scaled_without_drift() {
        let cases = [
            ("0.1", 1_000_000_000, Some(100_000_000)),
            ("2", 60, Some(120)),
            ("1.5", 1_000, Some(1_500)),
            ("0.0000000019", 1_000_000_000, Some(1)),
            ("99999999999999999999", 1, None),
            ("18446744073709551615", 2, None),
            ("1e3", 1, None),
            ("-1", 1, None),
            (".5", 10, None),
            ("", 1, None),
        ];
        for (text, scale, expected) in cases {
            assert_eq!(scaled(text, scale), expected, "{text} * {scale}");
        }
    }

    #[test]
    fn a_suggestion_is_near_or_ends_alike() {
        let known = ["depends_on", "sensors/imu", "localization"];
        let suggest = |name| suggest(name, known);
        assert_eq!(suggest("dependson"), Some("depends_on"));
        assert_eq!(suggest("Lokalization"), Some("localization"));
        assert_eq!(suggest("imu"), Some("sensors/imu"));
        assert_eq!(suggest("imuu"), Some("sensors/imu"));
        assert_eq!(suggest("lidar/imu"), Some("sensors/imu"));
        assert_eq!(suggest("x"), None);
        assert_eq!(suggest("brake"), None);
    }
}
