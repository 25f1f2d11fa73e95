//! `GET /developer/moment`: every page as it was at a moment, from the best source that still has it.

use std::time::Duration;

use axum::extract::{Query, State};
use axum::response::{IntoResponse, Redirect, Response};

use super::page::{MomentQuery, asked_ms};
use crate::record::recorder::Recorder;
use crate::record::writer::unix_ms;
use crate::store::IncidentFilter;
use crate::web::AppState;
use crate::web::http::errors::HttpError;
use crate::web::http::guard::SignedIn;
use crate::web::http::respond::{Reader, refusal};

/// No recording begins longer before its first trigger.
const PRE_ROLL_MAX_MS: i64 = 3_600_000;
/// Of the history, this much around the moment is shown.
const SPAN_S: i64 = 120;

/// `GET /developer/moment?at=TIME`, TIME in milliseconds since 1970 or UTC, without one now. Leads to the replay of
/// the last minutes, else to that of an incident, else to the timeline, which has states and alarms alone.
pub async fn moment(
    State(app): State<AppState>,
    Query(MomentQuery { at }): Query<MomentQuery>,
    _: SignedIn,
    reader: Reader,
) -> Response {
    let now_ms = unix_ms(app.clock.wall());
    let at_ms = match asked_ms(at.as_deref()) {
        Ok(at_ms) => at_ms.unwrap_or(now_ms).max(0),
        Err(trouble) => return refusal(&reader, trouble),
    };
    let recorder = app.settings.recording.as_ref().map(|state| &state.recorder);
    // Of a moment still to come, the replay says that it ends before.
    if recorder.and_then(|it| held_since_ms(&app, it)).is_some_and(|since_ms| since_ms <= at_ms) {
        return Redirect::to(&format!("/replay/recent?at={at_ms}")).into_response();
    }
    if at_ms > now_ms {
        return refusal(&reader, HttpError::Future);
    }
    let filter = IncidentFilter {
        since_ms: Some(at_ms),
        until_ms: Some(at_ms.saturating_add(PRE_ROLL_MAX_MS)),
        ..IncidentFilter::default()
    };
    let incidents = match app.store.incidents(filter).await {
        Ok(incidents) => incidents,
        Err(error) => return refusal(&reader, error.into()),
    };
    let covers = incidents.iter().find(|incident| {
        let recording = &incident.summary.recording;
        let pre_roll_ms = (recording.pre_roll_s * 1000.0) as i64;
        let from_ms = incident.summary.since_ms.saturating_sub(pre_roll_ms);
        recording.finished && !recording.gone && from_ms <= at_ms
    });
    Redirect::to(&match covers {
        Some(incident) => format!("/replay/{}?at={at_ms}", incident.summary.id),
        None => {
            let (until_ms, place) = around(at_ms, now_ms);
            format!("/developer/timeline?span={SPAN_S}&until={until_ms}&at={place}&unrecorded=1")
        }
    })
    .into_response()
}

/// The end of a span with this moment in its middle, as far as it lies between 1970 and now; and the place of the moment
/// in thousandths of the span. It has to be this very moment.
fn around(at_ms: i64, now_ms: i64) -> (i64, i64) {
    const STEP_MS: i64 = SPAN_S;
    let behind = (now_ms.saturating_sub(at_ms) / STEP_MS).clamp(0, 500).max(1000 - at_ms / STEP_MS);
    (at_ms.saturating_add(behind * STEP_MS), 1000 - behind)
}

/// Since when the recorder holds everything.
fn held_since_ms(app: &AppState, recorder: &Recorder) -> Option<i64> {
    let age = app.clock.now().since(recorder.holds_since()?);
    // Its first millisecond may have begun before.
    Some(unix_ms(app.clock.wall() - Duration::from_nanos(age.as_nanos())).saturating_add(1))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_timeline_shows_the_very_moment_and_nothing_that_is_still_to_come() {
        let now_ms = 1_795_621_444_567;
        for before_ms in [0, 1, 119, 120, 10_001, 59_999, 60_000, 86_400_000, now_ms - 200_000] {
            let at_ms = now_ms - before_ms;
            let (until_ms, place) = around(at_ms, now_ms);
            let from_ms = until_ms - SPAN_S * 1000;
            assert!(until_ms <= now_ms && (500..=1000).contains(&place), "{before_ms}");
            assert_eq!(from_ms + SPAN_S * 1000 * place / 1000, at_ms, "{before_ms}");
        }
        // No span begins before 1970.
        assert_eq!(around(0, now_ms), (120_000, 0));
    }
}
