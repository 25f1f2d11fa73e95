//! Verifies a complete recording: checksums, indexes and counts agree with what the file holds.

use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{self, Read, Seek};
use std::path::Path;

use flate2::Crc;
use mcap::MAGIC;
use mcap::records::{AttachmentIndex, ChunkIndex, Footer, MetadataIndex, Statistics, SummaryOffset, op};

use super::FileError;
use super::records::{self, ChunkHead, Fields};
use super::source::{CHUNK_BYTES_MAX, Head, Source, crc};

/// Enough to know that a file is not as it should be.
const FINDINGS_MAX: usize = 100;

/// Everything that is wrong with a file, in words; nothing for a complete and undamaged one. A record of
/// more than `CHUNK_BYTES_MAX` is a finding.
///
/// # Errors
/// The disk cannot read it.
pub fn check(path: &Path) -> Result<Vec<String>, FileError> {
    let file = File::open(path).map_err(|error| FileError::io(path, "opened", error))?;
    check_bytes(file).map_err(|error| FileError::io(path, "read", error))
}

/// # Errors
/// The bytes cannot be read.
pub fn check_bytes(bytes: impl Read + Seek) -> io::Result<Vec<String>> {
    let source = Source::new(bytes)?;
    let mut doctor = Doctor {
        source,
        findings: Vec::new(),
        definitions: HashMap::new(),
        counted: Statistics::default(),
        times: None,
        chunks: Vec::new(),
        attachments: Vec::new(),
        metadata: Vec::new(),
        entries: BTreeMap::new(),
    };
    if doctor.source.read(0, MAGIC.len() as u64)? != MAGIC {
        return Ok(vec!["it does not begin as an MCAP file".to_owned()]);
    }
    if let Some(data_end) = doctor.data()? {
        doctor.summary(data_end)?;
    }
    Ok(doctor.findings)
}

struct Doctor<R> {
    source: Source<R>,
    findings: Vec<String>,
    /// Schemas and channels, by opcode and id.
    definitions: HashMap<(u8, u16), Vec<u8>>,
    counted: Statistics,
    times: Option<(u64, u64)>,
    chunks: Vec<ChunkIndex>,
    attachments: Vec<AttachmentIndex>,
    metadata: Vec<MetadataIndex>,
    /// The messages of the last chunk without an index so far: time and offset, by channel.
    entries: BTreeMap<u16, Vec<(u64, u64)>>,
}

impl<R: Read + Seek> Doctor<R> {
    fn find(&mut self, at: u64, what: impl std::fmt::Display) {
        if self.findings.len() < FINDINGS_MAX {
            self.findings.push(format!("at byte {at}: {what}"));
        }
    }

    /// The next record with its content, or `None` where there is none.
    fn record(&mut self, at: u64) -> io::Result<Option<(Head, Vec<u8>)>> {
        let Some(head) = self.source.head(at)? else {
            self.find(at, "the file ends in the middle of a record");
            return Ok(None);
        };
        if head.length > CHUNK_BYTES_MAX {
            self.find(at, "a record is too large");
            return Ok(None);
        }
        Ok(Some((head, self.source.read(head.content(), head.length)?)))
    }

    /// Everything up to the end of the data; returns where it is.
    fn data(&mut self) -> io::Result<Option<Head>> {
        let mut at = MAGIC.len() as u64;
        loop {
            let Some((head, record)) = self.record(at)? else { return Ok(None) };
            let first = at == MAGIC.len() as u64;
            if first != (head.op == op::HEADER) {
                self.find(at, "the header has to be the first record, and the only one");
            }
            match head.op {
                op::DATA_END => {
                    self.data_end(head, &record)?;
                    return Ok(Some(head));
                }
                op::FOOTER => {
                    self.find(at, "the end of the data is not marked");
                    return Ok(None);
                }
                op::MESSAGE_INDEX => self.message_index(head, &record),
                op => self.data_record(head, op, &record),
            }
            at = head.end();
        }
    }

    fn data_record(&mut self, head: Head, op: u8, record: &[u8]) {
        let at = head.at;
        self.end_of_indexes(at);
        let read = match op {
            op::HEADER => records::header(record).is_some(),
            op::CHUNK => match records::chunk_head(record) {
                Some(chunk) => {
                    self.chunk(head, &chunk);
                    true
                }
                None => false,
            },
            op::SCHEMA | op::CHANNEL | op::MESSAGE => self.within(at, op, record, None).is_some(),
            op::ATTACHMENT => self.attachment(head, record).is_some(),
            op::METADATA => match records::metadata(record) {
                Some((name, _)) => {
                    self.metadata.push(MetadataIndex { offset: at, length: head.end() - at, name });
                    true
                }
                None => false,
            },
            op => op >= 0x80,
        };
        if !read {
            self.find(at, format_args!("a record of kind {op:#04x} cannot be read or does not belong there"));
        }
    }

    fn chunk(&mut self, head: Head, chunk: &ChunkHead) {
        let at = head.at;
        let data_at = head.content() + chunk.length;
        self.chunks.push(ChunkIndex {
            message_start_time: chunk.start_time,
            message_end_time: chunk.end_time,
            chunk_start_offset: at,
            chunk_length: head.end() - at,
            message_index_offsets: BTreeMap::new(),
            message_index_length: 0,
            compression: chunk.compression.clone(),
            compressed_size: chunk.compressed,
            uncompressed_size: chunk.size,
        });
        if data_at.checked_add(chunk.compressed) != Some(head.end()) {
            return self.find(at, "the lengths of a chunk contradict each other");
        }
        let bytes = match self.source.unpack(chunk, data_at) {
            Ok(bytes) => bytes,
            Err(why) => return self.find(at, why),
        };
        let mut fields = Fields::new(&bytes);
        let mut times = None;
        while !fields.rest().is_empty() {
            let offset = (bytes.len() - fields.rest().len()) as u64;
            let taken = records::next_record(&mut fields)
                .and_then(|(op, record)| self.within(at, op, record, Some((offset, &mut times))));
            if taken.is_none() {
                return self.find(at, format_args!("a record at byte {offset} of a chunk cannot be read"));
            }
        }
        if times.unwrap_or((0, 0)) != (chunk.start_time, chunk.end_time) {
            self.find(at, "the times of a chunk are not those of its messages");
        }
    }

    /// A record in a chunk or beside one; `None` if it cannot be read.
    fn within(
        &mut self,
        at: u64,
        op: u8,
        record: &[u8],
        chunk: Option<(u64, &mut Option<(u64, u64)>)>,
    ) -> Option<()> {
        match op {
            op::SCHEMA => {
                let id = records::schema(record)?.id;
                if id == 0 {
                    self.find(at, "a schema has the id 0");
                }
                self.define(at, (op, id), record);
            }
            op::CHANNEL => {
                let channel = records::channel(record)?;
                if channel.schema_id != 0 && !self.definitions.contains_key(&(op::SCHEMA, channel.schema_id))
                {
                    self.find(at, format_args!("the schema of {} is not defined before it", channel.topic));
                }
                self.define(at, (op, channel.id), record);
            }
            op::MESSAGE => {
                let message = records::message(record)?;
                let (id, time) = (message.channel_id, message.log_time);
                if !self.definitions.contains_key(&(op::CHANNEL, id)) {
                    self.find(at, format_args!("the channel {id} of a message is not defined before it"));
                }
                let widen = |times: Option<(u64, u64)>| {
                    Some(times.map_or((time, time), |(start, end)| (start.min(time), end.max(time))))
                };
                self.times = widen(self.times);
                self.counted.message_count += 1;
                *self.counted.channel_message_counts.entry(id).or_default() += 1;
                if let Some((offset, times)) = chunk {
                    *times = widen(*times);
                    self.entries.entry(id).or_default().push((time, offset));
                }
            }
            op => return (op >= 0x80).then_some(()),
        }
        Some(())
    }

    fn define(&mut self, at: u64, key: (u8, u16), record: &[u8]) {
        match self.definitions.get(&key) {
            Some(known) if known != record => {
                self.find(at, "a schema or channel is defined twice, differently")
            }
            Some(_) => {}
            None => {
                self.definitions.insert(key, record.to_vec());
            }
        }
    }

    fn message_index(&mut self, head: Head, record: &[u8]) {
        let (Some(index), Some(chunk)) = (records::message_index(record), self.chunks.last_mut()) else {
            return self.find(head.at, "an index of messages cannot be read or has no chunk");
        };
        chunk.message_index_offsets.insert(index.channel_id, head.at);
        chunk.message_index_length += head.end() - head.at;
        let mut listed: Vec<_> = index.records.iter().map(|entry| (entry.log_time, entry.offset)).collect();
        let mut there = self.entries.remove(&index.channel_id).unwrap_or_default();
        listed.sort_unstable();
        there.sort_unstable();
        if listed != there {
            self.find(head.at, "an index is not that of the messages in its chunk");
        }
    }

    /// A chunk has an index for each of its channels, or none at all.
    fn end_of_indexes(&mut self, at: u64) {
        let left = !std::mem::take(&mut self.entries).is_empty();
        if left && self.chunks.last().is_some_and(|chunk| !chunk.message_index_offsets.is_empty()) {
            self.find(at, "a channel of the chunk before has no index");
        }
    }

    fn attachment(&mut self, head: Head, record: &[u8]) -> Option<()> {
        let attachment = records::attachment_head(record)?;
        let content = record.get(..record.len().checked_sub(4)?)?;
        if content.len() as u64 != attachment.length.checked_add(attachment.size)? {
            return None;
        }
        let saved = Fields::new(&record[content.len()..]).u32()?;
        if saved != 0 && saved != crc(&[content]) {
            self.find(head.at, format_args!("the checksum of the attachment {:?} is wrong", attachment.name));
        }
        self.attachments.push(AttachmentIndex {
            offset: head.at,
            length: head.end() - head.at,
            log_time: attachment.log_time,
            create_time: attachment.create_time,
            data_size: attachment.size,
            name: attachment.name,
            media_type: attachment.media_type,
        });
        Some(())
    }

    fn data_end(&mut self, head: Head, record: &[u8]) -> io::Result<()> {
        self.end_of_indexes(head.at);
        let Some(saved) = Fields::new(record).u32() else {
            self.find(head.at, "the mark of the end of the data cannot be read");
            return Ok(());
        };
        if saved != 0 && saved != self.checksum(0, head.at)? {
            self.find(head.at, "the checksum of the data is wrong");
        }
        Ok(())
    }

    fn checksum(&mut self, from: u64, to: u64) -> io::Result<u32> {
        const STEP: u64 = 1 << 20;
        let mut crc = Crc::new();
        let mut at = from;
        while at < to {
            let bytes = self.source.read(at, STEP.min(to - at))?;
            crc.update(&bytes);
            at += (bytes.len() as u64).max(1);
        }
        Ok(crc.sum())
    }

    fn summary(&mut self, data_end: Head) -> io::Result<()> {
        self.count();
        let start = data_end.end();
        let (mut at, mut first_offset) = (start, None);
        let (mut chunks, mut attachments, mut metadata) = (Vec::new(), Vec::new(), Vec::new());
        let mut groups: BTreeMap<u8, SummaryOffset> = BTreeMap::new();
        let mut repeated: Vec<(u8, u16)> = Vec::new();
        let footer_at = loop {
            let Some((head, record)) = self.record(at)? else { return Ok(()) };
            if head.op == op::FOOTER {
                break head.at;
            }
            let length = head.end() - at;
            let group = SummaryOffset { group_opcode: head.op, group_start: at, group_length: 0 };
            groups.entry(head.op).or_insert(group).group_length += length;
            let read = match head.op {
                op::SCHEMA | op::CHANNEL => {
                    let id = Fields::new(&record).u16();
                    repeated.extend(id.map(|id| (head.op, id)));
                    id.is_some_and(|id| self.definitions.get(&(head.op, id)) == Some(&record))
                }
                op::STATISTICS => records::statistics(&record).as_ref() == Some(&self.counted),
                op::CHUNK_INDEX => records::chunk_index(&record).map(|it| chunks.push(it)).is_some(),
                op::ATTACHMENT_INDEX => {
                    records::attachment_index(&record).map(|it| attachments.push(it)).is_some()
                }
                op::METADATA_INDEX => records::metadata_index(&record).map(|it| metadata.push(it)).is_some(),
                op::SUMMARY_OFFSET => {
                    first_offset.get_or_insert(at);
                    let offset = records::summary_offset(&record);
                    offset.is_some_and(|offset| groups.get(&offset.group_opcode) == Some(&offset))
                }
                op => op >= 0x80,
            };
            if !read {
                let kind = head.op;
                self.find(
                    at,
                    format_args!("a record of kind {kind:#04x} in the summary does not fit the data"),
                );
            }
            at = head.end();
        };
        let lists = [
            ("chunks", chunks.is_empty() || chunks == self.chunks),
            ("attachments", attachments.is_empty() || attachments == self.attachments),
            ("metadata", metadata.is_empty() || metadata == self.metadata),
            ("schemas and channels", repeated.is_empty() || repeated.len() == self.definitions.len()),
        ];
        for (what, agrees) in lists {
            if !agrees {
                self.find(start, format_args!("the index of the {what} is not that of the data"));
            }
        }
        self.footer(footer_at, start, first_offset)
    }

    fn count(&mut self) {
        let defined = |op: u8| self.definitions.keys().filter(|key| key.0 == op).count();
        let (schemas, channels) = (defined(op::SCHEMA), defined(op::CHANNEL));
        self.counted.schema_count = schemas as u16;
        self.counted.channel_count = channels as u32;
        self.counted.attachment_count = self.attachments.len() as u32;
        self.counted.metadata_count = self.metadata.len() as u32;
        self.counted.chunk_count = self.chunks.len() as u32;
        (self.counted.message_start_time, self.counted.message_end_time) = self.times.unwrap_or((0, 0));
    }

    fn footer(&mut self, at: u64, start: u64, first_offset: Option<u64>) -> io::Result<()> {
        let Some((head, record)) = self.record(at)? else { return Ok(()) };
        let Some(Footer { summary_start, summary_offset_start, summary_crc }) = records::footer(&record)
        else {
            self.find(at, "the footer cannot be read");
            return Ok(());
        };
        let leads = match first_offset {
            Some(first) => (summary_start, summary_offset_start) == (start, first),
            None => summary_start == if at == start { 0 } else { start },
        };
        if !leads {
            self.find(at, "the footer does not lead to the summary");
        }
        if summary_crc != 0 && summary_crc != self.checksum(start, head.end() - 4)? {
            self.find(at, "the checksum of the summary is wrong");
        }
        let rest = self.source.read(head.end(), MAGIC.len() as u64 + 1)?;
        if rest != MAGIC {
            self.find(head.end(), "it does not end as an MCAP file");
        }
        Ok(())
    }
}
