//! One tap of an operator: who made it, the state it was shown with, whether it counts, and its result.

use std::net::IpAddr;

use axum::extract::FromRequestParts;
use axum::http::StatusCode;
use axum::http::request::Parts;
use axum::response::{IntoResponse, Redirect, Response};
use serde::Deserialize;
use serde_json::{Value, json};

use super::not_done::{InvalidTap, NotActed, NotDone};
use crate::clock::wall_at;
use crate::engine::input::OperatorAction;
use crate::engine::model::output::Output;
use crate::engine::time::{Span, Timestamp};
use crate::store::Session;
use crate::store::audit::{Action, Record};
use crate::web::AppState;
use crate::web::admission::peer::{Peer, source_of};
use crate::web::auth::expiry::is_in_charge;
use crate::web::http::errors::HttpError;
use crate::web::http::guard::SignedIn;
use crate::web::http::respond::{Reader, Speaks, bad_field, json_answer, refusal, refused_in_words};
use crate::web::record::audit::record_of;
use crate::web::view;
use crate::web::view::versions::Aspect;
use crate::web::view::{Lang, Palette, Part};

/// Longer names of taps are no page's.
const TAP_BYTES_MAX: usize = 64;

/// Twice the time after which a page without heartbeats covers itself.
const TAP_LATE_MAX: Span = Span::from_secs(4);

/// The `seq` that the button was shown with.
#[derive(Debug, Deserialize)]
pub struct Versioned {
    pub version: u64,
    /// The wall time of the server's last heartbeat before the tap, as the heartbeat said it.
    pub beat: Option<String>,
}

/// A stop, over HTTP or over the socket of the page.
#[derive(Debug, Deserialize)]
pub struct StopForm {
    pub version: u64,
    pub beat: Option<String>,
    /// The tap's own name: what comes with the same one again is the same tap.
    pub tap: Option<Box<str>>,
}

/// Somebody touched a button.
#[derive(Debug, Clone)]
pub struct Tap {
    pub app: AppState,
    pub session: Session,
    source: IpAddr,
    pub reader: Reader,
    arrived: Timestamp,
}

/// What makes a tap count. It is looked at anew whenever the tap has waited.
#[derive(Debug, Clone, Copy)]
pub struct Validity {
    pub aspect: Aspect,
    /// The `seq` that it was shown with.
    pub version: u64,
    /// After this it is late.
    pub until: Timestamp,
    /// Of a second step: after this the first one counts no more.
    pub confirmed_until: Timestamp,
    /// It is a stop, which counts from the next operator too.
    pub is_stop: bool,
}

impl FromRequestParts<AppState> for Tap {
    type Rejection = Response;

    async fn from_request_parts(parts: &mut Parts, app: &AppState) -> Result<Tap, Response> {
        let arrived = app.clock.now();
        let SignedIn(session) = SignedIn::from_request_parts(parts, app).await?;
        let source = source_of(parts.extensions.get::<Peer>().copied());
        let reader = Reader::of(&parts.uri, &parts.headers);
        Ok(Tap { app: app.clone(), session, source, reader, arrived })
    }
}

impl Tap {
    /// Somebody touched a button, and the socket of their page says so.
    pub fn over_socket(app: &AppState, session: &Session, source: IpAddr, lang: Lang) -> Tap {
        let reader =
            Reader { speaks: Speaks::Json, lang, palette: Palette::default(), part: Part::default() };
        Tap { app: app.clone(), session: session.clone(), source, reader, arrived: app.clock.now() }
    }

    /// Requests a stop, once for each tap.
    pub async fn stop(&self, form: StopForm) -> Response {
        let shown = Versioned { version: form.version, beat: form.beat };
        let validity = Validity { is_stop: true, ..self.validity(&shown, Aspect::Stage) };
        let tap = self.clone();
        let record = self.record(Action::Stop);
        let stopping = async move { tap.command(validity, OperatorAction::RequestStop, record).await };
        let done = match form.tap {
            Some(name) if name.len() > TAP_BYTES_MAX => return bad_field(&self.reader, "tap"),
            Some(name) => self.app.stops.once(&self.session, name, stopping).await,
            None => stopping.await,
        };
        match done {
            Ok(()) => self.done(&json!({})),
            Err(refused) => self.refuse(refused),
        }
    }

    pub async fn act(&self, validity: Validity, action: OperatorAction, record: Record) -> Response {
        match self.command(validity, action, record).await {
            Ok(()) => self.done(&json!({})),
            Err(refused) => self.refuse(refused),
        }
    }

    /// Has the action done, if it was shown as things are and by whom it concerns. What was done or
    /// refused is on the disk when this returns, unless that does not answer.
    pub async fn command(
        &self,
        validity: Validity,
        action: OperatorAction,
        record: Record,
    ) -> Result<(), NotDone> {
        if let Err(invalid) = self.check(&validity) {
            self.app.record(None, record.refused(invalid.words(Lang::En))).await;
            return Err(NotDone::Invalid(invalid));
        }
        // Runs to its end also if nobody listens any more: what was done has to be kept.
        let tap = self.clone();
        let done = tokio::spawn(async move { tap.hand_on(validity, action, record).await });
        done.await.unwrap_or(Err(NotDone::HttpError(HttpError::Unavailable)))
    }

    /// A tap that waited on its way was made while the display could still say that it is live, and
    /// arrives when it could not.
    pub fn validity(&self, shown: &Versioned, aspect: Aspect) -> Validity {
        let age = shown.beat.as_deref().map_or(Span::ZERO, |beat| self.age(beat));
        let until = self.arrived + (TAP_LATE_MAX - age);
        Validity { aspect, version: shown.version, until, confirmed_until: until, is_stop: false }
    }

    /// How old a heartbeat was when the tap arrived. What cannot be read is as old as can be.
    fn age(&self, beat: &str) -> Span {
        let Ok(beat) = humantime::parse_rfc3339(beat) else { return TAP_LATE_MAX };
        let clock = &self.app.clock;
        let wall = wall_at(clock.wall(), clock.now(), self.arrived);
        let apart = wall.duration_since(beat).or_else(|_| beat.duration_since(wall)).unwrap_or_default();
        Span::from_nanos(u64::try_from(apart.as_nanos()).unwrap_or(u64::MAX))
    }

    /// Whether the tap counts now.
    fn check(&self, validity: &Validity) -> Result<(), InvalidTap> {
        let (app, now) = (&self.app, self.app.clock.now());
        if !self.session.is_open() || app.has_expired(&self.session) {
            return Err(InvalidTap::SessionEnded);
        }
        let published = app.published();
        let is_next = validity.is_stop && app.hand_overs.is_successor(&self.session);
        if !is_next && !is_in_charge(&self.session, &published.snapshot) {
            return Err(InvalidTap::NotInCharge);
        }
        if now >= validity.until {
            return Err(InvalidTap::Late);
        }
        if now >= validity.confirmed_until {
            return Err(InvalidTap::ConfirmedLate);
        }
        let holds = app.frames.observe(&published).holds(validity.aspect, validity.version);
        if holds { Ok(()) } else { Err(InvalidTap::Stale) }
    }

    /// What is asked for, with what is known in this moment.
    fn asked(&self, validity: &Validity, action: &OperatorAction) -> Result<OperatorAction, InvalidTap> {
        self.check(validity)?;
        let (display_live, storage_ok) = self.conditions();
        Ok(match action {
            OperatorAction::AskClearance { .. } => OperatorAction::AskClearance { display_live, storage_ok },
            OperatorAction::Clear { .. } => OperatorAction::Clear { display_live, storage_ok },
            other => other.clone(),
        })
    }

    async fn hand_on(
        &self,
        validity: Validity,
        action: OperatorAction,
        record: Record,
    ) -> Result<(), NotDone> {
        let acted = if action == OperatorAction::RequestStop {
            let kept = self.app.act_at_once(action, record).await;
            let deaf = self.app.published().snapshot.unreached(Output::ManeuverStop).is_some();
            match kept {
                Ok(_) if deaf => {
                    tracing::error!("a stop was requested and nobody listens");
                    return Err(NotDone::HttpError(HttpError::StopNotHeard));
                }
                Ok(true) => Ok(()),
                Ok(false) => {
                    tracing::error!("a stop was requested and is not kept yet");
                    return Err(NotDone::HttpError(HttpError::StopNotKept));
                }
                Err(not_acted) => Err(not_acted),
            }
        } else {
            let until = validity.until.min(validity.confirmed_until);
            self.app.act(until, record, || self.asked(&validity, &action)).await
        };
        acted.map_err(|not_acted| match not_acted {
            NotActed::Refused(reasons) => {
                NotDone::Refused(view::refusals(&self.app.published(), self.reader.lang, &reasons))
            }
            NotActed::Invalid(invalid) => NotDone::Invalid(invalid),
            other => NotDone::HttpError(other.trouble()),
        })
    }

    /// What the engine cannot know: whether the operator sees what is, and whether it can be written down.
    pub fn conditions(&self) -> (bool, bool) {
        let display_live = self.app.displays.is_live_for(&self.session, self.app.clock.now());
        (display_live, self.app.is_storage_ok())
    }

    pub fn record(&self, action: Action) -> Record {
        record_of(&self.session, action, self.source)
    }

    pub fn done(&self, answer: &Value) -> Response {
        match self.reader.speaks {
            Speaks::Json => json_answer(StatusCode::OK, answer),
            Speaks::Html => Redirect::to("/").into_response(),
        }
    }

    pub fn refuse(&self, not_done: NotDone) -> Response {
        match not_done {
            NotDone::Refused(reasons) => refused_in_words(&self.reader, &reasons, None),
            NotDone::Invalid(InvalidTap::SessionEnded) => refusal(&self.reader, HttpError::NoSession),
            NotDone::Invalid(invalid) => {
                // What was shown is old: the page asks for what is.
                let is_old = matches!(invalid, InvalidTap::Stale | InvalidTap::Late);
                let seq = is_old.then(|| self.app.published().snapshot.seq);
                refused_in_words(&self.reader, &[invalid.words(self.reader.lang)], seq)
            }
            NotDone::HttpError(trouble) => refusal(&self.reader, trouble),
        }
    }
}
