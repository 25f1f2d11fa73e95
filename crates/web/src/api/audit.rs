//! The audit log.

use axum::extract::State;
use axum::http::HeaderMap;
use axum::response::Response;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::query::{Asked, Count};
use super::table::{Format, Table};
use crate::AppState;
use crate::incidents::wall_time;
use crate::schema::words;
use crate::texts::HttpError;
use telltale_store::audit::Entry;

#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AuditAsked {
    /// Only records with a smaller number: `next` of the page before.
    before: Option<u64>,
    /// The largest number of records to return.
    #[serde(default)]
    count: Count<100, 5000>,
    format: Option<Format>,
}

/// Records of the audit log, the newest first. `telltale audit verify` tells whether the chain is whole.
#[derive(Debug, Serialize, JsonSchema)]
pub struct AuditAnswer<'a> {
    records: &'a [AuditRow<'a>],
    /// For `before` of the next page; `null` on the last one.
    next: Option<u64>,
}

#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "AuditRecord")]
pub struct AuditRow<'a> {
    number: u64,
    #[schemars(schema_with = "words::time")]
    at: String,
    who: &'a str,
    role: &'a str,
    /// An address, or `command line`.
    source: &'a str,
    action: &'a str,
    target: &'a str,
    /// `done`, or `refused: ` and why.
    outcome: &'a str,
    /// Of this record and the hash before it, with a key.
    hash: String,
}

const COLUMNS: [&str; 9] = ["number", "at", "who", "role", "source", "action", "target", "outcome", "hash"];

/// `GET /api/v1/audit`
pub async fn get(
    State(app): State<AppState>,
    Asked(asked): Asked<AuditAsked>,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let count = asked.count.0;
    let _reader = app.audit_reading.turn().await;
    let entries = match app.store.audit_entries(asked.before, count).await {
        Ok(entries) => entries,
        Err(error) => {
            tracing::error!(%error, "the audit log cannot be read");
            return Err(HttpError::Unavailable);
        }
    };
    let rows: Vec<AuditRow<'_>> = entries.iter().map(row).collect();
    let is_full = rows.len() == count as usize;
    let next = rows.last().filter(|last| is_full && last.number > 1).map(|last| last.number);
    let table = Table { name: "audit", columns: &COLUMNS, rows: &rows, next };
    Ok(table.answer(Format::of(asked.format, &headers), &AuditAnswer { records: &rows, next }))
}

fn row(entry: &Entry) -> AuditRow<'_> {
    AuditRow {
        number: entry.number,
        at: wall_time(entry.at_ms),
        who: &entry.who,
        role: &entry.role,
        source: &entry.source,
        action: &entry.action,
        target: &entry.target,
        outcome: &entry.outcome,
        hash: entry.hash.to_string(),
    }
}
