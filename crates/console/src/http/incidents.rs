//! The incidents of the fleet in groups, and the what-ifs that were run over such groups.

use askama::Template;
use axum::response::Response;
use telltale_store::Role;
use telltale_web::common::{Asked, PageFrame, Reader};
use telltale_web::texts::console::ConsoleWords;
use telltale_web::texts::{IncidentWords, Lang};

use super::answers::IncidentsAsked;
use super::page::rendered;
use super::view::View;
use super::what_ifs::{Line, form_address, group_name};
use crate::state::incidents::{Group, GroupBy, grouped};

/// Groups of the page, and the vehicles and versions of one that are named.
const GROUPS_MAX: usize = 100;
const NAMED_MAX: usize = 12;

#[derive(Template)]
#[template(path = "console/incidents.html")]
struct IncidentsHtml {
    frame: PageFrame,
    words: &'static ConsoleWords,
    it: &'static IncidentWords,
    user: String,
    by: &'static str,
    kinds: Vec<(&'static str, &'static str)>,
    groups: Vec<GroupHtml>,
    more: Option<String>,
    what_ifs: Vec<Line>,
}

struct GroupHtml {
    name: String,
    count: usize,
    fetched: String,
    vehicles: Vec<String>,
    more: Option<String>,
    versions: String,
    last: String,
    /// The address of its what-if; `None` for all but engineers.
    what_if: Option<String>,
}

/// What the groups of a kind are called.
pub fn kind(by: GroupBy, lang: Lang) -> &'static str {
    let words = ConsoleWords::of(lang);
    match by {
        GroupBy::Cause => words.by_cause,
        GroupBy::Version => words.by_version,
        GroupBy::Config => words.by_config,
    }
}

/// `GET /incidents?group=cause`
pub async fn page(
    view: View,
    Asked(IncidentsAsked { group: by, .. }): Asked<IncidentsAsked>,
    reader: Reader,
) -> Response {
    let (lang, words) = (reader.lang, ConsoleWords::of(reader.lang));
    let what_ifs = view.what_ifs().ok();
    // Of a group an engineer of some of its vehicles has those judged.
    let may_start =
        |it: &Group| what_ifs.is_some() && it.vehicles.iter().any(|id| view.may(Role::Engineer, id));
    let groups = grouped(view.fleet().incidents(), by);
    let more = groups.len().saturating_sub(GROUPS_MAX);
    let html = |it: Group| {
        let (may_start, more) = (may_start(&it), it.vehicles.len().saturating_sub(NAMED_MAX));
        GroupHtml {
            name: group_name(by, &it.group, lang),
            fetched: lang.so_many_fetched(it.fetched, it.count),
            count: it.count,
            vehicles: it.vehicles.into_iter().take(NAMED_MAX).collect(),
            more: (more > 0).then(|| lang.so_many_more(more)),
            versions: it.versions.into_iter().take(NAMED_MAX).collect::<Vec<_>>().join(", "),
            last: it.last,
            what_if: may_start.then(|| form_address(by, &it.group)),
        }
    };
    rendered(&IncidentsHtml {
        frame: PageFrame::new(lang, reader.palette),
        words,
        it: IncidentWords::of(lang),
        user: view.session.user.to_string(),
        by: by.as_str(),
        kinds: GroupBy::ALL.map(|it| (it.as_str(), kind(it, lang))).to_vec(),
        groups: groups.into_iter().take(GROUPS_MAX).map(html).collect(),
        more: (more > 0).then(|| lang.so_many_more(more)),
        what_ifs: what_ifs.iter().flat_map(|it| it.each(|it| Line::of(it, lang))).collect(),
    })
}
