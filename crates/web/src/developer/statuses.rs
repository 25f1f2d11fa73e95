//! The page of statuses, the first developer page: received statuses, faults of reception, and every
//! module.

use std::cmp::Ordering;

use askama::Template;

use axum::extract;
use axum::response::Html;

use crate::AppState;

use super::request::PageRequest;
use crate::texts::{DevWords, MESSAGE, NAME, VALUE, clean};
use crate::view::node_names::reason_word;
use crate::view::page::frame::PageFrame;
use crate::view::trends::POINTS_SMALL;
use crate::view::{PageContext, Trends, View, html};
use telltale_engine::input::TroubleKind;
use telltale_engine::model::{GroupId, ModuleId, NodeId};
use telltale_engine::snapshot::{ModuleInfo, ModuleView};
use telltale_engine::state::State;
use telltale_engine::time::Timestamp;
use telltale_runtime::Published;

use super::pager::Pager;
use super::{DevFrame, Page, PageQuery, ReportValue, measured, report_values, why_address};

/// Rows of one page of the table.
const ROWS: usize = 30;
/// Rows that may be pinned above it.
const PINS: usize = 20;
const VALUES: usize = 5;
/// The order of a page that asks for none.
const SORT: &str = "state";
const TROUBLES: usize = 12;
/// Ages count on without news.
const RENEW_MS: u32 = 1000;

/// The columns by which the table can be sorted.
const SORTS: [&str; 6] = ["state", "own", "name", "since", "age", "message"];

struct Trouble {
    topic: String,
    kind: &'static str,
    count: u64,
    last: String,
    text: String,
}

struct StatusRow {
    id: String,
    why: String,
    pin: String,
    pinned: bool,
    state: &'static str,
    word: &'static str,
    reason: &'static str,
    because: String,
    own: &'static str,
    own_word: &'static str,
    since: String,
    age: String,
    silent: bool,
    shelved: bool,
    class: String,
    message: String,
    values: Vec<ReportValue>,
    more_values: usize,
}

/// The head of a column, with the address that sorts by it.
struct Column {
    name: &'static str,
    word: &'static str,
    address: String,
    /// `ascending` or `descending`, if the table is sorted by it.
    sorted: &'static str,
}

struct FilterOption {
    value: String,
    word: String,
    chosen: bool,
}

/// How many of those that the rest of the filter leaves show a state, with the address that leaves only them.
struct StateCount {
    state: &'static str,
    word: &'static str,
    count: usize,
    address: String,
    chosen: bool,
}

#[derive(Template)]
#[template(path = "developer/statuses.html")]
struct StatusesHtml {
    frame: PageFrame,
    dev: DevFrame,
    filter: String,
    counts: Vec<StateCount>,
    levels: Vec<FilterOption>,
    groups: Vec<FilterOption>,
    /// Fields of the address that the form has to keep.
    kept: Vec<(&'static str, String)>,
    troubles: Vec<Trouble>,
    more_troubles: usize,
    counters: [(&'static str, u64); 9],
    signals: Vec<(String, &'static str)>,
    columns: Vec<Column>,
    pinned: Vec<StatusRow>,
    rows: Vec<StatusRow>,
    pager: Pager,
}

/// `GET /developer?q=TEXT&level=STATE&group=PATH&sort=COLUMN&desc=1&page=N&pin=MODULE`
pub async fn get(extract::State(app): extract::State<AppState>, request: PageRequest) -> Html<String> {
    Html(page(&request.published, &request.context, &request.query, &app.trends))
}

pub fn page(published: &Published, context: &PageContext, query: &PageQuery, trends: &Trends) -> String {
    let view = &View::new(published, context.lang, false);
    let words = DevWords::of(context.lang);
    let dev = DevFrame::new(view, context, Page::Statuses, RENEW_MS);
    let snapshot = view.snapshot;
    let filter = StatusFilter::of(view, query);
    let mut modules: Vec<ModuleId> = filter.modules();
    let counts = counts(view, words, query, &modules);
    modules.retain(|&id| filter.has_level(id));
    sort(view, query, &mut modules);
    let (pager, shown) = Pager::of(query, "matching", "page", modules.len(), ROWS);
    let pins: Vec<&str> = query.all("pin").take(PINS).collect();
    // Many rows are for a file, which has no curves.
    let curves = (shown.len() <= ROWS).then_some(trends);
    let row = |id: ModuleId| row(view, id, query, &pins, curves);
    let rows: Vec<StatusRow> = modules[shown].iter().map(|&id| row(id)).collect();
    html(&StatusesHtml {
        filter: clean(query.get("q"), MESSAGE),
        counts,
        levels: levels(view, words, query),
        groups: groups(view, words, query),
        kept: query.kept(&["sort", "desc", "pin"]),
        troubles: if dev.locked { Vec::new() } else { troubles(view, words) },
        more_troubles: snapshot.reception.len().saturating_sub(TROUBLES),
        counters: [
            (words.arrays, snapshot.counters.arrays),
            (words.received, snapshot.counters.statuses),
            (words.dropped, snapshot.counters.dropped_names),
            (words.shortened, snapshot.counters.cut_statuses),
            (words.merged_alarms, snapshot.counters.merged_alarms),
            (words.dropped_alarms, snapshot.counters.dropped_alarms),
            (words.unknown_signals, snapshot.counters.unknown_signals),
            (words.samples, snapshot.counters.samples),
            (words.dropped_samples, snapshot.counters.dropped_samples),
        ],
        signals: snapshot.signals.iter().map(|(name, value)| (clean(name, NAME), signal(*value))).collect(),
        columns: columns(words, query),
        pinned: pins.iter().filter_map(|name| module_of(view, name)).map(row).collect(),
        pager,
        rows,
        frame: super::frame(context),
        dev,
    })
}

fn module_of(view: &View<'_>, name: &str) -> Option<ModuleId> {
    match view.snapshot.node(name) {
        Some(NodeId::Module(id)) => Some(id),
        _ => None,
    }
}

/// The filter of the table.
pub(crate) struct StatusFilter<'a> {
    view: &'a View<'a>,
    text: String,
    level: &'a str,
    group: &'a str,
}

impl<'a> StatusFilter<'a> {
    fn of(view: &'a View<'a>, query: &'a PageQuery) -> StatusFilter<'a> {
        StatusFilter::new(view, query.get("q"), query.get("level"), query.get("group"))
    }

    /// Modules with this text, in this state and group; an empty word stands for all.
    pub(crate) fn new(view: &'a View<'a>, text: &str, level: &'a str, group: &'a str) -> StatusFilter<'a> {
        StatusFilter { view, text: text.to_lowercase(), level, group }
    }

    /// Of any state, in the order of the groups; those of `other` come last.
    pub(crate) fn modules(&self) -> Vec<ModuleId> {
        let groups = self.view.snapshot.layout.groups.iter().filter(|group| is_in(&group.path, self.group));
        let modules = groups.flat_map(|group| group.modules.iter().copied());
        modules.filter(|&id| self.matches(id)).collect()
    }

    pub(crate) fn has_level(&self, id: ModuleId) -> bool {
        let state = self.view.snapshot.module(id).1.state;
        match self.level {
            "" => true,
            "abnormal" => matches!(state, State::Error | State::Warning | State::Unknown),
            word => state.as_str() == word,
        }
    }

    fn matches(&self, id: ModuleId) -> bool {
        let (info, module) = self.view.snapshot.module(id);
        self.text.is_empty() || self.contains_text(id, info, module)
    }

    /// Whether its row or its report contains the text.
    fn contains_text(&self, id: ModuleId, info: &ModuleInfo, module: &ModuleView) -> bool {
        let holds = |text: &str| contains(text, &self.text);
        let (view, report) = (self.view, &module.report);
        holds(&info.id)
            || holds(&report.message)
            || holds(view.lang.message(report))
            || holds(&report.hardware_id)
            || report.values.iter().any(|(key, value)| holds(key) || holds(value))
            || [module.state, module.own].iter().any(|state| holds(view.lang.state(*state)))
            || holds(&class(DevWords::of(view.lang), info))
            || module.received.is_none() && holds(DevWords::of(view.lang).never)
            || (module.silent || module.why_unknown().is_some()) && holds(&view.message_text(module))
            || module.reason.is_some() && holds(&view.reason(NodeId::Module(id), module.reason.as_ref()))
    }
}

/// Whether a group is this one or inside it; every path is inside the empty one.
fn is_in(path: &str, group: &str) -> bool {
    let rest = path.strip_prefix(group);
    group.is_empty() || rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
}

/// Whether `text` contains `lower`, in small or capital letters. ASCII, which nearly every text is, needs
/// no copy.
pub(super) fn contains(text: &str, lower: &str) -> bool {
    if !text.is_ascii() {
        return text.to_lowercase().contains(lower);
    }
    let (text, lower) = (text.as_bytes(), lower.as_bytes());
    text.len() >= lower.len() && text.windows(lower.len()).any(|part| part.eq_ignore_ascii_case(lower))
}

fn sort(view: &View<'_>, query: &PageQuery, modules: &mut [ModuleId]) {
    let key = sorted_by(query);
    let snapshot = view.snapshot;
    let compare = |a: ModuleId, b: ModuleId| -> Ordering {
        let ((a_info, a), (b_info, b)) = (snapshot.module(a), snapshot.module(b));
        match key {
            // The worst stands first.
            "state" => (b.state, b.own).cmp(&(a.state, a.own)),
            "own" => b.own.cmp(&a.own),
            "name" => a_info.id.cmp(&b_info.id),
            "since" => b.since.cmp(&a.since),
            "age" => a.received.cmp(&b.received),
            "message" => a.report.message.cmp(&b.report.message),
            _ => Ordering::Equal,
        }
    };
    if SORTS.contains(&key) {
        modules.sort_by(|&a, &b| compare(a, b));
    }
    if query.get("desc") == "1" {
        modules.reverse();
    }
}

/// The column that orders the table: that of the worst state, unless the address names another one.
fn sorted_by(query: &PageQuery) -> &str {
    if query.get("sort").is_empty() { SORT } else { query.get("sort") }
}

fn columns(words: &'static DevWords, query: &PageQuery) -> Vec<Column> {
    let heads = [words.shown, words.own, words.module, words.since, words.age, words.message];
    let column = |(name, word): (&'static str, &'static str)| {
        let here = sorted_by(query) == name;
        let descending = query.get("desc") == "1";
        // After a third click the worst stand first again.
        let kept = query.without(&["page", "sort", "desc"]);
        let more = match (here, descending) {
            (false, _) => format!("sort={name}"),
            (true, false) => format!("sort={name}&desc=1"),
            (true, true) => String::new(),
        };
        let joint = if kept.len() > 1 && !more.is_empty() { "&" } else { "" };
        let sorted = match (here, descending) {
            (false, _) => "",
            (true, false) => "ascending",
            (true, true) => "descending",
        };
        Column { name, word, address: format!("{kept}{joint}{more}"), sorted }
    };
    SORTS.into_iter().zip(heads).map(column).collect()
}

/// All, and each state from the worst on.
fn counts(view: &View<'_>, words: &DevWords, query: &PageQuery, modules: &[ModuleId]) -> Vec<StateCount> {
    let mut counts = [0; State::ALL.len()];
    for &id in modules {
        let state = view.snapshot.module(id).1.state;
        if let Some(place) = State::ALL.iter().position(|known| *known == state) {
            counts[place] += 1;
        }
    }
    let of = |state: &'static str, word: &'static str, count: usize| StateCount {
        state,
        word,
        count,
        address: query.with_all(&[("level", state), ("page", "")]),
        chosen: query.get("level") == state,
    };
    let states = State::ALL.iter().zip(counts).rev();
    let each = states.map(|(state, count)| of(state.as_str(), view.lang.state(*state), count));
    std::iter::once(of("", words.all_states, modules.len())).chain(each).collect()
}

fn levels(view: &View<'_>, words: &'static DevWords, query: &PageQuery) -> Vec<FilterOption> {
    let states = State::ALL.iter().rev().map(|state| (state.as_str(), view.lang.state(*state)));
    let all = [("", words.all_states), ("abnormal", words.abnormal)].into_iter().chain(states);
    let chosen = |value: &str| query.get("level") == value;
    all.map(|(value, word)| FilterOption {
        value: value.to_owned(),
        word: word.to_owned(),
        chosen: chosen(value),
    })
    .collect()
}

fn groups(view: &View<'_>, words: &'static DevWords, query: &PageQuery) -> Vec<FilterOption> {
    let group = |(index, path): (usize, &str)| FilterOption {
        value: path.to_owned(),
        word: format!("{} ({})", view.group_name(GroupId(index as u32)), clean(path, NAME)),
        chosen: query.get("group") == path,
    };
    let layout = &view.snapshot.layout;
    let all = FilterOption { value: String::new(), word: words.all_groups.to_owned(), chosen: false };
    let groups = layout.groups.iter().map(|group| &*group.path).enumerate().map(group);
    std::iter::once(all).chain(groups).collect()
}

fn troubles(view: &View<'_>, words: &'static DevWords) -> Vec<Trouble> {
    let kind = |kind| match kind {
        TroubleKind::Malformed => words.malformed,
        TroubleKind::WrongType => words.wrong_type,
        TroubleKind::Lost => words.lost,
    };
    let troubles = view.snapshot.reception.iter().take(TROUBLES).map(|trouble| Trouble {
        topic: clean(&trouble.topic, NAME),
        kind: kind(trouble.kind),
        count: trouble.count,
        last: view.wall(trouble.last),
        text: clean(&trouble.last_text, MESSAGE),
    });
    troubles.collect()
}

pub(super) fn signal(value: Option<bool>) -> &'static str {
    match value {
        Some(true) => "true",
        Some(false) => "false",
        None => "unknown",
    }
}

fn row(
    view: &View<'_>,
    id: ModuleId,
    query: &PageQuery,
    pins: &[&str],
    trends: Option<&Trends>,
) -> StatusRow {
    let (info, module) = view.snapshot.module(id);
    let past = trends.map(|trends| trends.of(id.0 as usize, &info.id, POINTS_SMALL)).unwrap_or_default();
    StatusRow {
        id: clean(&info.id, 2 * NAME),
        why: why_address(&info.id),
        pin: query.toggled("pin", &info.id),
        pinned: pins.contains(&&*info.id),
        state: module.state.as_str(),
        word: view.lang.state(module.state),
        reason: reason_word(module.reason.as_ref()),
        because: view.reason(NodeId::Module(id), module.reason.as_ref()),
        own: module.own.as_str(),
        own_word: view.lang.state(module.own),
        since: view.wall(module.since),
        age: match module.received {
            None => DevWords::of(view.lang).never.to_owned(),
            Some(then) if module.silent => silence(view, then),
            Some(then) => age(view, then),
        },
        silent: module.silent,
        shelved: view.snapshot.shelved(id).is_some(),
        class: class(DevWords::of(view.lang), info),
        message: view.message_text(module),
        values: report_values(module, VALUES, VALUE, past),
        more_values: measured(module).count().saturating_sub(VALUES),
    }
}

pub(super) fn class(words: &DevWords, info: &ModuleInfo) -> String {
    let class = [Some(info.class.location), Some(info.class.information), info.class.flow];
    let word = |part| match part {
        "isolated" => words.isolated,
        "contextual" => words.contextual,
        "content" => words.content,
        "meta" => words.meta,
        "sequential" => words.sequential,
        "parallel" => words.parallel,
        other => other,
    };
    class.into_iter().flatten().map(word).collect::<Vec<_>>().join(", ")
}

pub(super) fn age(view: &View<'_>, then: Timestamp) -> String {
    let ms = view.snapshot.now.since(then).as_millis();
    if ms < 10_000 { format!("{ms} ms") } else { format!("{} s", ms / 1000) }
}

/// An age that needs no milliseconds.
fn silence(view: &View<'_>, then: Timestamp) -> String {
    let ms = view.snapshot.now.since(then).as_millis();
    if ms < 10_000 { format!("{}.{} s", ms / 1000, ms % 1000 / 100) } else { format!("{} s", ms / 1000) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_filter_finds_in_any_case() {
        for (text, lower, found) in [
            ("Sensors/LiDAR", "lidar", true),
            ("Größe", "grö", true),
            ("GRÖSSE", "grö", true),
            ("abc", "abcd", false),
            ("", "a", false),
        ] {
            assert_eq!(contains(text, lower), found, "{text} {lower}");
        }
        for (path, group, inside) in
            [("a/b", "a", true), ("ab", "a", false), ("a", "a", true), ("a", "", true), ("a", "a/b", false)]
        {
            assert_eq!(is_in(path, group), inside, "{path} {group}");
        }
    }
}
