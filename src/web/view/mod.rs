//! The pages and their fragments as HTML. Nothing here reads a request or sends an answer.
//!
//! All that is shown comes from one [`Snapshot`]; text that the vehicle or a publisher wrote goes
//! through [`clean`] and is escaped by the templates.

mod arrows;
mod board;
mod causes;
mod checks;
pub mod clean;
mod detail;
mod developer;
mod entries;
mod fit;
mod measure;
mod node;
mod outside;
mod pages;
#[cfg(test)]
pub(super) mod sample;
mod step;
#[cfg(test)]
mod tests;
mod tile;
mod top;
mod trend;

use std::time::{Duration, SystemTime};

use crate::clock::wall_at;
use crate::engine::input::Refusal;
use crate::engine::model::Stage;
use crate::engine::snapshot::Snapshot;
use crate::engine::time::Timestamp;
use crate::runtime::Published;
use crate::store::Role;
use crate::web::farewell::Farewell;
use crate::web::text::Words;
use crate::web::versions::Seen;
use board::Board;

pub use developer::{
    Asked, AuditPage, Window, audit_page, configuration_page, coverage_page, developer_page, graph_page,
    masking_page, timeline_page, topics_page, why_page,
};
pub use pages::{demo_page, login_page, message_page, operator_page};
pub use trend::Trends;

/// Files below `static/` that the login page needs: served without a session, so none of them may
/// name a part of the vehicle. An entry that ends in `/` names a folder.
pub const LOGIN_ASSETS: &[&str] = &[
    "telltale.css",
    "page.js",
    "pad.js",
    "icon.svg",
    "telltale.webmanifest",
    "vendor/inter-latin-wght-normal.woff2",
];

/// A language of the pages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum Lang {
    #[default]
    En,
    De,
}

impl Lang {
    pub const ALL: [Lang; 2] = [Lang::En, Lang::De];

    /// The tag of the `lang` attribute and cookie: `en`, `de`.
    pub const fn as_str(self) -> &'static str {
        match self {
            Lang::En => "en",
            Lang::De => "de",
        }
    }

    pub fn from_word(word: &str) -> Option<Lang> {
        Lang::ALL.into_iter().find(|lang| lang.as_str() == word)
    }
}

/// The colours of the pages.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Palette {
    Day,
    #[default]
    Night,
}

impl Palette {
    /// The word of the `data-palette` attribute and cookie: `day`, `night`.
    pub const fn as_str(self) -> &'static str {
        match self {
            Palette::Day => "day",
            Palette::Night => "night",
        }
    }

    pub fn from_word(word: &str) -> Option<Palette> {
        [Palette::Day, Palette::Night].into_iter().find(|palette| palette.as_str() == word)
    }
}

/// What of a developer's page is made: a script that has the rest asks for no more.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Part {
    #[default]
    Whole,
    /// All but the frame that every page has: `<main>`.
    Main,
    /// What changes while the page stands: `#dev`.
    Content,
}

impl Part {
    pub fn from_word(word: &str) -> Option<Part> {
        match word {
            "main" => Some(Part::Main),
            "content" => Some(Part::Content),
            _ => None,
        }
    }

    fn is_whole(self) -> bool {
        self == Part::Whole
    }

    fn is_content(self) -> bool {
        self == Part::Content
    }
}

/// How the ids of those elements begin that stand behind the tiles, and on sheets.
pub const DETAIL: &str = "detail-";
pub const SHEET: &str = "all-";

/// One element of the operator's page that changes by itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fragment {
    /// The `id` of the element: the same for the same part of the vehicle, always.
    pub id: String,
    /// The element, ready to be swapped in by its id.
    pub html: String,
}

/// For whom a page is made.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PageContext {
    pub lang: Lang,
    pub palette: Palette,
    pub user: String,
    pub role: Role,
    /// The simulated shuttle runs in this process: pages may link to `/demo`.
    pub demo: bool,
    /// The configuration comes from a file: pages may link to its page.
    pub configuration: bool,
    /// What is made of it.
    pub part: Part,
}

/// What the login page shows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LoginContext {
    pub lang: Lang,
    pub palette: Palette,
    /// The name that was typed last.
    pub name: String,
    pub failure: Option<LoginFailure>,
    /// Why the session that the browser had is over.
    pub farewell: Option<Farewell>,
    pub demo: bool,
}

/// Why a login did not work. It never says whether the name exists.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LoginFailure {
    /// The name or the secret is wrong.
    Wrong,
    /// It is a PIN, and this is no display at which one will do.
    PinElsewhere,
    /// Too many failures: this many seconds until the next try is looked at.
    Wait { seconds: u64 },
    /// Another operator has the vehicle; who just proved to be one may take it over.
    SeatTaken { by: String },
    /// The vehicle drives; it is taken over at one of its own displays alone.
    Drives,
    /// It cannot be written down: the disk is full, or the database broken.
    Storage,
    /// The server can not check logins now.
    Unavailable,
    /// No user exists yet; `telltale user add` makes one.
    /// `data` is the folder that `telltale user` has to be given.
    NoUsers { data: Option<String> },
}

impl LoginFailure {
    /// For programs and the audit log.
    pub const fn as_str(&self) -> &'static str {
        match self {
            LoginFailure::Wrong => "the name or the secret is wrong",
            LoginFailure::PinElsewhere => "a PIN will do at the vehicle's own displays only; give a password",
            LoginFailure::Wait { .. } => "too many failures; wait",
            LoginFailure::SeatTaken { .. } => "another operator has the vehicle",
            LoginFailure::Drives => "the vehicle drives; take it over at one of its own displays",
            LoginFailure::Storage => {
                "nothing can be written: the disk is full or the database broken; nothing was changed"
            }
            LoginFailure::Unavailable | LoginFailure::NoUsers { .. } => {
                "logins cannot be checked now; try again"
            }
        }
    }
}

/// A fault of the simulated shuttle.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DemoFault {
    /// As `POST /demo/fault` takes it: `sensor_outage`.
    pub name: String,
    pub active: bool,
}

/// Every element of the operator's page that changes with the snapshot, in page order. While the
/// vehicle is locked that is the top bar alone, which tells the page to leave.
pub fn fragments(published: &Published, seen: &Seen, lang: Lang, trends: &Trends) -> Vec<Fragment> {
    let view = View { seen: seen.clone(), trends: Some(trends), ..View::new(published, lang, true) };
    if published.snapshot.stage == Stage::Locked {
        return vec![top::top(&view)];
    }
    Parts::of(&view).into_fragments()
}

/// Why something was refused, one sentence a reason, by the names that are shown.
pub fn refusals(published: &Published, lang: Lang, reasons: &[Refusal]) -> Vec<String> {
    let view = View::new(published, lang, false);
    view.sentences(reasons)
}

/// What all parts of a page are made from.
struct View<'a> {
    snapshot: &'a Snapshot,
    at: SystemTime,
    lang: Lang,
    words: &'static Words,
    board: Board,
    /// The elements carry the mark by which htmx swaps them in.
    swap: bool,
    /// The versions by which the buttons are shown.
    seen: Seen,
    /// The recent past of the values, where it is shown.
    trends: Option<&'a Trends>,
}

impl<'a> View<'a> {
    fn new(published: &'a Published, lang: Lang, swap: bool) -> View<'a> {
        let snapshot = &*published.snapshot;
        let board = Board::of(&snapshot.layout);
        let (words, seen) = (lang.words(), Seen::default());
        View { snapshot, at: published.at, lang, words, board, swap, seen, trends: None }
    }

    /// Whether this machine is led from stage to stage at all.
    fn has_stages(&self) -> bool {
        !self.snapshot.clearance_refusals.contains(&Refusal::NoStages)
    }

    /// Whether there is something to take over.
    fn drives(&self) -> bool {
        self.has_stages() && matches!(self.snapshot.stage, Stage::Cleared | Stage::Active)
    }

    /// When `then` was, by the wall clock, to the second: the page counts on from there. Finer
    /// would differ a little with each snapshot and send what has not changed.
    fn wall(&self, then: Timestamp) -> String {
        let exact = wall_at(self.at, self.snapshot.now, then);
        let rounded = exact.checked_add(Duration::from_millis(500)).unwrap_or(exact);
        humantime::format_rfc3339_seconds(rounded).to_string()
    }
}

/// The elements of the operator's page.
struct Parts {
    top: Fragment,
    measure: Fragment,
    arrows: Fragment,
    tiles: Vec<Fragment>,
    causes: Fragment,
    step: Fragment,
    /// What stands on sheets: stops, checks, causes.
    stops: Fragment,
    checks: Fragment,
    all_causes: Fragment,
    details: Vec<Fragment>,
}

impl Parts {
    fn of(view: &View<'_>) -> Parts {
        let entries = entries::entries(view);
        Parts {
            top: top::top(view),
            measure: measure::measure(view),
            arrows: tile::arrows(view),
            tiles: (0..view.board.tiles.len()).map(|tile| tile::tile(view, tile)).collect(),
            causes: causes::causes(view, &entries),
            step: step::step(view),
            stops: step::all_stops(view),
            checks: step::all_checks(view),
            all_causes: causes::all_causes(view, &entries),
            details: (0..view.board.tiles.len()).map(|tile| detail::detail(view, tile)).collect(),
        }
    }

    fn into_fragments(self) -> Vec<Fragment> {
        let mut all = vec![self.top, self.measure, self.arrows];
        all.extend(self.tiles);
        all.extend([self.causes, self.step, self.stops, self.checks, self.all_causes]);
        all.extend(self.details);
        all
    }
}

/// Renders a template of this crate.
fn html(template: &impl askama::Template) -> String {
    template.render().expect("writing into a string does not fail")
}
