//! Pages and the snapshot for logged-in users; and the health probes, which say nothing about the vehicle.

use std::time::Duration;

use axum::extract::State;
use axum::http::StatusCode;
use axum::http::header::CONTENT_TYPE;
use axum::response::{Html, IntoResponse, Response};
use tokio::time::timeout;

use super::AppState;
use super::http::guard::SignedIn;
use super::http::respond::Reader;
use super::view::{self, PageContext, permitted};
use crate::texts::HttpError;
use telltale_store::Session;

/// `GET /`
pub async fn operator(
    State(app): State<AppState>,
    SignedIn(session): SignedIn,
    reader: Reader,
) -> Html<String> {
    let published = app.published();
    let seen = app.frames.observe(&published);
    let context = page_context(&app, &session, &reader);
    Html(view::operator_page(&permitted(&published), &seen, &context, &app.trends))
}

/// `GET /api/v1/snapshot`
pub async fn snapshot(State(app): State<AppState>) -> Response {
    let json = app.frames.json(&app.published());
    ([(CONTENT_TYPE, "application/json")], axum::body::Bytes::from(json)).into_response()
}

/// `GET /healthz`: the process answers.
pub async fn healthz() -> &'static str {
    "ok\n"
}

/// For the store's answer to `GET /readyz`. Pages wait for any answer before they connect again, also
/// while the disk hangs.
const READY_TIMEOUT: Duration = Duration::from_millis(1500);

/// `GET /readyz`: the engine, the bridge to DDS and the store work.
pub async fn readyz(State(app): State<AppState>) -> (StatusCode, &'static str) {
    let lives = app.is_source_alive() && app.is_bridge_working();
    if lives && timeout(READY_TIMEOUT, app.store.is_ready()).await.unwrap_or(false) {
        (StatusCode::OK, "ready\n")
    } else {
        (StatusCode::SERVICE_UNAVAILABLE, "not ready\n")
    }
}

/// Answers an address without a route.
pub async fn not_found() -> HttpError {
    HttpError::NotFound
}

/// A route that does not take this method.
pub async fn wrong_method() -> HttpError {
    HttpError::WrongMethod
}

/// `GET /static/...`
pub async fn asset(uri: axum::http::Uri, headers: axum::http::HeaderMap) -> Result<Response, HttpError> {
    super::assets::answer(uri.path(), &headers).ok_or(HttpError::NotFound)
}

pub fn page_context(app: &AppState, session: &Session, reader: &Reader) -> PageContext {
    PageContext {
        lang: reader.lang,
        palette: reader.palette,
        user: session.user.to_string(),
        role: session.role,
        demo: app.settings.demo.is_some(),
        configuration: app.settings.rereads.is_some(),
        recorder: app.recorder_state(),
        replay: app.live().is_none(),
        part: reader.part,
    }
}
