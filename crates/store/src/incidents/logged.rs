//! The records of the audit log on incidents, and whether their rows agree: the chain of the log proves the rows.

use std::collections::{BTreeMap, BTreeSet};

use rusqlite::{Connection, OptionalExtension as _, Row, params};
use sha2::{Digest as _, Sha256};

use super::read::{COLUMNS, Incidents, incident, surely};
use super::{Incident, Note};
use crate::audit::{Action, DONE, Record, fits};
use crate::database::schema;
use crate::{Store, StoreError};
use telltale_engine::text::hex;
use telltale_record::proof::{Expected, NO_HASH};
use telltale_record::summary::Summary;

/// A longer note stands in the audit log with this beginning and its hash.
const NOTE_CHARS_MAX: usize = 200;

/// The records of the audit log on incidents. Of two hashes of one recording the first counts: a recording that is
/// finished does not change.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct IncidentRecords {
    /// The hash with which each recording was recorded.
    pub hashes: BTreeMap<u64, String>,
    /// Those that were removed since.
    pub removed: Vec<u64>,
    /// Those whose recordings were taken in without an incident, and whose hashes prove nothing before.
    pub found: BTreeSet<u64>,
    /// The hashes of summaries.
    summaries: BTreeMap<u64, String>,
    /// The last records of notes, with the names of their writers.
    notes: BTreeMap<u64, (String, String)>,
    /// Whether each was kept last.
    kept: BTreeMap<u64, bool>,
    /// Incidents with a marked moment.
    marked: BTreeSet<u64>,
}

/// The records of the audit log on one recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Logged {
    /// The hash with which it was recorded.
    pub hash: Option<String>,
    /// The part of its row that the log contradicts.
    pub contradiction: Option<&'static str>,
}

/// An incident as it lies in the database.
#[derive(Debug, Clone, PartialEq)]
pub struct StoredIncident {
    pub incident: Incident,
    id: u64,
    summary: String,
    /// The columns by which incidents are listed and removed say what the summary says.
    columns_agree: bool,
}

impl Logged {
    /// The proof that a recording must meet, by its row and by this.
    pub fn expected(logged: Option<Logged>, row: &Summary) -> Expected {
        let is_row_changed = logged.as_ref().is_some_and(|logged| logged.contradiction.is_some());
        let stored = row.recording.sha256.clone();
        Expected { stored, logged: logged.and_then(|logged| logged.hash), is_row_changed }
    }
}

impl IncidentRecords {
    /// All incidents that must be there, finished or not.
    pub fn held(&self) -> impl Iterator<Item = u64> {
        let named = self.hashes.keys().chain(self.notes.keys()).chain(self.kept.keys()).chain(&self.marked);
        named.copied().filter(|id| !self.removed.contains(id))
    }

    /// The part of a row that the audit log contradicts.
    pub fn contradiction(&self, row: &StoredIncident) -> Option<&'static str> {
        let id = row.id;
        if self.summaries.get(&id).is_some_and(|logged| !row.is_recorded_as(logged)) {
            return Some("what it says of the incident");
        }
        let is_note_logged = match (&row.incident.note, self.notes.get(&id)) {
            (None, None) => true,
            (None, Some((logged, _))) => *logged == note_target(id, ""),
            (Some(_), None) => false,
            (Some(note), Some(_)) => self.has_note(id, note),
        };
        if !is_note_logged {
            return Some("its note");
        }
        let is_marked = row.incident.summary.is_marked();
        let is_kept_logged = match self.kept.get(&id) {
            Some(true) => row.incident.kept,
            // A mark may have come after it.
            Some(false) => is_marked || !row.incident.kept,
            // Its marks may be among the triggers that are only counted.
            None => row.incident.kept || !is_marked,
        };
        (!is_kept_logged).then_some("whether it is kept")
    }

    /// Whether a note is the last one, or nothing is known of the incident.
    pub fn may_be_note(&self, id: u64, note: &Note) -> bool {
        !self.hashes.contains_key(&id) || self.has_note(id, note)
    }

    fn has_note(&self, id: u64, note: &Note) -> bool {
        self.notes.get(&id).is_some_and(|(logged, by)| {
            *logged == note_target(id, &note.text) && (by.is_empty() || *by == note.by)
        })
    }

    /// Whether it was kept last: by the log if that knows the incident, else as `said`. `None`: nobody said so.
    pub fn kept(&self, id: u64, said: Option<bool>) -> Option<bool> {
        if self.hashes.contains_key(&id) { self.kept.get(&id).copied() } else { said }
    }

    /// The hash of the finished recording.
    pub fn hash(&self, id: u64) -> Option<&String> {
        self.hashes.get(&id).filter(|hash| *hash != NO_HASH)
    }

    /// The largest number of an incident.
    pub(super) fn largest(&self) -> Option<u64> {
        let ids = self.hashes.keys().chain(self.notes.keys()).chain(self.kept.keys()).chain(&self.marked);
        ids.chain(&self.removed).copied().max()
    }

    /// Takes the next record.
    fn take(&mut self, action: &str, target: String, who: String) {
        if action == Action::IncidentNote.as_str() {
            if let Some(id) = target.split_once(": ").and_then(|(id, _)| id.parse().ok()) {
                self.notes.insert(id, (target, who));
            }
        } else if action == Action::Mark.as_str() {
            self.marked.extend(target.split_once(": ").and_then(|(id, _)| id.parse::<u64>().ok()));
        } else if action == Action::IncidentKept.as_str() {
            let id = target.strip_suffix(NO_LONGER);
            if let Ok(number) = id.unwrap_or(&target).parse() {
                self.kept.insert(number, id.is_none());
            }
        } else if let Some((id, hash, summary)) = read_recorded(&target) {
            self.removed.retain(|it| *it != id);
            if action == Action::IncidentRemoved.as_str() {
                self.removed.push(id);
                self.notes.remove(&id);
                self.kept.remove(&id);
                return;
            }
            match self.hash(id) {
                Some(first) if first != hash => return,
                Some(_) => {}
                None if action == Action::IncidentFound.as_str() => drop(self.found.insert(id)),
                None => {}
            }
            self.hashes.insert(id, hash.to_owned());
            match summary {
                Some(summary) => self.summaries.insert(id, summary.to_owned()),
                None => self.summaries.remove(&id),
            };
        }
    }
}

impl StoredIncident {
    fn is_recorded_as(&self, logged: &str) -> bool {
        self.columns_agree && summary_hash(&self.summary) == logged
    }
}

impl Store {
    /// The records of the audit log on a recording; `None` if there are none.
    pub async fn incident_logged(&self, id: u64) -> Result<Option<Logged>, StoreError> {
        self.call(move |database| logged(&database.connection, id)).await
    }

    /// The records of the audit log on incidents.
    pub async fn incident_records(&self) -> Result<IncidentRecords, StoreError> {
        self.call(|database| all_records(&database.connection, None)).await
    }

    /// An incident as it lies in the database; `None` if there is none.
    pub async fn stored_incident(&self, id: u64) -> Result<Option<StoredIncident>, StoreError> {
        self.call(move |database| stored(&database.connection, id)).await
    }
}

impl Incidents {
    /// `read` sees one instant, also while a server writes.
    ///
    /// # Errors
    /// If the database fails, or what is read.
    pub fn at_once<T>(&self, read: impl FnOnce() -> Result<T, StoreError>) -> Result<T, StoreError> {
        let transaction = self.0.unchecked_transaction()?;
        let found = read()?;
        transaction.finish()?;
        Ok(found)
    }

    /// An incident as it lies in the database; `None` if there is none.
    pub fn stored(&self, id: u64) -> Result<Option<StoredIncident>, StoreError> {
        stored(&self.0, id)
    }

    /// As [`Store::incident_records`]. Whether the log is as it was written tells
    /// [`verify_audit_in`](crate::audit::verify_audit_in).
    pub fn records(&self) -> Result<IncidentRecords, StoreError> {
        all_records(&self.0, None)
    }

    /// As [`Store::incident_logged`].
    pub fn logged(&self, id: u64) -> Result<Option<Logged>, StoreError> {
        logged(&self.0, id)
    }
}

/// New records of the incidents that the records up to this number name, which are pruned. Removed incidents are left out.
pub(crate) fn said_again(connection: &Connection, number: u64) -> Result<Vec<Record>, StoreError> {
    let (before, all) =
        (records(connection, None, number)?, records(connection, None, schema::RECORD_NUMBER_MAX)?);
    let source = format!("{AGAIN} {number}");
    let mut again = Vec::new();
    for id in all.held().collect::<BTreeSet<u64>>() {
        if let (Some(_), Some(hash)) = (before.hashes.get(&id), all.hashes.get(&id)) {
            let found = all.found.contains(&id);
            let action = if found { Action::IncidentFound } else { Action::IncidentRecorded };
            let summary = all.summaries.get(&id).map(|it| format!(" summary:{it}")).unwrap_or_default();
            again.push(Record::of(action, &*source).on(format!("{id} sha256:{hash}{summary}")));
        }
        if let (Some(_), Some((note, who))) = (before.notes.get(&id), all.notes.get(&id)) {
            let record = Record::of(Action::IncidentNote, &*source).on(note);
            again.push(Record { who: who.clone(), ..record });
        }
        if let (Some(_), Some(kept)) = (before.kept.get(&id), all.kept.get(&id)) {
            again.push(Record::of(Action::IncidentKept, &*source).on(kept_target(id, *kept)));
        }
        if before.marked.contains(&id) {
            again.push(Record::of(Action::Mark, &*source).on(format!("{id}: ")));
        }
    }
    Ok(again)
}

/// The source of such a record, before that number.
const AGAIN: &str = "records up to";

/// The target of the record on a recording, and on its row if that is known.
pub(super) fn recorded_target(id: u64, sha256: Option<&str>, summary: Option<&str>) -> String {
    let recording = format!("{id} sha256:{}", sha256.unwrap_or(NO_HASH));
    match summary {
        Some(summary) => format!("{recording} summary:{}", summary_hash(summary)),
        None => recording,
    }
}

/// The target of the record on a note.
pub(super) fn note_target(id: u64, text: &str) -> String {
    let whole = format!("{id}: {text}");
    if fits(&whole) {
        return whole;
    }
    let beginning: String = text.chars().take(NOTE_CHARS_MAX).collect();
    format!("{id}: {beginning}… sha256:{}", hex_sha256(text))
}

/// The target of the record that an incident is kept, or no longer.
pub(super) fn kept_target(id: u64, kept: bool) -> String {
    if kept { id.to_string() } else { format!("{id}{NO_LONGER}") }
}

const NO_LONGER: &str = ": no longer";

/// The columns beside a summary: the lists and the retention read them.
pub(super) fn columns(summary: &Summary) -> (i64, Option<i64>, bool, i64, bool, Option<&str>, &str, String) {
    let recording = &summary.recording;
    (
        summary.since_ms,
        summary.until_ms,
        summary.is_marked(),
        surely(recording.bytes),
        recording.finished,
        recording.sha256.as_deref(),
        &summary.stage,
        format!("\n{}\n", summary.causes().join("\n")),
    )
}

/// The hash of a summary as it is stored.
fn summary_hash(json: &str) -> String {
    hex_sha256(json)
}

fn hex_sha256(text: &str) -> String {
    hex(&Sha256::digest(text))
}

fn stored(connection: &Connection, id: u64) -> Result<Option<StoredIncident>, StoreError> {
    let sql = format!("SELECT {COLUMNS}, marked FROM incidents WHERE id = ?1");
    let mut query = connection.prepare_cached(&sql)?;
    let read = |row: &Row<'_>| {
        let incident = incident(row)?;
        let (since_ms, until_ms, marked, bytes, finished, sha256, stage, causes) = columns(&incident.summary);
        let columns_agree = row.get::<_, i64>("since_ms")? == since_ms
            && row.get::<_, Option<i64>>("until_ms")? == until_ms
            && row.get::<_, bool>("marked")? == marked
            && row.get::<_, i64>("bytes")? == bytes
            && row.get::<_, bool>("finished")? == finished
            && row.get::<_, Option<String>>("sha256")?.as_deref() == sha256
            && row.get::<_, String>("stage")? == stage
            && row.get::<_, String>("causes")? == causes
            && incident.summary.id == id;
        Ok(StoredIncident { id, summary: row.get("summary")?, columns_agree, incident })
    };
    Ok(query.query_row([surely(id)], read).optional()?)
}

fn logged(connection: &Connection, id: u64) -> Result<Option<Logged>, StoreError> {
    let records = all_records(connection, Some(id))?;
    let row = stored(connection, id)?;
    let contradiction = row.and_then(|row| records.contradiction(&row));
    let is_known = records.hashes.contains_key(&id) || contradiction.is_some();
    Ok(is_known.then(|| Logged { hash: records.hash(id).cloned(), contradiction }))
}

pub(super) fn all_records(connection: &Connection, id: Option<u64>) -> Result<IncidentRecords, StoreError> {
    records(connection, id, schema::RECORD_NUMBER_MAX)
}

/// The records of all incidents, or of this one, up to a number.
fn records(connection: &Connection, id: Option<u64>, up_to: u64) -> Result<IncidentRecords, StoreError> {
    let actions = [
        Action::IncidentRecorded,
        Action::IncidentFound,
        Action::IncidentRemoved,
        Action::IncidentNote,
        Action::IncidentKept,
        Action::Mark,
    ];
    let [recorded, found, removed, note, kept, mark] = actions.map(Action::as_str);
    let sql = "SELECT action, target, who FROM audit
               WHERE action IN (?1, ?2, ?3, ?4, ?5, ?6) AND outcome = ?7
                   AND number <= ?9
                   AND (?8 IS NULL OR target = ?8 OR target LIKE ?8 || ' %' OR target LIKE ?8 || ': %')
               ORDER BY number";
    let mut query = connection.prepare_cached(sql)?;
    let id = id.map(|id| id.to_string());
    let mut rows =
        query.query(params![recorded, found, removed, note, kept, mark, DONE, id, surely(up_to)])?;
    let mut records = IncidentRecords::default();
    while let Some(row) = rows.next()? {
        let action: String = row.get(0)?;
        records.take(&action, row.get(1)?, row.get(2)?);
    }
    Ok(records)
}

/// Reads what [`recorded_target`] wrote.
fn read_recorded(target: &str) -> Option<(u64, &str, Option<&str>)> {
    let (id, hashes) = target.split_once(" sha256:")?;
    let (hash, summary) = match hashes.split_once(" summary:") {
        Some((hash, summary)) => (hash, Some(summary)),
        None => (hashes, None),
    };
    Some((id.parse().ok()?, hash, summary))
}
