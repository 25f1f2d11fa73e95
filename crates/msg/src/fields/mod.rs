//! Fields of any message, by their paths: compiled once from the definition of the type, then read directly
//! from the bytes, skipping everything else.
//!
//! A path names fields from the outside inwards, `twist.twist.linear.x`. `[2]` is an element of an array,
//! counted from 0, `[-1]` the last one. `[child_frame_id=base_link]` is the first element with that value; a message without one
//! says nothing about the field, because each broadcaster of `/tf` sends only its own frames. `.length` is
//! the number of elements. `detections[].bbox` are all elements, for lists of positions. A Time or Duration
//! is a number of seconds.

mod content;
mod definition;
mod elements;
mod event;
mod library;
mod path;
mod positions;
mod program;
mod shape;
mod transforms;

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::cdr::{self, Endian, Fault};
pub use event::EventReader;
use library::Library;
use path::Step;
pub use program::NoValue;
use program::{PathError, Program};
use shape::{Shape, ShapeKind};
use telltale_engine::model::monitors::{FieldKind, FieldSpec, ScalarKind, TopicSpec};
use telltale_engine::model::sample::FieldValue;

/// The definitions of messages: first those of a recording, then those in folders, then the built-in packages.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Definitions {
    folders: Vec<PathBuf>,
    /// By `package/msg/Name`.
    given: Arc<BTreeMap<Box<str>, Box<str>>>,
}

/// Types that a recording may define.
const GIVEN_MAX: usize = 10_000;

/// A field of a topic that cannot be read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldsError(pub Vec<FieldError>);

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldError {
    /// The field; `None` if the error concerns the type or its stamp.
    pub path: Option<Box<str>>,
    pub text: String,
    /// What to do.
    pub help: String,
}

impl Definitions {
    /// Each folder is the `share` of a ROS 2 installation or has the same structure:
    /// `FOLDER/package/msg/Name.msg`. The first folder with a type wins; all win over the built-in
    /// definitions.
    pub fn new(folders: Vec<PathBuf>) -> Definitions {
        Definitions { folders, given: Arc::default() }
    }

    /// Adds the schema of a recording, a text as [`Definitions::text`] makes it. The first definition of a type
    /// counts.
    pub fn give(&mut self, type_name: &str, whole: &str) {
        let given = Arc::make_mut(&mut self.given);
        for (name, text) in library::parts(type_name, whole) {
            if given.len() < GIVEN_MAX {
                given.entry(name).or_insert(text);
            }
        }
    }

    /// The folders, then `share` of every sourced ROS 2 installation: `AMENT_PREFIX_PATH`, which `env`
    /// looks up.
    pub fn of_environment(mut folders: Vec<PathBuf>, env: impl Fn(&str) -> Option<String>) -> Definitions {
        let prefixes = env("AMENT_PREFIX_PATH").unwrap_or_default();
        let prefixes = prefixes.split(':').filter(|prefix| !prefix.is_empty());
        folders.extend(prefixes.map(|prefix| Path::new(prefix).join("share")));
        Definitions::new(folders)
    }

    /// With further folders behind the present ones.
    pub fn with(&self, folders: &[PathBuf]) -> Definitions {
        let folders = self.folders.iter().chain(folders).cloned().collect();
        Definitions { folders, given: self.given.clone() }
    }

    /// Compiles a reader for the wanted fields of a topic. If only the arrival of messages matters, the
    /// topic can have any type, unless the type's own package is known and does not have it.
    ///
    /// # Errors
    /// Every field that the type does not have or that has another kind of value, or the unknown type.
    pub fn check(&self, spec: &TopicSpec) -> Result<Reader, FieldsError> {
        let (reader, errors) = self.reader(spec)?;
        if errors.is_empty() { Ok(reader) } else { Err(FieldsError(errors)) }
    }

    /// Whether the arrival of messages of a type can be watched, or else their stamps.
    pub fn knows(&self, type_name: &str, stamp: bool) -> bool {
        let (topic, type_name) = ("".into(), type_name.into());
        self.check(&TopicSpec { topic, type_name, stamp, fields: Vec::new() }).is_ok()
    }

    /// Compiles the readable fields, and returns the errors beside the reader: an unreadable field is
    /// unreadable in every message, and the others have their values.
    ///
    /// # Errors
    /// The type is not known, so nothing can be read.
    pub fn reader(&self, spec: &TopicSpec) -> Result<(Reader, Vec<FieldError>), FieldsError> {
        let of_type = |text, help| FieldError { path: None, text, help };
        if spec.fields.is_empty() && !spec.stamp {
            return match Library::new(self).misnamed(&spec.type_name) {
                Some(error) => Err(FieldsError(vec![of_type(error.text, error.help)])),
                None => Ok((Reader { fields: Vec::new(), stamp: None, whole: None }, Vec::new())),
            };
        }
        let shape = Library::new(self).shape(&spec.type_name);
        let shape = shape.map_err(|error| FieldsError(vec![of_type(error.text, error.help)]))?;
        let mut errors = Vec::new();
        let stamp = spec.stamp.then(|| stamp_of(&shape)).flatten();
        if spec.stamp && stamp.is_none() {
            errors.push(of_type(
                format!("{} has no stamp, so its age cannot be known", spec.type_name),
                "watch a topic whose messages begin with a std_msgs/Header".to_owned(),
            ));
        }
        let fields = spec.fields.iter().map(|field| {
            let named = |program: Program| match field.kind {
                FieldKind::Named => program
                    .named(self.labels(&spec.type_name, &field.path), &field.names)
                    .map_err(|wrong| of_path(&field.path, wrong)),
                _ => Ok(program),
            };
            compile(&shape, field).and_then(named).map_err(|error| {
                let why = error.brief().into();
                errors.push(error);
                why
            })
        });
        let fields = fields.collect();
        let whole = (!shape.wide).then_some(shape);
        Ok((Reader { fields, stamp, whole }, errors))
    }

    /// Whether a message may be of megabytes, as images and point clouds are: it holds bytes without a bound, or its
    /// type is not known.
    pub fn may_be_large(&self, type_name: &str) -> bool {
        Library::new(self).shape(type_name).map_or(true, |shape| shape.bytes)
    }

    /// A reader for a boolean field.
    pub fn boolean(&self, type_name: &str, path: &str) -> Result<BooleanReader, FieldError> {
        let shape = Library::new(self).shape(type_name);
        let shape = shape.map_err(|error| FieldError { path: None, text: error.text, help: error.help })?;
        let program = compile(&shape, &FieldSpec::new(path, FieldKind::Scalar))?;
        if program.kind() == Some(ScalarKind::Bool) {
            return Ok(BooleanReader(program));
        }
        let text = format!("`{path}` of {type_name} is neither true nor false");
        Err(FieldError { path: Some(path.into()), text, help: "name a field of type bool".to_owned() })
    }

    /// The folders that have what is not built in of a type and of the types in it.
    pub fn folders_of(&self, type_name: &str) -> BTreeSet<&Path> {
        let whole = self.text(type_name).unwrap_or_default();
        let built_in = Definitions::default();
        let names = library::parts(type_name, &whole).into_iter().map(|(name, _)| name);
        let strange = names.filter(|name| built_in.text(name).is_none());
        strange.filter_map(|name| library::folder_of(&self.folders, &name)).collect()
    }

    /// The names that the message of a field has for its values, with their numbers: those that begin with the name of
    /// the field, where there are such, or else all of its type. Empty for a field that is no whole number.
    pub fn labels(&self, type_name: &str, path: &str) -> Vec<(Box<str>, i64)> {
        let mut library = Library::new(self);
        let (Ok(mut shape), Ok(steps)) = (library.shape(type_name), path::parse(path)) else {
            return Vec::new();
        };
        let mut last = None;
        for step in &steps {
            let next = match (step, &shape.kind) {
                (Step::Member(name), ShapeKind::Message(message)) => {
                    last = Some((message.type_name.clone(), name.clone()));
                    message.members.iter().find(|(known, _)| known == name).map(|(_, member)| member.clone())
                }
                (Step::Index(_) | Step::Last | Step::Each | Step::Where { .. }, ShapeKind::Array(array)) => {
                    Some(array.element.clone())
                }
                _ => None,
            };
            let Some(next) = next else { return Vec::new() };
            shape = next;
        }
        let (Some((owner, field)), ShapeKind::Primitive(primitive)) = (last, &shape.kind) else {
            return Vec::new();
        };
        let all: Vec<_> =
            library.constants(&owner).into_iter().filter(|it| it.primitive == *primitive).collect();
        let prefix = format!("{}_", field.to_ascii_uppercase());
        let is_named = all.iter().any(|it| it.name.starts_with(&prefix));
        let all = all.into_iter().filter(|it| !is_named || it.name.starts_with(&prefix));
        all.map(|it| (it.name, it.value)).collect()
    }

    /// The definition of a type with those of all types in it, in the form of `ros2msg` schemas: each type
    /// behind the first follows a line of `=` and a line `MSG: package/Name`. `None` if one of them is not
    /// known or cannot be read, or if they have more than 1 MiB together.
    pub fn text(&self, type_name: &str) -> Option<String> {
        Library::new(self).whole_text(type_name).ok()
    }

    /// Judges whether messages follow their type; `None` if the type is not known.
    pub fn event(&self, type_name: &str) -> Option<EventReader> {
        Library::new(self).shape(type_name).ok().and_then(EventReader::of)
    }
}

fn compile(shape: &Arc<Shape>, field: &FieldSpec) -> Result<Program, FieldError> {
    let error = |text, help| FieldError { path: Some(field.path.clone()), text, help };
    let is_whole = field.kind == FieldKind::Content && field.path.is_empty();
    let steps = if is_whole { Ok(Vec::new()) } else { path::parse(&field.path) };
    let steps = steps
        .map_err(|why| error(format!("`{}` is no path of a field: {why}", field.path), PATHS.to_owned()))?;
    Program::compile(shape, &steps, field.kind).map_err(|wrong| of_path(&field.path, wrong))
}

fn of_path(path: &str, PathError { text, help }: PathError) -> FieldError {
    FieldError { path: Some(path.into()), text: format!("`{path}`: {text}"), help }
}

const PATHS: &str = "write the names of fields with dots between them: twist.twist.linear.x";

/// The stamp of the header, if that is the first member; or a Time called `stamp`; or, if a message begins
/// with an array, the stamp of its first element, as in a TFMessage.
fn stamp_of(shape: &Arc<Shape>) -> Option<Program> {
    let ShapeKind::Message(message) = &shape.kind else { return None };
    let (first, first_shape) = message.members.first()?;
    let member = |name: &str| Step::Member(name.into());
    let mut ways = vec![vec![member("stamp")]];
    match &first_shape.kind {
        ShapeKind::Message(header) if *header.type_name == *"std_msgs/msg/Header" => {
            ways.insert(0, vec![member(first), member("stamp")]);
        }
        ShapeKind::Array(_) => {
            ways.push(vec![member(first), Step::Index(0), member("header"), member("stamp")])
        }
        _ => {}
    }
    let mut programs = ways.iter().filter_map(|steps| Program::compile(shape, steps, FieldKind::Scalar).ok());
    programs.find(Program::is_time)
}

/// Reads the fields of one topic.
#[derive(Debug, Clone)]
pub struct Reader {
    /// Each field, or why it has no value.
    fields: Vec<Result<Program, Box<str>>>,
    stamp: Option<Program>,
    /// The type, for noticing a message that is cut behind its fields; `None` if that cannot be judged.
    whole: Option<Arc<Shape>>,
}

impl Reader {
    /// For messages that can be counted and not read.
    pub fn of_nothing(spec: &TopicSpec, why: &FieldsError) -> Reader {
        let why = why.0.first().map(FieldError::brief).unwrap_or_default();
        let fields = spec.fields.iter().map(|_| Err(why.as_str().into())).collect();
        Reader { fields, stamp: None, whole: None }
    }
}

/// The values of one message.
#[derive(Debug, Clone, PartialEq)]
pub struct Reading {
    pub values: Box<[FieldValue]>,
    /// Nanoseconds since 1970 by the publisher's clock.
    pub stamp_ns: Option<i64>,
    /// Where the message does not follow its type. Fields before that have their values.
    pub fault: Option<Fault>,
}

impl Reader {
    /// Reads a body without its encapsulation. Each field has a value or a reason, whatever the body holds.
    /// NaN and infinities are numbers.
    pub fn read(&self, body: &[u8], endian: Endian) -> Reading {
        let reader = cdr::Reader::new(body, endian);
        let mut fault = None;
        let values = self.fields.iter().map(|program| {
            let program = match program {
                Ok(program) => program,
                Err(why) => return FieldValue::Unreadable(why.clone()),
            };
            match program.read(reader.clone()) {
                Ok(value) => value,
                Err(NoValue::Absent) => FieldValue::Absent,
                Err(NoValue::Refused(why)) => FieldValue::Unreadable(why.into()),
                Err(NoValue::Fault(wrong)) => {
                    let why = wrong.to_string().into();
                    fault = Some(wrong);
                    FieldValue::Unreadable(why)
                }
            }
        });
        let values = values.collect();
        let stamp_ns = self.stamp.as_ref().and_then(|stamp| stamp.read_stamp(reader.clone()));
        let mut rest = reader;
        let fault = fault.or_else(|| self.whole.as_ref()?.skip(&mut rest).err());
        Reading { values, stamp_ns, fault }
    }

    /// The kinds of the fields' values, in order; `None` for a pose, and for a missing field.
    pub fn kinds(&self) -> impl Iterator<Item = Option<ScalarKind>> {
        self.fields.iter().map(|program| program.as_ref().ok()?.kind())
    }

    /// The range of each field, in order, if its type has one.
    pub fn ranges(&self) -> impl Iterator<Item = Option<(f64, f64)>> {
        self.fields.iter().map(|program| program.as_ref().ok()?.range())
    }

    /// Only the arrival of messages matters.
    pub fn is_empty(&self) -> bool {
        self.fields.is_empty() && self.stamp.is_none()
    }

    /// The result for a message that cannot be read at all.
    pub fn unreadable(&self, why: &Fault) -> Reading {
        let value = FieldValue::Unreadable(why.to_string().into());
        Reading { values: vec![value; self.fields.len()].into(), stamp_ns: None, fault: Some(why.clone()) }
    }
}

/// Reads one boolean field.
#[derive(Debug, Clone)]
pub struct BooleanReader(Program);

impl BooleanReader {
    pub fn read(&self, body: &[u8], endian: Endian) -> Result<bool, NoValue> {
        match self.0.read(cdr::Reader::new(body, endian))? {
            FieldValue::Bool(value) => Ok(value),
            other => Err(NoValue::Refused(format!("{other:?} is no boolean"))),
        }
    }
}

impl FieldError {
    /// For a known path and a long list of fields: "sensor_msgs/msg/BatteryState has no field `percent`;
    /// did you mean `percentage`?"
    pub fn brief(&self) -> String {
        let path = self.path.as_ref().map(|path| format!("`{path}`: ")).unwrap_or_default();
        let text = self.text.strip_prefix(&*path).unwrap_or(&self.text);
        match self.help.split_once('?') {
            Some((guess, _)) if guess.starts_with("did you mean ") => format!("{text}; {guess}?"),
            _ => text.to_owned(),
        }
    }
}

impl fmt::Display for FieldError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({})", self.text, self.help)
    }
}

impl fmt::Display for FieldsError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let texts: Vec<_> = self.0.iter().map(ToString::to_string).collect();
        f.write_str(&texts.join("; "))
    }
}

impl std::error::Error for FieldsError {}

#[cfg(test)]
mod tests;
