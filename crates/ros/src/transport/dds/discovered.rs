//! The endpoints of other participants that the DDS library has discovered.

use std::collections::BTreeMap;

use rustdds::DomainParticipant;
use rustdds::policy::{self, Deadline, Durability, Reliability};

use super::qos;
use crate::transport::ids::participant_name;
use crate::transport::wire::NAME_BYTES_MAX;
use crate::transport::{Found, Quality};
use telltale_engine::discovery::{Liveliness, LivelinessKind};
use telltale_msg::sample_bytes::Guid;

/// The kind of an entity in the last byte of its GUID, and a reader with a key (RTPS 2.5, 9.3.1.2).
const ENTITY_KIND: u8 = 0x0f;
const READER_WITH_KEY: u8 = 0x07;

/// The prefix of the topics on which participants hear themselves; no ROS topic begins so.
const ECHO_TOPIC_PREFIX: &str = "telltale_alive/";

/// The topic on which one participant hears itself.
pub fn echo_topic(guid: &Guid) -> String {
    format!("{ECHO_TOPIC_PREFIX}{}", participant_name(guid))
}

/// All endpoints that can belong to ROS.
pub fn all(participant: &DomainParticipant) -> BTreeMap<Guid, Found> {
    let writers = participant.discovered_writers().into_iter().map(|found| {
        let data = found.publication_topic_data;
        Found {
            guid: data.key.to_bytes(),
            writes: true,
            // A writer without these settings is reliable and volatile (DDS 1.4, 2.2.3).
            reliable: data.reliability != Some(Reliability::BestEffort),
            transient_local: keeps(data.durability),
            deadline_ns: deadline(data.deadline),
            liveliness: liveliness(data.liveliness),
            takes: 0,
            topic: data.topic_name,
            type_name: data.type_name,
        }
    });
    let readers = participant.discovered_readers().into_iter().map(|found| {
        let data = found.subscription_topic_data;
        let qos = data.qos();
        // A reader of a type with a key is none of our types.
        let is_keyed = data.key().to_bytes()[15] & ENTITY_KIND == READER_WITH_KEY;
        let fits = |quality| !is_keyed && qos::offered(quality).compliance_failure_wrt(&qos).is_none();
        let takes = Quality::ALL.map(fits);
        Found {
            guid: data.key().to_bytes(),
            writes: false,
            // A reader without these settings accepts everything.
            reliable: matches!(qos.reliability(), Some(Reliability::Reliable { .. })),
            transient_local: keeps(qos.durability()),
            deadline_ns: deadline(qos.deadline()),
            liveliness: liveliness(qos.liveliness()),
            takes: takes.iter().rev().fold(0, |bits, takes| bits << 1 | u8::from(*takes)),
            topic: data.topic_name().clone(),
            type_name: data.type_name().clone(),
        }
    });
    let is_ours_to_tell = |found: &Found| {
        let fits = |name: &str| name.len() <= NAME_BYTES_MAX;
        fits(&found.topic) && fits(&found.type_name) && !found.topic.starts_with(ECHO_TOPIC_PREFIX)
    };
    writers.chain(readers).filter(is_ours_to_tell).map(|found| (found.guid, found)).collect()
}

fn keeps(durability: Option<Durability>) -> bool {
    durability.is_some_and(|kind| kind >= Durability::TransientLocal)
}

fn deadline(deadline: Option<Deadline>) -> Option<u64> {
    deadline.and_then(|Deadline(period)| nanos(period))
}

/// Without this setting the library asserts liveliness, with an infinite lease (DDS 1.4, 2.2.3.11).
fn liveliness(said: Option<policy::Liveliness>) -> Liveliness {
    use policy::Liveliness::{Automatic, ManualByParticipant, ManualByTopic};
    let (kind, lease) = match said {
        None => return Liveliness::default(),
        Some(Automatic { lease_duration }) => (LivelinessKind::Automatic, lease_duration),
        Some(ManualByParticipant { lease_duration }) => (LivelinessKind::ManualByParticipant, lease_duration),
        Some(ManualByTopic { lease_duration }) => (LivelinessKind::ManualByTopic, lease_duration),
    };
    Liveliness { kind, lease_ns: nanos(lease) }
}

/// `None` is infinite.
fn nanos(duration: rustdds::Duration) -> Option<u64> {
    (duration != rustdds::Duration::INFINITE).then(|| u64::try_from(duration.to_nanoseconds()).unwrap_or(0))
}
