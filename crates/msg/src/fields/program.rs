//! Compiled paths: the parts of a message to skip, and the value to read.

use std::collections::BTreeSet;
use std::fmt;
use std::sync::Arc;

use super::content;
use super::definition::Primitive;
use super::elements::Elements;
use super::path::Step;
use super::positions::Positions;
use super::shape::{Array, Message, Shape, ShapeKind};
use super::transforms::Transforms;
use crate::cdr::{Fault, Reader};
use telltale_engine::model::monitors::{FieldKind, ScalarKind};
use telltale_engine::model::sample::{FieldValue, Pose};

/// Longer texts are not read: a longer text is never compared with a value.
const TEXT_BYTES_MAX: usize = 4096;

#[derive(Debug, Clone)]
pub struct Program {
    moves: Vec<Move>,
    leaf: Leaf,
}

#[derive(Debug, Clone)]
pub(super) enum Move {
    Skip(Arc<Shape>),
    /// To an element.
    Index {
        array: Array,
        index: u32,
    },
    /// To the last element.
    Last(Array),
    /// To the first element with this key.
    Where {
        array: Array,
        key: Box<Program>,
        wanted: Wanted,
    },
}

#[derive(Debug, Clone)]
enum Leaf {
    Primitive(Primitive),
    /// A whole number as its name.
    Named(Primitive, Arc<[(Box<str>, i64)]>),
    Text,
    /// `int32` seconds and `uint32` nanoseconds.
    Time,
    Pose,
    Length(Array),
    Positions(Box<Positions>),
    Transforms(Box<Transforms>),
    Elements(Box<Elements>),
    Content(Arc<Shape>),
}

#[derive(Debug, Clone)]
pub(super) enum Wanted {
    Text(Box<str>),
    Number(f64),
}

/// Why a message has no value for a field.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum NoValue {
    /// The message does not follow its type.
    Fault(Fault),
    /// The wanted element is missing: this message is about others.
    Absent,
    /// The field exists, but its value cannot be used.
    Refused(String),
}

impl fmt::Display for NoValue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            NoValue::Fault(fault) => fault.fmt(f),
            NoValue::Absent => f.write_str("no element is the one that is asked for"),
            NoValue::Refused(why) => f.write_str(why),
        }
    }
}

impl From<Fault> for NoValue {
    fn from(fault: Fault) -> NoValue {
        NoValue::Fault(fault)
    }
}

/// Why a path cannot be read from a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PathError {
    pub text: String,
    pub help: String,
}

impl Program {
    /// # Errors
    /// The missing field, or the field that is there instead.
    pub fn compile(shape: &Arc<Shape>, steps: &[Step], kind: FieldKind) -> Result<Program, PathError> {
        let mut compiler = Compiler::at(shape.clone());
        if kind == FieldKind::Positions {
            let (positions, moves) = Positions::compile(compiler, steps)?;
            return Ok(Program { moves, leaf: Leaf::Positions(Box::new(positions)) });
        }
        if kind == FieldKind::Transforms {
            let (transforms, moves) = Transforms::compile(compiler, steps)?;
            return Ok(Program { moves, leaf: Leaf::Transforms(Box::new(transforms)) });
        }
        if kind == FieldKind::Elements {
            let (elements, moves) = Elements::compile(compiler, steps)?;
            return Ok(Program { moves, leaf: Leaf::Elements(Box::new(elements)) });
        }
        for (index, step) in steps.iter().enumerate() {
            let is_last = index + 1 == steps.len();
            if let (Step::Member(name), true, ShapeKind::Array(array)) = (step, is_last, &compiler.here.kind)
                && **name == *"length"
                && matches!(kind, FieldKind::Scalar | FieldKind::Named | FieldKind::Content)
            {
                let leaf = Leaf::Length(array.clone());
                return Ok(Program { moves: compiler.moves, leaf });
            }
            compiler.step(step)?;
        }
        match kind {
            FieldKind::Pose => compiler.pose(),
            FieldKind::Content => compiler.content(),
            FieldKind::Scalar
            | FieldKind::Named
            | FieldKind::Positions
            | FieldKind::Transforms
            | FieldKind::Elements => compiler.scalar(),
        }
    }

    /// The kind of its value, or of each value of a list; `None` for a pose, for positions, for transforms and for a fingerprint.
    pub fn kind(&self) -> Option<ScalarKind> {
        Some(match &self.leaf {
            Leaf::Primitive(Primitive::Bool) => ScalarKind::Bool,
            Leaf::Primitive(_) | Leaf::Time | Leaf::Length(_) => ScalarKind::Number,
            Leaf::Text | Leaf::Named(..) => ScalarKind::Text,
            Leaf::Elements(elements) => return elements.kind(),
            Leaf::Pose | Leaf::Positions(_) | Leaf::Transforms(_) | Leaf::Content(_) => return None,
        })
    }

    /// Reads the name of a number in place of the number, if there are names.
    ///
    /// # Errors
    /// A number has two names, or none has one that is wanted: a condition on it would never be true.
    pub fn named(
        self,
        names: Vec<(Box<str>, i64)>,
        wanted: &BTreeSet<Box<str>>,
    ) -> Result<Program, PathError> {
        let Leaf::Primitive(primitive) = self.leaf else { return Ok(self) };
        let is_whole = range(primitive).is_some();
        if names.is_empty() || !is_whole {
            return Ok(self);
        }
        for (at, (name, number)) in names.iter().enumerate() {
            if let Some((other, _)) = names[..at].iter().find(|(_, known)| known == number) {
                let text = format!("{number} is called {other} and {name}");
                return Err(PathError { text, help: "write the number".to_owned() });
            }
        }
        if let Some(unknown) = wanted.iter().find(|wanted| names.iter().all(|(name, _)| name != *wanted)) {
            let known: Vec<&str> = names.iter().map(|(name, _)| &**name).collect();
            let text = format!("no number of it is called {unknown}");
            return Err(PathError { text, help: format!("write one of {}", known.join(", ")) });
        }
        Ok(Program { leaf: Leaf::Named(primitive, names.into()), ..self })
    }

    /// Whether it reads a time.
    pub fn is_time(&self) -> bool {
        matches!(self.leaf, Leaf::Time)
    }

    pub fn read(&self, mut reader: Reader<'_>) -> Result<FieldValue, NoValue> {
        let reader = &mut reader;
        self.go(reader)?;
        Ok(match &self.leaf {
            Leaf::Primitive(Primitive::Bool) => FieldValue::Bool(reader.u8()? != 0),
            Leaf::Primitive(primitive) => FieldValue::Number(number(*primitive, reader)?),
            Leaf::Named(primitive, names) => {
                // Whole: only such a number has names.
                let number = number(*primitive, reader)? as i64;
                let name = names.iter().find(|(_, named)| *named == number).map(|(name, _)| name.clone());
                FieldValue::Text(name.unwrap_or_else(|| number.to_string().into()))
            }
            Leaf::Text => FieldValue::Text(text(reader)?.into()),
            Leaf::Time => {
                let (seconds, nanos) = time(reader)?;
                FieldValue::Number(f64::from(seconds) + f64::from(nanos) / 1e9)
            }
            Leaf::Pose => FieldValue::Pose(pose(reader)?),
            Leaf::Length(array) => FieldValue::Number(f64::from(array.count(reader)?)),
            Leaf::Positions(positions) => FieldValue::Positions(positions.read(reader)?.into()),
            Leaf::Transforms(transforms) => FieldValue::Transforms(transforms.read(reader)?),
            Leaf::Elements(elements) => FieldValue::Elements(elements.read(reader)?.into()),
            Leaf::Content(shape) => FieldValue::Content(content::fingerprint(shape, reader)?),
        })
    }

    /// A time in nanoseconds since 1970; `None` for a value that is not a time.
    pub fn read_stamp(&self, mut reader: Reader<'_>) -> Option<i64> {
        self.go(&mut reader).ok()?;
        let (seconds, nanos) = time(&mut reader).ok()?;
        (nanos < 1_000_000_000).then(|| i64::from(seconds) * 1_000_000_000 + i64::from(nanos))
    }

    /// The bytes of a text.
    pub(super) fn text_bytes<'a>(&self, mut reader: Reader<'a>) -> Result<&'a [u8], NoValue> {
        self.go(&mut reader)?;
        Ok(reader.string()?)
    }

    /// Moves to the position of the value.
    fn go(&self, reader: &mut Reader<'_>) -> Result<(), NoValue> {
        for step in &self.moves {
            match step {
                Move::Skip(shape) => shape.skip(reader)?,
                Move::Index { array, index } => {
                    let count = array.count(reader)?;
                    if *index >= count {
                        return Err(NoValue::Refused(format!(
                            "there is no element {index}: there are {count}"
                        )));
                    }
                    array.skip(*index, reader)?;
                }
                Move::Last(array) => {
                    let Some(index) = array.count(reader)?.checked_sub(1) else {
                        return Err(NoValue::Refused("there is no last element: there are 0".to_owned()));
                    };
                    array.skip(index, reader)?;
                }
                Move::Where { array, key, wanted } => find(array, key, wanted, reader)?,
            }
        }
        Ok(())
    }

    fn matches(&self, mut reader: Reader<'_>, wanted: &Wanted) -> Result<bool, NoValue> {
        self.go(&mut reader)?;
        Ok(match (&self.leaf, wanted) {
            (Leaf::Text, Wanted::Text(wanted)) => reader.string()? == wanted.as_bytes(),
            #[expect(clippy::float_cmp, reason = "the very number is looked for")]
            (Leaf::Primitive(primitive), Wanted::Number(wanted)) => {
                number(*primitive, &mut reader)? == *wanted
            }
            _ => false,
        })
    }

    /// The smallest and the largest number of a field, if its type has limits.
    pub fn range(&self) -> Option<(f64, f64)> {
        match &self.leaf {
            Leaf::Primitive(primitive) => range(*primitive),
            Leaf::Length(_) => range(Primitive::U32),
            Leaf::Text
            | Leaf::Named(..)
            | Leaf::Time
            | Leaf::Pose
            | Leaf::Positions(_)
            | Leaf::Transforms(_)
            | Leaf::Elements(_)
            | Leaf::Content(_) => None,
        }
    }
}

fn find(array: &Array, key: &Program, wanted: &Wanted, reader: &mut Reader<'_>) -> Result<(), NoValue> {
    let count = array.count(reader)?;
    for _ in 0..count {
        if key.matches(reader.clone(), wanted)? {
            return Ok(());
        }
        array.skip(1, reader)?;
    }
    Err(NoValue::Absent)
}

pub(super) fn number(primitive: Primitive, reader: &mut Reader<'_>) -> Result<f64, Fault> {
    Ok(match primitive {
        Primitive::Bool => f64::from(u8::from(reader.u8()? != 0)),
        Primitive::U8 => f64::from(reader.u8()?),
        Primitive::I8 => f64::from(reader.u8()?.cast_signed()),
        Primitive::U16 => f64::from(u16::from_le_bytes(reader.scalar()?)),
        Primitive::I16 => f64::from(i16::from_le_bytes(reader.scalar()?)),
        Primitive::U32 => f64::from(u32::from_le_bytes(reader.scalar()?)),
        Primitive::I32 => f64::from(i32::from_le_bytes(reader.scalar()?)),
        // Above 2^53, the nearest number that is a double.
        Primitive::U64 => u64::from_le_bytes(reader.scalar()?) as f64,
        Primitive::I64 => i64::from_le_bytes(reader.scalar()?) as f64,
        Primitive::F32 => f64::from(f32::from_le_bytes(reader.scalar()?)),
        Primitive::F64 => f64::from_le_bytes(reader.scalar()?),
    })
}

fn text<'a>(reader: &mut Reader<'a>) -> Result<&'a str, NoValue> {
    text_of(reader.string()?)
}

pub(super) fn text_of(bytes: &[u8]) -> Result<&str, NoValue> {
    if bytes.len() > TEXT_BYTES_MAX {
        let text = format!("a string of {} bytes; at most {TEXT_BYTES_MAX} are taken", bytes.len());
        return Err(NoValue::Refused(text));
    }
    std::str::from_utf8(bytes).map_err(|_| NoValue::Refused("a string that is no UTF-8".to_owned()))
}

fn time(reader: &mut Reader<'_>) -> Result<(i32, u32), Fault> {
    Ok((i32::from_le_bytes(reader.scalar()?), reader.u32()?))
}

fn pose(reader: &mut Reader<'_>) -> Result<Pose, Fault> {
    let mut next = || reader.scalar().map(f64::from_le_bytes);
    Ok(Pose { x_m: next()?, y_m: next()?, z_m: next()?, qx: next()?, qy: next()?, qz: next()?, qw: next()? })
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

/// A position on the way along a path.
#[derive(Clone)]
pub(super) struct Compiler {
    moves: Vec<Move>,
    here: Arc<Shape>,
}

impl Compiler {
    pub(super) fn at(here: Arc<Shape>) -> Compiler {
        Compiler { moves: Vec::new(), here }
    }

    pub(super) fn here(&self) -> &Shape {
        &self.here
    }

    /// The array at this position, and the way to it.
    pub(super) fn into_array(self) -> Result<(Array, Vec<Move>), PathError> {
        let array = self.array("[]")?;
        Ok((array, self.moves))
    }

    pub(super) fn step(&mut self, step: &Step) -> Result<(), PathError> {
        match step {
            Step::Member(name) => self.member(name),
            Step::Index(index) => {
                let array = self.array(&format!("[{index}]"))?;
                if let Some(count) = array.fixed
                    && *index >= count
                {
                    return Err(PathError {
                        text: format!("there is no element {index}: the array always has {count}"),
                        help: format!("write a number from 0 to {}", count - 1),
                    });
                }
                self.here = array.element.clone();
                self.moves.push(Move::Index { array, index: *index });
                Ok(())
            }
            Step::Last => {
                let array = self.array("[-1]")?;
                self.here = array.element.clone();
                self.moves.push(Move::Last(array));
                Ok(())
            }
            Step::Where { key, value } => self.choose(key, value),
            Step::Each => Err(PathError {
                text: "`[]` stands for all elements, and one is wanted".to_owned(),
                help: "name an element, `[0]`; `[]` belongs into a `list`".to_owned(),
            }),
        }
    }

    pub(super) fn member(&mut self, name: &str) -> Result<(), PathError> {
        let here = self.here.clone();
        let ShapeKind::Message(message) = &here.kind else {
            return Err(PathError {
                text: format!("there is no `{name}` in {}", here.name()),
                help: match here.kind {
                    ShapeKind::Array(_) => "name an element before: `[0]`; or ask for `length`".to_owned(),
                    _ => format!("leave out `.{name}`"),
                },
            });
        };
        let Some(at) = message.members.iter().position(|(known, _)| **known == *name) else {
            return Err(no_such_member(message, name));
        };
        for (before, shape) in &message.members[..at] {
            if shape.wide {
                return Err(wide(&format!("`{before}` before it")));
            }
            self.moves.push(Move::Skip(shape.clone()));
        }
        self.here = message.members[at].1.clone();
        Ok(())
    }

    fn array(&self, what: &str) -> Result<Array, PathError> {
        match &self.here.kind {
            ShapeKind::Array(array) if array.element.wide => Err(wide("the array")),
            ShapeKind::Array(array) => Ok(array.clone()),
            _ => Err(PathError {
                text: format!("{} is no array, so it has no `{what}`", self.here.name()),
                help: format!("leave out `{what}`"),
            }),
        }
    }

    fn choose(&mut self, key: &[Step], value: &str) -> Result<(), PathError> {
        let array = self.array(&format!("[...={value}]"))?;
        let key = Program::compile(&array.element, key, FieldKind::Scalar)?;
        let wanted = match key.leaf {
            Leaf::Text => Wanted::Text(value.into()),
            Leaf::Primitive(primitive) => {
                let number = match (primitive, value) {
                    (Primitive::Bool, "true") => Some(1.0),
                    (Primitive::Bool, "false") => Some(0.0),
                    _ => value.parse().ok(),
                };
                Wanted::Number(number.ok_or_else(|| PathError {
                    text: format!("`{value}` is no number, and the field that is compared with it is"),
                    help: "write a number after `=`".to_owned(),
                })?)
            }
            _ => {
                return Err(PathError {
                    text: format!("what is compared with `{value}` is neither a string nor a number"),
                    help: "name a string or a number before `=`".to_owned(),
                });
            }
        };
        self.here = array.element.clone();
        self.moves.push(Move::Where { array, key: Box::new(key), wanted });
        Ok(())
    }

    pub(super) fn scalar(self) -> Result<Program, PathError> {
        let leaf = match &self.here.kind {
            ShapeKind::Primitive(primitive) => Leaf::Primitive(*primitive),
            ShapeKind::Text => Leaf::Text,
            ShapeKind::WideText => return Err(wide("it")),
            ShapeKind::Message(message) if is_time(message) => Leaf::Time,
            ShapeKind::Message(message) => {
                return Err(PathError {
                    text: format!("{} is no single value", message.type_name),
                    help: format!("go on to one of its fields: {}", names(message)),
                });
            }
            ShapeKind::Array(_) => {
                return Err(PathError {
                    text: "an array is no single value".to_owned(),
                    help: "name an element, `[0]`, or ask for `.length`".to_owned(),
                });
            }
        };
        Ok(Program { moves: self.moves, leaf })
    }

    /// Whatever is here.
    fn content(self) -> Result<Program, PathError> {
        if self.here.wide {
            return Err(wide("it"));
        }
        Ok(Program { moves: self.moves, leaf: Leaf::Content(self.here) })
    }

    /// Goes on into `pose` and `transform` until it reaches a pose.
    fn pose(mut self) -> Result<Program, PathError> {
        loop {
            let here = self.here.clone();
            let inner = match &here.kind {
                ShapeKind::Message(message) if is_pose(message) => {
                    return Ok(Program { moves: self.moves, leaf: Leaf::Pose });
                }
                ShapeKind::Message(message) => ["pose", "transform"]
                    .into_iter()
                    .find(|name| message.members.iter().any(|(it, _)| **it == **name)),
                _ => None,
            };
            let Some(inner) = inner else {
                return Err(PathError {
                    text: format!("{} is no pose", here.name()),
                    help: "name a geometry_msgs Pose or Transform, or what has one as `pose` or `transform`"
                        .to_owned(),
                });
            };
            self.member(inner)?;
        }
    }
}

fn no_such_member(message: &Message, name: &str) -> PathError {
    // A shortened word is closer than a word with other letters: `percent` is not `present`.
    let distance = |known: &str| match name.len() > 3 && known.starts_with(name) {
        true => 0,
        false => strsim::damerau_levenshtein(known, name),
    };
    let distances = message.members.iter().map(|(known, _)| (distance(known), known));
    let close = distances.filter(|(distance, known)| *distance <= 2.max(known.len() / 3)).min();
    let guess = close.map(|(_, known)| format!("did you mean `{known}`? ")).unwrap_or_default();
    PathError {
        text: format!("{} has no field `{name}`", message.type_name),
        help: format!("{guess}it has: {}", names(message)),
    }
}

fn names(message: &Message) -> String {
    let names: Vec<_> = message.members.iter().map(|(name, _)| &**name).collect();
    if names.is_empty() { "none".to_owned() } else { names.join(", ") }
}

fn wide(what: &str) -> PathError {
    PathError {
        text: format!("{what} has a wstring, which implementations of ROS 2 write in different ways"),
        help: "choose a field that stands before it".to_owned(),
    }
}

pub(super) fn is_time(message: &Message) -> bool {
    let known =
        ["builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"].contains(&&*message.type_name);
    known && has_members(message, &[("sec", Primitive::I32), ("nanosec", Primitive::U32)])
}

fn is_pose(message: &Message) -> bool {
    let known = ["geometry_msgs/msg/Pose", "geometry_msgs/msg/Transform"].contains(&&*message.type_name);
    let numbers = |shape: &Shape, names: &[&str]| {
        let members: Vec<_> = names.iter().map(|name| (*name, Primitive::F64)).collect();
        matches!(&shape.kind, ShapeKind::Message(message) if has_members(message, &members))
    };
    match &message.members[..] {
        [(_, at), (_, turned)] => {
            known && numbers(at, &["x", "y", "z"]) && numbers(turned, &["x", "y", "z", "w"])
        }
        _ => false,
    }
}

fn has_members(message: &Message, expected: &[(&str, Primitive)]) -> bool {
    let is = |(name, shape): &(Box<str>, Arc<Shape>), (wanted, primitive): &(&str, Primitive)| {
        **name == **wanted && matches!(shape.kind, ShapeKind::Primitive(it) if it == *primitive)
    };
    message.members.len() == expected.len() && message.members.iter().zip(expected).all(|(a, b)| is(a, b))
}
