//! The page of the timeline: strips as in Fig. 6 of the paper for any nodes and any span of time, from the
//! history.

pub(super) mod strips;

use askama::Template;

use axum::extract;
use axum::response::Html;

use crate::AppState;
use crate::incidents::wall_time as wall;
use crate::source::{Source, gap_marks};

use super::request::PageRequest;
use crate::texts::{DevWords, NAME, clean};
use crate::view::page::frame::PageFrame;
use crate::view::{PageContext, View, html};
use telltale_clock::unix_ms;
use telltale_engine::time::Timestamp;
use telltale_picture::bars::patterns;
use telltale_picture::strips::{Axis, stamp};
use telltale_runtime::Published;
use telltale_store::{HistoryQuery, Past, PastEvent};

use super::page_query::is_clean;
use super::{DevFrame, Page, PageQuery, why_address};
use strips::{Explained, StripHtml, StripKind, TimelineStrips, legend};

/// Strips of nodes on one page, and below them of signals.
const STRIPS: usize = 60;
/// Strips of a page that asks for none.
const STRIPS_UNASKED: usize = 30;
const SIGNALS: usize = 12;
const SPAN_S: u64 = 120;
/// Of a replay: a recording begins so long before its first trigger.
const SPAN_THEN_S: u64 = 30;
const SPANS_S: [u64; 7] = [30, 120, 600, 3600, 6 * 3600, 24 * 3600, 7 * 24 * 3600];
const EVENTS: usize = 100;
const RENEW_MS: u32 = 1000;
/// Names in the list to choose from.
const OFFERED: usize = 300;
/// The right end of the slider, in thousandths of the span.
const SLIDER_END: i64 = 1000;

struct Row {
    at: String,
    at_ms: i64,
    what: &'static str,
    detail: String,
    /// Names and addresses of the nodes that it is about.
    node: Option<(String, String)>,
    cause: Option<(String, String)>,
}

pub(crate) struct Tick {
    pub x: String,
    pub at: String,
    pub text: String,
}

pub(super) struct SpanOption {
    pub value: u64,
    pub word: String,
    pub chosen: bool,
}

#[derive(Template)]
#[template(path = "developer/timeline.html")]
struct TimelineHtml {
    frame: PageFrame,
    dev: DevFrame,
    live: bool,
    /// The patterns of states; the stylesheet says their colours.
    patterns: String,
    spans: Vec<SpanOption>,
    /// The span without one in the address.
    unasked: u64,
    unasked_word: String,
    /// Fields that the forms have to keep.
    kept: Vec<(&'static str, String)>,
    offered: Vec<String>,
    from_ms: i64,
    to_ms: i64,
    slider: i64,
    /// The position of the chosen moment, if it is in the span.
    line: Option<String>,
    moment: String,
    moment_ms: i64,
    /// A moment was chosen; without one it is the end.
    chosen: bool,
    /// The address of a span around the chosen moment, if it lies outside of this one.
    around: Option<String>,
    /// It was looked for in recordings, and none has it: what does. Empty if it was not.
    unrecorded: &'static str,
    earlier: String,
    later: Option<String>,
    present: String,
    zoom_in: String,
    zoom_out: String,
    unzoomed: String,
    strips: Vec<StripHtml>,
    /// Marks over each strip.
    gaps: String,
    ticks: Vec<Tick>,
    legend: Vec<Explained>,
    events: Vec<Row>,
    trouble: Option<&'static str>,
}

/// The span, the moment and the nodes that an address names.
pub struct Window {
    pub query: HistoryQuery,
    span_s: u64,
    pub(super) live: bool,
    chosen_ms: Option<i64>,
}

impl Window {
    pub fn of(published: &Published, query: &PageQuery) -> Window {
        Window::over(published, query, unasked_s(published))
    }

    /// With so many seconds where the address names no span.
    pub fn over(published: &Published, query: &PageQuery, unasked_s: u64) -> Window {
        let now_ms = unix_ms(published.at);
        let span_s = query.number("span").unwrap_or(unasked_s).clamp(1, SPANS_S[SPANS_S.len() - 1]);
        let until = query.number("until").and_then(|until| i64::try_from(until).ok());
        let to_ms = until.unwrap_or(now_ms).min(now_ms);
        let from_ms = to_ms.saturating_sub(span_s as i64 * 1000).max(0);
        let mut nodes: Vec<String> = Vec::new();
        // The nodes that were added last are shown.
        let named: Vec<&str> = query.all("node").collect();
        for &name in &named[named.len().saturating_sub(STRIPS)..] {
            if !nodes.iter().any(|known| known == name) {
                nodes.push(name.to_owned());
            }
        }
        if nodes.is_empty() {
            let snapshot = &published.snapshot;
            nodes = snapshot
                .tiles()
                .map(|id| snapshot.group(id).0.path.to_string())
                .take(STRIPS_UNASKED)
                .collect();
            nodes.extend(snapshot.roots.iter().take(5).map(|root| snapshot.node_name(root.node).to_string()));
        }
        let signals = published.snapshot.signals.iter().map(|(name, _)| name.to_string()).take(SIGNALS);
        let signals = signals.collect();
        let chosen_ms = query.number("at").and_then(|at| i64::try_from(at).ok()).map(|at| at.min(now_ms));
        let query = HistoryQuery { nodes, signals, from_ms, to_ms };
        Window { query, span_s, live: until.is_none(), chosen_ms }
    }

    /// The chosen moment, or the end.
    fn moment_ms(&self) -> i64 {
        self.chosen_ms.unwrap_or(self.query.to_ms)
    }

    fn shows(&self, at_ms: i64) -> bool {
        (self.query.from_ms..=self.query.to_ms).contains(&at_ms)
    }

    /// The chosen moment, unless it lies outside of the span.
    fn line_ms(&self) -> Option<i64> {
        self.chosen_ms.filter(|&at_ms| self.shows(at_ms))
    }

    /// The address of another span, in which the moment keeps its place; the present goes on if it is shown.
    fn zoomed(&self, query: &PageQuery, span_s: u64) -> String {
        let place_ms = self.line_ms().unwrap_or(self.query.to_ms);
        let after = (self.query.to_ms - place_ms) * span_s as i64 / self.span_s as i64;
        let until = match self.live && self.chosen_ms.is_none() {
            true => String::new(),
            false => (place_ms + after).to_string(),
        };
        query.with_all(&[("span", &span_s.to_string()), ("until", &until)])
    }

    /// In milliseconds since 1970.
    pub(super) fn span_ms(&self) -> (i64, i64) {
        (self.query.from_ms, self.query.to_ms)
    }

    /// In hundredths of the width.
    pub(super) fn axis(&self) -> Axis {
        let HistoryQuery { from_ms, to_ms, .. } = self.query;
        Axis { from: stamp(from_ms), to: stamp(to_ms), left: 0.0, width: 100.0 }
    }
}

/// The span of a page that asks for none.
fn unasked_s(published: &Published) -> u64 {
    if published.replay { SPAN_THEN_S } else { SPAN_S }
}

/// `GET /developer/timeline?node=NODE&span=SECONDS&until=MS&at=MS`, times in milliseconds since 1970.
pub async fn get(extract::State(app): extract::State<AppState>, request: PageRequest) -> Html<String> {
    let PageRequest { published, context, query, .. } = request;
    let window = Window::of(&published, &query);
    let past = app.past(&published, |history| history.past(window.query.clone())).await.ok();
    let gaps = match &app.source {
        Source::Live(_) => String::new(),
        Source::Replay(replay) => gap_marks(&replay.gaps, window.query.from_ms, window.query.to_ms),
    };
    Html(page(&published, &context, &query, (&window, gaps), past.as_ref()))
}

/// `past` is `None` if it cannot be read. `gaps` marks what is missing of a recording.
pub fn page(
    published: &Published,
    context: &PageContext,
    query: &PageQuery,
    (window, gaps): (&Window, String),
    past: Option<&Past>,
) -> String {
    let view = &View::new(published, context.lang, false);
    let words = DevWords::of(context.lang);
    let HistoryQuery { ref nodes, from_ms, to_ms, .. } = window.query;
    let mut dev = DevFrame::new(view, context, Page::Timeline, RENEW_MS);
    dev.fixed = !window.live;
    let half = window.span_s as i64 * 500;
    let shift = |to: i64| query.with("until", &to.to_string());
    let timeline = TimelineStrips { lang: context.lang, words, window, query };
    let trouble = match past {
        None => Some(words.no_history),
        Some(past) if past.cut => Some(words.cut),
        Some(_) => None,
    };
    let strips = past.map(|past| timeline.strips(past, published.snapshot.has_stages())).unwrap_or_default();
    let unrecorded = match query.number("unrecorded") {
        Some(_) if window.live => "",
        Some(_) if window.shows(window.moment_ms()) && strips.iter().all(|strip| strip.state == "none") => {
            words.nowhere
        }
        Some(_) => words.unrecorded,
        None => "",
    };
    html(&TimelineHtml {
        frame: super::frame(context),
        live: window.live,
        patterns: patterns("p-", |paint| format!("class=\"p-{paint}\"")),
        spans: spans(window),
        unasked: unasked_s(published),
        unasked_word: span_word(unasked_s(published)),
        kept: query.kept(&["until", "span", "at", "node"]),
        offered: offered(view, nodes),
        from_ms,
        to_ms,
        slider: window
            .line_ms()
            .map_or(SLIDER_END, |at_ms| SLIDER_END * (at_ms - from_ms) / (to_ms - from_ms).max(1)),
        line: window.line_ms().map(|at_ms| percent(window.axis().x(stamp(at_ms)))),
        moment: wall(window.moment_ms()),
        moment_ms: window.moment_ms(),
        chosen: window.chosen_ms.is_some(),
        around: (!window.shows(window.moment_ms())).then(|| shift(window.moment_ms() + half)),
        unrecorded,
        earlier: shift((to_ms - half).max(0)),
        later: (!window.live).then(|| shift(to_ms + half)),
        present: query.without(&["until", "at", "unrecorded"]),
        zoom_in: window.zoomed(query, (window.span_s / 2).max(1)),
        zoom_out: window.zoomed(query, (window.span_s * 2).min(SPANS_S[SPANS_S.len() - 1])),
        unzoomed: query.without(&["span", "until", "at", "unrecorded"]),
        strips,
        gaps,
        ticks: ticks(window.axis()),
        legend: legend(context.lang),
        events: past.map(|past| events(view, words, past)).unwrap_or_default(),
        trouble,
        dev,
    })
}

pub(super) fn spans(window: &Window) -> Vec<SpanOption> {
    let mut all: Vec<u64> = SPANS_S.to_vec();
    if !all.contains(&window.span_s) {
        all.push(window.span_s);
    }
    all.sort_unstable();
    all.into_iter()
        .map(|value| SpanOption { value, word: span_word(value), chosen: value == window.span_s })
        .collect()
}

fn span_word(seconds: u64) -> String {
    match seconds {
        _ if seconds.is_multiple_of(86_400) => format!("{} d", seconds / 86_400),
        _ if seconds.is_multiple_of(3600) => format!("{} h", seconds / 3600),
        _ if seconds.is_multiple_of(60) => format!("{} min", seconds / 60),
        _ => format!("{seconds} s"),
    }
}

/// Names that are not shown yet.
fn offered(view: &View<'_>, shown: &[String]) -> Vec<String> {
    let layout = &view.snapshot.layout;
    let groups = layout.groups.iter().map(|group| &*group.path);
    let names = groups.chain(layout.modules.iter().map(|module| &*module.id));
    let names = names.filter(|name| is_clean(name) && !shown.iter().any(|known| known == name));
    names.take(OFFERED).map(str::to_owned).collect()
}

/// Times below the strips.
pub(super) fn ticks(axis: Axis) -> Vec<Tick> {
    let tick = |at: Timestamp| Tick {
        x: percent(axis.x(at)),
        at: wall((at.as_nanos() / 1_000_000) as i64),
        text: clock(at),
    };
    axis.ticks(Timestamp::ZERO).map(tick).collect()
}

/// The newest first.
fn events(view: &View<'_>, words: &'static DevWords, past: &Past) -> Vec<Row> {
    let lang = view.lang;
    let named = |name: &str| Some((clean(name, 2 * NAME), why_address(name)));
    let event = |(at_ms, what): &(i64, PastEvent)| {
        let none = String::new;
        let (what, detail, node, cause) = match what {
            PastEvent::Started { anew: false } => (words.ev_started, none(), None, None),
            PastEvent::Started { anew: true } => (words.ev_reloaded, none(), None, None),
            PastEvent::Stage(stage) => (words.ev_stage, lang.stage(*stage, true).to_owned(), None, None),
            PastEvent::Signal { name, value } => {
                let value = value.map_or("unknown", |value| if value { "true" } else { "false" });
                (words.ev_signal, format!("{} {value}", clean(name, 2 * NAME)), None, None)
            }
            PastEvent::AlarmRaised { id, node } => (words.ev_raised, format!("{id}:"), named(node), None),
            PastEvent::AlarmMoved { id, symptom, cause } => {
                (words.ev_moved, format!("{id}:"), named(symptom), named(cause))
            }
            PastEvent::AlarmAcknowledged { id, node } => {
                (words.ev_acknowledged, format!("{id}:"), named(node), None)
            }
            PastEvent::AlarmCleared { id, node } => (words.ev_cleared, format!("{id}:"), named(node), None),
            PastEvent::Left { node } => (words.ev_left, none(), named(node), None),
            PastEvent::Lost(count) => (words.history_lost, count.to_string(), None, None),
        };
        Row { at: wall(*at_ms), at_ms: *at_ms, what, detail, node, cause }
    };
    past.events.iter().rev().take(EVENTS).map(event).collect()
}

pub(super) fn percent(share: f64) -> String {
    format!("{share:.2}%")
}

/// `12:03:04.5` in UTC; the page's script replaces it by local time.
fn clock(at: Timestamp) -> String {
    let text = wall((at.as_nanos() / 1_000_000) as i64);
    text.get(11..21).unwrap_or_default().trim_end_matches(".0").to_owned()
}

#[cfg(test)]
mod tests;
