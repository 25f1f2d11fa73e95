//! The publishers of one topic: which of them are heard, and how many of their messages were lost.

mod fitting;
mod missed;
mod published;

use std::collections::BTreeMap;
use std::time::{Duration, SystemTime};

pub use self::published::Published;
use crate::transport::quality::Via;
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::sample_bytes::Guid;

/// Writers whose last sequence number is remembered. More of them come only from publishers that come and
/// go; then writers that are gone are forgotten.
const REMEMBERED_MAX: usize = 1024;

/// Lower numbers that go on for so long, without the last one, are of a writer that counts anew. A kept message that comes
/// again is followed by the last one.
const ANEW: Span = Span::from_secs(3);

/// The clock of a writer is not set forward by more than this between two messages.
const STAMP_AHEAD: Duration = Duration::from_secs(1);

/// Writers that discovery has not told of; if there are more, all are forgotten.
const UNDISCOVERED_MAX: usize = 256;

/// A writer as discovery describes it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Offer {
    /// As it stands on the wire.
    pub type_name: String,
    pub reliable: bool,
    pub transient_local: bool,
}

impl Offer {
    fn keeps_last_value(&self) -> bool {
        self.reliable && self.transient_local
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The sample is new; `lost` are missing before it.
    Take { lost: u64 },
    /// Received before, or to be received through another reader.
    Skip,
    /// Not of our type.
    WrongType,
}

#[derive(Debug, Default)]
pub struct Writers {
    /// When our reader was made, by our wall clock.
    listening: Option<SystemTime>,
    known: BTreeMap<Guid, Known>,
    /// Writers that discovery has not told of, and when their first message came.
    undiscovered: BTreeMap<Guid, Timestamp>,
    numbers: BTreeMap<Guid, Numbers>,
    /// The writer of the last sample that was handed over, since the present reader exists.
    spoke: Option<Guid>,
    /// Since the last report a message may have been missed that no writer tells again.
    missed: bool,
    /// When the initial writers are known.
    settled_at: Option<Timestamp>,
    /// Until when the reader must fit a best-effort writer, and one that keeps no last value.
    best_effort_until: Option<Timestamp>,
    volatile_until: Option<Timestamp>,
}

#[derive(Debug)]
struct Known {
    offer: Offer,
    since: Timestamp,
    since_wall: SystemTime,
    /// It was heard before, through an earlier reader.
    heard: bool,
    /// A reliable reader hears it, and has received the older messages that the writer keeps for readers that were killed.
    reliably: bool,
    /// When its first message was received, and when that was published by its source stamp.
    first: Option<(Timestamp, Option<SystemTime>)>,
}

/// When a sample was published and received.
#[derive(Debug, Clone, Copy)]
pub struct Came {
    pub source: Option<SystemTime>,
    pub received: Timestamp,
    /// It is for our reader, and not from before.
    pub is_now: bool,
}

/// The sequence numbers of a writer. One forged message can have any number and any stamp.
#[derive(Debug)]
struct Numbers {
    /// Samples up to it were received before.
    last: i64,
    /// The newest source stamp, and when it was received.
    newest: Option<(SystemTime, Timestamp)>,
    /// Since when lower numbers come, and the highest of them.
    lower: Option<(Timestamp, i64)>,
}

impl Numbers {
    fn stamp(&mut self, source: SystemTime, now: Timestamp) {
        let source = self.newest.map_or(source, |(newest, at)| {
            let most = newest + Duration::from_nanos(now.since(at).as_nanos()) + STAMP_AHEAD;
            source.clamp(newest, most)
        });
        self.newest = Some((source, now));
    }

    /// Whether a sample with a number that is not higher is new all the same: it was published after the newest one, or
    /// lower numbers have come for long to a reader that is not catching up.
    fn is_anew(&mut self, sequence: i64, came: Came, in_order: bool) -> bool {
        let Came { source, received: now, is_now } = came;
        if !is_now {
            return false;
        }
        if sequence == self.last {
            self.lower = None;
            return false;
        }
        if source.zip(self.newest).is_some_and(|(source, (newest, _))| source > newest) {
            return true;
        }
        let (since, highest) = self.lower.get_or_insert((now, sequence));
        let goes_on = sequence > std::mem::replace(highest, sequence.max(*highest));
        goes_on && in_order && now.since(*since) >= ANEW
    }
}

impl Writers {
    /// A new reader exists.
    pub fn listen(&mut self, wall: SystemTime) {
        (self.listening, self.spoke) = (Some(wall), None);
        // Those who are there are asked for no less than they offer.
        (self.settled_at, self.best_effort_until, self.volatile_until) = (None, None, None);
    }

    /// Takes the news of discovery at `now`. Returns the wrong types of writers that were not known before.
    pub fn update(
        &mut self,
        offers: BTreeMap<Guid, Offer>,
        dds_type: &str,
        (now, wall): (Timestamp, SystemTime),
    ) -> Vec<String> {
        let mut before = std::mem::take(&mut self.known);
        let mut wrong = Vec::new();
        for (guid, offer) in offers {
            let known = before.remove(&guid).unwrap_or_else(|| {
                if offer.type_name != dds_type {
                    wrong.push(offer.type_name.clone());
                }
                // It may have spoken before it knew our reader.
                self.missed |= self.spoke.is_some() && offer.type_name == dds_type && !offer.transient_local;
                let heard = self.numbers.contains_key(&guid);
                Known {
                    offer: offer.clone(),
                    since: now,
                    since_wall: wall,
                    heard,
                    reliably: false,
                    first: None,
                }
            });
            self.undiscovered.remove(&guid);
            self.known.insert(guid, Known { offer, ..known });
        }
        // Its last message may be out of date.
        self.missed |= self.spoke.take_if(|guid| before.contains_key(guid)).is_some();
        if self.numbers.len() > REMEMBERED_MAX {
            self.numbers.retain(|guid, _| self.known.contains_key(guid));
        }
        wrong
    }

    /// Whether this is the first message of a writer that discovery has not told of.
    pub fn is_first_of_undiscovered(&mut self, writer: &Guid, now: Timestamp) -> bool {
        if self.known.contains_key(writer) || self.undiscovered.contains_key(writer) {
            return false;
        }
        if self.undiscovered.len() >= UNDISCOVERED_MAX {
            self.undiscovered.clear();
        }
        self.undiscovered.insert(*writer, now);
        true
    }

    /// The type that a writer offers, as it stands on the wire.
    pub fn type_name(&self, writer: &Guid) -> Option<&str> {
        self.known.get(writer).map(|known| &*known.offer.type_name)
    }

    /// The number of writers of our type, and another type that is offered; whether all writers of our type keep their
    /// last messages for readers that come later, and whether one of them is best effort.
    pub fn publishers(&self, dds_type: &str) -> (u32, Option<&str>, bool, bool) {
        let ours = || self.ours(dds_type).map(|(_, known)| &known.offer);
        let mut types = self.known.values().map(|known| &*known.offer.type_name);
        let other = types.find(|theirs| *theirs != dds_type);
        let count = u32::try_from(ours().count()).unwrap_or(u32::MAX);
        let best_effort = ours().any(|offer| !offer.reliable);
        (count, other, count > 0 && ours().all(Offer::keeps_last_value), best_effort)
    }

    fn ours(&self, dds_type: &str) -> impl Iterator<Item = (&Guid, &Known)> {
        self.known.iter().filter(move |(_, known)| known.offer.type_name == dds_type)
    }

    /// Whether a writer of our type keeps its last message for readers that come later.
    pub fn keeps_last_value(&self, writer: &Guid, dds_type: &str) -> bool {
        let ours = |known: &Known| known.offer.transient_local && known.offer.type_name == dds_type;
        self.known.get(writer).is_some_and(ours)
    }

    /// No reliable reader is left: samples are taken in the order of their arrival.
    pub fn heard_by_best_effort_alone(&mut self) {
        self.known.values_mut().for_each(|known| known.reliably = false);
    }

    /// Whether a reliable reader has not yet received all that a best-effort one has.
    pub fn is_catching_up(&self, dds_type: &str) -> bool {
        let lags = |(guid, known): (_, &Known)| {
            known.offer.reliable && !known.reliably && self.numbers.contains_key(guid)
        };
        self.ours(dds_type).any(lags)
    }

    /// Judges one sample.
    pub fn judge(&mut self, writer: &Guid, sequence: i64, via: Via, dds_type: &str, came: Came) -> Verdict {
        let mut in_order = true;
        if let Some(Known { offer, reliably, .. }) = self.known.get_mut(writer) {
            if offer.type_name != dds_type {
                return Verdict::WrongType;
            }
            let last = self.numbers.get(writer).map(|it| it.last);
            *reliably |= via != Via::BestEffort && last.is_none_or(|last| sequence >= last);
            // A best-effort reader hands samples over in the order of arrival: one of them would overtake a
            // repair.
            if *reliably && via == Via::BestEffort {
                return Verdict::Skip;
            }
            in_order = *reliably || via == Via::BestEffort;
        }
        let known = self.numbers.entry(*writer).or_insert(Numbers {
            last: sequence.saturating_sub(1),
            newest: None,
            lower: None,
        });
        let is_next = sequence > known.last;
        if !is_next && !known.is_anew(sequence, came, in_order) {
            return Verdict::Skip;
        }
        let lost = if is_next { sequence.abs_diff(known.last) - 1 } else { 0 };
        (known.last, known.lower) = (sequence, None);
        if let Some(source) = came.source {
            known.stamp(source, came.received);
        }
        Verdict::Take { lost }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    pub const START: (Timestamp, SystemTime) = (Timestamp::from_millis(5000), SystemTime::UNIX_EPOCH);
    pub const OURS: &str = "ours";
    pub const BEFORE: Came = Came { source: None, received: Timestamp::ZERO, is_now: false };
    pub const A: Guid = [1; 16];
    pub const B: Guid = [2; 16];

    pub fn offer(type_name: &str, reliable: bool, transient_local: bool) -> Offer {
        Offer { type_name: type_name.to_owned(), reliable, transient_local }
    }

    pub fn writers(offers: &[(Guid, Offer)]) -> Writers {
        let mut writers = Writers::default();
        writers.update(offers.iter().cloned().collect(), OURS, START);
        writers
    }

    #[test]
    fn gaps_are_counted_for_each_writer() {
        let mut writers = writers(&[(A, offer(OURS, true, false)), (B, offer(OURS, true, false))]);
        let samples = [
            (A, 5, Verdict::Take { lost: 0 }),
            (B, 9, Verdict::Take { lost: 0 }),
            (A, 6, Verdict::Take { lost: 0 }),
            (A, 9, Verdict::Take { lost: 2 }),
            (B, 10, Verdict::Take { lost: 0 }),
            (A, 9, Verdict::Skip),
            (A, 7, Verdict::Skip),
            (A, 10, Verdict::Take { lost: 0 }),
        ];
        for (writer, sequence, expected) in samples {
            assert_eq!(writers.judge(&writer, sequence, Via::Reliable, OURS, BEFORE), expected, "{sequence}");
        }
    }

    /// One forged message silences no publisher, and one that is started again with the same id counts anew.
    #[test]
    fn a_number_that_is_far_too_high_hides_nothing_that_is_published_after_it() {
        let stamp = |ms: u64| Some(SystemTime::UNIX_EPOCH + Duration::from_millis(ms));
        let take = |writers: &mut Writers, sequence, source, ms| {
            let came = Came { source, received: Timestamp::from_millis(ms), is_now: true };
            writers.judge(&A, sequence, Via::BestEffort, OURS, came) != Verdict::Skip
        };
        for forged in [None, stamp(1), stamp(1000), stamp(10_u64.pow(12))] {
            let mut writers = writers(&[(A, offer(OURS, false, false))]);
            for number in 0..5 {
                assert!(take(
                    &mut writers,
                    7 + number,
                    stamp(100 * number as u64),
                    9000 + 100 * number as u64
                ));
            }
            assert!(take(&mut writers, 1 << 40, forged, 9450));
            assert!(!take(&mut writers, 11, stamp(400), 9460), "it was received");
            let next = (5..20).find(|&number| {
                take(&mut writers, 7 + number, stamp(100 * number as u64), 9000 + 100 * number as u64)
            });
            assert!(next <= Some(16), "{forged:?}: {next:?}");
            assert!(!take(&mut writers, 7, stamp(0), 12_000), "it was received");
        }
        let mut writers = writers(&[(A, offer(OURS, false, false))]);
        assert!(take(&mut writers, 1 << 40, stamp(10_u64.pow(12)), 9000), "the first of all is forged");
        let first = (0..60).find(|&number| {
            take(&mut writers, 7 + number, stamp(100 * number as u64), 9000 + 100 * number as u64)
        });
        assert_eq!(first, Some(30), "lower numbers count after three seconds");
        // A message from before our reader is not new when a second reader hears it later.
        let mut writers = super::tests::writers(&[(A, offer(OURS, false, false))]);
        let came = |ms, is_now| Came { source: stamp(ms), received: Timestamp::from_millis(9000), is_now };
        for (number, is_now) in [(1, true), (2, false), (3, false)] {
            let came = came(100 * number as u64, is_now);
            assert_eq!(writers.judge(&A, number, Via::BestEffort, OURS, came), Verdict::Take { lost: 0 });
        }
        let again = came(200, true);
        assert_eq!(writers.judge(&A, 2, Via::BestEffort, OURS, again), Verdict::Skip);
        // A reliable reader receives the older messages again, and the last one at their end.
        let mut writers = super::tests::writers(&[(A, offer(OURS, true, false))]);
        let came = |ms| Came { received: Timestamp::from_millis(ms), is_now: true, ..BEFORE };
        assert_eq!(writers.judge(&A, 100, Via::BestEffort, OURS, came(5000)), Verdict::Take { lost: 0 });
        for old in 1..100 {
            let came = came(5000 + 100 * old as u64);
            assert_eq!(writers.judge(&A, old, Via::Reliable, OURS, came), Verdict::Skip, "{old}");
        }
    }

    #[test]
    fn a_writer_is_not_read_out_of_order_once_a_reliable_reader_hears_it() {
        let mut writers = writers(&[(A, offer(OURS, true, false)), (B, offer(OURS, false, false))]);
        assert_eq!(
            writers.judge(&A, 5, Via::BestEffort, OURS, BEFORE),
            Verdict::Take { lost: 0 },
            "the first alone"
        );
        assert_eq!(writers.judge(&A, 5, Via::Reliable, OURS, BEFORE), Verdict::Skip);
        assert_eq!(writers.judge(&A, 7, Via::BestEffort, OURS, BEFORE), Verdict::Skip);
        assert_eq!(writers.judge(&A, 6, Via::Reliable, OURS, BEFORE), Verdict::Take { lost: 0 });
        assert_eq!(writers.judge(&A, 7, Via::LastValue, OURS, BEFORE), Verdict::Take { lost: 0 });
        writers.heard_by_best_effort_alone();
        assert_eq!(writers.judge(&A, 9, Via::BestEffort, OURS, BEFORE), Verdict::Take { lost: 1 });
        assert_eq!(writers.judge(&B, 7, Via::BestEffort, OURS, BEFORE), Verdict::Take { lost: 0 });
    }

    #[test]
    fn a_reliable_reader_counts_once_it_has_received_the_messages_kept_for_killed_ones() {
        let mut writers = writers(&[(A, offer(OURS, true, false)), (B, offer(OURS, false, false))]);
        assert!(!writers.is_catching_up(OURS), "nothing was heard");
        assert_eq!(writers.judge(&A, 100, Via::BestEffort, OURS, BEFORE), Verdict::Take { lost: 0 });
        assert_eq!(writers.judge(&B, 100, Via::BestEffort, OURS, BEFORE), Verdict::Take { lost: 0 });
        for old in 1..100 {
            assert_eq!(writers.judge(&A, old, Via::Reliable, OURS, BEFORE), Verdict::Skip);
        }
        assert!(writers.is_catching_up(OURS));
        assert_eq!(writers.judge(&A, 101, Via::BestEffort, OURS, BEFORE), Verdict::Take { lost: 0 });
        assert_eq!(writers.judge(&A, 100, Via::Reliable, OURS, BEFORE), Verdict::Skip);
        assert!(writers.is_catching_up(OURS));
        assert_eq!(writers.judge(&A, 101, Via::Reliable, OURS, BEFORE), Verdict::Skip);
        assert!(!writers.is_catching_up(OURS));
        assert_eq!(
            writers.judge(&A, 103, Via::BestEffort, OURS, BEFORE),
            Verdict::Skip,
            "102 may still be repaired"
        );
        assert_eq!(writers.judge(&A, 102, Via::Reliable, OURS, BEFORE), Verdict::Take { lost: 0 });
    }

    #[test]
    fn another_type_is_told_once_and_never_taken() {
        let mut writers = Writers::default();
        let offers: BTreeMap<_, _> =
            [(A, offer("theirs", true, false)), (B, offer(OURS, true, false))].into();
        assert_eq!(writers.update(offers.clone(), OURS, START), ["theirs"]);
        assert_eq!(writers.update(offers, OURS, START), [""; 0]);
        assert_eq!(writers.publishers(OURS), (1, Some("theirs"), false, false));
        assert_eq!(writers.judge(&A, 1, Via::Reliable, OURS, BEFORE), Verdict::WrongType);
        assert_eq!(writers.judge(&B, 1, Via::Reliable, OURS, BEFORE), Verdict::Take { lost: 0 });
    }

    #[test]
    fn what_is_remembered_is_bounded() {
        let mut writers = Writers::default();
        for index in 0..3 * REMEMBERED_MAX as u32 {
            let mut guid = [0; 16];
            guid[..4].copy_from_slice(&index.to_le_bytes());
            writers.update([(guid, offer(OURS, true, false))].into(), OURS, START);
            writers.judge(&guid, 1, Via::Reliable, OURS, BEFORE);
        }
        assert!(writers.numbers.len() <= REMEMBERED_MAX + 1);
    }
}
