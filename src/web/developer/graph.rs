//! The page of the graph: groups and modules with their dependencies and present states, as boxes in
//! columns, each right of what it depends on, with the paths from root causes highlighted.

mod links;
mod open;

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;

use askama::Template;

use axum::response::Html;

use super::visit::Visit;
use crate::engine::model::{GroupId, ModuleId, NodeId};
use crate::engine::snapshot::GroupInfo;
use crate::picture::layers::{Item, Layers};
use crate::runtime::Published;
use crate::web::view::clean_text::{NAME, clean};
use crate::web::view::node_names::reason_word;
use crate::web::view::page_frame::Frame;
use crate::web::view::{PageContext, View, html};

use super::page_query::address;
use super::{DevFrame, Page, PageQuery, why_address};
use links::Link;
use open::Open;

const RENEW_MS: u32 = 0;
/// Modules drawn in one group that is open: fewer where many are, so that all of them are no more
/// than a browser draws at once.
const MODULES: usize = 60;
const MODULES_MIN: usize = 1;
const MODULES_IN_ALL: usize = 150;
/// Boxes at the top; what is beyond is named below the picture.
const BOXES: usize = 150;
/// Lines drawn: the hot ones first.
const LINES: usize = 1500;

const MARGIN: f64 = 16.0;
const WIDTH: f64 = 188.0;
const COLUMN_GAP: f64 = 54.0;
const BOX_GAP: f64 = 18.0;
const LANE: f64 = 12.0;
const PAD: f64 = 10.0;
const HEAD: f64 = 34.0;
const ROW: f64 = 22.0;
const ROW_STEP: f64 = 26.0;
/// What a letter takes at most.
const LETTER: f64 = 6.9;
const NAME_LETTER: f64 = 8.3;

struct BoxHtml {
    x: f64,
    y: f64,
    width: f64,
    height: f64,
    depth: usize,
    state: &'static str,
    reason: &'static str,
    name: String,
    count: String,
    title: String,
    why: String,
    /// Opens or closes the group.
    toggle: String,
    open: bool,
}

struct RowHtml {
    x: f64,
    y: f64,
    width: f64,
    state: &'static str,
    reason: &'static str,
    name: String,
    /// Empty where the name says it all.
    title: String,
    address: String,
}

struct LineHtml {
    path: String,
    head: String,
    any: bool,
    hot: bool,
    title: String,
}

#[derive(Template)]
#[template(path = "developer/graph.html")]
struct GraphHtml {
    frame: Frame,
    dev: DevFrame,
    width: f64,
    height: f64,
    boxes: Vec<BoxHtml>,
    rows: Vec<RowHtml>,
    lines: Vec<LineHtml>,
    left_out: Vec<(String, String)>,
}

/// `GET /developer/graph?open=GROUP`
pub async fn get(visit: Visit) -> Html<String> {
    Html(page(&visit.published, &visit.context, &visit.asked))
}

pub fn page(published: &Published, context: &PageContext, asked: &PageQuery) -> String {
    let view = &View::new(published, context.lang, false);
    let mut drawing = Drawing::of(view, asked);
    let lines = drawing.draw();
    html(&GraphHtml {
        frame: super::frame(context),
        dev: DevFrame::new(view, context, Page::Graph, RENEW_MS),
        width: drawing.width,
        height: drawing.height,
        boxes: drawing.boxes,
        rows: drawing.rows,
        lines,
        left_out: drawing.left_out,
    })
}

struct Drawing<'a> {
    view: &'a View<'a>,
    open: Open<'a>,
    /// Modules drawn in each group that is open.
    each: usize,
    /// What stands for each group and module in the picture.
    groups: Vec<Option<NodeId>>,
    modules: Vec<Option<NodeId>>,
    tops: Vec<GroupId>,
    /// Left edge, right edge and height of what is drawn.
    anchors: BTreeMap<NodeId, (f64, f64, f64)>,
    boxes: Vec<BoxHtml>,
    rows: Vec<RowHtml>,
    left_out: Vec<(String, String)>,
    width: f64,
    height: f64,
}

impl<'a> Drawing<'a> {
    fn of(view: &'a View<'a>, asked: &'a PageQuery) -> Drawing<'a> {
        let layout = &view.snapshot.layout;
        let is_there = |id: &GroupId| {
            let group = &layout.groups[id.0 as usize];
            group.parent.is_none() && !(group.is_other && group.modules.is_empty())
        };
        let mut tops: Vec<GroupId> = (0..layout.groups.len() as u32).map(GroupId).filter(is_there).collect();
        let beyond = tops.split_off(tops.len().min(BOXES));
        let name = |id: &GroupId| {
            let path = &layout.groups[id.0 as usize].path;
            (clean(path, 2 * NAME), why_address(path))
        };
        let open = Open::of(view, asked);
        let opened = layout.groups.iter().filter(|group| open.is(&group.path)).count().max(1);
        let mut drawing = Drawing {
            view,
            open,
            each: (MODULES_IN_ALL / opened).clamp(MODULES_MIN, MODULES),
            groups: vec![None; layout.groups.len()],
            modules: vec![None; layout.modules.len()],
            anchors: BTreeMap::new(),
            boxes: Vec::new(),
            rows: Vec::new(),
            left_out: beyond.iter().map(name).collect(),
            width: 0.0,
            height: 0.0,
            tops,
        };
        for top in drawing.tops.clone() {
            drawing.stand_for(top, None);
        }
        drawing
    }

    /// Notes what is drawn for a group and for all that is in it.
    fn stand_for(&mut self, id: GroupId, closed: Option<NodeId>) {
        let shown = closed.unwrap_or(NodeId::Group(id));
        self.groups[id.0 as usize] = Some(shown);
        let group = &self.view.snapshot.layout.groups[id.0 as usize];
        let closed = closed.or((!self.open.is(&group.path)).then_some(NodeId::Group(id)));
        for module in &group.modules {
            self.modules[module.0 as usize] = Some(closed.unwrap_or(NodeId::Group(id)));
        }
        if closed.is_none() {
            for module in self.drawn(group) {
                self.modules[module.0 as usize] = Some(NodeId::Module(module));
            }
        }
        for &inner in &group.groups {
            self.stand_for(inner, closed);
        }
    }

    /// The modules of a group that have a row of their own, in their order: where not all have one,
    /// the worst.
    fn drawn(&self, group: &GroupInfo) -> Vec<ModuleId> {
        let mut modules = group.modules.clone();
        if modules.len() > self.each {
            let state = |id: &ModuleId| {
                let module = self.view.snapshot.module(*id).1;
                (module.state, module.own)
            };
            modules.sort_by_key(|id| Reverse(state(id)));
            modules.truncate(self.each);
            modules.sort_unstable();
        }
        modules
    }

    fn shown(&self, node: NodeId) -> Option<NodeId> {
        match node {
            NodeId::Group(id) => self.groups[id.0 as usize],
            NodeId::Module(id) => self.modules[id.0 as usize],
        }
    }

    fn draw(&mut self) -> Vec<LineHtml> {
        let links = self.links();
        let tiles: Vec<(GroupId, f64)> = self.tops.iter().map(|&id| (id, self.box_height(id))).collect();
        let ends: Vec<(GroupId, GroupId)> =
            links.keys().map(|&(on, from)| (self.top(on), self.top(from))).collect();
        // Lines between the same two boxes share their lanes.
        let ways: Vec<(GroupId, GroupId)> =
            ends.iter().copied().collect::<BTreeSet<_>>().into_iter().collect();
        let layers = Layers::of(&tiles, &ways, BOX_GAP, LANE);
        for (column, items) in layers.columns.iter().enumerate() {
            for (item, top) in items {
                if let Item::Tile(id) = item {
                    self.group(*id, column_x(column), MARGIN + top, WIDTH, 0);
                }
            }
        }
        let columns = layers.columns.len().max(1) as f64;
        self.width = MARGIN * 2.0 + columns * (WIDTH + COLUMN_GAP) - COLUMN_GAP;
        self.height = MARGIN * 2.0 + layers.height;
        let mut all: Vec<_> = links.iter().zip(&ends).collect();
        all.sort_by_key(|((_, link), _)| Reverse(link.hot));
        all.truncate(LINES);
        // What is hot is drawn last, over the rest.
        let mut lines = Vec::with_capacity(all.len());
        for ((&(on, from), link), way) in all.into_iter().rev() {
            let lanes = ways.binary_search(way).map(|index| layers.lanes(index, MARGIN)).unwrap_or_default();
            lines.extend(self.line(on, from, link, &lanes));
        }
        lines
    }

    fn top(&self, node: NodeId) -> GroupId {
        let layout = &self.view.snapshot.layout;
        let mut id = match node {
            NodeId::Group(id) => id,
            NodeId::Module(id) => layout.modules[id.0 as usize].group,
        };
        while let Some(parent) = layout.groups[id.0 as usize].parent {
            id = parent;
        }
        id
    }

    fn box_height(&self, id: GroupId) -> f64 {
        let group = &self.view.snapshot.layout.groups[id.0 as usize];
        if !self.open.is(&group.path) {
            return HEAD;
        }
        let rows = group.modules.len().min(self.each) + usize::from(group.modules.len() > self.each);
        let inner: f64 = group.groups.iter().map(|&id| self.box_height(id) + 6.0).sum();
        HEAD + rows as f64 * ROW_STEP + inner + 4.0
    }

    fn group(&mut self, id: GroupId, x: f64, y: f64, width: f64, depth: usize) {
        let (info, group) = self.view.snapshot.group(id);
        let open = self.open.is(&info.path);
        let height = self.box_height(id);
        let name = self.view.group_name(id);
        let state = self.view.lang.state(group.state);
        let because = self.view.reason(NodeId::Group(id), group.reason.as_ref());
        self.boxes.push(BoxHtml {
            x,
            y,
            width,
            height,
            depth: depth.min(3),
            state: group.state.as_str(),
            reason: reason_word(group.reason.as_ref()),
            name: fitted(&name, width - 84.0, NAME_LETTER),
            // Of what is ignored nothing counts.
            count: if group.counted == 0 {
                "\u{2013}".to_owned()
            } else {
                format!("{}/{}", group.ok, group.counted)
            },
            title: format!("{}: {state} {because}", clean(&info.path, 2 * NAME)),
            why: why_address(&info.path),
            toggle: self.open.toggle(&self.view.snapshot.layout, &info.path),
            open,
        });
        self.anchors.insert(NodeId::Group(id), (x, x + width, y + HEAD / 2.0));
        if !open {
            return;
        }
        let mut top = y + HEAD;
        for module in self.drawn(info) {
            self.module(module, x + PAD, top, width - PAD * 2.0);
            top += ROW_STEP;
        }
        if info.modules.len() > self.each {
            let more = info.modules.len() - self.each;
            self.rows.push(RowHtml {
                x: x + PAD,
                y: top,
                width: width - PAD * 2.0,
                state: "more",
                reason: "",
                name: self.view.lang.and_more(more),
                title: String::new(),
                address: format!("/developer{}", address([("group", &*info.path)].into_iter())),
            });
            top += ROW_STEP;
        }
        for inner in info.groups.clone() {
            self.group(inner, x + PAD, top, width - PAD * 2.0, depth + 1);
            top += self.box_height(inner) + 6.0;
        }
    }

    fn module(&mut self, id: ModuleId, x: f64, y: f64, width: f64) {
        let (info, module) = self.view.snapshot.module(id);
        let state = self.view.lang.state(module.state);
        let because = self.view.reason(NodeId::Module(id), module.reason.as_ref());
        self.rows.push(RowHtml {
            x,
            y,
            width,
            state: module.state.as_str(),
            reason: reason_word(module.reason.as_ref()),
            name: fitted(&self.view.label(info), width - 16.0, LETTER),
            title: format!("{}: {state} {because}", clean(&info.id, 2 * NAME)),
            address: why_address(&info.id),
        });
        self.anchors.insert(NodeId::Module(id), (x, x + width, y + ROW / 2.0));
    }

    fn line(&self, on: NodeId, from: NodeId, link: &Link, lanes: &[(usize, f64)]) -> Option<LineHtml> {
        let &(on_left, on_right, on_y) = self.anchors.get(&on)?;
        let &(to_left, _, to_y) = self.anchors.get(&from)?;
        let mut path = String::new();
        if self.top(on) == self.top(from) {
            let out = on_left.min(to_left) - 9.0;
            let _ = write!(
                path,
                "M{on_left:.0} {on_y:.0}C{out:.0} {on_y:.0} {out:.0} {to_y:.0} {:.0} {to_y:.0}",
                to_left - 5.0
            );
        } else {
            let _ = write!(path, "M{on_right:.0} {on_y:.0}");
            let (mut x, mut y) = (on_right, on_y);
            let mut bend = |path: &mut String, to_x: f64, to_y: f64| {
                let half = ((to_x - x) / 2.0).abs().max(24.0);
                let _ =
                    write!(path, "C{:.0} {y:.0} {:.0} {to_y:.0} {to_x:.0} {to_y:.0}", x + half, to_x - half);
                (x, y) = (to_x, to_y);
            };
            for &(column, lane_y) in lanes {
                bend(&mut path, column_x(column), lane_y);
                bend(&mut path, column_x(column) + WIDTH, lane_y);
            }
            bend(&mut path, to_left - 5.0, to_y);
        }
        let name = |node: NodeId| clean(self.view.snapshot.node_name(node), 2 * NAME);
        let times = if link.count > 1 { format!(" (\u{d7}{})", link.count) } else { String::new() };
        Some(LineHtml {
            path,
            head: format!("M{to_left:.0} {to_y:.0}l-8 -4v8z"),
            any: link.any,
            hot: link.hot,
            title: format!("{} \u{2192} {}{times}", name(on), name(from)),
        })
    }
}

fn column_x(column: usize) -> f64 {
    MARGIN + column as f64 * (WIDTH + COLUMN_GAP)
}

fn fitted(text: &str, width: f64, letter: f64) -> String {
    let most = (width / letter).max(4.0) as usize;
    if text.chars().count() <= most {
        return text.to_owned();
    }
    let kept: String = text.chars().take(most - 1).collect();
    format!("{kept}\u{2026}")
}
