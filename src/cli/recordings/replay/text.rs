//! The lines of a replay for people, in the order of their times: with the day, and with where something is missing.

use humantime::format_rfc3339_seconds;

use crate::cli::print;
use crate::engine::time::Timestamp;
use crate::replay::line::{Line, remark};
use crate::replay::{Facts, Gaps};

/// Stands where a gap of the recording begins, and where all is known again.
const MAY_DIFFER: &str =
    "--- from here on something is missing: what follows may differ from what was shown ---";
const AS_SHOWN: &str = "--- here the state was recorded: what follows is as it was shown ---";
const AS_SHOWN_AT_ONCE: &str =
    "--- something is missing before this; here the state was recorded: what follows is as it was shown ---";

pub(super) struct Text<'f> {
    facts: &'f Facts,
    /// Nothing is printed of what was before.
    from: Timestamp,
    /// The last step.
    last: Timestamp,
    gaps: usize,
    may_differ: bool,
    /// That of the last line, in UTC.
    day: String,
}

impl Text<'_> {
    pub fn new(facts: &Facts, from: Timestamp) -> Text<'_> {
        Text { facts, from, last: Timestamp::ZERO, gaps: 0, may_differ: false, day: String::new() }
    }

    /// Prints the lines of a step. Returns whether anybody reads further.
    pub fn print(&mut self, at: Timestamp, gaps: &Gaps, lines: &[Line]) -> bool {
        let remarked = self.remarked(at, gaps).filter(|_| at >= self.from);
        self.last = self.last.max(at);
        // Deadlines within a gap have acted before its end.
        let before = remarked.map_or(0, |(at, _)| lines.partition_point(|line| line.at < at));
        let (before, after) = lines.split_at(before);
        let remarked = remarked.map(|(at, words)| (at, remark(at, words, self.facts)));
        let told = before.iter().map(|line| (line.at, &*line.text));
        let told = told.chain(remarked.iter().map(|(at, text)| (*at, &**text)));
        told.chain(after.iter().map(|line| (line.at, &*line.text))).all(|(at, text)| self.line(at, text))
    }

    fn line(&mut self, at: Timestamp, text: &str) -> bool {
        let mut day = format_rfc3339_seconds(self.facts.wall(at)).to_string();
        day.truncate("2026-11-20".len());
        if day != self.day {
            if !print::line(&format!("{day} UTC")) {
                return false;
            }
            self.day = day;
        }
        print::line(text)
    }

    /// What is to be said of the gaps behind this step, and at which instant.
    fn remarked(&mut self, at: Timestamp, gaps: &Gaps) -> Option<(Timestamp, &'static str)> {
        let differed = std::mem::replace(&mut self.may_differ, gaps.may_differ(at));
        let is_new = self.gaps < gaps.list().len();
        self.gaps = gaps.list().len();
        match (differed, self.may_differ, is_new) {
            (false, true, _) => {
                let begin = gaps.list().last().map_or(at, |gap| gap.from);
                Some((begin.max(self.last).max(self.from), MAY_DIFFER))
            }
            (true, false, _) => Some((at, AS_SHOWN)),
            (false, false, true) => Some((at, AS_SHOWN_AT_ONCE)),
            _ => None,
        }
    }
}
