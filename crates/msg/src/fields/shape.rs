//! The layout of messages on the wire, and how to skip any part without looking inside.

use std::sync::Arc;

use super::definition::Primitive;
use crate::cdr::{Fault, FaultKind, Reader};

/// A part of a message.
#[derive(Debug, Clone)]
pub struct Shape {
    pub kind: ShapeKind,
    /// Set if no part of it has a length of its own.
    plain: Option<Strides>,
    /// Its smallest size, without padding; never 0.
    bytes_min: u64,
    /// It holds a `wstring`, which implementations of ROS 2 write in different ways.
    pub wide: bool,
    /// It holds bytes without a bound.
    pub bytes: bool,
}

#[derive(Debug, Clone)]
pub enum ShapeKind {
    Primitive(Primitive),
    Text,
    WideText,
    Message(Message),
    Array(Array),
}

#[derive(Debug, Clone)]
pub struct Message {
    /// `package/msg/Name`.
    pub type_name: Box<str>,
    pub members: Vec<(Box<str>, Arc<Shape>)>,
}

#[derive(Debug, Clone)]
pub struct Array {
    pub element: Arc<Shape>,
    /// `None` for a sequence, which begins with its length.
    pub fixed: Option<u32>,
}

/// The bytes from an offset to the end of a plain shape, padding included, by the offset modulo 8.
type Strides = [u64; 8];

impl Shape {
    pub fn primitive(primitive: Primitive) -> Shape {
        let bytes = u64::from(primitive.bytes());
        let stride = |offset: u64| offset.next_multiple_of(bytes) + bytes - offset;
        let plain = std::array::from_fn(|offset| stride(offset as u64));
        Shape {
            kind: ShapeKind::Primitive(primitive),
            plain: Some(plain),
            bytes_min: bytes,
            wide: false,
            bytes: false,
        }
    }

    pub fn text(wide: bool) -> Shape {
        let kind = if wide { ShapeKind::WideText } else { ShapeKind::Text };
        Shape { kind, plain: None, bytes_min: 4, wide, bytes: false }
    }

    /// A message without members has one byte on the wire.
    pub fn message(message: Message) -> Shape {
        let members = || message.members.iter().map(|(_, shape)| shape);
        if members().next().is_none() {
            return Shape { kind: ShapeKind::Message(message), ..Shape::primitive(Primitive::U8) };
        }
        let after = |start: u64| {
            members()
                .try_fold(start, |at, shape| shape.plain.map(|plain| at.saturating_add(stride(&plain, at))))
        };
        let plain = after(0).map(|_| {
            std::array::from_fn(|start| after(start as u64).unwrap_or(u64::MAX).saturating_sub(start as u64))
        });
        let bytes_min = members().fold(0_u64, |sum, shape| sum.saturating_add(shape.bytes_min));
        let wide = members().any(|shape| shape.wide);
        let bytes = members().any(|shape| shape.bytes);
        Shape { kind: ShapeKind::Message(message), plain, bytes_min, wide, bytes }
    }

    pub fn array(element: Arc<Shape>, fixed: Option<u32>) -> Shape {
        let plain = fixed.zip(element.plain).map(|(count, plain)| {
            std::array::from_fn(|start| repeated(&plain, start as u64, u64::from(count)))
        });
        let bytes_min = match fixed {
            Some(count) => element.bytes_min.saturating_mul(u64::from(count)),
            None => 4,
        };
        let wide = element.wide;
        let is_byte = matches!(element.kind, ShapeKind::Primitive(Primitive::U8 | Primitive::I8));
        let bytes = element.bytes || fixed.is_none() && is_byte;
        Shape { kind: ShapeKind::Array(Array { element, fixed }), plain, bytes_min, wide, bytes }
    }

    /// # Errors
    /// The body ends too early, as in all methods below.
    pub fn skip(&self, reader: &mut Reader<'_>) -> Result<(), Fault> {
        if let Some(plain) = &self.plain {
            return reader.skip(stride(plain, reader.at() as u64));
        }
        match &self.kind {
            ShapeKind::Message(message) => {
                message.members.iter().try_for_each(|(_, shape)| shape.skip(reader))
            }
            ShapeKind::Array(array) => {
                let count = array.count(reader)?;
                array.skip(count, reader)
            }
            ShapeKind::Primitive(_) | ShapeKind::Text | ShapeKind::WideText => reader.string().map(drop),
        }
    }

    /// Its name in a message for people.
    pub fn name(&self) -> String {
        match &self.kind {
            ShapeKind::Primitive(Primitive::Bool) => "a boolean".to_owned(),
            ShapeKind::Primitive(_) => "a number".to_owned(),
            ShapeKind::Text | ShapeKind::WideText => "a string".to_owned(),
            ShapeKind::Message(message) => message.type_name.to_string(),
            ShapeKind::Array(_) => "an array".to_owned(),
        }
    }
}

impl Array {
    /// The number of elements. A number that the rest of the body cannot hold is refused before any loop
    /// over it.
    ///
    /// # Errors
    pub fn count(&self, reader: &mut Reader<'_>) -> Result<u32, Fault> {
        let count = match self.fixed {
            Some(count) => count,
            None => reader.u32()?,
        };
        let needed = self.element.bytes_min.saturating_mul(u64::from(count));
        if needed > reader.remaining() as u64 {
            let what = FaultKind::Cut { needed, left: reader.remaining() };
            return Err(Fault { at: reader.at(), what });
        }
        Ok(count)
    }

    /// Skips this many elements.
    ///
    /// # Errors
    pub fn skip(&self, count: u32, reader: &mut Reader<'_>) -> Result<(), Fault> {
        match &self.element.plain {
            Some(plain) => reader.skip(repeated(plain, reader.at() as u64, u64::from(count))),
            None => (0..count).try_for_each(|_| self.element.skip(reader)),
        }
    }
}

fn stride(plain: &Strides, offset: u64) -> u64 {
    plain[(offset % 8) as usize]
}

/// The size of `count` plain shapes in a row. The offset modulo 8 repeats within 8 of them, so a million
/// take no more steps than a dozen.
fn repeated(plain: &Strides, start: u64, count: u64) -> u64 {
    let mut seen: [Option<(u64, u64)>; 8] = [None; 8];
    let (mut done, mut bytes) = (0_u64, 0_u64);
    let mut looking = true;
    while done < count {
        let phase = (start.wrapping_add(bytes) % 8) as usize;
        if looking && let Some((done_then, bytes_then)) = seen[phase] {
            let rounds = (count - done) / (done - done_then);
            bytes = bytes.saturating_add((bytes - bytes_then).saturating_mul(rounds));
            done += rounds * (done - done_then);
            looking = false;
            continue;
        }
        seen[phase] = Some((done, bytes));
        bytes = bytes.saturating_add(plain[phase]);
        done += 1;
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cdr::Endian;

    fn message(members: Vec<Shape>) -> Shape {
        let members = members.into_iter().map(|shape| ("m".into(), Arc::new(shape))).collect();
        Shape::message(Message { type_name: "t".into(), members })
    }

    #[test]
    fn skipping_all_at_once_is_skipping_one_by_one() {
        use Primitive::{F64, U8, U16, U32};
        let shapes = [
            message(vec![Shape::primitive(U8)]),
            message(vec![Shape::primitive(F64), Shape::primitive(U8)]),
            message(vec![Shape::primitive(U8), Shape::primitive(U16), Shape::primitive(U8)]),
            message(vec![Shape::primitive(U32), Shape::array(Arc::new(Shape::primitive(U8)), Some(7))]),
            message(vec![]),
        ];
        let body = [0; 4096];
        for shape in shapes {
            let shape = Arc::new(shape);
            for start in 0..8 {
                for count in 0..50 {
                    let mut one_by_one = Reader::new(&body, Endian::Little);
                    one_by_one.skip(start).unwrap();
                    let mut at_once = one_by_one.clone();
                    (0..count).for_each(|_| shape.skip(&mut one_by_one).unwrap());
                    Shape::array(shape.clone(), Some(count)).skip(&mut at_once).unwrap();
                    assert_eq!(at_once.at(), one_by_one.at(), "{shape:?} {start} {count}");
                }
            }
        }
    }

    #[test]
    fn lengths_that_lie_cost_nothing() {
        let huge = Arc::new(Shape::array(Arc::new(Shape::primitive(Primitive::F64)), Some(u32::MAX)));
        let huge = Shape::array(Arc::new(Shape::array(huge, Some(u32::MAX))), Some(u32::MAX));
        assert!(huge.skip(&mut Reader::new(&[0; 64], Endian::Little)).is_err());
        for element in [Shape::text(false), message(vec![]), message(vec![Shape::text(false)])] {
            let sequence = Shape::array(Arc::new(element), None);
            let fault = sequence.skip(&mut Reader::new(&[0xff; 64], Endian::Little)).unwrap_err();
            assert_eq!(fault.at, 4);
        }
    }
}
