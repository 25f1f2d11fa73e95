//! Ends sessions that are over, and locks a vehicle whose operator has none any more.

use std::time::Duration;

use tokio::time::{MissedTickBehavior, interval};

use super::state::{AppState, is_seated};
use crate::engine::input::{OperatorAction, Response};
use crate::engine::model::Stage;
use crate::engine::time::{Span, Timestamp};
use crate::store::audit::{Action, Record, TELLTALE};
use crate::store::{Role, Session, SessionKind, StoreError};

const CHECK_EVERY: Duration = Duration::from_millis(500);

/// A developer who does nothing for this long has gone away from an open page. An operator's work
/// is to watch, so the display in the vehicle never ends for that.
pub const DEVELOPER_IDLE_MAX: Span = Span::from_secs(15 * 60);

/// Whether a session is over because its holder does nothing.
pub fn has_idled_out(session: &Session, now: Timestamp) -> bool {
    session.role == Role::Developer
        && session.kind == SessionKind::Person
        && session.idle(now) >= DEVELOPER_IDLE_MAX
}

/// Runs for as long as the server does.
pub async fn watch(app: AppState) {
    let mut checks = interval(CHECK_EVERY);
    checks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let mut failing = false;
    loop {
        checks.tick().await;
        let checked = check(&app).await;
        if let Err(error) = &checked
            && !failing
        {
            tracing::error!(%error, "sessions that are over cannot be ended");
        }
        failing = checked.is_err();
    }
}

async fn check(app: &AppState) -> Result<(), StoreError> {
    app.audit_omitted().await;
    for session in app.store.sessions() {
        if session.kind == SessionKind::Person && app.has_expired(&session) {
            let why = if has_idled_out(&session, app.clock.now()) { "idle" } else { "expired" };
            app.farewells.end(&session, app.overdue(&session));
            let record = Record::of(Action::SessionEnded, TELLTALE).on(why);
            app.store.end_session(&session, record.by(&*session.user, session.role)).await?;
        }
    }
    let _seat = app.seat.lock().await;
    let snapshot = app.published().snapshot;
    // A vehicle that drives keeps its operator; the engine would refuse anyway.
    let Some(operator) = snapshot.operator.as_deref().filter(|_| snapshot.stage != Stage::Active) else {
        return Ok(());
    };
    if !app.store.sessions().iter().any(|session| is_seated(session, &snapshot)) {
        // An engine that does not answer, or refuses, is asked again at the next check.
        if !matches!(app.rehearse(OperatorAction::Logout).await, Ok(Ok(_))) {
            return Ok(());
        }
        tracing::info!("the operator has no session any more: the vehicle is locked");
        let record = Record::of(Action::Logout, TELLTALE).by(operator, Role::Operator);
        let record = record.on("no session any more");
        let _owed = app.acting.lock().await;
        let written = app.store.leave(operator, record.clone()).await?;
        match app.command(OperatorAction::Logout).await {
            Ok(Response::Done) => app.store.left().await?,
            other => {
                let why = format!("the engine answered {other:?}");
                app.store.take_back(written, app.memory(), record.refused(why)).await?;
            }
        }
    }
    Ok(())
}
