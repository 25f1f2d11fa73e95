//! The end of the chain as it is known outside the database: in memory, in a file beside it, and in the
//! program's log. Each new record must follow it.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use rusqlite::{Connection, OptionalExtension as _, Transaction, TransactionBehavior};

use super::chain::beginning;
use super::head::{read_head, remove_leftovers, write_head};
use super::key::{self, KEY_FILE_NAME, Key, KeyId};
use super::known::as_they_are;
use super::{Action, Entry, Record, TELLTALE, append, hash_of};
use crate::database::files::HEAD_FILE_NAME;
use crate::{Head, StoreError};

/// The program's log gets the head after this many records, even if none of them is important.
const LOG_HEAD_EVERY: u64 = 100;
/// The file gets the head after this many records, even if more wait to be written.
const HEAD_LAG_MAX: u64 = 64;

/// The head of the chain, as it is noted outside the database.
#[derive(Debug)]
pub(crate) struct Log {
    /// `None` for a store in memory.
    head_file: Option<PathBuf>,
    /// `None` if it cannot be read: nothing is written then.
    key: Option<Key>,
    /// The last record that this process wrote.
    head: Head,
    /// The record that [`HEAD_FILE_NAME`] names.
    noted: Head,
    logged: u64,
    /// Why the last attempt to write the head failed.
    fault: Option<String>,
}

impl Log {
    /// Continues the chain where it ends. If it does not reach the noted head, or was written without the
    /// key, that is recorded.
    pub(crate) fn open(
        connection: &mut Connection,
        folder: Option<&Path>,
        wall: SystemTime,
    ) -> Result<Log, StoreError> {
        let head_file = folder.map(|folder| folder.join(HEAD_FILE_NAME));
        let noted = head_file.as_deref().map_or(Ok(None), read_head)?.unwrap_or(Head::NONE);
        if let Some(file) = &head_file {
            remove_leftovers(file);
        }
        let transaction = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
        let last = Head::of(&transaction)?;
        let Keyed { key, news, is_new } = match folder {
            Some(folder) => take_key(&transaction, &folder.join(KEY_FILE_NAME), last)?,
            None => Keyed { key: Key::random()?, news: None, is_new: false },
        };
        let mut news: Vec<Record> = news.into_iter().collect();
        let is_gone = is_new && !news.is_empty();
        if noted.number > 0 && hash_of(&transaction, noted.number)? != Some(noted.hash) {
            news.push(broken(format!("{HEAD_FILE_NAME} said {noted}")));
        } else if noted.number == 0 && head_file.is_some() && last.number > 0 {
            news.push(head_missing());
        }
        if let (Some(folder), true) = (folder, last.number > 0 && news.is_empty()) {
            // An attacker who wrote another chain, with a head that fits, has no key.
            if !is_sealed(&transaction, &key, last.number)? {
                let file = folder.join(KEY_FILE_NAME);
                news.push(broken(format!("record {last} was not written with {}", file.display())));
            }
        }
        for record in &news {
            log_breach(record);
            append(&transaction, &key, record, wall)?;
        }
        if is_gone {
            // Nobody can tell any more which users were known: all are taken as they are. Where a key is there, they are
            // not: the database alone does not say that the key is another one.
            for record in as_they_are(&transaction)? {
                append(&transaction, &key, &record, wall)?;
            }
        }
        transaction.commit()?;
        if let (Some(folder), true) = (folder, is_new) {
            key::put_in_place(&folder.join(KEY_FILE_NAME))?;
        }
        let head = Head::of(connection)?;
        let mut log = Log { head_file, key: Some(key), head, noted, logged: head.number, fault: None };
        log.log_head();
        log.note_head();
        Ok(log)
    }

    /// Reads where the chain ends, from a database that cannot be written.
    pub(crate) fn read(connection: &Connection, folder: &Path) -> Result<Log, StoreError> {
        let head_file = folder.join(HEAD_FILE_NAME);
        // If they cannot be read, that is why the database is not written.
        let noted = read_head(&head_file).ok().flatten().unwrap_or(Head::NONE);
        let key = Key::read(&folder.join(KEY_FILE_NAME)).ok().flatten();
        let head = Head::of(connection)?;
        Ok(Log { head_file: Some(head_file), key, head, noted, logged: head.number, fault: None })
    }

    pub(super) fn noted(&self) -> Vec<Head> {
        vec![self.noted]
    }

    pub(crate) fn key(&self) -> Result<&Key, StoreError> {
        self.key.as_ref().ok_or_else(|| StoreError::Files(format!("{KEY_FILE_NAME} cannot be read")))
    }

    /// Compares, before something is appended, the end of the chain in the database with the record that
    /// was written last and with the noted head. Others may have appended, with the key. Returns the
    /// breaches, which are to be recorded first.
    pub(super) fn check(&self, transaction: &Transaction<'_>) -> Result<Option<Record>, StoreError> {
        let (key, last) = (self.key()?, Head::of(transaction)?);
        if last != self.head && !self.is_continued(transaction, key, last)? {
            return Ok(Some(broken(format!("this program had written up to {}", self.head))));
        }
        let noted = self.head_file.as_deref().map(read_head).transpose();
        Ok(match noted {
            Ok(Some(None)) if self.noted.number > 0 => Some(head_missing()),
            Ok(Some(Some(noted)))
                if noted != self.noted && hash_of(transaction, noted.number)? != Some(noted.hash) =>
            {
                Some(broken(format!("{HEAD_FILE_NAME} said {noted}")))
            }
            // A file that cannot be read shows as an error when it is written.
            _ => None,
        })
    }

    fn is_continued(&self, transaction: &Transaction<'_>, key: &Key, last: Head) -> Result<bool, StoreError> {
        let is_same =
            self.head.number == 0 || hash_of(transaction, self.head.number)? == Some(self.head.hash);
        if !is_same || last.number < self.head.number {
            return Ok(false);
        }
        for number in self.head.number + 1..=last.number {
            if !is_sealed(transaction, key, number)? {
                return Ok(false);
            }
        }
        Ok(true)
    }

    /// The chain now ends there. A record that matters is noted in the program's log at once, and one about
    /// a breach (`news`) also beside the database, so that it is said once.
    pub(super) fn written(&mut self, head: Head, matters: bool, news: Option<&Record>) {
        self.head = head;
        if let Some(news) = news {
            log_breach(news);
            self.note_head();
        }
        if matters || news.is_some() || head.number >= self.logged + LOG_HEAD_EVERY {
            self.log_head();
        }
        if head.number >= self.noted.number + HEAD_LAG_MAX {
            self.note_head();
        }
    }

    /// Writes the head into the program's log.
    pub(crate) fn log_head(&mut self) {
        self.logged = self.head.number;
        if self.head_file.is_some() && self.head.number > 0 {
            tracing::info!("audit head {}", self.head);
        }
    }

    /// Writes the head into the file beside the database.
    pub(crate) fn note_head(&mut self) {
        if self.noted == self.head {
            return;
        }
        let written = self.head_file.as_deref().map_or(Ok(()), |file| write_head(file, self.head));
        match written {
            Ok(()) => (self.noted, self.fault) = (self.head, None),
            Err(error) => self.fault = Some(format!("{HEAD_FILE_NAME} cannot be written: {error}")),
        }
    }

    pub(crate) fn fault(&self) -> Option<&str> {
        self.fault.as_deref()
    }
}

/// The key of a log, and what must be recorded about it.
struct Keyed {
    key: Key,
    news: Option<Record>,
    /// It still has its temporary name.
    is_new: bool,
}

/// Finds the key that the database refers to, or makes that of a new log.
fn take_key(transaction: &Transaction<'_>, file: &Path, last: Head) -> Result<Keyed, StoreError> {
    let sql = "SELECT id FROM audit_key";
    let named: Option<KeyId> = transaction.query_row(sql, [], |row| row.get(0)).optional()?;
    let found = Key::read(file)?;
    let path = file.display();
    if let Some(key) = &found
        && named == Some(key.id())
    {
        return Ok(Keyed { key: key.clone(), news: None, is_new: false });
    }
    let left = key::left_beside(file)?;
    if let (None, Some(key)) = (&found, left)
        && named == Some(key.id())
    {
        return Ok(Keyed { key, news: None, is_new: true });
    }
    let (key, is_new) = match found {
        Some(key) => (key, false),
        None => {
            let key = Key::random()?;
            key.write_beside(file)?;
            (key, true)
        }
    };
    let news = match last.number {
        0 => None,
        _ if is_new => Some(broken(format!("{path} was gone"))),
        _ => Some(broken(format!("the database does not name {path} as its key"))),
    };
    transaction.execute("INSERT OR REPLACE INTO audit_key (one, id) VALUES (1, ?1)", [key.id()])?;
    Ok(Keyed { key, news, is_new })
}

/// Whether a record was written with this key and follows the one before it.
pub(crate) fn is_sealed(connection: &Connection, key: &Key, number: u64) -> Result<bool, StoreError> {
    let sql = "SELECT number, at_ms, who, role, source, action, target, outcome, hash
               FROM audit WHERE number = ?1";
    let entry = connection.prepare_cached(sql)?.query_row([number as i64], Entry::read).optional()?;
    let before = match hash_of(connection, number.saturating_sub(1))? {
        // The first record stands on the last one that was pruned.
        None => Some(beginning(connection)?).filter(|it| it.number + 1 == number).map(|it| it.hash),
        before => before,
    };
    Ok(entry.zip(before).is_some_and(|(entry, before)| entry.sealed(Some(key), before) == entry.hash))
}

fn broken(how: String) -> Record {
    Record::of(Action::ChainBroken, TELLTALE).on(how)
}

fn head_missing() -> Record {
    Record::of(Action::HeadMissing, TELLTALE).on(format!("{HEAD_FILE_NAME} was gone or no head"))
}

fn log_breach(record: &Record) {
    tracing::error!(
        "the audit log is not as it was left: {}; `telltale audit verify` says more, `telltale audit acknowledge` is \
         for an authority who has looked into it",
        record.target
    );
}
