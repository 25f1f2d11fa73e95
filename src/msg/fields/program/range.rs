//! Which numbers a field can be at all.

use super::{Leaf, Program};
use crate::msg::fields::definition::Primitive;

impl Program {
    /// The least and the greatest number that it can read, where its type says.
    pub fn range(&self) -> Option<(f64, f64)> {
        match &self.leaf {
            Leaf::Primitive(primitive) => range(*primitive),
            Leaf::Length(_) => range(Primitive::U32),
            Leaf::Text | Leaf::Time | Leaf::Pose | Leaf::Positions(_) => None,
        }
    }
}

/// Of the largest integers the nearest numbers that are one.
fn range(primitive: Primitive) -> Option<(f64, f64)> {
    Some(match primitive {
        Primitive::Bool | Primitive::F32 | Primitive::F64 => return None,
        Primitive::U8 => (0.0, f64::from(u8::MAX)),
        Primitive::I8 => (f64::from(i8::MIN), f64::from(i8::MAX)),
        Primitive::U16 => (0.0, f64::from(u16::MAX)),
        Primitive::I16 => (f64::from(i16::MIN), f64::from(i16::MAX)),
        Primitive::U32 => (0.0, f64::from(u32::MAX)),
        Primitive::I32 => (f64::from(i32::MIN), f64::from(i32::MAX)),
        Primitive::U64 => (0.0, u64::MAX as f64),
        Primitive::I64 => (i64::MIN as f64, i64::MAX as f64),
    })
}
