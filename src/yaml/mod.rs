//! YAML as a tree in which every value knows its place, and problems that point there.
//!
//! A file is read in one pass that collects every problem, so nobody has to fix a file error by error.
//! serde stops at the first error, so the tree is made from the parser's events.

pub mod decode;
pub mod plain;
pub mod problem;
mod slips;
pub mod source;
pub mod tree;

pub use decode::{Fields, FromNode, Log, Spanned, suggest};
pub use problem::{Problem, Problems};
pub use source::{Sources, Span};
pub use tree::{Kind, Node};
