//! The log of one vehicle as people read it: alarms, stages, and what is not known, the newest first.

use std::collections::BTreeMap;

use askama::Template;
use axum::extract::Path;
use axum::http::HeaderMap;
use axum::response::Response;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use telltale_clock::unix_ms;
use telltale_engine::model::Stage;
use telltale_fleet::history::Unknown;
use telltale_fleet::message::{Alarm, Content, Epoch, GapReason, Message, VehicleId};
use telltale_web::common::{Asked, Format, Reader, Table};
use telltale_web::describe::words;
use telltale_web::texts::console::ConsoleWords;
use telltale_web::texts::{HttpError, ID, Lang, MESSAGE, clean};

use super::history::HistoryAsked;
use super::page::rendered;
use super::view::View;
use crate::history::{Known, Part};
use crate::state::time;

/// Lines of the page.
const LINES_MAX: usize = 200;

const HOUR_MS: i64 = 3_600_000;

telltale_engine::words! {
    /// How far back the log is read.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
    pub enum Reach {
        #[serde(rename = "1h")]
        Hour = "1h",
        #[default]
        #[serde(rename = "24h")]
        Day = "24h",
        /// As long as a hub keeps logs.
        #[serde(rename = "14d")]
        All = "14d",
    }
}

impl Reach {
    pub const fn ms(self) -> i64 {
        match self {
            Reach::Hour => HOUR_MS,
            Reach::Day => 24 * HOUR_MS,
            Reach::All => 14 * 24 * HOUR_MS,
        }
    }
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LogAsked {
    #[serde(default)]
    log: Reach,
}

#[derive(Template)]
#[template(path = "console/log.html")]
pub struct LogHtml {
    words: &'static ConsoleWords,
    id: String,
    /// Of an address in the past: its moment.
    at: String,
    /// When it begins.
    from: String,
    /// The place of the last message in it.
    noted: String,
    reach: &'static str,
    reaches: [(&'static str, &'static str); 3],
    lines: Vec<LineHtml>,
    notes: Vec<String>,
}

/// A line of the log.
#[derive(Serialize, JsonSchema)]
#[schemars(rename = "LogLine")]
pub struct LineHtml {
    #[schemars(schema_with = "words::time")]
    at: String,
    /// `alarm`, `seen`, `over`, `stage`, `goodbye`; `gap` if messages are missing, `cut` if there is more than is read at once.
    kind: &'static str,
    /// For people, in the language of `Accept-Language`.
    word: &'static str,
    text: String,
    node: String,
}

/// `GET /api/v1/vehicles/ID/log?from&to&format`: the log as people read it, the oldest line first.
pub async fn table(
    view: View,
    Path(id): Path<String>,
    Asked(asked): Asked<HistoryAsked>,
    reader: Reader,
    headers: HeaderMap,
) -> Result<Response, HttpError> {
    let id = VehicleId::new(&id).ok_or(HttpError::NotFound)?;
    let (from, to) = asked.span(unix_ms(view.console.clock.wall()));
    let known = view.history(&id, from, to).await?;
    let told = lines(&known, from, reader.lang).into_iter().filter(|(at, _)| (from..=to).contains(at));
    let mut rows: Vec<LineHtml> = told.map(|(_, line)| line).collect();
    if !known.is_whole {
        let words = ConsoleWords::of(reader.lang);
        let last_ms = known.messages().last().map_or(from, |message| message.at);
        let text = words.log_more.to_owned();
        rows.push(LineHtml {
            at: time(last_ms),
            kind: "cut",
            word: words.not_known,
            text,
            node: String::new(),
        });
    }
    let columns = &["at", "kind", "word", "text", "node"];
    let table = Table { name: "log", columns, rows: &rows, next: None };
    Ok(table.answer(Format::of(asked.format, &headers), &rows))
}

/// `GET /vehicles/ID/log?log=24h`: the part of the page with the log.
pub async fn log(
    view: View,
    Path(id): Path<String>,
    Asked(asked): Asked<LogAsked>,
    reader: Reader,
) -> Result<Response, HttpError> {
    let id = VehicleId::new(&id).ok_or(HttpError::NotFound)?;
    Ok(rendered(&log_of(&view, &id, asked.log, reader.lang).await?))
}

pub async fn log_of(view: &View, id: &VehicleId, log: Reach, lang: Lang) -> Result<LogHtml, HttpError> {
    let words = ConsoleWords::of(lang);
    let noted = view.fleet().vehicle(id)?.picture.noted_place();
    let from = unix_ms(view.console.clock.wall()).saturating_sub(log.ms());
    // Without its hub the console has no log, and the rest of the page all the same.
    let (lines, notes) = match view.history(id, from, i64::MAX).await {
        Ok(known) => {
            (shown(lines(&known, from, lang), from, i64::MAX), remarks(&known, (from, i64::MAX), lang))
        }
        Err(HttpError::NotFound) => return Err(HttpError::NotFound),
        Err(_) => (Vec::new(), vec![words.log_unread.to_owned()]),
    };
    Ok(LogHtml { noted, lines, notes, ..LogHtml::of(id, log, from, lang) })
}

/// The log up to a moment, and the moments of the lines before it and after it.
pub fn log_until(
    known: &Known,
    id: &VehicleId,
    at_ms: i64,
    reach: Reach,
    lang: Lang,
) -> (LogHtml, [Option<i64>; 2]) {
    let from = at_ms.saturating_sub(reach.ms());
    let lines = lines(known, from, lang);
    let moments = || lines.iter().map(|(at, _)| *at);
    let steps = [moments().filter(|at| *at < at_ms).max(), moments().filter(|at| *at > at_ms).min()];
    let log = LogHtml {
        at: time(at_ms),
        lines: shown(lines, from, at_ms),
        notes: remarks(known, (from, at_ms), lang),
        ..LogHtml::of(id, reach, from, lang)
    };
    (log, steps)
}

impl LogHtml {
    /// Without lines.
    fn of(id: &VehicleId, reach: Reach, from: i64, lang: Lang) -> LogHtml {
        let words = ConsoleWords::of(lang);
        let reaches =
            [(Reach::Hour, words.last_hour), (Reach::Day, words.last_day), (Reach::All, words.last_14_days)];
        LogHtml {
            words,
            id: id.to_string(),
            at: String::new(),
            from: time(from),
            noted: String::new(),
            reach: reach.as_str(),
            reaches: reaches.map(|(reach, word)| (reach.as_str(), word)),
            lines: Vec::new(),
            notes: Vec::new(),
        }
    }
}

/// The lines of a time, the newest first, as many as a page has.
fn shown(lines: Vec<(i64, LineHtml)>, from: i64, to: i64) -> Vec<LineHtml> {
    let asked = lines.into_iter().rev().filter(|(at, _)| (from..=to).contains(at));
    asked.take(LINES_MAX).map(|(_, line)| line).collect()
}

fn remarks(known: &Known, (from, to): (i64, i64), lang: Lang) -> Vec<String> {
    let words = ConsoleWords::of(lang);
    let mut remarks = Vec::new();
    if !known.messages().any(|message| (from..=to).contains(&message.at)) {
        remarks.push(words.log_none.to_owned());
    }
    if !known.is_whole {
        remarks.push(words.log_cut.to_owned());
    }
    if known.refused > 0 {
        remarks.push(lang.unread_batches(known.refused));
    }
    if known.contradictions > 0 {
        remarks.push(words.log_contradicts.to_owned());
    }
    remarks
}

/// All lines with their times, the newest last.
fn lines(known: &Known, from: i64, lang: Lang) -> Vec<(i64, LineHtml)> {
    let mut missing = Vec::new();
    let mut run = Run::default();
    let mut lines = Vec::new();
    for part in known.parts(i64::MIN, i64::MAX) {
        let message = match part {
            Part::Message(message) => message,
            Part::Missing(gap) => {
                missing.push(gap);
                continue;
            }
        };
        lines.extend(missing.drain(..).map(|gap| (message.at, gap_line(&gap, message.at, lang))));
        if run.epoch != Some(message.epoch) {
            run = Run { epoch: Some(message.epoch), ..Run::default() };
        }
        lines.extend(run.line(message, lang).map(|line| (message.at, line)));
    }
    let last_ms = lines.last().map_or(from, |(at, _)| *at);
    lines.extend(missing.iter().map(|gap| (last_ms, gap_line(gap, last_ms, lang))));
    lines
}

fn gap_line(gap: &Unknown, at_ms: i64, lang: Lang) -> LineHtml {
    let words = ConsoleWords::of(lang);
    let why = match gap.why {
        Some(GapReason::Overflow) => words.gap_overflow,
        Some(GapReason::TooOld) => words.gap_too_old,
        Some(GapReason::Lost) => words.gap_lost,
        Some(GapReason::Disk) => words.gap_disk,
        Some(GapReason::TooLarge) => words.gap_too_large,
        Some(GapReason::Unknown) | None => "",
    };
    let count = gap.to.saturating_sub(gap.from.n).saturating_add(1);
    let missing = lang.missing_messages(count);
    let text = if why.is_empty() { missing } else { format!("{missing}: {why}") };
    LineHtml { at: time(at_ms), kind: "gap", word: words.not_known, text, node: String::new() }
}

/// What is known of one run of the vehicle's program, message by message.
#[derive(Default)]
struct Run {
    epoch: Option<Epoch>,
    stage: Option<Stage>,
    /// The open alarms by their numbers; at the end of one its node is not named again.
    alarms: BTreeMap<u64, Alarm>,
}

impl Run {
    fn line(&mut self, message: &Message, lang: Lang) -> Option<LineHtml> {
        let words = ConsoleWords::of(lang);
        let line = |kind, word, text: String, node: String| {
            Some(LineHtml { at: time(message.at), kind, word, text, node })
        };
        match &message.content {
            Content::Keyframe(all) | Content::Delta(all) => {
                let before = self.stage.replace(all.stage);
                let is_new = before.is_some_and(|before| before != all.stage);
                let stage = lang.stage(all.stage, true).to_owned();
                if is_new { line("stage", words.motion, stage, String::new()) } else { None }
            }
            Content::Alarm(alarm) => {
                let before = self.alarms.remove(&alarm.number);
                let named = if alarm.node.is_empty() { before.as_ref().unwrap_or(alarm) } else { alarm };
                let (kind, word) = match &before {
                    None if alarm.active => ("alarm", words.alarm),
                    Some(before) if alarm.active && alarm.acknowledged && !before.acknowledged => {
                        ("seen", words.acknowledged)
                    }
                    Some(before) if before.active && !alarm.active => ("over", words.alarm_over),
                    Some(before) if alarm.acknowledged && !before.acknowledged => {
                        ("seen", words.acknowledged)
                    }
                    _ => ("alarm", words.alarm),
                };
                let (text, node) = (clean(&named.words, MESSAGE), clean(&named.node, ID));
                let is_closed = !alarm.active && alarm.acknowledged;
                if !is_closed {
                    self.alarms.insert(alarm.number, Alarm { node: named.node.clone(), ..alarm.clone() });
                }
                // One that was over before it was acknowledged is told once more.
                if is_closed && before.is_none() { None } else { line(kind, word, text, node) }
            }
            Content::Goodbye => line("goodbye", words.telltale_ended, String::new(), String::new()),
            _ => None,
        }
    }
}
