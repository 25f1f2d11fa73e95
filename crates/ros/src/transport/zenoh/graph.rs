//! The nodes, publishers, subscribers, servers and clients that liveliness tokens tell of.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use super::attachment::Gid;
use super::hashes;
use super::names::{self, Channel, ENTITIES_MAX, Kind, Part, Token};
use crate::transport::ids::{PREFIX, Prefix};
use crate::transport::wire::NAME_BYTES_MAX;
use crate::transport::{ENDPOINTS_MAX, Found, NODES_TOPIC};
use telltale_engine::discovery::Liveliness;
use telltale_msg::messages::{self, GidSize, NodeEntities, PARTICIPANT_ENTITIES_INFO};
use telltale_msg::sample_bytes::Guid;
use telltale_msg::services::ZENOH;

/// Places that no session loses to others.
const SHARE: usize = 256;
/// Telltale publishes on so many types of one topic, by their hashes.
const HASHES_MAX: usize = 8;
/// The entity of a session that announces its nodes.
const ANNOUNCER: u32 = u32::MAX;
/// Marks the writer of replies of a server, and the reader of replies of a client.
const REPLIES: u32 = ENTITIES_MAX;

/// The tokens of all sessions but our own.
#[derive(Debug, Default)]
pub struct Graph {
    domain: u16,
    own: String,
    sessions: BTreeMap<Prefix, Session>,
    /// The places of each session: the last has the most.
    sizes: BTreeSet<(usize, Prefix)>,
    places: usize,
    /// Tokens that were passed over since the graph was full.
    pub cut: u32,
    publishers: HashMap<Gid, Guid>,
    /// The hashes of each channel's type that entities of a kind have, and how many have each.
    hashes: BTreeMap<(Channel, Kind), BTreeMap<String, usize>>,
    /// Sessions that have changed since they were last told of.
    pub changed: BTreeSet<Prefix>,
    /// Known tokens that are gone, or the router is: it is not asked yet.
    lost: BTreeSet<(Prefix, String)>,
    /// The same, and it is asked.
    asked: BTreeSet<(Prefix, String)>,
}

/// The tokens of the sessions with ids that begin alike. So a forged id takes nothing from the true session.
#[derive(Debug, Default)]
struct Session {
    tokens: BTreeMap<String, Token>,
    /// Of the tokens.
    places: usize,
}

impl Session {
    /// One more for the writer that announces its nodes.
    fn places(&self) -> usize {
        if self.tokens.is_empty() { 0 } else { self.places + 1 }
    }
}

impl Graph {
    pub fn new(domain: u16, own: String) -> Graph {
        Graph { domain, own, ..Graph::default() }
    }

    /// A token is there. When there are too many, the session with the most gives way if it has more than its share.
    pub fn add(&mut self, key: &str) {
        let Some(mut token) = Token::read(key, self.domain).filter(|token| token.session != self.own) else {
            return;
        };
        let session = prefix(&token.session);
        if self.sessions.get(&session).is_some_and(|known| known.tokens.contains_key(key)) {
            let place = (session, key.to_owned());
            // It was away for a moment.
            self.lost.remove(&place);
            self.asked.remove(&place);
            return;
        }
        while self.places + places(&token) >= ENDPOINTS_MAX {
            self.cut = self.cut.saturating_add(1);
            let most = self.sizes.last().copied().filter(|(places, it)| *places > SHARE && *it != session);
            let last =
                most.and_then(|(_, it)| Some((it, self.sessions.get(&it)?.tokens.keys().next_back()?)));
            let Some((most, last)) = last.map(|(it, last)| (it, last.clone())) else { return };
            self.take_away(most, &last);
        }
        let gid = names::gid(key);
        // Two of one number are two all the same.
        token.entity = u32::from_le_bytes([gid[0], gid[1], gid[2], gid[3]]) % ENTITIES_MAX;
        if token.kind == Kind::Publisher || token.kind == Kind::Client {
            self.publishers.insert(gid, guid(&token.session, token.entity));
        }
        self.count_hash(&token, true);
        let known = self.sessions.entry(session).or_default();
        let before = known.places();
        known.places += places(&token);
        known.tokens.insert(key.to_owned(), token);
        self.resize(session, before);
    }

    /// A token is gone, or the router is.
    pub fn lose(&mut self, key: &str) {
        let session = Token::read(key, self.domain).map(|token| prefix(&token.session));
        let is_known =
            |it: &Prefix| self.sessions.get(it).is_some_and(|known| known.tokens.contains_key(key));
        if let Some(session) = session.filter(is_known) {
            self.lost.insert((session, key.to_owned()));
        }
    }

    /// The router tells again of all that are there.
    pub fn lose_all(&mut self) {
        let keys = |(session, known): (&Prefix, &Session)| {
            let session = *session;
            known.tokens.keys().map(move |key| (session, key.clone())).collect::<Vec<_>>()
        };
        self.lost = self.sessions.iter().flat_map(keys).collect();
        self.cut = 0;
    }

    /// Whether the router has to be asked about tokens.
    pub fn asks(&mut self) -> bool {
        self.asked.append(&mut self.lost);
        !self.asked.is_empty()
    }

    /// The router has answered: they are gone.
    pub fn confirm(&mut self) {
        for (session, key) in std::mem::take(&mut self.asked) {
            self.take_away(session, &key);
        }
    }

    /// Whether tokens that were passed over have room now.
    pub fn has_room_again(&self) -> bool {
        self.cut > 0 && self.places < ENDPOINTS_MAX / 2
    }

    fn take_away(&mut self, session: Prefix, key: &str) {
        let Some(known) = self.sessions.get_mut(&session) else { return };
        let before = known.places();
        let Some(token) = known.tokens.remove(key) else { return };
        known.places -= places(&token);
        self.publishers.remove(&names::gid(key));
        self.count_hash(&token, false);
        self.resize(session, before);
    }

    /// A session had so many places before.
    fn resize(&mut self, session: Prefix, before: usize) {
        let after = self.sessions.get(&session).map_or(0, Session::places);
        self.sizes.remove(&(before, session));
        if after == 0 {
            self.sessions.remove(&session);
        } else {
            self.sizes.insert((after, session));
        }
        self.places = self.places + after - before;
        self.changed.insert(session);
    }

    fn count_hash(&mut self, token: &Token, is_new: bool) {
        let Some((channel, hash, _)) = &token.channel else { return };
        let of = (channel.clone(), token.kind);
        let known = self.hashes.entry(of.clone()).or_default();
        let count = known.entry(hash.clone()).or_default();
        *count = if is_new { *count + 1 } else { count.saturating_sub(1) };
        if *count == 0 {
            known.remove(hash);
        }
        if known.is_empty() {
            self.hashes.remove(&of);
        }
    }

    /// The hashes of a channel's type that entities of a kind have. Those that are right are first, so forged ones do not
    /// push them out.
    pub fn hashes(&self, channel: &Channel, kind: Kind) -> impl Iterator<Item = &str> {
        let right = [hashes::of(&channel.type_name), hashes::NONE];
        let known = self.hashes.get(&(channel.clone(), kind));
        let is_right = move |hash: &&str| right.contains(hash);
        let all = move || known.into_iter().flat_map(BTreeMap::keys).map(String::as_str);
        all().filter(is_right).chain(all().filter(move |hash| !is_right(hash))).take(HASHES_MAX)
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
        let announcers = self.sessions.keys().map(|session| announces(session, NODES_TOPIC.to_owned()));
        let tokens = self.sessions.values().flat_map(|known| known.tokens.values());
        // The last of two with one id counts.
        let all = tokens.flat_map(endpoints).chain(announcers);
        let fits =
            |found: &Found| found.topic.len() <= NAME_BYTES_MAX && found.type_name.len() <= NAME_BYTES_MAX;
        all.filter(fits).map(|found| (found.guid, found)).collect()
    }

    /// The nodes of a session as `rmw_dds_common/msg/ParticipantEntitiesInfo`, and the writer of that. `None` if it is
    /// gone.
    pub fn announcement(&self, session: &Prefix) -> Option<(Guid, Vec<u8>)> {
        let tokens = &self.sessions.get(session)?.tokens;
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
        let body = messages::encode_nodes(entity(session, 0), &all, GidSize::Bytes16);
        Some((entity(session, ANNOUNCER), body))
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
pub fn guid(session: &str, number: u32) -> Guid {
    entity(&prefix(session), number)
}

fn entity(session: &Prefix, number: u32) -> Guid {
    let mut guid = [0; 16];
    guid[..PREFIX].copy_from_slice(session);
    guid[PREFIX..].copy_from_slice(&number.to_be_bytes());
    guid
}

/// The endpoints of a token. A node takes a place, too.
fn places(token: &Token) -> usize {
    endpoints(token).count().max(1)
}

fn announces(session: &Prefix, topic: String) -> Found {
    Found {
        guid: entity(session, ANNOUNCER),
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

#[cfg(test)]
mod tests {
    use super::*;

    /// A publisher or server of a session, by its number.
    fn token(session: &str, kind: &str, number: usize, hash: &str) -> String {
        format!(
            "@ros2_lv/7/{session}/0/{number}/{kind}/%/%/node/%t{number}/std_msgs::msg::dds_::Bool_/{hash}/::,:,:,:,,"
        )
    }

    fn of(graph: &Graph, session: &str) -> usize {
        let endpoints = graph.endpoints();
        endpoints.keys().filter(|guid| guid.starts_with(&prefix(session))).count()
    }

    #[test]
    fn a_stranger_with_thousands_pushes_out_its_own_alone() {
        let mut graph = Graph::new(7, "own".to_owned());
        let vehicle = |graph: &mut Graph, session: &str| {
            (0..SHARE - 1).for_each(|number| graph.add(&token(session, "MP", number, "h")));
        };
        vehicle(&mut graph, "a1");
        (0..ENDPOINTS_MAX).for_each(|number| graph.add(&token("ffff", "SS", number, "h")));
        vehicle(&mut graph, "b2");
        assert_eq!([of(&graph, "a1"), of(&graph, "b2")], [SHARE, SHARE]);
        // Now each with an id of its own.
        (0..2 * ENDPOINTS_MAX)
            .for_each(|number| graph.add(&token(&format!("{number:020x}"), "SS", number, "h")));
        assert_eq!([of(&graph, "a1"), of(&graph, "b2")], [SHARE, SHARE]);
        assert!(graph.cut > 0 && graph.endpoints().len() <= ENDPOINTS_MAX && !graph.has_room_again());
        assert_eq!(of(&graph, "ffff"), SHARE - 1);
        graph.lose_all();
        vehicle(&mut graph, "b2");
        assert!(graph.asks());
        graph.confirm();
        assert_eq!((graph.endpoints().len(), graph.places, graph.sizes.len()), (SHARE, SHARE, 1));
        assert_eq!((graph.publishers.len(), graph.hashes.len()), (SHARE - 1, SHARE - 1));
    }

    #[test]
    fn a_token_is_gone_once_the_router_has_answered_a_question_after_it() {
        let mut graph = Graph::new(7, "own".to_owned());
        let [first, second] = [1, 2].map(|number| token("a1", "MP", number, "h"));
        graph.add(&first);
        graph.add(&second);
        graph.lose(&first);
        assert!(graph.asks());
        graph.lose(&second);
        graph.confirm();
        assert_eq!(of(&graph, "a1"), 2, "the second and the announcer");
        graph.add(&second);
        assert!(!graph.asks());
        graph.lose("@ros2_lv/7/unknown/0/1/NN/%/%/node");
        assert!(!graph.asks());
    }

    #[test]
    fn a_forged_id_or_hash_takes_nothing_from_the_true_one() {
        let mut graph = Graph::new(7, "own".to_owned());
        let true_one = token("0123456789abcdef01234567", "MP", 1, "h");
        graph.add("@ros2_lv/7/0123456789abcdef01234567/0/0/NN/%/%/node");
        graph.add(&true_one);
        let writer = graph.writer(&names::gid(&true_one)).unwrap();
        let announced = graph.announcement(&prefix("0123456789abcdef01234567")).unwrap();
        let forged = true_one.replace("%t1", "%other").replace("01234567/", "01234568/");
        graph.add(&forged);
        assert!(graph.endpoints().get(&writer).is_some_and(|found| found.topic == "rt/t1"));
        let both = graph.announcement(&prefix("0123456789abcdef01234567")).unwrap();
        assert!(both.0 == announced.0 && both.1.len() > announced.1.len());
        let channel = Channel { name: "/t1".to_owned(), type_name: "std_msgs::msg::dds_::Bool_".to_owned() };
        let right = hashes::of(&channel.type_name);
        let hashes =
            (0..99).map(|number| format!("A{number}")).chain([hashes::NONE.to_owned(), right.to_owned()]);
        hashes.for_each(|hash| graph.add(&token("ffff", "MS", 1, &hash)));
        let known: Vec<&str> = graph.hashes(&channel, Kind::Subscriber).collect();
        assert!(known.len() == HASHES_MAX && known.contains(&right) && known.contains(&hashes::NONE));
    }
}
