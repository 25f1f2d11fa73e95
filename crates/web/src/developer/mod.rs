//! The developer pages, one in a file with its handler; that of the interface for programs is `api/page.rs`. All have the
//! same frame: the vehicle, its stage, whether the page is live, and links to the other pages.

pub mod audit;
pub mod configuration;
pub mod coverage;
pub mod graph;
pub mod incidents;
pub mod learn;
pub mod masking;
mod page_query;
mod pager;
pub mod reload;
pub(crate) mod request;
pub mod search;
pub mod shelving;
pub mod statistics;
pub mod statuses;
#[cfg(test)]
pub(crate) mod tests;
pub mod timeline;
pub mod topics;
pub mod why;

use telltale_engine::model::{NodeId, Stage};
use telltale_engine::snapshot::{ModuleView, Shelved};
use telltale_record::story::Limit;
use telltale_store::Role;

pub use audit::AuditPage;
pub use page_query::{PageQuery, address};
pub use timeline::Window;

use super::view::page::frame::PageFrame;
use super::view::trends::Trend;
use super::view::{PageContext, View};
use crate::texts::{DevWords, NAME, VALUE, clean};

/// A developer page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Page {
    Statuses,
    Graph,
    Timeline,
    Incidents,
    Masking,
    Coverage,
    Topics,
    Configuration,
    Audit,
    /// The graph leads there.
    Learn,
    /// The incidents lead there.
    Statistics,
    /// The interface for programs; the help leads there.
    Api,
}

impl Page {
    const ALL: [Page; 9] = [
        Page::Statuses,
        Page::Graph,
        Page::Timeline,
        Page::Incidents,
        Page::Masking,
        Page::Coverage,
        Page::Topics,
        Page::Configuration,
        Page::Audit,
    ];

    pub const fn path(self) -> &'static str {
        match self {
            Page::Statuses => "/developer",
            Page::Graph => "/developer/graph",
            Page::Timeline => "/developer/timeline",
            Page::Incidents => "/incidents",
            Page::Masking => "/developer/masking",
            Page::Coverage => "/developer/coverage",
            Page::Topics => "/developer/topics",
            Page::Configuration => "/developer/configuration",
            Page::Audit => "/developer/audit",
            Page::Learn => "/developer/learn",
            Page::Statistics => "/developer/statistics",
            Page::Api => "/developer/api",
        }
    }

    /// The page of the navigation that leads there.
    const fn leading(self) -> Page {
        match self {
            Page::Learn => Page::Graph,
            Page::Statistics => Page::Incidents,
            other => other,
        }
    }

    /// Whether a replay has it, as it was.
    const fn is_of_a_moment(self) -> bool {
        match self {
            Page::Statuses | Page::Graph | Page::Timeline => true,
            Page::Masking | Page::Coverage | Page::Topics => true,
            Page::Incidents | Page::Configuration | Page::Audit => false,
            Page::Learn | Page::Statistics | Page::Api => false,
        }
    }

    const fn word(self, words: &'static DevWords) -> &'static str {
        match self {
            Page::Statuses => words.statuses,
            Page::Graph => words.graph,
            Page::Timeline => words.timeline,
            Page::Incidents => words.incidents,
            Page::Masking => words.masking,
            Page::Coverage => words.coverage,
            Page::Topics => words.topics,
            Page::Configuration => words.configuration,
            Page::Audit => words.audit,
            Page::Learn => words.learned,
            Page::Statistics => words.statistics,
            Page::Api => words.api,
        }
    }
}

/// A page in the navigation.
pub(crate) struct NavLink {
    pub(crate) path: &'static str,
    pub(crate) word: &'static str,
    /// The key that leads there.
    pub(crate) key: usize,
    pub(crate) here: bool,
    /// A moment of the past has this page too.
    pub(crate) then: bool,
}

/// The frame of every developer page.
pub(crate) struct DevFrame {
    pub(crate) words: &'static DevWords,
    pub(crate) title: String,
    /// Where it stands in the navigation.
    pub(crate) path: &'static str,
    pub(crate) links: Vec<NavLink>,
    pub(crate) vehicle: String,
    pub(crate) stage: &'static str,
    pub(crate) stage_word: &'static str,
    pub(crate) overall: &'static str,
    pub(crate) overall_word: &'static str,
    pub(crate) user: String,
    /// The reader may read everything and change nothing.
    pub(crate) looks_only: bool,
    pub(crate) locked: bool,
    pub(crate) at: String,
    pub(crate) seq: u64,
    pub(crate) revision: u64,
    /// Milliseconds after which the page asks again without news, because times in it count on; zero if
    /// none do.
    pub(crate) renew_ms: u32,
    /// The content does not change by itself: it is from the past, or complete.
    pub(crate) fixed: bool,
    pub(crate) replay: bool,
    /// The shelved modules, on every page.
    pub(crate) shelved: Vec<ShelvedHtml>,
}

/// A shelved module.
pub(crate) struct ShelvedHtml {
    pub(crate) name: String,
    pub(crate) address: String,
    pub(crate) until: String,
    pub(crate) by: String,
}

impl ShelvedHtml {
    fn of(view: &View<'_>, shelved: &Shelved) -> ShelvedHtml {
        let NodeLink { name, address } = NodeLink::of(view, NodeId::Module(shelved.module));
        let by = view.lang.shelved_by(&clean(&shelved.by, NAME));
        ShelvedHtml { name, address, until: view.wall(shelved.until), by }
    }
}

impl DevFrame {
    pub(crate) fn new(view: &View<'_>, context: &PageContext, page: Page, renew_ms: u32) -> DevFrame {
        let snapshot = view.snapshot;
        let words = DevWords::of(context.lang);
        let has = |page: Page| match page {
            Page::Configuration => context.configuration && !context.replay,
            other => !context.replay || other.is_of_a_moment(),
        };
        let known = Page::ALL.into_iter().filter(|&it| has(it));
        let links = known.enumerate().map(|(index, it)| NavLink {
            path: it.path(),
            word: it.word(words),
            key: index + 1,
            here: it == page.leading(),
            then: it.is_of_a_moment(),
        });
        DevFrame {
            words,
            title: page.word(words).to_owned(),
            path: page.leading().path(),
            links: links.collect(),
            vehicle: view.lang.pick(&snapshot.layout.vehicle_name, NAME),
            stage: snapshot.stage.as_str(),
            stage_word: view.lang.stage_of(snapshot),
            overall: snapshot.overall.as_str(),
            overall_word: view.lang.state(snapshot.overall),
            user: clean(&context.user, NAME),
            looks_only: context.role == Role::Authority,
            locked: snapshot.stage == Stage::Locked && !context.replay,
            at: view.wall(snapshot.now),
            seq: snapshot.seq,
            revision: snapshot.revision,
            renew_ms,
            fixed: false,
            replay: context.replay,
            shelved: snapshot.shelved.iter().map(|it| ShelvedHtml::of(view, it)).collect(),
        }
    }
}

pub(crate) fn frame(context: &PageContext) -> PageFrame {
    PageFrame { part: context.part, ..PageFrame::new(context.lang, context.palette) }
}

/// A link to the page of one node.
struct NodeLink {
    name: String,
    address: String,
}

impl NodeLink {
    fn of(view: &View<'_>, node: NodeId) -> NodeLink {
        let name = view.snapshot.node_name(node);
        NodeLink { name: clean(name, 2 * NAME), address: why_address(name) }
    }
}

/// The address of the page that explains a node. The name is not cleaned, because a cleaned one could be another node's.
fn why_address(name: &str) -> String {
    format!("/developer/why{}", page_query::address([("node", name)].into_iter()))
}

/// The values of a report without the limits of its monitor.
fn measured(module: &ModuleView) -> impl Iterator<Item = &(Box<str>, Box<str>)> {
    module.report.values.iter().filter(|(key, _)| !Limit::is_name(key))
}

/// A value of a report, with its last minutes if it is a number.
struct ReportValue {
    key: String,
    value: String,
    trend: Option<Trend>,
}

/// The first `count` values of a report without the limits of its monitor, each in so many letters.
fn report_values(
    module: &ModuleView,
    count: usize,
    letters: usize,
    mut past: Vec<Trend>,
) -> Vec<ReportValue> {
    let value = |(key, value): &(Box<str>, Box<str>)| {
        let trend = past.iter().position(|trend| *trend.key == **key).map(|index| past.swap_remove(index));
        ReportValue { key: clean(key, VALUE), value: clean(value, letters), trend }
    };
    measured(module).take(count).map(value).collect()
}
