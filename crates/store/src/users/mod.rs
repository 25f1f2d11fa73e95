//! Users: names, roles and secrets, and the proof of a secret.

pub(super) mod changes_made;
pub(super) mod known_browsers;
pub(super) mod secret;
pub(super) mod tokens;

use super::database::from_unix_ms;
use std::time::SystemTime;
use telltale_clock::unix_ms;

use rusqlite::{Connection, OptionalExtension, params};

use super::audit::known::Mark;
use super::audit::{Action, COMMAND_LINE, Record};
use super::{Caller, DEMO_CONSOLE_USERS, DEMO_USERS, Role, Store, StoreError};

use secret::check_policy;

/// A user in a list.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct User {
    pub name: String,
    pub role: Role,
    pub created: SystemTime,
    /// The audit log knows this row. Nobody logs in with another one.
    pub is_known: bool,
}

/// Proof that somebody gave the secret of this user just now.
#[derive(Debug, Clone)]
pub struct Verified {
    pub(super) id: i64,
    pub(super) name: String,
    pub(super) role: Role,
    pub(super) secret_hash: String,
}

impl Verified {
    pub fn name(&self) -> &str {
        &self.name
    }

    pub fn role(&self) -> Role {
        self.role
    }
}

/// Why a name is not acceptable.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum NameError {
    #[error("a name has 1 to {NAME_CHARS_MAX} characters")]
    Length,
    #[error("a name has letters, digits, '.', '_' and '-' only")]
    Letters,
}

const NAME_CHARS_MAX: usize = 64;

impl Store {
    /// # Errors
    /// If the name or the secret is not acceptable, the name is taken, or the database fails.
    pub async fn add_user(&self, name: &str, role: Role, secret: &str) -> Result<(), StoreError> {
        check_name(name)?;
        check_policy(role, name, secret)?;
        self.insert_user(name, role, secret).await
    }

    /// Adds the users of [`DEMO_USERS`] that are missing.
    pub async fn add_demo_users(&self) -> Result<(), StoreError> {
        self.add_known_users(&DEMO_USERS).await
    }

    /// The same with [`DEMO_CONSOLE_USERS`].
    pub async fn add_demo_console_users(&self) -> Result<(), StoreError> {
        self.add_known_users(&DEMO_CONSOLE_USERS).await
    }

    async fn add_known_users(&self, users: &[(&str, Role, &str)]) -> Result<(), StoreError> {
        for &(name, role, secret) in users {
            match self.insert_user(name, role, secret).await {
                Ok(()) | Err(StoreError::Exists(_)) => {}
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    async fn insert_user(&self, name: &str, role: Role, secret: &str) -> Result<(), StoreError> {
        let hash = self.hashing.hash(secret.to_owned()).await?;
        let name = name.to_owned();
        let created_ms = unix_ms(self.clock.wall());
        let mark = Mark::of_user(&name, role, &hash);
        let target = format!("{name} ({}){mark}", role.as_str());
        let record = Record::of(Action::UserAdded, COMMAND_LINE).on(target);
        self.call(move |database| {
            database.change(&[record], |transaction| {
                changes_made::count(transaction)?;
                let added = transaction.execute(
                    "INSERT INTO users (name, role, secret_hash, created_ms) VALUES (?1, ?2, ?3, ?4)
                     ON CONFLICT (name) DO NOTHING",
                    params![name, role.as_str(), hash, created_ms],
                )?;
                if added == 0 { Err(StoreError::Exists(name)) } else { Ok(()) }
            })
        })
        .await
    }

    /// All users by name.
    pub async fn users(&self) -> Result<Vec<User>, StoreError> {
        self.call(|database| {
            database.read_known()?;
            let sql = "SELECT name, role, created_ms, secret_hash FROM users ORDER BY name";
            let mut query = database.connection.prepare(sql)?;
            let rows = query.query_map([], |row| {
                let (name, role): (String, Role) = (row.get(0)?, Role::read(row, 1)?);
                let hash: String = row.get(3)?;
                let is_known = database.knowledge.has_user(&name, role, &hash);
                Ok(User { name, role, created: from_unix_ms(row.get(2)?), is_known })
            })?;
            Ok(rows.collect::<Result<_, _>>()?)
        })
        .await
    }

    /// Whether there is any user. Anybody may cause this query.
    ///
    /// # Errors
    /// If the database fails, or is so damaged that there may be users that nobody can read.
    pub async fn has_users(&self) -> Result<bool, StoreError> {
        let sql = "SELECT EXISTS (SELECT 1 FROM users)";
        self.call_from(Caller::Elsewhere, |database| {
            let has_users = database.connection.query_row(sql, [], |row| row.get(0))?;
            if has_users { Ok(true) } else { database.health.check_keeps().map(|()| false) }
        })
        .await
    }

    /// The names of the operators; none if there are more than `most`.
    pub async fn operators(&self, most: usize) -> Result<Vec<String>, StoreError> {
        let sql = "SELECT name FROM users WHERE role = ?1 ORDER BY name LIMIT ?2";
        let names: Vec<String> = self
            .call_from(Caller::Vehicle, move |database| {
                let mut query = database.connection.prepare(sql)?;
                let rows =
                    query.query_map(params![Role::Operator.as_str(), most as i64 + 1], |row| row.get(0))?;
                Ok(rows.collect::<Result<_, _>>()?)
            })
            .await?;
        Ok(if names.len() > most { Vec::new() } else { names })
    }

    /// Whether this is a user's name. Anybody may cause this query.
    pub async fn knows_user(&self, name: &str) -> Result<bool, StoreError> {
        Ok(self.find_user(Caller::Elsewhere, name).await?.is_some())
    }

    /// Gives a user another secret and ends all of its sessions and tokens.
    ///
    /// # Errors
    /// If there is no such user, the secret is not acceptable, or the database fails.
    pub async fn change_secret(&self, name: &str, secret: &str) -> Result<(), StoreError> {
        let user = self.row_of(Caller::Vehicle, name).await?;
        let user = user.ok_or_else(|| StoreError::NoSuchUser(name.to_owned()))?;
        self.change_user((user.id, name), user.role, secret, Action::UserSecret, name.to_owned()).await
    }

    /// Gives a user another role with a secret that fits it, and ends all of its sessions and tokens.
    ///
    /// # Errors
    /// If there is no such user, the secret is not acceptable, or the database fails.
    pub async fn change_role(&self, name: &str, role: Role, secret: &str) -> Result<(), StoreError> {
        let user = self.row_of(Caller::Vehicle, name).await?;
        let user = user.ok_or_else(|| StoreError::NoSuchUser(name.to_owned()))?;
        let was = user.role.as_str();
        let said = format!("{name}: {was} -> {}", role.as_str());
        self.change_user((user.id, name), role, secret, Action::UserRole, said).await
    }

    async fn change_user(
        &self,
        (id, name): (i64, &str),
        role: Role,
        secret: &str,
        action: Action,
        said: String,
    ) -> Result<(), StoreError> {
        check_policy(role, name, secret)?;
        let hash = self.hashing.hash(secret.to_owned()).await?;
        let mark = Mark::of_user(name, role, &hash);
        let record = Record::of(action, COMMAND_LINE).on(format!("{said}{mark}"));
        self.call(move |database| {
            database.change(&[record], |transaction| {
                changes_made::count(transaction)?;
                transaction.execute(
                    "UPDATE users SET secret_hash = ?2, role = ?3 WHERE id = ?1",
                    params![id, hash, role.as_str()],
                )?;
                transaction.execute("DELETE FROM sessions WHERE user = ?1", [id])?;
                transaction.execute("DELETE FROM tokens WHERE user = ?1", [id])?;
                Ok(())
            })?;
            database.reload_sessions()
        })
        .await
    }

    /// Removes a user and all of its sessions and tokens.
    ///
    /// # Errors
    /// If there is no such user, or the database fails.
    pub async fn remove_user(&self, name: &str) -> Result<(), StoreError> {
        let name = name.to_owned();
        let record = Record::of(Action::UserRemoved, COMMAND_LINE).on(&*name);
        self.call(move |database| {
            database.change(&[record], |transaction| {
                changes_made::count(transaction)?;
                let removed = transaction.execute("DELETE FROM users WHERE name = ?1", [&name])?;
                if removed == 0 { Err(StoreError::NoSuchUser(name)) } else { Ok(()) }
            })?;
            database.reload_sessions()
        })
        .await
    }

    /// Proves a name and its secret. Unknown names take the same time.
    ///
    /// # Errors
    /// If too many logins wait, or the database fails. A wrong secret is not an error but `None`.
    pub async fn authenticate(&self, name: &str, secret: &str) -> Result<Option<Verified>, StoreError> {
        self.authenticate_from(Caller::Vehicle, name, secret).await
    }

    /// [`Store::authenticate`] for this caller.
    pub async fn authenticate_from(
        &self,
        caller: Caller,
        name: &str,
        secret: &str,
    ) -> Result<Option<Verified>, StoreError> {
        let user = if check_name(name).is_ok() { self.find_user(caller, name).await? } else { None };
        let hash = user.as_ref().map(|user| user.secret_hash.clone());
        let proven = self.hashing.verify(caller, secret.to_owned(), hash).await?;
        Ok(user.filter(|_| proven))
    }

    /// The user of this name, if the audit log knows the row.
    pub(super) async fn find_user(&self, caller: Caller, name: &str) -> Result<Option<Verified>, StoreError> {
        let name = name.to_owned();
        self.call_from(caller, move |database| {
            let Some(user) = row_of(&database.connection, &name)? else { return Ok(None) };
            Ok(if database.knows(&user.name, user.role, &user.secret_hash)? { Some(user) } else { None })
        })
        .await
    }

    /// The user of this name, also one that the audit log does not know: a new secret or role makes that one known.
    async fn row_of(&self, caller: Caller, name: &str) -> Result<Option<Verified>, StoreError> {
        let name = name.to_owned();
        self.call_from(caller, move |database| row_of(&database.connection, &name)).await
    }
}

fn row_of(connection: &Connection, name: &str) -> Result<Option<Verified>, StoreError> {
    let sql = "SELECT id, name, role, secret_hash FROM users WHERE name = ?1";
    let user = connection.query_row(sql, [name], |row| {
        Ok(Verified {
            id: row.get(0)?,
            name: row.get(1)?,
            role: Role::read(row, 2)?,
            secret_hash: row.get(3)?,
        })
    });
    Ok(user.optional()?)
}

fn check_name(name: &str) -> Result<(), NameError> {
    let chars = name.chars().count();
    if chars == 0 || chars > NAME_CHARS_MAX {
        return Err(NameError::Length);
    }
    if !name.chars().all(|char| char.is_alphanumeric() || matches!(char, '.' | '_' | '-')) {
        return Err(NameError::Letters);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_letters_and_digits() {
        let long = "x".repeat(64);
        for good in ["a", "Jürgen", "bus-1_operator", "运营", long.as_str()] {
            assert_eq!(check_name(good), Ok(()), "{good}");
        }
        for bad in [
            "",
            &"x".repeat(65),
            "a b",
            "a\n",
            "\u{202e}rotarepo",
            "a\u{200b}",
            "\u{0}",
            "<b>x",
            "a/b",
            "a'",
            "a&b",
        ] {
            assert!(check_name(bad).is_err(), "{bad:?}");
        }
    }
}
