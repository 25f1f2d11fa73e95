//! Finds files of the server that everybody on its machine can read or change, and the command that ends
//! that.

use std::fmt::{self, Display, Formatter};
use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};

use crate::audit::{HEAD_FILE_NAME, KEY_FILE_NAME};
use crate::database::backup;
use crate::{FILE_NAME, HISTORY_FILE};

const READ: u32 = 0o004;
const WRITE: u32 = 0o002;

/// A file, or the data folder, that others can access.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Exposed {
    pub path: PathBuf,
    /// Its permissions.
    pub mode: u32,
    /// The bits of [`READ`] and [`WRITE`] that others should not have.
    excess: u32,
}

/// The files of a data folder, and the key of TLS, that others can read or change. Group permissions do not
/// count: somebody made that group. Nothing is opened, because closing the database would release its
/// locks.
pub fn exposed(folder: &Path, key: Option<&Path>) -> Vec<Exposed> {
    let databases = [FILE_NAME, HISTORY_FILE].into_iter();
    let databases = databases.flat_map(|name| ["", "-wal", "-shm"].map(|end| format!("{name}{end}")));
    let names = databases.chain([KEY_FILE_NAME, HEAD_FILE_NAME].map(str::to_owned));
    let files = names.map(|name| folder.join(name)).chain(backup::list(folder));
    let files = files.chain(key.map(Path::to_owned)).filter_map(|file| look(file, READ | WRITE));
    // Others must not be able to replace its files; seeing their names is harmless.
    look(folder.to_owned(), WRITE).into_iter().chain(files).collect()
}

fn look(path: PathBuf, unwanted: u32) -> Option<Exposed> {
    let mode = fs::metadata(&path).ok()?.permissions().mode() & 0o7777;
    let excess = mode & unwanted;
    (excess != 0).then_some(Exposed { path, mode, excess })
}

impl Display for Exposed {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let (what, bits) = match self.excess {
            READ => ("read", "r"),
            WRITE => ("changed", "w"),
            _ => ("read and changed", "rw"),
        };
        let (path, mode) = (self.path.display(), self.mode);
        write!(
            f,
            "{path} can be {what} by everybody on this machine (mode {mode:03o}): `chmod o-{bits} {path}`"
        )
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn what_everybody_can_read_or_change_is_named_with_its_remedy() {
        let temporary = tempfile::tempdir().unwrap();
        let root = temporary.path();
        let (folder, elsewhere) = (root.join("data"), root.join("key.pem"));
        fs::create_dir_all(folder.join("backups")).unwrap();
        let set =
            |path: &Path, mode: u32| fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
        let make = |path: &Path, mode: u32| {
            fs::write(path, "").unwrap();
            set(path, mode);
        };
        let files =
            ["telltale.db", "telltale.db-wal", "history.db", "audit.head", "backups/telltale-2026-01-02.db"];
        for name in files {
            make(&folder.join(name), 0o600);
        }
        make(&elsewhere, 0o640);
        make(&root.join("audit.key"), 0o600);
        symlink(root.join("audit.key"), folder.join("audit.key")).unwrap();
        // The administrator who makes the folder, or systemd, may let others list it.
        set(&folder, 0o755);
        let said = || exposed(&folder, Some(&elsewhere)).iter().map(ToString::to_string).collect::<Vec<_>>();
        assert!(said().is_empty(), "{:?}", said());
        for name in files {
            make(&folder.join(name), 0o666);
        }
        make(&root.join("audit.key"), 0o602);
        make(&elsewhere, 0o644);
        set(&folder, 0o757);
        let at = |path: &Path, what: &str, mode: &str, bits: &str| {
            let path = path.display();
            format!(
                "{path} can be {what} by everybody on this machine (mode {mode}): `chmod o-{bits} {path}`"
            )
        };
        let mut expected = vec![
            at(&folder, "changed", "757", "w"),
            at(&folder.join("audit.key"), "changed", "602", "w"),
            at(&elsewhere, "read", "644", "r"),
        ];
        expected.extend(files.map(|name| at(&folder.join(name), "read and changed", "666", "rw")));
        expected.sort();
        let mut all = said();
        all.sort();
        assert_eq!(all, expected);
    }
}
