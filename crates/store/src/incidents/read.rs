//! Reads incidents, also from a database that a server has open.

use std::collections::BTreeSet;
use std::path::Path;
use std::time::SystemTime;

use rusqlite::{Connection, OptionalExtension as _, Row, params};

use super::{Incident, Note};
use crate::database::schema;
use crate::disk::clock_floor;
use crate::{Store, StoreError};
use telltale_record::folder;
use telltale_record::retention::Held;
use telltale_record::summary::{Recording, Summary};

/// Incidents that are read at once.
pub const INCIDENTS_PAGE_MAX: u32 = 200;

/// So many of the newest numbers are searched as a whole: to read a summary takes longer than a column.
const SEARCHED: u32 = 2000;

pub(super) const COLUMNS: &str =
    "id, since_ms, until_ms, kept, bytes, finished, sha256, stage, causes, summary, note, note_by, note_ms";

/// Which incidents are listed; the default is the newest page of all.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct IncidentFilter {
    /// A part of the name of a root cause, in any case; empty for all.
    pub cause: String,
    /// A part, in any case, of the name of a root cause, of the note, or of what the newest incidents say of their
    /// triggers and frozen nodes; empty for all.
    pub text: String,
    /// With `text`: those with one of these root causes too.
    pub or_causes: Vec<String>,
    /// The group of a root cause, or a group around it; empty for all.
    pub group: String,
    /// The stage at the first trigger; empty for all.
    pub stage: String,
    pub marked: Option<bool>,
    pub kept: Option<bool>,
    /// Those that lasted at this time or later, in milliseconds since 1970.
    pub since_ms: Option<i64>,
    /// Those that began at this time or earlier.
    pub until_ms: Option<i64>,
    /// Those with a smaller number: the next page.
    pub before: Option<u64>,
    /// At most [`INCIDENTS_PAGE_MAX`]; zero counts as that.
    pub count: u32,
}

/// The bytes of all recordings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct OnDisk {
    pub count: u64,
    pub bytes: u64,
    /// Of incidents since the time that was asked for.
    pub bytes_since: u64,
}

impl Store {
    /// Incidents that the filter lets pass, the newest first.
    pub async fn incidents(&self, filter: IncidentFilter) -> Result<Vec<Incident>, StoreError> {
        self.call(move |database| list(&database.connection, &filter)).await
    }

    /// Everything that is known of an incident; `None` if there is none.
    pub async fn incident(&self, id: u64) -> Result<Option<Incident>, StoreError> {
        self.call(move |database| one(&database.connection, id)).await
    }

    /// The facts of every incident for its retention, the smallest number first.
    pub async fn incidents_held(&self) -> Result<Vec<Held>, StoreError> {
        self.call(|database| held(&database.connection)).await
    }

    /// The number of all incidents, the bytes of their recordings, and the bytes of those since a time.
    pub async fn incidents_on_disk(&self, since_ms: i64) -> Result<OnDisk, StoreError> {
        self.call(move |database| {
            let sql =
                "SELECT count(*), total(bytes), total(bytes) FILTER (WHERE since_ms >= ?1) FROM incidents";
            let mut query = database.connection.prepare_cached(sql)?;
            let sums = query.query_row([since_ms], |row| {
                let bytes = |index| row.get::<_, Option<f64>>(index).map(|sum| sum.unwrap_or(0.0) as u64);
                let count = row.get::<_, i64>(0)?.unsigned_abs();
                Ok(OnDisk { count, bytes: bytes(1)?, bytes_since: bytes(2)? })
            });
            Ok(sums?)
        })
        .await
    }

    /// The incidents whose recordings the last run of the program did not finish, and those whose recordings were
    /// gone.
    pub async fn unfinished_incidents(&self) -> Result<Vec<Summary>, StoreError> {
        self.call(|database| {
            let sql = format!("SELECT {COLUMNS} FROM incidents WHERE NOT finished OR (sha256 IS NULL AND bytes = 0) ORDER BY id");
            let mut query = database.connection.prepare_cached(&sql)?;
            let found = query.query_map([], |row| Ok(incident(row)?.summary))?;
            Ok(found.collect::<Result<_, _>>()?)
        })
        .await
    }

    /// Those of these numbers that belong to no incident.
    pub async fn unknown_incidents(&self, numbers: Vec<u64>) -> Result<Vec<u64>, StoreError> {
        self.call(move |database| {
            let known: BTreeSet<u64> = held(&database.connection)?.iter().map(|it| it.id).collect();
            Ok(numbers.into_iter().filter(|number| !known.contains(number)).collect())
        })
        .await
    }
}

/// The incidents of a data folder, which are read without a lock: a server may run on it.
#[derive(Debug)]
pub struct Incidents(pub(super) Connection);

impl Incidents {
    /// Opens the database of a data folder for reading.
    ///
    /// # Errors
    /// If there is none, or it cannot be read.
    pub fn open(folder: &Path) -> Result<Incidents, StoreError> {
        let (connection, _, _) = schema::read_only(folder, schema::LOCK_WAIT)?;
        Ok(Incidents(connection))
    }

    /// As [`Store::floor`], by now.
    pub fn floor(&self) -> Result<SystemTime, StoreError> {
        clock_floor::of(&self.0)
    }

    /// As [`Store::incidents`].
    pub fn list(&self, filter: &IncidentFilter) -> Result<Vec<Incident>, StoreError> {
        list(&self.0, filter)
    }

    /// All that a filter lets through, the newest first, over its pages.
    pub fn all(&self, mut filter: IncidentFilter) -> Result<Vec<Incident>, StoreError> {
        let mut all: Vec<Incident> = Vec::new();
        loop {
            let page = self.list(&filter)?;
            let is_last = page.len() < INCIDENTS_PAGE_MAX as usize;
            all.extend(page);
            if is_last {
                return Ok(all);
            }
            filter.before = all.last().map(|incident| incident.summary.id);
        }
    }

    /// As [`Store::incident`].
    pub fn one(&self, id: u64) -> Result<Option<Incident>, StoreError> {
        one(&self.0, id)
    }

    /// As [`Store::incidents_held`].
    pub fn held(&self) -> Result<Vec<Held>, StoreError> {
        held(&self.0)
    }
}

/// A number as SQLite keeps it. No number of ours is too large.
pub(super) fn surely(number: u64) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}

/// The largest number that was given; zero if there was none.
pub(super) fn last_number(connection: &Connection) -> Result<u64, StoreError> {
    let sql = "SELECT max(ifnull((SELECT last FROM incident_number), 0), ifnull((SELECT max(id) FROM incidents), 0))";
    Ok(connection.query_row(sql, [], |row| row.get::<_, i64>(0))?.unsigned_abs())
}

fn list(connection: &Connection, filter: &IncidentFilter) -> Result<Vec<Incident>, StoreError> {
    let sql = format!(
        "SELECT {COLUMNS} FROM incidents
         WHERE id < ?1 AND (?2 = '' OR instr(lower(causes), lower(?2)))
             AND (?3 = '' OR instr(causes, char(10) || ?3 || char(10)) OR instr(causes, char(10) || ?3 || '/'))
             AND (?4 = '' OR stage = ?4) AND (?5 IS NULL OR marked = ?5) AND (?6 IS NULL OR kept = ?6)
             AND (?7 IS NULL OR ifnull(until_ms, ?7) >= ?7) AND (?8 IS NULL OR since_ms <= ?8)
             AND (?10 = '' OR instr(lower(causes), lower(?10)) OR instr(lower(ifnull(note, '')), lower(?10))
                 OR EXISTS (SELECT 1 FROM json_each(?11) AS cause
                     WHERE instr(causes, char(10) || cause.value || char(10)))
                 OR (id > (SELECT max(id) FROM incidents) - {SEARCHED} AND EXISTS (
                     SELECT 1 FROM json_tree(CASE WHEN json_valid(summary) THEN summary ELSE '{{}}' END) AS said
                     WHERE said.key IN ('kind', 'what', 'note', 'node', 'message') AND said.type = 'text'
                         AND instr(lower(said.value), lower(?10)))))
         ORDER BY id DESC LIMIT ?9"
    );
    let before = filter.before.map_or(i64::MAX, surely);
    let count = if filter.count == 0 { INCIDENTS_PAGE_MAX } else { filter.count.min(INCIDENTS_PAGE_MAX) };
    let or_causes = serde_json::Value::from(filter.or_causes.clone()).to_string();
    let IncidentFilter { cause, text, group, stage, marked, kept, since_ms, until_ms, .. } = filter;
    let parameters =
        params![before, cause, group, stage, marked, kept, since_ms, until_ms, count, text, or_causes];
    let mut query = connection.prepare_cached(&sql)?;
    let found = query.query_map(parameters, incident)?;
    Ok(found.collect::<Result<_, _>>()?)
}

fn one(connection: &Connection, id: u64) -> Result<Option<Incident>, StoreError> {
    let sql = format!("SELECT {COLUMNS} FROM incidents WHERE id = ?1");
    let mut query = connection.prepare_cached(&sql)?;
    Ok(query.query_row([surely(id)], incident).optional()?)
}

fn held(connection: &Connection) -> Result<Vec<Held>, StoreError> {
    let sql = "SELECT id, since_ms, bytes, marked, kept, finished, sha256 FROM incidents ORDER BY id";
    let mut query = connection.prepare_cached(sql)?;
    let found = query.query_map([], |row| {
        Ok(Held {
            id: row.get::<_, i64>(0)?.unsigned_abs(),
            since_ms: row.get(1)?,
            bytes: row.get::<_, i64>(2)?.unsigned_abs(),
            marked: row.get(3)?,
            kept: row.get(4)?,
            finished: row.get(5)?,
            sha256: row.get(6)?,
        })
    })?;
    Ok(found.collect::<Result<_, _>>()?)
}

pub(super) fn incident(row: &Row<'_>) -> rusqlite::Result<Incident> {
    let json: String = row.get(9)?;
    // Of a row that is damaged, or of another version, the columns remain.
    let summary = match serde_json::from_str(&json) {
        Ok(summary) => summary,
        Err(_) => bare(row)?,
    };
    let text: String = row.get(10)?;
    let note = match text.is_empty() {
        true => None,
        false => Some(Note { text, by: row.get(11)?, at_ms: row.get(12)? }),
    };
    Ok(Incident { summary, kept: row.get(3)?, note })
}

fn bare(row: &Row<'_>) -> rusqlite::Result<Summary> {
    let id = row.get::<_, i64>(0)?.unsigned_abs();
    let causes: String = row.get(8)?;
    Ok(Summary {
        id,
        since_ms: row.get(1)?,
        until_ms: row.get(2)?,
        stage: row.get(7)?,
        roots: causes.lines().filter(|cause| !cause.is_empty()).map(str::to_owned).collect(),
        recording: Recording {
            file: folder::file_name(id),
            bytes: row.get::<_, i64>(4)?.unsigned_abs(),
            finished: row.get(5)?,
            sha256: row.get(6)?,
            ..Recording::default()
        },
        ..Summary::default()
    })
}
