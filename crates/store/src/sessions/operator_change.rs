//! Logins, hand-overs and logouts of operators: each is written before it happens, so that it happens
//! completely or not at all. The table `seat` names the operator in charge.

use rusqlite::{Connection, OptionalExtension, Transaction, params};

use super::table::Row;
use super::{Key, insert_session};
use crate::audit::Record;
use crate::vehicle::write as write_vehicle;
use crate::{Session, Store, StoreError, Token, VehicleMemory, Verified};
use telltale_engine::time::Timestamp;

/// A change that is written and has not happened yet: until it does, the sessions go on as before.
#[derive(Debug)]
pub struct Written {
    /// The session that opens, and the sessions that end.
    comes: Option<Row>,
    goes: Vec<Key>,
    /// The alignment of the table of open sessions at the time of writing.
    alignment: u64,
    /// The earlier operator in charge, and the sessions of the users concerned.
    before: Before,
}

#[derive(Debug)]
struct Before {
    in_charge: Option<i64>,
    sessions: Vec<Stored>,
}

/// A session as it was stored, with the secret that its user had then.
#[derive(Debug)]
struct Stored {
    key: Key,
    user: i64,
    secret_hash: String,
    created_ms: i64,
    expires_ms: i64,
    used_ms: i64,
}

/// A user who proved the secret and logs in.
#[derive(Debug)]
pub struct Entering<'a> {
    pub user: &'a Verified,
    /// The session that the browser had before, which ends.
    pub before: Option<&'a Session>,
    /// The vehicle's state with this operator in charge; `None` for others.
    pub vehicle: Option<VehicleMemory>,
    /// The earlier operator, who leaves all displays.
    pub from: Option<&'a str>,
    /// Sessions of this user that do not end although there are too many.
    pub stay: Vec<Session>,
}

impl Store {
    /// Writes a login with its records. When this returns, it is on the disk; then [`Store::entered`] makes
    /// it happen, or [`Store::take_back`] undoes it. If the disk gets to it after `until`, nothing is
    /// written.
    ///
    /// # Errors
    /// [`StoreError::TooLate`]; [`StoreError::NoSuchUser`] if the user was removed or got another secret
    /// meanwhile; otherwise an error of the database. Nothing is changed then.
    pub fn enter(
        &self,
        entering: Entering<'_>,
        records: Vec<Record>,
        until: Timestamp,
    ) -> impl Future<Output = Result<(Token, Written), StoreError>> + Send + use<> {
        let store = self.clone();
        let Entering { user, before, vehicle, from, stay } = entering;
        let stay: Vec<Key> = stay.iter().map(Session::key).collect();
        let (user, from) = (user.clone(), from.map(str::to_owned));
        let ends = before.map(Session::key);
        async move {
            let token = Token::random()?;
            let key = token.key();
            let written = store.call(move |database| {
                if database.clock.now() >= until {
                    return Err(StoreError::TooLate);
                }
                let created = database.judged();
                let (before, goes) = database.write(&records, |transaction| {
                    let before = Before::of(transaction, [Some(user.name()), from.as_deref()], ends)?;
                    if let Some(ends) = ends {
                        transaction.execute("DELETE FROM sessions WHERE token_hash = ?1", [ends])?;
                    }
                    insert_session(transaction, &user, key, created, &stay)?;
                    if let Some(from) = &from {
                        end_all(transaction, from)?;
                    }
                    if let Some(memory) = &vehicle {
                        put_in_charge(transaction, user.id)?;
                        write_vehicle(transaction, memory)?;
                    }
                    let goes = before.ended(transaction)?;
                    Ok((before, goes))
                })?;
                if let Some(memory) = vehicle {
                    database.is_stored(memory);
                }
                let comes = Some(Row::of_login(key, &user, database.clock.now()));
                Ok(Written { comes, goes, alignment: database.sessions.alignment(), before })
            });
            Ok((token, written.await?))
        }
    }

    /// Opens the session of a login, and ends the sessions that it replaces. It does not wait for the disk.
    ///
    /// # Errors
    /// [`StoreError::SessionEnded`] if the user was removed or got another secret meanwhile.
    pub fn entered(&self, written: Written) -> Result<Session, StoreError> {
        let key = written.comes.as_ref().map(|row| row.key);
        self.left(written);
        key.and_then(|key| self.sessions.find(&key)).ok_or(StoreError::SessionEnded)
    }

    /// Writes that an operator who is logged in replaces the operator in charge, who leaves all displays.
    /// When this returns, it is on the disk; then [`Store::left`] makes it happen, or [`Store::take_back`]
    /// undoes it. If the disk gets to it after `until`, nothing is written.
    ///
    /// # Errors
    /// [`StoreError::TooLate`]; [`StoreError::SessionEnded`] if the user was removed; otherwise an error of
    /// the database. Nothing is changed then.
    pub fn take_over(
        &self,
        session: &Session,
        from: &str,
        memory: VehicleMemory,
        record: Record,
        until: Timestamp,
    ) -> impl Future<Output = Result<Written, StoreError>> + Send + use<> {
        let (store, user, from) = (self.clone(), session.user.clone(), from.to_owned());
        async move {
            let writing = store.call(move |database| {
                if database.clock.now() >= until {
                    return Err(StoreError::TooLate);
                }
                let (before, goes) = database.write(&[record], |transaction| {
                    let before = Before::of(transaction, [Some(&*user), Some(from.as_str())], None)?;
                    let sql = "SELECT id FROM users WHERE name = ?1 AND role = 'operator'";
                    let id = transaction.query_row(sql, [&*user], |row| row.get(0)).optional()?;
                    put_in_charge(transaction, id.ok_or(StoreError::SessionEnded)?)?;
                    end_all(transaction, &from)?;
                    write_vehicle(transaction, &memory)?;
                    let goes = before.ended(transaction)?;
                    Ok((before, goes))
                })?;
                database.is_stored(memory);
                Ok(Written { comes: None, goes, alignment: database.sessions.alignment(), before })
            });
            writing.await
        }
    }

    /// Writes that the operator in charge leaves all displays, with its record. When this returns, it is
    /// on the disk; then [`Store::left`] makes it happen, or [`Store::take_back`] undoes it. If the disk
    /// gets to it after `until`, nothing is written.
    ///
    /// # Errors
    /// If the database fails; nothing is changed then.
    pub fn leave(
        &self,
        user: &str,
        record: Record,
        until: Timestamp,
    ) -> impl Future<Output = Result<Written, StoreError>> + Send + use<> {
        let (store, user) = (self.clone(), user.to_owned());
        async move {
            let writing = store.call(move |database| {
                if database.clock.now() >= until {
                    return Err(StoreError::TooLate);
                }
                let (before, goes) = database.write(&[record], |transaction| {
                    let before = Before::of(transaction, [Some(user.as_str()), None], None)?;
                    end_all(transaction, &user)?;
                    let sql = "DELETE FROM seat WHERE user = (SELECT id FROM users WHERE name = ?1)";
                    transaction.execute(sql, [&user])?;
                    let goes = before.ended(transaction)?;
                    Ok((before, goes))
                })?;
                Ok(Written { comes: None, goes, alignment: database.sessions.alignment(), before })
            });
            writing.await
        }
    }

    /// Ends the sessions of operators who have left. It does not wait for the disk.
    pub fn left(&self, written: Written) {
        self.sessions.change(written.alignment, &written.goes, written.comes);
    }

    /// Restores the operator in charge and the sessions, with the vehicle as it is and a record of the reason.
    ///
    /// # Errors
    /// If the database fails: after a restart the operator then has to log in again.
    pub async fn take_back(
        &self,
        written: Written,
        memory: VehicleMemory,
        record: Record,
    ) -> Result<(), StoreError> {
        self.call_surely(move |database| {
            database.write(&[record], |transaction| {
                if let Some(Row { key, .. }) = written.comes {
                    transaction.execute("DELETE FROM sessions WHERE token_hash = ?1", [key])?;
                }
                for session in written.before.sessions {
                    session.restore(transaction)?;
                }
                transaction.execute("DELETE FROM seat", [])?;
                if let Some(user) = written.before.in_charge {
                    put_in_charge(transaction, user)?;
                }
                write_vehicle(transaction, &memory)
            })?;
            database.is_stored(memory);
            database.reload_sessions()
        })
        .await
    }
}

impl Before {
    /// The operator in charge, and the sessions of these users and of the token with this key.
    fn of(
        transaction: &Transaction<'_>,
        names: [Option<&str>; 2],
        ends: Option<Key>,
    ) -> Result<Before, StoreError> {
        let mut query = transaction.prepare_cached(
            "SELECT token_hash, users.id, secret_hash, sessions.created_ms, expires_ms, used_ms
             FROM sessions JOIN users ON users.id = sessions.user
             WHERE name = ?1 OR name = ?2 OR token_hash = ?3",
        )?;
        let sessions = query.query_map(params![names[0], names[1], ends], |row| {
            Ok(Stored {
                key: row.get(0)?,
                user: row.get(1)?,
                secret_hash: row.get(2)?,
                created_ms: row.get(3)?,
                expires_ms: row.get(4)?,
                used_ms: row.get(5)?,
            })
        })?;
        let sessions = sessions.collect::<Result<_, _>>()?;
        let in_charge = transaction.query_row("SELECT user FROM seat", [], |row| row.get(0)).optional()?;
        Ok(Before { in_charge, sessions })
    }

    /// Sessions that no longer exist.
    fn ended(&self, transaction: &Transaction<'_>) -> Result<Vec<Key>, StoreError> {
        let mut query = transaction.prepare_cached("SELECT 1 FROM sessions WHERE token_hash = ?1")?;
        let mut ended = Vec::new();
        for session in &self.sessions {
            if !query.exists([session.key])? {
                ended.push(session.key);
            }
        }
        Ok(ended)
    }
}

impl Stored {
    /// Restores the session, unless its user was removed or got another secret meanwhile.
    fn restore(self, transaction: &Transaction<'_>) -> Result<(), StoreError> {
        transaction.execute(
            "INSERT OR IGNORE INTO sessions (token_hash, user, created_ms, expires_ms, used_ms)
             SELECT ?1, id, ?4, ?5, ?6 FROM users WHERE id = ?2 AND secret_hash = ?3",
            params![self.key, self.user, self.secret_hash, self.created_ms, self.expires_ms, self.used_ms],
        )?;
        Ok(())
    }
}

fn end_all(connection: &Connection, user: &str) -> Result<(), StoreError> {
    let sql = "DELETE FROM sessions WHERE user = (SELECT id FROM users WHERE name = ?1)";
    connection.execute(sql, [user])?;
    Ok(())
}

/// Puts a user in charge, unless the user was removed.
fn put_in_charge(connection: &Connection, user: i64) -> Result<(), StoreError> {
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
    use crate::audit::{Action, TELLTALE};
    use crate::{Database, DemoSecrets, Role};
    use telltale_clock::Clock;
    use telltale_engine::restart::resume::Restored;

    fn memory(store: &Store, seq: u64) -> VehicleMemory {
        VehicleMemory { seq, at: store.clock.wall(), vehicle: Restored::default() }
    }

    const LATE: Timestamp = Timestamp::from_millis(u32::MAX as u64);

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
    async fn an_end_that_is_taken_back_changes_nothing() {
        let store = store().await;
        let (token, session) = store.open_session(&user(&store, "anna", "135791").await).await.unwrap();
        store.put_in_charge("anna").await.unwrap();

        let leaving = store.leave("anna", record(), LATE).await.unwrap();
        assert_eq!(store.operator_in_charge().await.unwrap(), None);
        assert!(session.is_open(), "it has not happened yet");
        store.take_back(leaving, memory(&store, 1), record().refused("no")).await.unwrap();
        assert_eq!(store.operator_in_charge().await.unwrap().as_deref(), Some("anna"));
        assert!(session.is_open() && store.session(&token).is_some());

        let leaving = store.leave("anna", record(), LATE).await.unwrap();
        store.left(leaving);
        assert!(!session.is_open() && store.session(&token).is_none());
    }

    #[tokio::test]
    async fn a_hand_over_happens_whole_or_not_at_all() {
        let store = store().await;
        let (token, session) = store.open_session(&user(&store, "anna", "135791").await).await.unwrap();
        store.put_in_charge("anna").await.unwrap();
        let bert = user(&store, "bert", "246802").await;
        let enter = || {
            let vehicle = Some(memory(&store, 1));
            let entering = Entering {
                user: &bert,
                before: Some(&session),
                vehicle,
                from: Some("anna"),
                stay: Vec::new(),
            };
            store.enter(entering, vec![record()], LATE)
        };

        let (theirs, written) = enter().await.unwrap();
        assert!(session.is_open() && store.session(&theirs).is_none(), "it has not happened yet");
        assert_eq!(store.operator_in_charge().await.unwrap().as_deref(), Some("bert"));
        store.take_back(written, memory(&store, 1), record().refused("no")).await.unwrap();
        assert!(session.is_open() && store.session(&token).is_some() && store.session(&theirs).is_none());
        assert_eq!(store.operator_in_charge().await.unwrap().as_deref(), Some("anna"));

        let (theirs, written) = enter().await.unwrap();
        assert!(store.entered(written).unwrap().is_of(&theirs));
        assert!(!session.is_open() && store.session(&token).is_none());
        assert_eq!(store.operator_in_charge().await.unwrap().as_deref(), Some("bert"));
    }

    #[tokio::test]
    async fn what_has_happened_waits_for_no_disk_and_brings_nobody_back() {
        let store = store().await;
        let (_, session) = store.open_session(&user(&store, "anna", "135791").await).await.unwrap();
        let bert = user(&store, "bert", "246802").await;
        for is_removed in [false, true] {
            let entering =
                Entering { user: &bert, before: None, vehicle: None, from: Some("anna"), stay: Vec::new() };
            let (token, written) = store.enter(entering, vec![record()], LATE).await.unwrap();
            if is_removed {
                store.remove_user("bert").await.unwrap();
                assert!(matches!(store.entered(written), Err(StoreError::SessionEnded)));
                continue;
            }
            // The disk hangs.
            let (go_on, stuck) = std::sync::mpsc::sync_channel::<()>(0);
            let hanging = tokio::spawn({
                let store = store.clone();
                async move { store.call(move |_| Ok(stuck.recv().is_ok())).await }
            });
            tokio::task::yield_now().await;
            assert!(store.entered(written).unwrap().is_of(&token));
            assert!(!session.is_open());
            go_on.send(()).unwrap();
            assert!(hanging.await.unwrap().unwrap());
            store.call(Database::reload_sessions).await.unwrap();
            assert_eq!(store.sessions().len(), 1, "the database says the same");
        }
        assert!(store.sessions().is_empty());
    }

    #[tokio::test]
    async fn what_is_taken_back_is_no_session_of_an_old_secret() {
        let store = store().await;
        let (token, _) = store.open_session(&user(&store, "anna", "135791").await).await.unwrap();
        let leaving = store.leave("anna", record(), LATE).await.unwrap();
        store.change_secret("anna", "864209").await.unwrap();
        store.take_back(leaving, memory(&store, 1), record().refused("no")).await.unwrap();
        assert!(store.session(&token).is_none());
    }
}
