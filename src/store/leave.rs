//! The end of an operator's work: written before it happens, so that it happens whole or not at all.

use rusqlite::params;

use super::audit::Record;
use super::sessions::Key;
use super::{Database, Store, StoreError};

/// An end that is written and has not happened yet: the sessions go on until it does.
#[derive(Debug)]
pub struct Leaving {
    user: String,
    had_seat: bool,
    /// Token, start and end of each session.
    sessions: Vec<(Key, i64, i64)>,
}

impl Store {
    /// Writes down that an operator leaves the seat and all displays, with the record of it. When
    /// this returns, it is on the disk; then [`Store::left`] makes it happen, or
    /// [`Store::take_back`] undoes it.
    ///
    /// # Errors
    /// If the database fails; nothing is changed then.
    pub async fn leave(&self, user: &str, record: Record) -> Result<Leaving, StoreError> {
        let user = user.to_owned();
        self.call(move |database| {
            database.change(&[record], |transaction| {
                let mut query = transaction.prepare_cached(
                    "SELECT token_hash, sessions.created_ms, expires_ms
                     FROM sessions JOIN users ON users.id = sessions.user WHERE name = ?1",
                )?;
                let rows = query.query_map([&user], |row| Ok((row.get(0)?, row.get(1)?, row.get(2)?)))?;
                let sessions = rows.collect::<Result<_, _>>()?;
                transaction.execute(
                    "DELETE FROM sessions WHERE user = (SELECT id FROM users WHERE name = ?1)",
                    [&user],
                )?;
                let sql = "DELETE FROM seat WHERE user = (SELECT id FROM users WHERE name = ?1)";
                let had_seat = transaction.execute(sql, [&user])? > 0;
                Ok(Leaving { user, had_seat, sessions })
            })
        })
        .await
    }

    /// Ends the sessions of those who have left.
    ///
    /// # Errors
    /// If the database cannot be read.
    pub async fn left(&self) -> Result<(), StoreError> {
        self.call(Database::reload_sessions).await
    }

    /// Gives the seat and the sessions back, with the record of why.
    ///
    /// # Errors
    /// If the database fails: the operator has to log in again after a restart then.
    pub async fn take_back(&self, leaving: Leaving, record: Record) -> Result<(), StoreError> {
        self.call(move |database| {
            let Leaving { user, had_seat, sessions } = leaving;
            database.change(&[record], |transaction| {
                for (key, created_ms, expires_ms) in sessions {
                    transaction.execute(
                        "INSERT OR IGNORE INTO sessions (token_hash, user, created_ms, expires_ms)
                         SELECT ?1, id, ?3, ?4 FROM users WHERE name = ?2",
                        params![key, user, created_ms, expires_ms],
                    )?;
                }
                if had_seat {
                    transaction.execute(
                        "INSERT OR REPLACE INTO seat (one, user) SELECT 1, id FROM users WHERE name = ?1",
                        [user],
                    )?;
                }
                Ok(())
            })?;
            database.reload_sessions()
        })
        .await
    }
}

#[cfg(test)]
mod tests {
    use crate::clock::Clock;
    use crate::store::audit::{Action, Record, TELLTALE};
    use crate::store::{DemoSecrets, Role, Store};

    #[tokio::test]
    async fn an_end_that_is_taken_back_leaves_seat_and_sessions_as_they_were() {
        let store = Store::in_memory(Clock::start(), DemoSecrets::Refused).unwrap();
        store.add_user("anna", Role::Operator, "135791").await.unwrap();
        let user = store.authenticate("anna", "135791").await.unwrap().unwrap();
        let (token, session) = store.open_session(&user).await.unwrap();
        store.take_seat("anna").await.unwrap();
        let record = || Record::of(Action::Logout, TELLTALE).by("anna", Role::Operator);

        let leaving = store.leave("anna", record()).await.unwrap();
        assert_eq!(store.seated_operator().await.unwrap(), None);
        assert!(session.is_open(), "it has not happened yet");
        store.take_back(leaving, record().refused("no")).await.unwrap();
        assert_eq!(store.seated_operator().await.unwrap().as_deref(), Some("anna"));
        assert!(session.is_open() && store.session(&token).is_some());

        store.leave("anna", record()).await.unwrap();
        store.left().await.unwrap();
        assert!(!session.is_open() && store.session(&token).is_none());
    }
}
