//! The page of the coverage: the techniques of the paper's classification (Sec. III-B, Fig. 3) with which
//! each group is diagnosed.

use std::collections::BTreeMap;

use askama::Template;

use axum::response::Html;

use super::request::PageRequest;
use crate::texts::{DevWords, NAME, clean};
use crate::view::page::frame::PageFrame;
use crate::view::{PageContext, View, html};
use telltale_engine::model::{GroupId, ModuleId, NodeId};
use telltale_engine::snapshot::ModuleInfo;
use telltale_runtime::Published;

use super::pager::Pager;
use super::{DevFrame, NodeLink, Page, PageQuery, why_address};

/// The columns of the paper's Fig. 3.
const COLUMNS: usize = 5;
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

struct GroupRow {
    name: String,
    path: String,
    why: String,
    depth: usize,
    cells: Vec<Cell>,
    sum: usize,
}

/// The kinds of monitor in each column, about components or about data streams, with their numbers.
struct Technique {
    name: &'static str,
    columns: Vec<Vec<(&'static str, usize)>>,
    sum: usize,
}

struct CellModules {
    title: String,
    /// Components, then data streams; without those that have none.
    parts: Vec<TechniqueModules>,
    more: Option<String>,
}

struct TechniqueModules {
    name: &'static str,
    modules: Vec<(NodeLink, &'static str, &'static str)>,
}

#[derive(Template)]
#[template(path = "developer/coverage.html")]
struct CoverageHtml {
    frame: PageFrame,
    dev: DevFrame,
    /// A module stands in none of the five columns: there is a sixth.
    unstated: bool,
    pager: Pager,
    rows: Vec<GroupRow>,
    total: Vec<usize>,
    techniques: [Technique; 2],
    listed: Option<CellModules>,
}

/// `GET /developer/coverage?cell=COLUMN PATH&page=N`
pub async fn get(request: PageRequest) -> Html<String> {
    Html(page(&request.published, &request.context, &request.query))
}

pub fn page(published: &Published, context: &PageContext, query: &PageQuery) -> String {
    let view = &View::new(published, context.lang, false);
    let words = DevWords::of(context.lang);
    let layout = &view.snapshot.layout;
    let unstated = layout.modules.iter().any(|module| module.class.column().is_none());
    let columns = COLUMNS + usize::from(unstated);
    let mut rows: Vec<GroupRow> = ordered(view).into_iter().map(|id| row(view, id, columns, query)).collect();
    let total = (0..columns).map(|column| rows.iter().map(|row| row.cells[column].count).sum()).collect();
    let (pager, shown) = Pager::of(query, "matching", "page", rows.len(), ROWS);
    rows.truncate(shown.end);
    rows.drain(..shown.start);
    html(&CoverageHtml {
        frame: super::frame(context),
        dev: DevFrame::new(view, context, Page::Coverage, RENEW_MS),
        unstated,
        pager,
        rows,
        total,
        techniques: [true, false].map(|of_components| technique(view, words, columns, of_components)),
        listed: listed(view, words, query),
    })
}

/// The position among the columns; one past the five where none fits.
fn column(info: &ModuleInfo) -> usize {
    info.class.column().unwrap_or(COLUMNS)
}

fn technique(view: &View<'_>, words: &'static DevWords, columns: usize, of_components: bool) -> Technique {
    let mut kinds = vec![BTreeMap::<&'static str, usize>::new(); columns];
    for info in view.snapshot.layout.modules.iter().filter(|info| info.of_component == of_components) {
        *kinds[column(info)].entry(info.kind).or_default() += 1;
    }
    Technique {
        name: if of_components { words.components } else { words.data_streams },
        sum: kinds.iter().flat_map(BTreeMap::values).sum(),
        columns: kinds.into_iter().map(|kinds| kinds.into_iter().collect()).collect(),
    }
}

/// Each group before what it contains. Empty groups that are built in are left out.
fn ordered(view: &View<'_>) -> Vec<GroupId> {
    let groups = &view.snapshot.layout.groups;
    let is_there = |id: &GroupId| {
        let group = &groups[id.0 as usize];
        !((group.is_other || group.is_system) && group.modules.is_empty())
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

fn row(view: &View<'_>, id: GroupId, columns: usize, query: &PageQuery) -> GroupRow {
    let group = &view.snapshot.layout.groups[id.0 as usize];
    let open = chosen(query);
    let mut cells: Vec<Cell> = (0..columns)
        .map(|column| {
            let address = query.with("cell", &format!("{column} {}", group.path));
            Cell { count: 0, address, open: open == Some((column, &*group.path)) }
        })
        .collect();
    for &module in &group.modules {
        cells[column(view.snapshot.module(module).0)].count += 1;
    }
    GroupRow {
        name: view.group_name(id),
        path: clean(&group.path, 2 * NAME),
        why: why_address(&group.path),
        depth: group.path.matches('/').count().min(5),
        cells,
        sum: group.modules.len(),
    }
}

/// Column and group of the cell that is asked for.
fn chosen(query: &PageQuery) -> Option<(usize, &str)> {
    let (column, path) = query.get("cell").split_once(' ')?;
    Some((column.parse().ok()?, path))
}

fn listed(view: &View<'_>, words: &'static DevWords, query: &PageQuery) -> Option<CellModules> {
    let (chosen_column, path) = chosen(query)?;
    let Some(NodeId::Group(id)) = view.snapshot.node(path) else { return None };
    let in_cell = |&&module: &&ModuleId| column(view.snapshot.module(module).0) == chosen_column;
    let (info, _) = view.snapshot.group(id);
    let mut modules: Vec<ModuleId> = info.modules.iter().filter(in_cell).copied().collect();
    let way = match chosen_column {
        0 => vec![words.isolated, words.meta],
        1 => vec![words.isolated, words.content],
        2 => vec![words.contextual, words.meta],
        3 => vec![words.contextual, words.content, words.sequential],
        4 => vec![words.contextual, words.content, words.parallel],
        _ => vec![words.unstated],
    };
    let more = modules.len().saturating_sub(LISTED);
    modules.truncate(LISTED);
    let module = |&id: &ModuleId| {
        let state = view.snapshot.module(id).1.state;
        (NodeLink::of(view, NodeId::Module(id)), state.as_str(), view.lang.state(state))
    };
    let part = |of_components: bool| TechniqueModules {
        name: if of_components { words.components } else { words.data_streams },
        modules: modules
            .iter()
            .filter(|&&id| view.snapshot.module(id).0.of_component == of_components)
            .map(module)
            .collect(),
    };
    Some(CellModules {
        title: format!("{}: {}", view.group_name(id), way.join(", ").to_lowercase()),
        parts: [true, false].map(part).into_iter().filter(|part| !part.modules.is_empty()).collect(),
        more: (more > 0).then(|| view.lang.and_more(more)),
    })
}

#[cfg(test)]
mod tests {
    use telltale_engine::model::monitors::Class;

    #[test]
    fn a_class_has_one_of_five_columns_or_none() {
        for (location, information, flow, column) in [
            ("isolated", "meta", None, Some(0)),
            ("isolated", "content", None, Some(1)),
            ("contextual", "meta", None, Some(2)),
            ("contextual", "meta", Some("sequential"), Some(2)),
            ("contextual", "content", Some("sequential"), Some(3)),
            ("contextual", "content", Some("parallel"), Some(4)),
            ("contextual", "content", None, None),
            ("isolated", "content", Some("parallel"), None),
            ("isolated", "meta", Some("sequential"), None),
        ] {
            assert_eq!(
                Class { location, information, flow }.column(),
                column,
                "{location} {information} {flow:?}"
            );
        }
    }
}
