//! Reads small files of the kernel, and lists folders, within bounds.

use std::fs::File;
use std::io::{ErrorKind, Read as _};
use std::path::Path;

/// The files that are read are shorter.
const FILE_BYTES_MAX: u64 = 64 * 1024;
/// Entries of a folder: processes at most.
const ENTRIES_MAX: usize = 100_000;

/// The fault of a file, in a sentence.
pub(super) fn text(path: &Path) -> Result<String, String> {
    bytes(path).map(|bytes| String::from_utf8_lossy(&bytes).into_owned()).map_err(|error| {
        let hidden =
            error.kind() == ErrorKind::NotFound && ["stat", "meminfo"].iter().any(|it| path.ends_with(it));
        let hint = if hidden { "; if a service hides it, ProcSubset=all shows it" } else { "" };
        format!("{}: {error}{hint}", path.display())
    })
}

pub(super) fn bytes(path: &Path) -> std::io::Result<Vec<u8>> {
    let mut found = Vec::new();
    File::open(path)?.take(FILE_BYTES_MAX).read_to_end(&mut found)?;
    Ok(found)
}

/// The names in a folder, in order; none of a folder that does not exist.
pub(super) fn names(folder: &Path) -> Result<Vec<String>, String> {
    let wrong = |error: std::io::Error| format!("{}: {error}", folder.display());
    let entries = match std::fs::read_dir(folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Vec::new()),
        entries => entries.map_err(wrong)?,
    };
    let mut names = Vec::new();
    for entry in entries {
        if names.len() >= ENTRIES_MAX {
            return Err(format!("{} has more than {ENTRIES_MAX} entries", folder.display()));
        }
        names.push(entry.map_err(wrong)?.file_name().to_string_lossy().into_owned());
    }
    names.sort_unstable();
    Ok(names)
}
