//! The transforms of one child frame in a `tf2_msgs/TFMessage`: `transforms[child_frame_id=base_link]`.

use super::path::Step;
use super::program::{Compiler, Move, NoValue, PathError, Program, text_of};
use super::shape::Array;
use crate::cdr::Reader;
use telltale_engine::model::monitors::FieldKind;
use telltale_engine::model::sample::{PARENTS_MAX, Transform};

#[derive(Debug, Clone)]
pub struct Transforms {
    array: Array,
    child: Program,
    parent: Program,
    stamp: Program,
    frame: Box<str>,
}

impl Transforms {
    /// Also returns the way to the array.
    pub(super) fn compile(
        mut compiler: Compiler,
        steps: &[Step],
    ) -> Result<(Transforms, Vec<Move>), PathError> {
        let Some((Step::Where { key, value }, before)) = steps.split_last() else {
            return Err(PathError {
                text: "it is not said which frame is looked for".to_owned(),
                help: "end with the child frame: `transforms[child_frame_id=base_link]`".to_owned(),
            });
        };
        for step in before {
            compiler.step(step)?;
        }
        let (array, moves) = compiler.into_array()?;
        let of_header = |name: &str| {
            let mut element = Compiler::at(array.element.clone());
            element.member("header")?;
            element.member(name)?;
            element.scalar()
        };
        let (parent, stamp) = (of_header("frame_id")?, of_header("stamp")?);
        let child = Program::compile(&array.element, key, FieldKind::Scalar)?;
        Ok((Transforms { child, parent, stamp, frame: value.clone(), array }, moves))
    }

    /// What tf2 does not take is left out: a parent without a name, and the frame itself.
    ///
    /// # Errors
    /// The body ends too early, a name cannot be read, or the message has no transform of the frame.
    pub(super) fn read(&self, reader: &mut Reader<'_>) -> Result<Box<[Transform]>, NoValue> {
        let mut found: Vec<Transform> = Vec::new();
        for _ in 0..self.array.count(reader)? {
            if bare(self.child.text_bytes(reader.clone())?) == self.frame.as_bytes() {
                let parent = text_of(bare(self.parent.text_bytes(reader.clone())?))?;
                let stamp_ns = self.stamp.read_stamp(reader.clone());
                match found.iter().position(|known| *known.parent == *parent) {
                    Some(known) => found[known].stamp_ns = found[known].stamp_ns.max(stamp_ns),
                    None if parent.is_empty() || *parent == *self.frame || found.len() == PARENTS_MAX => {}
                    None => found.push(Transform { parent: parent.into(), stamp_ns }),
                }
            }
            self.array.skip(1, reader)?;
        }
        if found.is_empty() { Err(NoValue::Absent) } else { Ok(found.into()) }
    }
}

/// tf2 takes names from the time of its predecessor, which begin with a slash.
fn bare(name: &[u8]) -> &[u8] {
    name.strip_prefix(b"/").unwrap_or(name)
}
