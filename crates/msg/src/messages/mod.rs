//! The ROS messages that Telltale itself reads and writes, field by field.
//!
//! Decoding is lenient: one bad string never loses an array. Bytes that are not UTF-8 are replaced, long
//! strings are cut, and an array that ends in its middle yields the statuses before the cut.

pub mod encode;

use std::time::SystemTime;

use super::cdr::{Endian, Fault, FaultKind, Reader, Writer};
use telltale_engine::input::{Status, StatusArray};
use telltale_engine::model::Limits;
pub use telltale_engine::model::monitors::DIAGNOSTIC_ARRAY;

pub const BOOL: &str = "std_msgs/msg/Bool";
pub const PARTICIPANT_ENTITIES_INFO: &str = "rmw_dds_common/msg/ParticipantEntitiesInfo";

/// Statuses that are taken from one array; the rest is dropped and reported.
pub const STATUSES_MAX: usize = 100_000;

/// The size of an empty status: level, three empty strings, no values.
const STATUS_BYTES_MIN: usize = 20;

/// The name of a ROS type on the wire: `std_msgs/msg/Bool` is `std_msgs::msg::dds_::Bool_`. `None` if the
/// name does not have three parts.
pub fn dds_type_name(ros: &str) -> Option<String> {
    let mut parts = ros.split('/');
    let (package, kind, name) = (parts.next()?, parts.next()?, parts.next()?);
    let word = |part: &str| {
        !part.is_empty() && part.bytes().all(|byte| byte.is_ascii_alphanumeric() || byte == b'_')
    };
    let whole = parts.next().is_none() && word(package) && word(kind) && word(name);
    whole.then(|| format!("{package}::{kind}::dds_::{name}_"))
}

/// The inverse, for people; other names are returned unchanged.
pub fn ros_type_name(dds: &str) -> String {
    match dds.split("::").collect::<Vec<_>>()[..] {
        [package, kind, "dds_", name] => {
            format!("{package}/{kind}/{}", name.strip_suffix('_').unwrap_or(name))
        }
        _ => dds.to_owned(),
    }
}

/// The statuses of a `diagnostic_msgs/DiagnosticArray`: all that are complete before the fault, if there is
/// one.
pub fn diagnostic_array(body: &[u8], endian: Endian, limits: &Limits) -> (StatusArray, Option<Fault>) {
    let mut reader = Reader::new(body, endian);
    let claimed = match array_header(&mut reader) {
        Ok(claimed) => claimed,
        Err(fault) => return (StatusArray::default(), Some(fault)),
    };
    let counted_at = reader.at() - 4;
    let wanted = (claimed as usize).min(STATUSES_MAX);
    let possible = wanted.min(reader.remaining() / STATUS_BYTES_MIN);
    let text_bytes = reader.remaining().saturating_sub(possible * STATUS_BYTES_MIN);
    let mut array = StatusArray::with_capacity(possible, text_bytes);
    for _ in 0..wanted {
        let before = array.len();
        if let Err(fault) = status(&mut reader, &mut array, limits) {
            array.truncate(before);
            return (array, Some(fault));
        }
    }
    let too_many = (claimed as usize > STATUSES_MAX)
        .then_some(Fault { at: counted_at, what: FaultKind::TooMany { claimed, limit: STATUSES_MAX } });
    (array, too_many)
}

/// Skips stamp and frame, returns the number of statuses that the message claims to hold.
fn array_header(reader: &mut Reader) -> Result<u32, Fault> {
    reader.u32()?;
    reader.u32()?;
    reader.string()?;
    reader.u32()
}

fn status(reader: &mut Reader, array: &mut StatusArray, limits: &Limits) -> Result<(), Fault> {
    let level = reader.u8()?;
    let name = shortened(reader.string()?, limits.string_bytes);
    let message = shortened(reader.string()?, limits.string_bytes);
    let hardware_id = shortened(reader.string()?, limits.string_bytes);
    let values = reader.u32()? as usize;
    array.push_status_lossy(level, name, message, hardware_id);
    for index in 0..values {
        let key = reader.string()?;
        let value = reader.string()?;
        if index < limits.values_per_status {
            // Long enough to show that it was cut.
            let value = shortened(value, limits.string_bytes.saturating_add(CHARACTER_BYTES));
            array.push_value_lossy(shortened(key, limits.string_bytes), value);
        }
    }
    Ok(())
}

/// The longest character of UTF-8.
const CHARACTER_BYTES: usize = 4;

/// The first `bytes_max` bytes of a text, without a character that this would split.
fn shortened(text: &[u8], bytes_max: usize) -> &[u8] {
    if text.len() <= bytes_max {
        return text;
    }
    let continues = |byte: u8| byte & 0b1100_0000 == 0b1000_0000;
    // A character has at most three bytes after its first; more of them are not UTF-8.
    let border = (bytes_max.saturating_sub(3)..=bytes_max).rev().find(|&at| !continues(text[at]));
    &text[..border.unwrap_or(bytes_max)]
}

/// The `data` of a `std_msgs/Bool`.
///
/// # Errors
/// The message is empty.
pub fn boolean(body: &[u8], endian: Endian) -> Result<bool, Fault> {
    Reader::new(body, endian).u8().map(|byte| byte != 0)
}

/// The bodies of as few `diagnostic_msgs/DiagnosticArray` as hold the statuses in at most about `bytes_max`
/// each. A larger status gets a message of its own; no statuses make one empty message.
pub fn encode_diagnostic_arrays(array: &StatusArray, stamp: SystemTime, bytes_max: usize) -> Vec<Vec<u8>> {
    let mut bodies = Vec::with_capacity(1);
    let mut first = 0;
    loop {
        let mut bytes = 0;
        let fitting = array.iter().skip(first).take_while(|status| {
            bytes += encoded_bytes(*status);
            bytes <= bytes_max
        });
        let count = fitting.count().max(1).min(array.len() - first);
        bodies.push(encode_diagnostic_array(array, first, count, stamp));
        first += count;
        if first == array.len() {
            return bodies;
        }
    }
}

fn encode_diagnostic_array(array: &StatusArray, first: usize, count: usize, stamp: SystemTime) -> Vec<u8> {
    let statuses = || array.iter().skip(first).take(count);
    let mut writer = Writer::with_capacity(24 + statuses().map(encoded_bytes).sum::<usize>());
    encode::header(&mut writer, encode::Header { stamp, frame_id: "" });
    // Bounded by the 32-bit addresses of a `StatusArray`.
    writer.u32(count as u32);
    statuses().for_each(|status| write_status(&mut writer, status));
    writer.finish()
}

/// The body of a `diagnostic_msgs/DiagnosticStatus`.
pub fn encode_diagnostic_status(status: Status<'_>) -> Vec<u8> {
    let mut writer = Writer::with_capacity(encoded_bytes(status));
    write_status(&mut writer, status);
    writer.finish()
}

fn write_status(writer: &mut Writer, status: Status<'_>) {
    writer.u8(status.level());
    writer.string(status.name());
    writer.string(status.message());
    writer.string(status.hardware_id());
    writer.u32(status.values().len() as u32);
    for (key, value) in status.values() {
        writer.string(key);
        writer.string(value);
    }
}

/// The largest size of a status on the wire: a string has its length, terminator and padding.
fn encoded_bytes(status: Status<'_>) -> usize {
    let string = |text: &str| text.len() + 8;
    let values: usize = status.values().map(|(key, value)| string(key) + string(value)).sum();
    8 + string(status.name()) + string(status.message()) + string(status.hardware_id()) + values
}

/// The size of a gid in `ros_discovery_info`. It differs between distributions, and a message of the wrong
/// size makes the other processes throw.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GidSize {
    /// Iron and later.
    Bytes16,
    /// Humble and earlier.
    Bytes24,
}

impl GidSize {
    /// The size in the distribution that `ROS_DISTRO` names.
    pub fn of_distro(name: &str) -> Option<GidSize> {
        match name {
            "foxy" | "galactic" | "humble" => Some(GidSize::Bytes24),
            "iron" | "jazzy" | "kilted" | "lyrical" | "rolling" => Some(GidSize::Bytes16),
            _ => None,
        }
    }

    /// The size in a `rmw_dds_common/ParticipantEntitiesInfo` of another participant: read with the right
    /// size, only padding is left.
    pub fn of_message(body: &[u8], endian: Endian) -> Option<GidSize> {
        let fits = |size: GidSize| {
            let mut reader = Reader::new(body, endian);
            skip_participant_entities(&mut reader, size.bytes()).is_ok() && reader.remaining() < 4
        };
        // A message that fits both sizes tells nothing.
        match (fits(GidSize::Bytes16), fits(GidSize::Bytes24)) {
            (true, false) => Some(GidSize::Bytes16),
            (false, true) => Some(GidSize::Bytes24),
            _ => None,
        }
    }

    pub const fn bytes(self) -> usize {
        match self {
            GidSize::Bytes16 => 16,
            GidSize::Bytes24 => 24,
        }
    }
}

fn skip_participant_entities(reader: &mut Reader, gid_bytes: usize) -> Result<(), Fault> {
    reader.octets(gid_bytes)?;
    for _ in 0..reader.u32()? {
        reader.string()?;
        reader.string()?;
        for _readers_then_writers in 0..2 {
            let gids = reader.u32()? as usize;
            reader.octets(gids.saturating_mul(gid_bytes))?;
        }
    }
    Ok(())
}

/// A ROS 2 node as it is announced.
#[derive(Debug, Clone, Copy, Default)]
pub struct NodeEntities<'a> {
    /// With its namespace: `/ns/name`.
    pub name: &'a str,
    pub readers: &'a [[u8; 16]],
    pub writers: &'a [[u8; 16]],
}

/// The body of a `rmw_dds_common/ParticipantEntitiesInfo` that announces the nodes of a participant.
pub fn encode_nodes(participant: [u8; 16], nodes: &[NodeEntities<'_>], size: GidSize) -> Vec<u8> {
    let gids: usize = nodes.iter().map(|node| node.readers.len() + node.writers.len()).sum();
    let mut writer = Writer::with_capacity(64 * (1 + nodes.len()) + gids * size.bytes());
    let gid = |writer: &mut Writer, guid: &[u8; 16]| {
        writer.octets(guid);
        writer.octets(&[0; 8][..size.bytes() - guid.len()]);
    };
    gid(&mut writer, &participant);
    writer.u32(nodes.len() as u32);
    for node in nodes {
        let (namespace, name) = node.name.rsplit_once('/').unwrap_or(("", node.name));
        writer.string(if namespace.is_empty() { "/" } else { namespace });
        writer.string(name);
        for gids in [node.readers, node.writers] {
            writer.u32(gids.len() as u32);
            gids.iter().for_each(|one| gid(&mut writer, one));
        }
    }
    writer.finish()
}

#[cfg(test)]
mod tests;
