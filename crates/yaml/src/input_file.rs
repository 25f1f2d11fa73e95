//! Opens and writes files in folders where others may write. A pipe or a device may never answer or never end, so only
//! regular files are read. No file is written through a link.

use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;

use rustix::fs::OFlags;

/// Opens a file for reading; a link to a file will do.
///
/// # Errors
/// It cannot be opened. [`io::ErrorKind::InvalidInput`]: it is no regular file.
pub fn open(path: &Path) -> io::Result<File> {
    // Without this flag, a pipe is open only when somebody writes into it. It means nothing for a file.
    let flags = OFlags::NONBLOCK.bits().cast_signed();
    let file = OpenOptions::new().read(true).custom_flags(flags).open(path)?;
    match file.metadata()?.is_file() {
        true => Ok(file),
        false => Err(io::Error::new(io::ErrorKind::InvalidInput, "it is no regular file")),
    }
}

/// Makes a new and empty file that only its owner can read. What was there under its name is removed: it may be a link
/// to a file of somebody else, or a pipe.
///
/// # Errors
/// It cannot be made, or others make something of that name meanwhile.
pub fn replace(path: &Path) -> io::Result<File> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
        _ => {}
    }
    OpenOptions::new().write(true).create_new(true).mode(0o600).open(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Makes a named pipe that nobody writes into.
    fn make_pipe(path: &Path) {
        use rustix::fs::{CWD, FileType, Mode, mknodat};
        mknodat(CWD, path, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap();
    }

    #[test]
    fn what_is_no_regular_file_is_refused_at_once() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let [file, link, pipe] = ["file", "link", "pipe"].map(|name| folder.join(name));
        std::fs::write(&file, "text").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        make_pipe(&pipe);
        assert!(open(&file).is_ok() && open(&link).is_ok());
        for refused in [pipe.as_path(), Path::new("/dev/zero"), folder] {
            assert_eq!(
                open(refused).unwrap_err().kind(),
                io::ErrorKind::InvalidInput,
                "{}",
                refused.display()
            );
        }
        assert_eq!(open(&folder.join("none")).unwrap_err().kind(), io::ErrorKind::NotFound);
    }

    #[test]
    fn what_is_written_goes_through_no_link_and_no_pipe() {
        let temporary = tempfile::tempdir().unwrap();
        let [victim, link, pipe] = ["victim", "link", "pipe"].map(|name| temporary.path().join(name));
        std::fs::write(&victim, "text").unwrap();
        std::os::unix::fs::symlink(&victim, &link).unwrap();
        make_pipe(&pipe);
        for name in [&link, &pipe, &temporary.path().join("none")] {
            io::Write::write_all(&mut replace(name).unwrap(), b"new").unwrap();
            assert!(std::fs::symlink_metadata(name).unwrap().is_file());
            assert_eq!(std::fs::read(name).unwrap(), b"new");
        }
        assert_eq!(std::fs::read(&victim).unwrap(), b"text");
    }
}
