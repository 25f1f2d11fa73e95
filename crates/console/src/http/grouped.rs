//! Many vehicles at once: their groups by cause, and all of them as a grid.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use axum::http::HeaderMap;
use axum::response::Response;
use schemars::JsonSchema;
use serde::Serialize;
use serde_json::{Value, json};
use telltale_engine::state::State;
use telltale_web::common::{Asked, Format, Table};
use telltale_web::describe::words;
use telltale_web::texts::{Lang, address};

use super::answers::VehiclesAsked;
use super::row::{icon_of, word_of};
use super::view::View;
use crate::state::Row;
use crate::state::contact::{Contact, Urgency};

/// Groups, the vehicles and versions of one that are named, and cells of the grid.
const GROUPS_MAX: usize = 30;
const NAMED_MAX: usize = 12;
const VERSIONS_MAX: usize = 4;
const CELLS_MAX: usize = 2000;

/// Vehicles that need somebody for the same reason.
pub struct GroupHtml {
    pub state: &'static str,
    pub contact: &'static str,
    pub icon: &'static str,
    pub word: String,
    /// The words of the first one.
    pub cause: String,
    pub node: String,
    /// Leads to the vehicles of the group.
    pub address: String,
    pub count: usize,
    pub versions: String,
    /// All are of one version, which most vehicles of the fleet have not.
    pub only: bool,
    /// The id and the name of each.
    pub vehicles: Vec<(String, String)>,
    pub more: Option<String>,
}

pub struct CellHtml {
    pub id: String,
    pub state: &'static str,
    pub contact: &'static str,
    pub title: String,
}

type Groups<'a> = Vec<((Urgency, &'a str), Vec<&'a Row>)>;

/// Those that are not well, by cause; of a vehicle that is not heard, by that. The worst group comes first, then the
/// largest.
fn grouped(rows: &[Row]) -> Groups<'_> {
    let ill = rows.iter().filter(|row| !matches!(row.urgency, Urgency::Ok | Urgency::Off));
    let mut groups: BTreeMap<(Urgency, &str), Vec<&Row>> = BTreeMap::new();
    for row in ill {
        let cause = row.cause.as_ref().filter(|_| row.contact == Contact::Live);
        groups.entry((row.urgency, cause.map_or("", |it| it.node.as_str()))).or_default().push(row);
    }
    let mut groups: Vec<_> = groups.into_iter().collect();
    groups.sort_by_key(|((urgency, _), rows)| (*urgency, Reverse(rows.len())));
    groups
}

/// As the page has them.
pub fn groups(rows: &[Row], lang: Lang) -> Vec<GroupHtml> {
    let is_rare = |version: &str| rows.iter().filter(|row| row.version == version).count() * 2 < rows.len();
    let group = |((_, node), rows): ((Urgency, &str), Vec<&Row>)| {
        let first = rows[0];
        let versions: BTreeSet<&str> = rows.iter().map(|row| row.version.as_str()).collect();
        let more = rows.len().saturating_sub(NAMED_MAX);
        let cause = first.cause.as_ref().filter(|_| !node.is_empty());
        GroupHtml {
            state: first.state.as_str(),
            contact: first.contact.as_str(),
            icon: icon_of(first),
            word: word_of(first, lang),
            cause: cause.map(|it| it.words.clone()).unwrap_or_default(),
            node: node.to_owned(),
            address: if node.is_empty() { String::new() } else { format!("/?q={}", address(node)) },
            count: rows.len(),
            only: rows.len() > 1 && versions.len() == 1 && is_rare(&first.version),
            versions: versions.into_iter().take(VERSIONS_MAX).collect::<Vec<_>>().join(", "),
            vehicles: rows.iter().take(NAMED_MAX).map(|row| (row.id.clone(), row.name.clone())).collect(),
            more: (more > 0).then(|| lang.so_many_more(more)),
        }
    };
    grouped(rows).into_iter().take(GROUPS_MAX).map(group).collect()
}

/// Vehicles that need somebody for the same reason, for programs.
#[derive(Debug, Serialize, JsonSchema)]
#[schemars(rename = "VehicleGroupByCause")]
pub struct CauseGroup<'a> {
    contact: Contact,
    /// The worst of them.
    #[schemars(schema_with = "words::state")]
    state: State,
    /// Their cause, with the words of the first one; empty of vehicles that are not heard.
    node: &'a str,
    words: &'a str,
    count: usize,
    versions: BTreeSet<&'a str>,
    vehicles: Vec<&'a str>,
}

/// `GET /api/v1/groups?q&format`: vehicles that are not well, by cause.
pub async fn get(
    view: View,
    Asked(VehiclesAsked { q, format }): Asked<VehiclesAsked>,
    headers: HeaderMap,
) -> Response {
    let rows = view.found(&q);
    let group = |((_, node), rows): ((Urgency, &'_ str), Vec<&'_ Row>)| {
        let cause = rows[0].cause.as_ref().filter(|_| !node.is_empty());
        json!(CauseGroup {
            contact: rows[0].contact,
            state: rows.iter().map(|row| row.state).max().unwrap_or(State::Unknown),
            node,
            words: cause.map_or("", |it| &it.words),
            count: rows.len(),
            versions: rows.iter().map(|row| row.version.as_str()).collect(),
            vehicles: rows.iter().map(|row| row.id.as_str()).collect(),
        })
    };
    let groups: Vec<Value> = grouped(&rows).into_iter().map(group).collect();
    let columns = &["contact", "state", "node", "words", "count", "versions", "vehicles"];
    let table = Table { name: "groups", columns, rows: &groups, next: None };
    table.answer(Format::of(format, &headers), &groups)
}

/// A cell for each vehicle in the order of their ids, and how many more there are.
pub fn cells(rows: &[Row], lang: Lang) -> (Vec<CellHtml>, usize) {
    let mut rows: Vec<&Row> = rows.iter().collect();
    rows.sort_by(|a, b| a.id.cmp(&b.id));
    let cell = |row: &&Row| CellHtml {
        id: row.id.clone(),
        state: row.state.as_str(),
        contact: row.contact.as_str(),
        title: format!("{}: {}", row.name, word_of(row, lang)),
    };
    (rows.iter().take(CELLS_MAX).map(cell).collect(), rows.len().saturating_sub(CELLS_MAX))
}
