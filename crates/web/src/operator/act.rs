//! Does the actions that operators and services ask for: each is judged, written, judged again, done. It waits for
//! others and for the disk only as long as the action counts.

use std::sync::Arc;

use tokio::sync::{Mutex, MutexGuard, OwnedSemaphorePermit, Semaphore};

use super::not_done::NotDone;
use super::tap::TappedAction;
use crate::Live;
use crate::engine_link::NoAnswer;
use crate::texts::{HttpError, InvalidTap, Lang};
use crate::view;
use telltale_engine::input::{OperatorAction, Response};
use telltale_engine::model::output::Output;
use telltale_engine::restart::preview::Preview;
use telltale_engine::time::Timestamp;
use telltale_store::VehicleMemory;
use telltale_store::audit::{RECORDED_WITHIN, Record};

/// Operator's actions that may wait for one another and for the disk: pages send three at once.
const PLACES: usize = 8;

/// Actions are done one after the other. A turn is held from the judgement of an action until it is done, and while
/// the vehicle is remembered: what is on the disk never falls behind an action that was written there.
#[derive(Debug)]
pub struct Turns {
    acting: Mutex<()>,
    places: Arc<Semaphore>,
}

impl Default for Turns {
    fn default() -> Turns {
        Turns { acting: Mutex::default(), places: Arc::new(Semaphore::new(PLACES)) }
    }
}

impl Turns {
    /// Waits for a turn. A change of the operator begins before that.
    pub async fn take(&self) -> MutexGuard<'_, ()> {
        self.acting.lock().await
    }

    /// A place among those who wait for a turn, or for the disk; `None` if all are taken.
    fn place(&self) -> Option<OwnedSemaphorePermit> {
        self.places.clone().try_acquire_owned().ok()
    }
}

/// An action that somebody asks for, at a page or elsewhere.
#[derive(Clone, Copy)]
pub struct AskedAction<'a> {
    pub app: &'a Live,
    pub record: &'a Record,
    /// It counts until then.
    pub until: Timestamp,
    /// For a second step: the number of the last STOP before the first. A STOP after that wins.
    pub last_stop: Option<u64>,
    /// The action with the conditions of this moment, or why it does not count now.
    pub judged: &'a (dyn Fn() -> Result<OperatorAction, InvalidTap> + Sync),
    /// Tells the recorder of incidents that it was not done, and why, in both languages.
    pub tell_recorder: &'a (dyn Fn(&str, &str) + Sync),
}

/// Does what a tap asks for, if it counts. It runs to its end also if nobody listens any more: what was done
/// has to be stored.
///
/// # Errors
/// Why nothing has changed. It is in the audit log, or will be.
pub async fn act(tapped: TappedAction) -> Result<(), NotDone> {
    let (app, arrived) = (tapped.tap.app.clone(), tapped.tap.arrived);
    let acting = tokio::spawn(async move {
        let asked = AskedAction {
            app: &tapped.tap.app,
            record: &tapped.record,
            until: tapped.until(),
            last_stop: tapped.validity.last_stop,
            judged: &|| tapped.judged(),
            tell_recorder: &|why, why_de| tapped.tell_recorder(why, why_de),
        };
        match tapped.action {
            OperatorAction::RequestStop => stop(asked).await,
            _ => act_in_turn(asked).await,
        }
    });
    // It ends early only if the whole program does.
    let done = acting.await.unwrap_or(Err(NotDone::HttpError(HttpError::Unavailable)));
    app.action_latency.observe(app.clock.now().since(arrived));
    done
}

/// Writes the action to the disk with the vehicle's state after it, then does it. An action that cannot be
/// written is not done. If the program is killed in between, the action is done after the restart, though
/// nobody was told yet.
///
/// # Errors
/// Why nothing has changed.
pub async fn act_in_turn(asked: AskedAction<'_>) -> Result<(), NotDone> {
    let AskedAction { app, record, until, judged, tell_recorder, .. } = asked;
    if let Err(invalid) = judged() {
        return Err(refused(asked, None, invalid.into()).await);
    }
    let Some(place) = app.turns.place() else {
        let (why, de) = ("too many others waited", "zu viele andere warteten");
        tell_recorder(why, de);
        app.store.note(record.clone().refused(why));
        return Err(NotDone::HttpError(HttpError::Busy));
    };
    let Some(_acting) = app.clock.by(until, app.turns.take()).await else {
        let (why, de) = ("it waited too long for others", "es wartete zu lange auf andere");
        tell_recorder(why, de);
        app.store.note(record.clone().refused(why));
        return Err(NotDone::HttpError(if app.is_storage_ok() {
            HttpError::Busy
        } else {
            HttpError::Storage
        }));
    };
    let preview = match preview(asked).await {
        Ok(preview) => preview,
        Err(not_done) => return Err(refused(asked, None, not_done).await),
    };
    let seq = preview.seq;
    let memory = Some(app.remembering(preview));
    if let Err(error) = app.store.write_ahead(record, memory, until, place).await {
        tell_recorder("it could not be stored", "es konnte nicht gespeichert werden");
        return Err(error.into());
    }
    let Err(not_done) = carry_out(asked).await else { return Ok(()) };
    tracing::warn!("an action was written and is not done");
    let memory = app.memory();
    let memory = VehicleMemory { seq: memory.seq.max(seq), ..memory };
    Err(refused(asked, Some(memory), not_done).await)
}

/// A stop waits for no disk: it is done, then recorded.
async fn stop(asked: AskedAction<'_>) -> Result<(), NotDone> {
    let AskedAction { app, record, .. } = asked;
    if let Err(not_done) = carry_out(asked).await {
        return Err(refused(asked, None, not_done).await);
    }
    let until = app.clock.now() + RECORDED_WITHIN;
    let is_recorded = if let Some(_acting) = app.clock.by(until, app.turns.take()).await {
        app.store.record(record.clone(), Some(app.memory())).await
    } else {
        app.store.note(record.clone());
        false
    };
    if app.published().snapshot.unreached(Output::ManeuverStop).is_some() {
        tracing::error!("a stop was requested and nobody listens");
        return Err(NotDone::HttpError(HttpError::StopNotHeard));
    }
    if !is_recorded {
        tracing::error!("a stop was requested and is not recorded yet");
        return Err(NotDone::HttpError(HttpError::StopNotKept));
    }
    Ok(())
}

/// The vehicle's state after the action, if the engine would grant it and it still counts then.
async fn preview(asked: AskedAction<'_>) -> Result<Preview, NotDone> {
    let preview = asked.app.rehearse((asked.judged)()?).await?.map_err(NotDone::Refused)?;
    // The engine may have taken its time.
    (asked.judged)()?;
    Ok(preview)
}

async fn carry_out(asked: AskedAction<'_>) -> Result<(), NotDone> {
    match asked.app.command((asked.judged)()?, asked.last_stop).await? {
        Response::Done => Ok(()),
        Response::Refused(reasons) => Err(NotDone::Refused(reasons)),
    }
}

/// Records why an action was not done, with the vehicle's state if another one was written.
async fn refused(asked: AskedAction<'_>, memory: Option<VehicleMemory>, not_done: NotDone) -> NotDone {
    let AskedAction { app, record, tell_recorder, .. } = asked;
    let [why, why_de] = Lang::ALL.map(|lang| match &not_done {
        NotDone::Refused(reasons) => view::refusals(&app.published(), lang, reasons).join(" "),
        NotDone::Invalid(invalid) => lang.invalid_tap(*invalid).to_owned(),
        NotDone::HttpError(_) => NoAnswer.to_string(),
    });
    tell_recorder(&why, &why_de);
    app.store.record(record.clone().refused(why), memory).await;
    not_done
}
