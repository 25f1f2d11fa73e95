//! Makes files and folders that only their owner may read.

use std::fs::File;
use std::os::unix::fs::{MetadataExt as _, fchown};
use std::path::Path;

/// Makes a folder that only its owner may look into.
///
/// # Errors
/// If it cannot be made.
#[cfg(unix)]
pub fn make_folder(folder: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::DirBuilderExt;
    std::fs::DirBuilder::new().recursive(true).mode(0o700).create(folder)
}

#[cfg(not(unix))]
pub fn make_folder(folder: &Path) -> std::io::Result<()> {
    std::fs::create_dir_all(folder)
}

/// Makes a file that only its owner may read, whatever the umask: it holds hashes of secrets. An existing
/// file is not opened: closing it would release the locks of this process on it.
pub(super) fn make_private_file(path: &Path) -> std::io::Result<()> {
    let mut options = std::fs::OpenOptions::new();
    options.write(true).create_new(true);
    #[cfg(unix)]
    std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
    match options.open(path) {
        Ok(new) => {
            give_to_owner_of(path.parent().unwrap_or(Path::new(".")), &new);
            Ok(())
        }
        Err(error) if error.kind() == std::io::ErrorKind::AlreadyExists => Ok(()),
        Err(error) => Err(error),
    }
}

/// If root makes a file on the command line, the file gets the owner of its folder or of the file beside it, who
/// must be able to open it.
pub fn give_to_owner_of(beside: &Path, new: &File) {
    if let (Ok(theirs), Ok(ours)) = (beside.metadata(), new.metadata())
        && theirs.uid() != ours.uid()
    {
        // A process without root's rights cannot change the owner, and could make the file as it is.
        let _ = fchown(new, Some(theirs.uid()), Some(theirs.gid()));
    }
}

/// An empty folder for a test, which is removed with the test.
#[cfg(test)]
#[derive(Debug)]
pub struct TestFolder(std::path::PathBuf);

#[cfg(test)]
impl TestFolder {
    pub fn new(name: &str) -> TestFolder {
        // Tests run side by side, and two may choose the same name.
        static NEXT: std::sync::atomic::AtomicU64 = std::sync::atomic::AtomicU64::new(0);
        let (process, number) = (std::process::id(), NEXT.fetch_add(1, std::sync::atomic::Ordering::Relaxed));
        let folder = std::env::temp_dir().join(format!("telltale-{name}-{process}-{number}"));
        let _ = std::fs::remove_dir_all(&folder);
        make_folder(&folder).unwrap();
        TestFolder(folder)
    }
}

#[cfg(test)]
impl std::ops::Deref for TestFolder {
    type Target = Path;

    fn deref(&self) -> &Path {
        &self.0
    }
}

#[cfg(test)]
impl Drop for TestFolder {
    fn drop(&mut self) {
        // If this fails, the folder stays among the temporary files.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}
