//! The bytes of an MCAP file: its top-level records, and chunks as they were before compression.

use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};

use bytes::Bytes;
use flate2::Crc;

use super::records::{ChunkHead, HEAD_BYTES};
use telltale_msg::cdr::{Endian, Fault, FaultKind};
use telltale_msg::sample_bytes::RawBody;

/// A larger chunk is left out. The largest message over DDS has half of it.
pub const CHUNK_BYTES_MAX: u64 = 128 << 20;

/// Any source of bytes with its length.
pub struct Source<R> {
    bytes: BufReader<R>,
    at: u64,
    pub length: u64,
}

/// A record of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Head {
    pub at: u64,
    pub op: u8,
    pub length: u64,
}

impl Head {
    /// Where its content begins.
    pub fn content(&self) -> u64 {
        self.at + HEAD_BYTES
    }

    pub fn end(&self) -> u64 {
        self.content().saturating_add(self.length)
    }
}

impl<R: Read + Seek> Source<R> {
    pub fn new(mut bytes: R) -> io::Result<Source<R>> {
        let length = bytes.seek(SeekFrom::End(0))?;
        bytes.rewind()?;
        Ok(Source { bytes: BufReader::with_capacity(64 << 10, bytes), at: 0, length })
    }

    fn seek(&mut self, to: u64) -> io::Result<()> {
        match i64::try_from(i128::from(to) - i128::from(self.at)) {
            Ok(by) => self.bytes.seek_relative(by)?,
            Err(_) => return Err(io::ErrorKind::InvalidInput.into()),
        }
        self.at = to;
        Ok(())
    }

    /// So many bytes, or fewer at the end of the file.
    pub fn read(&mut self, at: u64, length: u64) -> io::Result<Vec<u8>> {
        self.seek(at)?;
        let mut found = Vec::new();
        let read = self.bytes.by_ref().take(length).read_to_end(&mut found);
        self.at += found.len() as u64;
        read?;
        Ok(found)
    }

    /// The record at this place, if the file holds all of it.
    pub fn head(&mut self, at: u64) -> io::Result<Option<Head>> {
        let Some((op, length)) = self.read(at, HEAD_BYTES)?.split_first().and_then(|(op, length)| {
            let length = <[u8; 8]>::try_from(length).ok()?;
            Some((*op, u64::from_le_bytes(length)))
        }) else {
            return Ok(None);
        };
        let head = Head { at, op, length };
        Ok((head.end() <= self.length).then_some(head))
    }

    /// The content of a chunk before compression. Memory follows the bytes that are there, and never exceeds
    /// `CHUNK_BYTES_MAX` and the window of the compression, which is as large at most.
    pub fn unpack(&mut self, head: &ChunkHead, data_at: u64) -> Result<Bytes, String> {
        if head.size > CHUNK_BYTES_MAX {
            return Err(format!("a chunk of {} bytes is too large", head.size));
        }
        self.seek(data_at).map_err(|error| error.to_string())?;
        let packed = self.bytes.by_ref().take(head.compressed);
        let unpacked = unpack(packed, &head.compression, head.size);
        // How far the decompressor read is not known.
        self.at = self.bytes.stream_position().map_err(|error| error.to_string())?;
        let unpacked = unpacked.map_err(|error| format!("a chunk cannot be decompressed: {error}"))?;
        if unpacked.len() as u64 != head.size {
            return Err(format!("a chunk of {} bytes has {} or more", head.size, unpacked.len()));
        }
        if head.crc != 0 && crc(&[&unpacked]) != head.crc {
            return Err("the checksum of a chunk is wrong".to_owned());
        }
        Ok(unpacked.into())
    }
}

fn unpack(packed: impl BufRead, compression: &str, size: u64) -> io::Result<Vec<u8>> {
    let mut unpacked = Vec::new();
    // One byte more shows that there is more.
    match compression {
        "" => packed.take(size + 1).read_to_end(&mut unpacked),
        "zstd" => {
            zstd::Decoder::with_buffer(packed)?.single_frame().take(size + 1).read_to_end(&mut unpacked)
        }
        "lz4" => lz4_flex::frame::FrameDecoder::new(packed).take(size + 1).read_to_end(&mut unpacked),
        other => Err(io::Error::other(format!("{other:?} is not known"))),
    }?;
    Ok(unpacked)
}

/// A message with its encapsulation, which rosbag2 may have compressed by itself; `None` if it is too short.
pub fn raw_body(data: &Bytes) -> Option<RawBody> {
    let unpacked = is_packed(data).then(|| unpack_message(data).ok()).flatten();
    let data = unpacked.as_ref().unwrap_or(data);
    let (head, _) = data.split_first_chunk::<4>()?;
    Some(match [head[0], head[1]] {
        [0, 0] => Ok((data.slice(4..), Endian::Big)),
        [0, 1] => Ok((data.slice(4..), Endian::Little)),
        other => Err(Fault { at: 0, what: FaultKind::Encoding(other) }),
    })
}

/// Whether rosbag2 compressed a message by itself.
pub(super) fn is_packed(data: &[u8]) -> bool {
    data.starts_with(&zstd::zstd_safe::MAGICNUMBER.to_le_bytes())
}

fn unpack_message(data: &[u8]) -> io::Result<Bytes> {
    let mut unpacked = Vec::new();
    zstd::Decoder::with_buffer(data)?.take(CHUNK_BYTES_MAX + 1).read_to_end(&mut unpacked)?;
    let is_too_large = unpacked.len() as u64 > CHUNK_BYTES_MAX;
    if is_too_large { Err(io::ErrorKind::FileTooLarge.into()) } else { Ok(unpacked.into()) }
}

/// The checksum of all parts together.
pub fn crc(parts: &[&[u8]]) -> u32 {
    let mut crc = Crc::new();
    parts.iter().for_each(|part| crc.update(part));
    crc.sum()
}
