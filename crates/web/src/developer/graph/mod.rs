//! The page of the graph: groups and modules with their dependencies and present states, with the paths from
//! root causes highlighted.

mod links;
mod near;
mod open;

use std::cmp::Reverse;

use askama::Template;
use axum::extract::State;
use axum::response::Html;

use super::learn::Outcome;
use super::page_query::address;
use super::request::PageRequest;
use super::{DevFrame, Page, PageQuery, why_address};
use crate::AppState;
use crate::texts::{LearnWords, NAME, clean};
use crate::view::node_names::reason_word;
use crate::view::page::frame::PageFrame;
use crate::view::{PageContext, View, html};
use links::Link;
use near::Near;
pub(super) use near::neighbourhood;
use open::OpenGroups;
use telltale_engine::model::{GroupId, ModuleId, NodeId};
use telltale_engine::snapshot::GroupInfo;
use telltale_picture::graph::{self, Arrow, Drawing, GroupBox, Label, Row, Style, Toggle};
use telltale_picture::svg::Attributes;
use telltale_runtime::Published;

const RENEW_MS: u32 = 0;
const KEPT: &str = "&proposed=yes";
/// Modules drawn in one group that is open: fewer where many are, so that all of them are no more
/// than a browser draws at once.
const MODULES: usize = 60;
const MODULES_MIN: usize = 1;
const MODULES_IN_ALL: usize = 150;
/// Boxes at the top; further ones are named below the picture.
const BOXES: usize = 150;

const STYLE: Style = Style {
    margin: 12.0,
    box_width: 198.0,
    column_gap: 32.0,
    box_gap: 18.0,
    arrow_height: 12.0,
    padding: 10.0,
    header_height: 34.0,
    name_at: (16.0, 22.0),
    name_letter: 8.3,
    row_letter: 7.1,
    arrows_max: 1500,
};

#[derive(Template)]
#[template(path = "developer/graph.html")]
struct GraphHtml {
    frame: PageFrame,
    dev: DevFrame,
    it: &'static LearnWords,
    drawing: Drawing,
    /// The end of an address at which the proposals of the history are drawn, if they are.
    kept: &'static str,
    left_out: Vec<(String, String)>,
}

/// `GET /developer/graph?open=GROUP&proposed=yes`
pub async fn get(State(app): State<AppState>, request: PageRequest) -> Html<String> {
    let last = app.learning.progress().last;
    let proposed = last.as_deref().filter(|_| request.query.get("proposed") == "yes");
    Html(drawn(&request.published, &request.context, &request.query, proposed))
}

pub fn page(published: &Published, context: &PageContext, query: &PageQuery) -> String {
    drawn(published, context, query, None)
}

/// With what the history proposes.
fn drawn(
    published: &Published,
    context: &PageContext,
    query: &PageQuery,
    proposed: Option<&Outcome>,
) -> String {
    let view = &View::new(published, context.lang, false);
    let mut graph = Graph::of(view, query);
    graph.kept = proposed.map_or("", |_| KEPT);
    graph.proposed = proposed.map(|it| it.added(view.snapshot)).unwrap_or_default();
    let layout = &view.snapshot.layout;
    let beyond = graph.tops.split_off(graph.tops.len().min(BOXES));
    for top in graph.tops.clone() {
        graph.stand_for(top, None);
    }
    let boxes: Vec<GroupBox> = graph.tops.iter().map(|&top| graph.group(top)).collect();
    let name = |id: GroupId| {
        let path = &layout.groups[id.0 as usize].path;
        (clean(path, 2 * NAME), why_address(path))
    };
    html(&GraphHtml {
        frame: super::frame(context),
        dev: DevFrame::new(view, context, Page::Graph, RENEW_MS),
        it: LearnWords::of(context.lang),
        drawing: graph::draw(&STYLE, &boxes, &graph.arrows()),
        kept: graph.kept,
        left_out: beyond.into_iter().map(name).collect(),
    })
}

struct Graph<'a> {
    view: &'a View<'a>,
    open: OpenGroups<'a>,
    /// Only a node and its neighbours are drawn.
    near: Option<Near>,
    /// Modules drawn in each group that is open.
    each: usize,
    /// The node that is drawn for each group and module.
    groups: Vec<Option<NodeId>>,
    modules: Vec<Option<NodeId>>,
    tops: Vec<GroupId>,
    /// Dependencies that the history proposes: the cause, and what depends on it.
    proposed: Vec<(NodeId, NodeId)>,
    /// The end of the addresses that keep these.
    kept: &'static str,
}

impl<'a> Graph<'a> {
    fn of(view: &'a View<'a>, query: &'a PageQuery) -> Graph<'a> {
        let layout = &view.snapshot.layout;
        let is_there = |id: &GroupId| {
            let group = &layout.groups[id.0 as usize];
            group.parent.is_none() && !((group.is_other || group.is_system) && group.modules.is_empty())
        };
        let open = OpenGroups::of(view, query);
        let opened = layout.groups.iter().filter(|group| open.is(&group.path)).count().max(1);
        Graph {
            view,
            open,
            near: None,
            each: (MODULES_IN_ALL / opened).clamp(MODULES_MIN, MODULES),
            groups: vec![None; layout.groups.len()],
            modules: vec![None; layout.modules.len()],
            tops: (0..layout.groups.len() as u32).map(GroupId).filter(is_there).collect(),
            proposed: Vec::new(),
            kept: "",
        }
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
        let is_near = |id: &ModuleId| self.near.as_ref().is_none_or(|near| near.has(NodeId::Module(*id)));
        let mut modules: Vec<ModuleId> = group.modules.iter().copied().filter(is_near).collect();
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

    /// Hot arrows are drawn last, over the others.
    fn arrows(&self) -> Vec<Arrow> {
        let name = |node: NodeId| clean(self.view.snapshot.node_name(node), 2 * NAME);
        let mut links: Vec<((NodeId, NodeId), Link)> = self.links().into_iter().collect();
        links.sort_by_key(|(_, link)| link.hot);
        let arrow = |((on, from), link): ((NodeId, NodeId), Link)| {
            let times = if link.count > 1 { format!(" (\u{d7}{})", link.count) } else { String::new() };
            Arrow {
                on,
                from,
                class: if link.any { "line any" } else { "line" }.to_owned(),
                title: format!("{} \u{2192} {}{times}", name(on), name(from)),
                attributes: if link.hot { vec![("data-hot", String::new())] } else { Vec::new() },
            }
        };
        let proposed = self.proposed.iter().filter_map(|&(cause, dependent)| {
            let (on, from) = (self.shown(cause)?, self.shown(dependent)?);
            (on != from).then(|| Arrow {
                on,
                from,
                class: "line proposed".to_owned(),
                title: format!(
                    "{}: {} \u{2192} {}",
                    LearnWords::of(self.view.lang).legend,
                    name(cause),
                    name(dependent)
                ),
                attributes: Vec::new(),
            })
        });
        links.into_iter().map(arrow).chain(proposed).collect()
    }

    fn group(&self, id: GroupId) -> GroupBox {
        let (info, group) = self.view.snapshot.group(id);
        let is_open = self.open.is(&info.path);
        let name = self.view.group_name(id);
        let state = self.view.lang.state(group.state);
        let because = self.view.reason(NodeId::Group(id), group.reason.as_ref());
        // No member of an ignored group counts.
        let count = match group.counted {
            0 => "\u{2013}".to_owned(),
            counted => format!("{}/{counted}", group.ok),
        };
        let toggle = vec![
            ("data-soft", String::new()),
            ("href", self.open.toggle(&self.view.snapshot.layout, &info.path) + self.kept),
            ("aria-expanded", is_open.to_string()),
            ("aria-label", name.clone()),
        ];
        let inside = is_open.then_some(info);
        GroupBox {
            id,
            label: Label {
                text: name,
                title: format!("{}: {state} {because}", clean(&info.path, 2 * NAME)),
                attributes: self.look(NodeId::Group(id)),
                link: Some(row_link(why_address(&info.path))),
            },
            notes: Vec::new(),
            toggle: self.near.is_none().then_some(Toggle { count, is_open, link: toggle }),
            rows: inside.map(|info| self.rows(info)).unwrap_or_default(),
            inner: inside
                .into_iter()
                .flat_map(|info| &info.groups)
                .filter(|&&inner| self.near.as_ref().is_none_or(|near| near.has(NodeId::Group(inner))))
                .map(|&inner| self.group(inner))
                .collect(),
        }
    }

    fn rows(&self, group: &GroupInfo) -> Vec<Row> {
        let more = group.modules.len().saturating_sub(self.each);
        let more = (more > 0).then(|| Row {
            id: None,
            label: Label {
                text: self.view.lang.and_more(more),
                title: String::new(),
                attributes: vec![("data-state", "more".to_owned())],
                link: Some(row_link(format!("/developer{}", address([("group", &*group.path)].into_iter())))),
            },
        });
        self.drawn(group).into_iter().map(|id| self.row(id)).chain(more).collect()
    }

    fn look(&self, node: NodeId) -> Attributes {
        let (state, reason) = self.view.snapshot.shown(node);
        let reason = reason.map(|reason| ("data-reason", reason_word(Some(reason)).to_owned()));
        let is_it = self.near.as_ref().is_some_and(|near| near.node == node);
        let mark = is_it.then(|| ("data-here", String::new()));
        std::iter::once(("data-state", state.as_str().to_owned())).chain(reason).chain(mark).collect()
    }

    fn row(&self, id: ModuleId) -> Row {
        let (info, module) = self.view.snapshot.module(id);
        let state = self.view.lang.state(module.state);
        let because = self.view.reason(NodeId::Module(id), module.reason.as_ref());
        let label = Label {
            text: self.view.label(info),
            title: format!("{}: {state} {because}", clean(&info.id, 2 * NAME)),
            attributes: self.look(NodeId::Module(id)),
            link: Some(row_link(why_address(&info.id))),
        };
        Row { id: Some(id), label }
    }
}

/// The keys of the page go from one such link to the next.
fn row_link(address: String) -> Attributes {
    vec![("data-open", String::new()), ("data-row", String::new()), ("href", address)]
}
