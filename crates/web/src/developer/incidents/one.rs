//! The page of one incident: what happened, the states of the nodes concerned, the values at the first instant, and
//! the recording.

use askama::Template;
use axum::extract::{Path, Request, State};
use axum::response::{Html, IntoResponse, Response};

use super::content::{Content, Medium};
use super::report;
use super::told::{Told, told};
use crate::AppState;
use crate::developer::request::PageRequest;
use crate::developer::{DevFrame, Page, frame};
use crate::incidents::{Read, download, find, story};
use crate::texts::HttpError;
use crate::view::page::frame::PageFrame;
use crate::view::{View, html};
use telltale_record::proof::Proof;
use telltale_store::{Incident, Role};

const RENEW_MS: u32 = 2000;

#[derive(Template)]
#[template(path = "developer/incident.html")]
struct OneHtml {
    frame: PageFrame,
    dev: DevFrame,
    content: Content,
    told: Told,
    /// May write a note and keep it.
    may_change: bool,
    kept: bool,
    has_file: bool,
    has_report: bool,
    /// May run it by another configuration.
    has_what_if: bool,
}

/// `GET /incidents/{id}`; `GET /incidents/{id}.mcap` for its recording, `GET /incidents/{id}.html` for its report.
pub async fn get(
    State(app): State<AppState>,
    Path(id): Path<String>,
    page: PageRequest,
    request: Request,
) -> Result<Response, HttpError> {
    if let Some(id) = id.strip_suffix(".mcap") {
        return download(&app, id, request).await;
    }
    if let Some(id) = id.strip_suffix(".html") {
        return report::get(&app, id, &page.reader).await;
    }
    let incident = find(&app, &id).await?;
    let (read, proof) = story(&app, &incident.summary).await;
    let has_what_if = app.settings.what_if.is_some();
    Ok(Html(html(&one(&page, &incident, (&read, &proof), has_what_if))).into_response())
}

fn one(
    page: &PageRequest,
    incident: &Incident,
    (read, proof): (&Read, &Proof),
    has_what_if: bool,
) -> OneHtml {
    let lang = page.context.lang;
    let view = &View::new(&page.published, lang, false);
    let summary = &incident.summary;
    let content = Content::of(lang, incident, (read, proof), Medium::Page);
    let mut dev = DevFrame::new(view, &page.context, Page::Incidents, RENEW_MS);
    // It does not change any more; and it is shown while the vehicle is locked, as its recording can be downloaded.
    let is_complete = !matches!(read, Read::Told(story) if story.series_pending);
    dev.fixed = summary.until_ms.is_some() && is_complete;
    dev.locked = false;
    dev.title = format!("{} {}", content.it.incident, summary.id);
    let may_change = page.context.role == Role::Developer;
    let has_file = summary.recording.finished && !matches!(read, Read::Missing);
    OneHtml {
        frame: frame(&page.context),
        may_change,
        kept: incident.kept,
        has_file,
        has_what_if: has_what_if && may_change && has_file,
        has_report: !summary.recording.is_open(),
        told: told(view, summary),
        content,
        dev,
    }
}
