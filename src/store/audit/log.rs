//! Where the chain ends, as it is noted outside of the database: in a file beside it, and in the log of the
//! program.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use rusqlite::{Connection, TransactionBehavior};

use super::{Action, Record, TELLTALE, append, hash_of};
use crate::store::head::{HEAD_FILE_NAME, read_head, write_head};
use crate::store::{Head, StoreError};

/// The program's log notes the head after so many records, and at start and end.
const LOG_HEAD_EVERY: u64 = 100;
/// Records after which the head is noted even if more wait to be written.
const HEAD_LAG_MAX: u64 = 64;

/// The head of the chain, as it is noted outside of the database.
#[derive(Debug)]
pub(in crate::store) struct Log {
    /// `None` for a store that ends with the process.
    head_file: Option<PathBuf>,
    /// The record that was written last.
    head: Head,
    /// The one that [`HEAD_FILE_NAME`] names.
    noted: Head,
    logged: u64,
    /// Why the head could not be noted last time.
    fault: Option<String>,
}

impl Log {
    /// Takes up the chain where it ends. If it does not reach what was noted, that becomes a record.
    pub(in crate::store) fn open(
        connection: &mut Connection,
        folder: Option<&Path>,
        wall: SystemTime,
    ) -> Result<Log, StoreError> {
        let head_file = folder.map(|folder| folder.join(HEAD_FILE_NAME));
        let noted = head_file.as_deref().map_or(Ok(None), read_head)?.unwrap_or(Head::NONE);
        let transaction = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
        if noted.number > 0 && hash_of(&transaction, noted.number)? != Some(noted.hash) {
            tracing::error!(%noted, "the audit log is not the one that was noted; `telltale audit verify` says more");
            let record =
                Record::of(Action::ChainBroken, TELLTALE).on(format!("{HEAD_FILE_NAME} said {noted}"));
            append(&transaction, &record, wall)?;
        } else if noted.number == 0 && head_file.is_some() && Head::of(&transaction)?.number > 0 {
            tracing::warn!(
                "{HEAD_FILE_NAME} is missing or no head: whether the audit log is whole cannot be proven"
            );
            let record = Record::of(Action::HeadMissing, TELLTALE);
            append(&transaction, &record.on(format!("{HEAD_FILE_NAME} was gone or no head")), wall)?;
        }
        transaction.commit()?;
        let head = Head::of(connection)?;
        let mut log = Log { head_file, head, noted, logged: head.number, fault: None };
        log.say();
        log.note();
        Ok(log)
    }

    /// Reads where the chain ends, of a database that cannot be written.
    pub(in crate::store) fn read(connection: &Connection, folder: &Path) -> Result<Log, StoreError> {
        let head_file = folder.join(HEAD_FILE_NAME);
        // Where it cannot be read, that is why the database is not written.
        let noted = read_head(&head_file).ok().flatten().unwrap_or(Head::NONE);
        let head = Head::of(connection)?;
        Ok(Log { head_file: Some(head_file), head, noted, logged: head.number, fault: None })
    }

    pub(super) fn noted(&self) -> Vec<Head> {
        vec![self.noted]
    }

    pub(super) fn written(&mut self, head: Head) {
        self.head = head;
        if head.number >= self.logged + LOG_HEAD_EVERY {
            self.say();
        }
        if head.number >= self.noted.number + HEAD_LAG_MAX {
            self.note();
        }
    }

    /// Notes the head in the log of the program.
    pub(in crate::store) fn say(&mut self) {
        self.logged = self.head.number;
        if self.head_file.is_some() && self.head.number > 0 {
            tracing::info!("audit head {}", self.head);
        }
    }

    /// Notes the head beside the database.
    pub(in crate::store) fn note(&mut self) {
        if self.noted == self.head {
            return;
        }
        let written = self.head_file.as_deref().map_or(Ok(()), |file| write_head(file, self.head));
        match written {
            Ok(()) => (self.noted, self.fault) = (self.head, None),
            Err(error) => self.fault = Some(format!("{HEAD_FILE_NAME} cannot be written: {error}")),
        }
    }

    pub(in crate::store) fn fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }
}
