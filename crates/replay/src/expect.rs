//! Compares the lines of a replay with expected ones, so that an incident is a regression test.

use serde_json::Value;

use super::Facts;
use super::line::seconds;
use telltale_engine::time::Timestamp;

/// A difference is looked for among this number of lines behind it.
const AHEAD_MAX: usize = 200;

/// A place where the replay differs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Difference {
    /// The expected line, counted from 1, does not come.
    Missing { line: usize, text: String },
    /// A line that is not expected comes before this one, or at the end.
    Unexpected { before: Option<usize>, text: String },
}

/// Expected lines: JSON objects. Each of their keys must be equal in the line of the replay.
#[derive(Debug, Default)]
pub struct Expected(Vec<(usize, String, serde_json::Map<String, Value>)>);

impl Expected {
    /// # Errors
    /// The first line that is no JSON object, and why.
    pub fn parse(text: &str) -> Result<Expected, String> {
        let lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
        let parsed = lines.map(|(index, line)| {
            let object = serde_json::from_str(line)
                .map_err(|error| format!("line {} is no JSON object: {error}", index + 1))?;
            Ok((index + 1, line.to_owned(), object))
        });
        parsed.collect::<Result<Vec<_>, String>>().map(Expected)
    }

    /// Without the lines that lie outside of this part of the time, by their `t_s` or else their `at`. Lines without
    /// either stay.
    pub fn within(mut self, facts: &Facts, from: Option<Timestamp>, to: Option<Timestamp>) -> Expected {
        let [from, to] = [from, to].map(|at| at.map(|at| seconds(facts.from, at)));
        self.0.retain(|(_, _, line)| {
            let at = || humantime::parse_rfc3339_weak(line.get("at")?.as_str()?).ok();
            let t_s = line.get("t_s").and_then(Value::as_f64);
            let t_s = t_s.or_else(|| Some(seconds(facts.from, facts.at_wall(at()?))));
            // Both are as exact as they are printed.
            t_s.is_none_or(|t_s| {
                from.is_none_or(|from| t_s > from - 0.000_5) && to.is_none_or(|to| t_s < to + 0.000_5)
            })
        });
        self
    }

    /// Every difference of these lines of a replay, in order.
    pub fn compare(&self, got: &[String]) -> Vec<Difference> {
        let got: Vec<Value> = got.iter().map(|line| serde_json::from_str(line).unwrap_or_default()).collect();
        let (mut differences, mut at) = (Vec::new(), 0);
        for (number, text, expected) in &self.0 {
            let ahead = got.iter().enumerate().skip(at).take(AHEAD_MAX);
            match ahead.into_iter().find(|(_, line)| fits(expected, line)) {
                Some((found, _)) => {
                    let extra = got[at..found].iter();
                    differences.extend(
                        extra
                            .map(|it| Difference::Unexpected { before: Some(*number), text: it.to_string() }),
                    );
                    at = found + 1;
                }
                None => differences.push(Difference::Missing { line: *number, text: text.clone() }),
            }
        }
        let rest = got[at..].iter();
        differences.extend(rest.map(|it| Difference::Unexpected { before: None, text: it.to_string() }));
        differences
    }
}

fn fits(expected: &serde_json::Map<String, Value>, line: &Value) -> bool {
    expected.iter().all(|(key, value)| line.get(key).is_some_and(|got| equal(value, got)))
}

/// Equal, numbers to a millisecond.
fn equal(expected: &Value, got: &Value) -> bool {
    match (expected.as_f64(), got.as_f64()) {
        (Some(expected), Some(got)) => (expected - got).abs() < 0.000_5,
        _ => expected == got,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn compare(expected: &str, got: &[&str]) -> Vec<Difference> {
        let got: Vec<String> = got.iter().map(|line| (*line).to_owned()).collect();
        Expected::parse(expected).unwrap().compare(&got)
    }

    const A: &str = r#"{"t_s":1.0,"node":"a","shown":"error"}"#;
    const B: &str = r#"{"t_s":2.0,"node":"b","shown":"ignore","reason":{"kind":"masked","by":["a"]}}"#;

    #[test]
    fn a_line_may_name_only_some_keys_and_differences_are_told_in_order() {
        assert_eq!(compare("", &[]), []);
        assert_eq!(compare(&format!("{A}\n\n{B}\n"), &[A, B]), []);
        assert_eq!(compare("{\"node\":\"a\"}\n{\"t_s\":2.0001}\n", &[A, B]), []);
        let missing = |line, text: &str| Difference::Missing { line, text: text.to_owned() };
        let wrong = r#"{"node":"a","shown":"ok"}"#;
        let unexpected = |before, text: &str| {
            let text = serde_json::from_str::<Value>(text).unwrap().to_string();
            Difference::Unexpected { before, text }
        };
        assert_eq!(compare(wrong, &[A]), [missing(1, wrong), unexpected(None, A)]);
        assert_eq!(compare(B, &[A, B]), [unexpected(Some(1), A)]);
        assert_eq!(compare(&format!("{A}\n{B}"), &[B]), [missing(1, A)]);
        assert_eq!(compare(r#"{"t_s":2.001}"#, &[B]).len(), 2, "a millisecond is a difference");
        assert!(Expected::parse("[1]\n").unwrap_err().starts_with("line 1 is no JSON object"));
    }

    #[test]
    fn lines_outside_of_a_part_of_the_time_do_not_count() {
        let facts = Facts::at_zero(std::time::UNIX_EPOCH + std::time::Duration::from_secs(1_800_000_000));
        let lines = [
            r#"{"t_s":1.0}"#,
            r#"{"at":"2027-01-15T08:00:02Z"}"#,
            r#"{"t_s":3.0,"at":"2027-01-15T08:00:03Z"}"#,
            r#"{"node":"a"}"#,
        ];
        let within = |from_s: Option<u64>, to_s: Option<u64>| {
            let [from, to] = [from_s, to_s].map(|s| s.map(|s| Timestamp::from_millis(1000 * s)));
            let expected = Expected::parse(&lines.join("\n")).unwrap().within(&facts, from, to);
            expected.0.iter().map(|(number, ..)| *number).collect::<Vec<_>>()
        };
        assert_eq!(within(None, None), [1, 2, 3, 4]);
        assert_eq!(within(Some(2), None), [2, 3, 4]);
        assert_eq!(within(None, Some(2)), [1, 2, 4]);
        assert_eq!(within(Some(3), Some(3)), [3, 4]);
    }
}
