//! Makes and reads files and folders that only their owner may read.

use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{self, Read as _, Write as _};
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

/// Why a file with a secret is of no use.
#[derive(Debug)]
pub enum NotPrivate {
    Unreadable(io::Error),
    /// Others may read it too, by its mode.
    Open(u32),
}

/// Reads a file with a secret, which only its owner may read, and no more bytes than this.
///
/// # Errors
/// [`NotPrivate`]
pub fn read_private(path: &Path, bytes_max: u64) -> Result<String, NotPrivate> {
    let file = input_file::open(path).map_err(NotPrivate::Unreadable)?;
    let mode = file.metadata().map_err(NotPrivate::Unreadable)?.mode() & 0o777;
    if mode & 0o077 != 0 {
        return Err(NotPrivate::Open(mode));
    }
    let mut text = String::new();
    file.take(bytes_max).read_to_string(&mut text).map_err(NotPrivate::Unreadable)?;
    Ok(text)
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
