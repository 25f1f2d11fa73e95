//! Users and tokens as the audit log knows them.
//!
//! The record of each change has a mark of the row that was written. The log has a key outside the database, so an
//! attacker who writes only the database adds no user or token, changes no role or secret, and puts no user back
//! who was removed: such rows are foreign, and nobody logs in with them.

use std::collections::HashMap;
use std::fmt;

use rusqlite::{Connection, params_from_iter};
use sha2::{Digest as _, Sha256};

use crate::audit::{Action, DONE, Entry, Key, Record, TELLTALE, is_sealed};
use crate::{Database, Role, StoreError};
use telltale_engine::text::hex;

/// Before the mark of a row in the target of a record.
const MARKED: &str = " #";

/// The actions that say who is known.
const ACTIONS: [Action; 8] = [
    Action::UserAdded,
    Action::UserSecret,
    Action::UserRole,
    Action::UserRemoved,
    Action::UserKept,
    Action::TokenAdded,
    Action::TokenRevoked,
    Action::TokenKept,
];

/// A hash of what matters in a row.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(crate) struct Mark(String);

impl Mark {
    pub fn of_user(name: &str, role: Role, secret_hash: &str) -> Mark {
        Mark::of(["user", name, role.as_str(), secret_hash])
    }

    pub fn of_token(token_hash: &[u8; 32], name: &str, expires_ms: i64) -> Mark {
        Mark::of(["token", name, &hex(token_hash), &expires_ms.to_string()])
    }

    fn of(fields: [&str; 4]) -> Mark {
        let mut hash = Sha256::new();
        for field in fields {
            hash.update((field.len() as u64).to_be_bytes());
            hash.update(field);
        }
        Mark(hex(&hash.finalize()[..16]))
    }

    /// The mark at the end of a record's target, and what stands before it.
    fn split(target: &str) -> (&str, Option<Mark>) {
        match target.rsplit_once(MARKED) {
            Some((said, mark)) if mark.len() == 32 => (said, Some(Mark(mark.to_owned()))),
            _ => (target, None),
        }
    }
}

impl fmt::Display for Mark {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{MARKED}{}", self.0)
    }
}

/// A user in the database.
struct UserRow {
    name: String,
    role: Role,
    mark: Mark,
}

/// A token in the database.
struct TokenRow {
    number: i64,
    user: String,
    label: String,
    mark: Mark,
}

/// The users and tokens that the records name.
#[derive(Debug, Default)]
pub(crate) struct Known {
    /// By their names, each with the number of its record.
    users: HashMap<String, (Mark, u64)>,
    /// Each with the name of its user and the number of its record.
    tokens: HashMap<Mark, (String, u64)>,
}

/// The known users and tokens of the database.
#[derive(Debug, Default)]
pub(crate) struct Knowledge {
    /// `None` if nobody can tell: all are taken as they are.
    known: Option<Known>,
    /// Those that are not known, in words.
    foreign: Vec<String>,
}

impl Knowledge {
    pub fn has_user(&self, name: &str, role: Role, secret_hash: &str) -> bool {
        self.known.as_ref().is_none_or(|known| known.has_user(name, role, secret_hash))
    }

    pub fn has_token(&self, mark: &Mark) -> bool {
        self.known.as_ref().is_none_or(|known| known.has_token(mark))
    }
}

impl Known {
    /// Reads the records. One that was not written with the key says nothing.
    pub fn read(connection: &Connection, key: &Key) -> Result<Known, StoreError> {
        let places = vec!["?"; ACTIONS.len()].join(", ");
        let sql = format!(
            "SELECT number, at_ms, who, role, source, action, target, outcome, hash
             FROM audit WHERE action IN ({places}) ORDER BY number"
        );
        let mut query = connection.prepare_cached(&sql)?;
        let mut rows = query.query(params_from_iter(ACTIONS.map(Action::as_str)))?;
        let mut known = Known::default();
        while let Some(row) = rows.next()? {
            // A record that cannot be read proves nothing.
            let Some(entry) = readable(Entry::read(row))? else { continue };
            let is_sealed = match is_sealed(connection, key, entry.number) {
                Err(StoreError::Database(error)) => readable(Err(error))?.unwrap_or(false),
                is_sealed => is_sealed?,
            };
            if entry.outcome == DONE && is_sealed {
                known.take(&entry);
            }
        }
        Ok(known)
    }

    fn take(&mut self, entry: &Entry) {
        let Some(action) = ACTIONS.into_iter().find(|action| action.as_str() == entry.action) else { return };
        let (said, mark) = Mark::split(&entry.target);
        let number = entry.number;
        let name = said.split([' ', ':']).next().unwrap_or(said);
        match action {
            Action::UserAdded | Action::UserKept => {
                self.users.extend(mark.map(|mark| (name.to_owned(), (mark, number))));
            }
            Action::UserSecret | Action::UserRole => {
                self.users.remove(name);
                self.users.extend(mark.map(|mark| (name.to_owned(), (mark, number))));
                self.tokens.retain(|_, (of, _)| of != name);
            }
            Action::UserRemoved => {
                self.users.remove(name);
                self.tokens.retain(|_, (of, _)| of != name);
            }
            Action::TokenAdded | Action::TokenKept => {
                self.tokens.extend(mark.map(|mark| (mark, (name.to_owned(), number))));
            }
            Action::TokenRevoked => drop(mark.and_then(|mark| self.tokens.remove(&mark))),
            _ => {}
        }
    }

    /// Whether this row of a user is as the records say.
    pub fn has_user(&self, name: &str, role: Role, secret_hash: &str) -> bool {
        self.knows(name, &Mark::of_user(name, role, secret_hash))
    }

    fn knows(&self, name: &str, mark: &Mark) -> bool {
        self.users.get(name).is_some_and(|(known, _)| known == mark)
    }

    /// Whether the records know no user.
    pub fn is_empty(&self) -> bool {
        self.users.is_empty()
    }

    /// Whether this row of a token is as the records say.
    pub fn has_token(&self, mark: &Mark) -> bool {
        self.tokens.contains_key(mark)
    }

    /// The users and tokens of the database that are in no record, in words.
    pub fn foreign(&self, connection: &Connection) -> Result<Vec<String>, StoreError> {
        let users = users(connection)?
            .into_iter()
            .filter(|row| !self.knows(&row.name, &row.mark))
            .map(|row| row.name);
        let tokens = tokens(connection)?.into_iter().filter(|row| !self.has_token(&row.mark));
        let tokens = tokens.map(|row| format!("token {} of {}", row.number, row.user));
        Ok(users.chain(tokens).collect())
    }

    /// Removes what no record names from a copy of a damaged database. Records that know no user at all were damaged
    /// themselves: then all stay.
    pub fn keep_known(&self, copy: &Connection) -> Result<Vec<String>, StoreError> {
        if self.is_empty() {
            return Ok(Vec::new());
        }
        let foreign = self.foreign(copy)?;
        for row in tokens(copy)?.iter().filter(|row| !self.has_token(&row.mark)) {
            copy.execute("DELETE FROM tokens WHERE number = ?1", [row.number])?;
        }
        for row in users(copy)?.iter().filter(|row| !self.knows(&row.name, &row.mark)) {
            copy.execute("DELETE FROM users WHERE name = ?1", [&row.name])?;
        }
        Ok(foreign)
    }

    /// The records that say again what is known only by records up to this number, which are pruned.
    pub fn said_again(&self, connection: &Connection, number: u64) -> Result<Vec<Record>, StoreError> {
        let is_old_user = |row: &UserRow| {
            self.users.get(&row.name).is_some_and(|(mark, it)| *mark == row.mark && *it <= number)
        };
        let is_old_token = |row: &TokenRow| self.tokens.get(&row.mark).is_some_and(|(_, it)| *it <= number);
        let users = users(connection)?.into_iter().filter(is_old_user).map(|row| row.kept());
        let tokens = tokens(connection)?.into_iter().filter(is_old_token).map(|row| row.kept());
        Ok(users.chain(tokens).collect())
    }
}

impl UserRow {
    fn kept(&self) -> Record {
        let UserRow { name, role, mark } = self;
        Record::of(Action::UserKept, TELLTALE).on(format!("{name} ({}){mark}", role.as_str()))
    }
}

impl TokenRow {
    fn kept(&self) -> Record {
        let TokenRow { user, label, mark, .. } = self;
        Record::of(Action::TokenKept, TELLTALE).on(format!("{user} {label}{mark}"))
    }
}

/// Records that take all users and tokens as they are: after a repair, and where the log gets another key.
pub(crate) fn as_they_are(connection: &Connection) -> Result<Vec<Record>, StoreError> {
    let users = users(connection)?.into_iter().map(|row| row.kept());
    Ok(users.chain(tokens(connection)?.into_iter().map(|row| row.kept())).collect())
}

fn users(connection: &Connection) -> Result<Vec<UserRow>, StoreError> {
    let mut query = connection.prepare_cached("SELECT name, role, secret_hash FROM users ORDER BY name")?;
    let rows = query.query_map([], |row| {
        let (name, role, secret_hash): (String, Role, String) =
            (row.get(0)?, Role::read(row, 1)?, row.get(2)?);
        let mark = Mark::of_user(&name, role, &secret_hash);
        Ok(UserRow { name, role, mark })
    })?;
    rows.filter_map(|row| readable(row).transpose()).collect()
}

fn tokens(connection: &Connection) -> Result<Vec<TokenRow>, StoreError> {
    let mut query = connection.prepare_cached(
        "SELECT number, name, label, token_hash, expires_ms
         FROM tokens JOIN users ON users.id = tokens.user ORDER BY number",
    )?;
    let rows = query.query_map([], |row| {
        let user: String = row.get(1)?;
        let mark = Mark::of_token(&row.get(3)?, &user, row.get(4)?);
        Ok(TokenRow { number: row.get(0)?, user, label: row.get(2)?, mark })
    })?;
    rows.filter_map(|row| readable(row).transpose()).collect()
}

/// A row; `None` for one that holds nonsense, which must not hide what the others say. A damaged database is an error.
fn readable<T>(row: rusqlite::Result<T>) -> Result<Option<T>, StoreError> {
    match row {
        Err(error) if error.sqlite_error_code().is_none() => Ok(None),
        row => Ok(Some(row?)),
    }
}

impl Database {
    /// Reads again who is known, and records what is foreign, once. Without the key nobody can tell: all are taken as
    /// they are. A copy in memory of a damaged database has no records: what was known before stays.
    pub(crate) fn read_known(&mut self) -> Result<(), StoreError> {
        if self.health.check_keeps().is_err() {
            return Ok(());
        }
        // One state of the database: another program may change it meanwhile.
        let transaction = self.connection.unchecked_transaction()?;
        let read = |key| {
            let known = Known::read(&transaction, key)?;
            let foreign = known.foreign(&transaction)?;
            Ok((known, foreign))
        };
        let read: Option<Result<_, StoreError>> = self.log.key().ok().map(read);
        let read = read.transpose().unwrap_or_else(|error| {
            tracing::warn!(%error, "users cannot be compared with the audit log");
            None
        });
        drop(transaction);
        let (known, foreign) = read.map_or((None, Vec::new()), |(known, foreign)| (Some(known), foreign));
        self.knowledge.known = known;
        if foreign != self.knowledge.foreign && !foreign.is_empty() && self.serves {
            let names = foreign.join(", ");
            tracing::error!(
                "in the database, and in no record of the audit log: {names}. They cannot log in; `telltale user \
                 passwd` takes a user in, `telltale user remove` and `telltale user revoke` remove them"
            );
            let record = Record::of(Action::UsersForeign, TELLTALE).on(names);
            if !self.is_recorded(&record)? {
                self.unwritten.put(record, &self.clock);
            }
        }
        self.knowledge.foreign = foreign;
        Ok(())
    }

    /// Whether the last record of this action says the same.
    fn is_recorded(&self, record: &Record) -> Result<bool, StoreError> {
        let sql = "SELECT target FROM audit WHERE action = ?1 ORDER BY number DESC LIMIT 1";
        let mut query = self.connection.prepare_cached(sql)?;
        let mut rows = query.query([record.action.as_str()])?;
        let said: Option<String> = rows.next()?.map(|row| row.get(0)).transpose()?;
        Ok(said.as_deref() == Some(crate::audit::in_field(&record.target)))
    }

    /// Whether the log knows this row of a user. Another program may have changed both a moment ago.
    pub(crate) fn knows(&mut self, name: &str, role: Role, secret_hash: &str) -> Result<bool, StoreError> {
        let version: i64 = self.connection.pragma_query_value(None, "data_version", |row| row.get(0))?;
        if self.data_version == version && self.knowledge.has_user(name, role, secret_hash) {
            return Ok(true);
        }
        self.read_known()?;
        Ok(self.knowledge.has_user(name, role, secret_hash))
    }
}

#[cfg(test)]
mod tests;
