//! A list of all topics with their publishers and subscribers, from discovery, once a second. The
//! developer's page of topics shows it.

use crate::every;
use crate::transport::ids::participant_name;
use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use tokio::sync::watch;

use super::nodes::Nodes;
use crate::engine_queue::stopped;
use crate::transport::{Found, Participant, Seen};
use telltale_clock::Clock;
use telltale_engine::discovery::{Discovery, ENDPOINTS_MAX, Endpoint, TOPICS_MAX, TopicSeen};
use telltale_engine::model::monitors::ProbeTarget;
use telltale_engine::pace::{Arrivals, Pace};
use telltale_engine::time::Timestamp;
use telltale_msg::lifecycle::GET_STATE;
use telltale_msg::messages;
use telltale_msg::sample_bytes::Guid;
use telltale_msg::subscription::Plan;

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

    /// The topic is no longer read.
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
    (nodes, siblings, plan): (watch::Receiver<Nodes>, OwnParticipants, watch::Receiver<Arc<Plan>>),
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
        let wanted = wanted(&plan.borrow());
        participant.follow_first(wanted.iter().map(|topic| &**topic));
        let paces = paces.look(now);
        let mut first: BTreeSet<String> = wanted.iter().map(|topic| ros_name(topic)).collect();
        first.extend(paces.keys().cloned());
        let mut ours = siblings.all();
        ours.insert(participant_name(&participant.guid()));
        let mut discovery = {
            let nodes = nodes.borrow();
            let (all, services) = (nodes.all(), nodes.services());
            Discovery { nodes: all, services, ..look(&participant.seen(), &nodes, (&ours, &first)) }
        };
        let of_ours = discovery.topics.iter().filter(|topic| has_ours(topic));
        let of_ours: Vec<String> = of_ours.map(|topic| dds_name(&topic.name)).collect();
        participant.follow_first(of_ours.iter().map(|topic| &**topic));
        discovery.at = Some(now);
        for (name, pace) in paces {
            let place = discovery.topics.binary_search_by(|topic| topic.name.cmp(&name));
            // A topic that is read and that nobody publishes also gets a row.
            let place = place.unwrap_or_else(|place| {
                discovery.topics.insert(place, TopicSeen { name, ..TopicSeen::default() });
                place
            });
            let topic = &mut discovery.topics[place];
            topic.rate_hz = Some(pace.rate_hz);
            // What comes no more does not come unevenly.
            topic.jitter_ms = pace.jitter_ms.filter(|_| pace.rate_hz > 0.0);
        }
        seen.send_replace(Arc::new(discovery));
    }
}

/// The topics that the configuration names, as they are called on the wire.
fn wanted(plan: &Plan) -> BTreeSet<String> {
    let read = plan.subscriptions.iter().map(|subscription| subscription.dds_topic.clone());
    let asked = plan.watchdogs.iter().flat_map(|watchdog| match &watchdog.target {
        ProbeTarget::Qos { topic } => vec![dds_name(topic)],
        ProbeTarget::Service { name } => service_topics(name).into(),
        ProbeTarget::Lifecycle { name } => service_topics(&format!("{name}/{GET_STATE}")).into(),
        _ => Vec::new(),
    });
    read.chain(asked).collect()
}

/// `ours` are our participants. The topics in `first`, and the topics with a reader or writer of ours, are listed in any
/// case.
fn look(seen: &Seen, nodes: &Nodes, (ours, first): (&BTreeSet<String>, &BTreeSet<String>)) -> Discovery {
    let mut topics: BTreeMap<String, TopicSeen> = BTreeMap::new();
    let mut participants = BTreeSet::new();
    for found in seen.writers().chain(seen.readers()) {
        let endpoint = endpoint(found, ours, nodes);
        participants.insert(endpoint.participant.clone());
        let name = ros_name(&found.topic);
        let topic = topics.entry(name.clone()).or_insert_with(|| TopicSeen { name, ..TopicSeen::default() });
        let list = if found.writes { &mut topic.publishers } else { &mut topic.subscribers };
        list.push(endpoint);
    }
    let more = topics.len().saturating_sub(TOPICS_MAX);
    let mut topics: Vec<TopicSeen> = topics.into_values().collect();
    if more > 0 {
        topics.sort_by_key(|topic| (!first.contains(&topic.name), !has_ours(topic)));
        topics.truncate(TOPICS_MAX);
        topics.sort_by(|one, other| one.name.cmp(&other.name));
    }
    topics.iter_mut().for_each(shorten);
    Discovery { topics, more, participants: participants.len(), ..Discovery::default() }
}

fn has_ours(topic: &TopicSeen) -> bool {
    topic.publishers.iter().chain(&topic.subscribers).any(|it| it.ours)
}

/// Keeps ours of many endpoints, and before others those that speak the same type.
fn shorten(topic: &mut TopicSeen) {
    let ours = topic.publishers.iter().chain(&topic.subscribers).filter(|it| it.ours);
    let types: BTreeSet<String> = ours.map(|it| it.type_name.clone()).collect();
    for list in [&mut topic.publishers, &mut topic.subscribers] {
        if list.len() > ENDPOINTS_MAX {
            list.sort_by_key(|it| (!it.ours, !types.contains(&it.type_name)));
            list.truncate(ENDPOINTS_MAX);
        }
    }
}

fn endpoint(found: &Found, ours: &BTreeSet<String>, nodes: &Nodes) -> Endpoint {
    let participant = participant_name(&found.guid);
    Endpoint {
        ours: ours.contains(&participant),
        participant,
        node: nodes.node_of(&found.guid).map(str::to_owned),
        type_name: messages::ros_type_name(&found.type_name),
        reliable: found.reliable,
        transient_local: found.transient_local,
        deadline_ns: found.deadline_ns,
        liveliness: found.liveliness,
    }
}

/// `rt/diagnostics` is `/diagnostics` to ROS; other names are left as they are.
fn ros_name(dds_topic: &str) -> String {
    dds_topic.strip_prefix("rt/").map_or_else(|| dds_topic.to_owned(), |name| format!("/{name}"))
}

/// The topics of the requests and of the replies of a service, as they are called on the wire.
pub fn service_topics(ros_name: &str) -> [String; 2] {
    let name = ros_name.trim_start_matches('/');
    [format!("rq/{name}Request"), format!("rr/{name}Reply")]
}

fn dds_name(ros_topic: &str) -> String {
    ros_topic.strip_prefix('/').map_or_else(|| ros_topic.to_owned(), |name| format!("rt/{name}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transport::found;

    /// So many endpoints of one participant.
    fn add(seen: &mut Seen, participant: u8, endpoints: impl Iterator<Item = (String, String)>) {
        for (number, (topic, type_name)) in endpoints.enumerate() {
            let mut guid = [participant; 16];
            guid[12..].copy_from_slice(&(number as u32).to_be_bytes());
            assert!(seen.add(Found { guid, type_name, ..found(0, &topic) }));
        }
    }

    fn seen_with(strangers: impl Iterator<Item = (String, String)>) -> Discovery {
        let mut seen = Seen::default();
        let bool_type = || "std_msgs::msg::dds_::Bool_".to_owned();
        add(&mut seen, 1, strangers);
        add(&mut seen, 7, [("rt/telltale/hold".to_owned(), bool_type())].into_iter());
        add(&mut seen, 8, [("rt/zeta".to_owned(), bool_type())].into_iter());
        add(&mut seen, 9, [("rt/telltale/hold".to_owned(), bool_type())].into_iter());
        let ours = BTreeSet::from([participant_name(&[7; 16])]);
        look(&seen, &Nodes::default(), (&ours, &BTreeSet::from(["/zeta".to_owned()])))
    }

    fn publishers<'a>(discovery: &'a Discovery, topic: &str) -> Vec<&'a str> {
        let place = discovery.topics.binary_search_by(|it| (*it.name).cmp(topic)).expect("it is listed");
        discovery.topics[place].publishers.iter().map(|it| &it.participant[..2]).collect()
    }

    #[test]
    fn the_topics_of_ours_and_of_the_configuration_are_listed_however_many_others_there_are() {
        let many = (0..TOPICS_MAX + 100).map(|number| (format!("rt/a{number:05}"), "t".to_owned()));
        let discovery = seen_with(many);
        assert_eq!((discovery.topics.len(), discovery.more), (TOPICS_MAX, 102));
        assert_eq!(publishers(&discovery, "/telltale/hold"), ["07", "09"]);
        assert_eq!(publishers(&discovery, "/zeta"), ["08"]);
    }

    #[test]
    fn who_speaks_our_type_on_a_topic_of_ours_is_listed_however_many_others_do_not() {
        let many = (0..2 * ENDPOINTS_MAX).map(|_| ("rt/telltale/hold".to_owned(), "t".to_owned()));
        let discovery = seen_with(many);
        let listed = publishers(&discovery, "/telltale/hold");
        assert_eq!((&listed[..2], listed.len()), (&["07", "09"][..], ENDPOINTS_MAX));
    }

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
