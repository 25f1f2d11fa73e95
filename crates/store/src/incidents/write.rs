//! Everything that changes what is known of an incident.

use rusqlite::{Connection, OptionalExtension as _, Transaction, params};

use super::Note;
use super::bounds::{bounded, note};
use super::logged::{all_records, columns, kept_target, note_target, recorded_target};
use super::read::{last_number, surely};
use crate::audit::{Action, Record, TELLTALE};
use crate::{Database, Store, StoreError};
use telltale_clock::unix_ms;
use telltale_record::retention::INCIDENTS_MAX;
use telltale_record::summary::Summary;

/// More incidents are not listed, kept or not. [`INCIDENTS_MAX`] leaves room for those that are kept.
const ROWS_MAX: usize = 2 * INCIDENTS_MAX;

/// Numbers are kept as `i64`.
const NUMBER_MAX: u64 = (1 << 53) - 1;

/// An incident that the store has forgotten: its file can be removed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Forgotten {
    pub id: u64,
    pub bytes: u64,
    pub sha256: Option<String>,
}

impl Store {
    /// The number of the next incident. It was never used: it is larger than all that the store knows and than
    /// `largest`, the largest in the folder of the recordings, which outlives a lost database. A disk that does
    /// not take the number is no reason not to record: the file with it tells the next call.
    pub async fn next_incident_number(&self, largest: u64) -> Result<u64, StoreError> {
        self.call_surely(move |database| database.next_incident_number(largest)).await
    }

    /// Stores an incident that has begun.
    ///
    /// # Errors
    /// If there are too many, or the database fails.
    pub async fn incident_opened(&self, summary: &Summary) -> Result<(), StoreError> {
        self.incident_updated(summary).await
    }

    /// Stores what is known of an incident by now, in place of what was known before. Its note and whether it
    /// is kept stay; a first mark makes it kept.
    ///
    /// # Errors
    /// If there are too many, or the database fails.
    pub async fn incident_updated(&self, summary: &Summary) -> Result<(), StoreError> {
        let row = Row::of(summary)?;
        // A copy of a damaged database in memory takes it too: it is listed until the next start.
        self.call_surely(move |database| database.write(&[], |transaction| put(transaction, &row))).await
    }

    /// Stores an incident whose recording is finished, with the hash in the audit log, in one transaction. It
    /// may be called again if it failed, and for a file that was made whole after a crash.
    ///
    /// # Errors
    /// If the database fails: then neither is written.
    pub async fn incident_finished(&self, summary: &Summary) -> Result<(), StoreError> {
        self.finish_incident(summary, Action::IncidentRecorded).await
    }

    /// Stores an incident that left only its recording.
    ///
    /// # Errors
    /// If there are too many, or the database fails: then neither it nor its hash is written.
    pub async fn incident_found(&self, summary: &Summary) -> Result<(), StoreError> {
        self.finish_incident(summary, Action::IncidentFound).await
    }

    async fn finish_incident(&self, summary: &Summary, action: Action) -> Result<(), StoreError> {
        let row = Row::of(summary)?;
        let hash = row.summary.recording.sha256.as_deref();
        let target = recorded_target(row.summary.id, hash, Some(&row.json));
        let record = Record::of(action, TELLTALE).on(target);
        self.call_surely(move |database| database.write(&[record], |transaction| put(transaction, &row)))
            .await
    }

    /// Writes a note about an incident in place of the last one; an empty one removes it. `record` says who
    /// writes.
    ///
    /// # Errors
    /// If there is no such incident, or the database fails.
    pub async fn set_incident_note(&self, id: u64, text: &str, record: Record) -> Result<(), StoreError> {
        let text = note(text);
        let record = Record { action: Action::IncidentNote, ..record }.on(note_target(id, &text));
        self.call(move |database| {
            let at_ms = unix_ms(database.clock.wall());
            let by = record.who.clone();
            database.change(&[record], |transaction| {
                let sql = "UPDATE incidents SET note = ?2, note_by = ?3, note_ms = ?4 WHERE id = ?1";
                found(id, transaction.execute(sql, params![id as i64, text, by, at_ms])?)
            })
        })
        .await
    }

    /// Takes over the note that was found beside the recording of an incident, as it was written then.
    ///
    /// # Errors
    /// If there is no such incident, or the database fails.
    pub async fn incident_note_found(&self, id: u64, found_note: Note) -> Result<(), StoreError> {
        let Note { text, by, at_ms } = found_note;
        let (text, by) = (note(&text), note(&by));
        let record = Record::of(Action::IncidentNote, TELLTALE).on(note_target(id, &text));
        self.call(move |database| {
            database.change(&[record], |transaction| {
                let sql = "UPDATE incidents SET note = ?2, note_by = ?3, note_ms = ?4 WHERE id = ?1";
                found(id, transaction.execute(sql, params![surely(id), text, by, at_ms])?)
            })
        })
        .await
    }

    /// Keeps an incident, or lets it go with the oldest again. `record` says who does.
    ///
    /// # Errors
    /// If there is no such incident, or the database fails.
    pub async fn keep_incident(&self, id: u64, kept: bool, record: Record) -> Result<(), StoreError> {
        let record = Record { action: Action::IncidentKept, ..record }.on(kept_target(id, kept));
        self.call(move |database| {
            database.change(&[record], |transaction| {
                let sql = "UPDATE incidents SET kept = ?2 WHERE id = ?1";
                found(id, transaction.execute(sql, params![id as i64, kept])?)
            })
        })
        .await
    }

    /// Forgets these incidents, each with a record of its hash in the audit log. Those that are kept or not
    /// finished stay. Returns those that are forgotten: their files are removed after this, so that no row is
    /// ever without its file.
    ///
    /// # Errors
    /// If the database fails: then none is forgotten.
    pub async fn forget_incidents(
        &self,
        ids: Vec<u64>,
        record: Record,
    ) -> Result<Vec<Forgotten>, StoreError> {
        self.call_surely(move |database| {
            let going: Vec<Forgotten> = ids
                .into_iter()
                .filter_map(|id| removable(&database.connection, id).transpose())
                .collect::<Result<_, _>>()?;
            if going.is_empty() {
                return Ok(going);
            }
            let record_of = |it: &Forgotten| {
                let record = Record { action: Action::IncidentRemoved, ..record.clone() };
                record.on(recorded_target(it.id, it.sha256.as_deref(), None))
            };
            let records: Vec<Record> = going.iter().map(record_of).collect();
            database.change(&records, |transaction| {
                let sql = "DELETE FROM incidents WHERE id = ?1 AND finished AND NOT kept";
                let mut delete = transaction.prepare_cached(sql)?;
                for it in &going {
                    // Another program may have kept it meanwhile.
                    found(it.id, delete.execute([it.id as i64])?)?;
                }
                Ok(())
            })?;
            Ok(going)
        })
        .await
    }
}

impl Database {
    fn next_incident_number(&mut self, largest: u64) -> Result<u64, StoreError> {
        let known = last_number(&self.connection)?;
        let next = known.max(largest.min(NUMBER_MAX - 1)) + 1;
        let noted = self.write(&[], |transaction| note_number(transaction, next));
        if let Err(error) = noted {
            tracing::error!(%error, "the number {next} of an incident cannot be noted");
            self.health.judge(&error);
        }
        Ok(next)
    }
}

/// Notes the largest number that the records of the audit log name.
pub(crate) fn note_largest(transaction: &Transaction<'_>) -> Result<(), StoreError> {
    all_records(transaction, None)?.largest().map_or(Ok(()), |number| note_number(transaction, number))
}

/// The number is used, also when its incident is forgotten.
fn note_number(transaction: &Transaction<'_>, number: u64) -> Result<(), StoreError> {
    let sql = "INSERT INTO incident_number (one, last) VALUES (1, ?1)
               ON CONFLICT (one) DO UPDATE SET last = max(last, ?1)";
    transaction.prepare_cached(sql)?.execute([surely(number)])?;
    Ok(())
}

/// A summary within its bounds, and as it is stored.
struct Row {
    summary: Summary,
    json: String,
}

impl Row {
    fn of(summary: &Summary) -> Result<Row, StoreError> {
        let summary = bounded(summary);
        let json = serde_json::to_string(&summary).map_err(|error| StoreError::Files(error.to_string()))?;
        Ok(Row { summary, json })
    }
}

fn put(transaction: &Transaction<'_>, Row { summary, json }: &Row) -> Result<(), StoreError> {
    let id = surely(summary.id);
    note_number(transaction, summary.id)?;
    let is_known = transaction.query_row("SELECT 1 FROM incidents WHERE id = ?1", [id], |_| Ok(()));
    if is_known.optional()?.is_none() {
        let count: i64 = transaction.query_row("SELECT count(*) FROM incidents", [], |row| row.get(0))?;
        if count >= ROWS_MAX as i64 {
            return Err(StoreError::ManyIncidents);
        }
    }
    let (since_ms, until_ms, marked, bytes, finished, sha256, stage, causes) = columns(summary);
    transaction
        .prepare_cached(
            "INSERT INTO incidents (id, since_ms, until_ms, marked, kept, bytes, finished, sha256, stage, causes, summary)
             VALUES (?1, ?2, ?3, ?4, ?4, ?5, ?6, ?7, ?8, ?9, ?10)
             ON CONFLICT (id) DO UPDATE SET since_ms = ?2, until_ms = ?3, marked = ?4,
                 kept = kept OR (?4 AND NOT marked), bytes = ?5, finished = ?6, sha256 = ?7, stage = ?8,
                 causes = ?9, summary = ?10",
        )?
        .execute(params![id, since_ms, until_ms, marked, bytes, finished, sha256, stage, causes, json])?;
    Ok(())
}

fn removable(connection: &Connection, id: u64) -> Result<Option<Forgotten>, StoreError> {
    let sql = "SELECT bytes, sha256 FROM incidents WHERE id = ?1 AND finished AND NOT kept";
    let mut query = connection.prepare_cached(sql)?;
    let row = query.query_row([surely(id)], |row| {
        Ok(Forgotten { id, bytes: row.get::<_, i64>(0)?.unsigned_abs(), sha256: row.get(1)? })
    });
    Ok(row.optional()?)
}

fn found(id: u64, rows: usize) -> Result<(), StoreError> {
    if rows == 0 { Err(StoreError::NoSuchIncident(id)) } else { Ok(()) }
}
