//! Which readers fit the writers of a topic.

use super::Writers;
use crate::reading::readers::Fitting;
use crate::transport::quality::Via;
use telltale_engine::time::{Span, Timestamp};

/// A publisher of another quality is expected back for this long after it has gone, such as a restarted
/// driver: until then the reader stays one that fits it too.
const QUALITY_REMEMBERED: Span = Span::from_secs(60);
/// Publishers that exist already are found within this time after the first one: only then is it known
/// which reader fits all of them.
const SETTLING: Span = Span::from_secs(1);

impl Writers {
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
        let any_keeps = self.ours(dds_type).any(|(_, known)| known.offer.keeps_last_value());
        any_keeps && !readers.contains(&Via::LastValue) && self.settles_at(now).is_none()
    }
}

#[cfg(test)]
mod tests {
    use super::super::Offer;
    use super::super::tests::{A, B, OURS, START, offer, writers};
    use super::*;
    use telltale_msg::sample_bytes::Guid;

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
}
