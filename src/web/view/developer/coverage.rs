//! In which ways of the paper's classification (Sec. III-B, Fig. 3) each group is diagnosed.

use askama::Template;

use crate::engine::model::{GroupId, ModuleId, NodeId};
use crate::engine::snapshot::Class;
use crate::web::view::clean::{NAME, clean};
use crate::web::view::pages::Frame;
use crate::web::view::{PageContext, View, html};

use super::pager::Pager;
use super::words::DevWords;
use super::{Asked, DevFrame, NodeLink, Page};

/// The columns: location, information, flow. An isolated diagnosis has no flow.
const CELLS: [(&str, &str, Option<&str>); 6] = [
    ("isolated", "content", None),
    ("isolated", "meta", None),
    ("contextual", "content", Some("sequential")),
    ("contextual", "content", Some("parallel")),
    ("contextual", "meta", Some("sequential")),
    ("contextual", "meta", Some("parallel")),
];
/// Groups of one page.
const ROWS: usize = 120;
/// Modules listed of one cell.
const LISTED: usize = 200;
const RENEW_MS: u32 = 0;

struct Cell {
    count: usize,
    address: String,
    open: bool,
}

struct Row {
    name: String,
    path: String,
    depth: usize,
    cells: Vec<Cell>,
    sum: usize,
}

struct Listed {
    title: String,
    modules: Vec<(NodeLink, &'static str, &'static str)>,
    more: Option<String>,
}

#[derive(Template)]
#[template(path = "developer/coverage.html")]
struct CoverageHtml {
    frame: Frame,
    dev: DevFrame,
    /// A module stands in none of the six cells: there is a seventh.
    unstated: bool,
    pager: Pager,
    rows: Vec<Row>,
    total: Vec<usize>,
    listed: Option<Listed>,
}

pub fn page(view: &View<'_>, context: &PageContext, asked: &Asked) -> String {
    let words = DevWords::of(context.lang);
    let layout = &view.snapshot.layout;
    let unstated = layout.modules.iter().any(|module| cell(module.class) == CELLS.len());
    let columns = CELLS.len() + usize::from(unstated);
    let mut rows: Vec<Row> = ordered(view).into_iter().map(|id| row(view, id, columns, asked)).collect();
    let total = (0..columns).map(|column| rows.iter().map(|row| row.cells[column].count).sum()).collect();
    let (pager, shown) = Pager::of(asked, "matching", "page", rows.len(), ROWS);
    rows.truncate(shown.end);
    rows.drain(..shown.start);
    html(&CoverageHtml {
        frame: super::frame(context),
        dev: DevFrame::new(view, context, Page::Coverage, RENEW_MS),
        unstated,
        pager,
        rows,
        total,
        listed: listed(view, words, asked),
    })
}

/// The position among the columns; one past the six where none fits.
fn cell(class: Class) -> usize {
    let fits = |(location, information, flow): &(&str, &str, Option<&str>)| {
        (class.location, class.information) == (*location, *information)
            && (class.flow == *flow || class.location == "isolated")
    };
    CELLS.iter().position(fits).unwrap_or(CELLS.len())
}

/// Each group before what it contains. Empty groups that are built in are left out.
fn ordered(view: &View<'_>) -> Vec<GroupId> {
    let groups = &view.snapshot.layout.groups;
    let is_there = |id: &GroupId| {
        let group = &groups[id.0 as usize];
        !(group.is_other && group.modules.is_empty())
    };
    let tops = (0..groups.len() as u32).map(GroupId).filter(|id| groups[id.0 as usize].parent.is_none());
    let mut waiting: Vec<GroupId> = tops.filter(is_there).collect();
    waiting.reverse();
    let mut ordered = Vec::with_capacity(groups.len());
    while let Some(id) = waiting.pop() {
        ordered.push(id);
        waiting.extend(groups[id.0 as usize].groups.iter().rev());
    }
    ordered
}

fn row(view: &View<'_>, id: GroupId, columns: usize, asked: &Asked) -> Row {
    let group = &view.snapshot.layout.groups[id.0 as usize];
    let open = chosen(asked);
    let mut cells: Vec<Cell> = (0..columns)
        .map(|column| {
            let address = asked.with("cell", &format!("{column} {}", group.path));
            Cell { count: 0, address, open: open == Some((column, &*group.path)) }
        })
        .collect();
    for &module in &group.modules {
        cells[cell(view.snapshot.module(module).0.class)].count += 1;
    }
    Row {
        name: view.group_name(id),
        path: clean(&group.path, 2 * NAME),
        depth: group.path.matches('/').count().min(5),
        cells,
        sum: group.modules.len(),
    }
}

/// Column and group of the cell that is asked for.
fn chosen(asked: &Asked) -> Option<(usize, &str)> {
    let (column, path) = asked.get("cell").split_once(' ')?;
    Some((column.parse().ok()?, path))
}

fn listed(view: &View<'_>, words: &'static DevWords, asked: &Asked) -> Option<Listed> {
    let (column, path) = chosen(asked)?;
    let Some(NodeId::Group(id)) = view.snapshot.node(path) else { return None };
    let in_cell = |&&module: &&ModuleId| cell(view.snapshot.module(module).0.class) == column;
    let (info, _) = view.snapshot.group(id);
    let modules: Vec<ModuleId> = info.modules.iter().filter(in_cell).copied().collect();
    let way = CELLS.get(column).map_or(words.unstated.to_owned(), |(location, information, flow)| {
        [Some(*location), Some(*information), *flow].into_iter().flatten().collect::<Vec<_>>().join(" ")
    });
    let more = modules.len().saturating_sub(LISTED);
    let module = |&id: &ModuleId| {
        let state = view.snapshot.module(id).1.state;
        (NodeLink::of(view, NodeId::Module(id)), state.as_str(), view.lang.state(state))
    };
    Some(Listed {
        title: format!("{}: {way}", view.group_name(id)),
        modules: modules.iter().take(LISTED).map(module).collect(),
        more: (more > 0).then(|| view.lang.and_more(more)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_monitor_has_its_cell() {
        for (location, information, flow, column) in [
            ("isolated", "content", None, 0),
            ("isolated", "meta", Some("parallel"), 1),
            ("contextual", "content", Some("sequential"), 2),
            ("contextual", "content", Some("parallel"), 3),
            ("contextual", "meta", Some("sequential"), 4),
            ("contextual", "meta", None, 6),
        ] {
            assert_eq!(cell(Class { location, information, flow }), column, "{location} {information}");
        }
    }
}
