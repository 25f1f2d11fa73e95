//! When a message was published: history, or meant for us.

use super::Writers;
use std::time::{Duration, SystemTime};
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::sample_bytes::Guid;

/// A sample that arrives within this time after its writer was discovered may be from before our start.
const HISTORY: Span = Span::from_secs(3);
/// The same of a writer that keeps its last message: it is asked for that after the others are found, and may have to send
/// it twice.
const KEPT_HISTORY: Span = Span::from_secs(10);
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

impl Writers {
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
}

/// Whether messages came much faster than they were published, since the first.
fn is_faster(first: Option<SystemTime>, source: SystemTime, took: Span) -> bool {
    let published = first.and_then(|first| source.duration_since(first).ok()).unwrap_or_default();
    published.as_nanos() > 2 * u128::from(took.as_nanos())
}

#[cfg(test)]
mod tests {
    use super::super::Offer;
    use super::super::tests::{A, B, BEFORE, OURS, START, offer};
    use super::*;
    use crate::transport::quality::Via;

    /// Listens from 98 s on the wall clock; knows the writers from 100 s there and 5 s here.
    fn found(offers: &[(Guid, Offer)], heard: &[Guid]) -> Writers {
        let wall = |seconds| SystemTime::UNIX_EPOCH + Duration::from_secs(seconds);
        let mut writers = Writers::default();
        writers.listen(wall(98));
        for guid in heard {
            writers.judge(guid, 1, Via::Reliable, OURS, BEFORE);
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
}
