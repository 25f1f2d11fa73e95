//! The developer pages, one in a file with its handler. All have the same frame: the vehicle, its stage,
//! whether the page is live, and links to the other pages.

pub mod audit;
pub mod configuration;
pub mod coverage;
pub mod graph;
pub mod masking;
mod page_query;
mod pager;
pub mod reload;
pub mod statuses;
#[cfg(test)]
pub(in crate::web) mod tests;
pub mod timeline;
pub mod topics;
mod visit;
pub mod why;
mod words;

use crate::engine::model::{NodeId, Stage};

pub use audit::AuditPage;
pub use page_query::PageQuery;
pub use timeline::Window;

use super::view::page::frame::Frame;
use super::view::text::{NAME, clean};
use super::view::{PageContext, View};
use words::DevWords;

/// A page of the developer's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Page {
    Statuses,
    Graph,
    Timeline,
    Masking,
    Coverage,
    Topics,
    Configuration,
    Audit,
}

impl Page {
    const ALL: [Page; 8] = [
        Page::Statuses,
        Page::Graph,
        Page::Timeline,
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
            Page::Masking => "/developer/masking",
            Page::Coverage => "/developer/coverage",
            Page::Topics => "/developer/topics",
            Page::Configuration => "/developer/configuration",
            Page::Audit => "/developer/audit",
        }
    }

    const fn word(self, words: &'static DevWords) -> &'static str {
        match self {
            Page::Statuses => words.statuses,
            Page::Graph => words.graph,
            Page::Timeline => words.timeline,
            Page::Masking => words.masking,
            Page::Coverage => words.coverage,
            Page::Topics => words.topics,
            Page::Configuration => words.configuration,
            Page::Audit => words.audit,
        }
    }
}

/// A page in the navigation.
struct Way {
    path: &'static str,
    word: &'static str,
    /// The key that leads there.
    key: usize,
    here: bool,
}

/// What every developer's page is framed by.
struct DevFrame {
    words: &'static DevWords,
    title: String,
    /// Where it stands in the navigation.
    path: &'static str,
    ways: Vec<Way>,
    vehicle: String,
    stage: &'static str,
    stage_word: &'static str,
    overall: &'static str,
    user: String,
    locked: bool,
    at: String,
    seq: u64,
    revision: u64,
    /// Milliseconds after which the page asks anew though nothing was said to have changed; zero
    /// where nothing changes unsaid.
    renew_ms: u32,
    /// What it shows is no present, and does not change by itself.
    fixed: bool,
}

impl DevFrame {
    fn new(view: &View<'_>, context: &PageContext, page: Page, renew_ms: u32) -> DevFrame {
        let snapshot = view.snapshot;
        let words = DevWords::of(context.lang);
        let known = Page::ALL.into_iter().filter(|&it| it != Page::Configuration || context.configuration);
        let ways = known.enumerate().map(|(index, it)| Way {
            path: it.path(),
            word: it.word(words),
            key: index + 1,
            here: it == page,
        });
        DevFrame {
            words,
            title: page.word(words).to_owned(),
            path: page.path(),
            ways: ways.collect(),
            vehicle: view.lang.pick(&snapshot.layout.vehicle_name, NAME),
            stage: snapshot.stage.as_str(),
            stage_word: view.lang.stage(snapshot.stage, snapshot.overall),
            overall: snapshot.overall.as_str(),
            user: clean(&context.user, NAME),
            locked: snapshot.stage == Stage::Locked,
            at: view.wall(snapshot.now),
            seq: snapshot.seq,
            revision: snapshot.revision,
            renew_ms,
            fixed: false,
        }
    }
}

fn frame(context: &PageContext) -> Frame {
    Frame { part: context.part, ..Frame::new(context.lang, context.palette) }
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

/// Where a page says why a node shows what it shows. The name goes as it is: cleaned, it would be another.
fn why_address(name: &str) -> String {
    format!("/developer/why{}", page_query::address([("node", name)].into_iter()))
}
