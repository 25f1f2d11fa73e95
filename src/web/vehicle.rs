//! What an operator does with the vehicle: one POST for each action, granted or refused in words.

use axum::extract::rejection::{FormRejection, PathRejection};
use axum::extract::{Form, Path, State};
use axum::http::StatusCode;
use axum::response::{IntoResponse, Redirect, Response};
use serde::Deserialize;
use serde_json::{Value, json};

use super::answer::{Reader, Speaks, json_answer, refusal, refused_in_words};
use super::guard::SignedIn;
use super::pending::{CONFIRM_WITHIN, NotPending};
use super::state::{AppState, is_seated};
use super::versions::{Matter, Seen};
use super::view;
use super::wording::Trouble;
use crate::engine::input::{AlarmRef, OperatorAction, Place, Refusal, Response as Answer};
use crate::engine::model::NodeId;
use crate::engine::snapshot::Snapshot;
use crate::runtime::Published;
use crate::store::Session;

type FormOf<T> = Result<Form<T>, FormRejection>;
type PathOf = Result<Path<String>, PathRejection>;

/// The `seq` that the button was shown with.
#[derive(Debug, Deserialize)]
pub struct Versioned {
    version: u64,
    /// The wall time of the server's last heartbeat before the tap, as the heartbeat said it.
    beat: Option<String>,
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
pub async fn localize(
    State(app): State<AppState>,
    SignedIn(session): SignedIn,
    reader: Reader,
    form: FormOf<LocalizeForm>,
) -> Response {
    let Ok(Form(form)) = form else { return refusal(&reader, Trouble::BadForm) };
    let place = match form {
        LocalizeForm { stop: Some(stop), x: None, y: None, yaw_deg: None, .. } => Place::Stop(stop),
        LocalizeForm { stop: None, x: Some(x_m), y: Some(y_m), yaw_deg: Some(yaw_deg), .. } => {
            Place::Pose { x_m, y_m, yaw_deg }
        }
        _ => return refusal(&reader, Trouble::BadForm),
    };
    let tap = Tap { app, session, reader };
    let shown = Versioned { version: form.version, beat: form.beat };
    tap.act(&shown, Matter::Stage, OperatorAction::Localize { place }).await
}

/// `POST /vehicle/stop`
pub async fn stop(
    State(app): State<AppState>,
    SignedIn(session): SignedIn,
    reader: Reader,
    form: FormOf<Versioned>,
) -> Response {
    let Ok(Form(shown)) = form else { return refusal(&reader, Trouble::BadForm) };
    Tap { app, session, reader }.act(&shown, Matter::Stage, OperatorAction::RequestStop).await
}

/// `POST /vehicle/shutdown`
pub async fn shutdown(
    State(app): State<AppState>,
    SignedIn(session): SignedIn,
    reader: Reader,
    form: FormOf<Versioned>,
) -> Response {
    let Ok(Form(shown)) = form else { return refusal(&reader, Trouble::BadForm) };
    Tap { app, session, reader }.act(&shown, Matter::Stage, OperatorAction::Shutdown).await
}

/// `POST /vehicle/clearance`: the first step; the answer holds the token for the second.
pub async fn clearance(
    State(app): State<AppState>,
    SignedIn(session): SignedIn,
    reader: Reader,
    form: FormOf<Versioned>,
) -> Response {
    let Ok(Form(shown)) = form else { return refusal(&reader, Trouble::BadForm) };
    let tap = Tap { app, session, reader };
    let (display_live, storage_ok) = tap.conditions().await;
    let ask = OperatorAction::AskClearance { display_live, storage_ok };
    match tap.command(&shown, Matter::Clearance, ask).await {
        Ok(()) => {}
        Err(answer) => return answer,
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
pub async fn confirm(
    State(app): State<AppState>,
    SignedIn(session): SignedIn,
    reader: Reader,
    form: FormOf<ConfirmForm>,
) -> Response {
    let Ok(Form(form)) = form else { return refusal(&reader, Trouble::BadForm) };
    let tap = Tap { app, session, reader };
    let asked = match tap.app.pending.redeem(&form.token, &tap.session, tap.app.clock.now()) {
        Ok(asked) => asked,
        Err(why) => return tap.refused(&[tap.reader.lang.not_pending(why == NotPending::TooLate)]),
    };
    let (display_live, storage_ok) = tap.conditions().await;
    let shown =
        Versioned { version: form.version.map_or(asked, |version| version.min(asked)), beat: form.beat };
    tap.act(&shown, Matter::Clearance, OperatorAction::Clear { display_live, storage_ok }).await
}

/// `POST /alarms/{id}/acknowledge`, where the id is the number of an alarm, the name of a node
/// with a WARNING, or `stop` for the stop that the operator asked for.
pub async fn acknowledge(
    State(app): State<AppState>,
    SignedIn(session): SignedIn,
    reader: Reader,
    path: PathOf,
    form: FormOf<Versioned>,
) -> Response {
    let Some(id) = inner(&path, "/acknowledge") else { return refusal(&reader, Trouble::NotFound) };
    let Ok(Form(shown)) = form else { return refusal(&reader, Trouble::BadForm) };
    let snapshot = app.published().snapshot;
    let (alarm, matter) = match id.parse() {
        Ok(number) => (AlarmRef::Number(number), Matter::Alarm(number)),
        Err(_) if id == "stop" => (AlarmRef::OperatorStop, Matter::Stage),
        Err(_) => (AlarmRef::Node(id.into()), of_node(&snapshot, id)),
    };
    Tap { app, session, reader }.act(&shown, matter, OperatorAction::Acknowledge { alarm }).await
}

/// `POST /modules/{id}/reset`, where the id is `group/module`.
pub async fn reset(
    State(app): State<AppState>,
    SignedIn(session): SignedIn,
    reader: Reader,
    path: PathOf,
    form: FormOf<Versioned>,
) -> Response {
    let Some(module) = inner(&path, "/reset") else { return refusal(&reader, Trouble::NotFound) };
    let Ok(Form(shown)) = form else { return refusal(&reader, Trouble::BadForm) };
    let matter = of_node(&app.published().snapshot, module);
    let action = OperatorAction::Reset { module: module.into() };
    Tap { app, session, reader }.act(&shown, matter, action).await
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
    if info.is_other || info.is_system { Matter::Stage } else { Matter::Component(group) }
}

/// Somebody touched a button.
struct Tap {
    app: AppState,
    session: Session,
    reader: Reader,
}

impl Tap {
    async fn act(&self, shown: &Versioned, matter: Matter, action: OperatorAction) -> Response {
        match self.command(shown, matter, action).await {
            Ok(()) => self.done(&json!({})),
            Err(answer) => answer,
        }
    }

    /// Hands the action to the engine, if it was shown as things are and by whom it concerns.
    async fn command(
        &self,
        shown: &Versioned,
        matter: Matter,
        action: OperatorAction,
    ) -> Result<(), Response> {
        let published = self.app.published();
        if !is_seated(&self.session, &published.snapshot) {
            return Err(self.refused(&[self.reader.lang.words().not_in_seat.to_owned()]));
        }
        let seen = self.app.frames.observe(&published);
        if !seen.holds(matter, shown.version) || self.is_late(shown) {
            return Err(self.stale(&seen));
        }
        match self.app.command(action).await {
            Ok(Answer::Done) => Ok(()),
            Ok(Answer::Refused(reasons)) => Err(self.refused(&self.in_words(&published, &reasons))),
            Err(error) => {
                tracing::error!(%error, "an action cannot be handed on");
                Err(refusal(&self.reader, Trouble::Unavailable))
            }
        }
    }

    /// What the engine cannot know: whether the operator sees what is, and whether it can be written down.
    async fn conditions(&self) -> (bool, bool) {
        let display_live = self.app.displays.is_live_for(&self.session, self.app.clock.now());
        (display_live, self.app.store.check().await.is_ok())
    }

    /// Whether the tap waited somewhere on its way: it was made while the display could still say
    /// that it is live, and arrives when it could not.
    fn is_late(&self, shown: &Versioned) -> bool {
        let Some(beat) = &shown.beat else { return false };
        let Ok(beat) = humantime::parse_rfc3339(beat) else { return true };
        let wall = self.app.clock.wall();
        let apart = wall.duration_since(beat).or_else(|_| beat.duration_since(wall)).unwrap_or_default();
        apart > TAP_LATE_MAX
    }

    fn in_words(&self, published: &Published, reasons: &[Refusal]) -> Vec<String> {
        view::refusals(published, self.reader.lang, reasons)
    }

    fn refused(&self, reasons: &[String]) -> Response {
        refused_in_words(&self.reader, reasons, None)
    }

    fn stale(&self, seen: &Seen) -> Response {
        refused_in_words(&self.reader, &[self.reader.lang.words().refused_stale.to_owned()], Some(seen.seq()))
    }

    fn done(&self, answer: &Value) -> Response {
        match self.reader.speaks {
            Speaks::Json => json_answer(StatusCode::OK, answer),
            Speaks::Html => Redirect::to("/").into_response(),
        }
    }
}

/// Twice the time after which a page without heartbeats covers itself.
const TAP_LATE_MAX: std::time::Duration = std::time::Duration::from_secs(4);
