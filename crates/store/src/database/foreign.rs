//! Finds parts of a database's schema that are not Telltale's. A foreign trigger would change rows that nobody
//! changes, and another definition of a table takes rows that are wrong.

use std::collections::BTreeMap;

use rusqlite::{Connection, Transaction, TransactionBehavior};

use super::schema::MIGRATIONS;
use crate::{Database, StoreError};
use telltale_yaml::plain::escaped;

/// Entries of a schema that are read. Telltale's own databases have fewer than 50.
const ENTRIES_MAX: usize = 500;
/// The letters of a definition that are read. Telltale's own are shorter.
const DEFINITION_MAX: usize = 10_000;
/// Findings that are named, and the letters of a name in them.
const NAMED_MAX: usize = 5;
const NAME_MAX: usize = 60;

/// The entries of a schema by their kind and name: the table and the definition.
type Entries = BTreeMap<(String, String), (String, Option<String>)>;

/// How much of an entry is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Compare {
    All,
    /// All but the definitions of tables, which differ between versions.
    Names,
}

/// What is not as this version, or the earlier one that made the database, has it; `None` if all is.
pub(crate) fn strange_in(connection: &Connection) -> Option<String> {
    let strange = || {
        let version: u32 = connection.pragma_query_value(None, "user_version", |row| row.get(0))?;
        let Some(steps) = MIGRATIONS.get(..version as usize) else { return Ok(None) };
        let known = Connection::open_in_memory()?;
        steps.iter().try_for_each(|step| known.execute_batch(step))?;
        difference(connection, &known, Compare::All)
    };
    strange().unwrap_or_else(|error: rusqlite::Error| Some(error.to_string()))
}

/// The differences of a database from one that is as it should be; `None` if there are none.
pub(crate) fn difference(
    connection: &Connection,
    known: &Connection,
    compare: Compare,
) -> rusqlite::Result<Option<String>> {
    let (found, known) = (entries(connection, compare)?, entries(known, compare)?);
    let strange = found.iter().filter_map(|(entry @ (kind, name), is)| {
        let (kind, name) = (cut(kind), cut(name));
        match known.get(entry) {
            // A table of another program, with its indexes, takes no part in what Telltale writes.
            None if is_apart(entry, &is.0, &known) => None,
            None => Some(format!("the {kind} {name} of {} is not Telltale's", cut(&is.0))),
            Some(should) if should != is => Some(format!("the {kind} {name} is defined in another way")),
            Some(_) => None,
        }
    });
    let missing = known.keys().filter(|entry| !found.contains_key(*entry));
    let all: Vec<String> =
        strange.chain(missing.map(|(kind, name)| format!("the {kind} {name} is missing"))).collect();
    let more = all.len().saturating_sub(NAMED_MAX);
    let mut said = all[..all.len() - more].join(", ");
    if more > 0 {
        said.push_str(&format!(", and {more} more"));
    }
    Ok((!all.is_empty()).then_some(said))
}

/// Whether an entry belongs to a table of another program: it is one, or an index of one.
fn is_apart((kind, _): &(String, String), table: &str, known: &Entries) -> bool {
    let is_ours = known.keys().any(|(kind, name)| kind == "table" && name == table);
    matches!(&**kind, "table" | "index") && !is_ours
}

/// The tables of `ANALYZE` change no row.
fn entries(connection: &Connection, compare: Compare) -> rusqlite::Result<Entries> {
    let sql = format!(
        "SELECT ifnull(type, ''), ifnull(name, ''), ifnull(tbl_name, ''), substr(sql, 1, {DEFINITION_MAX})
         FROM sqlite_schema
         WHERE NOT (type = 'table' AND name IN ('sqlite_stat1', 'sqlite_stat4')) LIMIT {ENTRIES_MAX}"
    );
    let mut query = connection.prepare(&sql)?;
    let entries = query.query_map([], |row| {
        let kind: String = row.get(0)?;
        let is_compared = compare == Compare::All || kind != "table";
        let definition = if is_compared { row.get(3)? } else { None };
        Ok(((kind, row.get(1)?), (row.get(2)?, definition)))
    })?;
    entries.collect()
}

fn cut(name: &str) -> String {
    escaped(&name.chars().take(NAME_MAX).collect::<String>()).replace('\n', " ")
}

impl Database {
    /// Whether another program has changed the schema since the last look. Before anything is written: a trigger acts
    /// with the first write.
    ///
    /// # Errors
    /// The schema is no longer Telltale's.
    pub(crate) fn check_schema(&mut self) -> Result<(), StoreError> {
        self.schema.check(&self.connection)
    }

    /// Begins to write. The schema is checked under the lock, so no other program changes it before the end.
    ///
    /// # Errors
    /// As [`Database::check_schema`], or if the lock is held for too long.
    pub(crate) fn begin<'a>(
        connection: &'a mut Connection,
        schema: &mut Schema,
    ) -> Result<Transaction<'a>, StoreError> {
        let transaction = connection.transaction_with_behavior(TransactionBehavior::Immediate)?;
        schema.check(&transaction)?;
        Ok(transaction)
    }
}

/// The version of the schema that was found to be Telltale's.
#[derive(Debug)]
pub(crate) struct Schema {
    /// A command of a short life reads what there is.
    is_checked: bool,
    checked: Option<i64>,
}

impl Schema {
    pub(crate) fn new(is_checked: bool) -> Schema {
        Schema { is_checked, checked: None }
    }

    fn check(&mut self, connection: &Connection) -> Result<(), StoreError> {
        if !self.is_checked {
            return Ok(());
        }
        let version = connection.pragma_query_value(None, "schema_version", |row| row.get(0))?;
        if self.checked == Some(version) {
            return Ok(());
        }
        match strange_in(connection) {
            None => {
                self.checked = Some(version);
                Ok(())
            }
            Some(what) => Err(StoreError::Database(damage(&what))),
        }
    }
}

/// The error of SQLite for a damaged database.
pub(crate) fn damage(what: &str) -> rusqlite::Error {
    rusqlite::Error::SqliteFailure(
        rusqlite::ffi::Error::new(rusqlite::ffi::SQLITE_CORRUPT),
        Some(what.to_owned()),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audit::{Action, COMMAND_LINE, Record};
    use crate::{DemoSecrets, FILE_NAME, Role, Store, check_data, repair};
    use std::path::Path;
    use std::sync::{Condvar, Mutex};
    use telltale_clock::Clock;

    const HANGS: &str = "CREATE TRIGGER hang AFTER INSERT ON audit BEGIN SELECT (WITH RECURSIVE n(i) AS
        (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 1e15) SELECT count(*) FROM n); END";

    fn run(folder: &Path, sql: &str) {
        Connection::open(folder.join(FILE_NAME)).unwrap().execute_batch(sql).unwrap();
    }

    fn serve(folder: &Path) -> Store {
        Store::open_or_read(folder, Clock::start(), DemoSecrets::Refused).unwrap()
    }

    async fn folder() -> tempfile::TempDir {
        let temporary = tempfile::tempdir().unwrap();
        let store = serve(temporary.path());
        store.add_user("anna", Role::Operator, "135791").await.unwrap();
        store.close().await;
        temporary
    }

    #[tokio::test]
    async fn what_is_not_ours_in_the_schema_is_named_kept_out_of_use_and_repaired() {
        let cases = [
            (HANGS, "the trigger hang of audit is not Telltale's"),
            ("CREATE VIEW \"a\u{1b}b\" AS SELECT 1", "the view a\\u{1b}b of a\\u{1b}b is not Telltale's"),
            ("CREATE UNIQUE INDEX one ON audit(who)", "the index one of audit is not Telltale's"),
            ("DROP INDEX audit_by_action", "the index audit_by_action is missing"),
            (
                "PRAGMA writable_schema = ON;
                 UPDATE sqlite_schema SET sql = replace(sql, 'outcome TEXT NOT NULL', 'outcome TEXT') WHERE name = 'audit'",
                "the table audit is defined in another way",
            ),
            ("CREATE VIEW a AS SELECT 1; CREATE VIEW b AS SELECT 1; CREATE VIEW c AS SELECT 1; CREATE VIEW d AS SELECT 1; CREATE VIEW e AS SELECT 1; CREATE VIEW f AS SELECT 1", "and 1 more"),
        ];
        for (sql, says) in cases {
            let temporary = folder().await;
            let folder = temporary.path();
            // A table of another program is no harm.
            run(
                folder,
                "ANALYZE; CREATE TABLE notes (text UNIQUE); CREATE INDEX notes_by_text ON notes(text)",
            );
            assert_eq!(check_data(folder).unwrap().damage, None);
            run(folder, sql);
            let damage = check_data(folder).unwrap().damage.unwrap_or_else(|| panic!("{says}"));
            assert!(damage.contains(says), "{damage}");
            // The server works with the rows alone, and says what to do.
            let store = serve(folder);
            assert!(store.authenticate("anna", "135791").await.unwrap().is_some(), "{says}");
            let fault = store.fault().borrow().clone().unwrap_or_else(|| panic!("{says}"));
            assert!(fault.contains(says) && fault.contains("telltale data repair"), "{fault}");
            store.close().await;
            let data = folder.to_owned();
            std::thread::spawn(move || repair(&data, Clock::start()).unwrap()).join().unwrap();
            assert_eq!(check_data(folder).unwrap().damage, None, "{says}");
            let store = serve(folder);
            assert_eq!(*store.fault().borrow(), None, "{says}");
            assert!(store.authenticate("anna", "135791").await.unwrap().is_some(), "{says}");
            store.close().await;
        }
    }

    #[tokio::test]
    async fn a_trigger_that_comes_while_a_server_runs_never_acts() {
        let temporary = folder().await;
        let folder = temporary.path();
        let store = serve(folder);
        run(folder, HANGS);
        // With the trigger this would never end.
        let user = store.authenticate("anna", "135791").await.unwrap().unwrap();
        let opened = store.open_session(&user).await;
        assert!(opened.is_ok() || opened.is_err_and(|error| error.is_of_storage()));
        let mut fault = store.fault();
        let said =
            fault.wait_for(|fault| fault.as_deref().is_some_and(|it| it.contains("data repair"))).await;
        assert!(said.unwrap().as_deref().is_some_and(|it| it.contains("the trigger hang of audit")));
        store.open_session(&user).await.expect("people go on in memory");
        store.close().await;
    }

    /// Held where the store waits for the lock.
    static WAITS: (Mutex<bool>, Condvar) = (Mutex::new(false), Condvar::new());

    #[tokio::test]
    async fn a_trigger_that_comes_while_a_write_waits_for_the_lock_never_acts() {
        let temporary = folder().await;
        let store = serve(temporary.path());
        let other = Connection::open(temporary.path().join(FILE_NAME)).unwrap();
        other.execute_batch(&format!("BEGIN IMMEDIATE; {HANGS}")).unwrap();
        let writing = store.call(|database| {
            database.connection.busy_handler(Some(|_| {
                *WAITS.0.lock().unwrap() = true;
                WAITS.1.notify_all();
                true
            }))?;
            database.write(&[Record::of(Action::Login, COMMAND_LINE)], |_| Ok(()))
        });
        let committing = tokio::task::spawn_blocking(move || {
            let (waits, said) = (WAITS.0.lock().unwrap(), &WAITS.1);
            drop(said.wait_while(waits, |waits| !*waits).unwrap());
            other.execute_batch("COMMIT").unwrap();
        });
        let (written, committed) = tokio::join!(writing, committing);
        committed.unwrap();
        let refused = written.expect_err("the trigger would never end");
        assert!(refused.to_string().contains("the trigger hang of audit"), "{refused}");
        store.close().await;
    }
}
