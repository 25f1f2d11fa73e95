//! The names of ROS 2 on Zenoh: the keys of topics and services, and the liveliness tokens by which nodes,
//! publishers, subscribers, servers and clients are found.
//!
//! Above the transport a topic has the name that it has on DDS: `rt/` before a topic, `rq/` and `rr/` before the
//! requests and replies of a service.

use telltale_engine::discovery::{Liveliness, LivelinessKind};
use twox_hash::XxHash3_128;

use super::attachment::Gid;

/// The first part of every token.
const TOKENS: &str = "@ros2_lv";
/// A longer token is passed over.
const TOKEN_BYTES_MAX: usize = 2048;

/// All tokens of a domain.
pub fn tokens(domain: u16) -> String {
    format!("{TOKENS}/{domain}/**")
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Kind {
    Node,
    Publisher,
    Subscriber,
    Server,
    Client,
}

impl Kind {
    const WORDS: [(&str, Kind); 5] = [
        ("NN", Kind::Node),
        ("MP", Kind::Publisher),
        ("MS", Kind::Subscriber),
        ("SS", Kind::Server),
        ("SC", Kind::Client),
    ];

    /// The kind that its messages come from or go to.
    pub fn other(self) -> Kind {
        match self {
            Kind::Node => Kind::Node,
            Kind::Publisher => Kind::Subscriber,
            Kind::Subscriber => Kind::Publisher,
            Kind::Server => Kind::Client,
            Kind::Client => Kind::Server,
        }
    }
}

/// A topic or service, and its type.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Channel {
    /// With its first slash.
    pub name: String,
    /// As on the wire: `std_msgs::msg::dds_::Bool_`, `std_srvs::srv::dds_::Trigger_`.
    pub type_name: String,
}

/// The part of a channel that a reader or writer of DDS is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Part {
    Message,
    Request,
    Reply,
}

impl Channel {
    /// The key of its data; `*` is any hash of the type.
    pub fn key(&self, domain: u16, hash: &str) -> String {
        format!("{domain}/{}/{}/{hash}", self.name.trim_matches('/'), self.type_name)
    }

    /// The channel of a topic and type as they are on DDS.
    pub fn of_dds(topic: &str, type_name: &str) -> Option<(Channel, Part)> {
        let service = |before: &str, behind: &str, kind: &str, part| {
            let name = topic.strip_prefix(before)?.strip_suffix(behind)?;
            let type_name = type_name.strip_suffix(kind)?.to_owned() + "_";
            Some((Channel { name: format!("/{name}"), type_name }, part))
        };
        let message = || {
            let name = topic.strip_prefix("rt/").unwrap_or(topic);
            Some((Channel { name: format!("/{name}"), type_name: type_name.to_owned() }, Part::Message))
        };
        match topic.get(..3)? {
            "rq/" => service("rq/", "Request", "_Request_", Part::Request),
            "rr/" => service("rr/", "Reply", "_Response_", Part::Reply),
            _ => message(),
        }
    }

    /// The topic and the type as they are on DDS.
    pub fn dds(&self, part: Part) -> (String, String) {
        let name = self.name.trim_start_matches('/');
        let typed = |kind: &str| format!("{}{kind}_", self.type_name);
        match part {
            Part::Message => (format!("rt/{name}"), self.type_name.clone()),
            Part::Request => (format!("rq/{name}Request"), typed("Request")),
            Part::Reply => (format!("rr/{name}Reply"), typed("Response")),
        }
    }
}

/// The quality of service in a token.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Qos {
    pub reliable: bool,
    pub transient_local: bool,
    pub depth: usize,
    pub deadline_ns: Option<u64>,
    pub liveliness: Liveliness,
}

impl Qos {
    /// An empty part has the default of rmw_zenoh.
    fn read(text: &str) -> Qos {
        let mut parts = text.split(':');
        let mut part = || parts.next().unwrap_or_default();
        let (reliability, durability, history, deadline) = (part(), part(), part(), part());
        let _lifespan = part();
        let (kind, lease) = part().split_once(',').unwrap_or_default();
        Qos {
            reliable: reliability != "2",
            transient_local: durability == "1",
            depth: history.split_once(',').and_then(|(_, depth)| depth.parse().ok()).unwrap_or(42),
            deadline_ns: nanos(deadline),
            liveliness: Liveliness {
                kind: if kind == "3" { LivelinessKind::ManualByTopic } else { LivelinessKind::Automatic },
                lease_ns: nanos(lease),
            },
        }
    }

    fn text(&self) -> String {
        let word = |is_other: bool, number: &'static str| if is_other { number } else { "" };
        let (reliability, durability) = (word(!self.reliable, "2"), word(self.transient_local, "1"));
        format!("{reliability}:{durability}:,{}:,:,:,,", self.depth)
    }
}

/// Seconds and nanoseconds; `None` is infinite.
fn nanos(text: &str) -> Option<u64> {
    let (seconds, nanos) = text.split_once(',')?;
    let (seconds, nanos): (u64, u64) = (seconds.parse().ok()?, nanos.parse().ok()?);
    // The infinite time of ROS 2.
    (seconds < 9_223_372_036).then(|| seconds.saturating_mul(1_000_000_000).saturating_add(nanos))
}

/// A node, or a publisher, subscriber, server or client of it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Token {
    /// The session, as Zenoh writes its id.
    pub session: String,
    /// Its number in the session.
    pub entity: u32,
    pub kind: Kind,
    /// The whole name of the node.
    pub node: String,
    /// All but a node have one.
    pub channel: Option<(Channel, String, Qos)>,
}

impl Token {
    /// `None` for a token that no rmw_zenoh of this domain declares.
    pub fn read(key: &str, domain: u16) -> Option<Token> {
        if key.len() > TOKEN_BYTES_MAX || key.contains(['*', '$']) {
            return None;
        }
        let mut parts = key.strip_prefix(TOKENS)?.strip_prefix('/')?.split('/');
        let mut part = || parts.next();
        part()?.parse().ok().filter(|number: &u16| *number == domain)?;
        let session = part()?.to_owned();
        let _node = part()?;
        let entity = part()?.parse().ok().filter(|number| *number < ENTITIES_MAX)?;
        let word = part()?;
        let kind = Kind::WORDS.into_iter().find(|(known, _)| *known == word)?.1;
        let _enclave = part()?;
        let (namespace, name) = (part()?.replace('%', "/"), part()?);
        let node = format!("{}/{name}", namespace.trim_end_matches('/'));
        let channel = match kind {
            Kind::Node => None,
            _ => {
                let name = part()?.replace('%', "/");
                let channel = Channel { name, type_name: part()?.to_owned() };
                Some((channel, part()?.to_owned(), Qos::read(part()?)))
            }
        };
        channel.iter().all(|(channel, ..)| channel.name.starts_with('/')).then_some(())?;
        Some(Token { session, entity, kind, node, channel })
    }

    /// The key under which it is declared, where `node_entity` is the number of its node.
    pub fn key(&self, domain: u16, node_entity: u32) -> String {
        let word = Kind::WORDS.iter().find(|(_, kind)| *kind == self.kind).map_or("", |(word, _)| word);
        let (namespace, name) = self.node.rsplit_once('/').unwrap_or(("", &self.node));
        let namespace = if namespace.is_empty() { "%".to_owned() } else { namespace.replace('/', "%") };
        let (session, entity) = (&self.session, self.entity);
        let node = format!("{TOKENS}/{domain}/{session}/{node_entity}/{entity}/{word}/%/{namespace}/{name}");
        match &self.channel {
            None => node,
            Some((channel, hash, qos)) => {
                let topic = channel.name.replace('/', "%");
                format!("{node}/{topic}/{}/{hash}/{}", channel.type_name, qos.text())
            }
        }
    }
}

/// Numbers of entities from here on are ours to give.
pub const ENTITIES_MAX: u32 = 1 << 31;

/// The id that the messages of a token's publisher have.
pub fn gid(key: &str) -> Gid {
    XxHash3_128::oneshot(key.as_bytes()).to_le_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    const PUBLISHER: &str = "@ros2_lv/7/a1b2/0/12/MP/%/%ns/camera/%ns%scan/sensor_msgs::msg::dds_::LaserScan_/RIHS01_ab/2:1:,5:1,500:,:3,2,0";

    #[test]
    fn a_token_names_node_topic_type_and_quality() {
        let token = Token::read(PUBLISHER, 7).unwrap();
        assert_eq!((&*token.session, token.entity, token.kind), ("a1b2", 12, Kind::Publisher));
        assert_eq!(token.node, "/ns/camera");
        let (channel, hash, qos) = token.channel.unwrap();
        assert_eq!((&*channel.name, &*hash), ("/ns/scan", "RIHS01_ab"));
        assert_eq!(channel.key(7, "*"), "7/ns/scan/sensor_msgs::msg::dds_::LaserScan_/*");
        let liveliness = Liveliness { kind: LivelinessKind::ManualByTopic, lease_ns: Some(2_000_000_000) };
        let expected = Qos {
            reliable: false,
            transient_local: true,
            depth: 5,
            deadline_ns: Some(1_000_000_500),
            liveliness,
        };
        assert_eq!(qos, expected);
        let defaults = Qos::read("::,10:,:,:,,");
        assert_eq!((defaults.reliable, defaults.transient_local, defaults.deadline_ns), (true, false, None));
        let node = "@ros2_lv/7/a1b2/3/3/NN/%/%/camera";
        let read = Token::read(node, 7).unwrap();
        assert_eq!((&*read.node, read.key(7, 3)), ("/camera", node.to_owned()));
        let lyrical = format!("{PUBLISHER}/backends:cpu:");
        assert!(Token::read(&lyrical, 7).is_some());
        for wrong in ["@ros2_lv/7/a1b2", "@ros2_lv/7/*/0/12/NN/%/%/x", "", &PUBLISHER.replace("/12/", "/x/")]
        {
            assert_eq!(Token::read(wrong, 7), None, "{wrong}");
        }
        assert_eq!(Token::read(PUBLISHER, 8), None, "another domain");
    }

    #[test]
    fn a_channel_is_the_same_on_both_transports() {
        let channels = [
            ("rt/a/b", "std_msgs::msg::dds_::Bool_", "7/a/b/std_msgs::msg::dds_::Bool_/h"),
            ("rq/n/xRequest", "s::srv::dds_::T_Request_", "7/n/x/s::srv::dds_::T_/h"),
            ("rr/n/xReply", "s::srv::dds_::T_Response_", "7/n/x/s::srv::dds_::T_/h"),
        ];
        for (topic, type_name, key) in channels {
            let (channel, part) = Channel::of_dds(topic, type_name).unwrap();
            assert_eq!(channel.key(7, "h"), key);
            assert_eq!(channel.dds(part), (topic.to_owned(), type_name.to_owned()));
        }
        assert_eq!(Channel::of_dds("rq/x", "t"), None);
    }

    #[test]
    fn an_id_is_the_hash_of_its_token() {
        // As xxhash.xxh3_128 of Python has it.
        assert_eq!(gid(""), 0x99aa_06d3_0147_98d8_6001_c324_468d_497f_u128.to_le_bytes());
    }
}
