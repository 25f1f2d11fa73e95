//! Login and logout.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::PoisonError;

use axum::extract::rejection::FormRejection;
use axum::extract::{Extension, Form, State};
use axum::http::header::{RETRY_AFTER, SET_COOKIE};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{Html, IntoResponse, Redirect, Response};
use serde::Deserialize;
use serde_json::json;

use super::answer::{Reader, Speaks, json_answer, refusal, refused};
use super::guard::{SignedIn, cookie_name, cookie_session};
use super::state::{AppState, is_seated};
use super::view::{self, LoginContext, LoginFailure};
use super::wording::Trouble;
use crate::engine::input::{OperatorAction, Response as Answer};
use crate::engine::model::Stage;
use crate::engine::time::Span;
use crate::store::{Role, SESSION_LIFE, Session, StoreError, Token, Verified};

/// The other end of a connection.
#[derive(Debug, Clone, Copy)]
pub struct Peer(pub SocketAddr);

#[derive(Deserialize)]
pub struct LoginForm {
    name: String,
    secret: String,
}

/// `GET /login`
pub async fn page(State(app): State<AppState>, headers: HeaderMap, reader: Reader) -> Response {
    // While the vehicle is locked an operator may follow somebody else at the same display.
    let locked = app.published().snapshot.stage == Stage::Locked;
    if !locked && cookie_session(&app, &headers).is_some() {
        return Redirect::to("/").into_response();
    }
    let nobody = matches!(app.store.users().await, Ok(users) if users.is_empty());
    login_page(&app, &reader, StatusCode::OK, "", nobody.then_some(LoginFailure::NoUsers))
}

/// `POST /login`
pub async fn login(
    State(app): State<AppState>,
    peer: Option<Extension<Peer>>,
    headers: HeaderMap,
    reader: Reader,
    form: Result<Form<LoginForm>, FormRejection>,
) -> Response {
    let form = match form {
        Ok(Form(form)) => form,
        Err(rejection) if rejection.status() == StatusCode::PAYLOAD_TOO_LARGE => {
            return rejection.into_response();
        }
        Err(_) => return refusal(&reader, Trouble::BadForm),
    };
    let source = peer.map_or(IpAddr::V4(Ipv4Addr::LOCALHOST), |Extension(Peer(peer))| peer.ip());
    let user = match prove(&app, &form, source).await {
        Ok(user) => user,
        Err(failure) => return failed(&app, &reader, &form.name, failure),
    };
    // The browser gets another session: nobody may go on with the one it had.
    if let Some(before) = cookie_session(&app, &headers)
        && let Err(error) = app.store.end_session(&before).await
    {
        tracing::error!(%error, "the session before this login stays open");
    }
    match whole(open(app.clone(), user)).await {
        Ok((token, session)) => welcome(&app, &reader, &token, &session),
        Err(NotOpened::Refused(reasons)) => refused(&reader, &reasons),
        Err(NotOpened::Unavailable) => failed(&app, &reader, &form.name, LoginFailure::Unavailable),
    }
}

/// `POST /logout`
pub async fn logout(State(app): State<AppState>, SignedIn(session): SignedIn, reader: Reader) -> Response {
    match whole(close(app.clone(), session.clone())).await {
        Ok(()) => {}
        Err(NotOpened::Refused(reasons)) => return refused(&reader, &reasons),
        Err(NotOpened::Unavailable) => return refusal(&reader, Trouble::Unavailable),
    }
    tracing::info!(user = &*session.user, "logged out");
    let mut answer = match reader.speaks {
        Speaks::Json => json_answer(StatusCode::OK, &json!({})),
        Speaks::Html => Redirect::to("/login").into_response(),
    };
    set_cookie(&mut answer, &app, "", 0);
    answer
}

async fn prove(app: &AppState, form: &LoginForm, source: IpAddr) -> Result<Verified, LoginFailure> {
    let throttle = || app.throttle.lock().unwrap_or_else(PoisonError::into_inner);
    if let Err(wait) = throttle().attempt(app.clock.now(), &form.name, source) {
        return Err(LoginFailure::Wait { seconds: whole_seconds(wait) });
    }
    match app.store.authenticate(&form.name, &form.secret).await {
        Ok(Some(user)) => {
            throttle().succeeded(&form.name, source);
            tracing::info!(user = user.name(), role = user.role().as_str(), %source, "logged in");
            Ok(user)
        }
        Ok(None) => {
            tracing::warn!(%source, "login failed");
            Err(LoginFailure::Wrong)
        }
        Err(error) => {
            tracing::error!(%error, "a login cannot be checked");
            Err(LoginFailure::Unavailable)
        }
    }
}

/// Why no session was opened or closed.
enum NotOpened {
    Refused(Vec<crate::engine::input::Refusal>),
    Unavailable,
}

impl From<StoreError> for NotOpened {
    fn from(error: StoreError) -> NotOpened {
        tracing::error!(%error, "sessions cannot be changed");
        NotOpened::Unavailable
    }
}

/// Runs to its end whoever still listens: a browser that goes on to another page drops its request,
/// and half a logout would leave a session open behind a locked vehicle.
async fn whole<T: Send + 'static>(
    change: impl Future<Output = Result<T, NotOpened>> + Send + 'static,
) -> Result<T, NotOpened> {
    // It ends early only if the whole program does.
    tokio::spawn(change).await.unwrap_or(Err(NotOpened::Unavailable))
}

/// Opens a session; an operator takes the seat, and the vehicle is unlocked by that.
async fn open(app: AppState, user: Verified) -> Result<(Token, Session), NotOpened> {
    let (token, session) = app.store.open_session(&user).await?;
    if user.role() != Role::Operator {
        return Ok((token, session));
    }
    let action = OperatorAction::Login { name: user.name().into() };
    let refused = match app.command(action).await {
        Ok(Answer::Done) => {
            app.store.take_seat(user.name()).await?;
            return Ok((token, session));
        }
        Ok(Answer::Refused(reasons)) => NotOpened::Refused(reasons),
        Err(error) => {
            tracing::error!(%error, "nobody can log in");
            NotOpened::Unavailable
        }
    };
    app.store.end_session(&session).await?;
    Err(refused)
}

/// Ends a session. The operator in the seat leaves it, at all displays, if the vehicle permits.
async fn close(app: AppState, session: Session) -> Result<(), NotOpened> {
    if !is_seated(&session, &app.published().snapshot) {
        return Ok(app.store.end_session(&session).await?);
    }
    match app.command(OperatorAction::Logout).await {
        Ok(Answer::Done) => {}
        Ok(Answer::Refused(reasons)) => return Err(NotOpened::Refused(reasons)),
        Err(error) => {
            tracing::error!(%error, "nobody can log out");
            return Err(NotOpened::Unavailable);
        }
    }
    app.store.leave_seat().await?;
    Ok(app.store.end_sessions_of(&session.user).await?)
}

fn welcome(app: &AppState, reader: &Reader, token: &Token, session: &Session) -> Response {
    let mut answer = match reader.speaks {
        Speaks::Json => {
            json_answer(StatusCode::OK, &json!({ "name": &*session.user, "role": session.role.as_str() }))
        }
        Speaks::Html => Redirect::to("/").into_response(),
    };
    set_cookie(&mut answer, app, token.as_str(), SESSION_LIFE.as_secs());
    answer
}

fn set_cookie(answer: &mut Response, app: &AppState, value: &str, age_s: u64) {
    let secure = app.settings.secure;
    let name = cookie_name(secure);
    let suffix = if secure { "; Secure" } else { "" };
    let cookie = format!("{name}={value}; Path=/; Max-Age={age_s}; HttpOnly; SameSite=Strict{suffix}");
    let cookie = HeaderValue::try_from(cookie).expect("names and hexadecimal digits are visible ASCII");
    answer.headers_mut().append(SET_COOKIE, cookie);
}

fn failed(app: &AppState, reader: &Reader, name: &str, failure: LoginFailure) -> Response {
    let (status, error) = match failure {
        LoginFailure::Wrong => (StatusCode::UNAUTHORIZED, "the name or the secret is wrong"),
        LoginFailure::Wait { .. } => (StatusCode::TOO_MANY_REQUESTS, "too many failures; wait"),
        LoginFailure::Unavailable | LoginFailure::NoUsers => {
            (StatusCode::SERVICE_UNAVAILABLE, "logins cannot be checked now; try again")
        }
    };
    let mut answer = match reader.speaks {
        Speaks::Json => json_answer(status, &json!({ "error": error })),
        Speaks::Html => login_page(app, reader, status, name, Some(failure)),
    };
    if let LoginFailure::Wait { seconds } = failure {
        answer.headers_mut().insert(RETRY_AFTER, HeaderValue::from(seconds));
    }
    answer
}

fn login_page(
    app: &AppState,
    reader: &Reader,
    status: StatusCode,
    name: &str,
    failure: Option<LoginFailure>,
) -> Response {
    let context = LoginContext {
        lang: reader.lang,
        palette: reader.palette,
        name: name.chars().take(NAME_SHOWN_CHARS_MAX).collect(),
        failure,
        demo: app.settings.demo.is_some(),
    };
    (status, Html(view::login_page(&context))).into_response()
}

/// A typed name that is longer is none, and is not shown whole.
const NAME_SHOWN_CHARS_MAX: usize = 64;

fn whole_seconds(span: Span) -> u64 {
    span.as_millis().div_ceil(1000).max(1)
}
