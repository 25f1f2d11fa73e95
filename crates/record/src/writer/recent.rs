//! Writes what the ring holds into a file at once, for a look at the last minutes. It is no incident.

use std::path::{Path, PathBuf};

use super::open_file::OpenFile;
use super::{BATCH_BYTES, Place};
use crate::file::FileError;
use crate::folder::file_name;
use crate::recorder::Recorder;
use crate::room::{FREE_MIN, free_bytes};

/// Writes the last minutes into a file of this folder, of the vehicle and its definitions at `place`. Blocks.
/// `None` if the ring holds no state of the engine yet.
///
/// # Errors
/// If the disk takes no such file.
pub fn write_recent(recorder: &Recorder, place: &Place, folder: &Path) -> Result<Option<PathBuf>, FileError> {
    let shared = &recorder.0;
    let Some(job) = shared.lock().everything() else { return Ok(None) };
    let place = Place { folder: folder.to_owned(), ..place.clone() };
    let most = free_bytes(folder)?.saturating_sub(FREE_MIN);
    let mut file = OpenFile::begin(&place, &job, most, shared.clock())?;
    // A piece after the other: all of it at once would keep a second ring in memory. The oldest is what the ring forgets
    // next, so it is written first; what a slow disk loses is counted in the file.
    while job.end.is_some_and(|end| file.next < end) {
        let (entries, gone) = shared.lock().ring.read(file.next, BATCH_BYTES);
        if entries.is_empty() {
            break;
        }
        file.take(&entries, gone, &place)?;
    }
    file.finish(shared.clock()).1?;
    Ok(Some(folder.join(file_name(job.number))))
}
