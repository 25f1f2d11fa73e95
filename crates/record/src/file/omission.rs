//! The parts of a file that could not be used, and why.

use std::collections::BTreeMap;
use std::fmt;

use super::definitions::Channel;
use super::json::{JOURNAL, KEYFRAMES};
use super::writer::MessageStamps;

/// The name of the metadata record that stands where entries are missing in a repaired file.
pub(super) const MISSING: &str = "telltale/missing";

/// More are counted only.
const LIST_MAX: usize = 100;

/// A part of a file that could not be used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Omission {
    /// Where it begins in the file; 0 if that is not known.
    pub at: u64,
    /// Its length in the file; 0 if it is a part of something longer.
    pub bytes: u64,
    pub why: String,
}

impl fmt::Display for Omission {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.bytes {
            0 if self.at == 0 => f.write_str(&self.why),
            0 => write!(f, "at byte {}: {}", self.at, self.why),
            bytes => write!(f, "{bytes} bytes at byte {}: {}", self.at, self.why),
        }
    }
}

/// Entries are missing between the entries around this: that part of the file cannot be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Missing {
    /// Their first and their last time, as far as the file says it: nanoseconds since 1970.
    pub span_ns: Option<(u64, u64)>,
}

impl Missing {
    /// The sign that a repaired file has in place of what is missing.
    pub(super) fn to_metadata(self) -> BTreeMap<String, String> {
        let ends = self.span_ns.map(|(from, to)| [("from_ns", from), ("to_ns", to)]);
        ends.into_iter().flatten().map(|(end, ns)| (end.to_owned(), ns.to_string())).collect()
    }

    pub(super) fn of_metadata(metadata: &BTreeMap<String, String>) -> Missing {
        let ns = |end: &str| metadata.get(end)?.parse().ok();
        Missing { span_ns: ns("from_ns").zip(ns("to_ns")).filter(|(from, to)| from <= to) }
    }

    /// The part that is missing where a document of this channel cannot be read: an input of the engine, or its state.
    pub(super) fn of_document(channel: &Channel, stamps: MessageStamps) -> Option<Missing> {
        let is_needed = [&JOURNAL, &KEYFRAMES].iter().any(|it| *it.topic == *channel.topic);
        let at_ns = stamps.log_time_ns;
        is_needed.then_some(Missing { span_ns: Some((at_ns, at_ns)) })
    }
}

/// The omissions of one file, each once.
#[derive(Debug, Clone, Default)]
pub struct Omissions {
    list: Vec<Omission>,
    more: u64,
}

impl Omissions {
    /// `at` is 0 where no place in the file is known.
    pub fn add(&mut self, at: u64, bytes: u64, why: impl Into<String>) {
        let omission = Omission { at, bytes, why: why.into() };
        if self.list.contains(&omission) {
            return;
        }
        if self.list.len() < LIST_MAX {
            self.list.push(omission);
        } else {
            self.more += 1;
        }
    }

    /// The first hundred.
    pub fn list(&self) -> &[Omission] {
        &self.list
    }

    /// How many more there are.
    pub fn more(&self) -> u64 {
        self.more
    }

    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }
}
