//! The routes of the operator's actions: one POST for each action, granted, or refused with reasons.

use axum::Json;
use axum::extract::Path;
use axum::extract::rejection::PathRejection;
use axum::response::{IntoResponse, Redirect, Response};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::act::act;
use super::not_done::NotDone;
use super::tap::{Tap, TapValidity, TappedAction, Versioned};
use super::two_steps::{CONFIRM_WITHIN, FirstStep, TwoSteps};
use crate::Live;
use crate::http::respond::{FormOf, Reader, Speaks, bad_field, refusal, refused_in_words};
use crate::texts::{HttpError, InvalidTap, Lang};
use crate::view;
use crate::view::versions::Aspect;
use telltale_engine::input::{AlarmRef, OperatorAction, Place};
use telltale_engine::snapshot::Snapshot;
use telltale_store::audit::{Action, Record};

/// The longest name of a tap that a page makes.
const TAP_BYTES_MAX: usize = 64;

/// The answer to a first step.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Granted {
    /// For the second step.
    token: String,
    /// Seconds within which the second step has to come.
    expires_s: u64,
}

/// Something was done, and there is nothing to say of it.
#[derive(Debug, Serialize, JsonSchema)]
pub struct Done {}

type PathOf = Result<Path<String>, PathRejection>;

#[derive(Debug, Deserialize, JsonSchema)]
pub struct LocalizeForm {
    /// The id of a stop; or else a pose.
    stop: Option<Box<str>>,
    /// In metres, on the map.
    x: Option<f64>,
    y: Option<f64>,
    yaw_deg: Option<f64>,
    /// The `seq` of the state that the operator was shown.
    version: u64,
    /// The wall time of the last heartbeat that the display received, if it received one.
    beat: Option<String>,
}

/// A stop, over HTTP or over the socket of the page. It counts whatever the page showed, and however late.
#[derive(Debug, Deserialize, JsonSchema)]
pub struct StopForm {
    /// The tap's own name, another for each tap: a request with the same name within 10 s is the same tap, sent again.
    pub tap: Option<Box<str>>,
}

#[derive(Debug, Deserialize, JsonSchema)]
pub struct AcknowledgeOverForm {
    /// The highest number of an alarm that the page showed as over.
    last: u64,
    beat: Option<String>,
}

#[derive(Debug, Deserialize, JsonSchema)]
pub struct ConfirmForm {
    /// Of the answer to the first step.
    token: String,
    version: Option<u64>,
    beat: Option<String>,
}

/// `POST /vehicle/localize`
pub async fn localize(tap: Tap, FormOf(form): FormOf<LocalizeForm>) -> Response {
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
    let validity = tap.validity(&shown, Aspect::Stage);
    done(tap, validity, OperatorAction::Localize { place }, record).await
}

/// `POST /vehicle/stop`
pub async fn stop(tap: Tap, FormOf(form): FormOf<StopForm>) -> Response {
    request_stop(tap, form).await
}

/// Requests a stop, once for each tap, over the socket or by HTTP.
pub async fn request_stop(tap: Tap, form: StopForm) -> Response {
    let validity = tap.validity_of_stop();
    let record = tap.record(Action::Stop);
    let stopping =
        act(TappedAction { tap: tap.clone(), validity, action: OperatorAction::RequestStop, record });
    let stopped = match form.tap {
        Some(name) if name.len() > TAP_BYTES_MAX => return bad_field(&tap.reader, "tap"),
        Some(name) => tap.app.stops.once(&tap, name, stopping).await,
        None => stopping.await,
    };
    answer(&tap, stopped, Done {})
}

/// `POST /vehicle/clearance`: the first step; the answer holds the token for the second.
pub async fn clearance(tap: Tap, FormOf(form): FormOf<Versioned>) -> Response {
    request(tap, form, TwoSteps::Clearance).await
}

/// `POST /vehicle/release`: the first step; the answer holds the token for the second.
pub async fn release(tap: Tap, FormOf(form): FormOf<Versioned>) -> Response {
    request(tap, form, TwoSteps::Release).await
}

/// `POST /vehicle/clearance/confirm`: the second step.
pub async fn confirm(tap: Tap, FormOf(form): FormOf<ConfirmForm>) -> Response {
    confirm_step(tap, form, TwoSteps::Clearance).await
}

/// `POST /vehicle/release/confirm`: the second step.
pub async fn confirm_release(tap: Tap, FormOf(form): FormOf<ConfirmForm>) -> Response {
    confirm_step(tap, form, TwoSteps::Release).await
}

/// `POST /vehicle/clearance/withdraw`
pub async fn withdraw(tap: Tap, FormOf(shown): FormOf<Versioned>) -> Response {
    let (validity, record) = (tap.validity(&shown, Aspect::Stage), tap.record(Action::ClearanceWithdrawn));
    done(tap, validity, OperatorAction::Withdraw, record).await
}

async fn request(tap: Tap, shown: Versioned, steps: TwoSteps) -> Response {
    // In this order: a STOP that the number does not count is a new tap, also under a known name.
    let last_stop = tap.app.published().snapshot.last_stop;
    tap.app.stops.forget();
    let (display_live, storage_ok) = tap.conditions();
    let (action, record) = steps.request(display_live, storage_ok);
    let (validity, record) = (tap.validity(&shown, steps.aspect()), tap.record(record));
    let granted = act(TappedAction { tap: tap.clone(), validity, action, record }).await;
    if granted.is_err() {
        return answer(&tap, granted, Done {});
    }
    let until = tap.app.clock.now() + CONFIRM_WITHIN;
    let first = FirstStep { version: shown.version, last_stop, until };
    match tap.app.pending.request(steps, &tap.session, first) {
        Ok(token) => answer(&tap, Ok(()), Granted { token, expires_s: CONFIRM_WITHIN.as_millis() / 1000 }),
        Err(error) => {
            tracing::error!(%error, "no token can be made");
            refusal(&tap.reader, HttpError::Unavailable)
        }
    }
}

async fn confirm_step(tap: Tap, form: ConfirmForm, steps: TwoSteps) -> Response {
    tap.app.stops.forget();
    let redeemed = tap.app.pending.redeem(steps, &form.token, &tap.session, tap.app.clock.now());
    let (display_live, storage_ok) = tap.conditions();
    let (action, record) = steps.confirm(display_live, storage_ok);
    let record = tap.record(record);
    let first = match redeemed {
        Ok(redeemed) => redeemed,
        Err(invalid) => {
            let [why, why_de] = Lang::ALL.map(|lang| lang.invalid_tap(invalid));
            tap.tell_recorder(&action, why, why_de);
            tap.app.store.record(record.refused(why), None).await;
            return answer(&tap, Err(invalid.into()), Done {});
        }
    };
    let version = form.version.map_or(first.version, |version| version.min(first.version));
    let shown = Versioned { version, beat: form.beat };
    let (confirmed_until, last_stop) = (first.until, Some(first.last_stop));
    let validity = TapValidity { confirmed_until, last_stop, ..tap.validity(&shown, steps.aspect()) };
    done(tap, validity, action, record).await
}

/// `POST /alarms/{id}/acknowledge`, where the id is the number of an alarm, or the name of a node
/// with a WARNING.
pub async fn acknowledge(tap: Tap, path: PathOf, FormOf(shown): FormOf<Versioned>) -> Response {
    let Some(id) = inner(&path, "/acknowledge") else { return refusal(&tap.reader, HttpError::NotFound) };
    let snapshot = tap.app.published().snapshot;
    let (alarm, aspect) = match id.parse() {
        Ok(number) => (AlarmRef::Number(number), Aspect::Alarm(number)),
        Err(_) => (AlarmRef::Node(id.into()), of_node(&snapshot, id)),
    };
    let record = tap.record(Action::Acknowledge).on(with_places(&snapshot, &alarm, id));
    let validity = tap.validity(&shown, aspect);
    done(tap, validity, OperatorAction::Acknowledge { alarm }, record).await
}

/// `POST /alarms/acknowledge-over`: all alarms that are over, up to the last one that the page showed. The
/// number says what it is about, so it counts whatever has changed since.
pub async fn acknowledge_over(tap: Tap, FormOf(form): FormOf<AcknowledgeOverForm>) -> Response {
    let AcknowledgeOverForm { last, beat } = form;
    let snapshot = tap.app.published().snapshot;
    let count = snapshot.alarms.iter().filter(|it| !it.active && it.id <= last).count();
    let record = tap.record(Action::AcknowledgeOver).on(format!("{count} up to {last}"));
    let validity = tap.validity(&Versioned { version: 0, beat }, Aspect::Nothing);
    done(tap, validity, OperatorAction::Acknowledge { alarm: AlarmRef::Over { last } }, record).await
}

/// The acknowledged alarm for the log, with its node and all others that its status feeds.
fn with_places(snapshot: &Snapshot, alarm: &AlarmRef, id: &str) -> String {
    let node = match alarm {
        AlarmRef::Number(number) => snapshot.alarms.iter().find(|it| it.id == *number).map(|it| it.node),
        AlarmRef::Node(name) => snapshot.node(name),
        AlarmRef::Over { .. } => None,
    };
    let places = node.map(|node| snapshot.places_of(node)).unwrap_or_default();
    let names: Vec<&str> = places.iter().map(|&node| &**snapshot.node_name(node)).collect();
    match &names[..] {
        [] => id.to_owned(),
        [name] if *name == id => id.to_owned(),
        names => format!("{id}: {}", names.join(", ")),
    }
}

/// `POST /modules/{id}/reset`, where the id is `group/module`.
pub async fn reset(tap: Tap, path: PathOf, FormOf(shown): FormOf<Versioned>) -> Response {
    let Some(module) = inner(&path, "/reset") else { return refusal(&tap.reader, HttpError::NotFound) };
    let aspect = of_node(&tap.app.published().snapshot, module);
    let action = OperatorAction::Reset { module: module.into() };
    let (validity, record) = (tap.validity(&shown, aspect), tap.record(Action::Reset).on(module));
    done(tap, validity, action, record).await
}

/// Has an action done, and answers.
async fn done(tap: Tap, validity: TapValidity, action: OperatorAction, record: Record) -> Response {
    let done = act(TappedAction { tap: tap.clone(), validity, action, record }).await;
    answer(&tap, done, Done {})
}

/// Answers with `granted`, or says why the tap changed nothing.
fn answer(tap: &Tap, done: Result<(), NotDone>, granted: impl Serialize) -> Response {
    let reader = &tap.reader;
    match done {
        Ok(()) => match reader.speaks {
            Speaks::Json => Json(granted).into_response(),
            Speaks::Html => Redirect::to("/").into_response(),
        },
        Err(why) => not_done(&tap.app, reader, why),
    }
}

/// Says why nothing has changed.
pub(crate) fn not_done(app: &Live, reader: &Reader, why: NotDone) -> Response {
    match why {
        NotDone::Refused(reasons) => {
            let reasons = view::refusals(&app.published(), reader.lang, &reasons);
            refused_in_words(reader, &reasons, None)
        }
        NotDone::Invalid(InvalidTap::SessionEnded) => refusal(reader, HttpError::NoSession),
        NotDone::Invalid(invalid) => {
            // The page is old: it asks for the present one.
            let is_old = matches!(invalid, InvalidTap::Stale | InvalidTap::Late);
            let seq = is_old.then(|| app.published().snapshot.seq);
            refused_in_words(reader, &[reader.lang.invalid_tap(invalid).to_owned()], seq)
        }
        NotDone::HttpError(error) => refusal(reader, error),
    }
}

/// The id in a path. Ids have slashes, so the route takes the rest of the path, and its last word is removed
/// here.
fn inner<'a>(path: &'a PathOf, word: &str) -> Option<&'a str> {
    let Ok(Path(path)) = path else { return None };
    path.strip_suffix(word).filter(|id| !id.is_empty())
}

/// The part of the state to which a node belongs: its component, or the stage if it is in no component.
fn of_node(snapshot: &Snapshot, name: &str) -> Aspect {
    let Some(node) = snapshot.node(name) else { return Aspect::Stage };
    let group = snapshot.layout.outermost(node);
    let info = snapshot.group(group).0;
    if info.is_tile() { Aspect::Component(group) } else { Aspect::Stage }
}
