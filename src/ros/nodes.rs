//! Which nodes there are: what each participant announces on `ros_discovery_info`, as long as
//! discovery knows the participant.

use std::collections::{BTreeMap, BTreeSet};

use super::cdr::{Endian, Fault, Reader};
use super::messages::GidSize;
use super::writers::Guid;
use crate::engine::sample::ProbeOutcome;
use crate::engine::time::{Span, Timestamp};

/// Participants that are remembered; more of them are no vehicle.
const PARTICIPANTS_MAX: usize = 1024;
/// Nodes of one participant.
const NODES_MAX: usize = 1024;
const NAME_BYTES_MAX: usize = 1024;

/// That a node is not there is said only when discovery had this time to find it.
const DISCOVERY: Span = Span::from_secs(5);

#[derive(Debug, Clone, Default)]
pub struct Nodes {
    /// Since when they are looked for; `None` while there is no participant.
    since: Option<Timestamp>,
    /// Whole names, by the writer that announced them.
    announced: BTreeMap<Guid, BTreeSet<Box<str>>>,
    /// The writers that are there. One that comes back may not announce again.
    present: BTreeSet<Guid>,
}

impl Nodes {
    pub fn new(since: Timestamp) -> Nodes {
        Nodes { since: Some(since), ..Nodes::default() }
    }

    /// Takes an announcement. `size` decides where both sizes of a gid would fit.
    pub fn announce(&mut self, writer: Guid, body: &[u8], endian: Endian, size: Option<GidSize>) {
        let Some(names) = names(body, endian, size) else { return };
        if self.announced.len() >= PARTICIPANTS_MAX {
            self.announced.retain(|writer, _| self.present.contains(writer));
        }
        if self.announced.contains_key(&writer) || self.announced.len() < PARTICIPANTS_MAX {
            self.announced.insert(writer, names);
            self.present.insert(writer);
        }
    }

    /// Takes which writers discovery knows: what others announced counts no longer.
    pub fn update(&mut self, writers: BTreeSet<Guid>) {
        self.present = writers;
    }

    /// Whole names of the nodes that are there, in order.
    pub fn all(&self) -> Vec<String> {
        let present = self.announced.iter().filter(|(writer, _)| self.present.contains(*writer));
        let names: BTreeSet<&str> = present.flat_map(|(_, names)| names).map(|name| &**name).collect();
        names.into_iter().map(str::to_owned).collect()
    }

    /// Whether a node is there. Its name has its namespace, `/ns/name`.
    pub fn ask(&self, name: &str, now: Timestamp) -> ProbeOutcome {
        let whole = format!("/{}", name.trim_start_matches('/'));
        let present = |writer: &Guid| self.present.contains(writer);
        if self.announced.iter().any(|(writer, names)| present(writer) && names.contains(&*whole)) {
            return ProbeOutcome::Answered { after: Span::ZERO };
        }
        match self.since {
            None => ProbeOutcome::Impossible("there is no DDS now".into()),
            Some(since) if now.since(since) < DISCOVERY => {
                ProbeOutcome::Impossible("the nodes are being discovered still".into())
            }
            Some(_) => ProbeOutcome::Missed(format!("no node {whole} is announced").into()),
        }
    }
}

/// The nodes in a `rmw_dds_common/ParticipantEntitiesInfo`.
fn names(body: &[u8], endian: Endian, size: Option<GidSize>) -> Option<BTreeSet<Box<str>>> {
    let read = |size: GidSize| {
        let mut reader = Reader::new(body, endian);
        let names = read_names(&mut reader, size.bytes()).ok()?;
        (reader.remaining() < 4).then_some(names)
    };
    match (read(GidSize::Bytes16), read(GidSize::Bytes24)) {
        (Some(names), None) | (None, Some(names)) => Some(names),
        (Some(_), Some(_)) => size.and_then(read),
        (None, None) => None,
    }
}

fn read_names(reader: &mut Reader<'_>, gid_bytes: usize) -> Result<BTreeSet<Box<str>>, Fault> {
    let mut names = BTreeSet::new();
    reader.octets(gid_bytes)?;
    for _ in 0..reader.u32()? {
        let (namespace, name) = (reader.string()?, reader.string()?);
        for _readers_then_writers in 0..2 {
            let gids = u64::from(reader.u32()?);
            reader.skip(gids * gid_bytes as u64)?;
        }
        if names.len() < NODES_MAX && namespace.len() + name.len() < NAME_BYTES_MAX {
            let (namespace, name) = (String::from_utf8_lossy(namespace), String::from_utf8_lossy(name));
            let namespace = namespace.trim_matches('/');
            let whole =
                if namespace.is_empty() { format!("/{name}") } else { format!("/{namespace}/{name}") };
            names.insert(whole.into());
        }
    }
    Ok(names)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros::messages::encode_node;

    #[test]
    fn a_node_is_there_while_its_participant_is() {
        let at = Timestamp::from_millis;
        let mut nodes = Nodes::new(at(1000));
        assert!(matches!(nodes.ask("/camera", at(2000)), ProbeOutcome::Impossible(_)));
        assert!(matches!(nodes.ask("/camera", at(6000)), ProbeOutcome::Missed(_)));
        for (writer, size) in [([1; 16], GidSize::Bytes16), ([2; 16], GidSize::Bytes24)] {
            let body =
                encode_node([9; 16], if writer[0] == 1 { "camera" } else { "lidar" }, &[[7; 16]], size);
            nodes.announce(writer, &body, Endian::Little, None);
        }
        let there = ProbeOutcome::Answered { after: Span::ZERO };
        assert_eq!([nodes.ask("/camera", at(1)), nodes.ask("lidar", at(1))], [there.clone(), there.clone()]);
        assert_eq!(nodes.all(), ["/camera", "/lidar"]);
        nodes.update([[2; 16]].into());
        assert_eq!(nodes.all(), ["/lidar"]);
        assert!(matches!(nodes.ask("/camera", at(6000)), ProbeOutcome::Missed(_)));
        // Cut, noise, lengths that lie: what was announced before stays.
        for body in [&[0xff; 64][..], &[], &[1; 20]] {
            nodes.announce([2; 16], body, Endian::Little, Some(GidSize::Bytes16));
        }
        assert_eq!(nodes.ask("/lidar", at(6000)), there);
        assert!(matches!(Nodes::default().ask("/lidar", at(6000)), ProbeOutcome::Impossible(_)));
    }
}
