//! A vehicle in one line, as all pages show it: its state, its cause in words, and how old that is.

use telltale_engine::model::Stage;
use telltale_engine::state::State as Shows;
use telltale_engine::time::{Span, how_long};
use telltale_web::texts::console::ConsoleWords;
use telltale_web::texts::{Lang, Words};

use crate::state::Row;
use crate::state::contact::{Contact, Urgency};

/// A vehicle in one line.
pub struct RowHtml {
    pub id: String,
    pub name: String,
    pub state: &'static str,
    pub contact: &'static str,
    pub urgency: &'static str,
    pub icon: &'static str,
    pub word: String,
    /// Of a vehicle that is not live: what it showed last.
    pub last: Option<&'static str>,
    pub cause: String,
    pub node: String,
    pub notes: Vec<String>,
    pub since: String,
    pub motion: String,
    pub age: String,
    pub version: String,
}

pub fn shown(row: &Row, lang: Lang, now_ms: i64) -> RowHtml {
    let is_old = row.contact != Contact::Live;
    let span = |ms: i64| how_long(Span::from_millis(u64::try_from(ms).unwrap_or(0)));
    let since = |since: i64| format!("{} {}", Words::of(lang).since_for, span(now_ms.saturating_sub(since)));
    RowHtml {
        id: row.id.clone(),
        name: row.name.clone(),
        state: row.state.as_str(),
        contact: row.contact.as_str(),
        urgency: urgency(row.urgency),
        icon: icon_of(row),
        word: word_of(row, lang),
        last: (is_old && row.stage.is_some()).then(|| lang.state(row.state)),
        cause: row.cause.as_ref().map(|cause| cause.words.clone()).unwrap_or_default(),
        node: row.cause.as_ref().map(|cause| cause.node.clone()).unwrap_or_default(),
        notes: notes(row, lang),
        // Of a vehicle that is not heard only the age of what it told is known.
        since: row.since_ms.filter(|_| !is_old).map(since).unwrap_or_default(),
        motion: motion(row, lang),
        age: row.age_s.map(|age| lang.ago(&span((age * 1000.0) as i64))).unwrap_or_default(),
        version: row.version.clone(),
    }
}

/// Its state in a word, or why that is not known now.
pub fn word_of(row: &Row, lang: Lang) -> String {
    let words = ConsoleWords::of(lang);
    let word = contact(row, words).unwrap_or_else(|| lang.state(row.state));
    match row.urgency {
        Urgency::LostDriving => format!("{word} {}", words.drove),
        _ => word.to_owned(),
    }
}

pub fn icon_of(row: &Row) -> &'static str {
    match (row.contact, row.stage) {
        (Contact::Live, Some(_)) => icon(row.state),
        (Contact::Off, _) => "leave",
        _ => "unknown",
    }
}

/// The word for a vehicle that is not live.
fn contact(row: &Row, words: &'static ConsoleWords) -> Option<&'static str> {
    match (row.contact, row.stage) {
        (_, None) => Some(words.never_heard),
        (Contact::Live, _) => None,
        (Contact::Late, _) => Some(words.late),
        (Contact::Lost, _) => Some(words.link_lost),
        (Contact::HubDown, _) => Some(words.hub_down),
        // A shuttle is locked before it is switched off. A machine without stages is always active.
        (Contact::Off, Some(Stage::Locked)) => Some(words.vehicle_off),
        (Contact::Off, Some(Stage::Active)) if !row.drives => Some(words.vehicle_off),
        (Contact::Off, Some(_)) => Some(words.telltale_ended),
    }
}

pub const fn icon(state: Shows) -> &'static str {
    match state {
        Shows::Ok => "ok",
        Shows::Warning => "warning",
        Shows::Error => "error",
        Shows::Ignore => "idle",
        Shows::Unknown => "unknown",
    }
}

const fn urgency(urgency: Urgency) -> &'static str {
    match urgency {
        Urgency::LostDriving => "lost-driving",
        Urgency::Error => "error",
        Urgency::Unacknowledged => "unacknowledged",
        Urgency::Warning => "warning",
        Urgency::Lost => "lost",
        Urgency::Late => "late",
        Urgency::NeverHeard => "never",
        Urgency::Ok => "ok",
        Urgency::Off => "off",
    }
}

fn notes(row: &Row, lang: Lang) -> Vec<String> {
    let words = ConsoleWords::of(lang);
    let mut notes = Vec::new();
    if row.two_vehicles {
        notes.push(words.two_vehicles.to_owned());
    }
    if row.unacknowledged > 0 {
        notes.push(format!("{} {}", row.unacknowledged, words.unacknowledged));
    }
    if let Some(skew_s) = row.clock_skew_s {
        let seconds = skew_s.abs().round() as u64;
        notes.push(if skew_s > 0.0 { lang.clock_ahead(seconds) } else { lang.clock_behind(seconds) });
    }
    if let Some(why) = &row.refused_why {
        notes.push(lang.refused_messages(row.refused, why));
    }
    notes
}

fn motion(row: &Row, lang: Lang) -> String {
    let Some(stage) = row.stage else { return String::new() };
    let words = Words::of(lang);
    let stage = match stage {
        // Of a machine without stages.
        Stage::Active if !row.drives => words.runs,
        stage => lang.stage(stage, true),
    };
    match row.speed_kmh {
        Some(speed) => format!("{stage} · {speed} km/h"),
        None => stage.to_owned(),
    }
}
