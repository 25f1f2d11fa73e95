//! The developer's first page: what was received, what of it failed, and every module.

use askama::Template;

use crate::engine::input::TroubleKind;
use crate::engine::model::{ModuleId, NodeId, Stage};
use crate::engine::time::Timestamp;

use super::clean::{MESSAGE, NAME, VALUE, clean};
use super::node::reason_word;
use super::pages::Frame;
use super::{PageContext, View, html};

/// Rows of the table; what is left out is counted below it.
const ROWS: usize = 2000;
const VALUES: usize = 16;

struct Trouble {
    topic: String,
    kind: &'static str,
    count: u64,
    last: String,
    text: String,
}

struct Row {
    id: String,
    state: &'static str,
    reason: &'static str,
    because: String,
    own: &'static str,
    since: String,
    age: String,
    silent: bool,
    class: String,
    message: String,
    values: Vec<(String, String)>,
}

#[derive(Template)]
#[template(path = "developer/index.html")]
struct DeveloperHtml {
    frame: Frame,
    locked: bool,
    vehicle: String,
    stage: &'static str,
    user: String,
    configuration: bool,
    at: String,
    seq: u64,
    troubles: Vec<Trouble>,
    counters: [(&'static str, u64); 6],
    signals: Vec<(String, &'static str)>,
    rows: Vec<Row>,
    more: Option<String>,
}

pub fn page(view: &View<'_>, context: &PageContext) -> String {
    let snapshot = view.snapshot;
    let locked = snapshot.stage == Stage::Locked;
    let modules = if locked { Vec::new() } else { by_group(view) };
    let more = modules.len().saturating_sub(ROWS);
    let words = view.words;
    html(&DeveloperHtml {
        frame: Frame::new(context.lang, context.palette),
        locked,
        vehicle: view.lang.pick(&snapshot.layout.vehicle_name, NAME),
        stage: snapshot.stage.as_str(),
        user: clean(&context.user, NAME),
        configuration: context.configuration,
        at: view.wall(snapshot.now),
        seq: snapshot.seq,
        troubles: if locked { Vec::new() } else { troubles(view) },
        counters: [
            (words.dev_arrays, snapshot.counters.arrays),
            (words.dev_statuses, snapshot.counters.statuses),
            (words.dev_dropped, snapshot.counters.dropped_names),
            (words.dev_unknown_signals, snapshot.counters.unknown_signals),
            (words.dev_samples, snapshot.counters.samples),
            (words.dev_dropped_samples, snapshot.counters.dropped_samples),
        ],
        signals: snapshot.signals.iter().map(|(name, value)| (clean(name, NAME), signal(*value))).collect(),
        rows: modules.iter().take(ROWS).map(|&module| row(view, module)).collect(),
        more: (more > 0).then(|| view.lang.and_more(more)),
    })
}

/// Every module, in the order of the groups; those of `other` come last.
fn by_group(view: &View<'_>) -> Vec<ModuleId> {
    let groups = view.snapshot.layout.groups.iter();
    groups.flat_map(|group| group.modules.iter().copied()).collect()
}

fn troubles(view: &View<'_>) -> Vec<Trouble> {
    let words = view.words;
    let kind = |kind| match kind {
        TroubleKind::Malformed => words.dev_malformed,
        TroubleKind::WrongType => words.dev_wrong_type,
        TroubleKind::Lost => words.dev_lost,
    };
    let troubles = view.snapshot.reception.iter().map(|trouble| Trouble {
        topic: clean(&trouble.topic, NAME),
        kind: kind(trouble.kind),
        count: trouble.count,
        last: view.wall(trouble.last),
        text: clean(&trouble.last_text, MESSAGE),
    });
    troubles.collect()
}

fn signal(value: Option<bool>) -> &'static str {
    match value {
        Some(true) => "true",
        Some(false) => "false",
        None => "unknown",
    }
}

fn row(view: &View<'_>, id: ModuleId) -> Row {
    let (info, module) = view.snapshot.module(id);
    let class = [Some(info.class.location), Some(info.class.information), info.class.flow];
    let values = module.report.values.iter().take(VALUES);
    Row {
        id: clean(&info.id, 2 * NAME),
        state: module.state.as_str(),
        reason: reason_word(module.reason.as_ref()),
        because: view.reason(NodeId::Module(id), module.reason.as_ref()),
        own: module.own.as_str(),
        since: view.wall(module.since),
        age: module.received.map_or_else(|| view.words.dev_never.to_owned(), |then| age(view, then)),
        silent: module.silent,
        class: class.into_iter().flatten().collect::<Vec<_>>().join(" "),
        message: clean(&module.report.message, MESSAGE),
        values: values.map(|(key, value)| (clean(key, VALUE), clean(value, VALUE))).collect(),
    }
}

fn age(view: &View<'_>, then: Timestamp) -> String {
    let ms = view.snapshot.now.since(then).as_millis();
    if ms < 10_000 { format!("{ms} ms") } else { format!("{} s", ms / 1000) }
}
