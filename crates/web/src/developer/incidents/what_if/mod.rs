//! The page of a what-if: the configuration to edit, and what it would have changed of an incident or of all that are
//! kept. Nothing of it touches the vehicle.

mod by_click;
mod shown;

use askama::Template;
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::response::{Html, IntoResponse, Redirect, Response};
use serde_json::json;

use self::by_click::{NodeChanges, by_click};
use self::shown::Strips;
pub use self::shown::{First, Row};
use crate::developer::configuration::reread;
use crate::developer::request::PageRequest;
use crate::developer::{DevFrame, Page, frame};
use crate::http::respond::{FormOf, Reader, Speaks, bad_field, json_answer};
use crate::incidents::{Progress, WhatIf, find, recorded_texts, start_what_if};
use crate::texts::{HttpError, IncidentWords, MESSAGE, NAME, clean};
use crate::view::page::frame::PageFrame;
use crate::view::{View, html};
use crate::{AppState, Live};
use telltale_replay::compare::Mistake;
use telltale_runtime::ConfigurationText;
use telltale_store::Incident;

/// The page asks again until everything is run.
const RENEW_MS: u32 = 500;
/// Files of a configuration, and the bytes of all of them.
const FILES_MAX: usize = 64;
const TEXT_BYTES_MAX: usize = 256 * 1024;
/// Differences of meaning that are listed.
const DIFFERENCES: usize = 50;

/// A file of the configuration. Names and texts that are sent back are exact: a soft hyphen or a tab means something.
struct File {
    label: String,
    name: String,
    text: String,
    /// Its height in lines.
    rows: usize,
}

struct MistakeRow {
    place: String,
    line: usize,
    /// The number of its file among the fields.
    file: usize,
    message: String,
    help: String,
}

/// How far it is.
enum Phase {
    /// Nothing was started.
    None,
    Waiting,
    Running(String),
    Wrong,
    Done,
}

#[derive(Template)]
#[template(path = "developer/what_if.html")]
struct WhatIfHtml {
    frame: PageFrame,
    dev: DevFrame,
    it: &'static IncidentWords,
    id: u64,
    causes: Vec<String>,
    files: Vec<File>,
    /// The values that a click may change, and how many nodes have no room.
    changes: Vec<NodeChanges>,
    more_changes: usize,
    is_all: bool,
    phase: Phase,
    /// Nothing differs of what is compared.
    is_same: bool,
    mistakes: Vec<MistakeRow>,
    differences: Vec<String>,
    more_differences: usize,
    has_differences: bool,
    rows: Vec<Row>,
    strips: Option<Strips>,
    is_done: bool,
    /// The first instant of difference in addresses of replays; empty if there is none.
    moment: String,
}

/// `GET /incidents/{id}/what-if?from=recorded|running|proposed&of=ID`; `proposed` is what the history proposes.
pub async fn get(
    State(app): State<AppState>,
    Path(id): Path<String>,
    page: PageRequest,
) -> Result<Response, HttpError> {
    let incident = available(&app, &id).await?;
    let run = app.what_ifs.of(&page.session, incident.summary.id);
    if page.reader.speaks == Speaks::Json {
        let value = run.map_or_else(|| json!({ "progress": "none" }), |run| run.state().json());
        return Ok(json_answer(StatusCode::OK, &value));
    }
    let texts = match (page.query.get("from"), &run) {
        ("running", _) => running(&app).await,
        ("proposed", _) => proposed(&app),
        ("recorded", _) | (_, None) => recorded_texts(&app, &incident.summary).await,
        (_, Some(run)) => run.texts.clone(),
    };
    let texts = if texts.is_empty() { running(&app).await } else { texts };
    Ok(Html(html(&what_if(&page, &incident, &texts, run.as_deref()))).into_response())
}

/// `POST /incidents/{id}/what-if`: `name` and `text` of each file in turn, the main one first, and `over` (`all` for
/// the kept incidents too).
pub async fn post(
    app: Live,
    Path(id): Path<String>,
    page: PageRequest,
    FormOf(fields): FormOf<Vec<(String, String)>>,
) -> Result<Response, HttpError> {
    let reader = &page.reader;
    let texts = match sent(reader, &fields) {
        Ok(texts) => texts,
        Err(refusal) => return Ok(refusal),
    };
    let is_all = fields.iter().any(|(name, value)| name == "over" && value == "all");
    let incident = available(&app, &id).await?;
    start_what_if(&app, &incident, &page.session, texts, is_all).await?;
    Ok(match reader.speaks {
        Speaks::Html => Redirect::to(&format!("/incidents/{id}/what-if")).into_response(),
        Speaks::Json => json_answer(StatusCode::ACCEPTED, &json!({ "progress": "waiting" })),
    })
}

/// The incident, if its recording is whole and something can be run here.
async fn available(app: &AppState, id: &str) -> Result<Incident, HttpError> {
    let incident = find(app, id).await?;
    match () {
        () if app.settings.what_if.is_none() => Err(HttpError::NotFound),
        () if !incident.summary.recording.finished => Err(HttpError::Unfinished),
        () => Ok(incident),
    }
}

/// The files of the running configuration.
async fn running(app: &AppState) -> Vec<ConfigurationText> {
    reread(app, false, None).await.map(|read| read.running.to_vec()).unwrap_or_default()
}

/// The files of the running configuration with what the history proposes; none if it proposes nothing.
fn proposed(app: &AppState) -> Vec<ConfigurationText> {
    let last = app.learning.progress().last;
    last.as_ref().and_then(|it| it.patched()).map(|it| it.texts.clone()).unwrap_or_default()
}

/// The files of a form, the main one first.
///
/// # Errors
/// The refusal: there are none, too many, or too large ones.
#[allow(clippy::result_large_err, reason = "it is sent as it is")]
pub fn sent(reader: &Reader, fields: &[(String, String)]) -> Result<Vec<ConfigurationText>, Response> {
    let of = |key: &'static str| fields.iter().filter(move |(name, _)| name == key).map(|(_, value)| value);
    // Browsers send line ends of two characters.
    let texts: Vec<ConfigurationText> = of("name")
        .zip(of("text"))
        .map(|(name, text)| ConfigurationText { name: name.clone(), text: text.replace("\r\n", "\n") })
        .collect();
    let bytes: usize = texts.iter().map(|it| it.name.len() + it.text.len()).sum();
    match texts.len() {
        1..=FILES_MAX if bytes <= TEXT_BYTES_MAX => Ok(texts),
        1..=FILES_MAX => Err(HttpError::LargeConfiguration.into_response()),
        _ => Err(bad_field(reader, "name, text")),
    }
}

fn what_if(
    page: &PageRequest,
    incident: &Incident,
    texts: &[ConfigurationText],
    run: Option<&WhatIf>,
) -> WhatIfHtml {
    let lang = page.context.lang;
    let it = IncidentWords::of(lang);
    let view = &View::new(&page.published, lang, false);
    let id = incident.summary.id;
    let state = run.map(WhatIf::state);
    let phase = match state.as_ref().map(|state| &state.progress) {
        None => Phase::None,
        Some(Progress::Waiting) => Phase::Waiting,
        Some(Progress::Running) => {
            let (at, count) = state.as_ref().map_or((0, 0), |state| (state.compared.len() + 1, state.count));
            Phase::Running(format!("{at} / {count}"))
        }
        Some(Progress::Wrong(_)) => Phase::Wrong,
        Some(Progress::Done) => Phase::Done,
    };
    let mut dev = DevFrame::new(view, &page.context, Page::Incidents, RENEW_MS);
    dev.fixed = !matches!(phase, Phase::Waiting | Phase::Running(_));
    dev.locked = false;
    dev.title = format!("{} {id}", it.title);
    // The same before and after an answer.
    let rows = if texts.len() == 1 { 16 } else { 10 };
    // The form is not renewed.
    let is_form_shown = !page.context.part.is_content();
    let (changes, more_changes) = if is_form_shown { by_click(texts) } else { Default::default() };
    let file = |it: &ConfigurationText| File {
        label: clean(&it.name, 2 * NAME),
        name: it.name.clone(),
        text: it.text.clone(),
        rows,
    };
    let state = state.as_deref();
    let mistakes = match state.map(|state| &state.progress) {
        Some(Progress::Wrong(mistakes)) => mistakes.iter().map(|mistake| row(mistake, texts)).collect(),
        _ => Vec::new(),
    };
    let differences = state.map(|state| &state.differences[..]).unwrap_or_default();
    let compared = state.map(|state| &state.compared[..]).unwrap_or_default();
    let of = page.query.number("of").unwrap_or(id);
    let chosen = compared.iter().find(|it| it.incident == of);
    let rows_of_incidents: Vec<Row> = compared.iter().map(|it| Row::of(lang, it, of, id)).collect();
    let first = rows_of_incidents.iter().find(|row| row.id == id).and_then(|row| row.first.as_ref());
    let moment = first.map(|first| format!("?at={}", first.at_ms));
    WhatIfHtml {
        frame: frame(&page.context),
        causes: incident.summary.causes().iter().take(3).map(|name| clean(name, 2 * NAME)).collect(),
        files: texts.iter().map(file).collect(),
        changes,
        more_changes,
        is_all: run.is_some_and(|run| run.is_all) || page.query.get("from") == "proposed",
        is_same: compared.iter().all(|it| it.result.as_ref().is_ok_and(|it| !it.differs())),
        mistakes,
        differences: differences.iter().take(DIFFERENCES).map(|text| clean(text, 4 * MESSAGE)).collect(),
        more_differences: differences.len().saturating_sub(DIFFERENCES),
        has_differences: !compared.is_empty(),
        is_done: matches!(phase, Phase::Done),
        moment: moment.unwrap_or_default(),
        rows: rows_of_incidents,
        strips: chosen.and_then(|it| Strips::of(lang, dev.words, it)),
        phase,
        id,
        it,
        dev,
    }
}

fn row(mistake: &Mistake, texts: &[ConfigurationText]) -> MistakeRow {
    MistakeRow {
        place: clean(&mistake.place(), 2 * NAME),
        line: mistake.line.unwrap_or(1),
        file: texts.iter().position(|it| it.name == mistake.file).unwrap_or(0),
        message: clean(&mistake.message, 4 * MESSAGE),
        help: clean(&mistake.help, 4 * MESSAGE),
    }
}
