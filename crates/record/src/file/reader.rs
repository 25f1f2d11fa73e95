//! Reads recordings: ours and those of others, whole or damaged.

use std::collections::{BTreeMap, HashSet};
use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;
use std::sync::Arc;

use bytes::Bytes;
use mcap::records::op;

use super::FileError;
use super::budget::{Budget, SPENT};
use super::definitions::{Channel, Definitions, Format};
use super::entry::{Entry, Item, Raw};
use super::json;
use super::layout::{Layout, Part};
use super::omission::{MISSING, Missing, Omissions};
use super::records::{self, AttachmentHead, ChunkHead, Fields, HEAD_BYTES};
use super::source::{CHUNK_BYTES_MAX, Source, crc, is_packed, raw_body};
use super::writer::MessageStamps;
use telltale_yaml::input_file;

/// A larger attachment is left out.
const ATTACHMENT_BYTES_MAX: u64 = 64 << 20;

/// Reads a recording in the order of the file: in ours the order in which the engine took its inputs, in
/// those of rosbag2 the order of arrival. (Sorting by time would change the order of the journal, and would
/// need the memory of all chunks that overlap.) One chunk is in memory at a time, at most `CHUNK_BYTES_MAX`
/// and the same for its decompression; what an entry holds of it stays until the entry is dropped.
pub struct Reader<R> {
    source: Source<R>,
    layout: Layout,
    definitions: Definitions,
    omissions: Omissions,
    /// The next part.
    next: usize,
    open: Option<Open>,
    /// Channels whose messages are left out.
    left_out: HashSet<u16>,
    /// Only definitions are taken from chunks that end before.
    from_ns: u64,
    /// By the number of the part and the bytes of it that were read.
    budget: Budget<(usize, u64)>,
}

/// A place in a file, between two entries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Place {
    next: usize,
    /// Within the part before `next`.
    inner: Option<u64>,
}

/// The rest of a part, not read yet.
enum Open {
    /// `missing`: what it lacks if it cannot be read to its end.
    Chunk {
        at: u64,
        bytes: Bytes,
        done: usize,
        missing: Missing,
    },
    Loose {
        at: u64,
        end: u64,
    },
}

impl Reader<File> {
    /// # Errors
    /// It is no MCAP file, or the disk cannot read it.
    pub fn open(path: &Path) -> Result<Reader<File>, FileError> {
        let file = input_file::open(path).map_err(|error| FileError::io(path, "opened", error))?;
        Reader::new(path, file)
    }
}

impl<R: Read + Seek> Reader<R> {
    /// `path` is for messages only.
    ///
    /// # Errors
    /// It is no MCAP file, or the disk cannot read it.
    pub fn new(path: &Path, bytes: R) -> Result<Reader<R>, FileError> {
        let failed = |error| FileError::io(path, "read", error);
        let (mut definitions, mut omissions) = (Definitions::default(), Omissions::default());
        let mut source = Source::new(bytes).map_err(failed)?;
        let layout = Layout::of(&mut source, &mut definitions, &mut omissions).map_err(failed)?;
        let budget = Budget::of_file(source.length);
        Ok(Reader {
            budget,
            source,
            layout,
            definitions,
            omissions,
            next: 0,
            open: None,
            left_out: HashSet::new(),
            from_ns: 0,
        })
    }

    #[cfg(test)]
    pub(super) fn unpack_at_most(&mut self, bytes: u64) {
        self.budget = Budget::of(bytes);
    }

    /// `ros2` for recordings of ROS 2.
    pub fn profile(&self) -> &str {
        &self.layout.profile
    }

    /// The program that wrote the file.
    pub fn library(&self) -> &str {
        &self.layout.library
    }

    /// The file was completed. Damage within it is another matter.
    pub fn is_complete(&self) -> bool {
        self.layout.complete
    }

    /// The unusable parts so far: of the whole file once every entry is read.
    pub fn omissions(&self) -> &Omissions {
        &self.omissions
    }

    /// The first and the last time of a message, by the heads of chunks. `None` without chunks.
    pub fn span_ns(&self) -> Option<(u64, u64)> {
        let times = self.layout.parts.iter().filter_map(|part| match part {
            Part::Chunk { head, .. } if head.size > 0 => Some((head.start_time, head.end_time)),
            _ => None,
        });
        times.reduce(|(start, end), (first, last)| (start.min(first), end.max(last)))
    }

    pub fn metadata(&self) -> impl Iterator<Item = (&str, &BTreeMap<String, String>)> {
        self.layout.parts.iter().filter_map(|part| match part {
            Part::Metadata { name, metadata } => Some((name.as_str(), metadata)),
            _ => None,
        })
    }

    /// The channels that are known so far: all of a completed file.
    pub fn channels(&mut self) -> Vec<Arc<Channel>> {
        self.definitions.all()
    }

    /// The names and media types of the attachments.
    pub fn attachments(&self) -> impl Iterator<Item = (&str, &str)> {
        self.layout.parts.iter().filter_map(|part| match part {
            Part::Attachment { head, .. } => Some((head.name.as_str(), head.media_type.as_str())),
            _ => None,
        })
    }

    /// The last attachment of a name. One that cannot be used is an omission.
    pub fn attachment(&mut self, name: &str) -> Option<Vec<u8>> {
        let found = self.layout.parts.iter().rev().find_map(|part| match part {
            Part::Attachment { data_at, head } if head.name == name => Some((*data_at, head.clone())),
            _ => None,
        });
        let (data_at, head) = found?;
        self.attachment_data(data_at, &head)
    }

    pub(super) fn attachment_data(&mut self, data_at: u64, head: &AttachmentHead) -> Option<Vec<u8>> {
        let start = data_at - head.length;
        let why = if head.size > ATTACHMENT_BYTES_MAX {
            "is too large".to_owned()
        } else {
            match self.source.read(start, head.length + head.size + 4) {
                Err(error) => format!("cannot be read: {error}"),
                Ok(mut bytes) => {
                    let data = bytes.split_off(head.length as usize);
                    let (data, saved) = data.split_at(head.size as usize);
                    let saved = Fields::new(saved).u32().unwrap_or_default();
                    if saved == 0 || saved == crc(&[&bytes, data]) {
                        return Some(data.to_vec());
                    }
                    "has a wrong checksum".to_owned()
                }
            }
        };
        self.omissions.add(start - HEAD_BYTES, head.size, format!("the attachment {:?} {why}", head.name));
        None
    }

    /// Goes to the first part that has entries of this time or later; earlier entries of that part follow
    /// too.
    pub fn seek(&mut self, from_ns: u64) {
        (self.next, self.open, self.from_ns) = (0, None, from_ns);
    }

    /// The place of the next entry, for [`Reader::go_to`].
    pub fn place(&self) -> Place {
        let inner = match &self.open {
            None => None,
            Some(Open::Chunk { done, .. }) => Some(*done as u64),
            Some(Open::Loose { at, .. }) => Some(*at),
        };
        Place { next: self.next, inner }
    }

    /// Goes back or forwards to a place, whose entry is the next one.
    pub fn go_to(&mut self, place: Place) {
        let Place { next, inner } = place;
        (self.next, self.open, self.from_ns) = (next, None, 0);
        let Some(inner) = inner else { return };
        let Some(part) = next.checked_sub(1).and_then(|part| self.layout.parts.get(part)).cloned() else {
            return;
        };
        match part {
            Part::Chunk { at, data_at, head } => {
                // It was said when it was read.
                let _ = self.open_chunk(at, data_at, &head);
            }
            Part::Loose { at, end } => self.open = Some(Open::Loose { at, end }),
            Part::Attachment { .. } | Part::Metadata { .. } | Part::Damage => {}
        }
        match &mut self.open {
            Some(Open::Chunk { bytes, done, .. }) => {
                *done = usize::try_from(inner).unwrap_or(usize::MAX).min(bytes.len())
            }
            Some(Open::Loose { at, end }) => *at = inner.min(*end),
            None => {}
        }
    }

    /// The next entry, in the order of the file. What cannot be used is in `omissions`.
    pub fn next_entry(&mut self) -> Option<Entry> {
        loop {
            match self.next_item()? {
                Item::Message(raw) => {
                    if let Some(entry) = self.entry(raw) {
                        return Some(entry);
                    }
                }
                Item::Missing(missing) => return Some(Entry::Missing(missing)),
                Item::Metadata { name, metadata } if name == MISSING => {
                    return Some(Entry::Missing(Missing::of_metadata(&metadata)));
                }
                Item::EndOfPart | Item::Attachment { .. } | Item::Metadata { .. } => {}
            }
        }
    }

    fn entry(&mut self, raw: Raw) -> Option<Entry> {
        let Some(channel) = self.definitions.known(raw.channel) else {
            self.leave_out_undefined(&raw);
            return None;
        };
        let Raw { at, channel: id, stamps, data } = raw;
        match &channel.format {
            Format::Other(encoding) => {
                let why = format!("messages of {}: their encoding is {encoding:?}", channel.topic);
                self.leave_out_channel(id, at, why);
                None
            }
            Format::Json => self.document(at, channel, stamps, data),
            Format::JsonText => match json::text(&data) {
                Some(text) => {
                    let text = data.slice_ref(text);
                    self.document(at, channel, stamps, text)
                }
                None => {
                    self.omissions.add(at, 0, format!("a document of {} cannot be read", channel.topic));
                    Missing::of_document(&channel, stamps).map(Entry::Missing)
                }
            },
            Format::Cdr => {
                let place = (self.next, self.place().inner.unwrap_or(u64::MAX));
                let is_packed = is_packed(&data);
                if is_packed && !self.budget.has_room(place) {
                    return Some(Entry::Missing(self.give_up(at)));
                }
                let Some(body) = raw_body(&data) else {
                    self.omissions.add(at, 0, format!("a message of {} has no body", channel.topic));
                    return None;
                };
                if is_packed {
                    let bytes = body.as_ref().map_or(0, |(bytes, _)| bytes.len());
                    self.budget.spend(place, bytes as u64);
                }
                Some(Entry::Message { channel, stamps, body })
            }
        }
    }

    fn document(
        &mut self,
        at: u64,
        channel: Arc<Channel>,
        stamps: MessageStamps,
        text: Bytes,
    ) -> Option<Entry> {
        if text.len() > json::bytes_max(&channel.topic) {
            let why = format!("a document of {} with {} bytes is too large", channel.topic, text.len());
            self.omissions.add(at, 0, why);
            return Missing::of_document(&channel, stamps).map(Entry::Missing);
        }
        Some(Entry::Json { channel, stamps, text })
    }

    /// Leaves out the rest of a file that unpacks to too much.
    fn give_up(&mut self, at: u64) -> Missing {
        self.omissions.add(at, self.source.length.saturating_sub(at), SPENT);
        (self.next, self.open) = (self.layout.parts.len(), None);
        Missing { span_ns: None }
    }

    fn leave_out_channel(&mut self, id: u16, at: u64, why: String) {
        if self.left_out.insert(id) {
            self.omissions.add(at, 0, why);
        }
    }

    pub(super) fn definitions(&self) -> &Definitions {
        &self.definitions
    }

    /// Reads everything that is left, only to see what cannot be used.
    pub(super) fn read_through(&mut self) {
        while let Some(item) = self.next_item() {
            match item {
                Item::Message(raw) if self.definitions.known(raw.channel).is_none() => {
                    self.leave_out_undefined(&raw);
                }
                Item::Attachment { data_at, head } => drop(self.attachment_data(data_at, &head)),
                _ => {}
            }
        }
    }

    pub(super) fn leave_out_undefined(&mut self, raw: &Raw) {
        let why = format!("messages of a channel that is not defined: {}", raw.channel);
        self.leave_out_channel(raw.channel, raw.at, why);
    }

    pub(super) fn next_item(&mut self) -> Option<Item> {
        loop {
            if let Some(open) = &mut self.open {
                let next = open.next(&mut self.source, &mut self.definitions, &mut self.omissions);
                if !matches!(next, Item::Message(_)) {
                    self.open = None;
                }
                return Some(next);
            }
            let part = self.layout.parts.get(self.next)?.clone();
            self.next += 1;
            match part {
                Part::Attachment { data_at, head } => return Some(Item::Attachment { data_at, head }),
                Part::Metadata { name, metadata } => return Some(Item::Metadata { name, metadata }),
                Part::Loose { at, end } => self.open = Some(Open::Loose { at, end }),
                Part::Damage => return Some(Item::Missing(Missing { span_ns: None })),
                Part::Chunk { at, .. } if !self.budget.has_room((self.next, 0)) => {
                    return Some(Item::Missing(self.give_up(at)));
                }
                Part::Chunk { at, data_at, head } => {
                    if let Err(missing) = self.open_chunk(at, data_at, &head) {
                        return Some(Item::Missing(missing));
                    }
                }
            }
        }
    }

    fn open_chunk(&mut self, at: u64, data_at: u64, head: &ChunkHead) -> Result<(), Missing> {
        let skipped = head.end_time < self.from_ns;
        if skipped && self.layout.indexed {
            return Ok(());
        }
        let is_span = head.start_time <= head.end_time && head.end_time > 0;
        let missing = Missing { span_ns: is_span.then_some((head.start_time, head.end_time)) };
        self.budget.spend((self.next, 0), head.size.min(CHUNK_BYTES_MAX));
        let mut open = match self.source.unpack(head, data_at) {
            Ok(bytes) => Open::Chunk { at, bytes, done: 0, missing },
            Err(why) => {
                self.omissions.add(at, data_at - at + head.compressed, why);
                return Err(missing);
            }
        };
        if skipped {
            while let Item::Message(_) =
                open.next(&mut self.source, &mut self.definitions, &mut self.omissions)
            {}
        } else {
            self.open = Some(open);
        }
        Ok(())
    }
}

impl Open {
    /// The next message, or how the part ends; schemas and channels before it are taken.
    fn next<R: Read + Seek>(
        &mut self,
        source: &mut Source<R>,
        definitions: &mut Definitions,
        omissions: &mut Omissions,
    ) -> Item {
        loop {
            let (place, op, record) = match self {
                Open::Chunk { at, bytes, done, missing } => {
                    let mut fields = Fields::new(&bytes[*done..]);
                    if fields.rest().is_empty() {
                        return Item::EndOfPart;
                    }
                    let Some((op, record)) = records::next_record(&mut fields) else {
                        omissions.add(*at, 0, "a chunk ends in the middle of a record");
                        return Item::Missing(*missing);
                    };
                    *done = bytes.len() - fields.rest().len();
                    (*at, op, bytes.slice_ref(record))
                }
                Open::Loose { at, end } => {
                    let head = source.head(*at).ok().flatten().filter(|head| head.end() <= *end);
                    let Some(head) = head else { return Item::EndOfPart };
                    *at = head.end();
                    if head.length > CHUNK_BYTES_MAX {
                        omissions.add(head.at, head.length, "a message is too large");
                        continue;
                    }
                    match source.read(head.content(), head.length) {
                        Ok(record) => (head.at, head.op, Bytes::from(record)),
                        Err(error) => {
                            omissions.add(head.at, head.length, format!("a message cannot be read: {error}"));
                            continue;
                        }
                    }
                }
            };
            match op {
                op::SCHEMA | op::CHANNEL => definitions.take(op, &record, place, omissions),
                op::MESSAGE => match records::message(&record) {
                    Some(message) => {
                        let stamps = MessageStamps {
                            log_time_ns: message.log_time,
                            publish_time_ns: message.publish_time,
                            sequence: message.sequence,
                        };
                        let data = record.slice_ref(message.data);
                        return Item::Message(Raw { at: place, channel: message.channel_id, stamps, data });
                    }
                    None => omissions.add(place, 0, "a message is shorter than its head"),
                },
                _ => {}
            }
        }
    }
}
