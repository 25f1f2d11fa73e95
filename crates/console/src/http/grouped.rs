//! Many vehicles at once: their groups by cause, and all of them as a grid.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use telltale_web::texts::Lang;

use super::row::{icon_of, word_of};
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

/// Those that are not well, by cause; of a vehicle that is not heard, by that. The worst group comes first, then the
/// largest.
pub fn groups(rows: &[Row], lang: Lang) -> Vec<GroupHtml> {
    let ill = rows.iter().filter(|row| !matches!(row.urgency, Urgency::Ok | Urgency::Off));
    let mut groups: BTreeMap<(Urgency, &str), Vec<&Row>> = BTreeMap::new();
    for row in ill {
        let cause = row.cause.as_ref().filter(|_| row.contact == Contact::Live);
        groups.entry((row.urgency, cause.map_or("", |it| it.node.as_str()))).or_default().push(row);
    }
    let is_rare = |version: &str| rows.iter().filter(|row| row.version == version).count() * 2 < rows.len();
    let mut groups: Vec<_> = groups.into_iter().collect();
    groups.sort_by_key(|((urgency, _), rows)| (*urgency, Reverse(rows.len())));
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
            count: rows.len(),
            only: rows.len() > 1 && versions.len() == 1 && is_rare(&first.version),
            versions: versions.into_iter().take(VERSIONS_MAX).collect::<Vec<_>>().join(", "),
            vehicles: rows.iter().take(NAMED_MAX).map(|row| (row.id.clone(), row.name.clone())).collect(),
            more: (more > 0).then(|| lang.so_many_more(more)),
        }
    };
    groups.into_iter().take(GROUPS_MAX).map(group).collect()
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
