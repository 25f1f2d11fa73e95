//! Makes files and folders that only their owner may read.

use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{self, Write as _};
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _, OpenOptionsExt as _, fchown};
use std::path::Path;

use crate::input_file;

/// Makes a folder that only its owner may look into.
///
/// # Errors
/// Of the disk.
pub fn make_folder(folder: &Path) -> io::Result<()> {
    DirBuilder::new().recursive(true).mode(0o700).create(folder)
}

/// Makes a file that only its owner may read, also with a wide umask: it holds hashes of secrets. An existing
/// file is not opened: closing it would release the locks of this process on it.
///
/// # Errors
/// Of the disk.
pub fn make_private_file(path: &Path) -> io::Result<()> {
    match OpenOptions::new().write(true).create_new(true).mode(0o600).open(path) {
        Ok(new) => {
            give_to_owner_of(path.parent().unwrap_or(Path::new(".")), &new);
            Ok(())
        }
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => Ok(()),
        Err(error) => Err(error),
    }
}

/// Writes a file that only its owner may read, even if another file was there. After a loss of power the old or
/// the new one is there, whole.
///
/// # Errors
/// Of the disk.
pub fn write_private(path: &Path, content: &[u8]) -> io::Result<()> {
    let new = path.with_added_extension("new");
    let mut file = input_file::replace(&new)?;
    give_to_owner_of(path.parent().unwrap_or(Path::new(".")), &file);
    file.write_all(content)?;
    file.sync_all()?;
    fs::rename(new, path)
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
