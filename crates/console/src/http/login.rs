//! Login and logout at the console.

use std::net::IpAddr;
use std::sync::PoisonError;
use std::time::Duration;

use askama::Template;
use axum::extract::State;
use axum::http::header::RETRY_AFTER;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{Html, IntoResponse, Redirect, Response};
use serde::Deserialize;
use serde_json::json;
use telltale_engine::time::Span;
use telltale_store::audit::{Action, Record};
use telltale_store::{Caller, Role, SESSION_LIFE, SessionKind, Token, Verified};
use telltale_web::common::{
    CameFrom, FormOf, PageFrame, Reader, SignedIn, Source, Speaks, json_answer, known_device, make_known,
    refusal, set_cookie,
};
use telltale_web::cookie_name;
use telltale_web::texts::console::ConsoleWords;
use telltale_web::texts::{HttpError, NAME, clean};

use super::Console;

#[derive(Deserialize)]
pub struct LoginForm {
    name: String,
    secret: String,
}

/// Why a login did not work.
enum Failure {
    Wrong,
    Wait(Span),
    /// The user is one of a vehicle.
    Role,
    Unavailable,
}

impl Failure {
    const fn as_str(&self) -> &'static str {
        match self {
            Failure::Wrong => "the name or the password is wrong",
            Failure::Wait(_) => "too many failures; wait",
            Failure::Role => {
                "users with this role log in at a vehicle; a console has control_room, engineer and authority"
            }
            Failure::Unavailable => "logins cannot be checked now; try again",
        }
    }

    const fn status(&self) -> StatusCode {
        match self {
            Failure::Wrong => StatusCode::UNAUTHORIZED,
            Failure::Wait(_) => StatusCode::TOO_MANY_REQUESTS,
            Failure::Role => StatusCode::FORBIDDEN,
            Failure::Unavailable => StatusCode::SERVICE_UNAVAILABLE,
        }
    }
}

#[derive(Template)]
#[template(path = "console/login.html")]
struct LoginHtml {
    frame: PageFrame,
    words: &'static ConsoleWords,
    name: String,
    failure: Option<String>,
    /// The words of the button that leads to the issuer.
    issuer: Option<String>,
}

/// `GET /login`
pub async fn page(
    State(console): State<Console>,
    signed_in: Result<SignedIn, HttpError>,
    reader: Reader,
) -> Response {
    if signed_in.is_ok() {
        return Redirect::to("/").into_response();
    }
    let words = ConsoleWords::of(reader.lang);
    let nobody = console.oidc.is_none() && matches!(console.store.has_users().await, Ok(false));
    let failure = nobody.then(|| words.no_users.to_owned());
    html(&console, &reader, "", failure, StatusCode::OK)
}

fn html(
    console: &Console,
    reader: &Reader,
    name: &str,
    failure: Option<String>,
    status: StatusCode,
) -> Response {
    let frame = PageFrame::new(reader.lang, reader.palette);
    let words = ConsoleWords::of(reader.lang);
    let issuer = console.oidc.as_ref().map(|oidc| reader.lang.log_in_with(oidc.host()));
    let page = LoginHtml { frame, words, name: clean(name, NAME), failure, issuer };
    match page.render() {
        Ok(page) => (status, Html(page)).into_response(),
        Err(_) => HttpError::Unavailable.into_response(),
    }
}

/// `POST /login`
pub async fn login(
    State(console): State<Console>,
    CameFrom(source): CameFrom,
    reader: Reader,
    headers: HeaderMap,
    FormOf(form): FormOf<LoginForm>,
) -> Response {
    let device = known_device(&console.store, console.secure, Caller::Elsewhere, &headers, &form.name).await;
    let failure = match prove(&console, &form, source, device.clone()).await {
        Ok(user) => match console.store.open_session(&user).await {
            Ok((token, _)) => {
                let record = Record::of(Action::Login, source.to_string()).by(user.name(), user.role());
                console.store.record(record, None).await;
                let mut answer = match reader.speaks {
                    Speaks::Json => json_answer(
                        StatusCode::OK,
                        &json!({ "name": user.name(), "role": user.role().as_str() }),
                    ),
                    Speaks::Html => Redirect::to("/").into_response(),
                };
                set_cookie(&mut answer, console.secure, cookie_name, token.as_str(), SESSION_LIFE);
                if device.is_none() {
                    make_known(&console.store, console.secure, &user, &mut answer).await;
                }
                return answer;
            }
            Err(error) => {
                tracing::error!(%error, "a session cannot be opened");
                Failure::Unavailable
            }
        },
        Err(failure) => failure,
    };
    // A name of no user may be a password that was typed into the wrong field.
    let known = console.store.knows_user(&form.name).await.unwrap_or(false);
    let name = if known { form.name.as_str() } else { "(unknown name)" };
    let record = Record::of(Action::Login, source.to_string()).on(name).refused(failure.as_str());
    console.store.record(record.by_anybody(Caller::Elsewhere), None).await;
    failed(&console, &reader, &form.name, &failure)
}

fn failed(console: &Console, reader: &Reader, name: &str, failure: &Failure) -> Response {
    let words = ConsoleWords::of(reader.lang);
    let text = match failure {
        Failure::Wrong => words.login_wrong,
        Failure::Wait(_) => words.login_wait,
        Failure::Role => words.login_role,
        Failure::Unavailable => words.login_unavailable,
    };
    let mut answer = refused(console, reader, name, text, failure.as_str(), failure.status());
    if let Failure::Wait(wait) = failure {
        answer.headers_mut().insert(RETRY_AFTER, wait.as_millis().div_ceil(1000).into());
    }
    answer
}

/// The page of the login with why it did not work, or the reason for programs.
pub fn refused(
    console: &Console,
    reader: &Reader,
    name: &str,
    text: &str,
    why: &str,
    status: StatusCode,
) -> Response {
    match reader.speaks {
        Speaks::Json => json_answer(status, &json!({ "error": why })),
        Speaks::Html => html(console, reader, name, Some(text.to_owned()), status),
    }
}

/// The user whose password this is, within the bounds on attempts. A known browser waits in no queue with strangers.
async fn prove(
    console: &Console,
    form: &LoginForm,
    ip: IpAddr,
    device: Option<Token>,
) -> Result<Verified, Failure> {
    let caller = if device.is_some() { Caller::Vehicle } else { Caller::Elsewhere };
    let from = Source { ip, caller: Caller::Elsewhere, device };
    let throttle = || console.throttle.lock().unwrap_or_else(PoisonError::into_inner);
    throttle().attempt(console.clock.now(), &form.name, &from).map_err(Failure::Wait)?;
    match console.store.authenticate_from(caller, &form.name, &form.secret).await {
        Ok(Some(user)) => {
            throttle().succeeded(&form.name, &from);
            if Role::OF_CONSOLE.contains(&user.role()) { Ok(user) } else { Err(Failure::Role) }
        }
        Ok(None) => {
            tracing::warn!(source = %ip, "login failed");
            Err(Failure::Wrong)
        }
        Err(error) => {
            tracing::error!(%error, "a login cannot be checked");
            Err(Failure::Unavailable)
        }
    }
}

/// `POST /logout`
pub async fn logout(
    State(console): State<Console>,
    CameFrom(source): CameFrom,
    SignedIn(session): SignedIn,
    reader: Reader,
) -> Response {
    // A program's token is taken back on the command line.
    if session.kind == SessionKind::Program {
        return refusal(&Reader { speaks: Speaks::Json, ..reader }, HttpError::Forbidden);
    }
    console.store.end_at_once(&session, Record::of_session(&session, Action::Logout, source));
    let mut answer = match reader.speaks {
        Speaks::Json => json_answer(StatusCode::OK, &json!({})),
        Speaks::Html => Redirect::to("/login").into_response(),
    };
    set_cookie(&mut answer, console.secure, cookie_name, "", Duration::ZERO);
    answer
}
