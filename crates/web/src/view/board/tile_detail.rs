//! The panel behind a tile: the reason of its state, and its modules.

use askama::Template;

use telltale_engine::model::{ModuleId, NodeId};
use telltale_engine::snapshot::{ModuleView, Reason};
use telltale_engine::state::State;

use super::Tile;
use crate::texts::operator::unit;
use crate::texts::{ID, NAME, VALUE, Words, address, clean};
use crate::view::node_names::{ModuleMessage, icon, own_matters, reason_word};
use crate::view::trends::{POINTS_SMALL, Trend};
use crate::view::versions::Aspect;
use crate::view::{DETAIL, Fragment, View, html};
use telltale_record::story::Limit;

/// Modules of one component that are listed; the worst first, the rest is counted.
const ROWS: usize = 40;
/// Values of one module that are shown.
const VALUES: usize = 8;
/// All panels together take no more on the wire, because a message to a page is never more than 1 MiB.
const BYTES: usize = 512 << 10;
/// Modules of one component whose values are drawn, and values of one of them that are.
const ROWS_DRAWN: usize = 12;
const VALUES_DRAWN: usize = 3;

/// Values of a monitor in the unit of its input.
const MEASURED: &[&str] = &["value", "difference", "earlier", "later", "a", "b"];

/// Values that the message of a monitor says: beside it their lines count.
const SAID: &[&str] = &[
    "rate_hz",
    "latency_s",
    "value",
    "difference",
    "ratio",
    "translation_m",
    "rotation_deg",
    "count_difference",
    "nearest_m",
    "answer_ms",
];

struct ModuleRow {
    id: String,
    title: String,
    label: String,
    state: &'static str,
    reason: &'static str,
    icon: &'static str,
    word: &'static str,
    because: String,
    /// Until when it is shelved, and who has done that.
    shelved: Option<(String, String)>,
    own: Option<&'static str>,
    /// Why its state is not the reported one.
    decided: String,
    since: String,
    message: ModuleMessage,
    values: Vec<MeasuredValue>,
    /// Its ERROR stays until somebody resets it.
    held: bool,
    reset: Option<ResetHtml>,
}

struct MeasuredValue {
    key: String,
    /// Empty where the message says it.
    value: String,
    past: Option<Past>,
}

/// The line of a value, and its least and greatest value in words.
struct Past {
    line: String,
    range: String,
}

struct ResetHtml {
    /// As a part of an address.
    address: String,
    version: u64,
    /// The fault is over: a reset is not refused.
    ready: bool,
}

#[derive(Template)]
#[template(path = "partials/detail.html")]
struct DetailHtml<'a> {
    words: &'static Words,
    swap: bool,
    path: &'a str,
    name: String,
    state: &'static str,
    reason: &'static str,
    icon: &'static str,
    word: &'static str,
    because: String,
    /// `2 faults of its own`, of a component that waits.
    own: String,
    since: String,
    count: String,
    /// Paths and names of the components from the root cause to this one.
    chain: Vec<(String, String)>,
    root: String,
    rows: Vec<ModuleRow>,
    more: Option<String>,
}

pub fn detail(view: &View<'_>, tile: Tile) -> Fragment {
    let id = view.board.tiles[tile];
    let (info, group) = view.snapshot.group(id);
    let mut modules = view.modules_of(id);
    let masked = matches!(group.reason, Some(Reason::Masked { .. }));
    modules.sort_by_key(|&module| std::cmp::Reverse(weight(view.snapshot.module(module).1)));
    let (chain, root) = if masked { why(view, tile) } else { (Vec::new(), String::new()) };
    let mut detail = DetailHtml {
        words: view.words,
        swap: view.swap,
        path: &info.path,
        name: view.group_name(id),
        state: group.state.as_str(),
        reason: reason_word(group.reason.as_ref()),
        icon: icon(group.state, group.reason.as_ref()),
        word: view.lang.state(group.state),
        because: view.reason(NodeId::Group(id), group.reason.as_ref()),
        own: match view.own_faults(id) {
            0 => String::new(),
            own => view.lang.own_faults(own),
        },
        since: view.wall(group.since),
        count: match group.counted {
            0 => view.hint(id).unwrap_or_default(),
            counted => format!("{}/{counted} {}", group.ok, view.words.ok),
        },
        chain,
        root,
        rows: modules.iter().take(ROWS).enumerate().map(|(index, &id)| row(view, tile, id, index)).collect(),
        more: None,
    };
    let html = fitting(&mut detail, BYTES / view.board.tiles.len().max(1), |shown| {
        let more = modules.len().saturating_sub(shown);
        (more > 0).then(|| view.lang.and_more(more))
    });
    Fragment { id: format!("{DETAIL}{}", info.path), html }
}

/// The panel in at most so many bytes: long ones lose their values, then their last rows.
fn fitting(detail: &mut DetailHtml<'_>, bytes: usize, more: impl Fn(usize) -> Option<String>) -> String {
    loop {
        detail.more = more(detail.rows.len());
        let text = html(&*detail);
        if detail.rows.is_empty() || text.len() + text.matches(['"', '\\', '\n']).count() <= bytes {
            return text;
        }
        if detail.rows.iter().any(|row| !row.values.is_empty()) {
            detail.rows.iter_mut().for_each(|row| row.values.clear());
        } else {
            detail.rows.truncate(detail.rows.len() / 2);
        }
    }
}

/// The way from the first root cause to this component, and what the root cause says.
fn why(view: &View<'_>, tile: Tile) -> (Vec<(String, String)>, String) {
    let (_, group) = view.snapshot.group(view.board.tiles[tile]);
    let Some(path) = group.paths.first() else { return (Vec::new(), String::new()) };
    let mut steps: Vec<Tile> = path.iter().filter_map(|&node| view.board.tile_of(node)).collect();
    steps.dedup();
    let named = |step: Tile| {
        let id = view.board.tiles[step];
        (view.snapshot.group(id).0.path.to_string(), view.group_name(id))
    };
    let chain = steps.into_iter().rev().map(named).collect();
    let root = match path.last() {
        Some(&NodeId::Module(id)) => view.fault(id, view.snapshot.module(id).1.state),
        _ => String::new(),
    };
    (chain, root)
}

/// Faults stand first; otherwise the order of the configuration stays.
fn weight(module: &ModuleView) -> u8 {
    match module.state {
        State::Error => 5,
        State::Unknown => 4,
        State::Warning => 3,
        State::Ignore if own_matters(module) => 2,
        _ => 1,
    }
}

fn row(view: &View<'_>, tile: Tile, id: ModuleId, index: usize) -> ModuleRow {
    let (info, module) = view.snapshot.module(id);
    let own = own_matters(module);
    let failing = if own { module.own } else { module.state };
    let label = view.label(info);
    let name = match failing {
        State::Ok | State::Ignore => view.name_of_part(info),
        fault => view.name_of_fault(info, fault),
    };
    ModuleRow {
        id: clean(&info.id, ID),
        label: if name.is_some() { label.clone() } else { String::new() },
        title: name.unwrap_or(label),
        state: module.state.as_str(),
        reason: reason_word(module.reason.as_ref()),
        icon: icon(module.state, module.reason.as_ref()),
        word: view.lang.state(module.state),
        because: view.reason(NodeId::Module(id), module.reason.as_ref()),
        shelved: view
            .snapshot
            .shelved(id)
            .map(|it| (view.wall(it.until), view.lang.shelved_by(&clean(&it.by, NAME)))),
        own: own.then(|| view.lang.state(module.own)),
        decided: decided(view, module),
        since: view.wall(module.since),
        message: view.message_of(module),
        values: values(view, id, index < ROWS_DRAWN),
        held: module.steps.latched,
        reset: reset(view, tile, id),
    }
}

/// Why a module's state differs from its report, if that is not its silence and its message does not tell it.
fn decided(view: &View<'_>, module: &ModuleView) -> String {
    let steps = module.steps;
    let differs = |&reported: &State| reported != module.own && module.why_unknown().is_none();
    let Some(reported) = steps.reported.filter(differs) else {
        return String::new();
    };
    if !module.silent && steps.debounced != steps.judged && !steps.latched {
        view.lang.reports_briefly(view.lang.state(reported))
    } else {
        String::new()
    }
}

/// The measured values of a module; a number of the last minutes is a line too.
fn values(view: &View<'_>, id: ModuleId, drawn: bool) -> Vec<MeasuredValue> {
    let (info, module) = view.snapshot.module(id);
    let past = view.trends.filter(|_| drawn && !module.report.values.is_empty());
    let mut past = past.map(|trends| trends.of(id.0 as usize, &info.id, POINTS_SMALL)).unwrap_or_default();
    // Limits are values too: a value that never changed needs no line.
    past.retain(|trend| trend.least < trend.most);
    past.truncate(VALUES_DRAWN);
    let measured = module.report.german.is_some();
    let says_numbers = measured && view.report_text(&module.report).contains(|it: char| it.is_ascii_digit());
    // A monitor's message names its limits already.
    let values = module.report.values.iter().filter(|(key, _)| !measured || !Limit::is_name(key));
    let value = values.take(VALUES).map(|(key, value)| {
        let past = past.iter().find(|trend| *trend.key == **key);
        let said = says_numbers && SAID.contains(&&**key);
        let (key, value) = (clean(key, VALUE), clean(value, VALUE));
        let (label, unit) = match measured {
            true => (view.lang.measured(&key).unwrap_or(&key), unit(&key)),
            false => (&*key, ""),
        };
        let quantity = info.quantity.as_ref().filter(|_| measured && MEASURED.contains(&&*key));
        let (unit, factor) = quantity.map_or((unit, 1.0), |it| (&*it.unit, it.factor));
        let read = |text: &str| view.lang.quantity(text, factor, unit);
        let past = past.map(|Trend { line, least, most, .. }| Past {
            line: line.clone(),
            range: format!("{} – {}", read(&least.to_string()), read(&most.to_string())),
        });
        MeasuredValue { key: label.to_owned(), value: if said { String::new() } else { read(&value) }, past }
    });
    value.filter(|it| !it.value.is_empty() || it.past.is_some()).collect()
}

fn reset(view: &View<'_>, tile: Tile, id: ModuleId) -> Option<ResetHtml> {
    let (info, module) = view.snapshot.module(id);
    (module.steps.latched && view.may_act()).then(|| ResetHtml {
        address: address(&info.id),
        version: view.seen.of(Aspect::Component(view.board.tiles[tile])),
        ready: !module.steps.in_error,
    })
}
