//! The file `audit.head` beside the database, which holds the end of the audit log.

use crate::database::files::HEAD_FILE_NAME;
use std::fs::{self, OpenOptions};
use std::io::{self, ErrorKind, Read as _, Write as _};
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};
use telltale_yaml::private_file::give_to_owner_of;

use rustix::fs::OFlags;
use telltale_yaml::input_file;

use crate::{FILE_NAME, Head, StoreError};

/// The bytes of `audit.head` and of `audit.key` that are read. Telltale's own have fewer than 100.
pub(super) const FILE_BYTES_MAX: u64 = 4096;

/// The head in the file; `None` if there is no such file, or no head in it. A file that exists and may not
/// be read is an error: the log must not record it as lost.
pub(crate) fn read_head(file: &Path) -> Result<Option<Head>, StoreError> {
    let mut text = Vec::new();
    match input_file::open(file).and_then(|it| it.take(FILE_BYTES_MAX).read_to_end(&mut text)) {
        Ok(_) => Ok(Head::parse(&String::from_utf8_lossy(&text))),
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(None),
        Err(reason) => Err(StoreError::Head { path: file.to_owned(), whose: whose(file), reason }),
    }
}

/// The owner of a file, and the owner that it should have.
pub(crate) fn whose(file: &Path) -> String {
    let user = rustix::process::geteuid().as_raw();
    fs::metadata(file).map_or(String::new(), |it| {
        let (owner, mode) = (it.uid(), it.mode() & 0o777);
        format!(" (it belongs to the user {owner} with mode {mode:o}, this runs as {user})")
    })
}

/// Removes the temporary file of a process that ended while it wrote the head.
pub(crate) fn remove_leftovers(file: &Path) {
    let entries = file.parent().and_then(|folder| fs::read_dir(folder).ok()).into_iter().flatten().flatten();
    for entry in entries {
        let name = entry.file_name();
        let process = name.to_str().and_then(|name| name.strip_prefix(HEAD_FILE_NAME)?.strip_prefix('.'));
        let Some(process) = process.and_then(|it| it.parse::<u32>().ok()) else { continue };
        // A running process may be writing it now.
        if !Path::new("/proc").join(process.to_string()).exists() {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// The temporary file of this process, which has one store of a folder.
pub(super) fn temporary(file: &Path) -> PathBuf {
    let process = std::process::id();
    // A test has several, each with a thread of its own.
    #[cfg(test)]
    let process = format!("{process}.{:?}", std::thread::current().id());
    file.with_extension(format!("head.{process}"))
}

/// Writes the file atomically, so that a loss of power leaves the old or the new head.
pub(crate) fn write_head(file: &Path, head: Head) -> io::Result<()> {
    let new = temporary(file);
    // A link in its place leads to a file of somebody else.
    let flags = OFlags::NOFOLLOW.bits().cast_signed();
    let mut options = OpenOptions::new();
    options.write(true).create(true).truncate(true).mode(0o600).custom_flags(flags);
    let mut writer = options.open(&new)?;
    writer.write_all(format!("{head}\n").as_bytes())?;
    give_to_owner_of(&file.with_file_name(FILE_NAME), &writer);
    writer.sync_data()?;
    fs::rename(&new, file)
}
