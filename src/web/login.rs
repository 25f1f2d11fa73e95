//! Login and logout.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::PoisonError;
use std::time::Duration;

use axum::extract::rejection::FormRejection;
use axum::extract::{Extension, Form, State};
use axum::http::header::{RETRY_AFTER, SET_COOKIE};
use axum::http::{HeaderMap, HeaderValue, StatusCode};
use axum::response::{Html, IntoResponse, Redirect, Response};
use serde::Deserialize;
use serde_json::json;

use super::answer::{Reader, Speaks, json_answer, refusal, refused};
use super::audit::record_of;
use super::farewell::{self, Farewell};
use super::guard::{SignedIn, cookie_name, cookie_session};
use super::state::{AppState, NoAnswer, is_seated};
use super::throttle::Source;
use super::view::{self, LoginContext, LoginFailure};
use super::wording::Trouble;
use crate::engine::input::{OperatorAction, Refusal, Response as Answer};
use crate::engine::model::Stage;
use crate::engine::time::Span;
use crate::store::audit::{Action, Record};
use crate::store::{
    Entering, Lane, Role, SESSION_LIFE, Session, SessionKind, StoreError, Token, Verified, Written, is_pin,
};

/// The server judges when a session is over, and whoever drives keeps it: a browser must not forget it
/// before.
const COOKIE_LIFE: Duration = SESSION_LIFE.saturating_mul(2);

/// The other end of a connection.
#[derive(Debug, Clone, Copy)]
pub struct Peer(pub SocketAddr);

/// The address of the other end; a router without a socket is asked from this machine.
pub fn source_of(peer: Option<Peer>) -> IpAddr {
    peer.map_or(IpAddr::V4(Ipv4Addr::LOCALHOST), |Peer(peer)| peer.ip().to_canonical())
}

#[derive(Deserialize)]
pub struct LoginForm {
    name: String,
    secret: String,
    /// Given by an operator who was told that somebody else sits in the seat, and takes it over.
    take_over: Option<String>,
}

/// `GET /login`
pub async fn page(State(app): State<AppState>, headers: HeaderMap, reader: Reader) -> Response {
    // While the vehicle is locked an operator may follow somebody else at the same display.
    let locked = app.published().snapshot.stage == Stage::Locked;
    if !locked && cookie_session(&app, &headers).is_some() {
        return Redirect::to("/").into_response();
    }
    let nobody = match app.store.has_users().await {
        Ok(false) => Some(no_users(&app)),
        Err(error) if error.is_of_storage() => Some(LoginFailure::Storage),
        _ => None,
    };
    let farewell = farewell::of(&app, &headers).await;
    login_page(&app, &reader, StatusCode::OK, "", nobody, farewell)
}

/// A folder with a blank in its name is quoted, as a shell has to be told it.
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
    let source = source_of(peer.map(|Extension(peer)| peer));
    let user = match prove(&app, &form, source).await {
        Ok(user) => user,
        Err(failure) => {
            if app.may_record_refusal(source, Action::Login).await {
                let record = Record::of(Action::Login, source.to_string());
                let record = record.on(app.recorded_name(&form.name).await);
                app.audit_or_log_from(app.lane(source), record.refused(failure.as_str())).await;
            }
            return failed(&app, &reader, &form.name, failure);
        }
    };
    let entrance = Entrance {
        user,
        source,
        takes_over: form.take_over.is_some(),
        before: cookie_session(&app, &headers),
    };
    match whole(entrance.open(app.clone())).await {
        Ok((token, session)) => welcome(&app, &reader, &token, &session),
        Err(NotOpened::Refused(reasons)) => refused(&reader, &reasons),
        Err(NotOpened::SeatTaken(by)) => failed(&app, &reader, &form.name, LoginFailure::SeatTaken { by }),
        Err(NotOpened::Storage) => failed(&app, &reader, &form.name, LoginFailure::Storage),
        Err(NotOpened::Unavailable) => failed(&app, &reader, &form.name, LoginFailure::Unavailable),
    }
}

/// `POST /logout`
pub async fn logout(
    State(app): State<AppState>,
    peer: Option<Extension<Peer>>,
    SignedIn(session): SignedIn,
    reader: Reader,
) -> Response {
    leave(app, peer, session, &reader, OperatorAction::Logout).await
}

/// `POST /vehicle/shutdown`: the operator ends the work with the vehicle, and leaves it.
pub async fn shutdown(
    State(app): State<AppState>,
    peer: Option<Extension<Peer>>,
    SignedIn(session): SignedIn,
    reader: Reader,
) -> Response {
    leave(app, peer, session, &reader, OperatorAction::Shutdown).await
}

async fn leave(
    app: AppState,
    peer: Option<Extension<Peer>>,
    session: Session,
    reader: &Reader,
    action: OperatorAction,
) -> Response {
    // A program's token is taken back on the command line.
    if session.kind == SessionKind::Program {
        return refusal(&Reader { speaks: Speaks::Json, ..*reader }, Trouble::Forbidden);
    }
    let source = source_of(peer.map(|Extension(peer)| peer));
    match whole(close(app.clone(), session.clone(), source, action)).await {
        Ok(()) => {}
        Err(NotOpened::Refused(reasons)) => return refused(reader, &reasons),
        Err(NotOpened::Storage) => return refusal(reader, Trouble::Storage),
        Err(NotOpened::SeatTaken(_) | NotOpened::Unavailable) => {
            return refusal(reader, Trouble::Unavailable);
        }
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
    // Whoever types it sees that it is a PIN: this says nothing of anybody's secret.
    if is_pin(&form.secret) && !app.settings.enrolled.is_near(source) {
        return Err(LoginFailure::PinElsewhere);
    }
    let lane = app.lane(source);
    let from = Source { ip: source, is_near: lane == Lane::Vehicle };
    let throttle = || app.throttle.lock().unwrap_or_else(PoisonError::into_inner);
    if let Err(wait) = throttle().attempt(app.clock.now(), &form.name, from) {
        return Err(LoginFailure::Wait { seconds: whole_seconds(wait) });
    }
    match app.store.authenticate_from(lane, &form.name, &form.secret).await {
        Ok(Some(user)) => {
            throttle().succeeded(&form.name, from);
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
    /// This operator sits in the seat.
    SeatTaken(String),
    Refused(Vec<Refusal>),
    /// It cannot be written down.
    Storage,
    Unavailable,
}

impl From<StoreError> for NotOpened {
    fn from(error: StoreError) -> NotOpened {
        tracing::error!(%error, "sessions cannot be changed");
        if error.is_of_storage() { NotOpened::Storage } else { NotOpened::Unavailable }
    }
}

impl From<NoAnswer> for NotOpened {
    fn from(error: NoAnswer) -> NotOpened {
        tracing::error!(%error, "nobody can log in or out");
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

/// Somebody who proved to be a user and asks for a session.
struct Entrance {
    user: Verified,
    source: IpAddr,
    /// From the operator who sits in the seat.
    takes_over: bool,
    /// The session that the browser had: nobody may go on with it.
    before: Option<Session>,
}

impl Entrance {
    /// Opens a session; an operator takes the seat, and the vehicle is unlocked by that.
    async fn open(self, app: AppState) -> Result<(Token, Session), NotOpened> {
        let _seat = app.seat.lock().await;
        let (name, role) = (self.user.name(), self.user.role());
        let seated = app.published().snapshot.operator.clone();
        let other = seated.filter(|seated| role == Role::Operator && **seated != *name);
        if let Some(other) = other.as_deref().filter(|_| !self.takes_over) {
            let why = format!("{other} is the operator");
            app.audit(self.record(Action::Login).refused(why)).await?;
            return Err(NotOpened::SeatTaken(other.to_owned()));
        }
        if let Some(reason) = self.is_refused_logout(&app) {
            app.audit(self.record(Action::Login).refused(format!("{:?}", [&reason]))).await?;
            return Err(NotOpened::Refused(vec![reason]));
        }
        let is_before = |session: &Session| self.before.as_ref().is_some_and(|before| before.is(session));
        let others = || {
            let sessions = app.store.sessions();
            sessions.iter().filter(|session| *session.user == *name && !is_before(session)).count()
        };
        let had = others();
        let (token, written) = match role {
            Role::Operator => self.take_seat(&app, other.as_deref()).await?,
            _ => {
                let entering =
                    Entering { user: &self.user, before: self.before.as_ref(), seat: None, from: None };
                let records = self.ends().chain([self.record(Action::Login)]).collect();
                app.store.enter(entering, records).await?
            }
        };
        // It has happened: from here on nothing can fail.
        let session = app.store.entered(written)?;
        if let ended @ 1.. = (had + 1).saturating_sub(others()) {
            let record = self.record(Action::SessionEnded);
            app.audit_or_log(record.on(format!("{ended} of too many, the oldest"))).await;
        }
        app.farewells.meet(&session);
        tracing::info!(user = name, role = role.as_str(), source = %self.source, "logged in");
        Ok((token, session))
    }

    /// Whether the session of a driving vehicle's operator would end. It does for the operator, and
    /// for whoever takes the seat over: for others this is a logout.
    fn is_refused_logout(&self, app: &AppState) -> Option<Refusal> {
        let snapshot = app.published().snapshot;
        let leaves = self.before.as_ref().is_some_and(|before| is_seated(before, &snapshot));
        let is_refused = leaves && self.user.role() != Role::Operator && snapshot.stage == Stage::Active;
        is_refused.then_some(Refusal::LogoutWhileActive)
    }

    /// That the session ends which the browser had.
    fn ends(&self) -> impl Iterator<Item = Record> {
        let record = |before| record_of(before, Action::SessionEnded, self.source);
        let target = format!("login of {}", self.user.name());
        self.before.as_ref().map(record).map(|record| record.on(target)).into_iter()
    }

    /// Written first: while nothing can be written, whoever has the vehicle keeps it.
    async fn take_seat(&self, app: &AppState, other: Option<&str>) -> Result<(Token, Written), NotOpened> {
        let _owed = app.acting.lock().await;
        let action = OperatorAction::Login { name: self.user.name().into() };
        let foreseen = match app.rehearse(action.clone()).await? {
            Ok(foreseen) => foreseen,
            Err(reasons) => {
                app.audit(self.record(Action::Login).refused(format!("{reasons:?}"))).await?;
                return Err(NotOpened::Refused(reasons));
            }
        };
        let hand_over = other.map(|other| self.record(Action::HandOver).on(format!("from {other}")));
        let records = self.ends().chain(hand_over).chain([self.record(Action::Login)]).collect();
        let seat = Some(app.remembering(foreseen));
        let entering = Entering { user: &self.user, before: self.before.as_ref(), seat, from: other };
        let (token, written) = app.store.enter(entering, records).await?;
        let (why, not_opened) = match app.command(action).await {
            Ok(Answer::Done) => {
                if let Some(other) = other {
                    app.farewells.end_all_of(other, Farewell::TakenOver);
                }
                return Ok((token, written));
            }
            Ok(Answer::Refused(reasons)) => (format!("{reasons:?}"), NotOpened::Refused(reasons)),
            Err(error) => (error.to_string(), error.into()),
        };
        app.store.take_back(written, app.memory(), self.record(Action::Login).refused(why)).await?;
        Err(not_opened)
    }

    fn record(&self, action: Action) -> Record {
        Record::of(action, self.source.to_string())
            .by(self.user.name(), self.user.role())
            .on(self.user.name())
    }
}

/// Ends a session. The operator in the seat leaves it, at all displays, if the vehicle permits.
async fn close(
    app: AppState,
    session: Session,
    source: IpAddr,
    action: OperatorAction,
) -> Result<(), NotOpened> {
    let _seat = app.seat.lock().await;
    let record = record_of(&session, Action::Logout, source);
    if !is_seated(&session, &app.published().snapshot) {
        return Ok(app.store.end_session(&session, record).await?);
    }
    let _owed = app.acting.lock().await;
    if let Err(reasons) = app.rehearse(action.clone()).await? {
        app.audit(record.refused(format!("{reasons:?}"))).await?;
        return Err(NotOpened::Refused(reasons));
    }
    // Written first: while nothing can be written, the operator keeps the vehicle and the session.
    let leaving = app.store.leave(&session.user, record.clone()).await?;
    app.farewells.log_out(&session);
    let (why, not_closed) = match app.command(action).await {
        Ok(Answer::Done) => {
            app.store.left(leaving);
            // That the vehicle is locked follows from the empty seat, after a restart too.
            if let Err(error) = app.store.remember(app.memory(), Vec::new()).await {
                tracing::error!(%error, "the vehicle cannot be remembered");
            }
            return Ok(());
        }
        Ok(Answer::Refused(reasons)) => (format!("{reasons:?}"), NotOpened::Refused(reasons)),
        Err(error) => (error.to_string(), error.into()),
    };
    app.farewells.stay(&session.user);
    app.store.take_back(leaving, app.memory(), record.refused(why)).await?;
    Err(not_closed)
}

fn welcome(app: &AppState, reader: &Reader, token: &Token, session: &Session) -> Response {
    let mut answer = match reader.speaks {
        Speaks::Json => {
            json_answer(StatusCode::OK, &json!({ "name": &*session.user, "role": session.role.as_str() }))
        }
        // The operator's screen of a locked vehicle is the login, where others would begin anew.
        Speaks::Html if session.role != Role::Operator && app.published().snapshot.stage == Stage::Locked => {
            Redirect::to("/developer").into_response()
        }
        Speaks::Html => Redirect::to("/").into_response(),
    };
    set_cookie(&mut answer, app, token.as_str(), COOKIE_LIFE.as_secs());
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
    let status = match failure {
        LoginFailure::Wrong => StatusCode::UNAUTHORIZED,
        LoginFailure::PinElsewhere => StatusCode::FORBIDDEN,
        LoginFailure::SeatTaken { .. } => StatusCode::CONFLICT,
        LoginFailure::Wait { .. } => StatusCode::TOO_MANY_REQUESTS,
        LoginFailure::Storage | LoginFailure::Unavailable | LoginFailure::NoUsers { .. } => {
            StatusCode::SERVICE_UNAVAILABLE
        }
    };
    let wait = if let LoginFailure::Wait { seconds } = failure { Some(seconds) } else { None };
    let mut answer = match (reader.speaks, &failure) {
        (Speaks::Json, LoginFailure::SeatTaken { by }) => {
            let refused = format!("{by} is the operator; take_over=1 takes the seat over");
            json_answer(status, &json!({ "refused": [refused], "operator": by }))
        }
        (Speaks::Json, LoginFailure::Wait { seconds }) => {
            json_answer(status, &json!({ "error": failure.as_str(), "seconds": seconds }))
        }
        (Speaks::Json, _) => json_answer(status, &json!({ "error": failure.as_str() })),
        (Speaks::Html, _) => login_page(app, reader, status, name, Some(failure), None),
    };
    if let Some(seconds) = wait {
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
    farewell: Option<Farewell>,
) -> Response {
    let context = LoginContext {
        lang: reader.lang,
        palette: reader.palette,
        name: name.chars().take(NAME_SHOWN_CHARS_MAX).collect(),
        failure,
        farewell,
        demo: app.settings.demo.is_some(),
    };
    (status, Html(view::login_page(&context))).into_response()
}

/// A typed name that is longer is none, and is not shown whole.
const NAME_SHOWN_CHARS_MAX: usize = 64;

fn whole_seconds(span: Span) -> u64 {
    span.as_millis().div_ceil(1000).max(1)
}
