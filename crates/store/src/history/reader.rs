//! Reads the history while it is written: on a connection of its own, one query at a time, each with a deadline.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use rusqlite::Connection;
use tokio::sync::Semaphore;

use crate::StoreError;

/// Instructions of SQLite between two checks whether somebody still waits: about a tenth of a millisecond.
const LOOK_EVERY: i32 = 10_000;

#[derive(Debug)]
pub struct Reader {
    connection: Arc<Mutex<Connection>>,
    /// The connection for readers. A query that waits for it holds no thread.
    turn: Arc<Semaphore>,
}

/// Interrupts a query that nobody waits for any more.
struct GivenUp(Arc<AtomicBool>);

impl Drop for GivenUp {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

impl Reader {
    pub fn new(connection: Arc<Mutex<Connection>>) -> Reader {
        Reader { connection, turn: Arc::new(Semaphore::new(1)) }
    }

    /// Another file counts from the next query on.
    pub fn replace(&self, connection: Connection) {
        *self.connection.lock().unwrap_or_else(PoisonError::into_inner) = connection;
    }

    /// Answers `query` within this time, including the wait for other queries. A query that takes longer,
    /// or whose caller has gone, is interrupted.
    pub async fn read<T: Send + 'static>(
        &self,
        within: Duration,
        query: impl FnOnce(&Connection) -> rusqlite::Result<T> + Send + 'static,
    ) -> Result<T, StoreError> {
        let answered = async {
            let turn = self.turn.clone().acquire_owned().await.map_err(|_| StoreError::Ended)?;
            let (connection, given_up) = (self.connection.clone(), Arc::new(AtomicBool::new(false)));
            let _asker = GivenUp(given_up.clone());
            let read = tokio::task::spawn_blocking(move || {
                let _turn = turn;
                let mut connection = connection.lock().unwrap_or_else(PoisonError::into_inner);
                connection.progress_handler(LOOK_EVERY, Some(move || given_up.load(Ordering::Relaxed)))?;
                let answer = query(&connection);
                connection.progress_handler(0, None::<fn() -> bool>)?;
                answer
            });
            Ok(read.await.map_err(|_| StoreError::Ended)??)
        };
        tokio::time::timeout(within, answered).await.map_err(|_| StoreError::TooLong { within })?
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PATIENCE: Duration = Duration::from_secs(20);

    fn endless(connection: &Connection) -> rusqlite::Result<i64> {
        let numbers =
            "WITH RECURSIVE n(x) AS (SELECT 1 UNION ALL SELECT x + 1 FROM n) SELECT count(*) FROM n";
        connection.query_row(numbers, [], |row| row.get(0))
    }

    fn one(connection: &Connection) -> rusqlite::Result<i64> {
        connection.query_row("SELECT 1", [], |row| row.get(0))
    }

    fn reader() -> Reader {
        Reader::new(Arc::new(Mutex::new(Connection::open_in_memory().unwrap())))
    }

    #[tokio::test]
    async fn a_query_that_takes_too_long_is_interrupted_and_the_next_one_is_answered() {
        let reader = reader();
        let answer = reader.read(Duration::from_millis(50), endless).await;
        assert!(matches!(answer, Err(StoreError::TooLong { .. })), "{answer:?}");
        assert_eq!(reader.read(PATIENCE, one).await.unwrap(), 1);
    }

    #[tokio::test]
    async fn a_query_whose_asker_has_gone_is_interrupted() {
        let reader = reader();
        let (began, begins) = tokio::sync::oneshot::channel();
        let asked = reader.read(PATIENCE, |connection| {
            began.send(()).unwrap();
            endless(connection)
        });
        tokio::select! {
            answer = asked => panic!("{answer:?}"),
            began = begins => began.unwrap(),
        }
        assert_eq!(reader.read(PATIENCE, one).await.unwrap(), 1);
    }
}
