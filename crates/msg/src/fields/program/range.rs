//! The range of the numbers that a field can have.

use super::{Leaf, Program};
use crate::fields::definition::Primitive;

impl Program {
    /// The smallest and the largest number of a field, if its type has limits.
    pub fn range(&self) -> Option<(f64, f64)> {
        match &self.leaf {
            Leaf::Primitive(primitive) => range(*primitive),
            Leaf::Length(_) => range(Primitive::U32),
            Leaf::Text | Leaf::Time | Leaf::Pose | Leaf::Positions(_) | Leaf::Content(_) => None,
        }
    }
}

/// The doubles nearest to the largest integers.
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
