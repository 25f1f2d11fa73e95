//! Participants that the DDS library dropped after a lease of silence. Their endpoints count as present until it is sure
//! that they have ended.

use std::collections::{BTreeMap, BTreeSet};

use rustdds::DomainParticipantStatusEvent as Event;
use rustdds::LostReason;

use crate::transport::Found;
use crate::transport::ids::{self, Prefix};
use crate::transport::wire::Change;
use telltale_msg::sample_bytes::Guid;

/// Participants that are remembered. Discovery is given up before it has lost so many.
const PARTICIPANTS_MAX: usize = 4096;

#[derive(Debug, Default)]
pub struct Losses {
    /// Those whose endpoints still count.
    doubtful: BTreeSet<Prefix>,
    /// All that were lost or left once: of one that comes back the library matches nothing.
    once: BTreeSet<Prefix>,
    /// Endpoints that were missing at the last look. The event that says why may come after it.
    missing: BTreeSet<Guid>,
}

impl Losses {
    /// Takes an event of the library. Returns what has become of a participant.
    pub fn hear(&mut self, event: &Event) -> Option<(Prefix, Change)> {
        let (participant, change) = match event {
            Event::ParticipantLost { id, reason } => {
                let participant = id.as_ref().try_into().ok()?;
                if self.once.len() < PARTICIPANTS_MAX {
                    self.once.insert(participant);
                }
                let change = match reason {
                    LostReason::Disposed => Change::Left,
                    LostReason::Timeout { .. } => Change::Lost,
                };
                (participant, change)
            }
            Event::ParticipantDiscovered { dpd } => {
                let participant = ids::prefix(&dpd.guid.to_bytes());
                let is_copy =
                    dpd.lease_duration.is_some_and(|lease| super::spdp::is_of_copy(lease.to_nanoseconds()));
                (participant, self.found(&participant, is_copy)?)
            }
            _ => return None,
        };
        match change {
            Change::Left => drop(self.doubtful.remove(&participant)),
            Change::Lost if self.doubtful.len() < PARTICIPANTS_MAX => drop(self.doubtful.insert(participant)),
            Change::Here | Change::Lost | Change::Back | Change::Copied => {}
        }
        Some((participant, change))
    }

    /// The meaning of a participant that the library finds: none if that is the answer to a copy of its announcement.
    fn found(&self, participant: &Prefix, is_copy: bool) -> Option<Change> {
        match (self.once.contains(participant), is_copy) {
            (true, true) => Some(Change::Copied),
            (true, false) => Some(Change::Back),
            (false, true) => None,
            (false, false) => Some(Change::Here),
        }
    }

    /// A lost participant is gone.
    pub fn forget(&mut self, participant: &Prefix) {
        self.doubtful.remove(participant);
    }

    /// Whether the next look may tell that endpoints are gone.
    pub fn is_looking(&self) -> bool {
        !self.missing.is_empty()
    }

    /// Adds to `now` the endpoints that it lacks and that are not surely gone.
    pub fn look(&mut self, before: &BTreeMap<Guid, Found>, now: &mut BTreeMap<Guid, Found>) {
        let mut missing = BTreeSet::new();
        for (guid, found) in before {
            if now.contains_key(guid) {
                continue;
            }
            let is_doubtful = self.doubtful.contains(&ids::prefix(guid));
            if !is_doubtful && self.missing.contains(guid) {
                continue;
            }
            if !is_doubtful {
                missing.insert(*guid);
            }
            now.insert(*guid, found.clone());
        }
        self.missing = missing;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::found;

    fn all(guids: &[u8]) -> BTreeMap<Guid, Found> {
        guids.iter().map(|&guid| ([guid; 16], found(guid, "a"))).collect()
    }

    fn lost(participant: u8, reason: LostReason) -> Event {
        Event::ParticipantLost { id: rustdds::GUID::from_bytes([participant; 16]).prefix, reason }
    }

    fn timeout() -> LostReason {
        let lease = rustdds::Duration::from_secs(10);
        LostReason::Timeout { lease, elapsed: lease }
    }

    #[test]
    fn what_a_silent_participant_had_counts_until_it_is_forgotten() {
        let mut losses = Losses::default();
        // The library drops the endpoints before it says why.
        let mut now = all(&[1]);
        losses.look(&all(&[1, 2]), &mut now);
        assert!(now == all(&[1, 2]) && losses.is_looking());
        assert_eq!(losses.hear(&lost(2, timeout())), Some(([2; 12], Change::Lost)));
        for _ in 0..3 {
            let mut now = all(&[1]);
            losses.look(&all(&[1, 2]), &mut now);
            assert!(now == all(&[1, 2]));
        }
        assert!(!losses.is_looking());
        losses.forget(&[2; 12]);
        losses.look(&all(&[1, 2]), &mut all(&[1]));
        let mut now = all(&[1]);
        losses.look(&all(&[1, 2]), &mut now);
        assert!(now == all(&[1]));
    }

    /// The library matches nothing of it any more: only another process hears it.
    #[test]
    fn a_participant_that_was_lost_once_is_back_when_it_is_found_by_a_copy_too() {
        for reason in [timeout(), LostReason::Disposed] {
            let mut losses = Losses::default();
            assert_eq!(
                [true, false].map(|is_copy| losses.found(&[2; 12], is_copy)),
                [None, Some(Change::Here)]
            );
            losses.hear(&lost(2, reason));
            assert_eq!(
                [true, false].map(|is_copy| losses.found(&[2; 12], is_copy)),
                [Change::Copied, Change::Back].map(Some)
            );
            losses.forget(&[2; 12]);
            assert_eq!(losses.found(&[2; 12], false), Some(Change::Back), "however long it was away");
        }
    }

    #[test]
    fn an_endpoint_that_ends_is_gone_at_the_second_look() {
        let mut losses = Losses::default();
        assert_eq!(losses.hear(&lost(2, LostReason::Disposed)), Some(([2; 12], Change::Left)));
        let mut now = all(&[1]);
        losses.look(&all(&[1, 2]), &mut now);
        assert!(now == all(&[1, 2]));
        let mut now = all(&[1]);
        losses.look(&all(&[1, 2]), &mut now);
        assert!(now == all(&[1]) && !losses.is_looking());
    }
}
