//! The entries of a recording, for a reader.

use std::collections::BTreeMap;
use std::sync::Arc;

use bytes::Bytes;

use super::definitions::Channel;
use super::omission::Missing;
use super::records::AttachmentHead;
use super::writer::MessageStamps;
use telltale_msg::sample_bytes::RawBody;

/// An entry of a recording.
#[derive(Debug, Clone, PartialEq)]
pub enum Entry {
    Message {
        channel: Arc<Channel>,
        stamps: MessageStamps,
        body: RawBody,
    },
    /// A document of a channel of JSON, as text.
    Json {
        channel: Arc<Channel>,
        stamps: MessageStamps,
        text: Bytes,
    },
    Missing(Missing),
}

impl Entry {
    /// `None` where entries are missing.
    pub fn stamps(&self) -> Option<MessageStamps> {
        match self {
            Entry::Message { stamps, .. } | Entry::Json { stamps, .. } => Some(*stamps),
            Entry::Missing(_) => None,
        }
    }
}

/// A message as it stands in the file.
pub(super) struct Raw {
    pub at: u64,
    pub channel: u16,
    pub stamps: MessageStamps,
    pub data: Bytes,
}

/// The next entry of the file.
pub(super) enum Item {
    Message(Raw),
    Missing(Missing),
    EndOfPart,
    Attachment { data_at: u64, head: AttachmentHead },
    Metadata { name: String, metadata: BTreeMap<String, String> },
}
