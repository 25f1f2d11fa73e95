//! Sessions: their tokens, their users, their time, and the operator in charge of the vehicle.

pub(super) mod guests;
pub(super) mod operator_change;
pub(super) mod places;
pub(super) mod table;

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{Duration, SystemTime};

use rusqlite::{Connection, OptionalExtension, params};
use sha2::{Digest, Sha256};
use tokio::sync::watch;

use super::audit::Record;
use super::audit::known::Mark;
use super::database::from_unix_ms;
use super::{Database, Role, Store, StoreError, Verified};
use guests::Grants;
use table::Row;
use telltale_clock::unix_ms;
use telltale_engine::model::Stage;
use telltale_engine::text::hex;
use telltale_engine::time::{Span, Timestamp};

/// A session ends this long after its login.
pub const SESSION_LIFE: Duration = Duration::from_secs(12 * 3600);

/// A user's oldest session ends when it opens one more than this.
const SESSIONS_PER_USER: usize = 16;

/// The secret half of a session, as the cookie carries it. Its 256 bits are never stored.
#[derive(Clone, PartialEq, Eq, Hash)]
pub struct Token(String);

/// SHA-256 of a token: the store keeps the hash, and finds a session by it. An attacker who measures the
/// search learns about hashes, not about tokens.
pub(super) type Key = [u8; 32];

/// The owner of a session: a person who logged in, or a program with a token.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SessionKind {
    Person,
    Program,
}

/// An open session.
#[derive(Debug, Clone)]
pub struct Session {
    pub(super) key: Key,
    pub user: Arc<str>,
    pub role: Role,
    pub kind: SessionKind,
    /// Of a guest; the role of a user counts for all vehicles.
    pub(super) grants: Option<Arc<Grants>>,
    /// On the monotonic clock, so a stepped wall clock ends no session.
    pub expires: Timestamp,
    /// The last activity of its holder, in nanoseconds of the monotonic clock; negative if before the start
    /// of this process.
    pub(super) used: Arc<AtomicI64>,
    pub(super) places: Arc<places::Places>,
    /// Its sender lies in the table of open sessions; it closes when the session leaves the table.
    pub(super) ended: watch::Receiver<()>,
}

impl Token {
    pub fn random() -> Result<Token, StoreError> {
        let mut bytes = [0; 32];
        getrandom::fill(&mut bytes).map_err(StoreError::Random)?;
        Ok(Token(hex(&bytes)))
    }

    /// Reads the token in a cookie or a header.
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
    /// Whether it has not been ended. The caller judges its expiry.
    pub fn is_open(&self) -> bool {
        self.ended.has_changed().is_ok()
    }

    /// Waits until it is ended.
    pub async fn ended(&mut self) {
        while self.ended.changed().await.is_ok() {}
    }

    /// Notes activity of its holder.
    pub fn touch(&self, now: Timestamp) {
        self.used.fetch_max(nanos(now), Ordering::Relaxed);
    }

    /// How long its holder has been idle, over restarts too.
    pub fn idle(&self, now: Timestamp) -> Span {
        let idle = nanos(now).saturating_sub(self.used.load(Ordering::Relaxed));
        Span::from_nanos(u64::try_from(idle).unwrap_or(0))
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
    /// [`StoreError::NoSuchUser`] if the user was removed or got another secret meanwhile; otherwise an
    /// error of the database.
    pub async fn open_session(&self, user: &Verified) -> Result<(Token, Session), StoreError> {
        let token = Token::random()?;
        let key = token.key();
        let user = user.clone();
        let session = self
            .call(move |database| {
                let created = database.judged();
                database.write(&[], |transaction| insert_session(transaction, &user, key, created, &[]))?;
                database.reload_sessions()?;
                database.sessions.find(&key).ok_or(StoreError::SessionEnded)
            })
            .await?;
        Ok((token, session))
    }

    /// The open session of this token. It never waits for the disk.
    pub fn session(&self, token: &Token) -> Option<Session> {
        self.sessions.find(&token.key())
    }

    /// All open sessions, in no order.
    pub fn sessions(&self) -> Vec<Session> {
        self.sessions.all()
    }

    /// Ends an expired session at once, without waiting for the disk, and records that.
    pub fn end_at_once(&self, session: &Session, record: Record) {
        if self.sessions.end(session.key) {
            self.note(record);
        }
    }

    /// Stores the last activity of the holders of these sessions, so that a restart does not count as
    /// activity.
    pub async fn note_used(&self, sessions: Vec<Session>) -> Result<(), StoreError> {
        let now = self.clock.now();
        self.call(move |database| {
            let wall = database.judged();
            database.write(&[], |transaction| {
                let mut update = transaction
                    .prepare_cached("UPDATE sessions SET used_ms = max(used_ms, ?2) WHERE token_hash = ?1")?;
                for session in sessions {
                    let used = wall.checked_sub(Duration::from_nanos(session.idle(now).as_nanos()));
                    update.execute(params![session.key, used.map_or(0, unix_ms)])?;
                }
                Ok(())
            })
        })
        .await
    }

    /// Ends a session and records why, in one transaction. If the disk gets to it after `until`, nothing is
    /// written.
    ///
    /// # Errors
    /// [`StoreError::TooLate`], or an error of the database; the session is open then.
    pub async fn end_session(
        &self,
        session: &Session,
        record: Record,
        until: Timestamp,
    ) -> Result<(), StoreError> {
        let key = session.key;
        self.call(move |database| {
            if database.clock.now() >= until {
                return Err(StoreError::TooLate);
            }
            database.write(&[record], |transaction| {
                transaction.execute("DELETE FROM sessions WHERE token_hash = ?1", [key])?;
                Ok(())
            })?;
            database.reload_sessions()
        })
        .await
    }

    /// Puts an operator in charge without a login.
    #[cfg(test)]
    pub(super) async fn put_in_charge(&self, operator: &str) -> Result<(), StoreError> {
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

    /// The operator who was in charge last and still has an open session. While the vehicle drives, that session
    /// does not expire.
    pub async fn operator_in_charge(&self) -> Result<Option<String>, StoreError> {
        self.call(move |database| {
            let now_ms = unix_ms(database.judged());
            let name = database.connection.query_row(
                "SELECT name FROM users JOIN seat ON seat.user = users.id
                 WHERE role = 'operator' AND EXISTS (
                     SELECT 1 FROM sessions WHERE sessions.user = users.id
                     AND (expires_ms > ?1 OR EXISTS (SELECT 1 FROM vehicle WHERE stage = ?2)))",
                params![now_ms, Stage::Active.as_str()],
                |row| row.get(0),
            );
            Ok(name.optional()?)
        })
        .await
    }
}

/// Writes a new session of somebody who just proved to be this user. If that is one too many, the oldest
/// ends, unless it is one of those that stay.
pub(super) fn insert_session(
    connection: &Connection,
    user: &Verified,
    key: Key,
    created: SystemTime,
    stay: &[Key],
) -> Result<(), StoreError> {
    let opened = connection.execute(
        "INSERT INTO sessions (token_hash, user, created_ms, expires_ms)
         SELECT ?1, id, ?4, ?5 FROM users WHERE id = ?2 AND secret_hash = ?3",
        params![key, user.id, user.secret_hash, unix_ms(created), unix_ms(created + SESSION_LIFE)],
    )?;
    if opened == 0 {
        return Err(StoreError::NoSuchUser(user.name.clone()));
    }
    let mut query = connection.prepare_cached(
        "SELECT token_hash FROM sessions WHERE user = ?1
         ORDER BY token_hash = ?2 DESC, created_ms DESC LIMIT -1 OFFSET ?3",
    )?;
    let too_many = query.query_map(params![user.id, key, SESSIONS_PER_USER as i64], |row| row.get(0))?;
    for old in too_many.collect::<Result<Vec<Key>, _>>()? {
        if !stay.contains(&old) {
            connection.execute("DELETE FROM sessions WHERE token_hash = ?1", [old])?;
        }
    }
    Ok(())
}

impl Database {
    /// Updates the table of open sessions from the database.
    pub(super) fn reload_sessions(&mut self) -> Result<(), StoreError> {
        self.read_known()?;
        let wall = self.judged();
        let now = self.clock.now();
        let mut query = self.connection.prepare_cached(
            "SELECT token_hash, name, role, 0, expires_ms, max(sessions.created_ms, used_ms), secret_hash
             FROM sessions JOIN users ON users.id = sessions.user
             UNION ALL
             SELECT token_hash, name, role, 1, expires_ms, 0, secret_hash
             FROM tokens JOIN users ON users.id = tokens.user
             WHERE role <> 'operator'",
        )?;
        let rows = query.query_map([], |row| {
            let expires = from_unix_ms(row.get(4)?);
            let left = expires.duration_since(wall).unwrap_or_default();
            let (kind, left) = match row.get(3)? {
                0 => (SessionKind::Person, left.min(SESSION_LIFE)),
                _ => (SessionKind::Program, left),
            };
            let idle = wall.duration_since(from_unix_ms(row.get(5)?)).unwrap_or_default();
            let idle = i64::try_from(idle.as_nanos()).unwrap_or(i64::MAX);
            let (key, user, role): (Key, String, Role) = (row.get(0)?, row.get(1)?, Role::read(row, 2)?);
            let is_known = {
                let known = &self.knowledge;
                let mark = || Mark::of_token(&key, &user, unix_ms(expires));
                known.has_user(&user, role, &row.get::<_, String>(6).unwrap_or_default())
                    && (kind == SessionKind::Person || known.has_token(&mark()))
            };
            Ok(is_known.then_some(Row {
                key,
                user,
                role,
                kind,
                expires: now + span(left),
                used: nanos(now).saturating_sub(idle),
                is_late: expires <= wall,
            }))
        })?;
        let rows: Vec<Option<Row>> = rows.collect::<Result<_, _>>()?;
        self.sessions.align(rows.into_iter().flatten().collect());
        Ok(())
    }
}

pub(super) fn span(time: Duration) -> Span {
    Span::from_nanos(u64::try_from(time.as_nanos()).unwrap_or(u64::MAX / 2))
}

pub(super) fn nanos(at: Timestamp) -> i64 {
    i64::try_from(at.as_nanos()).unwrap_or(i64::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DemoSecrets;
    use crate::audit::{Action, TELLTALE};
    use telltale_clock::Clock;

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
    async fn an_operator_in_charge_has_an_open_session() {
        let store = store_with_users().await;
        let user = store.authenticate("anna", "135791").await.unwrap().unwrap();
        store.put_in_charge("anna").await.unwrap();
        assert_eq!(store.operator_in_charge().await.unwrap(), None);
        let (_, session) = store.open_session(&user).await.unwrap();
        assert_eq!(store.operator_in_charge().await.unwrap().as_deref(), Some("anna"));
        let record = Record::of(Action::SessionEnded, TELLTALE);
        store.end_session(&session, record, Timestamp::from_millis(u64::from(u32::MAX))).await.unwrap();
        assert_eq!(store.operator_in_charge().await.unwrap(), None);
    }

    #[tokio::test]
    async fn a_copy_of_the_data_folder_opens_nothing() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let store = Store::open(folder, Clock::start(), DemoSecrets::Refused).unwrap();
        store.add_user("dora", Role::Developer, "a long password").await.unwrap();
        let user = store.authenticate("dora", "a long password").await.unwrap().unwrap();
        let (session, _) = store.open_session(&user).await.unwrap();
        let token = store.add_token("dora", "", 1).await.unwrap();
        let device = store.know_device(&user).await.unwrap();
        store.close().await;
        let files =
            std::fs::read_dir(folder).unwrap().map(|entry| std::fs::read(entry.unwrap().path()).unwrap());
        let bytes: Vec<u8> = files.flatten().collect();
        let has = |part: &[u8]| bytes.windows(part.len()).any(|it| it == part);
        assert!(has(b"dora") && has(&session.key()) && has(&token.key()), "they are searched where they are");
        for token in [session, token, device] {
            let digits = token.as_str().as_bytes();
            let number =
                digits.chunks(2).map(|pair| u8::from_str_radix(str::from_utf8(pair).unwrap(), 16).unwrap());
            assert!(!has(digits) && !has(&number.collect::<Vec<u8>>()), "it is stored hashed");
        }
        assert!(!has(b"a long password"));
    }

    #[test]
    fn no_part_of_a_token_is_always_the_same() {
        let tokens: Vec<Token> = (0..64).map(|_| Token::random().unwrap()).collect();
        for digit in 0..64 {
            let first = tokens[0].as_str().as_bytes()[digit];
            assert!(tokens.iter().any(|token| token.as_str().as_bytes()[digit] != first), "digit {digit}");
        }
    }

    async fn store_with_users() -> Store {
        let store = Store::in_memory(Clock::start(), DemoSecrets::Refused).unwrap();
        store.add_user("anna", Role::Operator, "135791").await.unwrap();
        store
    }
}
