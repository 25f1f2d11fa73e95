//! Tokens of programs: made on the command line, shown once, revoked by their number.

use std::time::{Duration, SystemTime};

use rusqlite::{OptionalExtension, params};

use super::changes_made;
use crate::audit::known::Mark;
use crate::audit::{Action, COMMAND_LINE, Record};
use crate::database::from_unix_ms;
use crate::{Role, Store, StoreError, Token};
use telltale_clock::unix_ms;

/// A program's token ends this long after it was made, unless another time is given.
pub const TOKEN_LIFE_DAYS: u32 = 365;

const TOKENS_PER_USER: i64 = 16;
const LABEL_CHARS_MAX: usize = 64;

/// A program's token in a list, without its secret.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ProgramToken {
    pub number: i64,
    pub user: String,
    pub role: Role,
    pub label: String,
    pub created: SystemTime,
    pub expires: SystemTime,
}

impl Store {
    /// Makes a token with which programs act as this user. It is shown only this once.
    ///
    /// # Errors
    /// If there is no such user, it is an operator, it has too many tokens, or the database fails.
    pub async fn add_token(&self, name: &str, label: &str, days: u32) -> Result<Token, StoreError> {
        let token = Token::random()?;
        let key = token.key();
        let label: String = label.chars().filter(|it| !it.is_control()).take(LABEL_CHARS_MAX).collect();
        let name = name.to_owned();
        self.call(move |database| {
            let created = database.judged();
            let expires = created + Duration::from_secs(u64::from(days) * 24 * 3600);
            let mark = Mark::of_token(&key, &name, unix_ms(expires));
            let record = Record::of(Action::TokenAdded, COMMAND_LINE).on(format!("{name} {label}{mark}"));
            database.change(&[record], |transaction| {
                changes_made::count(transaction)?;
                let user =
                    transaction.query_row("SELECT id, role FROM users WHERE name = ?1", [&name], |row| {
                        Ok((row.get::<_, i64>(0)?, Role::read(row, 1)?))
                    });
                let (user, role) = user.optional()?.ok_or_else(|| StoreError::NoSuchUser(name.clone()))?;
                if role == Role::Operator {
                    return Err(StoreError::OperatorToken(name));
                }
                transaction.execute("DELETE FROM tokens WHERE expires_ms <= ?1", [unix_ms(created)])?;
                let count: i64 =
                    transaction
                        .query_row("SELECT count(*) FROM tokens WHERE user = ?1", [user], |row| row.get(0))?;
                if count >= TOKENS_PER_USER {
                    return Err(StoreError::ManyTokens(name));
                }
                transaction.execute(
                    "INSERT INTO tokens (token_hash, user, label, created_ms, expires_ms)
                     VALUES (?1, ?2, ?3, ?4, ?5)",
                    params![key, user, label, unix_ms(created), unix_ms(expires)],
                )?;
                Ok(())
            })?;
            database.reload_sessions()
        })
        .await?;
        Ok(token)
    }

    /// All tokens of programs by their number.
    pub async fn tokens(&self) -> Result<Vec<ProgramToken>, StoreError> {
        self.call(|database| {
            let mut query = database.connection.prepare(
                "SELECT number, name, role, label, tokens.created_ms, expires_ms
                 FROM tokens JOIN users ON users.id = tokens.user ORDER BY number",
            )?;
            let tokens = query.query_map([], |row| {
                Ok(ProgramToken {
                    number: row.get(0)?,
                    user: row.get(1)?,
                    role: Role::read(row, 2)?,
                    label: row.get(3)?,
                    created: from_unix_ms(row.get(4)?),
                    expires: from_unix_ms(row.get(5)?),
                })
            })?;
            Ok(tokens.collect::<Result<_, _>>()?)
        })
        .await
    }

    /// Revokes a token; programs that are connected with it are cut off.
    ///
    /// # Errors
    /// If there is no such token, or the database fails.
    pub async fn revoke_token(&self, number: i64) -> Result<(), StoreError> {
        self.call(move |database| {
            let sql = "SELECT token_hash, name, expires_ms FROM tokens JOIN users ON users.id = tokens.user
                       WHERE number = ?1";
            let mark = database.connection.query_row(sql, [number], |row| {
                Ok(Mark::of_token(&row.get(0)?, &row.get::<_, String>(1)?, row.get(2)?))
            });
            let mark = mark.optional()?.ok_or(StoreError::NoSuchToken(number))?;
            let record = Record::of(Action::TokenRevoked, COMMAND_LINE).on(format!("{number}{mark}"));
            database.change(&[record], |transaction| {
                changes_made::count(transaction)?;
                let revoked = transaction.execute("DELETE FROM tokens WHERE number = ?1", [number])?;
                if revoked == 0 { Err(StoreError::NoSuchToken(number)) } else { Ok(()) }
            })?;
            database.reload_sessions()
        })
        .await
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DemoSecrets, SessionKind};
    use telltale_clock::Clock;

    #[tokio::test]
    async fn a_token_is_its_users_until_it_is_taken_back() {
        let store = Store::in_memory(Clock::start(), DemoSecrets::Refused).unwrap();
        store.add_user("dora", Role::Developer, "a long password").await.unwrap();
        store.add_user("anna", Role::Operator, "135791").await.unwrap();
        assert!(matches!(store.add_token("anna", "", 1).await, Err(StoreError::OperatorToken(_))));
        assert!(matches!(store.add_token("bert", "", 1).await, Err(StoreError::NoSuchUser(_))));
        let token = store.add_token("dora", "dashboard", 1).await.unwrap();
        let mut session = store.session(&token).unwrap();
        assert_eq!(
            (&*session.user, session.role, session.kind),
            ("dora", Role::Developer, SessionKind::Program)
        );
        let listed = store.tokens().await.unwrap();
        assert_eq!((listed.len(), listed[0].label.as_str()), (1, "dashboard"));
        store.revoke_token(listed[0].number).await.unwrap();
        session.ended().await;
        assert!(store.session(&token).is_none());
        assert!(matches!(store.revoke_token(listed[0].number).await, Err(StoreError::NoSuchToken(_))));

        let ended = store.add_token("dora", "", 0).await.unwrap();
        assert!(store.session(&ended).is_none_or(|session| session.expires <= store.clock.now()));
        for _ in 0..TOKENS_PER_USER {
            store.add_token("dora", "", 1).await.unwrap();
        }
        assert!(matches!(store.add_token("dora", "", 1).await, Err(StoreError::ManyTokens(_))));
    }
}
