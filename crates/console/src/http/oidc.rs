//! The login at an OpenID Connect issuer: the browser goes there, and comes back with a code.

use std::net::IpAddr;
use std::time::Duration;

use askama::Template;
use axum::extract::rejection::QueryRejection;
use axum::extract::{Query, State};
use axum::http::header::HOST;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Redirect, Response};
use telltale_store::audit::{Action, Record};
use telltale_store::{Caller, SESSION_LIFE, Token};
use telltale_web::common::{
    CameFrom, PageFrame, Reader, SignedIn, cookie, network, set_cookie, set_lax_cookie,
};
use telltale_web::cookie_name;
use telltale_web::texts::HttpError;
use telltale_web::texts::console::ConsoleWords;

use super::Console;
use super::login;
use super::page::rendered;
use crate::oidc::{Brought, Failure, Oidc, Person, WAITS_FOR};

/// The cookie of a browser that began a login.
const fn oidc_cookie_name(secure: bool) -> &'static str {
    if secure { "__Host-telltale-oidc" } else { "telltale-oidc" }
}

/// A browser sends the cookie of its session only where a page of the console leads on, so this page does.
#[derive(Template)]
#[template(path = "console/logged_in.html")]
struct LoggedInHtml {
    frame: PageFrame,
    words: &'static ConsoleWords,
}

/// `GET /login/oidc`: sends the browser to the issuer.
pub async fn begin(
    State(console): State<Console>,
    CameFrom(source): CameFrom,
    signed_in: Result<SignedIn, HttpError>,
    reader: Reader,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let oidc = console.oidc.as_ref().ok_or(HttpError::NotFound)?;
    if signed_in.is_ok() {
        return Ok(Redirect::to("/").into_response());
    }
    let host = headers.get(HOST).and_then(|host| host.to_str().ok());
    let origin = host.and_then(|host| console.origins.of_host(host)).ok_or(HttpError::ForeignHost)?;
    match oidc.begin(origin, network(source)).await {
        Ok((address, browser)) => {
            let mut answer = Redirect::to(&address).into_response();
            set_lax_cookie(&mut answer, console.secure, oidc_cookie_name, browser.as_str(), WAITS_FOR.into());
            Ok(answer)
        }
        Err(failure) => Ok(failed(&console, oidc, &reader, source, &failure).await),
    }
}

/// `GET /login/oidc/back`: the browser comes from the issuer.
pub async fn back(
    State(console): State<Console>,
    CameFrom(source): CameFrom,
    reader: Reader,
    headers: HeaderMap,
    brought: Result<Query<Brought>, QueryRejection>,
) -> Result<Response, HttpError> {
    let oidc = console.oidc.as_ref().ok_or(HttpError::NotFound)?;
    let browser = cookie(&headers, oidc_cookie_name(console.secure)).and_then(Token::parse);
    let Query(brought) = brought.unwrap_or_default();
    let mut answer = match oidc.finish(brought, browser.as_ref()).await {
        Ok(person) => logged_in(&console, &reader, source, person).await?,
        Err(failure) => failed(&console, oidc, &reader, source, &failure).await,
    };
    set_lax_cookie(&mut answer, console.secure, oidc_cookie_name, "", Duration::ZERO);
    Ok(answer)
}

async fn logged_in(
    console: &Console,
    reader: &Reader,
    source: IpAddr,
    person: Person,
) -> Result<Response, HttpError> {
    let Person { name, subject, grants } = person;
    let target = format!("sub {subject}: {grants}");
    let (token, session) = console.store.open_guest(&name, grants)?;
    let record = Record::of_session(&session, Action::Login, source).on(target);
    console.store.record(record, None).await;
    let (frame, words) = (PageFrame::new(reader.lang, reader.palette), ConsoleWords::of(reader.lang));
    let mut answer = rendered(&LoggedInHtml { frame, words });
    set_cookie(&mut answer, console.secure, cookie_name, token.as_str(), SESSION_LIFE);
    Ok(answer)
}

async fn failed(
    console: &Console,
    oidc: &Oidc,
    reader: &Reader,
    source: IpAddr,
    failure: &Failure,
) -> Response {
    let (lang, words) = (reader.lang, ConsoleWords::of(reader.lang));
    let (status, text) = match failure {
        Failure::Away(_) => (StatusCode::SERVICE_UNAVAILABLE, words.issuer_away.to_owned()),
        Failure::Stale => (StatusCode::BAD_REQUEST, words.login_stale.to_owned()),
        Failure::Refused(_) => (StatusCode::FORBIDDEN, lang.issuer_refused(oidc.host())),
        Failure::Unbelieved(_) => (StatusCode::FORBIDDEN, words.issuer_unbelieved.to_owned()),
        Failure::NoRole(name) => (StatusCode::FORBIDDEN, lang.no_role_here(name)),
    };
    let (who, why) = (if let Failure::NoRole(name) = failure { name } else { "" }, failure.why());
    tracing::warn!(%source, "login failed: {why}");
    let record = Record::of(Action::Login, source.to_canonical().to_string()).on(who).refused(why.as_str());
    console.store.record(record.by_anybody(Caller::Elsewhere), None).await;
    login::refused(console, reader, "", &text, &why, status)
}
