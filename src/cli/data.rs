//! The data folder and its lock.

use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::bail;

use crate::store::make_folder;

/// [`is_held`] takes the lock of a folder for a moment: a display that starts meanwhile tries again.
const HOLD_TRIES: usize = 10;
const HOLD_AGAIN_AFTER: Duration = Duration::from_millis(100);

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
    let mut locked = file.try_lock();
    for _ in 1..HOLD_TRIES {
        if !matches!(locked, Err(TryLockError::WouldBlock)) {
            break;
        }
        std::thread::sleep(HOLD_AGAIN_AFTER);
        locked = file.try_lock();
    }
    match locked {
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

/// Whether a display holds a data folder.
///
/// # Errors
/// If that cannot be found out.
pub fn is_held(folder: &Path) -> io::Result<bool> {
    match File::open(folder)?.try_lock_shared() {
        Ok(()) => Ok(false),
        Err(TryLockError::WouldBlock) => Ok(true),
        Err(TryLockError::Error(error)) => Err(error),
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;

    #[test]
    fn a_display_starts_while_others_look_whether_one_runs() {
        let folder = std::env::temp_dir().join(format!("telltale-held-{}", std::process::id()));
        make_folder(&folder).unwrap();
        let is_over = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !is_over.load(Ordering::Relaxed) {
                    is_held(&folder).unwrap();
                }
            });
            let have_held = (0..20).all(|_| hold(&folder).is_ok_and(|held| held.is_some()));
            is_over.store(true, Ordering::Relaxed);
            assert!(have_held);
        });
        let held = hold(&folder).unwrap();
        assert!(is_held(&folder).unwrap());
        drop(held);
        assert!(!is_held(&folder).unwrap());
        std::fs::remove_dir_all(&folder).unwrap();
        assert!(is_held(&folder).is_err());
    }
}
