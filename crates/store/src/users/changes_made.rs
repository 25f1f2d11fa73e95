//! Changes of users and tokens that the server has taken in.
//!
//! The command line counts each change in the transaction that makes it. The server writes into the same
//! row up to which change it has read the sessions again. That number proves that both use the same
//! database; without it the change may not be in force.

use rusqlite::Transaction;

use crate::{Database, Store, StoreError};

impl Store {
    /// The number of the last change of users and tokens.
    pub async fn last_user_change(&self) -> Result<i64, StoreError> {
        self.call(|database| Ok(database.user_changes()?.0)).await
    }

    /// Whether the server has taken in this change.
    pub async fn is_taken_in(&self, change: i64) -> Result<bool, StoreError> {
        self.call(move |database| Ok(database.user_changes()?.1 >= change)).await
    }
}

/// Counts a change of users or tokens.
pub(crate) fn count(transaction: &Transaction<'_>) -> Result<(), StoreError> {
    transaction.execute("UPDATE user_changes SET made = made + 1", [])?;
    Ok(())
}

impl Database {
    /// Reads the sessions again if another process changed the database.
    pub(crate) fn notice_foreign_changes(&mut self) -> Result<(), StoreError> {
        let version = self.connection.pragma_query_value(None, "data_version", |row| row.get(0))?;
        if version == self.data_version {
            return Ok(());
        }
        self.check_schema()?;
        let serves = self.serves && !self.health.is_reading();
        // Read before the sessions: a change that comes in between is noted the next time.
        let changes = if serves { Some(self.user_changes()?) } else { None };
        self.reload_sessions()?;
        if let Some((made, taken_in)) = changes.filter(|(made, taken_in)| made != taken_in) {
            tracing::debug!(made, taken_in, "users or tokens were changed");
            self.backups.hasten(self.clock.now());
            let transaction = Database::begin(&mut self.connection, &mut self.schema)?;
            transaction.execute("UPDATE user_changes SET taken_in = ?1", [made])?;
            transaction.commit()?;
        }
        self.data_version = version;
        Ok(())
    }

    /// The last change that was made, and the last change that the server has taken in.
    fn user_changes(&self) -> Result<(i64, i64), StoreError> {
        let mut query = self.connection.prepare_cached("SELECT made, taken_in FROM user_changes")?;
        Ok(query.query_row([], |row| Ok((row.get(0)?, row.get(1)?)))?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DemoSecrets, Role};
    use telltale_clock::Clock;

    #[tokio::test]
    async fn the_server_alone_notes_what_it_has_taken_in() {
        let temporary = tempfile::tempdir().unwrap();
        let folder = temporary.path();
        let command = Store::open(folder, Clock::start(), DemoSecrets::Refused).unwrap();
        command.add_user("dora", Role::Developer, "a long password").await.unwrap();
        let first = command.last_user_change().await.unwrap();
        let other = Store::open(folder, Clock::start(), DemoSecrets::Refused).unwrap();
        other.call(Database::notice_foreign_changes).await.unwrap();
        assert!(!command.is_taken_in(first).await.unwrap(), "nobody serves");

        let server = Store::open_or_read(folder, Clock::start(), DemoSecrets::Refused).unwrap();
        assert!(command.is_taken_in(first).await.unwrap(), "it has read all of it at its start");
        let user = server.authenticate("dora", "a long password").await.unwrap().unwrap();
        let (token, _) = server.open_session(&user).await.unwrap();
        for change in 0..3 {
            match change {
                0 => drop(command.add_token("dora", "", 1).await.unwrap()),
                1 => command.revoke_token(1).await.unwrap(),
                _ => command.remove_user("dora").await.unwrap(),
            }
            let number = command.last_user_change().await.unwrap();
            assert_eq!(number, first + change + 1);
            server.call(Database::notice_foreign_changes).await.unwrap();
            assert!(command.is_taken_in(number).await.unwrap());
        }
        assert!(server.session(&token).is_none());
    }
}
