//! The records of an MCAP file, out of untrusted bytes. The library's own parser reserves memory by lengths
//! that nobody checked, and panics at a short attachment.

use std::collections::BTreeMap;

use mcap::records::{Footer, Header};

/// The opcode and the length before each record.
pub const HEAD_BYTES: u64 = 9;

/// Reads fields one after another; `None` if the record ends before.
#[derive(Debug, Clone)]
pub struct Fields<'a> {
    rest: &'a [u8],
}

impl<'a> Fields<'a> {
    pub fn new(record: &'a [u8]) -> Fields<'a> {
        Fields { rest: record }
    }

    pub fn rest(&self) -> &'a [u8] {
        self.rest
    }

    pub fn take(&mut self, length: u64) -> Option<&'a [u8]> {
        let (taken, rest) = self.rest.split_at_checked(usize::try_from(length).ok()?)?;
        self.rest = rest;
        Some(taken)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (taken, rest) = self.rest.split_first_chunk()?;
        self.rest = rest;
        Some(*taken)
    }

    pub fn u8(&mut self) -> Option<u8> {
        self.array().map(u8::from_le_bytes)
    }

    pub fn u16(&mut self) -> Option<u16> {
        self.array().map(u16::from_le_bytes)
    }

    pub fn u32(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    pub fn u64(&mut self) -> Option<u64> {
        self.array().map(u64::from_le_bytes)
    }

    pub fn bytes(&mut self) -> Option<&'a [u8]> {
        let length = self.u32()?;
        self.take(length.into())
    }

    pub fn text(&mut self) -> Option<&'a str> {
        std::str::from_utf8(self.bytes()?).ok()
    }

    fn owned(&mut self) -> Option<String> {
        self.text().map(str::to_owned)
    }

    fn texts(&mut self) -> Option<BTreeMap<String, String>> {
        let mut inner = Fields::new(self.bytes()?);
        let mut texts = BTreeMap::new();
        while !inner.rest.is_empty() {
            texts.insert(inner.owned()?, inner.owned()?);
        }
        Some(texts)
    }
}

/// The next record of a chunk: its opcode and its content.
pub fn next_record<'a>(fields: &mut Fields<'a>) -> Option<(u8, &'a [u8])> {
    let op = fields.u8()?;
    let length = fields.u64()?;
    Some((op, fields.take(length)?))
}

pub fn header(record: &[u8]) -> Option<Header> {
    let mut fields = Fields::new(record);
    Some(Header { profile: fields.owned()?, library: fields.owned()? })
}

pub struct SchemaRecord<'a> {
    pub id: u16,
    pub name: &'a str,
    pub encoding: &'a str,
    pub data: &'a [u8],
}

pub fn schema(record: &[u8]) -> Option<SchemaRecord<'_>> {
    let mut fields = Fields::new(record);
    let (id, name, encoding) = (fields.u16()?, fields.text()?, fields.text()?);
    Some(SchemaRecord { id, name, encoding, data: fields.bytes()? })
}

pub struct ChannelRecord<'a> {
    pub id: u16,
    pub schema_id: u16,
    pub topic: &'a str,
    pub encoding: &'a str,
    pub metadata: BTreeMap<String, String>,
}

pub fn channel(record: &[u8]) -> Option<ChannelRecord<'_>> {
    let mut fields = Fields::new(record);
    let (id, schema_id, topic, encoding) = (fields.u16()?, fields.u16()?, fields.text()?, fields.text()?);
    Some(ChannelRecord { id, schema_id, topic, encoding, metadata: fields.texts()? })
}

pub struct MessageRecord<'a> {
    pub channel_id: u16,
    pub sequence: u32,
    pub log_time: u64,
    pub publish_time: u64,
    pub data: &'a [u8],
}

pub fn message(record: &[u8]) -> Option<MessageRecord<'_>> {
    let mut fields = Fields::new(record);
    let (channel_id, sequence) = (fields.u16()?, fields.u32()?);
    let (log_time, publish_time) = (fields.u64()?, fields.u64()?);
    Some(MessageRecord { channel_id, sequence, log_time, publish_time, data: fields.rest() })
}

/// A chunk without its data.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChunkHead {
    pub start_time: u64,
    pub end_time: u64,
    pub size: u64,
    pub crc: u32,
    pub compression: String,
    pub compressed: u64,
    /// Of the head itself.
    pub length: u64,
}

/// `record` begins with the head and can end behind it.
pub fn chunk_head(record: &[u8]) -> Option<ChunkHead> {
    let mut fields = Fields::new(record);
    Some(ChunkHead {
        start_time: fields.u64()?,
        end_time: fields.u64()?,
        size: fields.u64()?,
        crc: fields.u32()?,
        compression: fields.owned()?,
        compressed: fields.u64()?,
        length: (record.len() - fields.rest.len()) as u64,
    })
}

/// An attachment without its data.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AttachmentHead {
    pub log_time: u64,
    pub create_time: u64,
    pub name: String,
    pub media_type: String,
    /// Of the data.
    pub size: u64,
    /// Of the head itself.
    pub length: u64,
}

/// `record` begins with the head and can end behind it.
pub fn attachment_head(record: &[u8]) -> Option<AttachmentHead> {
    let mut fields = Fields::new(record);
    Some(AttachmentHead {
        log_time: fields.u64()?,
        create_time: fields.u64()?,
        name: fields.owned()?,
        media_type: fields.owned()?,
        size: fields.u64()?,
        length: (record.len() - fields.rest.len()) as u64,
    })
}

pub fn metadata(record: &[u8]) -> Option<(String, BTreeMap<String, String>)> {
    let mut fields = Fields::new(record);
    Some((fields.owned()?, fields.texts()?))
}

pub fn footer(record: &[u8]) -> Option<Footer> {
    let mut fields = Fields::new(record);
    let (summary_start, summary_offset_start) = (fields.u64()?, fields.u64()?);
    Some(Footer { summary_start, summary_offset_start, summary_crc: fields.u32()? })
}

/// Where the indexed chunk begins.
pub fn chunk_start(index: &[u8]) -> Option<u64> {
    let mut fields = Fields::new(index);
    let _times = (fields.u64()?, fields.u64()?);
    fields.u64()
}
