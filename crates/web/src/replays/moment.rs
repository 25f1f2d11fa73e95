//! `GET /developer/moment`: every page as it was at a moment, from the best source that still has it.

use std::time::Duration;

use axum::extract::{Query, State};
use axum::response::Redirect;

use super::page::{MomentQuery, asked_ms};
use crate::AppState;
use crate::developer::address;
use crate::http::guard::SignedIn;
use crate::texts::HttpError;
use telltale_clock::unix_ms;
use telltale_record::recorder::Recorder;
use telltale_store::IncidentFilter;

/// No recording begins longer before its first trigger.
const PRE_ROLL_MAX_MS: i64 = 3_600_000;
/// Of the history, this much around the moment is shown.
const SPAN_S: i64 = 120;

/// `GET /developer/moment?at=TIME`, TIME in milliseconds since 1970 or UTC, without one now. Leads to the replay of
/// the last minutes, else to that of an incident, else to the timeline, which has states and alarms alone. With
/// `&screen=ADDRESS` a replay shows that page first.
pub async fn moment(
    State(app): State<AppState>,
    Query(MomentQuery { at, screen }): Query<MomentQuery>,
    _: SignedIn,
) -> Result<Redirect, HttpError> {
    let now_ms = unix_ms(app.clock.wall());
    let at_ms = asked_ms(at.as_deref())?.unwrap_or(now_ms).max(0);
    // Of a moment still to come, the replay says that it ends before.
    if recorder_holds(&app, at_ms) {
        return Ok(Redirect::to(&format!("/replay/recent{}", asks(at_ms, &screen))));
    }
    if at_ms > now_ms {
        return Err(HttpError::Future);
    }
    let filter = IncidentFilter {
        since_ms: Some(at_ms),
        until_ms: Some(at_ms.saturating_add(PRE_ROLL_MAX_MS)),
        ..IncidentFilter::default()
    };
    let incidents = app.store.incidents(filter).await.map_err(HttpError::from)?;
    let covers = incidents.iter().find(|incident| {
        let recording = &incident.summary.recording;
        let pre_roll_ms = (recording.pre_roll_s * 1000.0) as i64;
        let from_ms = incident.summary.since_ms.saturating_sub(pre_roll_ms);
        recording.finished && !recording.gone && from_ms <= at_ms
    });
    Ok(Redirect::to(&match covers {
        Some(incident) => format!("/replay/{}{}", incident.summary.id, asks(at_ms, &screen)),
        None => {
            let until_ms = at_ms.saturating_add(SPAN_S * 500).min(now_ms);
            format!("/developer/timeline?span={SPAN_S}&until={until_ms}&at={at_ms}&unrecorded=1")
        }
    }))
}

/// Whether the recorder's last minutes begin before.
pub(super) fn recorder_holds(app: &AppState, at_ms: i64) -> bool {
    let recorder = app.settings.recording.as_ref().map(|state| &state.recorder);
    recorder.and_then(|it| held_since_ms(app, it)).is_some_and(|since_ms| since_ms <= at_ms)
}

pub(super) fn asks(at_ms: i64, screen: &str) -> String {
    address([("at", &*at_ms.to_string()), ("screen", screen)].into_iter())
}

/// Since when the recorder holds everything.
fn held_since_ms(app: &AppState, recorder: &Recorder) -> Option<i64> {
    let age = app.clock.now().since(recorder.holds_since()?);
    // Its first millisecond may have begun before.
    Some(unix_ms(app.clock.wall() - Duration::from(age)).saturating_add(1))
}
