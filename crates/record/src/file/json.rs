//! JSON in a recording: each document is the text of a `std_msgs/msg/String`. With the message encoding
//! `json`, `ros2 bag` refuses the whole file because its topics have different encodings, `rosbags` fails
//! at the schema, and `mcap-ros2-support` at the first such message.

use std::collections::BTreeMap;
use std::io;

use serde::Serialize;

/// A channel of JSON documents.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct JsonChannel {
    pub topic: &'static str,
    /// The JSON Schema of its documents, of draft 7, which most programs know.
    pub schema: &'static str,
    /// A larger document is neither written nor read.
    pub bytes_max: usize,
}

/// The largest line, and the largest document of a channel that is not ours. The text of a whole configuration
/// fits into a line.
const LINE_BYTES_MAX: usize = 16 << 20;

/// Everything that the engine took, in its order.
pub const JOURNAL: JsonChannel = JsonChannel {
    topic: "/telltale/journal",
    schema: include_str!("schemas/journal.json"),
    bytes_max: LINE_BYTES_MAX,
};

/// The engine's whole state at one instant.
pub const KEYFRAMES: JsonChannel = JsonChannel {
    topic: "/telltale/keyframe",
    schema: include_str!("schemas/keyframe.json"),
    // With what stands before it in its chunk, it stays below the largest chunk. 100,000 modules with four values
    // each take 109 MB.
    bytes_max: 120 << 20,
};

/// Changes of what is shown.
pub const TRANSITIONS: JsonChannel = JsonChannel {
    topic: "/telltale/transitions",
    schema: include_str!("schemas/transitions.json"),
    bytes_max: LINE_BYTES_MAX,
};

/// The bytes of the largest document of a channel.
pub(super) fn bytes_max(topic: &str) -> usize {
    let ours = [JOURNAL, KEYFRAMES, TRANSITIONS].into_iter().find(|channel| channel.topic == topic);
    ours.map_or(LINE_BYTES_MAX, |channel| channel.bytes_max)
}

pub(super) const TYPE: &str = "std_msgs/msg/String";
pub(super) const DEFINITION: &str = "string data\n";

const FORMAT_KEY: &str = "message_format";
const FORMAT: &str = "json";
const SCHEMA_KEY: &str = "json_schema";

impl JsonChannel {
    /// The channel's metadata in the file.
    pub(super) fn metadata(&self) -> BTreeMap<String, String> {
        let entries = [(FORMAT_KEY, FORMAT), (SCHEMA_KEY, self.schema)];
        entries.map(|(key, value)| (key.to_owned(), value.to_owned())).into()
    }
}

/// Appends a document as the CDR of a `std_msgs/msg/String` with its encapsulation. Returns the bytes of its text.
pub(super) fn encode(document: &impl Serialize, into: &mut Vec<u8>) -> io::Result<usize> {
    let start = into.len();
    into.extend([0, 1, 0, 0, 0, 0, 0, 0]);
    let text = into.len();
    serde_json::to_writer(&mut *into, document)?;
    into.push(0);
    let length = u32::try_from(into.len() - text)
        .map_err(|_| io::Error::other("the document is longer than 4 GiB"))?;
    into[start + 4..text].copy_from_slice(&length.to_le_bytes());
    Ok(into.len() - text - 1)
}

/// Whether a channel of this type and metadata has JSON documents.
pub(super) fn is_json(type_name: &str, metadata: &BTreeMap<String, String>) -> bool {
    type_name == TYPE && metadata.get(FORMAT_KEY).is_some_and(|format| format == FORMAT)
}

/// The text of a document that `encode` wrote.
pub(super) fn text(message: &[u8]) -> Option<&[u8]> {
    let (head, text) = message.split_first_chunk::<8>()?;
    let [_, order, _, _, length @ ..] = *head;
    let length = if order == 0 { u32::from_be_bytes(length) } else { u32::from_le_bytes(length) };
    let text = text.get(..usize::try_from(length).ok()?)?.strip_suffix(&[0])?;
    std::str::from_utf8(text).is_ok().then_some(text)
}
