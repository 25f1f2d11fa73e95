//! Durations in the file: a number with its unit.

use crate::decode::FromNode;
use telltale_engine::model::Within;
use telltale_engine::time::Span;
use telltale_yaml::decode::{scalar, scaled};
use telltale_yaml::schema::one_of;
use telltale_yaml::{Log, Members, Node, Problem, Schema};

/// A unit that ends with another one comes before it.
const UNITS: [(&str, u64); 8] = [
    ("ns", 1),
    ("us", 1_000),
    ("µs", 1_000),
    ("ms", 1_000_000),
    ("s", 1_000_000_000),
    ("m", 60_000_000_000),
    ("h", 3_600_000_000_000),
    ("d", 86_400_000_000_000),
];

impl FromNode for Span {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        let span = scalar(node).and_then(parse);
        if span.is_none() {
            let problem = Problem::at(node.span, format!("expected a duration, found {}", node.describe()));
            log.push(
                problem.help("write a number with one of the units ns, us, ms, s, m, h, d: for example `2s`"),
            );
        }
        span
    }

    fn form(schema: &mut Schema) -> Members {
        super::forms::duration(schema)
    }
}

impl FromNode for Within {
    fn from_node(node: &Node, log: &mut Log) -> Option<Self> {
        if scalar(node) == Some("always") {
            return Some(Within::Always);
        }
        let span = scalar(node).and_then(parse);
        if span.is_none() {
            let text = format!("expected a duration or `always`, found {}", node.describe());
            log.push(Problem::at(node.span, text).help("write for example `5s`"));
        }
        span.map(Within::Limit)
    }

    fn form(schema: &mut Schema) -> Members {
        one_of([super::forms::duration(schema), vec![("const", "always".into())]])
    }
}

pub(crate) fn parse(text: &str) -> Option<Span> {
    let unit_start = text.find(|c: char| !c.is_ascii_digit() && c != '.')?;
    let (number, unit) = (&text[..unit_start], text[unit_start..].trim_start());
    let (_, scale) = UNITS.iter().find(|(name, _)| *name == unit)?;
    scaled(number, *scale).map(Span::from_nanos)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_duration_has_a_number_and_a_unit() {
        let cases = [
            ("2s", Some(2_000_000_000)),
            ("1.5 s", Some(1_500_000_000)),
            ("250ms", Some(250_000_000)),
            ("3us", Some(3_000)),
            ("3µs", Some(3_000)),
            ("7ns", Some(7)),
            ("2m", Some(120_000_000_000)),
            ("1h", Some(3_600_000_000_000)),
            ("2d", Some(172_800_000_000_000)),
            ("0s", Some(0)),
            ("2", None),
            ("2 sek", None),
            ("s", None),
            ("-1s", None),
            ("1s 5ms", None),
            ("99999999999h", None),
        ];
        for (text, expected) in cases {
            assert_eq!(parse(text).map(Span::as_nanos), expected, "{text}");
        }
    }
}
