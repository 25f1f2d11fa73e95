//! The page of a replay: its controls, the states over time, and the screens as they were.

use askama::Template;
use axum::extract::{Path, Query, State};
use axum::http::StatusCode;
use axum::http::header::REFRESH;
use axum::response::{Html, IntoResponse, Redirect, Response};
use serde::Deserialize;
use serde_json::json;

use super::missing::MissingTold;
use super::moment::{asks, recorder_holds};
use super::opening::of;
use super::player::{Order, PlayState};
use super::screen::is_page;
use super::{OpenReplay, Subject, subject};
use crate::AppState;
use crate::developer::incidents::content::{Content, Medium};
use crate::http::guard::SignedIn;
use crate::http::respond::{FormOf, Reader, bad_field, json_answer};
use crate::incidents::{Read, find, wall_time};
use crate::texts::{HttpError, IncidentWords, NAME, Words, clean};
use crate::view::html;
use crate::view::page::frame::PageFrame;
use telltale_store::{Incident, Session};

/// The speeds at which a replay can play.
const SPEEDS: std::ops::RangeInclusive<f64> = 0.01..=1000.0;
/// No address of a screen is longer.
const SCREEN_BYTES_MAX: usize = 2000;

#[derive(Template)]
#[template(path = "replay.html")]
struct ReplayHtml {
    frame: PageFrame,
    about: About,
    subject: Subject,
    content: Content,
    state: PlayState,
    /// The note that this was never shown; empty where it was.
    edited: &'static str,
    /// The gaps of the recording.
    missing: Option<MissingTold>,
    /// The topics that the configuration reads and the recording does not have.
    unheard: String,
    /// Why another moment is shown than was asked for; empty if that one is.
    beyond: &'static str,
    /// The shown moment.
    shown: String,
    /// The replay of the same incident by the other configuration, and its name.
    other: Option<(Subject, &'static str)>,
    /// The screens: the address behind the replay's, and its name.
    screens: [(&'static str, &'static str); 7],
    speeds: [&'static str; 6],
    /// The address of the first screen behind the replay's.
    screen: String,
}

/// A moment in the address: milliseconds since 1970, or UTC; and the page that shows it, instead of the operator's.
#[derive(Debug, Deserialize)]
pub struct MomentQuery {
    pub(super) at: Option<String>,
    #[serde(default)]
    pub(super) screen: String,
}

/// Orders of the page: one at a time.
#[derive(Debug, Deserialize)]
pub struct ControlForm {
    at_ms: Option<i64>,
    /// `next` or `previous`.
    step: Option<String>,
    /// The speed; 0 pauses.
    play: Option<f64>,
    /// Only the speed: nothing begins or ends to play.
    speed: Option<f64>,
}

/// The recording of a replay, and the page that it leads back to.
struct About {
    name: String,
    leave: String,
    leave_word: &'static str,
}

/// The name of a recording, for people.
pub(super) fn about_name(app: &AppState, subject: &Subject, it: &'static IncidentWords) -> String {
    match subject {
        Subject::Incident(id) => format!("{} {id}", it.incident),
        Subject::WhatIf(id) => format!("{} {id}, {}", it.incident, it.edited),
        Subject::Recent => it.last_minutes.to_owned(),
        Subject::File(name) => {
            subject::file(app, name).map(|file| clean(&file.name, 2 * NAME)).unwrap_or_default()
        }
    }
}

fn about(app: &AppState, subject: &Subject, it: &'static IncidentWords) -> About {
    let (leave, leave_word) = match subject {
        Subject::Incident(id) => (format!("/incidents/{id}"), it.leave_replay),
        Subject::WhatIf(id) => (format!("/incidents/{id}/what-if"), it.leave_replay),
        Subject::Recent => ("/developer".to_owned(), it.back_to_now),
        Subject::File(name) => {
            (subject::file(app, name).map(|file| file.leave).unwrap_or_default(), it.leave_replay)
        }
    };
    About { name: about_name(app, subject, it), leave, leave_word }
}

/// The incident of the store, where one is replayed, and the replay.
async fn opened(
    app: &AppState,
    subject: &Subject,
    session: &Session,
    at_ms: Option<i64>,
) -> Result<(Option<Incident>, OpenReplay), HttpError> {
    let incident = match subject.incident() {
        Some(id) => Some(find(app, &id.to_string()).await?),
        None => None,
    };
    let replay = of(app, subject, incident.as_ref(), session, at_ms).await?;
    Ok((incident, replay))
}

/// `GET /replay/{id}?at=TIME`
pub async fn get(
    State(app): State<AppState>,
    Path(id): Path<String>,
    Query(MomentQuery { at, screen }): Query<MomentQuery>,
    SignedIn(session): SignedIn,
    reader: Reader,
) -> Result<Response, HttpError> {
    let subject = id.parse::<Subject>()?;
    let at_ms = asked_ms(at.as_deref())?;
    // The recorder goes on: an older link to the last minutes leads to what holds its moment now.
    let holds = |at_ms| {
        let open = app.replays.of_address(&id, &session, app.clock.now());
        open.is_some_and(|open| open.state.borrow().from_ms <= at_ms) || recorder_holds(&app, at_ms)
    };
    if let (Subject::Recent, Some(at_ms)) = (&subject, at_ms.filter(|&at_ms| !holds(at_ms))) {
        return Ok(Redirect::to(&format!("/developer/moment{}", asks(at_ms, &screen))).into_response());
    }
    let (incident, replay) = match opened(&app, &subject, &session, at_ms).await {
        // The page asks again by itself.
        Err(HttpError::Opening) => return Ok(([(REFRESH, "1")], HttpError::Opening).into_response()),
        opened => opened?,
    };
    let mut state = *replay.state.borrow();
    if let Some(at_ms) = at_ms {
        // The address of a moment shows that moment: what plays would leave it at once.
        replay.controls.order(Order::Pause);
        replay.controls.order(Order::GoTo(at_ms));
        state = replay.controls.place().await.unwrap_or(state);
    }
    let lang = reader.lang;
    let incident =
        incident.unwrap_or_else(|| Incident { summary: (*replay.summary).clone(), kept: false, note: None });
    let read = Read::Told(Box::new((*replay.story).clone()));
    let mut content =
        Content::of(lang, &incident, (&read, &telltale_record::proof::Proof::None), Medium::Replay(&id));
    let words = content.words;
    let it = content.it;
    content.first_trigger.insert_str(0, &replay.missing.marks(content.from_ms, content.to_ms));
    let other = match subject {
        Subject::WhatIf(id) => Some((Subject::Incident(id), content.it.as_recorded)),
        Subject::Incident(id) => {
            app.what_ifs.of(&session, id).map(|_| (Subject::WhatIf(id), content.it.as_edited))
        }
        _ => None,
    };
    Ok(Html(html(&ReplayHtml {
        frame: PageFrame::new(lang, reader.palette),
        about: about(&app, &subject, content.it),
        edited: if subject.is_edited() { it.edited } else { "" },
        missing: replay.missing.told(lang, it),
        unheard: replay.missing.unheard(lang),
        beyond: at_ms.map(|at_ms| beyond(it, &replay, at_ms)).unwrap_or_default(),
        shown: wall_time(state.at_ms),
        other,
        screens: [
            ("/", Words::of(lang).operator),
            ("/developer", words.statuses),
            ("/developer/graph", words.graph),
            ("/developer/timeline", words.timeline),
            ("/developer/masking", words.masking),
            ("/developer/coverage", words.coverage),
            ("/developer/topics", words.topics),
        ],
        speeds: ["0.1", "0.5", "1", "2", "5", "20"],
        screen: if is_screen(&screen) { screen } else { "/".to_owned() },
        content,
        state,
        subject,
    }))
    .into_response())
}

/// Whether a screen of the replay has this address. Another one would leave it.
fn is_screen(address: &str) -> bool {
    address.len() <= SCREEN_BYTES_MAX && is_page(address)
}

/// The moment that an address asks for, in milliseconds since 1970; `None` if it asks for none.
pub fn asked_ms(at: Option<&str>) -> Result<Option<i64>, HttpError> {
    let Some(text) = at else { return Ok(None) };
    let utc = || humantime::parse_rfc3339_weak(text).ok().map(telltale_clock::unix_ms);
    text.parse().ok().or_else(utc).map(Some).ok_or(HttpError::BadMoment)
}

/// Why another moment is shown than was asked for; empty if that one is.
pub(super) fn beyond(it: &'static IncidentWords, replay: &OpenReplay, asked_ms: i64) -> &'static str {
    let PlayState { from_ms, to_ms, .. } = *replay.state.borrow();
    // "Now" is a little later than the last step of the last minutes.
    let grace_ms = if replay.subject == Subject::Recent { 1000 } else { 0 };
    if asked_ms > to_ms.saturating_add(grace_ms) {
        it.ends_at
    } else if asked_ms < from_ms {
        it.begins_at
    } else {
        ""
    }
}

/// `GET /replay/{id}/state`
pub async fn state(
    State(app): State<AppState>,
    Path(id): Path<String>,
    SignedIn(session): SignedIn,
) -> Result<Response, HttpError> {
    let replay = app.replays.of_address(&id, &session, app.clock.now()).ok_or(HttpError::NotFound)?;
    Ok(json_answer(StatusCode::OK, &json!(*replay.state.borrow())))
}

/// `POST /replay/{id}/state`
pub async fn control(
    State(app): State<AppState>,
    Path(id): Path<String>,
    SignedIn(session): SignedIn,
    reader: Reader,
    FormOf(form): FormOf<ControlForm>,
) -> Result<Response, HttpError> {
    let replay = app.replays.of_address(&id, &session, app.clock.now()).ok_or(HttpError::NotFound)?;
    let order = match form {
        ControlForm { at_ms: Some(at_ms), .. } => Order::GoTo(at_ms),
        ControlForm { step: Some(step), .. } if step == "next" => Order::Step { forwards: true },
        ControlForm { step: Some(step), .. } if step == "previous" => Order::Step { forwards: false },
        ControlForm { play: Some(speed), .. } if SPEEDS.contains(&speed) => Order::Play(speed),
        ControlForm { speed: Some(speed), .. } if SPEEDS.contains(&speed) => Order::Speed(speed),
        ControlForm { play: Some(0.0), .. } => Order::Pause,
        ControlForm { step: Some(_), .. } => return Ok(bad_field(&reader, "step")),
        ControlForm { play: Some(_), .. } => return Ok(bad_field(&reader, "play")),
        ControlForm { speed: Some(_), .. } => return Ok(bad_field(&reader, "speed")),
        _ => return Ok(bad_field(&reader, "at_ms, step, play, speed")),
    };
    replay.controls.order(order);
    // Else the page would jump back to the place before.
    let place = replay.controls.place().await;
    Ok(json_answer(StatusCode::OK, &json!(place.unwrap_or(*replay.state.borrow()))))
}
