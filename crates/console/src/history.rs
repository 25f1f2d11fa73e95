//! The messages of one vehicle from a span of time, read from its log at the hub. The console's pages and API, and
//! `telltale fleet export`, read it here.

use serde_json::{Value, json};
use telltale_fleet::history::{History, Unknown};
use telltale_fleet::message::{Batch, Mark, Message, VehicleId};
use telltale_fleet::reading::{From, Logs};

use crate::state::time;

/// Messages of an answer, and batches that are read for it. The rest is asked for with the time of the last one.
const MESSAGES_MAX: usize = 10_000;
const BATCHES_MAX: usize = 5000;
/// Unpacked bytes of these batches.
const READ_BYTES_MAX: usize = 32 << 20;

/// A message may have been made this long before the hub took it and still be in a batch with later ones.
const MARGIN_MS: i64 = 15 * 60_000;

/// The messages that were read, and their gaps.
#[derive(Debug, Default)]
pub struct Known {
    history: History,
    /// The number of the first message of the hub that was read.
    first: Option<u64>,
    /// The hub has no older messages.
    is_from_oldest: bool,
    pub contradictions: usize,
    pub refused: usize,
    /// The end was reached.
    pub is_whole: bool,
    /// The hub has nothing later of this vehicle.
    is_to_newest: bool,
    /// Messages at the end that the vehicle told and the hub lost.
    lost: Option<Unknown>,
}

/// A message, or a gap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Part<'a> {
    Message(&'a Message),
    /// Messages that are missing.
    Missing(Unknown),
}

impl Part<'_> {
    /// When the vehicle made it, if it is a message.
    pub fn at(&self) -> Option<i64> {
        match self {
            Part::Message(message) => Some(message.at),
            Part::Missing(_) => None,
        }
    }
}

/// The parts of a time, as many as an answer has.
#[derive(Debug)]
pub struct Told<'a> {
    pub parts: Vec<Part<'a>>,
    /// None is left out.
    pub is_whole: bool,
}

impl Known {
    /// All messages, in their order.
    pub fn messages(&self) -> impl Iterator<Item = &Message> {
        self.history.messages()
    }

    /// Takes the messages of one batch.
    pub fn take(&mut self, batch: Batch) {
        self.contradictions += self.history.take(batch).contradictions;
    }

    /// The number of the oldest message of this log that the hub has.
    pub fn oldest_is(&mut self, number: u64) {
        self.is_from_oldest = self.first == Some(number);
    }

    /// The vehicle told this message. The hub may have lost it: the log of another vehicle may have pushed it out.
    pub fn was_told(&mut self, end: Mark) {
        let last = self.history.messages().last().map(Message::end);
        if self.is_to_newest && last < Some(end) {
            let after = last.filter(|last| last.epoch == end.epoch).map_or(0, |last| last.n);
            self.lost = Some(Unknown { from: Mark { n: after + 1, ..end }, to: end.n, why: None });
        }
    }

    /// The messages of a time, by the vehicle's clock, and their gaps, in order.
    pub fn parts(&self, from: i64, to: i64) -> Vec<Part<'_>> {
        let mut missing = self.unknown().into_iter().peekable();
        let mut parts = Vec::new();
        let is_in = |ms: i64| (from..=to).contains(&ms);
        // It was made between the messages around it; before the first one nothing says when.
        let is_asked = |before: Option<i64>, after: i64| match before {
            Some(before) if is_in(before) && is_in(after) => true,
            Some(before) => before.min(after) < to && before.max(after) > from,
            None => after >= from,
        };
        let mut before = None;
        for message in self.history.messages() {
            while let Some(it) = missing.next_if(|it| it.from < message.mark()) {
                if is_asked(before, message.at) {
                    parts.push(Part::Missing(it));
                }
            }
            if is_in(message.at) {
                parts.push(Part::Message(message));
            }
            before = Some(message.at);
        }
        parts.extend(missing.filter(|_| is_asked(before, i64::MAX)).map(Part::Missing));
        parts
    }

    /// The same, with the bound of an answer.
    pub fn told(&self, from: i64, to: i64) -> Told<'_> {
        let mut parts = self.parts(from, to);
        let messages = parts.iter().enumerate().filter(|(_, part)| matches!(part, Part::Message(_)));
        let last = messages.map(|(index, _)| index).nth(MESSAGES_MAX - 1);
        if let Some(last) = last {
            parts.truncate(last + 1);
        }
        Told { parts, is_whole: self.is_whole && last.is_none() }
    }

    /// The gaps. Of those before the first message that was read, only the ones that the vehicle declared.
    fn unknown(&self) -> Vec<Unknown> {
        let first = self.history.messages().next().map(Message::mark);
        let mut unknown = self.history.unknown();
        unknown.retain(|it| {
            self.is_from_oldest || it.why.is_some() || first.is_some_and(|first| it.from > first)
        });
        unknown.extend(self.lost);
        unknown
    }
}

/// Reads the messages of a vehicle from a time by its own clock, in milliseconds since 1970. That clock is ahead of the hub's by
/// so many milliseconds.
///
/// # Errors
/// The hub does not answer.
pub async fn read(
    logs: &Logs,
    id: &VehicleId,
    from_ms: i64,
    to_ms: i64,
    skew_ms: i64,
) -> Result<Known, String> {
    let mut known = Known::default();
    let mut from = From::Time(from_ms.saturating_sub(skew_ms.max(0)).saturating_sub(MARGIN_MS));
    let mut read_bytes = 0;
    for _ in 0..BATCHES_MAX {
        let Some(found) = logs.next(id, from).await? else {
            (known.is_whole, known.is_to_newest) = (true, true);
            break;
        };
        from = From::After(found.number);
        known.first.get_or_insert(found.number);
        let (bytes, batch) = Batch::weigh(&found.packed, id);
        match batch {
            Ok(batch) => {
                // What follows is later still. A vehicle's clock may be ahead for a while, and the hub's is not then.
                let is_later = |ms: i64| ms > to_ms.saturating_add(MARGIN_MS);
                let by_hub = found.stored_ms.map(|ms| ms.saturating_add(skew_ms.max(0)));
                let is_over = batch.messages.iter().all(|it| is_later(it.at)) && by_hub.is_none_or(is_later);
                known.take(batch);
                if is_over {
                    known.is_whole = true;
                    break;
                }
            }
            Err(_) => known.refused += 1,
        }
        read_bytes += bytes;
        if read_bytes > READ_BYTES_MAX {
            break;
        }
    }
    Ok(known)
}

/// A message for programs.
pub fn message(message: &Message) -> Value {
    let mut row = json!(message);
    row["at"] = Value::from(time(message.at));
    row
}

/// Missing messages for programs.
pub fn missing(it: &Unknown) -> Value {
    json!({ "epoch": it.from.epoch.to_string(), "n": it.from.n, "to": it.to, "why": it.why })
}

#[cfg(test)]
mod tests {
    use super::*;
    use telltale_fleet::message::{Content, Epoch, Gap, GapReason};

    const SECOND: i64 = 1000;

    /// Messages with these numbers, each made in the second of its number. Some are gaps up to a number.
    fn known(parts: &[(u64, Option<u64>)]) -> Known {
        let message = |&(n, gap): &(u64, Option<u64>)| {
            let content =
                gap.map_or(Content::Goodbye, |to| Content::Gap(Gap { to, why: GapReason::Overflow }));
            Message { epoch: Epoch { start: 1, nonce: 0 }, n, at: n as i64 * SECOND, content }
        };
        let messages = parts.iter().map(message).collect();
        let mut known = Known { first: Some(7), is_whole: true, ..Known::default() };
        let id = VehicleId::new("a").unwrap();
        known.history.take(Batch { id, key: String::new(), sent: 0, messages });
        known
    }

    fn told(known: &Known, from_s: i64, to_s: i64) -> Vec<(u64, Option<u64>)> {
        let part = |part: &Part<'_>| match part {
            Part::Message(message) => (message.n, None),
            Part::Missing(it) => (it.from.n, Some(it.to)),
        };
        known.told(from_s * SECOND, to_s.saturating_mul(SECOND)).parts.iter().map(part).collect()
    }

    #[test]
    fn what_is_missing_stands_in_its_place_and_in_its_time() {
        let known = known(&[(5, None), (6, None), (9, None), (10, Some(12)), (13, None), (20, Some(22))]);
        let all = [
            (5, None),
            (6, None),
            (7, Some(8)),
            (9, None),
            (10, Some(12)),
            (13, None),
            (14, Some(19)),
            (20, Some(22)),
        ];
        assert_eq!(told(&known, 0, i64::MAX), all);
        assert_eq!(told(&known, 5, 6), [(5, None), (6, None)]);
        assert_eq!(told(&known, 6, 9), [(6, None), (7, Some(8)), (9, None)]);
        assert_eq!(told(&known, 7, 8), [(7, Some(8))], "it may be of this time");
        assert_eq!(told(&known, 10, 12), [(10, Some(12))]);
        assert_eq!(told(&known, 30, 40), [(14, Some(19)), (20, Some(22))]);
        assert_eq!(told(&known, 0, 3), []);
    }

    #[test]
    fn what_the_hub_no_longer_has_is_missing_where_its_log_begins() {
        let mut known = known(&[(5, None), (6, None)]);
        known.oldest_is(6);
        assert_eq!(told(&known, 0, 9), [(5, None), (6, None)], "there is more, and it was not asked for");
        known.oldest_is(7);
        assert_eq!(told(&known, 0, 9), [(1, Some(4)), (5, None), (6, None)]);
        assert_eq!(told(&known, 5, 5), [(1, Some(4)), (5, None)]);
        assert_eq!(told(&known, 6, 9), [(6, None)]);
    }

    #[test]
    fn what_was_told_and_is_gone_from_the_hub_is_missing_at_the_end() {
        let mut some = known(&[(5, None), (6, None)]);
        let end = Mark { n: 9, ..some.messages().last().unwrap().mark() };
        some.was_told(end);
        assert_eq!(told(&some, 0, 9), [(5, None), (6, None)], "the rest was not asked for");
        some.is_to_newest = true;
        some.was_told(end);
        assert_eq!(told(&some, 0, 9), [(5, None), (6, None), (7, Some(9))]);
        let mut nothing = Known { is_to_newest: true, ..known(&[]) };
        nothing.was_told(end);
        assert_eq!(told(&nothing, 0, 9), [(1, Some(9))]);
    }

    #[test]
    fn an_answer_is_bounded_and_says_so() {
        let all: Vec<(u64, Option<u64>)> = (1..=MESSAGES_MAX as u64 + 1).map(|n| (2 * n, None)).collect();
        let mut known = known(&[]);
        for some in all.chunks(1000) {
            let more = self::known(some);
            let messages = more.history.messages().cloned().collect();
            known.history.take(Batch {
                id: VehicleId::new("a").unwrap(),
                key: String::new(),
                sent: 0,
                messages,
            });
        }
        let told = known.told(0, i64::MAX);
        assert!(!told.is_whole);
        assert_eq!(told.parts.len(), 2 * MESSAGES_MAX - 1, "gaps are not counted");
        assert!(matches!(told.parts.last(), Some(Part::Message(_))));
        assert!(known.told(0, 1000 * SECOND).is_whole);
    }
}
