//! Who comes into the operator's seat and who leaves it: written before it happens, so that it happens
//! whole or not at all.

use rusqlite::{Connection, OptionalExtension, Transaction, params};

use super::audit::Record;
use super::sessions::{Key, insert_session};
use super::vehicle::write as write_vehicle;
use super::{Database, Session, Store, StoreError, Token, VehicleMemory, Verified};

/// A change that is written and has not happened yet: the sessions go on as they were until it does.
#[derive(Debug)]
pub struct Written {
    /// The session that was opened.
    opened: Option<Key>,
    /// Who sat in the seat.
    seat: Option<i64>,
    /// Token, user, start and end of each session of those whom it is about.
    sessions: Vec<(Key, i64, i64, i64)>,
}

/// Somebody who proved to be a user and comes in.
#[derive(Debug)]
pub struct Entering<'a> {
    pub user: &'a Verified,
    /// The session that the browser had, which ends.
    pub before: Option<&'a Session>,
    /// What is to be remembered of the vehicle once this operator sits in the seat; `None` for others.
    pub seat: Option<VehicleMemory>,
    /// Who sat there, and leaves all displays.
    pub from: Option<&'a str>,
}

impl Store {
    /// Writes down that somebody comes in, with the records of it. When this returns, it is on the
    /// disk; then [`Store::entered`] makes it happen, or [`Store::take_back`] undoes it.
    ///
    /// # Errors
    /// [`StoreError::NoSuchUser`] if the user was removed or got another secret meanwhile; else what
    /// the database says. Nothing is changed then.
    pub async fn enter(
        &self,
        entering: Entering<'_>,
        records: Vec<Record>,
    ) -> Result<(Token, Written), StoreError> {
        let token = Token::random()?;
        let key = token.key();
        let created = self.clock.wall();
        let Entering { user, before, seat, from } = entering;
        let (user, from) = (user.clone(), from.map(str::to_owned));
        let ends = before.map(Session::key);
        let written = self.call(move |database| {
            let remembered = seat.as_ref().map(|memory| memory.seq);
            let written = database.change(&records, |transaction| {
                let names = [Some(user.name()), from.as_deref()];
                let written = Written { opened: Some(key), ..before_change(transaction, names, ends)? };
                if let Some(ends) = ends {
                    transaction.execute("DELETE FROM sessions WHERE token_hash = ?1", [ends])?;
                }
                insert_session(transaction, &user, key, created)?;
                if let Some(from) = &from {
                    end_all(transaction, from)?;
                }
                if let Some(memory) = &seat {
                    take_seat(transaction, user.id)?;
                    write_vehicle(transaction, memory)?;
                }
                Ok(written)
            })?;
            database.remembered_seq = database.remembered_seq.max(remembered.unwrap_or(0));
            Ok(written)
        });
        Ok((token, written.await?))
    }

    /// Opens the session of who has come in, and ends those that it ends.
    ///
    /// # Errors
    /// If the database cannot be read, or the session was ended meanwhile.
    pub async fn entered(&self, token: &Token) -> Result<Session, StoreError> {
        self.left().await?;
        self.session(token).ok_or(StoreError::SessionEnded)
    }

    /// Writes down that an operator leaves the seat and all displays, with the record of it. When
    /// this returns, it is on the disk; then [`Store::left`] makes it happen, or
    /// [`Store::take_back`] undoes it.
    ///
    /// # Errors
    /// If the database fails; nothing is changed then.
    pub async fn leave(&self, user: &str, record: Record) -> Result<Written, StoreError> {
        let user = user.to_owned();
        self.call(move |database| {
            database.change(&[record], |transaction| {
                let written = before_change(transaction, [Some(user.as_str()), None], None)?;
                end_all(transaction, &user)?;
                let sql = "DELETE FROM seat WHERE user = (SELECT id FROM users WHERE name = ?1)";
                transaction.execute(sql, [&user])?;
                Ok(written)
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

    /// Gives the seat and the sessions back, with the vehicle as it is and the record of why.
    ///
    /// # Errors
    /// If the database fails: the operator has to log in again after a restart then.
    pub async fn take_back(
        &self,
        written: Written,
        memory: VehicleMemory,
        record: Record,
    ) -> Result<(), StoreError> {
        self.call(move |database| {
            database.change(&[record], |transaction| {
                if let Some(opened) = written.opened {
                    transaction.execute("DELETE FROM sessions WHERE token_hash = ?1", [opened])?;
                }
                for (key, user, created_ms, expires_ms) in written.sessions {
                    transaction.execute(
                        "INSERT OR IGNORE INTO sessions (token_hash, user, created_ms, expires_ms)
                         SELECT ?1, id, ?3, ?4 FROM users WHERE id = ?2",
                        params![key, user, created_ms, expires_ms],
                    )?;
                }
                transaction.execute("DELETE FROM seat", [])?;
                if let Some(user) = written.seat {
                    take_seat(transaction, user)?;
                }
                write_vehicle(transaction, &memory)
            })?;
            database.reload_sessions()
        })
        .await
    }
}

fn before_change(
    transaction: &Transaction<'_>,
    names: [Option<&str>; 2],
    ends: Option<Key>,
) -> Result<Written, StoreError> {
    let mut query = transaction.prepare_cached(
        "SELECT token_hash, sessions.user, sessions.created_ms, expires_ms
         FROM sessions JOIN users ON users.id = sessions.user
         WHERE name = ?1 OR name = ?2 OR token_hash = ?3",
    )?;
    let row = |row: &rusqlite::Row<'_>| Ok((row.get(0)?, row.get(1)?, row.get(2)?, row.get(3)?));
    let sessions = query.query_map(params![names[0], names[1], ends], row)?.collect::<Result<_, _>>()?;
    let seat = transaction.query_row("SELECT user FROM seat", [], |row| row.get(0)).optional()?;
    Ok(Written { opened: None, seat, sessions })
}

fn end_all(connection: &Connection, user: &str) -> Result<(), StoreError> {
    let sql = "DELETE FROM sessions WHERE user = (SELECT id FROM users WHERE name = ?1)";
    connection.execute(sql, [user])?;
    Ok(())
}

/// A user that was removed takes no seat.
fn take_seat(connection: &Connection, user: i64) -> Result<(), StoreError> {
    connection.execute(
        "INSERT INTO seat (one, user) SELECT 1, id FROM users WHERE id = ?1
         ON CONFLICT (one) DO UPDATE SET user = excluded.user",
        [user],
    )?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::Clock;
    use crate::engine::resume::Restored;
    use crate::store::audit::{Action, TELLTALE};
    use crate::store::{DemoSecrets, Role};

    fn memory(store: &Store, seq: u64) -> VehicleMemory {
        VehicleMemory { seq, at: store.clock.wall(), vehicle: Restored::default() }
    }

    fn record() -> Record {
        Record::of(Action::Logout, TELLTALE).by("anna", Role::Operator)
    }

    async fn store() -> Store {
        let store = Store::in_memory(Clock::start(), DemoSecrets::Refused).unwrap();
        store.add_user("anna", Role::Operator, "135791").await.unwrap();
        store.add_user("bert", Role::Operator, "246802").await.unwrap();
        store
    }

    async fn user(store: &Store, name: &str, secret: &str) -> Verified {
        store.authenticate(name, secret).await.unwrap().unwrap()
    }

    #[tokio::test]
    async fn an_end_that_is_taken_back_leaves_seat_and_sessions_as_they_were() {
        let store = store().await;
        let (token, session) = store.open_session(&user(&store, "anna", "135791").await).await.unwrap();
        store.take_seat("anna").await.unwrap();

        let leaving = store.leave("anna", record()).await.unwrap();
        assert_eq!(store.seated_operator().await.unwrap(), None);
        assert!(session.is_open(), "it has not happened yet");
        store.take_back(leaving, memory(&store, 1), record().refused("no")).await.unwrap();
        assert_eq!(store.seated_operator().await.unwrap().as_deref(), Some("anna"));
        assert!(session.is_open() && store.session(&token).is_some());

        store.leave("anna", record()).await.unwrap();
        store.left().await.unwrap();
        assert!(!session.is_open() && store.session(&token).is_none());
    }

    #[tokio::test]
    async fn a_hand_over_happens_whole_or_not_at_all() {
        let store = store().await;
        let (token, session) = store.open_session(&user(&store, "anna", "135791").await).await.unwrap();
        store.take_seat("anna").await.unwrap();
        let bert = user(&store, "bert", "246802").await;
        let enter = || {
            let seat = Some(memory(&store, 1));
            let entering = Entering { user: &bert, before: Some(&session), seat, from: Some("anna") };
            store.enter(entering, vec![record()])
        };

        let (theirs, written) = enter().await.unwrap();
        assert!(session.is_open() && store.session(&theirs).is_none(), "it has not happened yet");
        assert_eq!(store.seated_operator().await.unwrap().as_deref(), Some("bert"));
        store.take_back(written, memory(&store, 1), record().refused("no")).await.unwrap();
        assert!(session.is_open() && store.session(&token).is_some() && store.session(&theirs).is_none());
        assert_eq!(store.seated_operator().await.unwrap().as_deref(), Some("anna"));

        let (theirs, _) = enter().await.unwrap();
        assert_eq!(&*store.entered(&theirs).await.unwrap().user, "bert");
        assert!(!session.is_open() && store.session(&token).is_none());
        assert_eq!(store.seated_operator().await.unwrap().as_deref(), Some("bert"));
    }
}
