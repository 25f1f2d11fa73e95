//! Writes what the ring holds into a file at once, for a look at the last minutes. It is no incident.

use std::path::{Path, PathBuf};

use super::open_file::OpenFile;
use super::{BATCH_BYTES, Place};
use crate::record::file::FileError;
use crate::record::folder::file_name;
use crate::record::recorder::Recorder;

/// Writes the last minutes into a file of this folder, of the vehicle and its definitions at `place`. Blocks.
/// `None` if the ring holds no state of the engine yet.
///
/// # Errors
/// If the disk takes no such file.
pub fn write_recent(recorder: &Recorder, place: &Place, folder: &Path) -> Result<Option<PathBuf>, FileError> {
    let shared = &recorder.0;
    let Some(job) = shared.lock().everything() else { return Ok(None) };
    // All at once, and short locks: a slow disk must not find the rest gone, and the recorder goes on meanwhile.
    let (mut batches, mut next, mut gone) = (Vec::new(), job.begin, 0);
    while job.end.is_some_and(|end| next < end) {
        let (entries, lost) = shared.lock().ring.read(next, BATCH_BYTES);
        if entries.is_empty() {
            break;
        }
        next += lost + entries.len() as u64;
        gone += lost;
        batches.push((entries, lost));
    }
    if gone > 0 {
        tracing::debug!(gone, "the ring lost entries while they were read");
    }
    let place = Place { folder: folder.to_owned(), ..place.clone() };
    let mut file = OpenFile::begin(&place, &job, shared.clock())?;
    for (entries, gone) in &batches {
        file.take(entries, *gone, &place)?;
    }
    file.finish(shared.clock()).1?;
    Ok(Some(folder.join(file_name(job.number))))
}
