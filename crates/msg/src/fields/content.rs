//! Fingerprints of parts of messages: equal values have the same one, whatever stands between them in the message.
//! Writers leave anything in the padding, so it does not count.

use std::hash::Hasher;

use twox_hash::XxHash64;

use super::program::is_time;
use super::shape::{Shape, ShapeKind};
use crate::cdr::{Fault, Reader};
use telltale_engine::model::sample::Fingerprint;

/// The fingerprint of the part at which the reader is. Times with the name `stamp` do not count, so a message
/// that is sent again with a new stamp has the same one.
pub(super) fn fingerprint(shape: &Shape, reader: &mut Reader<'_>) -> Result<Fingerprint, Fault> {
    let mut hash = XxHash64::with_seed(0);
    add(shape, reader, &mut hash)?;
    Ok(Fingerprint(hash.finish()))
}

fn add(shape: &Shape, reader: &mut Reader<'_>, hash: &mut XxHash64) -> Result<(), Fault> {
    match &shape.kind {
        ShapeKind::Primitive(primitive) => hash.write(reader.numbers(1, primitive.bytes())?),
        ShapeKind::Text | ShapeKind::WideText => {
            let text = reader.string()?;
            hash.write_usize(text.len());
            hash.write(text);
        }
        // Its one byte means nothing.
        ShapeKind::Message(message) if message.members.is_empty() => shape.skip(reader)?,
        ShapeKind::Message(message) => {
            for (name, member) in &message.members {
                if **name == *"stamp" && matches!(&member.kind, ShapeKind::Message(it) if is_time(it)) {
                    member.skip(reader)?;
                } else {
                    add(member, reader, hash)?;
                }
            }
        }
        ShapeKind::Array(array) => {
            let count = array.count(reader)?;
            hash.write_u32(count);
            match &array.element.kind {
                ShapeKind::Primitive(primitive) => hash.write(reader.numbers(count, primitive.bytes())?),
                _ => (0..count).try_for_each(|_| add(&array.element, reader, hash))?,
            }
        }
    }
    Ok(())
}
