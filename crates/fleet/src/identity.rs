//! The identity of a vehicle towards the hub: an nkey. Its private part lies in a file that only its owner may read.

use std::fs::OpenOptions;
use std::io::{self, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};

use nkeys::KeyPair;
use telltale_yaml::private_file::{NotPrivate, read_private};

/// Bytes of a file with a key that are read. A key has 58.
const FILE_BYTES_MAX: u64 = 4096;

/// Why a file with a private key is of no use.
#[derive(Debug, thiserror::Error)]
pub enum IdentityError {
    #[error("{}: {reason}", .path.display())]
    Read { path: PathBuf, reason: io::Error },
    #[error(
        "{} may be read by others (mode {mode:o}): take that right away with `chmod 600`, or enrol the vehicle again",
        .path.display()
    )]
    Open { path: PathBuf, mode: u32 },
    #[error("{} holds no private key of a user (nkey): `telltale fleet enrol` makes one", .path.display())]
    NoKey { path: PathBuf },
}

/// The key of a vehicle or a console.
#[derive(Clone)]
pub struct Identity {
    seed: String,
    public: String,
}

impl std::fmt::Debug for Identity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Identity({})", self.public)
    }
}

impl Identity {
    /// Reads the file of a private key.
    ///
    /// # Errors
    /// Others may read it too, or it holds no key.
    pub fn read(path: &Path) -> Result<Identity, IdentityError> {
        let text = read_private(path, FILE_BYTES_MAX).map_err(|why| match why {
            NotPrivate::Unreadable(reason) => IdentityError::Read { path: path.to_owned(), reason },
            NotPrivate::Open(mode) => IdentityError::Open { path: path.to_owned(), mode },
        })?;
        Identity::of(text.trim()).ok_or_else(|| IdentityError::NoKey { path: path.to_owned() })
    }

    /// Makes a key, and its file.
    ///
    /// # Errors
    /// The file is there already, or cannot be made.
    pub fn make(path: &Path) -> io::Result<Identity> {
        let key = KeyPair::new_user();
        let seed = key.seed().map_err(io::Error::other)?;
        let mut file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(path)?;
        file.write_all(format!("{seed}\n").as_bytes())?;
        file.sync_all()?;
        Ok(Identity { seed, public: key.public_key() })
    }

    fn of(seed: &str) -> Option<Identity> {
        let key = KeyPair::from_seed(seed).ok()?;
        let public = key.public_key();
        public.starts_with('U').then(|| Identity { seed: seed.to_owned(), public })
    }

    /// The public key. The hub knows the vehicle by it.
    pub fn public(&self) -> &str {
        &self.public
    }

    pub(crate) fn seed(&self) -> &str {
        &self.seed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs::Permissions;
    use std::os::unix::fs::PermissionsExt as _;

    #[test]
    fn a_key_is_read_only_from_a_file_of_its_owner_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("vehicle.nk");
        let made = Identity::make(&path).unwrap();
        assert_eq!(Identity::read(&path).unwrap().public(), made.public());
        assert!(Identity::make(&path).is_err(), "a key is never overwritten");
        std::fs::set_permissions(&path, Permissions::from_mode(0o640)).unwrap();
        assert!(matches!(Identity::read(&path), Err(IdentityError::Open { mode: 0o640, .. })));
        std::fs::set_permissions(&path, Permissions::from_mode(0o600)).unwrap();
        std::fs::write(&path, "SUAAAA").unwrap();
        assert!(matches!(Identity::read(&path), Err(IdentityError::NoKey { .. })));
        assert!(!format!("{made:?}").contains(made.seed()), "logs do not show it");
    }
}
