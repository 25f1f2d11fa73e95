//! The lines of a recording's journal: what the engine took, in its order, messages by reference.

use std::borrow::Cow;
use std::sync::Arc;
use std::time::UNIX_EPOCH;

use serde::{Deserialize, Serialize};

use super::ring::{ConfigurationText, Entry, Taken};
use crate::engine::input::Input;
use crate::engine::time::Timestamp;
use crate::msg::received::Message;
use crate::msg::sample_bytes::Guid;

/// One line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Line<'a> {
    /// The time with which the engine took it, in nanoseconds since the start of the program.
    pub at_ns: Timestamp,
    pub took: Took<'a>,
    /// The message behind it, if there was one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub message: Option<MessageRef<'a>>,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Took<'a> {
    Input(Cow<'a, Input>),
    /// The statuses of the message.
    Statuses,
    /// From here on the configuration of these files counts.
    Reload(Vec<ConfigurationText>),
    /// This number of entries is missing before this one.
    Lost(u64),
}

/// A message of the same file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct MessageRef<'a> {
    pub topic: Cow<'a, str>,
    /// The GUID of its writer, in hexadecimal digits.
    pub writer: String,
    /// The sequence number that the writer gave it.
    pub sequence: i64,
    /// When it was received, by the wall clock, in nanoseconds since 1970.
    pub received_ns: u64,
}

impl<'a> Line<'a> {
    /// The line of an entry; `None` for entries with channels of their own.
    pub fn of(entry: &'a Entry) -> Option<Line<'a>> {
        let took = match &entry.taken {
            Taken::Input(input) => Took::Input(Cow::Borrowed(input)),
            Taken::Statuses => Took::Statuses,
            Taken::Reload(texts) => Took::Reload(texts.to_vec()),
            Taken::Lost(count) => Took::Lost(*count),
            Taken::Transition(_) | Taken::Told(_) | Taken::Keyframe(_) => return None,
        };
        Some(Line { at_ns: entry.at, took, message: entry.message.as_ref().map(MessageRef::of) })
    }
}

impl MessageRef<'_> {
    /// The GUID of its writer; `None` if it is none.
    pub fn writer(&self) -> Option<Guid> {
        let pairs = self.writer.as_bytes().chunks(2).map(|pair| std::str::from_utf8(pair).ok());
        let bytes = pairs.map(|pair| pair.and_then(|pair| u8::from_str_radix(pair, 16).ok()));
        let bytes = bytes.collect::<Option<Vec<u8>>>()?;
        bytes.try_into().ok()
    }
}

impl<'a> MessageRef<'a> {
    fn of(message: &'a Arc<Message>) -> MessageRef<'a> {
        let since_epoch = message.received.duration_since(UNIX_EPOCH).unwrap_or_default();
        MessageRef {
            topic: Cow::Borrowed(&*message.topic),
            writer: message.writer.iter().map(|byte| format!("{byte:02x}")).collect(),
            sequence: message.sequence,
            received_ns: u64::try_from(since_epoch.as_nanos()).unwrap_or(u64::MAX),
        }
    }
}
