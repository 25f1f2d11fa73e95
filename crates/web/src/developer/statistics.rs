//! The page of the statistics: how many alarms there were, of which nodes and for how long, and the time in each stage.

use askama::Template;
use axum::extract::State;
use axum::response::Html;

use super::request::PageRequest;
use super::timeline::percent;
use super::{DevFrame, Page, why_address};
use crate::AppState;
use crate::texts::{DevWords, Lang, NAME, clean};
use crate::view::page::frame::PageFrame;
use crate::view::{View, html};
use telltale_clock::unix_ms;
use telltale_store::{NodeFigures, NodeStatistics, Statistics, VersionStatistics, how_long_ms, way};

const DAY_MS: i64 = 24 * 3_600_000;
/// The choices of days.
const DAYS: [u64; 4] = [1, 7, 30, 365];
/// What counts without a choice.
const DAYS_PLAIN: u64 = 7;
/// Nodes of the table.
const ROWS: usize = 200;

/// A figure with its name.
struct Figure {
    name: &'static str,
    text: String,
    /// Its part of a whole, in percent of the width.
    share: Option<String>,
}

struct NodeRow {
    name: String,
    address: String,
    alarms: u64,
    /// Its alarms in relation to those of the node that has most.
    share: String,
    figures: NodeFigures,
    chatters: bool,
}

#[derive(Template)]
#[template(path = "developer/statistics.html")]
struct StatisticsHtml {
    frame: PageFrame,
    dev: DevFrame,
    /// Days, their words, and whether they are shown.
    days: Vec<(u64, &'static str, bool)>,
    /// Why there is nothing.
    trouble: Option<&'static str>,
    figures: Vec<Figure>,
    rows: Vec<NodeRow>,
    /// Enough is recorded for a rate.
    has_rate: bool,
    /// The way is known.
    has_way: bool,
    versions: Vec<VersionRow>,
}

struct VersionRow {
    /// Empty: it did not say.
    version: String,
    recorded: String,
    way: String,
    alarms: u64,
    between: String,
}

/// `GET /developer/statistics?days=N`
pub async fn get(State(app): State<AppState>, request: PageRequest) -> Html<String> {
    let PageRequest { published, context, query, .. } = request;
    let words = DevWords::of(context.lang);
    let days =
        query.number("days").and_then(|days| DAYS.into_iter().find(|it| *it == days)).unwrap_or(DAYS_PLAIN);
    let to_ms = unix_ms(published.at);
    let from_ms = to_ms - days as i64 * DAY_MS;
    let found = app.past(&published, |history| history.statistics(from_ms, to_ms)).await.ok();
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
        days: DAYS
            .into_iter()
            .zip([words.one_day, words.seven_days, words.thirty_days, words.one_year])
            .map(|(it, word)| (it, word, it == days))
            .collect(),
        trouble,
        figures: known.as_ref().map(|found| figures(view, words, found)).unwrap_or_default(),
        rows: known.as_ref().map(|found| rows(context.lang, found)).unwrap_or_default(),
        has_rate: known.as_ref().is_some_and(|found| !found.rate(found.alarms).is_empty()),
        has_way: known.as_ref().is_some_and(|found| found.driven_m.is_some()),
        versions: known
            .iter()
            .flat_map(|found| &found.versions)
            .map(|it| version_row(context.lang, it))
            .collect(),
    }))
}

fn figures(view: &View<'_>, words: &'static DevWords, found: &Statistics) -> Vec<Figure> {
    let lang = view.lang;
    let mut figures = vec![
        (words.recorded_time, how_long_ms(found.recorded_ms)),
        (words.alarms, found.alarms.to_string()),
        (words.most_in_10_min, found.most_in_10_min.to_string()),
    ];
    let rate = found.rate(found.alarms);
    figures.extend((!rate.is_empty()).then(|| (words.alarms_per_hour, lang.quantity(&rate, 1.0, ""))));
    figures.extend(found.driven_m.map(|metres| (words.driven, lang.quantity(&way(metres), 1.0, ""))));
    figures.extend(found.to_acknowledge_ms.map(|ms| (words.to_acknowledge, how_long_ms(ms))));
    figures.extend((found.lost > 0).then(|| (words.history_lost, found.lost.to_string())));
    let plain = figures.into_iter().map(|(name, text)| Figure { name, text, share: None });
    let stages = found.shares().filter(|_| view.has_stages()).map(|(stage, ms, text)| {
        let share = Some(percent(100.0 * ms as f64 / found.recorded_ms as f64));
        Figure { name: lang.stage(stage, true), text, share }
    });
    plain.chain(stages).collect()
}

fn version_row(lang: Lang, found: &VersionStatistics) -> VersionRow {
    VersionRow {
        version: clean(&found.version, NAME),
        recorded: how_long_ms(found.recorded_ms),
        way: found.driven_m.map(|metres| lang.quantity(&way(metres), 1.0, "")).unwrap_or_default(),
        alarms: found.alarms,
        between: found.between_alarms_ms().filter(|_| found.alarms > 1).map_or_else(String::new, how_long_ms),
    }
}

fn rows(lang: Lang, found: &Statistics) -> Vec<NodeRow> {
    let most = found.nodes.iter().map(|node| node.alarms).max().unwrap_or(1).max(1);
    let row = |node: &NodeStatistics| NodeRow {
        name: clean(&node.node, 2 * NAME),
        address: why_address(&node.node),
        alarms: node.alarms,
        share: percent(100.0 * node.alarms as f64 / most as f64),
        figures: {
            let figures = found.figures(node);
            NodeFigures {
                an_hour: lang.quantity(&figures.an_hour, 1.0, ""),
                on_100_km: lang.quantity(&figures.on_100_km, 1.0, ""),
                // One failure says nothing of the time between two.
                between: if node.alarms < 2 { String::new() } else { figures.between },
                ..figures
            }
        },
        chatters: node.chatters,
    };
    found.nodes.iter().take(ROWS).map(row).collect()
}
