//! The files of the database as they lie in the data folder, and what may be wrong with them.
//!
//! Nothing here opens and closes the database. POSIX releases all locks of a process on a file as soon as
//! the process closes any descriptor of it: SQLite would lose its lock on the database without noticing,
//! and the next program that closes the database would delete the log under the server.

use std::fs::File;
use std::io;
use std::mem::ManuallyDrop;
use std::os::unix::fs::{FileExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use crate::FILE_NAME;
use telltale_yaml::private_file::make_folder;

/// The file with the head of the chain, beside the database.
pub const HEAD_FILE_NAME: &str = "audit.head";

/// With less free room than this in the data folder the storage counts as full.
const FREE_BYTES_MIN: u64 = 1 << 20;

const DATABASE_STARTS_WITH: &[u8; 16] = b"SQLite format 3\0";
/// The first four bytes of the log, without the last bit, which gives the order of bytes.
const LOG_STARTS_WITH: u32 = 0x377f_0682;

/// The ends of the names of the files that SQLite makes beside a database.
const BESIDE: [&str; 3] = ["-journal", "-wal", "-shm"];

/// A folder, a pipe, a device, or a link to nothing in the place of a file that SQLite makes beside this database.
/// SQLite would wait for ever for a pipe, and fail at the others.
pub(crate) fn odd_beside(database: &Path) -> Option<PathBuf> {
    let beside = BESIDE.map(|end| {
        let mut path = database.as_os_str().to_owned();
        path.push(end);
        PathBuf::from(path)
    });
    let is_odd =
        |path: &PathBuf| path.symlink_metadata().is_ok() && !path.metadata().is_ok_and(|file| file.is_file());
    beside.into_iter().find(is_odd)
}

/// Moves such things out of the way, before the database is opened.
///
/// # Errors
/// Of the disk: SQLite must not open the database then.
pub(crate) fn put_odd_aside(database: &Path) -> io::Result<()> {
    while let Some(odd) = odd_beside(database) {
        let mut number = 1_u32;
        let mut aside = odd.with_added_extension("odd-1");
        while aside.symlink_metadata().is_ok() {
            number += 1;
            aside = odd.with_added_extension(format!("odd-{number}"));
        }
        std::fs::rename(&odd, &aside)?;
        tracing::error!(
            "{} is no file, and the database needs its place: it is now {}",
            odd.display(),
            aside.display()
        );
    }
    Ok(())
}

/// Moves a database of a data folder, with the files beside it, into a folder of its own. Returns that folder.
pub(crate) fn put_aside(folder: &Path, database: &str, wall: SystemTime) -> io::Result<PathBuf> {
    let day = humantime::format_rfc3339_seconds(wall).to_string().replace(':', "");
    let kept = folder.join(format!("damaged-{day}"));
    make_folder(&kept)?;
    // The log first: it must not be taken for that of the next one.
    for end in BESIDE.into_iter().chain([""]) {
        let name = format!("{database}{end}");
        match std::fs::rename(folder.join(&name), kept.join(&name)) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
    }
    Ok(kept)
}

/// The data folder with the files that were opened in it.
#[derive(Debug)]
pub(crate) struct OpenFiles {
    folder: PathBuf,
    database: Opened,
    log: Opened,
    index: Opened,
}

/// A file as it was when the database was opened.
#[derive(Debug)]
struct Opened {
    path: PathBuf,
    /// `None` if there was none.
    identity: Option<Identity>,
    /// For reading its first bytes. It is never closed, see above.
    file: Option<ManuallyDrop<File>>,
    /// In bytes, at the last look.
    size: u64,
}

/// The file behind a path: its device and its inode.
type Identity = (u64, u64);

impl OpenFiles {
    /// The files as they are just after SQLite has opened them.
    pub(crate) fn new(folder: &Path) -> OpenFiles {
        let opened = |suffix: &str| Opened::new(folder.join(format!("{FILE_NAME}{suffix}")));
        let (database, log) = (opened("").held(), opened("-wal").held());
        OpenFiles { folder: folder.to_owned(), database, log, index: opened("-shm") }
    }

    /// Whether the next start will find what is written now: the files are those that were opened. A
    /// database that is only read has no log of its own.
    pub(crate) fn check_files(&self, is_reading: bool) -> Result<(), String> {
        self.database.check_identity()?;
        self.database.check_start(|start| start.starts_with(DATABASE_STARTS_WITH))?;
        if is_reading {
            return Ok(());
        }
        for file in [&self.log, &self.index] {
            file.check_identity().map_err(|fault| format!("{fault}: restart telltale"))?;
        }
        // Another program may have emptied the log. The next write begins it again.
        if self.log.size_now() == Some(0) {
            return Ok(());
        }
        self.log.check_start(is_log).map_err(|fault| format!("{fault}: restart telltale"))
    }

    /// Whether the content of the log may be taken into the database: both are whole, and no other program
    /// can have begun another log or index, because those are unchanged or gone. A program that opens the
    /// database for reading leaves an empty log where there is none.
    pub(crate) fn can_be_saved(&self) -> bool {
        let is_ours_or_gone = |file: &Opened| identity(&file.path).is_none_or(|it| Some(it) == file.identity);
        self.check_files(true).is_ok()
            && self.log.check_start(is_log).is_ok()
            && (is_ours_or_gone(&self.log) || self.log.size_now() == Some(0))
            && is_ours_or_gone(&self.index)
    }

    /// Whether the database became shorter than its content. It also becomes shorter if another program
    /// vacuums it, but then it holds all pages.
    pub(crate) fn check_size(&mut self, bytes_held: u64) -> Result<(), String> {
        let Some(size) = self.database.size_now() else { return Ok(()) };
        if size < self.database.size && size < bytes_held {
            return Err(format!("the database {} was cut while it was in use", self.database.path.display()));
        }
        self.database.size = size;
        Ok(())
    }

    /// Whether there is enough room to write.
    pub(crate) fn check_room(&self) -> Result<(), String> {
        let folder = self.folder.display();
        let system = rustix::fs::statvfs(&self.folder).map_err(|error| format!("{folder}: {error}"))?;
        if system.f_flag.contains(rustix::fs::StatVfsMountFlags::RDONLY) {
            return Err(format!("the data folder {folder} is read-only"));
        }
        let free = system.f_bavail.saturating_mul(system.f_frsize);
        if free < FREE_BYTES_MIN {
            return Err(format!(
                "the disk of the data folder {folder} is full: {} KiB are free",
                free / 1024
            ));
        }
        Ok(())
    }

    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }
}

impl Opened {
    fn new(path: PathBuf) -> Opened {
        let (identity, size) = (identity(&path), size(&path).unwrap_or(0));
        Opened { path, identity, file: None, size }
    }

    /// With a descriptor for reading its first bytes; a file that cannot be opened has none.
    fn held(mut self) -> Opened {
        self.file = File::open(&self.path).ok().map(ManuallyDrop::new);
        self
    }

    fn check_identity(&self) -> Result<(), String> {
        if self.identity.is_none() || identity(&self.path) == self.identity {
            return Ok(());
        }
        Err(format!("the file {} was removed or replaced while it was in use", self.path.display()))
    }

    fn check_start(&self, is_good: impl FnOnce(&[u8]) -> bool) -> Result<(), String> {
        let Some(file) = &self.file else { return Ok(()) };
        let path = self.path.display();
        let mut start = [0; 16];
        let read = file.read_exact_at(&mut start, 0);
        read.map_err(|error| format!("the file {path} cannot be read: {error}"))?;
        if is_good(&start) { Ok(()) } else { Err(format!("the file {path} was overwritten")) }
    }

    fn size_now(&self) -> Option<u64> {
        size(&self.path)
    }
}

fn is_log(start: &[u8]) -> bool {
    start.first_chunk().map(|it| u32::from_be_bytes(*it) & !1) == Some(LOG_STARTS_WITH)
}

fn identity(path: &Path) -> Option<Identity> {
    let file = std::fs::metadata(path).ok()?;
    Some((file.dev(), file.ino()))
}

fn size(path: &Path) -> Option<u64> {
    Some(std::fs::metadata(path).ok()?.len())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A data folder with the files of a database.
    struct Files(tempfile::TempDir);

    impl Files {
        fn new() -> Files {
            let files = Files(tempfile::tempdir().unwrap());
            files.write("", &[DATABASE_STARTS_WITH.as_slice(), &[0; 100]].concat());
            files.write("-wal", &[&[0x37, 0x7f, 0x06, 0x83], [0; 100].as_slice()].concat());
            files.write("-shm", &[0; 100]);
            files
        }

        fn path(&self, suffix: &str) -> PathBuf {
            self.0.path().join(format!("{FILE_NAME}{suffix}"))
        }

        fn write(&self, suffix: &str, bytes: &[u8]) {
            std::fs::write(self.path(suffix), bytes).unwrap();
        }
    }

    fn fault(files: &OpenFiles) -> String {
        files.check_files(false).unwrap_err()
    }

    #[test]
    fn what_is_no_file_makes_way_for_the_files_of_the_database() {
        use rustix::fs::{CWD, FileType, Mode, mknodat};
        for (end, kind) in
            BESIDE.into_iter().flat_map(|end| ["pipe", "folder", "link"].map(|kind| (end, kind)))
        {
            let temporary = tempfile::tempdir().unwrap();
            let database = temporary.path().join(FILE_NAME);
            let odd = temporary.path().join(format!("{FILE_NAME}{end}"));
            match kind {
                "pipe" => mknodat(CWD, &odd, FileType::Fifo, Mode::RUSR | Mode::WUSR, 0).unwrap(),
                "folder" => {
                    std::fs::create_dir(&odd).unwrap();
                    std::fs::write(odd.join("x"), "x").unwrap();
                }
                _ => std::os::unix::fs::symlink(&odd, &odd).unwrap(),
            }
            assert_eq!(odd_beside(&database), Some(odd.clone()), "{kind}");
            // Something was put aside before.
            std::fs::write(odd.with_added_extension("odd-1"), "kept").unwrap();
            let open = || crate::database::schema::open(temporary.path(), std::time::Duration::ZERO);
            drop(open().unwrap_or_else(|error| panic!("{end} {kind}: {error}")));
            assert!(odd.with_added_extension("odd-2").symlink_metadata().is_ok(), "{end} {kind}");
            assert_eq!(std::fs::read(odd.with_added_extension("odd-1")).unwrap(), b"kept");
            assert_eq!(odd_beside(&database), None, "a link to a file, or a file, stays");
        }
    }

    #[test]
    fn a_file_that_is_gone_or_another_one_is_told() {
        for suffix in ["", "-wal", "-shm"] {
            let folder = Files::new();
            let files = OpenFiles::new(folder.0.path());
            assert_eq!(files.check_files(false), Ok(()));
            let (path, kept) = (folder.path(suffix), folder.0.path().join("kept"));
            std::fs::rename(&path, &kept).unwrap();
            assert!(fault(&files).contains("was removed or replaced"), "{suffix}");
            assert_eq!(files.can_be_saved(), !suffix.is_empty(), "{suffix}");
            std::fs::copy(&kept, &path).unwrap();
            assert!(fault(&files).contains(path.to_str().unwrap()), "{suffix}");
            assert!(!files.can_be_saved(), "{suffix}");
            assert_eq!(files.check_files(true).is_ok(), !suffix.is_empty(), "{suffix}");
            std::fs::rename(&kept, &path).unwrap();
            assert_eq!(files.check_files(false), Ok(()));
        }
    }

    #[test]
    fn a_file_that_is_overwritten_or_cut_is_told() {
        let folder = Files::new();
        let mut files = OpenFiles::new(folder.0.path());
        for (suffix, good) in [("", DATABASE_STARTS_WITH.as_slice()), ("-wal", &[0x37, 0x7f, 0x06, 0x82])] {
            folder.write(suffix, &[b'x'; 100]);
            assert!(fault(&files).contains("was overwritten") && !files.can_be_saved(), "{suffix}");
            folder.write(suffix, &good[..3]);
            assert!(fault(&files).contains("cannot be read"), "{suffix}");
            folder.write(suffix, &[good, &[0; 100]].concat());
            assert_eq!(files.check_files(false), Ok(()));
        }
        folder.write("-wal", b"");
        assert_eq!(files.check_files(false), Ok(()), "another program may empty the log");
        assert_eq!(files.check_size(200), Ok(()), "the log holds the rest");
        folder.write("", &DATABASE_STARTS_WITH[..]);
        assert_eq!(files.check_size(16), Ok(()), "another program tidied it up");
        folder.write("", &[DATABASE_STARTS_WITH.as_slice(), &[0; 100]].concat());
        assert_eq!(files.check_size(116), Ok(()));
        folder.write("", &DATABASE_STARTS_WITH[..]);
        for _ in 0..2 {
            assert!(files.check_size(116).unwrap_err().contains("was cut"));
        }
    }
}
