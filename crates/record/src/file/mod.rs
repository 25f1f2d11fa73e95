//! MCAP files of incidents. A file is written so that a crash costs at most its last chunk, is read whatever
//! it holds, and is made whole again after a crash.

mod budget;
mod definitions;
mod doctor;
mod entry;
mod json;
mod layout;
mod omission;
mod output;
mod reader;
mod records;
mod repair;
mod source;
mod writer;

use std::io;
use std::path::{Path, PathBuf};

pub use budget::{Budget, SPENT};
pub use definitions::Channel;
pub use doctor::{check, check_bytes};
pub use entry::Entry;
pub use json::{JOURNAL, JsonChannel, KEYFRAMES, TRANSITIONS};
pub use omission::{Missing, Omission, Omissions};
pub use reader::{Place, Reader};
pub use repair::{REPAIRED, Repair, repair};
pub use source::{CHUNK_BYTES_MAX, raw_body};
pub use writer::{IncidentFile, MessageStamps, Topic, Written};

/// The name of the metadata record that describes a file of ours.
pub const ABOUT: &str = "telltale";

/// The name of the metadata record with what was known of an incident when its recording began.
pub const BEGUN: &str = "telltale:begun";

/// The name of the metadata record with what each topic lacks, for want of room.
pub const LEFT_OUT: &str = "telltale:left_out";

/// The schema of a type whose definition is not known.
const UNDEFINED: &str = "# The definition of this type was not known where it was recorded.\n";

/// Why a file of a recording could not be written, read or repaired.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    #[error("{} cannot be {doing}: {why}", path.display())]
    Io { path: PathBuf, doing: &'static str, why: io::Error },
    #[error("{}: {why}", path.display())]
    Format { path: PathBuf, why: String },
}

impl FileError {
    pub fn io(path: &Path, doing: &'static str, why: io::Error) -> FileError {
        FileError::Io { path: path.to_owned(), doing, why }
    }

    pub fn format(path: &Path, why: impl Into<String>) -> FileError {
        FileError::Format { path: path.to_owned(), why: why.into() }
    }

    /// The fault of the disk, if it is one.
    pub fn kind(&self) -> Option<io::ErrorKind> {
        match self {
            FileError::Io { why, .. } => Some(why.kind()),
            FileError::Format { .. } => None,
        }
    }
}

#[cfg(test)]
mod tests;
