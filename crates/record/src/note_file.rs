//! The note of people on an incident, in a file beside its recording, so that it outlives the database.
//! The recording itself cannot hold it, because its hash is in the audit log by then.

use std::fs::{self, File};
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use telltale_yaml::private_file::write_private;

/// A larger file is none of ours.
const BYTES_MAX: u64 = 64 << 10;

/// A note on an incident.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Note {
    pub text: String,
    /// The name of the user.
    pub by: String,
    /// Milliseconds since 1970.
    pub at_ms: i64,
}

/// The words of people on an incident.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Beside {
    #[serde(flatten)]
    pub note: Option<Note>,
    /// Whether it is kept; `None` if nobody said so.
    pub kept: Option<bool>,
}

fn path(folder: &Path, id: u64) -> PathBuf {
    folder.join(format!("incident-{id}.note.json"))
}

/// Writes the file in place of the last one. Blocks.
pub fn write(folder: &Path, id: u64, said: &Beside) -> io::Result<()> {
    write_private(&path(folder, id), &serde_json::to_vec(said)?)
}

/// Removes the file, if there is one. Blocks.
pub fn remove(folder: &Path, id: u64) -> io::Result<()> {
    match fs::remove_file(path(folder, id)) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

/// Reads the file; `None` if there is none that can be read. Blocks.
pub fn read(folder: &Path, id: u64) -> Option<Beside> {
    let path = path(folder, id);
    if !fs::symlink_metadata(&path).ok()?.is_file() {
        return None;
    }
    let mut text = Vec::new();
    File::open(path).ok()?.take(BYTES_MAX).read_to_end(&mut text).ok()?;
    serde_json::from_slice(&text).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_is_read_as_it_was_written_last_and_other_files_are_none() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        fs::create_dir_all(folder).unwrap();
        assert_eq!(read(folder, 7), None);
        let note = |text: &str| Some(Note { text: text.into(), by: "dora".into(), at_ms: 5 });
        for (note, kept) in [(note("brake squeals"), false), (note("it was the pad"), true), (None, true)] {
            let said = Beside { note, kept: Some(kept) };
            write(folder, 7, &said).unwrap();
            assert_eq!(read(folder, 7), Some(said));
        }
        let mode =
            std::os::unix::fs::PermissionsExt::mode(&fs::metadata(path(folder, 7)).unwrap().permissions());
        assert_eq!(mode & 0o777, 0o600);
        remove(folder, 7).unwrap();
        remove(folder, 7).unwrap();
        assert_eq!((read(folder, 7), fs::read_dir(folder).unwrap().count()), (None, 0));
        fs::write(path(folder, 8), "{").unwrap();
        fs::create_dir(path(folder, 9)).unwrap();
        assert_eq!((read(folder, 8), read(folder, 9)), (None, None));
        fs::write(path(folder, 8), r#"{"text":"old","by":"dora","at_ms":5}"#).unwrap();
        assert_eq!(read(folder, 8), Some(Beside { note: note("old"), kept: None }));
    }
}
