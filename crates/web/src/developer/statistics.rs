//! The page of the statistics: how many alarms there were, of which nodes and for how long, and the time in each stage.

use askama::Template;
use axum::extract::State;
use axum::response::Html;

use super::request::PageRequest;
use super::words::DevWords;
use super::{DevFrame, Page, why_address};
use crate::AppState;
use crate::incidents::wall_ms;
use crate::view::page::frame::PageFrame;
use crate::view::text::{NAME, clean};
use crate::view::{View, html};
use telltale_engine::model::Stage;
use telltale_engine::time::{Span, how_long};
use telltale_store::Statistics;

const DAY_MS: i64 = 24 * 3_600_000;
/// The choices of days; the first one counts without a choice.
const DAYS: [u64; 4] = [7, 1, 30, 365];
/// Nodes of the table.
const ROWS: usize = 200;

struct NodeRow {
    name: String,
    address: String,
    alarms: u64,
    an_hour: String,
    between: String,
    alarmed: String,
    longest: String,
    chatters: bool,
}

#[derive(Template)]
#[template(path = "developer/statistics.html")]
struct StatisticsHtml {
    frame: PageFrame,
    dev: DevFrame,
    /// Days, and whether they are shown.
    days: Vec<(u64, bool)>,
    /// Why there is nothing.
    trouble: Option<&'static str>,
    /// What it is and its figure.
    figures: Vec<(&'static str, String)>,
    rows: Vec<NodeRow>,
}

/// `GET /developer/statistics?days=N`
pub async fn get(State(app): State<AppState>, request: PageRequest) -> Html<String> {
    let PageRequest { published, context, query, .. } = request;
    let words = DevWords::of(context.lang);
    let days =
        query.number("days").and_then(|days| DAYS.into_iter().find(|it| *it == days)).unwrap_or(DAYS[0]);
    let to_ms = wall_ms(published.at);
    let found = match &app.settings.history {
        // While the vehicle is locked, its past is not shown either.
        Some(history) if published.snapshot.stage != Stage::Locked => {
            let found = history.statistics(to_ms - days as i64 * DAY_MS, to_ms).await;
            found.inspect_err(|error| tracing::warn!(%error, "the statistics cannot be read")).ok()
        }
        _ => None,
    };
    let view = &View::new(&published, context.lang, false);
    let mut dev = DevFrame::new(view, &context, Page::Statistics, 0);
    dev.fixed = true;
    let trouble = match &found {
        None => Some(words.no_history),
        Some(found) if found.recorded_ms == 0 => Some(words.nothing_recorded),
        Some(_) => None,
    };
    let known = found.filter(|found| found.recorded_ms > 0);
    Html(html(&StatisticsHtml {
        frame: super::frame(&context),
        dev,
        days: DAYS.into_iter().map(|it| (it, it == days)).collect(),
        trouble,
        figures: known.as_ref().map(|found| figures(view, words, found)).unwrap_or_default(),
        rows: known.as_ref().map(rows).unwrap_or_default(),
    }))
}

fn figures(view: &View<'_>, words: &'static DevWords, found: &Statistics) -> Vec<(&'static str, String)> {
    let mut figures = vec![
        (words.recorded_time, long(found.recorded_ms)),
        (words.alarms, format!("{}, {} {}", found.alarms, rate(found, found.alarms), words.alarms_an_hour)),
        (words.most_in_10_min, found.most_in_10_min.to_string()),
    ];
    figures.extend(found.to_acknowledge_ms.map(|ms| (words.to_acknowledge, long(ms))));
    for &(stage, ms) in found.stages.iter().filter(|_| view.has_stages()) {
        let share = 100.0 * ms as f64 / found.recorded_ms as f64;
        figures.push((view.lang.stage(stage, true), format!("{share:.0} %")));
    }
    if found.lost > 0 {
        figures.push((words.history_lost, found.lost.to_string()));
    }
    figures
}

fn rows(found: &Statistics) -> Vec<NodeRow> {
    let row = |node: &telltale_store::NodeStatistics| NodeRow {
        name: clean(&node.node, 2 * NAME),
        address: why_address(&node.node),
        alarms: node.alarms,
        an_hour: rate(found, node.alarms),
        between: found.between_alarms_ms(node).map_or_else(String::new, long),
        alarmed: long(node.alarmed_ms),
        longest: long(node.longest_ms),
        chatters: node.chatters,
    };
    found.nodes.iter().take(ROWS).map(row).collect()
}

fn long(ms: i64) -> String {
    how_long(Span::from_millis(u64::try_from(ms).unwrap_or(0)))
}

fn rate(found: &Statistics, alarms: u64) -> String {
    found.per_hour(alarms).map_or_else(String::new, |rate| format!("{rate:.2}"))
}
