//! The results of DDS discovery, as plain data that the bridge fills and pages show.

use super::text::words;
use super::time::Span;
use super::time::Timestamp;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

/// Topics that are listed; further ones are only counted.
pub const TOPICS_MAX: usize = 2000;
/// Publishers or subscribers that are listed for one topic.
pub const ENDPOINTS_MAX: usize = 200;

/// All topics of a domain at one instant, by name.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Discovery {
    /// The time of the latest look; `None` before the first one.
    pub at: Option<Timestamp>,
    pub topics: Vec<TopicSeen>,
    /// Full names of the announced nodes, `/ns/name`.
    pub nodes: Vec<String>,
    /// Full names of the services that a node serves, `/ns/name`.
    pub services: Vec<String>,
    /// The number of topics beyond the limit.
    pub more: usize,
    /// Participants other than our own.
    pub participants: usize,
}

#[derive(Debug, Clone, PartialEq, Default)]
pub struct TopicSeen {
    /// The ROS name, `/diagnostics`; for a topic outside ROS, the DDS name.
    pub name: String,
    pub publishers: Vec<Endpoint>,
    pub subscribers: Vec<Endpoint>,
    /// Messages per second that Telltale received; `None` if Telltale does not read the topic.
    pub rate_hz: Option<f32>,
    /// The standard deviation of the time from one message to the next, as they arrived; `None` of fewer than three.
    pub jitter_ms: Option<f32>,
}

/// A publisher or subscriber of a topic.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Endpoint {
    /// Its participant, in hexadecimal digits.
    pub participant: String,
    /// The full name of its node, `/ns/name`, if the node is announced.
    pub node: Option<String>,
    /// As ROS names it: `std_msgs/msg/Bool`.
    pub type_name: String,
    pub reliable: bool,
    pub transient_local: bool,
    /// The promised or expected period of messages; `None`: no deadline.
    pub deadline_ns: Option<u64>,
    pub liveliness: Liveliness,
    /// Whether it belongs to Telltale.
    pub ours: bool,
}

/// How a publisher's liveliness is asserted, from the weakest kind, and within which time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub struct Liveliness {
    pub kind: LivelinessKind,
    /// `None`: no limit.
    pub lease_ns: Option<u64>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub enum LivelinessKind {
    #[default]
    Automatic,
    ManualByParticipant,
    ManualByTopic,
}

words! {
    /// The reason why a publisher and a subscriber of one topic do not match. Its words are for a developer.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
    pub enum Mismatch {
        Type = "types differ",
        /// The subscriber requests reliability; the publisher does not offer it.
        Reliability = "reliability is asked for and not offered",
        /// The subscriber wants the last value as a late joiner; the publisher does not keep it.
        Durability = "the last value is asked for and not kept",
        /// The subscriber expects messages more often than the publisher promises them.
        Deadline = "a deadline is asked for and not offered",
        /// The subscriber expects a stronger or more frequent assertion of liveliness than the publisher offers.
        Liveliness = "liveliness is asked for and not offered",
    }
}

impl Mismatch {
    fn between(self, publisher: &Endpoint, subscriber: &Endpoint) -> String {
        let (from, to) = (publisher.label(), subscriber.label());
        match self {
            Mismatch::Type => {
                format!(
                    "{from} publishes {}, {to} subscribes to {}",
                    publisher.type_name, subscriber.type_name
                )
            }
            Mismatch::Reliability => format!("{to} asks for reliability, {from} does not offer it"),
            Mismatch::Durability => format!("{to} asks for the last value, {from} does not keep it"),
            Mismatch::Deadline => format!("{to} asks for a deadline, {from} does not offer it"),
            Mismatch::Liveliness => format!("{to} asks for liveliness, {from} does not offer it"),
        }
    }
}

impl TopicSeen {
    /// The reasons why publishers and subscribers of the topic do not match, each once.
    pub fn mismatches(&self) -> Vec<Mismatch> {
        let mut found: Vec<Mismatch> = self.mismatched().map(|(reason, ..)| reason).collect();
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Publishers and subscribers of the topic that do not match, with the reason (DDS 1.4, 2.2.3: requested against
    /// offered).
    pub fn mismatched(&self) -> impl Iterator<Item = (Mismatch, &Endpoint, &Endpoint)> {
        let pairs = self
            .publishers
            .iter()
            .flat_map(|publisher| self.subscribers.iter().map(move |it| (publisher, it)));
        pairs.filter_map(|(publisher, it)| Some((publisher.mismatch(it)?, publisher, it)))
    }

    /// The pairs that do not match and why, for a developer: each reason with the first pair, and the number of
    /// further pairs.
    pub fn why_mismatched(&self) -> Option<String> {
        let mut found: BTreeMap<Mismatch, (String, usize)> = BTreeMap::new();
        for (reason, publisher, subscriber) in self.mismatched() {
            let (_, pairs) =
                found.entry(reason).or_insert_with(|| (reason.between(publisher, subscriber), 0));
            *pairs += 1;
        }
        let said = found.into_values().map(|(text, pairs)| match pairs {
            1 => text,
            more => format!("{text}, and {} more", more - 1),
        });
        Some(said.collect::<Vec<_>>().join("; ")).filter(|text| !text.is_empty())
    }

    /// Whether another program publishes the same aggregated diagnosis as Telltale.
    pub fn is_published_beside_us(&self) -> bool {
        let aggregated = |it: &Endpoint| it.type_name.starts_with("diagnostic_msgs/msg/Diagnostic");
        let ours = |it: &&Endpoint| it.ours && aggregated(it);
        self.publishers.iter().any(|it| ours(&it))
            && self.publishers.iter().any(|it| !it.ours && aggregated(it))
    }

    /// The names of the types, each once.
    pub fn types(&self) -> Vec<&str> {
        let endpoints = self.publishers.iter().chain(&self.subscribers);
        let mut types: Vec<&str> = endpoints.map(|endpoint| &*endpoint.type_name).collect();
        types.sort_unstable();
        types.dedup();
        types
    }
}

impl Endpoint {
    /// Its node, or else its participant.
    fn label(&self) -> String {
        self.node.clone().unwrap_or_else(|| format!("a program without a node ({})", self.participant))
    }

    fn mismatch(&self, subscriber: &Endpoint) -> Option<Mismatch> {
        // Telltale has a reader of each kind; one of them fits.
        if subscriber.ours && self.type_name == subscriber.type_name {
            return None;
        }
        if self.type_name != subscriber.type_name {
            Some(Mismatch::Type)
        } else if subscriber.reliable && !self.reliable {
            Some(Mismatch::Reliability)
        } else if subscriber.transient_local && !self.transient_local {
            Some(Mismatch::Durability)
        } else if !is_within(self.deadline_ns, subscriber.deadline_ns) {
            Some(Mismatch::Deadline)
        } else {
            let lives = self.liveliness.kind >= subscriber.liveliness.kind
                && is_within(self.liveliness.lease_ns, subscriber.liveliness.lease_ns);
            (!lives).then_some(Mismatch::Liveliness)
        }
    }
}

/// Whether the offered period is at most the requested one; `None` is infinite.
fn is_within(offered: Option<u64>, asked: Option<u64>) -> bool {
    asked.is_none_or(|asked| offered.is_some_and(|offered| offered <= asked))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn endpoint(type_name: &str, reliable: bool, transient_local: bool, ours: bool) -> Endpoint {
        let participant = "01".to_owned();
        let type_name = type_name.to_owned();
        Endpoint { participant, type_name, reliable, transient_local, ours, ..Endpoint::default() }
    }

    #[test]
    fn what_is_asked_for_and_not_offered_does_not_match() {
        let (reliable, best_effort) = (endpoint("a", true, false, false), endpoint("a", false, false, false));
        let keeps = endpoint("a", true, true, false);
        let every = |deadline_ns| Endpoint { deadline_ns: Some(deadline_ns), ..keeps.clone() };
        let lives = |kind, lease_ns| Endpoint { liveliness: Liveliness { kind, lease_ns }, ..keeps.clone() };
        let (fast, by_topic) = (every(100), lives(LivelinessKind::ManualByTopic, Some(100)));
        for (publisher, subscriber, expect) in [
            (&reliable, endpoint("a", true, false, false), None),
            (&reliable, endpoint("a", false, false, false), None),
            (&best_effort, endpoint("a", true, false, false), Some(Mismatch::Reliability)),
            (&reliable, endpoint("a", true, true, false), Some(Mismatch::Durability)),
            (&keeps, endpoint("a", true, true, false), None),
            (&reliable, endpoint("b", true, false, false), Some(Mismatch::Type)),
            (&best_effort, endpoint("a", true, true, true), None),
            (&fast, every(100), None),
            (&fast, every(99), Some(Mismatch::Deadline)),
            (&keeps, every(100), Some(Mismatch::Deadline)),
            (&fast, endpoint("a", true, true, false), None),
            (&by_topic, lives(LivelinessKind::Automatic, None), None),
            (&by_topic, lives(LivelinessKind::ManualByTopic, Some(99)), Some(Mismatch::Liveliness)),
            (&keeps, lives(LivelinessKind::ManualByTopic, None), Some(Mismatch::Liveliness)),
        ] {
            let topic = TopicSeen {
                publishers: vec![publisher.clone()],
                subscribers: vec![subscriber],
                ..TopicSeen::default()
            };
            assert_eq!(topic.mismatches(), Vec::from_iter(expect), "{topic:?}");
        }
    }

    #[test]
    fn a_mismatch_names_the_nodes_and_their_types() {
        let named = |node: &str, of: Endpoint| Endpoint { node: Some(node.into()), ..of };
        let (camera, wrong) =
            (endpoint("a/msg/Image", false, false, false), endpoint("a/msg/Text", true, false, false));
        let viewer = endpoint("a/msg/Image", true, false, false);
        let topic = TopicSeen {
            publishers: vec![named("/camera", camera), wrong],
            subscribers: vec![named("/viewer", viewer.clone()), named("/logger", viewer)],
            ..TopicSeen::default()
        };
        let said = "a program without a node (01) publishes a/msg/Text, /viewer subscribes to a/msg/Image, and 1 more; \
             /viewer asks for reliability, /camera does not offer it, and 1 more";
        assert_eq!(topic.why_mismatched().as_deref(), Some(said));
        assert_eq!(TopicSeen::default().why_mismatched(), None);
    }
}

/// Writers whose nodes are remembered. No vehicle has more.
const WRITERS_MAX: usize = 2048;

/// A DDS writer by its GUID (RTPS 2.5, 9.3.1); all zero if the writer is unknown.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct WriterId(pub [u8; 16]);

/// In files: 32 hexadecimal digits.
impl From<WriterId> for String {
    fn from(writer: WriterId) -> String {
        writer.to_string()
    }
}

impl fmt::Display for WriterId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl TryFrom<String> for WriterId {
    type Error = &'static str;

    fn try_from(text: String) -> Result<WriterId, &'static str> {
        let number = Some(&text).filter(|it| it.len() == 32 && it.bytes().all(|it| it.is_ascii_hexdigit()));
        let number = number.and_then(|text| u128::from_str_radix(text, 16).ok());
        number.map(|it| WriterId(it.to_be_bytes())).ok_or("a writer has 32 hexadecimal digits")
    }
}

/// The ROS 2 node of a writer.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NodeOf {
    /// The participant may still announce it.
    Pending,
    /// It was not announced in time, for example by a program that uses DDS without ROS 2.
    Unannounced,
    /// The full name, `/ns/name`.
    Named(Arc<str>),
}

/// All writers of diagnostics that discovery knows.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct WriterList {
    /// When discovery was read.
    pub as_of: Timestamp,
    /// Discovery has had time to find every writer: a writer that is missing here, and was not heard since, has
    /// left.
    pub complete: bool,
    pub writers: BTreeMap<WriterId, NodeOf>,
}

impl WriterList {
    pub(super) fn node(&self, writer: WriterId) -> &NodeOf {
        self.writers.get(&writer).unwrap_or(&NodeOf::Pending)
    }

    /// The node's name, or else the GUID in hexadecimal digits.
    pub(super) fn label(&self, writer: WriterId) -> Arc<str> {
        match self.node(writer) {
            NodeOf::Named(name) => name.clone(),
            NodeOf::Pending | NodeOf::Unannounced => format!("writer {writer}").into(),
        }
    }

    /// Takes a newer list. While discovery is still searching, known writers stay.
    pub(super) fn follow(&mut self, newer: &WriterList) {
        let before = std::mem::replace(self, newer.clone());
        if !newer.complete {
            for (writer, node) in before.writers {
                if self.writers.len() >= WRITERS_MAX {
                    return;
                }
                let known = self.writers.entry(writer).or_insert(NodeOf::Pending);
                if *known == NodeOf::Pending {
                    *known = node;
                }
            }
        }
    }
}

/// The time that DDS discovery may need after a start or a reload to find all publishers.
pub(super) const DISCOVERY: Span = Span::from_secs(3);
