//! The data folder: the flag `--data` that names it, and its lock.

use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::bail;

use crate::yaml::private_file::make_folder;

/// [`is_locked`] takes the lock of a folder for a moment: a server that starts meanwhile tries again.
const LOCK_TRIES: usize = 10;
const LOCK_AGAIN_AFTER: Duration = Duration::from_millis(100);

/// The flag of the subcommands that use the data folder.
#[derive(Debug, clap::Args)]
pub struct DataFolder {
    /// The folder of users, sessions, the audit log and the history [default: $XDG_DATA_HOME/telltale or ~/.local/share/telltale]
    #[arg(long, value_name = "DIR", global = true)]
    data: Option<PathBuf>,
}

impl DataFolder {
    /// The given folder, or `telltale` in the user's data folder as the XDG base directories name it.
    ///
    /// # Errors
    /// If none is given and the environment names none either.
    pub fn path(&self) -> anyhow::Result<PathBuf> {
        if let Some(folder) = &self.data {
            return Ok(folder.clone());
        }
        // The specification ignores relative paths.
        let absolute = |name| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
        let data = absolute("XDG_DATA_HOME").or_else(|| Some(absolute("HOME")?.join(".local/share")));
        match data {
            Some(data) => Ok(data.join("telltale")),
            None => bail!("no data folder: neither XDG_DATA_HOME nor HOME is set; name one with --data"),
        }
    }
}

/// Locks a data folder for one server, until the returned file is dropped: two servers would overwrite each
/// other's state. The folder itself is locked, so that this works on a full disk. `None` where a folder
/// cannot be locked.
///
/// # Errors
/// If another server has the lock.
pub fn lock(folder: &Path) -> anyhow::Result<Option<File>> {
    // The store says what is wrong with a folder that cannot be made or opened.
    let Ok(file) = make_folder(folder).and_then(|()| File::open(folder)).or_else(|_| File::open(folder))
    else {
        return Ok(None);
    };
    let mut locked = file.try_lock();
    for _ in 1..LOCK_TRIES {
        if !matches!(locked, Err(TryLockError::WouldBlock)) {
            break;
        }
        std::thread::sleep(LOCK_AGAIN_AFTER);
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

/// Whether a server has the lock of a data folder.
///
/// # Errors
/// If that cannot be found out.
pub fn is_locked(folder: &Path) -> io::Result<bool> {
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
    fn a_server_starts_while_others_look_whether_one_runs() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let is_over = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while !is_over.load(Ordering::Relaxed) {
                    is_locked(folder).unwrap();
                }
            });
            let were_locked = (0..20).all(|_| lock(folder).is_ok_and(|lock| lock.is_some()));
            is_over.store(true, Ordering::Relaxed);
            assert!(were_locked);
        });
        let lock = lock(folder).unwrap();
        assert!(is_locked(folder).unwrap());
        drop(lock);
        assert!(!is_locked(folder).unwrap());
        assert!(is_locked(&folder.join("none")).is_err());
    }
}
