//! The page of one incident: what happened, the states of the nodes concerned, the values at the first instant, and
//! the recording.

use askama::Template;
use axum::extract::{Path, Request, State};
use axum::response::{Html, IntoResponse, Response};

use super::list::{flags, length};
use super::words::IncidentWords;
use crate::engine::event::Said;
use crate::engine::model::Stage;
use crate::engine::state::State as NodeState;
use crate::engine::view::record::Stretch;
use crate::picture::bars::patterns;
use crate::picture::strips::{Axis, recorded, stamp};
use crate::record::retention::size;
use crate::record::story::{Happened, NodeStrip, Period, Story};
use crate::store::{Incident, Role};
use crate::web::AppState;
use crate::web::developer::request::PageRequest;
use crate::web::developer::timeline::strips::Painter;
use crate::web::developer::timeline::{Tick, ticks};
use crate::web::developer::{DevFrame, Page, frame, why_address};
use crate::web::http::respond::refusal;
use crate::web::incidents::{Read, download, find, story, wall_time};
use crate::web::view::page::frame::PageFrame;
use crate::web::view::text::{MESSAGE, NAME, VALUE, clean, clean_lines};
use crate::web::view::{Lang, View, html};

/// Parts of a damaged file that are named.
const LEFT_OUT: usize = 5;
const RENEW_MS: u32 = 2000;

struct MomentRow {
    at: String,
    /// Seconds after the first trigger.
    after: String,
    state: String,
    text: String,
}

struct Lane {
    name: String,
    why: String,
    bars: String,
}

struct FrozenRow {
    node: String,
    why: String,
    state: String,
    word: String,
    message: String,
    values: Vec<(String, String)>,
}

struct TopicRow {
    topic: String,
    type_name: String,
    seconds: String,
    messages: u64,
    size: String,
}

#[derive(Template)]
#[template(path = "developer/incident.html")]
struct OneHtml {
    frame: PageFrame,
    dev: DevFrame,
    it: &'static IncidentWords,
    id: u64,
    causes: Vec<(String, String)>,
    since: String,
    length: String,
    stage: &'static str,
    kinds: String,
    flags: Vec<&'static str>,
    /// May write a note and keep it.
    may_change: bool,
    kept: bool,
    note: String,
    note_by: String,
    has_file: bool,
    size: String,
    pre_roll_s: String,
    messages: u64,
    missing: u64,
    sha256: String,
    version: String,
    configuration: String,
    troubles: Vec<String>,
    moments: Vec<MomentRow>,
    more_moments: u64,
    patterns: String,
    stage_bars: String,
    lanes: Vec<Lane>,
    ticks: Vec<Tick>,
    frozen: Vec<FrozenRow>,
    topics: Vec<TopicRow>,
}

/// `GET /incidents/{id}`, and `GET /incidents/{id}.mcap` for its recording.
pub async fn get(
    State(app): State<AppState>,
    Path(id): Path<String>,
    page: PageRequest,
    request: Request,
) -> Response {
    if let Some(id) = id.strip_suffix(".mcap") {
        return download(&app, id, page.reader, request).await;
    }
    let incident = match find(&app, &id).await {
        Ok(incident) => incident,
        Err(trouble) => return refusal(&page.reader, trouble),
    };
    let read = story(&app, &incident.summary).await;
    Html(html(&one(&page, &incident, read))).into_response()
}

fn one(page: &PageRequest, incident: &Incident, read: Read) -> OneHtml {
    let lang = page.context.lang;
    let it = IncidentWords::of(lang);
    let view = &View::new(&page.published, lang, false);
    let summary = &incident.summary;
    let recording = &summary.recording;
    let mut dev = DevFrame::new(view, &page.context, Page::Incidents, RENEW_MS);
    // It does not change any more; and it is shown while the vehicle is locked, as its recording can be downloaded.
    dev.fixed = summary.until_ms.is_some();
    dev.locked = false;
    dev.title = format!("{} {}", it.incident, summary.id);
    let troubles = troubles(it, &read);
    let has_file = recording.finished && !matches!(read, Read::Missing);
    let story = match read {
        Read::Told(story) => *story,
        _ => Story::default(),
    };
    let mut kinds: Vec<&str> = summary.triggers.iter().map(|trigger| it.kind(&trigger.kind)).collect();
    kinds.sort_unstable();
    kinds.dedup();
    let axis = Axis { from: stamp(story.from_ms), to: stamp(story.to_ms), left: 0.0, width: 100.0 };
    let painter = Painter { lang, words: dev.words, axis };
    let named = |name: &&str| (clean(name, 2 * NAME), why_address(name));
    let note = incident.note.as_ref();
    OneHtml {
        frame: frame(&page.context),
        id: summary.id,
        causes: summary.causes().iter().map(named).collect(),
        since: wall_time(summary.since_ms),
        length: length(incident),
        stage: stage_word(lang, &summary.stage),
        kinds: clean(&kinds.join(", "), MESSAGE),
        flags: flags(it, incident),
        may_change: page.context.role == Role::Developer,
        kept: incident.kept,
        note: note.map(|note| clean_lines(&note.text)).unwrap_or_default(),
        note_by: note.map(|note| clean(&note.by, NAME)).unwrap_or_default(),
        has_file,
        size: size(recording.bytes),
        pre_roll_s: format!("{:.1} s", recording.pre_roll_s),
        messages: recording.messages,
        missing: recording.missing.max(story.lost),
        sha256: clean(recording.sha256.as_deref().unwrap_or_default(), MESSAGE),
        version: clean(&summary.version, NAME),
        configuration: clean(&summary.configuration, MESSAGE),
        troubles,
        moments: moments(lang, it, &story, summary.since_ms),
        more_moments: story.more_moments,
        patterns: patterns("p-", |paint| format!("class=\"p-{paint}\"")),
        stage_bars: story.stages.iter().filter_map(|period| stage_bar(&painter, period)).collect(),
        lanes: story.strips.iter().map(|strip| lane(&painter, strip)).collect(),
        ticks: if story.strips.is_empty() { Vec::new() } else { ticks(axis) },
        frozen: frozen(lang, incident),
        topics: topics(&story),
        it,
        dev,
    }
}

fn troubles(it: &IncidentWords, read: &Read) -> Vec<String> {
    let story = match read {
        Read::Told(story) => story,
        Read::Missing => return vec![it.no_file.to_owned()],
        Read::Busy => return vec![it.busy.to_owned()],
        Read::Bad(why) => return vec![format!("{}: {}", it.bad_file, clean(why, MESSAGE))],
    };
    let mut troubles = Vec::new();
    if !story.complete {
        troubles.push(it.incomplete.to_owned());
    }
    if story.cut {
        troubles.push(it.cut.to_owned());
    }
    if !story.left_out.is_empty() && story.complete {
        let parts: Vec<String> =
            story.left_out.iter().take(LEFT_OUT).map(|part| clean(part, MESSAGE)).collect();
        troubles.push(format!("{}: {}", it.left_out, parts.join("; ")));
    }
    troubles
}

fn stage_word(lang: Lang, stage: &str) -> &'static str {
    Stage::from_word(stage).map_or("", |stage| lang.stage(stage, true))
}

fn state_word(lang: Lang, state: &str) -> &'static str {
    NodeState::from_word(state).map_or("", |state| lang.state(state))
}

fn stage_bar(painter: &Painter, period: &Period) -> Option<String> {
    let stage = Stage::from_word(&period.state)?;
    Some(painter.stage(stamp(period.from_ms), stamp(period.to_ms), stage))
}

fn lane(painter: &Painter, strip: &NodeStrip) -> Lane {
    let stretch = |period: &Period| {
        Some(Stretch {
            from_ms: period.from_ms,
            to_ms: period.to_ms,
            state: NodeState::from_word(&period.state)?,
            own: NodeState::from_word(&period.own)?,
            cause: period.masked_by.as_deref().map(Into::into),
            said: Said::of(&period.message, None),
        })
    };
    let stretches: Vec<Stretch> = strip.periods.iter().filter_map(stretch).collect();
    let bars = recorded(&stretches).iter().map(|segment| painter.segment(segment)).collect();
    Lane { name: clean(&strip.node, 2 * NAME), why: why_address(&strip.node), bars }
}

fn frozen(lang: Lang, incident: &Incident) -> Vec<FrozenRow> {
    let row = |frozen: &crate::record::summary::FrozenNode| FrozenRow {
        node: clean(&frozen.node, 2 * NAME),
        why: why_address(&frozen.node),
        state: clean(&frozen.state, NAME),
        word: state_word(lang, &frozen.state).to_owned(),
        message: clean(&frozen.message, MESSAGE),
        values: frozen.values.iter().map(|(key, value)| (clean(key, VALUE), clean(value, VALUE))).collect(),
    };
    incident.summary.freeze.iter().map(row).collect()
}

fn topics(story: &Story) -> Vec<TopicRow> {
    let row = |topic: &crate::record::story::ToldTopic| TopicRow {
        topic: clean(&topic.topic, 2 * NAME),
        type_name: clean(&topic.type_name, 2 * NAME),
        seconds: format!("{:.1}", topic.last_ms.saturating_sub(topic.first_ms) as f64 / 1000.0),
        messages: topic.messages,
        size: size(topic.bytes),
    };
    story.topics.iter().map(row).collect()
}

fn moments(lang: Lang, it: &IncidentWords, story: &Story, since_ms: i64) -> Vec<MomentRow> {
    let row = |moment: &crate::record::story::Moment| {
        // Whole tenths, so that nothing is "-0.0".
        let tenths = (moment.at_ms.saturating_sub(since_ms) as f64 / 100.0).round() as i64;
        let state = match &moment.what {
            Happened::Fails { state, .. } => state.clone(),
            Happened::Masks { .. } => "ignore".to_owned(),
            Happened::Recovers { .. } => "ok".to_owned(),
            _ => String::new(),
        };
        MomentRow {
            at: wall_time(moment.at_ms),
            after: format!("{:+.1} s", tenths as f64 / 10.0),
            state: clean(&state, NAME),
            text: sentence(lang, it, &moment.what),
        }
    };
    story.moments.iter().map(row).collect()
}

/// One sentence for what happened.
fn sentence(lang: Lang, it: &IncidentWords, what: &Happened) -> String {
    let name = |name: &str| clean(name, 2 * NAME);
    let names = |nodes: &[String], more: usize| {
        let mut all: Vec<String> = nodes.iter().map(|node| name(node)).collect();
        if more > 0 {
            all.push(lang.and_more(more));
        }
        all.join(", ")
    };
    let text = |en: String, de: String| if lang == Lang::De { de } else { en };
    match what {
        Happened::Fails { node, state, message } => {
            let (node, word) = (name(node), state_word(lang, state));
            match clean(message, MESSAGE) {
                message if message.is_empty() => format!("{node}: {word}"),
                message => format!("{node}: {word}, \u{201c}{message}\u{201d}"),
            }
        }
        Happened::Masks { by, nodes, more } => {
            let (by, nodes) = (name(by), names(nodes, *more));
            text(format!("{by} hides: {nodes}"), format!("{by} verdeckt: {nodes}"))
        }
        Happened::Recovers { nodes, more } => {
            let nodes = names(nodes, *more);
            text(format!("OK again: {nodes}"), format!("Wieder OK: {nodes}"))
        }
        Happened::AlarmMoves { symptom, node } => {
            let (symptom, node) = (name(symptom), name(node));
            text(
                format!("{symptom} was a symptom: the cause is {node}"),
                format!("{symptom} war eine Folge: Die Ursache ist {node}"),
            )
        }
        Happened::Stage { stage } => {
            let stage = stage_word(lang, stage);
            text(format!("The vehicle: {stage}"), format!("Das Fahrzeug: {stage}"))
        }
        Happened::LostActive { .. } => text(
            "Autonomous driving ended while the vehicle was not known to stand".to_owned(),
            "Autonomes Fahren endete, ohne dass das Fahrzeug sicher stand".to_owned(),
        ),
        Happened::Request { request } => {
            let request = match (lang, &**request) {
                (Lang::En, "decelerate") => "slow down".to_owned(),
                (Lang::De, "decelerate") => "abbremsen".to_owned(),
                (Lang::En, "maneuver_stop") => "stop safely".to_owned(),
                (Lang::De, "maneuver_stop") => "sicher anhalten".to_owned(),
                (_, other) => name(other),
            };
            text(format!("The vehicle is asked to {request}"), format!("Das Fahrzeug soll {request}"))
        }
        Happened::Mark { by, note } => {
            let (by, note) = (name(by), clean(note, MESSAGE));
            let said = if note.is_empty() { note } else { format!(": \u{201c}{note}\u{201d}") };
            text(format!("Marked by {by}{said}"), format!("Markiert von {by}{said}"))
        }
        Happened::Operator { action, on } => {
            let (en, de) = operator(action);
            let on = name(on);
            text(format!("The operator {en} {on}"), format!("Fahrbegleitung: {de} {on}"))
                .trim_end()
                .to_owned()
        }
        Happened::Reload => it.reloaded.to_owned(),
        Happened::Lost { count } => text(
            format!("{count} changes before this are missing"),
            format!("{count} Änderungen davor fehlen"),
        ),
    }
}

/// What the operator did, or tried to do.
fn operator(action: &str) -> (&str, &str) {
    match action {
        "login" => ("logs in:", "Anmeldung:"),
        "logout" => ("logs out", "Abmeldung"),
        "shutdown" => ("ends the work", "Dienstende"),
        "localize" => ("says where the vehicle is", "Positionsangabe"),
        "clearance" => ("presses: give clearance", "drückt: Freigabe"),
        "stop" => ("presses STOP", "drückt STOPP"),
        "withdraw" => ("withdraws the clearance", "widerruft die Freigabe"),
        "release" => ("presses: continue driving", "drückt: Weiterfahrt"),
        "acknowledge" => ("acknowledges", "quittiert"),
        "reset" => ("resets", "setzt zurück:"),
        other => (other, other),
    }
}
