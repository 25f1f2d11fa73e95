//! The endpoints of others that a DDS process has reported.

use std::collections::BTreeMap;

use super::ids::Prefix;
use super::{ENDPOINTS_MAX, Quality};
use telltale_engine::discovery::Liveliness;
use telltale_msg::sample_bytes::Guid;

/// A reader or writer of another participant.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Found {
    pub guid: Guid,
    pub writes: bool,
    /// Topic and type as they stand on the wire.
    pub topic: String,
    pub type_name: String,
    pub reliable: bool,
    pub transient_local: bool,
    pub deadline_ns: Option<u64>,
    pub liveliness: Liveliness,
    /// A reader: for each [`Quality`] a bit, whether it accepts that offer.
    pub takes: u8,
}

impl Found {
    pub fn takes(&self, quality: Quality) -> bool {
        self.takes & (1 << quality.number()) != 0
    }
}

/// Endpoints by topic.
#[derive(Debug, Default)]
pub struct Seen {
    by_topic: BTreeMap<String, BTreeMap<Guid, Found>>,
    topics: BTreeMap<Guid, String>,
}

impl Seen {
    /// Takes an endpoint that is new or has changed. False if there are more than a process may report.
    pub fn add(&mut self, found: Found) -> bool {
        self.remove(&found.guid);
        if self.topics.len() >= ENDPOINTS_MAX {
            return false;
        }
        self.topics.insert(found.guid, found.topic.clone());
        self.by_topic.entry(found.topic.clone()).or_default().insert(found.guid, found);
        true
    }

    pub fn remove(&mut self, guid: &Guid) {
        let Some(topic) = self.topics.remove(guid) else { return };
        if let Some(endpoints) = self.by_topic.get_mut(&topic) {
            endpoints.remove(guid);
            if endpoints.is_empty() {
                self.by_topic.remove(&topic);
            }
        }
    }

    pub fn writers(&self) -> impl Iterator<Item = &Found> {
        self.by_topic.values().flat_map(BTreeMap::values).filter(|found| found.writes)
    }

    pub fn readers(&self) -> impl Iterator<Item = &Found> {
        self.by_topic.values().flat_map(BTreeMap::values).filter(|found| !found.writes)
    }

    pub fn writers_of(&self, topic: &str) -> impl Iterator<Item = &Found> {
        self.of(topic).filter(|found| found.writes)
    }

    pub fn readers_of(&self, topic: &str) -> impl Iterator<Item = &Found> {
        self.of(topic).filter(|found| !found.writes)
    }

    /// Whether an endpoint of this participant is known.
    pub fn has_any_of(&self, participant: &Prefix) -> bool {
        let mut first = [0; 16];
        first[..participant.len()].copy_from_slice(participant);
        self.topics.range(first..).next().is_some_and(|(guid, _)| guid.starts_with(participant))
    }

    fn of(&self, topic: &str) -> impl Iterator<Item = &Found> {
        self.by_topic.get(topic).into_iter().flat_map(BTreeMap::values)
    }
}

#[cfg(test)]
pub mod tests {
    use super::*;

    pub fn found(guid: u8, topic: &str) -> Found {
        Found {
            guid: [guid; 16],
            writes: true,
            topic: topic.to_owned(),
            type_name: "t".to_owned(),
            reliable: true,
            transient_local: false,
            deadline_ns: None,
            liveliness: Liveliness::default(),
            takes: 0,
        }
    }

    #[test]
    fn an_endpoint_is_there_once_and_leaves_nothing_behind() {
        let mut seen = Seen::default();
        assert!(seen.add(found(1, "a")) && seen.add(found(1, "b")) && seen.add(found(2, "b")));
        assert_eq!([seen.writers_of("a").count(), seen.writers_of("b").count()], [0, 2]);
        assert_eq!([0, 1, 3].map(|participant| seen.has_any_of(&[participant; 12])), [false, true, false]);
        seen.remove(&[1; 16]);
        seen.remove(&[2; 16]);
        assert!(seen.by_topic.is_empty() && seen.topics.is_empty());
    }

    #[test]
    fn what_is_remembered_is_bounded() {
        let mut seen = Seen::default();
        let guid = |number: usize| {
            let mut guid = [0; 16];
            guid[..8].copy_from_slice(&(number as u64).to_le_bytes());
            guid
        };
        let add = |seen: &mut Seen, number| seen.add(Found { guid: guid(number), ..found(0, "a") });
        assert!((0..ENDPOINTS_MAX).all(|number| add(&mut seen, number)));
        assert!(!add(&mut seen, ENDPOINTS_MAX) && add(&mut seen, 5));
    }
}
