//! The publishers of one topic: which of them are heard, through which reader, and how many of their
//! messages were lost.

use super::readers::Fitting;
use crate::library::qos::Via;
use std::collections::BTreeMap;
use std::time::{Duration, SystemTime};
use telltale_msg::sample_bytes::Guid;

use telltale_engine::time::{Span, Timestamp};

/// Writers whose last sequence number is remembered. More of them come only from publishers that come and
/// go; then writers that are gone are forgotten.
const REMEMBERED_MAX: usize = 1024;

/// Writers that discovery has not told of; if there are more, all are forgotten.
const UNDISCOVERED_MAX: usize = 256;

/// A sample that arrives within this time after its writer was discovered may be from before our start.
const HISTORY: Span = Span::from_secs(3);
/// The same of a writer that keeps its last message: it is asked for that after the others are found, and may have to send
/// it twice.
const KEPT_HISTORY: Span = Span::from_secs(10);
/// A publisher of another quality is expected back for this long after it has gone, such as a restarted
/// driver: until then the reader stays one that fits it too.
const QUALITY_REMEMBERED: Span = Span::from_secs(60);
/// Publishers that exist already are found within this time after the first one: only then is it known
/// which reader fits all of them.
const SETTLING: Span = Span::from_secs(1);
/// Clocks of synchronized machines differ by less, and a message takes less time on its way.
const CLOCKS_DIFFER: Duration = Duration::from_millis(50);
/// History is handed over at once. If a publisher gives no source stamps, or its messages come no faster
/// than they were published (so its clock is behind ours), a message that arrives later than this after its
/// first one is current.
const HISTORY_BURST: Span = Span::from_millis(300);

/// When a message was published, as far as that matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Published {
    /// Before our reader existed: it was not published to us.
    Before,
    /// While our reader existed, but before we knew its writer: it may be meant for us, but comes late.
    Unfound,
    Now,
}

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
    /// The last sequence number of each writer: samples up to it were received before.
    last: BTreeMap<Guid, i64>,
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
                let heard = self.last.contains_key(&guid);
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
        if self.last.len() > REMEMBERED_MAX {
            self.last.retain(|guid, _| self.known.contains_key(guid));
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
        let offers = || self.known.values().map(|known| &known.offer);
        let ours = || offers().filter(|offer| offer.type_name == dds_type);
        let other = offers().map(|offer| &*offer.type_name).find(|theirs| *theirs != dds_type);
        let count = u32::try_from(ours().count()).unwrap_or(u32::MAX);
        let best_effort = ours().any(|offer| !offer.reliable);
        (count, other, count > 0 && ours().all(Offer::keeps_last_value), best_effort)
    }

    /// Whether a writer of our type keeps its last message for readers that come later.
    pub fn keeps_last_value(&self, writer: &Guid, dds_type: &str) -> bool {
        let ours = |known: &Known| known.offer.transient_local && known.offer.type_name == dds_type;
        self.known.get(writer).is_some_and(ours)
    }

    /// A message of a writer that keeps nothing may be missing: another writer's kept message counts, or the reader has ended
    /// that would have asked for it again.
    pub fn may_miss(&mut self, dds_type: &str) {
        let mut ours = self.known.values().filter(|it| it.offer.type_name == dds_type);
        self.missed |= ours.any(|it| !it.offer.transient_local);
    }

    /// A message may be missing of each writer. Those that keep their last one tell it again.
    pub fn may_miss_any(&mut self) {
        self.missed |= self.spoke.is_some();
    }

    /// A sample of this writer is handed over.
    pub fn speaks(&mut self, writer: &Guid) {
        self.spoke = Some(*writer);
    }

    /// Whether a message may have been missed since the last report.
    pub fn may_have_missed(&self) -> bool {
        self.missed
    }

    /// A report is made.
    pub fn reported(&mut self) {
        self.missed = false;
    }

    /// Judges when a message was published. The library asks every writer for its history, even for a
    /// reader that wants none: a transient-local writer has its last messages, a volatile one those that a
    /// killed reader did not acknowledge. The writer's clock decides, as long as it is plausible.
    pub fn published(&mut self, writer: &Guid, source: Option<SystemTime>, now: Timestamp) -> Published {
        let before = self.listening.zip(source).is_some_and(|(since, source)| source + CLOCKS_DIFFER < since);
        let Some(known) = self.known.get_mut(writer) else {
            let first = self.undiscovered.get(writer).copied().filter(|_| before);
            let is_history = first.is_some_and(|first| now.since(first) < HISTORY);
            return if is_history { Published::Unfound } else { Published::Now };
        };
        let (first, first_source) = *known.first.get_or_insert((now, source));
        let burst = now.since(first) < HISTORY_BURST;
        let history = if known.offer.transient_local { KEPT_HISTORY } else { HISTORY };
        if now.since(known.since) >= history {
            return Published::Now;
        }
        let Some(source) = source else {
            let kept = known.offer.transient_local && burst;
            return if kept { Published::Before } else { Published::Now };
        };
        let of_now = source + CLOCKS_DIFFER >= known.since_wall;
        if of_now || !burst && !is_faster(first_source, source, now.since(first)) {
            return Published::Now;
        }
        if before && !known.heard { Published::Before } else { Published::Unfound }
    }

    /// The readers that fit the writers of our type: a writer that is asked for more than it offers complains in its
    /// own log. Where last values count, one of best effort that has sent nothing takes none from the others: each kind
    /// has its reader then. `None` if there is no writer yet, or none any more.
    pub fn fitting(&mut self, wants_last_value: bool, dds_type: &str, now: Timestamp) -> Option<Fitting> {
        let ours = || self.known.values().filter(|known| known.offer.type_name == dds_type);
        let found = ours().next().is_some();
        let keeps = wants_last_value && ours().any(|known| known.offer.keeps_last_value());
        let mut best_effort = ours().filter(|known| !known.offer.reliable).peekable();
        let any_best_effort = best_effort.peek().is_some();
        let lasts = best_effort.any(|known| !wants_last_value || known.first.is_some());
        let volatile = ours().any(|known| known.offer.reliable && !known.offer.keeps_last_value());
        let remember = |until: &mut Option<Timestamp>, seen: bool| {
            if seen {
                *until = Some(now + QUALITY_REMEMBERED);
            }
            until.is_some_and(|until| now < until)
        };
        let lasts = remember(&mut self.best_effort_until, lasts);
        let best_effort = lasts || any_best_effort && !keeps;
        let volatile = remember(&mut self.volatile_until, volatile);
        let settling = found && now < *self.settled_at.get_or_insert(now + SETTLING);
        let wanted: Fitting = match (best_effort || settling, any_best_effort, wants_last_value && !volatile)
        {
            (true, ..) => &[Via::BestEffort],
            (false, true, true) => &[Via::LastValue, Via::BestEffort],
            (false, true, false) => &[Via::Reliable, Via::BestEffort],
            (false, false, true) => &[Via::LastValue],
            (false, false, false) => &[Via::Reliable],
        };
        found.then_some(wanted)
    }

    /// Until when others may be found that are there already.
    pub fn settles_at(&self, now: Timestamp) -> Option<Timestamp> {
        self.settled_at.filter(|at| now < *at)
    }

    /// When to ask again which reader fits, after it was asked last.
    pub fn fitting_due(&self, asked: Timestamp) -> Option<Timestamp> {
        let all = [self.settled_at, self.best_effort_until, self.volatile_until];
        all.into_iter().flatten().filter(|at| asked < *at).min()
    }

    /// Whether these readers ask for no last value although a writer of our type keeps one. At the beginning, while others
    /// may be found still, no reader asks for it.
    pub fn leaves_last_value(&self, readers: Fitting, dds_type: &str, now: Timestamp) -> bool {
        let mut offers = self.known.values().map(|known| &known.offer);
        let any_keeps = offers.any(|offer| offer.type_name == dds_type && offer.keeps_last_value());
        any_keeps && !readers.contains(&Via::LastValue) && self.settles_at(now).is_none()
    }

    /// No reliable reader is left: samples are taken in the order of their arrival.
    pub fn heard_by_best_effort_alone(&mut self) {
        self.known.values_mut().for_each(|known| known.reliably = false);
    }

    /// Whether a reliable reader has not yet received all that a best-effort one has.
    pub fn is_catching_up(&self, dds_type: &str) -> bool {
        let mut ours = self.known.iter().filter(|(_, known)| known.offer.type_name == dds_type);
        ours.any(|(guid, known)| known.offer.reliable && !known.reliably && self.last.contains_key(guid))
    }

    /// Judges one sample.
    pub fn judge(&mut self, writer: &Guid, sequence: i64, via: Via, dds_type: &str) -> Verdict {
        if let Some(Known { offer, reliably, .. }) = self.known.get_mut(writer) {
            if offer.type_name != dds_type {
                return Verdict::WrongType;
            }
            let last = self.last.get(writer);
            *reliably |= via != Via::BestEffort && last.is_none_or(|last| sequence >= *last);
            // A best-effort reader hands samples over in the order of arrival: one of them would overtake a
            // repair.
            if *reliably && via == Via::BestEffort {
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

/// Whether messages came much faster than they were published, since the first.
fn is_faster(first: Option<SystemTime>, source: SystemTime, took: Span) -> bool {
    let published = first.and_then(|first| source.duration_since(first).ok()).unwrap_or_default();
    published.as_nanos() > 2 * u128::from(took.as_nanos())
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
    fn a_writer_is_not_read_out_of_order_once_a_reliable_reader_hears_it() {
        let mut writers = writers(&[(A, offer(OURS, true, false)), (B, offer(OURS, false, false))]);
        assert_eq!(writers.judge(&A, 5, Via::BestEffort, OURS), Verdict::Take { lost: 0 }, "the first alone");
        assert_eq!(writers.judge(&A, 5, Via::Reliable, OURS), Verdict::Skip);
        assert_eq!(writers.judge(&A, 7, Via::BestEffort, OURS), Verdict::Skip);
        assert_eq!(writers.judge(&A, 6, Via::Reliable, OURS), Verdict::Take { lost: 0 });
        assert_eq!(writers.judge(&A, 7, Via::LastValue, OURS), Verdict::Take { lost: 0 });
        writers.heard_by_best_effort_alone();
        assert_eq!(writers.judge(&A, 9, Via::BestEffort, OURS), Verdict::Take { lost: 1 });
        assert_eq!(writers.judge(&B, 7, Via::BestEffort, OURS), Verdict::Take { lost: 0 });
    }

    #[test]
    fn a_reliable_reader_counts_once_it_has_received_the_messages_kept_for_killed_ones() {
        let mut writers = writers(&[(A, offer(OURS, true, false)), (B, offer(OURS, false, false))]);
        assert!(!writers.is_catching_up(OURS), "nothing was heard");
        assert_eq!(writers.judge(&A, 100, Via::BestEffort, OURS), Verdict::Take { lost: 0 });
        assert_eq!(writers.judge(&B, 100, Via::BestEffort, OURS), Verdict::Take { lost: 0 });
        for old in 1..100 {
            assert_eq!(writers.judge(&A, old, Via::Reliable, OURS), Verdict::Skip);
        }
        assert!(writers.is_catching_up(OURS));
        assert_eq!(writers.judge(&A, 101, Via::BestEffort, OURS), Verdict::Take { lost: 0 });
        assert_eq!(writers.judge(&A, 100, Via::Reliable, OURS), Verdict::Skip);
        assert!(writers.is_catching_up(OURS));
        assert_eq!(writers.judge(&A, 101, Via::Reliable, OURS), Verdict::Skip);
        assert!(!writers.is_catching_up(OURS));
        assert_eq!(writers.judge(&A, 103, Via::BestEffort, OURS), Verdict::Skip, "102 may still be repaired");
        assert_eq!(writers.judge(&A, 102, Via::Reliable, OURS), Verdict::Take { lost: 0 });
    }

    #[test]
    fn another_type_is_told_once_and_never_taken() {
        let mut writers = Writers::default();
        let offers: BTreeMap<_, _> =
            [(A, offer("theirs", true, false)), (B, offer(OURS, true, false))].into();
        assert_eq!(writers.update(offers.clone(), OURS, START), ["theirs"]);
        assert_eq!(writers.update(offers, OURS, START), [""; 0]);
        assert_eq!(writers.publishers(OURS), (1, Some("theirs"), false, false));
        assert_eq!(writers.judge(&A, 1, Via::Reliable, OURS), Verdict::WrongType);
        assert_eq!(writers.judge(&B, 1, Via::Reliable, OURS), Verdict::Take { lost: 0 });
    }

    #[test]
    fn the_reader_asks_no_writer_for_more_than_it_offers() {
        let (reliable, keeps, best_effort) =
            (offer(OURS, true, false), offer(OURS, true, true), offer(OURS, false, true));
        let theirs = offer("theirs", false, false);
        use Via::{BestEffort, LastValue, Reliable};
        let cases: [(&[&Offer], [&[Via]; 2]); 8] = [
            (&[], [&[], &[]]),
            (&[&theirs], [&[], &[]]),
            (&[&reliable], [&[Reliable], &[Reliable]]),
            (&[&keeps, &theirs], [&[Reliable], &[LastValue]]),
            (&[&keeps, &reliable], [&[Reliable], &[Reliable]]),
            (&[&best_effort], [&[BestEffort], &[BestEffort]]),
            (&[&best_effort, &reliable], [&[BestEffort], &[BestEffort]]),
            (&[&best_effort, &keeps], [&[BestEffort], &[LastValue, BestEffort]]),
        ];
        for (offers, expected) in cases {
            let offers: Vec<_> = (0..).zip(offers).map(|(id, &it)| ([id; 16], it.clone())).collect();
            let fitting = [false, true].map(|last| {
                let mut writers = writers(&offers);
                let early = writers.fitting(last, OURS, START.0);
                let is_found = !expected[0].is_empty();
                assert_eq!(early, is_found.then_some(&[BestEffort][..]), "others may be found still");
                writers.fitting(last, OURS, START.0 + SETTLING).unwrap_or_default()
            });
            assert_eq!(fitting, expected, "{offers:?}");
        }
    }

    #[test]
    fn publishers_are_mixed_only_once_all_of_them_are_known() {
        let (keeps, volatile) = (offer(OURS, true, true), offer(OURS, true, false));
        let mixed = |offers: &[(Guid, Offer)]| {
            let mut writers = writers(offers);
            [START.0, START.0 + SETTLING].map(|now| {
                let via = writers.fitting(true, OURS, now).expect("there are writers");
                writers.leaves_last_value(via, OURS, now)
            })
        };
        assert_eq!(mixed(&[(A, keeps.clone()), (B, keeps.clone())]), [false, false]);
        assert_eq!(mixed(&[(A, keeps), (B, volatile.clone())]), [false, true]);
        assert_eq!(mixed(&[(A, volatile)]), [false, false]);
    }

    #[test]
    fn a_publisher_that_was_there_finds_a_reader_that_fits_it_when_it_comes_back() {
        let at = Timestamp::from_millis;
        let mut writers = writers(&[(A, offer(OURS, true, true)), (B, offer(OURS, false, false))]);
        writers.published(&B, None, START.0);
        let [best_effort, last_value] = [&[Via::BestEffort][..], &[Via::LastValue]].map(Some);
        assert_eq!(writers.fitting(true, OURS, at(5000)), best_effort);
        writers.update([(A, offer(OURS, true, true))].into(), OURS, START);
        assert_eq!(writers.fitting(true, OURS, at(64_999)), best_effort);
        assert_eq!(writers.fitting(true, OURS, at(65_000)), last_value);
    }

    #[test]
    fn a_silent_publisher_that_came_first_takes_no_last_value_from_those_that_come_after_it() {
        let (silent, keeps) = ((A, offer(OURS, false, false)), (B, offer(OURS, true, true)));
        let mut writers = writers(std::slice::from_ref(&silent));
        let later = START.0 + SETTLING;
        for at in [START.0, later] {
            assert_eq!(
                writers.fitting(true, OURS, at),
                Some(&[Via::BestEffort][..]),
                "alone, it is not asked for more"
            );
        }
        writers.update([silent, keeps].into(), OURS, START);
        assert_eq!(writers.fitting(true, OURS, later), Some(&[Via::LastValue, Via::BestEffort][..]));
    }

    /// Listens from 98 s on the wall clock; knows the writers from 100 s there and 5 s here.
    fn found(offers: &[(Guid, Offer)], heard: &[Guid]) -> Writers {
        let wall = |seconds| SystemTime::UNIX_EPOCH + Duration::from_secs(seconds);
        let mut writers = Writers::default();
        writers.listen(wall(98));
        for guid in heard {
            writers.judge(guid, 1, Via::Reliable, OURS);
        }
        writers.update(offers.iter().cloned().collect(), OURS, (Timestamp::from_millis(5000), wall(100)));
        // Discovery has news of others; the age of these does not change.
        writers.update(offers.iter().cloned().collect(), OURS, (Timestamp::from_millis(60_000), wall(100)));
        writers
    }

    fn check(writers: &mut Writers, cases: &[(Guid, Option<u64>, u64, Published)]) {
        for &(writer, source, now, expected) in cases {
            let wall = source.map(|millis| SystemTime::UNIX_EPOCH + Duration::from_millis(millis));
            let published = writers.published(&writer, wall, Timestamp::from_millis(now));
            assert_eq!(published, expected, "{source:?} at {now}");
        }
    }

    #[test]
    fn what_a_new_writer_published_before_we_listened_is_history_whatever_it_offers() {
        use Published::{Before, Now, Unfound};
        for transient_local in [false, true] {
            let mut writers = found(&[(A, offer(OURS, true, transient_local))], &[]);
            let cases = [
                (A, Some(90_000), 5100, Before),
                (A, Some(97_940), 5100, Before),
                (A, Some(97_960), 5110, Unfound),
                (A, Some(99_940), 5110, Unfound),
                (A, Some(99_960), 5120, Now),
                // It comes late, and no faster than a burst can: a repair.
                (A, Some(97_000), 6000, Before),
                (A, Some(97_000), if transient_local { 15_000 } else { 8000 }, Now),
            ];
            check(&mut writers, &cases);
        }
        // A writer that was heard before its participant was replaced is not new.
        check(&mut found(&[(A, offer(OURS, true, false))], &[A]), &[(A, Some(97_000), 5100, Unfound)]);
    }

    #[test]
    fn a_message_may_be_missed_when_its_writer_is_new_and_keeps_nothing_or_the_last_one_is_gone() {
        let (keeps, volatile) = (offer(OURS, true, true), offer(OURS, true, false));
        let mut writers = writers(&[(A, keeps.clone()), (B, volatile.clone())]);
        let missed = |writers: &mut Writers| {
            let missed = writers.may_have_missed();
            writers.reported();
            missed
        };
        assert!(!missed(&mut writers), "nothing was heard that may be over");
        writers.speaks(&A);
        let follow = |writers: &mut Writers, offers: &[(Guid, Offer)]| {
            writers.update(offers.iter().cloned().collect(), OURS, START);
            missed(writers)
        };
        let (c, d) = ([3; 16], [4; 16]);
        let all = [(A, keeps.clone()), (B, volatile), (c, offer("theirs", true, false)), (d, keeps.clone())];
        assert!(!follow(&mut writers, &all), "a new one tells what it keeps, or is no concern");
        assert!(follow(&mut writers, &[&all[..], &[([5; 16], offer(OURS, true, false))]].concat()));
        assert!(!follow(&mut writers, &all));
        assert!(follow(&mut writers, &all[1..]), "the one that spoke last is gone");
        writers.may_miss(OURS);
        assert!(follow(&mut writers, &all[1..]), "one that keeps nothing may have spoken after it");
        assert!(!follow(&mut writers, &all[3..]));
        writers.may_miss(OURS);
        assert!(!follow(&mut writers, &all[3..]));
    }

    #[test]
    fn an_older_message_of_a_writer_that_is_not_discovered_yet_comes_late() {
        use Published::{Now, Unfound};
        let mut writers = found(&[], &[]);
        assert!(writers.is_first_of_undiscovered(&A, Timestamp::from_millis(5100)));
        assert!(!writers.is_first_of_undiscovered(&A, Timestamp::from_millis(5200)));
        let cases = [(A, Some(97_000), 5200, Unfound), (A, Some(98_000), 5200, Now), (A, None, 5200, Now)];
        check(&mut writers, &cases);
        check(&mut writers, &[(A, Some(97_000), 8100, Now)]);
        writers.update([(A, offer(OURS, true, true))].into(), OURS, START);
        assert!(!writers.is_first_of_undiscovered(&A, Timestamp::from_millis(5300)));
    }

    #[test]
    fn a_writer_without_a_clock_hands_over_at_once_what_it_keeps() {
        use Published::{Before, Now};
        let mut writers = found(&[(A, offer(OURS, true, true)), (B, offer(OURS, true, false))], &[]);
        let cases =
            [(A, None, 5100, Before), (A, None, 5399, Before), (A, None, 5400, Now), (B, None, 5100, Now)];
        check(&mut writers, &cases);
    }

    #[test]
    fn what_comes_as_it_was_published_is_of_now_though_its_clock_is_behind() {
        use Published::{Before, Now};
        let mut writers = found(&[(A, offer(OURS, true, false))], &[]);
        let cases: Vec<_> = (0..20)
            .map(|step| (A, Some(10_000 + step * 50), 5100 + step * 50, if step < 6 { Before } else { Now }))
            .collect();
        check(&mut writers, &cases);
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
