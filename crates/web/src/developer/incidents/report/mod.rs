//! The report of an incident: one document with everything that its page has, which needs nothing else.

use std::sync::LazyLock;

use askama::Template;
use axum::http::HeaderValue;
use axum::http::header::{CONTENT_DISPOSITION, CONTENT_SECURITY_POLICY};
use axum::response::{Html, IntoResponse, Response};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use sha2::{Digest as _, Sha256};

use super::content::{Content, Medium};
use crate::AppState;
use crate::http::respond::Reader;
use crate::incidents::{Read, find, story, wall_time};
use crate::texts::{HttpError, Lang};
use crate::view::html;
use telltale_clock::unix_ms;
use telltale_record::folder::file_name;
use telltale_record::proof::Proof;
use telltale_store::Incident;

const STYLE: &str = include_str!("../report.css");

/// The document's own policy: its stylesheet, and nothing else of any kind.
static POLICY: LazyLock<String> = LazyLock::new(|| {
    let hash = STANDARD.encode(Sha256::digest(STYLE));
    format!("default-src 'none'; style-src 'sha256-{hash}'; base-uri 'none'; form-action 'none'")
});

#[derive(Template)]
#[template(path = "developer/incident_report.html")]
struct ReportHtml {
    lang: Lang,
    content: Content,
    style: &'static str,
    policy: &'static str,
    /// The name of the recording.
    file: String,
    is_as_recorded: bool,
    written: String,
}

/// The report as one HTML file.
pub fn report(lang: Lang, incident: &Incident, (read, proof): (&Read, &Proof), written_ms: i64) -> String {
    let content = Content::of(lang, incident, (read, proof), Medium::Report);
    html(&ReportHtml {
        lang,
        style: STYLE,
        policy: &POLICY,
        file: file_name(incident.summary.id),
        is_as_recorded: *proof == Proof::Same,
        written: minutes(written_ms),
        content,
    })
}

/// `2026-11-20 14:03 UTC`
fn minutes(ms: i64) -> String {
    let at = wall_time(ms);
    format!("{} {} UTC", &at[..10], &at[11..16])
}

/// `GET /incidents/{id}.html`
pub async fn get(app: &AppState, id: &str, reader: &Reader) -> Result<Response, HttpError> {
    let incident = find(app, id).await?;
    if incident.summary.recording.is_open() {
        return Err(HttpError::Unfinished);
    }
    let (read, proof) = story(app, &incident.summary).await;
    if matches!(read, Read::Busy) {
        return Err(HttpError::Busy);
    }
    let document = report(reader.lang, &incident, (&read, &proof), unix_ms(app.clock.wall()));
    let mut answer = Html(document).into_response();
    // A document cannot forbid frames by itself.
    let policy = HeaderValue::from_str(&format!("{}; frame-ancestors 'none'", *POLICY));
    let name = format!("inline; filename=\"incident-{}.html\"", incident.summary.id);
    let headers = answer.headers_mut();
    headers.extend(policy.ok().map(|policy| (CONTENT_SECURITY_POLICY, policy)));
    headers.extend(HeaderValue::from_str(&name).ok().map(|name| (CONTENT_DISPOSITION, name)));
    Ok(answer)
}

#[cfg(test)]
mod tests;
