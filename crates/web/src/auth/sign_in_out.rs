//! Logins and logouts, which also change the operator in charge. Each is judged, written and then done, and
//! waits no longer than a tap.

use std::net::IpAddr;
use std::sync::Arc;

use futures_util::TryFutureExt;
use tokio::sync::{Mutex, MutexGuard, OwnedMutexGuard, oneshot};

use super::expiry::is_in_charge;
use super::handover;
use crate::Live;
use crate::admission::peer::place_of;
use crate::engine_link::NoAnswer;
use crate::texts::SessionEnd;
use telltale_engine::input::{OperatorAction, Refusal, Response as Answer};
use telltale_engine::model::Stage;
use telltale_engine::time::{Span, Timestamp};
use telltale_store::audit::{Action, Record};
use telltale_store::{Caller, Entering, Role, Session, StoreError, Token, VehicleMemory, Verified, Written};

/// Why no session was opened or closed.
#[derive(Debug)]
pub enum NotOpened {
    /// Another operator, with this name, is in charge.
    OtherOperator(String),
    /// The vehicle drives, and the caller is not at one of its displays.
    Drives,
    Refused(Vec<Refusal>),
    /// It cannot be written down.
    Storage,
    /// Too many others wait, or it waited too long for them.
    Busy,
    Unavailable,
}

impl From<StoreError> for NotOpened {
    fn from(error: StoreError) -> NotOpened {
        tracing::error!(%error, "sessions cannot be changed");
        match error {
            error if error.is_of_storage() => NotOpened::Storage,
            _ => NotOpened::Unavailable,
        }
    }
}

impl From<NoAnswer> for NotOpened {
    fn from(error: NoAnswer) -> NotOpened {
        tracing::error!(%error, "nobody can log in or out");
        NotOpened::Unavailable
    }
}

/// A login or a logout waits no longer than this for others and for the disk; then it is not done.
pub const DONE_WITHIN: Span = Span::from_secs(4);
const LATE: &str = "the disk did not answer in time";
const DRIVES: &str = "the vehicle drives, and this is none of its displays";
const DROVE_OFF: &str = "the vehicle has begun to drive";

/// The operator in charge changes for one reason at a time.
#[derive(Debug, Default)]
pub struct OperatorChange {
    change: Mutex<()>,
    /// Held while a change is undone that the disk took too late.
    undoing: Arc<Mutex<()>>,
}

impl OperatorChange {
    /// Locks the operator in charge for a change, once a change that the disk took too late is undone.
    pub async fn begin(&self) -> MutexGuard<'_, ()> {
        let change = self.begin_beside_undoing().await;
        drop(self.undoing.lock().await);
        change
    }

    /// The same without waiting for a change that is undone.
    pub async fn begin_beside_undoing(&self) -> MutexGuard<'_, ()> {
        self.change.lock().await
    }

    /// Held until a change is undone, by the one that has begun it.
    fn undo(&self) -> Option<OwnedMutexGuard<()>> {
        self.undoing.clone().try_lock_owned().ok()
    }
}

/// Opens a session. It runs to its end even if the browser has gone; then the session is ended again,
/// because that browser does not know of it.
///
/// # Errors
/// Why there is none.
pub async fn log_in(app: &Live, attempt: LoginAttempt) -> Result<(Token, Session), NotOpened> {
    let (reply, answer) = oneshot::channel();
    let app = app.clone();
    tokio::spawn(async move {
        let record = attempt.record(Action::SessionEnded).on("nobody waited for the login");
        let opened = attempt.open(&app, || !reply.is_closed()).await;
        if let Err(Ok((_, session))) = reply.send(opened) {
            app.store.end_at_once(&session, record);
        }
    });
    // It ends early only if the whole program does.
    answer.await.unwrap_or(Err(NotOpened::Unavailable))
}

/// Ends a session. It runs to its end even if the browser has gone: a browser that opens another page drops
/// its request, and half a logout would leave a session open with a locked vehicle.
///
/// # Errors
/// Why the session goes on.
pub async fn leave(
    app: &Live,
    session: &Session,
    source: IpAddr,
    action: OperatorAction,
) -> Result<(), NotOpened> {
    let closing = close(app.clone(), session.clone(), source, action);
    tokio::spawn(closing).await.unwrap_or(Err(NotOpened::Unavailable))
}

/// How a vehicle lets a user in.
enum Way {
    Open,
    /// It drives: the operator in charge is told first.
    Announced,
    /// It drives, and the user is not at one of its displays.
    Closed,
}

/// A user who proved the secret and asks for a session.
pub struct LoginAttempt {
    pub user: Verified,
    pub source: IpAddr,
    /// The user confirmed to take over from the operator in charge.
    pub takes_over: bool,
    /// The session that the browser had before, which ends.
    pub before: Option<Session>,
    /// After this the login is not done.
    pub until: Timestamp,
}

impl LoginAttempt {
    /// Opens a session. An operator takes charge, which unlocks the vehicle.
    async fn open(
        self,
        app: &Live,
        is_waited_for: impl Fn() -> bool + Send,
    ) -> Result<(Token, Session), NotOpened> {
        let _change = app.clock.by(self.until, app.operator_change.begin()).await.ok_or(NotOpened::Busy)?;
        let (name, role) = (self.user.name(), self.user.role());
        let in_charge = app.published().snapshot.operator.clone();
        let other = in_charge.filter(|it| role == Role::Operator && **it != *name);
        if let Some(other) = other.as_deref().filter(|_| !self.takes_over) {
            let why = format!("{other} is the operator");
            app.store.record(self.record(Action::Login).refused(why), None).await;
            return Err(NotOpened::OtherOperator(other.to_owned()));
        }
        let way = self.way(app);
        if matches!(way, Way::Closed) {
            app.store.record(self.record(Action::Login).refused(DRIVES), None).await;
            return Err(NotOpened::Drives);
        }
        let announced = if matches!(way, Way::Announced) { other.as_deref() } else { None };
        if announced.is_some() && app.hand_overs.is_announced() {
            return Err(NotOpened::Busy);
        }
        // It ends the session of the operator in charge, so no clearance may come between.
        let acting = match self.ends_operator(app) {
            true => Some(app.clock.by(self.until, app.turns.take()).await.ok_or(NotOpened::Busy)?),
            false => None,
        };
        if let Some(reason) = self.is_refused_logout(app) {
            drop(acting);
            let record = self.record(Action::Login).refused(format!("{:?}", [&reason]));
            app.store.record(record, None).await;
            return Err(NotOpened::Refused(vec![reason]));
        }
        let is_before = |session: &Session| self.before.as_ref().is_some_and(|before| before.is(session));
        let others = || {
            let sessions = app.store.sessions();
            sessions.iter().filter(|session| *session.user == *name && !is_before(session)).count()
        };
        let had = others();
        let (token, written) = match role {
            Role::Operator if announced.is_none() => {
                self.take_charge(app, other.as_deref(), is_waited_for).await?
            }
            _ => {
                let entering = self.entering(app, None, None);
                let records = self.ends().chain([self.record(Action::Login)]).collect();
                self.write(app, entering, records).await?
            }
        };
        // It has happened: from here on nothing can fail.
        let session = app.store.entered(written)?;
        if let ended @ 1.. = (had + 1).saturating_sub(others()) {
            let record = self.record(Action::SessionEnded);
            app.store.note(record.on(format!("{ended} of too many, the oldest")));
        }
        app.session_ends.remember(&session);
        session.used_from(self.source, place_of(self.source));
        if let Some(from) = announced {
            handover::begin(app, &session, self.source, from);
        }
        tracing::info!(user = name, role = role.as_str(), source = %self.source, "logged in");
        Ok((token, session))
    }

    /// The change to write. If a user has too many sessions, the oldest ends, except those of the operator
    /// in charge with an open page.
    fn entering<'a>(
        &'a self,
        app: &Live,
        vehicle: Option<VehicleMemory>,
        from: Option<&'a str>,
    ) -> Entering<'a> {
        let is_driver = app.published().snapshot.operator.as_deref() == Some(self.user.name());
        let mut stay = app.store.sessions();
        stay.retain(|it| is_driver && *it.user == *self.user.name() && app.displays.has(it));
        Entering { user: &self.user, before: self.before.as_ref(), vehicle, from, stay }
    }

    /// How the vehicle lets this user in now.
    fn way(&self, app: &Live) -> Way {
        let snapshot = app.published().snapshot;
        let drives = snapshot.is_under_way();
        let other = snapshot.operator.as_deref().filter(|it| *it != self.user.name());
        // The operator in charge keeps the place between stops too. An empty place is refused only while the vehicle moves: else
        // nobody could release or stop it.
        let is_kept = match snapshot.operator {
            Some(_) => other.is_some() && drives,
            None => snapshot.moves(),
        };
        // At the driver's own display nobody has to be told.
        let is_here = || self.before.as_ref().is_some_and(|before| is_in_charge(before, &snapshot));
        match self.user.role() {
            Role::Operator if is_kept && app.caller(self.source) != Caller::Vehicle => Way::Closed,
            Role::Operator if other.is_some() && drives && !is_here() => Way::Announced,
            _ => Way::Open,
        }
    }

    /// Whether this login is refused as a logout of a driving vehicle's operator would be: another role logs
    /// in in the operator's browser.
    fn is_refused_logout(&self, app: &Live) -> Option<Refusal> {
        let snapshot = app.published().snapshot;
        // It would end the session at once, and the clearance a moment later.
        let may_drive = snapshot.moves() || snapshot.stage == Stage::Cleared;
        (self.ends_operator(app) && may_drive).then_some(Refusal::LogoutWhileActive)
    }

    /// Whether another role logs in in the browser of the operator in charge.
    fn ends_operator(&self, app: &Live) -> bool {
        let snapshot = app.published().snapshot;
        let leaves = self.before.as_ref().is_some_and(|before| is_in_charge(before, &snapshot));
        leaves && self.user.role() != Role::Operator
    }

    /// The record of the end of the browser's earlier session.
    fn ends(&self) -> impl Iterator<Item = Record> {
        let record = |before| Record::of_session(before, Action::SessionEnded, self.source);
        let target = format!("login of {}", self.user.name());
        self.before.as_ref().map(record).map(|record| record.on(target)).into_iter()
    }

    /// Puts an operator in charge. It is written first: while nothing can be written, the operator in charge
    /// stays.
    async fn take_charge(
        &self,
        app: &Live,
        other: Option<&str>,
        is_waited_for: impl Fn() -> bool + Send,
    ) -> Result<(Token, Written), NotOpened> {
        let _acting = app.clock.by(self.until, app.turns.take()).await.ok_or(NotOpened::Busy)?;
        let action = OperatorAction::Login { name: self.user.name().into() };
        let preview = match app.rehearse(action.clone()).await? {
            Ok(preview) => preview,
            Err(reasons) => {
                let record = self.record(Action::Login).refused(format!("{reasons:?}"));
                app.store.record(record, None).await;
                return Err(NotOpened::Refused(reasons));
            }
        };
        if !is_waited_for() {
            app.store.note(self.record(Action::Login).refused("nobody waited for it any more"));
            return Err(NotOpened::Unavailable);
        }
        let hand_over = other.map(|other| self.record(Action::HandOver).on(format!("from {other}")));
        let records = self.ends().chain(hand_over).chain([self.record(Action::Login)]).collect();
        let vehicle = Some(app.remembering(preview));
        let entering = self.entering(app, vehicle, other);
        let (token, written) = self.write(app, entering, records).await?;
        // The vehicle may have been cleared, or have set off, since the login was judged.
        let (why, not_opened) = match self.way(app) {
            Way::Open => match app.command(action, None).await {
                Ok(Answer::Done) => {
                    if let Some(other) = other {
                        app.session_ends.end_all_of(other, SessionEnd::TakenOver);
                    }
                    return Ok((token, written));
                }
                Ok(Answer::Refused(reasons)) => (format!("{reasons:?}"), NotOpened::Refused(reasons)),
                Err(error) => (error.to_string(), error.into()),
            },
            Way::Announced => (DROVE_OFF.to_owned(), NotOpened::Busy),
            Way::Closed => (DROVE_OFF.to_owned(), NotOpened::Drives),
        };
        app.store.take_back(written, app.memory(), self.record(Action::Login).refused(why)).await?;
        Err(not_opened)
    }

    /// Writes a login in time or not at all: a login that the disk takes later is undone.
    async fn write(
        &self,
        app: &Live,
        entering: Entering<'_>,
        records: Vec<Record>,
    ) -> Result<(Token, Written), NotOpened> {
        let mut writing = Box::pin(app.store.enter(entering, records, self.until));
        if let Some(written) = app.clock.by(self.until, &mut writing).await {
            return Ok(written.inspect_err(|error| {
                if matches!(error, StoreError::TooLate) {
                    app.store.note(self.record(Action::Login).refused(LATE));
                }
            })?);
        }
        tracing::error!("the disk does not answer, so nobody is logged in");
        app.undo_late(writing.map_ok(|(_, written)| written), self.record(Action::Login));
        Err(NotOpened::Storage)
    }

    fn record(&self, action: Action) -> Record {
        Record::of(action, self.source.to_string())
            .by(self.user.name(), self.user.role())
            .on(self.user.name())
    }
}

/// Ends a session. The operator in charge logs out at all displays, if the vehicle permits.
async fn close(app: Live, session: Session, source: IpAddr, action: OperatorAction) -> Result<(), NotOpened> {
    let until = app.clock.now() + DONE_WITHIN;
    let _change = app.clock.by(until, app.operator_change.begin()).await.ok_or(NotOpened::Busy)?;
    let record = Record::of_session(&session, Action::Logout, source);
    let not_done = |error: &StoreError| {
        if matches!(error, StoreError::TooLate) {
            app.store.note(record.clone().refused(LATE));
        }
    };
    if !is_in_charge(&session, &app.published().snapshot) {
        // Nothing else follows from it: once the disk has begun with it, it may be done later.
        let ending = app.clock.by(until, app.store.end_session(&session, record.clone(), until)).await;
        return Ok(ending.ok_or(NotOpened::Storage)?.inspect_err(not_done)?);
    }
    let _acting = app.clock.by(until, app.turns.take()).await.ok_or(NotOpened::Busy)?;
    if let Err(reasons) = app.rehearse(action.clone()).await? {
        app.store.record(record.refused(format!("{reasons:?}")), None).await;
        return Err(NotOpened::Refused(reasons));
    }
    // Written first: while nothing can be written, the operator keeps the vehicle and the session.
    let mut leaving = Box::pin(app.store.leave(&session.user, record.clone(), until));
    let Some(leaving) = app.clock.by(until, &mut leaving).await else {
        tracing::error!("the disk does not answer, so nobody is logged out");
        app.undo_late(leaving, record);
        return Err(NotOpened::Storage);
    };
    let leaving = leaving.inspect_err(not_done)?;
    app.session_ends.log_out(&session);
    let (why, not_closed) = match app.command(action, None).await {
        Ok(Answer::Done) => {
            app.store.left(leaving);
            // That the vehicle is locked follows from having no operator, after a restart too.
            if let Err(error) = app.store.remember(app.memory()).await {
                tracing::error!(%error, "the vehicle cannot be remembered");
            }
            return Ok(());
        }
        Ok(Answer::Refused(reasons)) => (format!("{reasons:?}"), NotOpened::Refused(reasons)),
        Err(error) => (error.to_string(), error.into()),
    };
    app.session_ends.stay(&session.user);
    app.store.take_back(leaving, app.memory(), record.refused(why)).await?;
    Err(not_closed)
}

impl Live {
    /// Undoes a change of the operator that is written too late: it was not done. The caller has begun a
    /// change; until the change is undone, nobody else changes the operator.
    pub(crate) fn undo_late(
        &self,
        writing: impl Future<Output = Result<Written, StoreError>> + Send + 'static,
        record: Record,
    ) {
        let (app, undoing) = (self.clone(), self.operator_change.undo());
        let record = record.refused(LATE);
        tokio::spawn(async move {
            let _undoing = undoing;
            let undone = match writing.await {
                Ok(written) => app.store.take_back(written, app.memory(), record.clone()).await,
                Err(error) => Err(error),
            };
            if undone.is_err() {
                app.store.note(record);
            }
        });
    }
}
