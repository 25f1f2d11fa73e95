//! The audit log: who did what, with which outcome, as a chain in which no change, omission or cut goes
//! unnoticed.
//!
//! An action is on the disk before it is done. A record's hash is made with a key outside the database
//! ([`KEY_FILE_NAME`]), so an attacker who can write only the database cannot write a chain that fits. The
//! head of the chain is noted in [`HEAD_FILE_NAME`] and in the program's log, so a cut at the end is found.

mod action;
pub(super) mod chain;
pub(super) mod head;
mod key;
pub(super) mod known;
pub mod limit;
mod log;
mod write;

use std::net::IpAddr;
use std::path::Path;
use std::time::SystemTime;

use rusqlite::{Connection, OptionalExtension, Row, Transaction, params};

pub use super::database::files::HEAD_FILE_NAME;
use super::database::foreign::damage;
use super::database::schema;
use super::database::schema::RECORD_NUMBER_MAX;
use super::{
    Caller, Database, Head, Role, Session, Store, StoreError, Verdict, Verified, incidents_said_again,
};
pub use action::Action;
use chain::{Hash, Verifier};
use head::read_head;
pub use key::KEY_FILE_NAME;
pub(super) use key::Key;
use known::Known;
pub(super) use log::{Log, is_sealed};
use telltale_clock::unix_ms;
pub use write::RECORDED_WITHIN;

/// The number of records that are kept. Beyond it the oldest are pruned, which is recorded.
const RECORDS_MAX: u64 = 1_000_000;
const PRUNE_AT_ONCE: u64 = 1000;
pub(super) const PRUNED_UP_TO: &str = "up to ";

/// A field that is longer is cut.
const FIELD_CHARS_MAX: usize = 300;

/// The length of the reason for acknowledging a breach; the record needs room for the breach as well.
const WHY_CHARS_MAX: usize = 200;

/// The number of records that are verified at once. Other jobs get their turn in between.
const VERIFY_AT_ONCE: u32 = 1000;

/// The source of actions on the command line.
pub const COMMAND_LINE: &str = "command line";
/// The source of actions of the program itself.
pub const TELLTALE: &str = "telltale";

/// A record to be written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Record {
    /// The user's name; empty where nobody is known.
    pub who: String,
    pub role: Option<Role>,
    /// An address, or [`COMMAND_LINE`], or [`TELLTALE`].
    pub source: String,
    pub action: Action,
    /// The object of the action.
    pub target: String,
    /// Why it was refused or failed; `None` if it was done.
    pub refusal: Option<String>,
    /// The caller, if anybody can cause such records: their number is bounded.
    pub by_anybody: Option<Caller>,
}

impl Record {
    /// A record without a user.
    pub fn of(action: Action, source: impl Into<String>) -> Record {
        let (who, target) = (String::new(), String::new());
        let source = source.into();
        Record { who, role: None, source, action, target, refusal: None, by_anybody: None }
    }

    /// The beginning of a record of what the holder of a session did.
    pub fn of_session(session: &Session, action: Action, source: IpAddr) -> Record {
        Record::of(action, source.to_canonical().to_string()).by(&*session.user, session.role)
    }

    pub fn by(mut self, who: impl Into<String>, role: Role) -> Record {
        (self.who, self.role) = (who.into(), Some(role));
        self
    }

    pub fn on(mut self, target: impl Into<String>) -> Record {
        self.target = target.into();
        self
    }

    pub fn refused(mut self, why: impl Into<String>) -> Record {
        self.refusal = Some(why.into());
        self
    }

    /// Bounds the number of such records, by the caller.
    pub fn by_anybody(mut self, caller: Caller) -> Record {
        self.by_anybody = Some(caller);
        self
    }
}

/// A record as it lies in the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    pub number: u64,
    pub at_ms: i64,
    pub who: String,
    pub role: String,
    pub source: String,
    pub action: String,
    pub target: String,
    /// `done`, or `refused: ` and why.
    pub outcome: String,
    pub hash: Hash,
}

impl Entry {
    pub fn was_refused(&self) -> bool {
        self.outcome != DONE
    }

    fn fields(&self) -> [&str; 6] {
        [&self.who, &self.role, &self.source, &self.action, &self.target, &self.outcome]
    }

    /// The hash that the record must have if the record before it has the hash `previous`.
    pub(super) fn sealed(&self, key: Option<&Key>, previous: Hash) -> Hash {
        chain::hash(key, previous, self.number, self.at_ms, self.fields())
    }

    /// A hash of all fields without the record before it, and the record's own hash.
    pub(super) fn content(&self) -> [u8; 64] {
        let mut content = [0; 64];
        content[..32].copy_from_slice(&self.sealed(None, Hash::NONE).0);
        content[32..].copy_from_slice(&self.hash.0);
        content
    }

    pub(super) fn read(row: &Row<'_>) -> rusqlite::Result<Entry> {
        Ok(Entry {
            number: u64::try_from(row.get::<_, i64>(0)?).unwrap_or(0),
            at_ms: row.get(1)?,
            who: row.get(2)?,
            role: row.get(3)?,
            source: row.get(4)?,
            action: row.get(5)?,
            target: row.get(6)?,
            outcome: row.get(7)?,
            hash: Hash(row.get(8)?),
        })
    }
}

pub(super) const DONE: &str = "done";

impl Store {
    /// At most `count` records before number `before`, the newest first.
    pub async fn audit_entries(&self, before: Option<u64>, count: u32) -> Result<Vec<Entry>, StoreError> {
        let before = before.and_then(|before| i64::try_from(before).ok()).unwrap_or(i64::MAX);
        self.call(move |database| {
            // A record that the disk does not take is not in the log.
            let _ = database.write_waiting();
            let sql = "SELECT number, at_ms, who, role, source, action, target, outcome, hash
                       FROM audit WHERE number < ?1 ORDER BY number DESC LIMIT ?2";
            let mut query = database.connection.prepare_cached(sql)?;
            let entries = query.query_map((before, count), Entry::read)?;
            Ok(entries.collect::<Result<_, _>>()?)
        })
        .await
    }

    /// Verifies the whole chain; other jobs get their turn in between.
    pub async fn verify_audit(&self) -> Result<Verdict, StoreError> {
        let begin = |database: &mut Database| {
            // A log in memory is not the log that was asked for.
            database.health.check_keeps()?;
            Ok(Verifier::new(database.log.noted(), Some(database.log.key()?.clone())))
        };
        let mut verifier = self.call(begin).await?;
        loop {
            let more;
            (verifier, more) = self
                .call(move |database| {
                    let more = verifier.read(&database.connection, VERIFY_AT_ONCE)?;
                    Ok((verifier, more))
                })
                .await?;
            if !more {
                return Ok(verifier.verdict(true));
            }
        }
    }

    /// Records that an authority has looked into the breaches of the log. Returns their number; zero if
    /// there is nothing to acknowledge.
    ///
    /// # Errors
    /// If the user is no authority, or the database fails.
    pub async fn acknowledge_breaches(&self, user: &Verified, why: &str) -> Result<u64, StoreError> {
        if user.role() != Role::Authority {
            return Err(StoreError::NoAuthority(user.name().to_owned()));
        }
        let verdict = self.verify_audit().await?;
        if verdict.breaches > 0 {
            let target = format!("{}: {}", cut_to(why, WHY_CHARS_MAX), verdict.evidence);
            let record = Record::of(Action::BreachAcknowledged, COMMAND_LINE).by(user.name(), user.role());
            self.call(move |database| database.change(&[record.on(target)], |_| Ok(()))).await?;
        }
        Ok(verdict.breaches)
    }
}

/// Verifies the chain in a data folder and changes nothing there. The chain must contain the head that lies
/// there and the `heads` that were noted elsewhere. The key is read from `key`, or from the folder.
///
/// # Errors
/// If there is no database, or it or the key cannot be read.
pub fn verify_audit_in(folder: &Path, heads: &[Head], key: Option<&Path>) -> Result<Verdict, StoreError> {
    let (connection, _, _) = schema::read_only(folder, schema::LOCK_WAIT)?;
    let mut known = heads.to_vec();
    // The file with the head is never ahead of the database, so it is read first.
    let noted = read_head(&folder.join(HEAD_FILE_NAME))?;
    known.extend(noted);
    let in_folder = folder.join(KEY_FILE_NAME);
    let key = Key::read(key.unwrap_or(&in_folder))?;
    let mut verifier = Verifier::new(known, key.clone());
    while verifier.read(&connection, VERIFY_AT_ONCE)? {}
    let mut verdict = verifier.verdict(noted.is_some());
    if let Some(key) = &key {
        // One state of the database: a server or a command may change it meanwhile.
        let transaction = connection.unchecked_transaction()?;
        verdict.foreign = Known::read(&transaction, key)?.foreign(&transaction)?;
    }
    Ok(verdict)
}

impl Database {
    /// Makes a change and writes its records in one transaction. Both are on the disk when this returns.
    pub(super) fn change<T>(
        &mut self,
        records: &[Record],
        change: impl FnOnce(&Transaction<'_>) -> Result<T, StoreError>,
    ) -> Result<T, StoreError> {
        self.health.check_keeps()?;
        self.write(records, change)
    }

    /// [`Database::change`] of sessions. With a damaged database's copy in memory, people log in and out all
    /// the same: nobody needs to know of it after a restart.
    pub(super) fn write<T>(
        &mut self,
        records: &[Record],
        change: impl FnOnce(&Transaction<'_>) -> Result<T, StoreError>,
    ) -> Result<T, StoreError> {
        let waiting = self.unwritten.batch(self.clock.now());
        let records = || waiting.records.iter().chain(records);
        if self.health.check_keeps().is_err() {
            for Record { who, source, action, target, refusal, .. } in records() {
                let action = action.as_str();
                tracing::warn!(who, source, action, target, refusal, "in no audit log");
            }
        }
        let wall = self.clock.wall();
        // The end of the chain is read under the lock: another process may write too.
        let transaction = Database::begin(&mut self.connection, &mut self.schema)?;
        let news = if records().next().is_none() { None } else { self.log.check(&transaction)? };
        let value = change(&transaction)?;
        let mut head = None;
        for record in news.iter().chain(records()) {
            head = Some(append(&transaction, self.log.key()?, record, wall)?);
        }
        if let Some(last) = head {
            head = prune(&transaction, self.log.key()?, last, RECORDS_MAX, wall)?.or(head);
        }
        if let Err(fault) = self.health.check_files() {
            transaction.rollback()?;
            // Saves what was acknowledged before it reports that nothing more will be.
            self.check_files()?;
            return Err(fault);
        }
        transaction.commit()?;
        self.unwritten.written(&waiting);
        // A log that was emptied under the server shows once it is written.
        self.check_files()?;
        if let Some(head) = head {
            let matters = |record: &Record| record.refusal.is_none() && record.action.matters();
            self.log.written(head, records().any(matters), news.as_ref());
        }
        Ok(value)
    }
}

fn append(connection: &Connection, key: &Key, record: &Record, wall: SystemTime) -> Result<Head, StoreError> {
    let last = Head::of(connection)?;
    let number = last.number + 1;
    if number > RECORD_NUMBER_MAX {
        return Err(StoreError::Database(damage(&format!(
            "a record of the audit log has the number {}",
            last.number
        ))));
    }
    let at_ms = unix_ms(wall);
    let outcome = record.refusal.as_ref().map_or(DONE.to_owned(), |why| format!("refused: {why}"));
    let [who, source, target, outcome] =
        [&record.who, &record.source, &record.target, &outcome].map(|it| in_field(it));
    let role = record.role.map_or("", Role::as_str);
    let action = record.action.as_str();
    let fields = [who, role, source, action, target, outcome];
    let hash = chain::hash(Some(key), last.hash, number, at_ms, fields);
    connection
        .prepare_cached(
            "INSERT INTO audit (number, at_ms, who, role, source, action, target, outcome, hash)
             VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9)",
        )?
        .execute(params![number as i64, at_ms, who, role, source, action, target, outcome, hash.0])?;
    Ok(Head { number, hash })
}

fn prune(
    connection: &Connection,
    key: &Key,
    last: Head,
    records_max: u64,
    wall: SystemTime,
) -> Result<Option<Head>, StoreError> {
    let first: i64 = connection.query_row("SELECT min(number) FROM audit", [], |row| row.get(0))?;
    let first = first.max(1).unsigned_abs();
    if last.number.saturating_sub(first) < records_max + PRUNE_AT_ONCE {
        return Ok(None);
    }
    let number = first + PRUNE_AT_ONCE - 1;
    let Some(hash) = hash_of(connection, number)? else { return Ok(None) };
    // Users, tokens, incidents and breaches that only these records name stay known.
    let mut said_again = Known::read(connection, key)?.said_again(connection, number)?;
    said_again.extend(incidents_said_again(connection, number)?);
    said_again.extend(chain::breach_said_again(connection, key, number)?);
    connection.execute("DELETE FROM audit WHERE number <= ?1", [number as i64])?;
    let target = format!("{PRUNED_UP_TO}{}", Head { number, hash });
    let mut last = append(connection, key, &Record::of(Action::Pruned, TELLTALE).on(target), wall)?;
    for record in &said_again {
        last = append(connection, key, record, wall)?;
    }
    Ok(Some(last))
}

fn hash_of(connection: &Connection, number: u64) -> Result<Option<Hash>, StoreError> {
    let sql = "SELECT hash FROM audit WHERE number = ?1";
    Ok(connection.query_row(sql, [number as i64], |row| Ok(Hash(row.get(0)?))).optional()?)
}

/// Whether a record has room for this text as a whole.
pub(super) fn fits(text: &str) -> bool {
    in_field(text).len() == text.len()
}

/// As much of a text as a field of a record has room for.
pub(super) fn in_field(text: &str) -> &str {
    cut_to(text, FIELD_CHARS_MAX)
}

fn cut_to(text: &str, chars_max: usize) -> &str {
    text.char_indices().nth(chars_max).map_or(text, |(end, _)| &text[..end])
}

#[cfg(test)]
mod tests;
