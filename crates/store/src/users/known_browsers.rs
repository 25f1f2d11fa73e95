//! Known browsers: a cookie marks a browser in which a user logged in before. Strangers who guess that
//! user's secret do not delay a login from it. Source: OWASP, "Slow Down Online Guessing Attacks with
//! Device Cookies".

use rusqlite::params;

use crate::{Caller, Store, StoreError, Token, Verified};
use telltale_clock::unix_ms;

/// Cookies for each user; a new one replaces the oldest.
const DEVICES_PER_USER: usize = 16;

impl Store {
    /// Makes a cookie by which a browser is known as one of this user's.
    ///
    /// # Errors
    /// If there is no such user any more, or the database fails.
    pub async fn know_device(&self, user: &Verified) -> Result<Token, StoreError> {
        let token = Token::random()?;
        let (key, user, created_ms) = (token.key(), user.clone(), unix_ms(self.clock.wall()));
        self.call(move |database| {
            database.change(&[], |transaction| {
                transaction.execute(
                    "INSERT INTO devices (token_hash, user, created_ms) VALUES (?1, ?2, ?3)",
                    params![key, user.id, created_ms],
                )?;
                transaction.execute(
                    "DELETE FROM devices WHERE user = ?1 AND token_hash NOT IN (
                         SELECT token_hash FROM devices WHERE user = ?1
                         ORDER BY token_hash = ?2 DESC, created_ms DESC LIMIT ?3)",
                    params![user.id, key, DEVICES_PER_USER as i64],
                )?;
                Ok(())
            })
        })
        .await?;
        Ok(token)
    }

    /// Whether a browser with this cookie is one of that user's. Anybody may cause this query.
    pub async fn is_device_of(&self, caller: Caller, token: &Token, name: &str) -> Result<bool, StoreError> {
        let (key, name) = (token.key(), name.to_owned());
        self.call_from(caller, move |database| {
            let sql = "SELECT EXISTS (SELECT 1 FROM devices JOIN users ON users.id = devices.user
                                      WHERE token_hash = ?1 AND name = ?2)";
            Ok(database.connection.query_row(sql, params![key, name], |row| row.get(0))?)
        })
        .await
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DemoSecrets, Role};
    use telltale_clock::Clock;

    #[tokio::test]
    async fn a_user_has_so_many_browsers_and_they_go_with_the_user() {
        let store = Store::in_memory(Clock::start(), DemoSecrets::Refused).unwrap();
        store.add_user("anna", Role::Operator, "135791").await.unwrap();
        store.add_user("bert", Role::Operator, "975310").await.unwrap();
        let anna = store.authenticate("anna", "135791").await.unwrap().unwrap();
        let knows = async |token: &Token, name: &str| {
            store.is_device_of(Caller::Elsewhere, token, name).await.unwrap()
        };
        let mut devices = Vec::new();
        for _ in 0..DEVICES_PER_USER + 3 {
            devices.push(store.know_device(&anna).await.unwrap());
            assert!(knows(&devices[devices.len() - 1], "anna").await, "the newest is known");
        }
        let mut known = 0;
        for device in &devices {
            known += usize::from(knows(device, "anna").await);
            assert!(!knows(device, "bert").await);
        }
        assert_eq!(known, DEVICES_PER_USER);
        store.remove_user("anna").await.unwrap();
        store.add_user("anna", Role::Operator, "135791").await.unwrap();
        assert!(!knows(&devices[devices.len() - 1], "anna").await);
        assert!(store.know_device(&anna).await.is_err());
    }
}
