//! Finds the definitions of message types: in the folders of a ROS 2 installation, then among the built-in
//! packages.

use std::collections::{BTreeMap, BTreeSet};
use std::io::{ErrorKind, Read as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::Definitions;
use super::definition::{self, Arity, Base, Constant};
use super::shape::{Message, Shape};
use crate::messages;
use telltale_yaml::input_file;

/// Each message follows a line `=== Name`.
const BUILT_IN: [(&str, &str); 17] = [
    ("action_msgs", include_str!("action_msgs.msgs")),
    ("actionlib_msgs", include_str!("actionlib_msgs.msgs")),
    ("builtin_interfaces", include_str!("builtin_interfaces.msgs")),
    ("diagnostic_msgs", include_str!("diagnostic_msgs.msgs")),
    ("geometry_msgs", include_str!("geometry_msgs.msgs")),
    ("lifecycle_msgs", include_str!("lifecycle_msgs.msgs")),
    ("nav_msgs", include_str!("nav_msgs.msgs")),
    ("rcl_interfaces", include_str!("rcl_interfaces.msgs")),
    ("sensor_msgs", include_str!("sensor_msgs.msgs")),
    ("shape_msgs", include_str!("shape_msgs.msgs")),
    ("std_msgs", include_str!("std_msgs.msgs")),
    ("stereo_msgs", include_str!("stereo_msgs.msgs")),
    ("tf2_msgs", include_str!("tf2_msgs.msgs")),
    ("trajectory_msgs", include_str!("trajectory_msgs.msgs")),
    ("unique_identifier_msgs", include_str!("unique_identifier_msgs.msgs")),
    ("velodyne_msgs", include_str!("velodyne_msgs.msgs")),
    ("visualization_msgs", include_str!("visualization_msgs.msgs")),
];

/// No definition of a message is longer.
const FILE_BYTES_MAX: u64 = 256 << 10;
/// The nesting of messages in messages.
const DEPTH_MAX: usize = 32;
/// The types in one message.
const TYPES_MAX: usize = 500;
/// The definition of a type with all types in it.
const WHOLE_BYTES_MAX: usize = 1 << 20;

/// Resolves the type of one message with all types in it.
pub struct Library<'a> {
    folders: &'a [PathBuf],
    given: &'a BTreeMap<Box<str>, Box<str>>,
    known: BTreeMap<Box<str>, Arc<Shape>>,
    /// From the outermost type inwards.
    open: Vec<Box<str>>,
}

/// The reason why a type cannot be used, and a help.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TypeError {
    pub text: String,
    pub help: String,
}

/// The definitions in a `ros2msg` schema, by the names of their types. The first one is that of `type_name`.
pub fn parts(type_name: &str, whole: &str) -> Vec<(Box<str>, Box<str>)> {
    let (mut parts, mut name, mut text) = (Vec::new(), Some(Box::from(type_name)), String::new());
    let mut end = |name: &mut Option<Box<str>>, text: &mut String| {
        let text = std::mem::take(text);
        parts.extend(name.take().map(|name| (name, text.into_boxed_str())));
    };
    for line in whole.lines() {
        if line.len() >= 20 && line.bytes().all(|byte| byte == b'=') {
            end(&mut name, &mut text);
        } else if name.is_none() {
            // The line behind the separator.
            let found = line.strip_prefix("MSG: ").and_then(|name| name.trim().split_once('/'));
            name = found.map(|(package, name)| {
                format!("{package}/msg/{}", name.strip_prefix("msg/").unwrap_or(name)).into()
            });
        } else {
            text.push_str(line);
            text.push('\n');
        }
    }
    end(&mut name, &mut text);
    parts
}

impl<'a> Library<'a> {
    pub fn new(Definitions { folders, given }: &'a Definitions) -> Library<'a> {
        Library { folders, given, known: BTreeMap::new(), open: Vec::new() }
    }

    /// `type_name` is `package/msg/Name`.
    ///
    /// # Errors
    /// It is not known, or its definition cannot be read.
    pub fn shape(&mut self, type_name: &str) -> Result<Arc<Shape>, TypeError> {
        if let Some(known) = self.known.get(type_name) {
            return Ok(known.clone());
        }
        if self.open.iter().any(|open| **open == *type_name) {
            let circle = self.open.join(", in it ");
            return Err(broken(format!("{type_name} contains itself: {circle}, in it {type_name}")));
        }
        if self.open.len() == DEPTH_MAX || self.known.len() == TYPES_MAX {
            let outermost = self.open.first().map_or(type_name, |open| open);
            return Err(broken(format!("{outermost} is made of too many types within types")));
        }
        let (package, text) = self.text(type_name)?;
        let members = definition::parse(package, &text)
            .map_err(|why| broken(format!("the definition of {type_name} cannot be read: {why}")))?;
        self.open.push(type_name.into());
        let members = members.into_iter().map(|member| {
            let base = match member.base {
                Base::Primitive(primitive) => Arc::new(Shape::primitive(primitive)),
                Base::Text => Arc::new(Shape::text(false)),
                Base::WideText => Arc::new(Shape::text(true)),
                Base::Message(name) => self.shape(&name)?,
            };
            let shape = match member.arity {
                Arity::One => base,
                Arity::Fixed(count) => Arc::new(Shape::array(base, Some(count))),
                Arity::Sequence => Arc::new(Shape::array(base, None)),
            };
            Ok((member.name, shape))
        });
        let members = members.collect::<Result<Vec<_>, TypeError>>()?;
        self.open.pop();
        let shape = Arc::new(Shape::message(Message { type_name: type_name.into(), members }));
        self.known.insert(type_name.into(), shape.clone());
        Ok(shape)
    }

    /// The whole numbers that a type has names for.
    pub fn constants(&self, type_name: &str) -> Vec<Constant> {
        self.text(type_name).map_or_else(|_| Vec::new(), |(_, text)| definition::constants(&text))
    }

    /// The definition of a type, followed by those of all types in it, in the form of `ros2msg` schemas.
    ///
    /// # Errors
    /// One of them is not known or cannot be read, or they are too long together.
    pub fn whole_text(&self, type_name: &str) -> Result<String, TypeError> {
        let (mut whole, mut seen) = (String::new(), BTreeSet::new());
        let mut next: Vec<Box<str>> = vec![type_name.into()];
        while let Some(type_name) = next.pop() {
            if seen.contains(&type_name) {
                continue;
            }
            let (package, text) = self.text(&type_name)?;
            let members = definition::parse(package, &text)
                .map_err(|why| broken(format!("the definition of {type_name} cannot be read: {why}")))?;
            if !seen.is_empty() {
                let name = type_name.rsplit('/').next().unwrap_or_default();
                whole.push_str(&format!("{}\nMSG: {package}/{name}\n", "=".repeat(80)));
            }
            whole.push_str(text.trim_end());
            whole.push('\n');
            let inner = members.into_iter().rev().filter_map(|member| match member.base {
                Base::Message(name) => Some(name),
                Base::Primitive(_) | Base::Text | Base::WideText => None,
            });
            next.extend(inner);
            seen.insert(type_name);
            if seen.len() > TYPES_MAX || whole.len() > WHOLE_BYTES_MAX {
                return Err(broken("the definition is too long".to_owned()));
            }
        }
        Ok(whole)
    }

    /// The error for a missing type of a known package. A type of another package may exist.
    pub fn misnamed(&self, type_name: &str) -> Option<TypeError> {
        let error = self.text(type_name).err()?;
        let (package, name) = type_name.split_once("/msg/")?;
        let within = |folder: &PathBuf| folder.join(package).join("msg");
        let defined = |folder: &PathBuf| within(folder).join(format!("{name}.idl")).is_file();
        let built_in = BUILT_IN.iter().any(|(known, _)| *known == package);
        let known = built_in || self.folders.iter().any(|folder| within(folder).is_dir());
        (known && !self.folders.iter().any(defined)).then_some(error)
    }

    /// The package of a type and the text of its definition.
    fn text<'b>(&self, type_name: &'b str) -> Result<(&'b str, String), TypeError> {
        let whole = messages::dds_type_name(type_name).and_then(|_| type_name.split_once("/msg/"));
        let Some((package, name)) = whole else {
            return Err(TypeError {
                text: format!("{type_name:?} is no type of a message"),
                help: "write it as package/msg/Name: nav_msgs/msg/Odometry".to_owned(),
            });
        };
        if let Some(text) = self.given.get(type_name) {
            return Ok((package, text.clone().into_string()));
        }
        for folder in self.folders {
            let file = folder.join(package).join("msg").join(format!("{name}.msg"));
            if let Some(text) = read(&file)? {
                return Ok((package, text));
            }
        }
        match built_in(package, name) {
            Some(text) => Ok((package, text.to_owned())),
            None => Err(self.unknown(type_name)),
        }
    }

    fn unknown(&self, type_name: &str) -> TypeError {
        let searched = match self.folders {
            [] => "it is not built in, and no folder with definitions is named".to_owned(),
            folders => {
                let folders: Vec<_> = folders.iter().map(|folder| folder.display().to_string()).collect();
                format!("it is not built in, and not in {}", folders.join(", "))
            }
        };
        let inside = match self.open.last() {
            Some(outer) => format!(", which {outer} contains"),
            None => String::new(),
        };
        let help = match similar(type_name) {
            Some(similar) => format!("did you mean {similar}?"),
            None => {
                let (package, name) = type_name.split_once("/msg/").unwrap_or((type_name, "Name"));
                format!(
                    "name the folder `share` of the ROS 2 installation that has {package}/msg/{name}.msg, or source \
                     that installation before the start"
                )
            }
        };
        TypeError { text: format!("the type {type_name}{inside} is not known: {searched}"), help }
    }
}

/// The folder with the definition of a type.
pub fn folder_of<'f>(folders: &'f [PathBuf], type_name: &str) -> Option<&'f Path> {
    let (package, name) = type_name.split_once("/msg/")?;
    let has = |folder: &&PathBuf| folder.join(package).join("msg").join(format!("{name}.msg")).is_file();
    folders.iter().find(has).map(PathBuf::as_path)
}

fn read(file: &Path) -> Result<Option<String>, TypeError> {
    let problem = |why: String| TypeError {
        text: format!("{} cannot be read: {why}", file.display()),
        help: "it has to be a text file with the definition of the message".to_owned(),
    };
    let opened = match input_file::open(file) {
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
            return Ok(None);
        }
        opened => opened.map_err(|error| problem(error.to_string()))?,
    };
    let mut text = String::new();
    opened.take(FILE_BYTES_MAX + 1).read_to_string(&mut text).map_err(|error| problem(error.to_string()))?;
    if text.len() as u64 > FILE_BYTES_MAX {
        return Err(problem(format!("it is longer than {FILE_BYTES_MAX} bytes")));
    }
    Ok(Some(text))
}

fn built_in(package: &str, name: &str) -> Option<&'static str> {
    let (_, text) = BUILT_IN.iter().find(|(known, _)| *known == package)?;
    let found = sections(text).find(|(known, _)| *known == name)?;
    Some(found.1)
}

fn sections(text: &'static str) -> impl Iterator<Item = (&'static str, &'static str)> {
    text.split("=== ").skip(1).map(|section| section.split_once('\n').unwrap_or((section, "")))
}

/// A built-in type with a similar name.
fn similar(type_name: &str) -> Option<String> {
    let all = BUILT_IN
        .iter()
        .flat_map(|(package, text)| sections(text).map(move |(name, _)| format!("{package}/msg/{name}")));
    let close = all.map(|known| (strsim::damerau_levenshtein(&known, type_name), known));
    close.filter(|(distance, _)| *distance <= 3).min().map(|(_, known)| known)
}

fn broken(text: String) -> TypeError {
    TypeError { text, help: "take the definition from the installation that runs on the vehicle".to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_parts_of_a_schema_are_definitions() {
        let whole = Definitions::default().text("nav_msgs/msg/Odometry").unwrap();
        let mut given = Definitions::default();
        given.give("other_msgs/msg/Odometry", &whole);
        let shape = Library::new(&given).shape("other_msgs/msg/Odometry").unwrap();
        assert_eq!(format!("{:?}", shape).matches("other_msgs").count(), 1, "{shape:?}");
        assert_eq!(parts("a/msg/A", "b/B it\n====================\nMSG: b/B\nint8 x\n").len(), 2);
        assert_eq!(
            parts("a/msg/A", "====================\nno name\nint8 x\n"),
            [("a/msg/A".into(), "".into())]
        );
    }

    #[test]
    fn every_built_in_type_is_whole() {
        let mut count = 0;
        for (package, text) in BUILT_IN {
            for (name, _) in sections(text) {
                let type_name = format!("{package}/msg/{name}");
                Library::new(&Definitions::default())
                    .shape(&type_name)
                    .unwrap_or_else(|error| panic!("{type_name}: {error:?}"));
                count += 1;
            }
        }
        assert_eq!(count, 136);
    }

    #[test]
    fn a_whole_definition_has_each_type_in_it_once() {
        let whole =
            |name: &str| Library::new(&Definitions::default()).whole_text(name).map_err(|error| error.text);
        let line = "=".repeat(80);
        assert_eq!(whole("geometry_msgs/msg/Point").unwrap(), "float64 x\nfloat64 y\nfloat64 z\n");
        assert_eq!(
            whole("geometry_msgs/msg/TwistStamped").unwrap(),
            format!(
                "std_msgs/Header header\nTwist twist\n{line}\nMSG: std_msgs/Header\n\
                 builtin_interfaces/Time stamp\nstring frame_id\n{line}\nMSG: builtin_interfaces/Time\n\
                 int32 sec\nuint32 nanosec\n{line}\nMSG: geometry_msgs/Twist\nVector3 linear\n\
                 Vector3 angular\n{line}\nMSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n"
            )
        );
        assert!(whole("my_msgs/msg/Thing").unwrap_err().contains("not known"));
        let folder = std::env::temp_dir().join(format!("telltale-whole-{}", std::process::id()));
        std::fs::create_dir_all(folder.join("a/msg")).unwrap();
        std::fs::write(folder.join("a/msg/Loop.msg"), "Loop[] again\n").unwrap();
        std::fs::write(folder.join("a/msg/Long.msg"), "# long\n".repeat(30_000)).unwrap();
        std::fs::write(folder.join("a/msg/Holder.msg"), "geometry_msgs/Point at # kept\nMissing it\n")
            .unwrap();
        let folders = [folder];
        let whole = |name: &str| Library::new(&Definitions::new(folders.to_vec())).whole_text(name);
        assert_eq!(whole("a/msg/Loop").unwrap(), "Loop[] again\n");
        assert_eq!(whole("a/msg/Long").unwrap().len(), 210_000);
        assert!(whole("a/msg/Holder").unwrap_err().text.contains("a/msg/Missing"));
        std::fs::remove_dir_all(&folders[0]).unwrap();
    }

    #[test]
    fn the_documentation_names_every_package_that_is_built_in() {
        let page = include_str!("../../../../docs/configuration.md");
        for (package, _) in BUILT_IN {
            assert!(page.contains(&format!("`{package}`")), "{package}");
        }
        let asked = ["lifecycle_msgs/msg/TransitionEvent", "action_msgs/msg/GoalStatusArray"];
        let common =
            ["actionlib_msgs/msg/GoalStatusArray", "shape_msgs/msg/Mesh", "stereo_msgs/msg/DisparityImage"];
        let more = ["trajectory_msgs/msg/JointTrajectory", "visualization_msgs/msg/MarkerArray"];
        for type_name in asked.into_iter().chain(common).chain(more) {
            assert!(Library::new(&Definitions::default()).shape(type_name).is_ok(), "{type_name}");
        }
    }

    #[test]
    fn a_wrong_name_in_a_known_package_is_told_from_an_unknown_package() {
        let misnamed =
            |name: &str| Library::new(&Definitions::default()).misnamed(name).map(|error| error.help);
        let meant = "did you mean sensor_msgs/msg/PointCloud2?".to_owned();
        assert_eq!(misnamed("sensor_msgs/msg/PointClod2"), Some(meant));
        assert!(misnamed("sensor_msgs/msg/Smell").is_some_and(|help| help.contains("`share`")));
        for fine in ["sensor_msgs/msg/PointCloud2", "my_msgs/msg/Thing"] {
            assert_eq!(misnamed(fine), None, "{fine}");
        }
    }

    #[test]
    fn unknown_types_are_refused_with_what_to_do() {
        let refused = |folders: &[PathBuf], name: &str| {
            Library::new(&Definitions::new(folders.to_vec())).shape(name).unwrap_err()
        };
        let error = refused(&[], "nav_msgs/msg/Odometri");
        assert_eq!(error.help, "did you mean nav_msgs/msg/Odometry?");
        let error = refused(&["/nowhere".into()], "my_msgs/msg/Thing");
        assert!(error.text.contains("/nowhere") && error.help.contains("my_msgs/msg/Thing.msg"), "{error:?}");
        for name in ["Odometry", "nav_msgs/Odometry", "../msg/x", "a/srv/B", ""] {
            let error = refused(&[], name);
            assert!(error.help.contains("package/msg/Name"), "{name}: {error:?}");
        }
    }
}
