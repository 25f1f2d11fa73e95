//! YAML as a tree whose every part knows where it stands, and problems that point there.
//!
//! Files of ours are read in one pass that collects every problem, so nobody mends a file error
//! by error. serde stops at the first; therefore the tree is made from the parser's events.

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
