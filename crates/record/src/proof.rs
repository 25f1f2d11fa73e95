//! Whether the file of a recording is as it was recorded.

use std::collections::{BTreeMap, VecDeque};
use std::fs::Metadata;
use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::sync::{LazyLock, Mutex, PoisonError};

use super::folder::file_name;
use super::retention::Held;
use super::writer::hash_file;

/// In the audit log, in place of the hash of a recording that has none.
pub const NO_HASH: &str = "unknown";

/// Files whose hashes are remembered.
const HASHES_MAX: usize = 64;

/// Whether a recording is as it was recorded.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Proof {
    Same,
    /// Its SHA-256 is this one.
    Other(String),
    /// The row of the incident is not as the audit log says.
    OtherRow,
    /// It was not compared because of its size.
    TooLarge,
    /// It has no hash, or cannot be read.
    None,
}

impl Proof {
    /// `None`: nothing is known.
    pub fn is_as_recorded(&self) -> Option<bool> {
        match self {
            Proof::Same => Some(true),
            Proof::Other(_) | Proof::OtherRow => Some(false),
            Proof::TooLarge | Proof::None => None,
        }
    }
}

/// The hashes that a recording must have: in its row, and in the audit log.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Expected {
    pub stored: Option<String>,
    pub logged: Option<String>,
    /// The rest of the row is not as the audit log says.
    pub is_row_changed: bool,
}

/// Compares a file, of at most so many bytes, with its hashes. One that did not change since it was compared last is
/// not read again. Blocks.
pub fn compare(path: &Path, expected: &Expected, bytes_max: u64) -> Proof {
    match compare_file(path, expected, bytes_max) {
        Proof::Other(hash) => Proof::Other(hash),
        _ if expected.is_row_changed => Proof::OtherRow,
        proof => proof,
    }
}

fn compare_file(path: &Path, expected: &Expected, bytes_max: u64) -> Proof {
    let expected: Vec<&String> = [&expected.stored, &expected.logged].into_iter().flatten().collect();
    let Ok(meta) = std::fs::symlink_metadata(path) else { return Proof::None };
    if expected.is_empty() || !meta.is_file() {
        return Proof::None;
    }
    if meta.len() > bytes_max {
        return Proof::TooLarge;
    }
    match hash(path, &meta) {
        Ok(found) if expected.iter().all(|it| **it == found) => Proof::Same,
        Ok(found) => Proof::Other(found),
        Err(_) => Proof::None,
    }
}

/// Whether a recording of a folder is not as it was recorded, by its row and these hashes in the audit log. Blocks.
pub fn is_changed(folder: &Path, held: &Held, logged: &BTreeMap<u64, String>) -> bool {
    let logged = logged.get(&held.id).filter(|hash| *hash != NO_HASH).cloned();
    let expected = Expected { stored: held.sha256.clone(), logged, is_row_changed: false };
    matches!(compare(&folder.join(file_name(held.id)), &expected, u64::MAX), Proof::Other(_))
}

/// A file in one state: every change of the file changes the last of these times.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct State {
    device: u64,
    inode: u64,
    bytes: u64,
    modified: (i64, i64),
    changed: (i64, i64),
}

impl State {
    fn of(meta: &Metadata) -> State {
        State {
            device: meta.dev(),
            inode: meta.ino(),
            bytes: meta.len(),
            modified: (meta.mtime(), meta.mtime_nsec()),
            changed: (meta.ctime(), meta.ctime_nsec()),
        }
    }
}

/// The newest at the end.
static HASHES: LazyLock<Mutex<VecDeque<(State, String)>>> = LazyLock::new(Mutex::default);

fn hash(path: &Path, meta: &Metadata) -> io::Result<String> {
    let state = State::of(meta);
    let known = || HASHES.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some((_, hash)) = known().iter().find(|(it, _)| *it == state) {
        return Ok(hash.clone());
    }
    let hash = hash_file(path)?;
    // Unless it was written meanwhile.
    if State::of(&std::fs::symlink_metadata(path)?) == state {
        let mut known = known();
        if known.len() >= HASHES_MAX {
            known.pop_front();
        }
        known.push_back((state, hash.clone()));
    }
    Ok(hash)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_changed_file_is_another_one_whatever_its_times_say() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        std::fs::create_dir_all(folder).unwrap();
        let path = folder.join("a.mcap");
        let none = Expected::default();
        let stored = Some("00".repeat(32));
        assert_eq!(
            compare(&path, &Expected { stored: stored.clone(), ..Expected::default() }, 100),
            Proof::None
        );
        std::fs::write(&path, "recorded").unwrap();
        assert_eq!(compare(&path, &none, 100), Proof::None);
        let right = hash_file(&path).unwrap();
        let expected =
            Expected { stored: Some(right.clone()), logged: Some(right.clone()), is_row_changed: false };
        assert_eq!(compare(&path, &expected, 7), Proof::TooLarge);
        for _ in 0..2 {
            assert_eq!(compare(&path, &expected, 100), Proof::Same);
        }
        // A change of the row does not change the audit log.
        assert_eq!(compare(&path, &Expected { stored, ..expected.clone() }, 100), Proof::Other(right));
        let other_row = Expected { is_row_changed: true, ..expected.clone() };
        assert_eq!(compare(&path, &other_row, 100), Proof::OtherRow);
        let before = std::fs::metadata(&path).unwrap().modified().unwrap();
        // The clock of a file system has steps.
        while compare(&path, &expected, 100) == Proof::Same {
            std::fs::write(&path, "forged!!").unwrap();
            std::fs::File::options().write(true).open(&path).unwrap().set_modified(before).unwrap();
        }
        assert_eq!(compare(&path, &expected, 100), Proof::Other(hash_file(&path).unwrap()));
    }
}
