//! What an operator does with the vehicle: one POST for each action, granted or refused in words.

use std::net::IpAddr;

use axum::extract::rejection::{FormRejection, PathRejection};
use axum::extract::{Form, FromRequestParts, Path};
use axum::http::StatusCode;
use axum::http::request::Parts;
use axum::response::{IntoResponse, Redirect, Response};
use serde::Deserialize;
use serde_json::{Value, json};

use super::act::{NotActed, Void};
use super::answer::{Reader, Speaks, bad_field, bad_form, json_answer, refusal, refused_in_words};
use super::audit::record_of;
use super::guard::SignedIn;
use super::login::{Peer, source_of};
use super::pending::{CONFIRM_WITHIN, NotPending};
use super::state::{AppState, is_seated};
use super::versions::Matter;
use super::view::{self, Lang, Palette, Part};
use super::wording::Trouble;
use crate::clock::wall_at;
use crate::engine::input::{AlarmRef, OperatorAction, Place};
use crate::engine::model::NodeId;
use crate::engine::model::output::Output;
use crate::engine::snapshot::Snapshot;
use crate::engine::time::{Span, Timestamp};
use crate::store::Session;
use crate::store::audit::{Action, Record};

type FormOf<T> = Result<Form<T>, FormRejection>;
type PathOf = Result<Path<String>, PathRejection>;

/// The `seq` that the button was shown with.
#[derive(Debug, Deserialize)]
pub struct Versioned {
    version: u64,
    /// The wall time of the server's last heartbeat before the tap, as the heartbeat said it.
    beat: Option<String>,
}

/// Longer names of taps are no page's.
const TAP_BYTES_MAX: usize = 64;

/// Twice the time after which a page without heartbeats covers itself.
const TAP_LATE_MAX: Span = Span::from_secs(4);

/// A stop, over HTTP or over the socket of the page.
#[derive(Debug, Deserialize)]
pub struct StopForm {
    version: u64,
    beat: Option<String>,
    /// The tap's own name: what comes with the same one again is the same tap.
    pub tap: Option<Box<str>>,
}

#[derive(Debug, Deserialize)]
pub struct LocalizeForm {
    stop: Option<Box<str>>,
    x: Option<f64>,
    y: Option<f64>,
    yaw_deg: Option<f64>,
    version: u64,
    beat: Option<String>,
}

#[derive(Debug, Deserialize)]
pub struct ConfirmForm {
    token: String,
    version: Option<u64>,
    beat: Option<String>,
}

/// `POST /vehicle/localize`
pub async fn localize(tap: Tap, form: FormOf<LocalizeForm>) -> Response {
    let form = match form {
        Ok(Form(form)) => form,
        Err(rejection) => return bad_form(&tap.reader, &rejection),
    };
    let place = match form {
        LocalizeForm { stop: Some(stop), x: None, y: None, yaw_deg: None, .. } => Place::Stop(stop),
        LocalizeForm { stop: None, x: Some(x_m), y: Some(y_m), yaw_deg: Some(yaw_deg), .. } => {
            Place::Pose { x_m, y_m, yaw_deg }
        }
        _ => return bad_field(&tap.reader, "stop, x, y, yaw_deg"),
    };
    let shown = Versioned { version: form.version, beat: form.beat };
    let target = match &place {
        Place::Stop(stop) => stop.to_string(),
        Place::Pose { x_m, y_m, yaw_deg } => format!("x {x_m} y {y_m} yaw {yaw_deg}"),
    };
    let record = tap.record(Action::Localize).on(target);
    tap.act(tap.grounds(&shown, Matter::Stage), OperatorAction::Localize { place }, record).await
}

/// `POST /vehicle/stop`
pub async fn stop(tap: Tap, form: FormOf<StopForm>) -> Response {
    match form {
        Ok(Form(form)) => tap.stop(form).await,
        Err(rejection) => bad_form(&tap.reader, &rejection),
    }
}

/// `POST /vehicle/clearance`: the first step; the answer holds the token for the second.
pub async fn clearance(tap: Tap, form: FormOf<Versioned>) -> Response {
    let shown = match form {
        Ok(Form(shown)) => shown,
        Err(rejection) => return bad_form(&tap.reader, &rejection),
    };
    let (display_live, storage_ok) = tap.conditions();
    let ask = OperatorAction::AskClearance { display_live, storage_ok };
    let record = tap.record(Action::ClearanceAsked);
    if let Err(refused) = tap.command(tap.grounds(&shown, Matter::Clearance), ask, record).await {
        return tap.refuse(refused);
    }
    match tap.app.pending.ask(&tap.session, shown.version, tap.app.clock.now()) {
        Ok(token) => tap.done(&json!({ "token": token, "expires_s": CONFIRM_WITHIN.as_millis() / 1000 })),
        Err(error) => {
            tracing::error!(%error, "no token can be made");
            refusal(&tap.reader, Trouble::Unavailable)
        }
    }
}

/// `POST /vehicle/clearance/confirm`: the second step.
pub async fn confirm(tap: Tap, form: FormOf<ConfirmForm>) -> Response {
    let form = match form {
        Ok(Form(form)) => form,
        Err(rejection) => return bad_form(&tap.reader, &rejection),
    };
    let redeemed = tap.app.pending.redeem(&form.token, &tap.session, tap.app.clock.now());
    let record = tap.record(Action::Clearance);
    let (asked, confirmed_until) = match redeemed {
        Ok(redeemed) => redeemed,
        Err(why) => {
            let is_late = why == NotPending::TooLate;
            tap.app.record(None, record.refused(Lang::En.not_pending(is_late))).await;
            return tap.refuse(NotDone::Refused(vec![tap.reader.lang.not_pending(is_late)]));
        }
    };
    let (display_live, storage_ok) = tap.conditions();
    let shown =
        Versioned { version: form.version.map_or(asked, |version| version.min(asked)), beat: form.beat };
    let grounds = Grounds { confirmed_until, ..tap.grounds(&shown, Matter::Clearance) };
    tap.act(grounds, OperatorAction::Clear { display_live, storage_ok }, record).await
}

/// `POST /alarms/{id}/acknowledge`, where the id is the number of an alarm, the name of a node
/// with a WARNING, or `stop` for the stop that the operator asked for.
pub async fn acknowledge(tap: Tap, path: PathOf, form: FormOf<Versioned>) -> Response {
    let Some(id) = inner(&path, "/acknowledge") else { return refusal(&tap.reader, Trouble::NotFound) };
    let shown = match form {
        Ok(Form(shown)) => shown,
        Err(rejection) => return bad_form(&tap.reader, &rejection),
    };
    let snapshot = tap.app.published().snapshot;
    let (alarm, matter) = match id.parse() {
        Ok(number) => (AlarmRef::Number(number), Matter::Alarm(number)),
        Err(_) if id == "stop" => (AlarmRef::OperatorStop, Matter::Stage),
        Err(_) => (AlarmRef::Node(id.into()), of_node(&snapshot, id)),
    };
    let record = tap.record(Action::Acknowledge).on(with_places(&snapshot, &alarm, id));
    tap.act(tap.grounds(&shown, matter), OperatorAction::Acknowledge { alarm }, record).await
}

/// What is acknowledged, for the log: all places at which one status shows.
fn with_places(snapshot: &Snapshot, alarm: &AlarmRef, id: &str) -> String {
    let node = match alarm {
        AlarmRef::Number(number) => snapshot.alarms.iter().find(|it| it.id == *number).map(|it| it.node),
        AlarmRef::Node(name) => snapshot.node(name),
        AlarmRef::OperatorStop => None,
    };
    let places = node.map(|node| snapshot.places_of(node)).unwrap_or_default();
    if places.len() < 2 {
        return id.to_owned();
    }
    let names: Vec<&str> = places.iter().map(|&node| &**snapshot.node_name(node)).collect();
    format!("{id}: {}", names.join(", "))
}

/// `POST /modules/{id}/reset`, where the id is `group/module`.
pub async fn reset(tap: Tap, path: PathOf, form: FormOf<Versioned>) -> Response {
    let Some(module) = inner(&path, "/reset") else { return refusal(&tap.reader, Trouble::NotFound) };
    let shown = match form {
        Ok(Form(shown)) => shown,
        Err(rejection) => return bad_form(&tap.reader, &rejection),
    };
    let matter = of_node(&tap.app.published().snapshot, module);
    let action = OperatorAction::Reset { module: module.into() };
    tap.act(tap.grounds(&shown, matter), action, tap.record(Action::Reset).on(module)).await
}

/// Ids hold slashes, so a route of such an id takes all that follows and its last word is read here.
fn inner<'a>(path: &'a PathOf, word: &str) -> Option<&'a str> {
    let Ok(Path(path)) = path else { return None };
    path.strip_suffix(word).filter(|id| !id.is_empty())
}

/// What a node stands for: its component. What is in none is judged with the stage alone.
fn of_node(snapshot: &Snapshot, name: &str) -> Matter {
    let mut group = match snapshot.node(name) {
        Some(NodeId::Group(id)) => id,
        Some(NodeId::Module(id)) => snapshot.module(id).0.group,
        None => return Matter::Stage,
    };
    while let Some(parent) = snapshot.group(group).0.parent {
        group = parent;
    }
    let info = snapshot.group(group).0;
    if info.is_tile() { Matter::Component(group) } else { Matter::Stage }
}

/// Somebody touched a button.
#[derive(Debug, Clone)]
pub struct Tap {
    app: AppState,
    session: Session,
    source: IpAddr,
    reader: Reader,
    arrived: Timestamp,
}

/// What makes a tap count. It is looked at anew whenever the tap has waited.
#[derive(Debug, Clone, Copy)]
struct Grounds {
    matter: Matter,
    /// The `seq` that it was shown with.
    version: u64,
    /// After this it is late.
    until: Timestamp,
    /// Of a second step: after this the first one counts no more.
    confirmed_until: Timestamp,
    /// It is a stop, which counts from the next operator too.
    is_stop: bool,
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

/// Why a tap is not acknowledged. It changed nothing; a stop that cannot be kept is requested.
#[derive(Debug, Clone)]
pub enum NotDone {
    /// In words.
    Refused(Vec<String>),
    Void(Void),
    Trouble(Trouble),
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
        let grounds = Grounds { is_stop: true, ..self.grounds(&shown, Matter::Stage) };
        let tap = self.clone();
        let record = self.record(Action::Stop);
        let stopping = async move { tap.command(grounds, OperatorAction::RequestStop, record).await };
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

    async fn act(&self, grounds: Grounds, action: OperatorAction, record: Record) -> Response {
        match self.command(grounds, action, record).await {
            Ok(()) => self.done(&json!({})),
            Err(refused) => self.refuse(refused),
        }
    }

    /// Has the action done, if it was shown as things are and by whom it concerns. What was done or
    /// refused is on the disk when this returns, unless that does not answer.
    async fn command(&self, grounds: Grounds, action: OperatorAction, record: Record) -> Result<(), NotDone> {
        if let Err(void) = self.check(&grounds) {
            self.app.record(None, record.refused(void.words(Lang::En))).await;
            return Err(NotDone::Void(void));
        }
        // Runs to its end also if nobody listens any more: what was done has to be kept.
        let tap = self.clone();
        let done = tokio::spawn(async move { tap.hand_on(grounds, action, record).await });
        done.await.unwrap_or(Err(NotDone::Trouble(Trouble::Unavailable)))
    }

    /// A tap that waited on its way was made while the display could still say that it is live, and
    /// arrives when it could not.
    fn grounds(&self, shown: &Versioned, matter: Matter) -> Grounds {
        let age = shown.beat.as_deref().map_or(Span::ZERO, |beat| self.age(beat));
        let until = self.arrived + (TAP_LATE_MAX - age);
        Grounds { matter, version: shown.version, until, confirmed_until: until, is_stop: false }
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
    fn check(&self, grounds: &Grounds) -> Result<(), Void> {
        let (app, now) = (&self.app, self.app.clock.now());
        if !self.session.is_open() || app.has_expired(&self.session) {
            return Err(Void::SessionEnded);
        }
        let published = app.published();
        let is_next = grounds.is_stop && app.hand_overs.is_successor(&self.session);
        if !is_next && !is_seated(&self.session, &published.snapshot) {
            return Err(Void::NotSeated);
        }
        if now >= grounds.until {
            return Err(Void::Late);
        }
        if now >= grounds.confirmed_until {
            return Err(Void::ConfirmedLate);
        }
        let holds = app.frames.observe(&published).holds(grounds.matter, grounds.version);
        if holds { Ok(()) } else { Err(Void::Stale) }
    }

    /// What is asked for, with what is known in this moment.
    fn asked(&self, grounds: &Grounds, action: &OperatorAction) -> Result<OperatorAction, Void> {
        self.check(grounds)?;
        let (display_live, storage_ok) = self.conditions();
        Ok(match action {
            OperatorAction::AskClearance { .. } => OperatorAction::AskClearance { display_live, storage_ok },
            OperatorAction::Clear { .. } => OperatorAction::Clear { display_live, storage_ok },
            other => other.clone(),
        })
    }

    async fn hand_on(&self, grounds: Grounds, action: OperatorAction, record: Record) -> Result<(), NotDone> {
        let acted = if action == OperatorAction::RequestStop {
            let kept = self.app.act_at_once(action, record).await;
            let deaf = self.app.published().snapshot.unreached(Output::ManeuverStop).is_some();
            match kept {
                Ok(_) if deaf => {
                    tracing::error!("a stop was requested and nobody listens");
                    return Err(NotDone::Trouble(Trouble::StopNotHeard));
                }
                Ok(true) => Ok(()),
                Ok(false) => {
                    tracing::error!("a stop was requested and is not kept yet");
                    return Err(NotDone::Trouble(Trouble::StopNotKept));
                }
                Err(not_acted) => Err(not_acted),
            }
        } else {
            let until = grounds.until.min(grounds.confirmed_until);
            self.app.act(until, record, || self.asked(&grounds, &action)).await
        };
        acted.map_err(|not_acted| match not_acted {
            NotActed::Refused(reasons) => {
                NotDone::Refused(view::refusals(&self.app.published(), self.reader.lang, &reasons))
            }
            NotActed::Void(void) => NotDone::Void(void),
            other => NotDone::Trouble(other.trouble()),
        })
    }

    /// What the engine cannot know: whether the operator sees what is, and whether it can be written down.
    fn conditions(&self) -> (bool, bool) {
        let display_live = self.app.displays.is_live_for(&self.session, self.app.clock.now());
        (display_live, self.app.is_storage_ok())
    }

    fn record(&self, action: Action) -> Record {
        record_of(&self.session, action, self.source)
    }

    fn done(&self, answer: &Value) -> Response {
        match self.reader.speaks {
            Speaks::Json => json_answer(StatusCode::OK, answer),
            Speaks::Html => Redirect::to("/").into_response(),
        }
    }

    fn refuse(&self, not_done: NotDone) -> Response {
        match not_done {
            NotDone::Refused(reasons) => refused_in_words(&self.reader, &reasons, None),
            NotDone::Void(Void::SessionEnded) => refusal(&self.reader, Trouble::NoSession),
            NotDone::Void(void) => {
                // What was shown is old: the page asks for what is.
                let is_old = matches!(void, Void::Stale | Void::Late);
                let seq = is_old.then(|| self.app.published().snapshot.seq);
                refused_in_words(&self.reader, &[void.words(self.reader.lang)], seq)
            }
            NotDone::Trouble(trouble) => refusal(&self.reader, trouble),
        }
    }
}
