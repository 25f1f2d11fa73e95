//! The recording of an incident as a file.

use std::path::Path;

use axum::body::Body;
use axum::extract::Request;
use axum::http::HeaderValue;
use axum::http::header::{CONTENT_DISPOSITION, CONTENT_TYPE, ETAG};
use axum::response::{IntoResponse, Response};
use tower::ServiceExt as _;
use tower_http::services::ServeFile;

use super::find;
use crate::AppState;
use crate::texts::HttpError;
use telltale_record::folder;

/// The recording of the incident with this number.
pub async fn get(app: &AppState, id: &str, request: Request) -> Result<Response, HttpError> {
    let incident = find(app, id).await?;
    let recording = &incident.summary.recording;
    if recording.is_open() {
        return Err(HttpError::Unfinished);
    }
    let path = app.settings.recordings.as_deref().and_then(|it| folder::file_in(it, &recording.file));
    let path = path.ok_or(HttpError::NoRecording)?;
    let hash = recording.sha256.as_deref().unwrap_or("unknown");
    Ok(sent(&path, &folder::file_name(incident.summary.id), hash, request).await)
}

/// A recording as a file of this name: the whole file, or the range that is asked for. It is read while it is sent.
pub async fn sent(path: &Path, name: &str, hash: &str, request: Request) -> Response {
    // `ServeFile` reads nothing of a request but its headers and method.
    let (parts, _) = request.into_parts();
    let sent = match ServeFile::new(path).oneshot(Request::from_parts(parts, Body::empty())).await {
        Ok(sent) => sent,
        Err(never) => match never {},
    };
    let mut answer = sent.map(Body::new).into_response();
    let headers = answer.headers_mut();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static("application/octet-stream"));
    let name = format!("attachment; filename=\"{name}\"");
    headers.extend(HeaderValue::from_str(&name).ok().map(|name| (CONTENT_DISPOSITION, name)));
    // With a tag it is not compressed: a range of a compressed file would be none of the file.
    let tag = HeaderValue::from_str(&format!("\"{hash}\""));
    headers.insert(ETAG, tag.unwrap_or(HeaderValue::from_static("\"unknown\"")));
    answer
}
