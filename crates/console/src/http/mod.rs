//! The console's pages and API. Every route but login, logout, the wish for a recording, replays and what-ifs is for reading,
//! and none acts on a vehicle.

mod answers;
mod grouped;
mod guard;
mod history;
mod incidents;
mod log;
mod login;
mod oidc;
mod operations;
mod page;
mod recordings;
mod replays;
mod row;
#[cfg(test)]
mod tests;
mod vehicle;
mod view;
mod what_ifs;

use std::path::Path;
use std::sync::{Arc, Mutex};

use axum::extract::DefaultBodyLimit;
use axum::http::StatusCode;
use axum::middleware::{from_fn, from_fn_with_state};
use axum::routing::{MethodRouter, any, get, post};
use axum::{Extension, Router};
use telltale_clock::Clock;
use telltale_store::Store;
use telltale_web::common::{
    Home, Throttle, asset, healthz, in_words, not_found, secure_headers, wrong_method,
};
use telltale_web::describe::Description;
use telltale_web::{BODY_BYTES_MAX, Examiner, Origins, TEXT_BYTES_MAX};
use tower_http::limit::RequestBodyLimitLayer;
use tower_http::timeout::TimeoutLayer;

use operations as op;
pub use operations::document as openapi;

use crate::follow::Shared;
use crate::oidc::{BACK, Oidc};
use view::Everything;

/// The time for a whole request.
const REQUEST_TIMEOUT: std::time::Duration = std::time::Duration::from_secs(10);

/// What all requests share; clones are the same.
#[derive(Debug, Clone)]
pub struct Console {
    fleet: Everything,
    /// Users, sessions and the audit log.
    pub store: Store,
    pub clock: Clock,
    origins: Arc<Origins>,
    /// Browsers connect over TLS, so cookies are marked for TLS only.
    secure: bool,
    throttle: Arc<Mutex<Throttle>>,
    /// `None`: only local users log in.
    oidc: Option<Arc<Oidc>>,
}

impl Console {
    /// `data`: its data folder.
    pub fn new(shared: Shared, store: Store, data: &Path, origins: Origins, secure: bool) -> Console {
        let clock = shared.clock;
        let served = (store.clone(), clock);
        let replays = |folder| replays::server(folder, served, origins.clone(), secure);
        let (fleet, origins) = (Everything::new(shared, data, replays), Arc::new(origins));
        Console { fleet, store, clock, origins, secure, throttle: Arc::default(), oidc: None }
    }

    /// With what-ifs, which it keeps in its data folder.
    pub fn with_what_ifs(self, data: &Path, examiner: Examiner) -> Console {
        Console { fleet: self.fleet.with_what_ifs(data, examiner), ..self }
    }

    /// With logins at an issuer.
    pub fn with_oidc(self, oidc: Option<Arc<Oidc>>) -> Console {
        Console { oidc, ..self }
    }
}

/// One row of the table of routes.
struct Route {
    path: &'static str,
    answer: MethodRouter<Console>,
    /// For programs; `None` for pages.
    told: Option<op::Told>,
    body_bytes_max: usize,
}

impl Route {
    /// With a body that holds a configuration.
    fn with_text(self) -> Route {
        Route { body_bytes_max: TEXT_BYTES_MAX, ..self }
    }

    fn told(self, told: op::Told) -> Route {
        Route { told: Some(told), ..self }
    }
}

fn on(path: &'static str, answer: MethodRouter<Console>) -> Route {
    Route { path, answer, told: None, body_bytes_max: BODY_BYTES_MAX }
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
        on("/replay/{*path}", any(replays::replay)),
        on("/incidents", get(incidents::page)),
        on("/incidents/what-if", get(what_ifs::form).post(what_ifs::start))
            .with_text()
            .told(op::WHAT_IF_START),
        on("/what-ifs/{number}", get(what_ifs::page)),
        on("/what-ifs/{number}/state", get(what_ifs::state)),
        on("/what-ifs/{number}/cancel", post(what_ifs::cancel)).told(op::WHAT_IF_CANCEL),
        on("/login", get(login::page).post(login::login)),
        on("/login/oidc", get(oidc::begin)),
        on(BACK, get(oidc::back)),
        on("/logout", post(login::logout)),
        on("/api/v1/vehicles", get(answers::vehicles)).told(op::VEHICLES),
        on("/api/v1/vehicles/{id}/snapshot", get(answers::snapshot)).told(op::SNAPSHOT),
        on("/api/v1/vehicles/{id}/history", get(history::get)).told(op::HISTORY),
        on("/api/v1/vehicles/{id}/log", get(log::table)).told(op::LOG),
        on("/api/v1/vehicles/{id}/incidents", get(answers::incidents_of)).told(op::INCIDENTS_OF_VEHICLE),
        on("/api/v1/groups", get(grouped::get)).told(op::GROUPS),
        on("/api/v1/incidents", get(answers::incidents)).told(op::INCIDENTS),
        on("/api/v1/what-ifs", get(what_ifs::all)).told(op::WHAT_IFS),
        on("/api/v1/what-ifs/{number}", get(what_ifs::one)).told(op::WHAT_IF),
        on("/api/v1/openapi.json", get(op::openapi)).told(op::DOCUMENT),
        on("/healthz", get(healthz)).told(op::HEALTHZ),
        on("/readyz", get(answers::readyz)).told(op::READYZ),
        on("/static/{*path}", get(asset)),
    ]
}

/// The service of all routes.
pub fn router(console: Console) -> Router {
    let secure = console.secure;
    let (with_text, plain): (Vec<Route>, Vec<Route>) =
        routes().into_iter().partition(|route| route.body_bytes_max == TEXT_BYTES_MAX);
    let of = |routes: Vec<Route>| {
        routes.into_iter().fold(Router::new(), |router, it| router.route(it.path, it.answer))
    };
    let guarded = |router: Router<Console>, bytes: usize| {
        let router = router.method_not_allowed_fallback(wrong_method).layer(DefaultBodyLimit::max(bytes));
        let router = router.layer(from_fn_with_state(console.clone(), guard::guard));
        router.layer(RequestBodyLimitLayer::new(bytes))
    };
    guarded(of(plain).fallback(not_found), BODY_BYTES_MAX)
        .merge(guarded(of(with_text), TEXT_BYTES_MAX))
        .layer(TimeoutLayer::with_status_code(StatusCode::REQUEST_TIMEOUT, REQUEST_TIMEOUT))
        .layer(from_fn(in_words))
        .layer(Extension(Home::Fleet))
        .layer(Extension(Description::of(op::document(secure))))
        .layer(from_fn_with_state(secure, secure_headers))
        .with_state(console)
}
