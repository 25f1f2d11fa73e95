//! The pages and their fragments as HTML. Nothing here reads a request or sends an answer.
//!
//! Everything that is shown comes from one [`Snapshot`]; text that the vehicle or a publisher wrote is
//! cleaned by [`crate::texts`] and escaped by the templates.

mod bars;
mod board;
mod faults;
pub(super) mod node_names;
pub(super) mod page;
mod permitted;
mod requests;
#[cfg(test)]
pub(super) mod tests;
pub(super) mod trends;
pub(super) mod versions;

use std::time::{Duration, SystemTime};

use crate::texts::{Lang, NAME, Words};
use bars::{action_bar, motion, top_bar};
use board::{Board, tile, tile_detail};
pub(crate) use faults::last_alarms::past_fault;
use faults::{entries, instruction, list};
use telltale_clock::{wall_at, with_a_text};
use telltale_engine::input::Refusal;
use telltale_engine::model::Stage;
use telltale_engine::snapshot::{Moving, Snapshot};
use telltale_engine::time::{Since, Span, Timestamp};
use telltale_runtime::Published;
use telltale_store::PastAlarm;
use versions::Seen;

pub use page::{
    DemoFault, Home, LoginContext, LoginFailure, PageContext, PagePart, Palette, RecorderState, demo_page,
    login_page, message_page, operator_page,
};
pub use permitted::permitted;
pub use trends::Trends;

/// Prefixes of the ids of elements in the panels behind tiles, and on sheets.
pub const DETAIL: &str = "detail-";
pub const SHEET: &str = "all-";

/// One element of the operator's page that changes with the vehicle.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fragment {
    /// The `id` of the element: always the same for the same part of the vehicle.
    pub id: String,
    /// The element, ready to be swapped in by its id.
    pub html: String,
}

/// Every element of the operator's page that changes with the snapshot, in page order. While the vehicle is
/// locked that is the top bar alone, whose stage sends the page to the login.
pub fn fragments(published: &Published, seen: &Seen, lang: Lang, trends: &Trends) -> Vec<Fragment> {
    let view = View { seen: seen.clone(), trends: Some(trends), ..View::new(published, lang, true) };
    if published.is_locked() {
        return vec![top_bar::top(&view)];
    }
    Parts::of(&view).into_fragments()
}

/// The last alarms, for a sheet of the operator's page.
pub fn last_alarms(published: &Published, lang: Lang, alarms: &[PastAlarm]) -> String {
    faults::last_alarms::last_alarms(&View::new(published, lang, false), alarms)
}

/// The reasons of a refusal, one sentence each, with the names that the page shows.
pub fn refusals(published: &Published, lang: Lang, reasons: &[Refusal]) -> Vec<String> {
    let view = View::new(published, lang, false);
    view.sentences(reasons)
}

/// A snapshot with everything that the parts of a page need.
pub(super) struct View<'a> {
    pub(super) snapshot: &'a Snapshot,
    pub(super) at: SystemTime,
    pub(super) lang: Lang,
    pub(super) words: &'static Words,
    pub(super) board: Board,
    /// The elements carry the mark by which htmx swaps them in.
    pub(super) swap: bool,
    /// It was then: there is nothing to act on.
    pub(super) replay: bool,
    /// The versions by which the buttons are shown.
    pub(super) seen: Seen,
    /// The recent past of the values, where it is shown.
    pub(super) trends: Option<&'a Trends>,
}

impl<'a> View<'a> {
    pub(super) fn new(published: &'a Published, lang: Lang, swap: bool) -> View<'a> {
        let snapshot = &*published.snapshot;
        let board = Board::of(&snapshot.layout);
        let (words, seen) = (Words::of(lang), Seen::default());
        let (at, replay) = (published.at, published.replay);
        View { snapshot, at, lang, words, board, swap, replay, seen, trends: None }
    }

    /// Somebody is logged in at the vehicle, who may act here.
    pub(super) fn may_act(&self) -> bool {
        self.snapshot.operator.is_some() && !self.replay
    }

    /// Whether the machine has stages (`vehicle.stages` is not `none`).
    pub(super) fn has_stages(&self) -> bool {
        self.snapshot.has_stages()
    }

    /// Whether the vehicle drives, or may start at any moment.
    pub(super) fn drives(&self) -> bool {
        self.has_stages() && matches!(self.snapshot.stage, Stage::Cleared | Stage::Active)
    }

    /// The stage whose advice counts: a vehicle that is held on its way and stands is advised as at a stop.
    pub(super) fn stage_of_advice(&self) -> Stage {
        let held = requests::has_banner(self) && !requests::waits_for_release(self);
        let stands = self.snapshot.motion.moving == Moving::No;
        if held && stands && self.drives() { Stage::Standby } else { self.snapshot.stage }
    }

    /// The name of the stop at which an operator says that the vehicle stands.
    pub(super) fn chosen_stop(&self) -> Option<String> {
        let pose = self.snapshot.localization.pose?;
        let stop = self.snapshot.layout.stops.iter().find(|stop| pose == (*stop).into())?;
        Some(self.lang.pick(&stop.name, NAME))
    }

    /// The wall clock's time of `then`, rounded to a second. The page counts on from there. A finer time
    /// would differ a little with each snapshot, and unchanged elements would be sent again.
    pub(super) fn wall(&self, then: Timestamp) -> String {
        self.wall_since(Since { at: then, before: Span::ZERO })
    }

    /// The same for what may come from an earlier run of the program.
    pub(super) fn wall_since(&self, since: Since) -> String {
        let exact = wall_at(self.at, self.snapshot.now, since.at);
        let exact = exact.checked_sub(Duration::from(since.before)).unwrap_or(exact);
        let rounded = exact.checked_add(Duration::from_millis(500)).unwrap_or(exact);
        humantime::format_rfc3339_seconds(with_a_text(rounded)).to_string()
    }
}

/// The elements of the operator's page.
struct Parts {
    motion: Fragment,
    top: Fragment,
    instruction: Fragment,
    arrows: Fragment,
    tiles: Vec<Fragment>,
    causes: Fragment,
    step: Fragment,
    /// The content of the sheets.
    stops: Fragment,
    checks: Fragment,
    all_causes: Fragment,
    details: Vec<Fragment>,
}

impl Parts {
    fn of(view: &View<'_>) -> Parts {
        let entries = entries::entries(view);
        Parts {
            motion: motion::motion(view),
            top: top_bar::top(view),
            instruction: instruction::instruction(view, &entries),
            arrows: tile::arrows(view),
            tiles: (0..view.board.tiles.len()).map(|tile| tile::tile(view, tile)).collect(),
            causes: list::causes(view, &entries),
            step: action_bar::step(view),
            stops: action_bar::all_stops(view),
            checks: action_bar::all_checks(view),
            all_causes: list::all_causes(view, &entries),
            details: (0..view.board.tiles.len()).map(|tile| tile_detail::detail(view, tile)).collect(),
        }
    }

    fn into_fragments(self) -> Vec<Fragment> {
        let mut all = vec![self.motion, self.top, self.instruction, self.arrows];
        all.extend(self.tiles);
        all.extend([self.causes, self.step, self.stops, self.checks, self.all_causes]);
        all.extend(self.details);
        all
    }
}

/// Renders a template of this crate.
pub(super) fn html(template: &impl askama::Template) -> String {
    template.render().expect("writing into a string does not fail")
}
