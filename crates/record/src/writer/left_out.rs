//! The messages that a file lacks for want of room: large topics first, small ones and the journal last.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

/// A topic is large from this part of what the file may take on.
const LARGE: u64 = 64;

/// Small topics have this part of it for themselves, but no more than this.
const FOR_SMALL: u64 = 8;
const FOR_SMALL_MAX: u64 = 64 << 20;

/// Topics that are accounted for by name; the ring has no more.
const TOPICS_MAX: usize = 1024;

/// The messages of one topic that were left out.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Lack {
    pub messages: u64,
    pub bytes: u64,
}

#[derive(Debug, Default)]
pub(super) struct LeftOut {
    /// Bytes that each topic has in the file.
    written: HashMap<Arc<str>, u64>,
    lacks: BTreeMap<Arc<str>, Lack>,
    /// Messages that were to be recorded by their times and sizes alone.
    sizes_only: BTreeMap<Arc<str>, Lack>,
    /// Of topics past the limit, too.
    all: Lack,
}

impl LeftOut {
    /// Whether a message has a place in a file that may grow to `most` and has `left` of it.
    pub fn has_place(&self, topic: &str, bytes: u64, most: u64, left: u64) -> bool {
        let written = self.written.get(topic).copied().unwrap_or(0);
        let is_large = written + bytes > most / LARGE;
        let reserve = if is_large { (most / FOR_SMALL).min(FOR_SMALL_MAX) } else { 0 };
        bytes.saturating_add(reserve) <= left
    }

    pub fn write(&mut self, topic: &Arc<str>, bytes: u64) {
        if self.written.len() < TOPICS_MAX || self.written.contains_key(topic) {
            *self.written.entry(topic.clone()).or_default() += bytes;
        }
    }

    pub fn lack(&mut self, topic: &Arc<str>, bytes: u64) {
        let mut lacks = vec![&mut self.all];
        if self.lacks.len() < TOPICS_MAX || self.lacks.contains_key(topic) {
            lacks.push(self.lacks.entry(topic.clone()).or_default());
        }
        for lack in lacks {
            lack.messages += 1;
            lack.bytes += bytes;
        }
    }

    /// A message that was to be recorded by its times and its size alone.
    pub fn size_only(&mut self, topic: &Arc<str>, bytes: u64) {
        if self.sizes_only.len() < TOPICS_MAX || self.sizes_only.contains_key(topic) {
            let lack = self.sizes_only.entry(topic.clone()).or_default();
            lack.messages += 1;
            lack.bytes += bytes;
        }
    }

    pub fn all(&self) -> Lack {
        self.all
    }

    /// For the file: what each topic lacks. Empty: nothing is left out.
    pub fn told(&self) -> BTreeMap<String, String> {
        let mut told: BTreeMap<String, String> = BTreeMap::new();
        let lacks = self.lacks.iter().map(|it| (it, "had no room"));
        let sizes = self.sizes_only.iter().map(|it| (it, "are recorded as their times and sizes"));
        for ((topic, lack), why) in lacks.chain(sizes) {
            let said = format!("{} messages, {} bytes: they {why}", lack.messages, lack.bytes);
            told.entry(topic.to_string()).and_modify(|it| *it = format!("{it}; {said}")).or_insert(said);
        }
        told
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn large_topics_are_left_out_first() {
        let (cloud, speed): (Arc<str>, Arc<str>) = ("/points".into(), "/speed".into());
        let mut left_out = LeftOut::default();
        let (most, mut left) = (1_000_000, 1_000_000);
        for _ in 0..2_000 {
            for (topic, bytes) in [(&cloud, 10_000), (&speed, 7)] {
                if left_out.has_place(topic, bytes, most, left) {
                    left_out.write(topic, bytes);
                    left -= bytes;
                } else {
                    left_out.lack(topic, bytes);
                }
            }
        }
        assert_eq!(left_out.told().into_keys().collect::<Vec<_>>(), ["/points"]);
        assert_eq!(left_out.written[&speed], 14_000);
        assert!(left < most / FOR_SMALL && left_out.all().messages > 1_900, "{left_out:?}");
    }
}
