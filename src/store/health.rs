//! Whether what is acknowledged can still be kept: the disk, the file, and a write every few seconds.

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rusqlite::{Connection, ErrorCode};
use tokio::sync::watch;

use super::audit::Log;
use super::{Database, FILE_NAME, Store, StoreError, schema};
use crate::engine::time::{Span, Timestamp};

const PROBE_EVERY: Span = Span::from_secs(5);

/// With less room than this in the data folder nothing is promised any more.
const FREE_BYTES_MIN: u64 = 1 << 20;

/// What is wrong with the storage, for a developer; `None` while it works.
pub type Fault = Option<Arc<str>>;

impl Store {
    /// What is wrong with the storage, now and whenever it changes.
    pub fn fault(&self) -> watch::Receiver<Fault> {
        self.fault.clone()
    }
}

/// What is watched of the storage.
#[derive(Debug)]
pub(super) struct Health {
    /// The data folder and the file as it was opened; `None` for a store that ends with the process.
    place: Option<Place>,
    fault: watch::Sender<Fault>,
    probed: Option<Timestamp>,
    /// The database is open for reading alone.
    is_reading: bool,
}

#[derive(Debug)]
struct Place {
    folder: PathBuf,
    file: Option<Identity>,
}

impl Health {
    pub(super) fn new(folder: Option<&Path>) -> Health {
        let place =
            folder.map(|folder| Place { folder: folder.to_owned(), file: identity(&folder.join(FILE_NAME)) });
        Health { place, fault: watch::channel(None).0, probed: None, is_reading: false }
    }

    /// The database could be opened for reading alone.
    pub(super) fn cannot_write(&mut self, why: &str) {
        self.is_reading = true;
        self.say(Some(why));
    }

    pub(super) fn watch(&self) -> watch::Receiver<Fault> {
        self.fault.subscribe()
    }

    /// Judges what a job came to: an error of the disk is told at once, not at the next probe. Of a
    /// database that is open for reading alone it is known why.
    pub(super) fn judge(&self, error: &StoreError) {
        if let StoreError::Database(rusqlite::Error::SqliteFailure(failure, _)) = error
            && !self.is_reading
            && matches!(
                failure.code,
                ErrorCode::DiskFull
                    | ErrorCode::ReadOnly
                    | ErrorCode::SystemIoFailure
                    | ErrorCode::DatabaseCorrupt
                    | ErrorCode::NotADatabase
                    | ErrorCode::CannotOpen
            )
        {
            self.say(Some(&error.to_string()));
        }
    }

    /// Whoever else finds something wrong says it here.
    pub(super) fn voice(&self) -> watch::Sender<Fault> {
        self.fault.clone()
    }

    /// Something took too long to be believed: the next probe is due.
    pub(super) fn doubt(&mut self) {
        self.probed = None;
    }

    fn say(&self, fault: Option<&str>) {
        say(&self.fault, fault);
    }
}

pub(super) fn say(voice: &watch::Sender<Fault>, fault: Option<&str>) {
    voice.send_if_modified(|said| {
        if said.as_deref() == fault {
            return false;
        }
        match fault {
            Some(fault) => tracing::error!("nothing can be kept any more: {fault}"),
            None => tracing::info!("what happens is kept again"),
        }
        *said = fault.map(Arc::from);
        true
    });
}

impl Database {
    /// Looks after the storage when it is time to.
    pub(super) fn probe_if_due(&mut self) {
        let now = self.clock.now();
        if self.health.probed.is_some_and(|probed| now.since(probed) < PROBE_EVERY) {
            return;
        }
        let fault = self.check().err();
        self.health.probed = Some(self.clock.now());
        self.health.say(fault.as_deref());
    }

    /// Opens for writing what could only be read so far.
    fn open_again(&mut self) -> Result<(), String> {
        let place = self.health.place.as_ref().filter(|_| self.health.is_reading);
        let Some(Place { folder, .. }) = place else { return Ok(()) };
        let folder = folder.clone();
        // Connections of one process share the log's index, and with it that nothing may be written.
        let nothing = Connection::open_in_memory().map_err(|error| error.to_string())?;
        drop(std::mem::replace(&mut self.connection, nothing));
        let reopened = schema::open(&folder).and_then(|mut connection| {
            let log = Log::open(&mut connection, Some(&folder), self.clock.wall())?;
            Ok((connection, log))
        });
        match reopened {
            Ok((connection, log)) => (self.connection, self.log) = (connection, log),
            Err(error) => {
                self.connection = schema::open_reading(&folder).map_err(|error| error.to_string())?;
                return Err(error.to_string());
            }
        }
        self.health.is_reading = false;
        self.reload_sessions().map_err(|error| error.to_string())
    }

    fn check(&mut self) -> Result<(), String> {
        if let Some(place) = &self.health.place {
            place.check()?;
        }
        self.open_again()?;
        if let Some(fault) = self.log.fault() {
            return Err(fault.to_owned());
        }
        let beat = self.connection.execute("UPDATE beat SET count = count + 1", []);
        beat.map(drop).map_err(|error| format!("the database failed: {error}"))
    }
}

impl Place {
    fn check(&self) -> Result<(), String> {
        let folder = self.folder.display();
        let path = self.folder.join(FILE_NAME);
        let is_same = self.file.is_none() || identity(&path) == self.file;
        if !is_same {
            return Err(format!(
                "the database {} was removed or replaced while it was in use",
                path.display()
            ));
        }
        let mut start = [0; 16];
        let read = std::fs::File::open(&path).and_then(|mut file| file.read_exact(&mut start));
        read.map_err(|error| format!("the database {} cannot be read: {error}", path.display()))?;
        if &start != b"SQLite format 3\0" {
            return Err(format!("the database {} was overwritten", path.display()));
        }
        let system = rustix::fs::statvfs(&self.folder).map_err(|error| format!("{folder}: {error}"))?;
        if system.f_flag.contains(rustix::fs::StatVfsMountFlags::RDONLY) {
            return Err(format!("the data folder {folder} is read-only"));
        }
        let free = system.f_bavail.saturating_mul(system.f_frsize);
        if free < FREE_BYTES_MIN {
            return Err(format!(
                "the disk of the data folder {folder} is full: {} KiB are free",
                free / 1024
            ));
        }
        Ok(())
    }
}

/// The file behind a path.
type Identity = (u64, u64);

fn identity(path: &Path) -> Option<Identity> {
    use std::os::unix::fs::MetadataExt as _;
    let file = std::fs::metadata(path).ok()?;
    Some((file.dev(), file.ino()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_is_gone_or_another_one_or_overwritten_is_told() {
        let folder = std::env::temp_dir().join(format!("telltale-health-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join(FILE_NAME);
        let good = [b"SQLite format 3\0".as_slice(), &[0; 100]].concat();
        std::fs::write(&path, &good).unwrap();
        let health = Health::new(Some(&folder));
        let check = || health.place.as_ref().map(Place::check).unwrap();
        assert_eq!(check(), Ok(()));
        std::fs::write(&path, [b'x'; 100]).unwrap();
        assert!(check().unwrap_err().contains("was overwritten"));
        std::fs::write(&path, b"SQL").unwrap();
        assert!(check().unwrap_err().contains("cannot be read"));
        std::fs::rename(&path, folder.join("kept")).unwrap();
        assert!(check().unwrap_err().contains("was removed or replaced"));
        std::fs::write(&path, &good).unwrap();
        assert!(check().unwrap_err().contains("was removed or replaced"));
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
