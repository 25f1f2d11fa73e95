//! The table of all routes: who may use each, and its handler.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use axum::extract::DefaultBodyLimit;
use axum::handler::Handler;
use axum::http::{Extensions, HeaderMap, Method, StatusCode, Version, header};
use axum::middleware::{from_fn, from_fn_with_state};
use axum::response::Redirect;
use axum::routing::{MethodRouter, get, post};
use axum::{Extension, Router};
use serde_json::Value;
use tower_http::CompressionLevel;
use tower_http::compression::CompressionLayer;
use tower_http::compression::predicate::{DefaultPredicate, Predicate as _};
use tower_http::limit::RequestBodyLimitLayer;
use tower_http::timeout::TimeoutLayer;

use super::api::openapi::{Described, Description, VEHICLE, document};
use super::api::operation::Operation;
use super::api::operations as op;
use super::auth::login;
use super::developer::incidents::what_if;
use super::developer::shelving;
use super::http::guard::Access::{Asset, Open, Roles, Session};
use super::http::guard::{Access, AccessTable, guard};
use super::http::origins::Origins;
use super::http::{headers, plain_errors, readers};
use super::live::socket;
use super::operator::{actions, last_alarms};
use super::replays::ServedFiles;
use super::source::Player;
use super::{AppState, Settings};
use super::{api, demo, developer, incidents, pages, replays};
use telltale_clock::Clock;
use telltale_engine::Engine;
use telltale_engine::model::{Model, Parts, StageModel};
use telltale_runtime::Published;
use telltale_store::Role::{Authority, Developer, Operator};
use telltale_store::Store;

/// The largest body of a request.
pub const BODY_BYTES_MAX: usize = 16 * 1024;
/// The largest body of a form with a configuration: its letters may be written as three each.
pub const TEXT_BYTES_MAX: usize = 1024 * 1024;
/// The time for a whole request with its body. Sockets have none.
const REQUEST_TIMEOUT: Duration = Duration::from_secs(10);

/// The routes of a server that shows a file alone begin with these.
const OF_A_FILE: [&str; 6] = ["/login", "/logout", "/replay/", "/static/", "/healthz", "/readyz"];

/// One row of the table.
#[derive(Debug)]
pub struct Route {
    pub method: Method,
    pub path: &'static str,
    pub access: Access,
    /// The same for all methods of a path.
    body_bytes_max: usize,
    answer: MethodRouter<AppState>,
    /// The error for programs; `None` for pages.
    pub operation: Option<&'static Operation>,
}

impl Route {
    fn told(self, operation: &'static Operation) -> Route {
        Route { operation: Some(operation), ..self }
    }
}

/// All routes of this server.
pub fn routes(has_demo: bool) -> Vec<Route> {
    let mut routes = vec![
        on_get("/", Session, pages::operator),
        on_get("/login", Open, login::page),
        on_post("/login", Open, login::login).told(&op::LOGIN),
        on_post("/logout", Session, login::logout).told(&op::LOGOUT),
        on_get("/ws", Session, socket::page),
        on_post("/vehicle/localize", Roles(&[Operator]), actions::localize).told(&op::LOCALIZE),
        on_post("/vehicle/clearance", Roles(&[Operator]), actions::clearance).told(&op::CLEARANCE),
        on_post("/vehicle/clearance/confirm", Roles(&[Operator]), actions::confirm)
            .told(&op::CONFIRM_CLEARANCE),
        on_post("/vehicle/clearance/withdraw", Roles(&[Operator]), actions::withdraw).told(&op::WITHDRAW),
        on_post("/vehicle/release", Roles(&[Operator]), actions::release).told(&op::RELEASE),
        on_post("/vehicle/release/confirm", Roles(&[Operator]), actions::confirm_release)
            .told(&op::CONFIRM_RELEASE),
        on_post("/vehicle/stop", Roles(&[Operator]), actions::stop).told(&op::STOP),
        on_post("/vehicle/shutdown", Roles(&[Operator]), login::shutdown).told(&op::SHUTDOWN),
        on_post("/alarms/acknowledge-over", Roles(&[Operator]), actions::acknowledge_over)
            .told(&op::ACKNOWLEDGE_OVER),
        on_get("/alarms/last", Session, last_alarms::get),
        // Ids hold slashes: these end in `/acknowledge` and `/reset`.
        on_post("/alarms/{*path}", Roles(&[Operator]), actions::acknowledge).told(&op::ACKNOWLEDGE),
        on_post("/modules/{*path}", Roles(&[Operator]), actions::reset).told(&op::RESET),
        on_get("/developer", Roles(&[Developer, Authority]), developer::statuses::get),
        on_get("/developer/why", Roles(&[Developer, Authority]), developer::why::get),
        on_get("/developer/search", Roles(&[Developer, Authority]), developer::search::get),
        on_get("/developer/graph", Roles(&[Developer, Authority]), developer::graph::get),
        on_get("/developer/learn", Roles(&[Developer, Authority]), developer::learn::get),
        on_get("/developer/timeline", Roles(&[Developer, Authority]), developer::timeline::get),
        on_get("/developer/moment", Roles(&[Developer, Authority]), replays::moment),
        on_get("/developer/masking", Roles(&[Developer, Authority]), developer::masking::get),
        on_get("/developer/coverage", Roles(&[Developer, Authority]), developer::coverage::get),
        on_get("/developer/statistics", Roles(&[Developer, Authority]), developer::statistics::get),
        on_get("/developer/topics", Roles(&[Developer, Authority]), developer::topics::get),
        on_get("/developer/live", Roles(&[Developer, Authority]), socket::pulse),
        on_get("/developer/configuration", Roles(&[Developer, Authority]), developer::configuration::get),
        on_get("/developer/api", Roles(&[Developer, Authority]), api::page::get),
        on_get("/developer/audit", Roles(&[Developer, Authority]), developer::audit::get),
        on_post("/developer/configuration/reload", Roles(&[Developer]), developer::reload::post),
        on_post("/developer/shelving", Roles(&[Developer]), shelving::shelve).told(&op::SHELVE),
        on_post("/developer/shelving/end", Roles(&[Developer]), shelving::unshelve).told(&op::UNSHELVE),
        on_get("/incidents", Roles(&[Developer, Authority]), developer::incidents::list::get),
        // The page of an incident; with `.mcap` after its number its recording, with `.html` its report.
        on_get("/incidents/{id}", Roles(&[Developer, Authority]), developer::incidents::one::get)
            .told(&op::RECORDING),
        on_post("/incidents/mark", Roles(&[Developer]), incidents::mark),
        on_post("/incidents/{id}/note", Roles(&[Developer]), incidents::note),
        on_post("/incidents/{id}/keep", Roles(&[Developer]), incidents::keep),
        with_text(on_get("/incidents/{id}/what-if", Roles(&[Developer]), what_if::get)),
        with_text(on_post("/incidents/{id}/what-if", Roles(&[Developer]), what_if::post)),
        on_get("/replay/{id}", Roles(&[Developer, Authority]), replays::get),
        on_get("/replay/{id}/state", Roles(&[Developer, Authority]), replays::state),
        on_post("/replay/{id}/state", Roles(&[Developer, Authority]), replays::control),
        on_get("/replay/{id}/differences", Roles(&[Developer, Authority]), replays::differences),
        on_get("/replay/{id}/screen/", Roles(&[Developer, Authority]), replays::first_screen),
        on_get("/replay/{id}/screen/{*path}", Roles(&[Developer, Authority]), replays::screen),
        on_get("/api/v1/incidents", Roles(&[Developer, Authority]), api::incidents::list)
            .told(&op::INCIDENTS),
        on_get("/api/v1/incidents/{id}", Roles(&[Developer, Authority]), api::incidents::one)
            .told(&op::INCIDENT),
        on_post("/api/v1/incidents/{id}/note", Roles(&[Developer]), incidents::note).told(&op::NOTE),
        on_post("/api/v1/incidents/{id}/keep", Roles(&[Developer]), incidents::keep).told(&op::KEEP),
        on_post("/api/v1/mark", Roles(&[Operator, Developer]), incidents::mark).told(&op::MARK),
        on_get("/api/v1/snapshot", Session, pages::snapshot).told(&op::SNAPSHOT),
        on_get("/api/v1/stream", Session, socket::stream).told(&op::STREAM),
        on_get("/api/v1/statuses", Roles(&[Developer, Authority]), api::statuses::get).told(&op::STATUSES),
        on_get("/api/v1/history", Roles(&[Developer, Authority]), api::history::get).told(&op::HISTORY),
        on_get("/api/v1/statistics", Roles(&[Developer, Authority]), api::statistics::get)
            .told(&op::STATISTICS),
        on_get("/api/v1/values", Roles(&[Developer, Authority]), api::values::get).told(&op::VALUES),
        on_get("/api/v1/topics", Roles(&[Developer, Authority]), api::topics::get).told(&op::TOPICS),
        on_get("/api/v1/audit", Roles(&[Developer, Authority]), api::audit::get).told(&op::AUDIT),
        on_get("/api/v1/openapi.json", Session, api::openapi::get).told(&op::OPENAPI),
        on_get("/api/v1/schema/snapshot.json", Session, api::openapi::snapshot_schema)
            .told(&op::SNAPSHOT_SCHEMA),
        on_get("/api/v1/schema/stream.json", Session, api::openapi::stream_schema).told(&op::STREAM_SCHEMA),
        on_get("/healthz", Open, pages::healthz).told(&op::HEALTHZ),
        on_get("/readyz", Open, pages::readyz).told(&op::READYZ),
        on_get("/static/{*path}", Asset, pages::asset),
    ];
    if has_demo {
        routes.push(on_get("/demo", Session, demo::page));
        routes.push(on_post("/demo/fault", Roles(&[Operator, Developer]), demo::fault));
    }
    routes
}

/// The OpenAPI document of all routes that are for programs.
pub fn openapi(secure: bool) -> Value {
    let routes = routes(false);
    let described = |route: &'_ Route| {
        let Route { method, path, access, operation, .. } = route;
        operation.map(|operation| Described { method: method.clone(), path, access: *access, operation })
    };
    document(&VEHICLE, routes.iter().filter_map(described), secure)
}

/// The service of all routes, behind the guard.
pub fn router(app: AppState) -> Router {
    let (mut plain, mut with_text) = (Router::new(), Router::new());
    let mut table: AccessTable = HashMap::new();
    let shows_file = app.settings.replayed.is_some();
    for mut route in routes(app.settings.demo.is_some()) {
        if shows_file {
            // There is no vehicle whose pages the others would be.
            if route.method == Method::GET && matches!(route.path, "/" | "/developer") {
                route.answer = get(async || Redirect::to("/replay/file"));
            } else if !OF_A_FILE.iter().any(|path| route.path.starts_with(path)) {
                continue;
            }
        }
        table.insert((route.path, route.method), route.access);
        let router = if route.body_bytes_max == BODY_BYTES_MAX { &mut plain } else { &mut with_text };
        *router = std::mem::take(router).route(route.path, route.answer);
    }
    let description = Description::of(openapi(app.settings.secure));
    let guard = from_fn_with_state((app.clone(), Arc::new(table)), guard);
    let readers = from_fn_with_state(app.clone(), readers::apart);
    let packed = CompressionLayer::new().quality(CompressionLevel::Fastest);
    let packed = packed.compress_when(DefaultPredicate::new().and(is_made_now));
    let guarded = |router: Router<AppState>, bytes: usize| {
        let router = router.method_not_allowed_fallback(pages::wrong_method);
        let router = router.layer(DefaultBodyLimit::max(bytes));
        let router = router.layer(packed.clone()).layer(readers.clone()).layer(guard.clone());
        router.layer(RequestBodyLimitLayer::new(bytes))
    };
    guarded(plain.fallback(pages::not_found), BODY_BYTES_MAX)
        .merge(guarded(with_text, TEXT_BYTES_MAX))
        .layer(TimeoutLayer::with_status_code(StatusCode::REQUEST_TIMEOUT, REQUEST_TIMEOUT))
        .layer(from_fn(plain_errors::in_words))
        .layer(from_fn_with_state(app.settings.secure, headers::secure))
        .layer(Extension(description))
        .with_state(app)
}

/// The service of the recordings that another server shows. That server knows who may see which, and logs people in.
pub fn shown_files(
    files: ServedFiles,
    (store, clock): (Store, Clock),
    origins: Origins,
    secure: bool,
) -> Router {
    let model = Model::new(Parts::empty("", StageModel::None)).expect("nothing depends on itself");
    let snapshot = Engine::new(Arc::new(model), clock.now()).snapshot();
    let (_, source) = Player::start(Published::recorded(snapshot, clock.wall()));
    let settings = Settings { replayed: Some(files), ..Settings::plain(origins, secure) };
    router(AppState::new(source, store, clock, settings))
}

/// Whether an answer was made for this request. Files have a tag; they are compressed already, or too small.
fn is_made_now(_: StatusCode, _: Version, headers: &HeaderMap, _: &Extensions) -> bool {
    !headers.contains_key(header::ETAG)
}

fn on_get<T: 'static>(path: &'static str, access: Access, answer: impl Handler<T, AppState>) -> Route {
    Route {
        method: Method::GET,
        path,
        access,
        body_bytes_max: BODY_BYTES_MAX,
        answer: get(answer),
        operation: None,
    }
}

fn on_post<T: 'static>(path: &'static str, access: Access, answer: impl Handler<T, AppState>) -> Route {
    Route {
        method: Method::POST,
        path,
        access,
        body_bytes_max: BODY_BYTES_MAX,
        answer: post(answer),
        operation: None,
    }
}

/// With bodies that hold a configuration.
fn with_text(route: Route) -> Route {
    Route { body_bytes_max: TEXT_BYTES_MAX, ..route }
}
