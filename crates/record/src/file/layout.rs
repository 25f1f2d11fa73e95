//! Where everything stands in an MCAP file: found by walking over its records, with the file's own index only
//! as a help behind a damaged place.

use std::collections::{BTreeMap, HashSet};
use std::io::{self, Read, Seek};

use mcap::MAGIC;
use mcap::records::op;

use super::definitions::Definitions;
use super::omission::Omissions;
use super::records::{self, AttachmentHead, ChunkHead, Fields};
use super::source::{Head, Source, crc};

/// Longer schemas, channels and metadata are left out.
const RECORD_BYTES_MAX: u64 = 16 << 20;
/// A longer summary is left out: the file is walked anyway.
const SUMMARY_BYTES_MAX: u64 = 64 << 20;
/// All metadata together.
const METADATA_BYTES_MAX: u64 = 16 << 20;
/// Chunks, attachments and runs of records without a chunk.
const PARTS_MAX: usize = 1 << 20;
/// The head of a chunk with the name of its compression.
const CHUNK_HEAD_BYTES_MAX: u64 = 128;
/// The head of an attachment with its name and media type.
const ATTACHMENT_HEAD_BYTES_MAX: u64 = 64 << 10;

/// A part of the file that holds data.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Part {
    Chunk {
        at: u64,
        data_at: u64,
        head: ChunkHead,
    },
    /// Records without a chunk, from the first to the end of the last.
    Loose {
        at: u64,
        end: u64,
    },
    Attachment {
        data_at: u64,
        head: AttachmentHead,
    },
    Metadata {
        name: String,
        metadata: BTreeMap<String, String>,
    },
    /// Bytes that are no records: what stood there is not known.
    Damage,
}

impl Part {
    fn chunk_at(&self) -> Option<u64> {
        match self {
            Part::Chunk { at, .. } => Some(*at),
            Part::Loose { .. } | Part::Attachment { .. } | Part::Metadata { .. } | Part::Damage => None,
        }
    }
}

#[derive(Debug, Default)]
pub struct Layout {
    pub profile: String,
    pub library: String,
    pub parts: Vec<Part>,
    /// The file ends as it should.
    pub complete: bool,
    /// The summary has the schemas and channels of all chunks.
    pub indexed: bool,
    metadata_bytes: u64,
}

impl Layout {
    /// # Errors
    /// It is no MCAP file, or the disk cannot read it.
    pub fn of<R: Read + Seek>(
        source: &mut Source<R>,
        definitions: &mut Definitions,
        omissions: &mut Omissions,
    ) -> io::Result<Layout> {
        if source.read(0, MAGIC.len() as u64)? != MAGIC {
            return Err(io::Error::new(io::ErrorKind::InvalidData, "it is no MCAP file"));
        }
        let mut layout = Layout::default();
        let summary = Summary::read(source, definitions, omissions)?;
        let mut at = MAGIC.len() as u64;
        while at < source.length {
            let head = source.head(at)?;
            let next = summary.as_ref().and_then(|summary| summary.next(at));
            let wrong = match head {
                None => Some("the file ends in the middle of a record"),
                Some(head) if next.is_some_and(|next| next < head.end()) => {
                    Some("the length of a record is wrong")
                }
                Some(Head { op: op::DATA_END | op::FOOTER, .. }) if summary.is_some() => break,
                Some(head) => layout.take(source, head, definitions, omissions)?,
            };
            if layout.parts.len() == PARTS_MAX {
                omissions.add(at, source.length - at, "the file has too many parts");
                return Ok(layout);
            }
            match (wrong, head) {
                (None, Some(head)) => at = head.end(),
                (wrong, _) => {
                    let end = next.unwrap_or(source.length);
                    omissions.add(at, end - at, wrong.unwrap_or_default());
                    layout.parts.push(Part::Damage);
                    at = end;
                }
            }
        }
        if let Some(summary) = &summary {
            layout.compare(summary, omissions);
        }
        layout.indexed = summary.as_ref().is_some_and(|summary| summary.has_channels);
        layout.complete = summary.is_some() && at < source.length;
        if !layout.complete && omissions.is_empty() {
            omissions.add(source.length, 0, "the file has no end: it was not completed");
        }
        Ok(layout)
    }

    /// Every chunk of the index has to be there.
    fn compare(&self, summary: &Summary, omissions: &mut Omissions) {
        let there: HashSet<u64> = self.parts.iter().filter_map(Part::chunk_at).collect();
        for at in summary.places.iter().filter(|at| **at != summary.start && !there.contains(at)) {
            omissions.add(*at, 0, "a chunk of the file's index is not there");
        }
    }

    /// Takes one record of the file, or says why the walk cannot go on behind it.
    fn take<R: Read + Seek>(
        &mut self,
        source: &mut Source<R>,
        head: Head,
        definitions: &mut Definitions,
        omissions: &mut Omissions,
    ) -> io::Result<Option<&'static str>> {
        let Head { at, op, length } = head;
        match op {
            op::CHUNK => {
                let start = source.read(head.content(), length.min(CHUNK_HEAD_BYTES_MAX))?;
                let Some(chunk) = records::chunk_head(&start) else {
                    return Ok(Some("the head of a chunk cannot be read"));
                };
                if chunk.length.checked_add(chunk.compressed).is_none_or(|whole| whole > length) {
                    return Ok(Some("the lengths of a chunk contradict each other"));
                }
                let data_at = head.content() + chunk.length;
                self.parts.push(Part::Chunk { at, data_at, head: chunk });
            }
            op::ATTACHMENT => {
                let start = source.read(head.content(), length.min(ATTACHMENT_HEAD_BYTES_MAX))?;
                let Some(attachment) = records::attachment_head(&start) else {
                    return Ok(Some("the head of an attachment cannot be read"));
                };
                if attachment.length.checked_add(attachment.size).and_then(|it| it.checked_add(4))
                    != Some(length)
                {
                    return Ok(Some("the lengths of an attachment contradict each other"));
                }
                let data_at = head.content() + attachment.length;
                self.parts.push(Part::Attachment { data_at, head: attachment });
            }
            op::MESSAGE => match self.parts.last_mut() {
                Some(Part::Loose { end, .. }) if *end == at => *end = head.end(),
                _ => self.parts.push(Part::Loose { at, end: head.end() }),
            },
            op::HEADER | op::SCHEMA | op::CHANNEL | op::METADATA => {
                if length > RECORD_BYTES_MAX {
                    omissions.add(at, length, "a record is too long");
                    return Ok(None);
                }
                let record = source.read(head.content(), length)?;
                self.take_small(head, &record, definitions, omissions);
            }
            op::MESSAGE_INDEX => {
                let start = source.read(head.content(), 6)?;
                let mut fields = Fields::new(&start);
                let entries = fields.u16().and_then(|_| fields.u32());
                if entries.is_none_or(|entries| u64::from(entries) + 6 != length) {
                    omissions.add(at, length, "an index of messages cannot be read");
                }
            }
            op::FOOTER | op::CHUNK_INDEX..=op::DATA_END => {}
            0 => return Ok(Some("there is no record")),
            _ => omissions.add(at, length, "a record of an unknown kind"),
        }
        Ok(None)
    }

    fn take_small(
        &mut self,
        head: Head,
        record: &[u8],
        definitions: &mut Definitions,
        omissions: &mut Omissions,
    ) {
        match head.op {
            op::HEADER => match records::header(record) {
                Some(header) => (self.profile, self.library) = (header.profile, header.library),
                None => omissions.add(head.at, head.length, "the file's header cannot be read"),
            },
            op::METADATA => match records::metadata(record) {
                Some((name, metadata)) if self.metadata_bytes + head.length <= METADATA_BYTES_MAX => {
                    self.metadata_bytes += head.length;
                    self.parts.push(Part::Metadata { name, metadata });
                }
                Some(_) => omissions.add(head.at, head.length, "the file has too much metadata"),
                None => omissions.add(head.at, head.length, "metadata cannot be read"),
            },
            op => definitions.take(op, record, head.at, omissions),
        }
    }
}

/// The summary at the end of a file, if it is whole.
struct Summary {
    /// Where chunks begin, and the summary itself.
    places: Vec<u64>,
    start: u64,
    has_channels: bool,
}

impl Summary {
    fn read<R: Read + Seek>(
        source: &mut Source<R>,
        definitions: &mut Definitions,
        omissions: &mut Omissions,
    ) -> io::Result<Option<Summary>> {
        // A record with a start, another start and a checksum, then the magic bytes.
        const FOOTER_BYTES: u64 = 9 + 20;
        let Some(footer_at) = source.length.checked_sub(FOOTER_BYTES + MAGIC.len() as u64) else {
            return Ok(None);
        };
        let end = source.read(footer_at, FOOTER_BYTES + MAGIC.len() as u64)?;
        let mut fields = Fields::new(&end);
        let footer = records::next_record(&mut fields)
            .filter(|(op, _)| *op == op::FOOTER && fields.rest() == MAGIC)
            .and_then(|(_, record)| records::footer(record));
        let Some(footer) = footer else { return Ok(None) };
        let start = footer.summary_start;
        let mut summary = Summary { places: Vec::new(), start, has_channels: false };
        if start == 0 {
            return Ok(Some(summary));
        }
        let length = footer_at.saturating_sub(start);
        if start > footer_at || length > SUMMARY_BYTES_MAX {
            omissions.add(footer_at, 0, "the summary of the file is not where it should be, or too long");
            return Ok(Some(summary));
        }
        let bytes = source.read(start, length)?;
        if footer.summary_crc != 0 && crc(&[&bytes, &end[..FOOTER_BYTES as usize - 4]]) != footer.summary_crc
        {
            omissions.add(start, length, "the checksum of the file's summary is wrong");
            return Ok(Some(summary));
        }
        let mut fields = Fields::new(&bytes);
        while !fields.rest().is_empty() {
            let at = start + (bytes.len() - fields.rest().len()) as u64;
            let Some((op, record)) = records::next_record(&mut fields) else {
                omissions.add(at, 0, "the summary of the file ends in the middle of a record");
                break;
            };
            match op {
                op::SCHEMA | op::CHANNEL => {
                    summary.has_channels |= op == op::CHANNEL;
                    definitions.take(op, record, at, omissions);
                }
                op::CHUNK_INDEX => match records::chunk_start(record) {
                    Some(at) => summary.places.push(at),
                    None => omissions.add(at, 0, "an entry of the file's index cannot be read"),
                },
                _ => {}
            }
        }
        summary.places.push(start);
        summary.places.sort_unstable();
        Ok(Some(summary))
    }

    /// The next place behind this one where a record surely begins.
    fn next(&self, at: u64) -> Option<u64> {
        self.places.get(self.places.partition_point(|place| *place <= at)).copied()
    }
}
