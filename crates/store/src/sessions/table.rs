//! The table of open sessions in memory. Every request is judged by it, so an end takes effect here at
//! once, whatever the disk does; it is written as soon as the disk works.

use std::collections::{HashMap, HashSet};
use std::sync::atomic::AtomicI64;
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard, RwLockWriteGuard};

use tokio::sync::watch;

use super::guests::{GUESTS_MAX, Grants};
use super::{Key, SESSIONS_PER_USER, nanos, span};
use crate::{Role, SESSION_LIFE, Session, SessionKind, Verified};
use telltale_engine::time::Timestamp;

#[derive(Debug, Default)]
pub(crate) struct Sessions(RwLock<Table>);

#[derive(Debug, Default)]
struct Table {
    open: HashMap<Key, Open>,
    /// Sessions that ended here. An update from the database does not open them again.
    ended: HashSet<Key>,
    /// Sessions that ended here and are not yet removed from the database.
    unwritten: Vec<Key>,
    /// How often the table was updated from the database.
    alignment: u64,
}

#[derive(Debug)]
struct Open {
    session: Session,
    _ends: watch::Sender<()>,
}

/// A session in the database.
#[derive(Debug)]
pub(crate) struct Row {
    pub key: Key,
    pub user: String,
    pub role: Role,
    pub kind: SessionKind,
    pub expires: Timestamp,
    /// The last activity of its holder, in nanoseconds; negative if before the start of this process.
    pub used: i64,
    /// It has expired by the wall clock.
    pub is_late: bool,
}

impl Row {
    /// A session of a new login.
    pub(crate) fn of_login(key: Key, user: &Verified, now: Timestamp) -> Row {
        let (expires, used) = (now + span(SESSION_LIFE), nanos(now));
        let kind = SessionKind::Person;
        Row { key, user: user.name.clone(), role: user.role, kind, expires, used, is_late: false }
    }
}

impl Sessions {
    pub(crate) fn find(&self, key: &Key) -> Option<Session> {
        self.read().open.get(key).map(|open| open.session.clone())
    }

    pub(crate) fn all(&self) -> Vec<Session> {
        self.read().open.values().map(|open| open.session.clone()).collect()
    }

    /// Ends a session; returns whether it was open. The store's thread removes it from the database later.
    pub(crate) fn end(&self, key: Key) -> bool {
        let mut table = self.write();
        let was_open = table.open.remove(&key).is_some();
        if was_open {
            table.ended.insert(key);
            table.unwritten.push(key);
        }
        was_open
    }

    /// Sessions that ended here and are to be removed from the database.
    pub(crate) fn unwritten(&self) -> Vec<Key> {
        self.read().unwritten.clone()
    }

    /// The first `count` of them are written.
    pub(crate) fn written(&self, count: usize) {
        self.write().unwritten.drain(..count);
    }

    pub(crate) fn alignment(&self) -> u64 {
        self.read().alignment
    }

    /// Applies a change that was written at that alignment; a later update has already applied it.
    pub(crate) fn change(&self, alignment: u64, goes: &[Key], comes: Option<Row>) {
        let mut table = self.write();
        if table.alignment == alignment {
            table.open.retain(|key, _| !goes.contains(key));
            table.open.extend(comes.map(|row| (row.key, Open::new(row))));
        }
    }

    /// Adds a session that is in no database. If it is one too many, of its guest or of all, the oldest ends.
    pub(crate) fn add_guest(&self, row: Row, grants: Arc<Grants>, now: Timestamp) -> Session {
        let mut table = self.write();
        table.open.retain(|_, open| !open.is_of_guest() || open.session.expires > now);
        let own = |session: &Session| *session.user == *row.user;
        while table.guests().filter(|it| own(it)).count() >= SESSIONS_PER_USER {
            table.end_oldest_guest(own);
        }
        while table.guests().count() >= GUESTS_MAX {
            table.end_oldest_guest(|_| true);
        }
        let key = row.key;
        let mut open = Open::new(row);
        open.session.grants = Some(grants);
        let session = open.session.clone();
        table.open.insert(key, open);
        session
    }

    /// Updates the table from the database. Sessions that stay keep their deadline; removed sessions end at
    /// once, and sessions that ended here stay ended. Sessions of guests are in no database.
    pub(crate) fn align(&self, rows: Vec<Row>) {
        let mut table = self.write();
        table.alignment += 1;
        let keys: HashSet<Key> = rows.iter().map(|row| row.key).collect();
        table.ended.retain(|key| keys.contains(key));
        let before = std::mem::take(&mut table.open);
        let (guests, mut before) = before.into_iter().partition(|(_, open)| open.is_of_guest());
        table.open = guests;
        for row in rows {
            let same = |open: &Open| *open.session.user == *row.user && open.session.role == row.role;
            let open = before.remove(&row.key).filter(same);
            // A token that had expired before has no session to end.
            let is_nothing = open.is_none() && row.is_late && row.kind == SessionKind::Program;
            if !is_nothing && !table.ended.contains(&row.key) {
                table.open.insert(row.key, open.unwrap_or_else(|| Open::new(row)));
            }
        }
    }

    fn read(&self) -> RwLockReadGuard<'_, Table> {
        self.0.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn write(&self) -> RwLockWriteGuard<'_, Table> {
        self.0.write().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Table {
    fn guests(&self) -> impl Iterator<Item = &Session> {
        self.open.values().map(|open| &open.session).filter(|session| session.is_of_guest())
    }

    fn end_oldest_guest(&mut self, among: impl Fn(&Session) -> bool) {
        let oldest = self.guests().filter(|it| among(it)).min_by_key(|it| it.expires);
        if let Some(key) = oldest.map(|it| it.key) {
            self.open.remove(&key);
        }
    }
}

impl Open {
    fn is_of_guest(&self) -> bool {
        self.session.is_of_guest()
    }

    fn new(row: Row) -> Open {
        let (ends, ended) = watch::channel(());
        let Row { key, user, role, kind, expires, used, .. } = row;
        let used = Arc::new(AtomicI64::new(used));
        let (user, grants, places) = (Arc::from(user), None, Arc::default());
        let session = Session { key, user, role, kind, grants, expires, used, places, ended };
        Open { session, _ends: ends }
    }
}
