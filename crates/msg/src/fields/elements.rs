//! One value of each element of an array: `status_list[].status`, `data[]`.

use super::path::Step;
use super::program::{Compiler, Move, NoValue, PathError, Program};
use super::shape::Array;
use crate::cdr::Reader;
use telltale_engine::model::monitors::{FieldKind, ScalarKind};
use telltale_engine::model::sample::{ELEMENTS_MAX, Elements as Found, FieldValue};

/// A longer text of an element is not read.
const ELEMENT_BYTES_MAX: usize = 256;

#[derive(Debug, Clone)]
pub struct Elements {
    array: Array,
    /// The way from an element to its value.
    value: Program,
}

impl Elements {
    /// Also returns the way to the array.
    pub(super) fn compile(
        mut compiler: Compiler,
        steps: &[Step],
    ) -> Result<(Elements, Vec<Move>), PathError> {
        let each = steps.iter().position(|step| *step == Step::Each).unwrap_or(steps.len());
        for step in &steps[..each] {
            compiler.step(step)?;
        }
        let (array, moves) = compiler.into_array()?;
        let inside = steps.get(each + 1..).unwrap_or_default();
        let value = Program::compile(&array.element, inside, FieldKind::Scalar)?;
        Ok((Elements { array, value }, moves))
    }

    /// The kind of each value.
    pub fn kind(&self) -> Option<ScalarKind> {
        self.value.kind()
    }

    /// # Errors
    /// The body ends too early, or the value of an element cannot be used.
    pub(super) fn read(&self, reader: &mut Reader<'_>) -> Result<Found, NoValue> {
        let count = self.array.count(reader)?;
        let mut taken = Vec::with_capacity((count as usize).min(ELEMENTS_MAX));
        for index in 0..count.min(ELEMENTS_MAX as u32) {
            let refused = |why: String| Err(NoValue::Refused(format!("element {index}: {why}")));
            taken.push(match self.value.read(reader.clone()) {
                Ok(FieldValue::Text(text)) if text.len() > ELEMENT_BYTES_MAX => {
                    return refused(format!("a text of more than {ELEMENT_BYTES_MAX} bytes"));
                }
                Ok(value) => value,
                Err(NoValue::Fault(fault)) => return Err(fault.into()),
                Err(why) => return refused(why.to_string()),
            });
            self.array.skip(1, reader)?;
        }
        Ok(Found { taken: taken.into(), count })
    }
}
