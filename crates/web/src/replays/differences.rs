//! `GET /replay/{id}/differences`: two moments of a replay side by side, with what differs.

use askama::Template;
use axum::extract::{Path, Query, State};
use axum::http::StatusCode;
use axum::response::{Html, IntoResponse, Response};
use serde::Deserialize;
use serde_json::json;

use super::Subject;
use super::missing::MissingTold;
use super::page::{about_name, asked_ms, beyond};
use crate::AppState;
use crate::developer::incidents::content::broken;
use crate::developer::incidents::sentences::{stage_word, state_word};
use crate::http::guard::SignedIn;
use crate::http::respond::{Reader, Speaks, json_answer};
use crate::incidents::wall_time;
use crate::texts::{DevWords, HttpError, IncidentWords, Lang, MESSAGE, NAME, VALUE, clean};
use crate::view::html;
use crate::view::page::frame::PageFrame;
use telltale_replay::difference::{Differences, Fact, NodeChange, NodeThen, VehicleChange};

/// Two moments: milliseconds since 1970, or UTC.
#[derive(Debug, Deserialize)]
pub struct TwoMoments {
    a: Option<String>,
    b: Option<String>,
}

struct Moment {
    address: String,
    at: String,
    /// Why it is another one than was asked for; empty if it is that one.
    beyond: &'static str,
}

struct Then {
    state: &'static str,
    word: &'static str,
    /// The node that masks it, or its own state behind that.
    because: String,
    message: String,
}

struct Row {
    name: String,
    /// The name as HTML, with places where its line may break.
    broken: String,
    /// At both moments.
    thens: [Option<Then>; 2],
    values: Vec<(String, String, String)>,
}

#[derive(Template)]
#[template(path = "replay_differences.html")]
struct DifferencesHtml {
    frame: PageFrame,
    it: &'static IncidentWords,
    name: String,
    subject: Subject,
    /// The note that this was never shown; empty where it was.
    edited: &'static str,
    missing: Option<MissingTold>,
    /// When the earlier one of them was, in milliseconds since 1970.
    from_ms: i64,
    moments: [Moment; 2],
    back: String,
    is_same: bool,
    vehicle: Vec<(String, String, String)>,
    rows: Vec<Row>,
    more: Option<String>,
    only_values: usize,
    valued: Vec<Row>,
    valued_more: Option<String>,
    /// For the buttons of the tables.
    export: &'static DevWords,
}

/// `GET /replay/{id}/differences?a=TIME&b=TIME`
pub async fn differences(
    State(app): State<AppState>,
    Path(id): Path<String>,
    Query(TwoMoments { a, b }): Query<TwoMoments>,
    SignedIn(session): SignedIn,
    reader: Reader,
) -> Result<Response, HttpError> {
    let replay = app.replays.of_address(&id, &session, app.clock.now()).ok_or(HttpError::NotFound)?;
    let (Ok(Some(a)), Ok(Some(b))) = (asked_ms(a.as_deref()), asked_ms(b.as_deref())) else {
        return Err(HttpError::BadMoment);
    };
    let (Some(first), Some(second)) = (replay.controls.look(a).await, replay.controls.look(b).await) else {
        return Err(HttpError::Unavailable);
    };
    let found = Differences::between(&first.snapshot, &second.snapshot);
    if reader.speaks == Speaks::Json {
        let answer = json!({ "first_ms": first.at_ms, "second_ms": second.at_ms, "differences": found });
        return Ok(json_answer(StatusCode::OK, &answer));
    }
    let lang = reader.lang;
    let (it, words) = (IncidentWords::of(lang), DevWords::of(lang));
    let moment = |at_ms: i64, asked_ms: i64| {
        let beyond = beyond(it, &replay, asked_ms);
        Moment { address: format!("/replay/{id}?at={at_ms}"), at: wall_time(at_ms), beyond }
    };
    let moments = [moment(first.at_ms, a), moment(second.at_ms, b)];
    Ok(Html(html(&DifferencesHtml {
        frame: PageFrame::new(lang, reader.palette),
        name: about_name(&app, &replay.subject, it),
        subject: replay.subject.clone(),
        edited: if replay.subject.is_edited() { it.edited } else { "" },
        missing: replay.missing.told(lang, it),
        back: moments[1].address.clone(),
        from_ms: first.at_ms.min(second.at_ms),
        moments,
        is_same: found.vehicle.is_empty() && found.nodes.is_empty(),
        vehicle: found.vehicle.iter().map(|change| fact(lang, it, words, change)).collect(),
        rows: found.nodes.iter().map(|node| row(lang, node)).collect(),
        more: (found.more_nodes > 0).then(|| lang.and_more(found.more_nodes)),
        only_values: found.only_values,
        valued: found.valued.iter().map(|node| row(lang, node)).collect(),
        valued_more: (found.only_values > found.valued.len())
            .then(|| lang.and_more(found.only_values - found.valued.len())),
        export: words,
        it,
    }))
    .into_response())
}

fn fact(
    lang: Lang,
    it: &'static IncidentWords,
    words: &'static DevWords,
    change: &VehicleChange,
) -> (String, String, String) {
    let name = match change.what {
        Fact::Stage => words.stage.to_owned(),
        Fact::Overall => it.fact_overall.to_owned(),
        Fact::SpeedKmh => it.vehicle_speed.to_owned(),
        Fact::Roots => it.fact_roots.to_owned(),
        Fact::Requests => it.fact_requests.to_owned(),
        Fact::Signal => format!("{} {}", words.signal, clean(&change.name, NAME)),
    };
    let value = |text: &str| match change.what {
        Fact::Stage => stage_word(lang, text).to_owned(),
        Fact::Overall => state_word(lang, text).to_owned(),
        _ => clean(text, MESSAGE),
    };
    (name, value(&change.first), value(&change.second))
}

fn row(lang: Lang, change: &NodeChange) -> Row {
    let then = |then: &NodeThen| {
        let because = if !then.masked_by.is_empty() {
            format!("{}, \u{2190} {}", state_word(lang, then.own), clean(&then.masked_by.join(", "), MESSAGE))
        } else if then.own != then.shown {
            state_word(lang, then.own).to_owned()
        } else {
            String::new()
        };
        let (state, word) = (then.shown, state_word(lang, then.shown));
        Then { state, word, because, message: clean(&then.message, MESSAGE) }
    };
    let value = |value: &Option<String>| value.as_deref().map(|it| clean(it, VALUE)).unwrap_or_default();
    Row {
        name: clean(&change.node, 2 * NAME),
        broken: broken(&change.node),
        thens: [change.first.as_ref().map(then), change.second.as_ref().map(then)],
        values: change
            .values
            .iter()
            .map(|it| (clean(&it.name, VALUE), value(&it.first), value(&it.second)))
            .collect(),
    }
}
