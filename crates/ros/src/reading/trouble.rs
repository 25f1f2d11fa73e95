//! Faults of reception, collected so that a flood of them costs little.

use telltale_engine::input::{ReceptionTrouble, TroubleKind};
use telltale_engine::time::{Span, Timestamp};

/// At most one input of a kind in this time.
const QUIET: Span = Span::from_millis(250);

const KINDS: [TroubleKind; 3] = [TroubleKind::Malformed, TroubleKind::WrongType, TroubleKind::Lost];

/// The faults of one topic that were not reported yet.
#[derive(Debug, Default)]
pub struct Troubles {
    kinds: [Pending; KINDS.len()],
}

#[derive(Debug, Default)]
struct Pending {
    count: u64,
    /// The text of the first one, which stands for all in a flood.
    text: String,
    told: Option<Timestamp>,
}

impl Troubles {
    /// Adds `count` faults. `text` is called only when it will be reported.
    pub fn add(&mut self, kind: TroubleKind, count: u64, text: impl FnOnce() -> String) {
        let pending = self.pending(kind);
        if pending.count == 0 {
            pending.text = text();
        }
        pending.count = pending.count.saturating_add(count);
    }

    /// When [`Self::take`] returns something next.
    pub fn due(&self) -> Option<Timestamp> {
        self.kinds.iter().filter(|pending| pending.count > 0).map(Pending::due).min()
    }

    /// The faults to report now.
    pub fn take(&mut self, topic: &str, now: Timestamp) -> Vec<ReceptionTrouble> {
        let mut due = Vec::new();
        for kind in KINDS {
            let pending = self.pending(kind);
            if pending.count > 0 && pending.due() <= now {
                pending.told = Some(now);
                due.push(ReceptionTrouble {
                    topic: topic.into(),
                    kind,
                    count: std::mem::take(&mut pending.count),
                    text: std::mem::take(&mut pending.text).into(),
                });
            }
        }
        due
    }

    fn pending(&mut self, kind: TroubleKind) -> &mut Pending {
        let index = match kind {
            TroubleKind::Malformed => 0,
            TroubleKind::WrongType => 1,
            TroubleKind::Lost => 2,
        };
        &mut self.kinds[index]
    }
}

impl Pending {
    fn due(&self) -> Timestamp {
        self.told.map_or(Timestamp::ZERO, |told| told + QUIET)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_is_told_at_once_and_a_flood_is_summed_up() {
        let mut troubles = Troubles::default();
        let at = Timestamp::from_millis;
        let mut told = Vec::new();
        for millis in 1000..2000 {
            troubles.add(TroubleKind::Malformed, 3, || format!("at {millis}"));
            if troubles.due().is_some_and(|due| due <= at(millis)) {
                told.extend(troubles.take("/x", at(millis)));
            }
        }
        let summary: Vec<_> = told.iter().map(|trouble| (trouble.count, &*trouble.text)).collect();
        assert_eq!(summary, [(3, "at 1000"), (750, "at 1001"), (750, "at 1251"), (750, "at 1501")]);
        assert_eq!(troubles.due(), Some(at(2000)));
        assert_eq!(troubles.take("/x", at(2000)).len(), 1);
        assert_eq!(troubles.due(), None);
    }

    #[test]
    fn kinds_do_not_wait_for_one_another() {
        let mut troubles = Troubles::default();
        troubles.add(TroubleKind::Lost, 1, String::new);
        assert_eq!(troubles.take("/x", Timestamp::from_millis(1)).len(), 1);
        troubles.add(TroubleKind::WrongType, 1, String::new);
        troubles.add(TroubleKind::Lost, 1, String::new);
        let told = troubles.take("/x", Timestamp::from_millis(2));
        assert_eq!(told.iter().map(|trouble| trouble.kind).collect::<Vec<_>>(), [TroubleKind::WrongType]);
    }
}
