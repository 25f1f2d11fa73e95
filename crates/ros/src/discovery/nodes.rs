//! The nodes and services of the ROS 2 graph. Each participant announces its nodes on `ros_discovery_info`;
//! they count while discovery knows the participant. A participant serves a service if it reads the
//! requests and writes the replies.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::transport::ids::{self, PREFIX, Prefix};
use telltale_engine::model::sample::ProbeOutcome;
use telltale_engine::time::{Span, Timestamp};
use telltale_msg::cdr::{Endian, Fault, Reader};
use telltale_msg::messages::GidSize;
use telltale_msg::sample_bytes::Guid;

/// Participants that are remembered; no vehicle has more. So many again have a place if the configuration names one of
/// their nodes: announcements of others keep none of these away. Of those that announce the same name so many do.
const PARTICIPANTS_MAX: usize = 1024;
const SAME_NAME_MAX: usize = 16;
const NAME_BYTES_MAX: usize = 1024;

/// The memory for all announcements. Once it is used, a further one has room for a share only.
const BYTES_MAX: usize = 8 << 20;
/// The memory of a name beside its letters, and of a reader or writer, about.
const NAME_BYTES: usize = 48;
const ENDPOINT_BYTES: usize = 32;

/// A node is reported as missing only after discovery had this time to find it.
const DISCOVERY: Span = Span::from_secs(5);

#[derive(Debug, Clone, Default)]
pub struct Nodes {
    /// The start of the search; `None` while there is no participant.
    since: Option<Timestamp>,
    /// The latest announcement of each participant, with its writer. However many a participant makes, one counts: so
    /// none takes the places of others.
    announced: BTreeMap<Prefix, (Guid, Announcement)>,
    /// The writers that exist now. A writer that comes back may not announce again.
    present: BTreeSet<Guid>,
    /// Full names of the services that a node serves.
    services: BTreeSet<Box<str>>,
    /// Whole names of the nodes that the configuration names.
    named: Arc<BTreeSet<Box<str>>>,
}

/// The announcement of one participant.
#[derive(Debug, Clone, Default)]
struct Announcement {
    /// Whole names.
    names: BTreeSet<Arc<str>>,
    /// Those of them that several of its nodes have.
    twice: BTreeSet<Arc<str>>,
    /// The node to which a reader or writer belongs.
    endpoints: BTreeMap<Guid, Arc<str>>,
    /// The memory that it takes.
    bytes: usize,
    /// It says more than had room.
    is_cut: bool,
}

/// The memory for one announcement.
#[derive(Debug, Clone, Copy)]
struct Room {
    names: usize,
    endpoints: usize,
}

impl Room {
    /// Some 1,000 nodes with 4,000 readers and writers.
    const WHOLE: Room = Room { names: 64 << 10, endpoints: 128 << 10 };
    const SHARE: Room = Room { names: 2 << 10, endpoints: 2 << 10 };

    /// Whether there is room for so much; then it is taken.
    fn take(room: &mut usize, bytes: usize) -> bool {
        let left = room.checked_sub(bytes);
        *room = left.unwrap_or(*room);
        left.is_some()
    }
}

impl Nodes {
    pub fn new(since: Timestamp) -> Nodes {
        Nodes { since: Some(since), ..Nodes::default() }
    }

    /// Keeps places for the nodes that a configuration names, from now on.
    pub fn keep_places(&mut self, named: Arc<BTreeSet<Box<str>>>) {
        self.named = named;
    }

    /// Takes an announcement. `size` decides if both sizes of a gid would fit.
    pub fn announce(&mut self, writer: Guid, body: &[u8], endian: Endian, size: Option<GidSize>) {
        let held = |nodes: &Nodes| nodes.announced.values().map(|(_, said)| said.bytes).sum::<usize>();
        if self.announced.len() >= PARTICIPANTS_MAX || held(self) >= BYTES_MAX {
            self.announced.retain(|_, (writer, _)| self.present.contains(writer));
        }
        let participant = ids::prefix(&writer);
        let room = if held(self) < BYTES_MAX { Room::WHOLE } else { Room::SHARE };
        let Some(announcement) = announcement(body, endian, size, (&writer, room)) else { return };
        let is_rare = |name: &Arc<str>| {
            let same = self.announced.values().filter(|(_, said)| said.names.contains(name));
            self.named.contains(&**name) && same.take(SAME_NAME_MAX).count() < SAME_NAME_MAX
        };
        let count = self.announced.len();
        let has_place = count < PARTICIPANTS_MAX
            || self.announced.contains_key(&participant)
            || count < 2 * PARTICIPANTS_MAX && announcement.names.iter().any(is_rare);
        if has_place {
            self.announced.insert(participant, (writer, announcement));
            self.present.insert(writer);
        }
    }

    /// Whether the nodes of another participant would find no place.
    fn is_full(&self) -> bool {
        self.present().nth(PARTICIPANTS_MAX - 1).is_some()
    }

    /// The announcements that count.
    fn present(&self) -> impl Iterator<Item = &(Guid, Announcement)> {
        self.announced.values().filter(|(writer, _)| self.present.contains(writer))
    }

    /// Whether the participant of this endpoint announces nodes and its announcement is not known as a whole: it came too
    /// late, was lost, or found no room among those of others.
    pub fn is_unheard(&self, endpoint: &Guid) -> bool {
        let participant = ids::prefix(endpoint);
        let known = self.announced.get(&participant);
        if let Some((_, said)) = known.filter(|(writer, _)| self.present.contains(writer)) {
            return said.is_cut;
        }
        let mut first = [0; 16];
        first[..PREFIX].copy_from_slice(&participant);
        self.present.range(first..).next().is_some_and(|writer| writer.starts_with(&participant))
    }

    /// Takes the writers that discovery knows; announcements of other writers no longer count. Discovery
    /// does not know the writers of the participant that asks, which certainly exist.
    pub fn update(&mut self, own: &Guid, mut writers: BTreeSet<Guid>, services: BTreeSet<Box<str>>) {
        let announced = self.announced.get(&ids::prefix(own));
        writers.extend(announced.map(|(writer, _)| *writer));
        self.present = writers;
        self.services = services;
    }

    /// Some that live are not found yet: none is missing before they are.
    pub fn search_on(&mut self, now: Timestamp) {
        self.since = Some(now);
    }

    /// Full names of the existing nodes, in order.
    pub fn all(&self) -> Vec<String> {
        let names = self.present().flat_map(|(_, announcement)| &announcement.names).map(|name| &**name);
        let names: BTreeSet<&str> = names.collect();
        names.into_iter().map(str::to_owned).collect()
    }

    /// Full names of the services that a node serves, in order.
    pub fn services(&self) -> Vec<String> {
        self.services.iter().map(ToString::to_string).collect()
    }

    /// The node of a reader or writer, if it is announced.
    pub fn node_of(&self, endpoint: &Guid) -> Option<&str> {
        let (writer, said) = self.announced.get(&ids::prefix(endpoint))?;
        let name = said.endpoints.get(endpoint).filter(|_| self.present.contains(writer));
        name.map(|name| &**name)
    }

    /// Whether a reader or writer belongs to a node that the configuration names.
    pub fn is_of_named(&self, endpoint: &Guid) -> bool {
        self.node_of(endpoint).is_some_and(|name| self.named.contains(name))
    }

    /// The nodes whose name another one has too: by name, their participants' writers, each with a number.
    pub fn repeated(&self) -> BTreeSet<(&str, Guid, u8)> {
        let mut by_name: BTreeMap<&str, Vec<(Guid, u8)>> = BTreeMap::new();
        for (writer, said) in self.present() {
            for name in &said.names {
                by_name.entry(&**name).or_default().push((*writer, 0));
            }
            for name in &said.twice {
                by_name.entry(&**name).or_default().push((*writer, 1));
            }
        }
        let several = by_name.into_iter().filter(|(_, nodes)| nodes.len() > 1);
        several
            .flat_map(|(name, nodes)| nodes.into_iter().map(move |(writer, number)| (name, writer, number)))
            .collect()
    }

    /// Whether a node exists, by its name with namespace, `/ns/name`.
    pub fn ask(&self, name: &str, now: Timestamp) -> ProbeOutcome {
        let whole = format!("/{}", name.trim_start_matches('/'));
        let names = self.present().filter(|(_, said)| said.names.contains(&*whole));
        match names.count() {
            0 if self.is_full() => ProbeOutcome::Impossible(
                format!(
                    "{PARTICIPANTS_MAX} participants announce nodes, and those of further ones are not known"
                )
                .into(),
            ),
            0 => self.missing(now, || format!("no node {whole} is announced")),
            1 => ProbeOutcome::Announced,
            times => ProbeOutcome::Repeated { times: u32::try_from(times).unwrap_or(u32::MAX) },
        }
    }

    /// Whether a node serves a service, by its name with namespace, `/ns/name`.
    pub fn ask_service(&self, name: &str, now: Timestamp) -> ProbeOutcome {
        let whole = format!("/{}", name.trim_start_matches('/'));
        if self.services.contains(&*whole) {
            return ProbeOutcome::Announced;
        }
        self.missing(now, || format!("nobody serves {whole}"))
    }

    fn missing(&self, now: Timestamp, what: impl FnOnce() -> String) -> ProbeOutcome {
        match self.since {
            None => ProbeOutcome::Impossible("ROS 2 is not heard now".into()),
            Some(since) if now.since(since) < DISCOVERY => {
                ProbeOutcome::Impossible("the nodes are being discovered still".into())
            }
            Some(_) => ProbeOutcome::Missed(what().into()),
        }
    }
}

/// The services that a node serves, from the topics of the readers and writers that discovery knows. A client
/// has reader and writer the other way round; a reader without a writer, or the reverse, is no service. There are at
/// most as many as half of the endpoints that are followed.
pub fn services<'a>(
    readers: impl Iterator<Item = (&'a str, Guid)>,
    writers: impl Iterator<Item = (&'a str, Guid)>,
) -> BTreeSet<Box<str>> {
    let name = |topic: &'a str, before: &str, behind: &str| {
        topic.strip_prefix(before)?.strip_suffix(behind).filter(|name| name.len() < NAME_BYTES_MAX)
    };
    let participant = |guid: Guid| -> [u8; PREFIX] { std::array::from_fn(|index| guid[index]) };
    let replying: BTreeSet<_> =
        writers.filter_map(|(topic, guid)| Some((name(topic, "rr/", "Reply")?, participant(guid)))).collect();
    let asked = readers.filter_map(|(topic, guid)| Some((name(topic, "rq/", "Request")?, participant(guid))));
    let served = asked.filter(|service| replying.contains(service));
    served.map(|(name, _)| format!("/{name}").into()).collect()
}

/// The nodes in a `rmw_dds_common/ParticipantEntitiesInfo`.
fn announcement(
    body: &[u8],
    endian: Endian,
    size: Option<GidSize>,
    by: (&Guid, Room),
) -> Option<Announcement> {
    let read = |size: GidSize| {
        let mut reader = Reader::new(body, endian);
        let found = read_nodes(&mut reader, size.bytes(), by).ok()?;
        (reader.remaining() < 4).then_some(found)
    };
    match (read(GidSize::Bytes16), read(GidSize::Bytes24)) {
        (Some(found), None) | (None, Some(found)) => Some(found),
        (Some(_), Some(_)) => size.and_then(read),
        (None, None) => None,
    }
}

fn read_nodes(
    reader: &mut Reader<'_>,
    gid_bytes: usize,
    (by, whole): (&Guid, Room),
) -> Result<Announcement, Fault> {
    let (mut found, mut room) = (Announcement::default(), whole);
    reader.octets(gid_bytes)?;
    for _ in 0..reader.u32()? {
        let name = whole_name(reader.string()?, reader.string()?)
            .filter(|name| Room::take(&mut room.names, name.len() + NAME_BYTES));
        found.is_cut |= name.is_none();
        for _readers_then_writers in 0..2 {
            for _ in 0..reader.u32()? {
                let gid = reader.octets(gid_bytes)?;
                // A participant speaks only for itself.
                if let Some(name) = name.as_ref()
                    && gid.starts_with(&by[..PREFIX])
                    && let Some(guid) = gid.first_chunk::<16>()
                {
                    if Room::take(&mut room.endpoints, ENDPOINT_BYTES) {
                        found.endpoints.insert(*guid, name.clone());
                    } else {
                        found.is_cut = true;
                    }
                }
            }
        }
        if let Some(name) = name
            && !found.names.insert(name.clone())
        {
            found.twice.insert(name);
        }
    }
    found.bytes = whole.names - room.names + whole.endpoints - room.endpoints;
    Ok(found)
}

/// `/ns/name`, unless that is too long.
fn whole_name(namespace: &[u8], name: &[u8]) -> Option<Arc<str>> {
    if namespace.len() + name.len() >= NAME_BYTES_MAX {
        return None;
    }
    let (namespace, name) = (String::from_utf8_lossy(namespace), String::from_utf8_lossy(name));
    let namespace = namespace.trim_matches('/');
    Some(if namespace.is_empty() { format!("/{name}") } else { format!("/{namespace}/{name}") }.into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use telltale_msg::messages::{NodeEntities, encode_nodes};

    #[test]
    fn a_node_is_there_while_its_participant_is() {
        let at = Timestamp::from_millis;
        let mut nodes = Nodes::new(at(1000));
        assert!(matches!(nodes.ask("/camera", at(2000)), ProbeOutcome::Impossible(_)));
        assert!(matches!(nodes.ask("/camera", at(6000)), ProbeOutcome::Missed(_)));
        for (writer, size) in [([1; 16], GidSize::Bytes16), ([2; 16], GidSize::Bytes24)] {
            let name = if writer[0] == 1 { "camera" } else { "/lidar" };
            // The second gid belongs to another participant.
            let node = NodeEntities { name, readers: &[writer], writers: &[[3 + writer[0]; 16]] };
            let body = encode_nodes([9; 16], &[node], size);
            nodes.announce(writer, &body, Endian::Little, None);
        }
        let there = ProbeOutcome::Announced;
        assert_eq!([nodes.ask("/camera", at(1)), nodes.ask("lidar", at(1))], [there.clone(), there.clone()]);
        assert_eq!(nodes.all(), ["/camera", "/lidar"]);
        assert_eq!(
            [[1; 16], [2; 16], [4; 16]].map(|it| nodes.node_of(&it)),
            [Some("/camera"), Some("/lidar"), None]
        );
        // Started again after a crash.
        let again = NodeEntities { name: "camera", readers: &[], writers: &[] };
        nodes.announce([5; 16], &encode_nodes([9; 16], &[again], GidSize::Bytes16), Endian::Little, None);
        assert_eq!(nodes.ask("/camera", at(1)), ProbeOutcome::Repeated { times: 2 });
        nodes.update(&[9; 16], [[2; 16]].into(), BTreeSet::new());
        assert_eq!(nodes.all(), ["/lidar"]);
        assert!(matches!(nodes.ask("/camera", at(6000)), ProbeOutcome::Missed(_)));
        // A cut message, noise, wrong lengths: the earlier announcement stays.
        for body in [&[0xff; 64][..], &[], &[1; 20]] {
            nodes.announce([2; 16], body, Endian::Little, Some(GidSize::Bytes16));
        }
        assert_eq!(nodes.ask("/lidar", at(6000)), there);
        assert!(matches!(Nodes::default().ask("/lidar", at(6000)), ProbeOutcome::Impossible(_)));
    }

    #[test]
    fn one_participant_takes_one_place_and_who_found_none_is_unheard() {
        let mut nodes = Nodes::new(Timestamp::ZERO);
        let writer = |participant: usize, entity: usize| -> Guid {
            let mut guid = [0; 16];
            guid[..8].copy_from_slice(&(participant as u64).to_be_bytes());
            guid[12..].copy_from_slice(&(entity as u32).to_be_bytes());
            guid
        };
        let body = |name| {
            let node = NodeEntities { name, readers: &[], writers: &[] };
            encode_nodes([9; 16], &[node], GidSize::Bytes16)
        };
        let announce = |nodes: &mut Nodes, writer: Guid, name| {
            nodes.announce(writer, &body(name), Endian::Little, None);
        };
        for entity in 0..2 * PARTICIPANTS_MAX {
            announce(&mut nodes, writer(1, entity), "stranger");
        }
        announce(&mut nodes, writer(2, 0), "lidar_driver");
        assert_eq!(nodes.all(), ["/lidar_driver", "/stranger"]);
        assert!(!nodes.is_unheard(&writer(2, 7)));

        // So many participants that there is no place for another.
        let late = writer(PARTICIPANTS_MAX + 9, 0);
        let many: BTreeSet<Guid> = (1..=PARTICIPANTS_MAX).map(|it| writer(it, 0)).chain([late]).collect();
        for writer in &many {
            announce(&mut nodes, *writer, "x");
        }
        nodes.update(&[9; 16], many, BTreeSet::new());
        let of_late = writer(PARTICIPANTS_MAX + 9, 7);
        assert!(nodes.is_unheard(&of_late), "it announces its nodes, and nobody has them");
        assert!(!nodes.is_unheard(&writer(3, 7)), "it has said what it has");
        assert!(!nodes.is_unheard(&writer(PARTICIPANTS_MAX + 8, 7)), "it announces nothing");
        let much_later = Timestamp::from_millis(60_000);
        assert!(matches!(nodes.ask("/late", much_later), ProbeOutcome::Impossible(_)), "it may be there");
        // Its announcement does not come again when there is a place.
        nodes.update(&[9; 16], [late].into(), BTreeSet::new());
        assert!(nodes.is_unheard(&of_late));
        assert!(matches!(nodes.ask("/late", much_later), ProbeOutcome::Missed(_)));
        announce(&mut nodes, late, "late");
        assert!(!nodes.is_unheard(&of_late));
    }

    #[test]
    fn a_node_that_the_configuration_names_has_a_place_however_many_announce_others() {
        let mut nodes = Nodes::new(Timestamp::ZERO);
        nodes.keep_places(Arc::new(["/camera".into(), "/lidar".into()].into()));
        let strangers = 2 * PARTICIPANTS_MAX as u64;
        for participant in 0..=2 * strangers {
            let name = match participant {
                it if it < strangers => "x",
                it if it < 2 * strangers => "camera",
                _ => "lidar",
            };
            let node = NodeEntities { name, readers: &[], writers: &[] };
            let mut writer = [0; 16];
            writer[..8].copy_from_slice(&participant.to_be_bytes());
            nodes.announce(writer, &encode_nodes([9; 16], &[node], GidSize::Bytes16), Endian::Little, None);
        }
        assert_eq!(nodes.all(), ["/camera", "/lidar", "/x"]);
        assert!(!nodes.is_of_named(&[9; 16]));
        assert_eq!(nodes.announced.len(), PARTICIPANTS_MAX + SAME_NAME_MAX + 1, "these have an end, too");
    }

    #[test]
    fn announcements_take_no_more_than_their_memory_and_a_cut_one_is_known_as_such() {
        let mut nodes = Nodes::new(Timestamp::ZERO);
        let guid = |participant: u16, entity: u16| -> Guid {
            let mut guid = [0; 16];
            guid[..2].copy_from_slice(&participant.to_be_bytes());
            guid[14..].copy_from_slice(&entity.to_be_bytes());
            guid
        };
        let long = "x".repeat(1000);
        for participant in 0..500 {
            let readers: Vec<Guid> = (0..5000).map(|entity| guid(participant, entity)).collect();
            let node = NodeEntities { name: &long, readers: &readers, writers: &[] };
            let body = encode_nodes([9; 16], &[node], GidSize::Bytes16);
            nodes.announce(guid(participant, 0), &body, Endian::Little, None);
        }
        let held: usize = nodes.announced.values().map(|(_, said)| said.bytes).sum();
        assert!(held < 2 * BYTES_MAX, "{held}");
        assert_eq!(nodes.node_of(&guid(0, 4000)), Some(&*format!("/{long}")));
        assert!(nodes.is_unheard(&guid(0, 4999)), "it may be a writer of any node");
        // Others have their room still.
        let node = NodeEntities { name: "camera", readers: &[], writers: &[guid(600, 1)] };
        let body = encode_nodes([9; 16], &[node], GidSize::Bytes16);
        nodes.announce(guid(600, 0), &body, Endian::Little, None);
        assert_eq!(nodes.node_of(&guid(600, 1)), Some("/camera"));
        assert!(!nodes.is_unheard(&guid(600, 1)));
    }

    #[test]
    fn a_service_is_there_where_one_participant_reads_requests_and_writes_replies() {
        let guid = |participant: u8, entity: u8| -> Guid {
            std::array::from_fn(|index| if index < PREFIX { participant } else { entity })
        };
        let (server, client, half) = (1, 2, 3);
        let readers = [
            ("rq/planning/planRequest", guid(server, 1)),
            ("rr/planning/planReply", guid(client, 2)),
            ("rq/mapRequest", guid(half, 3)),
            ("rt/planRequest", guid(server, 4)),
        ];
        let writers = [
            ("rr/planning/planReply", guid(server, 5)),
            ("rq/planning/planRequest", guid(client, 6)),
            ("rr/mapReply", guid(client, 7)),
        ];
        let found = services(readers.into_iter(), writers.into_iter());
        assert_eq!(found, BTreeSet::from(["/planning/plan".into()]));
        let at = Timestamp::from_millis;
        let mut nodes = Nodes::new(at(0));
        assert!(matches!(nodes.ask_service("/planning/plan", at(4000)), ProbeOutcome::Impossible(_)));
        nodes.update(&[9; 16], BTreeSet::new(), found);
        assert_eq!(nodes.ask_service("/planning/plan", at(4000)), ProbeOutcome::Announced);
        assert_eq!(nodes.services(), ["/planning/plan"]);
        let missed = ProbeOutcome::Missed("nobody serves /map".into());
        assert_eq!(nodes.ask_service("map", at(6000)), missed);
    }
}
