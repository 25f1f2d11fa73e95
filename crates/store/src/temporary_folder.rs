//! Folders for recordings that end with this process. One that was killed leaves them: the next one removes them.

use std::fs::{self, File};
use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use telltale_yaml::private_file::make_folder;

/// All their names begin with this.
const PREFIX: &str = "telltale-";
/// Their purpose, behind it.
const KINDS: [&str; 2] = ["demo-", "replay-"];

/// A folder that only its owner may read, and that is removed with this.
#[derive(Debug)]
pub struct TemporaryFolder {
    path: PathBuf,
    /// It is locked as long as its process lives.
    _lock: File,
}

impl TemporaryFolder {
    /// For the recordings of a demonstration.
    ///
    /// # Errors
    /// It cannot be made, or the operating system gives no random numbers.
    pub fn for_demo() -> io::Result<TemporaryFolder> {
        TemporaryFolder::make(&std::env::temp_dir(), KINDS[0])
    }

    /// For the last minutes, while a replay opens them.
    ///
    /// # Errors
    /// It cannot be made, or the operating system gives no random numbers.
    pub fn for_replay() -> io::Result<TemporaryFolder> {
        TemporaryFolder::make(&std::env::temp_dir(), KINDS[1])
    }

    fn make(within: &Path, kind: &str) -> io::Result<TemporaryFolder> {
        let mut random = [0; 8];
        getrandom::fill(&mut random).map_err(io::Error::other)?;
        let path = within.join(format!("{PREFIX}{kind}{:016x}", u64::from_le_bytes(random)));
        make_folder(&path)?;
        let lock = File::open(&path)?;
        // Where a folder cannot be locked, no other process can either, and leaves it alone.
        let _ = lock.try_lock();
        Ok(TemporaryFolder { path, _lock: lock })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Removes the folders of processes that were killed.
    pub fn remove_left_over() {
        remove_left_over(&std::env::temp_dir());
    }
}

impl Drop for TemporaryFolder {
    fn drop(&mut self) {
        remove(&self.path);
    }
}

fn remove_left_over(within: &Path) {
    let user = rustix::process::geteuid().as_raw();
    for entry in fs::read_dir(within).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let rest = name.to_str().and_then(|name| name.strip_prefix(PREFIX));
        let random = rest.and_then(|rest| KINDS.iter().find_map(|kind| rest.strip_prefix(kind)));
        if !random.is_some_and(|it| it.len() == 16 && it.bytes().all(|byte| byte.is_ascii_hexdigit())) {
            continue;
        }
        let path = entry.path();
        // Anybody may make a folder or a link of this name there.
        let is_ours = path.symlink_metadata().is_ok_and(|it| it.is_dir() && it.uid() == user);
        if is_ours && File::open(&path).is_ok_and(|folder| folder.try_lock().is_ok()) {
            tracing::info!("{} of a process that was killed is removed", path.display());
            remove(&path);
        }
    }
}

fn remove(path: &Path) {
    if let Err(error) = fs::remove_dir_all(path) {
        tracing::warn!(%error, "the folder {} is not removed", path.display());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_killed_process_left_is_removed_and_nothing_else() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        make_folder(folder).unwrap();
        let [left, other, target] = ["telltale-replay-0011223344556677", "telltale-replay-data", "elsewhere"]
            .map(|name| folder.join(name));
        [&left, &other, &target].into_iter().for_each(|path| fs::create_dir(path).unwrap());
        fs::write(left.join("incident-1.mcap"), "a recording").unwrap();
        let link = folder.join("telltale-demo-8899aabbccddeeff");
        std::os::unix::fs::symlink(&target, &link).unwrap();
        let used = TemporaryFolder::make(folder, KINDS[1]).unwrap();
        remove_left_over(folder);
        assert!(!left.exists() && other.exists() && target.exists() && used.path().exists());
        assert!(link.is_symlink());
        let path = used.path().to_owned();
        drop(used);
        assert!(!path.exists());
    }
}
