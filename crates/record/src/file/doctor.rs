//! Verifies a complete recording: all of it can be read, and its checksums are right.

use std::fs::File;
use std::io::{ErrorKind, Read, Seek};
use std::path::Path;

use mcap::McapResult;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use super::FileError;
use super::reader::Reader;
use super::source::CHUNK_BYTES_MAX;

/// How much of a record is read at once: memory follows the bytes that are there, not the length that they
/// claim.
const STEP_BYTES: usize = 1 << 20;

/// Everything that is wrong with a file, in words, but no more than an omission list holds; nothing for a
/// complete and undamaged one. A record of more than `CHUNK_BYTES_MAX` is a finding.
///
/// # Errors
/// The disk cannot read it.
pub fn check(path: &Path) -> Result<Vec<String>, FileError> {
    let file = File::open(path).map_err(|error| FileError::io(path, "opened", error))?;
    check_bytes(path, file)
}

/// `path` is for messages only.
///
/// # Errors
/// They cannot be read.
pub fn check_bytes(path: &Path, mut bytes: impl Read + Seek) -> Result<Vec<String>, FileError> {
    let mut reader = match Reader::new(path, &mut bytes) {
        Err(FileError::Io { why, .. }) if why.kind() == ErrorKind::InvalidData => {
            return Ok(vec![why.to_string()]);
        }
        opened => opened?,
    };
    reader.read_through();
    let omissions = reader.omissions().list().iter();
    let findings: Vec<_> = omissions.map(|it| format!("at byte {}: {}", it.at, it.why)).collect();
    if !findings.is_empty() {
        return Ok(findings);
    }
    bytes.rewind().map_err(|error| FileError::io(path, "read", error))?;
    let mut at = 0;
    let wrong = checksums(&mut bytes, &mut at).err();
    Ok(wrong.map(|error| format!("at byte {at} or before: {error}")).into_iter().collect())
}

/// The library goes over every byte of the file, without unpacking its chunks. `at` is how far it came.
fn checksums(bytes: &mut impl Read, at: &mut usize) -> McapResult<()> {
    let options = LinearReaderOptions::default()
        .with_emit_chunks(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_check_finishes_after_end_magic(true)
        .with_record_length_limit(CHUNK_BYTES_MAX as usize);
    let mut reader = LinearReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        if let LinearReadEvent::ReadRequest(wanted) = event? {
            let read = bytes.read(reader.insert(wanted.min(STEP_BYTES)))?;
            reader.notify_read(read);
            *at += read;
        }
    }
    Ok(())
}
