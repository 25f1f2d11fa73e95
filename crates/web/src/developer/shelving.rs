//! Shelves a module for maintenance, and ends that: `POST /developer/shelving` and `/developer/shelving/end`.

use axum::Json;
use axum::response::{IntoResponse, Redirect, Response};
use schemars::JsonSchema;
use serde::Deserialize;

use super::why_address;
use crate::Live;
use crate::admission::peer::CameFrom;
use crate::http::guard::SignedIn;
use crate::http::respond::{FormOf, Reader, Speaks};
use crate::operator::act::{AskedAction, act_in_turn};
use crate::operator::actions::{Done, not_done};
use crate::operator::not_done::NotDone;
use crate::texts::{HttpError, InvalidTap};
use telltale_engine::input::OperatorAction;
use telltale_engine::time::Span;
use telltale_store::Session;
use telltale_store::audit::{Action, Record};

/// A request counts for so long.
const COUNTS_FOR: Span = Span::from_secs(4);

#[derive(Debug, Deserialize, JsonSchema)]
pub struct ShelveForm {
    /// The name of a module, with the slashes in it.
    module: Box<str>,
    /// Whole minutes, 480 at most.
    minutes: u32,
}

#[derive(Debug, Deserialize, JsonSchema)]
pub struct UnshelveForm {
    /// The name of a module, with the slashes in it.
    module: Box<str>,
}

/// `POST /developer/shelving`: the faults of a module raise no alarm for so long.
pub async fn shelve(
    app: Live,
    CameFrom(source): CameFrom,
    SignedIn(session): SignedIn,
    reader: Reader,
    FormOf(form): FormOf<ShelveForm>,
) -> Response {
    let ShelveForm { module, minutes } = form;
    let record =
        Record::of_session(&session, Action::Shelved, source).on(format!("{module} for {minutes} min"));
    let lasts = Span::from_secs(60 * u64::from(minutes));
    let action =
        OperatorAction::Shelve { module: module.clone(), lasts, by: session.user.to_string().into() };
    let done = act(app.clone(), session, action, record).await;
    answer(&app, &reader, &module, done)
}

/// `POST /developer/shelving/end`: what still fails calls anew.
pub async fn unshelve(
    app: Live,
    CameFrom(source): CameFrom,
    SignedIn(session): SignedIn,
    reader: Reader,
    FormOf(form): FormOf<UnshelveForm>,
) -> Response {
    let UnshelveForm { module } = form;
    let record = Record::of_session(&session, Action::Unshelved, source).on(&*module);
    let action = OperatorAction::Unshelve { module: module.clone() };
    let done = act(app.clone(), session, action, record).await;
    answer(&app, &reader, &module, done)
}

/// Runs to its end also if nobody listens any more.
async fn act(app: Live, session: Session, action: OperatorAction, record: Record) -> Result<(), NotDone> {
    let until = app.clock.now() + COUNTS_FOR;
    let acting = tokio::spawn(async move {
        let judged = || {
            if !session.is_open() || app.has_expired(&session) {
                return Err(InvalidTap::SessionEnded);
            }
            if app.clock.now() >= until { Err(InvalidTap::Late) } else { Ok(action.clone()) }
        };
        let asked = AskedAction {
            app: &app,
            record: &record,
            until,
            last_stop: None,
            judged: &judged,
            tell_recorder: &|_, _| {},
        };
        act_in_turn(asked).await
    });
    acting.await.unwrap_or(Err(NotDone::HttpError(HttpError::Unavailable)))
}

fn answer(app: &Live, reader: &Reader, module: &str, done: Result<(), NotDone>) -> Response {
    match done {
        Ok(()) => match reader.speaks {
            Speaks::Json => Json(Done {}).into_response(),
            Speaks::Html => Redirect::to(&why_address(module)).into_response(),
        },
        Err(why) => not_done(app, reader, why),
    }
}
