//! Where a vehicle keeps what outlives a restart.

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

use anyhow::bail;

use crate::store::make_folder;

/// The data folder: the one given, else `telltale` in the user's data folder as the XDG base
/// directories name it.
///
/// # Errors
/// If none is given and the environment names none either.
pub fn folder(given: Option<PathBuf>) -> anyhow::Result<PathBuf> {
    if let Some(folder) = given {
        return Ok(folder);
    }
    // The specification ignores relative paths.
    let absolute = |name| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let data = absolute("XDG_DATA_HOME").or_else(|| Some(absolute("HOME")?.join(".local/share")));
    match data {
        Some(data) => Ok(data.join("telltale")),
        None => bail!("no data folder: neither XDG_DATA_HOME nor HOME is set; name one with --data"),
    }
}

/// Keeps every other display from a data folder for as long as the answer is held: each would
/// overwrite what the other remembers. The folder itself is locked, so that it works on a disk that
/// takes nothing more. `None` where a folder cannot be locked.
///
/// # Errors
/// If another display has it.
pub fn hold(folder: &Path) -> anyhow::Result<Option<File>> {
    // The store says what is wrong with a folder that cannot be made or opened.
    let Ok(file) = make_folder(folder).and_then(|()| File::open(folder)).or_else(|_| File::open(folder))
    else {
        return Ok(None);
    };
    match file.try_lock() {
        Ok(()) => Ok(Some(file)),
        Err(TryLockError::WouldBlock) => bail!(
            "another `telltale serve` uses the data folder {}. End that first, or name another folder with --data",
            folder.display()
        ),
        Err(TryLockError::Error(error)) => {
            tracing::warn!(%error, "{} cannot be locked: start no second display on it", folder.display());
            Ok(None)
        }
    }
}
