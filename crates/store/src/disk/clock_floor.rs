//! A floor for the wall clock. A clock that starts in 1970, or some months ago, must not make expired
//! sessions and tokens valid again: they are judged by no time before the release of this version or before
//! the newest record.

use std::time::{Duration, SystemTime};

use rusqlite::Connection;

use crate::database::from_unix_ms;
use crate::{Database, Store, StoreError};
use telltale_clock::earliest;
use telltale_clock::unix_ms;

/// A record that is further ahead was written by a wrong clock and is ignored.
const CREDIBLE: Duration = Duration::from_secs(20 * 365 * 24 * 3600);

/// The number of records among which the newest is searched.
const RECORDS: i64 = 10_000;

/// A time that has certainly passed.
pub(crate) fn of(connection: &Connection) -> Result<SystemTime, StoreError> {
    let sql = "SELECT max(at) FROM (
            SELECT at_ms AS at FROM (SELECT at_ms FROM audit ORDER BY number DESC LIMIT ?2)
            UNION ALL SELECT created_ms FROM users
            UNION ALL SELECT created_ms FROM tokens
            UNION ALL SELECT max(created_ms, used_ms) FROM sessions
        ) WHERE at <= ?1";
    let latest = unix_ms(earliest() + CREDIBLE);
    let newest: Option<i64> = connection.query_row(sql, (latest, RECORDS), |row| row.get(0))?;
    Ok(newest.map_or(earliest(), |newest| from_unix_ms(newest).max(earliest())))
}

impl Store {
    /// The time that had certainly passed when the database was opened: an earlier wall clock is wrong.
    pub fn floor(&self) -> SystemTime {
        self.floor
    }
}

impl Database {
    /// The present time for sessions and tokens. After a clock that was ahead, it goes on from the floor while the program runs.
    pub(crate) fn judged(&self) -> SystemTime {
        let passed = Duration::from_nanos(self.clock.now().since(self.opened).as_nanos());
        self.clock.wall().max(self.floor + passed)
    }
}

#[cfg(test)]
mod tests {
    use std::time::UNIX_EPOCH;

    use super::*;
    use crate::audit::{Action, Record, TELLTALE};
    use crate::{DemoSecrets, Role};
    use telltale_clock::{Clock, ClockHand};
    use telltale_engine::time::Span;

    const DAY: Duration = Duration::from_secs(24 * 3600);

    fn open(folder: &std::path::Path, wall: SystemTime) -> Store {
        open_by_hand(folder, wall).0
    }

    fn open_by_hand(folder: &std::path::Path, wall: SystemTime) -> (Store, ClockHand) {
        let (clock, hand) = Clock::with_hand();
        let seconds = |wall| unix_ms(wall).div_euclid(1000);
        hand.step_wall(seconds(wall) - seconds(clock.wall()));
        (Store::open_or_read(folder, clock, DemoSecrets::Refused).unwrap(), hand)
    }

    #[tokio::test]
    async fn what_has_expired_stays_so_when_the_clock_starts_too_early_and_people_log_in() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let today = earliest() + 200 * DAY;
        let store = open(folder, today);
        store.add_user("dora", Role::Developer, "correct horse battery").await.unwrap();
        let token = store.add_token("dora", "", 30).await.unwrap();
        let user = store.authenticate("dora", "correct horse battery").await.unwrap().unwrap();
        let (session, _) = store.open_session(&user).await.unwrap();
        store.close().await;
        let store = open(folder, today + 40 * DAY);
        assert!(store.session(&token).is_none(), "its 30 days are over");
        store.record_in_time(Record::of(Action::Start, TELLTALE)).await;
        store.close().await;

        for wrong in [UNIX_EPOCH, earliest() - DAY, today, today + 20 * DAY] {
            let store = open(folder, wrong);
            assert!(store.session(&token).is_none(), "{wrong:?}");
            let over = store.session(&session).is_none_or(|it| it.expires <= store.clock.now());
            assert!(over, "{wrong:?}: a session of forty days ago");
            assert!(store.floor() >= today + 40 * DAY, "{wrong:?}");
            let user = store.authenticate("dora", "correct horse battery").await.unwrap().unwrap();
            let (fresh, _) = store.open_session(&user).await.unwrap();
            store.close().await;
            let store = open(folder, wrong);
            assert!(
                store.session(&fresh).is_some_and(|it| it.expires > store.clock.now()),
                "{wrong:?}: a new one"
            );
            store.close().await;
        }

        // A start fifty years ahead keeps nobody out once the clock is right again.
        let store = open(folder, today + 50 * 365 * DAY);
        store.record_in_time(Record::of(Action::Start, TELLTALE)).await;
        store.close().await;
        let store = open(folder, today + 41 * DAY);
        assert!(store.floor() < today + 50 * DAY, "{:?}", store.floor());
        let user = store.authenticate("dora", "correct horse battery").await.unwrap().unwrap();
        let (fresh, _) = store.open_session(&user).await.unwrap();
        store.close().await;
        assert!(open(folder, today + 41 * DAY).session(&fresh).is_some());
    }

    #[tokio::test]
    async fn a_clock_that_was_ahead_makes_no_session_outlast_twelve_hours_of_running() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let today = earliest() + 200 * DAY;
        let store = open(folder, today + 400 * DAY);
        store.add_user("dora", Role::Developer, "correct horse battery").await.unwrap();
        let user = store.authenticate("dora", "correct horse battery").await.unwrap().unwrap();
        let (token, _) = store.open_session(&user).await.unwrap();
        store.close().await;
        for is_open in [true, true, false] {
            let (store, hand) = open_by_hand(folder, today);
            let session = store.session(&token).filter(|it| it.expires > store.clock.now());
            assert_eq!(session.is_some(), is_open);
            hand.advance(Span::from_secs(7 * 3600));
            session.iter().for_each(|session| session.touch(store.clock.now()));
            store.note_used(session.into_iter().collect()).await.unwrap();
            store.close().await;
        }
    }
}
