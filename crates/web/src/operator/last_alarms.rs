//! The last alarms of the shift, for the operator who asks what has just beeped.

use axum::extract::State;
use axum::response::Html;

use crate::AppState;
use crate::http::respond::Reader;
use crate::texts::HttpError;
use crate::view;

/// As many as a person looks through.
const SHOWN: u32 = 10;

/// `GET /alarms/last`: a part of the operator's page.
pub async fn get(State(app): State<AppState>, reader: Reader) -> Result<Html<String>, HttpError> {
    let published = app.published();
    let alarms = app.past(&published, |history| history.last_alarms(SHOWN)).await?;
    Ok(Html(view::last_alarms(&published, reader.lang, &alarms)))
}
