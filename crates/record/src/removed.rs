//! Recordings that were removed before the database could record that, because a full disk needed their room first.
//! An empty file stays in the place of each until its removal is recorded, so a crash forgets none.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

use super::folder::{file_in, file_name};

fn path(folder: &Path, id: u64) -> PathBuf {
    folder.join(format!("incident-{id}.removed"))
}

/// Frees the room of a recording. A full disk takes that, because nothing new is written. Blocks.
///
/// # Errors
/// It is no file, or the disk refuses it.
pub fn free(folder: &Path, id: u64) -> io::Result<()> {
    let recording = file_in(folder, &file_name(id)).ok_or(io::ErrorKind::NotFound)?;
    let path = path(folder, id);
    fs::rename(recording, &path)?;
    File::options().write(true).open(path)?.set_len(0)
}

/// The recordings whose removal is not recorded yet. Blocks.
pub fn unrecorded(folder: &Path) -> io::Result<Vec<u64>> {
    let number = |name: &str| -> Option<u64> {
        name.strip_prefix("incident-")?.strip_suffix(".removed")?.parse().ok()
    };
    let mut found = Vec::new();
    for entry in fs::read_dir(folder)? {
        found.extend(entry?.file_name().to_str().and_then(number));
    }
    Ok(found)
}

/// Whether the removal of this one is not recorded yet. Blocks.
pub fn is_unrecorded(folder: &Path, id: u64) -> bool {
    path(folder, id).symlink_metadata().is_ok_and(|it| it.is_file())
}

/// Its removal is recorded. Blocks.
pub fn recorded(folder: &Path, id: u64) -> io::Result<()> {
    fs::remove_file(path(folder, id))
}
