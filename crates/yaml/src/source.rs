//! The texts of files, and places in them.

use std::collections::BTreeMap;
use std::io::{ErrorKind, Read};
use std::path::Path;
use std::sync::Arc;

use super::plain;
use super::problem::Problem;
use crate::input_file;

/// The largest configuration or scenario.
const FILE_BYTES_MAX: u64 = 64 << 20;

/// A range of bytes in one of the [`Sources`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Span {
    pub file: u16,
    pub start: u32,
    pub end: u32,
}

/// All texts of one configuration or scenario.
#[derive(Debug, Clone, Default)]
pub struct Sources {
    read: Vec<Source>,
    /// The only files that can be read, by their names; `None`: those of the disk.
    kept: Option<Arc<BTreeMap<String, String>>>,
}

#[derive(Debug, Clone)]
struct Source {
    /// As the user named it.
    name: String,
    text: String,
}

impl Sources {
    /// Reads files of a recording, by the names that they had, and nothing from the disk.
    pub fn kept(texts: impl IntoIterator<Item = (String, String)>) -> Sources {
        Sources { read: Vec::new(), kept: Some(Arc::new(texts.into_iter().collect())) }
    }

    /// Whether its files are those of a recording.
    pub fn is_kept(&self) -> bool {
        self.kept.is_some()
    }

    /// Adds a text and returns its number.
    pub fn add(&mut self, name: &str, text: &str) -> u16 {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        self.read.push(Source { name: name.to_owned(), text: text.to_owned() });
        (self.read.len() - 1) as u16
    }

    /// Adds the text of a file.
    ///
    /// # Errors
    /// It cannot be read, is too large, or is not UTF-8.
    pub fn read(&mut self, path: &Path) -> Result<u16, Problem> {
        let name = path.display().to_string();
        if let Some(kept) = &self.kept {
            let text = kept.get(&name).cloned();
            let text = text.ok_or_else(|| {
                Problem::of_file(&name, "is not in the recording", "name a configuration with --config")
            })?;
            return Ok(self.add(&name, &text));
        }
        let bytes = read_bytes(path).map_err(|(what, help)| Problem::of_file(&name, what, help))?;
        self.add_bytes(&name, bytes)
    }

    /// Adds a text that is called `name` in messages.
    ///
    /// # Errors
    /// It cannot be read, is too large, or is not UTF-8.
    pub fn read_from(&mut self, name: &str, reader: impl Read) -> Result<u16, Problem> {
        let mut bytes = Vec::new();
        let problem = |what, help| Problem::of_file(name, what, help);
        let read = reader.take(FILE_BYTES_MAX + 1).read_to_end(&mut bytes);
        read.map_err(|_| problem("cannot be read", "write the configuration into it"))?;
        if bytes.len() as u64 > FILE_BYTES_MAX {
            return Err(problem("is larger than 64 MiB", "give it a configuration"));
        }
        self.add_bytes(name, bytes)
    }

    fn add_bytes(&mut self, name: &str, bytes: Vec<u8>) -> Result<u16, Problem> {
        let text = String::from_utf8(bytes).map_err(|error| {
            let valid = error.utf8_error().valid_up_to();
            let line = error.as_bytes()[..valid].iter().filter(|&&byte| byte == b'\n').count() + 1;
            let what = format!("is not UTF-8 text: byte {} in line {line} is wrong", valid + 1);
            Problem::of_file(name, &what, "save the file with the encoding UTF-8")
        })?;
        Ok(self.add(name, &text))
    }

    /// The text for a terminal: every place stays the same.
    pub fn printable(&self) -> Sources {
        let printable = |source: &Source| Source {
            name: plain::line(&source.name).into_owned(),
            text: plain::masked(&source.text),
        };
        Sources { read: self.read.iter().map(printable).collect(), kept: self.kept.clone() }
    }

    pub fn len(&self) -> usize {
        self.read.len()
    }

    pub fn is_empty(&self) -> bool {
        self.read.is_empty()
    }

    pub fn name(&self, file: u16) -> &str {
        &self.read[usize::from(file)].name
    }

    pub fn text(&self, file: u16) -> &str {
        &self.read[usize::from(file)].text
    }

    /// Names and texts, in the order in which they were read.
    pub fn texts(&self) -> impl Iterator<Item = (&str, &str)> {
        self.read.iter().map(|source| (&*source.name, &*source.text))
    }

    /// Whether every file is unchanged since it was read.
    pub fn are_unchanged(&self) -> bool {
        self.read.iter().all(|source| {
            let mut again = Sources::default();
            again.read(Path::new(&source.name)).is_ok_and(|file| again.text(file) == source.text)
        })
    }

    /// Line and column of the start of a span, counted from 1, columns in characters.
    pub fn line_column(&self, span: Span) -> (usize, usize) {
        let text = self.text(span.file);
        let before = &text[..text.floor_char_boundary(span.start as usize)];
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        (before.matches('\n').count() + 1, before[line_start..].chars().count() + 1)
    }

    /// `file:line`, as editors open it.
    pub fn place(&self, span: Span) -> String {
        format!("{}:{}", self.name(span.file), self.line_column(span).0)
    }
}

fn read_bytes(path: &Path) -> Result<Vec<u8>, (&'static str, &'static str)> {
    let trouble = |error: std::io::Error| match error.kind() {
        ErrorKind::NotFound => ("does not exist", "check the path"),
        ErrorKind::PermissionDenied => ("may not be read", "check who owns it and its permissions"),
        ErrorKind::IsADirectory => ("is a directory", "name a file in it"),
        ErrorKind::InvalidInput => ("is no regular file", "a pipe or a device may never end: name a file"),
        _ => ("cannot be read", "check the path and the disk"),
    };
    if path.is_dir() {
        return Err(("is a directory", "name a file in it"));
    }
    let mut bytes = Vec::new();
    let file = input_file::open(path).map_err(trouble)?;
    file.take(FILE_BYTES_MAX + 1).read_to_end(&mut bytes).map_err(trouble)?;
    if bytes.len() as u64 > FILE_BYTES_MAX {
        return Err(("is larger than 64 MiB", "name a file that is meant for this"));
    }
    Ok(bytes)
}
