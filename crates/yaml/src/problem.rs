//! Problems in files: where, what, and what to do about it.

use std::fmt;

use miette::{
    Diagnostic, GraphicalReportHandler, GraphicalTheme, LabeledSpan, MietteError, MietteSpanContents,
    Severity, SourceCode, SourceSpan, SpanContents,
};

use super::plain;
use super::source::{Sources, Span};

/// Problems beyond this many are counted, not kept.
const PROBLEMS_MAX: usize = 200;

/// One problem in a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Problem {
    /// A sentence without a full stop.
    pub message: String,
    /// Its place; `None` for the file as a whole.
    pub span: Option<Span>,
    /// The file, for a problem of the file as a whole.
    pub file: Option<Box<str>>,
    /// The text under the caret.
    pub label: Box<str>,
    /// Other relevant places, each with a word.
    pub also: Vec<(Span, String)>,
    /// What to do.
    pub help: Option<Box<str>>,
    /// A warning, which is no reason to refuse the file.
    pub warning: bool,
}

impl Problem {
    pub fn at(span: Span, message: impl Into<String>) -> Problem {
        Problem {
            message: message.into(),
            span: Some(span),
            file: None,
            label: "here".into(),
            also: Vec::new(),
            help: None,
            warning: false,
        }
    }

    /// The problem as a warning.
    pub fn as_warning(mut self) -> Problem {
        self.warning = true;
        self
    }

    pub fn of_file(name: &str, what: &str, help: &str) -> Problem {
        let message = format!("`{name}` {what}");
        let (file, help) = (Some(name.into()), Some(help.into()));
        Problem { message, span: None, file, label: Box::default(), also: Vec::new(), help, warning: false }
    }

    pub fn label(mut self, label: impl Into<String>) -> Problem {
        self.label = label.into().into();
        self
    }

    pub fn help(mut self, help: impl Into<String>) -> Problem {
        self.help = Some(help.into().into());
        self
    }

    pub fn also(mut self, span: Span, label: impl Into<String>) -> Problem {
        self.also.push((span, label.into()));
        self
    }

    fn printable(&self) -> Problem {
        let escaped = |text: &str| plain::line(text).into_owned();
        let short = |text: &str| escaped(text).into_boxed_str();
        // Several sentences may stand below one another there.
        let help = |text: &str| plain::escaped(text).into_owned().into_boxed_str();
        Problem {
            message: escaped(&self.message),
            file: self.file.as_deref().map(short),
            label: short(&self.label),
            also: self.also.iter().map(|(span, label)| (*span, escaped(label))).collect(),
            help: self.help.as_deref().map(help),
            ..*self
        }
    }
}

/// All problems, with the texts in which they are. As an error, never empty.
#[derive(Debug, Clone)]
pub struct Problems {
    sources: Sources,
    list: Vec<Problem>,
    more: usize,
}

impl Problems {
    /// In the order of the files and of the lines in them.
    pub fn new(sources: Sources, mut list: Vec<Problem>) -> Problems {
        list.sort_by_key(|problem| problem.span);
        list.dedup();
        let more = list.len().saturating_sub(PROBLEMS_MAX);
        list.truncate(PROBLEMS_MAX);
        Problems { sources, list, more }
    }

    /// These problems and others of the same texts. Of two at one place, only the first counts, because the
    /// second follows from it.
    pub fn and(self, others: Problems) -> Problems {
        let known: Vec<Span> = self.list.iter().filter_map(|problem| problem.span).collect();
        let is_new = |problem: &Problem| problem.span.is_none_or(|span| !known.contains(&span));
        let more = self.more + others.more;
        let list = self.list.into_iter().chain(others.list.into_iter().filter(is_new)).collect();
        let all = Problems::new(self.sources, list);
        Problems { more: all.more + more, ..all }
    }

    /// For programs: each problem with its `severity`, `file`, `line` and `column` from 1 (these
    /// null where the file as a whole is meant), `message` and `help`.
    pub fn json(&self) -> Vec<serde_json::Value> {
        let place = |span: Option<Span>| {
            let (line, column) = span.map(|span| self.sources.line_column(span)).unzip();
            (span.map(|span| self.sources.name(span.file)), line, column)
        };
        let of = |problem: &Problem| {
            let (file, line, column) = place(problem.span);
            let file = file.or(problem.file.as_deref());
            let also = problem.also.iter().map(|(span, message)| {
                let (file, line, column) = place(Some(*span));
                serde_json::json!({ "file": file, "line": line, "column": column, "message": message })
            });
            serde_json::json!({
                "severity": if problem.warning { "warning" } else { "error" },
                "file": file, "line": line, "column": column,
                "message": problem.message, "help": problem.help, "also": also.collect::<Vec<_>>(),
            })
        };
        self.list.iter().map(of).collect()
    }

    /// The number of problems beyond those that are kept.
    pub fn more(&self) -> usize {
        self.more
    }

    pub fn list(&self) -> &[Problem] {
        &self.list
    }

    /// One line each: `file:line:column: message (what to do)`.
    pub fn lines(&self) -> Vec<String> {
        let line = |problem: &Problem| {
            let place = problem.span.map_or(String::new(), |span| {
                let (line, column) = self.sources.line_column(span);
                format!("{}:{line}:{column}: ", self.sources.name(span.file))
            });
            let help = problem
                .help
                .as_ref()
                .map_or(String::new(), |help| format!(" ({})", help.replace('\n', "; ")));
            plain::line(&format!("{place}{}{help}", problem.message)).into_owned()
        };
        self.list.iter().map(line).collect()
    }

    /// Each with its line of the file, a caret and what to do.
    pub fn render(&self, colour: bool) -> String {
        let theme = if colour { GraphicalTheme::unicode() } else { GraphicalTheme::unicode_nocolor() };
        let handler = GraphicalReportHandler::new_themed(theme).with_width(100).with_links(false);
        let mut text = String::new();
        let sources = self.sources.printable();
        for problem in self.list.iter().map(Problem::printable) {
            let report = Report { problem: &problem, sources: &sources };
            // Writing to a String cannot fail, and a span that miette cannot show still has its text.
            if handler.render_report(&mut text, &report).is_err() {
                text.push_str(&problem.message);
            }
            text.push('\n');
        }
        if self.more > 0 {
            text.push_str(&format!("and {} more\n", self.more));
        }
        text
    }
}

impl fmt::Display for Problems {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.render(false))
    }
}

impl std::error::Error for Problems {}

#[derive(Debug)]
struct Report<'a> {
    problem: &'a Problem,
    sources: &'a Sources,
}

impl fmt::Display for Report<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.problem.message)
    }
}

impl std::error::Error for Report<'_> {}

impl Diagnostic for Report<'_> {
    fn severity(&self) -> Option<Severity> {
        Some(if self.problem.warning { Severity::Warning } else { Severity::Error })
    }

    fn help<'b>(&'b self) -> Option<Box<dyn fmt::Display + 'b>> {
        let elsewhere = self.problem.also.iter().filter(|(span, _)| Some(span.file) != self.file());
        let elsewhere = elsewhere.map(|(span, label)| format!("{}: {label}", self.sources.place(*span)));
        let help = self.problem.help.as_deref().map(str::to_owned);
        let parts: Vec<String> = help.into_iter().chain(elsewhere).collect();
        if parts.is_empty() { None } else { Some(Box::new(parts.join("\n"))) }
    }

    fn source_code(&self) -> Option<&dyn SourceCode> {
        self.problem.span.map(|_| self as &dyn SourceCode)
    }

    fn labels(&self) -> Option<Box<dyn Iterator<Item = LabeledSpan> + '_>> {
        let span = self.problem.span?;
        let main = LabeledSpan::new_primary_with_span(Some(self.problem.label.to_string()), range(span));
        let also = self.problem.also.iter().filter(move |(other, _)| other.file == span.file);
        let also = also.map(|(other, label)| LabeledSpan::new_with_span(Some(label.clone()), range(*other)));
        Some(Box::new(std::iter::once(main).chain(also)))
    }
}

impl Report<'_> {
    fn file(&self) -> Option<u16> {
        self.problem.span.map(|span| span.file)
    }
}

impl SourceCode for Report<'_> {
    fn read_span<'b>(
        &'b self,
        span: &SourceSpan,
        before: usize,
        after: usize,
    ) -> Result<Box<dyn SpanContents<'b> + 'b>, MietteError> {
        let file = self.file().ok_or(MietteError::OutOfBounds)?;
        let contents = self.sources.text(file).read_span(span, before, after)?;
        Ok(Box::new(MietteSpanContents::new_named(
            self.sources.name(file).to_owned(),
            contents.data(),
            *contents.span(),
            contents.line(),
            contents.column(),
            contents.line_count(),
        )))
    }
}

fn range(span: Span) -> std::ops::Range<usize> {
    span.start as usize..span.end as usize
}
