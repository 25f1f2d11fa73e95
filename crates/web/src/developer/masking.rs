//! The page of masking: each hidden node, its causes, since when, and its own state.

use askama::Template;

use axum::response::Html;

use super::request::PageRequest;
use crate::texts::{DevWords, MESSAGE, clean};
use crate::view::page::frame::PageFrame;
use crate::view::{PageContext, View, html};
use telltale_engine::model::NodeId;
use telltale_engine::snapshot::Reason;
use telltale_engine::state::State;
use telltale_engine::time::Timestamp;
use telltale_runtime::Published;

use super::pager::Pager;
use super::{DevFrame, NodeLink, Page, PageQuery};

/// Rows of one page of a table.
const ROWS: usize = 40;
/// Root causes named beside one node.
const NAMED: usize = 6;
/// The durations of silences count on.
const RENEW_MS: u32 = 1000;

struct HiddenRow {
    node: NodeLink,
    by: Vec<NodeLink>,
    more: usize,
    because: String,
    since: String,
    own: &'static str,
    own_word: &'static str,
    message: String,
}

/// The ids of a table and of its counter, and its field in the address.
struct TableKind {
    id: &'static str,
    counter: &'static str,
    field: &'static str,
}

const MASKED: TableKind = TableKind { id: "masked", counter: "masked-count", field: "page" };
const NOT_RELEVANT: TableKind =
    TableKind { id: "not-relevant", counter: "not-relevant-count", field: "page-idle" };

/// The hidden nodes of one kind, the worst and then the oldest first.
struct HiddenTable {
    id: &'static str,
    title: &'static str,
    nothing: &'static str,
    masked: bool,
    rows: Vec<HiddenRow>,
    pager: Pager,
    /// Nodes that report an ERROR behind what they show.
    behind: usize,
}

#[derive(Template)]
#[template(path = "developer/masking.html")]
struct MaskingHtml {
    frame: PageFrame,
    dev: DevFrame,
    filter: String,
    tables: [HiddenTable; 2],
}

/// `GET /developer/masking?q=TEXT&page=N&page-idle=N`
pub async fn get(request: PageRequest) -> Html<String> {
    Html(page(&request.published, &request.context, &request.query))
}

pub fn page(published: &Published, context: &PageContext, query: &PageQuery) -> String {
    let view = &View::new(published, context.lang, false);
    let words = DevWords::of(context.lang);
    let hidden = hidden(view, &query.get("q").to_lowercase());
    let (masked, irrelevant): (Vec<_>, Vec<_>) = hidden.into_iter().partition(|hidden| hidden.masked);
    html(&MaskingHtml {
        frame: super::frame(context),
        dev: DevFrame::new(view, context, Page::Masking, RENEW_MS),
        filter: clean(query.get("q"), MESSAGE),
        tables: [
            table(view, query, &MASKED, (words.masked, words.nothing_masked), masked),
            table(view, query, &NOT_RELEVANT, (words.not_relevant, words.nothing_irrelevant), irrelevant),
        ],
    })
}

struct Hidden {
    node: NodeId,
    masked: bool,
    own: State,
    since: Timestamp,
}

fn hidden(view: &View<'_>, filter: &str) -> Vec<Hidden> {
    let snapshot = view.snapshot;
    let nodes = snapshot.layout.nodes().filter_map(|node| {
        let (_, reason) = snapshot.shown(node);
        let masked = matches!(reason?, Reason::Masked { .. });
        let since = match node {
            NodeId::Group(id) => snapshot.group(id).1.since,
            NodeId::Module(id) => snapshot.module(id).1.since,
        };
        Some(Hidden { node, masked, own: snapshot.own(node), since })
    });
    let wanted = |node: NodeId| filter.is_empty() || snapshot.node_name(node).to_lowercase().contains(filter);
    let mut hidden: Vec<Hidden> = nodes.filter(|hidden| wanted(hidden.node)).collect();
    hidden.sort_by(|a, b| b.own.cmp(&a.own).then(a.since.cmp(&b.since)));
    hidden
}

fn table(
    view: &View<'_>,
    query: &PageQuery,
    kind: &TableKind,
    (title, nothing): (&'static str, &'static str),
    hidden: Vec<Hidden>,
) -> HiddenTable {
    let (pager, shown) = Pager::of(query, kind.counter, kind.field, hidden.len(), ROWS);
    HiddenTable {
        id: kind.id,
        title,
        nothing,
        masked: kind.id == MASKED.id,
        behind: hidden.iter().filter(|hidden| hidden.own == State::Error).count(),
        rows: hidden[shown].iter().map(|hidden| row(view, hidden)).collect(),
        pager,
    }
}

fn row(view: &View<'_>, hidden: &Hidden) -> HiddenRow {
    let snapshot = view.snapshot;
    let (_, reason) = snapshot.shown(hidden.node);
    let by: &[NodeId] = match reason {
        Some(Reason::Masked { by }) => by,
        _ => &[],
    };
    let because = match reason {
        Some(Reason::NotRelevant(because)) => view.lang.not_relevant(because, &snapshot.layout),
        _ => String::new(),
    };
    let message = match hidden.node {
        NodeId::Module(id) => view.message_text(snapshot.module(id).1),
        NodeId::Group(_) => String::new(),
    };
    HiddenRow {
        node: NodeLink::of(view, hidden.node),
        by: by.iter().take(NAMED).map(|&node| NodeLink::of(view, node)).collect(),
        more: by.len().saturating_sub(NAMED),
        because,
        since: view.wall(hidden.since),
        own: hidden.own.as_str(),
        own_word: view.lang.state(hidden.own),
        message,
    }
}
