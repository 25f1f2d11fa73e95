//! Completes a recording that ends in the middle: after a crash, a power cut or a full disk.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashSet};
use std::ffi::OsString;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

use mcap::Attachment;
use mcap::records::{MessageHeader, Metadata};

use super::FileError;
use super::definitions::RawChannel;
use super::entry::{Item, Raw};
use super::omission::{MISSING, Missing, Omissions};
use super::output::{Output, sync_folder_of};
use super::reader::Reader;
use super::writer::CHUNK_BYTES;

/// The name of the metadata record in a repaired file.
pub const REPAIRED: &str = "telltale/repaired";

/// The counts of a repaired file.
#[derive(Debug, Clone)]
pub struct Repair {
    pub messages: u64,
    pub bytes: u64,
    /// The parts of the damaged file that it lacks.
    pub left_out: Omissions,
}

/// Completes a file. A complete one stays as it is (`None`). The new file is written beside it and takes its
/// name only when it is on the disk, so this can be interrupted and repeated at any time.
/// Appending to the damaged file would save the copy, but change the only evidence.
///
/// # Errors
/// It is no MCAP file, or the disk failed; the file is then as before.
pub fn repair(path: &Path) -> Result<Option<Repair>, FileError> {
    let mut reader = Reader::open(path)?;
    if reader.is_complete() {
        return Ok(None);
    }
    let part = part_of(path);
    match fs::remove_file(&part) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => {
            return Err(FileError::io(&part, "removed", error));
        }
        _ => {}
    }
    let copied = copy(&mut reader, &part).and_then(|(messages, bytes)| {
        fs::rename(&part, path).map_err(|error| FileError::io(path, "replaced", error))?;
        sync_folder_of(path)?;
        Ok(Repair { messages, bytes, left_out: reader.omissions().clone() })
    });
    if copied.is_err() {
        // The next repair removes it otherwise.
        let _ = fs::remove_file(&part);
    }
    copied.map(Some)
}

fn part_of(path: &Path) -> PathBuf {
    let mut part = OsString::from(path);
    part.push(".part");
    part.into()
}

/// Copies everything that can be used, with the ids that it had.
fn copy(reader: &mut Reader<File>, part: &Path) -> Result<(u64, u64), FileError> {
    let mut output = Output::create(part, reader.profile(), reader.library())?;
    let (mut known, mut messages, mut open) = (HashSet::new(), 0, 0);
    let mut missing = Vec::new();
    while let Some(item) = reader.next_item() {
        match item {
            Item::Message(raw) => {
                // A missing end makes no gap: the recording was interrupted there.
                for sign in missing.drain(..).map(Missing::to_metadata) {
                    let metadata = Metadata { name: MISSING.to_owned(), metadata: sign };
                    output.put(|writer| writer.write_metadata(&metadata))?;
                }
                if !known.contains(&raw.channel) {
                    if !define(&mut output, reader, raw.channel)? {
                        reader.leave_out_undefined(&raw);
                        continue;
                    }
                    known.insert(raw.channel);
                }
                let Raw { channel: channel_id, stamps, data, .. } = raw;
                let header = MessageHeader {
                    channel_id,
                    sequence: stamps.sequence,
                    log_time: stamps.log_time_ns,
                    publish_time: stamps.publish_time_ns,
                };
                output.put(|writer| writer.write_to_known_channel(&header, &data))?;
                messages += 1;
                open += data.len();
                if open >= CHUNK_BYTES {
                    output.end_chunk()?;
                    open = 0;
                }
            }
            Item::EndOfPart => output.end_chunk()?,
            Item::Missing(found) => {
                output.end_chunk()?;
                if missing.last() != Some(&found) {
                    missing.push(found);
                }
            }
            Item::Attachment { data_at, head } => {
                if let Some(data) = reader.attachment_data(data_at, &head) {
                    let attachment = Attachment {
                        log_time: head.log_time,
                        create_time: head.create_time,
                        name: head.name,
                        media_type: head.media_type,
                        data: Cow::Owned(data),
                    };
                    output.put(|writer| writer.attach(&attachment))?;
                }
            }
            Item::Metadata { name, metadata } => {
                output.put(|writer| writer.write_metadata(&Metadata { name, metadata }))?;
            }
        }
    }
    let left_out: Vec<_> = reader.omissions().list().iter().map(ToString::to_string).collect();
    let metadata = BTreeMap::from([
        ("messages".to_owned(), messages.to_string()),
        ("left_out".to_owned(), left_out.join("\n")),
    ]);
    output.put(|writer| writer.write_metadata(&Metadata { name: REPAIRED.to_owned(), metadata }))?;
    Ok((messages, output.finish()?))
}

/// Writes a channel with its schema, if both are known.
fn define(output: &mut Output, reader: &Reader<File>, id: u16) -> Result<bool, FileError> {
    let definitions = reader.definitions();
    let Some(channel) = definitions.raw.get(&id) else { return Ok(false) };
    let schema = definitions.schemas.get(&channel.schema_id);
    if schema.is_none() && channel.schema_id != 0 {
        return Ok(false);
    }
    output.put(|writer| {
        if let Some(schema) = schema {
            writer.add_schema_with_id(channel.schema_id, &schema.name, &schema.encoding, &schema.data)?;
        }
        let RawChannel { schema_id, topic, encoding, metadata } = channel;
        writer.add_channel_with_id(id, *schema_id, topic, encoding, metadata)
    })?;
    Ok(true)
}
