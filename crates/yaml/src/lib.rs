//! YAML as a tree in which every value has its place, and problems that point to places.
//!
//! A file is read in one pass that collects every problem, so nobody has to fix a file error by error. serde
//! stops at the first error, so the tree is built from the parser's events.

pub mod decode;
pub mod input_file;
pub mod plain;
pub mod private_file;
pub mod problem;
pub mod schema;
mod slips;
pub mod source;
pub mod tree;

pub use decode::{Log, suggest};
pub use problem::{Problem, Problems};
pub use schema::{KeyDoc, MapDoc, Members, Schema, key, map};
pub use source::{Sources, Span};
pub use tree::{Kind, Node};
