//! Checks whether a message follows its type completely: an event counts only then.

use std::sync::Arc;

use super::definition::Primitive;
use super::program::{NoValue, number};
use super::shape::{Message, Shape, ShapeKind};
use crate::cdr::{Endian, Reader};

/// How far the length of a rotation's quaternion may be from 1: publishers round.
const UNIT_WITHIN: f64 = 0.1;

/// Judges messages of one type.
#[derive(Debug, Clone)]
pub struct EventReader(Arc<Shape>);

impl EventReader {
    /// `None` for a type that is not known to the last byte.
    pub(super) fn of(shape: Arc<Shape>) -> Option<EventReader> {
        (!shape.wide).then_some(EventReader(shape))
    }

    /// Checks the whole message: its positions, directions and rotations (`geometry_msgs`) must be valid.
    ///
    /// # Errors
    /// The reason why the message does not count.
    pub fn check(&self, body: &[u8], endian: Endian) -> Result<(), NoValue> {
        judge(&self.0, &mut Reader::new(body, endian), "")
    }
}

fn judge(shape: &Shape, reader: &mut Reader<'_>, name: &str) -> Result<(), NoValue> {
    match &shape.kind {
        ShapeKind::Message(message) if is_geometry(message) => judge_numbers(message, reader, name),
        ShapeKind::Message(message) if !message.members.is_empty() => {
            message.members.iter().try_for_each(|(name, shape)| judge(shape, reader, name))
        }
        ShapeKind::Array(array) if matches!(array.element.kind, ShapeKind::Message(_)) => {
            let count = array.count(reader)?;
            (0..count).try_for_each(|_| judge(&array.element, reader, name))
        }
        _ => Ok(shape.skip(reader)?),
    }
}

/// A `geometry_msgs` type of floats only.
fn is_geometry(message: &Message) -> bool {
    let is_float =
        |shape: &Shape| matches!(shape.kind, ShapeKind::Primitive(Primitive::F32 | Primitive::F64));
    message.type_name.starts_with("geometry_msgs/")
        && !message.members.is_empty()
        && message.members.iter().all(|(_, shape)| is_float(shape))
}

fn judge_numbers(message: &Message, reader: &mut Reader<'_>, name: &str) -> Result<(), NoValue> {
    let mut length = 0.0_f64;
    for (member, shape) in &message.members {
        let ShapeKind::Primitive(primitive) = shape.kind else { continue };
        let value = number(primitive, reader)?;
        if !value.is_finite() {
            return Err(NoValue::Refused(format!("refused: {name}.{member} is {value}")));
        }
        length = length.hypot(value);
    }
    if &*message.type_name == "geometry_msgs/msg/Quaternion" && (length - 1.0).abs() > UNIT_WITHIN {
        let why =
            format!("refused: {name} is no rotation, its quaternion has the length {length:.3} and not 1");
        return Err(NoValue::Refused(why));
    }
    Ok(())
}
