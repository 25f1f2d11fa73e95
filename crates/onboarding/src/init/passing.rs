//! Finds names of statuses with a changing number (`task 17`, then `task 18`): one falls silent, and its writer goes on with
//! the next. No module is declared for them, because it would wait for ever. A name that falls silent and has no successor
//! is a fault, and no such name.

use std::collections::BTreeMap;

use super::observations::Status;
use super::rhythm::at_least_ms;
use telltale_engine::time::Timestamp;

/// The shortest time after which such a name leaves.
const FORGET_MS_MIN: u64 = 60_000;
/// A name leaves after this many timeouts of silence.
const TIMEOUTS: u64 = 10;

/// Names that differ in numbers alone, and come and go.
#[derive(Debug, PartialEq, Eq)]
pub struct Passing {
    /// Matches them all.
    pub regex: String,
    pub example: String,
    /// How many were heard, and how many of them fell silent.
    pub heard: usize,
    pub ended: usize,
    pub timeout_ms: u64,
    pub forget_after_ms: u64,
}

/// The parts of a name: whether it is a word with a digit, and its text.
fn parts(name: &str) -> Vec<(bool, &str)> {
    let is_word = |letter: char| letter.is_ascii_alphanumeric();
    let mut parts = Vec::new();
    let mut rest = name;
    while let Some(first) = rest.chars().next() {
        let end = rest.find(|letter| is_word(letter) != is_word(first)).unwrap_or(rest.len());
        let (part, after) = rest.split_at(end);
        parts.push((part.bytes().any(|byte| byte.is_ascii_digit()), part));
        rest = after;
    }
    parts
}

/// A regular expression for all names that are like this one, with other numbers; `None` of one without a number.
fn regex(name: &str) -> Option<String> {
    let parts = parts(name);
    let is_numbered = parts.iter().any(|(is_numbered, _)| *is_numbered);
    let part = |(is_numbered, text): &(bool, &str)| match is_numbered {
        true => "[0-9A-Za-z]+".to_owned(),
        false => text.chars().fold(String::new(), |mut out, letter| {
            out.extend(r"\.+*?()|[]{}^$#&-~".contains(letter).then_some('\\'));
            out.push(letter);
            out
        }),
    };
    is_numbered.then(|| parts.iter().map(part).collect())
}

/// Those among these statuses, each with the names of its statuses.
pub fn find<'a>(statuses: &[(&'a str, &'a Status)], end: Timestamp) -> Vec<(Passing, Vec<&'a str>)> {
    let mut alike: BTreeMap<String, Vec<(&str, &Status)>> = BTreeMap::new();
    for &(name, status) in statuses {
        if let Some(regex) = regex(name) {
            alike.entry(regex).or_default().push((name, status));
        }
    }
    let passing = |(regex, all): (String, Vec<(&'a str, &'a Status)>)| {
        let follows = |it: &Status, gone: &Status| {
            gone.rhythm.has_ended(end)
                && !it.rhythm.has_ended(end)
                && it.rhythm.follows(&gone.rhythm)
                && !it.writers.is_disjoint(&gone.writers)
        };
        let is_followed = |gone: &Status| all.iter().any(|(_, it)| follows(it, gone));
        let ended = all.iter().filter(|(_, it)| is_followed(it)).count();
        // Those that were there all the time are declared, and so are those that ended without a follower.
        let passes = |it: &Status| is_followed(it) || all.iter().any(|(_, gone)| follows(it, gone));
        let all: Vec<_> = all.iter().copied().filter(|(_, it)| passes(it)).collect();
        let longest_s = all.iter().filter_map(|(_, it)| it.rhythm.longest_between_s()).fold(0.0, f64::max);
        let timeout_ms = at_least_ms((3.0 * longest_s).max(1.0));
        let passing = Passing {
            example: all.first()?.0.to_owned(),
            regex,
            heard: all.len(),
            ended,
            timeout_ms,
            forget_after_ms: FORGET_MS_MIN.max(TIMEOUTS * timeout_ms),
        };
        (ended > 0).then(|| (passing, all.iter().map(|(name, _)| *name).collect()))
    };
    alike.into_iter().filter_map(passing).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;
    use telltale_engine::input::WriterId;
    use telltale_engine::state::State;

    /// The status of a writer that speaks every half second between these two.
    fn spoken(writer: u8, from_s: u64, to_s: u64) -> Status {
        let mut rhythm = crate::init::rhythm::Rhythm::default();
        (from_s * 1000..=to_s * 1000).step_by(500).for_each(|at| rhythm.beat(Timestamp::from_millis(at)));
        Status {
            rhythm,
            last: State::Ok,
            worst: State::Ok,
            writers: BTreeSet::from([WriterId([writer; 16])]),
        }
    }

    #[track_caller]
    fn found(statuses: &[(&str, Status)]) -> Vec<(usize, usize, String)> {
        let statuses: Vec<(&str, &Status)> = statuses.iter().map(|(name, status)| (*name, status)).collect();
        let found = find(&statuses, Timestamp::from_millis(10_000));
        found.into_iter().map(|(it, _)| (it.heard, it.ended, it.regex)).collect()
    }

    #[test]
    fn a_number_that_another_one_follows_comes_and_goes() {
        let jobs = [
            ("worker: job 17", spoken(1, 0, 3)),
            ("worker: job 18", spoken(1, 4, 10)),
            ("worker: queue", spoken(1, 0, 10)),
        ];
        assert_eq!(found(&jobs), [(2, 1, r"worker: job [0-9A-Za-z]+".to_owned())]);
        let ids = [("a.b (3f-9c1)", spoken(1, 0, 3)), ("a.b (77-x2)", spoken(1, 4, 10))];
        let mixed = [
            ("channel 1", spoken(1, 0, 3)),
            ("channel 2", spoken(1, 0, 10)),
            ("channel 5", spoken(1, 4, 10)),
        ];
        let statuses: Vec<(&str, &Status)> = mixed.iter().map(|(name, status)| (*name, status)).collect();
        let names = find(&statuses, Timestamp::from_millis(10_000)).remove(0).1;
        assert_eq!(names, ["channel 1", "channel 5"], "one that was there all the time is declared");
        assert_eq!(found(&ids), [(2, 1, r"a\.b \([0-9A-Za-z]+\-[0-9A-Za-z]+\)".to_owned())]);
    }

    #[test]
    fn a_sensor_that_falls_silent_is_none_that_goes() {
        let silent = |others: &[(&'static str, Status)]| {
            let mut all = vec![("lidar 1", spoken(1, 0, 3))];
            all.extend(others.iter().cloned());
            found(&all)
        };
        assert_eq!(silent(&[("lidar 2", spoken(1, 0, 10))]), [], "the other was there before");
        assert_eq!(silent(&[("lidar 2", spoken(2, 4, 10))]), [], "another driver says the other");
        assert_eq!(silent(&[("lidar 2", spoken(1, 4, 6))]), [], "the driver is gone");
        assert_eq!(silent(&[("camera 2", spoken(1, 4, 10))]), [], "another name");
        assert_eq!(silent(&[]), []);
    }
}
