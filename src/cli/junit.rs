//! Results as JUnit's XML, which the pages of continuous integration show.

use std::fmt::Write as _;
use std::path::Path;
use std::time::Duration;

use anyhow::Context as _;

use crate::picture::svg::escaped;

/// One case: a scenario or a recording.
pub struct Case {
    pub name: String,
    pub took: Duration,
    pub result: Verdict,
}

pub enum Verdict {
    Passed,
    /// The result differs from the expected one: in a line, and in full.
    Failed(String, String),
    /// It could not be run, and why.
    Broken(String),
}

/// Writes the cases of a command to a file.
///
/// # Errors
/// The file cannot be written.
pub fn write(path: &Path, command: &str, cases: &[Case]) -> anyhow::Result<()> {
    std::fs::write(path, text(command, cases))
        .with_context(|| format!("the results cannot be written to {}", path.display()))
}

fn text(command: &str, cases: &[Case]) -> String {
    let count = |is: fn(&Verdict) -> bool| cases.iter().filter(|case| is(&case.result)).count();
    let failures = count(|it| matches!(it, Verdict::Failed(..)));
    let errors = count(|it| matches!(it, Verdict::Broken(_)));
    let seconds: f64 = cases.iter().map(|case| case.took.as_secs_f64()).sum();
    let counts = format!(
        "tests=\"{}\" failures=\"{failures}\" errors=\"{errors}\" time=\"{seconds:.3}\"",
        cases.len()
    );
    let mut out = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites {counts}>\n<testsuite name=\"{command}\" {counts}>\n"
    );
    for Case { name, took, result } in cases {
        // Writing to a string cannot fail.
        let _ = write!(
            out,
            "<testcase classname=\"{command}\" name=\"{}\" time=\"{:.3}\">",
            escaped(name),
            took.as_secs_f64()
        );
        let _ = match result {
            Verdict::Passed => Ok(()),
            Verdict::Failed(line, all) => {
                write!(out, "<failure message=\"{}\">{}</failure>", escaped(line), lines(all))
            }
            Verdict::Broken(why) => write!(out, "<error message=\"{}\"/>", escaped(why)),
        };
        out.push_str("</testcase>\n");
    }
    out.push_str("</testsuite>\n</testsuites>\n");
    out
}

/// A text whose lines stay lines.
fn lines(text: &str) -> String {
    text.lines().map(escaped).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_case_has_its_result_and_no_text_becomes_markup() {
        let case =
            |name: &str, result| Case { name: name.to_owned(), took: Duration::from_millis(1500), result };
        let cases = [
            case("a.mcap", Verdict::Passed),
            case("b<\"&\u{1}.mcap", Verdict::Failed("x < y".to_owned(), "one\n]]> two".to_owned())),
            case("c", Verdict::Broken("no file".to_owned())),
        ];
        let expected = "<?xml version=\"1.0\" encoding=\"UTF-8\"?>
<testsuites tests=\"3\" failures=\"1\" errors=\"1\" time=\"4.500\">
<testsuite name=\"telltale replay\" tests=\"3\" failures=\"1\" errors=\"1\" time=\"4.500\">
<testcase classname=\"telltale replay\" name=\"a.mcap\" time=\"1.500\"></testcase>
<testcase classname=\"telltale replay\" name=\"b&lt;&quot;&amp;\\u{1}.mcap\" time=\"1.500\"><failure message=\"x &lt; y\">one
]]&gt; two</failure></testcase>
<testcase classname=\"telltale replay\" name=\"c\" time=\"1.500\"><error message=\"no file\"/></testcase>
</testsuite>
</testsuites>
";
        assert_eq!(text("telltale replay", &cases), expected);
    }
}
