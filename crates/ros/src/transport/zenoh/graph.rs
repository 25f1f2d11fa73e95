//! The nodes, publishers, subscribers, servers and clients that liveliness tokens tell of.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use super::attachment::Gid;
use super::names::{self, Channel, ENTITIES_MAX, Kind, Part, Token};
use crate::transport::ids::{PREFIX, Prefix};
use crate::transport::wire::NAME_BYTES_MAX;
use crate::transport::{Found, NODES_TOPIC};
use telltale_engine::discovery::Liveliness;
use telltale_msg::messages::{self, GidSize, NodeEntities, PARTICIPANT_ENTITIES_INFO};
use telltale_msg::sample_bytes::Guid;
use telltale_msg::services::ZENOH;

/// Tokens that are kept. A server or client has two endpoints.
const TOKENS_MAX: usize = 32_768;
/// The entity of a session that announces its nodes.
const ANNOUNCER: u32 = u32::MAX;
/// Marks the writer of replies of a server, and the reader of replies of a client.
const REPLIES: u32 = ENTITIES_MAX;

/// The tokens of all sessions but our own.
#[derive(Debug, Default)]
pub struct Graph {
    domain: u16,
    own: String,
    sessions: BTreeMap<String, BTreeMap<String, Token>>,
    /// The number of tokens of each session: the last has the most.
    sizes: BTreeSet<(usize, String)>,
    count: usize,
    /// Tokens that were passed over since the graph was full.
    pub cut: u32,
    publishers: HashMap<Gid, Guid>,
    /// The hashes of each channel's type, and how many tokens have each.
    hashes: BTreeMap<Channel, BTreeMap<String, usize>>,
    /// Sessions that have changed since they were last told of.
    pub changed: BTreeSet<String>,
    /// A token has gone since its sessions were last told of: the router has to confirm it.
    pub has_lost: bool,
}

impl Graph {
    pub fn new(domain: u16, own: String) -> Graph {
        Graph { domain, own, ..Graph::default() }
    }

    /// A token is there. When there are too many, one of the session with the most is given up.
    pub fn add(&mut self, key: &str) {
        let Some(token) = Token::read(key, self.domain).filter(|token| token.session != self.own) else {
            return;
        };
        let session = token.session.clone();
        if self.sessions.get(&session).is_some_and(|tokens| tokens.contains_key(key)) {
            return;
        }
        if self.count >= TOKENS_MAX {
            self.cut += 1;
            let most = self.sizes.last().cloned();
            let last = most
                .and_then(|(_, most)| Some((self.sessions.get(&most)?.keys().next_back()?.clone(), most)));
            match last {
                Some((last, most)) if most != session => self.remove_of(&most, &last),
                _ => return,
            }
        }
        if token.kind == Kind::Publisher || token.kind == Kind::Client {
            self.publishers.insert(names::gid(key), guid(&session, token.entity));
        }
        self.count_hash(&token, true);
        self.resize(&session, |tokens| drop(tokens.insert(key.to_owned(), token)));
    }

    /// A token is gone.
    pub fn remove(&mut self, key: &str) {
        self.has_lost = true;
        if let Some(token) = Token::read(key, self.domain) {
            self.remove_of(&token.session, key);
        }
    }

    fn remove_of(&mut self, session: &str, key: &str) {
        let Some(token) = self.sessions.get(session).and_then(|tokens| tokens.get(key)).cloned() else {
            return;
        };
        self.publishers.remove(&names::gid(key));
        self.count_hash(&token, false);
        self.resize(session, |tokens| drop(tokens.remove(key)));
    }

    fn resize(&mut self, session: &str, change: impl FnOnce(&mut BTreeMap<String, Token>)) {
        let tokens = self.sessions.entry(session.to_owned()).or_default();
        let before = tokens.len();
        change(tokens);
        let after = tokens.len();
        if after == 0 {
            self.sessions.remove(session);
        }
        self.sizes.remove(&(before, session.to_owned()));
        if after > 0 {
            self.sizes.insert((after, session.to_owned()));
        }
        self.count = self.count + after - before;
        self.changed.insert(session.to_owned());
    }

    fn count_hash(&mut self, token: &Token, is_new: bool) {
        let Some((channel, hash, _)) = &token.channel else { return };
        let known = self.hashes.entry(channel.clone()).or_default();
        let count = known.entry(hash.clone()).or_default();
        *count = if is_new { *count + 1 } else { count.saturating_sub(1) };
        known.retain(|_, count| *count > 0);
        if known.is_empty() {
            self.hashes.remove(channel);
        }
    }

    /// The hashes of a channel's type that others have.
    pub fn hashes(&self, channel: &Channel) -> impl Iterator<Item = &String> {
        self.hashes.get(channel).into_iter().flat_map(BTreeMap::keys)
    }

    /// The writer with this id.
    pub fn writer(&self, gid: &Gid) -> Option<Guid> {
        self.publishers.get(gid).copied()
    }

    /// Tells of all sessions again.
    pub fn tell_all_again(&mut self) {
        self.changed = self.sessions.keys().cloned().collect();
    }

    /// All endpoints as they would be on DDS: each session also has a writer that announces its nodes.
    pub fn endpoints(&self) -> BTreeMap<Guid, Found> {
        let announcer = |session: &String| announces(session, NODES_TOPIC.to_owned());
        let announcers = self.sessions.keys().map(announcer);
        let tokens = self.sessions.values().flat_map(BTreeMap::values);
        let all = announcers.chain(tokens.flat_map(endpoints));
        let fits =
            |found: &Found| found.topic.len() <= NAME_BYTES_MAX && found.type_name.len() <= NAME_BYTES_MAX;
        all.filter(fits).map(|found| (found.guid, found)).collect()
    }

    /// The nodes of a session as `rmw_dds_common/msg/ParticipantEntitiesInfo`, and the writer of that. `None` if it is
    /// gone.
    pub fn announcement(&self, session: &str) -> Option<(Guid, Vec<u8>)> {
        let tokens = self.sessions.get(session)?;
        let mut nodes: BTreeMap<&str, (usize, Vec<Guid>, Vec<Guid>)> = BTreeMap::new();
        for token in tokens.values() {
            let (times, readers, writers) = nodes.entry(&token.node).or_default();
            *times += usize::from(token.kind == Kind::Node);
            for found in endpoints(token) {
                if found.writes { writers.push(found.guid) } else { readers.push(found.guid) }
            }
        }
        // A name that a session has twice is announced twice.
        let named = nodes.iter().flat_map(|(name, (times, readers, writers))| {
            let again = (1..*times).map(|_| NodeEntities { name, readers: &[], writers: &[] });
            (0..1.min(*times)).map(|_| NodeEntities { name, readers, writers }).chain(again)
        });
        let all: Vec<NodeEntities<'_>> = named.collect();
        Some((guid(session, ANNOUNCER), messages::encode_nodes(guid(session, 0), &all, GidSize::Bytes16)))
    }
}

/// The participant of a session: two bytes that tell it from DDS, and the beginning of its id.
pub fn prefix(session: &str) -> Prefix {
    let mut prefix = [0; PREFIX];
    prefix[..2].copy_from_slice(&ZENOH);
    for (byte, digits) in prefix[2..].iter_mut().zip(session.as_bytes().chunks(2)) {
        let digits = std::str::from_utf8(digits).unwrap_or_default();
        *byte = u8::from_str_radix(digits, 16).unwrap_or_default();
    }
    prefix
}

/// A reader or writer of a session.
pub fn guid(session: &str, entity: u32) -> Guid {
    let mut guid = [0; 16];
    guid[..PREFIX].copy_from_slice(&prefix(session));
    guid[PREFIX..].copy_from_slice(&entity.to_be_bytes());
    guid
}

fn announces(session: &str, topic: String) -> Found {
    Found {
        guid: guid(session, ANNOUNCER),
        writes: true,
        topic,
        type_name: messages::dds_type_name(PARTICIPANT_ENTITIES_INFO).unwrap_or_default(),
        reliable: true,
        transient_local: true,
        deadline_ns: None,
        liveliness: Liveliness::default(),
        takes: 0,
    }
}

fn endpoints(token: &Token) -> impl Iterator<Item = Found> + '_ {
    let parts: &[(bool, Part, u32)] = match token.kind {
        Kind::Node => &[],
        Kind::Publisher => &[(true, Part::Message, 0)],
        Kind::Subscriber => &[(false, Part::Message, 0)],
        Kind::Server => &[(false, Part::Request, 0), (true, Part::Reply, REPLIES)],
        Kind::Client => &[(true, Part::Request, 0), (false, Part::Reply, REPLIES)],
    };
    parts.iter().filter_map(|(writes, part, mark)| {
        let (channel, _, qos) = token.channel.as_ref()?;
        let (topic, type_name) = channel.dds(*part);
        Some(Found {
            guid: guid(&token.session, token.entity | mark),
            writes: *writes,
            topic,
            type_name,
            // On Zenoh no quality that a subscriber asks for stops a message: it is told as the weakest.
            reliable: *writes && qos.reliable,
            transient_local: *writes && qos.transient_local,
            deadline_ns: qos.deadline_ns.filter(|_| *writes),
            liveliness: if *writes { qos.liveliness } else { Liveliness::default() },
            takes: if *writes { 0 } else { u8::MAX >> (8 - crate::Quality::COUNT) },
        })
    })
}
