//! Tests of users and tokens that the audit log does or does not know.

use std::path::Path;

use crate::audit::verify_audit_in;
use crate::{DemoSecrets, FILE_NAME, Role, Store};
use telltale_clock::Clock;

const PASSWORD: &str = "a long password";

async fn folder_with_users() -> tempfile::TempDir {
    let temporary = tempfile::tempdir().unwrap();
    let folder = temporary.path();
    let store = open(folder);
    store.add_user("anna", Role::Operator, "135791").await.unwrap();
    store.add_user("dora", Role::Developer, PASSWORD).await.unwrap();
    store.close().await;
    temporary
}

fn open(folder: &Path) -> Store {
    Store::open_or_read(folder, Clock::start(), DemoSecrets::Refused).unwrap()
}

fn run(folder: &Path, sql: &str) {
    let connection = rusqlite::Connection::open(folder.join(FILE_NAME)).unwrap();
    connection.busy_timeout(std::time::Duration::from_secs(5)).unwrap();
    connection.execute_batch(sql).unwrap();
}

async fn logs_in(store: &Store, name: &str, secret: &str) -> Option<Role> {
    store.authenticate(name, secret).await.unwrap().map(|user| user.role())
}

/// Runs it beside a database with copies of the tables as they were.
fn run_beside(folder: &Path, sql: &str) {
    let kept = folder.join("kept.db");
    run(folder, &format!("ATTACH '{}' AS kept; {sql}", kept.display()));
}

#[tokio::test]
async fn a_user_that_no_record_knows_cannot_log_in() {
    let cases = [
        (
            "inserted",
            "INSERT INTO users (name, role, secret_hash, created_ms)
             SELECT 'eve', 'authority', secret_hash, 0 FROM users WHERE name = 'dora'",
            "eve",
        ),
        ("role", "UPDATE users SET role = 'authority' WHERE name = 'dora'", "dora"),
        (
            "secret",
            "UPDATE users SET secret_hash = (SELECT secret_hash FROM users WHERE name = 'dora') WHERE name = 'anna'",
            "anna",
        ),
        ("renamed", "UPDATE users SET name = 'eve' WHERE name = 'dora'", "eve"),
    ];
    for (case, sql, name) in cases {
        for is_running in [false, true] {
            let temporary = folder_with_users().await;
            let folder = temporary.path();
            let running = is_running.then(|| open(folder));
            run(folder, sql);
            if !is_running {
                let verdict = verify_audit_in(folder, &[], None).unwrap();
                assert_eq!((verdict.breach, verdict.foreign), (None, vec![name.to_owned()]), "{case}");
            }
            let store = running.unwrap_or_else(|| open(folder));
            assert_eq!(logs_in(&store, name, PASSWORD).await, None, "{case}");
            let known: Vec<_> = store.users().await.unwrap().into_iter().filter(|it| !it.is_known).collect();
            assert_eq!(known.iter().map(|it| it.name.as_str()).collect::<Vec<_>>(), [name], "{case}");
            store.close().await;
            let verdict = verify_audit_in(folder, &[], None).unwrap();
            let breach = verdict.breach.unwrap_or_else(|| panic!("{case}: it is recorded"));
            assert!(breach.what.contains(name), "{case}: {breach:?}");
            // It is said once.
            open(folder).close().await;
            assert_eq!(verify_audit_in(folder, &[], None).unwrap().breaches, verdict.breaches, "{case}");
            let store = open(folder);
            let secret = if name == "anna" { "975310" } else { PASSWORD };
            store.change_secret(name, secret).await.unwrap();
            assert!(logs_in(&store, name, secret).await.is_some(), "{case}: it was taken in");
        }
    }
}

#[tokio::test]
async fn who_was_removed_or_changed_cannot_be_put_back() {
    let temporary = folder_with_users().await;
    let folder = temporary.path();
    let store = open(folder);
    let (token, other) =
        (store.add_token("dora", "old", 9).await.unwrap(), store.add_token("dora", "new", 9).await.unwrap());
    store.revoke_token(1).await.unwrap();
    assert!(store.session(&token).is_none() && store.session(&other).is_some());
    run_beside(
        folder,
        "CREATE TABLE kept.users AS SELECT * FROM main.users; CREATE TABLE kept.tokens AS SELECT * FROM main.tokens",
    );
    store.remove_user("anna").await.unwrap();
    store.change_secret("dora", "another long password").await.unwrap();
    store.close().await;
    run_beside(
        folder,
        "INSERT OR REPLACE INTO main.users SELECT * FROM kept.users;
         INSERT OR REPLACE INTO main.tokens SELECT * FROM kept.tokens",
    );
    let store = open(folder);
    assert_eq!(logs_in(&store, "anna", "135791").await, None);
    assert_eq!(logs_in(&store, "dora", PASSWORD).await, None);
    assert!(store.session(&token).is_none() && store.session(&other).is_none());
    store.close().await;
    let verdict = verify_audit_in(folder, &[], None).unwrap();
    assert_eq!(verdict.foreign, ["anna", "dora", "token 2 of dora"]);
}

#[tokio::test]
async fn a_token_that_no_record_knows_opens_nothing_though_its_user_may_log_in() {
    for (case, sql) in [
        ("put back", "INSERT INTO main.tokens SELECT * FROM kept.tokens WHERE label = 'revoked'"),
        ("longer", "UPDATE tokens SET expires_ms = expires_ms + 1 WHERE label = 'changed'"),
        (
            "of somebody else",
            "UPDATE tokens SET user = (SELECT id FROM users WHERE name = 'carl') WHERE label = 'changed'",
        ),
    ] {
        let folder = folder_with_users().await;
        let store = open(folder.path());
        store.add_user("carl", Role::Authority, "another long password").await.unwrap();
        let revoked = store.add_token("dora", "revoked", 9).await.unwrap();
        let changed = store.add_token("dora", "changed", 9).await.unwrap();
        let left = store.add_token("dora", "left alone", 9).await.unwrap();
        run_beside(folder.path(), "CREATE TABLE kept.tokens AS SELECT * FROM main.tokens");
        store.revoke_token(1).await.unwrap();
        store.close().await;
        run_beside(folder.path(), sql);
        let foreign = if case == "put back" { "token 1 of dora" } else { "token 2 of " };
        let verdict = verify_audit_in(folder.path(), &[], None).unwrap();
        assert!(verdict.foreign.len() == 1 && verdict.foreign[0].starts_with(foreign), "{case}: {verdict:?}");
        let store = open(folder.path());
        assert!(store.session(&revoked).is_none(), "{case}");
        assert_eq!(store.session(&changed).is_some(), case == "put back", "{case}");
        assert!(store.session(&left).is_some(), "{case}");
        assert_eq!(logs_in(&store, "dora", PASSWORD).await, Some(Role::Developer), "{case}");
        store.close().await;
    }
}

/// Only where the key is gone is everybody taken as known; the row that names it is no proof.
#[tokio::test]
async fn a_key_that_the_database_does_not_name_makes_nobody_known() {
    for sql in ["DELETE FROM audit_key", "UPDATE audit_key SET id = randomblob(32)"] {
        let temporary = folder_with_users().await;
        let folder = temporary.path();
        run(
            folder,
            &format!(
                "INSERT INTO users (name, role, secret_hash, created_ms)
            SELECT 'eve', 'authority', secret_hash, 0 FROM users WHERE name = 'dora'; {sql}"
            ),
        );
        let store = open(folder);
        assert_eq!(logs_in(&store, "eve", PASSWORD).await, None, "{sql}");
        assert_eq!(logs_in(&store, "dora", PASSWORD).await, Some(Role::Developer), "{sql}");
        store.close().await;
        assert!(verify_audit_in(folder, &[], None).unwrap().breach.is_some(), "{sql}");
    }
}

/// The newest backup tells who was known.
#[tokio::test]
async fn records_that_were_wiped_beside_damage_make_nobody_known() {
    let temporary = folder_with_users().await;
    let folder = temporary.path();
    crate::database::backup::make(folder, std::time::SystemTime::UNIX_EPOCH).unwrap();
    run(
        folder,
        "INSERT INTO users (name, role, secret_hash, created_ms)
        SELECT 'eve', 'authority', secret_hash, 0 FROM users WHERE name = 'dora';
        DELETE FROM audit; CREATE TRIGGER foreign_one AFTER INSERT ON beat BEGIN SELECT 1; END",
    );
    let store = open(folder);
    assert!(store.fault().borrow().as_deref().is_some_and(|fault| fault.contains("damaged")));
    assert_eq!(logs_in(&store, "eve", PASSWORD).await, None);
    assert_eq!(logs_in(&store, "dora", PASSWORD).await, Some(Role::Developer));
}

#[tokio::test]
async fn records_without_the_key_make_nobody_known_and_a_lost_key_locks_nobody_out() {
    let temporary = folder_with_users().await;
    let folder = temporary.path();
    run(
        folder,
        "INSERT INTO users (name, role, secret_hash, created_ms)
         SELECT 'eve', 'authority', secret_hash, 0 FROM users WHERE name = 'dora';
         INSERT INTO audit SELECT number + 1, at_ms, who, role, source, action, 'eve (authority)', outcome, hash
         FROM audit ORDER BY number DESC LIMIT 1",
    );
    // Nor does nonsense in the log, or among the users, hide that.
    run(
        folder,
        "PRAGMA ignore_check_constraints = ON;
         INSERT INTO audit SELECT 0, at_ms, cast(x'ff' AS TEXT), role, source, action, target, outcome, x'00'
         FROM audit ORDER BY number DESC LIMIT 1;
         INSERT INTO users (name, role, secret_hash, created_ms) VALUES ('odd', 'emperor', cast(x'ff' AS TEXT), 0);",
    );
    let store = open(folder);
    assert_eq!(logs_in(&store, "eve", PASSWORD).await, None);
    store.close().await;
    run(folder, "DELETE FROM users WHERE name = 'odd'; DELETE FROM audit WHERE number = 0");
    let store = open(folder);
    assert_eq!(logs_in(&store, "eve", PASSWORD).await, None);
    store.remove_user("eve").await.unwrap();
    store.close().await;
    std::fs::remove_file(folder.join(crate::audit::KEY_FILE_NAME)).unwrap();
    let store = open(folder);
    assert_eq!(logs_in(&store, "dora", PASSWORD).await, Some(Role::Developer));
    assert_eq!(logs_in(&store, "anna", "135791").await, Some(Role::Operator));
}
