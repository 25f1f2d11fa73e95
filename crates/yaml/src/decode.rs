//! Problems that are collected while a tree is read, and the forms of single values.

use super::problem::Problem;
use super::schema::Schema;
use super::tree::{Key, Kind, Node};

/// Collects problems, or the schema of what is decoded.
#[derive(Debug, Default)]
pub struct Log {
    problems: Vec<Problem>,
    /// Present while decoders describe themselves; problems do not count then.
    pub schema: Option<Schema>,
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

/// The candidate that was probably meant; the same one in whatever order they come.
pub fn suggest<'a>(name: &str, candidates: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    let name = name.to_lowercase();
    let distances = |candidate: &'a str| {
        let lower = candidate.to_lowercase();
        let whole = strsim::damerau_levenshtein(&name, &lower);
        // Users often write only the last part of a path, or a wrong path to it.
        let by_end = match name.contains('/') {
            false => strsim::damerau_levenshtein(&name, last(&lower)),
            true if last(&name) == last(&lower) => 1,
            true => usize::MAX,
        };
        // A shortened word.
        let by_start = if name.len() > 3 && lower.starts_with(&name) { 1 } else { usize::MAX };
        // Of equally near ones, that which is nearer as a whole.
        (whole.min(by_end).min(by_start), whole, candidate)
    };
    let limit = match name.chars().count() {
        0..=2 => 0,
        3..=5 => 1,
        length => length / 3,
    };
    let near = candidates.into_iter().map(distances).filter(|(distance, ..)| *distance <= limit);
    near.min().map(|(.., found)| found)
}

fn last(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}

pub fn did_you_mean(name: &str) -> String {
    format!("did you mean `{name}`?")
}

/// The entries of a map; `what` names it in messages.
pub fn mapping<'n>(node: &'n Node, what: &str, log: &mut Log) -> Option<&'n [(Key, Node)]> {
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

    #[test]
    fn a_suggestion_does_not_depend_on_the_order_of_what_is_known() {
        // Both end alike; the first is nearer as a whole, and of equally near ones the alphabet decides.
        for (name, first, second) in [
            ("/mrm_domain/planning/available", "/mrm_comain/planning/available", "/foolproof/available"),
            ("wheel_x", "wheel_a", "wheel_b"),
        ] {
            assert_eq!(suggest(name, [first, second]), Some(first));
            assert_eq!(suggest(name, [second, first]), Some(first));
        }
    }
}
