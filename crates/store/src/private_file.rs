//! Makes files and folders that only their owner may read.

use std::fs::File;
use std::os::unix::fs::{MetadataExt as _, fchown};
use std::path::Path;

/// Makes a folder that only its owner may look into.
pub fn make_folder(folder: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::DirBuilderExt;
    std::fs::DirBuilder::new().recursive(true).mode(0o700).create(folder)
}

/// Makes a file that only its owner may read, whatever the umask: it holds hashes of secrets. An existing
/// file is not opened: closing it would release the locks of this process on it.
pub fn make_private_file(path: &Path) -> std::io::Result<()> {
    let mut options = std::fs::OpenOptions::new();
    options.write(true).create_new(true);
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
