//! A tile, which shows one component, and the arrows between components.

use askama::Template;

use telltale_engine::model::{GroupId, NodeId};
use telltale_engine::snapshot::{Reason, Shelved};
use telltale_engine::state::State;

use super::{Tile, arrows as lines};
use crate::view::node_names::{icon, reason_word};
use crate::view::{Fragment, View, html};

#[derive(Template)]
#[template(path = "partials/tile.html")]
struct TileHtml<'a> {
    swap: bool,
    path: &'a str,
    place: (usize, usize),
    name: String,
    state: &'static str,
    reason: &'static str,
    icon: &'static str,
    word: &'static str,
    line: String,
    /// How many faults it reports while it waits, and the same in words.
    own: Option<(usize, String)>,
    flashes: bool,
    /// A module in it is shelved.
    shelved: bool,
}

pub fn tile(view: &View<'_>, tile: Tile) -> Fragment {
    let id = view.board.tiles[tile];
    let (info, group) = view.snapshot.group(id);
    let (word, line) = match (group.state, &group.reason) {
        // `Waiting for` and the name of the cause, or `Not active`.
        (State::Ignore, Some(Reason::Masked { by })) => {
            (view.words.waiting, view.cause_name(NodeId::Group(id), by))
        }
        (State::Ignore, _) => (view.words.not_active, String::new()),
        (state, _) => {
            let line = match shelved(view, tile) {
                0 => count(view, id),
                shelved => view.lang.so_many_shelved(shelved),
            };
            (view.lang.state(state), line)
        }
    };
    let (column, row) = view.board.places[tile];
    let html = html(&TileHtml {
        swap: view.swap,
        path: &info.path,
        place: (column + 1, row + 1),
        name: view.group_name(id),
        state: group.state.as_str(),
        reason: reason_word(group.reason.as_ref()),
        icon: icon(group.state, group.reason.as_ref()),
        word,
        line,
        own: Some(view.own_faults(id)).filter(|&own| own > 0).map(|own| (own, view.lang.own_faults(own))),
        flashes: flashes(view, tile),
        shelved: shelved(view, tile) > 0,
    });
    Fragment { id: format!("tile-{}", info.path), html }
}

/// How many of the modules are OK: `3/3 OK`.
fn count(view: &View<'_>, id: GroupId) -> String {
    let (_, group) = view.snapshot.group(id);
    match group.state {
        State::Ok if group.counted == 0 => view.words.none_undeclared.to_owned(),
        _ if group.counted == 0 => view.no_member(id),
        State::Unknown if group.ok == 0 => view.words.no_news.to_owned(),
        _ => format!("{}/{} {}", group.ok, group.counted, view.words.ok),
    }
}

/// How many of its modules a developer has shelved.
fn shelved(view: &View<'_>, tile: Tile) -> usize {
    let its = |it: &&Shelved| view.board.tile_of(NodeId::Module(it.module)) == Some(tile);
    view.snapshot.shelved.iter().filter(its).count()
}

/// A tile flashes while an alarm in it waits to be acknowledged.
fn flashes(view: &View<'_>, tile: usize) -> bool {
    let alarms = view.snapshot.alarms.iter().filter(|alarm| alarm.active && !alarm.acknowledged);
    let mut nodes = alarms.map(|alarm| alarm.node);
    nodes.any(|node: NodeId| view.board.tile_of(node) == Some(tile))
}

struct ArrowHtml<'a> {
    from: &'a str,
    to: &'a str,
    hot: bool,
    line: String,
    tip: (String, String),
    head: &'static str,
}

#[derive(Template)]
#[template(path = "partials/arrows.html")]
struct ArrowsHtml<'a> {
    swap: bool,
    width: f64,
    height: f64,
    arrows: Vec<ArrowHtml<'a>>,
}

/// All arrows in one drawing, those of a root-cause path on top.
pub fn arrows(view: &View<'_>) -> Fragment {
    let hot = view.board.hot_edges(view.snapshot);
    let mut edges = view.board.edges.clone();
    edges.extend(hot.iter().filter(|edge| !view.board.edges.contains(edge)));
    let ((width, height), drawn) = lines::draw(&view.board, &edges);
    let path = |tile: Tile| &*view.snapshot.group(view.board.tiles[tile]).0.path;
    let mut arrows: Vec<ArrowHtml<'_>> = drawn
        .into_iter()
        .map(|arrow| ArrowHtml {
            from: path(arrow.from),
            to: path(arrow.to),
            hot: hot.contains(&(arrow.from, arrow.to)),
            line: arrow.line,
            tip: arrow.tip,
            head: arrow.head,
        })
        .collect();
    arrows.sort_by_key(|arrow| arrow.hot);
    let html = html(&ArrowsHtml { swap: view.swap, width, height, arrows });
    Fragment { id: "arrows".to_owned(), html }
}
