//! Hands a driving vehicle over to another operator, who is at one of the vehicle's own displays. Every page
//! announces it for five seconds. Until then a STOP of both operators counts.

use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use tokio::sync::watch;
use tokio::time::{MissedTickBehavior, interval};

use crate::Live;
use crate::texts::SessionEnd;
use telltale_engine::input::{OperatorAction, Response};
use telltale_engine::time::{Span, Timestamp};
use telltale_store::Session;
use telltale_store::audit::{Action, Record};

/// The time from the announcement to the hand-over.
const ANNOUNCED_BEFORE: Span = Span::from_secs(5);
/// Once it is due, a hand-over waits no longer than this for others and for the disk.
const DONE_WITHIN: Span = Span::from_secs(4);
const CHECK_EVERY: Duration = Duration::from_millis(100);

/// A change of the operator that is announced and has not happened yet.
#[derive(Debug, Clone)]
pub struct HandOver {
    /// The session of the operator who takes over.
    session: Session,
    source: IpAddr,
    from: Arc<str>,
    due: Timestamp,
}

impl HandOver {
    /// The operator who takes over.
    pub fn to(&self) -> &str {
        &self.session.user
    }
}

/// The one hand-over that is announced, if any is.
#[derive(Debug)]
pub struct HandOvers(watch::Sender<Option<HandOver>>);

/// Withdraws the announcement when it is dropped.
#[derive(Debug)]
struct Announced(Live);

impl Default for HandOvers {
    fn default() -> HandOvers {
        HandOvers(watch::channel(None).0)
    }
}

impl HandOvers {
    /// The announced hand-over, now and whenever it changes.
    pub fn subscribe(&self) -> watch::Receiver<Option<HandOver>> {
        self.0.subscribe()
    }

    pub fn is_announced(&self) -> bool {
        self.0.borrow().is_some()
    }

    /// Whether the operator with this login takes over next.
    pub fn is_successor(&self, session: &Session) -> bool {
        self.0.borrow().as_ref().is_some_and(|announced| announced.session.is(session))
    }
}

/// Announces that the operator with this login takes over, and carries it out when that is due.
pub fn begin(app: &Live, session: &Session, source: IpAddr, from: &str) {
    let due = app.clock.now() + ANNOUNCED_BEFORE;
    let announced = HandOver { session: session.clone(), source, from: from.into(), due };
    app.hand_overs.0.send_replace(Some(announced.clone()));
    tokio::spawn(follow(Announced(app.clone()), announced));
}

async fn follow(told: Announced, announced: HandOver) {
    let app = &told.0;
    let mut checks = interval(CHECK_EVERY);
    checks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    while app.clock.now() < announced.due {
        checks.tick().await;
        if !announced.session.is_open() {
            return;
        }
    }
    if let Err(why) = announced.take(app).await {
        tracing::warn!(why, "the vehicle is not handed over");
        app.store.record(announced.record().refused(why), None).await;
    }
}

impl HandOver {
    fn record(&self) -> Record {
        Record::of_session(&self.session, Action::HandOver, self.source).on(format!("from {}", self.from))
    }

    /// Puts the operator in charge: judged again, written, then done; not done if the disk takes too long.
    async fn take(&self, app: &Live) -> Result<(), String> {
        let late = || "it waited too long for others".to_owned();
        let until = self.due + DONE_WITHIN;
        let _change = app.clock.by(until, app.operator_change.begin()).await.ok_or_else(late)?;
        let _acting = app.clock.by(until, app.turns.take()).await.ok_or_else(late)?;
        let in_charge = app.published().snapshot.operator.clone();
        if !self.session.is_open() || in_charge.is_some_and(|in_charge| *in_charge != *self.from) {
            return Err("things have changed".to_owned());
        }
        let action = OperatorAction::Login { name: self.to().into() };
        let preview = app.rehearse(action.clone()).await.map_err(|error| error.to_string())?;
        let memory = app.remembering(preview.map_err(|reasons| format!("{reasons:?}"))?);
        let taking = app.store.take_over(&self.session, &self.from, memory, self.record(), until);
        let mut taking = Box::pin(taking);
        let Some(taken) = app.clock.by(until, &mut taking).await else {
            app.undo_late(taking, self.record());
            return Err("the disk did not answer in time".to_owned());
        };
        let written = taken.map_err(|error| error.to_string())?;
        let why = match app.command(action, None).await {
            Ok(Response::Done) => {
                app.session_ends.end_all_of(&self.from, SessionEnd::TakenOver);
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

impl Drop for Announced {
    fn drop(&mut self) {
        self.0.hand_overs.0.send_replace(None);
    }
}
