//! The guard before every route. It checks the host name of the request, a session (unless the table of
//! routes needs none), the origin of requests that change something, and the role.
//!
//! An unknown path needs a session too, so that strangers cannot find out which paths exist.

use std::collections::HashMap;
use std::net::{IpAddr, SocketAddr};
use std::sync::Arc;
use std::time::Duration;

use axum::body::{Body, Bytes};
use axum::extract::{FromRequest, FromRequestParts, MatchedPath, Request, State};
use axum::http::header::{AUTHORIZATION, HOST, ORIGIN, RETRY_AFTER, UPGRADE, WWW_AUTHENTICATE};
use axum::http::request::Parts;
use axum::http::{HeaderMap, Method, StatusCode};
use axum::middleware::Next;
use axum::response::{IntoResponse, Redirect, Response};
use tokio::time::timeout;

use super::origins::Origins;
use super::respond::{Reader, Speaks, cookies, header};
use crate::admission::connections::ConnectionHandle;
use crate::admission::peer::{Peer, place_of, source_of};
use crate::admission::recorded::{TRY_AGAIN_AFTER_S, is_bounded};
use crate::assets;
use crate::texts::{HttpError, Lang};
use crate::{AppState, Live};
use telltale_store::audit::{Action, Record};
use telltale_store::{Role, Session, SessionKind, Token};

/// The users who may use a route.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Access {
    /// Everybody: the route reveals nothing about the vehicle.
    Open,
    /// A file below `/static/`: without a session only the files of the login page.
    Asset,
    /// Everybody who is logged in.
    Session,
    /// Users who are logged in with one of these roles.
    Roles(&'static [Role]),
}

/// The access of each route, by its path and method.
pub type AccessTable = HashMap<(&'static str, Method), Access>;

/// The cookie of a session. Under TLS its prefix makes browsers refuse it from anywhere else.
pub const fn cookie_name(secure: bool) -> &'static str {
    if secure { "__Host-telltale" } else { "telltale" }
}

/// The time for the body of a request without a session.
const ANONYMOUS_BODY_TIMEOUT: Duration = Duration::from_secs(2);

/// The cookie of a browser from which somebody logged in before.
pub const fn device_cookie_name(secure: bool) -> &'static str {
    if secure { "__Host-telltale-device" } else { "telltale-device" }
}

/// The header of a request that a page makes by itself: it is no activity of the user.
const RENEWAL: &str = "telltale-renewal";

/// The session with which a request came. The guard has checked it.
#[derive(Debug, Clone)]
pub struct SignedIn(pub Session);

impl<S: Sync> FromRequestParts<S> for SignedIn {
    type Rejection = HttpError;

    async fn from_request_parts(parts: &mut Parts, _state: &S) -> Result<SignedIn, HttpError> {
        parts.extensions.get::<SignedIn>().cloned().ok_or(HttpError::NoSession)
    }
}

/// Refuses a request that would act on a vehicle where a recording is shown.
impl FromRequestParts<AppState> for Live {
    type Rejection = HttpError;

    async fn from_request_parts(_: &mut Parts, app: &AppState) -> Result<Live, HttpError> {
        app.live().ok_or(HttpError::Replay)
    }
}

/// The middleware around all routes and unknown paths.
pub async fn guard(
    State((app, table)): State<(AppState, Arc<AccessTable>)>,
    mut request: Request,
    next: Next,
) -> Response {
    if let Some(Peer(peer)) = request.extensions().get::<Peer>().copied() {
        let source = app.settings.enrolled.source(peer.ip(), request.headers());
        request.extensions_mut().insert(Peer(SocketAddr::new(source, peer.port())));
    }
    let headers = request.headers();
    if !header(headers, HOST.as_str()).is_some_and(|host| app.settings.origins.has_host(host)) {
        return HttpError::ForeignHost.into_response();
    }
    let access = access(&request, &table);
    let caller = Requester::of(&app, headers);
    let needs_session = match access {
        Access::Open => false,
        Access::Asset => !assets::is_open(request.uri().path()),
        Access::Session | Access::Roles(_) => true,
    };
    if caller.is_false {
        let (source, record) = refused(&request, None, "the token is not, or no longer, valid");
        app.record_refused(record, source).await;
    }
    if needs_session && caller.session.is_none() {
        return not_signed_in(&request);
    }
    let trouble = match &caller.session {
        _ if acts(&request)
            && !caller.is_bearer
            && !has_own_origin(&app.settings.origins, request.headers()) =>
        {
            Some(HttpError::ForeignOrigin)
        }
        Some(session) if matches!(access, Access::Roles(roles) if !app.permits(roles, session)) => {
            Some(HttpError::Forbidden)
        }
        Some(session)
            if is_bounded(request.method(), request.uri().path(), session.role)
                && !app.recorded.admit(app.clock.now(), &session.user) =>
        {
            Some(HttpError::TooMany)
        }
        _ => None,
    };
    if let Some(trouble) = trouble {
        let (source, record) = refused(&request, caller.session.as_ref(), Lang::En.error_text(trouble));
        app.record_refused(record, source).await;
        let mut answer = trouble.into_response();
        if trouble == HttpError::TooMany {
            answer.headers_mut().insert(RETRY_AFTER, TRY_AGAIN_AFTER_S.into());
        }
        return answer;
    }
    let mut request = match admitted(request, caller.session.as_ref()).await {
        Ok(request) => request,
        Err(trouble) => return trouble.into_response(),
    };
    if let Some(session) = caller.session {
        if !request.headers().contains_key(RENEWAL) {
            session.touch(app.clock.now());
        }
        note_place(&app, &session, source_of(request.extensions().get::<Peer>().copied()));
        request.extensions_mut().insert(SignedIn(session));
    }
    next.run(request).await
}

impl AppState {
    /// Whether a session has one of these roles. Of a replay, people of a fleet's console read what an authority does.
    fn permits(&self, roles: &[Role], session: &Session) -> bool {
        let reads = || self.live().is_none() && Role::OF_CONSOLE.contains(&session.role);
        roles.contains(&session.role) || reads() && roles.contains(&Role::Authority)
    }
}

/// Records that a session is used from another place than at its beginning. Its pages show it too.
fn note_place(app: &AppState, session: &Session, source: IpAddr) {
    if let Some(first) = session.used_from(source, place_of(source)) {
        tracing::warn!(user = &*session.user, %source, "a session is used from another address than at its beginning");
        app.store.note(
            Record::of_session(session, Action::SessionElsewhere, source).on(format!("before: {first}")),
        );
    }
}

/// Admits a request. Without a session its body must arrive in time, and a place for anonymous requests must
/// be free: an unfinished request makes nobody wait.
pub async fn admitted(request: Request, session: Option<&Session>) -> Result<Request, HttpError> {
    let handle = request.extensions().get::<ConnectionHandle>().cloned();
    if handle.as_ref().is_some_and(|handle| handle.hold(session)) {
        return Ok(request);
    }
    let (parts, body) = request.into_parts();
    let body = match timeout(ANONYMOUS_BODY_TIMEOUT, Bytes::from_request(Request::new(body), &())).await {
        Ok(Ok(body)) => body,
        Ok(Err(rejection)) if rejection.status() == StatusCode::PAYLOAD_TOO_LARGE => {
            return Err(HttpError::TooLarge);
        }
        Ok(Err(_)) => return Err(HttpError::BadRequest),
        Err(_) => return Err(HttpError::TooSlow),
    };
    if handle.is_some_and(|handle| !handle.answer()) {
        return Err(HttpError::Busy);
    }
    Ok(Request::from_parts(parts, Body::from(body)))
}

/// The audit record of a refused request, and its source.
fn refused(request: &Request, session: Option<&Session>, why: &str) -> (IpAddr, Record) {
    let source = source_of(request.extensions().get::<Peer>().copied());
    let target = format!("{} {}", request.method(), request.uri().path());
    let record = Record::of(Action::Request, source.to_string()).on(target).refused(why);
    let record = match session {
        Some(session) => record.by(&*session.user, session.role),
        None => record,
    };
    (source, record)
}

fn access(request: &Request, table: &AccessTable) -> Access {
    let Some(path) = request.extensions().get::<MatchedPath>() else { return Access::Session };
    // A HEAD is answered as its GET is.
    let method = if request.method() == Method::HEAD { &Method::GET } else { request.method() };
    let row = table.iter().find(|((routed, of), _)| *routed == path.as_str() && of == method);
    row.map_or(Access::Session, |(_, access)| *access)
}

struct Requester {
    session: Option<Session>,
    /// The token came in a header that no browser sends by itself.
    is_bearer: bool,
    /// It came in that header and is not valid.
    is_false: bool,
}

impl Requester {
    fn of(app: &AppState, headers: &HeaderMap) -> Requester {
        if let Some(token) = bearer(headers) {
            let session = Token::parse(token).and_then(|token| app.session(&token));
            return Requester { is_bearer: session.is_some(), is_false: session.is_none(), session };
        }
        Requester { session: cookie_session(app, headers), is_bearer: false, is_false: false }
    }
}

/// The token of a program. The name of a scheme may be written in any case (RFC 9110, 11.1).
pub fn bearer(headers: &HeaderMap) -> Option<&str> {
    let value = header(headers, AUTHORIZATION.as_str())?;
    let (scheme, token) = value.split_once(' ').unwrap_or((value, ""));
    scheme.eq_ignore_ascii_case("bearer").then(|| token.trim_start())
}

/// The session of the cookie. If several cookies belong to open sessions, one was put there by somebody
/// else, so none counts.
pub fn cookie_session(app: &AppState, headers: &HeaderMap) -> Option<Session> {
    one_session(headers, app.settings.secure, |token| app.session(token))
}

/// The same with any store of sessions.
pub fn one_session(
    headers: &HeaderMap,
    secure: bool,
    session: impl Fn(&Token) -> Option<Session>,
) -> Option<Session> {
    let tokens = cookies(headers, cookie_name(secure)).filter_map(Token::parse);
    let mut sessions = tokens.filter_map(|token| session(&token));
    let session = sessions.next()?;
    // A program's token in a cookie would be a session that no login made.
    let is_one = sessions.all(|other| other.is(&session)) && session.kind == SessionKind::Person;
    is_one.then_some(session)
}

/// Whether a request may change something, or opens a socket.
fn acts(request: &Request) -> bool {
    !matches!(*request.method(), Method::GET | Method::HEAD) || is_upgrade(request)
}

fn is_upgrade(request: &Request) -> bool {
    request.headers().contains_key(UPGRADE)
}

/// Whether a page of this server sent the request. Under `Referrer-Policy: no-referrer` alone
/// browsers would send a form's origin as `null`: every page relaxes it by a `meta` of its own.
pub fn has_own_origin(own: &Origins, headers: &HeaderMap) -> bool {
    // Of several, each has to be ours.
    let mut origins = headers.get_all(ORIGIN).iter().peekable();
    origins.peek().is_some() && origins.all(|it| it.to_str().is_ok_and(|it| own.has(it)))
}

/// Browsers are led to the login when they ask for a page; all others get 401.
fn not_signed_in(request: &Request) -> Response {
    let is_page = Reader::of(request.uri(), request.headers(), request.extensions()).speaks == Speaks::Html
        && !is_upgrade(request)
        && request.uri().path() != "/ws"
        && !request.uri().path().starts_with("/static/");
    if is_page {
        return Redirect::to("/login").into_response();
    }
    ([(WWW_AUTHENTICATE, "Bearer")], HttpError::NoSession).into_response()
}
