//! Sessions: who holds which token, until when, and who sits in the operator's seat.

use std::collections::HashMap;
use std::fmt;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, PoisonError, RwLock};
use std::time::{Duration, SystemTime};

use rusqlite::{Connection, OptionalExtension, params};
use sha2::{Digest, Sha256};
use tokio::sync::watch;

use super::audit::Record;
use super::users::{from_unix_ms, role, to_unix_ms};
use super::{Database, Role, Store, StoreError, Verified};
use crate::engine::time::{Span, Timestamp};

/// A session ends this long after its login.
pub const SESSION_LIFE: Duration = Duration::from_secs(12 * 3600);

/// A user's oldest session ends when it opens one more than this.
const SESSIONS_PER_USER: usize = 16;

/// The secret half of a session, as the cookie carries it. Its 256 bits are never stored.
#[derive(Clone)]
pub struct Token(String);

/// SHA-256 of a token: what is stored, and what a session is found by. An attacker who
/// measures the search learns about hashes, not about tokens.
pub(super) type Key = [u8; 32];

/// Whose session it is: a person's, who logged in, or a program's, by its token.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SessionKind {
    Person,
    Program,
}

/// An open session.
#[derive(Debug, Clone)]
pub struct Session {
    key: Key,
    pub user: Arc<str>,
    pub role: Role,
    pub kind: SessionKind,
    /// On the monotonic clock: a stepped wall clock ends no session.
    pub expires: Timestamp,
    /// When its holder did something last, in nanoseconds of the monotonic clock.
    used: Arc<AtomicU64>,
    /// Its sender lies in the table of open sessions; it closes when the session leaves that.
    ended: watch::Receiver<()>,
}

#[derive(Debug, Default)]
pub(super) struct Sessions(RwLock<HashMap<Key, Open>>);

#[derive(Debug)]
struct Open {
    session: Session,
    _ends: watch::Sender<()>,
}

impl Token {
    pub(super) fn random() -> Result<Token, StoreError> {
        let mut bytes = [0; 32];
        getrandom::fill(&mut bytes).map_err(StoreError::Random)?;
        Ok(Token(bytes.iter().map(|byte| format!("{byte:02x}")).collect()))
    }

    /// What a cookie or a header claims to be a token.
    pub fn parse(text: &str) -> Option<Token> {
        let is_token = text.len() == 64 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
        is_token.then(|| Token(text.to_owned()))
    }

    pub fn as_str(&self) -> &str {
        &self.0
    }

    pub(super) fn key(&self) -> Key {
        Sha256::digest(self.0.as_bytes()).into()
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Token(..)")
    }
}

impl Session {
    /// Whether it was not ended. Its expiry is for the caller to judge.
    pub fn is_open(&self) -> bool {
        self.ended.has_changed().is_ok()
    }

    /// Waits until it is ended.
    pub async fn ended(&mut self) {
        while self.ended.changed().await.is_ok() {}
    }

    /// Its holder did something.
    pub fn touch(&self, now: Timestamp) {
        self.used.fetch_max(now.as_nanos(), Ordering::Relaxed);
    }

    /// How long its holder has done nothing.
    pub fn idle(&self, now: Timestamp) -> Span {
        now.since(Timestamp::from_nanos(self.used.load(Ordering::Relaxed)))
    }

    pub(super) fn key(&self) -> Key {
        self.key
    }

    /// Whether this is the session of a token.
    pub fn is_of(&self, token: &Token) -> bool {
        self.key == token.key()
    }

    /// Whether both are the same login.
    pub fn is(&self, other: &Session) -> bool {
        self.key == other.key
    }
}

impl Store {
    /// Opens a session with a new token for somebody who just proved to be this user.
    ///
    /// # Errors
    /// [`StoreError::NoSuchUser`] if the user was removed or got another secret meanwhile; else
    /// what the database says.
    pub async fn open_session(&self, user: &Verified) -> Result<(Token, Session), StoreError> {
        let token = Token::random()?;
        let key = token.key();
        let created = self.clock.wall();
        let user = user.clone();
        let session = self
            .call(move |database| {
                let transaction = database.connection.transaction()?;
                insert_session(&transaction, &user, key, created)?;
                transaction.commit()?;
                database.reload_sessions()?;
                database.sessions.find(&key).ok_or(StoreError::SessionEnded)
            })
            .await?;
        Ok((token, session))
    }

    /// The open session of this token. It never waits.
    pub fn session(&self, token: &Token) -> Option<Session> {
        self.sessions.find(&token.key())
    }

    /// All open sessions, in no order.
    pub fn sessions(&self) -> Vec<Session> {
        let sessions = self.sessions.0.read().unwrap_or_else(PoisonError::into_inner);
        sessions.values().map(|open| open.session.clone()).collect()
    }

    /// Ends a session and records why, both or neither.
    ///
    /// # Errors
    /// If the database fails; the session is open then.
    pub async fn end_session(&self, session: &Session, record: Record) -> Result<(), StoreError> {
        let key = session.key;
        self.call(move |database| {
            database.change(&[record], |transaction| {
                transaction.execute("DELETE FROM sessions WHERE token_hash = ?1", [key])?;
                Ok(())
            })?;
            database.reload_sessions()
        })
        .await
    }

    /// Puts an operator into the seat without a login.
    #[cfg(test)]
    pub(super) async fn take_seat(&self, operator: &str) -> Result<(), StoreError> {
        let operator = operator.to_owned();
        self.call(move |database| {
            database.connection.execute(
                "INSERT INTO seat (one, user) SELECT 1, id FROM users WHERE name = ?1
                 ON CONFLICT (one) DO UPDATE SET user = excluded.user",
                [operator],
            )?;
            Ok(())
        })
        .await
    }

    /// Who sat in the operator's seat last and has an open session still.
    ///
    /// # Errors
    /// If the database fails.
    pub async fn seated_operator(&self) -> Result<Option<String>, StoreError> {
        let now_ms = to_unix_ms(self.clock.wall());
        self.call(move |database| {
            let name = database.connection.query_row(
                "SELECT name FROM users JOIN seat ON seat.user = users.id
                 WHERE role = 'operator' AND EXISTS (
                     SELECT 1 FROM sessions WHERE sessions.user = users.id AND expires_ms > ?1)",
                [now_ms],
                |row| row.get(0),
            );
            Ok(name.optional()?)
        })
        .await
    }
}

/// Writes a new session of somebody who just proved to be this user; the oldest ends that is too many.
pub(super) fn insert_session(
    connection: &Connection,
    user: &Verified,
    key: Key,
    created: SystemTime,
) -> Result<(), StoreError> {
    let opened = connection.execute(
        "INSERT INTO sessions (token_hash, user, created_ms, expires_ms)
         SELECT ?1, id, ?4, ?5 FROM users WHERE id = ?2 AND secret_hash = ?3",
        params![key, user.id, user.secret_hash, to_unix_ms(created), to_unix_ms(created + SESSION_LIFE)],
    )?;
    if opened == 0 {
        return Err(StoreError::NoSuchUser(user.name.clone()));
    }
    connection.execute(
        "DELETE FROM sessions WHERE user = ?1 AND token_hash NOT IN (
             SELECT token_hash FROM sessions WHERE user = ?1
             ORDER BY token_hash = ?2 DESC, created_ms DESC LIMIT ?3)",
        params![user.id, key, SESSIONS_PER_USER as i64],
    )?;
    Ok(())
}

impl Sessions {
    fn find(&self, key: &Key) -> Option<Session> {
        let sessions = self.0.read().unwrap_or_else(PoisonError::into_inner);
        sessions.get(key).map(|open| open.session.clone())
    }
}

impl Database {
    /// Brings the table of open sessions in line with the database. Sessions that stay keep
    /// their deadline; those that left end at once.
    pub(super) fn reload_sessions(&mut self) -> Result<(), StoreError> {
        let wall = self.clock.wall();
        let now = self.clock.now();
        let mut query = self.connection.prepare_cached(
            "SELECT token_hash, name, role, expires_ms, 0 FROM sessions JOIN users ON users.id = sessions.user
             UNION ALL
             SELECT token_hash, name, role, expires_ms, 1 FROM tokens JOIN users ON users.id = tokens.user
             WHERE role <> 'operator'",
        )?;
        let rows = query.query_map([], |row| {
            let left = from_unix_ms(row.get(3)?).duration_since(wall).unwrap_or_default();
            let (kind, left) = match row.get(4)? {
                0 => (SessionKind::Person, left.min(SESSION_LIFE)),
                _ => (SessionKind::Program, left),
            };
            let expires = now + Span::from_nanos(u64::try_from(left.as_nanos()).unwrap_or(u64::MAX / 2));
            Ok((row.get::<_, Key>(0)?, row.get::<_, String>(1)?, role(row, 2)?, expires, kind))
        })?;
        let rows: Vec<_> = rows.collect::<Result<_, _>>()?;

        let mut sessions = self.sessions.0.write().unwrap_or_else(PoisonError::into_inner);
        let mut before = std::mem::take(&mut *sessions);
        for (key, user, role, expires, kind) in rows {
            let same = |open: &Open| *open.session.user == *user && open.session.role == role;
            let open = before.remove(&key).filter(same).unwrap_or_else(|| {
                let (ends, ended) = watch::channel(());
                let used = Arc::new(AtomicU64::new(now.as_nanos()));
                let session = Session { key, user: Arc::from(user), role, kind, expires, used, ended };
                Open { session, _ends: ends }
            });
            sessions.insert(key, open);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::Clock;
    use crate::store::DemoSecrets;
    use crate::store::audit::{Action, TELLTALE};

    #[tokio::test]
    async fn a_session_ends_with_its_user_and_its_secret() {
        let store = store_with_users().await;
        for removed in [true, false] {
            let user = store.authenticate("anna", "135791").await.unwrap().unwrap();
            let (token, mut session) = store.open_session(&user).await.unwrap();
            assert!(store.session(&token).unwrap().is(&session) && session.is_open());
            if removed {
                store.change_secret("anna", "135791").await.unwrap();
            } else {
                store.remove_user("anna").await.unwrap();
            }
            session.ended().await;
            assert!(!session.is_open() && store.session(&token).is_none());
            assert!(store.open_session(&user).await.is_err(), "the proof is of the old secret");
        }
    }

    #[tokio::test]
    async fn a_user_has_a_bounded_number_of_sessions_and_keeps_the_newest() {
        let store = store_with_users().await;
        let user = store.authenticate("anna", "135791").await.unwrap().unwrap();
        for _ in 0..SESSIONS_PER_USER + 3 {
            let (token, _) = store.open_session(&user).await.unwrap();
            assert!(store.session(&token).is_some());
        }
        assert_eq!(store.sessions().len(), SESSIONS_PER_USER);
    }

    #[tokio::test]
    async fn the_seat_needs_an_open_session() {
        let store = store_with_users().await;
        let user = store.authenticate("anna", "135791").await.unwrap().unwrap();
        store.take_seat("anna").await.unwrap();
        assert_eq!(store.seated_operator().await.unwrap(), None);
        let (_, session) = store.open_session(&user).await.unwrap();
        assert_eq!(store.seated_operator().await.unwrap().as_deref(), Some("anna"));
        let record = Record::of(Action::SessionEnded, TELLTALE);
        store.end_session(&session, record).await.unwrap();
        assert_eq!(store.seated_operator().await.unwrap(), None);
    }

    async fn store_with_users() -> Store {
        let store = Store::in_memory(Clock::start(), DemoSecrets::Refused).unwrap();
        store.add_user("anna", Role::Operator, "135791").await.unwrap();
        store
    }
}
