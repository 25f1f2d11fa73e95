//! The schemas and channels of an MCAP file.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use mcap::records::op;

use super::omission::Omissions;
use super::{UNDEFINED, json, records};

/// All schemas and channels of a file together.
const BYTES_MAX: usize = 64 << 20;
/// What an entry of a channel's metadata takes in memory beside its text.
const ENTRY_BYTES: usize = 128;
/// A channel with more metadata is left out.
const CHANNEL_BYTES_MAX: usize = 1 << 20;

/// A topic of the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Channel {
    pub topic: Arc<str>,
    /// `package/msg/Name`, or the name of another schema; empty if it has none.
    pub type_name: Arc<str>,
    /// The whole definition of the type, if the file has it as a `ros2msg` schema.
    pub definition: Option<Arc<str>>,
    pub(super) format: Format,
}

impl Channel {
    /// A topic of messages in CDR.
    pub fn cdr(topic: &str, type_name: &str, definition: Option<&str>) -> Channel {
        Channel {
            topic: topic.into(),
            type_name: type_name.into(),
            definition: definition.map(Arc::from),
            format: Format::Cdr,
        }
    }
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Format {
    Cdr,
    /// JSON as the text of a `std_msgs/msg/String`.
    JsonText,
    Json,
    Other(Box<str>),
}

/// As it stands in the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Schema {
    pub name: Arc<str>,
    pub encoding: Box<str>,
    pub data: Arc<[u8]>,
}

/// As it stands in the file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct RawChannel {
    pub schema_id: u16,
    pub topic: Arc<str>,
    pub encoding: Box<str>,
    pub metadata: BTreeMap<String, String>,
}

#[derive(Debug, Default)]
pub(super) struct Definitions {
    pub schemas: HashMap<u16, Schema>,
    pub raw: HashMap<u16, RawChannel>,
    channels: HashMap<u16, Arc<Channel>>,
    bytes: usize,
}

impl Definitions {
    /// Takes a record of a schema or a channel. The first of an id counts.
    pub fn take(&mut self, op: u8, record: &[u8], at: u64, omissions: &mut Omissions) {
        if self.bytes + record.len() > BYTES_MAX {
            omissions.add(at, 0, "the file has too many definitions");
            return;
        }
        if op != op::SCHEMA && record.len() > CHANNEL_BYTES_MAX {
            omissions.add(at, 0, "the definition of a channel is too large");
            return;
        }
        let contradicts = match op {
            op::SCHEMA => self.schema(record),
            _ => self.channel(record),
        };
        match contradicts {
            None => omissions.add(at, 0, "the definition of a schema or channel cannot be read"),
            Some(true) => omissions.add(at, 0, "a schema or channel is defined twice, the second counts not"),
            Some(false) => {}
        }
    }

    fn schema(&mut self, record: &[u8]) -> Option<bool> {
        let schema = records::schema(record)?;
        if let Some(known) = self.schemas.get(&schema.id) {
            return Some(*known.data != *schema.data || *known.name != *schema.name);
        }
        self.bytes += record.len();
        let entry =
            Schema { name: schema.name.into(), encoding: schema.encoding.into(), data: schema.data.into() };
        self.schemas.insert(schema.id, entry);
        Some(false)
    }

    fn channel(&mut self, record: &[u8]) -> Option<bool> {
        let channel = records::channel(record)?;
        let raw = RawChannel {
            schema_id: channel.schema_id,
            topic: channel.topic.into(),
            encoding: channel.encoding.into(),
            metadata: channel.metadata,
        };
        if let Some(known) = self.raw.get(&channel.id) {
            return Some(*known != raw);
        }
        self.bytes += record.len() + ENTRY_BYTES * raw.metadata.len();
        self.raw.insert(channel.id, raw);
        Some(false)
    }

    /// All channels that are known, by their numbers.
    pub fn all(&mut self) -> Vec<Arc<Channel>> {
        let mut ids: Vec<u16> = self.raw.keys().copied().collect();
        ids.sort_unstable();
        ids.into_iter().filter_map(|id| self.known(id)).collect()
    }

    /// A channel, once its schema is known too.
    pub fn known(&mut self, id: u16) -> Option<Arc<Channel>> {
        if let Some(known) = self.channels.get(&id) {
            return Some(known.clone());
        }
        let raw = self.raw.get(&id)?;
        let schema = self.schemas.get(&raw.schema_id);
        if schema.is_none() && raw.schema_id != 0 {
            return None;
        }
        let definition =
            schema.filter(|schema| &*schema.encoding == "ros2msg" && *schema.data != *UNDEFINED.as_bytes());
        let type_name = schema.map_or_else(|| "".into(), |schema| schema.name.clone());
        let format = match &*raw.encoding {
            "cdr" if json::is_json(&type_name, &raw.metadata) => Format::JsonText,
            "cdr" => Format::Cdr,
            "json" => Format::Json,
            other => Format::Other(other.into()),
        };
        let channel = Arc::new(Channel {
            topic: raw.topic.clone(),
            type_name,
            definition: definition.and_then(|schema| std::str::from_utf8(&schema.data).ok()).map(Arc::from),
            format,
        });
        self.channels.insert(id, channel.clone());
        Some(channel)
    }
}
