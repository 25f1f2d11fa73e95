//! The hash chain of the audit log: how a record is hashed, and how a chain is verified.

use std::fmt;

use rusqlite::{Connection, OptionalExtension, Row};
use sha2::{Digest, Sha256};

use super::{Action, Entry, Key, PRUNED_UP_TO, Record, TELLTALE, is_sealed};
use crate::{Role, StoreError};
use telltale_engine::text::hex;

/// Breaches that are reported one by one; the others are counted with the last.
const BREACHES_MAX: usize = 1000;

/// The hash of a record, made from the record and the hash of the record before it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Hash(pub(crate) [u8; 32]);

impl Hash {
    /// The hash before the first record.
    pub(crate) const NONE: Hash = Hash([0; 32]);

    pub(crate) fn parse(text: &str) -> Option<Hash> {
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
        f.write_str(&hex(&self.0))
    }
}

/// The last record of a chain, in the form in which it is noted elsewhere: `120:9f86d0...`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Head {
    pub number: u64,
    pub hash: Hash,
}

impl Head {
    pub(crate) const NONE: Head = Head { number: 0, hash: Hash::NONE };

    /// Reads what [`Head`] writes.
    pub fn parse(text: &str) -> Option<Head> {
        let (number, hash) = text.trim().split_once(':')?;
        Some(Head { number: number.parse().ok()?, hash: Hash::parse(hash)? })
    }

    /// The last record in the database.
    pub(crate) fn of(connection: &Connection) -> Result<Head, StoreError> {
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

/// The hash of a record: every field with its length before it, so that no two records are written alike.
/// With a key it is an HMAC-SHA-256, as each record has it; without, a SHA-256.
pub(crate) fn hash(key: Option<&Key>, previous: Hash, number: u64, at_ms: i64, fields: [&str; 6]) -> Hash {
    let mut message = Vec::with_capacity(256);
    message.extend(if key.is_some() { b"telltale audit 2\0" } else { b"telltale audit 1\0" });
    message.extend(previous.0);
    message.extend(number.to_be_bytes());
    message.extend(at_ms.to_be_bytes());
    for field in fields {
        message.extend((field.len() as u64).to_be_bytes());
        message.extend(field.as_bytes());
    }
    Hash(key.map_or_else(|| Sha256::digest(&message).into(), |key| key.sign(&message)))
}

/// A breach: what is wrong with a chain, and where.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Breach {
    /// The first record that is not as it was written, and the last one of such records in a row.
    pub number: u64,
    pub to: u64,
    pub what: String,
}

/// The authority who has looked into the breaches before a record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Acknowledged {
    pub number: u64,
    pub by: String,
    pub at_ms: i64,
    /// How many breaches.
    pub count: u64,
}

/// The result of verifying a whole chain.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Verdict {
    /// The number of intact records.
    pub records: u64,
    pub head: Head,
    /// The first breach that nobody has acknowledged.
    pub breach: Option<Breach>,
    /// The number of breaches that nobody has acknowledged.
    pub breaches: u64,
    pub acknowledged: Option<Acknowledged>,
    /// The last record that a head noted elsewhere proves. Nobody would notice if records after it were cut
    /// off.
    pub proven: u64,
    /// Users and tokens in the database that are in no record: they cannot log in.
    pub foreign: Vec<String>,
    /// A hash of all breaches within the chain, which an authority acknowledges. It changes with each of
    /// them.
    pub(crate) evidence: Hash,
}

/// Kinds of breaches, as [`Verdict::evidence`] tells them apart. Numbers are never reused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum BreachKind {
    Missing = 1,
    Changed = 2,
    Found = 3,
    Unreadable = 4,
    Extra = 5,
}

/// Verifies a chain from its first record to its last.
#[derive(Debug)]
pub(crate) struct Verifier {
    /// Heads that were noted elsewhere: the chain must contain them.
    known: Vec<Head>,
    key: Option<Key>,
    records: u64,
    last: Option<Head>,
    /// Breaches within the chain, which an authority can acknowledge.
    open: Vec<Breach>,
    last_kind: Option<BreachKind>,
    evidence: Sha256,
    acknowledged: Option<Acknowledged>,
    /// Breaches against heads that were noted elsewhere.
    against: Option<Breach>,
}

impl Verifier {
    pub(crate) fn new(mut known: Vec<Head>, key: Option<Key>) -> Verifier {
        known.retain(|head| head.number > 0);
        known.sort_by_key(|head| head.number);
        Verifier {
            known,
            key,
            records: 0,
            last: None,
            open: Vec::new(),
            last_kind: None,
            evidence: Sha256::new(),
            acknowledged: None,
            against: None,
        }
    }

    /// Reads the next records, at most `count`; tells whether there may be more.
    pub(crate) fn read(&mut self, connection: &Connection, count: u32) -> Result<bool, StoreError> {
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
            self.take(row, &mut last);
        }
        self.last = Some(last);
        Ok(read == count)
    }

    fn take(&mut self, row: &Row<'_>, last: &mut Head) {
        let number = last.number + 1;
        let entry = match Entry::read(row) {
            Ok(entry) => entry,
            Err(error) => {
                self.breach(BreachKind::Unreadable, number, number, &[], format!("cannot be read: {error}"));
                last.number = number;
                return;
            }
        };
        if entry.number < number {
            let what = format!("is preceded by a record {}", entry.number);
            return self.breach(BreachKind::Extra, number, number, &entry.content(), what);
        }
        if entry.number > number {
            let what = format!("is missing; the next one is {}", entry.number);
            self.breach(BreachKind::Missing, number, entry.number - 1, &entry.hash.0, what);
        } else if self.is_as_written(&entry, last.hash) {
            self.records += 1;
            self.judge(&entry);
        } else {
            let what = match self.key {
                None => "cannot be checked without its key, or is not as it was written",
                Some(_) => "is not as it was written, or another one before it was changed",
            };
            self.breach(BreachKind::Changed, number, number, &entry.content(), what.to_owned());
        }
        let other = self.noted(entry.number).iter().copied().find(|known| known.hash != entry.hash);
        if let Some(known) = other {
            let (number, what) = (entry.number, format!("is another one than was noted: {known}"));
            self.against.get_or_insert(Breach { number, to: number, what });
        }
        *last = Head { number: entry.number, hash: entry.hash };
    }

    fn is_as_written(&self, entry: &Entry, previous: Hash) -> bool {
        self.key.is_some() && entry.sealed(self.key.as_ref(), previous) == entry.hash
    }

    /// The heads that were noted of a record.
    fn noted(&self, number: u64) -> &[Head] {
        let from = self.known.partition_point(|known| known.number < number);
        let to = self.known.partition_point(|known| known.number <= number);
        &self.known[from..to]
    }

    /// Judges what an intact record says about the chain.
    fn judge(&mut self, entry: &Entry) {
        let number = entry.number;
        if entry.action == Action::ChainBroken.as_str() {
            let what = format!("was written after the log had been found damaged: {}", entry.target);
            self.breach(BreachKind::Found, number, number, &entry.content(), what);
        }
        if entry.action == Action::UsersForeign.as_str() {
            let what = format!("was written when users were found that are in no record: {}", entry.target);
            self.breach(BreachKind::Found, number, number, &entry.content(), what);
        }
        if entry.action == Action::HeadMissing.as_str() {
            // A head that was noted elsewhere may prove that nothing was cut off there.
            if !self.noted(number - 1).is_empty() {
                self.witness(BreachKind::Found, number, number, &entry.content());
            } else {
                let what = format!(
                    "was written when nobody could tell whether the end was cut off: {}",
                    entry.target
                );
                self.breach(BreachKind::Found, number, number, &entry.content(), what);
            }
        }
        let evidence = self.evidence();
        let is_acknowledged = entry.action == Action::BreachAcknowledged.as_str()
            && entry.role == Role::Authority.as_str()
            && entry.target.ends_with(&evidence.to_string());
        if is_acknowledged {
            let count = self.open.len() as u64 + self.acknowledged.as_ref().map_or(0, |it| it.count);
            self.open.clear();
            self.last_kind = None;
            let Entry { who, at_ms, .. } = entry;
            self.acknowledged = Some(Acknowledged { number, by: who.clone(), at_ms: *at_ms, count });
        }
    }

    fn witness(&mut self, kind: BreachKind, number: u64, to: u64, content: &[u8]) {
        self.evidence.update([kind as u8]);
        self.evidence.update(number.to_be_bytes());
        self.evidence.update(to.to_be_bytes());
        self.evidence.update(content);
    }

    fn breach(&mut self, kind: BreachKind, number: u64, to: u64, content: &[u8], what: String) {
        self.witness(kind, number, to, content);
        let is_next = |last: &Breach| last.to + 1 == number && self.last_kind == Some(kind);
        let is_full = self.open.len() >= BREACHES_MAX;
        match self.open.last_mut() {
            Some(last) if is_full || kind != BreachKind::Found && is_next(last) => last.to = to,
            _ => self.open.push(Breach { number, to, what }),
        }
        self.last_kind = Some(kind);
    }

    fn evidence(&self) -> Hash {
        Hash(self.evidence.clone().finalize().into())
    }

    pub(crate) fn verdict(mut self, has_head_file: bool) -> Verdict {
        let head = self.last.unwrap_or(Head::NONE);
        let evidence = self.evidence();
        let proven = self.known.iter().map(|known| known.number).filter(|&number| number <= head.number);
        let proven = proven.max().unwrap_or(0);
        let mut against: Vec<Breach> = self.against.take().into_iter().collect();
        let cut = self.known.iter().filter(|known| known.number > head.number).max_by_key(|it| it.number);
        let after = |number, what| Breach { number, to: number, what };
        if let Some(known) = cut {
            let what =
                format!("is missing: the log was cut here; it was noted to reach record {}", known.number);
            against.push(after(head.number + 1, what));
        }
        if !has_head_file && proven < head.number {
            let what = "may be missing: there is no audit.head that says where the log ends, and no head that was \
                        noted elsewhere is that of the last record";
            against.push(after(head.number + 1, what.to_owned()));
        }
        let breaches = (self.open.len() + against.len()) as u64;
        let breach = self.open.into_iter().chain(against).min_by_key(|breach| breach.number);
        let Verifier { records, acknowledged, .. } = Verifier { open: Vec::new(), ..self };
        Verdict { records, head, breach, breaches, acknowledged, proven, foreign: Vec::new(), evidence }
    }
}

/// The record of a breach among the records up to this number, which are pruned, if no authority has acknowledged it.
pub(super) fn breach_said_again(
    connection: &Connection,
    key: &Key,
    number: u64,
) -> Result<Option<Record>, StoreError> {
    let mut verifier = Verifier::new(Vec::new(), Some(key.clone()));
    let rows = "SELECT count(*) FROM audit WHERE number <= ?1";
    let rows = connection.query_row(rows, [number as i64], |row| row.get(0))?;
    verifier.read(connection, rows)?;
    let Some(breach) = verifier.open.first() else { return Ok(None) };
    let later = "SELECT number FROM audit WHERE number > ?1 AND action = ?2 AND role = ?3";
    let mut query = connection.prepare(later)?;
    let by = (number as i64, Action::BreachAcknowledged.as_str(), Role::Authority.as_str());
    let later = query.query_map(by, |row| row.get::<_, i64>(0))?.collect::<Result<Vec<_>, _>>()?;
    for acknowledged in later {
        if is_sealed(connection, key, acknowledged.unsigned_abs())? {
            return Ok(None);
        }
    }
    let what = format!("the pruned record {} {}", breach.number, breach.what);
    Ok(Some(Record::of(Action::ChainBroken, TELLTALE).on(what)))
}

/// The hash on which the first record stands: none, or that of the last pruned record. A later record in
/// the chain names that one.
pub(super) fn beginning(connection: &Connection) -> Result<Head, StoreError> {
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
