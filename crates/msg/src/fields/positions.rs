//! Lists of positions: the elements of an array that have x and y, or contain a member that does.

use super::definition::Primitive;
use super::path::Step;
use super::program::{Compiler, Move, NoValue, PathError, Program};
use super::shape::{Array, Shape, ShapeKind};
use crate::cdr::Reader;
use telltale_engine::model::sample::Positions as Found;
use telltale_engine::model::sample::{FieldValue, POSITIONS_MAX, Position};

/// The members that contain a position in the messages of the common packages.
const HOLDERS: [&str; 5] = ["position", "pose", "center", "translation", "transform"];

#[derive(Debug, Clone)]
pub struct Positions {
    array: Array,
    /// The way from an element to its position.
    x: Program,
    y: Program,
}

impl Positions {
    /// `[]` in the path stands for each element; without it the path ends at the array. Also returns the
    /// way to the array.
    pub(super) fn compile(
        mut compiler: Compiler,
        steps: &[Step],
    ) -> Result<(Positions, Vec<Move>), PathError> {
        let each = steps.iter().position(|step| *step == Step::Each);
        let (before, inside) = match each {
            Some(each) => (&steps[..each], &steps[each + 1..]),
            None => (steps, &[][..]),
        };
        for step in before {
            compiler.step(step)?;
        }
        let (array, moves) = compiler.into_array()?;
        let mut element = Compiler::at(array.element.clone());
        for step in inside {
            element.step(step)?;
        }
        while !is_position(element.here()) {
            let Some(holder) = holder(element.here()) else {
                return Err(PathError {
                    text: format!("{} has no position", element.here().name()),
                    help: "name what has `x` and `y`, behind `[]`: `detections[].bbox.center.position`"
                        .to_owned(),
                });
            };
            element.member(holder)?;
        }
        let number = |name: &str| {
            let mut compiler = element.clone();
            compiler.member(name)?;
            compiler.scalar()
        };
        Ok((Positions { x: number("x")?, y: number("y")?, array }, moves))
    }

    /// # Errors
    /// The body ends too early, or an element has no position.
    pub(super) fn read(&self, reader: &mut Reader<'_>) -> Result<Found, NoValue> {
        let count = self.array.count(reader)?;
        let mut taken = Vec::with_capacity((count as usize).min(POSITIONS_MAX));
        for index in 0..count.min(POSITIONS_MAX as u32) {
            taken.push(Position {
                x_m: number(&self.x, reader, index)?,
                y_m: number(&self.y, reader, index)?,
            });
            self.array.skip(1, reader)?;
        }
        Ok(Found { taken: taken.into(), count })
    }
}

fn number(program: &Program, reader: &Reader<'_>, index: u32) -> Result<f64, NoValue> {
    match program.read(reader.clone()) {
        Ok(FieldValue::Number(number)) => Ok(number),
        // An element without a position must not be skipped.
        Ok(_) | Err(NoValue::Absent) => Err(NoValue::Refused(format!("element {index} has no position"))),
        Err(miss) => Err(miss),
    }
}

fn is_position(shape: &Shape) -> bool {
    let ShapeKind::Message(message) = &shape.kind else { return false };
    let number = |name: &str| {
        let shape =
            message.members.iter().find(|(member, _)| **member == *name).map(|(_, shape)| &shape.kind);
        matches!(shape, Some(ShapeKind::Primitive(primitive)) if *primitive != Primitive::Bool)
    };
    number("x") && number("y")
}

fn holder(shape: &Shape) -> Option<&'static str> {
    let ShapeKind::Message(message) = &shape.kind else { return None };
    let has = |name: &&str| message.members.iter().any(|(member, _)| **member == **name);
    HOLDERS.into_iter().find(has)
}
