//! The black box: the last minutes of everything that the engine took, and incidents on the disk.

pub mod feed;
pub mod file;
pub mod folder;
pub mod found;
pub mod freeze;
pub mod incident;
mod job;
pub mod journal;
mod latched;
pub mod note_file;
pub mod noticed;
pub mod proof;
pub mod recorder;
pub mod removed;
pub mod retention;
pub mod ring;
pub mod room;
pub mod story;
pub mod summary;
pub mod transition;
pub mod why;
pub mod writer;

/// The version of the program, with the commit that it was built from.
pub const VERSION: &str = env!("TELLTALE_VERSION");
