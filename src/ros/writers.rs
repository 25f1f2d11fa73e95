//! The publishers of one topic: which of them are heard, through which reader, and what of theirs
//! was lost.

use std::collections::BTreeMap;
use std::time::{Duration, SystemTime};

use crate::engine::time::{Span, Timestamp};

/// A writer's globally unique id, as its bytes.
pub type Guid = [u8; 16];

/// Writers whose last sequence number is remembered. More of them come only from publishers that
/// come and go; then those that are gone are forgotten.
const REMEMBERED_MAX: usize = 1024;

/// What comes from a writer this long after it was discovered may be from before our time.
const HISTORY: Span = Span::from_secs(3);
/// A message this much older than the discovery of its writer is. Less is the time that discovery
/// takes, or clocks that differ.
const HISTORY_AGE: Duration = Duration::from_secs(1);
/// A publisher that does not say when it published hands its history over at once: what comes later
/// than this after its first message is of now.
const HISTORY_BURST: Span = Span::from_millis(300);

/// What discovery says of a writer.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Offer {
    /// As it stands on the wire.
    pub type_name: String,
    pub reliable: bool,
    pub transient_local: bool,
}

/// The reader that a sample came through. They share one cache of samples in the library, so each
/// may see what was meant for another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Via {
    Reliable,
    /// Reliable, and asks for the last value from before its time.
    LastValue,
    BestEffort,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// The sample is new; `lost` are missing before it.
    Take { lost: u64 },
    /// Seen already, or to come through another reader.
    Skip,
    /// Not of our type.
    WrongType,
}

#[derive(Debug, Default)]
pub struct Writers {
    known: BTreeMap<Guid, Known>,
    /// The last sequence number of each writer: what is not after it was seen already.
    last: BTreeMap<Guid, i64>,
}

#[derive(Debug)]
struct Known {
    offer: Offer,
    since: Timestamp,
    since_wall: SystemTime,
    /// When its first message was received.
    first: Option<Timestamp>,
}

impl Writers {
    /// Takes what discovery says `now`. Returns the wrong types of writers that were not known before.
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
                Known { offer: offer.clone(), since: now, since_wall: wall, first: None }
            });
            self.known.insert(guid, Known { offer, ..known });
        }
        if self.last.len() > REMEMBERED_MAX {
            self.last.retain(|guid, _| self.known.contains_key(guid));
        }
        wrong
    }

    pub fn knows(&self, writer: &Guid) -> bool {
        self.known.contains_key(writer)
    }

    /// The type that a writer offers, as it stands on the wire.
    pub fn type_name(&self, writer: &Guid) -> Option<&str> {
        self.known.get(writer).map(|known| &*known.offer.type_name)
    }

    /// How many offer our type, and another type that is offered.
    pub fn publishers(&self, dds_type: &str) -> (u32, Option<&str>) {
        let types = || self.known.values().map(|known| &*known.offer.type_name);
        let ours = types().filter(|theirs| *theirs == dds_type).count();
        (u32::try_from(ours).unwrap_or(u32::MAX), types().find(|theirs| *theirs != dds_type))
    }

    /// Whether a writer of our type keeps its last message for readers that come later.
    pub fn keeps_last_value(&self, writer: &Guid, dds_type: &str) -> bool {
        let ours = |known: &Known| known.offer.transient_local && known.offer.type_name == dds_type;
        self.known.get(writer).is_some_and(ours)
    }

    /// Whether a message is from before our time. The library asks every transient-local writer for
    /// its history, even for a reader that wants none.
    pub fn is_history(&mut self, writer: &Guid, source: Option<SystemTime>, now: Timestamp) -> bool {
        self.known.get_mut(writer).is_some_and(|known| {
            let first = *known.first.get_or_insert(now);
            let old = match source {
                Some(source) => source + HISTORY_AGE < known.since_wall,
                None => now.since(first) < HISTORY_BURST,
            };
            known.offer.transient_local && now.since(known.since) < HISTORY && old
        })
    }

    /// Whether a writer of our type offers what only such a reader takes.
    pub fn need(&self, via: Via, dds_type: &str) -> bool {
        let offers = self.known.values().map(|known| &known.offer);
        let mut offers = offers.filter(|offer| offer.type_name == dds_type);
        match via {
            Via::Reliable => true,
            Via::LastValue => offers.any(|offer| offer.reliable && offer.transient_local),
            Via::BestEffort => offers.any(|offer| !offer.reliable),
        }
    }

    /// Judges one sample.
    pub fn judge(&mut self, writer: &Guid, sequence: i64, via: Via, dds_type: &str) -> Verdict {
        if let Some(Known { offer, .. }) = self.known.get(writer) {
            if offer.type_name != dds_type {
                return Verdict::WrongType;
            }
            // A best-effort reader hands over in the order of arrival: it would overtake a repair.
            if offer.reliable && via == Via::BestEffort {
                return Verdict::Skip;
            }
        }
        match self.last.insert(*writer, sequence) {
            None => Verdict::Take { lost: 0 },
            Some(last) if sequence > last => {
                Verdict::Take { lost: u64::try_from(sequence - last - 1).unwrap_or(0) }
            }
            Some(last) => {
                self.last.insert(*writer, last);
                Verdict::Skip
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const START: (Timestamp, SystemTime) = (Timestamp::from_millis(5000), SystemTime::UNIX_EPOCH);
    const OURS: &str = "ours";
    const A: Guid = [1; 16];
    const B: Guid = [2; 16];

    fn offer(type_name: &str, reliable: bool, transient_local: bool) -> Offer {
        Offer { type_name: type_name.to_owned(), reliable, transient_local }
    }

    fn writers(offers: &[(Guid, Offer)]) -> Writers {
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
            assert_eq!(writers.judge(&writer, sequence, Via::Reliable, OURS), expected, "{sequence}");
        }
    }

    #[test]
    fn a_reliable_writer_is_never_read_out_of_order() {
        let mut writers = writers(&[(A, offer(OURS, true, false)), (B, offer(OURS, false, false))]);
        assert_eq!(writers.judge(&A, 7, Via::BestEffort, OURS), Verdict::Skip);
        assert_eq!(writers.judge(&A, 6, Via::Reliable, OURS), Verdict::Take { lost: 0 });
        assert_eq!(writers.judge(&A, 7, Via::LastValue, OURS), Verdict::Take { lost: 0 });
        assert_eq!(writers.judge(&B, 7, Via::BestEffort, OURS), Verdict::Take { lost: 0 });
    }

    #[test]
    fn another_type_is_told_once_and_never_taken() {
        let mut writers = Writers::default();
        let offers: BTreeMap<_, _> =
            [(A, offer("theirs", true, false)), (B, offer(OURS, true, false))].into();
        assert_eq!(writers.update(offers.clone(), OURS, START), ["theirs"]);
        assert_eq!(writers.update(offers, OURS, START), [""; 0]);
        assert_eq!(writers.publishers(OURS), (1, Some("theirs")));
        assert_eq!(writers.judge(&A, 1, Via::Reliable, OURS), Verdict::WrongType);
        assert_eq!(writers.judge(&B, 1, Via::Reliable, OURS), Verdict::Take { lost: 0 });
    }

    #[test]
    fn readers_follow_what_is_offered() {
        let cases = [
            (offer(OURS, true, false), [true, false, false]),
            (offer(OURS, true, true), [true, true, false]),
            (offer(OURS, false, false), [true, false, true]),
            (offer("theirs", false, true), [true, false, false]),
        ];
        for (offer, expected) in cases {
            let writers = writers(&[(A, offer.clone())]);
            let needed = [Via::Reliable, Via::LastValue, Via::BestEffort].map(|via| writers.need(via, OURS));
            assert_eq!(needed, expected, "{offer:?}");
        }
    }

    #[test]
    fn only_old_messages_of_a_new_transient_local_writer_are_history() {
        let wall = SystemTime::UNIX_EPOCH + Duration::from_secs(100);
        let mut writers = Writers::default();
        let offers = [(A, offer(OURS, true, true)), (B, offer(OURS, true, false))];
        writers.update(offers.clone().into(), OURS, (Timestamp::from_millis(5000), wall));
        // Discovery has news of others: these two are as old as they were.
        writers.update(offers.into(), OURS, (Timestamp::from_millis(60_000), wall));
        let source = |millis| Some(SystemTime::UNIX_EPOCH + Duration::from_millis(millis));
        let cases = [
            (A, source(98_000), 5100, true),
            (A, None, 5100, true),
            (A, None, 5399, true),
            (A, None, 5400, false),
            (A, source(99_500), 5100, false),
            (A, source(98_000), 8100, false),
            (B, source(98_000), 5100, false),
            ([3; 16], source(98_000), 5100, false),
        ];
        for (writer, source, now, expected) in cases {
            assert_eq!(writers.is_history(&writer, source, Timestamp::from_millis(now)), expected, "{now}");
        }
    }

    #[test]
    fn what_is_remembered_is_bounded() {
        let mut writers = Writers::default();
        for index in 0..3 * REMEMBERED_MAX as u32 {
            let mut guid = [0; 16];
            guid[..4].copy_from_slice(&index.to_le_bytes());
            writers.update([(guid, offer(OURS, true, false))].into(), OURS, START);
            writers.judge(&guid, 1, Via::Reliable, OURS);
        }
        assert!(writers.last.len() <= REMEMBERED_MAX + 1);
    }
}
