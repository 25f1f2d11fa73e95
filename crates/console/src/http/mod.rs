//! The console's pages and API. Every route but login, logout and the wish for a recording is for reading, and none acts
//! on a vehicle.

mod answers;
mod grouped;
mod guard;
mod history;
mod log;
mod login;
mod operations;
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
use axum::routing::{MethodRouter, get, post};
use axum::{Extension, Router};
use telltale_clock::Clock;
use telltale_store::Store;
use telltale_web::common::{
    Home, Throttle, asset, healthz, in_words, not_found, secure_headers, wrong_method,
};
use telltale_web::describe::Description;
use telltale_web::{BODY_BYTES_MAX, Origins};
use tokio::sync::Semaphore;
use tower_http::limit::RequestBodyLimitLayer;
use tower_http::timeout::TimeoutLayer;

use operations as op;
pub use operations::document as openapi;

use crate::follow::Shared;
use crate::state::Row;
use crate::state::search::Search;

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
    /// Permits to read a history.
    histories: Arc<Semaphore>,
}

impl Console {
    /// The vehicles that a search finds, the worst first.
    pub fn found(&self, q: &Search) -> Vec<Row> {
        let mut rows = self.shared.fleet().rows(self.clock.now());
        rows.retain(|row| q.finds(row));
        rows
    }

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

/// One row of the table of routes.
struct Route {
    path: &'static str,
    answer: MethodRouter<Console>,
    /// For programs; `None` for pages.
    told: Option<op::Told>,
}

impl Route {
    fn told(self, told: op::Told) -> Route {
        Route { told: Some(told), ..self }
    }
}

fn on(path: &'static str, answer: MethodRouter<Console>) -> Route {
    Route { path, answer, told: None }
}

/// All routes.
fn routes() -> Vec<Route> {
    vec![
        on("/", get(page::get)),
        on("/overview", get(page::overview)),
        on("/vehicles/{id}", get(vehicle::page)),
        on("/vehicles/{id}/state", get(vehicle::state)),
        on("/vehicles/{id}/log", get(log::log)),
        on("/vehicles/{id}/incidents/{number}/fetch", post(recordings::fetch)).told(op::FETCH),
        on("/vehicles/{id}/incidents/{number}/recording", get(recordings::download)).told(op::RECORDING),
        on("/login", get(login::page).post(login::login)),
        on("/logout", post(login::logout)),
        on("/api/v1/vehicles", get(answers::vehicles)).told(op::VEHICLES),
        on("/api/v1/vehicles/{id}/snapshot", get(answers::snapshot)).told(op::SNAPSHOT),
        on("/api/v1/vehicles/{id}/history", get(history::get)).told(op::HISTORY),
        on("/api/v1/vehicles/{id}/log", get(log::table)).told(op::LOG),
        on("/api/v1/vehicles/{id}/incidents", get(answers::incidents_of)).told(op::INCIDENTS_OF_VEHICLE),
        on("/api/v1/groups", get(grouped::get)).told(op::GROUPS),
        on("/api/v1/incidents", get(answers::incidents)).told(op::INCIDENTS),
        on("/api/v1/openapi.json", get(op::openapi)).told(op::DOCUMENT),
        on("/healthz", get(healthz)).told(op::HEALTHZ),
        on("/readyz", get(answers::readyz)).told(op::READYZ),
        on("/static/{*path}", get(asset)),
    ]
}

/// The service of all routes.
pub fn router(console: Console) -> Router {
    let secure = console.secure;
    let with = |router: Router<Console>, route: Route| router.route(route.path, route.answer);
    routes()
        .into_iter()
        .fold(Router::new(), with)
        .method_not_allowed_fallback(wrong_method)
        .fallback(not_found)
        .layer(DefaultBodyLimit::max(BODY_BYTES_MAX))
        .layer(from_fn_with_state(console.clone(), guard::guard))
        .layer(RequestBodyLimitLayer::new(BODY_BYTES_MAX))
        .layer(TimeoutLayer::with_status_code(StatusCode::REQUEST_TIMEOUT, REQUEST_TIMEOUT))
        .layer(from_fn(in_words))
        .layer(Extension(Home::Fleet))
        .layer(Extension(Description::of(op::document(secure))))
        .layer(from_fn_with_state(secure, secure_headers))
        .with_state(console)
}
