//! Incidents for programs and developers: their summaries, recordings and notes, and the mark of a moment.

mod download;
mod json;
mod mark;
mod reading;
mod what_if;

use std::sync::Arc;

use axum::extract::rejection::FormRejection;
use axum::extract::{Form, Path};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Redirect, Response};
use schemars::JsonSchema;
use serde::Deserialize;
use tokio::sync::watch;

use super::admission::peer::CameFrom;
use super::http::guard::SignedIn;
use super::http::respond::{FormOf, Reader, Speaks, bad_form, json_answer};
use super::view::RecorderState;
use super::{AppState, Live};
use crate::texts::HttpError;
use telltale_record::incident::NOTE_BYTES_MAX;
use telltale_record::note_file;
use telltale_record::recorder::Recorder;
use telltale_record::retention::Policy;
use telltale_record::writer::Place;
use telltale_store::audit::{Action, Record};
use telltale_store::{Incident, StoreError};

pub use download::{get as download, sent as sent_recording};
pub use json::{Listed, Marked, Whole, listed, time as wall_time, whole};
pub(crate) use mark::mark_moment;
pub use mark::{MarkForm, Marker, Marking, NotMarked, mark};
pub use reading::{Read, read, story};
pub use telltale_replay::compare::{Comparison, Mistake};
pub use what_if::{
    Compared, Examiner, Progress, RUN_WITHIN, Run as WhatIf, Stop, Trouble, WhatIfs, runnable, texts_in,
};
pub(crate) use what_if::{start as start_what_if, texts as recorded_texts};

/// The recorder, whether its recordings can be written, and how many are kept.
#[derive(Debug)]
pub struct RecordingState {
    pub recorder: Recorder,
    /// The name of the vehicle in a file of its last minutes.
    pub place: Place,
    /// Why nothing can be recorded.
    pub fault: watch::Receiver<Option<Arc<str>>>,
    pub policy: watch::Receiver<Policy>,
}

impl AppState {
    /// The recorder's present state; `None` without a recorder.
    pub fn recorder_state(&self) -> Option<RecorderState> {
        let state = self.settings.recording.as_ref()?;
        Some(match self.published().recording {
            _ if state.fault.borrow().is_some() => RecorderState::Off,
            true => RecorderState::Recording,
            false => RecorderState::Ready,
        })
    }
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
    CameFrom(source): CameFrom,
    SignedIn(session): SignedIn,
    reader: Reader,
    form: Result<Form<NoteForm>, FormRejection>,
) -> Result<Response, HttpError> {
    let Form(NoteForm { note }) = match form {
        Ok(form) if form.note.trim().len() <= NOTE_BYTES_MAX => form,
        Ok(_) => return Err(HttpError::LongNote),
        Err(FormRejection::InvalidFormContentType(_)) => return Err(HttpError::NoForm),
        Err(rejection) => return Ok(bad_form(&reader, &rejection)),
    };
    let number = number(&id)?;
    let record = Record::of_session(&session, Action::IncidentNote, source);
    let written = app.store.set_incident_note(number, &note, record).await;
    changed(&app, number, &reader, written).await
}

/// Writes what people said of an incident beside its recording too. It counts without that: only a lost database
/// needs it.
async fn write_beside(app: &AppState, number: u64) {
    let (Some(folder), Ok(Some(incident))) =
        (app.settings.recordings.clone(), app.store.incident(number).await)
    else {
        return;
    };
    let write = move || note_file::write(&folder, number, &incident.beside());
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
    CameFrom(source): CameFrom,
    SignedIn(session): SignedIn,
    reader: Reader,
    FormOf(KeepForm { kept }): FormOf<KeepForm>,
) -> Result<Response, HttpError> {
    let number = number(&id)?;
    let record = Record::of_session(&session, Action::IncidentKept, source);
    let written = app.store.keep_incident(number, kept, record).await;
    changed(&app, number, &reader, written).await
}

/// Answers a program with the changed incident, and leads a browser back to its page.
async fn changed(
    app: &AppState,
    number: u64,
    reader: &Reader,
    written: Result<(), StoreError>,
) -> Result<Response, HttpError> {
    written.map_err(failed)?;
    write_beside(app, number).await;
    let id = number.to_string();
    Ok(match reader.speaks {
        Speaks::Html => Redirect::to(&format!("/incidents/{id}")).into_response(),
        Speaks::Json => json_answer(StatusCode::OK, &whole(&find(app, &id).await?)),
    })
}

pub(crate) fn failed(error: StoreError) -> HttpError {
    if !matches!(error, StoreError::NoSuchIncident(_)) {
        tracing::error!(%error, "an incident cannot be read or changed");
    }
    error.into()
}
