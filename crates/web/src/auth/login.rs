//! Login and logout.

use std::hash::{BuildHasher as _, RandomState};
use std::net::IpAddr;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use axum::Json;
use axum::extract::rejection::FormRejection;
use axum::extract::{Form, RawQuery, State};
use axum::http::header::{RETRY_AFTER, SET_COOKIE};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{Html, IntoResponse, Redirect, Response};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::json;
use tokio::time::timeout;

use super::expiry::is_in_charge;
use super::session_ends;
use super::sign_in_out;
use super::sign_in_out::{LoginAttempt, NotOpened};
use crate::admission::login_throttle::{Source, Throttle};
use crate::admission::peer::CameFrom;
use crate::http::guard::{SignedIn, cookie_name, cookie_session, device_cookie_name};
use crate::http::respond::{Reader, Speaks, cookie, json_answer, refusal, refused};
use crate::texts::HttpError;
use crate::view;
use crate::view::{LoginContext, LoginFailure};
use crate::{AppState, Live};
use telltale_engine::input::OperatorAction;
use telltale_engine::model::Stage;
use telltale_engine::time::Span;
use telltale_store::audit::{Action, Record};
use telltale_store::{Caller, Role, SESSION_LIFE, Session, SessionKind, Store, Token, Verified, is_pin};

/// The cookie outlives the session: the server judges when a session ends, and that of an operator who
/// drives lasts longer.
const COOKIE_LIFE: Duration = SESSION_LIFE.saturating_mul(2);

/// A browser is known for as long as it is used in a year.
const DEVICE_LIFE: Duration = Duration::from_secs(365 * 24 * 3600);
/// A login at a display waits no longer for others there.
const PROVEN_WITHIN: Span = Span::from_secs(20);
/// The time for the disk to take the cookie of a known browser.
const DEVICE_WITHIN: Duration = Duration::from_secs(1);

/// The earlier attempts to log in.
#[derive(Debug, Default)]
pub struct Proofs {
    throttle: Mutex<Throttle>,
    /// Held while a secret from a display or a known browser is proven: the next one is judged by what came of it.
    proving: tokio::sync::Mutex<()>,
    /// Makes numbers of names that are no user's, by a key of this run.
    unknown_names: RandomState,
}

#[derive(Deserialize, JsonSchema)]
pub struct LoginForm {
    name: String,
    /// The PIN or the password.
    secret: Option<String>,
    /// Given by an operator who was told that another one is in charge, and takes over.
    take_over: Option<String>,
    /// In place of the secret: the token of the question whether to take over.
    confirm: Option<String>,
}

/// The user who has logged in.
#[derive(Serialize, JsonSchema)]
pub struct LoggedIn<'a> {
    name: &'a str,
    role: &'static str,
}

/// Operators whose names the vehicle's own displays offer. If there are more, none is offered.
const NAMES_MAX: usize = 4;

/// The query with which an operator's page leads another operator to the login.
const CHANGE: &str = "change";

/// `GET /login`, and `GET /login?change` for another operator at the display of the present one
pub async fn page(
    State(app): State<AppState>,
    CameFrom(source): CameFrom,
    RawQuery(query): RawQuery,
    headers: HeaderMap,
    reader: Reader,
) -> Response {
    // While the vehicle is locked an operator may follow somebody else at the same display.
    let locked = app.published().snapshot.stage == Stage::Locked;
    let open = cookie_session(&app, &headers).filter(|_| !locked);
    let from =
        query.filter(|query| query == CHANGE).and(open.as_ref()).and_then(|open| in_charge(&app, open));
    if open.is_some() && from.is_none() {
        return Redirect::to("/").into_response();
    }
    let nobody = match app.store.has_users().await {
        Ok(false) => Some(no_users(&app)),
        Err(error) if error.is_of_storage() => Some(LoginFailure::Storage),
        _ => None,
    };
    let shown = LoginContext {
        failure: nobody,
        session_end: session_ends::of(&app, &headers).await,
        names: names(&app, source, from.as_deref()).await,
        from,
        ..login_context(&app, &reader)
    };
    Html(view::login_page(&shown)).into_response()
}

/// The user of this session, if it is the one in charge of the vehicle.
fn in_charge(app: &AppState, session: &Session) -> Option<String> {
    is_in_charge(session, &app.published().snapshot).then(|| session.user.to_string())
}

fn login_context(app: &AppState, reader: &Reader) -> LoginContext {
    let dpi = app.published().snapshot.layout.display_dpi;
    LoginContext::new(reader.lang, reader.palette, dpi, app.settings.demo.is_some())
}

/// The names that a display offers, so that an operator types none. Only the vehicle's own displays get them. A
/// take-over is by somebody else than the operator in charge.
async fn names(app: &AppState, source: IpAddr, from: Option<&str>) -> Vec<String> {
    let mut names = match app.caller(source) {
        Caller::Vehicle => app.store.operators(NAMES_MAX).await.unwrap_or_default(),
        Caller::Elsewhere => Vec::new(),
    };
    names.retain(|name| from != Some(name.as_str()));
    names
}

/// The hint for a vehicle without users. The name of the folder is quoted for a shell.
fn no_users(app: &AppState) -> LoginFailure {
    let data = app.store.folder().map(|folder| folder.display().to_string());
    let is_plain = |it: char| it.is_alphanumeric() || "/._-+:@%,".contains(it);
    let quoted = |data: String| match data.chars().all(is_plain) {
        true => data,
        false => format!("'{}'", data.replace('\'', r"'\''")),
    };
    LoginFailure::NoUsers { data: data.map(quoted) }
}

/// `POST /login`
pub async fn login(
    app: Live,
    CameFrom(source): CameFrom,
    headers: HeaderMap,
    reader: Reader,
    form: Result<Form<LoginForm>, FormRejection>,
) -> Response {
    let form = match form {
        Ok(Form(form)) => form,
        Err(rejection) if rejection.status() == StatusCode::PAYLOAD_TOO_LARGE => {
            return rejection.into_response();
        }
        Err(_) => return refusal(&reader, HttpError::BadForm),
    };
    let device =
        known_device(&app.store, app.settings.secure, app.caller(source), &headers, &form.name).await;
    let proven = match (&form.secret, &form.confirm) {
        (Some(secret), _) => {
            let proven = prove(&app, &form.name, secret, source, device.clone()).await;
            proven.map(|user| (user, form.take_over.is_some()))
        }
        (None, Some(token)) => confirmed(&app, token, &form.name, source).ok_or(LoginFailure::TakeOverLate),
        (None, None) => return refusal(&reader, HttpError::BadForm),
    };
    let before = cookie_session(&app, &headers);
    let changes = form.take_over.is_some() && form.confirm.is_none();
    let from = before.as_ref().filter(|_| changes).and_then(|open| in_charge(&app, open));
    let page = Failing { app: &app, reader: &reader, name: &form.name, source, from };
    let (user, takes_over) = match proven {
        Ok(proven) => proven,
        Err(failure) => {
            let name = recorded_name(&app, &form.name).await;
            let record = Record::of(Action::Login, source.to_string()).on(name).refused(failure.as_str());
            app.store.record(record.by_anybody(app.caller(source)), None).await;
            return page.failed(failure).await;
        }
    };
    let has_session = before.is_some();
    let attempt = LoginAttempt {
        user: user.clone(),
        source,
        takes_over,
        before,
        until: app.clock.now() + sign_in_out::DONE_WITHIN,
    };
    match sign_in_out::log_in(&app, attempt).await {
        Ok((token, session)) => {
            let mut answer = welcome(&app, &reader, &token, &session);
            if device.is_none() {
                make_known(&app.store, app.settings.secure, &user, &mut answer).await;
            }
            answer
        }
        Err(NotOpened::Refused(reasons)) => refused(&reader, &reasons),
        Err(NotOpened::OtherOperator(by)) => {
            let asked = app.take_overs.ask(&user, &by, source, app.clock.now());
            let Ok(token) = asked else { return page.failed(LoginFailure::Unavailable).await };
            page.failed(LoginFailure::OtherOperator { by, token, has_session }).await
        }
        Err(NotOpened::Drives) => page.failed(LoginFailure::Drives).await,
        Err(NotOpened::Storage) => page.failed(LoginFailure::Storage).await,
        Err(NotOpened::Busy | NotOpened::Unavailable) => page.failed(LoginFailure::Unavailable).await,
    }
}

/// The operator who confirms a take-over, and whether it is from the one that was named: if somebody else is in
/// charge by now, the question is asked again.
fn confirmed(app: &AppState, token: &str, name: &str, source: IpAddr) -> Option<(Verified, bool)> {
    let (user, from) = app.take_overs.answer(&Token::parse(token)?, name, source, app.clock.now())?;
    let is_from = app.published().snapshot.operator.as_deref() == Some(&*from);
    Some((user, is_from))
}

/// `POST /logout`
pub async fn logout(
    app: Live,
    CameFrom(source): CameFrom,
    SignedIn(session): SignedIn,
    reader: Reader,
) -> Response {
    leave(app, source, session, &reader, OperatorAction::Logout).await
}

/// `POST /vehicle/shutdown`: the operator ends the work with the vehicle, and leaves it.
pub async fn shutdown(
    app: Live,
    CameFrom(source): CameFrom,
    SignedIn(session): SignedIn,
    reader: Reader,
) -> Response {
    leave(app, source, session, &reader, OperatorAction::Shutdown).await
}

/// The name of a failed login for the audit log. A name of no user may be a secret that was typed into the
/// wrong field: it is recorded as a number, which is the same for the same text until a restart.
async fn recorded_name(app: &AppState, name: &str) -> String {
    match app.store.knows_user(name).await {
        Ok(true) => name.to_owned(),
        _ => format!("(unknown name, {:08x})", app.proofs.unknown_names.hash_one(name) >> 32),
    }
}

async fn leave(
    app: Live,
    source: IpAddr,
    session: Session,
    reader: &Reader,
    action: OperatorAction,
) -> Response {
    // A program's token is taken back on the command line.
    if session.kind == SessionKind::Program {
        return refusal(&Reader { speaks: Speaks::Json, ..*reader }, HttpError::Forbidden);
    }
    match sign_in_out::leave(&app, &session, source, action).await {
        Ok(()) => {}
        Err(NotOpened::Refused(reasons)) => return refused(reader, &reasons),
        Err(NotOpened::Storage) => return refusal(reader, HttpError::Storage),
        Err(NotOpened::Busy) => return refusal(reader, HttpError::Busy),
        Err(NotOpened::OtherOperator(_) | NotOpened::Drives | NotOpened::Unavailable) => {
            return refusal(reader, HttpError::Unavailable);
        }
    }
    tracing::info!(user = &*session.user, "logged out");
    let mut answer = match reader.speaks {
        Speaks::Json => json_answer(StatusCode::OK, &json!({})),
        Speaks::Html => Redirect::to("/login").into_response(),
    };
    set_cookie(&mut answer, app.settings.secure, cookie_name, "", Duration::ZERO);
    answer
}

/// The cookie of a browser from which this user logged in before.
pub async fn known_device(
    store: &Store,
    secure: bool,
    caller: Caller,
    headers: &HeaderMap,
    name: &str,
) -> Option<Token> {
    let token = cookie(headers, device_cookie_name(secure)).and_then(Token::parse)?;
    // A user who cannot be looked up is not known.
    let is_known = store.is_device_of(caller, &token, name).await.unwrap_or(false);
    is_known.then_some(token)
}

/// Gives the browser a cookie by which it is known from now on. With a slow disk the login works without
/// one.
pub async fn make_known(store: &Store, secure: bool, user: &Verified, answer: &mut Response) {
    if let Ok(Ok(token)) = timeout(DEVICE_WITHIN, store.know_device(user)).await {
        set_cookie(answer, secure, device_cookie_name, token.as_str(), DEVICE_LIFE);
    }
}

async fn prove(
    app: &AppState,
    name: &str,
    secret: &str,
    source: IpAddr,
    device: Option<Token>,
) -> Result<Verified, LoginFailure> {
    // The user sees that it is a PIN: this says nothing of anybody's secret.
    if is_pin(secret) && app.caller(source) == Caller::Elsewhere {
        return Err(LoginFailure::PinElsewhere);
    }
    let at = app.caller(source);
    // A known browser waits in no queue with strangers.
    let caller = if device.is_some() { Caller::Vehicle } else { at };
    // Their hashes are made one after the other anyway. A login that is tried beside others must not wait for
    // failures that these may turn out not to be.
    let _turn = match caller {
        Caller::Vehicle => {
            let turn = app.clock.by(app.clock.now() + PROVEN_WITHIN, app.proofs.proving.lock()).await;
            Some(turn.ok_or(LoginFailure::Unavailable)?)
        }
        Caller::Elsewhere => None,
    };
    let from = Source { ip: source, caller: at, device };
    let throttle = || app.proofs.throttle.lock().unwrap_or_else(PoisonError::into_inner);
    if let Err(wait) = throttle().attempt(app.clock.now(), name, &from) {
        return Err(LoginFailure::Wait { seconds: whole_seconds(wait) });
    }
    match app.store.authenticate_from(caller, name, secret).await {
        Ok(Some(user)) if Role::OF_VEHICLE.contains(&user.role()) => {
            throttle().succeeded(name, &from);
            Ok(user)
        }
        // A user of a fleet's console has nothing to do here.
        Ok(_) => {
            tracing::warn!(%source, "login failed");
            Err(LoginFailure::Wrong)
        }
        Err(error) => {
            tracing::error!(%error, "a login cannot be checked");
            Err(LoginFailure::Unavailable)
        }
    }
}

fn welcome(app: &AppState, reader: &Reader, token: &Token, session: &Session) -> Response {
    let mut answer = match reader.speaks {
        Speaks::Json => Json(LoggedIn { name: &session.user, role: session.role.as_str() }).into_response(),
        // The operator's screen of a locked vehicle is the login, where others would begin anew.
        Speaks::Html if session.role != Role::Operator && app.published().snapshot.stage == Stage::Locked => {
            Redirect::to("/developer").into_response()
        }
        Speaks::Html => Redirect::to("/").into_response(),
    };
    set_cookie(&mut answer, app.settings.secure, cookie_name, token.as_str(), COOKIE_LIFE);
    answer
}

/// `secure` as in [`cookie_name`].
pub fn set_cookie(
    answer: &mut Response,
    secure: bool,
    name: fn(bool) -> &'static str,
    value: &str,
    life: Duration,
) {
    append_cookie(answer, secure, name(secure), value, life, "Strict");
}

/// The same for a cookie that also comes when a page elsewhere leads here.
pub fn set_lax_cookie(
    answer: &mut Response,
    secure: bool,
    name: fn(bool) -> &'static str,
    value: &str,
    life: Duration,
) {
    append_cookie(answer, secure, name(secure), value, life, "Lax");
}

fn append_cookie(answer: &mut Response, secure: bool, name: &str, value: &str, life: Duration, site: &str) {
    let (age_s, suffix) = (life.as_secs(), if secure { "; Secure" } else { "" });
    let cookie = format!("{name}={value}; Path=/; Max-Age={age_s}; HttpOnly; SameSite={site}{suffix}");
    let cookie = HeaderValue::try_from(cookie).expect("names and hexadecimal digits are visible ASCII");
    answer.headers_mut().append(SET_COOKIE, cookie);
}

/// A login that does not work, for its answer.
struct Failing<'a> {
    app: &'a AppState,
    reader: &'a Reader,
    /// The name that was given.
    name: &'a str,
    source: IpAddr,
    /// The operator at this display, from whom another one takes over.
    from: Option<String>,
}

impl Failing<'_> {
    async fn failed(&self, failure: LoginFailure) -> Response {
        let status = match failure {
            LoginFailure::Wrong | LoginFailure::TakeOverLate => StatusCode::UNAUTHORIZED,
            LoginFailure::PinElsewhere => StatusCode::FORBIDDEN,
            LoginFailure::OtherOperator { .. } | LoginFailure::Drives => StatusCode::CONFLICT,
            LoginFailure::Wait { .. } => StatusCode::TOO_MANY_REQUESTS,
            LoginFailure::Storage | LoginFailure::Unavailable | LoginFailure::NoUsers { .. } => {
                StatusCode::SERVICE_UNAVAILABLE
            }
        };
        let wait = if let LoginFailure::Wait { seconds } = failure { Some(seconds) } else { None };
        let mut answer = match (self.reader.speaks, &failure) {
            (Speaks::Json, LoginFailure::OtherOperator { by, .. }) => {
                let refused = format!("{by} is the operator; take_over=1 takes over");
                json_answer(status, &json!({ "refused": [refused], "operator": by }))
            }
            (Speaks::Json, LoginFailure::Drives) => {
                json_answer(status, &json!({ "refused": [failure.as_str()] }))
            }
            (Speaks::Json, LoginFailure::Wait { seconds }) => {
                json_answer(status, &json!({ "error": failure.as_str(), "seconds": seconds }))
            }
            (Speaks::Json, _) => json_answer(status, &json!({ "error": failure.as_str() })),
            (Speaks::Html, _) => {
                let Failing { app, reader, name, source, ref from } = *self;
                let shown = LoginContext {
                    name: name.chars().take(NAME_SHOWN_CHARS_MAX).collect(),
                    failure: Some(failure),
                    names: names(app, source, from.as_deref()).await,
                    from: from.clone(),
                    ..login_context(app, reader)
                };
                (status, Html(view::login_page(&shown))).into_response()
            }
        };
        if let Some(seconds) = wait {
            answer.headers_mut().insert(RETRY_AFTER, HeaderValue::from(seconds));
        }
        answer
    }
}

/// A longer name is not a user's; it is shown cut.
const NAME_SHOWN_CHARS_MAX: usize = 64;

fn whole_seconds(span: Span) -> u64 {
    span.as_millis().div_ceil(1000).max(1)
}
