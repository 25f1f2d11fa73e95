//! The file behind a writer. The library formats records into memory; this module brings whole chunks to the
//! disk, so that an error of the disk leaves nothing half written.

use std::fs::{File, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use mcap::{Compression, McapResult, WriteOptions, Writer};

use super::FileError;

/// A vehicle's computer has little time: the fastest level is enough for sensor data.
const COMPRESSION_LEVEL: u32 = 1;

/// A buffer that was larger once is given back.
const BUFFER_KEPT: usize = 8 << 20;

pub(super) struct Output {
    path: PathBuf,
    file: File,
    formatted: Memory,
    /// `None` after an error of the disk.
    writer: Option<Writer<Memory>>,
    /// The length up to which the file is whole.
    whole: u64,
    /// The file's name is surely on the disk.
    named: bool,
}

impl Output {
    /// Creates a file that only its owner may read.
    ///
    /// # Errors
    /// It exists, or the disk refuses it.
    pub fn create(path: &Path, profile: &str, library: &str) -> Result<Output, FileError> {
        let mut options = OpenOptions::new();
        options.write(true).create_new(true);
        std::os::unix::fs::OpenOptionsExt::mode(&mut options, 0o600);
        let file = options.open(path).map_err(|error| FileError::io(path, "created", error))?;
        let formatted = Memory::default();
        let options = WriteOptions::new()
            .profile(profile)
            .library(library)
            .compression(Some(Compression::Zstd))
            .compression_level(COMPRESSION_LEVEL)
            // In the thread of the caller.
            .compression_threads(0)
            .chunk_size(None)
            .disable_seeking(true);
        let writer = options.create(formatted.clone());
        let writer = writer.map_err(|error| FileError::format(path, error.to_string()))?;
        Ok(Output { path: path.to_owned(), file, formatted, writer: Some(writer), whole: 0, named: false })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The length up to which the file can be read now.
    pub fn whole(&self) -> u64 {
        self.whole
    }

    /// Formats records. Nothing of them is in the file before `end_chunk`.
    ///
    /// # Errors
    /// The library refuses them, or an earlier call met an error of the disk.
    pub fn put<T>(&mut self, act: impl FnOnce(&mut Writer<Memory>) -> McapResult<T>) -> Result<T, FileError> {
        let Some(writer) = &mut self.writer else {
            return Err(FileError::format(&self.path, "it was given up after an error"));
        };
        act(writer).map_err(|error| FileError::format(&self.path, error.to_string()))
    }

    /// Everything so far lies in whole chunks in the file.
    ///
    /// # Errors
    /// Of the disk. The file then ends with the last whole chunk and takes nothing more.
    pub fn end_chunk(&mut self) -> Result<(), FileError> {
        self.put(Writer::flush)?;
        self.write()
    }

    fn write(&mut self) -> Result<(), FileError> {
        let mut bytes = self.formatted.lock();
        match self.file.write_all(&bytes.data) {
            Ok(()) => {
                self.whole = bytes.end;
                bytes.data.clear();
                bytes.data.shrink_to(BUFFER_KEPT);
                Ok(())
            }
            Err(error) => {
                drop(bytes);
                self.writer = None;
                // If this fails too, a reader leaves out the part behind the last whole chunk.
                let _ = self.file.set_len(self.whole);
                Err(FileError::io(&self.path, "written", error))
            }
        }
    }

    /// Everything up to the last ended chunk survives a power cut.
    pub fn sync(&mut self) -> Result<(), FileError> {
        self.file.sync_data().map_err(|error| FileError::io(&self.path, "brought to the disk", error))?;
        if !self.named {
            sync_folder_of(&self.path)?;
            self.named = true;
        }
        Ok(())
    }

    /// Completes the file and brings it to the disk. Returns its length.
    pub fn finish(mut self) -> Result<u64, FileError> {
        self.put(Writer::finish)?;
        self.write()?;
        self.file.sync_all().map_err(|error| FileError::io(&self.path, "brought to the disk", error))?;
        sync_folder_of(&self.path)?;
        Ok(self.whole)
    }
}

pub(super) fn sync_folder_of(path: &Path) -> Result<(), FileError> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let synced = File::open(folder).and_then(|folder| folder.sync_all());
    synced.map_err(|error| FileError::io(folder, "brought to the disk", error))
}

/// Takes what the library formats. It never fails, so the library never gives up.
#[derive(Clone, Default)]
pub(super) struct Memory(Arc<Mutex<Formatted>>);

#[derive(Default)]
struct Formatted {
    data: Vec<u8>,
    /// The position in the file behind the data.
    end: u64,
}

impl Memory {
    fn lock(&self) -> MutexGuard<'_, Formatted> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Write for Memory {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let mut formatted = self.lock();
        formatted.data.extend_from_slice(bytes);
        formatted.end += bytes.len() as u64;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Seek for Memory {
    /// Only the present position is known.
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match to {
            SeekFrom::Current(0) => Ok(self.lock().end),
            _ => Err(io::ErrorKind::Unsupported.into()),
        }
    }
}
