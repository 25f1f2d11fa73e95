//! Why a file of a recording could not be written, read or repaired.

use std::io;
use std::path::{Path, PathBuf};

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
