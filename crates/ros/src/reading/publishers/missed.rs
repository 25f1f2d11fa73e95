//! Which messages may be missed that no writer tells again.

use super::Writers;
use telltale_msg::sample_bytes::Guid;

impl Writers {
    /// A message of a writer that keeps nothing may be missing: another writer's kept message counts, or the reader has ended
    /// that would have asked for it again.
    pub fn may_miss(&mut self, dds_type: &str) {
        let any_keeps_nothing = self.ours(dds_type).any(|(_, known)| !known.offer.transient_local);
        self.missed |= any_keeps_nothing;
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
}

#[cfg(test)]
mod tests {
    use super::super::tests::{A, B, OURS, START, offer, writers};
    use super::super::{Offer, Writers};
    use telltale_msg::sample_bytes::Guid;

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
}
