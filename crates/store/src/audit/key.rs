//! The key of the audit log. The hash of each record is made with it, so that somebody who can write only
//! the database cannot write a chain that fits. The key lies beside the database, or where a symbolic link
//! of that name leads.

use std::fmt;
use std::fs::{self, File};
use std::io::{self, ErrorKind, Read as _, Write as _};
use std::path::{Path, PathBuf};

use ring::hmac;
use sha2::{Digest as _, Sha256};
use telltale_yaml::input_file;

use super::head::{FILE_BYTES_MAX, whose};
use crate::{FILE_NAME, StoreError};
use telltale_yaml::private_file::{give_to_owner_of, make_private_file};

/// The file of the key, in the data folder.
pub const KEY_FILE_NAME: &str = "audit.key";

/// The key with which records are hashed.
#[derive(Clone)]
pub(crate) struct Key {
    bytes: [u8; 32],
    hmac: hmac::Key,
}

/// Identifies a key without revealing it: the database stores the identifier of its log's key.
pub(crate) type KeyId = [u8; 32];

impl Key {
    pub(super) fn random() -> Result<Key, StoreError> {
        let mut bytes = [0; 32];
        getrandom::fill(&mut bytes).map_err(StoreError::Random)?;
        Ok(Key::new(bytes))
    }

    fn new(bytes: [u8; 32]) -> Key {
        Key { bytes, hmac: hmac::Key::new(hmac::HMAC_SHA256, &bytes) }
    }

    pub(crate) fn id(&self) -> KeyId {
        Sha256::new().chain_update(b"telltale audit key\0").chain_update(self.bytes).finalize().into()
    }

    pub(crate) fn sign(&self, message: &[u8]) -> [u8; 32] {
        let mut signed = [0; 32];
        signed.copy_from_slice(hmac::sign(&self.hmac, message).as_ref());
        signed
    }

    /// Reads a key; `None` if there is no such file, or no key in it.
    ///
    /// # Errors
    /// If it is there and may not be read.
    pub(crate) fn read(file: &Path) -> Result<Option<Key>, StoreError> {
        let text = match input_file::open(file).and_then(|it| io::read_to_string(it.take(FILE_BYTES_MAX))) {
            Ok(text) => text,
            Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::InvalidData) => {
                return Ok(None);
            }
            Err(reason) => return Err(StoreError::Key { path: file.to_owned(), whose: whose(file), reason }),
        };
        Ok(crate::Hash::parse(text.trim()).map(|hash| Key::new(hash.0)))
    }

    /// Writes the key to a temporary name; [`put_in_place`] gives it its own.
    pub(super) fn write_beside(&self, file: &Path) -> Result<(), StoreError> {
        let new = beside(file);
        let write = || -> io::Result<()> {
            // A start that ended too early left this behind.
            match fs::remove_file(&new) {
                Err(error) if error.kind() != ErrorKind::NotFound => return Err(error),
                _ => make_private_file(&new)?,
            }
            let mut writer = File::options().write(true).open(&new)?;
            writer.write_all(format!("{}\n", crate::Hash(self.bytes)).as_bytes())?;
            give_to_owner_of(&file.with_file_name(FILE_NAME), &writer);
            writer.sync_all()
        };
        write().map_err(|reason| StoreError::Folder { path: new.clone(), reason })
    }
}

/// Gives a new key its name once the database refers to it. After a power cut in between, it still has the
/// temporary one.
pub(super) fn put_in_place(file: &Path) -> Result<(), StoreError> {
    fs::rename(beside(file), file).map_err(|reason| StoreError::Folder { path: file.to_owned(), reason })
}

/// A new key that still has its temporary name.
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
