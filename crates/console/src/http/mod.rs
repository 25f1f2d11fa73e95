//! The console's pages and API. Every route but login, logout and the wish for a recording is for reading, and none acts
//! on a vehicle.

mod answers;
mod grouped;
mod guard;
mod history;
mod log;
mod login;
mod page;
mod recordings;
mod row;
#[cfg(test)]
mod tests;
mod vehicle;

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use axum::extract::DefaultBodyLimit;
use axum::http::StatusCode;
use axum::middleware::{from_fn, from_fn_with_state};
use axum::routing::{get, post};
use axum::{Extension, Router};
use telltale_clock::Clock;
use telltale_store::Store;
use telltale_web::common::{
    Home, Throttle, asset, healthz, in_words, not_found, secure_headers, wrong_method,
};
use telltale_web::{BODY_BYTES_MAX, Origins};
use tokio::sync::Semaphore;
use tower_http::limit::RequestBodyLimitLayer;
use tower_http::timeout::TimeoutLayer;

use crate::follow::Shared;

/// The time for a whole request.
const REQUEST_TIMEOUT: std::time::Duration = std::time::Duration::from_secs(10);

/// What all requests share; clones are the same.
#[derive(Debug, Clone)]
pub struct Console {
    pub shared: Shared,
    /// Users, sessions and the audit log.
    pub store: Store,
    pub clock: Clock,
    /// The folder of the recordings.
    pub recordings: PathBuf,
    origins: Arc<Origins>,
    /// Browsers connect over TLS, so cookies are marked for TLS only.
    secure: bool,
    throttle: Arc<Mutex<Throttle>>,
    /// Whose turn it is to read a history.
    histories: Arc<Semaphore>,
}

impl Console {
    /// `data`: its data folder.
    pub fn new(shared: Shared, store: Store, data: &Path, origins: Origins, secure: bool) -> Console {
        let clock = shared.clock;
        let (origins, histories) = (Arc::new(origins), Arc::new(Semaphore::new(history::AT_A_TIME)));
        let folder = data.join(crate::recordings::FOLDER);
        Console {
            shared,
            store,
            clock,
            recordings: folder,
            origins,
            secure,
            throttle: Arc::default(),
            histories,
        }
    }
}

/// The service of all routes.
pub fn router(console: Console) -> Router {
    let secure = console.secure;
    Router::new()
        .route("/", get(page::get))
        .route("/overview", get(page::overview))
        .route("/vehicles/{id}", get(vehicle::page))
        .route("/vehicles/{id}/state", get(vehicle::state))
        .route("/vehicles/{id}/log", get(log::log))
        .route("/vehicles/{id}/incidents/{number}/fetch", post(recordings::fetch))
        .route("/vehicles/{id}/incidents/{number}/recording", get(recordings::download))
        .route("/login", get(login::page).post(login::login))
        .route("/logout", post(login::logout))
        .route("/api/v1/vehicles", get(answers::vehicles))
        .route("/api/v1/vehicles/{id}/snapshot", get(answers::snapshot))
        .route("/api/v1/vehicles/{id}/history", get(history::get))
        .route("/api/v1/incidents", get(answers::incidents))
        .route("/healthz", get(healthz))
        .route("/readyz", get(answers::readyz))
        .route("/static/{*path}", get(asset))
        .method_not_allowed_fallback(wrong_method)
        .fallback(not_found)
        .layer(DefaultBodyLimit::max(BODY_BYTES_MAX))
        .layer(from_fn_with_state(console.clone(), guard::guard))
        .layer(RequestBodyLimitLayer::new(BODY_BYTES_MAX))
        .layer(TimeoutLayer::with_status_code(StatusCode::REQUEST_TIMEOUT, REQUEST_TIMEOUT))
        .layer(from_fn(in_words))
        .layer(Extension(Home::Fleet))
        .layer(from_fn_with_state(secure, secure_headers))
        .with_state(console)
}
