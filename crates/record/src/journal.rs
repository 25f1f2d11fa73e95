//! The lines of a recording's journal: what the engine took, in its order, messages by reference.

use std::borrow::Cow;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::ring::{ConfigurationText, Entry, Taken};
use telltale_clock::unix_ns;
use telltale_engine::input::Input;
use telltale_engine::text::hex;
use telltale_engine::time::Timestamp;
use telltale_msg::received::Message;
use telltale_msg::sample_bytes::Guid;

/// One line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Line<'a> {
    /// The time with which the engine took it, in nanoseconds since the start of the program.
    pub at_ns: Timestamp,
    pub took: Took<'a>,
    /// The message behind it, if there was one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub message: Option<MessageRef<'a>>,
    /// The message behind it, if it is not in the file.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub left_out: Option<LeftOut<'a>>,
}

/// The stamps and the size of a message that is not in the file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LeftOut<'a> {
    pub topic: Cow<'a, str>,
    pub writer: String,
    pub sequence: i64,
    pub received_ns: u64,
    /// When it was published, by the publisher's clock, in nanoseconds since 1970.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub published_ns: Option<u64>,
    pub bytes: u64,
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
        Some(Line {
            at_ns: entry.at,
            took,
            message: entry.message.as_ref().map(MessageRef::of),
            left_out: None,
        })
    }

    /// The same of an entry whose message is not in the file.
    pub fn without_message(entry: &'a Entry) -> Option<Line<'a>> {
        let left_out = entry.message.as_ref().map(LeftOut::of);
        Line::of(entry).map(|line| Line { message: None, left_out, ..line })
    }
}

impl<'a> LeftOut<'a> {
    fn of(message: &'a Arc<Message>) -> LeftOut<'a> {
        let MessageRef { topic, writer, sequence, received_ns } = MessageRef::of(message);
        let published_ns = message.source.map(unix_ns);
        let bytes = (message.len() + message.left_out) as u64;
        LeftOut { topic, writer, sequence, received_ns, published_ns, bytes }
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
        MessageRef {
            topic: Cow::Borrowed(&*message.topic),
            writer: hex(&message.writer),
            sequence: message.sequence,
            received_ns: unix_ns(message.received),
        }
    }
}
