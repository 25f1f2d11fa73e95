//! Ends sessions that are over, and locks a vehicle whose operator has none any more.

use std::time::Duration;

use tokio::time::{MissedTickBehavior, interval};

use super::state::{AppState, is_seated};
use crate::engine::input::OperatorAction;
use crate::engine::model::Stage;
use crate::store::StoreError;

const CHECK_EVERY: Duration = Duration::from_millis(500);

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
    for session in app.store.sessions() {
        if app.has_expired(&session) {
            app.store.end_session(&session).await?;
        }
    }
    let snapshot = app.published().snapshot;
    // A vehicle that drives keeps its operator; the engine would refuse anyway.
    if snapshot.operator.is_none() || snapshot.stage == Stage::Active {
        return Ok(());
    }
    if !app.store.sessions().iter().any(|session| is_seated(session, &snapshot)) {
        tracing::info!("the operator has no session any more: the vehicle is locked");
        // An engine that does not answer is asked again at the next check.
        if app.command(OperatorAction::Logout).await.is_ok() {
            app.store.leave_seat().await?;
        }
    }
    Ok(())
}
