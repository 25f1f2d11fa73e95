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
use telltale_engine::pace::{Arrivals, Pace};
use telltale_engine::time::Timestamp;
use telltale_msg::messages;
use telltale_msg::sample_bytes::Guid;

const LOOK: Duration = Duration::from_secs(1);

/// The pace of the topics that are read, by their names on the wire.
#[derive(Debug, Clone, Default)]
pub struct Paces(Arc<Mutex<BTreeMap<String, Arrivals>>>);

impl Paces {
    /// The topic is read from now on: nothing yet is a rate too.
    pub fn begin(&self, dds_topic: &str, now: Timestamp) {
        let mut paces = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        paces.entry(dds_topic.to_owned()).or_insert_with(|| Arrivals::since(now));
    }

    /// A message came.
    pub fn take(&self, dds_topic: &str, now: Timestamp) {
        let mut paces = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(arrivals) = paces.get_mut(dds_topic) {
            arrivals.take(now);
        }
    }

    /// A topic without a message is no longer read.
    pub fn forget(&self, dds_topic: &str) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).remove(dds_topic);
    }

    /// By the ROS names of the topics.
    fn look(&self, now: Timestamp) -> BTreeMap<String, Pace> {
        let mut paces = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        paces.iter_mut().map(|(topic, arrivals)| (ros_name(topic), arrivals.look(now))).collect()
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
    paces: Paces,
    seen: Arc<watch::Sender<Arc<Discovery>>>,
    (nodes, siblings): (watch::Receiver<Nodes>, OwnParticipants),
    clock: Clock,
    mut stop: watch::Receiver<bool>,
) {
    let mut looks = every(LOOK);
    loop {
        tokio::select! {
            () = stopped(&mut stop) => return,
            _ = looks.tick() => {}
        }
        let now = clock.now();
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
        discovery.at = Some(now);
        for (name, pace) in paces.look(now) {
            let place = discovery.topics.binary_search_by(|topic| topic.name.cmp(&name));
            // A topic that is read and that nobody publishes also gets a row.
            let place = place.unwrap_or_else(|place| {
                discovery.topics.insert(place, TopicSeen { name, ..TopicSeen::default() });
                place
            });
            let topic = &mut discovery.topics[place];
            (topic.rate_hz, topic.jitter_ms) = (Some(pace.rate_hz), pace.jitter_ms);
        }
        seen.send_replace(Arc::new(discovery));
    }
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
    fn a_topic_that_is_read_has_a_pace_from_the_start_by_its_ros_name() {
        let paces = Paces::default();
        paces.begin("rt/scan", Timestamp::from_millis(1000));
        for at in (1000..3000).step_by(100) {
            paces.begin("rt/scan", Timestamp::from_millis(at));
            paces.take("rt/scan", Timestamp::from_millis(at));
            paces.take("rt/unread", Timestamp::from_millis(at));
        }
        paces.begin("outside", Timestamp::from_millis(2000));
        let seen = paces.look(Timestamp::from_millis(3000));
        let rates: Vec<(&str, f32)> = seen.iter().map(|(name, pace)| (&**name, pace.rate_hz)).collect();
        assert_eq!(rates, [("/scan", 10.0), ("outside", 0.0)]);
        paces.forget("rt/scan");
        assert_eq!(paces.look(Timestamp::from_millis(4000)).len(), 1);
    }
}
