//! The key of the audit log: with it the hash of each record is made, so that nobody who can write the
//! database alone can write a chain that fits. It lies beside the database, or wherever a symbolic link
//! of that name leads.

use std::fmt;
use std::fs::{self, File};
use std::io::{self, ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use ring::hmac;
use sha2::{Digest as _, Sha256};

use super::head::{give_to_owner, whose};
use crate::store::StoreError;
use crate::store::private_file::make_private_file;

/// The key, in the data folder.
pub const KEY_FILE_NAME: &str = "audit.key";

/// The key with which records are hashed.
#[derive(Clone)]
pub(in crate::store) struct Key {
    bytes: [u8; 32],
    hmac: hmac::Key,
}

/// What a key can be told by, without it: the database names that of its log.
pub(in crate::store) type KeyId = [u8; 32];

impl Key {
    pub(super) fn random() -> Result<Key, StoreError> {
        let mut bytes = [0; 32];
        getrandom::fill(&mut bytes).map_err(StoreError::Random)?;
        Ok(Key::new(bytes))
    }

    fn new(bytes: [u8; 32]) -> Key {
        Key { bytes, hmac: hmac::Key::new(hmac::HMAC_SHA256, &bytes) }
    }

    pub(super) fn id(&self) -> KeyId {
        Sha256::new().chain_update(b"telltale audit key\0").chain_update(self.bytes).finalize().into()
    }

    pub(in crate::store) fn sign(&self, message: &[u8]) -> [u8; 32] {
        let mut signed = [0; 32];
        signed.copy_from_slice(hmac::sign(&self.hmac, message).as_ref());
        signed
    }

    /// Reads a key; `None` if there is no such file, or no key in it.
    ///
    /// # Errors
    /// If it is there and may not be read.
    pub(in crate::store) fn read(file: &Path) -> Result<Option<Key>, StoreError> {
        let text = match fs::read_to_string(file) {
            Ok(text) => text,
            Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::InvalidData) => {
                return Ok(None);
            }
            Err(reason) => return Err(StoreError::Key { path: file.to_owned(), whose: whose(file), reason }),
        };
        Ok(crate::store::Hash::parse(text.trim()).map(|hash| Key::new(hash.0)))
    }

    /// Writes it beside the place where it is to lie; [`put_in_place`] takes it there.
    pub(super) fn write_beside(&self, file: &Path) -> Result<(), StoreError> {
        let new = beside(file);
        let write = || -> io::Result<()> {
            // What a start left behind that ended too early.
            match fs::remove_file(&new) {
                Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
                _ => make_private_file(&new)?,
            }
            let mut writer = File::options().write(true).open(&new)?;
            writer.write_all(format!("{}\n", crate::store::Hash(self.bytes)).as_bytes())?;
            give_to_owner(file, &writer);
            writer.sync_all()
        };
        write().map_err(|reason| StoreError::Folder { path: new.clone(), reason })
    }
}

/// Takes a new key to its place once the database names it. A power cut in between leaves it beside.
pub(super) fn put_in_place(file: &Path) -> Result<(), StoreError> {
    fs::rename(beside(file), file).map_err(|reason| StoreError::Folder { path: file.to_owned(), reason })
}

/// A new key that did not come to its place.
pub(super) fn left_beside(file: &Path) -> Result<Option<Key>, StoreError> {
    Key::read(&beside(file))
}

fn beside(file: &Path) -> PathBuf {
    file.with_extension("key.new")
}

impl fmt::Debug for Key {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Key(..)")
    }
}
