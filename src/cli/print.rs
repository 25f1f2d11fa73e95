//! What commands print. Each line stays one line, whatever it is made of: text from the vehicle's network or from a file
//! begins no line of its own and does not act on a terminal. A reader of a pipe who has had enough is no error.

use std::fmt::Display;
use std::io::{self, ErrorKind, IsTerminal as _, Write, stderr, stdout};
use std::sync::atomic::{AtomicBool, Ordering};

use crate::yaml::{Problems, plain};

/// Standard output could not be written, and not because its reader has had enough.
static FAILED: AtomicBool = AtomicBool::new(false);

/// Prints a line to standard output.
macro_rules! say {
    ($($words:tt)*) => {{
        $crate::cli::print::line(&format!($($words)*));
    }};
}
pub(crate) use say;

/// Prints a line to standard error.
macro_rules! note {
    ($($words:tt)*) => {
        $crate::cli::print::error_line(&format!($($words)*))
    };
}
pub(crate) use note;

/// Prints a line to standard output. Returns whether anybody reads further.
pub fn line(line: &str) -> bool {
    is_read(written(stdout().lock(), &format!("{}\n", plain::line(line))))
}

/// Prints a document of JSON as one line. Returns whether anybody reads further.
pub fn json(document: &impl Display) -> bool {
    is_read(written(stdout().lock(), &format!("{}\n", plain::json(&document.to_string()))))
}

/// Prints a text whose lines are made: [`Lines`], or what another program reads. Returns whether anybody reads further.
pub fn text(text: &str) -> bool {
    is_read(written(stdout().lock(), text))
}

/// Prints a line to standard error.
pub fn error_line(line: &str) {
    error_text(&format!("{}\n", plain::line(line)));
}

/// Prints a text whose lines are made to standard error. Where nobody reads it there is nobody to tell.
pub fn error_text(text: &str) {
    let _ = written(stderr().lock(), text);
}

/// Prints what is wrong with a file to standard error.
pub fn problems(problems: &Problems) {
    let colour = stderr().is_terminal() && std::env::var_os("NO_COLOR").is_none();
    error_text(&problems.render(colour));
}

/// Whether a text for standard output was lost.
pub fn has_failed() -> bool {
    FAILED.load(Ordering::Relaxed)
}

/// Lines that are printed together.
#[derive(Debug, Default)]
pub struct Lines(String);

impl Lines {
    pub fn add(&mut self, line: impl Display) {
        self.0.push_str(&plain::line(&line.to_string()));
        self.0.push('\n');
    }

    pub fn text(&self) -> &str {
        &self.0
    }
}

fn written(mut out: impl Write, text: &str) -> io::Result<()> {
    out.write_all(text.as_bytes())?;
    out.flush()
}

fn is_read(written: io::Result<()>) -> bool {
    let Err(error) = written else { return true };
    if error.kind() != ErrorKind::BrokenPipe && !FAILED.swap(true, Ordering::Relaxed) {
        note!("telltale: standard output cannot be written: {error}");
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_one_whatever_it_is_made_of() {
        let mut lines = Lines::default();
        lines.add(format_args!("a{}b", "\n\u{1b}[2J"));
        lines.add("c");
        assert_eq!(lines.text(), "a\\n\\u{1b}[2Jb\nc\n");
    }
}
