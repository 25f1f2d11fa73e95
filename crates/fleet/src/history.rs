//! What a console keeps of one vehicle: its messages in their order, each once, and the places that are not known.

use std::collections::BTreeMap;

use crate::message::{Batch, Content, Epoch, Gap, GapReason, Mark, Message};

/// Messages and gaps that are kept of a vehicle; beyond it the oldest go.
pub const KEPT_MAX: usize = 100_000;

/// What came of a batch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Taken {
    pub new: usize,
    /// Messages that are known, word for word.
    pub again: usize,
    /// Messages with another content than the known one, which stays: the vehicle rewrites its past, or there are two.
    pub contradictions: usize,
}

/// The log of one vehicle.
#[derive(Debug, Default)]
pub struct History {
    messages: BTreeMap<Mark, Message>,
    /// By the first place of each; they may overlap with one another and with messages, which count more.
    gaps: BTreeMap<Mark, Gap>,
    /// Everything up to here was forgotten for want of room.
    forgotten: Option<Mark>,
}

/// Places of one epoch that are not known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unknown {
    pub from: Mark,
    pub to: u64,
    /// What the vehicle says of it; `None` if it says nothing.
    pub why: Option<GapReason>,
}

impl History {
    /// Takes a batch that was unpacked for this vehicle.
    pub fn take(&mut self, batch: Batch) -> Taken {
        let mut taken = Taken::default();
        for message in batch.messages {
            match self.forgotten {
                Some(forgotten) if message.mark() <= forgotten => taken.again += 1,
                _ => self.take_one(message, &mut taken),
            }
        }
        while self.messages.len() > KEPT_MAX {
            self.forgotten = self.forgotten.max(self.messages.pop_first().map(|(mark, _)| mark));
        }
        while self.gaps.len() > KEPT_MAX {
            self.forgotten = self.forgotten.max(self.gaps.pop_first().map(|(mark, _)| mark));
        }
        taken
    }

    fn take_one(&mut self, message: Message, taken: &mut Taken) {
        let mark = message.mark();
        if let Content::Gap(gap) = message.content {
            let known = self.gaps.entry(mark).or_insert(Gap { to: 0, ..gap });
            let is_new = known.to < gap.to;
            known.to = known.to.max(gap.to);
            *(if is_new { &mut taken.new } else { &mut taken.again }) += 1;
            return;
        }
        match self.messages.get(&mark) {
            None => {
                self.messages.insert(mark, message);
                taken.new += 1;
            }
            Some(known) if *known == message => taken.again += 1,
            Some(_) => taken.contradictions += 1,
        }
    }

    /// All messages in their order.
    pub fn messages(&self) -> impl Iterator<Item = &Message> {
        self.messages.values()
    }

    /// What is not known up to the last place that was told of each epoch: gaps that the vehicle declared, and holes.
    pub fn unknown(&self) -> Vec<Unknown> {
        let mut ends: BTreeMap<Epoch, u64> = BTreeMap::new();
        let told = self.messages.keys().copied();
        for end in told.chain(self.gaps.iter().map(|(mark, gap)| Mark { n: gap.to, ..*mark })) {
            let last = ends.entry(end.epoch).or_default();
            *last = end.n.max(*last);
        }
        let mut found = Vec::new();
        for (epoch, last) in ends {
            let forgotten = self.forgotten.filter(|it| it.epoch == epoch).map_or(0, |it| it.n);
            let all = Mark { epoch, n: 0 }..=Mark { epoch, n: u64::MAX };
            let declared = self.declared(epoch);
            let mut declared = declared.iter().peekable();
            let mut next = forgotten + 1;
            for n in self.messages.range(all).map(|(mark, _)| mark.n).chain([last + 1]) {
                while next < n {
                    while declared.next_if(|(_, to, _)| *to < next).is_some() {}
                    let (to, why) = match declared.peek() {
                        Some(&&(from, to, why)) if from <= next => (to.min(n - 1), Some(why)),
                        Some(&&(from, ..)) => ((from - 1).min(n - 1), None),
                        None => (n - 1, None),
                    };
                    found.push(Unknown { from: Mark { epoch, n: next }, to, why });
                    next = to + 1;
                }
                next = n + 1;
            }
        }
        found
    }

    /// The declared gaps of an epoch without their overlaps.
    fn declared(&self, epoch: Epoch) -> Vec<(u64, u64, GapReason)> {
        let all = Mark { epoch, n: 0 }..=Mark { epoch, n: u64::MAX };
        let mut apart = Vec::new();
        let mut until = 0;
        for (mark, gap) in self.gaps.range(all) {
            let from = mark.n.max(until + 1);
            if from <= gap.to {
                apart.push((from, gap.to, gap.why));
                until = gap.to;
            }
        }
        apart
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::message::VehicleId;

    const EPOCH: Epoch = Epoch { start: 1, nonce: 0 };

    fn history(parts: &[(u64, Option<u64>)]) -> (History, Taken) {
        let mut history = History::default();
        let mut all = Taken::default();
        for &(n, gap) in parts {
            let content =
                gap.map_or(Content::Goodbye, |to| Content::Gap(Gap { to, why: GapReason::Overflow }));
            let id = VehicleId::new("a").expect("it is plain");
            let messages = vec![Message { epoch: EPOCH, n, at: 0, content }];
            let taken = history.take(Batch { id, key: String::new(), sent: 0, messages });
            all.new += taken.new;
            all.again += taken.again;
            all.contradictions += taken.contradictions;
        }
        (history, all)
    }

    fn unknown(parts: &[(u64, Option<u64>)]) -> Vec<(u64, u64, bool)> {
        let (history, _) = history(parts);
        history.unknown().iter().map(|it| (it.from.n, it.to, it.why.is_some())).collect()
    }

    #[test]
    fn what_is_not_known_is_declared_or_a_hole() {
        assert_eq!(unknown(&[(1, None), (2, None)]), []);
        assert_eq!(unknown(&[(1, None), (4, None)]), [(2, 3, false)]);
        assert_eq!(unknown(&[(3, None)]), [(1, 2, false)]);
        assert_eq!(unknown(&[(1, Some(3)), (4, None)]), [(1, 3, true)]);
        assert_eq!(unknown(&[(1, Some(3)), (6, None)]), [(1, 3, true), (4, 5, false)]);
        assert_eq!(unknown(&[(2, None), (1, Some(3))]), [(1, 1, true), (3, 3, true)]);
        assert_eq!(unknown(&[(1, None), (2, Some(9)), (3, None)]), [(2, 2, true), (4, 9, true)]);
        assert_eq!(unknown(&[(1, Some(4)), (1, None)]), [(2, 4, true)], "what is found leaves the gap");
        assert_eq!(
            unknown(&[(2, Some(4)), (3, Some(6)), (9, None)]),
            [(1, 1, false), (2, 4, true), (5, 6, true), (7, 8, false)]
        );
    }

    #[test]
    fn each_message_counts_once_and_the_first_stays() {
        let (mut history, taken) = history(&[(1, None), (1, None), (1, Some(1))]);
        assert_eq!(taken, Taken { new: 2, again: 1, contradictions: 0 });
        assert_eq!(history.unknown(), [], "a message counts more than a gap");
        let other = Message { epoch: EPOCH, n: 1, at: 5, content: Content::Goodbye };
        let id = VehicleId::new("a").expect("it is plain");
        let taken = history.take(Batch { id, key: String::new(), sent: 0, messages: vec![other] });
        assert_eq!(taken, Taken { contradictions: 1, ..Taken::default() });
        assert_eq!(history.messages().map(|it| it.at).collect::<Vec<_>>(), [0]);
    }
}
