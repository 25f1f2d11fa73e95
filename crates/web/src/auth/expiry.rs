//! Ends expired sessions, and locks a vehicle whose operator has no session left.

use std::time::Duration;

use tokio::time::{Interval, MissedTickBehavior, interval};

use crate::texts::SessionEnd;
use crate::{AppState, Live, Source};
use telltale_engine::input::{OperatorAction, Response};
use telltale_engine::snapshot::Snapshot;
use telltale_engine::time::{Span, Timestamp};
use telltale_store::audit::{Action, Record, TELLTALE};
use telltale_store::{Role, Session, SessionKind, Token};

const CHECK_EVERY: Duration = Duration::from_millis(500);

/// The stored time of a developer's last action lags by at most this.
const NOTE_USE_EVERY: Duration = Duration::from_secs(60);

/// A developer's session ends after this long without an action. An operator's work is to watch, so an
/// operator's session never ends for that.
pub const DEVELOPER_IDLE_MAX: Span = Span::from_secs(15 * 60);

/// Whether a session is over because its holder was idle for too long.
pub fn has_idled_out(session: &Session, now: Timestamp) -> bool {
    idles_out(session) && session.idle(now) >= DEVELOPER_IDLE_MAX
}

/// Whether this is a session of the operator in charge.
pub fn is_in_charge(session: &Session, snapshot: &Snapshot) -> bool {
    session.role == Role::Operator && snapshot.operator.as_deref() == Some(&*session.user)
}

fn idles_out(session: &Session) -> bool {
    session.role == Role::Developer && session.kind == SessionKind::Person
}

impl AppState {
    /// The session of a token, unless it has expired.
    pub fn session(&self, token: &Token) -> Option<Session> {
        self.store.session(token).filter(|session| !self.has_expired(session))
    }

    /// Whether a session has expired. That of a vehicle's operator does not while it is under way: the page has STOP.
    pub fn has_expired(&self, session: &Session) -> bool {
        if has_idled_out(session, self.clock.now()) {
            return true;
        }
        session.expires <= self.clock.now() && !self.is_under_way(session)
    }

    /// Whether this is a session of the operator of a vehicle that is under way. A recording says nothing about the
    /// sessions of its readers.
    fn is_under_way(&self, session: &Session) -> bool {
        let Source::Live(link) = &self.source else { return false };
        let published = link.snapshots.borrow();
        published.snapshot.is_under_way() && is_in_charge(session, &published.snapshot)
    }

    /// Why a session that has expired did so.
    pub fn overdue(&self, session: &Session) -> SessionEnd {
        if has_idled_out(session, self.clock.now()) { SessionEnd::Idle } else { SessionEnd::Expired }
    }
}

/// Runs as long as the server. Sessions end in memory first, so none of this waits for the disk.
pub async fn watch(app: Live) {
    tokio::join!(end_overdue(&app), lock_empty(&app), note_use(&app));
}

fn checks() -> Interval {
    let mut checks = interval(CHECK_EVERY);
    checks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    checks
}

async fn end_overdue(app: &Live) {
    let mut checks = checks();
    loop {
        checks.tick().await;
        for session in app.store.sessions().iter().filter(|session| app.has_expired(session)) {
            let why = match session.kind {
                SessionKind::Program => "token expired",
                SessionKind::Person if has_idled_out(session, app.clock.now()) => "idle",
                SessionKind::Person => "expired",
            };
            app.session_ends.end(session, app.overdue(session));
            let record = Record::of(Action::SessionEnded, TELLTALE).on(why);
            app.store.end_at_once(session, record.by(&*session.user, session.role));
        }
    }
}

async fn lock_empty(app: &Live) {
    let mut checks = checks();
    loop {
        checks.tick().await;
        lock_if_empty(app).await;
    }
}

/// Locks a vehicle whose operator has no session any more. If the engine does not answer or refuses, the
/// next check tries again.
async fn lock_if_empty(app: &Live) {
    let _change = app.operator_change.begin_beside_undoing().await;
    let snapshot = app.published().snapshot;
    // A vehicle that drives keeps its operator; the engine would refuse anyway.
    let Some(operator) = snapshot.operator.as_deref().filter(|_| !snapshot.drives()) else {
        return;
    };
    let is_empty = !app.store.sessions().iter().any(|session| is_in_charge(session, &snapshot));
    if is_empty && matches!(app.command(OperatorAction::Logout, None).await, Ok(Response::Done)) {
        tracing::info!("the operator has no session any more: the vehicle is locked");
        let record = Record::of(Action::Logout, TELLTALE).by(operator, Role::Operator);
        app.store.note(record.on("no session any more"));
    }
}

/// Stores the last activity of developers, so that a restart gives nobody another quarter of an hour.
async fn note_use(app: &Live) {
    let mut checks = interval(NOTE_USE_EVERY);
    checks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut noted = app.clock.now();
    loop {
        checks.tick().await;
        let now = app.clock.now();
        let mut used = app.store.sessions();
        used.retain(|session| idles_out(session) && session.idle(now) <= now.since(noted));
        if used.is_empty() {
            continue;
        }
        match app.store.note_used(used).await {
            Ok(()) => noted = now,
            Err(error) => tracing::error!(%error, "the use of sessions cannot be written yet"),
        }
    }
}
