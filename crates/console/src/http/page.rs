//! The overview: all vehicles, the worst first, as a page and as the fragment that its script asks for each second. A few
//! vehicles are cards; of more, those that are well are folded; of many, the groups by cause, all as a grid, and the worst.

use askama::Template;
use axum::response::{Html, IntoResponse, Redirect, Response};
use serde::Deserialize;
use telltale_clock::unix_ms;
use telltale_web::common::{Asked, PageFrame, Reader};
use telltale_web::texts::console::ConsoleWords;
use telltale_web::texts::{HttpError, Lang, Words, address};

use super::grouped::{CellHtml, GroupHtml, cells, groups};
use super::row::{RowHtml, shown};
use super::view::View;
use crate::state::contact::Urgency;
use crate::state::search::Search;
use crate::state::{Row, counts};

/// So many vehicles are cards, and more than this are groups.
const FEW: usize = 5;
const MANY: usize = 100;

/// The worst of many that stand in full.
const WORST: usize = 10;

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OverviewAsked {
    /// Words that all shown vehicles have.
    #[serde(default)]
    q: Search,
}

#[derive(Template)]
#[template(path = "console/overview.html")]
struct OverviewHtml {
    frame: PageFrame,
    words: &'static ConsoleWords,
    user: String,
    q: String,
    fleet: FleetHtml,
}

#[derive(Template)]
#[template(path = "console/fleet.html")]
struct FleetHtml {
    words: &'static ConsoleWords,
    /// With what is searched for.
    address: String,
    csv: String,
    groups_csv: String,
    frame_id: String,
    hub_down: bool,
    counts: Vec<(&'static str, usize, &'static str)>,
    off: Option<String>,
    /// How many vehicles a search found.
    found: Option<String>,
    size: &'static str,
    has_heads: bool,
    rows: Vec<RowHtml>,
    /// Those that are well, and how many.
    folded: Option<(String, Vec<RowHtml>)>,
    groups: Vec<GroupHtml>,
    cells: Vec<CellHtml>,
    more_cells: Option<String>,
}

/// `GET /`
pub async fn get(
    view: Result<View, HttpError>,
    Asked(OverviewAsked { q }): Asked<OverviewAsked>,
    reader: Reader,
) -> Response {
    let Ok(view) = view else { return Redirect::to("/login").into_response() };
    let fleet = fleet(&view, &q, reader.lang);
    let frame = PageFrame::new(reader.lang, reader.palette);
    let (words, user, q) = (fleet.words, view.session.user.to_string(), q.text().to_owned());
    rendered(&OverviewHtml { frame, words, user, q, fleet })
}

/// `GET /overview`: the part of the page that changes.
pub async fn overview(
    view: View,
    Asked(OverviewAsked { q }): Asked<OverviewAsked>,
    reader: Reader,
) -> Response {
    rendered(&fleet(&view, &q, reader.lang))
}

pub fn rendered(page: &impl Template) -> Response {
    match page.render() {
        Ok(page) => Html(page).into_response(),
        Err(_) => HttpError::Unavailable.into_response(),
    }
}

fn fleet(view: &View, q: &Search, lang: Lang) -> FleetHtml {
    let now_ms = unix_ms(view.console.clock.wall());
    let (mut rows, hub_down) = {
        let fleet = view.fleet();
        (fleet.rows(view.console.clock.now()), fleet.hub_is_down())
    };
    let (words, states) = (ConsoleWords::of(lang), Words::of(lang));
    let all = counts(&rows);
    let counts = vec![
        ("error", all.error, states.error),
        ("warning", all.warning, states.warning),
        ("ok", all.ok, states.ok),
        ("lost", all.lost, words.lost_contact),
        ("never", all.never_heard, words.never_heard),
    ];
    rows.retain(|row| q.finds(row));
    let line = |row: &Row| shown(row, lang, now_ms);
    let is_well = |row: &&Row| matches!(row.urgency, Urgency::Ok | Urgency::Off);
    let well: Vec<&Row> = rows.iter().filter(is_well).collect();
    let size = match rows.len() {
        count if count <= FEW => "few",
        count if count <= MANY => "some",
        _ => "many",
    };
    let (folds, is_many) = (size == "some" && well.len() > 1, size == "many");
    let in_full = if is_many { WORST } else { rows.len() };
    let (cells, more_cells) = if is_many { cells(&rows, lang) } else { (Vec::new(), 0) };
    let asked = if q.is_empty() { String::new() } else { format!("q={}", address(q.text())) };
    FleetHtml {
        words,
        address: format!("/overview?{asked}"),
        csv: format!("/api/v1/vehicles?format=csv&{asked}"),
        groups_csv: format!("/api/v1/groups?format=csv&{asked}"),
        // Another program has other words and other files.
        frame_id: telltale_web::assets::url(lang.as_str()),
        hub_down,
        counts,
        off: (all.off > 0).then(|| lang.off_count(all.off)),
        found: (!q.is_empty()).then(|| lang.so_many_found(rows.len())),
        size,
        has_heads: size != "few",
        rows: rows.iter().filter(|row| !folds || !is_well(row)).take(in_full).map(line).collect(),
        folded: folds.then(|| (summary(&well, lang), well.iter().map(|row| line(row)).collect())),
        groups: if is_many { groups(&rows, lang) } else { Vec::new() },
        cells,
        more_cells: (more_cells > 0).then(|| lang.so_many_more(more_cells)),
    }
}

/// `38 OK, 3 not in service`
fn summary(well: &[&Row], lang: Lang) -> String {
    let off = well.iter().filter(|row| row.urgency == Urgency::Off).count();
    let ok = well.len() - off;
    let words = [(ok, format!("{ok} {}", Words::of(lang).ok)), (off, lang.off_count(off))];
    let words: Vec<String> =
        words.into_iter().filter(|(count, _)| *count > 0).map(|(_, word)| word).collect();
    words.join(", ")
}
