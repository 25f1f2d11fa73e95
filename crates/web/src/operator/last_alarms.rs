//! The last alarms of the shift, for the operator who asks what has just beeped.

use axum::extract::State;
use axum::response::{Html, IntoResponse as _, Response};

use crate::AppState;
use crate::http::respond::{Reader, refusal};
use crate::view;

/// As many as a person looks through.
const SHOWN: u32 = 10;

/// `GET /alarms/last`: a part of the operator's page.
pub async fn get(State(app): State<AppState>, reader: Reader) -> Response {
    let published = app.published();
    match app.past(&published, |history| history.last_alarms(SHOWN)).await {
        Ok(alarms) => Html(view::last_alarms(&published, reader.lang, &alarms)).into_response(),
        Err(error) => refusal(&reader, error),
    }
}
