//! A list of all topics with their publishers and subscribers, from discovery, once a second. The
//! developer's page of topics shows it.

use crate::every;
use crate::library::discovered::participant_name;
use crate::library::spdp::PREFIX;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::watch;

use super::nodes::Nodes;
use crate::library::{Found, Participant};
use crate::outbox::stopped;
use telltale_clock::Clock;
use telltale_engine::discovery::{Discovery, ENDPOINTS_MAX, Endpoint, TOPICS_MAX, TopicSeen};
use telltale_engine::time::Timestamp;
use telltale_msg::messages;
use telltale_msg::sample_bytes::Guid;

const LOOK: Duration = Duration::from_secs(1);

/// Messages received since the start, by the topic's name on the wire; only of topics that are read.
#[derive(Debug, Clone, Default)]
pub struct MessageCounts(Arc<Mutex<BTreeMap<String, u64>>>);

impl MessageCounts {
    pub fn add(&self, dds_topic: &str, count: usize) {
        let mut tallies = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        match tallies.get_mut(dds_topic) {
            Some(tally) => *tally += count as u64,
            None => drop(tallies.insert(dds_topic.to_owned(), count as u64)),
        }
    }

    /// A topic without a message is no longer read.
    pub fn forget(&self, dds_topic: &str) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).remove(dds_topic);
    }

    fn read(&self) -> BTreeMap<String, u64> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// Our participants other than the bridge's own, in hexadecimal digits, including the last ones that ended: a
/// killed participant said no goodbye, and discovery knows it until its lease is over.
#[derive(Debug, Clone, Default)]
pub struct OwnParticipants(Arc<Mutex<VecDeque<String>>>);

/// Many more than end within a lease.
const SIBLINGS_MAX: usize = 256;

impl OwnParticipants {
    pub fn add(&self, participant: String) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        all.push_back(participant);
        while all.len() > SIBLINGS_MAX {
            all.pop_front();
        }
    }

    /// Whether this endpoint is of one of them.
    pub fn has(&self, endpoint: &Guid) -> bool {
        let name = participant_name(endpoint);
        self.0.lock().unwrap_or_else(PoisonError::into_inner).contains(&name)
    }

    fn all(&self) -> BTreeSet<String> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).iter().cloned().collect()
    }
}

/// Runs until it is stopped.
pub async fn run(
    participant: Participant,
    tallies: MessageCounts,
    seen: Arc<watch::Sender<Arc<Discovery>>>,
    (nodes, siblings): (watch::Receiver<Nodes>, OwnParticipants),
    clock: Clock,
    mut stop: watch::Receiver<bool>,
) {
    let mut looks = every(LOOK);
    let mut before = (clock.now(), tallies.read());
    loop {
        tokio::select! {
            () = stopped(&mut stop) => return,
            _ = looks.tick() => {}
        }
        let now = (clock.now(), tallies.read());
        let mut discovery = {
            let nodes = nodes.borrow();
            let (all, services) = (nodes.all(), nodes.services());
            Discovery { nodes: all, services, ..look(&participant, &nodes.endpoints()) }
        };
        let siblings = siblings.all();
        for topic in &mut discovery.topics {
            for endpoint in topic.publishers.iter_mut().chain(&mut topic.subscribers) {
                endpoint.ours |= siblings.contains(&endpoint.participant);
            }
        }
        discovery.at = Some(now.0);
        let rates = rates(&before, &now);
        for (name, rate) in rates {
            let place = discovery.topics.binary_search_by(|topic| topic.name.cmp(&name));
            // A topic that is read and that nobody publishes also gets a row.
            let place = place.unwrap_or_else(|place| {
                discovery.topics.insert(place, TopicSeen { name, ..TopicSeen::default() });
                place
            });
            discovery.topics[place].rate_hz = Some(rate);
        }
        seen.send_replace(Arc::new(discovery));
        before = now;
    }
}

/// Messages per second of the topics that are read, by their ROS names.
fn rates(
    before: &(Timestamp, BTreeMap<String, u64>),
    now: &(Timestamp, BTreeMap<String, u64>),
) -> BTreeMap<String, f32> {
    let seconds = now.0.since(before.0).as_nanos() as f32 / 1e9;
    let rate = |(topic, count): (&String, &u64)| {
        let more = count - before.1.get(topic).copied().unwrap_or(0).min(*count);
        (ros_name(topic), if seconds > 0.0 { more as f32 / seconds } else { 0.0 })
    };
    now.1.iter().map(rate).collect()
}

fn look(participant: &Participant, nodes: &BTreeMap<Guid, &str>) -> Discovery {
    let own = participant.guid();
    let mut topics: BTreeMap<String, TopicSeen> = BTreeMap::new();
    let mut participants = BTreeSet::new();
    let seen = participant.seen();
    for found in seen.writers() {
        let endpoint = endpoint(found, &own, nodes);
        participants.insert(endpoint.participant.clone());
        push(&mut topics, &found.topic, endpoint, |topic| &mut topic.publishers);
    }
    for found in seen.readers() {
        let endpoint = endpoint(found, &own, nodes);
        participants.insert(endpoint.participant.clone());
        push(&mut topics, &found.topic, endpoint, |topic| &mut topic.subscribers);
    }
    participants.remove(&participant_name(&own));
    let more = topics.len().saturating_sub(TOPICS_MAX);
    let topics = topics.into_values().take(TOPICS_MAX);
    Discovery { topics: topics.collect(), more, participants: participants.len(), ..Discovery::default() }
}

fn endpoint(found: &Found, own: &Guid, nodes: &BTreeMap<Guid, &str>) -> Endpoint {
    Endpoint {
        participant: participant_name(&found.guid),
        node: nodes.get(&found.guid).map(|name| (*name).to_owned()),
        type_name: messages::ros_type_name(&found.type_name),
        reliable: found.reliable,
        transient_local: found.transient_local,
        deadline_ns: found.deadline_ns,
        liveliness: found.liveliness,
        ours: found.guid[..PREFIX] == own[..PREFIX],
    }
}

fn push(
    topics: &mut BTreeMap<String, TopicSeen>,
    dds_topic: &str,
    endpoint: Endpoint,
    list: impl Fn(&mut TopicSeen) -> &mut Vec<Endpoint>,
) {
    let name = ros_name(dds_topic);
    let topic = topics.entry(name.clone()).or_insert_with(|| TopicSeen { name, ..TopicSeen::default() });
    let list = list(topic);
    if list.len() < ENDPOINTS_MAX {
        list.push(endpoint);
    }
}

/// `rt/diagnostics` is `/diagnostics` to ROS; other names are left as they are.
fn ros_name(dds_topic: &str) -> String {
    dds_topic.strip_prefix("rt/").map_or_else(|| dds_topic.to_owned(), |name| format!("/{name}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_of_the_time_between_two_looks() {
        let tallies = MessageCounts::default();
        tallies.add("rt/diagnostics", 5);
        let before = (Timestamp::from_millis(1000), tallies.read());
        tallies.add("rt/diagnostics", 20);
        tallies.add("rt/new", 4);
        let now = (Timestamp::from_millis(3000), tallies.read());
        let expect = [("/diagnostics".to_owned(), 10.0), ("/new".to_owned(), 2.0)];
        assert_eq!(rates(&before, &now), BTreeMap::from(expect));
        assert_eq!(rates(&now, &now).values().copied().collect::<Vec<_>>(), [0.0, 0.0]);
    }
}
