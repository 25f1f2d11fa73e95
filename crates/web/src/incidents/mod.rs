//! Incidents for programs and developers: lists, recordings, notes, and the mark of a moment.

mod download;
mod json;
mod mark;
mod reading;
mod what_if;

use std::sync::Arc;

use axum::Json;
use axum::extract::rejection::FormRejection;
use axum::extract::{Extension, Form, Path, State};
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Redirect, Response};
use schemars::JsonSchema;
use serde::Deserialize;
use tokio::sync::watch;

use super::admission::peer::{Peer, source_of};
use super::api::query::{Asked, Count, Moment};
use super::api::table::{Format, Table};
use super::http::guard::SignedIn;
use super::http::respond::{Reader, Speaks, bad_form, json_answer, refusal};
use super::view::RecorderState;
use super::{AppState, Live};
use crate::texts::HttpError;
use telltale_record::beside;
use telltale_record::incident::NOTE_BYTES_MAX;
use telltale_record::recorder::Recorder;
use telltale_record::retention::Policy;
use telltale_record::writer::Place;
use telltale_store::audit::{Action, Record};
use telltale_store::{INCIDENTS_PAGE_MAX, Incident, IncidentFilter, StoreError};

pub use download::get as download;
pub use json::{Listed, Marked, Whole, listed, time as wall_time, wall_ms, whole};
pub(crate) use mark::mark_moment;
pub use mark::{MarkForm, Marker, Marking, NotMarked, mark};
pub use reading::{Read, read, story};
pub use what_if::{Compared, Examiner, Progress, Run as WhatIf, Trouble, WhatIfs};
pub(crate) use what_if::{start as start_what_if, texts as recorded_texts};

/// Incidents in one answer, unless `count` asks for another number.
const COUNT: u32 = 50;

/// The recorder, whether its recordings can be written, and how many are kept.
#[derive(Debug)]
pub struct RecordingState {
    pub recorder: Recorder,
    /// What a file of its last minutes says of the vehicle.
    pub place: Place,
    /// Why nothing can be recorded.
    pub fault: watch::Receiver<Option<Arc<str>>>,
    pub policy: watch::Receiver<Policy>,
}

impl AppState {
    /// What the recorder does now; `None` without a recorder.
    pub fn recorder_state(&self) -> Option<RecorderState> {
        let state = self.settings.recording.as_ref()?;
        Some(match self.published().recording {
            _ if state.fault.borrow().is_some() => RecorderState::Off,
            true => RecorderState::Recording,
            false => RecorderState::Ready,
        })
    }
}

#[derive(Debug, Deserialize, JsonSchema)]
pub struct ListQuery {
    /// Part of the name of a cause.
    #[serde(default)]
    cause: String,
    /// The path of a group that a cause is in.
    #[serde(default)]
    group: String,
    /// At the first trigger.
    #[serde(default)]
    stage: String,
    marked: Option<bool>,
    kept: Option<bool>,
    /// Only those that began at this time or later.
    since: Option<Moment>,
    /// Only those that began at this time or earlier.
    until: Option<Moment>,
    /// Only those with a smaller number.
    before: Option<u64>,
    /// At most so many.
    #[serde(default)]
    count: Count<COUNT, INCIDENTS_PAGE_MAX>,
    format: Option<Format>,
}

/// The columns of the list as CSV.
const COLUMNS: [&str; 13] = [
    "id",
    "since",
    "until",
    "roots",
    "kinds",
    "trigger_count",
    "stage",
    "marked",
    "marks",
    "kept",
    "storm",
    "note",
    "recording",
];

impl ListQuery {
    fn filter(self) -> IncidentFilter {
        IncidentFilter {
            cause: self.cause,
            group: self.group,
            stage: self.stage,
            marked: self.marked,
            kept: self.kept,
            since_ms: self.since.map(|Moment(ms)| ms),
            until_ms: self.until.map(|Moment(ms)| ms),
            before: self.before,
            count: self.count.0,
            ..IncidentFilter::default()
        }
    }
}

/// `GET /api/v1/incidents`: the newest first, filtered, in pages.
pub async fn list(
    State(app): State<AppState>,
    reader: Reader,
    headers: HeaderMap,
    Asked(query): Asked<ListQuery>,
) -> Response {
    let format = Format::of(query.format, &headers);
    let filter = query.filter();
    let count = filter.count as usize;
    match app.store.incidents(filter).await {
        Ok(found) => {
            let rows: Vec<Listed<'_>> = found.iter().map(Listed::of).collect();
            let next = found.last().filter(|_| found.len() == count).map(|last| last.summary.id);
            Table { name: "incidents", columns: &COLUMNS, rows: &rows, next }.answer(format, &rows)
        }
        Err(error) => refusal(&reader, failed(error)),
    }
}

/// `GET /api/v1/incidents/{id}`: everything that is known of it.
pub async fn one(State(app): State<AppState>, Path(id): Path<String>, reader: Reader) -> Response {
    let incident = match find(&app, &id).await {
        Ok(incident) => incident,
        Err(trouble) => return refusal(&reader, trouble),
    };
    let (read, proof) = story(&app, &incident.summary).await;
    let story = match read {
        Read::Told(story) => Some(story),
        Read::Missing | Read::Bad(_) | Read::Busy => None,
    };
    Json(Whole::of(&incident, Some((story.as_deref(), &proof)))).into_response()
}

/// The incident with the number in an address.
pub(crate) async fn find(app: &AppState, id: &str) -> Result<Incident, HttpError> {
    let found = app.store.incident(number(id)?).await.map_err(failed)?;
    found.ok_or(HttpError::NotFound)
}

fn number(id: &str) -> Result<u64, HttpError> {
    id.parse().map_err(|_| HttpError::NotFound)
}

#[derive(Debug, Deserialize, JsonSchema)]
pub struct NoteForm {
    /// At most 2,000 bytes; an empty one removes the note.
    note: String,
}

/// `POST /api/v1/incidents/{id}/note`, and `/incidents/{id}/note` of the page: writes a note in place of the last one.
pub async fn note(
    app: Live,
    Path(id): Path<String>,
    peer: Option<Extension<Peer>>,
    SignedIn(session): SignedIn,
    reader: Reader,
    form: Result<Form<NoteForm>, FormRejection>,
) -> Response {
    let Form(NoteForm { note }) = match form {
        Ok(form) if form.note.trim().len() <= NOTE_BYTES_MAX => form,
        Ok(_) => return refusal(&reader, HttpError::LongNote),
        Err(FormRejection::InvalidFormContentType(_)) => return refusal(&reader, HttpError::NoForm),
        Err(rejection) => return bad_form(&reader, &rejection),
    };
    let Ok(number) = number(&id) else { return refusal(&reader, HttpError::NotFound) };
    let source = source_of(peer.map(|Extension(peer)| peer));
    let record = Record::of_session(&session, Action::IncidentNote, source);
    let written = app.store.set_incident_note(number, &note, record).await;
    if written.is_ok() {
        write_beside(&app, number).await;
    }
    changed(&app, &id, &reader, written).await
}

/// Writes what people said of an incident beside its recording too. It counts without that: only a lost database
/// needs it.
async fn write_beside(app: &AppState, number: u64) {
    let (Some(folder), Ok(Some(incident))) =
        (app.settings.recordings.clone(), app.store.incident(number).await)
    else {
        return;
    };
    let write = move || beside::write(&folder, number, &incident.beside());
    // It is not known only at the end of the program.
    if let Ok(Err(error)) = tokio::task::spawn_blocking(write).await {
        tracing::warn!(%error, "what people said of incident {number} is in the database alone");
    }
}

#[derive(Debug, Deserialize, JsonSchema)]
pub struct KeepForm {
    kept: bool,
}

/// `POST /api/v1/incidents/{id}/keep`, and `/incidents/{id}/keep` of the page: keeps it whatever its age and size, or no
/// longer.
pub async fn keep(
    app: Live,
    Path(id): Path<String>,
    peer: Option<Extension<Peer>>,
    SignedIn(session): SignedIn,
    reader: Reader,
    form: Result<Form<KeepForm>, FormRejection>,
) -> Response {
    let kept = match form {
        Ok(Form(form)) => form.kept,
        Err(rejection) => return bad_form(&reader, &rejection),
    };
    let Ok(number) = number(&id) else { return refusal(&reader, HttpError::NotFound) };
    let source = source_of(peer.map(|Extension(peer)| peer));
    let record = Record::of_session(&session, Action::IncidentKept, source);
    let written = app.store.keep_incident(number, kept, record).await;
    if written.is_ok() {
        write_beside(&app, number).await;
    }
    changed(&app, &id, &reader, written).await
}

/// Answers a program with the changed incident, and leads a browser back to its page.
async fn changed(app: &AppState, id: &str, reader: &Reader, written: Result<(), StoreError>) -> Response {
    match written {
        Ok(()) if reader.speaks == Speaks::Html => Redirect::to(&format!("/incidents/{id}")).into_response(),
        Ok(()) => answer(reader, find(app, id).await),
        Err(error) => refusal(reader, failed(error)),
    }
}

fn answer(reader: &Reader, found: Result<Incident, HttpError>) -> Response {
    match found {
        Ok(incident) => json_answer(StatusCode::OK, &whole(&incident)),
        Err(trouble) => refusal(reader, trouble),
    }
}

pub(crate) fn failed(error: StoreError) -> HttpError {
    if !matches!(error, StoreError::NoSuchIncident(_)) {
        tracing::error!(%error, "an incident cannot be read or changed");
    }
    error.into()
}
