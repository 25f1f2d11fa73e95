//! One search over everything that has a name: groups, modules with their titles, statuses and messages, signals,
//! topics, ROS nodes, incidents and pages. What is found leads to its page.

use std::cmp::Reverse;

use askama::Template;
use axum::extract;
use axum::response::Html;

use super::incidents::told::told;
use super::page_query::address;
use super::request::PageRequest;
use super::statuses::contains;
use super::{DevFrame, Page, PageQuery, why_address};
use crate::AppState;
use crate::incidents::wall_time;
use crate::texts::{DevWords, IncidentWords, Lang, MESSAGE, NAME, clean};
use crate::view::page::frame::PageFrame;
use crate::view::{PageContext, View, html};
use telltale_engine::discovery::Discovery;
use telltale_engine::model::{GroupId, ModuleId, NodeId, Stage};
use telltale_engine::snapshot::ModuleInfo;
use telltale_engine::state::State;
use telltale_runtime::Published;
use telltale_store::{Incident, IncidentFilter};

/// Results of one kind.
const EACH: usize = 10;
/// Modules whose incidents are looked for.
const CAUSES: usize = 100;
/// Words of a query; further ones are ignored.
const TERMS: usize = 8;

struct Found {
    address: String,
    name: String,
    /// The state of a node, with its word.
    state: Option<(&'static str, &'static str)>,
    /// The findings, or the kind of file.
    detail: String,
    /// When it began; empty for what lasts.
    at: String,
}

/// Results of one kind, the best first.
struct Kind {
    id: &'static str,
    title: &'static str,
    found: Vec<Found>,
    /// How many more there are, and where they are listed.
    more: usize,
    all: Option<String>,
}

#[derive(Template)]
#[template(path = "developer/search.html")]
struct SearchHtml {
    frame: PageFrame,
    dev: DevFrame,
    asked: String,
    kinds: Vec<Kind>,
    /// Something was asked for and nothing found.
    is_nothing: bool,
}

/// `GET /developer/search?q=WORDS`
pub async fn get(extract::State(app): extract::State<AppState>, request: PageRequest) -> Html<String> {
    let PageRequest { published, context, query, .. } = request;
    let seen = app.settings.discovery.as_ref().map(|seen| seen.borrow().clone()).unwrap_or_default();
    let text = query.get("q").trim().to_owned();
    let is_asked = !text.is_empty() && !context.replay && published.snapshot.stage != Stage::Locked;
    let incidents = match is_asked {
        true => {
            let or_causes = causes(&View::new(&published, context.lang, false), &terms(&text.to_lowercase()));
            incidents(&app, text, or_causes).await
        }
        false => Vec::new(),
    };
    Html(page(&published, &context, &query, &seen, &incidents))
}

/// The incident with this number, and those that have the text, or one of these causes.
async fn incidents(app: &AppState, text: String, or_causes: Vec<String>) -> Vec<Incident> {
    let id = number(&text);
    let by_id = match id {
        Some(id) => app.store.incident(id).await.unwrap_or_default(),
        None => None,
    };
    let filter = IncidentFilter { text, or_causes, count: EACH as u32 + 1, ..IncidentFilter::default() };
    let by_text = app.store.incidents(filter).await.unwrap_or_default();
    let others = by_text.into_iter().filter(|it| Some(it.summary.id) != id);
    by_id.into_iter().chain(others).collect()
}

/// `12`, `#12`, `Incident 12`: the number of an incident.
fn number(text: &str) -> Option<u64> {
    let words = Lang::ALL.map(|lang| IncidentWords::of(lang).incident.to_lowercase());
    let text = text.to_lowercase();
    let is_said = words.iter().find_map(|word| text.strip_prefix(&**word));
    is_said.unwrap_or(&text).trim_start().trim_start_matches('#').parse().ok()
}

/// The modules whose names, or the names of whose faults, have all terms.
fn causes(view: &View<'_>, terms: &[&str]) -> Vec<String> {
    let is_meant = |info: &ModuleInfo| {
        rank(terms, &[&info.id, &view.label(info), &view.names_of_faults(info)]).is_some()
    };
    let modules = view.snapshot.module_ids().map(|id| view.snapshot.module(id).0);
    modules.filter(|info| is_meant(info)).take(CAUSES).map(|info| info.id.to_string()).collect()
}

fn terms(text: &str) -> Vec<&str> {
    text.split_whitespace().take(TERMS).collect()
}

pub fn page(
    published: &Published,
    context: &PageContext,
    query: &PageQuery,
    seen: &Discovery,
    incidents: &[Incident],
) -> String {
    let view = &View::new(published, context.lang, false);
    let words = DevWords::of(context.lang);
    let mut dev = DevFrame::new(view, context, Page::Statuses, 0);
    dev.title = words.search.to_owned();
    // The findings stay until the next question.
    dev.fixed = true;
    let text = query.get("q").to_lowercase();
    let terms = terms(&text);
    let mut kinds = Vec::new();
    if !terms.is_empty() {
        let pages = dev.links.iter().map(|link| (link.word, link.path)).collect::<Vec<_>>();
        kinds = vec![
            nodes(view, words, query, &terms),
            topics(words, query, seen, &terms),
            ros_nodes(words, seen, &terms),
            signals(view, words, &terms),
            found_incidents(view, words, query, incidents),
            named_pages(words, &pages, &terms),
        ];
        kinds.retain(|kind| !kind.found.is_empty());
    }
    html(&SearchHtml {
        frame: super::frame(context),
        asked: clean(query.get("q"), MESSAGE),
        is_nothing: kinds.is_empty() && !terms.is_empty(),
        kinds,
        dev,
    })
}

/// Where all terms were found: the smaller, the more likely that it was meant. Each term may be in another text.
fn rank(terms: &[&str], texts: &[&str]) -> Option<usize> {
    let rank = |term: &&str| {
        let place = texts.iter().position(|text| contains(text, term))?;
        let mut words = texts[place].split(|letter: char| !letter.is_alphanumeric());
        let begins = words.any(|word| word.get(..term.len()).is_some_and(|start| contains(start, term)));
        Some(2 * place + usize::from(!begins))
    };
    terms.iter().map(rank).try_fold(0, |worst, rank| Some(worst.max(rank?)))
}

fn nodes(view: &View<'_>, words: &DevWords, query: &PageQuery, terms: &[&str]) -> Kind {
    let snapshot = view.snapshot;
    let layout = &snapshot.layout;
    let groups = (0..layout.groups.len() as u32).map(GroupId).filter_map(|id| {
        let info = &layout.groups[id.0 as usize];
        let title = view.group_name(id);
        Some((rank(terms, &[&info.path, &title])?, NodeId::Group(id), title))
    });
    let modules = snapshot.module_ids().filter_map(|id: ModuleId| {
        let (info, module) = snapshot.module(id);
        let title = view.label(info);
        let status = info.status.as_deref().unwrap_or_default();
        let said = view.message_text(module);
        let faults = view.names_of_faults(info);
        let rank = rank(terms, &[&info.id, &title, &faults, status, &said, &module.report.hardware_id])?;
        Some((rank, NodeId::Module(id), said))
    });
    let mut found: Vec<(usize, NodeId, String)> = groups.chain(modules).collect();
    // Of those that match alike the worst stands first.
    found.sort_by_cached_key(|(rank, node, _)| {
        let name = snapshot.node_name(*node);
        (*rank, Reverse(snapshot.shown(*node).0), name.len(), name.to_string())
    });
    let more = found.len().saturating_sub(EACH);
    let row = |(_, node, detail): (usize, NodeId, String)| {
        let name = snapshot.node_name(node);
        let state: State = snapshot.shown(node).0;
        Found {
            address: why_address(name),
            name: clean(name, 2 * NAME),
            state: Some((state.as_str(), view.lang.state(state))),
            detail: clean(&detail, MESSAGE),
            at: String::new(),
        }
    };
    let all = format!("/developer{}", address([("q", query.get("q"))].into_iter()));
    Kind {
        id: "found-nodes",
        title: words.groups_and_modules,
        found: found.into_iter().take(EACH).map(row).collect(),
        more,
        all: Some(all),
    }
}

/// Results whose names alone count.
fn named<'a>(
    (id, title): (&'static str, &'static str),
    all: impl Iterator<Item = (&'a str, String, String)>,
    terms: &[&str],
) -> Kind {
    let found = all
        .filter_map(|(name, address, detail)| Some((rank(terms, &[name, &detail])?, name, address, detail)));
    let mut found: Vec<_> = found.collect();
    found.sort_by(|a, b| (a.0, a.1.len(), a.1).cmp(&(b.0, b.1.len(), b.1)));
    let more = found.len().saturating_sub(EACH);
    let row = |(_, name, address, detail): (usize, &str, String, String)| {
        let (name, detail) = (clean(name, 2 * NAME), clean(&detail, MESSAGE));
        Found { address, name, state: None, detail, at: String::new() }
    };
    Kind { id, title, found: found.into_iter().take(EACH).map(row).collect(), more, all: None }
}

fn topics_address(name: &str) -> String {
    format!("/developer/topics{}", address([("q", name)].into_iter()))
}

fn topics(words: &DevWords, query: &PageQuery, seen: &Discovery, terms: &[&str]) -> Kind {
    let all = seen.topics.iter().map(|it| (&*it.name, topics_address(&it.name), it.types().join(" ")));
    let kind = named(("found-topics", words.topics), all, terms);
    Kind { all: Some(topics_address(query.get("q"))), ..kind }
}

fn ros_nodes(words: &DevWords, seen: &Discovery, terms: &[&str]) -> Kind {
    let all = seen.nodes.iter().map(|name| (&**name, topics_address(name), String::new()));
    named(("found-ros-nodes", words.nodes), all, terms)
}

fn signals(view: &View<'_>, words: &DevWords, terms: &[&str]) -> Kind {
    let all = view.snapshot.signals.iter().map(|(name, value)| {
        (&**name, Page::Timeline.path().to_owned(), super::statuses::signal(*value).to_owned())
    });
    named(("found-signals", words.signals), all, terms)
}

fn named_pages(words: &DevWords, pages: &[(&'static str, &'static str)], terms: &[&str]) -> Kind {
    let all = pages.iter().map(|(word, path)| (*word, (*path).to_owned(), String::new()));
    named(("found-pages", words.pages), all, terms)
}

fn found_incidents(view: &View<'_>, words: &DevWords, query: &PageQuery, incidents: &[Incident]) -> Kind {
    let row = |incident: &Incident| {
        let summary = &incident.summary;
        let note = incident.note.as_ref().map(|note| clean(&note.text, MESSAGE));
        let causes = clean(&summary.causes().join(", "), 2 * NAME);
        let told = told(view, summary);
        Found {
            address: format!("/incidents/{}", summary.id),
            name: format!("{} {}", summary.id, told.sentence),
            state: (!told.state.is_empty()).then_some((told.state, told.word)),
            detail: [causes].into_iter().chain(note).collect::<Vec<_>>().join("; "),
            at: wall_time(summary.since_ms),
        }
    };
    Kind {
        id: "found-incidents",
        title: words.incidents,
        found: incidents.iter().take(EACH).map(row).collect(),
        more: incidents.len().saturating_sub(EACH),
        all: Some(format!("/incidents{}", address([("cause", query.get("q"))].into_iter()))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_number_of_an_incident_is_found_as_people_write_it() {
        for text in ["12", "#12", "incident 12", "Incident #12", "Vorfall 12"] {
            assert_eq!(number(text), Some(12), "{text}");
        }
        for text in ["", "incident", "incidents 12", "12 V", "-12"] {
            assert_eq!(number(text), None, "{text}");
        }
    }

    #[test]
    fn what_begins_with_the_words_is_found_first() {
        for (asked, texts, found) in [
            ("lidar", &["sensors/lidar_front", "LiDAR in front"][..], Some(0)),
            ("front", &["sensors/lidar_front", "LiDAR in front"], Some(0)),
            ("dar", &["sensors/lidar_front", "LiDAR in front"], Some(1)),
            ("lidar in", &["sensors/lidar_front", "LiDAR in front"], Some(2)),
            ("lidar rear", &["sensors/lidar_front", "LiDAR in front"], None),
            ("größe", &["a/GRÖSSE", "die Größe"], Some(2)),
        ] {
            let terms: Vec<&str> = asked.split_whitespace().collect();
            assert_eq!(rank(&terms, texts), found, "{asked}");
        }
    }
}
