//! Writes the file of one incident.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::fs;
use std::path::Path;

use mcap::Attachment;
use mcap::records::{MessageHeader, Metadata};
use serde::Serialize;

use super::FileError;
use super::json::{self, JsonChannel};
use super::output::Output;
use super::{ABOUT, UNDEFINED};
use telltale_msg::cdr::Endian;

/// A chunk ends when it holds so many bytes before compression. With the largest message, this bounds the
/// memory of a writer.
pub const CHUNK_BYTES: usize = 4 << 20;

/// The space of a message or a document in the file apart from its bytes, with its entry in the index.
const RECORD_BYTES: usize = 64;

/// An entry of the index of chunks, and what each topic adds to it.
const CHUNK_INDEX_BYTES: u64 = 128;
const TOPIC_INDEX_BYTES: u64 = 24;

/// One MCAP file with the profile `ros2`. Everything up to the last ended chunk can be read at any time,
/// also if the process or the computer ends.
pub struct IncidentFile {
    output: Output,
    /// By topic, then by type.
    topics: HashMap<Box<str>, Vec<(Box<str>, Topic)>>,
    /// By topic, with the next sequence number.
    json: BTreeMap<&'static str, (Topic, u32)>,
    /// Of the open chunk.
    bytes: usize,
    messages: u64,
    scratch: Vec<u8>,
    /// No message makes it longer than this.
    most: u64,
    /// Of the schemas and channels, which stand at the end once more.
    defined: u64,
    chunks: u64,
}

/// A topic with one type in one file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Topic(u16);

/// Times in nanoseconds since 1970.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MessageStamps {
    /// When it was received.
    pub log_time_ns: u64,
    /// When it was published, by the publisher's clock.
    pub publish_time_ns: u64,
    pub sequence: u32,
}

/// A complete file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Written {
    pub bytes: u64,
    pub messages: u64,
}

impl IncidentFile {
    /// Creates the file with its header and a description of what it is.
    ///
    /// # Errors
    /// It exists, or the disk refuses it: then none is left.
    pub fn create(path: &Path, about: BTreeMap<String, String>) -> Result<IncidentFile, FileError> {
        let output = Output::create(path, "ros2", concat!("telltale ", env!("TELLTALE_VERSION")))?;
        let mut file = IncidentFile {
            output,
            topics: HashMap::new(),
            json: BTreeMap::new(),
            bytes: 0,
            messages: 0,
            scratch: Vec::new(),
            most: u64::MAX,
            defined: 0,
            chunks: 0,
        };
        match file.metadata(ABOUT, about) {
            Ok(()) => Ok(file),
            Err(error) => {
                file.remove();
                Err(error)
            }
        }
    }

    /// Gives the file up, and removes it. If the disk refuses that too, the next start removes an empty one.
    pub fn remove(self) {
        let _ = fs::remove_file(self.path());
    }

    pub fn path(&self) -> &Path {
        self.output.path()
    }

    /// The length up to which the file can be read now.
    pub fn len(&self) -> u64 {
        self.output.whole()
    }

    /// From now on it grows no further than to this length.
    pub fn grow_to(&mut self, most: u64) {
        self.most = most;
    }

    /// The length to which it may grow.
    pub fn most(&self) -> u64 {
        self.most
    }

    /// Bytes that still have a place, so that the file can be completed. What waits to be compressed counts whole.
    pub fn left(&self) -> u64 {
        let topics = (self.topics.len() + self.json.len()) as u64;
        let index = (self.chunks + 1) * (CHUNK_INDEX_BYTES + topics * TOPIC_INDEX_BYTES);
        let end = index + self.defined + topics * CHUNK_INDEX_BYTES;
        self.most.saturating_sub(self.len() + self.bytes as u64 + end)
    }

    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// A topic. `define` gives the whole definition of the type (`Definitions::text`) and is called once.
    /// Without a definition, the schema only says so, and every reader gets an empty message: other
    /// encodings of a schema, or none, make readers fail for the whole file.
    ///
    /// # Errors
    /// The file has no room for more topics, or was given up.
    pub fn topic(
        &mut self,
        topic: &str,
        type_name: &str,
        define: impl FnOnce() -> Option<String>,
    ) -> Result<Topic, FileError> {
        let known = self.topics.get(topic).and_then(|types| types.iter().find(|it| *it.0 == *type_name));
        if let Some((_, known)) = known {
            return Ok(*known);
        }
        let definition = define().map_or(Cow::Borrowed(UNDEFINED), Cow::Owned);
        let added = self.add(topic, type_name, &definition, &BTreeMap::new())?;
        self.topics.entry(topic.into()).or_default().push((type_name.into(), added));
        Ok(added)
    }

    fn add(
        &mut self,
        topic: &str,
        type_name: &str,
        definition: &str,
        metadata: &BTreeMap<String, String>,
    ) -> Result<Topic, FileError> {
        let facts: usize = metadata.iter().map(|(key, value)| key.len() + value.len()).sum();
        let bytes = definition.len() + type_name.len() + topic.len() + facts + RECORD_BYTES;
        self.bytes += bytes;
        self.defined += bytes as u64;
        self.output.put(|writer| {
            let schema = writer.add_schema(type_name, "ros2msg", definition.as_bytes())?;
            writer.add_channel(schema, topic, "cdr", metadata).map(Topic)
        })
    }

    /// A message with its body as it was received. The encapsulation is written anew; its options, which
    /// only count padding behind the body, are 0.
    ///
    /// # Errors
    /// Of the disk, if this completes a chunk.
    pub fn message(
        &mut self,
        topic: Topic,
        stamps: MessageStamps,
        (body, endian): (&[u8], Endian),
    ) -> Result<(), FileError> {
        self.scratch.clear();
        self.scratch.extend([0, u8::from(endian == Endian::Little), 0, 0]);
        self.scratch.extend_from_slice(body);
        self.put_message(topic, stamps)
    }

    /// A document of one of our own channels. Returns whether it is in the file: one that is too large for its
    /// readers, or has no place, is not.
    ///
    /// # Errors
    /// It is no JSON (a map's key is no text), or the disk failed, if this completes a chunk.
    pub fn json(
        &mut self,
        channel: &JsonChannel,
        log_time_ns: u64,
        document: &impl Serialize,
    ) -> Result<bool, FileError> {
        self.scratch.clear();
        let length = json::encode(document, &mut self.scratch)
            .map_err(|error| FileError::format(self.output.path(), error.to_string()))?;
        // A channel stands at the end of the file once more.
        let of_channel = if self.json.contains_key(channel.topic) { 0 } else { 2 * channel.schema.len() };
        if length > channel.bytes_max || (length + of_channel + RECORD_BYTES) as u64 > self.left() {
            return Ok(false);
        }
        let (topic, sequence) = match self.json.get(channel.topic) {
            Some(known) => *known,
            None => (self.add(channel.topic, json::TYPE, json::DEFINITION, &channel.metadata())?, 0),
        };
        self.json.insert(channel.topic, (topic, sequence.wrapping_add(1)));
        self.put_message(topic, MessageStamps { log_time_ns, publish_time_ns: log_time_ns, sequence })?;
        Ok(true)
    }

    fn put_message(&mut self, topic: Topic, stamps: MessageStamps) -> Result<(), FileError> {
        let MessageStamps { log_time_ns: log_time, publish_time_ns: publish_time, sequence } = stamps;
        let header = MessageHeader { channel_id: topic.0, sequence, log_time, publish_time };
        self.output.put(|writer| writer.write_to_known_channel(&header, &self.scratch))?;
        self.messages += 1;
        self.bytes += self.scratch.len() + RECORD_BYTES;
        self.scratch.clear();
        self.scratch.shrink_to(CHUNK_BYTES);
        if self.bytes >= CHUNK_BYTES { self.end_chunk() } else { Ok(()) }
    }

    /// A file within the file. Ends the chunk.
    pub fn attach(
        &mut self,
        name: &str,
        media_type: &str,
        log_time_ns: u64,
        bytes: &[u8],
    ) -> Result<(), FileError> {
        let attachment = Attachment {
            log_time: log_time_ns,
            create_time: log_time_ns,
            name: name.to_owned(),
            media_type: media_type.to_owned(),
            data: Cow::Borrowed(bytes),
        };
        self.output.put(|writer| writer.attach(&attachment))?;
        self.end_chunk()
    }

    /// Names with values. Ends the chunk.
    pub fn metadata(&mut self, name: &str, metadata: BTreeMap<String, String>) -> Result<(), FileError> {
        let record = Metadata { name: name.to_owned(), metadata };
        self.output.put(|writer| writer.write_metadata(&record))?;
        self.end_chunk()
    }

    /// Hands everything so far to the system in whole chunks: it survives the end of the process.
    ///
    /// # Errors
    /// Of the disk. The file then ends with the last whole chunk and takes nothing more.
    pub fn end_chunk(&mut self) -> Result<(), FileError> {
        self.bytes = 0;
        self.chunks += 1;
        self.output.end_chunk()
    }

    /// Everything up to the last ended chunk survives a power cut.
    pub fn sync(&mut self) -> Result<(), FileError> {
        self.output.sync()
    }

    /// Completes the file with its summary and brings it to the disk. A file that is dropped instead stays
    /// as after its last ended chunk.
    ///
    /// # Errors
    /// Of the disk. The file then can be read as after its last ended chunk.
    pub fn finish(self) -> Result<Written, FileError> {
        let messages = self.messages;
        Ok(Written { bytes: self.output.finish()?, messages })
    }
}
