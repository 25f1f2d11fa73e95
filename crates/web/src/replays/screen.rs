//! The screens of a replay: the operator's page and the developer's pages as they were, behind the address of the
//! replay.

use axum::Router;
use axum::body::{Body, to_bytes};
use axum::extract::{Path, Request, State};
use axum::http::header::{ACCEPT_ENCODING, CONTENT_LENGTH, CONTENT_SECURITY_POLICY, CONTENT_TYPE};
use axum::http::{Extensions, HeaderValue, Uri};
use axum::response::{IntoResponse, Redirect, Response};
use hyper::upgrade::OnUpgrade;
use tower::ServiceExt as _;

use crate::AppState;
use crate::admission::connections::ConnectionHandle;
use crate::admission::peer::Peer;
use crate::http::guard::SignedIn;
use crate::http::headers::FRAMED;
use crate::http::respond::{Reader, refusal};
use crate::live::byte_budget::Meter;
use crate::texts::{HttpError, IncidentWords};
use crate::view::Home;

/// The developer's pages of a replay. All others read the present of the vehicle, of its store or of its files.
const PAGES: [&str; 8] = [
    "developer",
    "developer/why",
    "developer/search",
    "developer/graph",
    "developer/timeline",
    "developer/masking",
    "developer/coverage",
    "developer/topics",
];
/// The part of a replay that the operator's page and programs read.
const OTHERS: [&str; 9] = [
    "",
    "ws",
    "developer/live",
    "api/v1/snapshot",
    "api/v1/stream",
    "api/v1/statuses",
    "api/v1/history",
    "api/v1/topics",
    "api/v1/values",
];
/// No page is larger.
const PAGE_BYTES_MAX: usize = 64 << 20;

/// `GET /replay/{id}/screen/`: the operator's page.
pub async fn first(
    state: State<AppState>,
    Path(id): Path<String>,
    session: SignedIn,
    request: Request,
) -> Response {
    get(state, Path((id, String::new())), session, request).await
}

/// `GET /replay/{id}/screen/...`: a page of the server, as it was.
pub async fn get(
    State(app): State<AppState>,
    Path((id, path)): Path<(String, String)>,
    SignedIn(session): SignedIn,
    mut request: Request,
) -> Response {
    let reader = Reader::of(request.uri(), request.headers(), request.extensions());
    let base = format!("/replay/{id}/screen");
    let Some(open) = app.replays.of_address(&id, &session, app.clock.now()) else {
        return based(refusal(&reader, HttpError::NotFound), &base, &[]).await;
    };
    if path == "developer/moment" {
        // The replay's own page goes there.
        let at = request.uri().query().unwrap_or_default();
        return Redirect::to(&format!("/replay/{id}?{at}")).into_response();
    }
    let query = request.uri().query().map(|query| format!("?{query}")).unwrap_or_default();
    let known = PAGES.iter().chain(&OTHERS).find(|known| **known == path);
    let Some(uri) = known.and_then(|known| Uri::try_from(format!("/{known}{query}")).ok()) else {
        return based(refusal(&reader, HttpError::NotFound), &base, &[]).await;
    };
    *request.uri_mut() = uri;
    // The answer is changed, and compressed afterwards.
    request.headers_mut().remove(ACCEPT_ENCODING);
    let answer = passed_on(&open.screen, request).await;
    let it = IncidentWords::of(reader.lang);
    let edited = if open.subject.is_edited() { it.edited } else { "" };
    let signs = [("edited", edited), ("missing", &*open.missing.sign(reader.lang, it))];
    based(answer, &base, &signs).await
}

/// Whether this is the address of a developer's page behind that of a replay, maybe with a query.
pub fn is_page(address: &str) -> bool {
    let path = address.split(['?', '#']).next().and_then(|path| path.strip_prefix('/'));
    path.is_some_and(|path| PAGES.contains(&path))
}

/// The answer of a server behind this one.
pub async fn passed_on(server: &Router, mut request: Request) -> Response {
    // The server behind would take the parameters of this address for its own.
    let mut outer = std::mem::take(request.extensions_mut());
    carry::<Peer>(&mut outer, &mut request);
    carry::<Meter>(&mut outer, &mut request);
    carry::<ConnectionHandle>(&mut outer, &mut request);
    carry::<OnUpgrade>(&mut outer, &mut request);
    carry::<Home>(&mut outer, &mut request);
    match server.clone().oneshot(request).await {
        Ok(answer) => answer,
        Err(never) => match never {},
    }
}

/// Gives a request what the connection says of itself.
fn carry<T: Clone + Send + Sync + 'static>(from: &mut Extensions, to: &mut Request) {
    if let Some(value) = from.remove::<T>() {
        to.extensions_mut().insert(value);
    }
}

/// A page with links that stay in the replay. The replay's own page may frame it. `signs` stand on every page, each with
/// the name of its attribute: that it shows what was never shown, or what may differ from it.
async fn based(mut answer: Response, base: &str, signs: &[(&str, &str)]) -> Response {
    answer.headers_mut().insert(CONTENT_SECURITY_POLICY, HeaderValue::from_static(FRAMED));
    let is_page = |kind: &HeaderValue| kind.as_bytes().starts_with(b"text/html");
    if !answer.headers().get(CONTENT_TYPE).is_some_and(is_page) {
        return answer;
    }
    let (mut parts, body) = answer.into_parts();
    let Ok(bytes) = to_bytes(body, PAGE_BYTES_MAX).await else {
        return HttpError::Unavailable.status().into_response();
    };
    // Text of the vehicle has no bare quotes in it: these are attributes of templates.
    let mut page = String::from_utf8_lossy(&bytes).into_owned();
    for address in ["/developer", "/ws"] {
        page = page.replace(&format!("=\"{address}"), &format!("=\"{base}{address}"));
    }
    page = page.replace("href=\"/\"", &format!("href=\"{base}/\""));
    for (name, sign) in signs.iter().filter(|(_, sign)| !sign.is_empty()) {
        page = page.replacen("<body ", &format!("<body data-{name}=\"{sign}\" "), 1);
    }
    parts.headers.remove(CONTENT_LENGTH);
    Response::from_parts(parts, Body::from(page))
}
