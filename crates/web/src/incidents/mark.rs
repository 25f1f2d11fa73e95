//! The mark of a moment in the recording. It is confirmed once it is on the disk, or it is not.

use std::fmt;
use std::pin::Pin;

use axum::Json;
use axum::extract::Form;
use axum::extract::rejection::FormRejection;
use axum::http::HeaderMap;
use axum::http::header::{CONTENT_LENGTH, TRANSFER_ENCODING};
use axum::response::{IntoResponse, Redirect, Response};
use schemars::JsonSchema;
use serde::Deserialize;
use tokio::task;

use super::Marked;
use crate::admission::peer::CameFrom;
use crate::http::guard::SignedIn;
use crate::http::respond::{Reader, Speaks, bad_form};
use crate::texts::HttpError;
use crate::{AppState, Live};
use telltale_record::incident::NOTE_BYTES_MAX;
use telltale_store::audit::{Action, Record};
use telltale_store::{Caller, SessionKind, clean_note};

/// Why a mark is not confirmed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NotMarked {
    /// The present incident has as many marks as it may: this moment is in its recording anyway.
    Full,
    /// It is in memory: the disk has not taken it yet.
    Unsure { incident: Option<u64> },
}

/// The number of the incident that has the mark on the disk, soon.
pub type Marking = Pin<Box<dyn Future<Output = Result<u64, NotMarked>> + Send>>;

/// Marks the present moment in the recording at once. It is given who marks, and a note.
pub struct Marker(Box<Mark>);

type Mark = dyn Fn(&str, &str) -> Marking + Send + Sync;

impl Marker {
    pub fn new(mark: impl Fn(&str, &str) -> Marking + Send + Sync + 'static) -> Marker {
        Marker(Box::new(mark))
    }
}

impl fmt::Debug for Marker {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Marker")
    }
}

/// Marks the present moment, with this record of it, which follows also if the caller goes away. Returns the number of
/// the incident.
///
/// # Errors
/// The mark is not on the disk, or that is not sure.
pub(crate) async fn mark_moment(
    app: &AppState,
    by: &str,
    note: &str,
    record: Record,
) -> Result<u64, HttpError> {
    let Some(Marker(mark)) = &app.settings.marker else { return Err(HttpError::NotRecording) };
    // The same in the recording and in the audit log.
    let note = clean_note(note);
    let (marking, store) = (mark(by, &note), app.store.clone());
    let target = move |incident: Option<u64>, note: &str| match incident {
        Some(incident) => record.on(format!("{incident}: {note}")),
        None => record.on(note),
    };
    let confirmed = task::spawn(async move {
        match marking.await {
            Ok(incident) => {
                // The mark stands on the disk already: a database that is late takes it later.
                let _is_stored = store.record(target(Some(incident), &note), None).await;
                Ok(incident)
            }
            Err(NotMarked::Full) => {
                // A record of each would fill the log.
                let record = target(None, &note).refused("this incident has as many marks as it may");
                store.note(record.by_anybody(Caller::Vehicle));
                Err(HttpError::ManyMarks)
            }
            Err(NotMarked::Unsure { incident }) => {
                store.note(target(incident, &note).refused("the disk has not taken it yet"));
                Err(HttpError::MarkUnsure)
            }
        }
    });
    // It is not known only at the end of the program.
    confirmed.await.unwrap_or(Err(HttpError::MarkUnsure))
}

#[derive(Debug, Default, Deserialize, JsonSchema)]
pub struct MarkForm {
    /// The event, in at most 2,000 bytes.
    #[serde(default)]
    note: String,
}

/// `POST /api/v1/mark`, and `/incidents/mark` of the page: marks the present moment in the recording. A browser is led
/// back to the list of incidents.
pub async fn mark(
    app: Live,
    CameFrom(source): CameFrom,
    SignedIn(session): SignedIn,
    reader: Reader,
    headers: HeaderMap,
    form: Result<Form<MarkForm>, FormRejection>,
) -> Result<Response, HttpError> {
    let MarkForm { note } = match form {
        Ok(Form(form)) if form.note.trim().len() <= NOTE_BYTES_MAX => form,
        Ok(_) => return Err(HttpError::LongNote),
        // A mark without a note needs no body.
        Err(FormRejection::InvalidFormContentType(_)) if is_empty(&headers) => MarkForm::default(),
        Err(FormRejection::InvalidFormContentType(_)) => return Err(HttpError::NoForm),
        Err(rejection) => return Ok(bad_form(&reader, &rejection)),
    };
    let record = Record::of_session(&session, Action::Mark, source);
    // A program has a share of its own: it takes no places of the person whose token it has.
    let by = match session.kind {
        SessionKind::Person => session.user.to_string(),
        SessionKind::Program => format!("{} (API)", session.user),
    };
    let incident = mark_moment(&app, &by, &note, record).await?;
    Ok(match reader.speaks {
        Speaks::Html => Redirect::to("/incidents").into_response(),
        Speaks::Json => Json(Marked { incident }).into_response(),
    })
}

/// A request without a body.
fn is_empty(headers: &HeaderMap) -> bool {
    let length = headers.get(CONTENT_LENGTH);
    length.is_none_or(|length| length == "0") && !headers.contains_key(TRANSFER_ENCODING)
}
