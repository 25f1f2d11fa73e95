//! Reads the configuration file again: `POST /developer/configuration/reload`.

use axum::extract::Form;
use axum::extract::rejection::FormRejection;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{Html, IntoResponse, Response};
use serde::Deserialize;
use serde_json::json;

use crate::Live;
use crate::admission::peer::CameFrom;
use crate::http::guard::bearer;
use crate::http::respond::{Speaks, json_answer};
use crate::texts::HttpError;
use telltale_engine::time::Span;
use telltale_runtime::Rereading;
use telltale_store::audit::{Action, Record};

use super::configuration::{self, reread};
use super::request::PageRequest;

/// The digest of the difference that the page showed.
#[derive(Debug, Deserialize)]
pub struct ReloadForm {
    shown: Option<String>,
}

/// `POST /developer/configuration/reload`: the file is taken whole, or not at all. A page names in `shown`
/// the digest of what it showed, and nothing else is taken. A program may leave it out and takes the file as
/// it is.
pub async fn post(
    app: Live,
    CameFrom(source): CameFrom,
    headers: HeaderMap,
    request: PageRequest,
    form: Result<Form<ReloadForm>, FormRejection>,
) -> Result<Response, HttpError> {
    let shown = form.ok().and_then(|Form(form)| form.shown);
    // A request that does not say which page it looks at was shown nothing.
    let shown = if bearer(&headers).is_some() { shown } else { Some(shown.unwrap_or_default()) };
    let record = Record::of_session(&request.session, Action::Configuration, source);
    // Runs to its end also if nobody listens any more: the record says who had it taken.
    let taking = tokio::spawn(have_taken(app, shown, record));
    let (read, found) = taking.await.unwrap_or(Err(HttpError::Unavailable))?;
    let status = match found {
        Found::Wrong => StatusCode::UNPROCESSABLE_ENTITY,
        Found::Other => StatusCode::CONFLICT,
        Found::Same | Found::Different => StatusCode::OK,
    };
    let is_other = found == Found::Other;
    Ok(match request.reader.speaks {
        Speaks::Json => {
            let Rereading { taken, differences, problems, warnings, digest, .. } = read;
            let answer = json!({
                "taken": taken, "differences": differences, "problems": problems, "warnings": warnings,
                "shown": digest,
            });
            json_answer(status, &answer)
        }
        Speaks::Html => {
            let (request, offer) = (&request, Some(is_other));
            let page =
                configuration::page(&request.published, &read, offer, &request.context, &request.query);
            (status, Html(page)).into_response()
        }
    })
}

/// The file compared with the running configuration and with what was shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Found {
    Wrong,
    /// It is not what was shown.
    Other,
    /// It means the same as what runs.
    Same,
    Different,
}

impl Found {
    fn of(read: &Rereading, shown: Option<&str>) -> Found {
        match read {
            Rereading { problems: Some(_), .. } => Found::Wrong,
            _ if shown.is_some_and(|shown| shown != read.digest) => Found::Other,
            _ if read.differences.is_empty() => Found::Same,
            _ => Found::Different,
        }
    }

    fn record(self, record: Record, differences: &[String]) -> Record {
        match self {
            Found::Wrong => record.refused("the file is wrong"),
            Found::Other => record.refused("the file is not what was shown"),
            Found::Same => record.on("no difference"),
            Found::Different => {
                let count = differences.len();
                let what = if count == 1 { "difference" } else { "differences" };
                record.on(format!("{count} {what}: {}", differences.join("; ")))
            }
        }
    }
}

/// The time for the disk to take the record of a reload.
const RECORD_WITHIN: Span = Span::from_secs(4);

/// One at a time has the configuration taken.
#[derive(Debug, Default)]
pub struct Reloading(tokio::sync::Mutex<()>);

/// Has the file taken, if it is what was shown. The request is on the disk before that, so an error means
/// that nothing was changed; another result than the expected one is recorded after.
pub(crate) async fn have_taken(
    app: Live,
    shown: Option<String>,
    record: Record,
) -> Result<(Rereading, Found), HttpError> {
    let _turn = app.reloading.0.try_lock().map_err(|_| HttpError::Busy)?;
    let read = reread(&app, false, None).await?;
    let expected = Found::of(&read, shown.as_deref());
    let until = app.clock.now() + RECORD_WITHIN;
    let before = expected.record(record.clone(), &read.differences);
    app.store.write_ahead(&before, None, until, ()).await.map_err(HttpError::from)?;
    // The text that was read is taken and nothing else, also where nothing was shown.
    let shown = shown.unwrap_or(read.digest);
    let read = match reread(&app, true, Some(shown.clone())).await {
        Ok(read) => read,
        Err(trouble) => {
            app.store.record(before.refused("nobody reads the file any more"), None).await;
            return Err(trouble);
        }
    };
    let found = Found::of(&read, Some(&shown));
    if found != expected {
        app.store.record(found.record(record, &read.differences), None).await;
    }
    Ok((read, found))
}
