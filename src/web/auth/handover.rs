//! An operator takes the seat of a vehicle that drives: from one of its own displays alone, and every
//! page says so five seconds before. Until then a STOP of both counts.

use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{MissedTickBehavior, interval};

use crate::engine::input::{OperatorAction, Response};
use crate::engine::time::{Span, Timestamp};
use crate::store::Session;
use crate::store::audit::{Action, Record};
use crate::web::AppState;
use crate::web::record::audit::record_of;
use crate::web::view::words::session_end::Farewell;

/// So long before it happens it is said.
const SAID_BEFORE: Span = Span::from_secs(5);
/// It waits no longer than this for others and for the disk once it is due.
const DONE_WITHIN: Span = Span::from_secs(4);
const CHECK_EVERY: Duration = Duration::from_millis(100);

/// A change of the seat that has been said and not happened yet.
#[derive(Debug, Clone)]
pub struct HandOver {
    /// Of the operator who takes the seat.
    session: Session,
    source: IpAddr,
    from: Arc<str>,
    due: Timestamp,
}

impl HandOver {
    /// Who takes the seat.
    pub fn to(&self) -> &str {
        &self.session.user
    }
}

/// The one hand-over that is said, if any is.
#[derive(Debug)]
pub struct HandOvers(watch::Sender<Option<HandOver>>);

/// Takes back what was said, when this is dropped.
#[derive(Debug)]
struct Said(AppState);

impl Default for HandOvers {
    fn default() -> HandOvers {
        HandOvers(watch::channel(None).0)
    }
}

impl HandOvers {
    /// What is said, now and from now on.
    pub fn subscribe(&self) -> watch::Receiver<Option<HandOver>> {
        self.0.subscribe()
    }

    pub fn is_said(&self) -> bool {
        self.0.borrow().is_some()
    }

    /// Whether the operator with this login takes the seat next.
    pub fn is_successor(&self, session: &Session) -> bool {
        self.0.borrow().as_ref().is_some_and(|said| said.session.is(session))
    }
}

/// Announces that the operator with this login takes the seat, and hands it over when that is due.
pub fn begin(app: &AppState, session: &Session, source: IpAddr, from: &str) {
    let due = app.clock.now() + SAID_BEFORE;
    let said = HandOver { session: session.clone(), source, from: from.into(), due };
    app.hand_overs.0.send_replace(Some(said.clone()));
    tokio::spawn(follow(Said(app.clone()), said));
}

async fn follow(told: Said, said: HandOver) {
    let app = &told.0;
    let mut checks = interval(CHECK_EVERY);
    checks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    while app.clock.now() < said.due {
        checks.tick().await;
        if !said.session.is_open() {
            return;
        }
    }
    if let Err(why) = said.take(app).await {
        tracing::warn!(why, "the seat is not handed over");
        app.record(None, said.record().refused(why)).await;
    }
}

impl HandOver {
    fn record(&self) -> Record {
        record_of(&self.session, Action::HandOver, self.source).on(format!("from {}", self.from))
    }

    /// Takes the seat, judged anew: written first, and not done if that takes too long.
    async fn take(&self, app: &AppState) -> Result<(), String> {
        let late = || "it waited too long for others".to_owned();
        let until = self.due + DONE_WITHIN;
        let _seat = app.by(until, app.free_seat()).await.ok_or_else(late)?;
        let _acting = app.by(until, app.acting.lock()).await.ok_or_else(late)?;
        let seated = app.published().snapshot.operator.clone();
        if !self.session.is_open() || seated.is_some_and(|seated| *seated != *self.from) {
            return Err("things have changed".to_owned());
        }
        let action = OperatorAction::Login { name: self.to().into() };
        let foreseen = app.rehearse(action.clone()).await.map_err(|error| error.to_string())?;
        let memory = app.remembering(foreseen.map_err(|reasons| format!("{reasons:?}"))?);
        let taking = app.store.take_over(&self.session, &self.from, memory, self.record(), until);
        let mut taking = Box::pin(taking);
        let Some(taken) = app.by(until, &mut taking).await else {
            app.undo_late(taking, self.record());
            return Err("the disk did not answer in time".to_owned());
        };
        let written = taken.map_err(|error| error.to_string())?;
        let why = match app.command(action).await {
            Ok(Response::Done) => {
                app.farewells.end_all_of(&self.from, Farewell::TakenOver);
                app.store.left(written);
                tracing::info!(user = self.to(), from = &*self.from, "took the vehicle over while it drives");
                return Ok(());
            }
            Ok(Response::Refused(reasons)) => format!("{reasons:?}"),
            Err(error) => error.to_string(),
        };
        let record = self.record().refused(&*why);
        app.store.take_back(written, app.memory(), record).await.map_err(|error| error.to_string())?;
        Err(why)
    }
}

impl Drop for Said {
    fn drop(&mut self) {
        self.0.hand_overs.0.send_replace(None);
    }
}
