//! The gaps of a recording, and from when to when a replay may therefore differ from the past.

use humantime::format_rfc3339_millis;

use super::Facts;
use telltale_engine::time::{Span, Timestamp};

/// Gaps that are told apart. Further ones are counted.
const GAPS_MAX: usize = 100;
/// Gaps as close as this are one.
const JOINED: Span = Span::from_secs(1);

/// A span of time whose inputs are missing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Gap {
    pub from: Timestamp,
    /// `None`: nothing follows.
    pub to: Option<Timestamp>,
    /// From here on all is again as it was shown: the state of the engine was recorded. `None`: up to the end it may differ.
    pub exact_from: Option<Timestamp>,
    /// The file is damaged or gone there. Else the recorder did not keep them, or this version cannot read them.
    pub is_damage: bool,
}

impl Gap {
    /// Its length; `None` if nothing follows.
    pub fn length(&self) -> Option<Span> {
        self.to.map(|to| to.since(self.from))
    }

    /// From when to when something is missing, and what that means.
    pub fn sentence(&self, facts: &Facts) -> String {
        let clock = |at| format_rfc3339_millis(facts.wall(at));
        let span = match self.length().zip(self.to) {
            Some((length, to)) => {
                format!("missing {} to {} ({:.3} s)", clock(self.from), clock(to), length.as_secs_f64())
            }
            None => format!("missing {} to the end", clock(self.from)),
        };
        let why = if self.is_damage {
            "the file is damaged or gone there"
        } else {
            "these inputs are not recorded"
        };
        let of =
            if facts.has_journal { "what was shown then" } else { "what the whole recording would show" };
        let until = match self.exact_from {
            Some(exact) => format!(" up to {}", clock(exact)),
            None => String::new(),
        };
        format!("{span}: {why}; states from there on{until} may differ from {of}")
    }
}

/// The gaps of a recording as far as it was read, in their order.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Gaps {
    list: Vec<Gap>,
    more: u64,
    /// The end of the last one is that of the next step.
    is_open: bool,
}

impl Gaps {
    pub fn list(&self) -> &[Gap] {
        &self.list
    }

    /// How many more there are.
    pub fn more(&self) -> u64 {
        self.more
    }

    pub fn is_empty(&self) -> bool {
        self.list.is_empty()
    }

    /// One sentence for each, and how much is missing as a whole; nothing if nothing is.
    pub fn sentences(&self, facts: &Facts) -> Vec<String> {
        let mut all: Vec<String> = self.list.iter().map(|gap| gap.sentence(facts)).collect();
        let count = self.list.len() as u64 + self.more;
        if count > 1 {
            let ns: u64 = self.list.iter().filter_map(Gap::length).map(Span::as_nanos).sum();
            let of = if self.more > 0 { "the first of them " } else { "" };
            all.push(format!("{count} gaps in the recording, {of}{:.3} s together", ns as f64 / 1e9));
        }
        all
    }

    /// Whether the file is damaged anywhere.
    pub fn is_damage(&self) -> bool {
        self.list.iter().any(|gap| gap.is_damage)
    }

    /// Whether what is shown at an instant may differ from what was shown then.
    pub fn may_differ(&self, at: Timestamp) -> bool {
        self.list.iter().any(|gap| gap.from <= at && gap.exact_from.is_none_or(|exact| at < exact))
    }

    /// Something is missing from here on, up to the next step if no end is known.
    pub(super) fn lose(&mut self, from: Timestamp, to: Option<Timestamp>, is_damage: bool) {
        let to = to.map(|to| to.max(from));
        self.is_open = to.is_none();
        if let Some(last) = self.list.last_mut()
            && last.is_damage == is_damage
            && last.exact_from.is_none()
            && last.to.is_none_or(|end| from <= end + JOINED)
        {
            last.from = last.from.min(from);
            last.to = to.map(|to| last.to.map_or(to, |end| end.max(to)));
        } else if self.list.len() < GAPS_MAX {
            self.list.push(Gap { from, to, exact_from: None, is_damage });
        } else {
            self.more += 1;
        }
    }

    /// The engine takes a step at this instant.
    pub(super) fn go_on(&mut self, at: Timestamp) {
        if std::mem::take(&mut self.is_open)
            && let Some(last) = self.list.last_mut()
        {
            last.to = last.to.or(Some(at.max(last.from)));
        }
    }

    /// The state of the engine at this instant is the recorded one.
    pub(super) fn catch_up(&mut self, at: Timestamp) {
        self.go_on(at);
        for gap in self.list.iter_mut().rev().take_while(|gap| gap.exact_from.is_none()) {
            gap.exact_from = Some(at.max(gap.from));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: fn(u64) -> Timestamp = |s| Timestamp::from_millis(1000 * s);

    #[test]
    fn from_a_gap_to_the_next_recorded_state_it_may_differ() {
        let mut gaps = Gaps::default();
        gaps.go_on(S(1));
        gaps.lose(S(10), Some(S(12)), true);
        gaps.go_on(S(13));
        gaps.lose(S(13), None, true);
        gaps.go_on(S(15));
        gaps.catch_up(S(20));
        gaps.lose(S(30), None, false);
        let gap = |from, to, exact_from, is_damage| Gap { from, to, exact_from, is_damage };
        let told = [gap(S(10), Some(S(15)), Some(S(20)), true), gap(S(30), None, None, false)];
        assert_eq!(gaps.list(), told);
        let differing: Vec<u64> = (0..40).filter(|s| gaps.may_differ(S(*s))).collect();
        assert_eq!(differing, (10..20).chain(30..40).collect::<Vec<_>>());
    }

    #[test]
    fn many_gaps_are_counted() {
        let mut gaps = Gaps::default();
        for number in 0..250 {
            gaps.lose(S(10 * number), Some(S(10 * number + 1)), true);
            gaps.catch_up(S(10 * number + 2));
        }
        assert_eq!((gaps.list().len(), gaps.more()), (GAPS_MAX, 250 - GAPS_MAX as u64));
    }
}
