//! The page of one vehicle, to read: what it shows, its faults with their causes, its components as tiles, and its log.

use askama::Template;
use axum::extract::Path;
use axum::response::Response;
use serde::Deserialize;
use telltale_clock::unix_ms;
use telltale_engine::module::system::{OTHER_GROUP, SYSTEM_GROUP};
use telltale_engine::state::State as Shows;
use telltale_engine::time::{Span, how_long};
use telltale_fleet::message::VehicleId;
use telltale_web::common::{Asked, PageFrame, Reader, asked_ms};
use telltale_web::texts::console::ConsoleWords;
use telltale_web::texts::{HttpError, IncidentWords, Lang, Words};

use super::history::past;
use super::log::{LogHtml, Reach, log_of, log_until};
use super::page::rendered;
use super::recordings::{IncidentHtml, incidents};
use super::row::{RowHtml, icon, shown};
use super::view::View;
use crate::past::Past;
use crate::state::contact::Contact;
use crate::state::picture::{Picture, Shown};
use crate::state::time;

/// Components of a page, and modules of one that are named; the rest is counted.
const TILES_MAX: usize = 100;
const MODULES_MAX: usize = 40;
/// Faults that are named, and nodes that are named as waiting for one.
const FAULTS_MAX: usize = 50;
const WAITING_MAX: usize = 12;

#[derive(Template)]
#[template(path = "console/vehicle.html")]
struct VehicleHtml {
    frame: PageFrame,
    words: &'static ConsoleWords,
    user: String,
    /// The moment that is shown; `None` shows the present.
    past: Option<PastHtml>,
    state: StateHtml,
    log: LogHtml,
}

struct PastHtml {
    words: &'static IncidentWords,
    at: String,
    /// The addresses of the moments before and after it.
    previous: Option<String>,
    next: Option<String>,
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PageAsked {
    #[serde(default)]
    log: Reach,
    /// A moment of the past.
    at: Option<String>,
}

/// The part that changes each second.
#[derive(Template)]
#[template(path = "console/state.html")]
struct StateHtml {
    words: &'static ConsoleWords,
    id: String,
    frame_id: String,
    hub_down: bool,
    contact: &'static str,
    /// The place of the last message that the log shows.
    noted: String,
    rows: Vec<RowHtml>,
    faults: Vec<FaultHtml>,
    more_faults: Option<String>,
    /// Said where there are none.
    no_faults: &'static str,
    tiles: Vec<TileHtml>,
    no_components: &'static str,
    incidents: Vec<IncidentHtml>,
    more_incidents: Option<String>,
    /// Why these states may not be right.
    doubt: Option<&'static str>,
    /// Of data that are not live.
    age: String,
    /// It is not followed, and has no incidents.
    is_past: bool,
}

struct FaultHtml {
    state: &'static str,
    icon: &'static str,
    title: String,
    node: String,
    waits: String,
    alarm: Option<&'static str>,
}

struct TileHtml {
    name: String,
    state: &'static str,
    reason: &'static str,
    icon: &'static str,
    word: &'static str,
    line: String,
    modules: Vec<ModuleHtml>,
    more: Option<String>,
}

struct ModuleHtml {
    name: String,
    state: &'static str,
    icon: &'static str,
    word: &'static str,
    words: String,
}

/// `GET /vehicles/ID`
pub async fn page(
    view: View,
    Path(id): Path<String>,
    Asked(PageAsked { log, at }): Asked<PageAsked>,
    reader: Reader,
) -> Result<Response, HttpError> {
    let id = VehicleId::new(&id).ok_or(HttpError::NotFound)?;
    let lang = reader.lang;
    let (past, state, log) = match asked_ms(at.as_deref())? {
        Some(at_ms) => {
            let (past, known) = past(&view, &id, at_ms, log.ms()).await?;
            let (log_html, steps) = log_until(&known, &id, at_ms, log, lang);
            let address = |ms| format!("/vehicles/{id}?at={}&log={}", time(ms), log.as_str());
            let [previous, next] = steps.map(|step| step.map(address));
            let html = PastHtml { words: IncidentWords::of(lang), at: time(at_ms), previous, next };
            (Some(html), state_then(&view, &id, &past, lang)?, log_html)
        }
        None => {
            let state = state_of(&view, &id, lang)?;
            view.look(&id).await;
            (None, state, log_of(&view, &id, log, lang).await?)
        }
    };
    let frame = PageFrame::new(lang, reader.palette);
    let (words, user) = (ConsoleWords::of(lang), view.session.user.to_string());
    Ok(rendered(&VehicleHtml { frame, words, user, past, state, log }))
}

/// `GET /vehicles/ID/state`: the part of the page that changes.
pub async fn state(view: View, Path(id): Path<String>, reader: Reader) -> Result<Response, HttpError> {
    let id = VehicleId::new(&id).ok_or(HttpError::NotFound)?;
    let state = state_of(&view, &id, reader.lang)?;
    view.look(&id).await;
    Ok(rendered(&state))
}

fn state_of(view: &View, id: &VehicleId, lang: Lang) -> Result<StateHtml, HttpError> {
    let now_ms = unix_ms(view.console.clock.wall());
    let fleet = view.fleet();
    let vehicle = fleet.vehicle(id)?;
    let row = fleet.row(vehicle, view.console.clock.now());
    let (incidents, more_incidents) = incidents(vehicle, view, lang);
    let shown = shown(&row, lang, now_ms);
    Ok(StateHtml {
        hub_down: fleet.hub_is_down(),
        age: if row.contact == Contact::Live { String::new() } else { shown.age.clone() },
        incidents,
        more_incidents: (more_incidents > 0).then(|| lang.so_many_more(more_incidents)),
        ..StateHtml::of(id, &vehicle.picture, row.contact, shown, lang)
    })
}

/// The state of the vehicle at a moment.
fn state_then(view: &View, id: &VehicleId, past: &Past, lang: Lang) -> Result<StateHtml, HttpError> {
    let words = ConsoleWords::of(lang);
    let row = {
        let fleet = view.fleet();
        past.row(fleet.row(fleet.vehicle(id)?, view.console.clock.now()))
    };
    let is_known = past.contact != Contact::Lost;
    let is_old = |age: &Span| past.contact != Contact::Live && *age >= Span::from_secs(1);
    let age = past.age().filter(is_old);
    let mut shown = shown(&row, lang, past.at_ms);
    shown.age = age.map(|age| lang.before_that(&how_long(age))).unwrap_or_default();
    if !is_known {
        words.not_known.clone_into(&mut shown.word);
    }
    let mut state = StateHtml {
        age: shown.age.clone(),
        is_past: true,
        ..StateHtml::of(id, &past.picture, past.contact, shown, lang)
    };
    if let Some(first) = state.faults.first() {
        (state.rows[0].cause, state.rows[0].node) = (first.title.clone(), first.node.clone());
    }
    state.no_faults = if is_known { words.no_faults } else { words.not_known };
    state.no_components = words.no_keyframe;
    state.doubt = (!is_known && !past.picture.nodes.is_empty()).then_some(words.not_proven);
    Ok(state)
}

impl StateHtml {
    /// Without its incidents, for data that are not old.
    fn of(id: &VehicleId, picture: &Picture, contact: Contact, row: RowHtml, lang: Lang) -> StateHtml {
        let words = ConsoleWords::of(lang);
        let (faults, more) = faults(picture, lang);
        let is_whole = picture.is_whole || picture.nodes.is_empty();
        StateHtml {
            words,
            id: id.to_string(),
            frame_id: telltale_web::assets::url(lang.as_str()),
            hub_down: false,
            contact: contact.as_str(),
            noted: picture.noted_place(),
            rows: vec![row],
            faults,
            more_faults: (more > 0).then(|| lang.so_many_more(more)),
            no_faults: if picture.nodes.is_empty() { words.not_known } else { words.no_faults },
            tiles: tiles(picture, lang),
            no_components: words.no_components,
            incidents: Vec::new(),
            more_incidents: None,
            doubt: (!is_whole).then_some(words.not_whole),
            age: String::new(),
            is_past: false,
        }
    }
}

/// The nodes that are ill themselves, the worst first, and how many more there are.
fn faults(picture: &Picture, lang: Lang) -> (Vec<FaultHtml>, usize) {
    let words = ConsoleWords::of(lang);
    let waiting = picture.waiting();
    let is_ill = |node: &Shown| matches!(node.state, Shows::Error | Shows::Warning | Shows::Unknown);
    // A group shows what its modules show. It is ill itself only if others wait for it.
    let counts = |name: &str| name.contains('/') || waiting.contains_key(name);
    let mut ill: Vec<(&String, &Shown)> =
        picture.nodes.iter().filter(|(name, node)| is_ill(node) && counts(name)).collect();
    let rank = |name: &str, node: &Shown| (node.state, waiting.get(name).map_or(0, Vec::len));
    ill.sort_by_key(|(name, node)| std::cmp::Reverse(rank(name, node)));
    let more = ill.len().saturating_sub(FAULTS_MAX);
    let fault = |(name, node): (&String, &Shown)| {
        let alarm = picture.alarms.values().find(|alarm| alarm.node == *name);
        let waits = waiting.get(name.as_str()).map_or(&[][..], Vec::as_slice);
        let named: Vec<&str> = waits.iter().take(WAITING_MAX).copied().collect();
        FaultHtml {
            state: node.state.as_str(),
            icon: icon(node.state),
            title: if node.words.is_empty() { name.clone() } else { node.words.clone() },
            node: name.clone(),
            waits: if waits.is_empty() {
                String::new()
            } else {
                format!("{} {}", lang.so_many_wait(waits.len()), named.join(", "))
            },
            alarm: alarm.map(|it| if it.acknowledged { words.seen } else { words.unacknowledged }),
        }
    };
    (ill.into_iter().take(FAULTS_MAX).map(fault).collect(), more)
}

/// A tile for each component, with its modules.
fn tiles(picture: &Picture, lang: Lang) -> Vec<TileHtml> {
    let mut groups = picture.groups();
    // Statuses that no group takes, of which there are none.
    groups.retain(|name, (_, modules)| *name != OTHER_GROUP || !modules.is_empty());
    groups
        .into_iter()
        .take(TILES_MAX)
        .map(|(name, (node, modules))| tile(name, node, modules, lang))
        .collect()
}

fn tile(name: &str, node: Option<&Shown>, mut modules: Vec<(&str, &Shown)>, lang: Lang) -> TileHtml {
    let words = Words::of(lang);
    let state = node.map_or(Shows::Unknown, |it| it.state);
    let (reason, icon, word) = look(state, node.and_then(|it| it.cause.as_deref()), lang);
    let ok = modules.iter().filter(|(_, it)| it.state == Shows::Ok).count();
    let counted = modules.iter().filter(|(_, it)| it.state != Shows::Ignore).count();
    let line = match node.and_then(|it| it.cause.clone()) {
        Some(cause) => cause,
        None if counted == 0 => String::new(),
        None => format!("{ok}/{counted} {}", words.ok),
    };
    // Modules of Telltale itself say something of the vehicle only if they are not OK.
    modules.retain(|(_, it)| name != SYSTEM_GROUP || it.state != Shows::Ok);
    modules.sort_by_key(|(_, it)| std::cmp::Reverse((it.state != Shows::Ignore, it.state)));
    let more = modules.len().saturating_sub(MODULES_MAX);
    let module = |(whole, shown): (&str, &Shown)| {
        let (_, icon, word) = look(shown.state, shown.cause.as_deref(), lang);
        let state = shown.state.as_str();
        let name = whole.split_once('/').map_or(whole, |(_, name)| name).to_owned();
        ModuleHtml { name, state, icon, word, words: shown.words.clone() }
    };
    TileHtml {
        name: name.to_owned(),
        state: state.as_str(),
        reason,
        icon,
        word,
        line,
        modules: modules.into_iter().take(MODULES_MAX).map(module).collect(),
        more: (more > 0).then(|| lang.so_many_more(more)),
    }
}

/// The reason for IGNORE, the icon and the word, as on the vehicle's own page.
fn look(state: Shows, cause: Option<&str>, lang: Lang) -> (&'static str, &'static str, &'static str) {
    let words = Words::of(lang);
    match (state, cause) {
        (Shows::Ignore, Some(_)) => ("masked", "masked", words.waiting),
        (Shows::Ignore, None) => ("not_relevant", "idle", words.not_active),
        (state, _) => ("", icon(state), lang.state(state)),
    }
}
