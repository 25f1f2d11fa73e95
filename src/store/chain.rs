//! The hash chain of the audit log: how a record is written for its hash, and who checks it.

use std::fmt;

use rusqlite::{Connection, OptionalExtension, Row};
use sha2::{Digest, Sha256};

use super::StoreError;
use super::audit::{Action, Entry, PRUNED_UP_TO};

/// SHA-256 of a record and of the hash before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Hash(pub(super) [u8; 32]);

impl Hash {
    /// What stands before the first record.
    pub(super) const NONE: Hash = Hash([0; 32]);

    fn parse(text: &str) -> Option<Hash> {
        let digits = text.as_bytes();
        if digits.len() != 64 || !digits.iter().all(u8::is_ascii_hexdigit) {
            return None;
        }
        let mut hash = [0; 32];
        for (byte, pair) in hash.iter_mut().zip(digits.chunks_exact(2)) {
            *byte = u8::from_str_radix(str::from_utf8(pair).ok()?, 16).ok()?;
        }
        Some(Hash(hash))
    }
}

impl fmt::Display for Hash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

/// The last record of a chain, as it is noted elsewhere: `120:9f86d0...`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Head {
    pub number: u64,
    pub hash: Hash,
}

impl Head {
    pub(super) const NONE: Head = Head { number: 0, hash: Hash::NONE };

    /// Reads what [`Head`] writes.
    pub fn parse(text: &str) -> Option<Head> {
        let (number, hash) = text.trim().split_once(':')?;
        Some(Head { number: number.parse().ok()?, hash: Hash::parse(hash)? })
    }

    /// The last record in the database.
    pub(super) fn of(connection: &Connection) -> Result<Head, StoreError> {
        let sql = "SELECT number, hash FROM audit ORDER BY number DESC LIMIT 1";
        let last = connection.prepare_cached(sql)?.query_row([], |row| {
            Ok(Head { number: row.get::<_, i64>(0)?.unsigned_abs(), hash: Hash(row.get(1)?) })
        });
        Ok(last.optional()?.unwrap_or(Head::NONE))
    }
}

impl fmt::Display for Head {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}", self.number, self.hash)
    }
}

/// The hash of a record: every field with its length before it, so that no two records are
/// written alike.
pub(super) fn hash(previous: Hash, number: u64, at_ms: i64, fields: [&str; 6]) -> Hash {
    let mut digest = Sha256::new();
    digest.update(b"telltale audit 1\0");
    digest.update(previous.0);
    digest.update(number.to_be_bytes());
    digest.update(at_ms.to_be_bytes());
    for field in fields {
        digest.update((field.len() as u64).to_be_bytes());
        digest.update(field);
    }
    Hash(digest.finalize().into())
}

/// What is wrong with a chain, and where.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Breach {
    /// The first record that is not as it was written.
    pub number: u64,
    pub what: String,
}

/// What a whole chain is worth.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Verdict {
    /// How many records are there and whole.
    pub records: u64,
    pub head: Head,
    pub breach: Option<Breach>,
    /// The last record that was noted elsewhere: that there were others after it, nobody would know.
    pub proven: u64,
}

/// Goes through a chain from its first record to its last and stops at the first bad one.
#[derive(Debug)]
pub(super) struct Verifier {
    /// Noted elsewhere: the chain must hold these.
    known: Vec<Head>,
    records: u64,
    last: Option<Head>,
    breach: Option<Breach>,
}

impl Verifier {
    pub(super) fn new(mut known: Vec<Head>) -> Verifier {
        known.retain(|head| head.number > 0);
        Verifier { known, records: 0, last: None, breach: None }
    }

    /// Reads the next records, at most `count`; tells whether there may be more.
    pub(super) fn read(&mut self, connection: &Connection, count: u32) -> Result<bool, StoreError> {
        let mut last = match self.last {
            Some(last) => last,
            None => beginning(connection)?,
        };
        let sql = "SELECT number, at_ms, who, role, source, action, target, outcome, hash
                   FROM audit WHERE number > ?1 ORDER BY number LIMIT ?2";
        let mut query = connection.prepare_cached(sql)?;
        let after = if self.last.is_none() { i64::MIN } else { last.number as i64 };
        let mut rows = query.query((after, count))?;
        let mut read = 0;
        while let Some(row) = rows.next()? {
            read += 1;
            if let Err(breach) = self.take(row, &mut last) {
                self.breach = Some(breach);
                return Ok(false);
            }
            self.records += 1;
        }
        self.last = Some(last);
        Ok(read == count)
    }

    fn take(&self, row: &Row<'_>, last: &mut Head) -> Result<(), Breach> {
        let number = last.number + 1;
        let breach = |what: String| Breach { number, what };
        let entry = Entry::read(row).map_err(|error| breach(format!("cannot be read: {error}")))?;
        if entry.number != number {
            return Err(breach(format!("is missing; the next one is {}", entry.number)));
        }
        let hash = hash(last.hash, number, entry.at_ms, entry.fields());
        if hash != entry.hash {
            return Err(breach("is not as it was written, or another one before it was changed".to_owned()));
        }
        if let Some(known) = self.known.iter().find(|known| known.number == number)
            && known.hash != hash
        {
            return Err(breach(format!("is another one than was noted: {known}")));
        }
        if entry.action == Action::ChainBroken.as_str() {
            return Err(breach(format!(
                "was written after the log had been found damaged: {}",
                entry.target
            )));
        }
        *last = Head { number, hash };
        Ok(())
    }

    pub(super) fn verdict(mut self) -> Verdict {
        let head = self.last.unwrap_or(Head::NONE);
        let cut = self.known.iter().filter(|known| known.number > head.number).max_by_key(|it| it.number);
        if let (None, Some(known)) = (&self.breach, cut) {
            let what =
                format!("is missing: the log was cut here; it was noted to reach record {}", known.number);
            self.breach = Some(Breach { number: head.number + 1, what });
        }
        let proven = self.known.iter().map(|known| known.number).filter(|&number| number <= head.number);
        Verdict { records: self.records, head, breach: self.breach, proven: proven.max().unwrap_or(0) }
    }
}

/// What the first record stands on: nothing, or the last of those that were taken away for their
/// age. A record further up in the chain names that one.
fn beginning(connection: &Connection) -> Result<Head, StoreError> {
    let first: Option<i64> = connection.query_row("SELECT min(number) FROM audit", [], |row| row.get(0))?;
    if first.is_none_or(|first| first <= 1) {
        return Ok(Head::NONE);
    }
    let sql = "SELECT target FROM audit WHERE action = ?1 ORDER BY number DESC LIMIT 1";
    let said: Option<String> =
        connection.query_row(sql, [Action::Pruned.as_str()], |row| row.get(0)).optional()?;
    let pruned = said.as_deref().and_then(|said| Head::parse(said.strip_prefix(PRUNED_UP_TO)?));
    Ok(pruned.unwrap_or(Head::NONE))
}
