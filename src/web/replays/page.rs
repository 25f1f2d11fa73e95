//! The page of a replay: its controls, the states over time, and the screens as they were.

use askama::Template;
use axum::Form;
use axum::extract::rejection::FormRejection;
use axum::extract::{Path, Query, State};
use axum::http::StatusCode;
use axum::response::{Html, IntoResponse, Response};
use serde::Deserialize;

use super::player::{Order, PlayState};
use super::{OpenReplay, of};
use crate::web::AppState;
use crate::web::developer::incidents::content::{Content, Medium};
use crate::web::http::errors::HttpError;
use crate::web::http::guard::SignedIn;
use crate::web::http::respond::{Reader, bad_form, json_answer, refusal};
use crate::web::incidents::{find, story};
use crate::web::view::page::frame::PageFrame;
use crate::web::view::{Lang, html};

#[derive(Template)]
#[template(path = "replay.html")]
struct ReplayHtml {
    frame: PageFrame,
    content: Content,
    state: PlayState,
    /// The screens: the address behind the replay's, and its name.
    screens: [(&'static str, &'static str); 5],
    speeds: [&'static str; 6],
}

/// A moment in the address: milliseconds since 1970, or UTC.
#[derive(Debug, Deserialize)]
pub struct MomentQuery {
    at: Option<String>,
}

/// Orders of the page: one at a time.
#[derive(Debug, Deserialize)]
pub struct ControlForm {
    at_ms: Option<i64>,
    /// `next` or `previous`.
    step: Option<String>,
    /// The speed; 0 pauses.
    play: Option<f64>,
}

/// `GET /replay/{id}?at=TIME`
pub async fn get(
    State(app): State<AppState>,
    Path(id): Path<String>,
    Query(MomentQuery { at }): Query<MomentQuery>,
    SignedIn(session): SignedIn,
    reader: Reader,
) -> Response {
    let incident = match find(&app, &id).await {
        Ok(incident) => incident,
        Err(trouble) => return refusal(&reader, trouble),
    };
    let replay = match of(&app, &incident, &session).await {
        Ok(replay) => replay,
        Err(trouble) => return refusal(&reader, trouble),
    };
    let mut state = *replay.state.borrow();
    if let Some(at_ms) = at.as_deref().and_then(moment_ms) {
        replay.controls.order(Order::GoTo(at_ms));
        state.at_ms = at_ms.clamp(state.from_ms, state.to_ms);
    }
    let read = story(&app, &incident.summary).await;
    let lang = reader.lang;
    let content = Content::of(lang, &incident, &read, Medium::Replay);
    let words = content.words;
    Html(html(&ReplayHtml {
        frame: PageFrame::new(lang, reader.palette),
        screens: [
            ("/", operator_word(lang)),
            ("/developer", words.statuses),
            ("/developer/graph", words.graph),
            ("/developer/masking", words.masking),
            ("/developer/coverage", words.coverage),
        ],
        speeds: ["0.1", "0.5", "1", "2", "5", "20"],
        content,
        state,
    }))
    .into_response()
}

const fn operator_word(lang: Lang) -> &'static str {
    match lang {
        Lang::En => "Operator",
        Lang::De => "Fahrbegleitung",
    }
}

fn moment_ms(text: &str) -> Option<i64> {
    let utc = || humantime::parse_rfc3339_weak(text).ok().map(crate::record::writer::unix_ms);
    text.parse().ok().or_else(utc)
}

/// `GET /replay/{id}/state`
pub async fn state(
    State(app): State<AppState>,
    Path(id): Path<u64>,
    SignedIn(session): SignedIn,
    reader: Reader,
) -> Response {
    match app.replays.find(id, &session, app.clock.now()) {
        Some(replay) => told(&replay),
        None => refusal(&reader, HttpError::NotFound),
    }
}

/// `POST /replay/{id}/state`
pub async fn control(
    State(app): State<AppState>,
    Path(id): Path<u64>,
    SignedIn(session): SignedIn,
    reader: Reader,
    form: Result<Form<ControlForm>, FormRejection>,
) -> Response {
    let form = match form {
        Ok(Form(form)) => form,
        Err(rejection) => return bad_form(&reader, &rejection),
    };
    let Some(replay) = app.replays.find(id, &session, app.clock.now()) else {
        return refusal(&reader, HttpError::NotFound);
    };
    let order = match form {
        ControlForm { at_ms: Some(at_ms), .. } => Order::GoTo(at_ms),
        ControlForm { step: Some(step), .. } if step == "next" => Order::Step { forwards: true },
        ControlForm { step: Some(step), .. } if step == "previous" => Order::Step { forwards: false },
        ControlForm { play: Some(speed), .. } if (0.01..=1000.0).contains(&speed) => Order::Play(speed),
        ControlForm { play: Some(0.0), .. } => Order::Pause,
        _ => return refusal(&reader, HttpError::BadForm),
    };
    replay.controls.order(order);
    told(&replay)
}

fn told(replay: &OpenReplay) -> Response {
    json_answer(StatusCode::OK, &serde_json::json!(*replay.state.borrow()))
}
